//! `outrigger post` with resin jobs, through the real binary.
//!
//! The bytes of a GOO file are looked at by their offsets; the same job is checked in
//! every format, and must give the same findings.
mod common;

use common::made::{archive, png};
use common::{folder_of, folder_with, names, outrigger, outrigger_after};
use outrigger::resin;
use serde_json::Value;
use std::fs;
use std::io::Cursor;
use std::path::Path;

const CONFIG: &str = "jobDir = a\nlayerHeight = 0.05\nexpTime = 5\nexpTimeFirst = 30\nnumFade = 2\nnumFast = 4\nnumSlow = 0\nprinterModel = SL1\n";
const SETTINGS: &str = "display_width = 8\ndisplay_height = 4\ndisplay_pixels_x = 80\ndisplay_pixels_y = 40\ndisplay_orientation = landscape\ndisplay_mirror_x = 1\ndisplay_mirror_y = 0\n";

/// An SL1 job with a body and an island of 4 × 5 px in layer 2.
fn sl1() -> Vec<u8> {
    let (body, island) = ([10, 10, 40, 30], [60, 10, 64, 15]);
    let pictures = [
        png([80, 40], &[body]),
        png([80, 40], &[body]),
        png([80, 40], &[body, island]),
        png([80, 40], &[[10, 10, 64, 30]]),
    ];
    let mut entries = vec![
        ("config.ini".to_owned(), CONFIG.as_bytes().to_vec()),
        ("prusaslicer.ini".to_owned(), SETTINGS.as_bytes().to_vec()),
        ("of another program".to_owned(), b"?".to_vec()),
    ];
    entries.extend(pictures.into_iter().enumerate().map(|(n, picture)| (format!("a{n:05}.png"), picture)));
    archive(&entries)
}

fn folder() -> tempfile::TempDir {
    folder_of("job.sl1", &sl1())
}

fn json(folder: &Path, args: &[&str]) -> Value {
    serde_json::from_str(&outrigger(folder, args).ends(0).stdout).expect("JSON")
}

#[test]
fn a_job_is_the_same_in_every_format() {
    let folder = folder();
    let check = |file: &str| {
        let mut report = json(folder.path(), &["check", "-q", "--json", "-", file]);
        for key in ["file", "kind", "seconds", "bbox_mm"] {
            report.as_object_mut().expect("an object").remove(key);
        }
        // Mirrored alike, the part lies where it lay.
        report
    };
    let expect = check("job.sl1");
    assert_eq!(expect["islands"].as_array().map(Vec::len), Some(1));
    for (from, to) in [
        ("job.sl1", "a.goo"),
        ("a.goo", "b.nanodlp"),
        ("b.nanodlp", "c.goo"),
        ("c.goo", "d.SL1S"),
        ("d.SL1S", "e.nanodlp"),
        ("e.nanodlp", "f.sl1"),
    ] {
        let run = outrigger(folder.path(), ["post", from, "-o", to]);
        assert!(run.ends(0).stdout.starts_with("4 layers from "), "{run:?}");
        let found = check(to);
        assert_eq!(found["layers"], expect["layers"], "{to}");
        let island = |report: &Value| {
            let island = &report["islands"][0];
            let number = |key: &str| (island[key].as_f64().expect("a number") * 1e4).round();
            let at = |i: usize| (island["centroid_mm"][i].as_f64().expect("a number") * 1e4).round();
            (island["layer"].clone(), number("area_mm2"), number("z_mm"), [at(0), at(1)])
        };
        assert_eq!(island(&found), island(&expect), "{to}");
    }
}

#[test]
fn what_was_done_is_told() {
    let folder = folder();
    let run = outrigger(folder.path(), ["post", "job.sl1", "-o", "job.goo", "--report", "-"]);
    let report: Value = serde_json::from_str(&run.ends(0).stdout).expect("JSON");
    assert_eq!((&report["kind"], &report["kind_out"]), (&"sl1".into(), &"goo".into()));
    assert_eq!((&report["layers"], &report["layers_changed"]), (&4.into(), &0.into()));
    assert_eq!(report["unchanged_reason"], Value::Null);
    let notes: Vec<&str> =
        report["notes"].as_array().expect("a list").iter().filter_map(Value::as_str).collect();
    assert!(notes[0].contains("\"of another program\""), "{notes:?}");
    for note in notes {
        run.says(&format!("Note: {note}"));
    }
    let goo = fs::read(folder.path().join("job.goo")).expect("the file");
    assert_eq!(goo[..12], *b"V3.0\x07\0\0\0DLP\0");
    assert_eq!(goo[195_310..195_320], [0, 0, 0, 4, 0, 80, 0, 40, 1, 0]);
    assert!(goo.ends_with(b"\0\0\0\x07\0\0\0DLP\0"));
    outrigger(folder.path(), ["post", "job.sl1", "-o", "again.goo"]).ends(0);
    assert!(fs::read(folder.path().join("again.goo")).expect("the file") == goo, "the same bytes");
    let quiet = outrigger(folder.path(), ["post", "-q", "job.sl1", "-o", "again.goo"]);
    assert_eq!((quiet.stdout.as_str(), quiet.stderr.as_str()), ("", ""));
}

#[test]
fn in_its_own_format_a_job_is_copied() {
    let folder = folder();
    outrigger(folder.path(), ["post", "job.sl1", "-o", "copy.sl1s"]).ends(0);
    assert!(fs::read(folder.path().join("copy.sl1s")).expect("the copy") == sl1());
    // Onto itself too.
    outrigger(folder.path(), ["post", "job.sl1", "-o", "job.sl1"]).ends(0);
    assert!(fs::read(folder.path().join("job.sl1")).expect("the job") == sl1());
    assert_eq!(names(folder.path()), ["copy.sl1s", "job.sl1"]);
}

#[test]
fn without_an_output_the_file_stays() {
    let folder = folder();
    let run = outrigger(folder.path(), ["post", "job.sl1", "--report", "report.json"]);
    run.ends(0).says("job.sl1: left as it was: there is nothing to do");
    assert!(fs::read(folder.path().join("job.sl1")).expect("the job") == sl1());
    let report = fs::read(folder.path().join("report.json")).expect("the report");
    let report: Value = serde_json::from_slice(&report).expect("JSON");
    assert!(report["unchanged_reason"].as_str().is_some_and(|why| why.contains(".goo")), "{report}");
    // A zip that is no job, and a job that is damaged.
    fs::write(folder.path().join("bad.sl1"), &sl1()[..500]).expect("written");
    outrigger(folder.path(), ["post", "bad.sl1"]).ends(0).says("left as it was").says("cut off");
    assert_eq!(names(folder.path()), ["bad.sl1", "job.sl1", "report.json"]);
}

#[test]
fn what_cannot_be_done_leaves_nothing_behind() {
    let folder = folder();
    let path = folder.path();
    fs::write(path.join("bad.goo"), b"V3.0\x07\0\0\0DLP\0").expect("written");
    fs::write(path.join("new.goo"), b"V5.1\x07\0\0\0DLP\0").expect("written");
    let before = names(path);
    let fails = |args: &[&str], code: i32, words: &str| {
        outrigger(path, [&["post"], args].concat()).ends(code).says(words);
        assert_eq!(names(path), before, "{args:?}");
    };
    fails(&["bad.goo", "-o", "out.sl1"], 1, "cut off");
    fails(&["new.goo", "-o", "out.sl1"], 1, "version");
    fails(&["job.sl1", "-o", "out.zip"], 2, "must end in .sl1");
    fails(&["job.sl1", "-o", "out"], 2, "must end in .sl1");
    fails(&["job.sl1", "-o", "no/such/folder.goo"], 1, "no/such");
    fails(&["job.sl1", "-o", "out.goo", "--first-layer"], 2, "--first-layer is for G-code");
    fails(
        &["job.sl1", "-o", "out.goo", "--picture", "p.svg"],
        2,
        "--picture without --supports is for G-code",
    );
    let (gcode, _) = folder_with(b"G28\n");
    outrigger(gcode.path(), ["post", "job.gcode", "-o", "job.goo"]).ends(1).says("no resin job");
    // A full disk, in the middle of the pictures and at their end.
    for blocks in ["1", "300", "381", "382"] {
        let full = format!("trap '' XFSZ; ulimit -f {blocks}");
        outrigger_after(path, &full, &["post", "job.sl1", "-o", "out.goo"]).ends(1).says("out.goo");
        assert_eq!(names(path), before, "{blocks}");
    }
    outrigger_after(path, "trap '' XFSZ; ulimit -f 1", &["post", "job.sl1", "-o", "out.nanodlp"])
        .ends(1)
        .says("out.nanodlp");
    assert_eq!(names(path), before);
}

#[test]
fn a_sample_of_prusaslicer_stays_the_same() {
    let sample =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/gcode-samples/sla/calib-supporttest-bare.sl1");
    let Ok(bytes) = fs::read(sample) else { return };
    let folder = tempfile::tempdir().expect("a temporary folder");
    fs::write(folder.path().join("job.sl1"), bytes).expect("the job");
    for (from, to) in [("job.sl1", "a.goo"), ("a.goo", "b.nanodlp")] {
        outrigger(folder.path(), ["post", from, "-o", to]).ends(0);
    }
    let open = |name: &str| {
        let bytes = fs::read(folder.path().join(name)).expect("a job");
        resin::open(Cursor::new(bytes)).expect("a job")
    };
    let (mut before, mut after) = (open("job.sl1"), open("b.nanodlp"));
    assert_eq!(before.layers().len(), after.layers().len());
    assert_eq!(before.placement().mirrored(), after.placement().mirrored());
    for (b, a) in before.layers().iter().zip(after.layers()) {
        assert!(
            (b.top_mm - a.top_mm).abs() < 1e-4 && (b.exposure_s - a.exposure_s).abs() < 1e-4,
            "{b:?} {a:?}"
        );
    }
    // All of them are slow to unpack without optimisation.
    for layer in (0..200).step_by(43) {
        let same = before.image(layer).expect("a picture") == after.image(layer).expect("a picture");
        assert!(same, "layer {layer}");
    }
}
