//! A mesh while it is mended.
//!
//! Takes vertices and triangles, keeps their neighbours up to date. Every mend
//! that changes triangles pairs all half-edges again: that is linear, happens a
//! few times at most, and leaves no half-changed state to get wrong.
use crate::mesh::twins::{CROWDED, Pairing, ends, pair};
use crate::mesh::vector::distance;
use crate::mesh::{OPEN, bounds};

/// Distance below which places are taken for the same where rims meet, in parts of
/// the mesh's diagonal: 0.2 µm for a part of 100 mm, twice the step of the slicing
/// grid, and as much as a text of six digits rounds by.
const TOLERANCE: f64 = 2e-6;

/// The same in steps of the largest coordinate's single-precision number, for
/// parts that lie far from the origin.
const TOLERANCE_STEPS: f64 = 4.0;

/// Vertices, triangles and neighbours.
pub(super) struct Draft {
    pub(super) vertices: Vec<[f64; 3]>,
    /// Corners are three different vertices.
    pub(super) triangles: Vec<[u32; 3]>,
    /// Of `triangles` as they are.
    pub(super) pairing: Pairing,
    /// Length of the diagonal of the bounds at the beginning, mm.
    pub(super) diagonal_mm: f64,
    /// Places nearer than this are the same where rims meet, mm.
    pub(super) tolerance_mm: f64,
}

impl Draft {
    pub(super) fn new(vertices: Vec<[f64; 3]>, triangles: Vec<[u32; 3]>) -> Draft {
        let [low, high] = bounds(&vertices);
        let diagonal_mm = if vertices.is_empty() { 0.0 } else { distance(low, high) };
        let largest = low.iter().chain(&high).fold(0.0_f64, |m, c| m.max(c.abs()));
        let step = largest * f64::from(f32::EPSILON);
        let tolerance_mm = (TOLERANCE * diagonal_mm).max(TOLERANCE_STEPS * step);
        let pairing = pair(&triangles, vertices.len());
        Draft { vertices, triangles, pairing, diagonal_mm, tolerance_mm }
    }

    /// Pairs all half-edges anew.
    pub(super) fn pair(&mut self) {
        self.pairing = pair(&self.triangles, self.vertices.len());
    }

    /// Whether any half-edge has no twin.
    pub(super) fn is_open(&self) -> bool {
        self.pairing.twins.iter().any(|&t| t >= CROWDED)
    }

    /// The places of a triangle's corners.
    pub(super) fn corners(&self, triangle: usize) -> [[f64; 3]; 3] {
        self.triangles[triangle].map(|v| self.vertices[v as usize])
    }

    /// Where a half-edge begins and ends.
    pub(super) fn ends(&self, h: u32) -> [u32; 2] {
        ends(&self.triangles, h)
    }

    /// Leaves out marked triangles; the pairing is stale afterwards.
    pub(super) fn drop_triangles(&mut self, dropped: &[bool]) {
        let mut number = 0;
        self.triangles.retain(|_| {
            number += 1;
            !dropped[number - 1]
        });
    }

    /// Leaves out vertices that no triangle has; triangles keep their numbers.
    pub(super) fn drop_unused_vertices(&mut self) {
        let mut numbers = vec![OPEN; self.vertices.len()];
        for &v in self.triangles.as_flattened() {
            numbers[v as usize] = 0;
        }
        if !numbers.contains(&OPEN) {
            return;
        }
        let mut used = 0;
        for (number, slot) in numbers.iter_mut().enumerate() {
            if *slot != OPEN {
                self.vertices[used as usize] = self.vertices[number];
                *slot = used;
                used += 1;
            }
        }
        self.vertices.truncate(used as usize);
        for v in self.triangles.as_flattened_mut() {
            *v = numbers[*v as usize];
        }
    }

    /// Makes what is still crowded open; gives the edges that have more than two
    /// triangles, and the half-edges without a twin.
    pub(super) fn close_pairing(&mut self) -> (u64, u64) {
        let crowded = self.pairing.crowds().filter(|c| c.len() > 2).count() as u64;
        let mut open = 0;
        for twin in &mut self.pairing.twins {
            if *twin >= CROWDED {
                *twin = OPEN;
                open += 1;
            }
        }
        (crowded, open)
    }
}
