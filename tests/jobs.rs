//! `outrigger jobs` through the real binary: what was written down is told, and
//! forgotten only where somebody means it.
use outrigger::job::disk::{JobId, Store};
use outrigger::job::record::{Accepted, Checkpoint, Record};
use outrigger::job::state::State;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn run(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger"))
        .arg("jobs")
        .args(args)
        .env("OUTRIGGER_STATE", folder)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

/// Exit code, and words on standard output and on standard error.
fn check(folder: &Path, args: &[&str], code: i32, out: &[&str], err: &str) -> String {
    let found = run(folder, args);
    let said = String::from_utf8(found.stdout).unwrap();
    let complained = String::from_utf8(found.stderr).unwrap();
    assert_eq!(found.status.code(), Some(code), "{args:?}: {complained}");
    for words in out {
        assert!(said.contains(words), "{args:?}: {words} is not in: {said}");
    }
    assert!(complained.contains(err), "{args:?}: {complained}");
    assert!(err.is_empty() == complained.is_empty(), "{args:?}: {complained}");
    said
}

fn accepted(path: &str) -> Accepted {
    Accepted {
        path: PathBuf::from(path),
        digest: [0xab; 32],
        bytes: 4000,
        commands: 1000,
        last_line: 1500,
        profile: "ender-3".to_owned(),
        at_unix_s: 1_795_349_100,
        ..Accepted::default()
    }
}

/// A job that came as far as `states`, 347 commands of it acknowledged.
fn job(store: &Store, path: &str, states: &[State]) -> JobId {
    let mut held = store.accept(&accepted(path)).unwrap();
    if let Some((first, rest)) = states.split_first() {
        let opened = Record::Opened { port: "usb:1A2B".to_owned(), baud: 250_000, at_unix_s: 1_795_349_160 };
        let checkpoint = Checkpoint {
            commands: 347,
            line: 512,
            layer: 17,
            z_mm: 3.4,
            nozzle_c: [209.7, 210.0],
            bed_c: [60.0, 60.0],
        };
        let mut records = vec![opened, Record::State(*first), Record::Checkpoint(checkpoint)];
        records.extend(rest.iter().map(|state| Record::State(*state)));
        records.iter().for_each(|record| held.journal.append(record));
        held.journal.sync().unwrap();
    }
    held.id
}

fn store() -> (tempfile::TempDir, Store) {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path()).unwrap();
    (folder, store)
}

#[test]
fn no_jobs() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none");
    check(&none, &["list"], 0, &["there are no jobs"], "");
    check(&none, &["list", "--json"], 0, &["\"jobs\": []"], "");
    check(&none, &["show", "3"], 1, &[], "there is no job 3");
    check(&none, &["forget", "3"], 1, &[], "there is no job 3");
    assert!(!none.exists(), "to look on makes no folder");
    check(&none, &["show", "three"], 2, &[], "invalid value");
    // The option is before the variable.
    let other = folder.path().join("other");
    Store::open(&other).unwrap().accept(&accepted("/x.gcode")).unwrap();
    check(&none, &["list", "--state", other.to_str().unwrap()], 0, &["x.gcode"], "");
}

#[test]
fn jobs_are_listed() {
    let (folder, store) = store();
    job(&store, "/jobs/benchy.gcode", &[State::Printing, State::Finished]);
    job(&store, "/jobs/vase.gcode", &[State::Printing]);
    job(&store, "/jobs/evil\x1b[2J\n.gcode", &[]);
    job(&store, "/jobs/damaged.gcode", &[State::Printing]);
    let live = job(&store, "/jobs/now.gcode", &[State::Printing]);
    let _held = store.hold_job(live).unwrap();
    std::fs::write(folder.path().join("jobs/4.journal"), "noise").unwrap();
    let said = check(folder.path(), &["list"], 0, &[], "");
    let lines: Vec<&str> = said.lines().collect();
    let line = |n: usize, words: &[&str]| {
        for word in words {
            assert!(lines[n].contains(word), "{word} is not in {}", lines[n]);
        }
    };
    assert_eq!(lines.len(), 6, "{said}");
    line(0, &["id", "state", "done", "layer", "port", "file"]);
    line(1, &[" 1  finished", "100 %", "17", "usb:1A2B", "benchy.gcode"]);
    line(2, &[" 2  broken off (printing)", "34 %", "vase.gcode"]);
    line(3, &[" 3  waiting to be printed", "0 %", "evil\\u{1b}[2J\\u{a}.gcode"]);
    line(4, &[" 4  unreadable", "no journal of Outrigger"]);
    line(5, &[" 5  printing", "34 %", "now.gcode"]);
    assert!(!said.contains('\x1b'));
}

#[test]
fn the_fields_of_json_are_those_of_the_help() {
    let (folder, store) = store();
    let id = job(&store, "/jobs/vase.gcode", &[State::Printing]);
    let said = check(folder.path(), &["show", "1", "--json"], 0, &[], "");
    let found: serde_json::Value = serde_json::from_str(&said).unwrap();
    let expect = serde_json::json!({
        "id": id, "live": false, "state": "printing", "state_text": "broken off (printing)",
        "next": ["resume", "forget"], "file": "/jobs/vase.gcode", "profile": "ender-3",
        "bytes": 4000, "sha256": "ab".repeat(32), "commands": 1000,
        "accepted_unix_s": 1_795_349_100, "starts": 1, "port": "usb:1A2B", "baud": 250_000,
        "opened_unix_s": 1_795_349_160, "commands_done": 347, "percent": 34.7, "line": 512,
        "layer": 17, "z_mm": 3.4, "nozzle_c": 209.7_f32, "nozzle_target_c": 210.0,
        "bed_c": 60.0, "bed_target_c": 60.0, "made_safe": false, "made_safe_z_mm": null,
        "note": null, "damaged": false, "lost_bytes": 0,
    });
    for (field, value) in expect.as_object().unwrap() {
        let near =
            |a: &serde_json::Value| a.as_f64().zip(value.as_f64()).is_some_and(|(a, b)| (a - b).abs() < 1e-4);
        assert!(&found[field] == value || near(&found[field]), "{field}: {} is not {value}", found[field]);
    }
    assert_eq!(found.as_object().unwrap().len(), expect.as_object().unwrap().len(), "{said}");
    let help = String::from_utf8(run(folder.path(), &["show", "--help"]).stdout).unwrap();
    for field in expect.as_object().unwrap().keys() {
        assert!(help.contains(&format!("`{field}`")), "{field} is not in the help");
    }
    let list = check(folder.path(), &["list", "--json"], 0, &[], "");
    let list: serde_json::Value = serde_json::from_str(&list).unwrap();
    assert_eq!(list["jobs"][0], found);
    std::fs::write(folder.path().join("jobs/1.journal"), "noise").unwrap();
    check(folder.path(), &["show", "1", "--json"], 0, &["\"error\"", "\"live\": false"], "");
}

#[test]
fn a_job_is_shown_in_plain_words() {
    let (folder, store) = store();
    let show = |id: JobId, out: &[&str]| check(folder.path(), &["show", &id.to_string()], 0, out, "");
    let orphan = job(&store, "/jobs/vase.gcode", &[State::Printing]);
    let words = [
        "job 1\n",
        "broken off (printing)",
        "/jobs/vase.gcode",
        "2026-11-22 12:05 UTC",
        "usb:1A2B at 250000 baud",
        "34 %: 347 commands, to line 512 of the file, layer 17, Z 3.40 mm",
        "nozzle 210 of 210 °C, bed 60 of 60 °C",
        "HEATERS MAY BE ON",
        "`outrigger jobs resume 1`",
        "`outrigger jobs forget 1 --yes`",
    ];
    show(orphan, &words);
    let held = store.hold_job(orphan).unwrap();
    let said = show(orphan, &["An outrigger is at work on it now"]);
    assert!(!said.contains("resume") && !said.contains("HEATERS"), "{said}");
    drop(held);
    let waits = job(&store, "/jobs/next.gcode", &[]);
    show(waits, &["waiting to be printed", "`outrigger print`", "`outrigger jobs forget 2`"]);
    let over = job(&store, "/jobs/done.gcode", &[State::Printing, State::Finished]);
    let said = show(over, &["finished", "`outrigger jobs forget 3`"]);
    assert!(!said.contains("--yes") && !said.contains("resume"), "{said}");
    let mut held = store.hold_job(orphan).unwrap();
    held.journal.append(&Record::Note("\x1b[31mthe cable".to_owned()));
    held.journal.append(&Record::MadeSafe { z_mm: Some(13.4) });
    held.journal.append(&Record::State(State::Interrupted));
    held.journal.sync().unwrap();
    drop(held);
    let said =
        show(orphan, &["Z 13.40 mm", "\\u{1b}[31mthe cable", "with the part on the bed", "jobs resume 1"]);
    assert!(!said.contains("HEATERS"), "{said}");
}

#[test]
fn damage_is_told() {
    let (folder, store) = store();
    job(&store, "/jobs/vase.gcode", &[State::Printing]);
    let path = folder.path().join("jobs/1.journal");
    let mut held = store.hold_job(1).unwrap();
    for commands in [400, 500] {
        held.journal.append(&Record::Checkpoint(Checkpoint { commands, ..Checkpoint::default() }));
        held.journal.sync().unwrap();
    }
    drop(held);
    let good = std::fs::read(&path).unwrap();
    let end = good.iter().rposition(|byte| *byte != 0).unwrap();
    // The last batch is torn; one before it is damaged; the first page is.
    let mut bytes = good.clone();
    bytes[end - 20..].fill(0);
    std::fs::write(&path, &bytes).unwrap();
    check(folder.path(), &["show", "1"], 0, &["400 commands", "were being written when the power went"], "");
    let mut bytes = good.clone();
    bytes[4100] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    check(folder.path(), &["show", "1"], 0, &["damaged in their middle"], "");
    let mut bytes = good;
    bytes[100] ^= 1;
    std::fs::write(&path, &bytes).unwrap();
    check(folder.path(), &["show", "1"], 1, &[], "first record is damaged");
    check(folder.path(), &["forget", "1"], 1, &[], "--yes");
    assert!(path.exists(), "never dropped without a word");
    check(folder.path(), &["forget", "1", "--yes"], 0, &["job 1 is forgotten"], "");
}

#[test]
fn forgetting_asks() {
    let (folder, store) = store();
    job(&store, "/jobs/done.gcode", &[State::Printing, State::Finished]);
    job(&store, "/jobs/vase.gcode", &[State::Printing]);
    let live = job(&store, "/jobs/now.gcode", &[State::Printing]);
    let held = store.hold_job(live).unwrap();
    // Nobody is there to be asked.
    check(folder.path(), &["forget", "1"], 1, &[], "--yes");
    check(folder.path(), &["forget", "2"], 1, &[], "broken off and can perhaps be resumed");
    check(folder.path(), &["forget", "3", "--yes"], 1, &[], "is being printed by another outrigger");
    assert_eq!(store.list().unwrap().len(), 3);
    check(folder.path(), &["forget", "1", "--yes"], 0, &["job 1 is forgotten"], "");
    check(folder.path(), &["forget", "2", "--yes"], 0, &["job 2 is forgotten"], "");
    drop(held);
    check(folder.path(), &["forget", "3", "--yes"], 0, &["job 3 is forgotten"], "");
    check(folder.path(), &["forget", "3", "--yes"], 1, &[], "there is no job 3");
    assert!(store.list().unwrap().is_empty());
}
