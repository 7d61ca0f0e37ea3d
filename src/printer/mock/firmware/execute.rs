//! What each command does.
//!
//! The commands that real jobs and hosts send, as Marlin 2.1.2 executes them
//! with arcs, inches, firmware retraction, host prompts and temperature
//! reports built in; a few that only set something up are taken and do
//! nothing; the rest is unknown.
use super::super::line::trim_start;
use super::super::report;
use super::super::words::Command;
use super::Firmware;
use super::wait::{After, Wait};

/// Marlin's EXTRUDE_MINTEMP.
const EXTRUDE_MIN_C: f64 = 170.0;

/// What probing the bed takes, s.
const PROBING_S: f64 = 30.0;

/// Longest pause of one G4 or M0: a day, so that a number of any size is a time.
const PAUSE_S_MAX: f64 = 86_400.0;

/// Commands that are taken and change nothing a host can see.
const TAKEN: &[(u8, &[u32])] = &[
    (b'G', &[17, 21]),
    (
        b'M',
        &[
            17, 18, 73, 75, 76, 77, 84, 92, 111, 117, 200, 206, 208, 209, 300, 301, 304, 420, 486, 500, 501,
            502, 504, 569, 572, 593, 851, 900, 906, 907,
        ],
    ),
];

impl Firmware {
    /// Executes the command at the head of the queue, or begins to.
    pub(super) fn execute(&mut self) {
        let Some(number) = self.queue.front().map(|head| head.number) else {
            return;
        };
        if self.script.is_some() {
            if let Some(line) = self.next_of_script() {
                self.execute_line(None, &line);
            }
            return;
        }
        if !self.faults_of_line(number) {
            return;
        }
        // The line is borrowed by its words while the board changes.
        if let Some(line) = self.queue.front_mut().map(|head| std::mem::take(&mut head.line)) {
            self.execute_line(number, &line);
        }
    }

    /// The command that is executed is done: its `ok` goes out, unless a macro runs it.
    pub(super) fn done(&mut self) {
        if self.script.is_none() {
            self.reply_ok("");
        }
        self.leave();
    }

    /// The same without an `ok`.
    fn leave(&mut self) {
        if self.script.is_none() {
            self.pop();
        } else {
            self.note_executed(None);
            self.last_command_ns = self.now_ns;
        }
    }

    fn execute_line(&mut self, number: Option<i64>, line: &[u8]) {
        let command = Command::parse(line);
        if is_move(&command) {
            self.begin_deed(number, command.whole);
        } else {
            self.current = command.whole.to_vec();
        }
        let waits = match command.letter {
            b'G' => self.g(&command),
            b'M' => self.m(&command),
            b'T' => self.change_tool(command.code),
            _ => Next::Unknown,
        };
        match waits {
            Next::Ok => self.done(),
            Next::Silent => self.leave(),
            Next::Wait(wait) => self.begin_wait(wait),
            Next::Halted | Next::Script => {}
            Next::Unknown => {
                self.counts.unknown_commands += 1;
                let mut text = b"echo:Unknown command: \"".to_vec();
                text.extend(command.whole);
                text.extend(b"\"\n");
                self.say(&text);
                self.done();
            }
        }
    }

    fn g(&mut self, command: &Command<'_>) -> Next {
        match command.code {
            0..=3 => return self.move_to(command),
            4 => {
                let seconds = seconds_of(command).unwrap_or(0.0);
                let lasts_ns = self.scaled_ns(seconds);
                return Next::Wait(Wait::Drain(After::Dwell { lasts_ns }));
            }
            10 | 11 if self.config.machine.resin.is_none() => {
                if let Some(path) = self.motion.firmware_retract(command.code == 10) {
                    return Next::Wait(Wait::Room(path));
                }
                self.deed_is_planned();
            }
            20 => self.motion.set_inches(true),
            21 => self.motion.set_inches(false),
            28 => return self.begin_homing(command),
            29 if self.config.machine.resin.is_none() => {
                let lasts_ns = self.scaled_ns(PROBING_S);
                return Next::Wait(Wait::Drain(After::Probe { lasts_ns }));
            }
            90 => self.motion.set_relative(false),
            91 => self.motion.set_relative(true),
            92 => self.name_position(command),
            _ => return taken(command),
        }
        Next::Ok
    }

    fn move_to(&mut self, command: &Command<'_>) -> Next {
        let mut path = self.motion.go(command);
        let cold = self.nozzle_c() < EXTRUDE_MIN_C;
        if cold && !self.cold_extrusion_allowed && path.stop_filament() {
            self.counts.cold_extrusions += 1;
            self.say(b"echo: cold extrusion prevented\n");
        }
        Next::Wait(Wait::Room(path))
    }

    fn m(&mut self, command: &Command<'_>) -> Next {
        let s = command.value(b'S');
        let now_s = self.simulated_s();
        match command.code {
            0 | 1 => {
                let at_most_ns = seconds_of(command).map(|s| self.scaled_ns(s));
                let title = if command.code == 0 { "M0 Stop" } else { "M1 Stop" };
                return Next::Wait(Wait::Drain(After::AskUser { title, at_most_ns }));
            }
            600 => return Next::Wait(Wait::Drain(After::ChangeFilament)),
            82 => self.motion.set_e_relative(false),
            83 => self.motion.set_e_relative(true),
            85 => {
                let seconds = s.unwrap_or(0.0).clamp(0.0, PAUSE_S_MAX);
                self.inactive_max_ns = (seconds > 0.0).then_some((seconds * 1e9) as u64);
            }
            104 | 109 => return self.heat_nozzle(command, now_s),
            140 | 190 => return self.heat_bed(command, now_s),
            141 | 191 if self.heaters.chamber.is_some() => return self.heat_chamber(command, now_s),
            105 => {
                let more = format!(" {}", self.temperatures());
                self.reply_ok(&more);
                return Next::Silent;
            }
            // One fan: what is for others is taken, as where FAN_COUNT is 1.
            106 | 107 if command.value(b'P').is_some_and(|p| p >= 1.0) => {}
            106 | 107 => {
                let on = s.unwrap_or(255.0).clamp(0.0, 255.0) as u8;
                self.fan = if command.code == 106 { on } else { 0 };
                self.look_at_light();
            }
            3..=5 if self.has_cutter() => return Next::Wait(self.cut(command)),
            211 => self.motion.endstops_on = s.map_or(self.motion.endstops_on, |s| s != 0.0),
            810..=819 if self.config.machine.macros => return self.keep_or_run(command),
            // Seen on arrival with an emergency parser, or while the line was
            // read without one; what is left is a numbered line without one.
            108 | 410 | 876 => self.late_emergency(command.code),
            112 => {
                if !self.config.emergency_parser {
                    self.kill("");
                    return Next::Halted;
                }
            }
            110 => self.set_number(command),
            113 if self.config.habits.busy_notes => match s {
                Some(s) => self.busy_every_ns = (s.clamp(0.0, 60.0) * 1e9) as u64,
                None => {
                    let text = format!("echo:M113 S{}\n", self.busy_every_ns / 1_000_000_000);
                    self.say(text.as_bytes());
                }
            },
            114 => self.say_position(),
            115 => {
                let text = report::identity(&self.config);
                self.say(text.as_bytes());
            }
            118 => self.echo(command),
            155 if self.config.habits.auto_report => {
                let every_ns = (s.unwrap_or(0.0).clamp(0.0, 60.0) as u64) * 1_000_000_000;
                self.auto_report = (every_ns > 0).then(|| (every_ns, self.now_ns() + every_ns));
            }
            201 | 203 | 204 | 205 | 207 => self.set_dynamics(command),
            220 => self.motion.feed_factor = percent(s, self.motion.feed_factor),
            221 => self.motion.flow_factor = percent(s, self.motion.flow_factor),
            302 => self.cold_extrusion_allowed = command.value(b'P') == Some(1.0) || s == Some(0.0),
            400 => return Next::Wait(Wait::Drain(After::Nothing)),
            420 if self.config.machine.levelling => self.set_levelling(s),
            999 => self.ask_resend(true),
            _ => return taken(command),
        }
        Next::Ok
    }

    fn late_emergency(&mut self, code: u32) {
        if !self.config.emergency_parser && code == 410 {
            self.quick_stop();
        }
    }

    /// M118: `E1` puts `echo:` before the text, `A1` puts `//`.
    fn echo(&mut self, command: &Command<'_>) {
        let mut text = command.rest;
        let mut out = Vec::new();
        for _ in 0..2 {
            match text {
                [b'A', b'1', rest @ ..] => {
                    out.extend(b"//");
                    text = trim_start(rest);
                }
                [b'E', b'1', rest @ ..] => {
                    out.extend(b"echo:");
                    text = trim_start(rest);
                }
                _ => break,
            }
        }
        out.extend(text);
        out.push(b'\n');
        self.say(&out);
    }
}

/// What follows the execution of a command.
pub(super) enum Next {
    Ok,
    /// It has said its `ok` itself.
    Silent,
    Wait(Wait),
    Halted,
    /// Its macro's commands come first.
    Script,
    Unknown,
}

/// Moves are noted when they end, anything else when it is done.
fn is_move(command: &Command<'_>) -> bool {
    command.letter == b'G' && matches!(command.code, 0..=3 | 10 | 11)
}

fn taken(command: &Command<'_>) -> Next {
    let known =
        TAKEN.iter().any(|(letter, codes)| *letter == command.letter && codes.contains(&command.code));
    if known { Next::Ok } else { Next::Unknown }
}

/// S seconds or P milliseconds; S wins, as in Marlin.
fn seconds_of(command: &Command<'_>) -> Option<f64> {
    let seconds = command.value(b'S').or(command.value(b'P').map(|ms| ms / 1000.0))?;
    Some(seconds.clamp(0.0, PAUSE_S_MAX))
}

fn percent(s: Option<f64>, now: f64) -> f64 {
    s.map_or(now, |s| (s / 100.0).clamp(0.01, 9.99))
}
