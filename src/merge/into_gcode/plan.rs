//! What of the supports is printed in a layer: sections, clipped by what the file prints
//! there, as toolpaths in their order.
//!
//! Takes a layer and the planned section, gives a [`Plan`]. Knows no G-code text.
use super::cross::{Boxes, Shadow, to_segment_mm};
use super::report::Clipped;
use super::{Options, Refusal};
use crate::layers::polygon::{difference, intersection, sweep};
use crate::layers::shape::{Bounds, Point as Grid, Region, UNITS_PER_MM};
use crate::merge::gcode::flow::Shape;
use crate::merge::gcode::survey::Survey;
use crate::post::layer::{Layer, What};
use crate::support::section::{Section, Sections};
use crate::toolpath::bead::{Bead, Ends, LiftRule, Point, distance_mm};
use crate::toolpath::fill::{Fill, Kind as PathKind, Path, Phase, fill};
use crate::toolpath::nearest::{Limit, Near, Start, nearest};
use outrigger_gcode::state::Kind;

/// Round ends of what is kept clear differ from true ones by at most this, mm.
const TOLERANCE_MM: f64 = 0.01;

/// What is left of a section in smaller pieces is none, mm²: 0.05 mm square.
const SLIVER_MM2: f64 = 0.0025;

/// Width of prime lines, mm: they are laid thick.
const PURGE_MM: f64 = 1.0;

/// Widths that a bead of the file can have, mm.
const WIDTHS_MM: [f64; 2] = [0.1, 3.0];

/// Travels between the supports' own beads need no lift up to this, mm.
const FREE_MM: f64 = 2.0;

/// Points nearer than this to the way without them are left out, mm.
const THINNED_MM: f64 = 0.02;

/// Most points left out in a row.
const THINNED_POINTS: usize = 16;

/// A layer thicker than this many widths cannot be printed.
const THICKEST: f64 = 1.2;

/// A path to print.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Planned {
    pub(super) points: Vec<Point>,
    pub(super) interface: bool,
}

/// What is printed in a layer.
#[derive(Clone, Debug)]
pub(super) struct Plan {
    pub(super) bottom_mm: f64,
    pub(super) top_mm: f64,
    /// As it was planned.
    pub(super) section: Section,
    /// In their order, bodies first.
    pub(super) paths: Vec<Planned>,
    /// Where it is printed.
    pub(super) shadow: Shadow,
    /// By the part, by other things, by the plate's border.
    pub(super) clipped: [Clipped; 3],
    pub(super) first: bool,
}

/// A bead of the file.
#[derive(Clone, Copy, Debug)]
struct Own {
    ends: [Point; 2],
    width_mm: f64,
    part: bool,
}

/// A rule of [`Options`]: short ways between the supports' beads are free.
struct Free(f64);

impl LiftRule for Free {
    fn needs_lift(&self, from: Point, to: Point) -> bool {
        distance_mm(from, to) > self.0
    }
}

/// How far the supports' own travels go without a lift, mm.
pub(super) fn free_mm(options: &Options) -> f64 {
    FREE_MM.max(1.2 * options.spacing_mm.min(4.0))
}

/// Plans a layer between two heights, entered at a point; `None` where there is nothing to print.
///
/// # Errors
/// The layer is too thick to be printed.
pub(super) fn plan(
    layer: &Layer,
    slice: [f64; 2],
    entry: Point,
    sections: &dyn Sections,
    survey: &Survey,
    options: &Options,
) -> Result<Option<Plan>, Refusal> {
    let [bottom_mm, top_mm] = slice;
    if bottom_mm > sections.top_mm() {
        return Ok(None);
    }
    let section = sections.section(bottom_mm, top_mm);
    if section.body.is_empty() && section.interface.is_empty() {
        return Ok(None);
    }
    let width_mm = survey.width_mm;
    if top_mm - bottom_mm > THICKEST * width_mm {
        return Err(Refusal::Gap { layer: layer.number, from_mm: bottom_mm, to_mm: top_mm });
    }
    let all = [&section.body, &section.interface];
    let own = near(layer, slice, survey, options, &all);
    let mut clipped = [Clipped::default(); 3];
    let cut = |region: &Region, clipped: &mut [Clipped; 3]| {
        let parts = keep_out(&own, true, options.clearance_mm);
        let others = keep_out(&own, false, options.aid_clearance_mm);
        let mut left = region.clone();
        for (k, without) in [parts, others].iter().enumerate().filter(|(_, r)| !r.is_empty()) {
            let after = difference(&left, without);
            clipped[k].add(layer.number, top_mm, &left, &after);
            left = after;
        }
        let bed = options.bed.as_ref().unwrap_or(&survey.bed);
        if !bed.is_empty() && !surely_within(&left, bed) {
            let after = intersection(&left, bed);
            clipped[2].add(layer.number, top_mm, &left, &after);
            left = after;
        }
        left.polygons.retain(|p| p.area_mm2() > SLIVER_MM2);
        left
    };
    let interface = cut(&section.interface, &mut clipped);
    let mut body = cut(&section.body, &mut clipped);
    if !interface.is_empty() {
        body = difference(&body, &interface);
        body.polygons.retain(|p| p.area_mm2() > SLIVER_MM2);
    }
    let first = bottom_mm <= survey.ground_mm + 1e-9;
    let (in_body, in_interface) = fills(width_mm, first, options);
    // Thin branches are held by one ring, and lighter to break off.
    let (thick, thin) =
        body.polygons.iter().cloned().partition(|p| first || p.area_mm2() > options.thick_mm2);
    let (thick, thin) = (Region { polygons: thick }, Region { polygons: thin });
    let in_thin = Fill { rings: in_body.rings.min(1), spacing_mm: f64::INFINITY, ..in_body };
    let clear = |path: &Path| path.kind != PathKind::Spot || is_clear(path, width_mm, &own, options);
    let paths_of = |region: &Region, how: &Fill| -> Vec<Vec<Point>> {
        fill(region, how).into_iter().filter(clear).map(|p| thinned(p.points)).collect()
    };
    let rule = Free(free_mm(options));
    let mut at = entry;
    let mut paths = Vec::new();
    let mut bodies = paths_of(&thick, &in_body);
    bodies.extend(paths_of(&thin, &in_thin));
    for (own, interface) in [(bodies, false), (paths_of(&interface, &in_interface), true)] {
        for points in ordered(own, at, entry, &rule) {
            at = points[points.len() - 1];
            paths.push(Planned { points, interface });
        }
    }
    if paths.is_empty() && clipped.iter().all(|c| c.layers == 0) {
        return Ok(None);
    }
    let shadow = Shadow::new([&body, &interface]);
    Ok(Some(Plan { bottom_mm, top_mm, section, paths, shadow, clipped, first }))
}

/// How bodies and interfaces are filled.
fn fills(width_mm: f64, first: bool, options: &Options) -> (Fill, Fill) {
    let body = Fill {
        width_mm,
        rings: options.rings,
        spacing_mm: options.spacing_mm.max(width_mm),
        angle_deg: options.angle_deg,
        phase: Phase::Grid,
    };
    // What holds on to the plate holds by its area.
    let pad = Fill { spacing_mm: width_mm, phase: Phase::Fitted, ..body };
    let interface = Fill {
        rings: 1,
        spacing_mm: width_mm + options.interface_gap_mm.max(0.0),
        angle_deg: options.angle_deg + 90.0,
        phase: Phase::Fitted,
        ..body
    };
    (if first { pad } else { body }, interface)
}

/// A path without the points that lie on the way from their neighbours but for [`THINNED_MM`]:
/// arcs come with more of them than a printer needs.
fn thinned(points: Vec<Point>) -> Vec<Point> {
    let mut out: Vec<Point> = Vec::with_capacity(points.len());
    let mut from = 0;
    for (k, &point) in points.iter().enumerate() {
        let next = points.get(k + 1);
        let spared = next.is_some_and(|&next| {
            let chord = [points[from], next];
            k > from
                && k - from < THINNED_POINTS
                && points[from + 1..=k].iter().all(|&p| to_segment_mm(p, chord) < THINNED_MM)
        });
        if !spared {
            out.push(point);
            from = k;
        }
    }
    out
}

/// The paths in the order in which they are printed, nearest first; some the other way round.
fn ordered(paths: Vec<Vec<Point>>, from: Point, to: Point, rule: &Free) -> Vec<Vec<Point>> {
    let beads: Vec<Bead> = paths.iter().map(|p| Bead { ends: [p[0], p[p.len() - 1]] }).collect();
    let ends = Ends { entry: from, entry_counts: false, exit: Some(to), exit_counts: false };
    let tour = nearest(&beads, &Near::new(&beads), ends, Start::Entry, rule, Limit::NONE);
    let Some(tour) = tour else { return paths };
    let mut paths: Vec<Option<Vec<Point>>> = paths.into_iter().map(Some).collect();
    let mut out = Vec::with_capacity(paths.len());
    for visit in tour.order {
        if let Some(mut points) = paths[visit.bead as usize].take() {
            if visit.reversed {
                points.reverse();
            }
            out.push(points);
        }
    }
    out
}

/// The beads of the layer, and of the start macro where it stands on the plate, that come
/// near the supports.
fn near(
    layer: &Layer,
    [bottom_mm, top_mm]: [f64; 2],
    survey: &Survey,
    options: &Options,
    regions: &[&Region],
) -> Vec<Own> {
    let margin_mm = options.clearance_mm.max(options.aid_clearance_mm) + WIDTHS_MM[1] / 2.0 + survey.width_mm;
    let boxes = Boxes::new(regions.iter().flat_map(|r| &r.polygons), margin_mm);
    let is_near = |a: Point, b: Point| boxes.met(a, b).next().is_some();
    let mut found = Vec::new();
    for row in &layer.rows {
        let What::Move(m, Kind::Deposit) = row.what else { continue };
        m.chords(|a, b| {
            if is_near(a, b) {
                let state = layer.state(row);
                let width_mm = if state.width_mm > 0.0 {
                    state.width_mm
                } else {
                    let area = m.e / m.length_mm() / survey.e_per_mm3;
                    Shape::of(survey.dialect).width_mm(area, top_mm - bottom_mm)
                };
                let width_mm = width_mm.clamp(WIDTHS_MM[0], WIDTHS_MM[1]);
                found.push(Own { ends: [a, b], width_mm, part: state.feature.is_part() });
            }
        });
    }
    let standing = survey.purge.iter().filter(|p| bottom_mm < p.z_mm && is_near(p.ends[0], p.ends[1]));
    found.extend(standing.map(|p| Own { ends: p.ends, width_mm: PURGE_MM, part: false }));
    found
}

/// Where no support may be: the beads with their clearance.
fn keep_out(own: &[Own], part: bool, clearance_mm: f64) -> Region {
    let mut chains: Vec<(Vec<Grid>, f64)> = Vec::new();
    for bead in own.iter().filter(|b| b.part == part) {
        let [a, b] = bead.ends.map(|p| Grid::from_mm(p[0], p[1]));
        let radius = bead.width_mm / 2.0 + clearance_mm;
        match chains.last_mut() {
            Some((chain, r)) if *r == radius && chain.last() == Some(&a) => chain.push(b),
            _ => chains.push((vec![a, b], radius)),
        }
    }
    if chains.is_empty() {
        return Region::default();
    }
    sweep(chains.iter().map(|(chain, radius)| (chain.as_slice(), *radius)), TOLERANCE_MM)
}

/// Whether a spot, which is wider than what it stands for, keeps its distance.
fn is_clear(path: &Path, width_mm: f64, own: &[Own], options: &Options) -> bool {
    path.points.windows(2).all(|p| {
        own.iter().all(|bead| {
            let clearance = if bead.part { options.clearance_mm } else { options.aid_clearance_mm };
            let least = (bead.width_mm + width_mm) / 2.0 + clearance;
            super::cross::distance_mm([p[0], p[1]], bead.ends) >= least - TOLERANCE_MM
        })
    })
}

/// Whether a region lies on a rectangular plate by its bounds alone.
fn surely_within(region: &Region, bed: &Region) -> bool {
    let (own, all) = (region.bounds(), bed.bounds());
    let area = |b: Bounds| {
        let side = |low: i32, high: i32| (f64::from(high) - f64::from(low)) / UNITS_PER_MM;
        side(b.min.x, b.max.x) * side(b.min.y, b.max.y)
    };
    let rectangular = (bed.area_mm2() - area(all)).abs() < 1e-6 * area(all);
    let inside =
        all.min.x <= own.min.x && own.max.x <= all.max.x && all.min.y <= own.min.y && own.max.y <= all.max.y;
    region.is_empty() || (rectangular && inside)
}
