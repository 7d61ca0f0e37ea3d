//! `outrigger post` on files that no slicer should write, through the real binary.
//!
//! Whatever the bytes: no panic, in place exit 0, and a job that deposits what
//! it deposited before; where nothing can be done, the file byte for byte as
//! it was, with the reason on stderr and in the report.
mod common;

use common::{Run, corpus, folder_with, names, outrigger, same_deposits};
use std::path::Path;

/// What `post` may make of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Expect {
    /// Left byte for byte, with a reason.
    Untouched,
    /// Left byte for byte, with a reason on stderr that has these words.
    UntouchedSaying(&'static str),
    /// Left, or changed into a job that deposits the same.
    Safe,
    /// Changed: it deposits the same and is not the same file.
    Changed,
}

/// Runs `post` on the bytes, in place and to another file, and checks both.
#[track_caller]
fn check(name: &str, bytes: &[u8], expect: Expect) {
    let (folder, job) = folder_with(bytes);
    let run = outrigger(folder.path(), ["post", "job.gcode", "--report", "report.json"]);
    run.ends(0);
    assert_eq!(names(folder.path()), ["job.gcode", "report.json"], "{name}: {run:?}");
    let in_place = std::fs::read(&job).expect("the job is still there");
    judge(name, bytes, &in_place, expect, &run, folder.path());

    let (folder, job) = folder_with(bytes);
    let run = outrigger(folder.path(), ["post", "job.gcode", "-o", "out.gcode", "--report", "report.json"]);
    run.ends(0);
    assert_eq!(names(folder.path()), ["job.gcode", "out.gcode", "report.json"], "{name}: {run:?}");
    assert!(std::fs::read(&job).expect("the job") == bytes, "{name}: -o changed the input");
    let out = std::fs::read(folder.path().join("out.gcode")).expect("the output");
    judge(name, bytes, &out, expect, &run, folder.path());
    assert!(out == in_place, "{name}: in place and -o differ");
}

#[track_caller]
fn judge(name: &str, before: &[u8], after: &[u8], expect: Expect, run: &Run, folder: &Path) {
    let report = std::fs::read(folder.join("report.json")).expect("the report");
    let report: serde_json::Value = serde_json::from_slice(&report).expect("the report is JSON");
    let reason = report.get("unchanged_reason").unwrap_or_else(|| panic!("{name}: no unchanged_reason"));
    let untouched = before == after;
    assert_eq!(reason.is_string(), untouched, "{name}: {reason}");
    match expect {
        Expect::Untouched | Expect::UntouchedSaying(_) => assert!(untouched, "{name}: changed"),
        Expect::Changed => assert!(!untouched, "{name}: left as it was: {reason}"),
        Expect::Safe => {}
    }
    if let Expect::UntouchedSaying(words) = expect {
        run.says(words);
    }
    if untouched {
        run.says("job.gcode");
    } else {
        same_deposits(name, before, after);
    }
}

/// A small job with infill in separate beads: what the cases below are cut from.
fn job() -> Vec<u8> {
    corpus("ps25-marlin2-fwretract-rectilinear.gcode")
}

/// The job with every line passed through `change`, which gets the line without its feed.
fn with_lines(job: &[u8], mut change: impl FnMut(usize, &[u8]) -> Vec<u8>) -> Vec<u8> {
    let lines: Vec<Vec<u8>> = job.split(|&b| b == b'\n').enumerate().map(|(i, l)| change(i, l)).collect();
    lines.join(&b'\n')
}

/// The job with one line put in after the first line of sparse infill in its second half.
fn with_line_in_infill(line: &[u8]) -> Vec<u8> {
    let job = job();
    let half = job.len() / 2;
    let mark = b";TYPE:Internal infill\n";
    let at = half + job[half..].windows(mark.len()).position(|w| w == mark).expect("infill") + mark.len();
    let mut out = job[..at].to_vec();
    out.extend_from_slice(line);
    out.push(b'\n');
    out.extend_from_slice(&job[at..]);
    out
}

/// Bytes without meaning, always the same (xorshift).
fn garbage(len: usize) -> Vec<u8> {
    let mut x = 0x2545_f491_4f6c_dd1d_u64;
    let next = |_| {
        x ^= x << 13;
        x ^= x >> 7;
        x ^= x << 17;
        (x >> 32) as u8
    };
    (0..len).map(next).collect()
}

/// Deposits of the demo job, counted by another program.
const DEMO_DEPOSITS: usize = 10_199;

#[test]
fn the_oracle_sees_what_is_deposited() {
    let straight = "M83\nG1 X1 Y1 F100\nG1 X5 Y1 E.2\nG1 X9 Y9\nG1 X9 Y5 E.2 ; E9\n";
    let other_way = "M82\nG92 E7\nG1 X9 Y5\nG1 Y9 E7.2\nG1 E6\nG1 X5 Y1\nG1 E7.2\nG1 X1 E7.4\n";
    same_deposits("the other way round", straight.as_bytes(), other_way.as_bytes());
    for (old, new) in [("E.2 ;", "E.3 ;"), ("X9 Y5", "X9 Y6"), ("G1 X5 Y1 E.2", "G1 X5 Y1"), ("F100", "Z1")] {
        let changed = straight.replacen(old, new, 1);
        let told =
            std::panic::catch_unwind(|| same_deposits("changed", straight.as_bytes(), changed.as_bytes()));
        assert!(told.is_err(), "{new} went unseen");
    }
    assert_eq!(common::deposits(&corpus("demo.gcode")).len(), DEMO_DEPOSITS);
}

#[test]
fn good_jobs_are_changed() {
    // Without these the other cases could pass by never doing anything.
    check("firmware retraction", &job(), Expect::Changed);
    check("absolute E", &corpus("ps25-marlin-abs-grid.gcode"), Expect::Changed);
}

#[test]
fn what_is_no_job_is_left() {
    check("empty", b"", Expect::Untouched);
    check("one line feed", b"\n", Expect::Untouched);
    check("garbage", &garbage(200_000), Expect::Untouched);
    check("zeros", &[0; 100_000], Expect::Untouched);
    check("a picture", b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR", Expect::Untouched);
    check("a page", b"<!DOCTYPE html>\n<p>404 Not Found</p>\n", Expect::Untouched);
}

#[test]
fn binary_gcode_that_is_none() {
    let mut bytes = b"GCDE\x01\0\0\0\x01\0".to_vec();
    bytes.extend(garbage(50_000));
    check("binary G-code", &bytes, Expect::UntouchedSaying("binary"));
    check("the magic alone", b"GCDE", Expect::UntouchedSaying("binary"));
}

#[test]
fn slicers_that_say_nothing_are_left() {
    check("no comments", &corpus("slic3r13-abs.gcode"), Expect::Untouched);
    let bare = with_lines(&job(), |_, l| if l.starts_with(b";") { Vec::new() } else { l.to_vec() });
    check("comments taken out", &bare, Expect::Untouched);
    let no_layers = with_lines(&job(), |_, l| {
        let mark = [b";LAYER_CHANGE".as_slice(), b";Z:", b";HEIGHT:"].iter().any(|m| l.starts_with(m));
        if mark { Vec::new() } else { l.to_vec() }
    });
    check("no layer comments", &no_layers, Expect::Safe);
}

#[test]
fn a_spiral_is_left() {
    let vase = corpus("ps25-marlin-vase.gcode");
    check("spiral vase", &vase, Expect::Safe);
    // The flat bottom may be reordered; from the fourth layer on the wall is one long climb.
    let (folder, job) = folder_with(&vase);
    outrigger(folder.path(), ["post", "job.gcode"]).ends(0);
    let spiral = |job: &[u8]| {
        let layers = job.windows(14).enumerate().filter(|(_, w)| w == b";LAYER_CHANGE\n");
        let fourth = layers.map(|(at, _)| at).nth(3).expect("four layers");
        job[fourth..].to_vec()
    };
    assert!(spiral(&std::fs::read(job).expect("the job")) == spiral(&vase), "the spiral was changed");
}

#[test]
fn a_truncated_job_keeps_what_it_has() {
    let job = job();
    for tenths in [1, 3, 5, 6, 9] {
        check("truncated", &job[..job.len() * tenths / 10], Expect::Safe);
    }
    check("without the last line feed", job.trim_ascii_end(), Expect::Safe);
}

#[test]
fn numbers_that_are_none() {
    let lines: [&[u8]; 12] = [
        b"G1 Xnan Y100 E1",
        b"G1 X100 Y100 Enan",
        b"G1 Xinf Y-inf E.5",
        // The E of 1e300 begins a word of its own.
        b"G1 X1e300 Y1e300 E1",
        b"G1 X- Y. E",
        b"G1 X1.2.3 Y4 E.1",
        b"G1 X0x10 Y1 E.1",
        b"G1 X100 X101 Y1 E.1",
        b"G1 X1 F0",
        b"G99999999999999999999 X1",
        b"G1 E-99999",
        b"G2 X100 Y100 R1 E1",
    ];
    for line in lines {
        check(&String::from_utf8_lossy(line), &with_line_in_infill(line), Expect::Safe);
    }
    let mut long = b"G1 Y100 E.1 X1".to_vec();
    long.resize(314, b'0');
    check("X1e300 written out", &with_line_in_infill(&long), Expect::Safe);
    long.resize(60_000, b'0');
    check("X beyond every number", &with_line_in_infill(&long), Expect::Safe);
}

#[test]
fn filament_that_runs_backwards() {
    let job = corpus("ps25-marlin-abs-grid.gcode");
    let backwards = with_lines(&job, |i, l| {
        let Some(at) = l.windows(2).position(|w| w == b" E").filter(|_| l.starts_with(b"G1 X") && i > 500)
        else {
            return l.to_vec();
        };
        [&l[..at], b" E-", &l[at + 2..]].concat()
    });
    check("every E negative", &backwards, Expect::Safe);
    let no_reset = with_lines(&job, |_, l| if l == b"G92 E0" { Vec::new() } else { l.to_vec() });
    check("no G92", &no_reset, Expect::Safe);
    let switched = with_line_in_infill(b"M82");
    check("M82 in the infill of a relative job", &switched, Expect::Safe);
}

/// Net filament of a job whose E is relative, mm.
fn net_filament_mm(job: &[u8]) -> f64 {
    let lines = job.split(|&b| b == b'\n').map(|l| std::str::from_utf8(l).expect("ASCII"));
    let codes = lines.map(|l| l.split(';').next().unwrap_or_default()).filter(|l| l.starts_with('G'));
    codes
        .flat_map(str::split_whitespace)
        .filter_map(|w| w.strip_prefix('E'))
        .filter_map(|e| e.parse::<f64>().ok())
        .sum()
}

#[test]
fn filament_that_moves_alone_in_the_infill() {
    for line in ["G1 E1 F300", "G1 E-1 F300", "G1 X105 Y105 E-0.5", "G2 X100 Y100 I0 J0 E1"] {
        let job = with_line_in_infill(line.as_bytes());
        let (folder, path) = folder_with(&job);
        outrigger(folder.path(), ["post", "job.gcode"]).ends(0);
        let after = std::fs::read(path).expect("the job");
        assert!((net_filament_mm(&after) - net_filament_mm(&job)).abs() < 0.001, "{line} was dropped");
    }
}

#[test]
fn mixed_dialects() {
    let (prusa, cura) = (job(), corpus("cura413-marlin-rel-cubic.gcode"));
    check("PrusaSlicer, then Cura", &[prusa.clone(), cura.clone()].concat(), Expect::Safe);
    check("Cura, then PrusaSlicer", &[cura, prusa].concat(), Expect::Safe);
    check("Cura's mark in PrusaSlicer's infill", &with_line_in_infill(b";TYPE:WALL-OUTER"), Expect::Safe);
    check("a layer that begins in the infill", &with_line_in_infill(b";LAYER_CHANGE"), Expect::Safe);
}

#[test]
fn line_endings_and_foreign_letters() {
    let crlf = with_lines(&job(), |_, l| [l, b"\r"].concat());
    check("CRLF", &crlf[..crlf.len() - 1], Expect::Safe);
    let mixed = with_lines(&job(), |i, l| if i % 3 == 0 { [l, b"\r"].concat() } else { l.to_vec() });
    check("mixed line endings", &mixed, Expect::Safe);
    check("Latin-1 in a comment", &with_line_in_infill(b"; 0,2 mm gr\xfcn \xff\xfe"), Expect::Safe);
    check("a zero byte", &with_line_in_infill(b"G1 \0 X1"), Expect::Safe);
    let marked = [b"\xef\xbb\xbf".as_slice(), &job()].concat();
    check("a byte order mark", &marked, Expect::Safe);
    let numbered = with_lines(&job(), |i, l| [format!("N{i} ").as_bytes(), l].concat());
    check("every line numbered", &numbered, Expect::Safe);
}

#[test]
fn commands_in_the_infill_stay() {
    for line in [
        "T1",
        "M600",
        "M104 S0",
        "G28",
        "G29",
        "G92 X0 Y0",
        "G20",
        "G91",
        "M220 S50",
        "PAUSE",
        "; printing object x",
    ] {
        check(line, &with_line_in_infill(line.as_bytes()), Expect::Safe);
    }
}

/// Memory that `post` may take for any one line, whatever its length: below what the file would need.
#[cfg(target_os = "linux")]
const ADDRESS_SPACE_KIB: u32 = 700_000;

#[cfg(target_os = "linux")] // elsewhere the shell cannot limit memory
#[test]
fn one_line_of_a_gigabyte() {
    // A file with a hole costs no disk; it reads as zeros without a line feed.
    let (folder, job) = folder_with(b"G1 X");
    let file = std::fs::OpenOptions::new().write(true).open(&job).expect("the job");
    file.set_len(1 << 30).expect("a sparse file");
    drop(file);
    let before = format!("ulimit -v {ADDRESS_SPACE_KIB}; export MALLOC_ARENA_MAX=2");
    let run = common::outrigger_after(folder.path(), &before, &["post", "job.gcode"]);
    run.ends(0).says("job.gcode");
    assert_eq!(std::fs::metadata(&job).expect("the job").len(), 1 << 30);
    assert_eq!(names(folder.path()), ["job.gcode"]);
}

#[test]
fn one_long_line_among_others() {
    let mut comment = b"; ".to_vec();
    comment.resize(16 << 20, b'x');
    check("a comment of 16 MB", &with_line_in_infill(&comment), Expect::Safe);
}
