//! `outrigger demo` through the real binary: no terminal, no hardware.
mod common;

use common::{command, corpus, names, outrigger, same_deposits};
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

/// So fast that the mock's boot takes most of the time.
const FAST: [&str; 2] = ["--speed", "4000"];

const FILES: [&str; 5] =
    ["demo-layer.svg", "demo-layers.html", "demo-reordered.gcode", "demo-report.json", "demo.gcode"];

#[test]
fn the_demo_ends_well_and_leaves_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("new/folder");
    let run = outrigger(folder.path(), ["demo", "--dir", "new/folder"].iter().chain(&FAST));
    run.ends(0);
    assert_eq!(names(&dir), FILES);
    let read = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert_eq!(read("demo.gcode"), corpus("demo.gcode"));
    same_deposits("demo", &read("demo.gcode"), &read("demo-reordered.gcode"));
    let report: serde_json::Value = serde_json::from_slice(&read("demo-report.json")).unwrap();
    assert!(report["retractions_after"].as_u64() < report["retractions_before"].as_u64(), "{report}");
    assert!(String::from_utf8(read("demo-layer.svg")).unwrap().starts_with("<svg "));
    assert!(run.stdout.contains("24 layers: no islands, no overhangs"), "{run:?}");
    assert!(String::from_utf8(read("demo-layers.html")).unwrap().contains("demo-reordered.gcode"));
    // The table of what arrived: three faults, and nothing lost by them.
    let row = |name: &str| {
        let line = run.stdout.lines().find(|l| l.trim_start().starts_with(name));
        line.unwrap_or_else(|| panic!("no {name} in {run:?}"))[18..]
            .split_whitespace()
            .next()
            .unwrap()
            .to_owned()
    };
    assert_eq!(["lost", "repeated"].map(row), ["0", "0"]);
    // Or more: what follows a damaged line may be cut where the firmware begins to listen again.
    let at_least = |name| row(name).parse::<u64>().unwrap() >= 3;
    assert!(at_least("damaged") && at_least("asked again"), "{run:?}");
    let commands = commands(&read("demo-reordered.gcode"));
    assert!(run.stdout.contains(&format!("printed, {commands} commands")), "{run:?}");
    assert!(run.stdout.contains(&format!("{commands} of the job")), "{run:?}");
    for line in run.stdout.lines() {
        assert!(line.chars().count() < 80 || line.contains('/'), "{line}");
    }
    // Once more over the same files, over a perfect cable.
    let run = outrigger(folder.path(), ["demo", "--dir", "new/folder", "--no-faults"].iter().chain(&FAST));
    run.ends(0);
    assert!(run.stdout.contains(", 0 resends"), "{run:?}");
    assert_eq!(names(&dir), FILES);
}

fn commands(job: &[u8]) -> usize {
    let job = String::from_utf8_lossy(job);
    job.lines().filter(|line| !line.split(';').next().unwrap_or_default().trim().is_empty()).count()
}

#[test]
fn without_a_folder_it_makes_one_that_stays() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = command(folder.path());
    let output = child.env("TMPDIR", folder.path()).arg("demo").args(FAST).output().unwrap();
    assert!(output.status.success(), "{output:?}");
    let made = names(folder.path());
    assert!(made.len() == 1 && made[0].starts_with("outrigger-demo-"), "{made:?}");
    assert_eq!(names(&folder.path().join(&made[0])), FILES);
    assert!(String::from_utf8_lossy(&output.stdout).contains(&made[0]));
}

#[test]
fn it_overwrites_no_job_of_the_users() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("demo.gcode"), "G28\n").unwrap();
    outrigger(folder.path(), ["demo", "--dir", "."]).ends(1).says("is another job").says("--dir");
    assert_eq!(names(folder.path()), ["demo.gcode"]);
    assert_eq!(std::fs::read(folder.path().join("demo.gcode")).unwrap(), b"G28\n");
}

#[test]
fn a_folder_that_cannot_be_made_is_told() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("file"), "").unwrap();
    outrigger(folder.path(), ["demo", "--dir", "file/below"]).ends(1).says("cannot make file/below");
}

#[test]
fn ctrl_c_cancels_the_print_and_leaves_no_printer() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = command(folder.path())
        .env("TMPDIR", folder.path())
        .args(["demo", "--dir", "here", "--speed", "1"])
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    assert!(said.any(|line| line.contains("connected to")));
    // Its first lines go out once that is written down; then it is heating for a minute, at life's speed.
    std::thread::sleep(Duration::from_secs(1));
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let rest: Vec<String> = said.collect();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{rest:?}");
    assert!(rest.iter().any(|l| l.contains("cancelled") && l.contains("heaters are off")), "{rest:?}");
    // The mock's terminal link was in the temporary folder.
    assert_eq!(names(folder.path()), ["here"]);
    assert_eq!(names(&folder.path().join("here")), FILES);
}
