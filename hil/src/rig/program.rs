//! The program under test: started, told, killed, listened to.
//!
//! Takes what a user would type, gives what a user would see. Its state is read from its
//! journal, as any other program could.
use outrigger::job::journal;
use outrigger::job::state::State;
use rustix::process::{Pid, Signal, kill_process};
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex, PoisonError};

/// Set, and this binary is `outrigger`: one build has both, and they are never out of step.
pub const RUNS_AS: &str = "OUTRIGGER_HIL_RUNS_AS";

/// Bytes of a program's output that are kept: a scenario's is a few kilobytes.
const SAID_BYTES_MAX: usize = 4 << 20;

/// How the program is started.
#[derive(Debug, Clone)]
pub struct Installed {
    /// The binary.
    pub path: PathBuf,
    /// Whether it must be told to be `outrigger`.
    pub is_hil: bool,
}

/// One process of the program, and all that earlier ones said.
#[derive(Debug)]
pub struct Program {
    installed: Installed,
    folder: PathBuf,
    child: Option<Child>,
    said: Arc<Mutex<String>>,
    /// Processes started.
    pub processes: u32,
}

impl Program {
    /// None runs yet. `folder` is for its records.
    pub fn new(installed: Installed, folder: PathBuf) -> Self {
        Self { installed, folder, child: None, said: Arc::default(), processes: 0 }
    }

    /// `outrigger` with these arguments.
    ///
    /// # Errors
    /// The system starts no process.
    pub fn start(&mut self, args: Vec<OsString>) -> std::io::Result<()> {
        let mut command = Command::new(&self.installed.path);
        if self.installed.is_hil {
            command.env(RUNS_AS, "outrigger");
        }
        command.args(args).env("OUTRIGGER_STATE", &self.folder);
        let mut child =
            command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn()?;
        if let Some(out) = child.stdout.take() {
            self.listen(out);
        }
        if let Some(err) = child.stderr.take() {
            self.listen(err);
        }
        self.child = Some(child);
        self.processes += 1;
        Ok(())
    }

    fn listen(&self, from: impl Read + Send + 'static) {
        let said = Arc::clone(&self.said);
        std::thread::spawn(move || {
            for line in BufReader::new(from).split(b'\n') {
                let Ok(line) = line else { return };
                let mut said = said.lock().unwrap_or_else(PoisonError::into_inner);
                if said.len() < SAID_BYTES_MAX {
                    said.push_str(&String::from_utf8_lossy(&line));
                    said.push('\n');
                }
            }
        });
    }

    /// A word on its standard input, as `--commands` reads it. Lost if nobody listens.
    pub fn tell(&mut self, word: &str) {
        if let Some(input) = self.child.as_mut().and_then(|c| c.stdin.as_mut()) {
            let _ = writeln!(input, "{word}");
        }
    }

    /// kill -9.
    pub fn kill(&mut self) {
        if let Some(mut child) = self.child.take() {
            if let Some(pid) = i32::try_from(child.id()).ok().and_then(Pid::from_raw) {
                let _ = kill_process(pid, Signal::KILL);
            }
            let _ = child.wait();
        }
    }

    /// Whether one runs; how the last one ended, once.
    pub fn ended(&mut self) -> Option<ExitStatus> {
        let status = self.child.as_mut()?.try_wait().ok()??;
        self.child = None;
        Some(status)
    }

    /// Whether one runs.
    pub fn runs(&self) -> bool {
        self.child.is_some()
    }

    /// All that was said so far.
    pub fn said(&self) -> String {
        self.said.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Where the one job of its folder is, as its journal says: read without a lock, so that
    /// nobody who wants the job finds it taken.
    pub fn job(&self) -> Option<State> {
        let bytes = std::fs::read(self.folder.join("jobs/1.journal")).ok()?;
        Some(journal::read(&bytes).ok()?.log.state)
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.kill();
    }
}
