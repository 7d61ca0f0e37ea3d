//! Heatshrink: a small LZSS for machines with little memory.
//!
//! Takes and gives whole blocks. By the format of Atomic Object's heatshrink 0.4:
//! bits from the highest down; a 1 and the 8 bits of a byte, or a 0, the distance
//! less 1 in as many bits as the window has, and the length less 1 in 4 bits; the
//! last byte is filled up with zeros. A match may reach before the beginning,
//! where the window is full of zeros.
//!
//! Why own code: `embedded-heatshrink` 0.1 counts an output buffer of 64 KiB and
//! more wrongly, and is not free of `unsafe`; `heatshrink` 0.2 is sound, but its
//! encoder compares with every position of the window: some seconds for a block.
//! The tests have the latter as their second opinion.

/// Bits of a match's length.
const LENGTH_BITS: u32 = 4;

/// Longest match, bytes.
const MAX_MATCH: usize = 1 << LENGTH_BITS;

/// A shorter match takes more bits (17, or 16) than its bytes by themselves (9 each).
const MIN_MATCH: usize = 3;

/// Candidates looked at for one match, the nearest first: G-code packed once already repeats little.
const MAX_CANDIDATES: usize = 48;

/// Unpacks a block; `None` when it does not give exactly `unpacked_bytes`.
pub(super) fn unpack(data: &[u8], window_bits: u32, unpacked_bytes: usize) -> Option<Vec<u8>> {
    // A match of 16 bytes takes at least 16 bits: what announces more is lying.
    if unpacked_bytes > data.len().saturating_mul(8) {
        return None;
    }
    let mut out = Vec::with_capacity(unpacked_bytes);
    let mut bits = Bits { data, at: 0, held: 0, count: 0 };
    loop {
        match bits.take(1) {
            None => break,
            Some(1) => match bits.take(8) {
                Some(byte) if out.len() < unpacked_bytes => out.push(byte as u8),
                Some(_) => return None,
                None => break,
            },
            Some(_) => {
                let (Some(distance), Some(length)) = (bits.take(window_bits), bits.take(LENGTH_BITS)) else {
                    break;
                };
                let (distance, length) = (distance as usize + 1, length as usize + 1);
                if out.len() + length > unpacked_bytes {
                    return None;
                }
                for _ in 0..length {
                    let byte = out.len().checked_sub(distance).map_or(0, |at| out[at]);
                    out.push(byte);
                }
            }
        }
    }
    (out.len() == unpacked_bytes).then_some(out)
}

/// Bits of some bytes, the highest first.
struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    held: u32,
    count: u32,
}

impl Bits<'_> {
    /// The next bits, at most 24; `None` when there are not so many.
    fn take(&mut self, count: u32) -> Option<u32> {
        while self.count < count {
            self.held = (self.held << 8) | u32::from(*self.data.get(self.at)?);
            self.at += 1;
            self.count += 8;
        }
        self.count -= count;
        let taken = self.held >> self.count;
        self.held &= (1 << self.count) - 1;
        Some(taken)
    }
}

/// Packs a block: greedily, each time the longest match found.
pub(super) fn pack(data: &[u8], window_bits: u32) -> Vec<u8> {
    let mut out = BitWriter { bytes: Vec::with_capacity(data.len() / 2), held: 0, count: 0 };
    let mut earlier = Earlier::new(data, 1 << window_bits);
    let mut at = 0;
    while at < data.len() {
        let (distance, length) = earlier.longest(at);
        let step = if length >= MIN_MATCH {
            out.put(0, 1);
            out.put(distance as u32 - 1, window_bits);
            out.put(length as u32 - 1, LENGTH_BITS);
            length
        } else {
            out.put(1, 1);
            out.put(u32::from(data[at]), 8);
            1
        };
        for passed in at..at + step {
            earlier.remember(passed);
        }
        at += step;
    }
    out.finish()
}

/// No position.
const NOWHERE: u32 = u32::MAX;

/// Where the same three bytes stood before.
struct Earlier<'a> {
    data: &'a [u8],
    window: usize,
    /// By the hash of three bytes, where they stood last.
    last: Vec<u32>,
    /// By position, modulo the window: where the bytes with that hash stood before.
    before: Vec<u32>,
}

impl Earlier<'_> {
    fn new(data: &[u8], window: usize) -> Earlier<'_> {
        Earlier { data, window, last: vec![NOWHERE; 1 << 13], before: vec![NOWHERE; window] }
    }

    fn slot(&self, at: usize) -> Option<usize> {
        let three = self.data.get(at..at + MIN_MATCH)?;
        let number = u32::from_le_bytes([three[0], three[1], three[2], 0]);
        Some((number.wrapping_mul(0x9E37_79B1) >> 19) as usize)
    }

    fn remember(&mut self, at: usize) {
        if let Some(slot) = self.slot(at) {
            self.before[at % self.window] = self.last[slot];
            self.last[slot] = at as u32;
        }
    }

    /// Distance and length of the longest match; the nearest of the longest.
    fn longest(&self, at: usize) -> (usize, usize) {
        let mut best = (0, 0);
        let Some(slot) = self.slot(at) else { return best };
        let rest = &self.data[at..];
        let most = rest.len().min(MAX_MATCH);
        let mut candidate = self.last[slot];
        for _ in 0..MAX_CANDIDATES {
            let from = candidate as usize;
            // Beyond the window `before` belongs to other positions.
            if candidate == NOWHERE || at - from > self.window {
                break;
            }
            let length = rest[..most].iter().zip(&self.data[from..]).take_while(|(a, b)| a == b).count();
            if length > best.1 {
                best = (at - from, length);
                if length == most {
                    break;
                }
            }
            candidate = self.before[from % self.window];
        }
        best
    }
}

struct BitWriter {
    bytes: Vec<u8>,
    held: u32,
    count: u32,
}

impl BitWriter {
    fn put(&mut self, value: u32, count: u32) {
        self.held = (self.held << count) | value;
        self.count += count;
        while self.count >= 8 {
            self.count -= 8;
            self.bytes.push((self.held >> self.count) as u8);
            self.held &= (1 << self.count) - 1;
        }
    }

    fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.put(0, 8 - self.count);
        }
        self.bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn unpacks_what_the_format_says() {
        let check = |data: &[u8], window_bits: u32, expect: Option<&[u8]>, announced: usize| {
            assert_eq!(unpack(data, window_bits, announced).as_deref(), expect, "{data:x?}");
        };
        // 1 01000111: a literal G, and seven zeros to fill up.
        check(&[0b1010_0011, 0b1000_0000], 11, Some(b"G"), 1);
        // Then 0, distance 1 in 11 bits, length 4 in 4 bits: 0 00000000000 0011.
        check(&[0b1010_0011, 0b1000_0000, 0b0000_0001, 0b1000_0000], 11, Some(b"GGGGG"), 5);
        check(&[0b1010_0011, 0b1000_0000, 0b0000_0000, 0b1100_0000], 12, Some(b"GGGGG"), 5);
        // A match before the beginning: zeros.
        check(&[0b0000_0000, 0b0000_0001], 11, Some(b"\0\0"), 2);
        check(b"", 11, Some(b""), 0);
        // Too short, too long.
        check(&[0b1010_0011, 0b1000_0000], 11, None, 2);
        check(&[0b1010_0011, 0b1000_0000, 0b0000_0001, 0b1000_0000], 11, None, 4);
        check(&[0b1010_0011, 0b1000_0000], 11, None, 0);
        check(&[0; 4], 11, None, usize::MAX);
    }

    #[test]
    fn repetition_shrinks() {
        let text = b"G1 X10.5 Y20.25 E.0125\n".repeat(100);
        for window_bits in [11, 12] {
            let packed = pack(&text, window_bits);
            assert!(packed.len() * 5 < text.len(), "{}", packed.len());
            assert_eq!(unpack(&packed, window_bits, text.len()).as_deref(), Some(&text[..]));
        }
    }

    #[test]
    fn matches_at_the_window_s_end_are_right() {
        for window_bits in [11, 12] {
            let window = 1usize << window_bits;
            for gap in window - 20..window + 3 {
                // Nothing in between repeats three bytes.
                let filler = (0..gap - 16).flat_map(|n| [n as u8, (n >> 8) as u8 ^ 0x5a]).take(gap - 16);
                let data: Vec<u8> = b"0123456789abcdef".iter().copied().chain(filler).collect();
                let data = [&data[..], b"0123456789abcdef"].concat();
                let packed = pack(&data, window_bits);
                assert_eq!(unpack(&packed, window_bits, data.len()), Some(data), "{gap}");
            }
        }
    }

    /// Data with repetitions near and far.
    fn pieces(pieces: &[(u8, usize)]) -> Vec<u8> {
        let piece =
            |&(seed, len): &(u8, usize)| (0..len).map(move |k| (k as u8).wrapping_mul(seed) ^ (k >> 5) as u8);
        pieces.iter().flat_map(piece).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn another_implementation_agrees(seeds in prop::collection::vec((0u8..6, 1usize..250), 0..10), twelve: bool) {
            let window_bits = if twelve { 12 } else { 11 };
            let data = pieces(&seeds);
            let config = heatshrink::Config::new(window_bits as u8, 4).unwrap();
            // It takes an output that is just filled for one that is too small.
            let mut room = vec![0; data.len() * 9 / 8 + 2];
            let back = heatshrink::decode(&pack(&data, window_bits), &mut room, &config).unwrap().to_vec();
            prop_assert_eq!(&back, &data);
            let packed = heatshrink::encode(&data, &mut room, &config).unwrap();
            prop_assert_eq!(unpack(packed, window_bits, data.len()), Some(data));
        }

        #[test]
        fn what_was_packed_unpacks(seeds in prop::collection::vec((0u8..6, 1usize..900), 0..24), twelve: bool) {
            let window_bits = if twelve { 12 } else { 11 };
            let data = pieces(&seeds);
            let packed = pack(&data, window_bits);
            prop_assert!(packed.len() <= data.len() * 9 / 8 + 1);
            prop_assert_eq!(unpack(&packed, window_bits, data.len()), Some(data));
        }

        #[test]
        fn any_bytes_unpack_or_do_not(data in prop::collection::vec(any::<u8>(), 0..300), announced in 0usize..4000) {
            if let Some(out) = unpack(&data, 11, announced) {
                prop_assert_eq!(out.len(), announced);
            }
        }
    }
}
