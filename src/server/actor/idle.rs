//! A connection without a job: temperatures, a person's commands, and heaters or a light that were
//! forgotten.
//!
//! Takes an open port and orders; gives the port on to a job, or says why it is lost. The
//! protocol is [`Session`]'s: lines are numbered, and what was damaged is sent again.
use super::{Actor, Idle, Order, Told};
use crate::job::host::Request;
use crate::printer::find::Connection;
use crate::printer::lines::LineSplitter;
use crate::printer::port::Moved;
use crate::printer::reply::{self, Reply};
use crate::printer::session::{Ending, Event, Outcome, Session, Settings};
use crate::profile::printer::HardStop;
use crate::server::model::{Level, Link, Question};
use crate::station::{news, now_unix_s, settings};
use std::time::Duration;
use tokio::sync::mpsc;
use tokio::time::{Instant, sleep_until};

/// Longest sleep when the session has no deadline.
const IDLE: Duration = Duration::from_secs(30);

/// Bytes read at once.
const READ_BYTES: usize = 4096;

/// How long the last commands are waited for when the daemon ends.
const LAST_WORDS: Duration = Duration::from_millis(500);

/// What switches every heater off.
const HEATERS_OFF: [&str; 2] = ["M104 S0", "M140 S0"];

/// Stays with the printer until something else is wanted of the port.
pub(super) async fn idle(
    actor: &Actor,
    orders: &mut mpsc::Receiver<Order>,
    mut connection: Connection,
) -> Idle {
    let started = Instant::now();
    let mut quiet = Quiet::new(actor, &connection, started);
    let mut input = [0_u8; READ_BYTES];
    loop {
        quiet.tell();
        if quiet.session.is_over() {
            return Idle::Lost(quiet.ended.take().unwrap_or_else(|| "the printer is gone".to_owned()));
        }
        if quiet.session.wants_hard_stop() {
            let resets = actor.profile.serial.hard_stop() == HardStop::Dtr && connection.port.has_dtr();
            let done = resets && connection.port.reset_board().await.is_ok();
            quiet.session.hard_stopped(done, ms(started));
            continue;
        }
        if quiet.session.wants_flush() {
            let _ = connection.port.flush_output();
        }
        let deadline = quiet.session.deadline().map(|at_ms| started + Duration::from_millis(at_ms));
        let due = deadline.into_iter().chain(quiet.heaters_off_at()).min();
        tokio::select! {
            biased;
            order = orders.recv() => match order {
                Some(Order::Print(print)) if quiet.connected => {
                    return Idle::Print(print, Box::new(quiet.hand_over(connection)));
                }
                Some(Order::Print(print)) => (actor.tell)(Told::Over {
                    job: print.id.clone(),
                    state: crate::job::state::State::Accepted,
                    words: Some("the printer has not answered yet".to_owned()),
                    safety: None,
                }),
                Some(Order::Ask(request)) => quiet.ask(request, ms(started)),
                Some(Order::Connect) => {}
                Some(Order::Disconnect) => return Idle::Disconnect,
                Some(Order::Leave) | None => {
                    quiet.cool_down(ms(started));
                    drain(&mut quiet.session, &mut connection, started).await;
                    return Idle::Leave;
                }
            },
            moved = connection.port.exchange(&mut input, quiet.session.output()) => match moved {
                Ok(Moved::Wrote(len)) => quiet.session.written(len),
                Ok(Moved::Read(len)) => {
                    quiet.overhear(&input[..len]);
                    quiet.session.on_bytes(&input[..len], ms(started));
                }
                Err(e) => quiet.session.link_lost(e.to_string()),
            },
            () = sleep_until(due.unwrap_or_else(|| Instant::now() + IDLE)) => {}
        }
        if quiet.session.deadline().is_some_and(|at_ms| at_ms <= ms(started)) {
            quiet.session.on_tick(ms(started));
        }
        if quiet.heaters_off_at().is_some_and(|at| at <= Instant::now()) {
            quiet.forgotten(ms(started));
        }
    }
}

/// Writes what is still to be written, for a moment: nobody waits for a printer that hangs.
async fn drain(session: &mut Session, connection: &mut Connection, started: Instant) {
    let mut input = [0_u8; READ_BYTES];
    let end = Instant::now() + LAST_WORDS;
    // Commands go out as the window frees, so answers are read, too.
    while session.deadline().is_some() && Instant::now() < end {
        tokio::select! {
            moved = connection.port.exchange(&mut input, session.output()) => match moved {
                Ok(Moved::Wrote(len)) => session.written(len),
                Ok(Moved::Read(len)) => session.on_bytes(&input[..len], ms(started)),
                Err(_) => return,
            },
            () = sleep_until(end) => return,
        }
    }
}

fn ms(started: Instant) -> u64 {
    u64::try_from(started.elapsed().as_millis()).unwrap_or(u64::MAX)
}

struct Quiet<'a> {
    actor: &'a Actor,
    /// Where the session's clock begins.
    started: Instant,
    session: Session,
    /// For the console: the session keeps none of what it understands.
    lines: LineSplitter,
    connected: bool,
    firmware: Option<String>,
    /// Why it is over.
    ended: Option<String>,
    /// Since when a heater is on that nobody has touched.
    hot_since: Option<Instant>,
}

impl<'a> Quiet<'a> {
    fn new(actor: &'a Actor, connection: &Connection, started: Instant) -> Self {
        let of = settings::of(&actor.profile, false).session;
        let boot_wait_ms = if connection.awake { 0 } else { of.boot_wait_ms };
        let wire =
            Settings { asks: false, waits_for_link: false, cancel_macro: Vec::new(), boot_wait_ms, ..of };
        Self {
            actor,
            started,
            session: Session::new(wire, 0),
            lines: LineSplitter::default(),
            connected: false,
            firmware: None,
            ended: None,
            hot_since: None,
        }
    }

    /// The port for a job: the printer is awake.
    fn hand_over(&self, connection: Connection) -> Connection {
        Connection { awake: true, firmware: self.firmware.clone(), ..connection }
    }

    fn ask(&mut self, request: Request, now_ms: u64) {
        let board = &self.actor.board;
        match request {
            Request::Command(command) => {
                board.console(now_unix_s(), "us", &command);
                // Whoever gives commands is there: what is hot is not forgotten.
                self.hot_since = self.hot_since.map(|_| Instant::now());
                if !self.session.command(&command, now_ms) {
                    let words = "not sent: it is no command, does not fit a line, or sets the line number";
                    board.console(now_unix_s(), "note", words);
                }
            }
            Request::EmergencyStop => {
                board.message(now_unix_s(), Level::Warning, "emergency stop");
                self.session.emergency_stop(now_ms);
            }
            Request::Answer(choice) => {
                if self.session.answer(choice, now_ms) {
                    board.change(|p| p.question = None);
                }
            }
            Request::Pause | Request::Resume | Request::Confirm | Request::Cancel => {}
        }
    }

    /// What the printer says goes to the console as it is said, but for what comes all the time.
    fn overhear(&mut self, bytes: &[u8]) {
        let (board, connected) = (&self.actor.board, self.connected);
        self.lines.push(bytes, |line| {
            let usual = matches!(
                reply::parse(line),
                Reply::Ok(_) | Reply::Wait | Reply::Busy(_) | Reply::Temperatures(_)
            );
            if connected && !usual {
                board.console(now_unix_s(), "printer", &String::from_utf8_lossy(line));
            }
        });
    }

    /// Whatever was before us, the light is off from now on. It takes no part in what is asked for.
    fn darken(&mut self) {
        let now_ms = ms(self.started);
        for line in settings::light_off(&self.actor.profile) {
            self.session.command(&line, now_ms);
        }
    }

    /// Shows what the session tells.
    fn tell(&mut self) {
        let (board, at) = (&self.actor.board, now_unix_s());
        while let Some(event) = self.session.poll_event() {
            match event {
                Event::Connected { firmware, .. } => {
                    self.connected = true;
                    self.firmware.clone_from(&firmware);
                    board.change(|p| {
                        p.link = Link::Ready;
                        p.error = None;
                        p.words = None;
                        p.firmware = firmware;
                    });
                    self.darken();
                    (self.actor.tell)(Told::Ready);
                }
                // A board that drives a plate tells of heaters that it has not.
                Event::Temperatures(_) if self.actor.profile.msla().is_some() => {}
                Event::Temperatures(told) => {
                    board.heat(at, &told);
                    let hot = [told.hotend(), told.bed, told.chamber]
                        .into_iter()
                        .flatten()
                        .any(|h| h.target_c.is_some_and(|c| c > 0.0));
                    self.hot_since = hot.then(|| self.hot_since.unwrap_or_else(Instant::now));
                }
                Event::Prompt(prompt) => board.change(|p| {
                    p.question = prompt.map(|q| Question { text: q.text, choices: q.choices });
                }),
                Event::Waiting(waiting) => {
                    let words = waiting.map(|w| news::waiting(Some(w)).to_owned());
                    board.change(|p| p.waits_for_user = words);
                }
                Event::Action(action) => board.message(at, Level::Info, news::action(&action)),
                Event::EmergencyStopped { by } => board.message(at, Level::Error, news::stopped(by)),
                Event::LinkLost { reason } => self.ended = Some(reason),
                Event::Ended(Outcome::Stopped { ending: Ending::Failed(why), .. }) => {
                    self.ended = Some(why.to_string());
                }
                Event::Ended(_) => {
                    self.ended.get_or_insert_with(|| "the printer was stopped".to_owned());
                }
                Event::ManyResends { resends, lines } => board.message(
                    at,
                    Level::Warning,
                    format!(
                        "{resends} resends in {lines} lines; check the cable, its shielding and the baud rate"
                    ),
                ),
                // The console has every line that says something.
                Event::Note(_)
                | Event::PrinterError(_)
                | Event::UnknownCommand(_)
                | Event::Position(_)
                | Event::Busy(_)
                | Event::Arrived
                | Event::Resend { .. }
                | Event::Probed { .. }
                | Event::Held
                | Event::OwnDone
                | Event::Skipped { .. }
                | Event::Stopping(_)
                | Event::Found(_)
                | Event::Rejoined { .. } => {}
            }
        }
    }

    fn heaters_off_at(&self) -> Option<Instant> {
        let timeout = Duration::from_secs(self.actor.config.idle_heater_timeout_s);
        self.hot_since.map(|since| since + timeout)
    }

    /// Nobody has wanted anything of a hot printer for long.
    fn forgotten(&mut self, now_ms: u64) {
        let timeout_s = self.actor.config.idle_heater_timeout_s;
        let words = format!("heaters were on for {timeout_s} s without a job: they are switched off");
        self.actor.board.message(now_unix_s(), Level::Warning, words);
        self.cool_down(now_ms);
        // Asked again after as long, should the printer still tell a target.
        self.hot_since = Some(Instant::now());
    }

    fn cool_down(&mut self, now_ms: u64) {
        // A light that somebody switched on by hand.
        for line in settings::light_off(&self.actor.profile) {
            self.session.command(&line, now_ms);
        }
        if self.hot_since.is_some() {
            for command in HEATERS_OFF {
                self.session.command(command, now_ms);
            }
        }
    }
}
