//! The loop that carries bytes between the program's pseudo-terminal and the printer.
//!
//! Takes a scenario and a [`Target`]; gives a [`Report`] of what was seen, as the virtual world
//! does. Judges nothing. The same [`Link`] damages, loses and holds as there, on the real clock;
//! what happens to board, program and plug is in `happen`.
use super::account::Account;
use super::program::{Installed, Program};
use super::target::Target;
use super::tty::{self, Pty};
use super::watchdog::Leash;
use super::{Rig, profile};
use crate::dice::Dice;
use crate::scenario::Scenario;
use crate::world::events::Events;
use crate::world::link::Link;
use crate::world::source::Commands;
use crate::world::wire::Chances;
use anyhow::Context;
use outrigger::job::state::State;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::collections::VecDeque;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Bytes carried at a time: a terminal's own buffer.
const READ_BYTES: usize = 4096;

/// Bytes for a side that reads none: what is more is lost, as on a wire.
const UNREAD_BYTES_MAX: usize = 64 * 1024;

/// Longest sleep: processes that end and journals that change wake nobody.
const LOOK_NS: u64 = 20_000_000;

/// The same where something waits for a state of the job, or a side is full.
const LOOK_CLOSELY_NS: u64 = 4_000_000;

/// Lines of the transcript that are kept: the tail that explains a failure.
const TRANSCRIPT_LINES: usize = 2_000;

/// The runner gives up that much of the allowed time before the watchdog acts.
const OF_TIME: f64 = 0.9;

/// What one scenario is played with.
#[derive(Debug, Clone)]
pub struct Setup<'a> {
    /// The scenario, sweeps unrolled.
    pub scenario: &'a Scenario,
    /// The rig.
    pub rig: &'a Rig,
    /// Its file, for the watchdog; none for the mock's.
    pub rig_file: Option<&'a Path>,
    /// The program under test.
    pub installed: &'a Installed,
    /// This binary, for the watchdog.
    pub hil: &'a Path,
    /// The repository.
    pub root: &'a Path,
}

/// All that is at work.
#[derive(Debug)]
pub struct Stage<'a> {
    pub(super) setup: Setup<'a>,
    pub(super) target: Target,
    pub(super) commands: Commands,
    pub(super) job: PathBuf,
    pub(super) profile: PathBuf,
    pub(super) port: PathBuf,
    pub(super) baud: u32,
    started: Instant,
    limit_ns: u64,
    dice: Dice,
    pub(super) link: Link,
    pub(super) events: Events,
    pub(super) account: Account,
    pub(super) program: Program,
    pub(super) pty: Option<Pty>,
    pub(super) device: Option<OwnedFd>,
    pub(super) leash: Option<Leash>,
    /// When the program first opened its port; times of the scenario count from there.
    pub(super) opened_ns: Option<u64>,
    /// For the printer, for the program: what a full terminal did not take yet.
    to_printer: Vec<u8>,
    to_program: Vec<u8>,
    pub(super) state: State,
    pub(super) restarts_ns: Option<u64>,
    pub(super) power_back_ns: Option<u64>,
    pub(super) ended_ns: u64,
    pub(super) confirmed_ns: Vec<u64>,
    pub(super) cold_ns: Option<u64>,
    pub(super) over: bool,
    pub(super) transcript: VecDeque<String>,
}

impl<'a> Stage<'a> {
    /// Everything is ready, the program is not started. `folder` is for its files alone.
    ///
    /// # Errors
    /// A file cannot be read or written, or the printer's port cannot be opened.
    pub fn new(setup: Setup<'a>, target: Target, folder: &Path) -> anyhow::Result<Self> {
        let (scenario, rig, sort) = (setup.scenario, setup.rig, target.sort());
        let text = scenario.job.text(setup.root)?.text;
        let text = if rig.lift_mm > 0.0 { profile::lifted(&text, rig.lift_mm) } else { text };
        let (job, changed) = (folder.join("job.gcode"), folder.join("profile.toml"));
        std::fs::write(&job, &text)?;
        let given = profile::file(scenario, sort, rig, setup.root);
        let given = std::fs::read_to_string(&given).with_context(|| given.display().to_string())?;
        std::fs::write(&changed, profile::adapted(&given, scenario.printer.window_lines)?)?;
        let baud = outrigger::profile::load_printer(&changed.display().to_string())?.serial.baud;
        let device = target.device().to_owned();
        let fd = tty::open_device(&device, baud).with_context(|| device.display().to_string())?;
        tty::lock(&fd).with_context(|| format!("{} is taken", device.display()))?;
        // Nothing is hot before the first line of the job, and nobody beats while a board starts.
        target.prepare(&fd, baud, rig)?;
        let leash = Leash::start(setup.hil, &device, baud, setup.rig_file)?;
        let port = folder.join("port");
        let noise = scenario.noise;
        let chances = |corrupt, lose| Chances {
            corrupt,
            lose,
            split: noise.split,
            delay_ns: noise.delay_ms * 1_000_000,
        };
        let commands = Commands::of(&text);
        Ok(Self {
            pty: Some(Pty::under(&port)?),
            job,
            profile: changed,
            port,
            baud,
            started: Instant::now(),
            limit_ns: (rig.limits.scenario_s * OF_TIME * 1e9) as u64,
            dice: Dice::new(noise.seed),
            link: Link::new(
                chances(noise.corrupt_line, noise.lose_line),
                chances(noise.corrupt_reply, noise.lose_reply),
            ),
            events: Events::new(&super::happen::faster(&scenario.fault, target.speed())),
            account: Account::new(commands.clone()),
            program: Program::new(setup.installed.clone(), folder.join("state")),
            commands,
            device: Some(fd),
            leash: Some(leash),
            opened_ns: None,
            to_printer: Vec::new(),
            to_program: Vec::new(),
            state: State::Accepted,
            restarts_ns: None,
            power_back_ns: None,
            ended_ns: 0,
            confirmed_ns: Vec::new(),
            cold_ns: None,
            over: false,
            transcript: VecDeque::new(),
            setup,
            target,
        })
    }

    /// Plays the scenario to its end, or until its time is over.
    ///
    /// # Errors
    /// The rig's own means fail, or its watchdog is gone.
    pub fn play(&mut self) -> anyhow::Result<()> {
        self.print()?;
        while self.now_ns() < self.limit_ns {
            self.step()?;
            if self.is_over() {
                self.over = true;
                return Ok(());
            }
            self.sleep()?;
        }
        Ok(())
    }

    /// ns since the program was started.
    pub(super) fn now_ns(&self) -> u64 {
        u64::try_from(self.started.elapsed().as_nanos()).unwrap_or(u64::MAX)
    }

    fn step(&mut self) -> anyhow::Result<()> {
        let heat = self.account.heat();
        if let Some(leash) = &mut self.leash {
            leash.beat(heat).context("the watchdog is gone")?;
        }
        self.look_at_plug()?;
        self.happen_due()?;
        self.hear_program()?;
        self.tell_printer()?;
        self.hear_printer();
        self.tell_program();
        self.look_at_job()?;
        self.look_at_process()?;
        Ok(())
    }

    /// Lines of the program go on their way, unless the port takes nothing.
    fn hear_program(&mut self) -> anyhow::Result<()> {
        let mut buffer = [0; READ_BYTES];
        if self.link.blocked_until_ns > self.now_ns() {
            return Ok(());
        }
        let read = self.pty.as_ref().map_or(Ok(0), |pty| tty::read(&pty.master, &mut buffer))?;
        let mut bytes = &buffer[..read];
        while let Some(line) = self.link.out.take(&mut bytes) {
            self.write_down('>', &line);
            let now_ns = self.now_ns();
            let command = self.account.wrote(&line, now_ns);
            for fault in self.events.line(&line, command, self.story_ns()) {
                self.happen(fault, super::account::number(&line))?;
            }
            if self.pty.is_none() {
                return Ok(());
            }
            self.link.send(line, self.now_ns(), &mut self.dice);
        }
        Ok(())
    }

    fn tell_printer(&mut self) -> anyhow::Result<()> {
        let now_ns = self.now_ns();
        while let Some(bytes) = self.link.out.arrived(now_ns, READ_BYTES) {
            if self.to_printer.len() < UNREAD_BYTES_MAX {
                self.to_printer.extend_from_slice(&bytes);
            }
        }
        if self.to_printer.is_empty() {
            return Ok(());
        }
        match self.device.as_ref().map(|fd| tty::write(fd, &self.to_printer)) {
            Some(Ok(written)) => {
                self.account.reached(&self.to_printer[..written], now_ns);
                self.to_printer.drain(..written);
            }
            Some(Err(_)) => self.device_goes(),
            None => self.to_printer.clear(),
        }
        Ok(())
    }

    fn hear_printer(&mut self) {
        let mut buffer = [0; READ_BYTES];
        let read = match self.device.as_ref().map(|fd| tty::read(fd, &mut buffer)) {
            Some(Ok(read)) => read,
            Some(Err(_)) => return self.device_goes(),
            None => 0,
        };
        if read == 0 {
            return;
        }
        let (now_ns, mut said) = (self.now_ns(), Vec::new());
        self.link.reply(&buffer[..read], now_ns, &mut self.dice, |line| said.push(line.to_vec()));
        for line in said {
            self.account.said(&line, now_ns);
            self.write_down('<', &line);
        }
        if self.pty.is_none() || !self.program.runs() {
            // A terminal forgets what nobody reads.
            self.link.back.cut();
        }
    }

    fn tell_program(&mut self) {
        let now_ns = self.now_ns();
        while let Some(bytes) = self.link.back.arrived(now_ns, READ_BYTES) {
            if self.to_program.len() < UNREAD_BYTES_MAX {
                self.to_program.extend_from_slice(&bytes);
            }
        }
        match self.pty.as_ref().map(|pty| tty::write(&pty.master, &self.to_program)) {
            Some(Ok(written)) => drop(self.to_program.drain(..written)),
            _ => self.to_program.clear(),
        }
    }

    /// Until bytes come or something is due.
    fn sleep(&self) -> anyhow::Result<()> {
        let now_ns = self.now_ns();
        let full = !self.to_printer.is_empty() || !self.to_program.is_empty();
        let closely = full || self.setup.scenario.fault.iter().any(|f| f.at_state.is_some());
        let look_ns = now_ns + if closely { LOOK_CLOSELY_NS } else { LOOK_NS };
        let due = [self.due_ns(), self.link.out.next_ns(), self.link.back.next_ns(), self.restarts_ns];
        let until_ns = due.into_iter().flatten().fold(look_ns, u64::min);
        let left = Duration::from_nanos(until_ns.saturating_sub(now_ns));
        let timeout = Timespec { tv_sec: 0, tv_nsec: left.subsec_nanos().into() };
        let mut fds = Vec::with_capacity(3);
        if let Some(pty) = &self.pty {
            fds.push(PollFd::new(&pty.watch, PollFlags::IN));
            if self.link.blocked_until_ns <= now_ns {
                fds.push(PollFd::new(&pty.master, PollFlags::IN));
            }
        }
        if let Some(device) = &self.device {
            fds.push(PollFd::new(device, PollFlags::IN));
        }
        match poll(&mut fds, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(e) => Err(e.into()),
        }
    }

    fn write_down(&mut self, mark: char, line: &[u8]) {
        let text = String::from_utf8_lossy(line).trim_end().escape_debug().to_string();
        self.note(format!("{mark} {text}"));
    }

    pub(super) fn note(&mut self, text: String) {
        if self.transcript.len() == TRANSCRIPT_LINES {
            self.transcript.pop_front();
        }
        self.transcript.push_back(format!("{:9.3} {text}", self.now_ns() as f64 / 1e9));
    }
}
