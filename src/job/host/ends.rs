//! Cancel, emergency stop, failure, and the end of a connection.
//!
//! Takes the user's wish and the session's last word; leaves the job in a state and
//! writes down what is known of the nozzle's height.
use super::{Doing, Happening, Host};
use crate::job::record::Record;
use crate::job::state::{Decision, State, next};
use crate::printer::session::{Ending, Failure, Outcome, Safety};
use crate::printer::source::Source;

impl<S: Source> Host<S> {
    pub(super) fn want_cancel(&mut self, now_ms: u64) {
        match next(self.state, Happening::Cancel) {
            Decision::To(_) => {
                self.happen(Happening::Cancel);
                self.doing = Doing::Finishing;
                self.gate = None;
                self.keep_still_if_unmoved();
                self.session.cancel(now_ms);
            }
            Decision::Refuse(why) => self.refuse(why),
            Decision::Stay => {}
        }
    }

    /// Of a job that is begun here and has moved nothing: the plate may stand at the top of its travel,
    /// and a cancel macro would raise it.
    pub(super) fn keep_still_if_unmoved(&mut self) {
        if self.taken.is_none() && self.source.is_unmoved() {
            self.session.keep_still(true);
        }
    }

    pub(super) fn want_emergency_stop(&mut self, now_ms: u64) {
        if self.over.is_some() || self.closing {
            return self.refuse("the job is over");
        }
        // Whatever the state: this is never refused while there is a connection.
        self.gate = None;
        self.doing = Doing::Finishing;
        self.session.emergency_stop(now_ms);
    }

    /// The session's last word.
    pub(super) fn ended(&mut self, outcome: &Outcome, _now_ms: u64) {
        self.over = Some(outcome.clone());
        self.gate = None;
        let halted = match outcome {
            Outcome::Finished => false,
            Outcome::Stopped { ending, .. } => {
                matches!(ending, Ending::EmergencyStop | Ending::Failed(Failure::Fatal { .. }))
            }
        };
        self.resets = halted && self.settings.resets_when_halted;
        match outcome {
            Outcome::Finished => {
                self.happen(Happening::Ended);
            }
            Outcome::Stopped { ending, safety } => {
                if self.begun {
                    self.note(0);
                    self.note_height(*safety);
                }
                self.stopped(ending);
            }
        }
        self.flight.clear();
    }

    fn stopped(&mut self, ending: &Ending) {
        match ending {
            Ending::Cancelled if self.state == State::Failing && !self.begun => {
                self.happen(Happening::Spoil);
            }
            Ending::Cancelled => _ = self.happen(Happening::Safe),
            Ending::EmergencyStop => _ = self.happen(Happening::EmergencyStop),
            Ending::Failed(failure) => {
                self.book.push(Record::Note(failure.to_string()));
                if let Failure::Reset { .. } = failure {
                    self.happen(Happening::Reset);
                    return;
                }
                if self.state == State::Cancelling {
                    self.happen(Happening::Safe);
                    return;
                }
                self.happen(Happening::Fail);
                let for_good = matches!(failure, Failure::Source { .. } | Failure::LineTooLong { .. });
                let event = if for_good || !self.begun { Happening::Spoil } else { Happening::Safe };
                self.happen(event);
            }
        }
    }

    /// How high the nozzle is after the cancel macro, as far as that is certain.
    fn note_height(&mut self, safety: Safety) {
        if self.session.keeps_still() {
            return;
        }
        let z_mm = match safety {
            // The macro did not run: it stands where it stood.
            Safety::Untouched | Safety::ByFirmware => return,
            Safety::Unknown if self.link_down => return,
            Safety::Unknown => None,
            Safety::Acknowledged => self.height_after_cancel(),
        };
        self.book.push(Record::MadeSafe { z_mm });
    }

    /// The printer may have made none or all of the moves that were not acknowledged, and may
    /// have been anywhere among our own lines.
    fn height_after_cancel(&self) -> Option<f64> {
        if !self.own.is_empty() {
            return None;
        }
        let after = |tracker: &crate::job::tracker::Tracker| {
            let mut tracker = tracker.clone();
            for line in &self.settings.session.cancel_macro {
                tracker.apply(line.as_bytes());
            }
            tracker.at_mm(2)
        };
        let first = after(&self.tracker)?;
        let mut tracker = self.tracker.clone();
        for one in self.flight.iter() {
            tracker.apply(&one.text);
            if after(&tracker).is_none_or(|z| (z - first).abs() > 1e-6) {
                return None;
            }
        }
        Some(first)
    }
}
