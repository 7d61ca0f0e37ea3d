//! A job on a printer: the host's event loop, with orders as its mail and the board as its watcher.
//!
//! Takes a checked job with its journal, an open port and orders; tells how it ended.
use super::board::Board;
use super::{Actor, Order, Print, Told};
use crate::causes;
use crate::job::host::{Host, HostEvent, Request};
use crate::job::record::{Checkpoint, Record};
use crate::job::recover::Plan;
use crate::job::run::{End, Ended, Mail, Watcher, Wires, mailbox, run};
use crate::job::scribe::Scribe;
use crate::job::state::State;
use crate::printer::find::Connection;
use crate::printer::job_file::Checked;
use crate::printer::session::{Ending, Event, Outcome, Safety};
use crate::profile::printer::HardStop;
use crate::server::model::{Level, Link, Progress, Question};
use crate::station::job::Display;
use crate::station::marks::{Facts, Marks};
use crate::station::plate::Exposures;
use crate::station::realtime::first_in_line;
use crate::station::watchdog::LightWatch;
use crate::station::{cases, display, news, now_unix_s, pace, settings};
use anyhow::Context;
use std::cell::RefCell;
use std::pin::pin;
use std::rc::Rc;
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until, timeout};

/// Progress is shown so often: nobody reads faster, and each time costs the board's lock.
const SHOW: Duration = Duration::from_millis(500);

/// How long a daemon that ends waits for the head to be parked; of a resin job, for the plate to be
/// raised once its layer is done.
const PARK: Duration = Duration::from_secs(45);

/// What comes after a job.
#[derive(Debug)]
pub(super) enum Next {
    /// The printer is kept, and its port where it is in order.
    Stay(Option<Box<Connection>>),
    /// The daemon ends.
    Leave,
}

/// Prints a job to its end, or until it is left.
pub(super) async fn print(
    actor: &Actor,
    orders: &mut mpsc::Receiver<Order>,
    print: Print,
    connection: Connection,
) -> Next {
    let board = &actor.board;
    let id = print.id.clone();
    board.change(|p| {
        p.link = Link::Busy;
        p.error = None;
        p.job = Some(id.clone());
        p.words = Some("getting ready");
        p.progress = None;
        (p.question, p.waits_for_user, p.plan) = (None, None, None);
    });
    let name = print.name.clone();
    let park = PARK + print.job.longest_layer().div_f64(actor.speed);
    board.change(|p| p.park = park);
    let done = try_print(actor, orders, print, connection, park).await;
    let (state, words, safety, next) = match done {
        Ok(Done { end, state, next }) => {
            let (words, safety) = last_words(&end, state);
            (state, words, safety, next)
        }
        // Nothing of it was sent.
        Err(why) => (State::Accepted, Some(causes::line(&why)), None, Next::Stay(None)),
    };
    let (level, told) = match &words {
        None => (Level::Info, format!("{name}: printed to its end")),
        Some(words) => (Level::Warning, format!("{name}: {words}")),
    };
    board.message(now_unix_s(), level, told);
    board.change(|p| {
        p.link = Link::Connecting;
        (p.job, p.progress, p.words) = (None, None, None);
        (p.question, p.waits_for_user, p.plan) = (None, None, None);
    });
    (actor.tell)(Told::Over { job: id, state, words, safety });
    next
}

struct Done {
    end: End,
    state: State,
    next: Next,
}

async fn try_print(
    actor: &Actor,
    orders: &mut mpsc::Receiver<Order>,
    print: Print,
    connection: Connection,
    park: Duration,
) -> anyhow::Result<Done> {
    let profile = &actor.profile;
    let marks = Rc::new(RefCell::new(Marks::default()));
    let (post, mail) = mailbox();
    let measured = Rc::new(RefCell::new(Exposures::default()));
    if print.job.is_resin() && !first_in_line() {
        tracing::debug!("no real-time priority: a busy machine makes exposures that are timed here longer");
    }
    let watch = LightWatch::default();
    let on_port = print.job.is_resin().then(|| watch.on_port(profile));
    let display = display(actor, &post, &measured, watch)?.filter(|_| print.job.is_resin());
    let lines = print.job.lines(Rc::clone(&marks), display).context("the file cannot be read again")?;
    let mut held = print.held;
    held.journal.append(&Record::Opened {
        port: actor.board.picture().device.unwrap_or_else(|| connection.port.path().to_owned()),
        baud: connection.port.baud(),
        at_unix_s: now_unix_s(),
    });
    let scribe = Scribe::start(held, post.clone()).context("cannot start the journal's thread")?;
    let mut wants = settings::of(profile, actor.config.macros);
    wants.waits_for_person = true;
    if connection.awake {
        wants.session.boot_wait_ms = 0;
    }
    let started = Instant::now();
    let mut eye = Eye {
        actor,
        id: print.id,
        checked: print.job.checked,
        facts: print.job.facts,
        marks,
        first_line: None,
        shown: None,
        line: 0,
        z_mm: 0.0,
        resends: 0,
    };
    let mut host = Host::new(wants, lines, &print.begin, 0);
    let (identity, firmware) = (connection.identity.clone(), connection.firmware.clone());
    let wires = Wires {
        port: connection.port,
        hard_stop: profile.serial.hard_stop() == HardStop::Dtr,
        identity: connection.identity,
        scribe: Some(scribe),
        mail,
        watcher: &mut eye,
        on_port,
        started,
    };
    let mut leaves = false;
    let mut leave_at: Option<Instant> = None;
    let Ended { end, port } = {
        let mut running = pin!(run(&mut host, wires));
        loop {
            let far = Instant::now() + park;
            tokio::select! {
                end = &mut running => break end,
                () = sleep_until(leave_at.unwrap_or(far)), if leave_at.is_some() => {
                    let _ = post.try_send(Mail::Quit);
                    leave_at = None;
                }
                order = orders.recv() => match order {
                    Some(Order::Leave) | None => {
                        leaves = true;
                        // The head is parked, away from the part; what runs then is left to
                        // whoever takes it up, or to the guardian.
                        let _ = post.try_send(Mail::Ask(Request::Pause));
                        leave_at = Some(leaves_at(&actor.board, park));
                    }
                    Some(order) => obey(actor, &post, order),
                },
                () = parked(&actor.board), if leaves => {
                    let _ = post.try_send(Mail::Quit);
                    // The mail is read at once; this only keeps from writing it again and again.
                    let _ = timeout(Duration::from_millis(50), std::future::pending::<()>()).await;
                }
            }
        }
    };
    if let Some(words) = measured.borrow().words() {
        actor.board.message(now_unix_s(), Level::Info, words);
    }
    let in_order = matches!(
        end,
        End::Over(
            Outcome::Finished | Outcome::Stopped { ending: Ending::Cancelled, safety: Safety::Acknowledged }
        )
    );
    let kept = port.filter(|_| in_order);
    let kept = kept.map(|port| Box::new(Connection { port, identity, firmware, awake: true }));
    let next = if leaves { Next::Leave } else { Next::Stay(kept) };
    Ok(Done { end, state: host.state(), next })
}

/// Where the pictures of a resin job go.
fn display(
    actor: &Actor,
    post: &mpsc::Sender<Mail>,
    measured: &Rc<RefCell<Exposures>>,
    watch: LightWatch,
) -> anyhow::Result<Option<Display>> {
    let Some(msla) = actor.profile.msla() else { return Ok(None) };
    let sink = display::open(msla, None)?;
    let post = post.clone();
    Ok(Some(Display {
        sink,
        watch,
        // Whoever is gone wants no word.
        wake: Box::new(move || _ = post.blocking_send(Mail::Look)),
        speed: actor.speed,
        measured: Rc::clone(measured),
    }))
}

/// A job that does not move needs no parking.
fn leaves_at(board: &Board, park: Duration) -> Instant {
    let moves = matches!(board.picture().words, Some(words) if words == State::Printing.words());
    Instant::now() + if moves { park } else { Duration::ZERO }
}

/// Until the head is parked.
async fn parked(board: &Board) {
    loop {
        tokio::time::sleep(Duration::from_millis(100)).await;
        if board.picture().words == Some(State::Paused.words()) {
            return;
        }
    }
}

/// An order while a job runs.
fn obey(actor: &Actor, post: &mpsc::Sender<Mail>, order: Order) {
    match order {
        Order::Ask(request) => {
            if let Request::Command(command) = &request {
                actor.board.console(now_unix_s(), "us", command);
            }
            if post.try_send(Mail::Ask(request)).is_err() {
                let words = "too much is wanted at once: say it again";
                actor.board.message(now_unix_s(), Level::Warning, words);
            }
        }
        Order::Print(print) => (actor.tell)(Told::Over {
            job: print.id,
            state: State::Accepted,
            words: Some("another job has the printer".to_owned()),
            safety: None,
        }),
        Order::Connect | Order::Disconnect | Order::Leave => {}
    }
}

/// What a person should know of an end.
fn last_words(end: &End, state: State) -> (Option<String>, Option<Safety>) {
    match end {
        End::Over(Outcome::Finished) => (None, None),
        End::Over(Outcome::Stopped { ending, safety }) => {
            let why = match ending {
                Ending::Cancelled => "cancelled".to_owned(),
                Ending::EmergencyStop => "emergency stop".to_owned(),
                Ending::Failed(failure) => failure.to_string(),
            };
            (Some(format!("{why}; {}", news::after(*safety))), Some(*safety))
        }
        End::Left => (Some(format!("the job is {}", state.words())), None),
        End::Quit => (Some("left as it was; the printer keeps its state".to_owned()), None),
    }
}

/// Shows on the board what the host tells.
struct Eye<'a> {
    actor: &'a Actor,
    id: String,
    checked: Checked,
    facts: Facts,
    marks: Rc<RefCell<Marks>>,
    first_line: Option<Instant>,
    shown: Option<Instant>,
    line: u64,
    z_mm: f64,
    resends: u64,
}

impl Eye<'_> {
    fn say(&self, level: Level, words: impl Into<String>) {
        self.actor.board.message(now_unix_s(), level, words);
    }

    fn show(&mut self) {
        let now = Instant::now();
        if self.shown.is_some_and(|at| now.duration_since(at) < SHOW) {
            return;
        }
        self.shown = Some(now);
        let elapsed_s = self.first_line.map_or(0.0, |at| now.duration_since(at).as_secs_f64());
        let marks = self.marks.borrow();
        let left_s = pace::left_s(elapsed_s, self.line, &self.checked, self.facts, &marks, self.actor.speed);
        let progress = Progress {
            fraction: pace::fraction(self.line, &self.checked),
            line: self.line,
            lines: self.checked.last_command,
            layer: marks.layer,
            layers: self.facts.layers,
            z_mm: Some(self.z_mm),
            elapsed_s,
            left_s,
        };
        let resends = self.resends;
        self.actor.board.change(|p| {
            p.progress = Some(progress);
            p.resends = resends;
            p.lines_sent = progress.line;
        });
    }

    fn session(&mut self, event: &Event) {
        let (board, at) = (&self.actor.board, now_unix_s());
        match event {
            Event::Connected { firmware, .. } | Event::Rejoined { firmware } => {
                board.change(|p| p.firmware.clone_from(firmware));
            }
            // A board that drives a plate tells of heaters that it has not.
            Event::Temperatures(_) if self.actor.profile.msla().is_some() => {}
            Event::Temperatures(told) => board.heat(at, told),
            Event::Resend { .. } => self.resends += 1,
            Event::Probed { timeouts } if *timeouts > 1 => {
                self.say(
                    Level::Warning,
                    format!("no answer from the printer (timeout {timeouts}); asking again"),
                );
            }
            Event::ManyResends { resends, lines } => self.say(
                Level::Warning,
                format!(
                    "{resends} resends in {lines} lines; check the cable, its shielding and the baud rate"
                ),
            ),
            Event::Action(action) => self.say(Level::Info, news::action(action)),
            Event::Prompt(prompt) => {
                let asked = prompt.clone().map(|q| Question { text: q.text, choices: q.choices });
                board.change(|p| p.question = asked);
            }
            Event::Waiting(waiting) => {
                let words = waiting.map(|w| news::waiting(Some(w)).to_owned());
                board.change(|p| p.waits_for_user = words);
            }
            Event::Note(text) => board.console(at, "printer", text),
            Event::PrinterError(text) => board.console(at, "printer", text),
            Event::UnknownCommand(text) => board.console(at, "printer", &format!("unknown command: {text}")),
            Event::Skipped { job_line } => self.say(
                Level::Info,
                format!("line {job_line} of the file sets the line number (M110) and was left out"),
            ),
            Event::Stopping(ending) => {
                let words = match ending {
                    Ending::Cancelled => "cancelling: waiting for what the printer has".to_owned(),
                    Ending::EmergencyStop => "emergency stop".to_owned(),
                    Ending::Failed(why) => format!("stopping: {why}"),
                };
                self.say(Level::Warning, words);
            }
            Event::EmergencyStopped { by } => self.say(Level::Error, news::stopped(*by)),
            Event::LinkLost { reason } => self.say(Level::Warning, reason.clone()),
            Event::Arrived
            | Event::Probed { .. }
            | Event::Busy(_)
            | Event::Position(_)
            | Event::Held
            | Event::OwnDone
            | Event::Found(_)
            | Event::Ended(_) => {}
        }
    }
}

impl Watcher for Eye<'_> {
    fn event(&mut self, event: &HostEvent) {
        match event {
            HostEvent::State(state) => {
                let words = state.words();
                self.actor.board.change(|p| {
                    p.words = Some(words);
                    if *state != State::Interrupted {
                        p.plan = None;
                    }
                });
                (self.actor.tell)(Told::Job(self.id.clone(), *state));
            }
            HostEvent::Session(event) => self.session(event),
            HostEvent::Refused(why) => self.say(Level::Warning, format!("not done: {why}")),
            HostEvent::Told(words) => self.say(Level::Warning, words.clone()),
            HostEvent::Case(case) => self.say(Level::Info, cases::words(case)),
            HostEvent::Planned => {}
        }
    }

    fn planned(&mut self, plan: &Plan) {
        let words = cases::plan(plan);
        self.actor.board.change(|p| p.plan = Some(words));
    }

    fn acknowledged(&mut self, at: &Checkpoint) {
        if at.line == self.line {
            return;
        }
        (self.line, self.z_mm) = (at.line, at.z_mm);
        self.first_line.get_or_insert_with(Instant::now);
        self.marks.borrow_mut().reach(at.line);
        self.show();
    }
}
