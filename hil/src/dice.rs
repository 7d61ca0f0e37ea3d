//! A small generator, so that a run depends on its seed alone.

/// SplitMix64 (Steele, Lea and Flood, 2014): any seed is a good one.
#[derive(Debug, Clone)]
pub struct Dice {
    state: u64,
}

impl Dice {
    /// A generator that gives the same numbers for the same seed.
    pub fn new(seed: u64) -> Self {
        Self { state: seed }
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number from 0 to `below` - 1; 0 for 0.
    pub fn below(&mut self, below: u64) -> u64 {
        // The bias of a remainder is below one in 2^40 for what is asked here.
        self.bits().checked_rem(below).unwrap_or(0)
    }

    /// A number from `low` to `high`, both included.
    pub fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.below(high.saturating_sub(low) + 1)
    }

    /// True `of_thousand` times in a thousand.
    pub fn chance(&mut self, of_thousand: u64) -> bool {
        of_thousand > 0 && self.below(1000) < of_thousand
    }

    /// One of these; there must be one.
    pub fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.below(of.len() as u64) as usize]
    }

    /// One byte of the line, not its last, becomes another, vanishes or is doubled by noise.
    pub fn damage(&mut self, line: &mut Vec<u8>) {
        let body = line.len().saturating_sub(1).max(1) as u64;
        let at = self.below(body) as usize;
        match self.below(4) {
            0 if line.len() > 1 => {
                line.remove(at);
            }
            1 => line.insert(at, b'!' + self.below(90) as u8),
            _ if !line.is_empty() => line[at] ^= 1 << self.below(7),
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_seed_says_all_and_seeds_differ() {
        let some = |seed| {
            let mut dice = Dice::new(seed);
            (0..100).map(|_| dice.between(3, 9)).collect::<Vec<_>>()
        };
        assert_eq!(some(1), some(1));
        assert_ne!(some(1), some(2));
        assert!((3..=9).all(|n| some(5).contains(&n)));
    }
}
