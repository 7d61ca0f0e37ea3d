//! Rings moved outward or inward: the raw material of growing and shrinking.
//!
//! Takes a closed ring with the solid on its left and a distance, gives a ring that
//! winds around every point of the grown (or shrunk) region at least once, and not
//! around any other; it may cross itself, which whoever asked has to resolve by
//! positive winding. Uses no function but square roots: the same bits on every
//! machine. Knows no polygon library and no other ring.
//!
//! Each edge moves along its normal. Where the ring bends away from the side it moves
//! to, an arc joins the moved edges. Where it bends towards it, they cross: either the
//! crossing is the corner, if it lies on both, or the ring goes by way of the corner
//! it came from, which encloses only what is grown over anyway (shrunk away, inward).
use super::shape::{MAX_COORDINATE, Point, Ring};

type Vector = [f64; 2];

/// Halvings of half a turn at most: 1024 chords of it.
const MAX_HALVINGS: u32 = 10;

/// Moves a ring to its right by `distance` (to its left where negative), grid steps.
/// Arcs differ from circles by at most `tolerance` and rounding; points that would
/// leave the grid stay at its border.
pub(super) fn offset(ring: &[Point], distance: f64, tolerance: f64) -> Ring {
    let pen = Pen { distance, tolerance };
    let mut moved = Ring::with_capacity(ring.len() + ring.len() / 2 + 8);
    // Points apart from their neighbours only: an edge needs a direction.
    let mut corners: Vec<Point> = ring.to_vec();
    corners.dedup();
    while corners.len() > 1 && corners.first() == corners.last() {
        corners.pop();
    }
    if corners.len() < 2 {
        return moved;
    }
    let edge = |k: usize| Edge::new(corners[k % corners.len()], corners[(k + 1) % corners.len()]);
    let mut before = edge(corners.len() - 1);
    for (k, &corner) in corners.iter().enumerate() {
        let after = edge(k);
        pen.turn(corner, &before, &after, &mut moved);
        before = after;
    }
    moved
}

/// An edge's direction, a unit vector, and its length in grid steps.
struct Edge {
    way: Vector,
    length: f64,
}

impl Edge {
    fn new(a: Point, b: Point) -> Edge {
        let (dx, dy) = (f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y));
        let length = (dx * dx + dy * dy).sqrt();
        Edge { way: [dx / length, dy / length], length }
    }

    /// The unit vector to the right.
    fn right(&self) -> Vector {
        [self.way[1], -self.way[0]]
    }
}

struct Pen {
    distance: f64,
    tolerance: f64,
}

impl Pen {
    /// The point of the grid at a vector, times a length, from a corner.
    fn put(&self, from: Point, way: Vector, length: f64, ring: &mut Ring) {
        let limit = f64::from(MAX_COORDINATE);
        let at = |from: i32, part: f64| (f64::from(from) + part * length).round().clamp(-limit, limit) as i32;
        ring.push(Point { x: at(from.x, way[0]), y: at(from.y, way[1]) });
    }

    /// What becomes of a corner.
    fn turn(&self, corner: Point, a: &Edge, b: &Edge, ring: &mut Ring) {
        let cross = a.way[0] * b.way[1] - a.way[1] * b.way[0];
        let dot = a.way[0] * b.way[0] + a.way[1] * b.way[1];
        let (u, v) = (a.right(), b.right());
        // Half the turn: its cosine, and twice how far along the edges the mitre lies.
        let cosine = ((1.0 + dot) / 2.0).max(0.0).sqrt();
        let reach = 2.0 * (self.distance * cross).abs();
        let fits = reach <= a.length.min(b.length) * (1.0 + dot);
        let opens = cross * self.distance > 0.0 || cross == 0.0 && dot < 0.0;
        let flat = self.distance.abs() * (1.0 - cosine) <= self.tolerance * cosine;
        if dot > -0.99 && if opens { flat } else { fits } {
            self.put(corner, [u[0] + v[0], u[1] + v[1]], self.distance / (1.0 + dot), ring);
        } else if opens {
            self.put(corner, u, self.distance, ring);
            self.arc(corner, u, v, MAX_HALVINGS, ring);
            self.put(corner, v, self.distance, ring);
        } else {
            self.put(corner, u, self.distance, ring);
            ring.push(corner);
            self.put(corner, v, self.distance, ring);
        }
    }

    /// The points between the ends of an arc of at most half a turn.
    fn arc(&self, corner: Point, u: Vector, v: Vector, halvings: u32, ring: &mut Ring) {
        let dot = u[0] * v[0] + u[1] * v[1];
        let cosine = ((1.0 + dot) / 2.0).max(0.0).sqrt();
        if halvings == 0 || self.distance.abs() * (1.0 - cosine) <= self.tolerance {
            return;
        }
        // The chord turned to the outside: opposite vectors have a middle too.
        let turned = if self.distance > 0.0 { 1.0 } else { -1.0 };
        let middle = [turned * (v[1] - u[1]), turned * (u[0] - v[0])];
        let length = (middle[0] * middle[0] + middle[1] * middle[1]).sqrt();
        let middle = [middle[0] / length, middle[1] / length];
        self.arc(corner, u, middle, halvings - 1, ring);
        self.put(corner, middle, self.distance, ring);
        self.arc(corner, middle, v, halvings - 1, ring);
    }
}

#[cfg(test)]
mod tests {
    use crate::layers::polygon::{Inside, difference, grow, resolve};
    use crate::layers::shape::{Point, Region, Ring, UNITS_PER_MM};
    use proptest::prelude::*;

    /// How far a point lies from a region's border, grid steps; negative inside.
    fn depth(region: &Region, [x, y]: [f64; 2]) -> f64 {
        let (mut within, mut nearest) = (false, f64::INFINITY);
        for ring in region.rings() {
            for k in 0..ring.len() {
                let at = |k: usize| [ring[k % ring.len()].x, ring[k % ring.len()].y].map(f64::from);
                let ([ax, ay], [bx, by]) = (at(k), at(k + 1));
                within ^= (ay > y) != (by > y) && ax + (y - ay) / (by - ay) * (bx - ax) > x;
                let (dx, dy) = (bx - ax, by - ay);
                let along = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
                nearest = nearest.min((ax + along * dx - x).hypot(ay + along * dy - y));
            }
        }
        if within { -nearest } else { nearest }
    }

    /// Regions with holes, pieces, narrow necks and sharp tips, about 1 mm wide.
    fn regions() -> impl Strategy<Value = Region> {
        let point = || (0..100_i32, 0..100_i32).prop_map(|(x, y)| Point { x: 100 * x, y: 100 * y });
        let rings = || prop::collection::vec(prop::collection::vec(point(), 3..9), 1..4);
        (rings(), rings()).prop_map(|(solid, cut)| {
            let of = |rings: &[Ring]| resolve(rings, Inside::NonZero);
            difference(&of(&solid), &of(&cut))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 120, ..ProptestConfig::default() })]

        #[test]
        fn grown_is_what_lies_within_the_distance(
            region in regions(),
            steps in prop_oneof![-3000..3000_i32, -60..60_i32],
            points in prop::collection::vec((-3000..13000_i32, -3000..13000_i32), 100),
        ) {
            let distance = f64::from(steps);
            let grown = grow(&region, distance / UNITS_PER_MM);
            for (x, y) in points {
                let at = [f64::from(x) + 0.3, f64::from(y) + 0.7];
                let beyond = depth(&region, at) - distance;
                // The tolerance of arcs, and rounding where edges run together.
                if beyond.abs() > 24.0 {
                    prop_assert_eq!(depth(&grown, at) < 0.0, beyond < 0.0, "{:?} {}", at, beyond);
                }
            }
        }
    }

    #[test]
    fn growing_knows_its_limits() {
        let square: Ring = [(0, 0), (9000, 0), (9000, 9000), (0, 9000)].map(|(x, y)| Point { x, y }).to_vec();
        let region = resolve([&square], Inside::Positive);
        let check = |mm: f64, area_mm2: std::ops::RangeInclusive<f64>| {
            let found = grow(&region, mm).area_mm2();
            assert!(area_mm2.contains(&found), "{mm}: {found}");
        };
        check(0.0, 0.81..=0.81);
        check(f64::NAN, 0.81..=0.81);
        check(-0.4, 0.009_999..=0.010_001);
        check(-0.45, 0.0..=0.0);
        check(-1e300, 0.0..=0.0);
        // 4 × 0.9 × 0.1 and a disc of 0.1 mm more.
        check(0.1, 1.20..=1.201_5);
        // No farther than the grid: all of it, about 107 m wide.
        check(1e300, 1.1e10..=1.2e10);
        assert!(grow(&Region::default(), 1.0).is_empty());
    }
}
