//! Bridges: strands that hang between two held ends.
//!
//! A strand of filament laid straight across a gap holds itself when both its ends lie
//! on something and are no farther apart than the material bears. In polygons: of a
//! residual piece, a point is bridged in a direction when the chord of the piece through
//! the point in that direction ends on held edges at both ends and is no longer than the
//! span. All of a piece is laid in one direction; of a few likely ones (square to
//! the held edges) that one is taken which leaves least. This is conservative: what
//! hangs on one end only, what is too wide, and pieces of more than [`MOST_EDGES`] edges
//! stay overhangs; the printer that fans strands out could do better.
use super::held::{Residual, V, at, cross, dot, minus};
use super::is_dust;
use crate::layers::polygon::without;
use crate::layers::shape::{Point, Polygon, Ring};

/// Pieces of more edges than this are not searched, so that no piece takes long.
const MOST_EDGES: usize = 4000;

/// Directions that are tried.
const TRIED: usize = 4;

/// Held edges within this angle of each other count as one direction, parts of a half turn.
const BINS: usize = 12;

/// Strands are cut out wider than they are by this, grid steps, so that rounding leaves no hairs.
const HAIR: f64 = 1.5;

/// An edge in the frame of a direction: along it and square to it, lower end first.
struct Wall {
    low: V,
    high: V,
    held: bool,
}

impl Wall {
    fn at(&self, height: f64) -> f64 {
        let part = (height - self.low[1]) / (self.high[1] - self.low[1]);
        self.low[0] + (self.high[0] - self.low[0]) * part
    }
}

/// What of the overhanging polygons of a piece no bridge of this span (grid steps) holds.
pub(super) fn unbridged(piece: &Residual, overhang: Vec<Polygon>, span: f64) -> Vec<Polygon> {
    if piece.polygon.len() > MOST_EDGES {
        return overhang;
    }
    let area = |left: &[Polygon]| left.iter().map(Polygon::area_mm2).sum::<f64>();
    let (mut best, mut least) = (None, area(&overhang));
    for way in directions(piece) {
        let strands = strands(piece, way, span);
        if strands.is_empty() {
            continue;
        }
        let left = without(overhang.iter().flat_map(|p| &p.rings), &strands).polygons;
        let left: Vec<Polygon> = left.into_iter().filter(|p| !is_dust(p)).collect();
        if area(&left) < least {
            least = area(&left);
            best = Some(left);
        }
        if least == 0.0 {
            break;
        }
    }
    best.unwrap_or(overhang)
}

/// Directions square to the held edges, those with the longest edges first.
fn directions(piece: &Residual) -> Vec<V> {
    let mut bins = [[0.0_f64; 3]; BINS];
    for (a, b, held) in edges(piece) {
        if !held {
            continue;
        }
        let mut normal = minus(b, a);
        normal = [-normal[1], normal[0]];
        // One of the two ways along the same line.
        if normal[1] < 0.0 || (normal[1] == 0.0 && normal[0] < 0.0) {
            normal = [-normal[0], -normal[1]];
        }
        let part = normal[1].atan2(normal[0]) / std::f64::consts::PI * BINS as f64;
        let bin = &mut bins[(part.round() as usize) % BINS];
        // Ways on both sides of the cut between the last bin and the first are opposite.
        let sign = if part.round() as usize == BINS { -1.0 } else { 1.0 };
        let length = normal[0].hypot(normal[1]);
        *bin = [bin[0] + sign * normal[0], bin[1] + sign * normal[1], bin[2] + length];
    }
    let mut order: Vec<usize> = (0..BINS).filter(|&k| bins[k][2] > 0.0).collect();
    order.sort_by(|&a, &b| bins[b][2].total_cmp(&bins[a][2]).then(a.cmp(&b)));
    order.truncate(TRIED);
    let unit = |[x, y, _]: [f64; 3]| {
        let length = x.hypot(y);
        (length > 0.0).then(|| [x / length, y / length])
    };
    order.into_iter().filter_map(|k| unit(bins[k])).collect()
}

fn edges(piece: &Residual) -> impl Iterator<Item = (V, V, bool)> + '_ {
    piece.polygon.rings.iter().zip(&piece.held).flat_map(|(ring, held)| {
        held.iter().enumerate().map(|(k, &held)| (at(ring[k]), at(ring[(k + 1) % ring.len()]), held))
    })
}

/// The parts of the piece whose chords along a direction are bridges, as quadrilaterals.
fn strands(piece: &Residual, way: V, span: f64) -> Vec<Ring> {
    let frame = |p: V| [dot(way, p), cross(way, p)];
    let mut walls: Vec<Wall> = edges(piece)
        .map(|(a, b, held)| {
            let (a, b) = (frame(a), frame(b));
            if a[1] <= b[1] { Wall { low: a, high: b, held } } else { Wall { low: b, high: a, held } }
        })
        .filter(|w| w.low[1] < w.high[1])
        .collect();
    walls.sort_by(|a, b| a.low[1].total_cmp(&b.low[1]));
    let mut heights: Vec<f64> = walls.iter().flat_map(|w| [w.low[1], w.high[1]]).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let (mut open, mut next): (Vec<&Wall>, usize) = (Vec::new(), 0);
    let mut strands = Vec::new();
    for ends in heights.windows(2) {
        let (low, high) = (ends[0], ends[1]);
        while next < walls.len() && walls[next].low[1] <= low {
            open.push(&walls[next]);
            next += 1;
        }
        open.retain(|w| w.high[1] >= high);
        let middle = (low + high) / 2.0;
        open.sort_by(|a, b| a.at(middle).total_cmp(&b.at(middle)));
        for pair in open.chunks_exact(2) {
            let (l, r) = (pair[0], pair[1]);
            let width = (r.at(low) - l.at(low)).max(r.at(high) - l.at(high));
            if l.held && r.held && width <= span {
                strands.push(quadrilateral(way, [l.at(low), r.at(low), l.at(high), r.at(high)], [low, high]));
            }
        }
    }
    strands
}

/// Between four places along the direction: lower left and right, upper left and right.
fn quadrilateral(way: V, along: [f64; 4], heights: [f64; 2]) -> Ring {
    let back = |s: f64, t: f64| Point {
        x: (way[0] * s - way[1] * t).round() as i32,
        y: (way[1] * s + way[0] * t).round() as i32,
    };
    let (low, high) = (heights[0] - HAIR, heights[1] + HAIR);
    vec![
        back(along[0] - HAIR, low),
        back(along[1] + HAIR, low),
        back(along[3] + HAIR, high),
        back(along[2] - HAIR, high),
    ]
}
