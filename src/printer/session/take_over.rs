//! A printer that may be in mid-job: where is it?
//!
//! Nothing here changes the printer's count or state. After listening for `start`, a line
//! feed ends what half a line may stand in the printer's buffer, and an M105 with a
//! number that no line can have makes it refuse: `Error:… Last Line: 41`,
//! `Resend: 42`. The printer reads that after all that it had before, and what it
//! throws away with the refusal it has not accepted. So the last line that it
//! accepted is known exactly, though the moves of it may still be to come.
//!
//! A wrong bit in that number would cost lines: two statements in a row must agree.
//!
//! | what is heard | what it is |
//! | --- | --- |
//! | `start` | [`Found::Started`]: all is lost on its side |
//! | twice the same last line | [`Found::Counting`] |
//! | `ok`, three questions long, and no refusal | [`Found::NotSaid`]: it does not count (Klipper) |
//! | reports or busy notes only | asked again for 10 min after the last busy note, then [`Found::NotSaid`] |
//! | nothing, over 93 s (10 min with G28, M109 or the like in flight) | [`Failure::NoAnswer`] |
use super::settings::*;
use super::{Ending, Event, Found, Phase, Session, Settings, Whence};
use crate::printer::reply::Reply;
use crate::printer::window::{Kind, MAX_NUMBER};
use outrigger_gcode::checksum::frame;

/// How far the search is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Search {
    /// For a `start`, before anything is said.
    Listening { until_ms: u64 },
    /// The question is out.
    Asking(Question),
    /// `start` was heard: what follows it is awaited.
    Starting { quiet_ms: u64, latest_ms: u64 },
    /// Told; the caller decides.
    Done(Found),
}

/// Questions asked and what came of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Question {
    tries: u32,
    retry_ms: u64,
    /// When a printer that lives but does not answer is given up; `None`: it waits for a
    /// person, who may take any time.
    give_up_ms: Option<u64>,
    /// Whether anything was understood since the search began.
    alive: bool,
    /// The last line it stated, and how often in a row.
    stated: Option<(u32, u32)>,
    /// Statements are believed once it is quiet.
    quiet_ms: Option<u64>,
    /// Whether an `ok` came since the last question, and after how many in a row.
    acknowledged: bool,
    unrefused: u32,
}

impl Search {
    pub(super) fn deadline(self) -> Option<u64> {
        match self {
            Search::Listening { until_ms } => Some(until_ms),
            Search::Asking(q) => Some(q.quiet_ms.unwrap_or(q.retry_ms)),
            Search::Starting { quiet_ms, latest_ms } => Some(quiet_ms.min(latest_ms)),
            Search::Done(_) => None,
        }
    }
}

impl Session {
    /// A session with a printer that may be in mid-job: nothing is said that would
    /// change its count or its state. Tells [`Event::Found`], then waits for
    /// [`Session::go_on`] or [`Session::begin_anew`].
    pub fn take_over(settings: Settings, now_ms: u64) -> Self {
        let mut session = Self::new(settings, now_ms);
        // Someone before us may have heated it.
        session.touched = true;
        session.search(now_ms);
        session
    }

    /// After [`Found::Counting`]: both sides count on from `last`. What the window
    /// still holds beyond it is sent again; once an M105 has proved that both count alike,
    /// [`Event::Rejoined`] is told and the session is in the job, open to be fed (or held,
    /// if it was, or still running its own lines). Lines up to `last` count as
    /// acknowledged.
    ///
    /// In a fresh session, which has no window, the next line gets the number after `last`;
    /// M115 and M155 go first, as lines of our own. The caller has written down before that
    /// the job counts on from there: a line that the dead host was allowed to number, and
    /// never sent, has left its trace in what was written before.
    ///
    /// `false`, and nothing changed, when that cannot be: lines up to `last` are not known to
    /// have been sent, or lines beyond it are proved to have been accepted: the printer
    /// was reset, or another has spoken to it. A fresh session knows of neither; the
    /// caller holds `last` against what was written down.
    pub fn go_on(&mut self, last: u32, now_ms: u64) -> bool {
        let Phase::Search(Search::Done(Found::Counting { .. })) = self.phase else {
            return false;
        };
        if last >= MAX_NUMBER {
            return false;
        }
        // Someone else's numbers: ours begin with the next.
        let fresh = !self.job_begun && self.window.next() == 1;
        let before = self.window.acked();
        if fresh {
            self.window.count_from(last + 1);
            self.proved_through = last;
        } else if self.unnumbered && last == 0 && self.window.first() > 1 {
            // The link went while M110 was on its way; it had arrived.
            self.window.reset();
            self.proved_through = 0;
        } else if last < self.proved_through || !self.window.settle(last + 1) {
            return false;
        } else {
            self.acked(before, now_ms);
        }
        self.job_begun |= fresh;
        self.answers.rejoined();
        self.proof_tries = 0;
        self.stall.begin_again(now_ms);
        self.phase = Phase::Identify { asked: !fresh, whence: Whence::Rejoined };
        self.pump(now_ms);
        true
    }

    /// After [`Event::Found`]: the printer is told to count from 0, as in a new
    /// session; [`Event::Connected`] follows. What waited to be sent is forgotten.
    pub fn begin_anew(&mut self, now_ms: u64) {
        if let Phase::Search(Search::Done(_)) = self.phase {
            self.start_over();
            self.number(super::Then::Identify, 0, now_ms);
        }
    }

    /// In the job, with lines in flight: has the printer say which line it has, so that it asks for
    /// what was lost. Needs no number, and so no leave.
    pub fn ask_which_line(&mut self) {
        if matches!(self.phase, Phase::Job) && !self.answers.is_draining() && !self.window.is_idle() {
            self.out.push(b'\n');
            frame(WRONG_NUMBER, b"M105", &mut self.out);
        }
    }

    /// Begins to look where the printer is.
    pub(super) fn search(&mut self, now_ms: u64) {
        let until_ms = now_ms + self.settings.boot_wait_ms.max(LISTEN_MS);
        self.phase = Phase::Search(Search::Listening { until_ms });
    }

    pub(super) fn tick_search(&mut self, search: Search, now_ms: u64) {
        if search.deadline().is_none_or(|at| now_ms < at) {
            return;
        }
        match search {
            // Cancelled or failed meanwhile: heat matters, not the count. It may have been
            // reset, and its cold nozzle stick to the part.
            Search::Listening { .. } if self.ending.is_some() => {
                self.still = true;
                self.make_safe(now_ms);
            }
            Search::Listening { .. } => self.ask_last(
                Question {
                    tries: 0,
                    retry_ms: 0,
                    give_up_ms: self.patient_until(now_ms),
                    alive: false,
                    stated: None,
                    quiet_ms: None,
                    acknowledged: false,
                    unrefused: 0,
                },
                now_ms,
            ),
            Search::Asking(question) => self.judge(question, now_ms),
            Search::Starting { .. } => self.found(Found::Started),
            Search::Done(_) => {}
        }
    }

    fn patient_until(&self, now_ms: u64) -> Option<u64> {
        let waits = self.window.in_flight().any(|tag| tag.kind == Kind::User);
        (!waits).then_some(now_ms + LONG_COMMAND_MS)
    }

    /// Quiet after a statement, or no answer in time.
    fn judge(&mut self, mut q: Question, now_ms: u64) {
        if q.quiet_ms.take().is_some() {
            match q.stated {
                Some((last, times)) if times >= AGREEING => self.found(Found::Counting { last }),
                _ => self.ask_last(q, now_ms),
            }
            return;
        }
        q.unrefused = if q.acknowledged { q.unrefused + 1 } else { 0 };
        let slow = self.window.in_flight().any(|tag| tag.kind != Kind::Quick);
        let given_up = q.give_up_ms.is_some_and(|at| now_ms >= at);
        if q.unrefused >= UNREFUSED_QUESTIONS {
            self.found(Found::NotSaid);
        } else if !q.alive && !slow && q.tries >= SILENT_QUESTIONS || !q.alive && given_up {
            self.ending.get_or_insert(Ending::Failed(self.answers.no_answer()));
            self.end_early(self.unanswered());
        } else if given_up || q.tries >= MAX_QUESTIONS {
            self.found(Found::NotSaid);
        } else {
            self.ask_last(q, now_ms);
        }
    }

    fn ask_last(&mut self, q: Question, now_ms: u64) {
        // Half an old reply must not spoil the answer.
        self.splitter.forget();
        self.out.push(b'\n');
        frame(WRONG_NUMBER, b"M105", &mut self.out);
        let wait_ms = (PROBE_AFTER_MS << q.tries.min(SILENT_QUESTIONS)).min(QUESTION_MAX_MS);
        self.phase = Phase::Search(Search::Asking(Question {
            tries: q.tries + 1,
            retry_ms: now_ms + wait_ms,
            acknowledged: false,
            ..q
        }));
    }

    fn found(&mut self, found: Found) {
        self.phase = Phase::Search(Search::Done(found));
        self.tell(Event::Found(found));
    }

    /// A line of the printer during the search. `true`: it is dealt with.
    pub(super) fn hear_in_search(&mut self, reply: &Reply<'_>, now_ms: u64) -> bool {
        let Phase::Search(search) = self.phase else {
            return false;
        };
        if let Reply::Start = reply {
            if self.ending.is_some() {
                let job_line = self.job_acked;
                self.fail_at_once(super::Failure::Reset { job_line });
            } else {
                let (quiet_ms, latest_ms) = (now_ms + BOOT_QUIET_MS, now_ms + BOOT_MAX_MS);
                self.phase = Phase::Search(Search::Starting { quiet_ms, latest_ms });
            }
            return true;
        }
        match search {
            Search::Starting { latest_ms, .. } => {
                let quiet_ms = now_ms + BOOT_QUIET_MS;
                self.phase = Phase::Search(Search::Starting { quiet_ms, latest_ms });
            }
            Search::Asking(mut q) => {
                self.hear_answer(&mut q, reply, now_ms);
                self.phase = Phase::Search(Search::Asking(q));
            }
            _ => {}
        }
        // Acknowledgements are of lines before; refusals are the answer.
        match reply {
            Reply::Ok(ack) => {
                if let Some(t) = ack.temperatures {
                    self.tell(Event::Temperatures(t));
                }
                true
            }
            Reply::Resend(_) | Reply::Refused { .. } | Reply::Wait => true,
            _ => false,
        }
    }

    fn hear_answer(&mut self, q: &mut Question, reply: &Reply<'_>, now_ms: u64) {
        if let Some(quiet_ms) = &mut q.quiet_ms {
            *quiet_ms = now_ms + REFUSED_QUIET_MS;
        }
        let last = match reply {
            Reply::Other(_) => return,
            Reply::Refused { last_line, .. } => Some(*last_line),
            Reply::Resend(n) => n.checked_sub(1),
            Reply::Ok(_) => {
                q.acknowledged = true;
                None
            }
            Reply::Busy(_) => {
                q.retry_ms = q.retry_ms.max(now_ms + PROBE_AFTER_MS);
                q.give_up_ms = q.give_up_ms.map(|_| now_ms + LONG_COMMAND_MS);
                None
            }
            // It has nothing to do, and so has not understood the question.
            Reply::Wait if q.quiet_ms.is_none() => {
                q.retry_ms = q.retry_ms.min(now_ms + REFUSED_QUIET_MS);
                None
            }
            _ => None,
        };
        q.alive = true;
        if let Some(last) = last {
            let times = match q.stated {
                Some((before, times)) if before == last => times + 1,
                _ => 1,
            };
            q.stated = Some((last, times));
            q.quiet_ms = Some(now_ms + REFUSED_QUIET_MS);
            (q.acknowledged, q.unrefused) = (false, 0);
        }
    }
}
