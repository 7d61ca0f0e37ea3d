//! What goes out, in each phase: our own questions, the job, the safe sequence.
use super::kind::kind_of;
use super::settings::*;
use super::{ASKED_ALL, Event, Failure, Feed, Outcome, Phase, Safety, Session, Then, To};
use crate::printer::window::{Kind, Tag};
use outrigger_gcode::checksum::{fit, framed_len, sendable};

/// A tag for lines that are not the job's.
fn own(kind: Kind) -> Tag {
    Tag { job_line: 0, kind }
}

impl Session {
    /// Sends all that may go now.
    pub(super) fn pump(&mut self, now_ms: u64) {
        if self.answers.is_draining() {
            return;
        }
        loop {
            while self.send_next(false, now_ms) {}
            if !self.window.all_sent() {
                return;
            }
            let more = match self.phase {
                Phase::Identify { asked } => self.identify(asked, now_ms),
                Phase::Job => self.push_job(now_ms),
                Phase::WindDown { interrupt, .. } => self.wind_down(interrupt, now_ms),
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

    fn identify(&mut self, asked: u8, now_ms: u64) -> bool {
        if !self.window.is_idle() {
            return false;
        }
        let report = format!("M155 S{AUTO_REPORT_S}");
        let (command, step) = match asked {
            0 => ("M115", 1),
            1 if self.printer.auto_report => (report.as_str(), ASKED_ALL),
            // An `ok` of before we came may have been taken for one of ours: the
            // job begins in step.
            _ if self.prove() => return true,
            _ => {
                self.connected();
                self.poll_ms = now_ms;
                return true;
            }
        };
        self.phase = Phase::Identify { asked: step };
        self.push_own(command.as_bytes(), Kind::Quick)
    }

    fn push_job(&mut self, now_ms: u64) -> bool {
        if self.poll(now_ms) {
            return true;
        }
        match self.feed {
            Feed::Open => self.pending.full && self.push_pending(now_ms),
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
        let waits = self.window.in_flight().any(|tag| tag.kind != Kind::Quick);
        if waits || !self.window.has_room(len) {
            return false;
        }
        self.push_own(b"M105", Kind::AskTemperature)
    }

    fn push_pending(&mut self, now_ms: u64) -> bool {
        let (n, job_line) = (self.window.next(), self.pending.job_line);
        let fitted = match fit(n, &self.pending.command, self.settings.max_line) {
            Ok(command) => command,
            Err(_) if n > 1 => return self.renumber(now_ms),
            Err(too_long) => {
                self.fail(Failure::LineTooLong { job_line, framed_len: too_long.framed_len }, now_ms);
                return false;
            }
        };
        if !self.window.has_room(framed_len(n, fitted.len()) + 1) {
            return false;
        }
        let kind = kind_of(fitted);
        if !self.window.push(fitted, Tag { job_line, kind }) {
            return self.renumber(now_ms);
        }
        self.answers.unproved();
        self.proof_tries = 0;
        self.pending.full = false;
        self.touched = true;
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
        self.number(Then::Job, 0, now_ms);
        false
    }

    /// Waits until nothing is in flight; ends a wait for heat if that is possible.
    fn wind_down(&mut self, interrupt: bool, now_ms: u64) -> bool {
        if self.window.is_idle() {
            self.make_safe(now_ms);
            return false;
        }
        if let Phase::WindDown { interrupt, .. } = &mut self.phase {
            *interrupt = false;
        }
        let waits = |tag: Tag| matches!(tag.kind, Kind::Heat | Kind::User);
        if interrupt && self.window.in_flight().any(waits) {
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

    /// Both sides count alike: the job may begin, or go on after a renumbering.
    fn connected(&mut self) {
        if !self.touched {
            self.tell(Event::Connected {
                firmware: self.printer.firmware.clone(),
                auto_temperatures: self.printer.auto_report,
                emergency_parser: self.printer.emergency_parser,
            });
        }
        self.phase = Phase::Job;
    }

    pub(super) fn push_own(&mut self, command: &[u8], kind: Kind) -> bool {
        self.answers.unproved();
        self.window.push(command, own(kind))
    }
}
