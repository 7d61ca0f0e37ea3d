//! Work and its peer, timed turn and turn about in one run: what else the machine
//! does slows both alike, so the ratio holds where either time alone would not.
use std::hint::black_box;
use std::time::{Duration, Instant};

/// Pairs timed. The median of 15 stands when a third of them was disturbed.
const PAIRS: usize = 15;

/// Work done as often as it takes to fill this is one timing: less is clock noise.
const LEAST: Duration = Duration::from_millis(20);

/// Prints a line for each comparison.
pub(crate) struct Ratios {
    pairs: usize,
}

/// One side of a comparison.
pub(crate) struct Timed {
    /// Median, s.
    pub(crate) seconds: f64,
}

impl Timed {
    /// Throughput, MB/s (10⁶).
    pub(crate) fn mb_s(&self, bytes: usize) -> f64 {
        bytes as f64 / 1e6 / self.seconds
    }
}

impl Ratios {
    /// Once each unless `cargo bench` runs the bench: `cargo test --benches` only tries it.
    pub(crate) fn from_args() -> Ratios {
        let bench = std::env::args().any(|arg| arg == "--bench");
        Ratios { pairs: if bench { PAIRS } else { 1 } }
    }

    /// Times both and prints their throughputs and the ratio of the first to the second
    /// (more is faster), the median of the pairs' ratios.
    pub(crate) fn compare<A, B>(
        &self,
        bytes: usize,
        (name, mut work): (&str, impl FnMut() -> A),
        (peer_name, mut peer): (&str, impl FnMut() -> B),
    ) -> Timed {
        let (mut own, mut other, mut ratios) = (Vec::new(), Vec::new(), Vec::new());
        for _ in 0..self.pairs {
            let a = seconds(&mut work);
            let b = seconds(&mut peer);
            own.push(a);
            other.push(b);
            ratios.push(b / a);
        }
        let timed = Timed { seconds: median(&mut own) };
        let peer = Timed { seconds: median(&mut other) };
        eprintln!(
            "{name:<34} {:>9.1} MB/s   {peer_name:<34} {:>9.1} MB/s   ratio {:>7.3}",
            timed.mb_s(bytes),
            peer.mb_s(bytes),
            median(&mut ratios),
        );
        timed
    }

    /// Says how a throughput stands to the least that the project wants; never fails.
    pub(crate) fn target(&self, name: &str, mb_s: f64, least_mb_s: f64) {
        let verdict = if mb_s >= least_mb_s { "met" } else { "MISSED" };
        eprintln!(
            "{name:<34} {mb_s:>9.1} MB/s   target {least_mb_s:>27.1} MB/s   ratio {:>7.3}  {verdict}",
            mb_s / least_mb_s
        );
    }
}

fn seconds<T>(work: &mut impl FnMut() -> T) -> f64 {
    let started = Instant::now();
    let mut times = 0;
    while times == 0 || started.elapsed() < LEAST {
        black_box(work());
        times += 1;
    }
    started.elapsed().as_secs_f64() / f64::from(times)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
