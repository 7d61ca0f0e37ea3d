//! What each command does.
//!
//! The commands that real jobs and hosts send, as Marlin 2.1.2 executes them
//! with arcs, inches, firmware retraction, host prompts and temperature
//! reports built in; a few that only set something up are taken and do
//! nothing; the rest is unknown.
use super::super::heater::Heater;
use super::super::line::trim_start;
use super::super::planner::Cornering;
use super::super::report;
use super::super::words::Command;
use super::Firmware;
use super::wait::{After, HEAT_REPORT_NS, Heat, Wait};
use super::watch::Did;

/// Marlin's EXTRUDE_MINTEMP.
const EXTRUDE_MIN_C: f64 = 170.0;

/// Marlin's TEMP_WINDOW and TEMP_RESIDENCY_TIME: how near the target counts as
/// there, and for how long it must stay.
const HEAT_WINDOW_C: f64 = 1.0;
const HEAT_RESIDENCY_S: f64 = 10.0;

/// Speeds of homing, mm/s, and what the touches of the switch take, s.
const HOME_XY_MM_S: f64 = 50.0;
const HOME_Z_MM_S: f64 = 10.0;
const HOME_TOUCH_S: f64 = 2.0;

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
            17, 18, 73, 75, 76, 77, 84, 92, 111, 117, 200, 206, 208, 209, 211, 300, 301, 304, 420, 486, 500,
            501, 502, 504, 569, 572, 593, 851, 900, 906, 907,
        ],
    ),
    (b'T', &[0]),
];

impl Firmware {
    /// Executes the command at the head of the queue, or begins to.
    pub(super) fn execute(&mut self) {
        let Some(number) = self.queue.front().map(|head| head.number) else {
            return;
        };
        if !self.faults_of_line(number) {
            return;
        }
        // The line is borrowed by its words while the board changes.
        let Some(line) = self.queue.front().map(|head| head.line.clone()) else {
            return;
        };
        let command = Command::parse(&line);
        self.note(|| Did::Took { number, command: command.whole.to_vec() });
        let waits = match command.letter {
            b'G' => self.g(&command),
            b'M' => self.m(&command),
            b'T' if command.code == 0 => Next::Ok,
            _ => Next::Unknown,
        };
        match waits {
            Next::Ok => {
                self.reply_ok("");
                self.pop();
            }
            Next::Silent => self.pop(),
            Next::Wait(wait) => self.begin_wait(wait),
            Next::Halted => {}
            Next::Unknown => {
                self.counts.unknown_commands += 1;
                let mut text = b"echo:Unknown command: \"".to_vec();
                text.extend(command.whole);
                text.extend(b"\"\n");
                self.say(&text);
                self.reply_ok("");
                self.pop();
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
            10 | 11 => {
                if let Some(path) = self.motion.firmware_retract(command.code == 10) {
                    return Next::Wait(Wait::Room(path));
                }
            }
            20 => self.motion.set_inches(true),
            21 => self.motion.set_inches(false),
            28 => {
                let named = [b'X', b'Y', b'Z'].map(|axis| command.has(axis));
                let axes = if named.contains(&true) { named } else { [true; 3] };
                return Next::Wait(Wait::Drain(After::Home(axes)));
            }
            29 => {
                let lasts_ns = self.scaled_ns(PROBING_S);
                return Next::Wait(Wait::Drain(After::Dwell { lasts_ns }));
            }
            90 => self.motion.set_relative(false),
            91 => self.motion.set_relative(true),
            92 => self.motion.name_position(command),
            _ => return taken(command),
        }
        Next::Ok
    }

    fn move_to(&mut self, command: &Command<'_>) -> Next {
        let mut path = self.motion.go(command);
        let cold = self.nozzle.temperature_c(self.simulated_s()) < EXTRUDE_MIN_C;
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
            0 | 1 | 600 => {
                let at_most_ns = seconds_of(command).map(|s| self.scaled_ns(s));
                return Next::Wait(Wait::Drain(After::AskUser { at_most_ns }));
            }
            82 => self.motion.set_e_relative(false),
            83 => self.motion.set_e_relative(true),
            85 => {
                let seconds = s.unwrap_or(0.0).clamp(0.0, PAUSE_S_MAX);
                self.inactive_max_ns = (seconds > 0.0).then_some((seconds * 1e9) as u64);
            }
            104 | 109 => return self.heat_nozzle(command, now_s),
            140 | 190 => return self.heat_bed(command, now_s),
            105 => {
                let more = format!(" {}", self.temperatures());
                self.reply_ok(&more);
                return Next::Silent;
            }
            106 => self.fan = s.unwrap_or(255.0).clamp(0.0, 255.0) as u8,
            107 => self.fan = 0,
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
            113 => match s {
                Some(s) => self.busy_every_ns = (s.clamp(0.0, 60.0) * 1e9) as u64,
                None => {
                    let text = format!("echo:M113 S{}\n", self.busy_every_ns / 1_000_000_000);
                    self.say(text.as_bytes());
                }
            },
            114 => self.say(report::position(self.motion.at_mm).as_bytes()),
            115 => {
                let text = report::identity(&self.config.machine.name, self.config.emergency_parser);
                self.say(text.as_bytes());
            }
            118 => self.echo(command),
            155 => {
                let every_ns = (s.unwrap_or(0.0).clamp(0.0, 60.0) as u64) * 1_000_000_000;
                self.auto_report = (every_ns > 0).then(|| (every_ns, self.now_ns() + every_ns));
            }
            201 | 203 | 204 | 205 | 207 => self.set_dynamics(command),
            220 => self.motion.feed_factor = percent(s, self.motion.feed_factor),
            221 => self.motion.flow_factor = percent(s, self.motion.flow_factor),
            302 => self.cold_extrusion_allowed = command.value(b'P') == Some(1.0) || s == Some(0.0),
            400 => return Next::Wait(Wait::Drain(After::Nothing)),
            999 => self.ask_resend(true),
            _ => return taken(command),
        }
        Next::Ok
    }

    fn late_emergency(&mut self, code: u32) {
        if !self.config.emergency_parser && code == 410 {
            self.planner.stop(self.now_ns());
        }
    }

    fn set_number(&mut self, command: &Command<'_>) {
        let Some(n) = command.value(b'N') else {
            return;
        };
        let n = n as i64;
        // A numbered M110 was counted when it was read; that the number is set
        // once more here, over lines that were read since, is Marlin's way: a
        // host must wait for the `ok` of M110.
        if self.queue.front().is_some_and(|head| head.number.is_none()) {
            self.renumber(self.numbering.last, n);
        }
        self.numbering.last = n;
    }

    fn heat_nozzle(&mut self, command: &Command<'_>, now_s: f64) -> Next {
        let most_c = self.config.machine.nozzle_max_c;
        let Some((target_c, cools)) = target(command, most_c) else {
            return Next::Ok;
        };
        self.nozzle.set(target_c, now_s);
        if command.code == 104 {
            return Next::Ok;
        }
        self.wait_for(&self.nozzle, cools, now_s)
    }

    fn heat_bed(&mut self, command: &Command<'_>, now_s: f64) -> Next {
        let most_c = self.config.machine.bed_max_c;
        let Some((target_c, cools)) = target(command, most_c) else {
            return Next::Ok;
        };
        self.bed.set(target_c, now_s);
        if command.code == 140 {
            return Next::Ok;
        }
        self.wait_for(&self.bed, cools, now_s)
    }

    /// M109 and M190: S waits for heating only, R for cooling too.
    fn wait_for(&self, heater: &Heater, cools: bool, now_s: f64) -> Next {
        let hotter = heater.temperature_c(now_s) > heater.target_c() + HEAT_WINDOW_C;
        if heater.target_c() <= 0.0 || (hotter && !cools) {
            return Next::Ok;
        }
        let in_s = heater.reaches_s(HEAT_WINDOW_C, now_s) - now_s;
        let now_ns = self.now_ns();
        Next::Wait(Wait::Heat(Heat {
            reached_ns: now_ns + self.scaled_ns(in_s),
            done_ns: now_ns + self.scaled_ns(in_s + HEAT_RESIDENCY_S),
            report_ns: now_ns + HEAT_REPORT_NS,
        }))
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

    fn set_dynamics(&mut self, command: &Command<'_>) {
        let dynamics = &mut self.planner.dynamics;
        let positive = |letter| command.value(letter).filter(|v| *v > 0.0);
        match command.code {
            201 | 203 => {
                for (axis, letter) in [b'X', b'Y', b'Z', b'E'].into_iter().enumerate() {
                    if let Some(value) = positive(letter) {
                        if command.code == 201 {
                            dynamics.max_accel_mm_s2[axis] = value;
                        } else {
                            dynamics.max_feed_mm_s[axis] = value;
                        }
                    }
                }
            }
            204 => {
                let both = positive(b'S');
                let set = |to: &mut f64, value: Option<f64>| *to = value.unwrap_or(*to);
                set(&mut dynamics.print_mm_s2, positive(b'P').or(both));
                set(&mut dynamics.travel_mm_s2, positive(b'T').or(both));
                set(&mut dynamics.retract_mm_s2, positive(b'R'));
            }
            205 => {
                let jerk = positive(b'X').or(positive(b'Y')).map(Cornering::JerkMmS);
                let junction = positive(b'J').map(Cornering::JunctionMm);
                dynamics.cornering = junction.or(jerk).unwrap_or(dynamics.cornering);
            }
            _ => {
                let (length, feed) = &mut self.motion.retract;
                *length = positive(b'S').unwrap_or(*length);
                *feed = positive(b'F').map_or(*feed, |f| f / 60.0);
            }
        }
    }

    /// How long homing these axes takes, s of the machine's time.
    pub(super) fn homing_s(&self, axes: [bool; 3]) -> f64 {
        let speeds = [HOME_XY_MM_S, HOME_XY_MM_S, HOME_Z_MM_S];
        (0..3)
            .filter(|&axis| axes[axis])
            .map(|axis| HOME_TOUCH_S + self.motion.at_mm[axis].abs().min(1000.0) / speeds[axis])
            .sum()
    }
}

/// What follows the execution of a command.
enum Next {
    Ok,
    /// It has said its `ok` itself.
    Silent,
    Wait(Wait),
    Halted,
    Unknown,
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

/// The target of S or R, and whether cooling is waited for too.
fn target(command: &Command<'_>, most_c: f64) -> Option<(f64, bool)> {
    let s = command.value(b'S');
    let target_c = s.or(command.value(b'R'))?;
    Some((target_c.clamp(0.0, most_c), s.is_none()))
}

fn percent(s: Option<f64>, now: f64) -> f64 {
    s.map_or(now, |s| (s / 100.0).clamp(0.01, 9.99))
}
