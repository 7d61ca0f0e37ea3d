//! Growth that jumps no gap.
//!
//! A sector over a held edge may leave the piece through a free edge and come back in
//! through another, across a slot or behind a corner. Where a free edge turns its outer side to
//! the held one within reach, that can be; there the edge holds what hangs together with it
//! among all that lies in the piece and within reach of it, in short parts of the
//! edge. So no gap is jumped, and around a corner distance is measured straight, the
//! same rule as that of the images. Everywhere else the sector stands.
use super::held::{Edge, NEAR, Sector, at, cross, distance_2, minus};
use crate::detect::overlap::sweep;
use crate::layers::polygon::within;
use crate::layers::shape::{Point, Polygon, Ring, ring_edges};

/// Vertices that are cut at most, so that no piece takes long. Beyond it what could jump
/// holds nothing: more is reported, nothing is missed.
const MOST_CUT: usize = 4_000_000;

/// What the sectors hold of the piece with these rings and free edges.
pub(super) fn held_by(rings: &[Ring], free: &[Edge], sectors: Vec<Sector>, reach: f64) -> Vec<Ring> {
    let span = |e: &Edge, more: f64| {
        let (low, high) = (e.0[0].min(e.1[0]) - more, e.0[0].max(e.1[0]) + more);
        (low.floor() as i32, high.ceil() as i32)
    };
    let sources: Vec<_> = sectors.iter().map(|s| span(&s.source, reach)).collect();
    let free_spans: Vec<_> = free.iter().map(|e| span(e, 0.0)).collect();
    let mut may_jump = vec![false; sectors.len()];
    sweep(&sources, &free_spans, |s, f| {
        let s = s as usize;
        may_jump[s] = may_jump[s] || comes_back(sectors[s].source, free[f as usize], reach);
        false
    });
    let size: usize = rings.iter().map(Vec::len).sum();
    let mut allowed = MOST_CUT;
    let mut held = Vec::new();
    for (sector, jumps) in sectors.into_iter().zip(may_jump) {
        if !jumps {
            held.push(sector.ring);
            continue;
        }
        if allowed <= size {
            continue;
        }
        allowed -= size;
        // The whole piece is looked at once an edge, then only what lies around the edge.
        let around = within(rings, [&around(sector.source, reach)]);
        let local: Vec<Ring> = around.polygons.into_iter().flat_map(|p| p.rings).collect();
        if within(&local, [&sector.ring]).polygons.len() == 1 {
            // All of it hangs together, so nothing lies behind a gap.
            held.push(sector.ring);
            continue;
        }
        let cost = local.iter().map(Vec::len).sum::<usize>();
        for part in sector.parts(reach) {
            allowed = allowed.saturating_sub(cost);
            if allowed > 0 {
                held.extend(attached(&local, &part));
            }
        }
    }
    held
}

/// Whether a way of at most `reach` from the held edge can cross the free one from its
/// outer side (the right) to its inner one.
fn comes_back((a, b): Edge, (c, d): Edge, reach: f64) -> bool {
    let apart = a[1].max(b[1]) + reach < c[1].min(d[1]) || c[1].max(d[1]) + reach < a[1].min(b[1]);
    if apart {
        return false;
    }
    let side = |p, q, r| cross(minus(q, p), minus(r, p));
    // A step or two of the grid to the wrong side is rounding.
    let length = minus(d, c)[0].hypot(minus(d, c)[1]);
    let outside = |p| side(c, d, p) < -2.0 * length;
    let before = |p| a == b || side(a, b, p) > 0.0;
    (outside(a) || outside(b)) && (before(c) || before(d)) && near((a, b), (c, d), reach)
}

/// Whether two edges that do not cross come this near.
fn near((a, b): Edge, (c, d): Edge, reach: f64) -> bool {
    let reach_2 = reach * reach;
    distance_2(a, c, d) <= reach_2
        || distance_2(b, c, d) <= reach_2
        || distance_2(c, a, b) <= reach_2
        || distance_2(d, a, b) <= reach_2
}

/// A rectangle with all within reach of an edge.
fn around((a, b): Edge, reach: f64) -> Ring {
    let more = reach + 4.0;
    let low = [0, 1].map(|c: usize| (a[c].min(b[c]) - more).floor() as i32);
    let high = [0, 1].map(|c: usize| (a[c].max(b[c]) + more).ceil() as i32);
    [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]]
        .map(|[x, y]| Point { x, y })
        .to_vec()
}

/// The parts of the piece in a sector that hang together with the sector's source.
fn attached(rings: &[Ring], sector: &Sector) -> Vec<Ring> {
    let (a, b) = sector.source;
    let middle = [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
    let touches = |polygon: &Polygon| {
        let mut edges = polygon.rings.iter().flat_map(|ring| ring_edges(ring));
        edges.any(|[c, d]| distance_2(middle, at(c), at(d)) <= NEAR * NEAR)
    };
    let found = within(rings, [&sector.ring]).polygons;
    found.into_iter().filter(touches).flat_map(|p| p.rings).collect()
}
