//! `outrigger jobs resume` through the real binary: the host is killed, the printer is
//! a mock in a process of its own.
mod common;

use common::printer::{Mock, commands, digest, moves, output, text, wait_until};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// A print on a board that keeps its state when the port is opened.
fn print(mock: &Mock, job: &Path, profile: &Path) -> Command {
    let mut command = mock.outrigger();
    command.arg("print").arg(job).arg("--port").arg(mock.path("tty"));
    command.arg("--profile").arg(profile).args(["--no-macros", "--no-guard"]);
    command
}

fn resume(mock: &Mock) -> Command {
    let mut command = mock.outrigger();
    command.args(["jobs", "resume", "1", "--no-macros", "--no-guard", "--verbose"]);
    command
}

/// Prints until the mock has executed `moves` of the moves, then kills the host as a
/// crash would.
fn killed(mock: &Mock, mut command: Command, moves: u64) {
    let mut child = command.spawn().unwrap();
    wait_until("some moves", || {
        assert!(child.try_wait().unwrap().is_none(), "the print has ended");
        mock.now()["moves"].as_u64() > Some(moves)
    });
    child.kill().unwrap();
    child.wait().unwrap();
}

fn jobs_file(mock: &Mock, count: u32) -> (PathBuf, String) {
    let job = moves(count);
    (mock.job(&job), job)
}

fn check_ended(out: &Output) {
    assert!(out.status.success(), "{}", text(&out.stderr));
}

#[test]
fn a_killed_hosts_job_goes_on_and_every_line_is_executed_once() {
    let mock = Mock::steady(&["--speed", "3"], "");
    let profile = mock.profile("", "");
    let (path, job) = jobs_file(&mock, 500);
    killed(&mock, print(&mock, &path, &profile), 50);
    let record = mock.record(1);
    assert_eq!((&record["live"], &record["state"]), (&false.into(), &"printing".into()), "{record}");
    let out = output(&mut resume(&mock));
    check_ended(&out);
    assert!(text(&out.stderr).contains("kept its state"), "{}", text(&out.stderr));
    assert_eq!(mock.record(1)["state"], "finished");
    let stats = mock.stats();
    assert_eq!(stats["digest"], digest(commands(&job)), "{stats}");
    assert_eq!((&stats["lines_repeated"], &stats["lines_lost"]), (&0.into(), &0.into()), "{stats}");
}

#[test]
fn nothing_is_printed_over_the_part_of_another_job() {
    let mock = Mock::steady(&["--speed", "3"], "");
    let profile = mock.profile("", "");
    let (path, _) = jobs_file(&mock, 500);
    killed(&mock, print(&mock, &path, &profile), 20);
    let before = mock.now()["lines_accepted"].as_u64();
    let out = output(&mut print(&mock, &path, &profile));
    assert_eq!(out.status.code(), Some(1));
    let said = text(&out.stderr);
    assert!(said.contains("outrigger jobs resume 1") && said.contains("forget 1"), "{said}");
    assert!(mock.now()["lines_accepted"].as_u64() <= before.map(|n| n + 60), "nothing was sent");
    // A person's word, and it is another job; the old one is given up.
    fs::write(&path, "G28\nG1 X10 F9000\n").unwrap();
    check_ended(&output(print(&mock, &path, &profile).arg("--part-removed")));
    assert_eq!(
        (&mock.record(1)["state"], &mock.record(2)["state"]),
        (&"cancelled".into(), &"finished".into())
    );
    let out = output(&mut resume(&mock));
    assert_eq!(out.status.code(), Some(1));
    assert!(text(&out.stderr).contains("nothing to resume"), "{}", text(&out.stderr));
}

#[test]
fn a_changed_file_is_not_resumed() {
    let mock = Mock::steady(&["--speed", "3"], "");
    let profile = mock.profile("", "");
    let (path, job) = jobs_file(&mock, 500);
    killed(&mock, print(&mock, &path, &profile), 20);
    let accepted = mock.now()["lines_accepted"].clone();
    fs::write(&path, job.replacen("G1 X16", "G1 X17", 1)).unwrap();
    let out = output(&mut resume(&mock));
    assert_eq!(out.status.code(), Some(1));
    assert!(text(&out.stderr).contains("was changed"), "{}", text(&out.stderr));
    assert_eq!(mock.record(1)["state"], "printing");
    drop(accepted);
    // The same bytes again, as another file: that is the job.
    fs::write(&path, &job).unwrap();
    check_ended(&output(&mut resume(&mock)));
    assert_eq!(mock.stats()["digest"], digest(commands(&job)));
}

#[test]
fn what_is_not_to_be_resumed_is_told() {
    let mock = Mock::steady(&["--speed", "1000"], "");
    let profile = mock.profile("", "");
    let check = |expect: &str| {
        let out = output(&mut resume(&mock));
        assert_eq!(out.status.code(), Some(1));
        let said = text(&out.stderr);
        assert!(said.contains(expect), "{said}");
    };
    check("no job 1");
    check_ended(&output(&mut print(&mock, &mock.job("G28\n"), &profile)));
    check("job 1 is finished");
}
