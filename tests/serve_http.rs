//! What the daemon says to those who come from outside: configuration, users, limits, headers.
mod common;

use common::http::{Daemon, PASSWORD, exchange, poll_until, user};
use common::{outrigger, printer::text};
use serde_json::json;
use std::process::{Command, Stdio};

const BARE: &str = "[server]\nmdns = false\n";

fn daemon() -> (Daemon, tempfile::TempDir) {
    let state = tempfile::tempdir().unwrap();
    (Daemon::start(state.path(), BARE), state)
}

#[test]
fn a_wrong_configuration_is_told_with_its_line_and_the_nearest_name() {
    let folder = tempfile::tempdir().unwrap();
    let check = |config: &str, code: i32, words: &[&str]| {
        std::fs::write(folder.path().join("o.toml"), config).unwrap();
        let run = outrigger(folder.path(), ["serve", "--config", "o.toml", "--print-config"]);
        assert_eq!(run.code, Some(code), "{run:?}");
        for word in words {
            assert!(run.stderr.contains(word) || run.stdout.contains(word), "{word}: {run:?}");
        }
    };
    check("[server]\nlistne = []\n", 2, &["o.toml: line 2", "did you mean server.listen?"]);
    check("[[printer]]\nid = 'a'\nprofile = 'ender3'\nport = 'auto'\n", 2, &["did you mean ender-3?"]);
    check("", 0, &["max_upload_mb = 512", "[[printer]]", "# Largest file that is taken, MB"]);
    let run = outrigger(folder.path(), ["serve", "--config", "missing.toml"]);
    assert_eq!(run.code, Some(2), "{run:?}");
    // What is printed is a configuration.
    let printed = outrigger(folder.path(), ["serve", "--print-config"]).stdout;
    std::fs::write(folder.path().join("o.toml"), &printed).unwrap();
    assert_eq!(outrigger(folder.path(), ["serve", "--config", "o.toml", "--print-config"]).stdout, printed);
}

#[test]
fn users_and_keys_are_made_beside_a_running_daemon() {
    let (mut daemon, state) = daemon();
    let key = user(state.path(), &["key", "slicer", "--scopes", "read"], "");
    // A key that is not known yet would count as a guess: the list is asked for.
    poll_until("the daemon to notice", || {
        daemon.see("/api/v2/keys").as_array().unwrap().iter().any(|key| key["name"] == "slicer")
    });
    let mine = std::mem::replace(&mut daemon.key, key.clone());
    assert_eq!(daemon.get("/api/v2/printers").status, 200);
    // A key has its scopes and no more.
    assert_eq!(daemon.send("POST", "/api/v2/files?name=a.gcode", &[], b"G28").status, 403);
    assert_eq!(daemon.get("/api/v2/users").status, 403);
    daemon.key = mine;
    let id =
        daemon.see("/api/v2/keys").as_array().unwrap().iter().find(|k| k["name"] == "slicer").unwrap()["id"]
            .clone();
    let path = format!("/api/v2/keys/{}", id.as_str().unwrap());
    assert_eq!(daemon.send("DELETE", &path, &[], b"").status, 204);
    daemon.key = key;
    assert_eq!(daemon.get("/api/v2/printers").status, 401, "revoked");
    let list = user(state.path(), &["list"], "");
    assert!(list.contains("anna") && !list.contains("slicer"), "{list}");
    daemon.end();
    // The last admin stays.
    let mut out = Command::new(common::printer::BINARY);
    let out = out.arg("user").arg("--state").arg(state.path()).args(["remove", "anna"]).output().unwrap();
    assert!(!out.status.success() && text(&out.stderr).contains("admin"), "{out:?}");
}

#[test]
fn guessing_passwords_is_slowed_down() {
    let (daemon, _state) = daemon();
    let body = json!({"name": "anna", "password": "wrong wrong"}).to_string();
    let headers = [("Content-Type", "application/json"), ("X-Api-Key", "")];
    // Headers that claim to come from elsewhere are nobody's word.
    let guess = |n: u32| {
        let from = format!("10.0.0.{n}");
        let headers = [&headers[..1], &[("X-Forwarded-For", from.as_str())]].concat();
        daemon.send("POST", "/api/v2/session", &headers, body.as_bytes())
    };
    let limited = (0..30).map(guess).find(|answer| answer.status == 429).expect("no limit in thirty tries");
    assert!(limited.header("retry-after").unwrap().parse::<u64>().unwrap() >= 1);
    let log = daemon.end();
    assert!(!log.contains("wrong wrong"), "{log}");
}

#[test]
fn every_answer_tells_browsers_what_they_may() {
    let (daemon, _state) = daemon();
    for path in ["/", "/api/v2/session", "/nothing"] {
        let answer = daemon.get(path);
        let policy = answer.header("content-security-policy").unwrap();
        assert!(policy.contains("default-src 'self'") && !policy.contains("unsafe"), "{policy}");
        assert_eq!(answer.header("x-content-type-options"), Some("nosniff"), "{path}");
        assert_eq!(answer.header("x-frame-options"), Some("SAMEORIGIN"), "{path}");
    }
    // What somebody uploaded is never shown by a browser.
    let evil = "<script>alert(1)</script>";
    let file = daemon.upload("x.html", evil.as_bytes());
    let content = daemon.get(&format!("/api/v2/files/{}/content", file["id"].as_str().unwrap()));
    assert!(content.header("content-disposition").unwrap().starts_with("attachment"));
    assert_eq!(content.header("content-type"), Some("application/octet-stream"));
    daemon.end();
}

#[test]
fn a_page_from_elsewhere_gets_no_events_and_log_and_metrics_no_keys() {
    let (daemon, _state) = daemon();
    let open = |more: &str| {
        let request = format!(
            "GET /api/v2/events HTTP/1.1\r\nHost: {}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{more}\r\n",
            daemon.address
        );
        exchange(daemon.address, request.as_bytes()).status
    };
    let key = format!("X-Api-Key: {}\r\n", daemon.key);
    assert_eq!(open(&key), 101);
    assert_eq!(open(""), 401);
    assert_eq!(open(&format!("{key}Origin: https://evil.example\r\n")), 403);
    assert_eq!(open(&format!("{key}Origin: http://{}\r\n", daemon.address)), 101);
    let metrics = daemon.get("/metrics");
    assert_eq!(metrics.status, 200);
    for name in ["outrigger_uptime_seconds", "outrigger_resident_memory_bytes", "outrigger_build{version="] {
        assert!(metrics.text().contains(name), "{}", metrics.text());
    }
    assert!(metrics.text().ends_with("# EOF\n"));
    let told = daemon.see("/api/v2/openapi.json");
    assert!(told["paths"]["/api/v2/jobs/{id}/actions"]["post"].is_object());
    let key = daemon.key.clone();
    let log = daemon.end();
    assert!(!log.contains(&key) && !log.contains(PASSWORD), "{log}");
}

#[test]
fn two_daemons_do_not_share_an_address() {
    let (daemon, _state) = daemon();
    let other = tempfile::tempdir().unwrap();
    let out = Command::new(common::printer::BINARY)
        .args(["serve", "--listen", &daemon.address.to_string(), "--state"])
        .arg(other.path())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let words = text(&out.stderr);
    assert!(out.status.code() == Some(1) && words.contains("cannot listen on"), "{words}");
    daemon.end();
}
