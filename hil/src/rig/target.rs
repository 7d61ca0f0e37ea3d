//! What is printed on: a real port, the mock on its pseudo-terminal, or OctoPrint's virtual printer.
use super::{Rig, Sort, tty};
use crate::scenario::{Fault, Kind, Names, Printer};
use crate::world::events::of_mock;
use outrigger::printer::mock::{self, Config, Executed, Faults, Options, Stats};
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// How many times faster than life the mechanics of the mock and of the virtual printer are
/// here: a scenario heats and homes, and nobody wants to wait for that.
pub const MOCK_SPEED: f64 = 10.0;

/// Time for the virtual printer's Python to begin.
const PYTHON_STARTS: Duration = Duration::from_secs(60);

/// Time for a real board to start after its port was opened, which may reset it: boot loaders
/// take one to two seconds, the firmware's own start as long again.
const BOARD_STARTS: Duration = Duration::from_secs(5);

/// What is printed on.
#[derive(Debug)]
pub enum Target {
    /// The mock.
    Mock(Box<mock::Handle>),
    /// The virtual printer.
    Virtual {
        /// Its process.
        child: Child,
        /// Its terminal.
        link: PathBuf,
    },
    /// A real printer's port.
    Real(PathBuf),
}

/// OctoPrint's virtual printer, where it is installed.
#[derive(Debug, Clone)]
pub struct Octoprint {
    /// A Python that has the package `octoprint`.
    pub python: PathBuf,
    /// The script that puts the virtual printer on a pseudo-terminal.
    pub script: PathBuf,
}

impl Target {
    /// A mock as the scenario wants it.
    ///
    /// # Errors
    /// There is no such personality, or no pseudo-terminal.
    pub fn mock(printer: &Printer) -> anyhow::Result<Self> {
        let mut config = match &printer.personality {
            Some(Names::One(name)) => crate::play::personality(name)?,
            _ => Config::default(),
        };
        config.speed = printer.speed.unwrap_or(1.0) * MOCK_SPEED;
        // Only the rig has this port open, and it opens it once.
        config.dtr_reset = false;
        config.record = true;
        let handle = mock::spawn(Options { config, faults: Faults::default(), ..Options::default() })?;
        Ok(Self::Mock(Box::new(handle)))
    }

    /// The virtual printer with its own default faults.
    ///
    /// # Errors
    /// It does not start.
    pub fn octoprint(octoprint: &Octoprint, folder: &Path) -> anyhow::Result<Self> {
        let link = folder.join("virtual");
        let mut child = Command::new(&octoprint.python)
            .arg(&octoprint.script)
            .arg("--link")
            .arg(&link)
            .args(["--speed", &MOCK_SPEED.to_string()])
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()?;
        let until = Instant::now() + PYTHON_STARTS;
        while !link.exists() {
            if let Some(status) = child.try_wait()? {
                anyhow::bail!("the virtual printer ended ({status}): is octoprint installed?");
            }
            if Instant::now() >= until {
                let _ = child.kill();
                anyhow::bail!("the virtual printer did not start within {PYTHON_STARTS:?}");
            }
            std::thread::sleep(Duration::from_millis(50));
        }
        Ok(Self::Virtual { child, link })
    }

    /// Which sort it is.
    pub fn sort(&self) -> Sort {
        match self {
            Self::Mock(_) => Sort::Mock,
            Self::Virtual { .. } => Sort::Virtual,
            Self::Real(_) => Sort::Real,
        }
    }

    /// The device to open.
    pub fn device(&self) -> &Path {
        match self {
            Self::Mock(handle) => handle.path(),
            Self::Virtual { link, .. } => link,
            Self::Real(path) => path,
        }
    }

    /// How many times faster than life its mechanics are.
    pub fn speed(&self) -> f64 {
        match self {
            Self::Mock(_) | Self::Virtual { .. } => MOCK_SPEED,
            Self::Real(_) => 1.0,
        }
    }

    /// Something happens to the board; `number` is the line's that it is to happen to. What it
    /// takes to undo it comes later: see [`Target::power`].
    ///
    /// # Errors
    /// The rig's means fail.
    pub fn happen(
        &self,
        fault: &Fault,
        number: Option<i64>,
        fd: Option<&OwnedFd>,
        baud: u32,
        rig: &Rig,
    ) -> io::Result<()> {
        match self {
            Self::Mock(handle) => handle.inject(of_mock(fault, number)),
            _ if fault.kind == Kind::PowerCut => shell(rig.power_off.as_deref())?,
            _ if fault.kind == Kind::Reset => fd.map_or(Ok(()), |fd| tty::reset_board(fd, baud))?,
            _ => {}
        }
        Ok(())
    }

    /// A real printer has power again.
    ///
    /// # Errors
    /// The rig's means fail.
    pub fn power(&self, rig: &Rig) -> io::Result<()> {
        match self {
            Self::Real(_) => shell(rig.power_on.as_deref()),
            _ => Ok(()),
        }
    }

    /// A real board begins each scenario anew: halted ones live again, and what one scenario
    /// left behind is not the next one's.
    ///
    /// # Errors
    /// The rig's means fail.
    pub fn prepare(&self, fd: &OwnedFd, baud: u32, rig: &Rig) -> io::Result<()> {
        if !matches!(self, Self::Real(_)) {
            return Ok(());
        }
        if rig.dtr_reset {
            tty::reset_board(fd, baud)?;
        }
        std::thread::sleep(BOARD_STARTS);
        tty::drop_unread(fd);
        Ok(())
    }

    /// What the board did, where it can be asked.
    pub fn deeds(&self) -> Option<(Vec<Executed>, Vec<u64>, Stats)> {
        match self {
            Self::Mock(handle) => Some((handle.take_executed(), handle.starts_ns(), handle.stats())),
            _ => None,
        }
    }
}

impl Target {
    /// The board's own counts, where it can be asked.
    pub fn stats(&self) -> Option<Stats> {
        match self {
            Self::Mock(handle) => Some(handle.stats()),
            _ => None,
        }
    }
}

impl Drop for Target {
    fn drop(&mut self) {
        if let Self::Virtual { child, .. } = self {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn shell(command: Option<&str>) -> io::Result<()> {
    let Some(command) = command else {
        return Ok(());
    };
    let status = Command::new("sh").arg("-c").arg(command).status()?;
    match status.success() {
        true => Ok(()),
        false => Err(io::Error::other(format!("{command:?} failed ({status})"))),
    }
}
