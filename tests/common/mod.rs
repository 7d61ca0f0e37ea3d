//! What the end-to-end tests share: the real binary, the corpus, and an oracle.
//!
//! The oracle reads G-code by itself, on purpose with none of the project's
//! code: it would not notice a mistake that it shares.
#![allow(dead_code)] // each test binary uses its own part

pub(crate) mod http;
pub(crate) mod made;
pub(crate) mod printer;

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// The bytes of a file of the corpus.
pub(crate) fn corpus(name: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus").join(name);
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// A run of the binary that has ended.
#[derive(Debug)]
pub(crate) struct Run {
    /// Exit code; `None` when a signal ended it.
    pub(crate) code: Option<i32>,
    pub(crate) stdout: String,
    pub(crate) stderr: String,
}

impl Run {
    fn of(output: Output) -> Run {
        let run = Run {
            code: output.status.code(),
            stdout: String::from_utf8_lossy(&output.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&output.stderr).into_owned(),
        };
        assert!(!run.stderr.contains("panicked"), "{run:?}");
        run
    }

    /// Ends with this code and with words on stderr for the user.
    #[track_caller]
    pub(crate) fn ends(&self, code: i32) -> &Run {
        assert_eq!(self.code, Some(code), "{self:?}");
        self
    }

    /// Stderr holds these words, in any case.
    #[track_caller]
    pub(crate) fn says(&self, words: &str) -> &Run {
        assert!(self.stderr.to_lowercase().contains(&words.to_lowercase()), "no {words:?} in {self:?}");
        self
    }
}

/// `outrigger ARGS` in a folder, to its end. No slicer's variables leak in.
pub(crate) fn outrigger<S: AsRef<OsStr>>(folder: &Path, args: impl IntoIterator<Item = S>) -> Run {
    Run::of(command(folder).args(args).stdin(Stdio::null()).output().expect("the binary starts"))
}

/// The same under a shell that runs `before` first (`ulimit …`); a run longer than a minute is ended with 124.
pub(crate) fn outrigger_after(folder: &Path, before: &str, args: &[&str]) -> Run {
    let script = format!("{before}; exec timeout 60 \"$0\" \"$@\"");
    let mut shell = Command::new("sh");
    shell.arg("-c").arg(script).arg(env!("CARGO_BIN_EXE_outrigger")).args(args);
    shell.current_dir(folder).env_remove("SLIC3R_PP_OUTPUT_NAME");
    Run::of(shell.stdin(Stdio::null()).output().expect("sh starts"))
}

/// The binary, not yet started.
pub(crate) fn command(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_outrigger"));
    command.current_dir(folder).env_remove("SLIC3R_PP_OUTPUT_NAME");
    command
}

/// A folder with one file `job.gcode`.
pub(crate) fn folder_with(bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let job = folder.path().join("job.gcode");
    std::fs::write(&job, bytes).expect("the job is written");
    (folder, job)
}

/// A folder with one file.
pub(crate) fn folder_of(name: &str, bytes: &[u8]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::write(folder.path().join(name), bytes).expect("the file is written");
    folder
}

/// The names in a folder, sorted: a temporary file left behind shows here.
pub(crate) fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .expect("the folder is there")
        .map(|entry| entry.expect("an entry").file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

/// One deposit: the two ends in micrometres (X Y Z), the lesser first, and the filament in millimetres.
pub(crate) type Deposit = ([i64; 3], [i64; 3], f64);

/// Every move that pushes filament while it moves in X, Y or Z, sorted.
pub(crate) fn deposits(job: &[u8]) -> Vec<Deposit> {
    let (mut at, mut e) = ([0i64; 3], 0.0f64);
    let (mut relative, mut said_relative_e) = (false, false);
    let mut found = Vec::new();
    for line in job.split(|&b| b == b'\n') {
        let code = line.split(|&b| b == b';').next().unwrap_or_default();
        let words = words(code);
        let Some(&(letter, number)) = words.iter().find(|w| w.0 != b'N') else { continue };
        match (letter, number) {
            // As slicers mean it: G91 makes E relative too, G90 gives it back to M82 or M83.
            (b'G', 90.0) => relative = false,
            (b'G', 91.0) => relative = true,
            (b'M', 82.0) => said_relative_e = false,
            (b'M', 83.0) => said_relative_e = true,
            (b'G', 92.0) => e = word(&words, b'E').unwrap_or(e),
            // Arcs by their ends: a pass may walk one from the other end, and no more.
            (b'G', 0.0 | 1.0 | 2.0 | 3.0) => {
                let mut to = at;
                for (axis, letter) in b"XYZ".iter().enumerate() {
                    if let Some(mm) = word(&words, *letter) {
                        let um = (mm * 1000.0).round() as i64;
                        to[axis] = if relative { at[axis].saturating_add(um) } else { um };
                    }
                }
                let relative_e = relative || said_relative_e;
                let push = word(&words, b'E').map_or(0.0, |v| if relative_e { v } else { v - e });
                e = if relative_e { e } else { e + push };
                if push > 0.0 && (to != at || number >= 2.0) {
                    found.push((at.min(to), at.max(to), push));
                }
                at = to;
            }
            _ => {}
        }
    }
    found.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
    found
}

/// Panics unless both jobs deposit the same segments with the same filament, in whatever order.
#[track_caller]
pub(crate) fn same_deposits(name: &str, before: &[u8], after: &[u8]) {
    let (before, after) = (deposits(before), deposits(after));
    assert_eq!(before.len(), after.len(), "{name}: number of deposits");
    for (b, a) in before.iter().zip(&after) {
        let same = b.0 == a.0 && b.1 == a.1 && (b.2 - a.2).abs() <= 0.001;
        assert!(same, "{name}: {b:?} became {a:?}");
    }
}

fn word(words: &[(u8, f64)], letter: u8) -> Option<f64> {
    words.iter().skip(1).find(|w| w.0 == letter).map(|w| w.1)
}

/// Letters with the number after each; a letter without one is left out.
fn words(code: &[u8]) -> Vec<(u8, f64)> {
    let mut words = Vec::new();
    let mut at = 0;
    while at < code.len() {
        let letter = code[at].to_ascii_uppercase();
        at += 1;
        if !letter.is_ascii_uppercase() {
            continue;
        }
        let len = code[at..].iter().take_while(|b| b.is_ascii_digit() || b"+-.".contains(b)).count();
        if let Some(value) = std::str::from_utf8(&code[at..at + len]).ok().and_then(|t| t.parse().ok()) {
            words.push((letter, value));
        }
        at += len;
    }
    words
}
