//! How many requests a source may make: a token bucket for each.
//!
//! Takes times in ms of a clock that is never set; gives yes, or how long to wait. Memory is
//! bounded. Uploads and WebSockets count once, as any request; how much they carry is not looked at
//! here. An own one for the reason that `throttle.rs` gives.
use super::recent::Recent;
use super::source::Source;
use super::throttle::Limited;

/// Sources that are remembered; one that was forgotten begins with a full bucket.
const MAX_REMEMBERED: usize = 1024;

/// Requests at once: a household of pages and slicers behind one address, all at once.
const BURST: u64 = 600;

/// Requests a second in the long run.
const PER_S: u64 = 150;

/// A request's cost; a bucket gains [`PER_S`] of these each ms.
const COST: u64 = 1000;

/// A bucket for each source.
#[derive(Debug)]
pub(super) struct Buckets(Recent<Source, u64>);

impl Buckets {
    pub(super) fn new() -> Self {
        Self(Recent::new(MAX_REMEMBERED))
    }

    /// Counts a request.
    ///
    /// # Errors
    /// The bucket is empty; the request then does not count.
    pub(super) fn take(&mut self, source: Source, now_ms: u64) -> Result<(), Limited> {
        let (before_ms, level) = self.0.touch(source, now_ms, || BURST * COST);
        let gained = now_ms.saturating_sub(before_ms).saturating_mul(PER_S);
        *level = level.saturating_add(gained).min(BURST * COST);
        match level.checked_sub(COST) {
            Some(left) => {
                *level = left;
                Ok(())
            }
            None => Err(Limited::after_ms((COST - *level).div_ceil(PER_S))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;

    fn from(last: u32) -> Source {
        IpAddr::from(last.to_be_bytes()).into()
    }

    /// So many requests at each time, of which so many pass.
    fn check(at: &[(u64, usize, usize)]) {
        let mut buckets = Buckets::new();
        for &(now_ms, requests, expect) in at {
            let passed = (0..requests).filter(|_| buckets.take(from(1), now_ms).is_ok()).count();
            assert_eq!(passed, expect, "{now_ms} of {at:?}");
        }
    }

    #[test]
    fn a_burst_passes_and_then_so_many_a_second() {
        check(&[(0, 1000, 600)]);
        check(&[(0, 1000, 600), (1000, 1000, 150), (1020, 10, 3), (1026, 10, 0), (1027, 10, 1)]);
        check(&[(0, 600, 600), (u64::MAX, 1000, 600)]);
        check(&[(5000, 600, 600), (0, 10, 0)]);
    }

    #[test]
    fn each_source_has_its_own_and_a_flood_is_bounded() {
        let mut buckets = Buckets::new();
        for n in 0..5000 {
            buckets.take(from(n), 0).unwrap();
        }
        assert_eq!(buckets.0.len(), MAX_REMEMBERED);
        for _ in 0..BURST {
            let _ = buckets.take(from(1), 0);
        }
        assert_eq!(buckets.take(from(1), 0), Err(Limited { retry_after_s: 1 }));
    }

    proptest::proptest! {
        #[test]
        fn no_pattern_gets_more_than_its_share(gaps_ms in proptest::collection::vec(0_u64..200, 1..600)) {
            let mut buckets = Buckets::new();
            let (mut now_ms, mut passed) = (0, 0);
            for gap_ms in gaps_ms {
                now_ms += gap_ms;
                passed += u64::from(buckets.take(from(1), now_ms).is_ok());
            }
            assert!(passed <= BURST + now_ms * PER_S / 1000);
        }
    }
}
