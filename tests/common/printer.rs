//! A mock printer in a process of its own, jobs for it, and `outrigger print` on them.
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

pub(crate) const BINARY: &str = env!("CARGO_BIN_EXE_outrigger");

/// No test here waits longer for anything: a loaded machine is slow, not stuck.
pub(crate) const PATIENCE: Duration = Duration::from_secs(100);

/// A mock printer in its own process, ended when dropped.
pub(crate) struct Mock {
    pub(crate) child: Child,
    pub(crate) folder: tempfile::TempDir,
}

impl Mock {
    pub(crate) fn start(options: &[&str]) -> Self {
        Self::with_faults(options, "")
    }

    pub(crate) fn with_faults(options: &[&str], faults: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("faults.toml"), faults).unwrap();
        let child = Command::new(BINARY)
            .current_dir(folder.path())
            .args(["mock", "--link", "tty", "--stats", "stats.json"])
            .args(["--faults", "faults.toml", "--baud", "0", "--dtr-reset"])
            .args(options)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mock = Self { child, folder };
        wait_until("the mock's terminal", || mock.path("tty").exists());
        mock
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn job(&self, text: &str) -> PathBuf {
        let path = self.path("job.gcode");
        fs::write(&path, text).unwrap();
        path
    }

    /// The binary, with a state folder of its own.
    pub(crate) fn outrigger(&self) -> Command {
        let mut command = Command::new(BINARY);
        command
            .env("OUTRIGGER_STATE", self.path("state"))
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command
    }

    /// The counts as the mock last wrote them.
    pub(crate) fn now(&self) -> serde_json::Value {
        let stats = || serde_json::from_slice(&fs::read(self.path("stats.json")).ok()?).ok();
        stats().unwrap_or_default()
    }

    pub(crate) fn print(&self, job: &Path) -> Command {
        let mut command = self.outrigger();
        command.arg("print").arg(job).arg("--port").arg(self.path("tty")).args([
            "--profile",
            "generic-marlin",
            "--verbose",
        ]);
        command
    }

    /// Ends the mock and returns its last counts.
    pub(crate) fn stats(mut self) -> serde_json::Value {
        signal("INT", &self.child);
        wait_for(&mut self.child);
        serde_json::from_slice(&fs::read(self.path("stats.json")).unwrap()).unwrap()
    }
}

impl Drop for Mock {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

pub(crate) fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "still waiting for {what}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

pub(crate) fn wait_for(child: &mut Child) {
    wait_until("a process to end", || child.try_wait().unwrap().is_some());
}

pub(crate) fn signal(name: &str, child: &Child) {
    let kill = Command::new("kill").args([&format!("-{name}"), &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
}

pub(crate) fn output(command: &mut Command) -> Output {
    let mut child = command.spawn().unwrap();
    wait_for(&mut child);
    child.wait_with_output().unwrap()
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// FNV-1a of the commands, one a line: the mock's digest.
pub(crate) fn digest<'a>(commands: impl Iterator<Item = &'a str>) -> String {
    let mut state = 0xcbf2_9ce4_8422_2325_u64;
    for byte in commands.flat_map(|c| c.bytes().chain([b'\n'])) {
        state = (state ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
    }
    format!("{state:016x}")
}

/// A job of short moves in the air; the mock's planner takes them as fast as
/// `--speed` lets it.
pub(crate) fn moves(count: u32) -> String {
    let moves: String =
        (0..count).map(|n| format!("G1 X{}.{:03} Y{} F9000\n", 10 + n % 7, n % 1000, 20 + n % 5)).collect();
    format!("G28 ; home\n;LAYER_CHANGE\n{moves}")
}

pub(crate) fn commands(job: &str) -> impl Iterator<Item = &str> {
    job.lines().map(|line| line.split(';').next().unwrap_or("").trim()).filter(|line| !line.is_empty())
}
