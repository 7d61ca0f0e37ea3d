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
use super::nest::Nester;
use super::outline::outline;
use super::shape::{Bounds, MAX_COORDINATE, Point, Polygon, Region, Ring, UNITS_PER_MM};
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

/// How far beyond the tolerance that it is asked for Clipper's arcs go: it rounds the
/// number of an arc's chords, so one may span half again the angle, at 1.5² the height.
const CLIPPER_ARC: f64 = 2.25;

fn closed_line(ring: &Ring) -> LineString<i64> {
    let coord = |p: &Point| Coord { x: i64::from(p.x), y: i64::from(p.y) };
    ring.iter().chain(ring.first()).map(coord).collect()
}

fn open_ring(line: LineString<i64>) -> Ring {
    let limit = i64::from(MAX_COORDINATE);
    let within = |c: i64| c.clamp(-limit, limit) as i32;
    let mut ring: Ring = line.0.into_iter().map(|c| Point { x: within(c.x), y: within(c.y) }).collect();
    if ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    ring
}

/// Everything within a distance of the region (negative: what is farther than it from the outside).
/// Corners become arcs that differ from circles by at most 2 µm; what would leave the
/// grid ends at its border. A distance that is no number is none.
#[must_use]
pub fn grow(a: &Region, distance_mm: f64) -> Region {
    let farthest = 2.0 * f64::from(MAX_COORDINATE);
    let distance = (distance_mm * UNITS_PER_MM).clamp(-farthest, farthest);
    if distance.is_nan() || distance == 0.0 {
        return a.clone();
    }
    let polygon = |p: &Polygon| {
        let mut lines = p.rings.iter().map(closed_line);
        geo_types::Polygon::new(lines.next().unwrap_or_else(|| LineString(Vec::new())), lines.collect())
    };
    let all = MultiPolygon(a.polygons.iter().map(polygon).collect());
    let join = JoinType::Round(ARC_TOLERANCE_MM / CLIPPER_ARC * UNITS_PER_MM);
    let grown = ClipperInt::offset(&all, distance, join, EndType::ClosedPolygon);
    let rings: Vec<Ring> = grown
        .into_iter()
        .map(geo_types::Polygon::into_inner)
        .flat_map(|(outer, holes)| std::iter::once(outer).chain(holes))
        .map(open_ring)
        .collect();
    // Clipper's rings may touch themselves; those of a region do not.
    Nester::default().nest(&rings).unwrap_or_else(|| resolve(&rings, Inside::Odd))
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
mod tests;
