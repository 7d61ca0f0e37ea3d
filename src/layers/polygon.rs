//! Booleans, predicates and offsets of regions: the one place that names the
//! polygon libraries.
//!
//! Booleans and predicates are `i_overlay`'s on 32-bit integers, offsets are
//! Clipper's (`geo-clipper`): each gives the same bits on every machine. Inputs
//! lie within [`super::shape::MAX_COORDINATE`].
use super::outline::outline;
use super::shape::{Point, Polygon, Region, Ring, UNITS_PER_MM};
use geo_clipper::{ClipperInt, EndType, JoinType};
use geo_types::{Coord, LineString, MultiPolygon};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{IntOverlayOptions, Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::relate::PredicateOverlay;
use i_overlay::core::solver::Solver;
use i_overlay::i_float::int::point::IntPoint;

/// Which points are inside rings that overlap.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inside {
    /// Those wound around at all: bodies that overlap are one, whichever way they turn.
    NonZero,
    /// Those wound around counter-clockwise: what turns the wrong way is a hole or nothing.
    Positive,
    /// Those wound around an odd number of times.
    Odd,
}

impl Inside {
    fn rule(self) -> FillRule {
        match self {
            Inside::NonZero => FillRule::NonZero,
            Inside::Positive => FillRule::Positive,
            Inside::Odd => FillRule::EvenOdd,
        }
    }
}

fn path(ring: &[Point]) -> impl Iterator<Item = IntPoint<i32>> {
    ring.iter().map(|p| IntPoint::new(p.x, p.y))
}

fn region(shapes: Vec<Vec<Vec<IntPoint<i32>>>>) -> Region {
    let ring = |c: Vec<IntPoint<i32>>| c.into_iter().map(|p| Point { x: p.x, y: p.y }).collect();
    shapes.into_iter().map(|s| Polygon { rings: s.into_iter().map(ring).collect() }).collect()
}

/// The region that rings of any kind enclose: crossing, overlapping, wound either way.
#[must_use]
pub fn resolve<'a>(rings: impl IntoIterator<Item = &'a Ring>, inside: Inside) -> Region {
    let mut overlay = Overlay::<i32>::new(256);
    for ring in rings {
        overlay.add_path_iter(path(ring), ShapeType::Subject);
    }
    region(overlay.overlay(OverlayRule::Subject, inside.rule()))
}

fn boolean(a: &Region, b: &Region, rule: OverlayRule) -> Region {
    let mut overlay = Overlay::<i32>::new(a.len() + b.len());
    a.rings().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Subject));
    b.rings().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Clip));
    region(overlay.overlay(rule, FillRule::EvenOdd))
}

/// What is in either.
#[must_use]
pub fn union(a: &Region, b: &Region) -> Region {
    boolean(a, b, OverlayRule::Union)
}

/// What is in both.
#[must_use]
pub fn intersection(a: &Region, b: &Region) -> Region {
    boolean(a, b, OverlayRule::Intersect)
}

/// What is in `a` and not in `b`.
#[must_use]
pub fn difference(a: &Region, b: &Region) -> Region {
    boolean(a, b, OverlayRule::Difference)
}

/// What rings enclose and others do not: `from` and `cut` may each overlap themselves,
/// what is wound around at all counts as inside.
#[must_use]
pub fn without<'a>(
    from: impl IntoIterator<Item = &'a Ring>,
    cut: impl IntoIterator<Item = &'a Ring>,
) -> Region {
    winding(from, cut, OverlayRule::Difference)
}

/// What both sets of rings enclose, each taken as in [`without`].
#[must_use]
pub fn within<'a>(a: impl IntoIterator<Item = &'a Ring>, b: impl IntoIterator<Item = &'a Ring>) -> Region {
    winding(a, b, OverlayRule::Intersect)
}

fn winding<'a>(
    a: impl IntoIterator<Item = &'a Ring>,
    b: impl IntoIterator<Item = &'a Ring>,
    rule: OverlayRule,
) -> Region {
    let mut overlay = Overlay::<i32>::new(256);
    a.into_iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Subject));
    b.into_iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Clip));
    region(overlay.overlay(rule, FillRule::NonZero))
}

/// Whether the interiors share a point; touching along an edge or in a point is not enough.
#[must_use]
pub fn overlaps(a: &Polygon, b: &Polygon) -> bool {
    let mut overlay = PredicateOverlay::<i32>::new(a.len() + b.len());
    a.rings.iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Subject));
    b.rings.iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Clip));
    overlay.interiors_intersect()
}

/// Greatest distance between an arc that Clipper draws and its chords, mm.
const ARC_TOLERANCE_MM: f64 = 0.002;

fn closed_line(ring: &[Point]) -> LineString<i64> {
    let coord = |p: &Point| Coord { x: i64::from(p.x), y: i64::from(p.y) };
    LineString(ring.iter().chain(ring.first()).map(coord).collect())
}

fn from_clipper(found: MultiPolygon<i64>) -> Region {
    let ring = |l: LineString<i64>| -> Ring {
        let mut ring: Ring = l.0.into_iter().map(|c| Point { x: c.x as i32, y: c.y as i32 }).collect();
        if ring.len() > 1 && ring.first() == ring.last() {
            ring.pop();
        }
        ring
    };
    let rings: Vec<Ring> = found
        .into_iter()
        .flat_map(|p| {
            let (outer, holes) = p.into_inner();
            std::iter::once(outer).chain(holes).map(ring).collect::<Vec<_>>()
        })
        .collect();
    resolve(&rings, Inside::Odd)
}

/// Everything within a distance of the region (negative: what is farther than it from the outside).
/// Corners become arcs that differ from circles by at most 2 µm.
#[must_use]
pub fn grow(a: &Region, distance_mm: f64) -> Region {
    let polygon = |p: &Polygon| {
        let mut rings = p.rings.iter().map(|r| closed_line(r));
        geo_types::Polygon::new(rings.next().unwrap_or_else(|| LineString(Vec::new())), rings.collect())
    };
    let all = MultiPolygon(a.polygons.iter().map(polygon).collect());
    let join = JoinType::Round(ARC_TOLERANCE_MM * UNITS_PER_MM);
    from_clipper(ClipperInt::offset(&all, distance_mm * UNITS_PER_MM, join, EndType::ClosedPolygon))
}

/// Everything within a distance of open paths: what a round nozzle of twice that width sweeps.
/// Round ends and corners differ from circles by at most 2 µm.
#[must_use]
pub fn stroke(paths: &[Vec<Point>], distance_mm: f64) -> Region {
    let paths = paths.iter().map(|path| (path.as_slice(), distance_mm));
    sweep(paths, ARC_TOLERANCE_MM)
}

/// What round nozzles sweep along open paths, each with its own radius in mm, united.
/// Round ends and corners differ from circles by at most the tolerance, mm.
#[must_use]
pub fn sweep<'a>(paths: impl IntoIterator<Item = (&'a [Point], f64)>, tolerance_mm: f64) -> Region {
    // Beads lie side by side, many at one height: the solver that cuts edges to pieces
    // is a quarter faster on them than the one that is chosen by their number.
    let mut overlay = Overlay::<i32>::new_custom(1024, IntOverlayOptions::default(), Solver::FRAG);
    for (points, radius_mm) in paths {
        if let Some(ring) = outline(points, radius_mm * UNITS_PER_MM, tolerance_mm * UNITS_PER_MM) {
            overlay.add_path_iter(path(&ring), ShapeType::Subject);
        }
    }
    region(overlay.overlay(OverlayRule::Subject, FillRule::NonZero))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(x: f64, y: f64, side: f64) -> Region {
        let corner = |dx: f64, dy: f64| Point::from_mm(x + dx, y + dy);
        let ring = vec![corner(0.0, 0.0), corner(side, 0.0), corner(side, side), corner(0.0, side)];
        Region { polygons: vec![Polygon { rings: vec![ring] }] }
    }

    #[test]
    fn booleans_have_the_areas_they_should() {
        let (a, b) = (square(0.0, 0.0, 2.0), square(1.0, 1.0, 2.0));
        let check = |found: Region, area: f64, polygons: usize| {
            assert!((found.area_mm2() - area).abs() < 1e-6, "{found:?}");
            assert_eq!(found.polygons.len(), polygons);
        };
        check(union(&a, &b), 7.0, 1);
        check(intersection(&a, &b), 1.0, 1);
        check(difference(&a, &b), 3.0, 1);
        check(union(&a, &square(2.0, 2.0, 1.0)), 5.0, 2);
        check(resolve(a.rings().chain(b.rings()), Inside::NonZero), 7.0, 1);
        check(resolve(a.rings().chain(b.rings()), Inside::Odd), 6.0, 2);
    }

    #[test]
    fn touching_is_not_overlapping() {
        let a = square(0.0, 0.0, 2.0);
        let check = |b: Region, expect: bool| {
            assert_eq!(overlaps(&a.polygons[0], &b.polygons[0]), expect, "{b:?}");
        };
        check(square(2.0, 0.0, 1.0), false);
        check(square(2.0, 2.0, 1.0), false);
        check(square(1.9999, 1.9999, 1.0), true);
        check(square(0.5, 0.5, 1.0), true);
        check(square(-1.0, -1.0, 9.0), true);
        check(a.clone(), true);
    }

    #[test]
    fn offsets_are_discs_and_strips() {
        let area = |r: &Region| r.area_mm2();
        let pi = std::f64::consts::PI;
        assert!((area(&grow(&square(0.0, 0.0, 2.0), 1.0)) - (4.0 + 8.0 + pi)).abs() < 0.02);
        assert!((area(&grow(&square(0.0, 0.0, 2.0), -0.5)) - 1.0).abs() < 1e-6);
        let path = vec![Point::from_mm(0.0, 0.0), Point::from_mm(3.0, 0.0)];
        assert!((area(&stroke(&[path], 0.5)) - (3.0 + pi / 4.0)).abs() < 0.02);
    }
}
