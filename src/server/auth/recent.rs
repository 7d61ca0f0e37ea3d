//! A map that remembers a fixed number of things: for a new one the longest untouched goes.
//!
//! What strangers can make grow must not grow. Time comes in. Knows not what it remembers.
use std::collections::HashMap;
use std::hash::Hash;

/// At most `max` values, each with when it was last touched, ms.
#[derive(Debug)]
pub(super) struct Recent<K, V> {
    max: usize,
    // The standard hasher has a secret of its own, so that nobody chooses colliding keys.
    entries: HashMap<K, (u64, V)>,
}

impl<K: Hash + Eq + Clone, V> Recent<K, V> {
    pub(super) fn new(max: usize) -> Self {
        Self { max, entries: HashMap::new() }
    }

    /// A value and when it was touched.
    pub(super) fn get(&self, key: &K) -> Option<(u64, &V)> {
        self.entries.get(key).map(|(touched_ms, value)| (*touched_ms, value))
    }

    /// A value that is about to change: touches it, or makes it. Also gives when it was touched
    /// before. Making one looks at all that are there, a few µs, once it is full.
    pub(super) fn touch(&mut self, key: K, now_ms: u64, fresh: impl FnOnce() -> V) -> (u64, &mut V) {
        if self.entries.len() >= self.max && !self.entries.contains_key(&key) {
            let oldest = self.entries.iter().min_by_key(|(_, (touched_ms, _))| *touched_ms);
            if let Some(oldest) = oldest.map(|(key, _)| key.clone()) {
                self.entries.remove(&oldest);
            }
        }
        let (touched_ms, value) = self.entries.entry(key).or_insert_with(|| (now_ms, fresh()));
        (std::mem::replace(touched_ms, now_ms.max(*touched_ms)), value)
    }

    /// A value that is about to change and does not count as touched.
    pub(super) fn get_mut(&mut self, key: &K) -> Option<&mut V> {
        self.entries.get_mut(key).map(|(_, value)| value)
    }

    pub(super) fn remove(&mut self, key: &K) {
        self.entries.remove(key);
    }

    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.entries.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Touches keys, one each ms; gives what is remembered, in order.
    fn check(touched: &[u8], expect: &[u8]) {
        let mut recent = Recent::new(3);
        for (now_ms, &key) in (0..).zip(touched) {
            recent.touch(key, now_ms, || ());
        }
        let mut left: Vec<_> = recent.entries.keys().copied().collect();
        left.sort_unstable();
        assert_eq!(left, expect, "{touched:?}");
    }

    #[test]
    fn the_longest_untouched_goes() {
        check(&[], &[]);
        check(&[1, 2, 3], &[1, 2, 3]);
        check(&[1, 2, 3, 4], &[2, 3, 4]);
        check(&[1, 2, 3, 1, 4], &[1, 3, 4]);
        check(&[1, 1, 1, 2, 2, 3], &[1, 2, 3]);
    }

    #[test]
    fn a_touch_tells_the_one_before() {
        let mut recent = Recent::new(3);
        *recent.touch('a', 5, || 1).1 += 1;
        assert_eq!(recent.touch('a', 9, || 1), (5, &mut 2));
        assert_eq!(recent.touch('a', 7, || 1), (9, &mut 2));
        assert_eq!(recent.get(&'a'), Some((9, &2)));
        recent.remove(&'a');
        assert_eq!(recent.get(&'a'), None);
    }
}
