//! A number for a picture: equal for equal pictures, else different but for one case in 2⁶⁴.
//!
//! Takes rows of brightness, gives 64 bits that are the same on every machine and in every
//! version, so that they may be written down and compared. It proves nothing against somebody
//! who wants two pictures to have the same sum.
//!
//! Two words of 8 bytes at a time are multiplied to 128 bits, whose halves are folded together, as
//! wyhash does (Wang Yi, <https://github.com/wangyi-fudan/wyhash>): one multiplication in 16 bytes,
//! and each of its results depends on all bytes before.

/// Odd numbers with as many ones as zeros: the fractions of the square roots of 2, 3 and 5 with
/// the lowest bit set, for want of a reason to take others.
const KEYS: [u64; 3] = [0x6a09_e667_f3bc_c909, 0xbb67_ae85_84ca_a73b, 0x3c6e_f372_fe94_f82b];

/// The sum of a picture whose rows are still coming.
#[derive(Clone, Copy, Debug)]
pub struct Sum {
    state: u64,
    rows: u64,
}

impl Default for Sum {
    fn default() -> Sum {
        Sum::new()
    }
}

impl Sum {
    /// Of no row.
    #[must_use]
    pub fn new() -> Sum {
        Sum { state: KEYS[2], rows: 0 }
    }

    /// The next row from the top, a byte a pixel. Where a row ends counts: the same bytes in
    /// rows of another width have another sum.
    pub fn row(&mut self, row: &[u8]) {
        let (whole, rest) = row.as_chunks::<16>();
        let mut state = fold(self.state ^ KEYS[0], row.len() as u64 ^ KEYS[1]);
        for chunk in whole {
            state = add(state, chunk);
        }
        if !rest.is_empty() {
            let mut last = [0; 16];
            last.iter_mut().zip(rest).for_each(|(to, v)| *to = *v);
            state = add(state, &last);
        }
        self.state = state;
        self.rows += 1;
    }

    /// The sum of the rows so far.
    #[must_use]
    pub fn finish(self) -> u64 {
        fold(self.state ^ KEYS[1], self.rows ^ KEYS[2])
    }

    /// The sum of a dark picture.
    #[must_use]
    pub fn dark([width_px, height_px]: [u32; 2]) -> u64 {
        let row = vec![0; width_px as usize];
        let mut sum = Sum::new();
        (0..height_px).for_each(|_| sum.row(&row));
        sum.finish()
    }
}

fn add(state: u64, chunk: &[u8; 16]) -> u64 {
    let both = u128::from_le_bytes(*chunk);
    fold(both as u64 ^ KEYS[0], (both >> 64) as u64 ^ state)
}

fn fold(a: u64, b: u64) -> u64 {
    let product = u128::from(a) * u128::from(b);
    product as u64 ^ (product >> 64) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn of(rows: &[&[u8]]) -> u64 {
        let mut sum = Sum::new();
        rows.iter().for_each(|row| sum.row(row));
        sum.finish()
    }

    /// The figures are of another program that was written from the module's text.
    #[test]
    fn a_sum_is_the_same_in_every_version() {
        let check = |rows: &[&[u8]], expect: u64| {
            assert_eq!(of(rows), expect, "{rows:?}: {:016x}", of(rows));
        };
        let counted: Vec<u8> = (0..=255).collect();
        check(&[], 0x54d9_d56b_229d_240e);
        check(&[b""], 0x236a_613b_d05b_fea0);
        check(&[b"a"], 0x7f0b_3504_c80d_e05f);
        check(&[&counted, &counted[..250]], 0xb0fe_123c_52d6_5946);
    }

    #[test]
    fn where_rows_end_counts() {
        let pictures: [&[&[u8]]; 8] = [
            &[],
            &[&[]],
            &[&[], &[]],
            &[&[0; 6]],
            &[&[0; 3], &[0; 3]],
            &[&[0; 2], &[0; 2], &[0; 2]],
            &[&[0; 16]],
            &[&[0; 32]],
        ];
        let mut sums: Vec<u64> = pictures.iter().map(|rows| of(rows)).collect();
        sums.sort_unstable();
        sums.dedup();
        assert_eq!(sums.len(), pictures.len());
    }

    #[test]
    fn a_dark_picture_has_the_sum_of_its_rows() {
        assert_eq!(Sum::dark([19, 2]), of(&[&[0; 19], &[0; 19]]));
        assert_ne!(Sum::dark([19, 2]), Sum::dark([19, 3]));
    }

    proptest! {
        /// Regular patterns differ in the same bits of many words: nothing must cancel.
        #[test]
        fn a_few_other_pixels_make_another_sum(
            width in 1_usize..70,
            seed in any::<u8>(),
            step in 1_usize..20,
            flip in 1_u8..,
        ) {
            let one: Vec<u8> = (0..width).map(|i| seed.wrapping_mul(i as u8)).collect();
            let mut other = one.clone();
            other.iter_mut().skip(seed as usize % width).step_by(step).for_each(|v| *v ^= flip);
            prop_assert_ne!(of(&[&one, &one]), of(&[&one, &other]));
            prop_assert_ne!(of(&[&other, &one]), of(&[&one, &other]));
        }
    }
}
