//! One job on one printer: protocol, state, records and position together.
//!
//! Takes what comes from the port, from the user and from the journal, with the time
//! in ms of any steady clock; gives bytes to write, records to keep, wishes for the
//! port, and events. Does no I/O and owns no clock. Reads the job through its
//! [`Source`].
//!
//! # What is written down before it is done
//! Records come out of [`Host::poll_record`] in order; [`Host::durable`] tells up to
//! which of them the medium keeps. Whatever could make a job be printed twice or at
//! a wrong place waits for its record: the first line of the file, a change of what
//! the line numbers mean, the first line after a pause. Checkpoints are not waited
//! for, but no more than [`MAX_AHEAD`] commands are sent beyond the last one that is
//! durable.
use super::record::{Checkpoint, Log, Record};
use super::recover::{Case, Plan, ResumeRules};
use super::state::State;
use super::tracker::EModes;
use crate::printer::session::{Event, Outcome, Session, Settings};
use crate::printer::source::Source;
use std::collections::VecDeque;

/// Commands sent at most beyond the last durable checkpoint: what a resume after a
/// power cut may go over again, the printer's own queues apart.
pub const MAX_AHEAD: u64 = 1024;

/// A checkpoint is written at least every so many commands while lines are acknowledged…
pub const CHECKPOINT_COMMANDS: u64 = 512;

/// …or after so long.
pub const CHECKPOINT_MS: u64 = 5_000;

/// What one job on one printer needs to be told.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct HostSettings {
    /// The connection's.
    pub session: Settings,
    /// Lines before the file's first.
    pub start_macro: Vec<String>,
    /// Lines after the file's last.
    pub end_macro: Vec<String>,
    /// Lines that park the head.
    pub pause_macro: Vec<String>,
    /// How the job may be resumed after the printer lost its state.
    pub resume: ResumeRules,
    /// What `G90` and `G91` do to E.
    pub e_modes: EModes,
    /// Lowers the nozzle's target in a long pause.
    pub pause_cooling: Option<PauseCooling>,
    /// Whether a host whose printer lost its state waits for [`Request::Confirm`]
    /// (after [`HostEvent::Planned`]); otherwise it ends there, and the job is
    /// resumed later.
    pub waits_for_person: bool,
}

/// What a long pause does to the nozzle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PauseCooling {
    /// After so long a pause, ms…
    pub after_ms: u64,
    /// …its target is lowered to this, °C.
    pub nozzle_c: f32,
}

/// How a host begins.
#[derive(Debug, Clone, PartialEq)]
pub enum Begin {
    /// From the job's first line.
    Fresh,
    /// After a host that died: ask the printer where it is, go on if it kept its state
    /// (if it was parked: stay so until [`Request::Resume`]). If it did not, the host is
    /// [`State::Interrupted`], see [`HostSettings::waits_for_person`].
    TakeOver {
        /// What the journal says of the job.
        log: Box<Log>,
    },
    /// After the printer lost its state. The way back is planned at once and
    /// runs after [`Request::Confirm`], or without asking where `confirmed` says that
    /// a person has given the word.
    AfterReset {
        /// What the journal says of the job.
        log: Box<Log>,
        /// Part and nozzle are clear.
        confirmed: bool,
    },
    /// For a guardian: ask the printer where it is, write that down, run the cancel
    /// macro, end as [`State::Interrupted`].
    MakeSafe {
        /// What the journal says of the job.
        log: Box<Log>,
    },
}

/// What a user wants.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Request {
    /// Park and wait.
    Pause,
    /// Go on: after a pause, or where the printer waits for a person.
    Resume,
    /// Part and nozzle are clear: the way back after a loss of state may run.
    Confirm,
    /// End it, safely.
    Cancel,
    /// M112, at once.
    EmergencyStop,
    /// The answer to the printer's question: the button's place, from 0.
    Answer(u8),
    /// A command beside the job.
    Command(String),
}

/// What the host wants done with the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PortWish {
    /// Exchange bytes.
    Keep,
    /// It is gone: find it again, open it, tell [`Host::link_back`].
    Reopen,
    /// Reset the board, tell [`Host::hard_stopped`].
    HardStop,
    /// All is over: close it.
    Close,
}

/// What happened.
#[derive(Debug, Clone, PartialEq)]
pub enum HostEvent {
    /// The job is in another state.
    State(State),
    /// What the session tells.
    Session(Event),
    /// A request was refused, and why.
    Refused(&'static str),
    /// Where a job that was broken off stands.
    Case(Case),
    /// The way back is known ([`Host::plan`]) and waits for [`Request::Confirm`].
    Planned,
    /// Something that the user should know.
    Told(String),
}

/// One job on one printer. See the module's text.
#[derive(Debug)]
pub struct Host<S> {
    settings: HostSettings,
    session: Session,
    source: S,
    state: State,
    records: VecDeque<Record>,
    events: VecDeque<HostEvent>,
    /// Records given out, and kept by the medium.
    given: u64,
    kept: u64,
    /// The file's first line may go once so many records are kept.
    open_at: Option<u64>,
    over: Option<Outcome>,
}

impl<S: Source> Host<S> {
    /// A host over a port that was opened at `now_ms`. `source` stands before the
    /// job's first line, whatever `begin` says.
    pub fn new(settings: HostSettings, source: S, begin: &Begin, now_ms: u64) -> Self {
        let session = match begin {
            Begin::Fresh => Session::new(settings.session.clone(), now_ms),
            _ => Session::take_over(settings.session.clone(), now_ms),
        };
        let mut host = Self {
            settings,
            session,
            source,
            state: State::Accepted,
            records: VecDeque::new(),
            events: VecDeque::new(),
            given: 0,
            kept: 0,
            open_at: None,
            over: None,
        };
        host.enter(State::Starting);
        host
    }

    // ---- what comes in ----

    /// Bytes came from the printer.
    pub fn on_bytes(&mut self, bytes: &[u8], now_ms: u64) {
        self.session.on_bytes(bytes, now_ms);
        self.go_on(now_ms);
    }

    /// Time passed. Call at [`Host::deadline`] or later.
    pub fn on_tick(&mut self, now_ms: u64) {
        self.session.on_tick(now_ms);
        self.go_on(now_ms);
    }

    /// The port is gone.
    pub fn link_lost(&mut self, reason: String, now_ms: u64) {
        self.session.link_lost(reason);
        self.go_on(now_ms);
    }

    /// The port was opened again.
    pub fn link_back(&mut self, now_ms: u64) {
        self.session.link_back(now_ms);
        self.go_on(now_ms);
    }

    /// The board was reset as [`PortWish::HardStop`] wants, or cannot be.
    pub fn hard_stopped(&mut self, done: bool, now_ms: u64) {
        self.session.hard_stopped(done, now_ms);
        self.go_on(now_ms);
    }

    /// The user wants something.
    pub fn request(&mut self, request: Request, now_ms: u64) {
        match request {
            Request::Cancel => self.session.cancel(now_ms),
            Request::EmergencyStop => self.session.emergency_stop(now_ms),
            _ => self.events.push_back(HostEvent::Refused("not yet")),
        }
        self.go_on(now_ms);
    }

    /// The medium keeps the first `records` of all that [`Host::poll_record`] gave.
    pub fn durable(&mut self, records: u64, now_ms: u64) {
        self.kept = self.kept.max(records);
        self.go_on(now_ms);
    }

    // ---- what goes out ----

    /// Bytes to write, in order.
    pub fn output(&self) -> &[u8] {
        self.session.output()
    }

    /// The first `len` bytes of [`Host::output`] are written.
    pub fn written(&mut self, len: usize) {
        self.session.written(len);
    }

    /// The oldest record that was not fetched, to be appended to the journal. Sync at
    /// leisure, but soon: the job may wait for it.
    pub fn poll_record(&mut self) -> Option<Record> {
        let record = self.records.pop_front()?;
        self.given += 1;
        Some(record)
    }

    /// The oldest event that was not fetched.
    pub fn poll_event(&mut self) -> Option<HostEvent> {
        self.events.pop_front()
    }

    /// What is wanted of the port.
    pub fn port(&self) -> PortWish {
        match self.over {
            Some(_) => PortWish::Close,
            None => PortWish::Keep,
        }
    }

    /// When [`Host::on_tick`] is due at the latest, in ms.
    pub fn deadline(&self) -> Option<u64> {
        self.session.deadline()
    }

    /// Where the job is.
    pub fn state(&self) -> State {
        self.state
    }

    /// How far it is.
    pub fn position(&self) -> Checkpoint {
        Checkpoint { line: self.session.job_acked(), ..Checkpoint::default() }
    }

    /// Where the job that was taken up was found to stand.
    pub fn case(&self) -> Option<&Case> {
        None
    }

    /// The way back after a loss of state, once it is known.
    pub fn plan(&self) -> Option<&Plan> {
        None
    }

    /// How it ended. With [`Case`]s that end a host before its connection has ended
    /// by itself this is `None` although [`Host::port`] is [`PortWish::Close`].
    pub fn outcome(&self) -> Option<&Outcome> {
        self.over.as_ref()
    }

    // ---- in between ----

    fn enter(&mut self, state: State) {
        self.state = state;
        self.records.push_back(Record::State(state));
        self.events.push_back(HostEvent::State(state));
    }

    /// All records that there are so far.
    fn written_down(&self) -> u64 {
        self.given + self.records.len() as u64
    }

    fn go_on(&mut self, now_ms: u64) {
        loop {
            while let Some(event) = self.session.poll_event() {
                self.on_event(&event, now_ms);
                self.events.push_back(HostEvent::Session(event));
            }
            if self.open_at.is_some_and(|at| self.kept >= at) {
                self.open_at = None;
                self.session.release(now_ms);
            }
            if !self.session.wants_line() {
                return;
            }
            match self.source.advance() {
                Ok(true) => {
                    let line = self.source.line();
                    self.session.feed(line.command, line.number, now_ms);
                }
                Ok(false) => {
                    self.enter(State::Ending);
                    self.session.hold(now_ms);
                }
                Err(e) => self.session.source_failed(e.line, e.reason, now_ms),
            }
        }
    }

    fn on_event(&mut self, event: &Event, now_ms: u64) {
        match event {
            Event::Connected { .. } => self.session.hold(now_ms),
            Event::Held => match self.state {
                State::Starting => {
                    self.session.run_own(self.settings.start_macro.iter().map(String::as_str), now_ms)
                }
                _ => self.session.run_own(self.settings.end_macro.iter().map(String::as_str), now_ms),
            },
            Event::OwnDone => match self.state {
                State::Starting => {
                    let first = self.session.next_number();
                    self.records.push_back(Record::Numbers { first, after: 0 });
                    self.enter(State::Printing);
                    self.open_at = Some(self.written_down());
                }
                _ => self.session.finish_job(now_ms),
            },
            Event::Ended(outcome) => {
                self.enter(match outcome {
                    Outcome::Finished => State::Finished,
                    Outcome::Stopped { .. } => State::Failed,
                });
                self.over = Some(outcome.clone());
            }
            _ => {}
        }
    }
}
