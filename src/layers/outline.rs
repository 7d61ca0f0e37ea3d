//! The outline of what a round nozzle sweeps along a path.
//!
//! Takes a path of grid points and a radius, gives one ring that winds around
//! every point within the radius at least once, counter-clockwise; where the
//! path comes near itself the ring crosses itself, so rings are resolved by
//! non-zero winding. Uses no function but square roots: the same bits on every
//! machine. Knows no polygon library.
use super::shape::{Point, Ring};

type Vector = [f64; 2];

/// Halvings of a half circle at most: 1024 chords of it.
const MAX_HALVINGS: u32 = 10;

/// One ring around everything within `radius` of the path (a point alone gives a
/// disc), in grid steps. Its round ends and corners differ from true ones by at
/// most `tolerance` and two grid steps; the path with the radius lies within
/// [`super::shape::MAX_COORDINATE`]. `None` for no point.
///
/// The ring is the sum of a rectangle a segment, a wedge a corner and a half disc
/// an end, all counter-clockwise: on the inner side of a corner it goes through
/// the path's own point, so that short segments with sharp corners never cancel
/// each other. Corners so flat that a mitre is within the tolerance, between
/// segments long enough for it, take one point a side.
#[must_use]
pub fn outline(path: &[Point], radius: f64, tolerance: f64) -> Option<Ring> {
    let mut points: Vec<Vector> = Vec::with_capacity(path.len());
    let mut last = None;
    for &p in path {
        if last != Some(p) {
            points.push([f64::from(p.x), f64::from(p.y)]);
            last = Some(p);
        }
    }
    let mut pen = Pen { radius, tolerance, ring: Ring::with_capacity(4 * points.len() + 20) };
    match points.as_slice() {
        [] => return None,
        [only] => {
            pen.arc(*only, [1.0, 0.0], [-1.0, 0.0], MAX_HALVINGS);
            pen.arc(*only, [-1.0, 0.0], [1.0, 0.0], MAX_HALVINGS);
        }
        _ => {
            let mut legs: Vec<Leg> = points.windows(2).map(|ends| Leg::new(ends[0], ends[1])).collect();
            pen.side(&points, &legs);
            points.reverse();
            legs.reverse();
            legs.iter_mut().for_each(|leg| leg.way = [-leg.way[0], -leg.way[1]]);
            pen.side(&points, &legs);
        }
    }
    Some(pen.ring)
}

/// A segment: its direction (a unit vector) and length.
struct Leg {
    way: Vector,
    length: f64,
}

impl Leg {
    fn new(a: Vector, b: Vector) -> Leg {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let length = (dx * dx + dy * dy).sqrt();
        Leg { way: [dx / length, dy / length], length }
    }

    /// The unit vector to the right.
    fn right(&self) -> Vector {
        [self.way[1], -self.way[0]]
    }
}

struct Pen {
    radius: f64,
    tolerance: f64,
    ring: Ring,
}

impl Pen {
    /// The point at a unit vector times a length from another.
    fn put(&mut self, from: Vector, way: Vector, length: f64) {
        let at = |k: usize| (from[k] + way[k] * length).round() as i32;
        self.ring.push(Point { x: at(0), y: at(1) });
    }

    /// Along the right of a path, and around its end.
    fn side(&mut self, points: &[Vector], legs: &[Leg]) {
        for (k, pair) in legs.windows(2).enumerate() {
            self.corner(points[k + 1], &pair[0], &pair[1]);
        }
        if let (Some(&end), Some(leg)) = (points.last(), legs.last()) {
            let right = leg.right();
            self.arc(end, right, [-right[0], -right[1]], MAX_HALVINGS);
        }
    }

    fn corner(&mut self, p: Vector, a: &Leg, b: &Leg) {
        let cross = a.way[0] * b.way[1] - a.way[1] * b.way[0];
        let dot = a.way[0] * b.way[0] + a.way[1] * b.way[1];
        let (u, v) = (a.right(), b.right());
        // Half the turn: its cosine, and its tangent times 1 + dot.
        let cosine = ((1.0 + dot) / 2.0).max(0.0).sqrt();
        let flat = self.radius * (1.0 - cosine) <= self.tolerance * cosine;
        if flat && 2.0 * self.radius * cross.abs() <= a.length.min(b.length) * (1.0 + dot) {
            self.put(p, [u[0] + v[0], u[1] + v[1]], self.radius / (1.0 + dot));
        } else if cross >= 0.0 {
            self.arc(p, u, v, MAX_HALVINGS);
        } else {
            self.put(p, u, self.radius);
            self.put(p, [0.0, 0.0], 0.0);
            self.put(p, v, self.radius);
        }
    }

    /// The arc from one unit vector to another, at most half a turn to the left, both ends included.
    fn arc(&mut self, p: Vector, u: Vector, v: Vector, halvings: u32) {
        self.put(p, u, self.radius);
        self.within(p, u, v, halvings);
        self.put(p, v, self.radius);
    }

    fn within(&mut self, p: Vector, u: Vector, v: Vector, halvings: u32) {
        let dot = u[0] * v[0] + u[1] * v[1];
        let cosine = ((1.0 + dot) / 2.0).max(0.0).sqrt();
        if halvings == 0 || self.radius * (1.0 - cosine) <= self.tolerance {
            return;
        }
        // The chord turned to the right: opposite vectors have a middle too.
        let middle = [v[1] - u[1], u[0] - v[0]];
        let length = (middle[0] * middle[0] + middle[1] * middle[1]).sqrt();
        let middle = [middle[0] / length, middle[1] / length];
        self.within(p, u, middle, halvings - 1);
        self.put(p, middle, self.radius);
        self.within(p, middle, v, halvings - 1);
    }
}

#[cfg(test)]
mod tests {
    use super::super::shape::{MAX_COORDINATE, twice_area};
    use super::*;
    use proptest::prelude::*;

    fn point() -> impl Strategy<Value = Point> {
        (-40i32..40, -40i32..40).prop_map(|(x, y)| Point { x: x * 50, y: y * 50 })
    }

    fn distance_to(p: Vector, a: Point, b: Point) -> f64 {
        let (a, b) = ([f64::from(a.x), f64::from(a.y)], [f64::from(b.x), f64::from(b.y)]);
        let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
        let squared = d[0] * d[0] + d[1] * d[1];
        let t = if squared > 0.0 { ((d[0] * e[0] + d[1] * e[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
        (e[0] - t * d[0]).hypot(e[1] - t * d[1])
    }

    /// How often the ring winds around a point that lies on none of its edges.
    fn winding(ring: &[Point], p: Vector) -> i32 {
        let mut turns = 0;
        for (k, b) in ring.iter().enumerate() {
            let a = ring[(k + ring.len() - 1) % ring.len()];
            let (a, b) = ([f64::from(a.x), f64::from(a.y)], [f64::from(b.x), f64::from(b.y)]);
            if (a[1] <= p[1]) != (b[1] <= p[1]) {
                let x = a[0] + (p[1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0]);
                turns += if x > p[0] { if b[1] > a[1] { 1 } else { -1 } } else { 0 };
            }
        }
        turns
    }

    #[test]
    fn discs_and_capsules_have_their_area() {
        let check = |path: &[(i32, i32)], expect: f64| {
            let path: Vec<Point> = path.iter().map(|&(x, y)| Point { x, y }).collect();
            let ring = outline(&path, 1000.0, 1.0).unwrap();
            let area = twice_area(&ring) as f64 / 2.0;
            assert!((area / expect - 1.0).abs() < 2e-3, "{path:?}: {area} {expect}");
        };
        let disc = std::f64::consts::PI * 1e6;
        check(&[(5, 5)], disc);
        check(&[(5, 5), (5, 5)], disc);
        check(&[(0, 0), (3000, 4000)], disc + 1e7);
        check(&[(0, 0), (3000, 4000), (6000, 8000)], disc + 2e7);
        // The inner side of a corner counts twice what both rectangles cover.
        check(&[(0, 0), (9000, 0), (9000, 9000)], 1.25 * disc + 3.6e7);
        // There and back: a disc at the near end, a whole one at the far end.
        check(&[(0, 0), (9000, 0), (0, 0)], 2.0 * disc + 3.6e7);
        assert_eq!(outline(&[], 1000.0, 1.0), None);
    }

    #[test]
    fn a_mitre_spares_points_only_where_it_is_true() {
        let corners = |y: i32| {
            outline(&[Point { x: 0, y: 0 }, Point { x: 9000, y: 0 }, Point { x: 18000, y }], 1000.0, 100.0)
                .unwrap()
                .len()
        };
        assert_eq!(corners(0), corners(3000));
        assert!(corners(3000) < corners(18000));
        let far = Point { x: MAX_COORDINATE - 9000, y: 0 };
        assert!(outline(&[far, Point { x: -far.x, y: 1 }], 9000.0, 20.0).is_some());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn winds_around_what_is_near_and_nothing_else(
            path in proptest::collection::vec(point(), 1..12),
            probes in proptest::collection::vec(point(), 60),
            radius in 200.0f64..1500.0,
        ) {
            let tolerance = 30.0;
            let ring = outline(&path, radius, tolerance).unwrap();
            for probe in probes {
                let p = [f64::from(probe.x) + 0.37, f64::from(probe.y) + 0.29];
                let legs = path.windows(2).map(|e| distance_to(p, e[0], e[1]));
                let gap = legs.fold(distance_to(p, path[0], path[0]), f64::min);
                let turns = winding(&ring, p);
                prop_assert!(turns >= 0, "{probe:?}: {turns}");
                if gap < radius - tolerance - 3.0 {
                    prop_assert!(turns > 0, "{probe:?} at {gap} of {radius}");
                }
                if gap > radius + tolerance + 3.0 {
                    prop_assert!(turns == 0, "{probe:?} at {gap} of {radius}");
                }
            }
        }
    }
}
