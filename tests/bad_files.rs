//! `outrigger post` on files and folders that do not behave, through the real binary.
//!
//! A slicer's export must not fail by us: once there is a file, the exit in place
//! is 0 and the file whole, old or new. With `-o` a fault is exit 1, and no
//! half-written output.
#![cfg(unix)]
mod common;

use common::{command, corpus, folder_with, names, outrigger, outrigger_after, same_deposits};
use std::fs::{self, Permissions};
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::Path;
use std::process::Stdio;

fn job() -> Vec<u8> {
    corpus("ps25-marlin2-fwretract-rectilinear.gcode")
}

fn mode(path: &Path) -> u32 {
    fs::metadata(path).expect("the file is there").permissions().mode() & 0o7777
}

/// A fault of the file: exit 1, words on stderr, and nothing written, in place and with `-o`.
#[track_caller]
fn fails(folder: &Path, input: &str) {
    let before = names(folder);
    let run = outrigger_after(folder, ":", &["post", input, "-o", "out.gcode"]);
    run.ends(1).says(input);
    assert_eq!(names(folder), before, "{input}");
    // No slicer calls its hook so: there is no export to fail.
    let run = outrigger_after(folder, ":", &["post", input]);
    run.ends(1).says(input);
    assert_eq!(names(folder), before, "{input}");
}

#[test]
fn what_is_no_file() {
    let (folder, _) = folder_with(b"");
    let path = folder.path();
    fs::create_dir(path.join("a-directory")).expect("a directory");
    symlink("nowhere", path.join("a-dangling-link")).expect("a link");
    symlink("a-loop", path.join("a-loop")).expect("a link");
    let made = std::process::Command::new("mkfifo").arg(path.join("a-fifo")).status().expect("mkfifo");
    assert!(made.success());
    // The last two never end: opening or reading one would hang the slicer.
    for input in ["missing", "a-directory", "a-dangling-link", "a-loop", "a-fifo", "/dev/zero"] {
        fails(path, input);
    }
}

#[test]
fn the_mode_is_kept() {
    for bits in [0o600, 0o640, 0o664, 0o755, 0o444] {
        let (folder, path) = folder_with(&job());
        fs::set_permissions(&path, Permissions::from_mode(bits)).expect("mode set");
        outrigger(folder.path(), ["post", "job.gcode"]).ends(0);
        assert_eq!(mode(&path), bits, "{bits:o}");
        same_deposits("mode", &job(), &fs::read(&path).expect("the job"));
        assert_eq!(names(folder.path()), ["job.gcode"]);
    }
}

#[test]
fn a_link_stays_a_link() {
    let (folder, path) = folder_with(&job());
    let elsewhere = folder.path().join("elsewhere");
    fs::create_dir(&elsewhere).expect("a directory");
    let link = elsewhere.join("link.gcode");
    symlink("../job.gcode", &link).expect("a link");
    outrigger(folder.path(), ["post", "elsewhere/link.gcode"]).ends(0);
    assert!(fs::symlink_metadata(&link).expect("the link").file_type().is_symlink());
    let after = fs::read(&path).expect("the job");
    assert!(after != job(), "the file behind the link was left");
    same_deposits("link", &job(), &after);
    assert_eq!(names(&elsewhere), ["link.gcode"]);
}

/// Blocks of 512 bytes that a file may have: less than the job needs.
const FULL: &str = "trap '' XFSZ; ulimit -f 40";

#[test]
fn a_full_disk_in_place() {
    let (folder, path) = folder_with(&job());
    outrigger_after(folder.path(), FULL, &["post", "job.gcode"]).ends(0).says("job.gcode");
    assert!(fs::read(&path).expect("the job") == job(), "the file was touched");
    assert_eq!(names(folder.path()), ["job.gcode"]);
}

#[test]
fn a_full_disk_with_output() {
    let (folder, _) = folder_with(&job());
    outrigger_after(folder.path(), FULL, &["post", "job.gcode", "-o", "out.gcode"]).ends(1).says("out.gcode");
    assert_eq!(names(folder.path()), ["job.gcode"]);
    // A file that was there before is not half overwritten either.
    fs::write(folder.path().join("out.gcode"), "G28\n").expect("an older output");
    outrigger_after(folder.path(), FULL, &["post", "job.gcode", "-o", "out.gcode"]).ends(1);
    assert_eq!(fs::read(folder.path().join("out.gcode")).expect("the older output"), b"G28\n");
}

#[test]
fn an_unwritable_report_fails_nothing() {
    let (folder, path) = folder_with(&job());
    let run = outrigger(folder.path(), ["post", "job.gcode", "--report", "no/such/folder/report.json"]);
    run.ends(0).says("report");
    same_deposits("report", &job(), &fs::read(&path).expect("the job"));
    // Standard output full.
    let full = fs::OpenOptions::new().write(true).open("/dev/full");
    let Ok(full) = full else { return };
    let (folder, path) = folder_with(&job());
    let mut post = command(folder.path());
    post.args(["post", "job.gcode", "--report", "-"]).stdout(Stdio::from(full)).stderr(Stdio::piped());
    let done = post.output().expect("the binary runs");
    assert_eq!(done.status.code(), Some(0), "{done:?}");
    assert!(!String::from_utf8_lossy(&done.stderr).contains("panicked"), "{done:?}");
    same_deposits("report to /dev/full", &job(), &fs::read(&path).expect("the job"));
}

#[test]
fn a_folder_that_cannot_be_written() {
    let (folder, path) = folder_with(&job());
    fs::set_permissions(folder.path(), Permissions::from_mode(0o555)).expect("mode set");
    let rooted = fs::write(folder.path().join("probe"), b"").is_ok();
    if !rooted {
        outrigger(folder.path(), ["post", "job.gcode"]).ends(0).says("job.gcode");
        assert!(fs::read(&path).expect("the job") == job());
    }
    fs::set_permissions(folder.path(), Permissions::from_mode(0o755)).expect("mode set");
}

#[test]
fn output_onto_the_input_itself() {
    let (folder, path) = folder_with(&job());
    let run = outrigger(folder.path(), ["post", "job.gcode", "-o", "./job.gcode"]);
    assert!(run.code == Some(0) || run.code == Some(1), "{run:?}");
    same_deposits("onto itself", &job(), &fs::read(&path).expect("the job"));
    assert_eq!(names(folder.path()), ["job.gcode"]);
}

/// Copies of the small job in the big one: long enough to be caught reading.
#[cfg(target_os = "linux")]
const COPIES: usize = 60;

/// Whether the process has the file open, as the kernel tells it.
#[cfg(target_os = "linux")]
fn has_open(pid: u32, path: &Path) -> bool {
    let Ok(fds) = fs::read_dir(format!("/proc/{pid}/fd")) else { return false };
    fds.flatten().any(|fd| fs::read_link(fd.path()).is_ok_and(|to| to == path))
}

/// Starts `post` on a big job and calls `meddle` once the job is open; gives the run's end.
#[cfg(target_os = "linux")]
fn meddled(meddle: impl FnOnce(&Path)) -> (tempfile::TempDir, std::process::Output) {
    let (folder, path) = folder_with(&job().repeat(COPIES));
    let real = path.canonicalize().expect("the job's own path");
    let mut post = command(folder.path());
    let mut child =
        post.args(["post", "job.gcode"]).stderr(Stdio::piped()).spawn().expect("the binary starts");
    let caught = loop {
        if has_open(child.id(), &real) {
            break true;
        }
        if child.try_wait().expect("the child can be asked").is_some() {
            break false;
        }
        std::thread::yield_now();
    };
    assert!(caught, "post ended before it was seen reading");
    meddle(&path);
    let done = child.wait_with_output().expect("the binary ends");
    assert_eq!(done.status.code(), Some(0), "{done:?}");
    assert!(!String::from_utf8_lossy(&done.stderr).contains("panicked"), "{done:?}");
    (folder, done)
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_replaced_while_it_is_read() {
    let (folder, done) = meddled(|path| {
        let newer = path.with_extension("newer");
        fs::write(&newer, "G28 ; the newer job\n").expect("a newer job");
        fs::rename(&newer, path).expect("it takes the place");
    });
    assert_eq!(
        fs::read(folder.path().join("job.gcode")).expect("the job"),
        b"G28 ; the newer job\n",
        "{done:?}"
    );
    assert_eq!(names(folder.path()), ["job.gcode"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_cut_off_while_it_is_read() {
    let (folder, done) = meddled(|path| fs::write(path, "G28 ; cut\n").expect("written over"));
    assert_eq!(fs::read(folder.path().join("job.gcode")).expect("the job"), b"G28 ; cut\n", "{done:?}");
    assert_eq!(names(folder.path()), ["job.gcode"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_file_removed_while_it_is_read() {
    let (folder, _) = meddled(|path| fs::remove_file(path).expect("removed"));
    assert_eq!(names(folder.path()), Vec::<String>::new());
}
