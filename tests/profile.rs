//! `outrigger profile` through the real binary.
use std::process::{Command, Output};

fn run(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_outrigger")).arg("profile").args(args).output().unwrap()
}

/// Exit code, and words on standard output and on standard error.
fn check(args: &[&str], code: i32, out: &str, err: &str) {
    let found = run(args);
    let said = String::from_utf8(found.stdout).unwrap();
    let complained = String::from_utf8(found.stderr).unwrap();
    assert_eq!(found.status.code(), Some(code), "{args:?}: {complained}");
    assert!(said.contains(out), "{args:?}: {said}");
    assert!(complained.contains(err), "{args:?}: {complained}");
    assert!(err.is_empty() == complained.is_empty(), "{args:?}: {complained}");
}

#[test]
fn list_and_show() {
    check(&["list"], 0, "prusa-mk3s", "");
    check(&["list", "--json"], 0, "\"title\": \"PLA (polylactic acid)\"", "");
    check(&["show", "ender-3"], 0, "# Bore of the stock nozzle, mm\nnozzle_mm = 0.4\n", "");
    check(&["show", "petg"], 0, "density_g_cm3 = 1.27", "");
    check(
        &["show", "resin-tough"],
        0,
        "# Longest span between two supported ends that prints unsupported (0: none), mm\nbridge_mm = 2.0\n",
        "",
    );
    check(&["show", "ender-3", "--json"], 0, "\"dtr_reset\": true", "");
    check(&["list"], 0, "generic-msla          msla      Any resin printer", "");
    check(&["list", "--json"], 0, "\"kind\": \"msla\"", "");
    check(&["show", "generic-msla"], 0, "lift.slow_mm_min = 40.0\n", "");
    check(&["show", "ender-33"], 1, "", "did you mean ender-3?");
    check(&["show"], 2, "", "Usage");
}

#[test]
fn what_is_shown_can_be_changed_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    let mine = folder.path().join("mine.toml");
    let path = mine.to_str().unwrap();
    let shown = String::from_utf8(run(&["show", "ender-3"]).stdout).unwrap();
    let named = shown.replace("name = \"ender-3\"", "name = \"mine\"");
    std::fs::write(&mine, &named).unwrap();
    check(&["check", path], 0, "fdm printer \"mine\" is valid", "");
    let wrong = named.replace("max_line", "max_lines");
    std::fs::write(&mine, &wrong).unwrap();
    let line = 1 + wrong.lines().position(|l| l.starts_with("max_lines")).unwrap();
    let complaint =
        format!("mine.toml, line {line}: unknown key serial.max_lines; did you mean serial.max_line?");
    check(&["check", path], 1, "", &complaint);
    check(&["check", path, "/none.toml"], 1, "", "/none.toml");
    std::fs::write(&mine, [0xff, 0xfe, 0]).unwrap();
    check(&["check", path], 1, "", "UTF-8");
    check(&["check", folder.path().to_str().unwrap()], 1, "", "directory");
}
