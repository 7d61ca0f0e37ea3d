//! The import rules of ARCHITECTURE.md, read from the sources.
//!
//! A room is a folder or file of `src/`. A rule says which rooms a room may name
//! with `crate::`; what stands in `#[cfg(test)]` counts too. Names of outside
//! systems (serial ports, polygon libraries …) are held in one place likewise.
use std::path::{Path, PathBuf};

/// A room, and the rooms that it may import.
const RULES: &[(&str, &[&str])] = &[
    ("units.rs", &[]),
    ("causes.rs", &[]),
    ("mesh", &["units"]),
    ("resin", &["units"]),
    ("layers", &["mesh", "resin", "units"]),
    ("detect", &["layers", "mesh", "units"]),
    ("toolpath", &["layers", "units"]),
    ("support", &["detect", "layers", "mesh", "units"]),
    ("merge", &["layers", "mesh", "post", "resin", "support", "toolpath", "units"]),
    ("profile", &["units"]),
    ("printer", &["units"]),
    ("job", &["printer", "units"]),
    ("station", &["causes", "job", "printer", "profile", "resin", "units"]),
    // Of the daemon nobody but the verbs knows.
    ("server", &["causes", "job", "printer", "profile", "station", "units"]),
    ("post", &["toolpath", "units"]),
    ("report", &["detect", "layers", "post", "support", "toolpath", "units"]),
];

/// A crate or module of the outside, and the only places that may name it.
const ONLY: &[(&str, &[&str])] = &[
    ("serialport", &["src/printer/port"]),
    ("nix::sys", &["src/printer/port", "src/printer/mock/pty/"]),
    ("stl_io", &["src/mesh/stl.rs"]),
    ("i_overlay", &["src/layers/polygon.rs"]),
    ("geo_clipper", &["src/layers/polygon.rs"]),
    ("geo_types", &["src/layers/polygon.rs"]),
    ("tiny_skia", &["src/report/canvas/png.rs"]),
    (
        "png",
        &["src/printer/lcd/folder.rs", "src/report/canvas/png.rs", "src/resin/image", "src/resin/testing.rs"],
    ),
    ("zip", &["src/resin/archive", "src/resin/testing.rs"]),
    ("crc32fast", &["gcode/src/bgcode/", "src/job/journal"]),
    ("embedded_heatshrink", &["gcode/src/bgcode/"]),
    (
        "flate2",
        &[
            "gcode/src/bgcode/",
            "src/report/embed.rs",
            "src/resin/image.rs",
            "src/resin/testing.rs",
            "src/server/page.rs",
        ],
    ),
    (
        "sha2",
        &["src/job/digest.rs", "src/server/upload.rs", "src/server/again.rs", "src/server/auth/secret.rs"],
    ),
    ("axum", &["src/server/"]),
    ("hyper", &["src/server/http.rs"]),
    ("hyper_util", &["src/server/http.rs"]),
    ("tokio_rustls", &["src/server/http.rs"]),
    ("argon2", &["src/server/auth/password.rs"]),
    ("subtle", &["src/server/auth/"]),
    ("getrandom", &["src/server/auth/secret.rs", "src/server/shelf.rs"]),
    ("mdns_sd", &["src/server/discovery.rs"]),
    ("prometheus_client", &["src/server/metrics.rs"]),
    ("rust_embed", &["src/server/page.rs"]),
    ("sd_notify", &["src/server/systemd.rs"]),
    ("utoipa", &["src/server/"]),
    ("tracing", &["src/server/", "src/cli/serve.rs", "src/station/screen.rs", "src/station/watchdog.rs"]),
    ("tracing_subscriber", &["src/cli/serve.rs"]),
    ("rustyline", &["src/cli/console"]),
    ("indicatif", &["src/cli/"]),
    ("clap", &["src/cli/"]),
    (
        "std::fs",
        &[
            "src/cli/",
            "src/job/disk",
            "src/job/digest/tests.rs",
            "src/job/state/tests.rs",
            "src/printer/",
            "src/profile",
            "src/station/",
            "src/server/shelf.rs",
            "src/server/inspect.rs",
            "src/server/upload.rs",
            "src/server/foreman/tests.rs",
            "src/server/auth_desk.rs",
            "src/server/metrics.rs",
            "src/layers/from_gcode/tests.rs",
            "src/merge/testing.rs",
        ],
    ),
    ("std::time::Instant", &["src/cli/", "src/printer/port.rs", "src/printer/mock/", "src/server/"]),
];

fn sources() -> Vec<(String, String)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> = vec![root.join("src"), root.join("gcode/src")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder of sources") {
            let path = entry.expect("an entry").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|e| e == "rs") {
                let name = path.strip_prefix(root).expect("inside").to_string_lossy().into_owned();
                found.push((name, std::fs::read_to_string(&path).expect("a source")));
            }
        }
    }
    assert!(found.len() > 40, "the sources are where this test looks for them");
    found
}

/// The code of a line, without its comment.
fn code(line: &str) -> &str {
    line.split("//").next().unwrap_or_default()
}

/// Whether a line names a crate or one of its modules: `use png::…`, `png::Decoder`, not
/// `canvas::png::Png`.
fn names(line: &str, system: &str) -> bool {
    let word = |c: char| c.is_alphanumeric() || c == '_';
    let line = code(line);
    line.match_indices(system).any(|(at, _)| {
        let (before, after) = (&line[..at], &line[at + system.len()..]);
        let told = system.contains("::") || after.starts_with("::") || before.ends_with("use ");
        told && !before.ends_with(|c| word(c) || c == ':') && !after.starts_with(word)
    })
}

#[test]
fn a_crate_is_told_from_a_word() {
    for (line, named) in [
        ("use png::{Decoder, Encoder};", true),
        ("    Encode(#[from] png::EncodingError),", true),
        ("pub(crate) use png::ColorType;", true),
        ("use png as p;", true),
        ("use crate::report::canvas::png::Png;", false),
        ("let png = Png::new(apng::size());", false),
        ("// as png::Decoder has it", false),
    ] {
        assert_eq!(names(line, "png"), named, "{line}");
    }
    assert!(names("fn now() -> std::time::Instant {", "std::time::Instant"));
}

/// The rooms that a file names: `crate::post::…`, `use crate::{post, …}` is not used here.
fn rooms_named(text: &str) -> Vec<(usize, String)> {
    let mut rooms = Vec::new();
    for (number, line) in text.lines().enumerate() {
        for rest in code(line).split("crate::").skip(1) {
            let room: String = rest.chars().take_while(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
            rooms.push((number + 1, room));
        }
    }
    rooms
}

#[test]
fn rooms_import_only_what_they_may() {
    let mut broken = Vec::new();
    for (name, text) in sources() {
        let Some(within) = name.strip_prefix("src/") else { continue };
        let room = within.split('/').next().unwrap_or_default();
        let Some((own, allowed)) =
            RULES.iter().find(|(r, _)| r.trim_end_matches(".rs") == room.trim_end_matches(".rs"))
        else {
            assert!(["cli", "lib.rs", "main.rs"].contains(&room), "{name}: no rule for this room");
            continue;
        };
        for (line, named) in rooms_named(&text) {
            if named != own.trim_end_matches(".rs") && !allowed.contains(&named.as_str()) {
                broken.push(format!("{name}:{line} names {named}"));
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn the_language_knows_nothing_of_ours() {
    for (name, text) in sources() {
        if name.starts_with("gcode/") {
            assert!(!text.lines().any(|l| code(l).contains("outrigger::")), "{name}");
        }
    }
}

#[test]
fn outside_systems_are_named_in_one_place() {
    let mut broken = Vec::new();
    for (name, text) in sources() {
        for (system, places) in ONLY {
            if places.iter().any(|place| name.starts_with(place)) {
                continue;
            }
            for (number, line) in text.lines().enumerate() {
                if names(line, system) {
                    broken.push(format!("{name}:{} names {system}", number + 1));
                }
            }
        }
    }
    assert!(broken.is_empty(), "{broken:#?}");
}

#[test]
fn the_mock_shares_no_code_with_the_sender() {
    for (name, text) in sources() {
        if name.starts_with("src/printer/mock") {
            for named in ["outrigger_gcode", "printer::session", "printer::reply", "printer::window"] {
                assert!(!text.lines().any(|l| code(l).contains(named)), "{name} names {named}");
            }
        }
    }
}
