//! What happens on the stage: to the plug, the board, the program and the job.
use super::stage::Stage;
use super::tty::{self, Pty};
use crate::scenario::{Fault, Kind, Place};
use crate::world::link::ns;
use anyhow::Context;
use outrigger::job::state::State;
use std::ffi::OsString;

/// Between two tries to open a printer's port that is gone.
const REOPEN_NS: u64 = 100_000_000;

/// Between two looks at whether the last process has ended, for a person who waits for that.
const WAIT_NS: u64 = 100_000_000;

/// From a port's being opened to its modes being set: a port that goes in between is none, and
/// the program says so and begins no job. Its first line comes later (the boot wait is 50 ms).
const OPENING_NS: u64 = 20_000_000;

/// A scenario's times are written for mechanics at life's speed: what people do comes
/// so many times sooner where these are faster. What happens to the wire and the board lasts
/// as long as it says, for the program's own clock is the real one.
pub(super) fn faster(faults: &[Fault], speed: f64) -> Vec<Fault> {
    let sooner = |fault: &Fault| {
        let mut fault = fault.clone();
        fault.after_s /= speed;
        fault.at_s = fault.at_s.map(|s| s / speed);
        if fault.kind == Kind::Kill {
            fault.for_s = fault.for_s.map(|s| s / speed);
        }
        fault
    };
    faults.iter().map(sooner).collect()
}

impl Stage<'_> {
    /// The first process.
    pub(super) fn print(&mut self) -> anyhow::Result<()> {
        let mut args: Vec<OsString> = vec!["print".into(), self.job.clone().into()];
        args.extend(["--port".into(), self.port.clone().into()]);
        args.extend(["--profile".into(), self.profile.clone().into()]);
        args.extend(["--commands", "--verbose", "--no-guard"].map(OsString::from));
        self.note("the program starts".to_owned());
        self.program.start(args).context("the program cannot be started")
    }

    /// An heir takes the job up; `sure`: with a person's word that part and nozzle are clear.
    fn resume(&mut self, sure: bool) -> anyhow::Result<()> {
        let mut args: Vec<OsString> =
            ["jobs", "resume", "1", "--verbose", "--no-guard"].map(OsString::from).into();
        // Who can be told is asked for that word, and waits: as nobody is there, nobody listens,
        // unless the scenario has something to say later.
        let says = |f: &Fault| {
            f.kind.place() == Place::Host && !matches!(f.kind, Kind::Kill | Kind::Confirm | Kind::ChangeFile)
        };
        if self.setup.scenario.fault.iter().any(says) {
            args.push("--commands".into());
        }
        if sure {
            args.push("--yes-part-and-nozzle-are-clear".into());
        }
        self.note(format!("the program resumes the job, with a person's word: {sure}"));
        self.program.start(args).context("the program cannot be started")
    }

    /// Time of the scenario, ns: its times count from when the port was first opened.
    pub(super) fn story_ns(&self) -> u64 {
        self.opened_ns.map_or(0, |at_ns| self.now_ns().saturating_sub(at_ns))
    }

    /// When the next thing is due, ns since the start.
    pub(super) fn due_ns(&self) -> Option<u64> {
        Some(self.events.next_ns()? + self.opened_ns?)
    }

    pub(super) fn happen_due(&mut self) -> anyhow::Result<()> {
        if self.power_back_ns.is_some_and(|at_ns| at_ns <= self.now_ns()) {
            self.power_back_ns = None;
            self.target.power(self.setup.rig)?;
        }
        let now_ns = self.story_ns();
        while let Some(fault) = self.opened_ns.and_then(|_| self.events.take_due(now_ns)) {
            self.happen(fault, None)?;
        }
        Ok(())
    }

    pub(super) fn happen(&mut self, fault: Fault, number: Option<i64>) -> anyhow::Result<()> {
        let now_ns = self.now_ns();
        let for_ns = ns(fault.for_s.unwrap_or_default());
        self.events.first_ns.get_or_insert(now_ns);
        self.note(format!("! {}", fault.kind.name()));
        match fault.kind.place() {
            Place::Wire if fault.kind == Kind::Unplug => self.unplug(now_ns + for_ns),
            Place::Wire => self.link.happen(&fault, now_ns),
            Place::Board => {
                if matches!(fault.kind, Kind::UnplugReset | Kind::PowerCut) {
                    self.unplug(now_ns + for_ns);
                }
                if fault.kind == Kind::PowerCut {
                    self.power_back_ns = Some(now_ns + for_ns);
                }
                let (fd, rig) = (self.device.as_ref(), self.setup.rig);
                self.target.happen(&fault, number, fd, self.baud, rig)?;
            }
            Place::Host => self.on_the_host(fault, now_ns + for_ns)?,
            Place::Disk => {}
        }
        Ok(())
    }

    fn on_the_host(&mut self, fault: Fault, until_ns: u64) -> anyhow::Result<()> {
        match fault.kind {
            Kind::Pause => self.program.tell("pause"),
            Kind::Resume => self.program.tell("resume"),
            Kind::Cancel => self.program.tell("cancel"),
            Kind::EmergencyStop => self.program.tell("stop"),
            Kind::Answer => self.program.tell(&format!("answer {}", fault.button.unwrap_or_default())),
            Kind::Send => self.program.tell(&format!("send {}", fault.text.unwrap_or_default())),
            Kind::Kill if self.program.runs() => {
                self.program.kill();
                self.link.back.cut();
                self.restarts_ns = Some(until_ns);
            }
            Kind::Confirm if self.program.runs() => self.events.later(self.story_ns() + WAIT_NS, fault),
            Kind::Confirm if self.state == State::Interrupted => {
                self.confirmed_ns.push(self.now_ns());
                self.resume(true)?;
            }
            _ => {}
        }
        Ok(())
    }

    fn unplug(&mut self, until_ns: u64) {
        self.link.unplug(until_ns);
        self.pty = None;
    }

    /// The printer's port is gone, and so is the program's.
    pub(super) fn device_goes(&mut self) {
        self.note("the printer's port is gone".to_owned());
        self.device = None;
        self.unplug(self.now_ns() + REOPEN_NS);
    }

    /// Plugs in again what was out long enough, and sees who has the port open.
    pub(super) fn look_at_plug(&mut self) -> anyhow::Result<()> {
        let now_ns = self.now_ns();
        let back = self.link.gone_until_ns <= now_ns;
        if back && self.device.is_none() {
            match tty::open_device(self.target.device(), self.baud) {
                Ok(fd) => self.device = Some(fd),
                Err(_) => self.link.gone_until_ns = now_ns + REOPEN_NS,
            }
        }
        if back && self.device.is_some() && self.pty.is_none() {
            self.pty = Some(Pty::under(&self.port)?);
            self.note("the port is there again".to_owned());
        }
        let open = self.pty.as_mut().map_or(Ok(false), Pty::is_open)?;
        if open && self.opened_ns.is_none() {
            self.opened_ns = Some(now_ns + OPENING_NS);
        }
        if self.restarts_ns.is_some_and(|at_ns| at_ns <= now_ns) && self.pty.is_some() {
            self.restarts_ns = None;
            self.resume(false)?;
        }
        Ok(())
    }

    /// The job's state, where something waits for it, and how hot the board wants to be.
    pub(super) fn look_at_job(&mut self) -> anyhow::Result<()> {
        let expect = &self.setup.scenario.expect;
        if expect.cold_s.is_some() && self.cold_ns.is_none() && self.events.first_ns.is_some() {
            let hot = self.target.stats().map(|stats| stats.heaters_on);
            let hot = hot.unwrap_or_else(|| super::account::targets(self.account.took()) != (0.0, 0.0));
            self.cold_ns = (!hot).then(|| self.now_ns());
        }
        if !self.setup.scenario.fault.iter().any(|f| f.at_state.is_some()) {
            return Ok(());
        }
        self.follow_state()
    }

    fn follow_state(&mut self) -> anyhow::Result<()> {
        let Some(state) = self.program.job().filter(|state| *state != self.state) else {
            return Ok(());
        };
        self.state = state;
        self.note(format!("  the job is {state:?}"));
        for fault in self.events.state(state, self.story_ns()) {
            self.happen(fault, None)?;
        }
        Ok(())
    }

    pub(super) fn look_at_process(&mut self) -> anyhow::Result<()> {
        let Some(status) = self.program.ended() else {
            return Ok(());
        };
        self.ended_ns = self.now_ns();
        self.note(format!("the program ended ({status})"));
        self.link.back.cut();
        self.follow_state()
    }

    /// Whether nothing will begin any more by itself.
    pub(super) fn is_over(&self) -> bool {
        !self.program.runs() && self.restarts_ns.is_none() && !self.events.waits_for_person()
    }
}
