//! A client for the tests: one request a connection over plain TCP, with none of the project's code;
//! and a daemon in a process of its own.
use super::printer::{BINARY, PATIENCE, signal, wait_for, wait_until};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// An answer.
#[derive(Debug, Clone)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    /// Names in lower case.
    pub(crate) headers: Vec<(String, String)>,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    pub(crate) fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {} {}", self.status, self.text()))
    }
}

/// Sends a request as it is, and reads the answer to its end.
pub(crate) fn exchange(to: SocketAddr, request: &[u8]) -> Answer {
    let mut stream = TcpStream::connect(to).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    // The other side may answer and close before it has taken all.
    let _ = stream.write_all(request);
    read_answer(&mut stream)
}

/// Reads one answer.
pub(crate) fn read_answer(stream: &mut TcpStream) -> Answer {
    let mut reader = BufReader::new(stream);
    let mut line = String::new();
    reader.read_line(&mut line).unwrap();
    let status = line.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or_else(|| panic!("{line:?}"));
    let mut headers = Vec::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).unwrap();
        let Some((name, value)) = line.trim_end().split_once(':') else { break };
        headers.push((name.to_ascii_lowercase(), value.trim().to_owned()));
    }
    let find = |name: &str| headers.iter().find(|(n, _)| n == name).map(|(_, v)| v.clone());
    let mut body = Vec::new();
    if status == 100 {
        return read_answer(reader.into_inner());
    }
    if find("transfer-encoding").as_deref() == Some("chunked") {
        loop {
            let mut size = String::new();
            reader.read_line(&mut size).unwrap();
            let size = usize::from_str_radix(size.trim(), 16).unwrap();
            let mut chunk = vec![0; size + 2];
            reader.read_exact(&mut chunk).unwrap();
            if size == 0 {
                break;
            }
            body.extend_from_slice(&chunk[..size]);
        }
    } else if let Some(length) = find("content-length") {
        body.resize(length.parse().unwrap(), 0);
        reader.read_exact(&mut body).unwrap();
    }
    Answer { status, headers, body }
}

/// A daemon in its own process, ended when dropped.
pub(crate) struct Daemon {
    pub(crate) child: Child,
    pub(crate) address: SocketAddr,
    pub(crate) state: PathBuf,
    log: Arc<Mutex<String>>,
    /// Sent with each request.
    pub(crate) key: String,
}

impl Daemon {
    /// A daemon with a configuration, over a data folder that may have been used before; it has an
    /// admin `anna` and an admin's key.
    pub(crate) fn start(state: &Path, config: &str) -> Self {
        let key = if state.join("auth.json").exists() {
            std::fs::read_to_string(state.join("key")).unwrap()
        } else {
            user(state, &["add", "anna"], PASSWORD);
            let key = user(state, &["key", "test", "--scopes", "read,print,control,admin"], "");
            std::fs::write(state.join("key"), &key).unwrap();
            key
        };
        Self::bare(state, config, key, &[])
    }

    /// The same without users and keys.
    pub(crate) fn bare(state: &Path, config: &str, key: String, flags: &[&str]) -> Self {
        std::fs::create_dir_all(state).unwrap();
        let file = state.join("outrigger.toml");
        std::fs::write(&file, config).unwrap();
        let mut child = Command::new(BINARY)
            .args(["serve", "--listen", "127.0.0.1:0", "--no-guard", "--config"])
            .arg(&file)
            .arg("--state")
            .arg(state)
            .args(flags)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let log = Arc::new(Mutex::new(String::new()));
        let (said, written) = (child.stderr.take().unwrap(), Arc::clone(&log));
        std::thread::spawn(move || {
            for line in BufReader::new(said).lines().map_while(Result::ok) {
                let mut log = written.lock().unwrap();
                log.push_str(&line);
                log.push('\n');
            }
        });
        let mut address = None;
        wait_until("the daemon to listen", || {
            let ended = child.try_wait().unwrap();
            let log = log.lock().unwrap();
            assert!(ended.is_none(), "the daemon has ended: {log}");
            let at = log.lines().find_map(|line| line.split("listening on http://").nth(1));
            address = at.and_then(|at| at.trim_end_matches('/').parse().ok());
            address.is_some()
        });
        Self { child, address: address.unwrap(), state: state.to_owned(), log, key }
    }

    pub(crate) fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// A request with the key and other headers.
    pub(crate) fn send(&self, method: &str, path: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut request = format!(
            "{method} {path} HTTP/1.1\r\nHost: {}\r\nConnection: close\r\nContent-Length: {}\r\n",
            self.address,
            body.len()
        );
        if !self.key.is_empty() && !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("x-api-key")) {
            request += &format!("X-Api-Key: {}\r\n", self.key);
        }
        for (name, value) in headers {
            request += &format!("{name}: {value}\r\n");
        }
        request += "\r\n";
        exchange(self.address, &[request.as_bytes(), body].concat())
    }

    pub(crate) fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], b"")
    }

    /// The JSON that a GET gives.
    pub(crate) fn see(&self, path: &str) -> Value {
        let answer = self.get(path);
        assert_eq!(answer.status, 200, "{path}: {}", answer.text());
        answer.json()
    }

    pub(crate) fn post(&self, path: &str, body: &Value) -> Answer {
        self.send("POST", path, &[("Content-Type", "application/json")], body.to_string().as_bytes())
    }

    /// Uploads a file; gives it as the daemon knows it.
    pub(crate) fn upload(&self, name: &str, bytes: &[u8]) -> Value {
        let answer = self.send("POST", &format!("/api/v2/files?name={name}"), &[], bytes);
        assert_eq!(answer.status, 201, "{}", answer.text());
        answer.json()
    }

    /// Queues a file; gives the job.
    pub(crate) fn queue(&self, file: &Value, printer: &str) -> Value {
        let answer = self.post("/api/v2/jobs", &serde_json::json!({"file": file["id"], "printer": printer}));
        assert_eq!(answer.status, 201, "{}", answer.text());
        answer.json()
    }

    /// Waits until a job is in a state, and gives it; one that ends otherwise is a fault.
    pub(crate) fn wait_job(&self, job: &Value, state: &str) -> Value {
        let path = format!("/api/v2/jobs/{}", job["id"].as_str().unwrap());
        let mut seen = Value::Null;
        poll_until(&format!("job to be {state}"), || {
            seen = self.see(&path);
            let now = seen["state"].as_str().unwrap();
            let over = ["finished", "failed", "cancelled"].contains(&now);
            assert!(!over || now == state, "wanted {state}: {seen}\n{}", self.log());
            now == state
        });
        seen
    }

    /// Waits until a printer is in a state, and gives it.
    pub(crate) fn wait_printer(&self, id: &str, state: &str) -> Value {
        let mut seen = Value::Null;
        poll_until(&format!("printer {id} to be {state}"), || {
            seen = self.see(&format!("/api/v2/printers/{id}"));
            seen["state"] == state
        });
        seen
    }

    /// Ends it in order.
    pub(crate) fn end(mut self) -> String {
        signal("TERM", &self.child);
        wait_for(&mut self.child);
        let log = self.log();
        assert!(!log.contains("panicked"), "{log}");
        log
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Between two questions to a daemon.
pub(crate) const POLL: Duration = Duration::from_millis(30);

/// Waits for something that a daemon is asked for: one source may not ask as often as it likes.
pub(crate) fn poll_until(what: &str, mut done: impl FnMut() -> bool) {
    wait_until(what, || {
        std::thread::sleep(POLL);
        done()
    });
}

/// The password of the tests' user.
pub(crate) const PASSWORD: &str = "correct horse battery";

/// `outrigger user …` with a password on standard input; gives what it says.
pub(crate) fn user(state: &Path, what: &[&str], password: &str) -> String {
    let mut child = Command::new(BINARY)
        .arg("user")
        .arg("--state")
        .arg(state)
        .args(what)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(format!("{password}\n").as_bytes()).unwrap();
    let out = child.wait_with_output().unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).trim().to_owned()
}
