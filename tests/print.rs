//! `outrigger print` through the real binary, against the mock printer.
//!
//! The mock checks every number and checksum and digests what it accepted; the
//! digest that a whole job must give is computed here, from the file.
mod common;

use common::printer::{BINARY, Mock, commands, digest, moves, output, signal, text, wait_for, wait_until};
use std::fs;
use std::io::Read;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

/// Prints a job to the end and holds the mock's digest against the file's.
fn check_whole(options: &[&str], faults: &str, count: u32) -> (String, serde_json::Value) {
    let mock = Mock::with_faults(options, faults);
    let job = moves(count);
    let out = output(&mut mock.print(&mock.job(&job)));
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("printed"), "{}", text(&out.stdout));
    let stats = mock.stats();
    assert_eq!(stats["digest"], digest(commands(&job)), "{stats}");
    assert_eq!(stats["digest_lines"], u64::from(count) + 1);
    (text(&out.stderr), stats)
}

#[test]
fn a_job_runs_whole_and_in_order() {
    for options in [&["--speed", "1000"][..], &["--speed", "1000", "--advanced-ok"]] {
        let (_, stats) = check_whole(options, "", 2000);
        assert_eq!(stats["resends_asked"], 0);
        assert_eq!(stats["overflow_bytes"], 0);
    }
}

#[test]
fn a_noisy_wire_loses_nothing() {
    let faults = "
        [random]
        seed = 11
        corrupt_line = 0.02
        garble_reply = 0.002
        [[fault]]
        at_line = 20
        do = \"resend_without_ok\"
        [[fault]]
        at_line = 50
        do = \"corrupt_line\"
        byte = 0
        times = 3
        [[fault]]
        at_line = 100
        do = \"noise\"
        text = \"\\u0000ok?\"
        [[fault]]
        at_line = 150
        do = \"say\"
        text = \"echo:ok this is no ok\"
    ";
    let (_, stats) = check_whole(&["--speed", "1000"], faults, 600);
    assert!(stats["resends_asked"].as_u64() > Some(5), "{stats}");
}

#[test]
fn a_lost_ok_is_found_by_a_probe() {
    let faults = "[[fault]]\nat_line = 30\ndo = \"drop_ok\"\ntimes = 1\n".to_owned()
        + "[random]\nseed = 3\ndrop_ok = 0.01\n";
    let (said, stats) = check_whole(&["--speed", "1000"], &faults, 500);
    assert!(said.contains("asking again"), "{said}");
    assert_eq!(stats["repeats_dropped"], 0);
}

#[test]
fn a_reset_in_mid_job_is_told() {
    let mock = Mock::with_faults(&["--speed", "1000"], "[[fault]]\nat_line = 100\ndo = \"reset\"\n");
    let out = output(&mut mock.print(&mock.job(&moves(500))));
    assert_eq!(out.status.code(), Some(1));
    let said = text(&out.stderr);
    assert!(said.contains("was reset in mid-job"), "{said}");
}

#[test]
fn a_killed_firmware_is_told_in_its_own_words() {
    let mock = Mock::with_faults(
        &["--speed", "1000"],
        "[[fault]]\nat_line = 100\ndo = \"kill\"\ntext = \"Thermal Runaway, system stopped! Heater_ID: 0\"\n",
    );
    let out = output(&mut mock.print(&mock.job(&moves(500))));
    assert_eq!(out.status.code(), Some(1));
    let said = text(&out.stderr);
    assert!(said.contains("Thermal Runaway"), "{said}");
    assert!(said.contains("switched its heaters off"), "{said}");
}

#[test]
fn a_port_that_comes_back_costs_nothing() {
    let mock =
        Mock::steady(&["--speed", "1000"], "[[fault]]\nat_line = 100\ndo = \"hang_up\"\nfor_s = 2.0\n");
    let mut print = mock.outrigger();
    print.arg("print").arg(mock.job(&moves(500))).arg("--port").arg(mock.path("tty"));
    print.arg("--profile").arg(mock.profile("", "")).arg("--no-macros");
    let out = output(&mut print);
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    let stats = mock.stats();
    assert_eq!((&stats["executed"], &stats["lines_repeated"]), (&500.into(), &0.into()), "{stats}");
}

/// The board has lost its state meanwhile: nothing more is printed, and the program ends.
#[test]
fn a_port_that_comes_back_reset_ends_the_print() {
    let mock = Mock::with_faults(
        &["--speed", "1000"],
        "[[fault]]\nat_line = 100\ndo = \"hang_up\"\nfor_s = 1.0\nreset = true\n",
    );
    let out = output(&mut mock.print(&mock.job(&moves(500))));
    assert_eq!(out.status.code(), Some(1));
    let said = text(&out.stderr);
    assert!(said.contains("started anew"), "{said}");
    assert!(said.contains("outrigger jobs resume"), "{said}");
    let stats = mock.stats();
    assert!(stats["executed"].as_u64() < Some(110), "{stats}");
    assert_eq!(stats["heaters_on"], false);
}

/// Starts a job that heats and then waits, and sends signals once it is there.
fn interrupted(options: &[&str], job: &str, signals: &[&str]) -> (Output, serde_json::Value) {
    let mock = Mock::start(options);
    let mut child = mock.print(&mock.job(job)).spawn().unwrap();
    wait_until("the nozzle to heat", || mock.now()["nozzle_target_c"].as_f64() > Some(0.0));
    for name in signals {
        signal(name, &child);
        // Two signals of one kind at once are one; the first must be taken.
        let mut first = [0; 1];
        let _ = child.stderr.as_mut().map(|e| e.read(&mut first));
        std::thread::sleep(Duration::from_millis(200));
    }
    wait_for(&mut child);
    (child.wait_with_output().unwrap(), mock.stats())
}

fn check_cancel(signal: &str) {
    let job = format!("M104 S200\nM109 S200\n{}", moves(50));
    let (out, stats) = interrupted(&["--speed", "2"], &job, &[signal]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("cancelled"), "{said}");
    assert!(said.contains("heaters are off"), "{said}");
    assert_eq!(stats["nozzle_target_c"], 0.0);
    assert_eq!(stats["bed_target_c"], 0.0);
    // Nobody waited for the 200 °C.
    assert!(stats["nozzle_c"].as_f64() < Some(150.0), "{stats}");
}

#[test]
fn ctrl_c_ends_the_heating_and_switches_heaters_off() {
    check_cancel("INT");
}

#[test]
fn so_does_a_request_to_terminate() {
    check_cancel("TERM");
}

#[test]
fn so_does_the_end_of_the_terminal() {
    check_cancel("HUP");
}

#[test]
fn a_second_ctrl_c_quits_at_once_and_says_what_is_left_on() {
    let job = format!("M104 S200\nG4 S600\n{}", moves(50));
    let (out, stats) = interrupted(&["--speed", "2"], &job, &["INT", "INT"]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("STAY AS THEY ARE"), "{said}");
    assert_eq!(stats["nozzle_target_c"], 200.0);
}

/// What is refused before anything goes out.
#[test]
fn bad_files_are_refused_before_the_first_byte() {
    let mock = Mock::start(&[]);
    let check = |name: &str, content: &[u8], expect: &str| {
        let path = mock.path(name);
        fs::write(&path, content).unwrap();
        let out = output(&mut mock.print(&path));
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{said}");
        assert!(said.contains(expect) && said.contains(name), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
    };
    let long = format!("G28\nG1 X{}\n", "1".repeat(90));
    check("long.gcode", long.as_bytes(), "line 2 is 101 characters");
    check("a.bgcode", b"GCDE\x02\0\0\0\0\0", "version 2");
    check("a.gcode.gz", b"\x1f\x8b\x08\0\0\0", "gzip");
    check("a.bin", &[0xff; 1000], "binary data");
    check("empty.gcode", b"", "no command");
    check("escape\x1b[2J.gcode", b"", "");
    let out = output(&mut mock.print(mock.folder.path()));
    assert!(text(&out.stderr).contains("directory"));
    let out = output(&mut mock.print(&mock.path("nowhere.gcode")));
    assert!(text(&out.stderr).contains("nowhere.gcode"));
    let stats = mock.stats();
    assert_eq!(stats["lines_received"], 0, "{stats}");
}

#[test]
fn long_messages_are_shortened_and_printed() {
    let mock = Mock::start(&["--speed", "1000"]);
    let job = mock.job(&format!("M117 {}\nG28\n", "x".repeat(200)));
    let out = output(&mut mock.print(&job));
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stderr).contains("1 messages"));
    assert_eq!(mock.stats()["resends_asked"], 0);
}

#[test]
fn no_printer_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let job = folder.path().join("a.gcode");
    fs::write(&job, "G28\n").unwrap();
    let out = output(
        Command::new(BINARY)
            .env("OUTRIGGER_STATE", folder.path().join("state"))
            .arg("print")
            .arg(&job)
            .args(["--port", "/nowhere/tty"])
            .stderr(Stdio::piped())
            .stdout(Stdio::piped()),
    );
    assert_eq!(out.status.code(), Some(1));
    let said = text(&out.stderr);
    assert!(said.contains("cannot open /nowhere/tty at 115200 baud"), "{said}");
    assert!(said.contains("plugged in"), "{said}");
}

#[test]
fn the_port_mock_brings_its_own_printer() {
    let folder = tempfile::tempdir().unwrap();
    let job = folder.path().join("a.gcode");
    fs::write(&job, moves(200)).unwrap();
    let out = output(
        Command::new(BINARY)
            .env("OUTRIGGER_STATE", folder.path().join("state"))
            .arg("print")
            .arg(&job)
            .args(["--port", "mock", "--mock-speed", "1000"])
            .stderr(Stdio::piped())
            .stdout(Stdio::piped()),
    );
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert!(text(&out.stdout).contains("201 commands"));
}
