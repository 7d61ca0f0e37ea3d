//! A proof that what is below holds all of a residual piece, without any boolean.
//!
//! Most residual pieces are slivers between the polygon's border and the border of what
//! is below. A sliver is zipped up: triangles are drawn between its held and its free
//! chain, from one end to the other. If every triangle turns the right way, they tile
//! the piece (a map of a disc onto the piece that keeps the orientation everywhere and
//! runs once around its border covers each point once). If moreover each triangle lies
//! within reach of a held edge or vertex *of its own*, each of its points is held by a
//! straight way inside the piece. So the proof is sound for both kinds of growth; where
//! it fails nothing is said.
use super::held::{Residual, V, at, cross, distance_2, minus};

/// Whether all of the piece is within reach (grid steps) of its held edges; no is no
/// proof of anything.
pub(super) fn is_thin(piece: &Residual, reach: f64) -> bool {
    let reach_2 = reach * reach;
    match piece.polygon.rings.as_slice() {
        [ring] => {
            let held = &piece.held[0];
            let n = ring.len();
            // Where the held chain begins: exactly one edge is held after a free one.
            let mut starts = (0..n).filter(|&k| held[k] && !held[(k + n - 1) % n]);
            let (Some(start), None) = (starts.next(), starts.next()) else { return false };
            let length = held.iter().filter(|h| **h).count();
            let chain = |from: usize, edges: usize| -> Vec<V> {
                (0..=edges).map(|k| at(ring[(from + k) % n])).collect()
            };
            zip(&chain(start, length), &chain(start + length, n - length), reach_2)
        }
        [one, two] => {
            let all = |k: usize, as_held: bool| piece.held[k].iter().all(|h| *h == as_held);
            let (held, free) = match (all(0, true) && all(1, false), all(0, false) && all(1, true)) {
                (true, _) => (one, two),
                (_, true) => (two, one),
                _ => return false,
            };
            let start = at(held[0]);
            let near = |k: &usize| {
                let off = minus(at(free[*k]), start);
                off[0].hypot(off[1])
            };
            let Some(first) = (0..free.len()).min_by(|a, b| near(a).total_cmp(&near(b))) else {
                return false;
            };
            let closed = |ring: &[_], from: usize| -> Vec<V> {
                (0..=ring.len()).map(|k| at(ring[(from + k) % ring.len()])).collect()
            };
            zip(&closed(held, 0), &closed(free, first), reach_2)
        }
        _ => false,
    }
}

/// Zips the held chain, from its end backward, to the free one, from its start forward.
fn zip(held: &[V], free: &[V], reach_2: f64) -> bool {
    let (mut i, mut j) = (held.len() - 1, 0);
    while i > 0 || j + 1 < free.len() {
        let back = i > 0 && holds_edge(held[i - 1], held[i], free[j], reach_2);
        let on = j + 1 < free.len() && holds_face(held, i, free[j], free[j + 1], reach_2);
        let take_back = match (back, on) {
            (false, false) => return false,
            // The shorter diagonal keeps the two sides in step.
            (true, true) => length_2(held[i - 1], free[j]) <= length_2(held[i], free[j + 1]),
            (back, _) => back,
        };
        if take_back {
            i -= 1;
        } else {
            j += 1;
        }
    }
    true
}

fn length_2(a: V, b: V) -> f64 {
    let d = minus(b, a);
    d[0] * d[0] + d[1] * d[1]
}

fn turns_left(a: V, b: V, c: V) -> bool {
    cross(minus(b, a), minus(c, a)) >= 0.0
}

/// The triangle over a held edge with its tip at `tip`.
fn holds_edge(a: V, b: V, tip: V, reach_2: f64) -> bool {
    turns_left(a, b, tip) && distance_2(tip, a, b) <= reach_2
}

/// The triangle over a free edge `a → b` with its tip at the held vertex `i`. The
/// distance from an edge is convex, so the farthest point of a triangle is a corner.
fn holds_face(held: &[V], i: usize, a: V, b: V, reach_2: f64) -> bool {
    let tip = held[i];
    let within = |c: V, d: V| distance_2(a, c, d) <= reach_2 && distance_2(b, c, d) <= reach_2;
    turns_left(tip, a, b)
        && (within(tip, tip)
            || (i > 0 && within(held[i - 1], tip))
            || (i + 1 < held.len() && within(tip, held[i + 1])))
}
