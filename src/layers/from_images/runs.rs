//! Where a row of brightness changes between dark and bright.
//!
//! Takes the bytes of a row, gives the columns where bright runs begin and end.
//! Bright is 128 and more: at least half of 255, the top bit.

/// The top bit of eight bytes.
const TOPS: u64 = 0x8080_8080_8080_8080;

/// Pixels that are looked at together where they may all be alike: a few registers.
const BLOCK: usize = 64;

/// Writes the columns where the row changes, from dark at its left: begin and end of
/// each bright run in turn, always an even number of them, at most `row.len() + 1`.
///
/// [`BLOCK`] pixels a step where they are alike, eight where not; a step more for each
/// change.
pub(super) fn changes(row: &[u8], found: &mut Vec<u32>) {
    found.clear();
    let mut bright = 0_u64;
    let (blocks, rest) = row.as_chunks::<BLOCK>();
    let mut column = 0_u32;
    for block in blocks {
        let differs = block.iter().fold(0, |any, &pixel| any | (pixel ^ bright as u8));
        if differs & 0x80 != 0 {
            words(block.as_chunks::<8>().0, column, &mut bright, found);
        }
        column += BLOCK as u32;
    }
    let (last, rest) = rest.as_chunks::<8>();
    words(last, column, &mut bright, found);
    column += 8 * last.len() as u32;
    for byte in rest {
        if (u64::from(*byte) ^ bright) & 0x80 != 0 {
            found.push(column);
            bright ^= TOPS;
        }
        column += 1;
    }
    if bright != 0 {
        found.push(column);
    }
}

/// The changes within some words that begin at a column.
fn words(words: &[[u8; 8]], mut column: u32, bright: &mut u64, found: &mut Vec<u32>) {
    for word in words {
        let mut differ = (u64::from_le_bytes(*word) & TOPS) ^ *bright;
        while differ != 0 {
            let pixel = differ.trailing_zeros() / 8;
            found.push(column + pixel);
            *bright ^= TOPS;
            // From this pixel on, what was alike differs and the other way round.
            differ ^= TOPS << (8 * pixel);
        }
        column += 8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pixel_by_pixel(row: &[u8]) -> Vec<u32> {
        let bright = |i: usize| row.get(i).is_some_and(|&b| b > 127);
        let changed = |i: usize| bright(i) != (i > 0 && bright(i - 1));
        (0..=row.len()).filter(|&i| changed(i)).map(|i| i as u32).collect()
    }

    #[test]
    fn half_of_the_brightness_is_bright() {
        let check = |row: &[u8], expect: &[u32]| {
            let mut found = vec![7];
            changes(row, &mut found);
            assert_eq!(found, expect, "{row:?}");
        };
        check(&[], &[]);
        check(&[127, 128, 255, 0], &[1, 3]);
        check(&[0; 31], &[]);
        check(&[255; 16], &[0, 16]);
        check(&[0, 0, 0, 0, 0, 0, 0, 200, 200, 0], &[7, 9]);
        check(&[255, 0, 255, 0, 255, 0, 255, 0, 255], &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    }

    proptest! {
        #[test]
        fn blocks_and_words_say_what_pixels_say(
            runs in prop::collection::vec((any::<u8>(), prop_oneof![1..4_usize, 1..200_usize]), 0..12),
        ) {
            let row: Vec<u8> = runs.into_iter().flat_map(|(b, n)| std::iter::repeat_n(b, n)).collect();
            let mut found = Vec::new();
            changes(&row, &mut found);
            prop_assert_eq!(found, pixel_by_pixel(&row));
        }
    }
}
