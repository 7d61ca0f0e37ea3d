//! `outrigger console` and `outrigger ports` through the real binary, against the
//! mock printer on its pseudo-terminal.
use rustix::event::{PollFd, PollFlags, poll};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use std::fs::{self, File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::PathBuf;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

const BINARY: &str = env!("CARGO_BIN_EXE_outrigger");

/// Longer than anything here takes on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(60);

/// A mock printer in its own process and folder, ended when dropped.
struct Mock {
    child: Child,
    folder: tempfile::TempDir,
}

impl Mock {
    fn start(options: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new(BINARY)
            .current_dir(folder.path())
            .args(["mock", "--link", "tty", "--baud", "0", "--speed", "100"])
            .args(options)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        assert_eq!(line, "tty\n");
        Self { child, folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A console whose state is kept in the mock's folder.
    fn console(&self, options: &[&str]) -> Command {
        let mut command = Command::new(BINARY);
        command.args(["console", "--port"]).arg(self.path("tty")).args(options);
        command.env("OUTRIGGER_STATE", self.path("state")).env_remove("NO_COLOR").env("TERM", "xterm");
        command
    }

    /// Runs a script through a console.
    fn script(&self, options: &[&str], input: &[u8]) -> Output {
        let mut child = self
            .console(options)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        child.stdin.take().unwrap().write_all(input).unwrap();
        child.wait_with_output().unwrap()
    }
}

impl Drop for Mock {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn a_script_gets_its_answers_in_order() {
    let mock = Mock::start(&["--dtr-reset"]);
    let input = b"; nothing\nM105\nG28\nM114\nfoo \x1b[2J\n";
    let output = mock.script(&["--wait", "0"], input);
    let (said, told) = (text(&output.stdout), text(&output.stderr));
    assert!(output.status.success(), "{told}");
    let at = |words: &str| said.find(words).unwrap_or_else(|| panic!("{words:?} in {said}"));
    let order = ["start\n", "ok T:22.00 /0.00", "X:0.00 Y:0.00", "echo:Unknown command: \""].map(at);
    assert!(order.is_sorted(), "{said}");
    assert!(!said.contains('\u{1b}'), "nothing acts on the terminal");
    assert!(told.contains("nothing was sent: this is a comment"), "{told}");
    // Every command was answered before the end.
    assert_eq!(said.lines().filter(|line| line.starts_with("ok")).count(), 4, "{said}");
}

#[test]
fn a_script_that_is_not_answered_fails() {
    let mock = Mock::start(&[]);
    let check = |options: &[&str], input: &[u8], code: i32, expect: &str| {
        let output = mock.script(options, input);
        let told = text(&output.stderr);
        assert_eq!(output.status.code(), Some(code), "{told}");
        assert!(told.contains(expect), "{told}");
    };
    let awake = ["--baud", "auto", "--profile", "prusa-mk4", "--wait", "0"];
    check(
        &[&awake[..], &["--timeout", "0.2"]].concat(),
        b"G4 S3600\nM105\n",
        1,
        "no answer to G4 S3600 for 0.2 s",
    );
}

#[test]
fn a_stop_overtakes_what_waits() {
    let mock = Mock::start(&["--dtr-reset"]);
    let mut child = mock
        .console(&["--wait", "0"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut input = child.stdin.take().unwrap();
    let mut said = BufReader::new(child.stdout.take().unwrap()).lines();
    input.write_all(b"M104 S200\nM105\nG4 S36000\nG28\n").unwrap();
    assert!(said.any(|line| line.unwrap().starts_with("ok T:")));
    input.write_all(b"M112\n").unwrap();
    drop(input);
    assert!(said.any(|line| line.unwrap().starts_with("Error:Printer halted")));
    let output = child.wait_with_output().unwrap();
    let told = text(&output.stderr);
    assert!(output.status.success() && told.contains("M112 is sent"), "{told}");
    assert!(told.contains("the firmware has stopped"), "{told}");
}

#[test]
fn raw_bytes_pass_unchanged() {
    let mock = Mock::start(&["--dtr-reset"]);
    let output = mock.script(&["--raw", "--wait", "0.5"], b"M105\nfoo\x1b\n");
    let said = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(said.starts_with("start\n External Reset\n"), "a blank is not taken away: {said}");
    assert!(said.contains("ok T:22.00") && said.contains("Unknown command: \"foo\u{1b}\""), "{said}");
}

#[test]
fn a_port_that_is_held_is_refused() {
    let mock = Mock::start(&["--dtr-reset"]);
    let mut first =
        mock.console(&[]).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut said = BufReader::new(first.stdout.take().unwrap()).lines();
    assert_eq!(said.next().unwrap().unwrap(), "start");
    let output = mock.script(&[], b"M105\n");
    let told = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1));
    assert!(told.contains("another program holds it"), "{told}");
    let probed =
        Command::new(BINARY).args(["ports", "--probe", "--json"]).arg(mock.path("tty")).output().unwrap();
    assert!(text(&probed.stdout).contains("\"found\": \"in_use\""), "{}", text(&probed.stdout));
    drop(first.stdin.take());
    assert!(first.wait().unwrap().success());
}

/// The far side of a terminal that a person would sit at.
struct Person {
    far: File,
    seen: String,
}

impl Person {
    fn types(&mut self, keys: &str) {
        self.far.write_all(keys.as_bytes()).unwrap();
    }

    fn sees(&mut self, words: &str) {
        let end = Instant::now() + PATIENCE;
        loop {
            if let Some(at) = self.seen.find(words) {
                self.seen.drain(..at + words.len());
                return;
            }
            let mut fds = [PollFd::new(&self.far, PollFlags::IN)];
            let left = end.saturating_duration_since(Instant::now()).try_into().unwrap();
            assert!(poll(&mut fds, Some(&left)).unwrap() > 0, "no {words:?} in {:?}", self.seen);
            let mut some = [0; 4096];
            let read = self.far.read(&mut some).unwrap_or(0);
            assert!(read > 0, "gone before {words:?}, after {:?}", self.seen);
            self.seen.push_str(&String::from_utf8_lossy(&some[..read]));
        }
    }
}

/// A console at a terminal.
fn at_a_terminal(mock: &Mock, options: &[&str]) -> (Person, Child) {
    let far = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&far).unwrap();
    unlockpt(&far).unwrap();
    let path = ptsname(&far, Vec::new()).unwrap().to_string_lossy().into_owned();
    let near = || OpenOptions::new().read(true).write(true).open(&path).unwrap();
    let child = mock.console(options).stdin(near()).stdout(near()).stderr(near()).spawn().unwrap();
    (Person { far: File::from(far), seen: String::new() }, child)
}

#[test]
fn a_person_types_sees_and_finds_it_again() {
    use std::os::unix::fs::PermissionsExt;
    let mock = Mock::start(&["--dtr-reset"]);
    let (mut person, mut child) = at_a_terminal(&mock, &[]);
    person.sees("/help says more");
    person.sees("Settings Loaded");
    person.types("M105\r");
    person.sees("ok T:22.00");
    person.types("\u{1b}[A"); // the line before
    person.sees("M105");
    person.types("\r");
    person.sees("ok T:22.00");
    // While it waits, the prompt stays usable; Ctrl-C says what can be done.
    person.types("G4 S36000\r");
    person.types("\u{3}");
    person.sees("the printer is still at G4 S36000");
    person.types("/stop\r");
    person.sees("Error:Printer halted");
    person.types("/reset\r");
    person.sees("Settings Loaded");
    person.types("M114\r");
    person.sees("X:0.00 Y:0.00");
    person.types("/quit\r");
    assert!(child.wait().unwrap().success());

    let history = mock.path("state/console-history");
    assert_eq!(history.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    let kept = fs::read_to_string(&history).unwrap();
    assert!(kept.contains("M105") && kept.contains("G4 S36000"), "{kept}");

    let (mut person, mut child) = at_a_terminal(&mock, &[]);
    person.sees("/help says more");
    person.types("\u{12}G4"); // search backwards
    person.sees("G4 S36000");
    person.types("\u{7}\u{15}");
    person.types("\u{4}"); // Ctrl-D ends
    assert!(child.wait().unwrap().success());
}

/// A printer that is unplugged is waited for, and talked to again.
#[test]
fn a_console_outlives_its_port() {
    let mut mock = Mock::start(&["--dtr-reset"]);
    let (mut person, mut child) = at_a_terminal(&mock, &[]);
    person.sees("Settings Loaded");
    mock.child.kill().unwrap();
    mock.child.wait().unwrap();
    person.sees("waiting for");
    fs::remove_file(mock.path("tty")).unwrap();
    person.types("M105\r");
    person.sees("there is no printer");
    mock.child = Command::new(BINARY)
        .current_dir(mock.folder.path())
        .args(["mock", "--link", "tty", "--baud", "0", "--dtr-reset"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    person.sees("is back");
    person.sees("Settings Loaded");
    person.types("M105\r");
    person.sees("ok T:22.00");
    person.types("/quit\r");
    assert!(child.wait().unwrap().success());
}

#[test]
fn ports_are_listed_and_asked() {
    let mock = Mock::start(&["--dtr-reset"]);
    let ports = |options: &[&str]| {
        let output = Command::new(BINARY).arg("ports").args(options).arg(mock.path("tty")).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let listed = ports(&[]);
    assert!(listed.starts_with("PORT ") && listed.contains("/tty"), "{listed}");
    let probed = ports(&["--probe"]);
    assert!(probed.contains("Marlin 2.1.2.1") && probed.contains("at 115200 baud"), "{probed}");
    let json: serde_json::Value = serde_json::from_str(&ports(&["--probe", "--json"])).unwrap();
    assert_eq!(json["ports"][0]["printer"]["found"], "printer");
    assert_eq!(json["ports"][0]["port"], json["ports"][0]["path"]);

    let all = Command::new(BINARY).args(["ports", "--json"]).output().unwrap();
    let json: serde_json::Value = serde_json::from_slice(&all.stdout).unwrap();
    assert!(json["ports"].is_array());
    let none = Command::new(BINARY).args(["ports", "/dev/outrigger-none"]).output().unwrap();
    assert_eq!(none.status.code(), Some(1));
}
