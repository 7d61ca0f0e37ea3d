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

/// Neighbours kept of each bead end. A step of a tour mostly finds one of them
/// unprinted; else all the beads are searched.
const NEIGHBOURS: usize = 8;

/// For each bead end the nearest ends of other beads, found once for all the tours of a section.
pub struct Near {
    /// Nearest first, ties by the lower end; end `2 b + s` is bead b's end s.
    lists: Vec<[u32; NEIGHBOURS]>,
    /// For each bead the least way to any other bead's end, mm: no order enters it
    /// over a shorter jump, which tells a hopeless tour long before its end.
    least_mm: Vec<f64>,
}

/// Stands for no end in a list that is not full.
const NO_END: u32 = u32::MAX;

fn point_of(end: u32, beads: &[Bead]) -> Point {
    beads[(end / 2) as usize].ends[(end % 2) as usize]
}

/// Squared distance, mm², and end.
type Neighbour = (f64, u32);

fn longer_axis(beads: &[Bead]) -> usize {
    let span = |axis: usize| {
        let ends = beads.iter().flat_map(|b| b.ends).map(|p| p[axis]);
        ends.clone().fold(f64::NEG_INFINITY, f64::max) - ends.fold(f64::INFINITY, f64::min)
    };
    usize::from(span(1) > span(0))
}

/// The nearest ends of other beads to the end at `from`, among all, sorted along an axis.
fn nearest_of(sorted: &[(f64, f64, u32)], from: usize) -> [Neighbour; NEIGHBOURS] {
    let (x, y, end) = sorted[from];
    let mut list = [(f64::INFINITY, NO_END); NEIGHBOURS];
    // False when everything further on is further away than what is listed.
    let mut take = |&(other_x, other_y, other): &(f64, f64, u32)| {
        let (dx, dy) = (other_x - x, other_y - y);
        let last = list[NEIGHBOURS - 1];
        if dx * dx > last.0 {
            return false;
        }
        let new = (dx * dx + dy * dy, other);
        if new < last && other / 2 != end / 2 {
            let mut place = NEIGHBOURS - 1;
            while place > 0 && new < list[place - 1] {
                list[place] = list[place - 1];
                place -= 1;
            }
            list[place] = new;
        }
        true
    };
    let (mut left, mut right) = (sorted[..from].iter().rev(), sorted[from + 1..].iter());
    let (mut more_left, mut more_right) = (true, true);
    while more_left || more_right {
        more_left = more_left && left.next().is_some_and(&mut take);
        more_right = more_right && right.next().is_some_and(&mut take);
    }
    list
}

impl Near {
    /// Goes out from each end along the axis in which the ends lie furthest apart,
    /// until what is left is further away along that axis alone.
    #[must_use]
    pub fn new(beads: &[Bead]) -> Near {
        let count = 2 * beads.len() as u32;
        let axis = longer_axis(beads);
        // Side by side in the order of the axis: place along it and across, and which end.
        let mut sorted: Vec<(f64, f64, u32)> = (0..count)
            .map(|end| {
                let p = point_of(end, beads);
                (p[axis], p[1 - axis], end)
            })
            .collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.2.cmp(&b.2)));
        let mut near = Near {
            lists: vec![[NO_END; NEIGHBOURS]; count as usize],
            least_mm: vec![f64::INFINITY; beads.len()],
        };
        for k in 0..sorted.len() {
            let end = sorted[k].2;
            let list = nearest_of(&sorted, k);
            near.lists[end as usize] = list.map(|n| n.1);
            let least_mm = if list[0].1 == NO_END { 0.0 } else { list[0].0.sqrt() };
            let least = &mut near.least_mm[(end / 2) as usize];
            *least = least.min(least_mm);
        }
        near
    }

    /// The nearest end of a bead not yet printed.
    fn unprinted(&self, from: Option<u32>, at: Point, beads: &[Bead], printed: &[bool]) -> Option<u32> {
        let list = from.map_or(&[][..], |end| &self.lists[end as usize]);
        let known = list.iter().find(|&&end| end != NO_END && !printed[(end / 2) as usize]);
        known.copied().or_else(|| {
            let mut best = (f64::INFINITY, None);
            for (bead, ends) in beads.iter().enumerate().filter(|(bead, _)| !printed[*bead]) {
                for (side, p) in ends.ends.iter().enumerate() {
                    let squared = (p[0] - at[0]) * (p[0] - at[0]) + (p[1] - at[1]) * (p[1] - at[1]);
                    if squared < best.0 {
                        best = (squared, Some(2 * bead as u32 + side as u32));
                    }
                }
            }
            best.1
        })
    }
}

/// Visits every bead, each time the nearest. Stops early and gives `None` as soon
/// as the cost must leave the limit.
#[must_use]
pub fn nearest(
    beads: &[Bead],
    near: &Near,
    ends: Ends,
    start: Start,
    rule: &impl LiftRule,
    limit: Limit,
) -> Option<Tour> {
    let mut printed = vec![false; beads.len()];
    let mut tour = Tour { order: Vec::with_capacity(beads.len()), cost: Cost::ZERO, breaks: Vec::new() };
    let mut at = ends.entry;
    let mut from = None;
    // The first bead is entered from the entry, which may be nearer than any bead.
    let mut ahead_mm: f64 = near.least_mm.iter().sum();
    for k in 0..beads.len() as u32 {
        let visit = match start {
            Start::At(first) if k == 0 => first,
            _ => {
                let end = near.unprinted(from, at, beads, &printed)?;
                Visit { bead: end / 2, reversed: end % 2 == 1 }
            }
        };
        printed[visit.bead as usize] = true;
        let to = visit.start(beads);
        tour.cost.travel_mm += distance_mm(at, to);
        if (k > 0 || ends.entry_counts) && rule.needs_lift(at, to) {
            tour.cost.lifts += 1;
            tour.breaks.push(k);
        }
        ahead_mm -= near.least_mm[visit.bead as usize];
        // A nanometre for the rounding of the sum.
        let at_least = Cost { travel_mm: tour.cost.travel_mm + (ahead_mm - 1e-6).max(0.0), ..tour.cost };
        if !limit.admits(at_least) {
            return None;
        }
        at = visit.end(beads);
        from = Some(2 * visit.bead + u32::from(!visit.reversed));
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
        let tour =
            nearest(&beads, &Near::new(&beads), ends([0.0, 0.0]), Start::Entry, &Longer(1.5), Limit::NONE)
                .unwrap();
        let order: Vec<_> = tour.order.iter().map(|v| (v.bead, v.reversed)).collect();
        assert_eq!(order, [(0, false), (1, true), (2, false), (3, true)]);
        assert_eq!(tour.cost, Cost { lifts: 0, travel_mm: 3.0 });
        assert!(tour.breaks.is_empty());
    }

    #[test]
    fn stops_at_the_limit() {
        let beads = [Bead { ends: [[10.0, 0.0], [11.0, 0.0]] }];
        let check = |limit: Limit, stops: bool| {
            let tour =
                nearest(&beads, &Near::new(&beads), ends([0.0, 0.0]), Start::Entry, &Longer(100.0), limit);
            assert_eq!(tour.is_none(), stops, "{limit:?}");
        };
        check(Limit { cost: Cost { lifts: 0, travel_mm: 5.0 }, ..Limit::NONE }, true);
        check(Limit { travel_mm: 5.0, ..Limit::NONE }, true);
        check(Limit { travel_mm: 10.0, ..Limit::NONE }, false);
    }

    proptest! {
        #[test]
        fn neighbours_are_the_nearest(beads in beads(1..20)) {
            let near = Near::new(&beads);
            for end in 0..2 * beads.len() as u32 {
                let at = point_of(end, &beads);
                let mut others: Vec<(f64, u32)> = (0..2 * beads.len() as u32)
                    .filter(|o| o / 2 != end / 2)
                    .map(|o| (distance_mm(at, point_of(o, &beads)), o))
                    .collect();
                others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                let list: Vec<u32> = near.lists[end as usize].into_iter().filter(|e| *e != NO_END).collect();
                let expect: Vec<u32> = others.iter().take(NEIGHBOURS).map(|o| o.1).collect();
                prop_assert_eq!(list, expect);
                prop_assert!(others.iter().all(|o| near.least_mm[(end / 2) as usize] <= o.0));
            }
        }

        #[test]
        fn a_limit_only_stops_what_leaves_it(beads in beads(1..20), entry in point(), part in 0.3f64..1.5) {
            let whole = nearest(&beads, &Near::new(&beads), ends(entry), Start::Entry, &Longer(3.0), Limit::NONE).unwrap();
            let limit = Limit { travel_mm: whole.cost.travel_mm * part, ..Limit::NONE };
            let cut = nearest(&beads, &Near::new(&beads), ends(entry), Start::Entry, &Longer(3.0), limit);
            prop_assert_eq!(cut.is_some(), limit.admits(whole.cost));
        }

        #[test]
        fn each_step_is_to_the_nearest(beads in beads(1..30), entry in point()) {
            let tour = nearest(&beads, &Near::new(&beads), ends(entry), Start::Entry, &Longer(3.0), Limit::NONE).unwrap();
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
