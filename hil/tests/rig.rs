//! The rig itself: scenarios over real pseudo-terminals, and its watchdog.
//!
//! The watchdog's tests have the mock in a process of its own, which outlives the rig as a real
//! printer does, and read from its statistics whether the heaters are off.
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const HIL: &str = env!("CARGO_BIN_EXE_outrigger-hil");

/// No test waits longer for anything: a loaded machine is slow, not stuck.
const PATIENCE: Duration = Duration::from_secs(100);

/// Scenarios that between them take every way through the rig: nothing, each direction of the
/// wire, the plug, the process, the user, the board, and a job that is refused.
const SOME: [&str; 10] = [
    "plain",
    "line-lost@40",
    "reply-garbled@60",
    "unknown-words",
    "unplugged-3-s@60",
    "host-killed@50",
    "pause-and-resume@48",
    "cancel@100",
    "thermal-runaway",
    "line-too-long",
];

fn hil() -> Command {
    let mut command = Command::new(HIL);
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn wait_until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "still waiting for {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Plays with these flags; all must hold.
fn check_holds(flags: &[&str], names: &[&str], at_least: usize) {
    let mut command = hil();
    command.args(flags).args(["--lines", "40"]);
    for name in names {
        command.args(["--only", name]);
    }
    let out = command.output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success(), "{said}{}", String::from_utf8_lossy(&out.stderr));
    let held = said.lines().filter(|line| line.contains(": holds (")).count();
    assert!(held >= at_least, "{said}");
}

#[test]
fn scenarios_hold_over_a_pseudo_terminal() {
    check_holds(&["--mock", "--jobs", "10"], &SOME, 9);
}

/// Where `OUTRIGGER_OCTOPRINT_PYTHON` and `OUTRIGGER_OCTOPRINT_SCRIPT` name them.
#[test]
fn they_hold_on_octoprints_virtual_printer_with_its_own_errors() {
    let named = |name| std::env::var_os(name).is_some();
    if !named("OUTRIGGER_OCTOPRINT_PYTHON") || !named("OUTRIGGER_OCTOPRINT_SCRIPT") {
        eprintln!(
            "skipped: OUTRIGGER_OCTOPRINT_PYTHON and OUTRIGGER_OCTOPRINT_SCRIPT name no virtual printer"
        );
        return;
    }
    check_holds(
        &["--octoprint", "--jobs", "4"],
        &["plain", "line-lost@41", "unplugged-3-s@60", "cancel@100"],
        4,
    );
}

#[test]
fn what_does_not_hold_is_told_and_is_exit_code_1() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = "title = 't'\n[job]\ngcode = 'G28'\n[expect]\noutcome = 'cancelled'";
    fs::write(folder.path().join("wrong.toml"), scenario).unwrap();
    let out = hil().arg("--mock").arg("--scenarios").arg(folder.path()).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("mock: wrong: DOES NOT HOLD: it ends in Finished"), "{said}");
    assert!(said.contains("0 hold, 1 do not, 0 were skipped"), "{said}");
}

#[test]
fn what_is_skipped_is_told_with_the_reason() {
    let out = hil().args(["--mock", "--list"]).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    assert!(out.status.success());
    assert!(said.contains("disk-slow: skipped: disk_slow: the journal's disk"), "{said}");
    assert!(said.contains("mock: plain: Nothing goes wrong"), "{said}");
}

#[test]
fn a_real_printer_waits_for_a_yes() {
    let board = Board::start();
    let out = board.runner("", &["--only", "plain"]).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("HEATS") && said.contains("Type yes"), "{said}");
    assert!(String::from_utf8_lossy(&out.stderr).contains("nothing was done"));
    assert_eq!(board.now()["lines_received"].as_u64(), Some(0));
}

/// A mock in a process of its own.
struct Board {
    child: Child,
    folder: tempfile::TempDir,
}

impl Board {
    fn start() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let child = Command::new(HIL)
            .env("OUTRIGGER_HIL_RUNS_AS", "outrigger")
            .current_dir(folder.path())
            .args(["mock", "--link", "tty", "--stats", "stats.json", "--speed", "4"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let board = Self { child, folder };
        wait_until("the mock's terminal", || board.path("tty").exists());
        board
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn now(&self) -> serde_json::Value {
        let stats = || serde_json::from_slice(&fs::read(self.path("stats.json")).ok()?).ok();
        stats().unwrap_or_default()
    }

    fn rig(&self, limits: &str) -> PathBuf {
        let path = self.path("rig.toml");
        let limits = match limits {
            "" => "nozzle_c = 260\nbed_c = 110\nscenario_s = 300",
            given => given,
        };
        fs::write(&path, format!("title = 'a mock'\nprofile = 'ender-3'\n[limits]\n{limits}\n")).unwrap();
        path
    }

    /// A rig that takes the mock for a real printer.
    fn runner(&self, limits: &str, flags: &[&str]) -> Command {
        let mut command = hil();
        command.arg("--port").arg(self.path("tty")).arg("--rig").arg(self.rig(limits)).args(flags);
        command
    }

    /// The watchdog alone, on a hot board, watching over `runner`.
    fn watchdog(&self, limits: &str, runner: &Child) -> Child {
        self.heat();
        let mut command = hil();
        command.arg("watchdog").arg("--port").arg(self.path("tty")).args(["--baud", "115200"]);
        command.arg("--rig").arg(self.rig(limits)).args(["--runner", &runner.id().to_string()]);
        command.stdin(Stdio::piped()).spawn().unwrap()
    }

    fn heat(&self) {
        let mut port = fs::OpenOptions::new().write(true).open(self.path("tty")).unwrap();
        port.write_all(b"M104 S200\nM140 S50\n").unwrap();
        wait_until("heat", || self.is_hot());
    }

    fn is_hot(&self) -> bool {
        let stats = self.now();
        stats["nozzle_target_c"].as_f64() > Some(0.0) && stats["bed_target_c"].as_f64() > Some(0.0)
    }

    fn wait_cold(&self) {
        wait_until("cold heaters", || {
            let stats = self.now();
            stats["nozzle_target_c"] == 0.0 && stats["bed_target_c"] == 0.0
        });
    }
}

impl Drop for Board {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A process that does nothing, for the watchdog to kill.
fn sleeper() -> Child {
    Command::new("sleep").arg("600").spawn().unwrap()
}

/// Waits for the watchdog's end: it acted, and the runner is dead.
fn check_acted(board: &Board, mut dog: Child, runner: Option<Child>, why: &str) {
    wait_until("the watchdog's end", || dog.try_wait().unwrap().is_some());
    board.wait_cold();
    let out = dog.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr);
    assert_eq!(out.status.code(), Some(3), "{said}");
    assert!(said.contains(why), "{said}");
    if let Some(mut runner) = runner {
        assert!(!runner.wait().unwrap().success());
    }
}

#[test]
fn a_killed_rig_leaves_a_cold_printer_and_no_process() {
    let board = Board::start();
    let mut runner = board.runner("", &["--yes", "--only", "plain"]).spawn().unwrap();
    wait_until("heat", || board.is_hot());
    runner.kill().unwrap();
    runner.wait().unwrap();
    board.wait_cold();
    assert_eq!(board.now()["kills"], 1, "the board was halted by M112");
    // Neither the program under test nor the watchdog stays behind.
    let tty = board.path("tty").display().to_string();
    wait_until("the watchdog's end", || !processes().lines().any(|line| line.contains(&tty)));
}

fn processes() -> String {
    let out = Command::new("ps").args(["-eo", "args"]).output().unwrap();
    String::from_utf8_lossy(&out.stdout).into_owned()
}

#[test]
fn too_hot_a_nozzle_ends_the_rig_and_the_heat() {
    let board = Board::start();
    // The job wants 200 °C.
    let limits = "nozzle_c = 60\nbed_c = 110\nscenario_s = 300";
    let out = board.runner(limits, &["--yes", "--only", "plain"]).output().unwrap();
    assert!(!out.status.success());
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(said.contains("60 °C at most are allowed"), "{said}");
    board.wait_cold();
    assert!(board.now()["nozzle_c"].as_f64() < Some(120.0));
}

#[test]
fn too_hot_a_bed_is_a_reason_too() {
    let (board, runner) = (Board::start(), sleeper());
    let mut dog = board.watchdog("nozzle_c = 260\nbed_c = 60\nscenario_s = 300", &runner);
    dog.stdin.as_mut().unwrap().write_all(b"heat 200.0 60.5\n").unwrap();
    check_acted(&board, dog, Some(runner), "60.5 °C measured, 60 °C at most");
}

#[test]
fn time_that_is_over_is_a_reason_however_lively_the_rig_is() {
    let (board, runner) = (Board::start(), sleeper());
    let mut dog = board.watchdog("nozzle_c = 260\nbed_c = 110\nscenario_s = 1", &runner);
    let mut input = dog.stdin.take().unwrap();
    while input.write_all(b"beat\n").is_ok() && dog.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(50));
    }
    check_acted(&board, dog, Some(runner), "time is over");
}

#[test]
fn a_rig_that_hangs_is_a_reason() {
    let (board, runner) = (Board::start(), sleeper());
    let mut dog = board.watchdog("", &runner);
    // Held open, and nothing said.
    let input = dog.stdin.take();
    check_acted(&board, dog, Some(runner), "hangs");
    drop(input);
}

#[test]
fn a_watchdog_that_is_told_that_all_is_done_leaves_the_printer_alone() {
    let (board, mut runner) = (Board::start(), sleeper());
    let mut dog = board.watchdog("", &runner);
    dog.stdin.take().unwrap().write_all(b"beat\ndone\n").unwrap();
    wait_until("the watchdog's end", || dog.try_wait().unwrap().is_some());
    assert!(dog.wait().unwrap().success());
    assert!(board.is_hot());
    assert!(runner.try_wait().unwrap().is_none(), "the runner lives");
    runner.kill().unwrap();
    runner.wait().unwrap();
}

#[test]
fn the_rigs_of_this_folder_are_valid() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("rigs");
    let mut count = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let rig = outrigger_hil::rig::Rig::load(&path).unwrap();
        outrigger::profile::load_printer(&rig.profile).unwrap();
        count += 1;
    }
    assert!(count >= 2);
}
