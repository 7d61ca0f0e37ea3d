//! Every file under `tests/scenarios` holds in the virtual world.
use outrigger_hil::play::{TAIL_LINES, play};
use outrigger_hil::scenario::Scenario;
use std::path::Path;

fn root() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

/// `SCENARIO=name cargo test -p outrigger-hil --test scenarios` plays one alone; `LINES=n` shows
/// so much of its transcript.
#[test]
fn every_scenario_holds() {
    let lines = std::env::var("LINES").ok().and_then(|n| n.parse().ok()).unwrap_or(TAIL_LINES);
    let only = std::env::var("SCENARIO").ok();
    let all = Scenario::load_all(&root().join("tests/scenarios")).unwrap();
    assert!(!all.is_empty(), "no scenarios");
    let mut failed = Vec::new();
    let mut played = 0;
    for scenario in all.iter().flat_map(Scenario::unroll) {
        if only.as_ref().is_some_and(|name| !scenario.name.starts_with(name.as_str())) {
            continue;
        }
        played += 1;
        let complaint = match play(&scenario, root()) {
            Ok(played) => played.complaint(lines),
            Err(e) => Some(format!("{e:#}")),
        };
        if let Some(complaint) = complaint {
            failed.push(format!("==== {} ({})\n{complaint}\n", scenario.name, scenario.title));
        }
    }
    assert!(played > 0, "no scenario of that name");
    let names = failed.len();
    assert!(failed.is_empty(), "{names} of {played} scenarios do not hold:\n{}", failed.join("\n"));
}
