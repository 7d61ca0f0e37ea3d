//! `outrigger mock` through the real binary: plain file I/O on its terminal.
use outrigger::printer::mock;
use rustix::event::{PollFd, PollFlags, poll};
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Longer than anything here takes on a loaded machine; a test that waits so
/// long has failed.
const PATIENCE: Duration = Duration::from_secs(20);

/// `outrigger mock` in a folder of its own; ended when dropped.
struct Mock {
    child: Child,
    folder: tempfile::TempDir,
    /// Files that may be there at the end.
    files: usize,
}

impl Mock {
    fn start(args: &[&str], faults: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("faults.toml"), faults).unwrap();
        let mut child = Command::new(env!("CARGO_BIN_EXE_outrigger"))
            .current_dir(folder.path())
            .args(["mock", "--link", "tty", "--stats", "stats.json"])
            .args(["--faults", "faults.toml"])
            .args(args)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let out = child.stdout.take().unwrap();
        BufReader::new(out).read_line(&mut line).unwrap();
        assert_eq!(line, "tty\n");
        // Faults, statistics, and the log if there is one.
        Self { child, folder, files: 2 + usize::from(args.contains(&"--log")) }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn open(&self) -> Port {
        Port::open(&self.path("tty"))
    }

    fn signal(&self, signal: &str) {
        let kill = format!("kill -{signal} {}", self.child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
    }

    /// Ends it with a signal; gives its statistics.
    fn end(mut self, signal: &str) -> serde_json::Value {
        self.signal(signal);
        assert!(self.child.wait().unwrap().success());
        assert!(self.path("tty").symlink_metadata().is_err(), "a link is left");
        let names: Vec<_> = std::fs::read_dir(self.folder.path()).unwrap().collect();
        assert_eq!(names.len(), self.files, "nothing else is left: {names:?}");
        let text = std::fs::read_to_string(self.path("stats.json")).unwrap();
        serde_json::from_str(&text).unwrap()
    }
}

impl Drop for Mock {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// An open port, read with patience.
struct Port {
    file: File,
}

impl Port {
    fn open(path: &Path) -> Self {
        let no_ctty = rustix::fs::OFlags::NOCTTY.bits().cast_signed();
        let file = OpenOptions::new().read(true).write(true).custom_flags(no_ctty).open(path).unwrap();
        Self { file }
    }

    /// As a careful host does it: DTR stays up when the port is closed.
    fn clear_hupcl(&self) {
        let mut modes = rustix::termios::tcgetattr(&self.file).unwrap();
        modes.control_modes -= rustix::termios::ControlModes::HUPCL;
        rustix::termios::tcsetattr(&self.file, rustix::termios::OptionalActions::Now, &modes).unwrap();
    }

    fn send(&mut self, text: &str) {
        self.file.write_all(text.as_bytes()).unwrap();
    }

    /// Some bytes; none when the device is gone.
    fn read(&mut self) -> Vec<u8> {
        let mut fds = [PollFd::new(&self.file, PollFlags::IN)];
        let patience = PATIENCE.try_into().unwrap();
        let ready = poll(&mut fds, Some(&patience)).unwrap();
        assert!(ready > 0, "nothing came");
        // One byte at a time, so that nothing after the awaited words is lost.
        let mut byte = [0];
        match self.file.read(&mut byte) {
            Ok(1) => byte.to_vec(),
            _ => Vec::new(),
        }
    }

    /// Everything up to and with some words.
    fn until(&mut self, words: &str) -> String {
        let mut said = String::new();
        while !said.ends_with(words) {
            let bytes = self.read();
            assert!(!bytes.is_empty(), "gone before {words:?}, after {said:?}");
            said.extend(bytes.into_iter().map(char::from));
        }
        said
    }

    /// Reads until the device is gone.
    fn gone(&mut self) {
        while !self.read().is_empty() {}
    }
}

fn numbered(n: i64, command: &str) -> String {
    let text = format!("N{n} {command}");
    let sum = text.bytes().fold(0u8, |sum, b| sum ^ b);
    format!("{text}*{sum}\n")
}

#[test]
fn a_session_on_the_wire() {
    let mock = Mock::start(&["--baud", "0", "--advanced-ok", "--dtr-reset"], "");
    let mut port = mock.open();
    let boot = port.until("Loaded\n");
    assert!(boot.starts_with("start\n External Reset\nMarlin 2.1.2.1\n"), "{boot}");
    port.send("N0 M110 N0*125\n");
    assert_eq!(port.until("\n"), "ok N0 P15 B3\n");
    let good = [numbered(1, "G90"), numbered(2, "G1 X1 F6000")].concat();
    let bad = numbered(3, "G1 X2").replace("X2", "X7");
    port.send(&[good, bad, numbered(4, "G1 X3"), numbered(5, "G1 X4")].concat());
    assert_eq!(
        port.until("ok N2 P14 B3\n"),
        "Error:checksum mismatch, Last Line: 2\nResend: 3\nok\nok N1 P15 B2\nok N2 P14 B3\n"
    );
    port.send(&numbered(3, "M105"));
    let temperatures = port.until("\n");
    assert!(temperatures.starts_with("ok T:22.00 /0.00 B:22.00 /0.00"), "{temperatures}");
    let stats = mock.end("TERM");
    assert_eq!(stats["checksum_errors"], 1);
    assert_eq!(stats["moves"], 1);
    assert_eq!(stats["digest_lines"], 2);
}

#[test]
fn the_port_can_be_closed_and_opened_again() {
    let mock = Mock::start(&["--baud", "0"], "");
    let mut port = mock.open();
    // Without a reset by DTR a host that opens the port hears nothing.
    port.send("M105\nM104 S50\n");
    port.until("ok T:");
    port.until("ok\n");
    port.send("M105\n"); // its answer is not read
    drop(port);
    for _ in 0..3 {
        let mut port = mock.open();
        port.send("G90\nM105\n");
        let said = port.until(" /50.00 B:");
        assert!(said.contains("ok"), "{said}");
    }
    let stats = mock.end("INT");
    assert_eq!(stats["boots"], 1);
    assert_eq!(stats["nozzle_target_c"], 50.0);
}

#[test]
fn dtr_stays_up_over_a_port_that_is_closed_without_hupcl() {
    let mock = Mock::start(&["--baud", "0", "--dtr-reset", "--keeps-dtr"], "");
    // For the first time: reset. As a host leaves it that knows nothing of HUPCL: again.
    for _ in 0..2 {
        let mut port = mock.open();
        port.until("Loaded\n");
        port.send("M105\n");
        port.until("ok T:");
    }
    let mut port = mock.open();
    port.until("Loaded\n");
    port.clear_hupcl();
    port.send("M104 S50\n");
    port.until("ok\n");
    drop(port);
    let mut port = mock.open();
    port.send("M105\n");
    let said = port.until(" /50.00 B:");
    assert!(!said.contains("start"), "{said}");
    let stats = mock.end("TERM");
    assert_eq!((&stats["boots"], &stats["connects"]), (&4.into(), &4.into()));
}

#[test]
fn firmwares_with_names_a_record_and_a_part_that_is_taken_off() {
    let args =
        ["--baud", "0", "--personality", "repetier", "--extruders", "2", "--log", "log", "--speed", "100"];
    let mock = Mock::start(&args, "");
    let mut port = mock.open();
    let lines = ["M302 P1", "G28", "G1 X10 E1 F6000", "M400", "T1"];
    for (at, line) in lines.iter().enumerate() {
        port.send(&numbered(at as i64 + 1, line));
        port.until(&format!("ok {}\n", at + 1));
    }
    port.until("Active Extruder: 1\n");
    mock.signal("USR1");
    // It comes between two looks of the mock's own; the rest of the test is patience.
    let begun = Instant::now();
    for n in 6.. {
        assert!(begun.elapsed() < PATIENCE, "the part is still there");
        port.send(&numbered(n, "M400"));
        port.until(&format!("ok {n}\n"));
        let text = std::fs::read_to_string(mock.path("stats.json")).unwrap();
        let stats: serde_json::Value = serde_json::from_str(&text).unwrap();
        if stats["deposits"] == 1 && stats["part_top_mm"] == 0.0 {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    let log = std::fs::read_to_string(mock.path("log")).unwrap();
    let moved: Vec<_> = log.lines().filter(|l| l.contains("G1")).collect();
    assert_eq!(moved.len(), 1, "{log}");
    assert!(moved[0].ends_with(" 3 10.000 0.000 0.000 whole G1 X10 E1 F6000"), "{log}");
    mock.end("TERM");
}

#[test]
fn a_hang_up_takes_the_device_away_and_brings_it_back() {
    let fault = "[[fault]]\nat_line = 2\ndo = 'hang_up'\nfor_s = 0.2";
    let mock = Mock::start(&["--baud", "0"], fault);
    let mut port = mock.open();
    port.send(&numbered(1, "M105"));
    port.until("ok T:");
    port.send(&numbered(2, "G90"));
    port.gone();
    let link = mock.path("tty");
    // Another process makes the link: all that can be done is to look again.
    let begun = Instant::now();
    while !link.exists() {
        assert!(begun.elapsed() < PATIENCE, "the link did not come back");
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut port = mock.open();
    port.send(&numbered(3, "M105"));
    port.until("ok T:");
    mock.end("TERM");
}

#[test]
fn what_cannot_be_is_said_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let taken = folder.path().join("taken");
    std::fs::write(&taken, "mine").unwrap();
    let bad = folder.path().join("bad.toml");
    std::fs::write(&bad, "[random]\ndrop_okay = 1").unwrap();
    let none = folder.path().join("no/such");
    let check = |args: &[&str], code: i32, expect: &str| {
        let out = Command::new(env!("CARGO_BIN_EXE_outrigger")).arg("mock").args(args).output().unwrap();
        let said = String::from_utf8_lossy(&out.stderr).into_owned();
        assert_eq!(out.status.code(), Some(code), "{args:?}: {said}");
        assert!(said.contains(expect), "{args:?}: {said}");
    };
    let path = |p: &Path| p.to_str().unwrap().to_owned();
    check(&["--link", &path(&taken)], 1, "choose another name");
    assert_eq!(std::fs::read_to_string(&taken).unwrap(), "mine");
    check(&["--link", &path(&none)], 1, "no/such");
    check(&["--stats", &path(&none)], 1, "no/such");
    check(&["--faults", &path(&bad)], 1, "drop_okay");
    check(&["--faults", &path(&none)], 1, "no/such");
    check(&["--profile", "prusa-mk3"], 1, "did you mean prusa-mk3s?");
    check(&["--log", &path(&none)], 1, "no/such");
    check(&["--speed", "0"], 2, "0.01");
    check(&["--personality", "repetir"], 2, "did you mean repetier?");
    check(&["--keeps-dtr"], 2, "--dtr-reset");
    check(&["--rx-bytes", "1"], 2, "64");
}

#[test]
fn in_a_thread_of_this_process() {
    let config = mock::Config { baud: 0, ..mock::Config::default() };
    let handle = mock::spawn(mock::Options { config, ..mock::Options::default() }).unwrap();
    let path = handle.path().to_owned();
    let mut port = Port::open(&path);
    port.send("M115\n");
    port.until("\nok\n");
    assert!(handle.is_running());
    assert_eq!(handle.stats().lines_accepted, 1);
    assert_eq!(handle.stop().unwrap().lines_accepted, 1);
    assert!(!path.exists(), "the temporary link is left");
    port.gone();
}
