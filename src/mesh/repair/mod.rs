//! Mending what real files have: from triangles to a mesh that can be sliced.
//!
//! Takes vertices and triangles as they were in the file, gives a [`Mesh`] and a
//! [`Mended`] that counts what was done and what is left. One mend a file; each
//! takes a [`Draft`] and is skipped where nothing asks for it. Bodies that cross
//! themselves or each other stay as they are: slicing unites them by winding.
//!
//! # Layout, in the order in which it happens
//! [`duplicate`] triangles · [`weld`] of rims that nearly meet · [`zero_area`] ·
//! [`t_junction`]s · [`flip`]ped triangles · [`around`] edges of many triangles ·
//! small [`hole`]s (with [`rim`]) · shells [`inside_out`].
mod around;
mod draft;
mod duplicate;
mod flip;
mod hole;
mod inside_out;
mod rays;
mod rim;
mod t_junction;
mod weld;
mod zero_area;

use super::Mesh;
use super::report::Mended;
use super::shells::Shells;
use draft::Draft;

/// Most rounds of splitting edges: each splits one edge of a triangle, and a piece
/// of it may have two more.
const SPLIT_ROUNDS: usize = 4;

/// Most open edges with which a mesh is taken for a body with cracks and holes: to look
/// for what fits them takes seconds. A file of more is a heap of loose triangles; it
/// stays open.
const RIM_MAX: u64 = 2_000_000;

/// Mends triangles whose corners are three different of the vertices, each at a
/// place of its own.
pub(super) fn mend(vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> (Mesh, Mended) {
    let mut mended = Mended::default();
    let mut draft = Draft::new(vertices, triangles);
    if draft.pairing.has_crowds() {
        duplicate::drop(&mut draft, &mut mended);
    }
    let few_open = draft.pairing.open <= RIM_MAX;
    if draft.pairing.open > 0 && few_open {
        close_rims(&mut draft, &mut mended);
    }
    if draft.pairing.has_crowds() {
        flip::agree(&mut draft, &mut mended);
        around::pair(&mut draft);
    }
    if few_open && draft.is_open() {
        hole::fill(&mut draft, &mut mended);
    }
    let shells = inside_out::turn(&mut draft, &mut mended);
    finish(draft, &shells, mended)
}

/// Joins rims that touch without sharing their vertices.
fn close_rims(draft: &mut Draft, mended: &mut Mended) {
    weld::weld(draft, mended);
    zero_area::peel(draft, mended);
    for _ in 0..SPLIT_ROUNDS {
        if draft.pairing.open == 0 || !t_junction::split(draft, mended) {
            break;
        }
    }
    if draft.pairing.has_crowds() {
        duplicate::drop(draft, mended);
    }
}

/// Leaves out vertices that no triangle has any more, and counts what is left.
fn finish(mut draft: Draft, shells: &Shells, mut mended: Mended) -> (Mesh, Mended) {
    draft.drop_unused_vertices();
    let (crowded_edges, open_edges) = draft.close_pairing();
    let twins = std::mem::take(&mut draft.pairing.twins);
    let mesh = Mesh { vertices: draft.vertices, triangles: draft.triangles, twins };
    mended.crowded_edges = crowded_edges;
    mended.open_edges = open_edges;
    mended.shells = shells.list.len() as u64;
    mended.cavities = shells.list.iter().filter(|s| s.open_edges == 0 && s.volume_mm3 < 0.0).count() as u64;
    mended.open_shells = shells.list.iter().filter(|s| s.open_edges > 0).count() as u64;
    mended.area_mm2 = shells.list.iter().map(|s| s.area_mm2).sum();
    let volume_mm3 = shells.list.iter().map(|s| s.volume_mm3).sum();
    mended.volume_mm3 = (open_edges == 0).then_some(volume_mm3);
    (mesh, mended)
}

#[cfg(test)]
mod tests;
