//! Which layer of a job post-processing improved most.
//!
//! Takes a job as it was and as it is, layer by layer; gives both sides of the
//! layer that lost the most retractions, or among equals the most travel.
//! Memory is bounded by the largest layers.
use super::strokes::Paths;
use crate::post::annotate::{Layers, Unfit};
use crate::post::measure::Totals;
use outrigger_gcode::dialect::Dialect;
use std::io::BufRead;

/// A layer as it was, and as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair {
    /// As the slicer ordered it.
    pub before: Paths,
    /// Reordered.
    pub after: Paths,
}

/// The layer that gained most; `None` when none was changed.
///
/// # Errors
/// One of the jobs cannot be read on.
pub fn most_improved(
    before: impl BufRead,
    after: impl BufRead,
    dialect: Dialect,
) -> Result<Option<Pair>, Unfit> {
    let (mut before, mut after) = (Layers::new(before, dialect), Layers::new(after, dialect));
    let mut best: Option<(Gain, Pair)> = None;
    while let (Some(b), Some(a)) = (before.next_layer()?, after.next_layer()?) {
        // Most layers of most jobs are as they were.
        if b.number == 0 || b.input() == a.input() {
            continue;
        }
        let pair = Pair { before: Paths::of(&b), after: Paths::of(&a) };
        let gain = Gain::of(&pair.before.totals, &pair.after.totals);
        if best.as_ref().is_none_or(|(most, _)| gain > *most) {
            best = Some((gain, pair));
        }
    }
    Ok(best.map(|(_, pair)| pair))
}

/// Ordered by the retractions first.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
struct Gain {
    retractions: i64,
    travel_mm: f64,
}

impl Gain {
    fn of(before: &Totals, after: &Totals) -> Gain {
        let count = |n: u64| i64::try_from(n).unwrap_or(i64::MAX);
        Gain {
            retractions: count(before.retractions) - count(after.retractions),
            travel_mm: before.travel_mm - after.travel_mm,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Layers of beads 1 mm long at these places, jumps longer than 5 mm retracted.
    fn job(layers: &[&[f64]]) -> String {
        let mut text = "M83\n".to_owned();
        for (n, beads) in layers.iter().enumerate() {
            text += &format!(";LAYER_CHANGE\nG1 Z{}\n", n + 1);
            let mut at = beads.first().copied().unwrap_or(0.0);
            for &x in *beads {
                let far = (x - at).abs() > 5.0;
                text += if far { "G1 E-1\n" } else { "" };
                text += &format!("G1 X{x}\n{}G1 X{} E.1\n", if far { "G1 E1\n" } else { "" }, x + 1.0);
                at = x + 1.0;
            }
        }
        text
    }

    fn check(before: &[&[f64]], after: &[&[f64]], expect: Option<(u32, i64)>) {
        let pair = most_improved(job(before).as_bytes(), job(after).as_bytes(), Dialect::Prusa).unwrap();
        let gained = pair.map(|p| (p.before.number, Gain::of(&p.before.totals, &p.after.totals).retractions));
        assert_eq!(gained, expect, "{before:?} {after:?}");
    }

    #[test]
    fn the_layer_that_lost_most_retractions_is_chosen() {
        let mixed: &[f64] = &[0.0, 20.0, 2.0, 22.0];
        let sorted: &[f64] = &[0.0, 2.0, 20.0, 22.0];
        check(&[], &[], None);
        check(&[mixed], &[mixed], None);
        // The gain is of the way within a layer; the way to the next may have gained more.
        check(&[sorted], &[mixed], Some((1, -2)));
        check(&[sorted, mixed, sorted], &[sorted, sorted, sorted], Some((2, 2)));
        // The first of equals stands.
        check(&[mixed, mixed], &[sorted, sorted], Some((1, 2)));
        // Among equal retractions, travel decides.
        check(&[&[0.0, 4.0, 2.0], &[0.0, 5.0, 2.0]], &[&[0.0, 2.0, 4.0], &[0.0, 2.0, 5.0]], Some((2, 0)));
    }

    #[test]
    fn a_job_that_ends_early_is_compared_as_far_as_it_goes() {
        let (mixed, sorted): (&[f64], &[f64]) = (&[0.0, 20.0, 2.0], &[0.0, 2.0, 20.0]);
        check(&[mixed, mixed], &[sorted], Some((1, 1)));
    }
}
