//! The hosts that are measured: ours, the least one in C, and the peers.
use anyhow::{Context, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;

/// Machine of every run: fast enough for moves of 1 ms, and opening the port does not
/// reset its board.
pub(crate) const PROFILE: &str = "prusa-mini";

/// Who sends.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Host {
    Ours,
    C,
    OctoPrint,
    Printcore,
}

impl Host {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Host::Ours => "outrigger",
            Host::C => "C sender",
            Host::OctoPrint => "OctoPrint",
            Host::Printcore => "printcore",
        }
    }

    /// Whether it leaves the numbering as it is after the last line, so that the
    /// printer's digest of the job stands at the end.
    pub(crate) fn keeps_numbers(self) -> bool {
        self != Host::Printcore
    }
}

/// Where the programs are.
pub(crate) struct Programs {
    pub(crate) outrigger: PathBuf,
    c_sender: PathBuf,
    python: Option<PathBuf>,
}

impl Programs {
    /// Compiles the sender in C into `folder`.
    pub(crate) fn new(folder: &Path, python: Option<PathBuf>) -> anyhow::Result<Self> {
        let exe = std::env::current_exe()?;
        let outrigger = exe.ancestors().nth(2).context("no build folder")?.join("outrigger");
        ensure!(outrigger.exists(), "{}: build it first, in the same profile", outrigger.display());
        let c_sender = folder.join("peer_sender");
        let source = source("benches/peer_sender.c");
        let compiled = Command::new("cc").arg("-O2").arg("-o").arg(&c_sender).arg(&source).status();
        ensure!(compiled.context("no C compiler (cc)")?.success(), "{} does not compile", source.display());
        Ok(Self { outrigger, c_sender, python })
    }

    /// All that can be run here.
    pub(crate) fn hosts(&self) -> Vec<Host> {
        match self.python {
            Some(_) => vec![Host::Ours, Host::C, Host::OctoPrint, Host::Printcore],
            None => vec![Host::Ours, Host::C],
        }
    }

    /// What prints `job` on the port `tty`; files that a host keeps go to `folder`.
    pub(crate) fn command(&self, host: Host, job: &Path, tty: &Path, baud: u32, folder: &Path) -> Command {
        // A line without a limit still has to be opened at some speed.
        let baud = if baud == 0 { 250_000 } else { baud }.to_string();
        let peer = |script| {
            let mut command = Command::new(self.python.as_deref().unwrap_or(Path::new("python3")));
            command.arg(source(script)).arg(job).arg(tty).arg(&baud);
            command
        };
        match host {
            Host::Ours => {
                let mut command = Command::new(&self.outrigger);
                command.arg("print").arg(job).arg("--port").arg(tty);
                command.args(["--profile", PROFILE, "--no-macros", "--baud", &baud]);
                // Whoever runs this has jobs of their own on record.
                command.env("OUTRIGGER_STATE", folder.join("state"));
                command
            }
            Host::C => {
                let mut command = Command::new(&self.c_sender);
                command.arg(job).arg(tty);
                command
            }
            Host::OctoPrint => peer("examples/peers/octoprint_print.py"),
            Host::Printcore => peer("examples/peers/printcore_print.py"),
        }
    }
}

fn source(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}
