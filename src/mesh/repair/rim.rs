//! Rims: the edges round each hole, in order.
//!
//! Takes a draft, gives closed sequences of half-edges without a twin; no vertex
//! comes twice in one. Where holes share a vertex, each edge goes on across the gap
//! beside it, not round the triangles that hang there: so a row of holes that cuts a
//! surface in two is still a row of holes.
use super::draft::Draft;
use crate::mesh::twins::{CROWDED, next};
use crate::mesh::vector::{cross, dot, length, sub};

/// Not in the rim that is being followed.
const NOWHERE: u32 = u32::MAX;

/// All rims.
pub(super) struct Rims {
    half_edges: Vec<u32>,
    /// Where in `half_edges` each rim ends.
    ends: Vec<usize>,
}

impl Rims {
    /// Follows them.
    pub(super) fn of(draft: &Draft) -> Rims {
        let open: Vec<u32> = (0..draft.pairing.twins.len() as u32)
            .filter(|&h| draft.pairing.twins[h as usize] >= CROWDED)
            .collect();
        let following = following(draft, &open);
        let mut seen = vec![false; open.len()];
        let mut positions = vec![NOWHERE; draft.vertices.len()];
        let mut rims = Rims { half_edges: Vec::with_capacity(open.len()), ends: Vec::new() };
        let mut path = Vec::new();
        for first in 0..open.len() {
            let mut k = first;
            while !std::mem::replace(&mut seen[k], true) {
                let start = draft.ends(open[k])[0] as usize;
                if positions[start] != NOWHERE {
                    rims.cut(draft, &mut path, positions[start], &mut positions);
                }
                positions[start] = path.len() as u32;
                path.push(open[k]);
                // Those that follow are all open ones in another order.
                k = open.binary_search(&following[k]).unwrap_or(k);
            }
            if !path.is_empty() {
                rims.cut(draft, &mut path, 0, &mut positions);
            }
        }
        rims
    }

    /// Makes the end of a path, from a position on, a rim.
    fn cut(&mut self, draft: &Draft, path: &mut Vec<u32>, from: u32, positions: &mut [u32]) {
        for h in path.drain(from as usize..) {
            positions[draft.ends(h)[0] as usize] = NOWHERE;
            self.half_edges.push(h);
        }
        self.ends.push(self.half_edges.len());
    }

    /// The half-edges of each, each beginning where the one before ends.
    pub(super) fn iter(&self) -> impl Iterator<Item = &[u32]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(from, &to)| &self.half_edges[from..to])
    }
}

/// For each open half-edge the open one that goes on from its end.
fn following(draft: &Draft, open: &[u32]) -> Vec<u32> {
    let twins = &draft.pairing.twins;
    // Round the triangles that hang together at the end.
    let mut following: Vec<u32> = open
        .iter()
        .map(|&h| {
            let mut h = next(h);
            while twins[h as usize] < CROWDED {
                h = next(twins[h as usize]);
            }
            h
        })
        .collect();
    let end = |k: u32| draft.ends(open[k as usize])[1];
    let mut by_end: Vec<u32> = (0..open.len() as u32).collect();
    by_end.sort_by_key(|&k| end(k));
    for fans in by_end.chunk_by(|&a, &b| end(a) == end(b)) {
        match *fans {
            [_] => (),
            [a, b] => following.swap(a as usize, b as usize),
            _ => across_gaps(draft, open, fans, &mut following),
        }
    }
    following
}

/// Sorts the edges at a vertex about its normal: a gap begins after an edge that comes
/// in, and ends at one that goes out.
fn across_gaps(draft: &Draft, open: &[u32], fans: &[u32], following: &mut [u32]) {
    let middle = draft.ends(open[fans[0] as usize])[1];
    let place = |v: u32| sub(draft.vertices[v as usize], draft.vertices[middle as usize]);
    let mut normal = [0.0; 3];
    for h in fans.iter().flat_map(|&k| [open[k as usize], following[k as usize]]) {
        let [a, b, c] = draft.corners((h / 3) as usize);
        let n = cross(sub(b, a), sub(c, a));
        normal = [0, 1, 2].map(|k| normal[k] + n[k]);
    }
    // Counter-clockwise on the plane square to the normal.
    let up = cross(normal, place(draft.ends(open[fans[0] as usize])[0]));
    let scale = length(normal).max(f64::MIN_POSITIVE);
    let right = cross(up, normal).map(|c| c / scale);
    let angle = |v: u32| dot(place(v), up).atan2(dot(place(v), right));
    let comes = fans.iter().map(|&k| (angle(draft.ends(open[k as usize])[0]), false, k));
    let goes = fans.iter().map(|&k| following[k as usize]).map(|h| (angle(draft.ends(h)[1]), true, h));
    let mut edges: Vec<(f64, bool, u32)> = comes.chain(goes).collect();
    edges.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let (mut gaps, mut unmatched) = (Vec::new(), Vec::new());
    for (_, goes, edge) in edges {
        match (goes, gaps.pop()) {
            (true, Some(k)) => following[k as usize] = edge,
            (true, None) => unmatched.push(edge),
            (false, before) => {
                gaps.extend(before);
                gaps.push(edge);
            }
        }
    }
    // Those whose gap holds the direction where counting begins.
    for (k, out) in gaps.into_iter().rev().zip(unmatched) {
        following[k as usize] = out;
    }
}
