//! What is ordered: beads with two ends, visits to them, and the cost of an order.

/// A point of a layer, mm.
pub type Point = [f64; 2];

/// Straight distance, mm.
#[must_use]
pub fn distance_mm(a: Point, b: Point) -> f64 {
    // sqrt and not hypot: no coordinate here is near the limits that hypot guards.
    let (dx, dy) = (a[0] - b[0], a[1] - b[1]);
    (dx * dx + dy * dy).sqrt()
}

/// A run of extrusion, seen from outside: where it may be entered and left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bead {
    /// Start and end as the slicer printed it, mm.
    pub ends: [Point; 2],
}

/// A bead, and whether it is printed from its end to its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Visit {
    /// Index into the beads.
    pub bead: u32,
    /// From end to start.
    pub reversed: bool,
}

impl Visit {
    /// Where the visit begins.
    #[must_use]
    pub fn start(self, beads: &[Bead]) -> Point {
        beads[self.bead as usize].ends[usize::from(self.reversed)]
    }

    /// Where the visit ends.
    #[must_use]
    pub fn end(self, beads: &[Bead]) -> Point {
        beads[self.bead as usize].ends[usize::from(!self.reversed)]
    }
}

/// The slicer's own order of `count` beads.
#[must_use]
pub fn as_sliced(count: usize) -> Vec<Visit> {
    (0..count as u32).map(|bead| Visit { bead, reversed: false }).collect()
}

/// Says which jumps need a lift (a retraction), by geometry alone, so that it is
/// the same for every order.
pub trait LiftRule {
    /// Whether the jump from one point to another needs one.
    fn needs_lift(&self, from: Point, to: Point) -> bool;
}

/// What an order costs: fewer lifts are always better, less travel decides between equals.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub struct Cost {
    /// Jumps that need a lift.
    pub lifts: u32,
    /// Straight travel between beads, from the entry and to the exit, mm.
    pub travel_mm: f64,
}

impl Cost {
    /// Nothing yet.
    pub const ZERO: Cost = Cost { lifts: 0, travel_mm: 0.0 };
    /// More than any order costs.
    pub const WORST: Cost = Cost { lifts: u32::MAX, travel_mm: f64::INFINITY };

    /// Adds a jump.
    pub fn jump(&mut self, from: Point, to: Point, rule: &impl LiftRule) {
        self.travel_mm += distance_mm(from, to);
        self.lifts += u32::from(rule.needs_lift(from, to));
    }

    /// Whether this is better than another by more than rounding.
    #[must_use]
    pub fn beats(self, other: Cost) -> bool {
        self.lifts < other.lifts || (self.lifts == other.lifts && self.travel_mm < other.travel_mm - 1e-6)
    }
}

/// Where a section is entered, and where the print goes on after it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ends {
    /// Where the nozzle is before the first bead.
    pub entry: Point,
    /// Whether the jump to the first bead is counted as a lift when the rule says
    /// so; false when the nozzle is lifted already.
    pub entry_counts: bool,
    /// Where the next bead after the section starts, if one does.
    pub exit: Option<Point>,
    /// As `entry_counts`, for the jump to the exit.
    pub exit_counts: bool,
}

/// The cost of an order, from entry to exit.
#[must_use]
pub fn cost(order: &[Visit], beads: &[Bead], ends: Ends, rule: &impl LiftRule) -> Cost {
    let mut cost = Cost::ZERO;
    let mut at = ends.entry;
    for (k, visit) in order.iter().enumerate() {
        let start = visit.start(beads);
        if k > 0 || ends.entry_counts {
            cost.jump(at, start, rule);
        } else {
            cost.travel_mm += distance_mm(at, start);
        }
        at = visit.end(beads);
    }
    add_exit(&mut cost, at, ends, rule);
    cost
}

/// Adds the jump from the last bead to the exit.
pub fn add_exit(cost: &mut Cost, at: Point, ends: Ends, rule: &impl LiftRule) {
    if let Some(exit) = ends.exit {
        if ends.exit_counts {
            cost.jump(at, exit, rule);
        } else {
            cost.travel_mm += distance_mm(at, exit);
        }
    }
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;
    use proptest::prelude::*;

    /// Jumps longer than this need a lift.
    pub(crate) struct Longer(pub(crate) f64);

    impl LiftRule for Longer {
        fn needs_lift(&self, from: Point, to: Point) -> bool {
            distance_mm(from, to) > self.0
        }
    }

    pub(crate) fn point() -> impl Strategy<Value = Point> {
        [0.0..50.0f64, 0.0..50.0f64]
    }

    pub(crate) fn beads(count: std::ops::Range<usize>) -> impl Strategy<Value = Vec<Bead>> {
        proptest::collection::vec([point(), point()].prop_map(|ends| Bead { ends }), count)
    }

    /// Every bead once.
    pub(crate) fn is_whole(order: &[Visit], count: usize) -> bool {
        let mut seen = vec![false; count];
        order.iter().all(|v| !std::mem::replace(&mut seen[v.bead as usize], true)) && order.len() == count
    }
}
