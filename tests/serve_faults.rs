//! `outrigger serve` when disks fill, become read-only, clocks jump, printers are unplugged, clients
//! send rubbish, and the process is killed: what was accepted is there afterwards, nothing is started
//! twice, and what cannot be done is refused in words.
//!
//! What needs a file system or an environment of its own runs in a process of its own: the test starts
//! this binary again for one of the tests that are marked `ignore`, in a namespace where it may mount.
#![cfg(target_os = "linux")]
mod common;

use common::http::{Answer, Daemon, PASSWORD, read_answer};
use common::names;
use common::printer::{BINARY, Mock, PATIENCE, commands, signal, wait_for, wait_until};
use rustix::process::{Pid, Resource, Rlimit, prlimit};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fs;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A configuration with the mock's printer; `more` has keys of that printer, or tables after it.
fn config(tty: &Path, more: &str) -> String {
    format!(
        "[server]\nmdns = false\n[storage]\nmin_free_mb = 0\n[[printer]]\nid = 'mock'\nprofile = 'generic-marlin'\n\
         port = '{}'\nmacros = false\non_findings = 'warn'\nclear_bed = 'assume'\n{more}\n",
        tty.display()
    )
}

/// A move to the start, and moves of 10 mm that no other job has: Y tells the job, and the place in it.
fn job(number: u32, moves: u32) -> String {
    let mut text = String::from("G28\nG90\nM83\nG1 X15 Y15 Z0.2 F6000\n");
    for n in 0..moves {
        text += &format!("G1 X{} Y{}.{n:04}\n", 20 + n % 2 * 10, 20 + number);
    }
    text
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn id(object: &Value) -> &str {
    object["id"].as_str().unwrap()
}

/// A problem of RFC 9457 with one of some statuses; gives its words.
#[track_caller]
fn refused(answer: &Answer, statuses: &[u16]) -> String {
    assert!(statuses.contains(&answer.status), "{} {}", answer.status, answer.text());
    assert_eq!(answer.header("content-type"), Some("application/problem+json"), "{}", answer.text());
    let words = answer.json()["detail"].as_str().unwrap().to_owned();
    assert!(!words.is_empty());
    words
}

/// What is in the folders of uploads, files and jobs that wait.
fn kept(state: &Path) -> [Vec<String>; 3] {
    ["incoming", "files", "queue"].map(|folder| names(&state.join(folder)))
}

/// Names in a data folder that are on their way to being something: none is left at rest.
fn half_written(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        if path.is_dir() {
            half_written(&path, found);
        } else if name.ends_with(".tmp") || name.starts_with('.') || name.starts_with("upload-") {
            found.push(path);
        }
    }
}

/// Runs one of this binary's ignored tests under `wrapper`, to its end.
#[track_caller]
fn in_its_own(wrapper: &[&str], name: &str, set: &[(&str, &Path)]) {
    let mut run = Command::new(wrapper[0]);
    run.args(&wrapper[1..]).arg(std::env::current_exe().unwrap());
    run.args(["--exact", name, "--ignored", "--nocapture", "--test-threads", "1"]);
    let out = run.envs(set.iter().copied()).stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&out.stdout).into_owned() + &String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && said.contains("1 passed"), "{said}");
}

/// What gives a process mounts of its own, if this machine lets it.
const NAMESPACE: [&str; 2] = ["unshare", "-rm"];

fn may_mount() -> bool {
    let try_it = "mount -t tmpfs -o size=1m tmpfs /tmp";
    let tried = Command::new("unshare").args(["-rm", "sh", "-c", try_it]).stderr(Stdio::null()).status();
    let may = tried.is_ok_and(|status| status.success());
    if !may {
        eprintln!("skipped: this machine does not let us mount a file system of our own");
    }
    may
}

/// A file system of so many MB in a folder; needs [`NAMESPACE`]. It goes with the process.
fn small_disk(folder: &Path, mb: u32) {
    let mounted = Command::new("mount")
        .args(["-t", "tmpfs", "-o", &format!("size={mb}m"), "tmpfs"])
        .arg(folder)
        .status();
    assert!(mounted.unwrap().success());
}

fn remount(folder: &Path, how: &str) {
    let done = Command::new("mount").args(["-o", &format!("remount,{how}")]).arg(folder).status();
    assert!(done.unwrap().success(), "remounted {how}");
}

/// Takes what is free of a disk, to the last byte.
fn fill(folder: &Path) -> PathBuf {
    let path = folder.join("filler");
    let mut file = fs::File::create(&path).unwrap();
    for bytes in [64 << 10, 4096, 1] {
        while file.write_all(&vec![b'x'; bytes]).is_ok() {}
    }
    path
}

// ---- disks ----

/// Commands that a host sends beyond what its journal has on the medium (docs/journal.md).
const MAX_AHEAD: u64 = 1024;

#[test]
fn too_little_free_space_refuses_uploads_only() {
    let state = tempfile::tempdir().unwrap();
    let ample = "[server]\nmdns = false\n[[printer]]\nid = 'gone'\nprofile = 'ender-3'\nport = '/dev/does-not-exist'\n";
    let daemon = Daemon::start(state.path(), &format!("{ample}[storage]\nmin_free_mb = 0\n"));
    let file = daemon.upload("part.gcode", job(0, 10).as_bytes());
    daemon.end();
    let daemon = Daemon::start(state.path(), &format!("{ample}[storage]\nmin_free_mb = 1000000\n"));
    let before = kept(state.path());
    let form = b"--B\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.gcode\"\r\n\r\nG28\n\r\n--B--\r\n";
    let typed = [("Content-Type", "multipart/form-data; boundary=B")];
    for (path, headers, body) in [
        ("/api/v2/files?name=a.gcode", &[][..], &b"G28\n"[..]),
        ("/api/v2/files", &typed[..], &form[..]),
        ("/api/files/local", &typed[..], &form[..]),
        ("/server/files/upload", &typed[..], &form[..]),
        ("/api/v1/files/local/a.gcode", &[][..], &b"G28\n"[..]),
    ] {
        let method = if path.starts_with("/api/v1") { "PUT" } else { "POST" };
        let answer = daemon.send(method, path, headers, body);
        assert_eq!(answer.status, 507, "{path}: {}", answer.text());
        assert!(answer.text().contains("min_free_mb"), "{path}: {}", answer.text());
    }
    assert_eq!(kept(state.path()), before);
    // What is small and wanted goes on.
    daemon.queue(&file, "gone");
    daemon.end();
}

#[test]
fn a_full_disk_refuses_what_is_new_and_loses_nothing() {
    if may_mount() {
        in_its_own(&NAMESPACE, "on_a_small_disk", &[]);
    }
}

#[test]
#[ignore = "run by a_full_disk_refuses_what_is_new_and_loses_nothing"]
fn on_a_small_disk() {
    let mock = Mock::steady(&["--speed", "20"], "");
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path();
    small_disk(state, 4);
    let config = config(&mock.path("tty"), "reorder = false");
    let daemon = Daemon::start(state, &config);
    daemon.wait_printer("mock", "ready");
    let text = job(0, 3000);
    let file = daemon.upload("part.gcode", text.as_bytes());
    let next = daemon.upload("next.gcode", job(1, 20).as_bytes());
    let printed = daemon.queue(&file, "mock");
    let waiting = daemon.queue(&next, "mock");
    daemon.wait_job(&printed, "printing");
    daemon.wait_job(&waiting, "queued");
    let before = kept(state);

    // One that is too large for what is there, announced and not: told in the middle of it.
    let large = vec![b';'; 6 << 20];
    refused(&daemon.send("POST", "/api/v2/files?name=large.gcode", &[], &large), &[507]);
    let form = b"--B\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.gcode\"\r\n\r\n";
    let typed = [("Content-Type", "multipart/form-data; boundary=B")];
    let form = [&form[..], &large, b"\r\n--B--\r\n"].concat();
    refused(&daemon.send("POST", "/api/v2/files", &typed, &form), &[507]);
    wait_until("what came of it to go", || kept(state) == before);

    // Not a byte is free.
    let filler = fill(state);
    refused(&daemon.send("POST", "/api/v2/files?name=small.gcode", &[], b"G28\n"), &[507]);
    let again = daemon.post("/api/v2/jobs", &json!({"file": id(&file), "printer": "mock"}));
    refused(&again, &[507]);
    assert_eq!(kept(state), before, "after refusals");
    let user = json!({"name": "bo", "password": PASSWORD, "role": "viewer"});
    refused(&daemon.post("/api/v2/users", &user), &[507]);
    // The job goes on further than a journal that cannot be written allows: its room was taken before.
    let moved = || mock.now()["moves"].as_u64().unwrap_or(0);
    let enough = moved() + MAX_AHEAD + 100;
    wait_until("moves on a full disk", || moved() > enough);
    let now = daemon.see(&format!("/api/v2/jobs/{}", id(&printed)));
    assert_eq!(now["state"], "printing", "{now}");

    fs::remove_file(filler).unwrap();
    daemon.wait_job(&printed, "finished");
    daemon.wait_job(&waiting, "finished");
    // The refused user is none, and may be made now.
    assert_eq!(daemon.post("/api/v2/users", &user).status, 201);
    daemon.end();
    let daemon = Daemon::start(state, &config);
    for (file, name) in [(&file, "part.gcode"), (&next, "next.gcode")] {
        assert_eq!(daemon.see(&format!("/api/v2/files/{}", id(file)))["name"], name);
    }
    for job in [&printed, &waiting] {
        assert_eq!(daemon.see(&format!("/api/v2/jobs/{}", id(job)))["state"], "finished");
    }
    daemon.end();
    let stats = mock.stats();
    assert_eq!(stats["moves"].as_u64(), Some(3000 + 20 + 2), "{stats}");
    let mut found = Vec::new();
    half_written(state, &mut found);
    assert!(found.is_empty(), "{found:?}");
}

#[test]
fn a_disk_that_takes_no_long_files_keeps_the_job_going() {
    // The signal that comes with the limit is no part of it.
    let wrapper = ["sh", "-c", "trap '' XFSZ; exec \"$0\" \"$@\""];
    in_its_own(&wrapper, "with_a_limit_on_files", &[]);
}

#[test]
#[ignore = "run by a_disk_that_takes_no_long_files_keeps_the_job_going"]
fn with_a_limit_on_files() {
    let mock = Mock::steady(&["--speed", "20"], "");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(&mock.path("tty"), "reorder = false"));
    daemon.wait_printer("mock", "ready");
    let printed = daemon.queue(&daemon.upload("part.gcode", job(0, 1000).as_bytes()), "mock");
    daemon.wait_job(&printed, "printing");
    let before = kept(state.path());
    let pid = Pid::from_raw(i32::try_from(daemon.child.id()).unwrap());
    let most = Some(200 << 10);
    prlimit(pid, Resource::Fsize, Rlimit { current: most, maximum: most }).unwrap();
    for size in [1 << 20, 3 << 20] {
        let large = vec![b';'; size];
        refused(&daemon.send("POST", "/api/v2/files?name=large.gcode", &[], &large), &[507, 500]);
    }
    wait_until("what came of it to go", || kept(state.path()) == before);
    daemon.upload("small.gcode", b"G28\n");
    daemon.wait_job(&printed, "finished");
    daemon.end();
    assert_eq!(mock.stats()["moves"].as_u64(), Some(1000 + 1));
}

#[test]
fn a_read_only_data_folder_is_told_in_a_line() {
    if may_mount() {
        in_its_own(&NAMESPACE, "on_a_disk_that_becomes_read_only", &[]);
    }
}

/// A daemon that does not start; gives what it says.
fn does_not_start(state: &Path, config: &str) -> String {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(&file, config).unwrap();
    let mut serve = Command::new(BINARY);
    serve
        .args(["serve", "--listen", "127.0.0.1:0", "--no-guard", "--config"])
        .arg(file.path())
        .arg("--state")
        .arg(state);
    let mut child = serve.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    wait_for(&mut child);
    let out = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(1), "{said}");
    said
}

#[test]
#[ignore = "run by a_read_only_data_folder_is_told_in_a_line"]
fn on_a_disk_that_becomes_read_only() {
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path();
    small_disk(state, 8);
    let config = "[server]\nmdns = false\n[storage]\nmin_free_mb = 0\n[[printer]]\nid = 'gone'\nprofile = 'ender-3'\n\
                  port = '/dev/does-not-exist'\non_findings = 'warn'\n";
    let check_start = || {
        let said = does_not_start(state, config);
        assert_eq!(said.trim_end().lines().count(), 1, "{said}");
        assert!(said.contains(&state.display().to_string()) && said.contains("Read-only"), "{said}");
        eprint!("{said}");
    };
    // A folder that nobody has used…
    remount(state, "ro");
    check_start();
    remount(state, "rw");
    let daemon = Daemon::start(state, config);
    let file = daemon.upload("part.gcode", job(0, 10).as_bytes());
    let queued = daemon.queue(&file, "gone");
    daemon.wait_job(&queued, "queued");
    // …and one in use, while the daemon runs.
    remount(state, "ro");
    refused(&daemon.send("POST", "/api/v2/files?name=a.gcode", &[], b"G28\n"), &[500, 507]);
    refused(&daemon.post("/api/v2/jobs", &json!({"file": id(&file), "printer": "gone"})), &[500, 507]);
    let act = daemon.post(&format!("/api/v2/jobs/{}/actions", id(&queued)), &json!({"action": "cancel"}));
    refused(&act, &[500, 507]);
    // A job needs it.
    refused(&daemon.send("DELETE", &format!("/api/v2/files/{}", id(&file)), &[], b""), &[409]);
    refused(
        &daemon.post("/api/v2/users", &json!({"name": "bo", "password": PASSWORD, "role": "viewer"})),
        &[500, 507],
    );
    let seen = |daemon: &Daemon| {
        assert_eq!(daemon.see("/api/v2/files").as_array().unwrap().len(), 1);
        let jobs = daemon.see("/api/v2/jobs");
        assert_eq!((jobs.as_array().unwrap().len(), &jobs[0]["state"]), (1, &json!("queued")));
        assert_eq!(daemon.see("/api/v2/users").as_array().unwrap().len(), 1);
        assert_eq!(daemon.get(&format!("/api/v2/files/{}/content", id(&file))).body, job(0, 10).as_bytes());
    };
    seen(&daemon);
    daemon.end();
    check_start();
    remount(state, "rw");
    let daemon = Daemon::start(state, config);
    seen(&daemon);
    daemon.upload("b.gcode", b"G28\n");
    daemon.end();
}

// ---- killed ----

/// A generator of random numbers that is the same in each run.
struct Dice(u64);

impl Dice {
    fn roll(&mut self, below: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % below
    }
}

/// A request to a daemon that may die meanwhile; `None`: no whole answer came.
fn ask(to: SocketAddr, key: &str, method: &str, path: &str, body: &[u8]) -> Option<(u16, Value)> {
    let kind = if path.contains("/files") { "application/octet-stream" } else { "application/json" };
    let head = format!(
        "{method} {path} HTTP/1.1\r\nHost: {to}\r\nX-Api-Key: {key}\r\nConnection: close\r\nContent-Type: {kind}\r\n\
         Content-Length: {}\r\n\r\n",
        body.len()
    );
    let (status, body) = raw(to, &[head.as_bytes(), body].concat())?;
    Some((status, serde_json::from_slice(&body).ok()?))
}

/// Sends bytes, and reads what comes until the other side closes. `None`: it is no answer.
fn raw(to: SocketAddr, bytes: &[u8]) -> Option<(u16, Vec<u8>)> {
    let mut stream = TcpStream::connect(to).ok()?;
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let _ = stream.write_all(bytes);
    answer(&mut stream)
}

/// Reads an answer that ends with its connection.
fn answer(stream: &mut TcpStream) -> Option<(u16, Vec<u8>)> {
    let mut got = Vec::new();
    // A connection that is reset after the answer has given the answer.
    let _ = stream.read_to_end(&mut got);
    let end = got.windows(4).position(|four| four == b"\r\n\r\n")?;
    let head = String::from_utf8_lossy(&got[..end]).to_ascii_lowercase();
    let status = head.strip_prefix("http/1.1 ")?.get(..3)?.parse().ok()?;
    let body = got.split_off(end + 4);
    let length =
        head.lines().find_map(|line| line.strip_prefix("content-length:")?.trim().parse::<usize>().ok());
    (status == 0 || length.is_none_or(|length| length == body.len() || body.is_empty()))
        .then_some((status, body))
}

/// What a daemon has said it has.
#[derive(Default)]
struct Said {
    /// SHA-256 by file.
    files: BTreeMap<String, String>,
    /// Its number, by job on the mock.
    printed: BTreeMap<String, u32>,
    /// Jobs that are to be mended.
    mended: Vec<String>,
    /// Jobs that wait for a person.
    held: Vec<String>,
}

const KILLS: u64 = 12;

/// A printer answers after some 3 s: every second daemon lives long enough to print, the others die
/// with what they have just taken.
const SHORT_LIFE_MS: u64 = 1500;
const LONG_LIFE_MS: [u64; 2] = [2800, 3000];

/// Moves of each job on the mock: some 2 s.
const MOVES: u32 = 100;

/// Jobs of each kind at most: they are all ended at last, and checks take their time.
const MOST_PRINTED: u32 = 8;
const MOST_MENDED: usize = 2;

/// Uploads and queues until the daemon is gone: a job for the mock, one that is to be mended, one that
/// is held, and then files that nobody prints.
fn keep_busy(to: SocketAddr, key: &str, said: &mut Said, number: &mut u32, until: &dyn Fn() -> bool) {
    let lamp = common::corpus("lamp.gcode");
    for turn in 0.. {
        if !until() {
            return;
        }
        let printed = *number + 1;
        let (bytes, printer, hold) = match turn {
            0 if *number < MOST_PRINTED => (job(printed, MOVES).into_bytes(), Some("mock"), false),
            1 if said.mended.len() < MOST_MENDED => (lamp.clone(), Some("mender"), false),
            2 => (job(99, 10).into_bytes(), Some("mock"), true),
            _ => (job(98, 2000).into_bytes(), None, false),
        };
        // Some hundred of them are enough for any disk.
        std::thread::sleep(Duration::from_millis(30));
        let Some((201, file)) =
            ask(to, key, "POST", &format!("/api/v2/files?name=part-{turn}.gcode"), &bytes)
        else {
            return;
        };
        let sum = hex(&Sha256::digest(&bytes));
        assert_eq!(file["sha256"], *sum);
        said.files.insert(id(&file).to_owned(), sum);
        let Some(printer) = printer else { continue };
        // Whether it was taken is not known where the daemon dies first: it counts as one.
        *number += u32::from(turn == 0);
        let wanted = json!({"file": id(&file), "printer": printer, "hold": hold}).to_string();
        let Some((201, job)) = ask(to, key, "POST", "/api/v2/jobs", wanted.as_bytes()) else { return };
        let job = id(&job).to_owned();
        match turn {
            0 => drop(said.printed.insert(job, printed)),
            1 => said.mended.push(job),
            _ => said.held.push(job),
        }
    }
}

fn all_is_there(daemon: &Daemon, said: &Said) {
    let listed = |path| -> BTreeMap<String, Value> {
        let all = daemon.see(path);
        all.as_array().unwrap().iter().map(|one| (id(one).to_owned(), one.clone())).collect()
    };
    let (files, jobs) = (listed("/api/v2/files"), listed("/api/v2/jobs"));
    for (file, sum) in &said.files {
        assert_eq!(files.get(file).map(|file| &file["sha256"]), Some(&json!(sum)), "an upload is lost");
    }
    for job in said.printed.keys().chain(&said.mended).chain(&said.held) {
        assert!(jobs.contains_key(job), "job {job} is lost");
    }
}

#[test]
fn a_daemon_that_is_killed_at_any_moment_loses_nothing_and_starts_nothing_twice() {
    let mock = Mock::steady(&["--speed", "10", "--log", "commands.log"], "");
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path();
    let mender = "[[printer]]\nid = 'mender'\nprofile = 'generic-marlin'\nport = '/dev/does-not-exist'\non_findings = 'mend'";
    let config = config(&mock.path("tty"), mender);
    let (mut said, mut number, mut dice) = (Said::default(), 0, Dice(0x9e37_79b9_7f4a_7c15));
    let (mut unsaid, mut in_print) = (0, 0);
    for round in 0..KILLS {
        let mut daemon = Daemon::start(state, &config);
        assert_eq!(names(&state.join("incoming")), [] as [&str; 0]);
        all_is_there(&daemon, &said);
        let jobs = daemon.see("/api/v2/jobs");
        in_print += jobs.as_array().unwrap().iter().filter(|job| job["state"] == "taking_over").count();
        let (to, key) = (daemon.address, daemon.key.clone());
        let lives_ms = match round % 2 {
            0 => dice.roll(SHORT_LIFE_MS),
            _ => LONG_LIFE_MS[0] + dice.roll(LONG_LIFE_MS[1]),
        };
        let lives = Duration::from_millis(lives_ms);
        let began = Instant::now();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                keep_busy(to, &key, &mut said, &mut number, &|| began.elapsed() < lives + PATIENCE / 20)
            });
            std::thread::sleep(lives);
            signal("KILL", &daemon.child);
            wait_for(&mut daemon.child);
        });
        let log = daemon.log();
        assert!(!log.contains("panicked"), "round {round}: {log}");
        unsaid = names(&state.join("files")).len() - said.files.len();
    }
    let daemon = Daemon::start(state, &config);
    all_is_there(&daemon, &said);
    let state_of =
        |job: &str| daemon.see(&format!("/api/v2/jobs/{job}"))["state"].as_str().unwrap().to_owned();
    let mut ends = BTreeMap::<String, u32>::new();
    for job in said.printed.keys() {
        let mut last = String::new();
        wait_until("a job to end", || {
            std::thread::sleep(Duration::from_millis(50));
            last = state_of(job);
            // What a person is asked is not answered here: the job is forgotten, and the next one goes on.
            if last == "interrupted" {
                let forgot =
                    daemon.post(&format!("/api/v2/jobs/{job}/actions"), &json!({"action": "forget"}));
                assert_eq!(forgot.status, 200, "{}", forgot.text());
            }
            ["finished", "failed", "interrupted"].contains(&last.as_str())
        });
        *ends.entry(last).or_default() += 1;
    }
    for job in &said.mended {
        daemon.wait_job(&json!({"id": job}), "mended");
    }
    for job in &said.held {
        daemon.wait_job(&json!({"id": job}), "held");
    }
    eprintln!(
        "{} uploads, {} jobs ({ends:?}), {} mended, {} held; {in_print} times a job was taken up, {unsaid} uploads \
         were kept and not said",
        said.files.len(),
        said.printed.len(),
        said.mended.len(),
        said.held.len()
    );
    assert_eq!(ends.get("failed"), None, "{ends:?}\n{}", daemon.log());
    let printed: Vec<_> =
        said.printed.iter().map(|(job, number)| (state_is_finished(&daemon, job), *number)).collect();
    daemon.end();
    // Every move that the printer made, as it has written them down.
    let done = fs::read_to_string(mock.path("commands.log")).unwrap();
    let mut times = BTreeMap::<&str, u32>::new();
    for line in done.lines() {
        if let Some(at) = line.find("G1 X").filter(|at| is_own(&line[*at..])) {
            *times.entry(line[at..].trim()).or_default() += 1;
        }
    }
    for (finished, number) in printed {
        let text = job(number, MOVES);
        for command in commands(&text).filter(|command| is_own(command)) {
            let made = times.get(command).copied().unwrap_or(0);
            assert!(made <= 1, "job {number}: {command} was made {made} times");
            assert!(made == 1 || !finished, "job {number}: {command} was left out");
        }
    }
    let stats = mock.stats();
    assert_eq!((stats["crashes"].as_u64(), stats["kills"].as_u64()), (Some(0), Some(0)), "{stats}");
    let mut found = Vec::new();
    half_written(state, &mut found);
    assert!(found.is_empty(), "{found:?}");
}

/// Whether a command is a move that no other job has.
fn is_own(command: &str) -> bool {
    command.starts_with("G1 X") && !command.contains('Z')
}

fn state_is_finished(daemon: &Daemon, job: &str) -> bool {
    let answer = daemon.get(&format!("/api/v2/jobs/{job}"));
    answer.status == 200 && answer.json()["state"] == "finished"
}

// ---- the clock ----

/// Sets the clock for whoever loads it: seconds to add are read from a file. Time that is only
/// measured (`CLOCK_MONOTONIC`) goes on, as in life.
const CLOCK_C: &str = r#"
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static long long shift(void) {
    char text[32] = {0};
    const char *path = getenv("TEST_CLOCK");
    int file = path ? open(path, O_RDONLY | O_CLOEXEC) : -1;
    if (file < 0) return 0;
    ssize_t got = read(file, text, sizeof text - 1);
    close(file);
    return got > 0 ? atoll(text) : 0;
}

int clock_gettime(clockid_t clock, struct timespec *now) {
    static int (*real)(clockid_t, struct timespec *);
    if (!real) real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
    int failed = real(clock, now);
    if (!failed && clock == CLOCK_REALTIME) now->tv_sec += shift();
    return failed;
}
"#;

#[test]
fn a_clock_that_jumps_lets_nobody_in_and_stops_no_print() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    fs::write(path("clock.c"), CLOCK_C).unwrap();
    fs::write(path("clock"), "0").unwrap();
    let compiled = Command::new("cc")
        .args(["-shared", "-fPIC", "-o"])
        .args([path("clock.so"), path("clock.c")])
        .arg("-ldl")
        .stderr(Stdio::null())
        .status();
    if !compiled.is_ok_and(|status| status.success()) {
        eprintln!("skipped: no C compiler (cc) to make a clock with");
        return;
    }
    let clock: &[(&str, &Path)] = &[("LD_PRELOAD", &path("clock.so")), ("TEST_CLOCK", &path("clock"))];
    in_its_own(&["env"], "with_a_clock_that_jumps", clock);
}

/// A person in a browser.
struct Person<'a> {
    daemon: &'a Daemon,
    cookie: String,
}

impl<'a> Person<'a> {
    fn try_password(daemon: &Daemon, password: &str) -> Answer {
        let body = json!({"name": "anna", "password": password}).to_string();
        let headers = [("Content-Type", "application/json"), ("X-Api-Key", "")];
        let head: String = headers[..1].iter().map(|(n, v)| format!("{n}: {v}\r\n")).collect();
        let request = format!(
            "POST /api/v2/session HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n{head}Content-Length: {}\r\n\r\n{body}",
            daemon.address,
            body.len()
        );
        common::http::exchange(daemon.address, request.as_bytes())
    }

    fn log_in(daemon: &'a Daemon) -> Self {
        let answer = Self::try_password(daemon, PASSWORD);
        assert_eq!(answer.status, 200, "{}", answer.text());
        let cookie = answer.header("set-cookie").unwrap().split(';').next().unwrap().to_owned();
        Self { daemon, cookie }
    }

    /// Whether the session lives.
    fn is_in(&self) -> bool {
        let to = self.daemon.address;
        let request = format!(
            "GET /api/v2/printers HTTP/1.1\r\nHost: {to}\r\nConnection: close\r\nCookie: {}\r\n\r\n",
            self.cookie
        );
        match common::http::exchange(to, request.as_bytes()).status {
            200 => true,
            401 => false,
            other => panic!("{other}"),
        }
    }
}

#[test]
#[ignore = "run by a_clock_that_jumps_lets_nobody_in_and_stops_no_print"]
fn with_a_clock_that_jumps() {
    const DAY: i64 = 86_400;
    let clock = PathBuf::from(std::env::var_os("TEST_CLOCK").unwrap());
    let set = |seconds: i64| {
        // Whole at any moment, as the daemon reads it all the time.
        let new = clock.with_extension("new");
        fs::write(&new, seconds.to_string()).unwrap();
        fs::rename(new, &clock).unwrap();
    };
    let mock = Mock::steady(&["--speed", "20"], "");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(&mock.path("tty"), "reorder = false"));
    daemon.wait_printer("mock", "ready");
    let text = job(0, 800);
    let printed = daemon.queue(&daemon.upload("part.gcode", text.as_bytes()), "mock");
    daemon.wait_job(&printed, "printing");
    // An hour is nothing; a Pi that learns the date, whichever way, ends sessions.
    let anna = Person::log_in(&daemon);
    set(3600);
    assert!(anna.is_in());
    let now = daemon.see("/api/v2/printers/mock")["messages"].clone();
    assert!(now.is_array(), "{now}");
    for jump in [3650 * DAY, -5000 * DAY, 0, -20 * DAY] {
        set(jump);
        assert!(!anna.is_in(), "a session of another time lives at {jump}");
        let anna = Person::log_in(&daemon);
        assert!(anna.is_in());
        set(jump + 2 * DAY);
        assert!(!anna.is_in(), "a session lives for two days without use");
    }
    // Whoever guesses passwords gains nothing by it.
    let tries: Vec<u16> = (0..7).map(|_| Person::try_password(&daemon, "wrong").status).collect();
    assert_eq!(*tries.last().unwrap(), 429, "{tries:?}");
    set(9000 * DAY);
    assert_eq!(Person::try_password(&daemon, "wrong").status, 429);
    // Nor does the printer notice.
    daemon.wait_job(&printed, "finished");
    let next = daemon.queue(&daemon.upload("next.gcode", job(1, 20).as_bytes()), "mock");
    daemon.wait_job(&next, "finished");
    let listed = daemon.see("/api/v2/jobs");
    assert_eq!(listed.as_array().unwrap().len(), 2);
    daemon.end();
    // Started at a time before all that is written down, nothing is lost either.
    set(-9000 * DAY);
    let daemon = Daemon::start(state.path(), &config(&mock.path("tty"), "reorder = false"));
    assert_eq!(daemon.see("/api/v2/files").as_array().unwrap().len(), 2);
    daemon.wait_printer("mock", "ready");
    let last = daemon.queue(&daemon.upload("last.gcode", job(2, 20).as_bytes()), "mock");
    daemon.wait_job(&last, "finished");
    daemon.end();
    let stats = mock.stats();
    assert_eq!(stats["moves"].as_u64(), Some(800 + 20 + 20 + 3), "{stats}");
}

// ---- the cable ----

/// Unplugs a mock: its terminal goes, and what the board knew.
fn unplug(mock: &mut Mock) {
    mock.child.kill().unwrap();
    mock.child.wait().unwrap();
    fs::remove_file(mock.path("tty")).unwrap();
}

fn plug_in(mock: &mut Mock, speed: &str) {
    mock.child = Command::new(BINARY)
        .current_dir(mock.folder.path())
        .args(["mock", "--link", "tty", "--stats", "stats.json", "--baud", "0", "--speed", speed])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
}

#[test]
fn a_printer_that_is_unplugged_is_shown_and_comes_back() {
    let mut mock = Mock::steady(&["--speed", "20"], "");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(&mock.path("tty"), "reorder = false"));
    daemon.wait_printer("mock", "ready");

    // While nothing is printed.
    unplug(&mut mock);
    daemon.wait_printer("mock", "connecting");
    let queued = daemon.queue(&daemon.upload("part.gcode", job(0, 1000).as_bytes()), "mock");
    let queued_job = daemon.wait_job(&queued, "queued");
    wait_until("why", || {
        let printer = daemon.see("/api/v2/printers/mock");
        std::thread::sleep(Duration::from_millis(50));
        printer["error"].as_str().is_some_and(|why| !why.is_empty())
            && printer["temperatures"]["nozzle"].is_null()
    });
    assert!(queued_job["started_unix_s"].is_null(), "{queued_job}");
    plug_in(&mut mock, "20");

    // It goes on by itself; and is unplugged while it is printed.
    daemon.wait_job(&queued, "printing");
    wait_until("some of it printed", || mock.now()["moves"].as_u64() > Some(100));
    unplug(&mut mock);
    let lost = daemon.wait_job(&queued, "lost");
    assert!(lost["waits_for"].as_str().unwrap().contains("port"), "{lost}");
    assert!(lost["can"].as_array().unwrap().contains(&json!("cancel")), "{lost}");
    assert_eq!(daemon.see("/api/v2/printers/mock")["state"], "busy");
    plug_in(&mut mock, "20");
    // A board that has forgotten where it is moves only after a yes.
    let broken = daemon.wait_job(&queued, "interrupted");
    assert!(broken["waits_for"].as_str().unwrap().contains("you"), "{broken}");
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(mock.now()["moves"].as_u64().unwrap_or(0), 0, "it moved without a yes");
    let cancelled =
        daemon.post(&format!("/api/v2/jobs/{}/actions", id(&queued)), &json!({"action": "cancel"}));
    assert_eq!(cancelled.status, 200, "{}", cancelled.text());
    daemon.wait_job(&queued, "cancelled");
    let next = daemon.queue(&daemon.upload("next.gcode", job(1, 20).as_bytes()), "mock");
    daemon.wait_job(&next, "finished");
    daemon.end();
}

// ---- rubbish ----

/// A daemon that believes what a proxy says of addresses: no source here asks too often.
fn behind_a_proxy(state: &Path) -> Daemon {
    let config = "[server]\nmdns = false\ntrusted_proxies = ['127.0.0.1']\n[storage]\nmin_free_mb = 0\n\
                  [[printer]]\nid = 'mock'\nprofile = 'ender-3'\nport = '/dev/does-not-exist'\n";
    Daemon::start(state, config)
}

/// Longest answer that anything here gives, bytes: the page's largest file is smaller.
const LONGEST: usize = 2 << 20;

#[track_caller]
fn bounded(what: &str, answer: Option<(u16, Vec<u8>)>, most_status: u16) -> u16 {
    let Some((status, body)) = answer else { return 0 };
    assert!(status <= most_status, "{what}: {status} {}", String::from_utf8_lossy(&body));
    assert!(body.len() <= LONGEST, "{what}: {} bytes", body.len());
    status
}

#[test]
fn rubbish_is_refused() {
    let state = tempfile::tempdir().unwrap();
    let daemon = behind_a_proxy(state.path());
    let (to, key) = (daemon.address, daemon.key.as_str());
    let with = |start: &str, headers: &str, body: &[u8]| {
        let head = format!("{start} HTTP/1.1\r\nHost: {to}\r\nConnection: close\r\n{headers}\r\n");
        [head.as_bytes(), body].concat()
    };
    let keyed = format!("X-Api-Key: {key}\r\n");
    // Each is refused or dropped, without an answer that says it was done.
    let long = "a".repeat(1 << 20);
    let many: String = (0..500).map(|n| format!("X-{n}: 1\r\n")).collect();
    for (what, bytes) in [
        ("a long header", with("GET /api/v2/printers", &format!("{keyed}X-Long: {long}\r\n"), b"")),
        ("a long address", with(&format!("GET /{long}"), &keyed, b"")),
        ("a long method", with(&format!("{long} /"), &keyed, b"")),
        ("many headers", with("GET /api/v2/printers", &(keyed.clone() + &many), b"")),
        ("a header without end", format!("GET / HTTP/1.1\r\nX: {long}").into_bytes()),
        ("no length at all", with("POST /api/v2/jobs", &format!("{keyed}Content-Length: x\r\n"), b"")),
        ("a negative length", with("POST /api/v2/jobs", &format!("{keyed}Content-Length: -1\r\n"), b"")),
        (
            "a vast length",
            with("POST /api/v2/jobs", &format!("{keyed}Content-Length: 99999999999999999999999\r\n"), b""),
        ),
        (
            "two lengths",
            with("POST /api/v2/jobs", &format!("{keyed}Content-Length: 1\r\nContent-Length: 2\r\n"), b"{}"),
        ),
        (
            "a bad chunk",
            with("POST /api/v2/jobs", &format!("{keyed}Transfer-Encoding: chunked\r\n"), b"zz\r\n"),
        ),
        (
            "an odd coding",
            with("POST /api/v2/jobs", &format!("{keyed}Transfer-Encoding: gzip\r\n"), b"zz\r\n"),
        ),
        ("a fold", with("GET /api/v2/printers", &format!("{keyed}X: a\r\n b\r\n"), b"")),
        ("a nul", with("GET /api/v2/printers", &format!("{keyed}X: a\0b\r\n"), b"")),
        ("TLS", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03".repeat(10)),
        ("HTTP/2", b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n".to_vec()),
        ("HTTP/0.9", b"GET /\r\n\r\n".to_vec()),
        ("zeros", vec![0; 1 << 20]),
    ] {
        let began = Instant::now();
        let status = bounded(what, raw(to, &bytes), 499);
        assert!([0].contains(&status) || (400..500).contains(&status), "{what}: {status}");
        assert!(began.elapsed() < Duration::from_secs(20), "{what}: {:?}", began.elapsed());
    }
    // Two ways to tell the length at once are how requests are smuggled: never two requests of one.
    let two = with(
        "POST /api/v2/jobs",
        &format!("{keyed}Content-Length: 5\r\nTransfer-Encoding: chunked\r\n"),
        b"0\r\n\r\nGET / HTTP/1.1\r\n\r\n",
    );
    assert!(bounded("both lengths", raw(to, &two), 499) >= 400);

    let deep = "[".repeat(100_000);
    let over = format!("\"{}\"", "a".repeat(1 << 20));
    let json_kind = format!("{keyed}Content-Type: application/json\r\n");
    for path in [
        "/api/v2/session",
        "/api/v2/session/confirm",
        "/api/v2/setup",
        "/api/v2/jobs",
        "/api/v2/jobs/J0123456789abcdef01234567/actions",
        "/api/v2/printers/mock/actions",
        "/api/v2/printers/mock/heat",
        "/api/v2/printers/mock/jog",
        "/api/v2/printers/mock/gcode",
        "/api/v2/users",
        "/api/v2/keys",
        "/api/job",
        "/api/printer/command",
        "/api/printer/printhead",
        "/api/printer/tool",
        "/api/printer/bed",
        "/api/connection",
        "/plugin/appkeys/request",
        "/printer/gcode/script",
        "/printer/print/start",
    ] {
        for body in [
            b"".as_slice(),
            b"{",
            b"[]",
            b"null",
            b"\xff\xfe{}",
            b"{\"action\": 1e999, \"nozzle_c\": 1e999, \"x_mm\": 1e999}",
            b"{\"action\": \"answer\", \"choice\": -1}",
            b"{\"file\": {}, \"file\": [], \"printer\": \"mock\"}",
            b"{\"commands\": []}",
            deep.as_bytes(),
            over.as_bytes(),
        ] {
            let length = format!("{json_kind}Content-Length: {}\r\n", body.len());
            let what = format!("{path} {}", String::from_utf8_lossy(&body[..body.len().min(40)]));
            let status = bounded(&what, raw(to, &with(&format!("POST {path}"), &length, body)), 499);
            assert!(status != 0, "{what}: no answer");
        }
    }

    let part = "Content-Disposition: form-data; name=\"file\"; filename=\"a.gcode\"\r\n";
    let vast = format!("--B\r\n{part}X: {long}\r\n\r\nG28\r\n--B--\r\n");
    let crowd: String = (0..20_000)
        .map(|n| format!("--B\r\nContent-Disposition: form-data; name=\"x{n}\"\r\n\r\n1\r\n"))
        .collect();
    let before = kept(state.path());
    for path in ["/api/v2/files", "/api/files/local", "/server/files/upload"] {
        for (kind, body) in [
            ("multipart/form-data", "--B\r\n\r\n\r\n--B--\r\n".to_owned()),
            ("multipart/form-data; boundary=", "--\r\n".to_owned()),
            ("multipart/form-data; boundary=B", String::new()),
            ("multipart/form-data; boundary=B", "G28\n".to_owned()),
            ("multipart/form-data; boundary=B", "--B--\r\n".to_owned()),
            ("multipart/form-data; boundary=B", format!("--B\r\n{part}\r\nG28\n")),
            ("multipart/form-data; boundary=B", format!("--B\r\n{part}\r\nG28\n\r\n--C--\r\n")),
            (
                "multipart/form-data; boundary=B",
                "--B\r\nContent-Disposition: \0\r\n\r\nG28\r\n--B--\r\n".to_owned(),
            ),
            ("multipart/form-data; boundary=B", part.replace("a.gcode", "../..")),
            ("multipart/form-data; boundary=B", vast.clone()),
            ("multipart/form-data; boundary=B", crowd.clone()),
        ] {
            let headers = format!("{keyed}Content-Type: {kind}\r\nContent-Length: {}\r\n", body.len());
            let what = format!("{path} {kind} {} … {} bytes", &body[..body.len().min(90)], body.len());
            let status =
                bounded(&what, raw(to, &with(&format!("POST {path}"), &headers, body.as_bytes())), 499);
            assert!(status >= 400, "{what}: {status}");
        }
        // An upload whose client goes away in the middle of it.
        let headers =
            format!("{keyed}Content-Type: multipart/form-data; boundary=B\r\nContent-Length: 1000000\r\n");
        let mut stream = TcpStream::connect(to).unwrap();
        stream
            .write_all(&with(&format!("POST {path}"), &headers, format!("--B\r\n{part}\r\nG28\n").as_bytes()))
            .unwrap();
        drop(stream);
    }
    wait_until("what was begun to be gone", || kept(state.path()) == before);
    daemon.end();
}

const VARIATIONS: u64 = 10_000;

#[test]
fn ten_thousand_odd_requests_are_answered_in_order() {
    let known: Vec<&[u8]> = [
        "/",
        "/index.html",
        "/assets/main.js",
        "/metrics",
        "/api/v2/session",
        "/api/v2/printers",
        "/api/v2/printers/mock",
        "/api/v2/printers/mock/console",
        "/api/v2/printers/mock/temperatures",
        "/api/v2/printers/mock/queue",
        "/api/v2/files",
        "/api/v2/files?name=a.gcode&printer=mock",
        "/api/v2/files/F0123456789abcdef01234567",
        "/api/v2/files/F0123456789abcdef01234567/content",
        "/api/v2/files/F0123456789abcdef01234567/check?printer=mock",
        "/api/v2/files/F0123456789abcdef01234567/pictures/layers?printer=mock",
        "/api/v2/jobs?printer=mock",
        "/api/v2/jobs/J0123456789abcdef01234567",
        "/api/v2/jobs/J0123456789abcdef01234567/pictures/paths",
        "/api/v2/users/bo",
        "/api/v2/keys/requests",
        "/api/v2/events",
        "/api/v2/openapi.json",
        "/api/version",
        "/api/printer?exclude=temperature,sd",
        "/api/job",
        "/api/files?recursive=true",
        "/api/files/local/a.gcode",
        "/downloads/files/local/a.gcode",
        "/api/settings",
        "/api/printerprofiles/_default",
        "/plugin/appkeys/request/abc",
        "/api/v1/status",
        "/api/v1/files/local/a.gcode",
        "/server/info",
        "/printer/info",
        "/printer/objects/query?print_stats&heater_bed=temperature",
        "/server/files/list?root=gcodes",
        "/server/files/metadata?filename=a.gcode",
        "/machine/system_info",
        "/access/oneshot_token",
        "/websocket?token=abc",
        "/p/mock/api/version",
        "/p/mock",
    ]
    .map(str::as_bytes)
    .to_vec();
    let odd: [&[u8]; 14] = [
        b"%00",
        b"..%2f",
        b"../",
        b"%2e%2e",
        b"//",
        b"\\",
        b"?",
        b"#",
        b"%",
        b"%zz",
        b"%ff%fe",
        b"\xc3\xa4",
        b"&printer=",
        b";",
    ];
    let methods =
        ["GET", "GET", "GET", "GET", "HEAD", "OPTIONS", "PUT", "PATCH", "DELETE", "POST", "TRACE", "BREW"];
    let state = tempfile::tempdir().unwrap();
    let daemon = behind_a_proxy(state.path());
    let (to, key) = (daemon.address, daemon.key.as_str());
    let counts = std::sync::Mutex::new(BTreeMap::<u16, u32>::new());
    std::thread::scope(|scope| {
        for thread in 1..=4_u64 {
            let (known, counts) = (&known, &counts);
            scope.spawn(move || {
                let mut dice = Dice(thread * 0x2545_f491_4f6c_dd1d);
                for n in 0..VARIATIONS / 4 {
                    let mut path = known[dice.roll(known.len() as u64) as usize].to_vec();
                    for _ in 0..dice.roll(4) {
                        let at = 1 + dice.roll(path.len() as u64) as usize;
                        let at = at.min(path.len());
                        match dice.roll(4) {
                            0 => drop(path.splice(at..at, odd[dice.roll(odd.len() as u64) as usize].iter().copied())),
                            1 => drop(path.splice(at..at, [dice.roll(256) as u8])),
                            2 => path.truncate(at),
                            _ => {
                                let more: Vec<u8> = (0..dice.roll(300)).map(|_| b'!' + dice.roll(94) as u8).collect();
                                drop(path.splice(at..at, more));
                            }
                        }
                    }
                    let method = methods[dice.roll(methods.len() as u64) as usize];
                    let body: Vec<u8> = match dice.roll(4) {
                        0 => (0..dice.roll(64)).map(|_| dice.roll(256) as u8).collect(),
                        _ => Vec::new(),
                    };
                    let from = format!("10.{thread}.{}.{}", n / 200, n % 200);
                    let kind = ["application/json", "text/plain", "multipart/form-data; boundary=B"][dice.roll(3) as usize];
                    let head = format!(
                        " HTTP/1.1\r\nHost: {to}\r\nConnection: close\r\nX-Api-Key: {key}\r\nX-Forwarded-For: {from}\r\n\
                         Content-Type: {kind}\r\nContent-Length: {}\r\n\r\n",
                        body.len()
                    );
                    let what = format!("{method} {}", String::from_utf8_lossy(&path));
                    let bytes = [method.as_bytes(), b" ", &path, head.as_bytes(), &body].concat();
                    let status = bounded(&what, raw(to, &bytes), 499);
                    *counts.lock().unwrap().entry(status).or_default() += 1;
                }
            });
        }
    });
    let counts = counts.into_inner().unwrap();
    eprintln!("{counts:?}");
    assert_eq!(counts.get(&429), None, "{counts:?}: not looked at");
    assert_eq!(counts.get(&0), None, "{counts:?}: not answered");
    daemon.end();
}

/// Heads are waited for so long.
const HEAD: Duration = Duration::from_secs(15);

#[test]
fn heads_that_never_end_are_given_up() {
    let state = tempfile::tempdir().unwrap();
    let daemon = behind_a_proxy(state.path());
    let answered_in = || {
        let began = Instant::now();
        assert_eq!(daemon.get("/api/v2/printers").status, 200);
        began.elapsed()
    };
    let slow = |many: usize| -> Vec<TcpStream> {
        (0..many)
            .map(|_| {
                let mut stream = TcpStream::connect(daemon.address).unwrap();
                stream.write_all(b"GET /api/v2/printers HTTP/1.1\r\nHost: a\r\nX: ").unwrap();
                stream.set_read_timeout(Some(2 * HEAD)).unwrap();
                stream
            })
            .collect()
    };
    let began = Instant::now();
    let mut held = slow(400);
    assert!(answered_in() < Duration::from_secs(2), "400 slow ones hold up another one");
    // More than are served at a time: others wait until the first are given up.
    held.extend(slow(200));
    for stream in &mut held {
        // One byte more now and then does not give more time.
        let _ = stream.write_all(b"a");
    }
    let waited = answered_in();
    eprintln!("with 600 slow heads a request was answered after {waited:.1?}");
    assert!(waited < HEAD + Duration::from_secs(5), "{waited:?}");
    for stream in &mut held {
        let mut rest = Vec::new();
        let _ = stream.read_to_end(&mut rest);
    }
    let over = began.elapsed();
    assert!(over < 2 * HEAD + Duration::from_secs(10), "the last was given up after {over:?}");
    assert!(answered_in() < Duration::from_secs(2));
    daemon.end();
}

#[test]
fn bodies_that_never_come_are_given_up() {
    let state = tempfile::tempdir().unwrap();
    let daemon = behind_a_proxy(state.path());
    // No key is needed for it: the body is read to see who logs in.
    let silent = b"POST /api/v2/session HTTP/1.1\r\nHost: a\r\nContent-Type: application/json\r\nContent-Length: 99\r\n\r\n{";
    let held: Vec<_> = (0..520)
        .map(|_| {
            let mut stream = TcpStream::connect(daemon.address).unwrap();
            stream.write_all(silent).unwrap();
            stream
        })
        .collect();
    let began = Instant::now();
    assert_eq!(daemon.get("/api/v2/printers").status, 200);
    assert!(began.elapsed() < Duration::from_secs(60), "{:?}", began.elapsed());
    drop(held);
    daemon.end();
}

#[test]
fn one_address_does_not_keep_out_others() {
    use rustix::net::{AddressFamily, SocketType, bind, connect, socket};
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(Path::new("/dev/does-not-exist"), ""));
    let mut held: Vec<_> = (0..400).map(|_| TcpStream::connect(daemon.address).unwrap()).collect();
    // The last ones were closed at once; waiting for their heads would take longer.
    let last = held.last_mut().unwrap();
    last.set_read_timeout(Some(HEAD / 2)).unwrap();
    assert!(matches!(last.read(&mut [0]), Ok(0) | Err(_)));
    let from_elsewhere = socket(AddressFamily::INET, SocketType::STREAM, None).unwrap();
    let other: SocketAddr = "127.0.0.2:0".parse().unwrap();
    bind(&from_elsewhere, &other).unwrap();
    connect(&from_elsewhere, &daemon.address).unwrap();
    let mut other = TcpStream::from(from_elsewhere);
    other.set_read_timeout(Some(HEAD / 2)).unwrap();
    other.write_all(b"GET /api/v2/session HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n").unwrap();
    assert!(read_answer(&mut other).status < 500);
    drop(held);
    daemon.end();
}
