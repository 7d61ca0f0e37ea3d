//! `outrigger guard` through the real binary: a killed host's printer becomes cold, and
//! one that is taken up in time is left alone.
mod common;

use common::printer::{Mock, commands, digest, moves, output, signal, text, wait_for, wait_until};
use std::process::{Child, Command};

/// A job that heats first.
fn hot_job(count: u32) -> String {
    format!("M104 S60\nM140 S40\n{}", moves(count))
}

/// Prints with the guardian that it starts by itself, until the nozzle heats and moves
/// are made.
fn printing(mock: &Mock, job: &str, orphan_s: u32) -> Child {
    let profile = mock.profile(&format!("orphan_timeout_s = {orphan_s}"), "");
    let mut command = mock.outrigger();
    command.arg("print").arg(mock.job(job)).arg("--port").arg(mock.path("tty"));
    let mut child = command.arg("--profile").arg(profile).arg("--no-macros").spawn().unwrap();
    wait_until("a hot printer at work", || {
        assert!(child.try_wait().unwrap().is_none(), "the print has ended");
        let stats = mock.now();
        stats["nozzle_target_c"] == 60.0 && stats["moves"].as_u64() > Some(10)
    });
    child
}

fn kill(mut child: Child) {
    signal("KILL", &child);
    wait_for(&mut child);
}

/// Guardians of this mock's jobs that run now.
fn guardians(mock: &Mock) -> usize {
    let state = mock.path("state");
    let state = state.to_string_lossy();
    let list = Command::new("ps").args(["-eo", "stat,args"]).output().unwrap();
    let list = text(&list.stdout);
    list.lines().filter(|line| line.contains(" guard ") && line.contains(&*state)).count()
}

#[test]
fn a_killed_hosts_printer_is_made_cold_and_the_job_stays() {
    let mock = Mock::steady(&["--speed", "3"], "");
    let child = printing(&mock, &hot_job(2000), 2);
    assert_eq!(guardians(&mock), 1);
    kill(child);
    wait_until("cold heaters", || {
        let stats = mock.now();
        stats["nozzle_target_c"] == 0.0 && stats["bed_target_c"] == 0.0
    });
    wait_until("the guardian to end", || guardians(&mock) == 0);
    let record = mock.record(1);
    assert_eq!(record["state"], "interrupted", "{record}");
    assert_eq!(record["made_safe"], true, "{record}");
    assert!(record["note"].as_str().is_some_and(|note| note.contains("guardian")), "{record}");
}

#[test]
fn a_job_that_is_taken_up_in_time_is_left_alone() {
    let mock = Mock::steady(&["--speed", "3"], "");
    let job = hot_job(600);
    kill(printing(&mock, &job, 6));
    let out = output(mock.outrigger().args(["jobs", "resume", "1", "--no-macros"]));
    assert!(out.status.success(), "{}", text(&out.stderr));
    assert_eq!(mock.record(1)["state"], "finished");
    assert_eq!(mock.record(1)["note"], serde_json::Value::Null);
    wait_until("the guardians to end", || guardians(&mock) == 0);
    let stats = mock.stats();
    assert_eq!(stats["digest"], digest(commands(&job)), "{stats}");
    assert_eq!(stats["nozzle_target_c"], 60.0, "{stats}");
}

#[test]
fn it_survives_the_end_of_the_whole_group() {
    let mock = Mock::steady(&["--speed", "3"], "");
    let child = printing(&mock, &hot_job(2000), 1);
    // As a terminal or a supervisor ends all of a group: print is alone in none here, so its
    // guardian must have left the group that they shared.
    let group = |pid: &str| {
        let out = Command::new("ps").args(["-o", "pgid=", "-p", pid]).output().unwrap();
        text(&out.stdout).trim().to_owned()
    };
    let list = Command::new("ps").args(["-eo", "pid,args"]).output().unwrap();
    let state = mock.path("state").display().to_string();
    let list = text(&list.stdout);
    let guardian = list.lines().find(|line| line.contains(" guard ") && line.contains(&state)).unwrap();
    let pid = guardian.split_whitespace().next().unwrap();
    assert_ne!(group(pid), group(&child.id().to_string()));
    assert_eq!(group(pid), pid, "a session of its own");
    kill(child);
    wait_until("cold heaters", || mock.now()["nozzle_target_c"] == 0.0);
}

#[test]
fn wrong_usage_is_told() {
    let mock = Mock::steady(&[], "");
    assert_eq!(output(mock.outrigger().arg("guard")).status.code(), Some(2));
    let out = output(mock.outrigger().args(["guard", "--job", "7"]));
    assert_eq!(out.status.code(), Some(1));
    assert!(text(&out.stderr).contains("no job 7"), "{}", text(&out.stderr));
    // Nothing to guard: it ends at once.
    assert!(output(mock.outrigger().args(["guard", "--all"])).status.success());
}
