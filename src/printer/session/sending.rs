//! What goes out, in each phase: our own questions, the job, the safe sequence.
use super::asks::Asked;
use super::kind::kind_of;
use super::settings::*;
use super::{Event, Failure, Feed, Outcome, Phase, Safety, Session, Then, To, Whence};
use crate::printer::window::{Kind, Tag};
use outrigger_gcode::checksum::{fit, framed_len, sendable};

/// A tag for lines that are not the job's.
fn own(kind: Kind) -> Tag {
    Tag { job_line: 0, kind }
}

impl Session {
    /// Sends all that may go now.
    pub(super) fn pump(&mut self, now_ms: u64) {
        if !self.answers.is_draining() {
            self.send_all(now_ms);
        }
        self.watch_person(now_ms);
    }

    fn send_all(&mut self, now_ms: u64) {
        loop {
            while self.send_next(false, now_ms) {}
            // No new line while one waits for leave.
            if !self.window.all_sent() || self.asked.is_some() {
                return;
            }
            let more = match self.phase {
                Phase::Identify { asked, whence } => self.identify(asked, whence, now_ms),
                Phase::Job => self.push_job(now_ms),
                Phase::WindDown { interrupted, .. } => self.wind_down(interrupted, now_ms),
                Phase::Safe { next, until_ms } => self.push_safe(next, until_ms),
                _ => false,
            };
            if !more {
                return;
            }
        }
    }

    /// Sends the line at the cursor if the window has room or `force` is set.
    pub(super) fn send_next(&mut self, force: bool, now_ms: u64) -> bool {
        if !matches!(
            self.phase,
            Phase::Identify { .. } | Phase::Job | Phase::WindDown { .. } | Phase::Safe { .. }
        ) {
            return false;
        }
        // A line on a quiet wire starts the wait for its answer.
        let was_idle = self.window.is_idle();
        let sent = self.window.send_next(&mut self.out, force);
        if sent {
            self.lines_sent += 1;
            if was_idle {
                self.stall.progress(now_ms);
            }
        }
        sent
    }

    fn identify(&mut self, asked: bool, whence: Whence, now_ms: u64) -> bool {
        if !self.window.is_idle() {
            return false;
        }
        if !asked {
            self.phase = Phase::Identify { asked: true, whence };
            return self.push_own(b"M115", Kind::Quick);
        }
        // An `ok` of before we came may have been taken for M115's: what it can do may
        // show only later.
        if self.printer.auto_report && !std::mem::replace(&mut self.printer.asked_reports, true) {
            return self.push_own(format!("M155 S{AUTO_REPORT_S}").as_bytes(), Kind::Quick);
        }
        if self.printer.prompts && !std::mem::replace(&mut self.printer.asked_prompts, true) {
            return self.push_own(b"M876 P1", Kind::Quick);
        }
        // The job begins in step.
        if !self.prove() {
            self.connected(whence, now_ms);
        }
        true
    }

    fn push_job(&mut self, now_ms: u64) -> bool {
        if self.poll(now_ms) || (self.feed == Feed::Open && self.pending.full && self.resync()) {
            return true;
        }
        if matches!(self.feed, Feed::Open | Feed::Held) && !self.own_running && self.push_command() {
            return true;
        }
        match self.feed {
            Feed::Open => self.pending.full && self.push_pending(now_ms),
            // Nothing was sent that could move.
            Feed::Closing(To::Hold) if !self.touched && self.window.is_idle() && self.answers.proved() => {
                self.feed = Feed::Held;
                self.tell(Event::Held);
                true
            }
            Feed::Closing(to) => {
                self.feed = Feed::Settling(to);
                self.proof_tries = 0;
                self.push_own(b"M400", Kind::Long)
            }
            Feed::Settling(to) => {
                if !self.window.is_idle() {
                    return false;
                }
                if self.prove() {
                    return true;
                }
                match to {
                    To::End => {
                        self.end(Outcome::Finished);
                        false
                    }
                    To::Hold => {
                        self.feed = Feed::Held;
                        self.tell(Event::Held);
                        true
                    }
                }
            }
            Feed::Held => self.push_held(),
        }
    }

    /// The next of our own lines while the job is held.
    fn push_held(&mut self) -> bool {
        if !self.own_running {
            return false;
        }
        let Some(line) = self.own.front() else {
            if !self.window.is_idle() {
                return false;
            }
            if self.prove() {
                return true;
            }
            self.own_running = false;
            self.tell(Event::OwnDone);
            return false;
        };
        let n = self.window.next();
        let mut scratch = Vec::new();
        let command =
            sendable(line, &mut scratch).and_then(|command| fit(n, command, self.settings.max_line).ok());
        if let Some(command) = command {
            if !self.window.has_room(framed_len(n, command.len()) + 1) {
                return false;
            }
            self.answers.unproved();
            self.proof_tries = 0;
            self.touched = true;
            self.window.push(command, own(kind_of(command)));
        }
        self.own.pop_front();
        true
    }

    /// Pushes an M105 unless the last lines are proved to be accepted (an `ok`
    /// alone does not prove it). Call when nothing is in flight.
    fn prove(&mut self) -> bool {
        if self.answers.proved() || self.proof_tries >= PROOF_TRIES {
            return false;
        }
        self.proof_tries += 1;
        self.push_own(b"M105", Kind::AskTemperature)
    }

    /// Asks for temperatures where the firmware does not report them, in the
    /// line's turn and within the window.
    fn poll(&mut self, now_ms: u64) -> bool {
        if self.printer.auto_report || now_ms < self.poll_ms {
            return false;
        }
        self.poll_ms = now_ms + POLL_MS;
        let len = framed_len(self.window.next(), 4) + 1;
        if self.slow_in_flight() || !self.window.has_room(len) {
            return false;
        }
        self.push_own(b"M105", Kind::AskTemperature)
    }

    fn slow_in_flight(&self) -> bool {
        self.window.in_flight().any(|tag| tag.kind != Kind::Quick)
    }

    /// An M105, whose `ok` tells which lines are done, where one may have been lost:
    /// the window would stay narrower by a line each time.
    fn resync(&mut self) -> bool {
        let due = self.answers.suspects || self.answers.bare_oks >= RESYNC_OKS;
        if !due || self.slow_in_flight() || !self.window.has_room(framed_len(self.window.next(), 4) + 1) {
            return false;
        }
        self.answers.in_step();
        self.push_own(b"M105", Kind::AskTemperature)
    }

    fn push_pending(&mut self, now_ms: u64) -> bool {
        let (n, job_line) = (self.window.next(), self.pending.job_line);
        if self.unnumbered {
            // Which line of the job the new numbers stand for is written down first.
            self.asked = Some(Asked::Count { n });
            return true;
        }
        let fitted = match fit(n, &self.pending.command, self.settings.max_line) {
            Ok(command) => command,
            Err(_) if n > 1 => return self.renumber(now_ms),
            Err(too_long) => {
                self.fail(Failure::LineTooLong { job_line, framed_len: too_long.framed_len }, now_ms);
                return false;
            }
        };
        let kind = kind_of(fitted);
        // Behind a command that takes its time the printer stops reading.
        let extra_bytes = match self.growth.extra_bytes() {
            extra if extra > 0 && kind == Kind::Quick && !self.slow_in_flight() => extra,
            _ => 0,
        };
        self.window.set_extra(extra_bytes);
        if !self.window.has_room(framed_len(n, fitted.len()) + 1) {
            return false;
        }
        if !self.window.push(fitted, Tag { job_line, kind }) {
            return self.renumber(now_ms);
        }
        self.answers.unproved();
        self.proof_tries = 0;
        self.pending.full = false;
        self.touched = true;
        self.job_begun = true;
        true
    }

    /// Our own lines between the job's have made the numbers longer than the
    /// check of the file foresaw (or they are used up): count from 0 again, once
    /// all that was sent is proved to be accepted.
    fn renumber(&mut self, now_ms: u64) -> bool {
        if !self.window.is_idle() {
            return false;
        }
        if self.prove() {
            return true;
        }
        if self.must_ask() {
            self.asked = Some(Asked::Renumber);
            return true;
        }
        self.unnumbered = true;
        self.number(Then::Job, 0, now_ms);
        false
    }

    /// Waits until nothing is in flight; ends each wait for heat if that is possible.
    fn wind_down(&mut self, interrupted: Option<u32>, now_ms: u64) -> bool {
        if self.window.is_idle() {
            self.make_safe(now_ms);
            return false;
        }
        // M108 ends the wait that is running and none that comes later: it goes out at
        // once, and again when the next line's turn has come and that one waits too.
        let oldest = self.window.acked();
        let waits = |tag: Tag| matches!(tag.kind, Kind::Heat | Kind::User);
        let due = match interrupted {
            None => self.window.in_flight().any(waits),
            Some(of) => of != oldest && self.window.tag(oldest).is_some_and(waits),
        };
        if due && self.printer.emergency_parser {
            if let Phase::WindDown { interrupted, .. } = &mut self.phase {
                *interrupted = Some(oldest);
            }
            self.push_own(b"M108", Kind::Quick);
            self.send_next(true, now_ms);
        }
        false
    }

    fn push_safe(&mut self, next: usize, until_ms: u64) -> bool {
        let Some(line) = self.settings.cancel_macro.get(next) else {
            if !self.window.is_idle() {
                return false;
            }
            // An `ok` from before the failure must not pass for that of the line
            // that switches the heaters off.
            if self.prove() {
                return true;
            }
            self.end_early(Safety::Acknowledged);
            return false;
        };
        let n = self.window.next();
        let mut scratch = Vec::new();
        let command = sendable(line.as_bytes(), &mut scratch)
            .filter(|command| !self.still || command.first() == Some(&b'M'))
            .and_then(|command| fit(n, command, self.settings.max_line).ok());
        if let Some(command) = command {
            if !self.window.has_room(framed_len(n, command.len()) + 1) {
                return false;
            }
            self.answers.unproved();
            self.window.push(command, own(kind_of(command)));
        }
        self.phase = Phase::Safe { next: next + 1, until_ms };
        true
    }
}
