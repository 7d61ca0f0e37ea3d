//! What the command at the head of the queue waits for, and its end.
//!
//! One command is executed at a time; while it waits, lines are still read
//! and reports still sent. Knows times only as the board's clock gives them.
use super::super::motion::Path;
use super::super::report;
use super::Firmware;

/// Between the lines of a wait for heat.
pub(super) const HEAT_REPORT_NS: u64 = 1_000_000_000;

/// What the command at the head of the queue waits for.
#[derive(Debug)]
pub(super) enum Wait {
    /// Room in the planner for the rest of its path.
    Room(Path),
    /// The end of all moves, and then something.
    Drain(After),
    /// A time.
    Until(u64),
    /// A temperature.
    Heat(Heat),
    /// The user (M108 or M876), or a time if it is given. After a change of filament
    /// the job is said to be resumed.
    User { until_ns: Option<u64>, change: bool },
}

/// A wait for a temperature.
#[derive(Clone, Copy, Debug)]
pub(super) struct Heat {
    /// When the temperature is in its window.
    pub(super) reached_ns: u64,
    /// When it has been there long enough.
    pub(super) done_ns: u64,
    pub(super) report_ns: u64,
}

/// What comes after the last move.
#[derive(Clone, Copy, Debug)]
pub(super) enum After {
    Nothing,
    Dwell { lasts_ns: u64 },
    Home { axes: [bool; 3], raise_mm: f64 },
    Probe { lasts_ns: u64 },
    Cutter { power: u8 },
    AskUser { title: &'static str, at_most_ns: Option<u64> },
    ChangeFilament,
}

impl Firmware {
    /// When M85 gives up; a command that waits counts as activity.
    pub(super) fn inactive_at_ns(&self) -> Option<u64> {
        let idle = self.wait.is_none() && self.planner.is_empty();
        self.inactive_max_ns.filter(|_| idle).map(|max| self.last_command_ns.saturating_add(max))
    }

    pub(super) fn timers(&mut self) {
        if let Some((every_ns, next_ns)) = self.auto_report
            && next_ns <= self.now_ns
        {
            self.auto_report = Some((every_ns, self.now_ns + every_ns));
            let text = format!(" {}\n", self.temperatures());
            self.say(text.as_bytes());
        }
        if self.inactive_at_ns().is_some_and(|at| at <= self.now_ns) {
            self.kill("!! KILLED caused by too much inactive time");
            return;
        }
        if self.is_idle() && self.wait_next_ns <= self.now_ns {
            self.wait_next_ns = self.now_ns + (self.config.habits.wait_s * 1e9) as u64;
            self.say(b"wait\n");
        }
        let Some((wait, _)) = &mut self.wait else {
            return;
        };
        let paused = matches!(wait, Wait::User { .. });
        let ends = matches!(wait, Wait::Until(at_ns) if *at_ns <= self.now_ns);
        if let Wait::Heat(heat) = wait
            && heat.report_ns <= self.now_ns
            && heat.done_ns > self.now_ns
        {
            heat.report_ns = self.now_ns + HEAT_REPORT_NS;
            let left_ns = (heat.reached_ns <= self.now_ns).then(|| heat.done_ns - self.now_ns);
            // The wait lasts `speed` times longer for the machine.
            let left_s = left_ns.map(|ns| (ns as f64 * self.config.speed / 1e9) as u64);
            let text = report::heating(&self.temperatures(), left_s);
            self.say(text.as_bytes());
        }
        // A pause that ends now is over before anything is said: a note takes its time on the
        // line, and what the pause is for would last longer.
        if self.busy_every_ns > 0 && self.busy_next_ns <= self.now_ns && !ends {
            self.busy_next_ns = self.now_ns + self.busy_every_ns;
            self.say(report::busy(paused));
        }
    }

    /// The command at the head of the queue waits now.
    pub(super) fn begin_wait(&mut self, wait: Wait) {
        self.busy_next_ns = self.now_ns + self.busy_every_ns;
        self.wait = Some((wait, self.now_ns));
        self.go_on();
    }

    /// Goes on with what waits; true when it got anywhere.
    pub(super) fn go_on(&mut self) -> bool {
        let now_ns = self.now_ns;
        let Some((wait, _)) = &mut self.wait else {
            return false;
        };
        let done = match wait {
            Wait::Room(path) => loop {
                if self.planner.free() == 0 {
                    break false;
                }
                match path.next() {
                    Some(by_mm) => {
                        self.counts.extruded_mm += by_mm[3];
                        self.planner.push(now_ns, by_mm, path.feed_mm_s);
                    }
                    None => {
                        self.deed_is_planned();
                        break true;
                    }
                }
            },
            Wait::Drain(after) if self.planner.is_empty() => {
                let after = *after;
                return self.drained(after);
            }
            Wait::Drain(_) => false,
            Wait::Until(at_ns) => *at_ns <= now_ns,
            Wait::Heat(heat) => heat.done_ns <= now_ns,
            Wait::User { until_ns, .. } => until_ns.is_some_and(|at| at <= now_ns),
        };
        if done {
            self.finish();
        }
        done
    }

    /// All moves have ended: the second part of G4, G28, M0 and M400.
    pub(super) fn drained(&mut self, after: After) -> bool {
        let next = match after {
            After::Nothing => {
                self.finish();
                return true;
            }
            After::Cutter { power } => {
                self.cutter = power;
                self.look_at_light();
                self.finish();
                return true;
            }
            After::Dwell { lasts_ns } => Wait::Until(self.now_ns.saturating_add(lasts_ns)),
            After::Home { axes, raise_mm } => {
                let lasts_s = self.home(axes, raise_mm);
                self.tell_position = self.config.habits.tells_position;
                Wait::Until(self.now_ns.saturating_add(self.scaled_ns(lasts_s)))
            }
            After::Probe { lasts_ns } => {
                self.body.probe();
                self.levelling_on = self.config.machine.levelling;
                Wait::Until(self.now_ns.saturating_add(lasts_ns))
            }
            After::AskUser { title, at_most_ns } => {
                self.ask(title);
                let until_ns = at_most_ns.map(|ns| self.now_ns.saturating_add(ns));
                Wait::User { until_ns, change: false }
            }
            After::ChangeFilament => {
                self.say(b"//action:paused\n");
                self.say(report::INSERT.as_bytes());
                self.ask("Nozzle Parked");
                Wait::User { until_ns: None, change: true }
            }
        };
        self.wait = Some((next, self.now_ns));
        true
    }

    fn ask(&mut self, title: &str) {
        if self.config.habits.prompts {
            self.say(report::prompt(title).as_bytes());
        }
    }

    /// The runout sensor: Marlin puts M600 before the commands that it has.
    pub(super) fn begin_runout(&mut self) {
        self.runout = false;
        self.injected = true;
        let text = format!("//action:out_of_filament T{}\n", self.heaters.tool);
        self.say(text.as_bytes());
        self.begin_wait(Wait::Drain(After::ChangeFilament));
    }

    /// The command at the head of the queue is done: its `ok` goes out.
    pub(super) fn finish(&mut self) {
        if let Some((wait, since_ns)) = self.wait.take() {
            if !matches!(wait, Wait::Room(_) | Wait::Drain(_)) {
                self.planner.excuse(since_ns, self.now_ns);
            }
            if matches!(wait, Wait::User { change: true, .. }) {
                self.say(b"//action:resumed\n");
            }
        }
        if std::mem::take(&mut self.injected) {
            return;
        }
        if std::mem::take(&mut self.tell_position) {
            self.say_position();
        }
        self.done();
    }
}
