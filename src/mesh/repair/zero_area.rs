//! Triangles without area that join nothing.
//!
//! Takes a draft with open edges, leaves out triangles that are lines and hang on
//! one edge or none. Those with neighbours on all sides stay: they hold the surface
//! together where three vertices lie on a line, and slice to nothing.
use super::draft::Draft;
use crate::mesh::OPEN;
use crate::mesh::report::Mended;
use crate::mesh::vector::{area, distance};

/// Leaves out lines on the rim, and those that come to be on the rim by that.
pub(super) fn peel(draft: &mut Draft, mended: &mut Mended) {
    let mut dropped = vec![false; draft.triangles.len()];
    let mut open: Vec<u8> = (0..draft.triangles.len()).map(|t| open_edges(draft, t)).collect();
    let mut queue: Vec<usize> =
        (0..draft.triangles.len()).filter(|&t| open[t] > 1 && is_line(draft, t)).collect();
    let mut count = 0;
    while let Some(t) = queue.pop() {
        if std::mem::replace(&mut dropped[t], true) {
            continue;
        }
        count += 1;
        for &twin in &draft.pairing.twins[t * 3..t * 3 + 3] {
            let neighbour = (twin / 3) as usize;
            if neighbour < dropped.len() && !dropped[neighbour] {
                open[neighbour] += 1;
                if open[neighbour] == 2 && is_line(draft, neighbour) {
                    queue.push(neighbour);
                }
            }
        }
    }
    if count > 0 {
        mended.degenerate_triangles += count;
        draft.drop_triangles(&dropped);
        draft.pair();
    }
}

fn open_edges(draft: &Draft, t: usize) -> u8 {
    draft.pairing.twins[t * 3..t * 3 + 3].iter().filter(|&&twin| twin == OPEN).count() as u8
}

/// Whether all corners lie within a hundredth of the tolerance of the longest side.
fn is_line(draft: &Draft, t: usize) -> bool {
    let [a, b, c] = draft.corners(t);
    let longest = distance(a, b).max(distance(b, c)).max(distance(c, a));
    2.0 * area(a, b, c) <= longest * draft.tolerance_mm * 0.01
}
