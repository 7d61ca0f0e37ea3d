//! Pause and resume: park, wait, go back to exactly where it was.
//!
//! Takes what the user or the printer wants, gives the session lines of ours. What the
//! tracker knows is made good by what the printer reports (M114).
use super::{Doing, Happening, Host};
use crate::job::recover::lower_again;
use crate::job::state::{Decision, State, next};
use crate::job::tracker::{Tracker, unpark};
use crate::printer::source::Source;

/// A parked machine.
#[derive(Debug)]
pub(super) struct Parked {
    /// What it goes back to.
    pub(super) want: Tracker,
    /// Since when, ms.
    since_ms: u64,
    /// Its target was lowered, or need not be.
    cooled: bool,
}

impl<S: Source> Host<S> {
    pub(super) fn want_pause(&mut self, now_ms: u64) {
        match next(self.state, Happening::Pause) {
            Decision::To(_)
                if self.doing == Doing::Feeding && self.gate.is_none() && self.source.may_hold() =>
            {
                self.happen(Happening::Pause);
                self.doing = Doing::Holding;
                self.session.hold(now_ms);
            }
            Decision::To(_) => self.note_pause(),
            Decision::Stay => match self.state {
                // A resume that was noted is taken back.
                State::Pausing | State::Paused => self.wishes.resume = false,
                _ => self.note_pause(),
            },
            Decision::Refuse(why) => self.refuse(why),
        }
    }

    fn note_pause(&mut self) {
        self.wishes.pause = true;
        self.say("it pauses as soon as it can");
    }

    pub(super) fn want_resume(&mut self, now_ms: u64) {
        match next(self.state, Happening::Resume) {
            Decision::To(_) if self.doing == Doing::Parked => {
                self.happen(Happening::Resume);
                let lines = ["M400", "M114"].map(str::to_owned).to_vec();
                self.run(lines, Doing::Asking, now_ms);
            }
            Decision::To(_) => self.wishes.resume = true,
            Decision::Stay => match self.state {
                State::Pausing => self.wishes.resume = true,
                State::Asking => {
                    if !self.session.command("M108", now_ms) {
                        self.refuse("the printer does not listen now: answer it at its panel");
                    }
                }
                _ => self.wishes.pause = false,
            },
            Decision::Refuse(why) => self.refuse(why),
        }
    }

    /// Nothing is in flight and it is written down how far the file is.
    pub(super) fn park(&mut self, now_ms: u64) {
        let mut lines = vec!["M114".to_owned()];
        lines.extend(self.settings.pause_macro.iter().cloned());
        self.run(lines, Doing::Parking, now_ms);
    }

    /// What was reported before the macro ran makes good what lines do not tell.
    pub(super) fn tracker_before_parking(&mut self) {
        if let Some(report) = self.reports[0] {
            self.tracker.resolve(report);
        }
        self.parked = Some(Box::new(Parked { want: self.tracker.clone(), since_ms: 0, cooled: false }));
    }

    pub(super) fn parked_now(&mut self, now_ms: u64) {
        self.happen(Happening::Parked);
        self.wishes.ran_out = false;
        self.doing = Doing::Parked;
        if let Some(parked) = &mut self.parked {
            parked.since_ms = now_ms;
        }
        if std::mem::take(&mut self.wishes.resume) {
            self.want_resume(now_ms);
        }
    }

    /// Parked by a host before us: `want` is where the file is.
    pub(super) fn found_parked(&mut self, want: Tracker, now_ms: u64) {
        self.parked = Some(Box::new(Parked { want, since_ms: now_ms, cooled: false }));
        self.happen(Happening::Parked);
        self.doing = Doing::Parked;
        if std::mem::take(&mut self.wishes.resume) {
            self.want_resume(now_ms);
        }
    }

    /// When a long pause lowers the nozzle's target, ms.
    pub(super) fn cools_at(&self) -> Option<u64> {
        let cooling = self.settings.pause_cooling?;
        let parked = self.parked.as_ref().filter(|p| self.doing == Doing::Parked && !p.cooled)?;
        Some(parked.since_ms + cooling.after_ms)
    }

    pub(super) fn cool_down(&mut self, now_ms: u64) {
        let Some(cooling) =
            self.settings.pause_cooling.filter(|_| self.cools_at().is_some_and(|at| at <= now_ms))
        else {
            return;
        };
        let to_c = f64::from(cooling.nozzle_c);
        let is_c = self.tracker.dials.nozzles_c.get(self.tracker.tool()).copied().flatten();
        if let Some(parked) = &mut self.parked {
            parked.cooled = true;
        }
        // Only what is known to be hotter, and can be put back.
        if is_c.is_some_and(|is_c| is_c > to_c) {
            self.run(vec![format!("M104 S{to_c}")], Doing::Cooling, now_ms);
            self.say(format!("the nozzle cools to {to_c} °C until the job goes on"));
        }
    }

    pub(super) fn cooled(&mut self, now_ms: u64) {
        self.doing = Doing::Parked;
        if std::mem::take(&mut self.wishes.resume) {
            self.want_resume(now_ms);
        }
    }

    /// Where the head is parked was reported: the way back.
    pub(super) fn unpark(&mut self, now_ms: u64) {
        let Some(parked) = &self.parked else {
            return;
        };
        if let Some(report) = self.reports[1] {
            // Somebody may have moved it.
            self.tracker.relocate(report);
        }
        let rules = &self.settings.resume;
        let lines = match &rules.plate {
            Some(_) => lower_again(&parked.want),
            None => unpark(&self.tracker, &parked.want, rules.raise_mm),
        };
        self.run(lines, Doing::Unparking, now_ms);
    }

    pub(super) fn unparked(&mut self) {
        if let Some(parked) = self.parked.take() {
            let dials = self.tracker.dials;
            self.tracker = parked.want;
            // The way back has set what differed; what it did not, a person has.
            self.tracker.dials = dials;
        }
        self.lead_to_file(Happening::Restored);
    }

    /// A person's command beside the job.
    pub(super) fn want_command(&mut self, command: &str, now_ms: u64) {
        let word = command.trim_start().as_bytes().first().map(u8::to_ascii_uppercase);
        let upsets = |text: &str| {
            let number = text.trim_start().get(1..).unwrap_or_default();
            let digits: String = number.chars().take_while(char::is_ascii_digit).collect();
            matches!(digits.trim_start_matches('0'), "82" | "83" | "600" | "601" | "125" | "84" | "18")
        };
        let moves = match word {
            Some(b'M') => upsets(command),
            _ => true,
        };
        let at_rest = matches!(self.state, State::Paused | State::Asking);
        if moves && !at_rest && self.state.is_active() {
            return self.refuse("what moves the head or changes modes waits for a pause");
        }
        if !self.session.command(command, now_ms) {
            return self.refuse("the printer cannot take this command now");
        }
        if matches!(word, Some(b'M' | b'T')) {
            // What a person sets stays set.
            self.tracker.apply(command.trim().as_bytes());
            if let Some(parked) = &mut self.parked {
                parked.want.apply(command.trim().as_bytes());
            }
        }
    }
}
