//! Points on a grid, polygons with holes, and their measures.
//!
//! Coordinates are whole tenths of a micrometre ([`UNITS_PER_MM`]): predicates on
//! them are exact, results are the same on every machine. Knows no polygon library.

/// Grid steps in a millimetre.
pub const UNITS_PER_MM: f64 = 10_000.0;

/// Coordinates lie within ±this (about 53 m): differences, and products of
/// differences, then have room in `i64`, and the polygon libraries' limits hold.
pub const MAX_COORDINATE: i32 = (1 << 29) - 1;

/// A point of the grid.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Point {
    /// Grid steps to the right.
    pub x: i32,
    /// Grid steps to the back.
    pub y: i32,
}

/// A closed curve; the last point joins the first.
pub type Ring = Vec<Point>;

/// A ring's edges, the one from its last point to its first included.
pub(crate) fn ring_edges(ring: &[Point]) -> impl Iterator<Item = [Point; 2]> + Clone {
    ring.iter().zip(ring.iter().cycle().skip(1)).map(|(a, b)| [*a, *b])
}

/// A connected piece: one outer ring, counter-clockwise, and its holes, clockwise.
///
/// Rings are simple. Two rings of a polygon may touch in points, never along an edge.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Polygon {
    /// The outer ring first, then the holes.
    pub rings: Vec<Ring>,
}

/// Polygons whose interiors do not meet; two of them may touch in points.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Region {
    /// In no particular order.
    pub polygons: Vec<Polygon>,
}

/// An axis-parallel rectangle, borders included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Bounds {
    /// Lowest x and y.
    pub min: Point,
    /// Highest x and y.
    pub max: Point,
}

impl Point {
    /// The nearest point of the grid, for millimetres within its range.
    #[must_use]
    pub fn from_mm(x: f64, y: f64) -> Point {
        Point { x: (x * UNITS_PER_MM).round() as i32, y: (y * UNITS_PER_MM).round() as i32 }
    }

    /// Millimetres.
    #[must_use]
    pub fn mm(self) -> [f64; 2] {
        [f64::from(self.x) / UNITS_PER_MM, f64::from(self.y) / UNITS_PER_MM]
    }
}

impl Bounds {
    /// Nothing: the bounds of no point.
    pub const EMPTY: Bounds =
        Bounds { min: Point { x: i32::MAX, y: i32::MAX }, max: Point { x: i32::MIN, y: i32::MIN } };

    /// The smallest bounds of some points.
    #[must_use]
    pub fn of(points: &[Point]) -> Bounds {
        points.iter().fold(Bounds::EMPTY, |b, &p| b.with(p))
    }

    /// Grown to hold a point.
    #[must_use]
    pub fn with(self, p: Point) -> Bounds {
        Bounds {
            min: Point { x: self.min.x.min(p.x), y: self.min.y.min(p.y) },
            max: Point { x: self.max.x.max(p.x), y: self.max.y.max(p.y) },
        }
    }

    /// Grown to hold another.
    #[must_use]
    pub fn joined(self, other: Bounds) -> Bounds {
        Bounds {
            min: Point { x: self.min.x.min(other.min.x), y: self.min.y.min(other.min.y) },
            max: Point { x: self.max.x.max(other.max.x), y: self.max.y.max(other.max.y) },
        }
    }

    /// Whether they share more than a border.
    #[must_use]
    pub fn overlap(self, other: Bounds) -> bool {
        self.min.x < other.max.x
            && other.min.x < self.max.x
            && self.min.y < other.max.y
            && other.min.y < self.max.y
    }

    /// Whether they share a point, if only of their borders.
    #[must_use]
    pub fn touch(self, other: Bounds) -> bool {
        self.min.x <= other.max.x
            && other.min.x <= self.max.x
            && self.min.y <= other.max.y
            && other.min.y <= self.max.y
    }

    /// `[[min x, min y], [max x, max y]]`, mm.
    #[must_use]
    pub fn mm(self) -> [[f64; 2]; 2] {
        [self.min.mm(), self.max.mm()]
    }
}

/// Where a point lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// Strictly inside.
    Inside,
    /// On a ring.
    Border,
    /// Strictly outside, in a hole perhaps.
    Outside,
}

/// Where a point lies by the even-odd rule of some rings. Exact; takes time in
/// proportion to the number of vertices.
fn place<'a>(p: Point, rings: impl IntoIterator<Item = &'a Ring>) -> Place {
    let mut within = false;
    for ring in rings {
        let Some(&last) = ring.last() else { continue };
        let mut a = last;
        for &b in ring {
            if (a.y > p.y) != (b.y > p.y) {
                let (low, high) = if a.y < b.y { (a, b) } else { (b, a) };
                let along = |q: Point| (i64::from(q.x) - i64::from(low.x), i64::from(q.y) - i64::from(low.y));
                let ((hx, hy), (px, py)) = (along(high), along(p));
                match (hx * py - hy * px).cmp(&0) {
                    std::cmp::Ordering::Greater => within = !within,
                    std::cmp::Ordering::Equal => return Place::Border,
                    std::cmp::Ordering::Less => {}
                }
            } else if b == p || a.y == p.y && b.y == p.y && (a.x.min(b.x)..=a.x.max(b.x)).contains(&p.x) {
                return Place::Border;
            }
            a = b;
        }
    }
    if within { Place::Inside } else { Place::Outside }
}

/// Length of a ring's border, grid steps.
#[must_use]
pub fn ring_length(ring: &[Point]) -> f64 {
    ring_edges(ring)
        .map(|[a, b]| (f64::from(b.x) - f64::from(a.x)).hypot(f64::from(b.y) - f64::from(a.y)))
        .sum()
}

/// Twice the signed area of a ring in grid steps squared; positive when counter-clockwise.
#[must_use]
pub fn twice_area(ring: &[Point]) -> i128 {
    let Some(&origin) = ring.first() else { return 0 };
    let mut sum = 0_i128;
    let mut at = ring[ring.len() - 1];
    for &p in ring {
        let (ax, ay) = (i64::from(at.x) - i64::from(origin.x), i64::from(at.y) - i64::from(origin.y));
        let (bx, by) = (i64::from(p.x) - i64::from(origin.x), i64::from(p.y) - i64::from(origin.y));
        sum += i128::from(ax * by - ay * bx);
        at = p;
    }
    sum
}

impl Polygon {
    /// Area, mm².
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        self.rings.iter().map(|r| twice_area(r)).sum::<i128>() as f64 / 2.0 / (UNITS_PER_MM * UNITS_PER_MM)
    }

    /// Bounds of the outer ring.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.rings.first().map_or(Bounds::EMPTY, |r| Bounds::of(r))
    }

    /// Where a point lies, exactly.
    #[must_use]
    pub fn place(&self, p: Point) -> Place {
        place(p, &self.rings)
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rings.iter().map(Vec::len).sum()
    }

    /// Whether it has no vertex.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// First moments: area in mm², and area times centroid in mm³.
    fn moments(&self) -> (f64, [f64; 2]) {
        let Some(origin) = self.rings.first().and_then(|r| r.first()).map(|p| p.mm()) else {
            return (0.0, [0.0; 2]);
        };
        let (mut area, mut mx, mut my) = (0.0, 0.0, 0.0);
        for ring in &self.rings {
            let Some(last) = ring.last() else { continue };
            let local = |p: &Point| [p.mm()[0] - origin[0], p.mm()[1] - origin[1]];
            let mut a = local(last);
            for p in ring {
                let b = local(p);
                let cross = a[0] * b[1] - a[1] * b[0];
                area += cross / 2.0;
                mx += (a[0] + b[0]) * cross / 6.0;
                my += (a[1] + b[1]) * cross / 6.0;
                a = b;
            }
        }
        (area, [mx + origin[0] * area, my + origin[1] * area])
    }

    /// Centroid, mm; the middle of the bounds where there is no area.
    #[must_use]
    pub fn centroid_mm(&self) -> [f64; 2] {
        let (area, moment) = self.moments();
        if area > 0.0 {
            return [moment[0] / area, moment[1] / area];
        }
        let [min, max] = self.bounds().mm();
        [(min[0] + max[0]) / 2.0, (min[1] + max[1]) / 2.0]
    }
}

impl Region {
    /// Area, mm².
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        self.polygons.iter().map(Polygon::area_mm2).sum()
    }

    /// Bounds of all.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.polygons.iter().fold(Bounds::EMPTY, |b, p| b.joined(p.bounds()))
    }

    /// Number of vertices.
    #[must_use]
    pub fn len(&self) -> usize {
        self.polygons.iter().map(Polygon::len).sum()
    }

    /// Whether it holds no polygon.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.polygons.is_empty()
    }

    /// Where a point lies, exactly.
    #[must_use]
    pub fn place(&self, p: Point) -> Place {
        place(p, self.rings())
    }

    /// All rings.
    pub fn rings(&self) -> impl Iterator<Item = &Ring> {
        self.polygons.iter().flat_map(|p| p.rings.iter())
    }
}

impl FromIterator<Polygon> for Region {
    fn from_iter<I: IntoIterator<Item = Polygon>>(polygons: I) -> Region {
        Region { polygons: polygons.into_iter().collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A counter-clockwise rectangle, mm.
    fn rectangle(x: [f64; 2], y: [f64; 2]) -> Ring {
        [(x[0], y[0]), (x[1], y[0]), (x[1], y[1]), (x[0], y[1])].map(|(x, y)| Point::from_mm(x, y)).to_vec()
    }

    #[test]
    fn a_square_with_a_hole_is_measured() {
        let mut hole = rectangle([1.0, 2.0], [1.0, 2.0]);
        hole.reverse();
        let square = Polygon { rings: vec![rectangle([0.0, 4.0], [0.0, 4.0]), hole] };
        assert!((square.area_mm2() - 15.0).abs() < 1e-12);
        let centre = (4.0 * 4.0 * 2.0 - 1.5) / 15.0;
        for k in 0..2 {
            assert!((square.centroid_mm()[k] - centre).abs() < 1e-9);
        }
        assert_eq!(square.bounds().mm(), [[0.0, 0.0], [4.0, 4.0]]);
    }

    #[test]
    fn the_largest_rings_are_measured_exactly() {
        let m = MAX_COORDINATE;
        let ring =
            [Point { x: -m, y: -m }, Point { x: m, y: -m }, Point { x: m, y: m }, Point { x: -m, y: m }];
        assert_eq!(twice_area(&ring), 8 * i128::from(m) * i128::from(m));
    }

    #[test]
    fn points_are_placed_exactly() {
        let mut hole = rectangle([1.0, 3.0], [1.0, 3.0]);
        hole.reverse();
        let polygon = Polygon { rings: vec![rectangle([0.0, 4.0], [0.0, 4.0]), hole] };
        let check = |x: f64, y: f64, expect: Place| {
            assert_eq!(polygon.place(Point::from_mm(x, y)), expect, "{x} {y}");
        };
        check(0.5, 0.5, Place::Inside);
        check(0.5, 1.0, Place::Inside);
        check(2.0, 2.0, Place::Outside);
        check(-1.0, 1.0, Place::Outside);
        check(5.0, 0.0, Place::Outside);
        for (x, y) in [(0.0, 0.0), (4.0, 4.0), (2.0, 0.0), (0.0, 3.0), (1.0, 1.0), (3.0, 2.0), (2.0, 3.0)] {
            check(x, y, Place::Border);
        }
        // One step beside a long slanting edge, and on it.
        let m = MAX_COORDINATE;
        let edge = vec![Point { x: -m, y: -m }, Point { x: m, y: m - 1 }, Point { x: -m, y: m }];
        let edge = Polygon { rings: vec![edge] };
        assert_eq!(edge.place(Point { x: 1 - m, y: 1 - m }), Place::Inside);
        assert_eq!(edge.place(Point { x: 0, y: -1 }), Place::Outside);
        assert_eq!(edge.place(Point { x: 0, y: 0 }), Place::Inside);
        assert_eq!(edge.place(Point { x: -m, y: 7 }), Place::Border);
    }
}
