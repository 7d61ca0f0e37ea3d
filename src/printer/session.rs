//! One job over one connection: a state machine without I/O and without a clock.
//!
//! Takes what comes ([`Session::on_bytes`], [`Session::on_tick`],
//! [`Session::feed`], [`Session::cancel`], [`Session::link_lost`] …) with the time
//! in ms of any steady clock, gives bytes to write ([`Session::output`]), events
//! ([`Session::poll_event`]) and the time when it wants to be called at the
//! latest ([`Session::deadline`]). Does not know ports, files or terminals.
//!
//! # The life of a connection
//! ```text
//!  Boot ──► Numbering ──► Identify ──► Job ──────────────► Ended
//!  (start?)  (M110 N0)     (M115,       │ cancel             ▲
//!      ▲        ▲           M155)       ▼                    │
//!      │        │             ▲      WindDown ─► Numbering ─► Safe
//!      │        └── numbers   │ ── Job            (M110 N0)   (cancel macro)
//!      │            used up   │
//!      │                      │ go_on
//!  begin_anew ◄──────────── Search ◄── link_back ── Lost ◄── link_lost (any)
//!                             ▲
//!                         take_over          any ── emergency_stop ──► Stopping ──► Ended
//! ```
//!
//! # Why every line is numbered, ours too
//! The firmware accepts a numbered line only after all lines before it. So a
//! probe (M105) with the next number does two things at once: its `ok` proves
//! that all before it arrived, and a lost line makes the firmware ask for it. An
//! unnumbered probe proves only that the printer lives, and has no checksum: one
//! wrong bit makes M107 of it, which stops the fan. Only what must overtake the queue
//! (M108, M112, M410, M876) goes without a number.
mod adapt;
mod answers;
mod asks;
mod emergency;
mod event;
mod kind;
mod link;
mod person;
mod phases;
mod resend;
mod sending;
mod settings;
mod stall;
mod take_over;

#[cfg(test)]
mod sim;
#[cfg(test)]
mod tests;

pub use asks::Ask;
pub use event::{Ending, Event, Failure, Found, Outcome, Safety, StoppedBy, Waiting};
pub use settings::{DEFAULT_BOOT_WAIT_MS, DEFAULT_WINDOW_BYTES, MARLIN_MAX_LINE, Settings};

use crate::printer::lines::LineSplitter;
use crate::printer::window::Window;
use kind::sets_line_number;
use settings::*;
use std::collections::VecDeque;

/// Where in its life the connection is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Listening for `start` until it is time to speak.
    Boot { speak_ms: u64, latest_ms: u64 },
    /// M110 was sent; its `ok` leads on.
    Numbering { then: Then, tries: u32, retry_ms: u64 },
    /// Asking who is there (M115, once `asked`), and for what it can do; then an M105
    /// proves that both sides count alike.
    Identify { asked: bool, whence: Whence },
    /// Both sides count alike: the job is fed, held or ended, as [`Feed`] says.
    Job,
    /// No more is fed; what is in flight is awaited.
    /// `interrupted`: the oldest line in flight when a wait for heat was last told to end.
    WindDown { until_ms: u64, interrupted: Option<u32> },
    /// The cancel macro goes out; `next` is the index of its next line.
    Safe { next: usize, until_ms: u64 },
    /// The printer may be in mid-job and is asked where it is.
    Search(take_over::Search),
    /// The port is gone. `anew`: nothing was sent that the printer must remember.
    Lost { anew: bool },
    /// M112 is out, or goes out as soon as there is a port.
    Stopping(emergency::Stop),
    /// Over.
    Ended,
}

/// How it came to [`Phase::Identify`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Whence {
    /// The printer counts from 0, and nothing of the job was sent.
    Anew,
    /// It counts from 0, in mid-job.
    Renumbered,
    /// It goes on counting where it was.
    Rejoined,
}

/// What follows when the printer counts from 0 again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    Identify,
    Job,
    Safe { until_ms: u64 },
}

/// Whether the job's lines go out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Feed {
    /// More lines may come.
    Open,
    /// No more lines of the job; what was sent is awaited.
    Closing(To),
    /// M400 was pushed: it waits for the last move.
    Settling(To),
    /// Nothing of the job is in flight; our own lines may run.
    Held,
}

/// What the closing leads to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum To {
    End,
    Hold,
}

/// What the printer said of itself.
#[derive(Debug, Default)]
struct Printer {
    firmware: Option<String>,
    auto_report: bool,
    emergency_parser: bool,
    prompts: bool,
    /// What was asked of it because it can: reports, and its prompts.
    asked_reports: bool,
    asked_prompts: bool,
}

/// The one job line that waits for room.
#[derive(Debug, Default)]
struct Pending {
    command: Vec<u8>,
    job_line: u64,
    full: bool,
}

/// The state machine. See the module's text.
#[derive(Debug)]
pub struct Session {
    settings: Settings,
    phase: Phase,
    printer: Printer,
    splitter: LineSplitter,
    window: Window,
    pending: Pending,
    out: Vec<u8>,
    /// How much of `out` is written.
    out_at: usize,
    events: VecDeque<Event>,
    ending: Option<Ending>,
    feed: Feed,
    /// Lines that are not the job's, to be run while it is held.
    own: VecDeque<Vec<u8>>,
    /// Such lines were given, and their end was not told yet.
    own_running: bool,
    /// Whether a line of the job or of a macro was ever sent, or may have been by
    /// someone before us: the printer may be hot.
    touched: bool,
    /// Of the cancel macro only what does not move is sent.
    still: bool,
    /// Whether numbers on the wire stand for lines of the job.
    job_begun: bool,
    /// The printer counts from 0 in mid-job, and nobody has written down from where
    /// the job's lines count.
    unnumbered: bool,
    asked: Option<asks::Asked>,
    person: person::Person,
    /// The system may hold bytes that are not to be sent any more.
    flush: bool,
    /// The printer has said that it accepted every line up to this one: by its number,
    /// or by M105's `ok`. A bare `ok` does not say so.
    proved_through: u32,
    /// Last job line that was acknowledged.
    job_acked: u64,
    lines_sent: u64,
    answers: answers::Answers,
    growth: adapt::Growth,
    stall: stall::Stall,
    poll_ms: u64,
    proof_tries: u32,
}

impl Session {
    /// A session over a port that was opened at `now_ms`.
    pub fn new(settings: Settings, now_ms: u64) -> Self {
        let window = Window::new(settings.window);
        let growth = adapt::Growth::new(settings.window);
        Self {
            phase: settings.boot(now_ms),
            settings,
            printer: Printer::default(),
            splitter: LineSplitter::default(),
            window,
            pending: Pending::default(),
            out: Vec::with_capacity(1024),
            out_at: 0,
            events: VecDeque::new(),
            ending: None,
            feed: Feed::Open,
            own: VecDeque::new(),
            own_running: false,
            touched: false,
            still: false,
            job_begun: false,
            unnumbered: false,
            asked: None,
            person: person::Person::default(),
            flush: false,
            proved_through: 0,
            job_acked: 0,
            lines_sent: 0,
            answers: answers::Answers::default(),
            growth,
            stall: stall::Stall::new(now_ms),
            poll_ms: now_ms,
            proof_tries: 0,
        }
    }

    // ---- what comes in ----

    /// Bytes came from the printer, in any pieces.
    pub fn on_bytes(&mut self, bytes: &[u8], now_ms: u64) {
        self.answers.heard(bytes.len(), now_ms);
        // The splitter is taken out so that its lines may change the rest.
        let mut splitter = std::mem::take(&mut self.splitter);
        splitter.push(bytes, |line| self.on_line(line, now_ms));
        self.splitter = splitter;
        self.pump(now_ms);
    }

    /// Time passed. Call at [`Session::deadline`] or later; more often is harmless.
    pub fn on_tick(&mut self, now_ms: u64) {
        match self.phase {
            Phase::Boot { speak_ms, .. } if now_ms >= speak_ms => {
                self.number(Then::Identify, 0, now_ms);
            }
            Phase::Numbering { then, tries, retry_ms } if now_ms >= retry_ms => {
                self.number(then, tries, now_ms)
            }
            Phase::WindDown { until_ms, .. } if now_ms >= until_ms => self.make_safe(now_ms),
            Phase::Safe { until_ms, .. } if now_ms >= until_ms => self.end_early(Safety::Unknown),
            Phase::Search(search) => self.tick_search(search, now_ms),
            Phase::Stopping(stop) => self.tick_stop(stop, now_ms),
            _ => {}
        }
        self.end_drain(now_ms);
        self.check_stall(now_ms);
        self.pump(now_ms);
        if now_ms >= self.poll_ms {
            // The window was full or the printer busy: another time.
            self.poll_ms = now_ms + POLL_MS;
        }
    }

    /// Moves that the printer has told it may hold, accepted and not made (ADVANCED_OK's P
    /// and B); 0: it does not tell.
    pub fn depth(&self) -> u32 {
        self.growth.depth()
    }

    /// Whether [`Session::feed`] would take a line.
    pub fn wants_line(&self) -> bool {
        self.phase == Phase::Job && self.feed == Feed::Open && !self.pending.full
    }

    /// Gives the next line of the job: a command without comment or number (see
    /// [`sendable`](outrigger_gcode::checksum::sendable)) and its line number in the file, from 1.
    ///
    /// Ignored unless [`Session::wants_line`].
    pub fn feed(&mut self, command: &[u8], job_line: u64, now_ms: u64) {
        if !self.wants_line() {
            return;
        }
        if sets_line_number(command) {
            self.tell(Event::Skipped { job_line });
            return;
        }
        self.pending.command.clear();
        self.pending.command.extend_from_slice(command);
        self.pending.job_line = job_line;
        self.pending.full = true;
        self.pump(now_ms);
    }

    /// The job has no more lines: once all were accepted and every move is made,
    /// [`Outcome::Finished`] is told.
    pub fn finish_job(&mut self, now_ms: u64) {
        if self.feed == Feed::Held {
            // What follows is after the job: no number stands for a line of it.
            self.job_begun = false;
        }
        self.close(To::End, now_ms);
    }

    /// Feeds no more: once all that was sent was accepted and every move is made,
    /// [`Event::Held`] is told. Lines of our own may then run ([`Session::run_own`]),
    /// until [`Session::release`] or [`Session::finish_job`].
    pub fn hold(&mut self, now_ms: u64) {
        self.close(To::Hold, now_ms);
    }

    fn close(&mut self, to: To, now_ms: u64) {
        if self.is_over() || self.ending.is_some() {
            return;
        }
        match (self.feed, to) {
            (Feed::Open, _) | (Feed::Held, To::End) => self.feed = Feed::Closing(to),
            _ => {}
        }
        self.pump(now_ms);
    }

    /// Feeds on after [`Event::Held`]. With [`Settings::asks`] the caller has written
    /// down that the job counts from [`Session::next_number`].
    pub fn release(&mut self, now_ms: u64) {
        if self.feed == Feed::Held {
            self.feed = Feed::Open;
            self.job_begun = true;
            self.unnumbered = false;
            self.pump(now_ms);
        }
    }

    /// Sends lines that are not the job's while it is held, in order and within the
    /// window; [`Event::OwnDone`] is told once all were accepted. Ignored otherwise.
    ///
    /// Their numbers are not asked for ([`Session::asks`]): with it, the caller has written
    /// down before that numbers say nothing of the job.
    pub fn run_own<'a>(&mut self, lines: impl IntoIterator<Item = &'a str>, now_ms: u64) {
        if self.feed == Feed::Held {
            self.own.extend(lines.into_iter().map(|line| line.as_bytes().to_vec()));
            self.own_running = true;
            self.pump(now_ms);
        }
    }

    /// Whether nothing of the job is in flight after [`Session::hold`], so that
    /// [`Session::run_own`] takes lines.
    pub fn is_held(&self) -> bool {
        self.phase == Phase::Job && self.feed == Feed::Held
    }

    /// Whether nothing at all is in flight or waits for its turn, so that the lines that are fed now go
    /// out one behind the other.
    pub fn is_quiet(&self) -> bool {
        self.wants_line()
            && self.window.is_idle()
            && self.asked.is_none()
            && !self.answers.is_draining()
            && self.person.is_quiet()
    }

    /// The number that the next new line gets on the wire.
    pub fn next_number(&self) -> u32 {
        self.window.next()
    }

    /// The job cannot be read on; the printer is made safe.
    pub fn source_failed(&mut self, job_line: u64, reason: String, now_ms: u64) {
        self.fail(Failure::Source { job_line, reason }, now_ms);
        self.pump(now_ms);
    }

    // ---- what goes out ----

    /// Bytes to write, whole lines in order.
    pub fn output(&self) -> &[u8] {
        &self.out[self.out_at..]
    }

    /// The first `len` bytes of [`Session::output`] are written.
    pub fn written(&mut self, len: usize) {
        self.out_at = self.out.len().min(self.out_at + len);
        if self.out_at == self.out.len() {
            self.out.clear();
            self.out_at = 0;
        }
        if len > 0 {
            self.flush = false;
        }
    }

    /// Whether what the system has taken but not yet sent is to be dropped (`tcflush`)
    /// before [`Session::output`] is written: it would go out ahead of M112. True from
    /// [`Session::emergency_stop`] until something is written.
    pub fn wants_flush(&self) -> bool {
        self.flush
    }

    /// The oldest event that was not fetched.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Last line of the file that the printer acknowledged; 0 before the first that this
    /// session has sent: what a taken-over printer had before, the caller knows.
    pub fn job_acked(&self) -> u64 {
        self.job_acked
    }

    /// Whether [`Event::Ended`] was told.
    pub fn is_over(&self) -> bool {
        self.phase == Phase::Ended
    }

    /// When [`Session::on_tick`] is due at the latest, in ms; `None`: not before
    /// something else comes.
    pub fn deadline(&self) -> Option<u64> {
        let phase = match self.phase {
            Phase::Ended | Phase::Lost { .. } => return None,
            Phase::Stopping(stop) => return stop.deadline(),
            Phase::Search(search) => search.deadline(),
            Phase::Boot { speak_ms, .. } => Some(speak_ms),
            Phase::Numbering { retry_ms, .. } => Some(retry_ms),
            Phase::WindDown { until_ms, .. } | Phase::Safe { until_ms, .. } => Some(until_ms),
            Phase::Job if !self.printer.auto_report => Some(self.poll_ms),
            Phase::Identify { .. } | Phase::Job => None,
        };
        let others = [self.answers.drain_ends_ms(), self.stall_ms(), self.person.deadline()];
        others.into_iter().flatten().chain(phase).min()
    }

    fn tell(&mut self, event: Event) {
        // What the session itself brings about is told in any case; what the printer
        // says, only to someone who listens.
        let must = matches!(
            event,
            Event::Held
                | Event::OwnDone
                | Event::Connected { .. }
                | Event::Rejoined { .. }
                | Event::Found(_)
                | Event::LinkLost { .. }
                | Event::EmergencyStopped { .. }
                | Event::Stopping(_)
                | Event::Ended(_)
        );
        if must || self.events.len() < MAX_EVENTS {
            self.events.push_back(event);
        }
    }
}
