//! Rings that neither cross nor touch, nested into polygons by one sweep.
//!
//! Takes closed rings on the grid, gives the [`Region`] that they wind around a
//! positive number of times, or says that two of them (or a ring and itself) share a
//! point, which [`super::polygon::resolve`] then has to untangle. Nearly all layers
//! of real meshes are free of that, and this is several times faster than a boolean.
//! Exact: integers only. Knows no polygon library and not where rings come from.
//!
//! The sweep is that of Shamos and Hoey, "Geometric intersection problems", 17th
//! Annual Symposium on Foundations of Computer Science (1976): vertices from left to
//! right (from low to high where x is the same), the edges over the sweep line in
//! order from low to high, and whatever become neighbours are tested. When no test
//! fails, nothing meets anything. The edge right below the first vertex of a ring
//! then tells where that ring lies.
use super::shape::{Point, Polygon, Region, Ring};

/// Marks a ring that the sweep has not reached, and a ring around which there is none.
const NONE: u32 = u32::MAX;

/// The sweep's memory, kept from layer to layer.
#[derive(Default)]
pub struct Nester {
    points: Vec<Corner>,
    /// x above, index into `points` below: 32 bits each.
    order: Vec<u64>,
    status: Vec<Edge>,
    rings: Vec<Nested>,
}

/// A vertex and its neighbours in its ring.
#[derive(Clone, Copy)]
struct Corner {
    at: Point,
    previous: u32,
    next: u32,
    ring: u32,
}

/// An edge over the sweep line; `left < right` in the order of the sweep.
#[derive(Clone, Copy)]
struct Edge {
    left: Point,
    right: Point,
    /// Index of the vertex at the right end.
    end: u32,
    ring: u32,
    /// Whether its ring runs from left to right along it.
    rightward: bool,
}

/// What the sweep learns of a ring at its first vertex.
#[derive(Clone, Copy)]
struct Nested {
    /// Winding number on the left of its walk; on the right it is one less.
    left: i32,
    counter_clockwise: bool,
    /// The ring right around it.
    parent: u32,
    /// The nearest border at it or around it.
    border: u32,
    /// Its first vertex in the order of the sweep.
    first: u32,
    /// Its first vertex as it was given.
    from: u32,
}

impl Nested {
    const UNSEEN: Nested =
        Nested { left: 0, counter_clockwise: false, parent: NONE, border: NONE, first: NONE, from: NONE };

    /// Whether it parts what is wound around (at least once) from what is not.
    fn is_border(self) -> bool {
        self.left == 1
    }
}

/// Two edges share a point.
struct Touch;

/// Twice the area of the triangle `a`, `b`, `c`: positive when `c` is on the left of `a` → `b`.
fn side(a: Point, b: Point, c: Point) -> i64 {
    let across = |p: Point, q: Point| (i64::from(p.x) - i64::from(q.x), i64::from(p.y) - i64::from(q.y));
    let ((bx, by), (cx, cy)) = (across(b, a), across(c, a));
    bx * cy - by * cx
}

impl Edge {
    /// Positive where a point within the edge's reach lies above it.
    fn below(&self, p: Point) -> i64 {
        side(self.left, self.right, p)
    }

    /// Whether it stays strictly below another that is strictly above it at the sweep
    /// line. Two edges that end in the same vertex meet there and nowhere else.
    fn stays_below(&self, above: &Edge) -> bool {
        if self.end == above.end {
            true
        } else if self.right < above.right {
            above.below(self.right) < 0
        } else {
            self.below(above.right) > 0
        }
    }
}

impl Nester {
    /// The region wound around by the rings at least once, counter-clockwise counting
    /// up and clockwise down: bodies within bodies are one, what turns the wrong way
    /// is a hole in a body and nothing outside of it.
    ///
    /// `None` where edges cross, touch, or lie on each other, other than neighbours in
    /// a ring at their common vertex. Rings of fewer than three points are nothing.
    /// Each ring of the result begins at its leftmost (then lowest) vertex, polygons
    /// come in the order of theirs, and so do the holes of a polygon: equal rings give
    /// equal regions, whatever order they came in.
    ///
    /// Takes O(n log n) time for n vertices where few edges lie over each other.
    #[must_use]
    pub fn nest(&mut self, rings: &[Ring]) -> Option<Region> {
        self.load(rings).ok()?;
        for k in 0..self.order.len() {
            self.step(self.order[k] as u32).ok()?;
        }
        Some(self.region(rings))
    }

    /// Takes the rings over and puts the vertices in order; no two may be equal.
    fn load(&mut self, rings: &[Ring]) -> Result<(), Touch> {
        self.points.clear();
        self.order.clear();
        self.status.clear();
        self.rings.clear();
        self.rings.resize(rings.len(), Nested::UNSEEN);
        for (ring, points) in rings.iter().enumerate() {
            if points.len() < 3 {
                continue;
            }
            let from = self.points.len() as u32;
            let last = from + points.len() as u32 - 1;
            self.rings[ring].from = from;
            for (k, &at) in (from..).zip(points) {
                let previous = if k == from { last } else { k - 1 };
                let next = if k == last { from } else { k + 1 };
                self.points.push(Corner { at, previous, next, ring: ring as u32 });
                self.order.push(u64::from((at.x as u32) ^ 0x8000_0000) << 32 | u64::from(k));
            }
        }
        self.order.sort();
        // The keys hold no y: vertices above each other are few, and are put right here.
        let points = &self.points;
        for same_x in self.order.chunk_by_mut(|a, b| a >> 32 == b >> 32) {
            if same_x.len() > 1 {
                same_x.sort_by_key(|&key| points[key as u32 as usize].at.y);
                let at = |key: u64| points[key as u32 as usize].at;
                if same_x.windows(2).any(|two| at(two[0]) == at(two[1])) {
                    return Err(Touch);
                }
            }
        }
        Ok(())
    }

    /// One vertex: the edges that end there leave the sweep line, those that begin enter it.
    fn step(&mut self, v: u32) -> Result<(), Touch> {
        let corner = self.points[v as usize];
        let (previous, next) =
            (self.points[corner.previous as usize].at, self.points[corner.next as usize].at);
        let at = self.status.partition_point(|e| e.below(corner.at) > 0);
        let edge = |right: Point, end: u32| Edge {
            left: corner.at,
            right,
            end,
            ring: corner.ring,
            rightward: end == corner.next,
        };
        match (previous < corner.at, next < corner.at) {
            (true, true) => self.end(v, at),
            (true, false) => self.pass(v, at, edge(next, corner.next)),
            (false, true) => self.pass(v, at, edge(previous, corner.previous)),
            (false, false) => {
                let (one, other) = (edge(previous, corner.previous), edge(next, corner.next));
                match side(corner.at, previous, next) {
                    0 => Err(Touch),
                    1.. => self.begin(v, at, one, other),
                    _ => self.begin(v, at, other, one),
                }
            }
        }
    }

    /// Both edges end in `v`: what was below and what was above them become neighbours.
    fn end(&mut self, v: u32, at: usize) -> Result<(), Touch> {
        match self.status.get(at..at + 2) {
            Some([a, b]) if a.end == v && b.end == v => drop(self.status.drain(at..at + 2)),
            _ => return Err(Touch),
        }
        match (at.checked_sub(1).and_then(|k| self.status.get(k)), self.status.get(at)) {
            (Some(below), Some(above)) if !below.stays_below(above) => Err(Touch),
            _ => Ok(()),
        }
    }

    /// One edge ends in `v`, and another takes its place.
    fn pass(&mut self, v: u32, at: usize, edge: Edge) -> Result<(), Touch> {
        match self.status.get_mut(at) {
            Some(old) if old.end == v => *old = edge,
            _ => return Err(Touch),
        }
        self.fits_above(at, &edge)?;
        self.fits_below(at + 1, &edge)
    }

    /// Both edges begin in `v`; a ring not seen before learns here where it lies.
    fn begin(&mut self, v: u32, at: usize, low: Edge, high: Edge) -> Result<(), Touch> {
        self.fits_above(at, &low)?;
        self.fits_below(at, &high)?;
        let ring = low.ring as usize;
        if self.rings[ring].first == NONE {
            let (outside, parent) = match at.checked_sub(1).map(|k| self.status[k]) {
                None => (0, NONE),
                Some(below) => {
                    let around = self.rings[below.ring as usize];
                    let winding = around.left - i32::from(!below.rightward);
                    let within = around.counter_clockwise == below.rightward;
                    (winding, if within { below.ring } else { around.parent })
                }
            };
            let counter_clockwise = low.rightward;
            let left = outside + i32::from(counter_clockwise);
            let nested = Nested { left, counter_clockwise, parent, first: v, ..self.rings[ring] };
            let border = if nested.is_border() { low.ring } else { self.border_at(parent) };
            self.rings[ring] = Nested { border, ..nested };
        }
        self.status.splice(at..at, [low, high]);
        Ok(())
    }

    fn border_at(&self, ring: u32) -> u32 {
        self.rings.get(ring as usize).map_or(NONE, |r| r.border)
    }

    /// Whether the edge below place `at` stays below a new one.
    fn fits_above(&self, at: usize, edge: &Edge) -> Result<(), Touch> {
        match at.checked_sub(1).and_then(|k| self.status.get(k)) {
            Some(below) if !below.stays_below(edge) => Err(Touch),
            _ => Ok(()),
        }
    }

    /// Whether the edge at place `at` is above a new one, and stays so.
    fn fits_below(&self, at: usize, edge: &Edge) -> Result<(), Touch> {
        match self.status.get(at) {
            Some(above) if above.below(edge.left) >= 0 || !edge.stays_below(above) => Err(Touch),
            _ => Ok(()),
        }
    }

    /// The borders, holes with the outer ring that they lie in.
    fn region(&self, rings: &[Ring]) -> Region {
        let mut borders: Vec<u32> = (0..rings.len() as u32).collect();
        borders.retain(|&r| self.rings[r as usize].is_border() && self.rings[r as usize].first != NONE);
        borders.sort_unstable_by_key(|&r| self.points[self.rings[r as usize].first as usize].at);
        let mut polygons: Vec<Polygon> = Vec::new();
        let mut polygon_of = vec![NONE; if borders.len() > 1 { rings.len() } else { 0 }];
        for &border in &borders {
            let nested = self.rings[border as usize];
            let begin = (nested.first - nested.from) as usize;
            let points = &rings[border as usize];
            let mut ring = Vec::with_capacity(points.len());
            ring.extend_from_slice(&points[begin..]);
            ring.extend_from_slice(&points[..begin]);
            if nested.counter_clockwise {
                if let Some(place) = polygon_of.get_mut(border as usize) {
                    *place = polygons.len() as u32;
                }
                polygons.push(Polygon { rings: vec![ring] });
            } else {
                // A hole's surroundings are solid, so that the nearest border around
                // is the outer ring of a polygon, which began farther left.
                let around = polygon_of[self.border_at(nested.parent) as usize];
                polygons[around as usize].rings.push(ring);
            }
        }
        Region { polygons }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::polygon::{self, Inside};
    use crate::layers::shape::twice_area;
    use proptest::prelude::*;

    fn ring(points: &[[i32; 2]]) -> Ring {
        points.iter().map(|&[x, y]| Point { x, y }).collect()
    }

    /// A square, counter-clockwise for a positive side, clockwise for a negative one.
    fn square(x: i32, y: i32, side: i32) -> Ring {
        let (s, w) = (side.abs(), side < 0);
        let mut ring = ring(&[[x, y], [x + s, y], [x + s, y + s], [x, y + s]]);
        if w {
            ring[1..].reverse();
        }
        ring
    }

    #[test]
    fn rings_nest_by_winding() {
        // Twice the area of each ring of each polygon.
        let check = |rings: &[Ring], expect: Option<&[&[i128]]>| {
            let found = Nester::default().nest(rings);
            let areas: Option<Vec<Vec<i128>>> = found.map(|r| {
                r.polygons.iter().map(|p| p.rings.iter().map(|r| twice_area(r)).collect()).collect()
            });
            let expect = expect.map(|e| e.iter().map(|p| p.to_vec()).collect());
            assert_eq!(areas, expect, "{rings:?}");
        };
        check(&[], Some(&[]));
        check(&[ring(&[[0, 0], [1, 1]])], Some(&[]));
        check(&[square(0, 0, 10)], Some(&[&[200]]));
        // A hole, whichever is given first; a body in a body; a body in a hole.
        check(&[square(0, 0, 10), square(1, 1, -5)], Some(&[&[200, -50]]));
        check(&[square(1, 1, -5), square(0, 0, 10)], Some(&[&[200, -50]]));
        check(&[square(1, 1, 5), square(0, 0, 10)], Some(&[&[200]]));
        check(&[square(0, 0, 10), square(1, 1, -8), square(2, 2, 5)], Some(&[&[200, -128], &[50]]));
        // What turns the wrong way is nothing outside, and undone by what is around it.
        check(&[square(0, 0, -10)], Some(&[]));
        check(&[square(0, 0, -10), square(1, 1, 5)], Some(&[]));
        check(&[square(0, 0, -10), square(1, 1, 8), square(2, 2, 5)], Some(&[&[50]]));
        // A cavity in a body in a body is filled; two cavities in each other are one.
        check(&[square(0, 0, 10), square(1, 1, 8), square(2, 2, -2)], Some(&[&[200]]));
        check(&[square(0, 0, 10), square(1, 1, -8), square(2, 2, -5)], Some(&[&[200, -128]]));
        check(&[square(0, 0, 10), square(1, 1, 8), square(2, 2, -5), square(3, 3, -2)], Some(&[&[200, -8]]));
        // Side by side; a hole finds its own.
        check(
            &[square(20, 0, 10), square(0, 0, 10), square(21, 1, -1), square(1, 5, -2)],
            Some(&[&[200, -8], &[200, -2]]),
        );
        // Touching at a corner, along a side, corner on side; crossing; twice the same; a spike.
        check(&[square(0, 0, 10), square(10, 10, 5)], None);
        check(&[square(0, 0, 10), square(10, 2, 5)], None);
        check(&[square(0, 0, 10), ring(&[[10, 5], [12, 3], [12, 8]])], None);
        check(&[square(0, 0, 10), square(5, 5, 10)], None);
        check(&[square(0, 0, 10), square(0, 0, 10)], None);
        check(&[ring(&[[0, 0], [10, 0], [20, 0], [10, 0], [0, 10]])], None);
        check(&[ring(&[[0, 0], [10, 10], [10, 0], [0, 10]])], None);
    }

    /// Whether two closed segments share a point, by signs of areas.
    fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
        let within = |a: Point, b: Point, p: Point| {
            side(a, b, p) == 0
                && (a.x.min(b.x)..=a.x.max(b.x)).contains(&p.x)
                && (a.y.min(b.y)..=a.y.max(b.y)).contains(&p.y)
        };
        side(a, b, c).signum() * side(a, b, d).signum() < 0
            && side(c, d, a).signum() * side(c, d, b).signum() < 0
            || within(a, b, c)
            || within(a, b, d)
            || within(c, d, a)
            || within(c, d, b)
    }

    /// Whether the way from `b` to `c` lies on the way from `a` to `b`, or is none.
    fn turns_back(a: Point, b: Point, c: Point) -> bool {
        side(a, b, c) == 0 && (b.x - a.x) * (c.x - b.x) + (b.y - a.y) * (c.y - b.y) <= 0
    }

    /// Every edge against every other: the slow way to know what the sweep claims.
    fn any_meet(rings: &[Ring]) -> bool {
        let mut edges = Vec::new();
        for ring in rings.iter().filter(|r| r.len() > 2) {
            let from = edges.len();
            for k in 0..ring.len() {
                edges.push(([ring[k], ring[(k + 1) % ring.len()]], from, k, ring.len()));
            }
        }
        let pair = |i: usize, j: usize| {
            let ((e, from, k, n), (f, other, l, _)) = (edges[i], edges[j]);
            let (next, previous) = (from == other && l == (k + 1) % n, from == other && k == (l + 1) % n);
            match (next, previous) {
                (true, _) => turns_back(e[0], e[1], f[1]),
                (_, true) => turns_back(f[0], f[1], e[1]),
                _ => meet(e, f),
            }
        };
        (0..edges.len()).any(|i| (0..i).any(|j| pair(i, j)))
    }

    fn same_region(a: &Region, b: &Region) -> bool {
        polygon::difference(a, b).is_empty() && polygon::difference(b, a).is_empty()
    }

    fn check(rings: &[Ring]) -> Result<bool, TestCaseError> {
        let found = Nester::default().nest(rings);
        prop_assert_eq!(found.is_none(), any_meet(rings));
        let Some(found) = found else { return Ok(false) };
        prop_assert!(same_region(&found, &polygon::resolve(rings, Inside::Positive)));
        for polygon in &found.polygons {
            prop_assert!(twice_area(&polygon.rings[0]) > 0);
            prop_assert!(polygon.rings[1..].iter().all(|r| twice_area(r) < 0));
        }
        // The order in which rings come, and where each begins, changes nothing.
        let mut turned = rings.to_vec();
        turned.reverse();
        turned.iter_mut().filter(|r| !r.is_empty()).for_each(|r| r.rotate_left(1));
        prop_assert_eq!(Nester::default().nest(&turned), Some(found));
        Ok(true)
    }

    /// Rings on a coarse grid, so that touching and vertical edges are the rule.
    fn coarse() -> impl Strategy<Value = Vec<Ring>> {
        let point = (0..12_i32, 0..12_i32).prop_map(|(x, y)| Point { x, y });
        prop::collection::vec(prop::collection::vec(point, 2..5), 1..4)
    }

    /// Stars and boxes, turning either way: many of these do not meet.
    fn stars() -> impl Strategy<Value = Vec<Ring>> {
        let star = (0..600_i32, 0..600_i32, 5..300_i32, 3..12_u32, any::<bool>()).prop_map(
            |(x, y, size, corners, turned)| {
                let at = |k: u32| {
                    let angle = std::f64::consts::TAU * f64::from(k) / f64::from(corners);
                    let radius = f64::from(size) * if k % 2 == 0 { 1.0 } else { 0.6 };
                    let point = |a: f64| (radius * a).round() as i32;
                    Point { x: x + point(angle.cos()), y: y + point(angle.sin()) }
                };
                let mut ring: Ring = (0..corners).map(at).collect();
                if turned {
                    ring.reverse();
                }
                ring
            },
        );
        prop::collection::vec(star, 1..9)
    }

    /// Small boxes and triangles far enough apart that many only just touch.
    fn boxes() -> impl Strategy<Value = Vec<Ring>> {
        let one = (0..16_i32, 0..16_i32, 1..5_i32, 1..5_i32, 0..4_u8).prop_map(|(x, y, w, h, kind)| {
            let mut ring = ring(&[[x, y], [x + w, y], [x + w, y + h], [x, y + h]]);
            if kind & 1 == 1 {
                ring.reverse();
            }
            ring.truncate(if kind & 2 == 2 { 3 } else { 4 });
            ring
        });
        prop::collection::vec(one, 1..5)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

        #[test]
        fn the_sweep_agrees_with_every_edge_against_every_other(rings in coarse()) {
            check(&rings)?;
        }

        #[test]
        fn touching_is_seen(rings in boxes()) {
            check(&rings)?;
        }

        #[test]
        fn nesting_agrees_with_the_boolean(rings in stars()) {
            check(&rings)?;
        }
    }

    #[test]
    fn the_largest_coordinates_are_compared_exactly() {
        let m = crate::layers::shape::MAX_COORDINATE;
        let big = ring(&[[-m, -m], [m, -m], [m, m], [-m, m]]);
        // A sliver along the diagonal, one step off it.
        let sliver = ring(&[[1 - m, -m + 2], [m - 2, m - 1], [-m + 1, 3 - m]]);
        let found = Nester::default().nest(&[big.clone(), sliver.iter().rev().copied().collect()]).unwrap();
        assert_eq!(found.polygons[0].rings.len(), 2);
        let on_it = ring(&[[-m, -m + 5], [m, m], [-m + 1, 9 - m]]);
        assert_eq!(Nester::default().nest(&[big, on_it]), None);
    }
}
