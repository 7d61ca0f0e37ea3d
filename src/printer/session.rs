//! One job over one connection: a state machine without I/O and without a clock.
//!
//! Takes what comes ([`Session::on_bytes`], [`Session::on_tick`],
//! [`Session::feed`], [`Session::cancel`], [`Session::port_lost`]) with the time
//! in ms of any steady clock, gives bytes to write ([`Session::output`]), events
//! ([`Session::poll_event`]) and the time when it wants to be called at the
//! latest ([`Session::deadline`]). Does not know ports, files or terminals.
//!
//! # The life of a connection
//! ```text
//!  Boot ──► Numbering ──► Identify ──► Job ──────────────► Ended
//!  (start?)  (M110 N0)     (M115,       │ cancel             ▲
//!               ▲           M155)       ▼                    │
//!               │                    WindDown ─► Numbering ─► Safe
//!               └── numbers used up ── Job        (M110 N0)   (cancel macro)
//! ```
//!
//! # Why every line is numbered, ours too
//! The firmware accepts a numbered line only after all lines before it. So a
//! probe (M105) with the next number does two things at once: its `ok` proves
//! that all before it arrived, and a lost line makes the firmware ask for it. An
//! unnumbered probe proves only that the printer lives, and has no checksum: one
//! wrong bit makes M107 of it, which stops the fan.
mod answers;
mod event;
mod kind;
mod sending;
mod settings;
mod stall;

#[cfg(test)]
mod sim;
#[cfg(test)]
mod tests;

pub use event::{Ending, Event, Failure, Found, Outcome, Safety, StoppedBy};
pub use settings::{DEFAULT_BOOT_WAIT_MS, DEFAULT_WINDOW_BYTES, MARLIN_MAX_LINE, Settings};

use crate::printer::lines::LineSplitter;
use crate::printer::window::Window;
use kind::sets_line_number;
use outrigger_gcode::checksum::frame;
use settings::*;
use std::collections::VecDeque;

/// Where in its life the connection is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// Listening for `start` until it is time to speak.
    Boot { speak_ms: u64, latest_ms: u64 },
    /// M110 was sent; its `ok` leads on.
    Numbering { then: Then, tries: u32, retry_ms: u64 },
    /// Asking who is there: 0 nothing, 1 M115, [`ASKED_ALL`] M155 sent; then an
    /// M105 proves that both sides count alike.
    Identify { asked: u8 },
    /// Both sides count alike: the job is fed, held or ended, as [`Feed`] says.
    Job,
    /// No more is fed; what is in flight is awaited.
    WindDown { until_ms: u64, interrupt: bool },
    /// The cancel macro goes out; `next` is the index of its next line.
    Safe { next: usize, until_ms: u64 },
    /// Over.
    Ended,
}

/// The last step of [`Phase::Identify`].
const ASKED_ALL: u8 = 2;

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
}

/// The one job line that waits for room.
#[derive(Debug, Default)]
struct Pending {
    command: Vec<u8>,
    job_line: u64,
    full: bool,
}

/// What a session wants to do and must ask for first, since it changes which line of
/// the job a number on the wire stands for. Only where [`Settings::asks`] is set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ask {
    /// A line that is not the job's is to get this number, between two of the job's.
    Own {
        /// Number on the wire.
        n: u32,
    },
    /// The printer is to count from 0 again; nothing of the job is in flight.
    Renumber,
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
    /// Whether a line of the job was ever sent.
    touched: bool,
    /// Last job line that was acknowledged.
    job_acked: u64,
    lines_sent: u64,
    answers: answers::Answers,
    stall: stall::Stall,
    poll_ms: u64,
    proof_tries: u32,
}

impl Session {
    /// A session over a port that was opened at `now_ms`.
    pub fn new(settings: Settings, now_ms: u64) -> Self {
        let window = Window::new(settings.window);
        Self {
            phase: Phase::Boot {
                speak_ms: now_ms + settings.boot_wait_ms,
                latest_ms: now_ms + settings.boot_wait_ms + BOOT_MAX_MS,
            },
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
            job_acked: 0,
            lines_sent: 0,
            answers: answers::Answers::default(),
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

    /// Feeds on after [`Event::Held`].
    pub fn release(&mut self, now_ms: u64) {
        if self.feed == Feed::Held {
            self.feed = Feed::Open;
            self.pump(now_ms);
        }
    }

    /// Sends lines that are not the job's while it is held, in order and within the
    /// window; [`Event::OwnDone`] is told once all were accepted. Ignored otherwise.
    pub fn run_own<'a>(&mut self, lines: impl IntoIterator<Item = &'a str>, now_ms: u64) {
        if self.feed == Feed::Held {
            self.own.extend(lines.into_iter().map(|line| line.as_bytes().to_vec()));
            self.own_running = true;
            self.pump(now_ms);
        }
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

    /// The user wants the job to end: no more is fed, what the printer has is
    /// awaited, the cancel macro follows.
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
        self.pending.full = false;
        // What the printer asked for again it shall not get.
        self.window.truncate();
        self.phase =
            Phase::WindDown { until_ms: now_ms + WIND_DOWN_MS, interrupt: self.printer.emergency_parser };
        self.pump(now_ms);
    }

    /// The port is gone: nothing can be sent any more.
    pub fn port_lost(&mut self, reason: String) {
        if self.is_over() {
            return;
        }
        if self.ending.is_none() {
            self.ending = Some(Ending::Failed(Failure::PortLost { reason }));
        }
        self.end_early(match self.touched {
            true => Safety::Unknown,
            false => Safety::Untouched,
        });
    }

    /// What the session wants leave for; it sends nothing new until
    /// [`Session::allow`].
    pub fn asks(&self) -> Option<Ask> {
        None
    }

    /// Leave for what [`Session::asks`] said.
    pub fn allow(&mut self, _now_ms: u64) {}

    /// A session with a printer that may be in mid-job: nothing is said that would
    /// change its count or its state. Tells [`Event::Found`], then waits for
    /// [`Session::go_on`] or [`Session::begin_anew`].
    pub fn take_over(settings: Settings, now_ms: u64) -> Self {
        Self::new(settings, now_ms)
    }

    /// After [`Found::Counting`]: both sides count on from `last`. What the window
    /// still holds beyond it is sent again; the session is then in the job, open to
    /// be fed (or held, if it was). `false`, and nothing changed, when lines
    /// between what was acknowledged and `last` are not known to have been sent.
    pub fn go_on(&mut self, _last: u32, _now_ms: u64) -> bool {
        false
    }

    /// After [`Event::Found`]: the printer is told to count from 0, as in a new
    /// session; [`Event::Connected`] follows.
    pub fn begin_anew(&mut self, _now_ms: u64) {}

    /// The port is gone. Where [`Settings::waits_for_link`] is set, [`Event::LinkLost`] is
    /// told and all waits; [`Session::link_back`] leads to [`Event::Found`].
    pub fn link_lost(&mut self, reason: String) {
        self.port_lost(reason);
    }

    /// The port was opened again.
    pub fn link_back(&mut self, _now_ms: u64) {}

    /// M112, ahead of all else and whatever the state: [`Session::output`] begins with
    /// it, and what was to be sent before is dropped. Where the caller must reset
    /// the board, [`Session::wants_hard_stop`] says so; [`Event::EmergencyStopped`]
    /// and the end follow.
    pub fn emergency_stop(&mut self, now_ms: u64) {
        self.cancel(now_ms);
    }

    /// M112 has had no effect for 1 s: the caller resets the board and calls
    /// [`Session::hard_stopped`].
    pub fn wants_hard_stop(&self) -> bool {
        false
    }

    /// The board was reset, or cannot be.
    pub fn hard_stopped(&mut self, _done: bool, _now_ms: u64) {}

    /// A command of a person, to be sent at once: beside the job, unnumbered where the firmware
    /// reads it ahead of its queue (M108, M876), else as a line of our own.
    pub fn command(&mut self, _command: &str, _now_ms: u64) {}

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
    }

    /// The oldest event that was not fetched.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Last line of the file that the printer acknowledged; 0 before the first.
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
            Phase::Ended => return None,
            Phase::Boot { speak_ms, .. } => Some(speak_ms),
            Phase::Numbering { retry_ms, .. } => Some(retry_ms),
            Phase::WindDown { until_ms, .. } | Phase::Safe { until_ms, .. } => Some(until_ms),
            Phase::Job if !self.printer.auto_report => Some(self.poll_ms),
            Phase::Identify { .. } | Phase::Job => None,
        };
        let others = [self.answers.drain_ends_ms(), self.stall_ms()];
        others.into_iter().flatten().chain(phase).min()
    }

    // ---- phases ----

    /// Tells the printer to count from 0: `N0 M110 N0*125`.
    fn number(&mut self, then: Then, tries: u32, now_ms: u64) {
        let out_of_time = matches!(then, Then::Safe { until_ms } if now_ms >= until_ms);
        if tries >= HANDSHAKE_TRIES || out_of_time {
            let failure = self.answers.no_answer();
            self.ending.get_or_insert(Ending::Failed(failure));
            self.end_early(match self.touched {
                true => Safety::Unknown,
                false => Safety::Untouched,
            });
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
    fn numbered(&mut self, then: Then, tries: u32, now_ms: u64) {
        self.window.reset();
        self.stall.progress(now_ms);
        self.proof_tries = 0;
        self.answers.unproved();
        self.phase = match then {
            Then::Identify => Phase::Identify { asked: 0 },
            // Not before M105 has proved that M110 was understood.
            Then::Job => Phase::Identify { asked: ASKED_ALL },
            Then::Safe { until_ms } => Phase::Safe { next: 0, until_ms },
        };
        if tries > 1 {
            // The earlier tries may be answered too; those acknowledge nothing.
            self.answers.drain(now_ms);
        }
    }

    /// The job cannot go on. Where the link may still work, the printer is made
    /// safe before the end is told.
    fn fail(&mut self, failure: Failure, now_ms: u64) {
        if self.is_over() {
            return;
        }
        if self.ending.is_some() {
            // Already on the way out: one more failure means that it did not work.
            match self.phase {
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
    fn fail_at_once(&mut self, failure: Failure) {
        self.ending.get_or_insert(Ending::Failed(failure));
        self.end_early(match self.touched {
            true => Safety::ByFirmware,
            false => Safety::Untouched,
        });
    }

    /// Starts the safe sequence. Its lines are numbered from 1 again: after a
    /// garbled resend request our count and the printer's may differ, and a line
    /// that switches heaters off must not be dropped as a repeat.
    fn make_safe(&mut self, now_ms: u64) {
        self.pending.full = false;
        let patience_ms = match self.ending {
            Some(Ending::Cancelled) => SAFE_AFTER_CANCEL_MS,
            _ => SAFE_AFTER_FAILURE_MS,
        };
        let until_ms = now_ms + patience_ms;
        self.number(Then::Safe { until_ms }, 0, now_ms);
    }

    fn end_early(&mut self, safety: Safety) {
        let ending = self.ending.clone().unwrap_or(Ending::Cancelled);
        self.end(Outcome::Stopped { ending, safety });
    }

    fn end(&mut self, outcome: Outcome) {
        if !self.is_over() {
            self.phase = Phase::Ended;
            self.out.clear();
            self.out_at = 0;
            self.tell(Event::Ended(outcome));
        }
    }

    fn tell(&mut self, event: Event) {
        let must = matches!(
            event,
            Event::Held | Event::OwnDone | Event::Connected { .. } | Event::Stopping(_) | Event::Ended(_)
        );
        if must || self.events.len() < MAX_EVENTS {
            self.events.push_back(event);
        }
    }
}
