//! From a region and a line's width to toolpaths: rings, rasters, spots.
//!
//! Takes a region with holes, gives paths of the nozzle's middle, always the same
//! ones for the same region. Rings go along the border, the outermost half a width
//! inside it. A raster is straight lines at an angle. What is narrower than a line is
//! no ring and no raster: it gets lines along its middle, or a dot, never nothing.
//! Knows no height, no speed and no filament.
mod inset;
mod scan;
mod spot;

use super::bead::Point;
use crate::layers::shape::{Polygon, Region};
use inset::inset;
use scan::{Frame, intervals};

/// Rings and lines lie nearer than this to each other nowhere, mm: a smaller width or
/// spacing counts as this.
pub const LEAST_SPACING_MM: f64 = 0.05;

/// Most lines of one raster: one every 0.05 mm over 5 m. Larger ones are coarser.
const MAX_LINES: f64 = 100_000.0;

/// Most rings within each other: those of 0.4 mm fill 400 mm.
const MAX_RINGS: usize = 500;

/// Lines of a fill go so far into the innermost ring, in widths: what slicers call overlap.
const OVERLAP: f64 = 0.25;

/// What is left inside of the last ring is a spot where it has this area, in widths squared.
const LEFT_AREA: f64 = 0.1;

/// What a path is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Closed, along a border.
    Ring,
    /// A straight line of a raster.
    Line,
    /// Where there is no room for a line.
    Spot,
}

/// Where the middle of the nozzle goes.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// At least two, mm; a ring's last point is its first one.
    pub points: Vec<Point>,
    /// What it is.
    pub kind: Kind,
}

impl Path {
    /// Length of the way, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.points.windows(2).map(|p| super::bead::distance_mm(p[0], p[1])).sum()
    }
}

/// Where the lines of a raster lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// At whole multiples of the spacing from the origin: those of one layer stand on
    /// those of the layer below.
    Grid,
    /// From border to border of each polygon, a little nearer to each other than the
    /// spacing where that is needed to fill it evenly.
    Fitted,
}

/// How a region is filled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fill {
    /// Of a line, mm.
    pub width_mm: f64,
    /// Along the border.
    pub rings: usize,
    /// From line to line of the raster inside, mm; infinite for none.
    pub spacing_mm: f64,
    /// Of the raster's lines, counter-clockwise from X.
    pub angle_deg: f64,
    /// Of the raster.
    pub phase: Phase,
}

/// Rings along the border, and a raster in what they leave.
///
/// The middles of rings and lines lie half a width inside of the region and deeper;
/// those of spots lie inside, but for the ends of dots (0.4 widths beyond at most).
#[must_use]
pub fn fill(region: &Region, how: &Fill) -> Vec<Path> {
    let (mut paths, mut left) = rings(region, how.width_mm, how.rings);
    if how.spacing_mm.is_finite() && !left.is_empty() {
        let width = how.width_mm.max(LEAST_SPACING_MM);
        let room = if how.rings > 0 { 0.5 - OVERLAP } else { 0.5 };
        left = left.polygons.iter().flat_map(|p| inset(p, room * width).polygons).collect();
        paths.extend(raster(&left, how.spacing_mm, how.angle_deg, how.phase));
    }
    paths
}

/// At most `count` rings within each other along all borders, and what they leave
/// inside. What is narrower than a line (a polygon, or what is left inside of the last
/// ring) gets spots.
#[must_use]
pub fn rings(region: &Region, width_mm: f64, count: usize) -> (Vec<Path>, Region) {
    let width = width_mm.max(LEAST_SPACING_MM);
    let mut paths = Vec::new();
    let mut left = Region::default();
    for polygon in &region.polygons {
        let mut done = 0;
        while done < count.min(MAX_RINGS) {
            let middles = inset(polygon, (done as f64 + 0.5) * width);
            if middles.is_empty() {
                break;
            }
            paths.extend(middles.rings().map(|ring| closed(ring)));
            done += 1;
        }
        let rest =
            if done == 0 { vec![polygon.clone()] } else { inset(polygon, done as f64 * width).polygons };
        if done == count.min(MAX_RINGS) && (done > 0 || !inset(polygon, width / 2.0).is_empty()) {
            left.polygons.extend(rest);
            continue;
        }
        // A polygon of its own is never left out; a remainder in the middle may be too small to matter.
        let least_mm2 = if done == 0 { 0.0 } else { LEFT_AREA * width * width };
        for narrow in rest.iter().filter(|p| p.area_mm2() > least_mm2) {
            paths.extend(spot::spots(narrow, width));
        }
    }
    (paths, left)
}

/// Straight lines within a region (their middles; the caller leaves room for half a width).
#[must_use]
pub fn raster(region: &Region, spacing_mm: f64, angle_deg: f64, phase: Phase) -> Vec<Path> {
    let frame = Frame::new(angle_deg);
    let mut paths = Vec::new();
    for polygon in &region.polygons {
        let offsets = offsets(polygon, frame, spacing_mm, phase);
        for (offset, pieces) in offsets.iter().zip(intervals(polygon, frame, &offsets)) {
            for [from, to] in pieces {
                let points = vec![frame.back([from, *offset]), frame.back([to, *offset])];
                paths.push(Path { points, kind: Kind::Line });
            }
        }
    }
    paths
}

/// How far from the origin the lines lie that cross a polygon, ascending.
fn offsets(polygon: &Polygon, frame: Frame, spacing_mm: f64, phase: Phase) -> Vec<f64> {
    let Some([low, high]) = frame.extent(polygon) else { return Vec::new() };
    let span = high - low;
    let spacing = spacing_mm.max(LEAST_SPACING_MM).max(span / MAX_LINES);
    match phase {
        Phase::Grid => {
            let first = (low / spacing).ceil() as i64;
            let last = (high / spacing).floor() as i64;
            (first..=last).map(|k| k as f64 * spacing).collect()
        }
        Phase::Fitted => {
            // From border to border; the outermost lie a hair inside, where they cut something off.
            let hair = (span / 4.0).min(1e-3);
            let gaps = ((span - 2.0 * hair) / spacing).ceil().max(1.0);
            let step = (span - 2.0 * hair) / gaps;
            (0..=gaps as u32).map(|k| low + hair + f64::from(k) * step).collect()
        }
    }
}

fn closed(ring: &[crate::layers::shape::Point]) -> Path {
    let points = ring.iter().chain(ring.first()).map(|p| p.mm()).collect();
    Path { points, kind: Kind::Ring }
}

#[cfg(test)]
mod tests;
