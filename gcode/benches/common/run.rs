//! How every bench runs: criterion's figures first, then ratios to peers.
use super::ratio::Ratios;
use criterion::Criterion;
use std::time::Duration;

/// Runs both, a few seconds a figure.
pub(crate) fn run(figures: fn(&mut Criterion), ratios: fn(&Ratios)) {
    let mut criterion = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3))
        .configure_from_args();
    figures(&mut criterion);
    criterion.final_summary();
    ratios(&Ratios::from_args());
}
