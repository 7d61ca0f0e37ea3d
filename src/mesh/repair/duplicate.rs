//! Triangles that are there twice.
//!
//! Takes a draft with crowded edges, leaves out triangles on the same three
//! vertices. Of those that face the same way one is kept. Those that face opposite
//! ways are dropped, both: they are the wall between two bodies that were put side
//! by side, and there is no air in it. Where most triangles have an opposite the
//! file was written with two-sided faces, and one of each is kept.
use super::draft::Draft;
use crate::mesh::report::Mended;
use crate::mesh::twins::CROWDED;

/// A triangle that may have a duplicate.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Candidate {
    /// Its vertices in ascending order.
    vertices: [u32; 3],
    /// Whether that order runs the other way round.
    reversed: bool,
    triangle: u32,
}

impl Candidate {
    fn of(corners: [u32; 3], triangle: u32) -> Candidate {
        let mut vertices = corners;
        vertices.sort_unstable();
        let lowest = corners.iter().position(|&v| v == vertices[0]).unwrap_or(0);
        Candidate { vertices, reversed: corners[(lowest + 1) % 3] != vertices[1], triangle }
    }
}

/// Leaves out duplicates and opposites.
pub(super) fn drop(draft: &mut Draft, mended: &mut Mended) {
    // A duplicate makes its edges crowded; opposites do where a neighbour is left.
    let crowded = |t: &usize| draft.pairing.twins[t * 3..t * 3 + 3].contains(&CROWDED);
    let mut candidates: Vec<Candidate> = (0..draft.triangles.len())
        .filter(crowded)
        .map(|t| Candidate::of(draft.triangles[t], t as u32))
        .collect();
    candidates.sort_unstable();
    let groups = || candidates.chunk_by(|a, b| a.vertices == b.vertices);
    let two_sided = |group: &[Candidate]| group[0].reversed != group[group.len() - 1].reversed;
    let opposites = groups().filter(|g| two_sided(g)).count();
    let extra: usize = groups().map(|g| g.len() - 1).sum();
    if extra == 0 {
        return;
    }
    let all_two_sided = opposites * 2 > draft.triangles.len() - extra;
    let mut dropped = vec![false; draft.triangles.len()];
    for group in groups().filter(|g| g.len() > 1) {
        group.iter().for_each(|c| dropped[c.triangle as usize] = true);
        if !two_sided(group) || all_two_sided {
            let kept = group.iter().map(|c| c.triangle).min().unwrap_or_default();
            dropped[kept as usize] = false;
            mended.duplicate_triangles += group.len() as u64 - 1;
        } else {
            mended.duplicate_triangles += group.len() as u64 - 2;
            mended.opposite_triangles += 2;
        }
    }
    draft.drop_triangles(&dropped);
    draft.pair();
}
