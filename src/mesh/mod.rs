//! Triangle meshes: read, mended, and placed for slicing.
//!
//! Takes the bytes of an STL file, gives a [`Mesh`] whose triangles share their
//! vertices and know their neighbours. Knows no layer and no file system.
//!
//! # Layout
//! - [`Mesh`]: vertices, triangles, neighbours
//! - [`stl`]: bytes → triangles; alone names the STL library
//! - `index`: triangles → shared vertices; `twins`: → neighbours; `shells`: → pieces
//! - `repair`: what real files have, mended, one mend a file; [`report`]: what was done
//! - [`place`]: turned, scaled, set down
mod index;
pub mod place;
mod plain_text;
mod repair;
pub mod report;
#[cfg(test)]
mod sample;
mod shells;
pub mod stl;
mod twins;
pub(crate) mod vector;

use index::Index;
use report::Report;
use std::io::{Read, Seek};
use vector::{cross, dot, sub};

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

/// Why there is no mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// The file cannot be read as STL.
    #[error(transparent)]
    Stl(#[from] stl::StlError),
    /// All triangles are lines or points.
    #[error(
        "all {triangles} triangles are lines or points, so there is nothing to print; export the model again"
    )]
    NoArea {
        /// Triangles in the file.
        triangles: u64,
    },
}

/// Reads a mesh from an STL file, binary or ASCII, and mends what can be mended.
///
/// Takes some 100 bytes a triangle while it works, and as many as the mesh has
/// afterwards. The same bytes give the same mesh.
///
/// # Errors
/// The file cannot be read, or holds nothing that has an area.
pub fn read(input: &mut (impl Read + Seek)) -> Result<(Mesh, Report), MeshError> {
    let mut index = Index::new();
    let source = stl::read(input, &mut index)?;
    let (vertices, triangles, degenerate) = index.into_parts();
    let (mesh, mut mended) = repair::mend(vertices, triangles);
    mended.degenerate_triangles += degenerate;
    if mended.area_mm2 > 0.0 {
        Ok((mesh, Report { source, mended }))
    } else {
        Err(MeshError::NoArea { triangles: source.triangles })
    }
}

/// Lowest and highest coordinates of some places; infinities the wrong way round without any.
fn bounds(places: &[[f64; 3]]) -> [[f64; 3]; 2] {
    let [mut low, mut high] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
    for v in places {
        for k in 0..3 {
            low[k] = low[k].min(v[k]);
            high[k] = high[k].max(v[k]);
        }
    }
    [low, high]
}

impl Mesh {
    /// Lowest and highest x, y and z, mm; infinities the wrong way round without vertices.
    #[must_use]
    pub fn bounds_mm(&self) -> [[f64; 3]; 2] {
        bounds(&self.vertices)
    }

    /// The places of a triangle's corners, mm.
    fn corners(&self, corners: &[u32; 3]) -> [[f64; 3]; 3] {
        corners.map(|v| self.vertices[v as usize])
    }

    /// Volume, mm³: positive when the surface faces outward. Bodies that overlap
    /// count twice; without meaning where the mesh is open.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        let Some(&origin) = self.vertices.first() else { return 0.0 };
        let six = |t| {
            let [a, b, c] = self.corners(t);
            dot(sub(a, origin), cross(sub(b, a), sub(c, a)))
        };
        self.triangles.iter().map(six).sum::<f64>() / 6.0
    }

    /// Area of all triangles, mm².
    #[must_use]
    pub fn area_mm2(&self) -> f64 {
        let area = |t| {
            let [a, b, c] = self.corners(t);
            vector::area(a, b, c)
        };
        self.triangles.iter().map(area).sum()
    }
}
