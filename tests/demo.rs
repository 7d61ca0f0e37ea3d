//! `outrigger demo` through the real binary: no terminal, no hardware.
mod common;

use common::{command, corpus, names, outrigger, same_deposits};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// So fast that the mock's boot and the check take most of the time.
const FAST: [&str; 2] = ["--speed", "4000"];

/// The only thing of a kind in a folder of the daemon's data.
fn only(folder: &Path) -> PathBuf {
    let all = names(folder);
    assert_eq!(all.len(), 1, "{folder:?}: {all:?}");
    folder.join(&all[0])
}

#[test]
fn the_demo_ends_well_and_leaves_its_files() {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join("new/folder");
    let run = outrigger(folder.path(), ["demo", "--dir", "new/folder"].iter().chain(&FAST));
    run.ends(0);
    assert!(run.stdout.contains("1 island and 1 overhang "), "{run:?}");
    assert!(run.stdout.contains("a piece begins in the air"), "{run:?}");
    let job = only(&dir.join("queue"));
    let mended = std::fs::read(job.join("mended")).unwrap();
    assert!(mended.len() > corpus("lamp.gcode").len(), "with supports");
    assert_eq!(std::fs::read(only(&dir.join("files")).join("content")).unwrap(), corpus("lamp.gcode"));
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
    assert!(run.stdout.contains(&format!("{} of the job", commands(&mended))), "{run:?}");
    for line in run.stdout.lines() {
        assert!(line.chars().count() < 80 || line.contains('/'), "{line}");
    }
    // Once more over the same data, over a perfect cable.
    let run = outrigger(folder.path(), ["demo", "--dir", "new/folder", "--no-faults"].iter().chain(&FAST));
    run.ends(0);
    assert_eq!(names(&dir.join("files")).len(), 2);
}

#[test]
fn a_resin_job_is_mended_printed_and_measured() {
    let folder = tempfile::tempdir().unwrap();
    let run = outrigger(folder.path(), ["demo", "--resin", "--dir", "here", "--speed", "100"]);
    run.ends(0);
    assert!(run.stdout.contains("an island: layer 28, 2.9 mm up, at X 20.0 Y 8.0"), "{run:?}");
    assert!(run.stdout.contains("no island is left"), "{run:?}");
    assert!(run.stdout.contains("mended.sl1: printed"), "{run:?}");
    let row = |name: &str| {
        let line = run.stdout.lines().find(|l| l.trim_start().starts_with(name));
        line.unwrap_or_else(|| panic!("no {name} in {run:?}")).split_once(name).unwrap().1.trim().to_owned()
    };
    assert_eq!(row("exposures"), "40 of 40");
    assert_eq!(row("missing, too many"), "0, 0");
    assert!(row("out of order").starts_with("0 "), "{run:?}");
    assert!(row("changed in light").starts_with("0 "), "{run:?}");
    assert!(row("light off by").starts_with("0."), "{run:?}");
    for line in run.stdout.lines() {
        assert!(line.chars().count() < 80 || line.contains("here"), "{line}");
    }
    // What it leaves can be looked at and printed again.
    let here = folder.path().join("here");
    for name in ["lamp.sl1", "mended.sl1", "printer.toml", "layers.html", "found.json", "grown.json"] {
        assert!(here.join(name).is_file(), "{name} of {:?}", names(&here));
    }
    outrigger(&here, ["check", "mended.sl1", "--fail-on", "islands"]).ends(0);
    outrigger(&here, ["profile", "check", "printer.toml"]).ends(0);
}

#[test]
fn ctrl_c_cancels_the_resin_print_and_leaves_no_printer() {
    let folder = tempfile::tempdir().unwrap();
    let mut child = command(folder.path())
        .env("TMPDIR", folder.path())
        .args(["demo", "--resin", "--dir", "here", "--speed", "10"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    assert!(said.any(|line| line.contains("connected to")));
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let rest: Vec<_> = said.collect();
    assert_eq!(child.wait().unwrap().code(), Some(1), "{rest:?}");
    assert!(rest.iter().any(|line| line.contains("mended.sl1: cancelled")), "{rest:?}");
    assert_eq!(names(folder.path()), ["here"]);
}

#[test]
fn what_is_reordered_prints_the_same() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("demo.gcode"), corpus("demo.gcode")).unwrap();
    outrigger(folder.path(), ["post", "demo.gcode", "-o", "out.gcode"]).ends(0);
    same_deposits("demo", &corpus("demo.gcode"), &std::fs::read(folder.path().join("out.gcode")).unwrap());
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
    assert!(String::from_utf8_lossy(&output.stdout).contains(&made[0]));
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
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
    assert!(said.any(|line| line.contains("4. It is printed")));
    // It is getting ready, or heating for a minute, at life's speed.
    let kill = Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    let output = child.wait_with_output().unwrap();
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{words}");
    assert!(words.contains("cancelled") && words.contains("heaters are off"), "{words}");
    // The mock's terminal link was in the temporary folder.
    assert_eq!(names(folder.path()), ["here"]);
}
