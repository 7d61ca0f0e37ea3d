//! From the paths of one layer to its polygons.
//!
//! Beads are swept a little wider than they are ([`spread_mm`]), for slicers lay them
//! side by side so that they just touch or nearly do, and they flow together.
//! What is bounded by walls and holds sparse infill counts as solid: what is printed on
//! it rests on the infill's lines and bridges from one to the next. Infill that
//! lies in no such hole (a part without walls) counts for what it is. Holes below
//! [`HOLE_MM2`], between the ends of beads, are none.
use super::locate::{Face, Hole, Locator};
use super::reach::along;
use super::trace::{Class, Path, Trace};
use crate::layers::polygon::{Inside, resolve, sweep, union};
use crate::layers::shape::{Point, Polygon, Region, UNITS_PER_MM, twice_area};
use crate::layers::tangle::tangled;
use rustc_hash::FxHashSet;

/// How much wider than it is a bead is swept, on each side, mm.
///
/// Widths that the file tells leave little open where lines end beside others. A
/// width that comes from the volume is less than the lines' spacing where the flow
/// is set below 100 %: down to 87 % is closed. Bridging
/// threads are laid 0.05 mm apart (PrusaSlicer's `BRIDGE_EXTRA_SPACING`).
pub(super) fn spread_mm(told: bool, bridge: bool) -> f64 {
    let gap = if told { 0.02 } else { 0.03 };
    if bridge { gap + 0.03 } else { gap }
}

/// Crossings of a layer's beads that are no trouble: some seconds' work. Supports of
/// crossed lines 2.5 mm apart on a plate of 500 mm cross 40,000 times; infill inside of
/// walls is not swept at all.
const FREE_CROSSINGS: u64 = 60_000;

/// Round ends and corners of beads differ from true ones by at most this, mm.
pub(super) const TOLERANCE_MM: f64 = 0.02;

/// Smaller holes are gaps between beads, mm²: 0.1 mm square.
pub(super) const HOLE_MM2: f64 = 0.01;

/// Infill is looked for at points this near each other, mm.
const STEP_MM: f64 = 1.0;

/// Points looked at on one segment of infill at most; longer ones are looked at more coarsely.
const STEPS_MAX: f64 = 400.0;

/// The part and the aids of a layer; `None` where beads cross each other everywhere.
pub(super) fn regions(trace: &Trace, paths: &[&Path]) -> Option<(Region, Region)> {
    let of = |classes: &'static [Class]| {
        paths
            .iter()
            .copied()
            .filter(move |path| classes.contains(&trace.sheets[path.sheet as usize].key.class))
    };
    let mut part = swept(trace, of(&[Class::Part]))?;
    let infill: Vec<&Path> = of(&[Class::Infill]).collect();
    if !infill.is_empty() {
        let (filled, outside) = fill(trace, part, &infill);
        part = if outside.is_empty() { filled } else { union(&filled, &swept(trace, outside.into_iter())?) };
    }
    drop_small_holes(&mut part);
    let mut aid = swept(trace, of(&[Class::Support, Class::Aid]))?;
    drop_small_holes(&mut aid);
    Some((part, aid))
}

/// Paths swept with their widths and united. Those that go on where the one before
/// ended, with its width (the turns of a spiral), are swept as one. `None` where they
/// cross each other everywhere.
fn swept<'a>(trace: &Trace, paths: impl Iterator<Item = &'a Path>) -> Option<Region> {
    let mut chains: Vec<(Vec<Point>, f64)> = Vec::new();
    for path in paths {
        let points = trace.points_of(path);
        let bridge = trace.sheets[path.sheet as usize].key.bridge;
        let radius_mm = f64::from(path.width_mm) / 2.0 + spread_mm(path.width_told, bridge);
        match chains.last_mut() {
            Some((chain, radius)) if *radius == radius_mm && chain.last() == points.first() => {
                chain.extend_from_slice(&points[1..]);
            }
            _ => chains.push((points.to_vec(), radius_mm)),
        }
    }
    let edges = chains.iter().flat_map(|(chain, _)| chain.windows(2).map(|e| [e[0], e[1]]));
    if tangled(edges, FREE_CROSSINGS).is_some() {
        return None;
    }
    Some(sweep(chains.iter().map(|(chain, radius)| (chain.as_slice(), *radius)), TOLERANCE_MM))
}

/// Fills the holes of a region that hold infill; gives the paths that leave it besides.
fn fill<'a>(trace: &Trace, part: Region, infill: &[&'a Path]) -> (Region, Vec<&'a Path>) {
    let locator = Locator::new(&part);
    let mut holes: FxHashSet<Hole> = FxHashSet::default();
    let mut outside = Vec::new();
    for path in infill {
        let mut leaves = false;
        along(trace.points_of(path), STEP_MM, STEPS_MAX, |p| match locator.at(p) {
            Face::Hole(hole) => {
                holes.insert(hole);
            }
            Face::Outside => leaves = true,
            Face::Material => {}
        });
        if leaves {
            outside.push(*path);
        }
    }
    (filled(part, &holes, locator.parents()), outside)
}

/// The region with some of its holes filled, and what lies in them swallowed.
///
/// No boolean is needed: a filled hole's ring goes, and so do the outer rings of the
/// polygons right inside it, whose own holes become the outer one's.
fn filled(part: Region, holes: &FxHashSet<Hole>, parents: &[Face]) -> Region {
    if holes.is_empty() {
        return part;
    }
    // A polygon that touches its hole's ring where it was asked for cannot be placed.
    if parents.contains(&Face::Material) {
        return filled_roughly(part, holes);
    }
    let root = |mut k: usize| {
        while let Face::Hole(hole) = parents[k] {
            if !holes.contains(&hole) {
                break;
            }
            k = hole.polygon as usize;
        }
        k
    };
    let mut polygons: Vec<Polygon> = vec![Polygon::default(); part.polygons.len()];
    for (k, polygon) in part.polygons.iter().enumerate() {
        if root(k) == k {
            polygons[k].rings.extend(polygon.rings.first().cloned());
        }
    }
    for (k, polygon) in part.polygons.into_iter().enumerate() {
        let kept = polygon
            .rings
            .into_iter()
            .enumerate()
            .skip(1)
            .filter(|(ring, _)| !holes.contains(&Hole { polygon: k as u32, ring: *ring as u32 }));
        polygons[root(k)].rings.extend(kept.map(|(_, ring)| ring));
    }
    polygons.into_iter().filter(|p| !p.rings.is_empty()).collect()
}

/// As [`filled`], with a union: holes inside of filled holes are filled too.
fn filled_roughly(part: Region, holes: &FxHashSet<Hole>) -> Region {
    let mut rings = Vec::new();
    for (k, polygon) in part.polygons.into_iter().enumerate() {
        rings.extend(polygon.rings.into_iter().enumerate().filter_map(|(ring, points)| {
            let hole = Hole { polygon: k as u32, ring: ring as u32 };
            (!holes.contains(&hole)).then_some(points)
        }));
    }
    resolve(&rings, Inside::Positive)
}

fn drop_small_holes(region: &mut Region) {
    let limit = (2.0 * HOLE_MM2 * UNITS_PER_MM * UNITS_PER_MM) as i128;
    for polygon in &mut region.polygons {
        let mut outer = true;
        polygon.rings.retain(|ring| std::mem::take(&mut outer) || -twice_area(ring) >= limit);
    }
}
