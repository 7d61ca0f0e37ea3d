//! Lines that the printer wants again.
//!
//! A request drops what is in flight from its line on; nothing is sent until the
//! stale answers are through, then the lines go out again. Requests that cannot be met
//! may be garbled, and make a probe.
use super::answers::lossy;
use super::settings::*;
use super::{Event, Failure, Phase, Session, Then, Whence};

impl Session {
    /// The printer wants line `n` and what follows it again.
    pub(super) fn on_resend(&mut self, n: u32, now_ms: u64) {
        match self.phase {
            Phase::Boot { .. } | Phase::Ended => return,
            Phase::Numbering { then, tries, .. } => {
                // M110 itself was damaged, or older lines are still refused.
                let retry_ms = now_ms + DRAIN_QUIET_MS;
                self.phase = Phase::Numbering { then, tries, retry_ms };
                return;
            }
            _ => {}
        }
        self.stall.progress(now_ms);
        self.answers.swallow_ok = true;
        self.answers.proved = false;
        // The first line of all, which was proved to be accepted: it has started anew, and
        // its `start` was lost. Sent again, the job would begin anew over the part.
        let anew = n <= 1 && self.proved_through > 0;
        let known = !anew && n >= self.window.first() && n <= self.window.next();
        let wanted = known.then_some(n);
        if self.answers.drain.is_some_and(|d| d.line == wanted) {
            // `Error:… Last Line` and `Resend`, or more lines of the same burst.
            return;
        }
        self.answers.drain_for(wanted, now_ms);
        if known {
            self.rewind(n, now_ms);
        } else if anew && self.answers.odd_requests + 1 >= ANEW_REQUESTS {
            let job_line = self.job_acked;
            self.fail_at_once(Failure::Reset { job_line });
        } else {
            self.odd_request(n, now_ms);
        }
    }

    fn rewind(&mut self, n: u32, now_ms: u64) {
        self.answers.odd_requests = 0;
        self.window.rewind(n);
        self.person.forget_strays_after(n);
        self.growth.on_resend();
        self.window.set_extra(0);
        if n == self.window.next() {
            // Nothing is missing (M999 asks so, and who is asked which line it has).
            if !self.pending.full && !self.window.is_idle() {
                self.tell(Event::Arrived);
            }
            return;
        }
        self.tell(Event::Resend { n });
        self.count_resend(n);
        if self.answers.resend_rounds > MAX_RESENDS {
            let text = self.window.line(n).map_or(String::new(), |l| lossy(&l));
            let resends = self.answers.resend_rounds - 1;
            self.fail(Failure::Resends { n, text, resends }, now_ms);
        } else if self.ending.is_some() && matches!(self.phase, Phase::WindDown { .. }) {
            // What was refused after a cancel is not sent again.
            self.window.truncate();
        }
    }

    fn count_resend(&mut self, n: u32) {
        let answers = &mut self.answers;
        if answers.resend_line != n {
            (answers.resend_line, answers.resend_rounds) = (n, 0);
        }
        answers.resend_rounds += 1;
        answers.resends += 1;
        let (resends, lines) = (answers.resends, self.lines_sent);
        if !answers.warned && lines >= RESEND_WARNING_LINES && resends * 100 > lines * RESEND_WARNING_PERCENT
        {
            answers.warned = true;
            self.tell(Event::ManyResends { resends, lines });
        }
    }

    /// A request that cannot be met. It may be garbled: what is in flight is
    /// lost, so a probe makes the printer ask again.
    fn odd_request(&mut self, n: u32, now_ms: u64) {
        self.answers.odd_requests += 1;
        let tries = self.answers.odd_requests;
        match self.phase {
            // M110 did not arrive although something was acknowledged; that it is
            // tried only so often, `number` sees to.
            Phase::Identify { whence: Whence::Renumbered, .. } => self.number(Then::Job, tries, now_ms),
            Phase::Identify { whence: Whence::Anew, .. } => self.number(Then::Identify, tries, now_ms),
            Phase::Safe { until_ms, .. } => self.number(Then::Safe { until_ms }, tries, now_ms),
            _ if tries >= MAX_ODD_REQUESTS => {
                let (first, last) = (self.window.first(), self.window.next() - 1);
                self.fail(Failure::OddRequest { n, first, last }, now_ms);
            }
            _ => {}
        }
    }

    /// Sends again once the stale answers are through.
    pub(super) fn end_drain(&mut self, now_ms: u64) {
        if self.answers.drain_ends_ms().is_none_or(|at| now_ms < at) {
            return;
        }
        let odd = self.answers.drain.take().is_some_and(|d| d.line.is_none());
        self.answers.swallow_ok = false;
        self.stall.progress(now_ms);
        if odd {
            self.probe(now_ms);
        }
    }
}
