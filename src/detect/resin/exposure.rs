//! Exposures that no printer's light and resin ask for.
//!
//! Wide ranges: from a DLP projector's fastest to the dimmest colour LCD, taken from makers' tables. What
//! is outside is a slip of a digit or of a unit more often than it is meant.
use std::ops::RangeInclusive;

/// Exposures of the layers above the bottom ones, s.
pub const USUAL_S: RangeInclusive<f64> = 0.3..=60.0;

/// Longest exposure of a bottom layer, s.
pub const LONGEST_S: f64 = 300.0;

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Wrong {
    /// Not exposed at all.
    Dark,
    /// Shorter than any layer cures in.
    TooShort,
    /// Longer than any layer takes.
    TooLong,
    /// The layer on the plate is exposed for less than the job's last one: it would not stick.
    BottomShort,
}

/// Layers with an exposure that is wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Amiss {
    /// What.
    pub wrong: Wrong,
    /// First layer.
    pub layer: u32,
    /// Last layer.
    pub end_layer: u32,
    /// The exposure of the first layer, s.
    pub exposure_s: f64,
}

/// What is wrong with the exposures of a job's layers, from the plate up, s.
#[must_use]
pub fn amiss(exposures_s: &[f64]) -> Vec<Amiss> {
    let Some(&last_s) = exposures_s.last() else { return Vec::new() };
    // Bottom layers and those that lead over from them are exposed longer.
    let leading = exposures_s.windows(2).take_while(|pair| pair[0] > last_s && pair[1] <= pair[0]).count();
    let wrong = |layer: usize, exposure_s: f64| {
        let longest_s = if layer < leading { LONGEST_S } else { *USUAL_S.end() };
        match exposure_s {
            s if s <= 0.0 => Some(Wrong::Dark),
            s if s < *USUAL_S.start() => Some(Wrong::TooShort),
            s if s > longest_s => Some(Wrong::TooLong),
            s if layer == 0 && s < last_s => Some(Wrong::BottomShort),
            _ => None,
        }
    };
    let mut found: Vec<Amiss> = Vec::new();
    for ((layer, &exposure_s), number) in exposures_s.iter().enumerate().zip(0..) {
        let Some(wrong) = wrong(layer, exposure_s) else { continue };
        match found.last_mut() {
            Some(last) if last.wrong == wrong && last.end_layer + 1 == number => last.end_layer = number,
            _ => found.push(Amiss { wrong, layer: number, end_layer: number, exposure_s }),
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slips_are_told_with_their_layers() {
        use Wrong::{BottomShort, Dark, TooLong, TooShort};
        let check = |exposures_s: &[f64], expect: &[(Wrong, u32, u32)]| {
            let found: Vec<_> = amiss(exposures_s).iter().map(|a| (a.wrong, a.layer, a.end_layer)).collect();
            assert_eq!(found, expect, "{exposures_s:?}");
        };
        check(&[], &[]);
        check(&[35.0, 35.0, 20.0, 7.0, 7.0, 7.0], &[]);
        check(&[2.0, 2.0], &[]);
        check(&[0.3, 60.0, 60.0], &[(BottomShort, 0, 0)]);
        check(&[300.0, 100.0, 2.0, 2.0], &[]);
        check(&[301.0, 301.0, 100.0, 2.0], &[(TooLong, 0, 1)]);
        check(&[35.0, 0.0, 0.0, 7.0], &[(Dark, 1, 2)]);
        check(&[35.0, 0.007, 0.007], &[(TooShort, 1, 2)]);
        check(&[35.0, 7000.0, 7000.0], &[(BottomShort, 0, 0), (TooLong, 1, 2)]);
        check(&[61.0, 61.0, 61.0], &[(TooLong, 0, 2)]);
        // A layer in between that is longer than the bottom layers' way down.
        check(&[35.0, 7.0, 61.0, 7.0], &[(TooLong, 2, 2)]);
    }
}
