//! Where a row of brightness changes between dark and bright.
//!
//! Takes the bytes of a row, gives the columns where bright runs begin and end.
//! Bright is 128 and more: at least half of 255, the top bit.

/// The top bit of eight bytes.
const TOPS: u64 = 0x8080_8080_8080_8080;

/// Writes the columns where the row changes, from dark at its left: begin and end of
/// each bright run in turn, always an even number of them, at most `row.len()`.
///
/// Eight pixels a step where they are alike; a step more for each change.
pub(super) fn changes(row: &[u8], found: &mut Vec<u32>) {
    found.clear();
    let mut bright = 0_u64;
    let (words, rest) = row.as_chunks::<8>();
    let mut column = 0_u32;
    for word in words {
        let mut differ = (u64::from_le_bytes(*word) & TOPS) ^ bright;
        while differ != 0 {
            let pixel = differ.trailing_zeros() / 8;
            found.push(column + pixel);
            bright ^= TOPS;
            // From this pixel on, what was alike differs and the other way round.
            differ ^= TOPS << (8 * pixel);
        }
        column += 8;
    }
    for byte in rest {
        if (u64::from(*byte) & 0x80) ^ (bright & 0x80) != 0 {
            found.push(column);
            bright ^= TOPS;
        }
        column += 1;
    }
    if bright != 0 {
        found.push(column);
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
        fn words_say_what_pixels_say(row in prop::collection::vec(prop_oneof![Just(0_u8), Just(255), any::<u8>()], 0..70)) {
            let mut found = Vec::new();
            changes(&row, &mut found);
            prop_assert_eq!(found, pixel_by_pixel(&row));
        }
    }
}
