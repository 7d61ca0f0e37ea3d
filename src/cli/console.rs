//! `outrigger console --port DEV`: a terminal to talk to a printer.
//!
//! On a terminal: a prompt with history, the printer's words above it. In a pipe:
//! lines in, answers out. With `--raw`: bytes both ways, unchanged.
mod boot;
mod keys;
mod prompt;
mod raw;
mod stdin;
mod talk;
#[cfg(test)]
mod tests;

use super::print::runtime;
use super::serial::{Baud, rate};
use crate::printer::find::{self, Connection, Places, Wanted};
use crate::printer::lines::MAX_REPLY_LEN;
use crate::printer::port::{Moved, OpenMode, Port, PortError};
use crate::printer::session::DEFAULT_BOOT_WAIT_MS;
use crate::profile::load_printer;
use crate::station::escape::{printable, printable_to};
use anyhow::{anyhow, bail};
use std::io::{IsTerminal, Write};
use std::process::ExitCode;
use std::time::Duration;
use talk::{Manner, Shown, Talk, Wish};
use tokio::sync::mpsc::Receiver;
use tokio::time::{Instant, sleep_until};

/// Bytes read at once.
const READ_BYTES: usize = 4096;

/// Lines of a pipe that are read ahead of the printer.
const PIPE_AHEAD: usize = 16;

/// What was typed last goes out within it when the user ends.
const LAST_WORDS: Duration = Duration::from_secs(1);

/// Longest sleep when nothing is due; any value would do.
const IDLE: Duration = Duration::from_secs(60);

/// Talk to a printer by hand.
///
/// Commands are sent one after the other, without line numbers, each when the
/// printer has said ok. M112 (or /stop) is sent at once, ahead of everything that
/// waits; so are M108 and M410. /help lists the other words. Without a terminal,
/// lines are read from standard input and answers are written to standard output.
///
/// Opening the port resets many boards, once: when the console ends, DTR stays up
/// and the printer goes on with what it has. A port that a running job holds is
/// not opened.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The printer's serial port: a path, usb:SERIAL (see `outrigger ports`), or
    /// auto for the only printer that answers.
    #[arg(long, value_name = "DEV")]
    port: String,
    /// Bits per second, or auto to find them; the profile's if not given.
    #[arg(long, value_name = "N|auto")]
    baud: Option<Baud>,
    /// The printer's profile: a name from `outrigger profile list`, or a file.
    #[arg(long, value_name = "NAME", default_value = "generic-marlin")]
    profile: String,
    /// Pass bytes both ways unchanged between the port and the standard streams.
    #[arg(long)]
    raw: bool,
    /// In a pipe: end so long after the end of the input and the last answer, in
    /// seconds.
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = seconds)]
    wait: f64,
    /// In a pipe: give up when a command has no answer for so long, in seconds.
    #[arg(long, value_name = "S", default_value_t = 60.0, value_parser = seconds)]
    timeout: f64,
    /// Show temperatures and waits that come by themselves.
    #[arg(long, short)]
    verbose: bool,
}

/// A day is long enough for any command.
fn seconds(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(s) if (0.0..=86_400.0).contains(&s) => Ok(s),
        _ => Err("seconds, from 0 to 86400".to_owned()),
    }
}

/// What the user does.
#[derive(Debug)]
enum Typed {
    Line(String),
    Interrupt,
    End,
    Wrong(String),
}

/// Where things are shown. An error ends the console: nobody looks any more.
trait Screen {
    fn show(&mut self, shown: &Shown) -> std::io::Result<()>;
}

/// Runs the verb. See [`Args`].
///
/// # Errors
/// No port, no answer, or the firmware gave up in the middle of a script.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let profile = load_printer(&args.profile)?;
    let resets = profile.serial.dtr_reset;
    let boot_ms = if resets { DEFAULT_BOOT_WAIT_MS } else { 0 };
    let max_line = profile.serial.max_line.and_then(|max| usize::try_from(max).ok());
    runtime()?.block_on(async {
        let escaped = |e: find::FindError| anyhow!(printable_to(&e.to_string(), MAX_REPLY_LEN));
        let wanted: Wanted = args.port.parse().map_err(escaped)?;
        let (rate, places) = (rate(args.baud, profile.serial.baud), Places::default());
        let found =
            find::connect(&wanted, rate, OpenMode::TakeOver, boot_ms, &places).await.map_err(escaped)?;
        let still_ms = if found.awake { 0 } else { boot_ms };
        let wait = Duration::from_secs_f64(args.wait);
        if args.raw {
            return raw::pump(found.port, still_ms, wait).await;
        }
        let manner = Manner { verbose: args.verbose, max_line, boot_ms: still_ms };
        let console = Console::new(found, manner, boot_ms, places);
        if std::io::stdin().is_terminal() && std::io::stdout().is_terminal() {
            let (mut screen, typed) = prompt::start()?;
            let about = format!("{} at {} baud; /help says more", console.port.path(), console.port.baud());
            screen.show(&Shown::Note(about))?;
            return console.prompted(typed, &mut screen).await;
        }
        let timeout = Duration::from_secs_f64(args.timeout);
        console.piped(stdin::lines(), &mut Plain, wait, timeout).await
    })
}

/// A printer that is talked to.
struct Console {
    port: Port,
    talk: Talk,
    started: Instant,
    boot_ms: u64,
    identity: find::Identity,
    places: Places,
    input: [u8; READ_BYTES],
}

/// Why a turn ended the conversation.
enum Over {
    Quit,
    Gone(PortError),
    /// Nobody looks at the screen.
    Unseen,
}

impl Console {
    fn new(found: Connection, manner: Manner, boot_ms: u64, places: Places) -> Self {
        let Connection { port, identity, .. } = found;
        let started = Instant::now();
        Self { port, talk: Talk::new(manner, 0), started, boot_ms, identity, places, input: [0; READ_BYTES] }
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    /// The conversation of a person; a port that vanishes is waited for.
    async fn prompted(
        mut self,
        mut typed: Receiver<Typed>,
        screen: &mut impl Screen,
    ) -> anyhow::Result<ExitCode> {
        loop {
            let over = match self.attend(screen).await {
                Ok(()) => self.turn(&mut typed, true, None).await,
                Err(over) => Err(over),
            };
            match over {
                Ok(()) => {}
                Err(Over::Quit | Over::Unseen) => {
                    self.last_words().await;
                    return Ok(ExitCode::SUCCESS);
                }
                Err(Over::Gone(error)) => {
                    let words = format!("{error}; waiting for {}", self.identity.words());
                    screen.show(&Shown::Note(words))?;
                    if !self.find_again(&mut typed, screen).await? {
                        return Ok(ExitCode::SUCCESS);
                    }
                }
            }
        }
    }

    /// The conversation of a script: every line is answered, or it failed.
    async fn piped(
        mut self,
        mut typed: Receiver<Typed>,
        screen: &mut impl Screen,
        wait: Duration,
        timeout: Duration,
    ) -> anyhow::Result<ExitCode> {
        let (mut ended, mut idle_since) = (false, None);
        loop {
            let mut over = self.attend(screen).await;
            if let Some(trouble) = self.talk.trouble() {
                bail!("{trouble}; the rest was not sent");
            }
            let timeout_ms = u64::try_from(timeout.as_millis()).unwrap_or(u64::MAX);
            let mut due = None;
            if let Some((command, heard_ms)) = self.talk.owed() {
                if self.now_ms() >= heard_ms.saturating_add(timeout_ms) {
                    let command = printable(&String::from_utf8_lossy(command));
                    bail!("no answer to {command} for {} s; the rest was not sent", timeout.as_secs_f64());
                }
                due = Some(self.started + Duration::from_millis(heard_ms.saturating_add(timeout_ms)));
            }
            if ended && self.talk.idle() {
                let end = *idle_since.get_or_insert_with(Instant::now) + wait;
                if Instant::now() >= end {
                    return Ok(ExitCode::SUCCESS);
                }
                due = Some(end);
            }
            if over.is_ok() {
                let accepts = !ended && self.talk.backlog() < PIPE_AHEAD;
                over = self.turn(&mut typed, accepts, due).await;
            }
            match over {
                Ok(()) => {}
                Err(Over::Quit) if self.talk.idle() => return Ok(ExitCode::SUCCESS),
                Err(Over::Quit) => ended = true,
                Err(Over::Unseen) => return Ok(ExitCode::SUCCESS),
                Err(Over::Gone(error)) => return Err(error.into()),
            }
        }
    }

    /// Shows what is to be shown and does to the port what is wished.
    async fn attend(&mut self, screen: &mut impl Screen) -> Result<(), Over> {
        loop {
            while let Some(shown) = self.talk.poll_shown() {
                screen.show(&shown).map_err(|_| Over::Unseen)?;
            }
            match self.talk.poll_wish() {
                None => return Ok(()),
                Some(Wish::Quit) => return Err(Over::Quit),
                Some(Wish::Flush) => self.port.flush_output().map_err(Over::Gone)?,
                Some(Wish::Reset) => {
                    self.port.reset_board().await.map_err(Over::Gone)?;
                    let now_ms = self.now_ms();
                    self.talk.was_reset(self.boot_ms, now_ms);
                }
            }
        }
    }

    /// Whatever happens next.
    async fn turn(
        &mut self,
        typed: &mut Receiver<Typed>,
        accepts: bool,
        due: Option<Instant>,
    ) -> Result<(), Over> {
        let talks = self.talk.deadline().map(|at_ms| self.started + Duration::from_millis(at_ms));
        let wake = [talks, due].into_iter().flatten().min().unwrap_or_else(|| Instant::now() + IDLE);
        tokio::select! {
            biased;
            typed = typed.recv(), if accepts => {
                let now_ms = self.now_ms();
                match typed {
                    Some(Typed::Line(line)) => self.talk.type_line(&line, now_ms),
                    Some(Typed::Interrupt) => self.talk.interrupt(),
                    Some(Typed::Wrong(why)) => self.talk.note(&why),
                    Some(Typed::End) | None => return Err(Over::Quit),
                }
            }
            moved = self.port.exchange(&mut self.input, self.talk.output()) => {
                match moved.map_err(Over::Gone)? {
                    Moved::Wrote(len) => self.talk.written(len),
                    Moved::Read(len) => {
                        let now_ms = self.now_ms();
                        self.talk.on_bytes(&self.input[..len], now_ms);
                    }
                }
            }
            () = sleep_until(wake) => {}
        }
        let now_ms = self.now_ms();
        self.talk.on_tick(now_ms);
        Ok(())
    }

    /// What was typed last still goes out: it may be a stop.
    async fn last_words(&mut self) {
        let rest = async {
            while !self.talk.output().is_empty() {
                match self.port.exchange(&mut self.input, self.talk.output()).await {
                    Ok(Moved::Wrote(len)) => self.talk.written(len),
                    Ok(Moved::Read(_)) => {}
                    Err(_) => return,
                }
            }
        };
        let _ = tokio::time::timeout(LAST_WORDS, rest).await;
    }

    /// Waits for the port, for ever; false if the user ends.
    async fn find_again(
        &mut self,
        typed: &mut Receiver<Typed>,
        screen: &mut impl Screen,
    ) -> anyhow::Result<bool> {
        // Held open, the old name would be kept from the device that comes back.
        self.port.close();
        loop {
            tokio::select! {
                biased;
                typed = typed.recv() => match typed {
                    Some(Typed::End) | None => return Ok(false),
                    Some(Typed::Line(line)) if matches!(line.trim(), "/quit" | "/exit") => return Ok(false),
                    _ => screen.show(&Shown::Note("there is no printer; /quit ends".to_owned()))?,
                },
                port = find::reopen(&self.identity, self.port.baud(), &self.places) => {
                    self.port = port?;
                    let now_ms = self.now_ms();
                    self.talk.was_reset(self.boot_ms, now_ms);
                    screen.show(&Shown::Note(format!("{} is back", self.port.path())))?;
                    return Ok(true);
                }
            }
        }
    }
}

/// Answers on standard output, our own words on standard error.
struct Plain;

impl Screen for Plain {
    fn show(&mut self, shown: &Shown) -> std::io::Result<()> {
        match shown {
            Shown::Said(text) | Shown::Aside(text) => {
                let mut out = std::io::stdout();
                writeln!(out, "{}", printable_to(text, MAX_REPLY_LEN))?;
                out.flush()
            }
            Shown::Note(text) => {
                for line in text.lines() {
                    eprintln!("outrigger: {}", printable_to(line, MAX_REPLY_LEN));
                }
                Ok(())
            }
        }
    }
}
