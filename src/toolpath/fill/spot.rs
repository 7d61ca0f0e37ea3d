//! What is narrower than a line: lines along its middle, or a dot.
//!
//! The polygon is cut across its longer axis every half width; the middles of the cuts
//! make chains, which follow it around bends. What is shorter than a line is wide gets a
//! dot: a line of π/4 widths, which holds as much as a disc of a width across.
use super::scan::{Frame, intervals};
use super::{Kind, Path};
use crate::layers::shape::{Polygon, ring_edges};
use crate::toolpath::bead::Point;
use std::f64::consts::FRAC_PI_4;

/// Most cuts across one polygon: 4 m of it.
const MAX_CUTS: f64 = 20_000.0;

/// Lines and dots for one polygon: at least one for one that has an area.
pub(super) fn spots(polygon: &Polygon, width_mm: f64) -> Vec<Path> {
    let along = Frame::along(axis(polygon));
    let across = along.across();
    // Across the cuts is along the axis, the other way around.
    let Some([low, high]) = across.extent(polygon) else { return Vec::new() };
    let room = (high - low - width_mm).max(0.0);
    let steps = (room / (width_mm / 2.0)).floor().clamp(0.0, MAX_CUTS);
    let middle = f64::midpoint(low, high);
    let step = if steps > 0.0 { room / steps } else { 0.0 };
    let cuts: Vec<f64> = (0..=steps as u32).map(|k| middle + (f64::from(k) - steps / 2.0) * step).collect();
    let mut chains: Vec<Chain> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    for (cut, pieces) in cuts.iter().zip(intervals(polygon, across, &cuts)) {
        let mut next = Vec::with_capacity(pieces.len());
        for piece in pieces {
            let point = across.back([f64::midpoint(piece[0], piece[1]), *cut]);
            let meets = |chain: &Chain| chain.last[0] < piece[1] && piece[0] < chain.last[1];
            match open.iter().position(|&k| meets(&chains[k])) {
                Some(at) => {
                    let k = open.swap_remove(at);
                    chains[k].points.push(point);
                    chains[k].last = piece;
                    next.push(k);
                }
                None => {
                    next.push(chains.len());
                    chains.push(Chain { points: vec![point], last: piece });
                }
            }
        }
        open = next;
    }
    chains.into_iter().map(|chain| path(chain.points, along, width_mm)).collect()
}

struct Chain {
    points: Vec<Point>,
    /// The cut that it came to last.
    last: [f64; 2],
}

/// A chain as a path, no shorter than a dot.
fn path(mut points: Vec<Point>, along: Frame, width_mm: f64) -> Path {
    let dot = FRAC_PI_4 * width_mm;
    let length: f64 = points.windows(2).map(|p| (p[1][0] - p[0][0]).hypot(p[1][1] - p[0][1])).sum();
    if length < dot {
        let middle = points[points.len() / 2];
        let [x, y] = along.of(middle);
        points = vec![along.back([x - dot / 2.0, y]), along.back([x + dot / 2.0, y])];
    }
    Path { points, kind: Kind::Spot }
}

/// The direction in which the border reaches furthest (the first principal axis of its edges).
fn axis(polygon: &Polygon) -> Point {
    let edges = || {
        polygon.rings.first().into_iter().flat_map(|ring| ring_edges(ring)).map(|[a, b]| {
            let (a, b) = (a.mm(), b.mm());
            ([f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])], [b[0] - a[0], b[1] - a[1]])
        })
    };
    let length = |d: Point| d[0].hypot(d[1]);
    let total: f64 = edges().map(|(_, d)| length(d)).sum();
    let mean = |axis: usize| edges().map(|(m, d)| m[axis] * length(d)).sum::<f64>() / total;
    let centre = [mean(0), mean(1)];
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for (m, d) in edges() {
        let (dx, dy, weight) = (m[0] - centre[0], m[1] - centre[1], length(d));
        xx += weight * (dx * dx + d[0] * d[0] / 12.0);
        xy += weight * (dx * dy + d[0] * d[1] / 12.0);
        yy += weight * (dy * dy + d[1] * d[1] / 12.0);
    }
    // The eigenvector of the larger eigenvalue of [[xx, xy], [xy, yy]].
    let larger = f64::midpoint(xx, yy) + (xx - yy).hypot(2.0 * xy) / 2.0;
    if xy != 0.0 {
        [larger - yy, xy]
    } else if xx >= yy {
        [1.0, 0.0]
    } else {
        [0.0, 1.0]
    }
}
