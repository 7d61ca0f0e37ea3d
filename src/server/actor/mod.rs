//! One printer: a thread with its port, and what others may want of it.
//!
//! Takes [`Order`]s; shows what happens on its [`Board`] and tells the foreman what changes a
//! job's life ([`Told`]). Each printer has a thread and an event loop of its own: a printer that
//! hangs, floods or breaks down disturbs neither another one nor the network's side, and those do
//! not disturb it. Knows no queue, no file's checks and no network.
//!
//! - [`idle`]: a connection without a job: temperatures, commands, heaters that were forgotten
//! - [`printing`]: a job on it
//! - [`board`]: what it shows
pub(crate) mod board;
mod idle;
mod printing;

use crate::causes;
use crate::job::disk::{HeldJob, JobId};
use crate::job::host::{Begin, Request};
use crate::job::state::State;
use crate::printer::find::{Connection, FindError, Places, Rate, Wanted, connect};
use crate::printer::port::OpenMode;
use crate::printer::session::Safety;
use crate::profile::Profile;
use crate::server::config;
use crate::server::model::{Level, Link};
use crate::station::{Job, lasting_port, now_unix_s, settings};
use board::Board;
use std::sync::Arc;
use std::time::Duration;
use tokio::sync::mpsc;

/// Orders that may wait; a person gives fewer.
const MAX_ORDERS: usize = 256;

/// Between two tries of a port that is not there: soon enough for somebody who has just switched
/// the printer on, and no load.
const RETRY: [Duration; 4] =
    [Duration::from_secs(1), Duration::from_secs(2), Duration::from_secs(4), Duration::from_secs(8)];

/// What is wanted of a printer.
pub(crate) enum Order {
    /// A job is to be printed, or taken up.
    Print(Box<Print>),
    /// A person wants something of the running job; an emergency stop works without a job, too.
    Ask(Request),
    /// Open the port and keep it.
    Connect,
    /// Let the port go.
    Disconnect,
    /// The daemon ends: a running job is parked and left to whoever takes it up.
    Leave,
}

/// A job for the printer.
pub(crate) struct Print {
    /// The daemon's name of the job.
    pub(crate) id: String,
    /// What people know it by.
    pub(crate) name: String,
    /// Its file, checked.
    pub(crate) job: Job,
    /// Its journal, held.
    pub(crate) held: HeldJob,
    /// How it begins.
    pub(crate) begin: Begin,
}

/// What changes a job's life.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Told {
    /// The printer can take a job.
    Ready,
    /// It cannot any more.
    Away,
    /// The actor has ended; nothing follows.
    Gone,
    /// A job is in another state.
    Job(String, State),
    /// A job is over, or was left as its state says: what to tell of it.
    Over {
        /// The job.
        job: String,
        /// Its last state.
        state: State,
        /// What a person should know; `None`: it went well.
        words: Option<String>,
        /// What became of the heaters, where it ended early.
        safety: Option<Safety>,
    },
}

/// What an actor needs.
pub(crate) struct Actor {
    /// The printer's short name.
    pub(crate) id: String,
    /// Its place in the configuration.
    pub(crate) config: config::Printer,
    /// Its profile.
    pub(crate) profile: Profile,
    /// What it shows.
    pub(crate) board: Arc<Board>,
    /// Who hears what changes a job's life.
    pub(crate) tell: Box<dyn Fn(Told) + Send>,
    /// Who hears that it has ended, whatever ended it.
    pub(crate) gone: Option<Box<dyn FnOnce(Told) + Send>>,
    /// How many times faster than life the printer is: 1 but for a mock.
    pub(crate) speed: f64,
}

/// Who gives orders to an actor.
#[derive(Clone)]
pub(crate) struct Handle {
    /// Where orders go.
    orders: mpsc::Sender<Order>,
    /// What it shows.
    pub(crate) board: Arc<Board>,
}

impl Handle {
    /// A handle whose orders somebody else takes.
    #[cfg(test)]
    pub(crate) fn fake() -> (Self, mpsc::Receiver<Order>) {
        let (orders, taken) = mpsc::channel(MAX_ORDERS);
        (Self { orders, board: Arc::new(Board::default()) }, taken)
    }

    /// Gives an order; `false`: it cannot be taken now (too many wait, or the actor is gone).
    pub(crate) fn give(&self, order: Order) -> bool {
        self.orders.try_send(order).is_ok()
    }
}

/// Starts a printer's thread. `first`: a job that it is to take up before anything is said to the
/// printer, whose count of lines must not be lost.
///
/// # Errors
/// The system has no thread left.
pub(crate) fn start(
    mut actor: Actor,
    first: Option<Box<Print>>,
) -> std::io::Result<(Handle, std::thread::JoinHandle<()>)> {
    let (post, orders) = mpsc::channel(MAX_ORDERS);
    let board = Arc::clone(&actor.board);
    let handle = Handle { orders: post, board: Arc::clone(&board) };
    let thread = std::thread::Builder::new().name(format!("printer {}", actor.id)).spawn(move || {
        let id = actor.id.clone();
        let gone = actor.gone.take();
        let ran = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| run(actor, orders, first)));
        if let Some(gone) = gone {
            gone(Told::Gone);
        }
        let why = match ran {
            Ok(Ok(())) => return,
            Ok(Err(error)) => causes::line(&error),
            Err(_) => "a fault of ours; the log says where".to_owned(),
        };
        tracing::error!(printer = id, "{why}");
        board.change(|p| {
            p.link = Link::Failed;
            p.error =
                Some(format!("this printer's part of the daemon broke down: {why}; restart the daemon"));
        });
    })?;
    Ok((handle, thread))
}

fn run(actor: Actor, orders: mpsc::Receiver<Order>, first: Option<Box<Print>>) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(Life { actor, orders }.live(first));
    Ok(())
}

/// What ends a connection without a job.
enum Idle {
    /// A job has come; the port is handed over.
    Print(Box<Print>, Box<Connection>),
    /// The port or the printer is lost, and why.
    Lost(String),
    /// A person wants it closed.
    Disconnect,
    /// The daemon ends.
    Leave,
}

struct Life {
    actor: Actor,
    orders: mpsc::Receiver<Order>,
}

impl Life {
    async fn live(mut self, mut first: Option<Box<Print>>) {
        let mut away = false;
        let mut tries = 0;
        // What a job has left.
        let mut kept: Option<Box<Connection>> = None;
        loop {
            if away && first.is_none() {
                // By a person's wish nobody has the port.
                self.show(Link::Offline, None);
                match self.orders.recv().await {
                    Some(Order::Connect) => away = false,
                    Some(Order::Leave) | None => return,
                    Some(Order::Print(print)) => self.not_now(&print, "the printer is not connected"),
                    Some(_) => {}
                }
                continue;
            }
            if self.actor.board.picture().link != Link::Connecting {
                self.show(Link::Connecting, None);
            }
            let opened = match kept.take() {
                Some(connection) => Ok(*connection),
                None => self.open().await,
            };
            let connection = match opened {
                Ok(connection) => connection,
                Err(why) => {
                    let words = why.to_string();
                    self.actor.board.change(|p| p.error = Some(words));
                    let pause = RETRY[tries.min(RETRY.len() - 1)];
                    tries += 1;
                    match self.wait(pause, first.as_deref()).await {
                        Waited::On => {}
                        Waited::Away => away = true,
                        Waited::Leave => return,
                    }
                    continue;
                }
            };
            tries = 0;
            let (print, connection) = match first.take() {
                Some(print) => (print, connection),
                None => match idle::idle(&self.actor, &mut self.orders, connection).await {
                    Idle::Print(print, connection) => (print, *connection),
                    Idle::Lost(why) => {
                        (self.actor.tell)(Told::Away);
                        self.actor.board.message(now_unix_s(), Level::Warning, why.clone());
                        self.show(Link::Connecting, Some(why));
                        // What is broken at once shall not be tried without pause.
                        if matches!(self.wait(RETRY[1], None).await, Waited::Leave) {
                            return;
                        }
                        continue;
                    }
                    Idle::Disconnect => {
                        (self.actor.tell)(Told::Away);
                        away = true;
                        continue;
                    }
                    Idle::Leave => return,
                },
            };
            match printing::print(&self.actor, &mut self.orders, *print, connection).await {
                printing::Next::Stay(connection) => kept = connection,
                printing::Next::Leave => return,
            }
        }
    }

    /// Opens the port as it is: nothing is reset on purpose, for somebody else's print may run.
    async fn open(&self) -> Result<Connection, FindError> {
        let Actor { config, profile, board, .. } = &self.actor;
        let wanted: Wanted = config.port.parse()?;
        let rate = Rate::Given(config.baud.unwrap_or(profile.serial.baud));
        let rate = if wanted == Wanted::Auto { Rate::Auto { first: rate.first() } } else { rate };
        let boot_ms = settings::boot_wait_ms(profile);
        let connection = connect(&wanted, rate, OpenMode::TakeOver, boot_ms, &Places::default()).await?;
        let device = lasting_port(&wanted, connection.port.path());
        board.change(|p| p.device = Some(device));
        Ok(connection)
    }

    /// Waits, and hears what is wanted meanwhile.
    async fn wait(&mut self, pause: Duration, first: Option<&Print>) -> Waited {
        let end = tokio::time::Instant::now() + pause;
        loop {
            let order = tokio::select! {
                order = self.orders.recv() => order,
                () = tokio::time::sleep_until(end) => return Waited::On,
            };
            match order {
                Some(Order::Connect) => return Waited::On,
                Some(Order::Disconnect) if first.is_none() => return Waited::Away,
                Some(Order::Leave) | None => return Waited::Leave,
                Some(Order::Print(print)) => self.not_now(&print, "the printer's port is not there"),
                Some(_) => {}
            }
        }
    }

    /// A job that came too late: it stays accepted, and nothing of it was sent.
    fn not_now(&self, print: &Print, why: &str) {
        (self.actor.tell)(Told::Over {
            job: print.id.clone(),
            state: State::Accepted,
            words: Some(why.to_owned()),
            safety: None,
        });
    }

    fn show(&self, link: Link, error: Option<String>) {
        self.actor.board.change(|p| {
            p.link = link;
            p.error = error;
            p.words = None;
            p.heat = crate::server::model::Heat::default();
            if link != Link::Busy {
                p.job = None;
                p.progress = None;
            }
        });
    }
}

enum Waited {
    On,
    Away,
    Leave,
}

/// The number of a job's journal.
pub(crate) fn record(print: &Print) -> JobId {
    print.held.id
}
