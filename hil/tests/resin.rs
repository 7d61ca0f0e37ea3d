//! Random resin jobs with random trouble, each a seed that can be run again.
use outrigger_hil::simulate::resin::{many, one};

/// Runs when nothing else is said.
const RUNS: u64 = 600;

fn number(name: &str) -> Option<u64> {
    std::env::var(name).ok().map(|text| text.parse().expect("a number"))
}

/// `SEED=n` runs that seed alone, with its transcript; `RUNS=n` and `FIRST=n` other seeds.
#[test]
fn every_seed_holds() {
    if let Some(seed) = number("SEED") {
        let (wrong, transcript) = one(seed).unwrap();
        eprintln!("{}", transcript.join("\n"));
        assert_eq!(wrong, None, "seed {seed}");
        return;
    }
    let tally = many(number("FIRST").unwrap_or(1), number("RUNS").unwrap_or(RUNS)).unwrap();
    eprintln!("{tally}");
    for failure in &tally.failures {
        eprintln!(
            "==== seed {}: {}\nagain: SEED={} cargo test -p outrigger-hil --test resin -- --nocapture\n",
            failure.seed, failure.text, failure.seed
        );
    }
    let seeds: Vec<_> = tally.failures.iter().map(|f| f.seed).collect();
    assert!(seeds.is_empty(), "seeds that do not hold: {seeds:?}");
}
