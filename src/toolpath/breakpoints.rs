//! Nearest neighbour, restarted only where the first pass broke the bead (paper 002, section III and Fig. 5).
//!
//! The paper leaves open what a restart does with the entry: here the nozzle
//! jumps from the entry to the restart, and that jump is part of the cost. The
//! paper restarts at the two points of each break; a bead has two ends, so each
//! of the two beads at a break is tried from both of its ends. "Fewest lifts"
//! decides, then the least travel, then the earlier candidate. Without a break
//! there is nothing to restart, and the first pass stands (the paper's line 20).
use super::bead::{Bead, Cost, Ends, LiftRule, Visit, cost};
use super::nearest::{Limit, Near, Start, Tour, nearest};

/// Most bead visits that one section's restarts may cost. A restart visits every
/// bead, so a section of 1,000 beads gets 40 restarts, of 100 beads 400: enough for
/// every break of a usual section, and linear in the beads for the largest.
const MAX_RESTART_VISITS: usize = 40_000;

/// Fewest restarts however large the section.
const MIN_RESTARTS: usize = 4;

/// The best of the first pass and of its restarts; `None` when none of them beats
/// `bound` with at most `most_mm` of travel.
#[must_use]
pub fn breakpoints(
    beads: &[Bead],
    ends: Ends,
    rule: &impl LiftRule,
    bound: Cost,
    most_mm: f64,
) -> Option<Tour> {
    let near = Near::new(beads);
    let first = nearest(beads, &near, ends, Start::Entry, rule, Limit::NONE)?;
    let starts = restarts(&first);
    let mut limit = Limit { cost: bound, travel_mm: most_mm };
    let mut best = None;
    let mut take = |tour: Tour, limit: &mut Limit| {
        if limit.admits(tour.cost) {
            limit.cost = tour.cost;
            best = Some(tour);
        }
    };
    take(first, &mut limit);
    for start in starts {
        if let Some(tour) = nearest(beads, &near, ends, Start::At(start), rule, limit) {
            take(tour, &mut limit);
        }
    }
    best
}

/// Both ends of the beads on both sides of each break, evenly thinned to the budget.
fn restarts(first: &Tour) -> Vec<Visit> {
    let mut starts: Vec<Visit> = Vec::new();
    let mut seen = vec![false; first.order.len()];
    for &at in &first.breaks {
        for k in [at.checked_sub(1), Some(at)].into_iter().flatten() {
            let visit = first.order[k as usize];
            if !std::mem::replace(&mut seen[visit.bead as usize], true) {
                starts.push(visit);
                starts.push(Visit { reversed: !visit.reversed, ..visit });
            }
        }
    }
    let most = (MAX_RESTART_VISITS / first.order.len().max(1)).max(MIN_RESTARTS);
    let step = starts.len().div_ceil(most).max(1);
    starts.into_iter().step_by(step).collect()
}

/// The slicer's order when nothing found is better, else the better one, with its
/// cost: fewer lifts without more travel, or less travel without more lifts.
#[must_use]
pub fn never_worse(
    sliced: &[Visit],
    beads: &[Bead],
    ends: Ends,
    rule: &impl LiftRule,
) -> (Option<Vec<Visit>>, Cost) {
    let own = cost(sliced, beads, ends, rule);
    match breakpoints(beads, ends, rule, own, own.travel_mm) {
        Some(tour) => (Some(tour.order), tour.cost),
        None => (None, own),
    }
}

#[cfg(test)]
mod tests {
    use super::super::bead::as_sliced;
    use super::super::bead::testing::{Longer, beads, is_whole, point};
    use super::*;
    use proptest::prelude::*;

    fn ends(entry: [f64; 2], exit: Option<[f64; 2]>) -> Ends {
        Ends { entry, entry_counts: false, exit, exit_counts: false }
    }

    /// Paper 002, Fig. 4 and 6: raster lines in a circle, entered a quarter past
    /// the centre: nearest neighbour needs two beads, a restart at the break one.
    #[test]
    fn the_papers_circle_goes_from_one_lift_to_none() {
        let lines: Vec<Bead> = (0..39)
            .map(|k| {
                let y = f64::from(k) - 19.0;
                let x = (20.0f64 * 20.0 - y * y).sqrt();
                Bead { ends: [[-x, y], [x, y]] }
            })
            .collect();
        let entry = [0.0, 10.0];
        let entry = Ends { entry: lines[29].ends[0], ..ends(entry, None) };
        // Consecutive lines near the poles are far apart along the rim.
        let rule = Longer(8.0);
        let first = nearest(&lines, &Near::new(&lines), entry, Start::Entry, &rule, Limit::NONE).unwrap();
        assert_eq!(first.cost.lifts, 1);
        let best = breakpoints(&lines, entry, &rule, Cost::WORST, f64::INFINITY).unwrap();
        assert_eq!(best.cost.lifts, 0);
    }

    proptest! {
        #[test]
        fn never_worse_than_nearest_nor_than_the_slicer(beads in beads(1..25), entry in point(), exit in proptest::option::of(point())) {
            let rule = Longer(8.0);
            let ends = ends(entry, exit);
            let sliced = as_sliced(beads.len());
            let own = cost(&sliced, &beads, ends, &rule);
            let first = nearest(&beads, &Near::new(&beads), ends, Start::Entry, &rule, Limit::NONE).unwrap();
            let best = breakpoints(&beads, ends, &rule, Cost::WORST, f64::INFINITY).unwrap();
            prop_assert!(!first.cost.beats(best.cost));
            prop_assert!(is_whole(&best.order, beads.len()));
            prop_assert_eq!(cost(&best.order, &beads, ends, &rule), best.cost);
            let (order, chosen) = never_worse(&sliced, &beads, ends, &rule);
            prop_assert!(chosen.lifts <= own.lifts && chosen.travel_mm <= own.travel_mm);
            prop_assert_eq!(order.is_some(), chosen.beats(own));
        }
    }
}
