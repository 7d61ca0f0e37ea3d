//! Booleans, predicates and offsets of regions: the one place that names the
//! polygon libraries.
//!
//! Takes regions and rings, gives regions and answers. Booleans and predicates are
//! `i_overlay`'s on 32-bit integers, offsets are Clipper's (`geo-clipper`): each gives
//! the same bits on every machine. Inputs lie within [`super::shape::MAX_COORDINATE`].
//! Knows no layer.
//!
//! Where edges cross off the grid the crossing is rounded to it, and edges nearer than
//! about one grid step may be drawn together. What touches is otherwise exact.
use super::outline::outline;
use super::shape::{Bounds, Point, Polygon, Region, Ring, UNITS_PER_MM};
use geo_clipper::{ClipperInt, EndType, JoinType};
use geo_types::{Coord, LineString, MultiPolygon};
use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{IntOverlayOptions, Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::core::relate::PredicateOverlay;
use i_overlay::core::solver::Solver;
use i_overlay::i_float::int::point::IntPoint;
use rustc_hash::FxBuildHasher;
use std::collections::HashSet;

/// Most pairs of bounds that a boolean looks at before it begins.
const MAX_BOUNDS_PAIRS: usize = 4096;

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

/// A boolean of rings; pieces that meet only in points come apart, so that every ring
/// is simple and every polygon hangs together.
fn overlay<'a>(
    subject: impl IntoIterator<Item = &'a Ring>,
    clip: impl IntoIterator<Item = &'a Ring>,
    rule: OverlayRule,
    inside: Inside,
) -> Region {
    let mut overlay = Overlay::<i32>::new_custom(256, IntOverlayOptions::ogc(), Default::default());
    subject.into_iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Subject));
    clip.into_iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Clip));
    region(overlay.overlay(rule, inside.rule()))
}

/// The region that rings of any kind enclose: crossing, overlapping, wound either way.
#[must_use]
pub fn resolve<'a>(rings: impl IntoIterator<Item = &'a Ring>, inside: Inside) -> Region {
    overlay(rings, [], OverlayRule::Subject, inside)
}

/// A boolean of regions. Polygons whose bounds meet nothing of the other region, and
/// those that both regions hold point for point, are spared it: what remains of them
/// is known.
fn boolean<'a>(a: &'a Region, b: &'a Region, rule: OverlayRule) -> Region {
    let (a_alone, a_rest) = split(a, b);
    let (b_alone, b_rest) = split(b, a);
    let in_b: Polygons = b_rest.iter().copied().collect();
    let (both, a_rest): (Vec<_>, Vec<_>) = a_rest.into_iter().partition(|p| in_b.contains(p));
    let in_both: Polygons = both.iter().copied().collect();
    let b_rest = b_rest.into_iter().filter(|p| !in_both.contains(p));
    let rings = |p: &'a Polygon| p.rings.iter();
    let mut found = overlay(a_rest.into_iter().flat_map(rings), b_rest.flat_map(rings), rule, Inside::Odd);
    let (keep_a, keep_b, keep_both) = match rule {
        OverlayRule::Union => (true, true, true),
        OverlayRule::Intersect => (false, false, true),
        _ => (true, false, false),
    };
    let kept = [(keep_a, a_alone), (keep_b, b_alone), (keep_both, both)];
    found.polygons.extend(kept.into_iter().filter(|k| k.0).flat_map(|k| k.1).cloned());
    found
}

type Polygons<'a> = HashSet<&'a Polygon, FxBuildHasher>;

/// Polygons of `a` whose bounds share no point with those of any polygon of `b`, and the others.
fn split<'a>(a: &'a Region, b: &Region) -> (Vec<&'a Polygon>, Vec<&'a Polygon>) {
    let all = b.bounds();
    // One by one only where that is cheap: the rest is for the boolean to find out.
    let each = a.polygons.len() * b.polygons.len() <= MAX_BOUNDS_PAIRS;
    let others: Vec<Bounds> = if each { b.polygons.iter().map(Polygon::bounds).collect() } else { vec![all] };
    a.polygons.iter().partition(|p| {
        let own = p.bounds();
        !own.touch(all) || !others.iter().any(|o| own.touch(*o))
    })
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
    overlay(from, cut, OverlayRule::Difference, Inside::NonZero)
}

/// What both sets of rings enclose, each taken as in [`without`].
#[must_use]
pub fn within<'a>(a: impl IntoIterator<Item = &'a Ring>, b: impl IntoIterator<Item = &'a Ring>) -> Region {
    overlay(a, b, OverlayRule::Intersect, Inside::NonZero)
}

/// Everything in any of the regions, which may overlap.
#[must_use]
pub fn union_all<'a>(regions: impl IntoIterator<Item = &'a Region>) -> Region {
    let rings: Vec<&Ring> = regions.into_iter().flat_map(Region::rings).collect();
    resolve(rings, Inside::Positive)
}

/// Whether the interiors share a point; touching along an edge or in a point is not
/// enough. An overlap no wider than a grid step may be missed.
#[must_use]
pub fn overlaps(a: &Polygon, b: &Polygon) -> bool {
    overlaps_any(a, [b])
}

/// Whether the interior of `a` shares a point with that of any of the others, which do
/// not overlap each other; as [`overlaps`] does it.
#[must_use]
pub fn overlaps_any<'a>(a: &Polygon, others: impl IntoIterator<Item = &'a Polygon>) -> bool {
    let bounds = a.bounds();
    let near: Vec<&Polygon> = others.into_iter().filter(|o| o.bounds().overlap(bounds)).collect();
    if near.is_empty() {
        return false;
    }
    let mut overlay = PredicateOverlay::<i32>::new(a.len() + near.iter().map(|o| o.len()).sum::<usize>());
    a.rings.iter().for_each(|r| overlay.add_path_iter(path(r), ShapeType::Subject));
    near.iter().flat_map(|o| &o.rings).for_each(|r| overlay.add_path_iter(path(r), ShapeType::Clip));
    overlay.interiors_intersect()
}

/// Greatest distance between an arc and its chords, mm.
const ARC_TOLERANCE_MM: f64 = 0.002;

fn closed_line(ring: &Ring) -> LineString<i64> {
    let coord = |p: &Point| Coord { x: i64::from(p.x), y: i64::from(p.y) };
    ring.iter().chain(ring.first()).map(coord).collect()
}

fn open_ring(line: LineString<i64>) -> Ring {
    let mut ring: Ring = line.0.into_iter().map(|c| Point { x: c.x as i32, y: c.y as i32 }).collect();
    if ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    ring
}

/// Everything within a distance of the region (negative: what is farther than it from the outside).
/// Corners become arcs that differ from circles by at most 2 µm.
#[must_use]
pub fn grow(a: &Region, distance_mm: f64) -> Region {
    if distance_mm.is_nan() || distance_mm == 0.0 {
        return a.clone();
    }
    let polygon = |p: &Polygon| {
        let mut lines = p.rings.iter().map(closed_line);
        geo_types::Polygon::new(lines.next().unwrap_or_else(|| LineString(Vec::new())), lines.collect())
    };
    let all = MultiPolygon(a.polygons.iter().map(polygon).collect());
    let join = JoinType::Round(ARC_TOLERANCE_MM * UNITS_PER_MM);
    let grown = ClipperInt::offset(&all, distance_mm * UNITS_PER_MM, join, EndType::ClosedPolygon);
    let rings: Vec<Ring> = grown
        .into_iter()
        .map(geo_types::Polygon::into_inner)
        .flat_map(|(outer, holes)| std::iter::once(outer).chain(holes))
        .map(open_ring)
        .collect();
    // Clipper's rings may touch themselves; those of a region do not.
    resolve(&rings, Inside::Odd)
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
    let mut overlay = Overlay::<i32>::new_custom(1024, IntOverlayOptions::ogc(), Solver::FRAG);
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
    use crate::layers::shape::twice_area;
    use proptest::prelude::*;

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

    const SIDE: usize = 10;

    type Boxes = [([i32; 2], [i32; 2], bool)];

    /// How often boxes wind around each cell of a board.
    fn board(boxes: &Boxes) -> [i32; SIDE * SIDE] {
        let mut cells = [0; SIDE * SIDE];
        for (min, max, turned) in boxes {
            for y in min[1]..max[1] {
                for x in min[0]..max[0] {
                    cells[y as usize * SIDE + x as usize] += if *turned { -1 } else { 1 };
                }
            }
        }
        cells
    }

    /// The number of cells, and of pieces of them that hang together by their sides.
    fn pieces(cells: &[bool; SIDE * SIDE]) -> (usize, usize) {
        let mut full = *cells;
        let (count, mut pieces) = (full.iter().filter(|&&f| f).count(), 0);
        while let Some(start) = full.iter().position(|&f| f) {
            pieces += 1;
            let mut stack = vec![start];
            while let Some(at) = stack.pop() {
                if std::mem::take(&mut full[at]) {
                    let (x, y) = (at % SIDE, at / SIDE);
                    stack.extend((x > 0).then(|| at - 1));
                    stack.extend((x + 1 < SIDE).then_some(at + 1));
                    stack.extend((y > 0).then(|| at - SIDE));
                    stack.extend((y + 1 < SIDE).then_some(at + SIDE));
                }
            }
        }
        (count, pieces)
    }

    fn boxes() -> impl Strategy<Value = Vec<([i32; 2], [i32; 2], bool)>> {
        let one = (0..9_i32, 0..9_i32, 1..6_i32, 1..6_i32, any::<bool>())
            .prop_map(|(x, y, w, h, turned)| ([x, y], [(x + w).min(10), (y + h).min(10)], turned));
        prop::collection::vec(one, 1..14)
    }

    fn rings_of(boxes: &Boxes) -> Vec<Ring> {
        let ring = |(min, max, turned): &([i32; 2], [i32; 2], bool)| {
            let mut ring: Ring = [(min[0], min[1]), (max[0], min[1]), (max[0], max[1]), (min[0], max[1])]
                .map(|(x, y)| Point { x: 100 * x, y: 100 * y })
                .to_vec();
            if *turned {
                ring.reverse();
            }
            ring
        };
        boxes.iter().map(ring).collect()
    }

    /// Area and pieces are as they must be, rings simple and turned the right way.
    fn is_sound(region: &Region, (cells, count): (usize, usize)) -> Result<(), TestCaseError> {
        prop_assert_eq!(region.rings().map(|r| twice_area(r)).sum::<i128>(), 20_000 * cells as i128);
        prop_assert_eq!(region.polygons.len(), count, "{:?}", region);
        for polygon in &region.polygons {
            for (k, ring) in polygon.rings.iter().enumerate() {
                prop_assert!((twice_area(ring) > 0) == (k == 0));
                let mut corners = ring.clone();
                corners.sort_unstable();
                corners.dedup();
                prop_assert_eq!(corners.len(), ring.len(), "a ring that meets itself: {:?}", ring);
            }
        }
        Ok(())
    }

    fn triangle() -> impl Strategy<Value = Ring> {
        let point = || (0..9_i32, 0..9_i32).prop_map(|(x, y)| Point { x: 700 * x, y: 700 * y });
        prop::collection::vec(point(), 3).prop_filter_map("flat", |mut ring| match twice_area(&ring) {
            0 => None,
            1.. => Some(ring),
            _ => {
                ring.reverse();
                Some(ring)
            }
        })
    }

    /// Whether no line along a side parts two counter-clockwise triangles: exact, by signs of areas.
    fn triangles_overlap(a: &Ring, b: &Ring) -> bool {
        let parts = |a: &Ring, b: &Ring| {
            (0..3).any(|k| b.iter().all(|&p| twice_area(&[a[k], a[(k + 1) % 3], p]) <= 0))
        };
        !parts(a, b) && !parts(b, a)
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

        #[test]
        fn regions_are_what_they_say(boxes in boxes()) {
            let rings = rings_of(&boxes);
            for (inside, rule) in [
                (Inside::Positive, (|w| w > 0) as fn(i32) -> bool),
                (Inside::NonZero, |w| w != 0),
                (Inside::Odd, |w| w & 1 == 1),
            ] {
                is_sound(&resolve(&rings, inside), pieces(&board(&boxes).map(rule)))?;
            }
        }

        #[test]
        fn booleans_agree_with_cells(a in boxes(), b in boxes(), c in boxes()) {
            // What is in `c` is in both, so that whole polygons are the same now and then.
            let filled = |boxes: &Boxes| board(boxes).map(|w| w != 0);
            let region = |boxes: &Boxes| resolve(&rings_of(boxes), Inside::NonZero);
            let (a, b) = ([&a[..], &c].concat(), [&b[..a.len() % b.len()], &c].concat());
            let (cells_a, cells_b) = (filled(&a), filled(&b));
            let both = |f: fn(bool, bool) -> bool| pieces(&std::array::from_fn(|k| f(cells_a[k], cells_b[k])));
            let (a, b) = (region(&a), region(&b));
            is_sound(&union(&a, &b), both(|a, b| a || b))?;
            is_sound(&union_all([&a, &b, &a]), both(|a, b| a || b))?;
            is_sound(&intersection(&a, &b), both(|a, b| a && b))?;
            is_sound(&difference(&a, &b), both(|a, b| a && !b))?;
            is_sound(&without(a.rings(), b.rings()), both(|a, b| a && !b))?;
            is_sound(&within(a.rings(), b.rings()), both(|a, b| a && b))?;
            for polygon in &a.polygons {
                let only = Region { polygons: vec![polygon.clone()] };
                let expect = !intersection(&only, &b).is_empty();
                prop_assert_eq!(overlaps_any(polygon, &b.polygons), expect);
            }
        }

        #[test]
        fn overlapping_is_exact(a in triangle(), b in triangle()) {
            let expect = triangles_overlap(&a, &b);
            let [a, b] = [a, b].map(|ring| Polygon { rings: vec![ring] });
            prop_assert_eq!(overlaps(&a, &b), expect);
        }
    }
}
