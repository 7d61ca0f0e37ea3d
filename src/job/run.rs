//! Where a host meets a port, a clock, a journal and a user: bytes, lines, records and
//! requests go between them until the job is over.
//!
//! Takes a [`Host`] and the [`Wires`] to all of these; tells every event to a
//! [`Watcher`]. Owns the clock; knows no protocol, no file and no terminal.
//!
//! # What a disk can do to a print
//! Records are written by a thread of their own ([`Scribe`]), so that a slow disk holds
//! up nothing. A disk that refuses pauses the job: the head is parked, heaters stay as
//! they are, and the user is told. Nobody may resume until the records are kept, for
//! what goes on without them could later be printed twice. The thread goes on trying.
use super::host::{Host, HostEvent, PortWish, Request};
use super::record::Checkpoint;
use super::recover::Plan;
use super::scribe::Scribe;
use super::state::State;
use crate::printer::find::{Identity, Places, reopen};
use crate::printer::port::{Moved, Port, PortError};
use crate::printer::session::Outcome;
use crate::printer::source::Source;
use std::future::Future;
use std::pin::{Pin, pin};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep, sleep_until};

/// Bytes read at once; replies are short, so this holds many.
const READ_BYTES: usize = 4096;

/// Longest sleep when the host has no deadline; any value would do.
const IDLE: Duration = Duration::from_secs(60);

/// Mail that waits at most; who has more waits. A person types slower than it is
/// read.
const MAX_MAIL: usize = 64;

/// Records given to the journal's thread that it has not kept yet, at most; the host keeps the rest.
/// A printing host makes one or two a second.
const MAX_UNKEPT: u64 = 256;

/// How long the last records of a job that is over are waited for: a busy SD card
/// takes seconds, a broken one is not worth more.
const LAST_RECORDS: Duration = Duration::from_secs(10);

/// Between two rounds of tries of a port that is there and cannot be opened.
const REFUSED_PAUSE: Duration = Duration::from_secs(2);

/// What a running host hears from this side.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Mail {
    /// The user wants something.
    Ask(Request),
    /// Something for the watcher to show.
    Tell(String),
    /// The user wants to leave at once: the printer is left as it is.
    Quit,
    /// Something that the job's lines wait for may have come.
    Look,
    /// The medium keeps so many of the records.
    Kept(u64),
    /// The medium refuses, and why; the records are tried again.
    Unkept(String),
}

/// Both ends of a running host's mail.
pub fn mailbox() -> (mpsc::Sender<Mail>, mpsc::Receiver<Mail>) {
    mpsc::channel(MAX_MAIL)
}

/// Who watches a job.
pub trait Watcher {
    /// Something happened.
    fn event(&mut self, event: &HostEvent);
    /// Lines of the file up to this place are acknowledged. Called after every
    /// exchange with the printer, so it must cost next to nothing.
    fn acknowledged(&mut self, at: &Checkpoint);
    /// The way back into the job, which waits for a person's word.
    fn planned(&mut self, _plan: &Plan) {}
}

/// What a host is tied to.
pub struct Wires<'a, W> {
    /// The printer's port, open since `started`.
    pub port: Port,
    /// Whether DTR resets the board, for an emergency stop that was not heard.
    pub hard_stop: bool,
    /// What finds the printer again when its port has vanished.
    pub identity: Identity,
    /// Who writes records down; `None`: nobody, and the host goes on as if they were kept.
    pub scribe: Option<Scribe>,
    /// Requests, and the scribe's answers.
    pub mail: mpsc::Receiver<Mail>,
    /// Who watches.
    pub watcher: &'a mut W,
    /// Is told of the port whenever it was opened, and that it is about to be closed (or is gone).
    pub on_port: Option<OnPort>,
    /// When the host's clock stood at 0.
    pub started: Instant,
}

/// Who wants to know which port is open.
pub type OnPort = Box<dyn FnMut(Option<&Port>)>;

/// How it ended.
#[derive(Debug, Clone, PartialEq)]
pub enum End {
    /// The host came to an end.
    Over(Outcome),
    /// The host left the job as its state says, and its events said why: the printer has lost
    /// its state, or the job cannot be taken up.
    Left,
    /// The user left; the printer is as it was.
    Quit,
}

/// What is left when a run is over.
#[derive(Debug)]
pub struct Ended {
    /// How it ended.
    pub end: End,
    /// The port, where it was open to the end. Who does not want it drops it.
    pub port: Option<Port>,
}

/// The port, or what is done about it.
enum Link {
    Open(Port),
    Away(Pin<Box<dyn Future<Output = Port>>>),
    /// All is over.
    Closed,
}

/// What came of a [`Link`].
enum Came {
    Moved(Result<Moved, PortError>),
    Back(Port),
}

impl Link {
    /// The port, if it is open.
    fn open(self) -> Option<Port> {
        match self {
            Link::Open(port) => Some(port),
            Link::Away(_) | Link::Closed => None,
        }
    }

    /// Nothing is lost when the returned future is dropped.
    async fn exchange(&mut self, input: &mut [u8], output: &[u8]) -> Came {
        match self {
            Link::Open(port) => Came::Moved(port.exchange(input, output).await),
            Link::Away(back) => Came::Back(back.as_mut().await),
            Link::Closed => std::future::pending().await,
        }
    }
}

/// Runs a host to its end.
///
/// Dropping the future abandons the job where it is: the caller then tells that
/// heaters may be on.
pub async fn run<S: Source, W: Watcher>(host: &mut Host<S>, wires: Wires<'_, W>) -> Ended {
    let Wires { port, hard_stop, identity, scribe, mut mail, watcher, mut on_port, started } = wires;
    let baud = port.baud();
    if let Some(tell) = &mut on_port {
        tell(Some(&port));
    }
    let mut link = Link::Open(port);
    let mut run = Run {
        book: Book::new(scribe),
        hard_stop,
        identity,
        baud,
        watcher,
        on_port,
        started,
        over_at: None,
        done: None,
    };
    let mut input = [0_u8; READ_BYTES];
    let mut timer = pin!(sleep_until(started));
    let mut mail_open = true;
    loop {
        run.book.take(host, now_ms(started));
        run.tell(host);
        if let Some(end) = run.end(host) {
            return Ended { end, port: run.done.or(link.open()) };
        }
        run.obey(host, &mut link).await;
        let due = run.due(host);
        // Deadlines mostly move away with every answer. Setting the timer costs
        // more than waking once too often, so only an earlier one sets it.
        if due < timer.deadline() || timer.is_elapsed() {
            timer.as_mut().reset(due);
        }
        tokio::select! {
            biased;
            letter = mail.recv(), if mail_open => match letter {
                Some(Mail::Quit) => return Ended { end: End::Quit, port: link.open() },
                // A broken-off job that waits for a word is left as it is.
                Some(Mail::Ask(Request::Cancel)) if host.state() == State::Interrupted => {
                    return Ended { end: End::Quit, port: link.open() };
                }
                Some(letter) => run.read(letter, host, &mut link),
                // Nobody is left who could write.
                None => mail_open = false,
            },
            came = link.exchange(&mut input, host.output()) => match came {
                Came::Moved(Ok(Moved::Wrote(len))) => host.written(len),
                Came::Moved(Ok(Moved::Read(len))) => host.on_bytes(&input[..len], now_ms(started)),
                Came::Moved(Err(e)) => {
                    run.port_is(None);
                    link = Link::Closed;
                    host.link_lost(e.to_string(), now_ms(started));
                }
                Came::Back(port) => {
                    run.port_is(Some(&port));
                    link = Link::Open(port);
                    host.link_back(now_ms(started));
                }
            },
            () = &mut timer => {}
        }
        // Also after an exchange: a printer that never falls silent must not keep
        // the host from its deadlines.
        let now_ms = now_ms(started);
        if host.deadline().is_some_and(|at_ms| at_ms <= now_ms) {
            host.on_tick(now_ms);
        }
    }
}

/// What a run needs beside the host and its port.
struct Run<'a, W> {
    book: Book,
    hard_stop: bool,
    identity: Identity,
    baud: u32,
    watcher: &'a mut W,
    on_port: Option<OnPort>,
    started: Instant,
    over_at: Option<Instant>,
    /// The port, when the host is done with it.
    done: Option<Port>,
}

impl<W: Watcher> Run<'_, W> {
    fn port_is(&mut self, port: Option<&Port>) {
        if let Some(tell) = &mut self.on_port {
            tell(port);
        }
    }

    fn tell<S: Source>(&mut self, host: &mut Host<S>) {
        self.watcher.acknowledged(&host.position());
        while let Some(event) = host.poll_event() {
            self.watcher.event(&event);
            if event == HostEvent::Planned
                && let Some(plan) = host.plan()
            {
                self.watcher.planned(plan);
            }
        }
    }

    /// The end, once it is there and written down, or cannot be.
    fn end<S: Source>(&mut self, host: &Host<S>) -> Option<End> {
        if !host.is_over() {
            return None;
        }
        let over_at = *self.over_at.get_or_insert_with(Instant::now);
        let kept = host.port() == PortWish::Close && self.book.all_kept();
        let end = || host.outcome().map_or(End::Left, |outcome| End::Over(outcome.clone()));
        (kept || over_at.elapsed() >= LAST_RECORDS).then(end)
    }

    fn due<S: Source>(&self, host: &Host<S>) -> Instant {
        let host = host.deadline().map(|at_ms| self.started + Duration::from_millis(at_ms));
        let end = self.over_at.map(|at| at + LAST_RECORDS);
        host.into_iter().chain(end).min().unwrap_or_else(|| Instant::now() + IDLE)
    }

    /// Does what the host wants of the port.
    async fn obey<S: Source>(&mut self, host: &mut Host<S>, link: &mut Link) {
        match host.port() {
            PortWish::Keep => {}
            PortWish::Reopen => {
                if !matches!(link, Link::Away(_)) {
                    // The old one first: two openings exclude each other.
                    self.done = None;
                    *link = Link::Closed;
                    *link = Link::Away(Box::pin(reopened(self.identity.clone(), self.baud)));
                }
            }
            PortWish::HardStop => {
                let done = match link {
                    Link::Open(port) if self.hard_stop => {
                        self.port_is(None);
                        let done = port.reset_board().await.is_ok();
                        self.port_is(Some(port));
                        done
                    }
                    _ => false,
                };
                host.hard_stopped(done, now_ms(self.started));
            }
            PortWish::Close => {
                self.port_is(None);
                if let Some(port) = std::mem::replace(link, Link::Closed).open() {
                    self.done = Some(port);
                }
            }
        }
    }

    fn read<S: Source>(&mut self, letter: Mail, host: &mut Host<S>, link: &mut Link) {
        let now_ms = now_ms(self.started);
        match letter {
            Mail::Quit => {}
            Mail::Look => host.look(now_ms),
            Mail::Tell(words) => self.watcher.event(&HostEvent::Told(words)),
            Mail::Ask(Request::Resume) if self.book.unkept => {
                self.watcher.event(&HostEvent::Refused(
                    "the journal cannot be written, and what is printed now could be printed twice later: \
                     make room on the disk first",
                ));
            }
            Mail::Ask(request) => {
                if request == Request::EmergencyStop
                    && let Link::Open(port) = link
                {
                    // What the system has not sent yet would delay M112.
                    if let Err(e) = port.flush_output() {
                        self.watcher.event(&HostEvent::Told(e.to_string()));
                    }
                }
                host.request(request, now_ms);
            }
            Mail::Kept(records) => {
                self.book.kept = self.book.kept.max(records);
                host.durable(records, now_ms);
                if std::mem::take(&mut self.book.unkept) {
                    let words = "the journal is written again: resume when you like".to_owned();
                    self.watcher.event(&HostEvent::Told(words));
                }
            }
            Mail::Unkept(reason) => {
                if !std::mem::replace(&mut self.book.unkept, true) && host.outcome().is_none() {
                    let words = format!(
                        "the journal cannot be written ({reason}); the job pauses until it can: make room \
                         on the disk"
                    );
                    self.watcher.event(&HostEvent::Told(words));
                    host.request(Request::Pause, now_ms);
                }
            }
        }
    }
}

/// Waits until the port is back, however long; one that is there and refuses (another program took it)
/// is tried again.
async fn reopened(identity: Identity, baud: u32) -> Port {
    let places = Places::default();
    loop {
        if let Ok(port) = reopen(&identity, baud, &places).await {
            return port;
        }
        sleep(REFUSED_PAUSE).await;
    }
}

/// The records on their way to the journal.
struct Book {
    scribe: Option<Scribe>,
    given: u64,
    kept: u64,
    /// The medium refused, and has not kept anything since.
    unkept: bool,
}

impl Book {
    fn new(scribe: Option<Scribe>) -> Self {
        Self { scribe, given: 0, kept: 0, unkept: false }
    }

    fn all_kept(&self) -> bool {
        self.kept >= self.given
    }

    /// Fetches what is to be written down.
    fn take<S: Source>(&mut self, host: &mut Host<S>, now_ms: u64) {
        match &self.scribe {
            Some(scribe) => {
                while self.given - self.kept < MAX_UNKEPT
                    && let Some(record) = host.poll_record()
                {
                    self.given += 1;
                    scribe.write(record);
                }
            }
            None => {
                let before = self.given;
                // What the host does once they are kept may make more of them.
                while host.poll_record().is_some() {
                    self.given += 1;
                }
                if self.given > before {
                    self.kept = self.given;
                    host.durable(self.given, now_ms);
                }
            }
        }
    }
}

/// Milliseconds since `started`, as a host counts them.
pub fn now_ms(started: Instant) -> u64 {
    u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX)
}
