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
mod book;
mod ends;
mod flight;
mod life;
mod pause;
mod take_up;

#[cfg(test)]
mod tests;

use super::record::{Checkpoint, Log, Record};
use super::recover::walk::Kept;
use super::recover::{Case, Plan, ResumeRules};
use super::state::{Decision, Event as Happening, State, next};
use super::tracker::{EModes, Tracker};
use crate::printer::reply::Position;
use crate::printer::session::{Event, Outcome, Session, Settings};
use crate::printer::source::Source;
use book::Book;
use flight::Flight;
use pause::Parked;
use std::collections::VecDeque;
use take_up::TakeUp;

/// Commands sent at most beyond the last durable checkpoint: what a resume after a
/// power cut may go over again, the printer's own queues apart.
pub const MAX_AHEAD: u64 = 1024;

/// A checkpoint is written at least every so many commands while lines are acknowledged…
pub const CHECKPOINT_COMMANDS: u64 = 512;

/// …or after so long…
pub const CHECKPOINT_MS: u64 = 5_000;

/// …or, when beads are at another height than at the last, after so long: where the nozzle
/// stands after a power cut is known the better, and a vase does not wear the medium.
pub const CHECKPOINT_LAYER_MS: u64 = 1_000;

/// Events kept for a driver that does not fetch them; what the printer says beyond is dropped.
const MAX_EVENTS: usize = 1024;

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
    /// A firmware that halts leaves something on that a reset of the board switches off: a light on a
    /// fan's pin.
    pub resets_when_halted: bool,
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

/// What goes on between host and session; what [`Event::Held`] and
/// [`Event::OwnDone`] then mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Doing {
    /// The handshake, and a hold after it.
    Connecting,
    /// Our own lines before the file's first.
    StartMacro,
    /// Held, the file's next line waits for a record; or lines go out.
    Feeding,
    /// Before a pause: a hold.
    Holding,
    /// Our own lines that park the head.
    Parking,
    /// Parked.
    Parked,
    /// Parked, the nozzle's target is lowered.
    Cooling,
    /// Parked: the printer is asked where it is before the way back.
    Asking,
    /// Our own lines that lead back from where it is parked.
    Unparking,
    /// After the file's last line: a hold.
    HoldingEnd,
    /// Our own lines after the file's last.
    EndMacro,
    /// The session ends by itself: done, cancelled or failed.
    Finishing,
    /// The printer is asked for its last line.
    Finding,
    /// The file is walked to where the printer is; the session waits.
    Walking,
    /// Both count alike again; a hold follows.
    Rejoining,
    /// The printer is asked where its head is.
    Verifying,
    /// A person's word is awaited.
    Waiting,
    /// The handshake before the way back.
    Reconnecting,
    /// A step of the way back.
    WayBack(usize),
}

/// What is done once the records before it are durable.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Then {
    Feed,
    Park,
    EndMacro,
    GoOn { last: u32 },
    MakeSafe,
    WayBack,
    Step(usize),
}

/// Wishes that cannot be granted yet.
#[derive(Debug, Clone, Copy, Default)]
struct Wishes {
    pause: bool,
    resume: bool,
    /// The pause that is on its way is for want of filament.
    ran_out: bool,
}

/// One job on one printer. See the module's text.
#[derive(Debug)]
pub struct Host<S> {
    settings: HostSettings,
    session: Session,
    source: S,
    state: State,
    doing: Doing,
    events: VecDeque<HostEvent>,
    book: Book,
    /// What waits for so many records to be durable.
    gate: Option<(u64, Then)>,
    /// The session's ask is allowed once so many are.
    ask_at: Option<u64>,
    /// Whether numbers on the wire stand for lines of the file, as last written down.
    numbered: bool,
    /// Whether a line of the file may have been sent, ever.
    begun: bool,
    /// Commands of the file before a place in it that are sent first, after a resume.
    again: VecDeque<Kept>,
    flight: Flight,
    /// Commands of the file that were fed, and the last acknowledged position.
    fed: u64,
    acked: Checkpoint,
    /// The machine as the acknowledged lines leave it.
    tracker: Tracker,
    /// The last checkpoint written: commands and time, and height of beads then.
    noted: (u64, u64, f64),
    bead_mm: f64,
    /// Moves that the printer may hold, as the profile says or as it has told.
    depth: u32,
    /// Our own lines that run, and the first and last place reported while they do.
    own: Vec<String>,
    reports: [Option<Position>; 2],
    /// How often it was asked where its head is.
    asked_where: u32,
    /// When it is asked again, unless the answer comes before.
    asks_where_ms: Option<u64>,
    wishes: Wishes,
    parked: Option<Box<Parked>>,
    taken: Option<Box<TakeUp>>,
    link_down: bool,
    /// All is over on our side, whatever the session thinks.
    closing: bool,
    /// The firmware has halted, and the board is to be reset.
    resets: bool,
    over: Option<Outcome>,
}

impl<S: Source> Host<S> {
    /// A host over a port that was opened at `now_ms`. `source` stands before the
    /// job's first line, whatever `begin` says.
    pub fn new(settings: HostSettings, source: S, begin: &Begin, now_ms: u64) -> Self {
        let mut wire = settings.session.clone();
        // What the numbers mean is written down, always.
        wire.asks = true;
        let session = match begin {
            Begin::Fresh | Begin::AfterReset { .. } => Session::new(wire, now_ms),
            Begin::TakeOver { .. } | Begin::MakeSafe { .. } => Session::take_over(wire, now_ms),
        };
        let mut host = Self {
            tracker: Tracker::new(settings.e_modes),
            depth: settings.resume.held_moves(),
            settings,
            session,
            source,
            state: State::Accepted,
            doing: Doing::Connecting,
            events: VecDeque::new(),
            book: Book::default(),
            gate: None,
            ask_at: None,
            numbered: false,
            begun: false,
            again: VecDeque::new(),
            flight: Flight::default(),
            fed: 0,
            acked: Checkpoint::default(),
            noted: (0, now_ms, 0.0),
            bead_mm: 0.0,
            own: Vec::new(),
            reports: [None; 2],
            asked_where: 0,
            asks_where_ms: None,
            wishes: Wishes::default(),
            parked: None,
            taken: None,
            link_down: false,
            closing: false,
            resets: false,
            over: None,
        };
        host.begin(begin);
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
        self.walk_on(now_ms);
        self.cool_down(now_ms);
        self.ask_where_again(now_ms);
        self.go_on(now_ms);
    }

    /// Something that the source waits for may have come.
    pub fn look(&mut self, now_ms: u64) {
        self.go_on(now_ms);
    }

    /// The port is gone.
    pub fn link_lost(&mut self, reason: String, now_ms: u64) {
        self.session.link_lost(reason);
        self.go_on(now_ms);
    }

    /// The port was opened again.
    pub fn link_back(&mut self, now_ms: u64) {
        self.link_down = false;
        self.happen(Happening::LinkBack);
        self.session.link_back(now_ms);
        self.go_on(now_ms);
    }

    /// The port is gone for good: it is no longer waited for.
    pub fn port_lost(&mut self, reason: String, now_ms: u64) {
        self.session.port_lost(reason);
        self.go_on(now_ms);
    }

    /// The board was reset as [`PortWish::HardStop`] wants, or cannot be.
    pub fn hard_stopped(&mut self, done: bool, now_ms: u64) {
        if std::mem::take(&mut self.resets) {
            self.say(match done {
                true => "the board was reset: its light is off",
                false => {
                    "THE LIGHT MAY BE ON: the firmware halted, and nothing resets the board; switch it off"
                }
            });
            return;
        }
        self.session.hard_stopped(done, now_ms);
        self.go_on(now_ms);
    }

    /// The user wants something. [`HostEvent::Refused`] says why it cannot be.
    pub fn request(&mut self, request: Request, now_ms: u64) {
        match request {
            Request::Pause => self.want_pause(now_ms),
            Request::Resume => self.want_resume(now_ms),
            Request::Confirm => self.want_confirm(now_ms),
            Request::Cancel => self.want_cancel(now_ms),
            Request::EmergencyStop => self.want_emergency_stop(now_ms),
            Request::Answer(choice) => {
                if !self.session.answer(choice, now_ms) {
                    self.refuse("the printer asks nothing");
                }
            }
            Request::Command(command) => self.want_command(&command, now_ms),
        }
        self.go_on(now_ms);
    }

    /// The medium keeps the first `records` of all that [`Host::poll_record`] gave.
    pub fn durable(&mut self, records: u64, now_ms: u64) {
        self.book.kept(records);
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

    /// Whether what the system has not sent yet is to be dropped before
    /// [`Host::output`] is written. See [`Session::wants_flush`].
    pub fn wants_flush(&self) -> bool {
        self.session.wants_flush()
    }

    /// The oldest record that was not fetched, to be appended to the journal. Sync at
    /// leisure, but soon: the job may wait for it.
    pub fn poll_record(&mut self) -> Option<Record> {
        self.book.poll()
    }

    /// The oldest event that was not fetched.
    pub fn poll_event(&mut self) -> Option<HostEvent> {
        self.events.pop_front()
    }

    /// What is wanted of the port.
    pub fn port(&self) -> PortWish {
        if self.resets {
            return PortWish::HardStop;
        }
        if self.is_over() {
            // The last state is durable before the port goes.
            return if self.book.has_all() { PortWish::Close } else { PortWish::Keep };
        }
        match self.link_down {
            true => PortWish::Reopen,
            false if self.session.wants_hard_stop() => PortWish::HardStop,
            false => PortWish::Keep,
        }
    }

    /// When [`Host::on_tick`] is due at the latest, in ms.
    pub fn deadline(&self) -> Option<u64> {
        // A walk goes on at once.
        let walk = self.is_walking().then_some(0);
        let checkpoint = (self.acked.commands > self.noted.0).then_some(self.noted.1 + CHECKPOINT_MS);
        let source = self.source.due_ms().filter(|_| self.doing == Doing::Feeding);
        [self.session.deadline(), walk, checkpoint, self.cools_at(), self.asks_where_ms, source]
            .into_iter()
            .flatten()
            .min()
    }

    /// Where the job is.
    pub fn state(&self) -> State {
        self.state
    }

    /// How far it is.
    pub fn position(&self) -> Checkpoint {
        self.acked
    }

    /// Commands that were acknowledged or are on their way, and those of the last
    /// durable checkpoint: the first is at most [`MAX_AHEAD`] more.
    pub fn ahead(&self) -> (u64, u64) {
        (self.fed, self.book.durable_commands())
    }

    /// Where the job that was taken up was found to stand.
    pub fn case(&self) -> Option<&Case> {
        self.taken.as_ref()?.case()
    }

    /// The way back after a loss of state, once it is known.
    pub fn plan(&self) -> Option<&Plan> {
        self.taken.as_ref()?.plan()
    }

    /// How it ended. `None` although [`Host::port`] is [`PortWish::Close`]: a job that was
    /// taken up is [`State::Interrupted`], see [`Host::case`].
    pub fn outcome(&self) -> Option<&Outcome> {
        self.over.as_ref()
    }

    /// Nothing more comes of this host: it has its outcome, or leaves the job as it is.
    pub fn is_over(&self) -> bool {
        self.over.is_some() || self.closing
    }

    // ---- in between ----

    /// What the transition function makes of it is done; `true` if the state is another.
    fn happen(&mut self, event: Happening) -> bool {
        match next(self.state, event) {
            Decision::To(state) => {
                self.enter(state);
                true
            }
            Decision::Stay => false,
            Decision::Refuse(why) => {
                self.refuse(why);
                false
            }
        }
    }

    fn enter(&mut self, state: State) {
        self.state = state;
        self.book.push(Record::State(state));
        self.tell(HostEvent::State(state));
    }

    fn refuse(&mut self, why: &'static str) {
        self.tell(HostEvent::Refused(why));
    }

    fn say(&mut self, text: impl Into<String>) {
        self.tell(HostEvent::Told(text.into()));
    }

    fn tell(&mut self, event: HostEvent) {
        let may_go = matches!(event, HostEvent::Session(_) | HostEvent::Told(_));
        if !may_go || self.events.len() < MAX_EVENTS {
            self.events.push_back(event);
        }
    }
}
