//! From one phase of a connection to the next: counting anew, failing, making safe,
//! ending.
use super::settings::*;
use super::{Ending, Event, Failure, Feed, Outcome, Phase, Printer, Safety, Session, Then, Whence};
use outrigger_gcode::checksum::frame;

impl Session {
    /// Tells the printer to count from 0: `N0 M110 N0*125`.
    pub(super) fn number(&mut self, then: Then, tries: u32, now_ms: u64) {
        let out_of_time = matches!(then, Then::Safe { until_ms } if now_ms >= until_ms);
        if tries >= HANDSHAKE_TRIES || out_of_time {
            let failure = self.answers.no_answer();
            self.ending.get_or_insert(Ending::Failed(failure));
            self.end_early(self.unanswered());
            return;
        }
        if then == Then::Identify {
            // Someone before us may have left half a line; a line feed ends it.
            // Empty lines are not answered.
            self.out.push(b'\n');
        }
        frame(0, b"M110 N0", &mut self.out);
        self.answers.forget_drain();
        self.phase = Phase::Numbering { then, tries: tries + 1, retry_ms: now_ms + HANDSHAKE_TRY_MS };
    }

    /// M110 was acknowledged.
    pub(super) fn numbered(&mut self, then: Then, tries: u32, now_ms: u64) {
        self.window.reset();
        self.proved_through = 0;
        self.person.forget_strays();
        self.stall.progress(now_ms);
        self.proof_tries = 0;
        self.answers.unproved();
        self.phase = match then {
            Then::Identify => {
                self.printer = Printer::default();
                Phase::Identify { asked: false, whence: Whence::Anew }
            }
            // Not before M105 has proved that M110 was understood.
            Then::Job => Phase::Identify { asked: true, whence: Whence::Renumbered },
            Then::Safe { until_ms } => Phase::Safe { next: 0, until_ms },
        };
        if tries > 1 {
            // The earlier tries may be answered too; those acknowledge nothing.
            self.answers.drain(now_ms);
        }
    }

    /// Whether a cancel or a failure from now on leaves the head where it is: of the cancel
    /// macro only M commands are sent. For a nozzle that sticks to the part.
    pub fn keep_still(&mut self, still: bool) {
        self.still = still;
    }

    /// See [`Session::keep_still`].
    pub fn keeps_still(&self) -> bool {
        self.still
    }

    /// The user wants the job to end: no more is fed, what the printer has is
    /// awaited, the cancel macro follows. While the port is gone, nothing is sent
    /// before it is back.
    pub fn cancel(&mut self, now_ms: u64) {
        if self.ending.is_some() || self.is_over() {
            return;
        }
        self.ending = Some(Ending::Cancelled);
        if !self.touched {
            self.end_early(Safety::Untouched);
            return;
        }
        self.tell(Event::Stopping(Ending::Cancelled));
        self.drop_what_waits();
        match self.phase {
            Phase::Lost { .. } => return,
            // Whose count may not be ours: there is nothing to wait for.
            Phase::Search(_) => self.make_safe(now_ms),
            _ => {
                // What the printer asked for again it shall not get.
                self.window.truncate();
                self.phase = Phase::WindDown { until_ms: now_ms + WIND_DOWN_MS, interrupted: None };
            }
        }
        self.pump(now_ms);
    }

    /// Nothing that waits for its turn shall be sent.
    fn drop_what_waits(&mut self) {
        self.pending.full = false;
        self.asked = None;
        self.own.clear();
        self.own_running = false;
        self.person.forget_commands();
    }

    /// The job cannot go on. Where the link may still work, the printer is made
    /// safe before the end is told.
    pub(super) fn fail(&mut self, failure: Failure, now_ms: u64) {
        if self.is_over() || matches!(self.phase, Phase::Stopping(_)) {
            return;
        }
        if self.ending.is_some() {
            // Already on the way out: one more failure means that it did not work.
            match self.phase {
                Phase::Lost { .. } => {}
                Phase::WindDown { .. } => self.make_safe(now_ms),
                _ => self.end_early(Safety::Unknown),
            }
            return;
        }
        let ending = Ending::Failed(failure);
        self.ending = Some(ending.clone());
        if !self.touched {
            self.end_early(Safety::Untouched);
            return;
        }
        self.tell(Event::Stopping(ending));
        self.make_safe(now_ms);
    }

    /// The firmware has stopped or started again by itself: heaters are off and
    /// nothing more can be done.
    pub(super) fn fail_at_once(&mut self, failure: Failure) {
        self.ending.get_or_insert(Ending::Failed(failure));
        self.end_early(match self.touched {
            true => Safety::ByFirmware,
            false => Safety::Untouched,
        });
    }

    /// Starts the safe sequence. Its lines are numbered from 1 again: after a
    /// garbled resend request our count and the printer's may differ, and a line
    /// that switches heaters off must not be dropped as a repeat.
    ///
    /// It is not asked for ([`Session::asks`]): heat does not wait for a disk. Who finds the
    /// job afterwards must not trust the count.
    pub(super) fn make_safe(&mut self, now_ms: u64) {
        self.drop_what_waits();
        if matches!(self.phase, Phase::Lost { .. }) {
            return;
        }
        let patience_ms = match self.ending {
            Some(Ending::Cancelled) => SAFE_AFTER_CANCEL_MS,
            _ => SAFE_AFTER_FAILURE_MS,
        };
        let until_ms = now_ms + patience_ms;
        self.number(Then::Safe { until_ms }, 0, now_ms);
    }

    /// What is known of a printer that no longer answers.
    pub(super) fn unanswered(&self) -> Safety {
        match self.touched {
            true => Safety::Unknown,
            false => Safety::Untouched,
        }
    }

    pub(super) fn end_early(&mut self, safety: Safety) {
        let ending = self.ending.clone().unwrap_or(Ending::Cancelled);
        self.end(Outcome::Stopped { ending, safety });
    }

    pub(super) fn end(&mut self, outcome: Outcome) {
        if !self.is_over() {
            self.phase = Phase::Ended;
            self.out.clear();
            self.out_at = 0;
            self.flush = false;
            self.asked = None;
            self.tell(Event::Ended(outcome));
        }
    }

    /// Both sides count alike: the job may begin, or go on.
    pub(super) fn connected(&mut self, whence: Whence, now_ms: u64) {
        let firmware = self.printer.firmware.clone();
        match whence {
            Whence::Anew => self.tell(Event::Connected {
                firmware,
                auto_temperatures: self.printer.auto_report,
                emergency_parser: self.printer.emergency_parser,
            }),
            Whence::Rejoined => self.tell(Event::Rejoined { firmware }),
            Whence::Renumbered => {}
        }
        self.answers.forget_starts();
        self.unnumbered &= self.settings.asks;
        self.phase = Phase::Job;
        // The M105 just now has brought temperatures.
        self.poll_ms = now_ms + POLL_MS;
    }

    /// A start of the printer before anything that it must remember: the handshake begins
    /// again. `false` where that happened too often, which ends the session.
    pub(super) fn boots(&mut self, now_ms: u64) {
        let starts = self.answers.count_start();
        if starts >= MAX_STARTS {
            return self.fail_at_once(Failure::BootLoop { starts });
        }
        self.window.reset();
        self.proved_through = 0;
        self.answers.forget_drain();
        let speak_ms = now_ms + BOOT_QUIET_MS;
        let latest_ms = match self.phase {
            Phase::Boot { latest_ms, .. } => latest_ms.max(speak_ms),
            _ => now_ms + BOOT_MAX_MS,
        };
        self.phase = Phase::Boot { speak_ms, latest_ms };
    }

    /// As a new session, over the same port.
    pub(super) fn start_over(&mut self) {
        self.feed = Feed::Open;
        self.drop_what_waits();
        self.window.reset();
        self.proved_through = 0;
        self.person.forget_strays();
        self.answers.forget_drain();
        self.proof_tries = 0;
        (self.job_begun, self.unnumbered) = (false, false);
        self.job_acked = 0;
    }
}
