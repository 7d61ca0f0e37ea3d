//! Triangles that face the other way than their neighbours.
//!
//! Takes a draft with edges whose two half-edges run the same way, turns triangles
//! so that neighbours agree: in each connected piece the fewer are turned. A
//! surface with one side only (a Möbius strip) is left open along a seam.
use super::draft::Draft;
use crate::mesh::report::Mended;
use crate::mesh::twins::CROWDED;

/// Turns triangles until neighbours agree.
pub(super) fn agree(draft: &mut Draft, mended: &mut Mended) {
    if !draft.pairing.crowds().any(|c| c.len() == 2) {
        return;
    }
    let mut sets = Sets::new(draft.triangles.len());
    // Neighbours that agree first: a conflict then opens a seam where they do not.
    for (h, &twin) in draft.pairing.twins.iter().enumerate() {
        if twin < CROWDED && (h as u32) < twin {
            sets.relate((h / 3) as u32, twin / 3, false);
        }
    }
    for crowd in draft.pairing.crowds() {
        if let [h, other] = *crowd {
            sets.relate(h / 3, other / 3, true);
        }
    }
    let mut votes = vec![0_i64; draft.triangles.len()];
    for t in 0..draft.triangles.len() as u32 {
        let (root, turned) = sets.find(t);
        votes[root as usize] += if turned { 1 } else { -1 };
    }
    let mut count = 0;
    for t in 0..draft.triangles.len() as u32 {
        let (root, turned) = sets.find(t);
        let turned_are_more = votes[root as usize] > 0;
        if turned != turned_are_more {
            draft.triangles[t as usize].swap(1, 2);
            count += 1;
        }
    }
    mended.flipped_triangles += count;
    if count > 0 {
        draft.pair();
    }
}

/// Sets of triangles, each turned against its set's root or not: union-find with parity.
struct Sets {
    /// The parent, and whether this one is turned against it.
    parents: Vec<(u32, bool)>,
    sizes: Vec<u32>,
}

impl Sets {
    fn new(count: usize) -> Sets {
        Sets { parents: (0..count as u32).map(|t| (t, false)).collect(), sizes: vec![1; count] }
    }

    /// The root, and whether the triangle is turned against it.
    fn find(&mut self, t: u32) -> (u32, bool) {
        let (mut at, mut turned) = (t, false);
        loop {
            let (parent, against) = self.parents[at as usize];
            if parent == at {
                return (at, turned);
            }
            // Halving the path as it goes: each points to its grandparent.
            let (grand, further) = self.parents[parent as usize];
            self.parents[at as usize] = (grand, against ^ further);
            turned ^= against ^ further;
            at = grand;
        }
    }

    /// Two triangles are turned against each other, or not; an earlier relation stands.
    fn relate(&mut self, a: u32, b: u32, turned: bool) {
        let ((a, ta), (b, tb)) = (self.find(a), self.find(b));
        if a == b {
            return;
        }
        let (small, large) = if self.sizes[a as usize] < self.sizes[b as usize] { (a, b) } else { (b, a) };
        self.parents[small as usize] = (large, ta ^ tb ^ turned);
        self.sizes[large as usize] += self.sizes[small as usize];
    }
}
