//! How often a password or a key may be guessed.
//!
//! Counts failures by source and by user name; after a few, each further one makes the next try
//! wait twice as long. Takes times in ms of a clock that is never set; gives how long to wait.
//! The loopback is a source like others. Memory is bounded. Knows no passwords.
//!
//! An own one, as the crate `governor` counts at a fixed rate: it has no growing delays, no success
//! that is forgiven, and its keyed limiters grow until somebody sweeps them.
use super::recent::Recent;
use super::source::Source;
use std::collections::HashMap;
use std::hash::Hash;

/// Sources, and names that nobody bears, that are remembered.
const MAX_REMEMBERED: usize = 1024;

const SECOND_MS: u64 = 1000;
const MINUTE_MS: u64 = 60 * SECOND_MS;

/// Too often. Whatever was asked has not been looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("too many tries: wait {retry_after_s} s")]
pub(crate) struct Limited {
    /// When it is worth another try, s, at least 1.
    pub(crate) retry_after_s: u64,
}

impl Limited {
    pub(super) fn after_ms(wait_ms: u64) -> Self {
        Self { retry_after_s: wait_ms.div_ceil(SECOND_MS).max(1) }
    }
}

/// How patient a counter is.
#[derive(Clone, Copy, Debug)]
struct Patience {
    /// Failures that cost nothing: people mistype.
    free: u32,
    /// The longest wait.
    max_wait_ms: u64,
    /// After so long without a failure all are forgotten.
    forget_ms: u64,
}

/// A household behind one address mistypes a few times; a machine that guesses waits.
const BY_SOURCE: Patience = Patience { free: 5, max_wait_ms: 15 * MINUTE_MS, forget_ms: 60 * MINUTE_MS };

/// The wait is short, as strangers can bring it about for anybody whose name they know; 1440 guesses
/// a day from ever so many sources still find no fair password.
const BY_NAME: Patience = Patience { free: 5, max_wait_ms: MINUTE_MS, forget_ms: 30 * MINUTE_MS };

/// Slicers go on asking with a key that was revoked. Nobody guesses 256 bits: this keeps the log and
/// the processor free.
const BY_KEYS: Patience = Patience { free: 20, max_wait_ms: MINUTE_MS, forget_ms: 10 * MINUTE_MS };

#[derive(Clone, Copy, Debug, Default)]
struct Failures {
    count: u32,
    ready_ms: u64,
}

#[derive(Debug)]
struct Counter<K> {
    patience: Patience,
    recent: Recent<K, Failures>,
}

impl<K: Hash + Eq + Clone> Counter<K> {
    fn new(patience: Patience, max: usize) -> Self {
        Self { patience, recent: Recent::new(max) }
    }

    fn wait_ms(&self, key: &K, now_ms: u64) -> u64 {
        self.recent.get(key).map_or(0, |(_, failures)| failures.ready_ms.saturating_sub(now_ms))
    }

    fn fail(&mut self, key: K, now_ms: u64) {
        let Patience { free, max_wait_ms, forget_ms } = self.patience;
        let (before_ms, failures) = self.recent.touch(key, now_ms, Failures::default);
        if now_ms.saturating_sub(before_ms) >= forget_ms {
            *failures = Failures::default();
        }
        failures.count = failures.count.saturating_add(1);
        if let Some(beyond) = failures.count.checked_sub(free) {
            // 2^10 s is beyond every longest wait.
            let wait_ms = (SECOND_MS << beyond.min(10)).min(max_wait_ms);
            failures.ready_ms = now_ms + wait_ms;
        }
    }

    fn take_back(&mut self, key: &K) {
        if let Some(failures) = self.recent.get_mut(key) {
            failures.count = failures.count.saturating_sub(1);
        }
    }
}

/// All counters of guesses.
#[derive(Debug)]
pub(super) struct Throttle {
    sources: Counter<Source>,
    // Names of users and other names are counted alike, but apart: whoever tries a thousand names
    // does not make the count of a user's be forgotten.
    users: Counter<String>,
    strangers: Counter<String>,
    keys: Counter<Source>,
    /// Where each user has logged in last: from there strangers' guesses at the name keep nobody out.
    homes: HashMap<String, Source>,
}

impl Throttle {
    pub(super) fn new(max_users: usize) -> Self {
        Self {
            sources: Counter::new(BY_SOURCE, MAX_REMEMBERED),
            users: Counter::new(BY_NAME, max_users),
            strangers: Counter::new(BY_NAME, MAX_REMEMBERED),
            keys: Counter::new(BY_KEYS, MAX_REMEMBERED),
            homes: HashMap::new(),
        }
    }

    /// Before a password is looked at. The try counts as a failure from here on, so that a hundred
    /// at once are no way around. `name`: folded, if it can be a name at all.
    ///
    /// # Errors
    /// The source or the name must wait; the try then does not count.
    pub(super) fn try_password(
        &mut self,
        source: Source,
        name: Option<&str>,
        is_user: bool,
        now_ms: u64,
    ) -> Result<(), Limited> {
        let names = if is_user { &mut self.users } else { &mut self.strangers };
        let at_home = name.is_some_and(|name| self.homes.get(name) == Some(&source));
        let of_name_ms = match name {
            Some(name) if !at_home => names.wait_ms(&name.to_owned(), now_ms),
            _ => 0,
        };
        let wait_ms = of_name_ms.max(self.sources.wait_ms(&source, now_ms));
        if wait_ms > 0 {
            return Err(Limited::after_ms(wait_ms));
        }
        self.sources.fail(source, now_ms);
        if let Some(name) = name {
            names.fail(name.to_owned(), now_ms);
        }
        Ok(())
    }

    /// The password was the right one. The name's count begins anew; the source's has only this try
    /// taken back, or an account of one's own would let one go on guessing at others.
    pub(super) fn right_password(&mut self, source: Source, name: &str) {
        self.sources.take_back(&source);
        self.users.recent.remove(&name.to_owned());
        self.homes.insert(name.to_owned(), source);
    }

    /// The name is no user's any more.
    pub(super) fn forget_user(&mut self, name: &str) {
        self.homes.remove(name);
    }

    /// After a key that is none.
    ///
    /// # Errors
    /// There were too many.
    pub(super) fn wrong_key(&mut self, source: Source, now_ms: u64) -> Result<(), Limited> {
        let wait_ms = self.keys.wait_ms(&source, now_ms);
        if wait_ms > 0 {
            return Err(Limited::after_ms(wait_ms));
        }
        self.keys.fail(source, now_ms);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::IpAddr;

    fn from(last: u32) -> Source {
        IpAddr::from(last.to_be_bytes()).into()
    }

    /// Tries of passwords, all wrong, at times; each is allowed (0) or told to wait so many seconds.
    fn check(tries: &[(u64, u32, &str, u64)]) {
        let mut throttle = Throttle::new(64);
        for &(now_s, source, name, wait_s) in tries {
            let got = throttle.try_password(from(source), Some(name), true, now_s * 1000);
            assert_eq!(got.map_or_else(|l| l.retry_after_s, |()| 0), wait_s, "{now_s} {source} {name}");
        }
    }

    #[test]
    fn a_source_waits_longer_and_longer() {
        let mut tries: Vec<_> = ["a", "b", "c", "d", "e"].map(|name| (0, 1, name, 0)).into();
        tries.extend([(0, 1, "f", 1), (1, 1, "f", 0), (1, 1, "g", 2), (3, 1, "g", 0), (3, 1, "h", 4)]);
        // Waiting costs nothing, and another source is not held up.
        tries.extend([(4, 1, "h", 3), (4, 2, "h", 0), (7, 1, "i", 0), (7, 1, "j", 8)]);
        check(&tries);
    }

    #[test]
    fn a_name_waits_wherever_the_guesses_come_from() {
        let mut tries: Vec<_> = (0..5).map(|source| (0, source, "anna", 0)).collect();
        tries.extend([(0, 9, "anna", 1), (0, 9, "bo", 0), (1, 9, "anna", 0), (1, 10, "anna", 2)]);
        check(&tries);
    }

    #[test]
    fn waits_are_bounded_and_forgotten() {
        let mut throttle = Throttle::new(64);
        let mut now_ms = 0;
        for n in 0..100 {
            if let Err(limited) = throttle.try_password(from(1), Some(&format!("n{n}")), false, now_ms) {
                assert!(limited.retry_after_s <= 15 * 60);
                now_ms += limited.retry_after_s * 1000;
            }
        }
        assert!(now_ms > 3_600_000, "a hundred tries took {now_ms} ms");
        now_ms += 2 * 3_600_000;
        for n in 0..5 {
            throttle.try_password(from(1), Some(&format!("n{n}")), false, now_ms).unwrap();
        }
        throttle.try_password(from(1), Some("n"), false, now_ms).unwrap_err();
    }

    #[test]
    fn a_success_forgives_the_name_but_not_the_source() {
        let mut throttle = Throttle::new(64);
        for now_ms in 0..4 {
            throttle.try_password(from(1), Some("anna"), true, now_ms).unwrap();
        }
        throttle.try_password(from(1), Some("anna"), true, 5).unwrap();
        throttle.right_password(from(1), "anna");
        assert_eq!(throttle.users.recent.len(), 0);
        assert_eq!(throttle.sources.recent.get(&from(1)).unwrap().1.count, 4);
        // One who has an account and guesses at another's.
        let mut allowed = 0;
        for n in 0..1000 {
            let now_ms = 10_000 + n;
            allowed += u32::from(throttle.try_password(from(1), Some("bo"), true, now_ms).is_ok());
            if throttle.try_password(from(1), Some("anna"), true, now_ms).is_ok() {
                throttle.right_password(from(1), "anna");
            }
        }
        assert!(allowed <= 2, "{allowed}");
    }

    #[test]
    fn strangers_do_not_keep_a_user_out_of_home() {
        let mut throttle = Throttle::new(64);
        throttle.try_password(from(1), Some("anna"), true, 0).unwrap();
        throttle.right_password(from(1), "anna");
        for n in 0..50 {
            let _ = throttle.try_password(from(100 + n), Some("anna"), true, 0);
        }
        throttle.try_password(from(2), Some("anna"), true, 0).unwrap_err();
        throttle.try_password(from(1), Some("anna"), true, 0).unwrap();
        throttle.forget_user("anna");
        throttle.try_password(from(1), Some("anna"), true, 0).unwrap_err();
    }

    #[test]
    fn a_flood_of_names_and_sources_is_bounded_and_frees_no_user() {
        let mut throttle = Throttle::new(64);
        for source in 0..6 {
            let _ = throttle.try_password(from(source), Some("anna"), true, 0);
        }
        for n in 100..5000 {
            throttle.try_password(from(n), Some(&format!("n{n}")), false, 1).unwrap();
            throttle.wrong_key(from(n), 1).unwrap();
        }
        assert_eq!(throttle.sources.recent.len(), MAX_REMEMBERED);
        assert_eq!(throttle.strangers.recent.len(), MAX_REMEMBERED);
        assert_eq!(throttle.keys.recent.len(), MAX_REMEMBERED);
        throttle.try_password(from(9999), Some("anna"), true, 2).unwrap_err();
    }

    #[test]
    fn wrong_keys_are_limited() {
        let mut throttle = Throttle::new(64);
        for _ in 0..20 {
            throttle.wrong_key(from(1), 0).unwrap();
        }
        assert_eq!(throttle.wrong_key(from(1), 0), Err(Limited { retry_after_s: 1 }));
        throttle.wrong_key(from(2), 0).unwrap();
        throttle.wrong_key(from(1), 1000).unwrap();
    }
}
