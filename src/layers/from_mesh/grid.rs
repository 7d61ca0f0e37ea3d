//! A mesh on the integer grid, each vertex with the planes that it is above of.
//!
//! Takes a [`Mesh`], gives corners in grid steps. After this, whether a vertex is below a plane is a
//! comparison of small integers: exact, and the same for all triangles around it.
use super::SliceError;
use crate::layers::shape::{MAX_COORDINATE, UNITS_PER_MM};
use crate::mesh::{Mesh, OPEN};
use rayon::prelude::*;

/// A vertex of the mesh in grid steps.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Corner {
    pub(super) x: i32,
    pub(super) y: i32,
    pub(super) z: i32,
    /// How many planes are strictly below it: it is below plane `p`, or on it, where
    /// `p >= level`. On the plane counts as below: the plane lies, so to speak, an
    /// infinitely small step higher, where no vertex is.
    pub(super) level: u32,
}

/// Vertices on the grid, levels not yet known.
pub(super) fn corners(mesh: &Mesh) -> Result<Vec<Corner>, SliceError> {
    let limit_mm = f64::from(MAX_COORDINATE) / UNITS_PER_MM;
    let corner = |(vertex, at): (usize, &[f64; 3])| {
        if let Some(&mm) = at.iter().find(|c| !(-limit_mm..=limit_mm).contains(*c)) {
            return Err(SliceError::Coordinate { vertex, mm });
        }
        let [x, y, z] = at.map(|c| (c * UNITS_PER_MM).round() as i32);
        Ok(Corner { x, y, z, level: 0 })
    };
    mesh.vertices.par_iter().enumerate().map(corner).collect()
}

/// Tells each corner how many planes are strictly below it.
pub(super) fn set_levels(corners: &mut [Corner], planes: &[i32]) {
    let count = planes.len();
    // But for the first, planes are mostly evenly spaced: a guess is right or next to it.
    let (first, last) = (f64::from(planes[1.min(count - 1)]), f64::from(planes[count - 1]));
    let spacing = ((last - first) / (count.max(3) - 2) as f64).max(1.0);
    corners.par_iter_mut().for_each(|corner| {
        let z = corner.z;
        let guess = ((1.0 + (f64::from(z) - first) / spacing).max(0.0) as usize).min(count);
        let is_level = |level: &usize| {
            *level <= count
                && (*level == 0 || planes[level - 1] < z)
                && planes.get(*level).is_none_or(|p| *p >= z)
        };
        let near = [guess, guess + 1, guess.saturating_sub(1)].into_iter().find(is_level);
        corner.level = near.unwrap_or_else(|| planes.partition_point(|p| *p < z)) as u32;
    });
}

/// Checks that triangles name vertices that exist, and that twins are each other's
/// and run along the same two vertices in opposite directions: the walk relies on it.
pub(super) fn check(mesh: &Mesh) -> Result<(), SliceError> {
    let (triangles, twins) = (&mesh.triangles, &mesh.twins);
    if triangles.is_empty() {
        return Err(SliceError::Empty);
    }
    let too_many = triangles.len() > OPEN as usize / 3 || twins.len() != 3 * triangles.len();
    let vertices = mesh.vertices.len() as u64;
    let fits = |t: usize| {
        let corners = triangles[t];
        corners.iter().all(|&v| u64::from(v) < vertices)
            && (0..3).all(|k| match twins[3 * t + k] {
                OPEN => true,
                twin => {
                    let (other, j) = (twin as usize / 3, twin as usize % 3);
                    triangles.get(other).is_some_and(|o| {
                        twins[twin as usize] as usize == 3 * t + k
                            && (o[j], o[(j + 1) % 3]) == (corners[(k + 1) % 3], corners[k])
                    })
                }
            })
    };
    if too_many {
        return Err(SliceError::Mesh { triangle: triangles.len() });
    }
    match (0..triangles.len()).into_par_iter().find_first(|&t| !fits(t)) {
        Some(triangle) => Err(SliceError::Mesh { triangle }),
        None => Ok(()),
    }
}

/// The planes that cross each triangle: from the first to the one past the last.
pub(super) fn spans(corners: &[Corner], triangles: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let span = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| corners[v as usize].level);
        [a.min(b).min(c), a.max(b).max(c)]
    };
    triangles.par_iter().map(span).collect()
}

/// The lowest and the highest z of all triangles, grid steps: vertices that no
/// triangle uses do not count.
pub(super) fn reach(corners: &[Corner], triangles: &[[u32; 3]]) -> [i32; 2] {
    let of = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|v| corners[v as usize].z);
        [a.min(b).min(c), a.max(b).max(c)]
    };
    triangles.par_iter().map(of).reduce(|| [i32::MAX, i32::MIN], |a, b| [a[0].min(b[0]), a[1].max(b[1])])
}
