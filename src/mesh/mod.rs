//! Triangle meshes: read, mended, and placed for slicing.
//!
//! Takes the bytes of an STL file, gives a [`Mesh`] whose triangles share their
//! vertices and know their neighbours. Knows no layer and no file system.
//!
//! # Layout
//! - [`Mesh`]: vertices, triangles, neighbours

/// No half-edge runs the other way: the edge is on the rim of a hole.
pub const OPEN: u32 = u32::MAX;

/// An indexed triangle mesh in millimetres, z up.
///
/// Triangle `t` has the vertices `triangles[t]`, counter-clockwise seen from
/// outside. Half-edge `3 t + k` runs from its corner `k` to its corner
/// `(k + 1) % 3`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners, mm.
    pub vertices: Vec<[f64; 3]>,
    /// Three indices into `vertices` a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// For each half-edge the one that runs the other way along the same edge in
    /// the neighbour, or [`OPEN`]. `twins[twins[h]] == h`.
    pub twins: Vec<u32>,
}
