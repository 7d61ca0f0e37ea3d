//! Nearest neighbour: from where the nozzle is, always the nearest end of a bead not yet printed.
//!
//! Paper 002, Fig. 3, over both ends of each bead. Ties go to the lower index, so
//! the order is the same on every machine.
use super::bead::{Bead, Cost, Ends, LiftRule, Point, Visit, add_exit, distance_mm};

/// Where the first bead is sought.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// The nearest to the entry.
    Entry,
    /// This visit, wherever it is.
    At(Visit),
}

/// An order, its cost, and where it broke.
#[derive(Clone, Debug, PartialEq)]
pub struct Tour {
    /// Every bead once.
    pub order: Vec<Visit>,
    /// From entry to exit.
    pub cost: Cost,
    /// Indices into `order` of the visits that a lift comes before (0: before the first).
    pub breaks: Vec<u32>,
}

/// What a tour must stay below to be of interest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limit {
    /// It must beat this.
    pub cost: Cost,
    /// And travel no further than this, mm.
    pub travel_mm: f64,
}

impl Limit {
    /// Every tour is of interest.
    pub const NONE: Limit = Limit { cost: Cost::WORST, travel_mm: f64::INFINITY };

    /// Whether a cost is within it.
    #[must_use]
    pub fn admits(self, cost: Cost) -> bool {
        cost.beats(self.cost) && cost.travel_mm <= self.travel_mm
    }
}

/// Beads not yet printed, as two columns of coordinates a bead end, so that the
/// search for the nearest is a plain sweep that the compiler can vectorise.
struct Left {
    x: Vec<f32>,
    y: Vec<f32>,
    end: Vec<u32>,
}

impl Left {
    fn new(beads: &[Bead]) -> Left {
        let mut left = Left { x: Vec::new(), y: Vec::new(), end: Vec::new() };
        for (k, bead) in beads.iter().enumerate() {
            for (side, p) in bead.ends.iter().enumerate() {
                left.x.push(p[0] as f32);
                left.y.push(p[1] as f32);
                left.end.push((2 * k + side) as u32);
            }
        }
        left
    }

    /// Slot of the nearest end; ties and what `f32` cannot tell apart are decided
    /// by the exact distance, then by the lower end.
    fn nearest(&self, at: Point, beads: &[Bead]) -> Option<u32> {
        let (x, y) = (at[0] as f32, at[1] as f32);
        let squared = |k: usize| {
            let (dx, dy) = (self.x[k] - x, self.y[k] - y);
            dx * dx + dy * dy
        };
        let least = (0..self.x.len()).map(squared).fold(f32::INFINITY, f32::min);
        // 1e-4 relative covers the rounding of coordinates up to a metre at 0.1 mm.
        let limit = least * 1.0001 + 1e-6;
        (0..self.x.len())
            .filter(|&k| squared(k) <= limit)
            .map(|k| (distance_mm(at, point_of(self.end[k], beads)), self.end[k]))
            .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            .map(|(_, end)| end)
    }

    /// Takes both ends of a bead out; each removal moves the last into the gap.
    fn remove(&mut self, bead: u32, slot_of: &mut [u32]) {
        for end in [2 * bead, 2 * bead + 1] {
            let slot = slot_of[end as usize] as usize;
            self.x.swap_remove(slot);
            self.y.swap_remove(slot);
            self.end.swap_remove(slot);
            if let Some(&moved) = self.end.get(slot) {
                slot_of[moved as usize] = slot as u32;
            }
        }
    }
}

fn point_of(end: u32, beads: &[Bead]) -> Point {
    beads[(end / 2) as usize].ends[(end % 2) as usize]
}

/// Visits every bead, each time the nearest. Stops early and gives `None` as soon
/// as the cost leaves the limit.
#[must_use]
pub fn nearest(beads: &[Bead], ends: Ends, start: Start, rule: &impl LiftRule, limit: Limit) -> Option<Tour> {
    let mut left = Left::new(beads);
    let mut slot_of: Vec<u32> = (0..2 * beads.len() as u32).collect();
    let mut tour = Tour { order: Vec::with_capacity(beads.len()), cost: Cost::ZERO, breaks: Vec::new() };
    let mut at = ends.entry;
    for k in 0..beads.len() as u32 {
        let visit = match start {
            Start::At(first) if k == 0 => first,
            _ => {
                let end = left.nearest(at, beads)?;
                Visit { bead: end / 2, reversed: end % 2 == 1 }
            }
        };
        left.remove(visit.bead, &mut slot_of);
        let to = visit.start(beads);
        tour.cost.travel_mm += distance_mm(at, to);
        if (k > 0 || ends.entry_counts) && rule.needs_lift(at, to) {
            tour.cost.lifts += 1;
            tour.breaks.push(k);
        }
        if !limit.admits(tour.cost) {
            return None;
        }
        at = visit.end(beads);
        tour.order.push(visit);
    }
    add_exit(&mut tour.cost, at, ends, rule);
    Some(tour)
}

#[cfg(test)]
mod tests {
    use super::super::bead::testing::{Longer, beads, is_whole, point};
    use super::super::bead::{Bead, cost};
    use super::*;
    use proptest::prelude::*;

    fn ends(entry: Point) -> Ends {
        Ends { entry, entry_counts: true, exit: None, exit_counts: true }
    }

    #[test]
    fn zig_zag_lines_are_printed_in_turn() {
        let beads: Vec<Bead> =
            (0..4).map(|k| Bead { ends: [[0.0, f64::from(k)], [9.0, f64::from(k)]] }).collect();
        let tour = nearest(&beads, ends([0.0, 0.0]), Start::Entry, &Longer(1.5), Limit::NONE).unwrap();
        let order: Vec<_> = tour.order.iter().map(|v| (v.bead, v.reversed)).collect();
        assert_eq!(order, [(0, false), (1, true), (2, false), (3, true)]);
        assert_eq!(tour.cost, Cost { lifts: 0, travel_mm: 3.0 });
        assert!(tour.breaks.is_empty());
    }

    #[test]
    fn stops_at_the_limit() {
        let beads = [Bead { ends: [[10.0, 0.0], [11.0, 0.0]] }];
        let check = |limit: Limit, stops: bool| {
            let tour = nearest(&beads, ends([0.0, 0.0]), Start::Entry, &Longer(100.0), limit);
            assert_eq!(tour.is_none(), stops, "{limit:?}");
        };
        check(Limit { cost: Cost { lifts: 0, travel_mm: 5.0 }, ..Limit::NONE }, true);
        check(Limit { travel_mm: 5.0, ..Limit::NONE }, true);
        check(Limit { travel_mm: 10.0, ..Limit::NONE }, false);
    }

    proptest! {
        #[test]
        fn each_step_is_to_the_nearest(beads in beads(1..30), entry in point()) {
            let tour = nearest(&beads, ends(entry), Start::Entry, &Longer(3.0), Limit::NONE).unwrap();
            prop_assert!(is_whole(&tour.order, beads.len()));
            let mut at = entry;
            for (k, visit) in tour.order.iter().enumerate() {
                let step = distance_mm(at, visit.start(&beads));
                for later in &tour.order[k..] {
                    for p in beads[later.bead as usize].ends {
                        prop_assert!(step <= distance_mm(at, p));
                    }
                }
                at = visit.end(&beads);
            }
            prop_assert_eq!(cost(&tour.order, &beads, ends(entry), &Longer(3.0)), tour.cost);
            prop_assert_eq!(tour.breaks.len() as u32, tour.cost.lifts);
        }
    }
}
