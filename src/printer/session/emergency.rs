//! M112, ahead of all else.
//!
//! ```text
//!  emergency_stop ─► M112 ─► halted, or start ─► EmergencyStopped { by: Firmware }
//!                      │
//!                      └ 1 s ─► wants_hard_stop ─► hard_stopped(true) ─► start ─► by: Reset
//!                                                │                       └ 5 s ─► by: None
//!                                                └ hard_stopped(false) ────────► by: None
//! ```
//! A line feed goes first: part of a line may be out, and what the system dropped at our
//! wish ([`Session::wants_flush`]) may have cut another. Firmware leaves an empty line
//! unanswered. M112 is repeated until it has an effect: without an emergency parser it waits
//! behind the window, and a line that was cut makes the firmware throw away what follows.
use super::settings::*;
use super::{Ending, Event, Phase, Safety, Session, StoppedBy};
use crate::printer::reply::Reply;

/// An emergency stop under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Stop {
    /// There is no port; M112 is the first thing that it gets.
    NoPort,
    /// M112 is out.
    Said { repeat_ms: u64, hard_ms: u64 },
    /// It had no effect; the caller is to reset the board.
    WantsReset,
    /// The board was reset; its `start` proves it.
    Reset { until_ms: u64 },
}

impl Stop {
    pub(super) fn deadline(self) -> Option<u64> {
        match self {
            Stop::NoPort | Stop::WantsReset => None,
            Stop::Said { repeat_ms, hard_ms } => Some(repeat_ms.min(hard_ms)),
            Stop::Reset { until_ms } => Some(until_ms),
        }
    }
}

impl Session {
    /// M112, ahead of all else and whatever the state: [`Session::output`] begins with
    /// it (after a line feed, which ends what may be out of another line), and what was
    /// to be sent before is dropped, by the system too ([`Session::wants_flush`]).
    /// Where the caller must reset the board, [`Session::wants_hard_stop`] says so;
    /// [`Event::EmergencyStopped`] and the end follow. Without a port it waits for one.
    pub fn emergency_stop(&mut self, now_ms: u64) {
        if self.is_over() || matches!(self.phase, Phase::Stopping(_)) {
            return;
        }
        let no_port = matches!(self.phase, Phase::Lost { .. });
        self.ending = Some(Ending::EmergencyStop);
        self.tell(Event::Stopping(Ending::EmergencyStop));
        self.asked = None;
        self.answers.forget_drain();
        if no_port {
            self.phase = Phase::Stopping(Stop::NoPort);
        } else {
            self.stop_now(now_ms);
        }
    }

    /// Puts M112 in the place of all that was to be sent.
    pub(super) fn stop_now(&mut self, now_ms: u64) {
        self.out.clear();
        self.out_at = 0;
        self.flush = true;
        self.say_stop();
        self.phase = Phase::Stopping(Stop::Said {
            repeat_ms: now_ms + STOP_REPEAT_MS,
            hard_ms: now_ms + HARD_STOP_MS,
        });
    }

    fn say_stop(&mut self) {
        self.out.extend_from_slice(b"\nM112\n");
    }

    pub(super) fn tick_stop(&mut self, stop: Stop, now_ms: u64) {
        if stop.deadline().is_none_or(|at| now_ms < at) {
            return;
        }
        match stop {
            Stop::Said { hard_ms, .. } if now_ms >= hard_ms => {
                self.phase = Phase::Stopping(Stop::WantsReset);
            }
            Stop::Said { hard_ms, .. } => {
                // What is not even written yet is not said twice.
                if self.output().is_empty() {
                    self.say_stop();
                }
                self.phase = Phase::Stopping(Stop::Said { repeat_ms: now_ms + STOP_REPEAT_MS, hard_ms });
            }
            Stop::Reset { .. } => self.stopped(None),
            Stop::NoPort | Stop::WantsReset => {}
        }
    }

    /// M112 has had no effect for 1 s: the caller resets the board (or does not, where
    /// the profile has no way) and calls [`Session::hard_stopped`].
    pub fn wants_hard_stop(&self) -> bool {
        self.phase == Phase::Stopping(Stop::WantsReset)
    }

    /// The board was reset, or cannot be. A reset counts once the board says that it starts: a
    /// port without the wire for it looks just the same.
    pub fn hard_stopped(&mut self, done: bool, now_ms: u64) {
        if !self.wants_hard_stop() {
            return;
        }
        if done {
            // What was not written by now would only halt it again.
            self.out.clear();
            self.out_at = 0;
            self.phase = Phase::Stopping(Stop::Reset { until_ms: now_ms + RESET_HEARD_MS });
        } else {
            self.stopped(None);
        }
    }

    /// A line of the printer during the stop. `true`: it is dealt with.
    pub(super) fn hear_in_stop(&mut self, reply: &Reply<'_>) -> bool {
        let Phase::Stopping(stop) = self.phase else {
            return false;
        };
        match (reply, stop) {
            (Reply::Start, Stop::Reset { .. }) => self.stopped(Some(StoppedBy::Reset)),
            (Reply::Fatal(_) | Reply::Start, _) => self.stopped(Some(StoppedBy::Firmware)),
            // Whatever it acknowledges or asks for no longer matters.
            (Reply::Ok(_) | Reply::Resend(_) | Reply::Wait, _) => {}
            _ => return false,
        }
        true
    }

    fn stopped(&mut self, by: Option<StoppedBy>) {
        self.tell(Event::EmergencyStopped { by });
        self.end_early(match by {
            Some(_) => Safety::ByFirmware,
            None => Safety::Unknown,
        });
    }
}
