//! The page in a browser, against the real daemon: a person's way from the log-in over a job that would begin in the air to
//! its end, by `tests/page/page.mjs`. Skipped where there is no node, no Chromium, or `npm ci` was not run in `tests/page`.
mod common;

use common::http::{Daemon, PASSWORD};
use common::printer::{Mock, text};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// So fast that the lamp's ten minutes are half of one, and yet pause and cancel find it printing.
const SPEED: &str = "30";

/// Somewhere on the path.
fn found(names: &[&str]) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let folders: Vec<_> = std::env::split_paths(&path).collect();
    names
        .iter()
        .flat_map(|name| folders.iter().map(move |folder| folder.join(name)))
        .find(|place| place.is_file())
}

/// What the script needs and is not here.
fn missing(folder: &Path) -> Option<&'static str> {
    let named = std::env::var_os("CHROMIUM").map(PathBuf::from).filter(|place| place.is_file());
    if found(&["node"]).is_none() {
        Some("no node")
    } else if named.or_else(|| found(&["chromium", "chromium-browser", "google-chrome"])).is_none() {
        Some("no Chromium: CHROMIUM can name one")
    } else if !folder.join("node_modules").is_dir() {
        Some("no tests/page/node_modules: run `npm ci` there")
    } else {
        None
    }
}

#[test]
fn a_person_goes_through_the_page() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = root.join("tests/page");
    if let Some(what) = missing(&folder) {
        // Past the harness, which keeps what a passing test prints.
        let _ = std::io::Write::write_all(&mut std::io::stdout(), format!("skipped: {what}\n").as_bytes());
        return;
    }
    let mock = Mock::start(&["--speed", SPEED]);
    let state = tempfile::tempdir().unwrap();
    let config = format!(
        "[server]\nmdns = false\n[[printer]]\nid = 'mock'\nprofile = 'generic-marlin'\nport = '{}'\nmacros = false\n",
        mock.path("tty").display()
    );
    let daemon = Daemon::start(state.path(), &config);
    daemon.wait_printer("mock", "ready");
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page");
    let run = Command::new("node")
        .arg(folder.join("page.mjs"))
        .arg(format!("http://{}/", daemon.address))
        .args(["anna", PASSWORD])
        .arg(root.join("gcode/corpus/lamp.gcode"))
        .arg(&pictures)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let said = text(&run.stdout);
    let log = daemon.log();
    assert!(run.status.success(), "{said}\n{}\npictures: {}\n{log}", text(&run.stderr), pictures.display());
    assert!(!log.contains("panicked"), "{log}");
    let _ = std::io::Write::write_all(&mut std::io::stdout(), said.as_bytes());
    daemon.end();
}
