//! Leave for what changes the meaning of line numbers.
//!
//! Somebody writes down which line of the job a number on the wire stands for, so that
//! a host that dies can be followed by another: the printer says the number of the
//! last line that it accepted. A line of ours between two of the job's shifts all
//! that follow, and so it waits until that is written down. Where
//! [`Settings::asks`](super::Settings::asks) is not set, nothing waits.
//!
//! | line of ours | asked for |
//! | --- | --- |
//! | handshake, up to the first [`release`](Session::release) | no |
//! | between lines of the job (probe, M105, a person's command, M400 before a hold) | [`Ask::Own`] |
//! | while held, of [`run_own`](Session::run_own) | no: the numbers say nothing then |
//! | while held, of our own accord (M105, a person's command) | [`Ask::Own`] |
//! | the count begins anew in mid-job | [`Ask::Renumber`], then [`Ask::Count`] |
//! | after the end of the job, a cancel, a failure | no: heat does not wait for a disk |
use super::{Feed, Phase, Session, Then, Whence};
use crate::printer::window::{Kind, Tag};

/// What a session wants to do and must ask for first, since it changes which line of
/// the job a number on the wire stands for. Only where
/// [`Settings::asks`](super::Settings::asks) is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ask {
    /// A line that is not the job's is to get this number, between two of the job's.
    Own {
        /// Number on the wire.
        n: u32,
    },
    /// The printer is to count from 0 again; nothing of the job is in flight, and all that
    /// was sent is proved to be accepted.
    Renumber,
    /// After [`Ask::Renumber`]: the next line of the job is to get this number.
    Count {
        /// Number on the wire.
        n: u32,
    },
}

/// An ask, and what is done once it is allowed.
#[derive(Debug)]
pub(super) enum Asked {
    Own { n: u32, command: Vec<u8>, kind: Kind, probe: bool },
    Renumber,
    Count { n: u32 },
}

impl Session {
    /// What the session wants leave for; while it waits, no new line gets a number.
    /// It stays the same until [`Session::allow`], or until the job ends.
    pub fn asks(&self) -> Option<Ask> {
        Some(match self.asked.as_ref()? {
            Asked::Own { n, .. } => Ask::Own { n: *n },
            Asked::Renumber => Ask::Renumber,
            Asked::Count { n } => Ask::Count { n: *n },
        })
    }

    /// Leave for what [`Session::asks`] said. Ignored when it says nothing.
    pub fn allow(&mut self, now_ms: u64) {
        match self.asked.take() {
            None => return,
            Some(Asked::Own { n, command, kind, probe }) => {
                debug_assert_eq!(n, self.window.next(), "no line may get a number meanwhile");
                self.stall.restart(now_ms);
                self.number_own(&command, kind);
                if probe {
                    self.send_probe(now_ms);
                }
            }
            Some(Asked::Renumber) => {
                self.unnumbered = true;
                self.number(Then::Job, 0, now_ms);
            }
            Some(Asked::Count { .. }) => self.unnumbered = false,
        }
        self.pump(now_ms);
    }

    /// Whether a line of ours must be asked for now.
    pub(super) fn must_ask(&self) -> bool {
        let counts = match self.phase {
            Phase::Job | Phase::Identify { whence: Whence::Rejoined, .. } => match self.feed {
                Feed::Held => !self.own_running,
                _ => self.job_begun,
            },
            _ => false,
        };
        self.settings.asks && !self.unnumbered && counts
    }

    /// Gives a line of ours the next number, or asks for leave to.
    pub(super) fn push_own(&mut self, command: &[u8], kind: Kind) -> bool {
        if !self.must_ask() {
            return self.number_own(command, kind);
        }
        debug_assert!(self.asked.is_none(), "one ask at a time");
        let (n, command) = (self.window.next(), command.to_vec());
        self.asked = Some(Asked::Own { n, command, kind, probe: false });
        true
    }

    fn number_own(&mut self, command: &[u8], kind: Kind) -> bool {
        self.answers.unproved();
        self.window.push(command, Tag { job_line: 0, kind })
    }

    /// Sends one new line beyond the window: an M105, or the next line that the
    /// printer has asked for.
    pub(super) fn probe(&mut self, now_ms: u64) {
        if self.asked.is_some() {
            // Once it is allowed, its answer tells as much.
            if let Some(Asked::Own { probe, .. }) = &mut self.asked {
                *probe = true;
            }
            return;
        }
        if self.window.all_sent() {
            self.push_own(b"M105", Kind::AskTemperature);
            if let Some(Asked::Own { probe, .. }) = &mut self.asked {
                *probe = true;
                return;
            }
        }
        self.send_probe(now_ms);
    }
}
