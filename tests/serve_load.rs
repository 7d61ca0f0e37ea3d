//! `outrigger serve` under load: 200 viewers, viewers that take nothing, and 20 uploads at once while
//! a job streams. The printer must not notice, and memory stays bounded.
#![cfg(target_os = "linux")]
mod common;

use common::http::Daemon;
use common::printer::{Mock, PATIENCE, commands, digest};
use serde_json::Value;
use sha2::{Digest, Sha256};
use std::fmt::Write as _;
use std::io::{BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const VIEWERS: usize = 200;

/// Viewers that never read: a page in a laptop that was closed.
const DEAF_VIEWERS: usize = 8;

/// A viewer that takes nothing is there for so long at least.
const STUCK: Duration = Duration::from_secs(20);

const UPLOADS: u32 = 20;
const UPLOAD_BYTES: usize = 1_000_000;

/// Most memory that the daemon ever has, MB (10⁶).
const PEAK_MB: f64 = 100.0;

/// The planner may be empty for so much more of the time than without load. A loaded test machine
/// holds the mock up as well; a daemon that stood still for one upload would show far more.
const EMPTY_SHARE: f64 = 0.05;

/// Moves of the job, 5 ms each: long enough for all that is done beside it.
const MOVES: u32 = 3000;

/// Moves of the run without load.
const QUIET_MOVES: u32 = 1200;

/// Short moves to and fro at 50 mm/s, as in a curved wall.
fn job(moves: u32) -> String {
    let mut text = String::from("G28\nG90\nM83\nG1 X20 Y20 Z0.2 F3000\n");
    let (mut x_mm, mut step_mm) = (20.0, 0.25);
    for n in 0..moves {
        x_mm += step_mm;
        if !(20.0..170.0).contains(&x_mm) {
            step_mm = -step_mm;
        }
        let _ = writeln!(text, "G1 X{x_mm:.3} Y{:.4}", 20.0 + f64::from(n) / 1000.0);
    }
    text
}

fn config(tty: &Path) -> String {
    // What is measured is the streaming: the job goes out as it is, whatever is found in it.
    format!(
        "[server]\nmdns = false\n[storage]\nmin_free_mb = 0\n[[printer]]\nid = 'mock'\nprofile = 'generic-marlin'\n\
         port = '{}'\nmacros = false\nreorder = false\non_findings = 'warn'\n",
        tty.display()
    )
}

/// A message that comes in frames of the server: RFC 6455, as far as servers speak it.
struct Viewer {
    stream: BufReader<TcpStream>,
}

impl Viewer {
    /// Opens the socket; the answer's head is read, and nothing after it.
    fn open(address: SocketAddr, key: &str) -> Self {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let head = format!(
            "GET /api/v2/events HTTP/1.1\r\nHost: {address}\r\nX-Api-Key: {key}\r\nConnection: Upgrade\r\n\
             Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).unwrap();
        let mut stream = BufReader::new(stream);
        let (mut answer, mut byte) = (Vec::new(), [0]);
        while !answer.ends_with(b"\r\n\r\n") {
            stream.read_exact(&mut byte).unwrap();
            answer.push(byte[0]);
        }
        let answer = String::from_utf8_lossy(&answer);
        assert!(answer.starts_with("HTTP/1.1 101"), "{answer}");
        // The value that RFC 6455 gives for this key.
        assert!(answer.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{answer}");
        Self { stream }
    }

    /// The next text; `None`: the server closes, or says nothing for long.
    fn next(&mut self) -> Option<Value> {
        loop {
            let mut head = [0; 2];
            self.stream.read_exact(&mut head).ok()?;
            let [first, length] = head;
            assert_eq!(first & 0xf0, 0x80, "one frame a message");
            assert_eq!(length & 0x80, 0, "servers do not mask");
            let length = match length {
                126 => u64::from(u16::from_be_bytes(self.bytes())),
                127 => u64::from_be_bytes(self.bytes()),
                short => u64::from(short),
            };
            assert!(length < 4 << 20, "a message of {length} bytes");
            let mut payload = vec![0; usize::try_from(length).unwrap()];
            self.stream.read_exact(&mut payload).unwrap();
            match first & 0x0f {
                1 => return Some(serde_json::from_slice(&payload).unwrap()),
                8 => return None,
                // Asked whether we are there: within the test nobody minds that we do not say.
                9 => {}
                other => panic!("a frame of kind {other}"),
            }
        }
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let mut bytes = [0; N];
        self.stream.read_exact(&mut bytes).unwrap();
        bytes
    }

    /// Looks on until the job is finished; gives how much it was told after the greeting.
    fn look_on(mut self, job: &str) -> usize {
        let hello = self.next().expect("a greeting");
        assert_eq!(hello["type"], "hello", "{hello}");
        assert_eq!(hello["printers"][0]["id"], "mock", "{hello}");
        let finished = |job_told: &Value| job_told["id"] == job && job_told["state"] == "finished";
        let mut told = 0;
        loop {
            let news = self.next().expect("the daemon goes on");
            told += 1;
            let over = match news["type"].as_str().unwrap() {
                "job" => finished(&news["job"]),
                // Whoever fell behind begins anew.
                "hello" => news["jobs"].as_array().unwrap().iter().any(finished),
                "printer" | "file" | "temperatures" | "console" | "gone" => false,
                other => panic!("news of the kind {other}"),
            };
            if over {
                return told;
            }
        }
    }
}

/// Prints a job; `beside` is done while it is printed. Gives the mock's counts.
fn print(moves: u32, beside: impl FnOnce(&Daemon, &str) -> Vec<JoinHandle<()>>) -> Value {
    let mock = Mock::steady(&["--speed", "1"], "");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(&mock.path("tty")));
    daemon.wait_printer("mock", "ready");
    let text = job(moves);
    let printed = daemon.queue(&daemon.upload("part.gcode", text.as_bytes()), "mock");
    daemon.wait_job(&printed, "printing");
    let others = beside(&daemon, printed["id"].as_str().unwrap());
    daemon.wait_job(&printed, "finished");
    for other in others {
        other.join().unwrap();
    }
    daemon.end();
    let stats = mock.stats();
    for wrong in ["lines_lost", "lines_repeated", "lines_out_of_order", "overflow_bytes", "resends_asked"] {
        assert_eq!(stats[wrong].as_u64(), Some(0), "{wrong}: {stats}");
    }
    assert_eq!(stats["all_digest"], digest(commands(&text)), "{stats}");
    stats
}

/// An upload's bytes: moves, so that it is a job, and no two are the same.
fn upload(number: u32) -> Vec<u8> {
    let mut text = format!("; upload {number}\n").into_bytes();
    let mut line = 0;
    while text.len() < UPLOAD_BYTES {
        text.extend(format!("G1 X{}.{line:03} Y{number}.5\n", 10 + line % 100).bytes());
        line += 1;
    }
    text.truncate(UPLOAD_BYTES);
    text
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn peak_mb(pid: u32) -> f64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).unwrap();
    line.trim().trim_end_matches("kB").trim().parse::<f64>().unwrap() * 1024.0 / 1e6
}

#[test]
fn viewers_and_uploads_do_not_disturb_the_printer() {
    let quiet = print(QUIET_MOVES, |_, _| Vec::new());
    let mut uploaded_s = 0.0;
    let mut peak = 0.0;
    let loaded = print(MOVES, |daemon, job| {
        let (address, key) = (daemon.address, daemon.key.clone());
        let deaf: Vec<_> = (0..DEAF_VIEWERS).map(|_| Viewer::open(address, &key)).collect();
        let looking: Vec<_> = (0..VIEWERS)
            .map(|_| {
                let (viewer, job) = (Viewer::open(address, &key), job.to_owned());
                std::thread::spawn(move || viewer.look_on(&job))
            })
            .collect();
        let began = Instant::now();
        let now = daemon.see(&format!("/api/v2/jobs/{job}"));
        assert_eq!(now["state"], "printing", "the load comes too late: {now}");
        std::thread::scope(|scope| {
            for number in 0..UPLOADS {
                scope.spawn(move || daemon.upload(&format!("{number}.gcode"), &upload(number)));
            }
        });
        uploaded_s = began.elapsed().as_secs_f64();
        let files = daemon.see("/api/v2/files");
        for number in 0..UPLOADS {
            let (name, bytes) = (format!("{number}.gcode"), upload(number));
            let file = files.as_array().unwrap().iter().find(|file| file["name"] == *name);
            let file = file.unwrap_or_else(|| panic!("{name} is not there"));
            assert_eq!(file["sha256"], hex(&Sha256::digest(&bytes)), "{file}");
            let id = file["id"].as_str().unwrap();
            let kept = daemon.get(&format!("/api/v2/files/{id}/content")).body;
            assert!(kept == bytes, "{name} came back as something else");
        }
        // All have looked on to the end of the job once these are joined.
        let told: Vec<usize> = looking.into_iter().map(|looks| looks.join().unwrap()).collect();
        let least = told.iter().min().unwrap();
        // Twice a second, and every upload.
        assert!(*least > 10, "one of the viewers was told {least} times only");
        peak = peak_mb(daemon.child.id());
        drop(deaf);
        Vec::new()
    });
    let share = |stats: &Value| stats["planner_empty_share"].as_f64().unwrap();
    let (quiet, loaded) = (share(&quiet), share(&loaded));
    eprintln!(
        "planner empty {quiet:.4} without load, {loaded:.4} with it; uploads {uploaded_s:.1} s; peak {peak:.1} MB"
    );
    assert!(
        loaded <= quiet + EMPTY_SHARE,
        "the planner was empty for {loaded:.3} of the time, else {quiet:.3}"
    );
    assert!(peak < PEAK_MB, "{peak:.1} MB");
    assert!(uploaded_s < Duration::from_secs(30).as_secs_f64(), "uploads took {uploaded_s:.1} s");
}

/// Sockets that a process has.
fn sockets(pid: u32) -> usize {
    let fds = std::fs::read_dir(format!("/proc/{pid}/fd")).unwrap();
    fds.flatten()
        .filter_map(|fd| std::fs::read_link(fd.path()).ok())
        .filter(|to| to.starts_with("socket:"))
        .count()
}

/// A viewer that takes nothing is let go at last, whatever is told meanwhile; another one hears all.
#[test]
fn a_viewer_that_takes_nothing_is_let_go() {
    let mock = Mock::steady(&["--speed", "100"], "");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(&mock.path("tty")));
    daemon.wait_printer("mock", "ready");
    let pid = daemon.child.id();
    // The last answers' connections are going; they count for nobody.
    let look = || {
        std::thread::sleep(Duration::from_millis(20));
        sockets(pid)
    };
    let none = (0..10).map(|_| look()).min().unwrap();
    let deaf: Vec<_> = (0..DEAF_VIEWERS).map(|_| Viewer::open(daemon.address, &daemon.key)).collect();
    let mut hears = Viewer::open(daemon.address, &daemon.key);
    let lines = std::thread::spawn(move || {
        let mut lines = 0;
        while let Some(news) = hears.next() {
            lines += news["lines"].as_array().map_or(0, Vec::len);
        }
        lines
    });
    let before = peak_mb(pid);
    let long = format!("M118 E1 {}", "x".repeat(80));
    let many = serde_json::json!({"commands": vec![long; 15]});
    // The console is what is told most of. Kernels hold a few MB for a reader, and 20 s it has then.
    let began = Instant::now();
    while began.elapsed() < STUCK || look() > none + 1 {
        assert!(began.elapsed() < PATIENCE, "{} more sockets than before", sockets(pid) - none);
        let said = daemon.post("/api/v2/printers/mock/gcode", &many);
        assert!([202, 409].contains(&said.status), "{}", said.text());
        std::thread::sleep(Duration::from_millis(15));
    }
    let grown = peak_mb(pid) - before;
    let took_s = began.elapsed().as_secs_f64();
    drop(deaf);
    daemon.end();
    let lines = lines.join().unwrap();
    eprintln!("let go after {took_s:.0} s; the other one heard {lines} lines; {grown:.1} MB more");
    assert!(lines > 1000, "the other one heard {lines} lines only");
    assert!(grown < 20.0, "{grown:.1} MB more");
}

/// Each admin sees who asks for a key, and that another one has answered.
#[test]
fn a_request_for_a_key_is_told_and_so_is_its_answer() {
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &config(Path::new("/dev/does-not-exist")));
    let mut viewer = Viewer::open(daemon.address, &daemon.key);
    let mut told = |kind: &str| loop {
        let news = viewer.next().expect("the daemon goes on");
        if news["type"] == kind {
            return news;
        }
    };
    told("hello");
    assert_eq!(daemon.post("/plugin/appkeys/request", &serde_json::json!({"app": "slicer"})).status, 201);
    let request = told("key_request");
    assert_eq!(request["app"], "slicer");
    let path = format!("/api/v2/keys/requests/{}", request["id"].as_str().unwrap());
    assert_eq!(daemon.post(&path, &serde_json::json!({"allow": false})).status, 204);
    assert_eq!(told("key_answered")["id"], request["id"]);
    daemon.end();
}
