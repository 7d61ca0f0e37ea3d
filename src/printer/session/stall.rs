//! Waiting for a sign of progress, and asking for one.
//!
//! An `ok` may be lost on the way. The line must then not be sent again: the
//! firmware drops a repeat without an answer. A probe, a new line, tells.
use super::settings::*;
use super::{Event, Failure, Phase, Session};
use crate::printer::window::Kind;

/// The wait since the last sign of progress.
#[derive(Debug)]
pub(super) struct Stall {
    /// When the printer last acknowledged, asked for lines or said it is busy.
    /// Reports that come by themselves are no progress: they go on while an `ok`
    /// is missing.
    progress_ms: u64,
    /// Expired waits in a row.
    timeouts: u32,
    /// Number and time of the last probe, while it is unanswered.
    probe: Option<(u32, u64)>,
    /// `ok`s since that probe, and whether the first came at once.
    oks: u32,
    prompt: bool,
    /// Probes in a row that brought exactly one `ok`, at once.
    single_answers: u32,
    last_busy_ms: Option<u64>,
    /// Whether the printer ever said that it is busy.
    keeps_alive: bool,
    /// Longest time between two busy notes in a row.
    busy_gap_ms: u64,
}

impl Stall {
    pub(super) fn new(now_ms: u64) -> Self {
        Self {
            progress_ms: now_ms,
            timeouts: 0,
            probe: None,
            oks: 0,
            prompt: false,
            single_answers: 0,
            last_busy_ms: None,
            keeps_alive: false,
            busy_gap_ms: 0,
        }
    }

    pub(super) fn progress(&mut self, now_ms: u64) {
        self.progress_ms = now_ms;
        self.timeouts = 0;
        self.last_busy_ms = None;
    }

    /// What was waited for comes only now: the wait begins here.
    pub(super) fn restart(&mut self, now_ms: u64) {
        self.progress_ms = now_ms;
    }

    /// Over another connection nothing of before counts, but for whether busy notes
    /// come.
    pub(super) fn begin_again(&mut self, now_ms: u64) {
        *self = Self { keeps_alive: self.keeps_alive, ..Self::new(now_ms) };
    }

    /// Something was acknowledged just now; `upto` is the first line that is not.
    pub(super) fn acked(&mut self, upto: u32) {
        match self.probe {
            Some((n, at_ms)) if upto <= n => {
                self.prompt |= self.oks == 0 && self.progress_ms <= at_ms + PROBE_ANSWER_MS;
                self.oks += 1;
            }
            _ => {
                self.probe = None;
                self.single_answers = 0;
            }
        }
    }

    pub(super) fn busy(&mut self, now_ms: u64) {
        if let Some(last_ms) = self.last_busy_ms.replace(now_ms) {
            self.busy_gap_ms = now_ms.saturating_sub(last_ms).min(LONG_COMMAND_MS);
        }
        self.keeps_alive = true;
        self.progress_ms = now_ms;
        // A probe that waits in the queue of a busy printer needs no second.
        self.timeouts = self.timeouts.min(1);
    }

    pub(super) fn is_probing(&self) -> bool {
        self.probe.is_some()
    }

    /// How long to wait for the next sign with such a command in flight; `None`:
    /// as long as it takes.
    fn patience_ms(&self, slowest: Kind) -> Option<u64> {
        let after_busy = match self.last_busy_ms {
            Some(_) => 3 * self.busy_gap_ms,
            None => 0,
        };
        let wait = match (self.timeouts, slowest) {
            // The first probe is early whatever runs: it does no harm in the
            // queue, and finds a lost `ok` even of G28.
            (0, _) => PROBE_AFTER_MS,
            (_, Kind::User) => return None,
            // A firmware that says when it is busy says so during these.
            (_, Kind::Long) if self.keeps_alive => KEPT_ALIVE_MS,
            (_, Kind::Long | Kind::Heat) => LONG_COMMAND_MS,
            (n, _) => PROBE_AFTER_MS << n.min(MAX_TIMEOUTS),
        };
        Some(wait.max(after_busy))
    }
}

impl Session {
    /// When the current wait expires; `None` when nothing is awaited.
    pub(super) fn stall_ms(&self) -> Option<u64> {
        let waiting = matches!(
            self.phase,
            Phase::Identify { .. } | Phase::Job | Phase::WindDown { .. } | Phase::Safe { .. }
        );
        // While something waits for leave, the printer is not what is waited for.
        if !waiting || self.answers.is_draining() || self.asked.is_some() {
            return None;
        }
        let slowest = self.window.in_flight().map(|tag| tag.kind).max()?;
        let patience_ms = self.stall.patience_ms(slowest)?;
        Some(self.stall.progress_ms + patience_ms)
    }

    /// Acts on an expired wait: a probe, or the end after too many.
    pub(super) fn check_stall(&mut self, now_ms: u64) {
        if self.stall_ms().is_none_or(|at| now_ms < at) {
            return;
        }
        // Half a reply that old will not be finished; it would spoil the next.
        self.splitter.forget();
        if self.probe_was_answered(now_ms) {
            return;
        }
        let timeouts = self.stall.timeouts + 1;
        if timeouts >= MAX_TIMEOUTS {
            let job_line = self.job_acked;
            self.fail(Failure::Timeouts { job_line, timeouts }, now_ms);
            return;
        }
        self.stall.timeouts = timeouts;
        self.stall.progress_ms = now_ms;
        self.tell(Event::Probed { timeouts });
        self.probe(now_ms);
    }

    /// A firmware whose M105 brings no temperatures answers a probe with one bare
    /// `ok`, which counts for the oldest line in flight; the rest would be awaited
    /// for ever. Twice exactly one `ok`, at once, then silence: it is idle.
    fn probe_was_answered(&mut self, now_ms: u64) -> bool {
        let Some((n, _)) = self.stall.probe.take() else {
            return false;
        };
        let single = self.stall.oks == 1 && self.stall.prompt;
        self.stall.single_answers = match single {
            true => self.stall.single_answers + 1,
            false => 0,
        };
        if self.stall.single_answers < PROBE_ANSWERS {
            return false;
        }
        self.stall.single_answers = 0;
        let before = self.window.acked();
        self.window.ack_through(n);
        self.acked(before, now_ms);
        true
    }

    /// Sends the line at the cursor beyond the window; its answer is the probe's.
    pub(super) fn send_probe(&mut self, now_ms: u64) {
        let n = self.window.cursor();
        if self.send_next(true, now_ms) {
            self.stall.probe = Some((n, now_ms));
            (self.stall.oks, self.stall.prompt) = (0, false);
        }
    }
}
