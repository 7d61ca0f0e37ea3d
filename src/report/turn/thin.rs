//! A surface with fewer triangles: its vertices gathered in the cells of a grid.
//!
//! Takes and gives vertices and triangles. A cell's vertices become one at their mean;
//! triangles that lose a corner go (Rossignac and Borrel, "Multi-resolution 3D
//! approximations for rendering complex scenes", 1993). No place moves by more than the
//! diagonal of a cell.
use rustc_hash::{FxHashMap, FxHashSet};

/// Vertices, and triangles over them.
pub(super) type Surface = (Vec<[f64; 3]>, Vec<[u32; 3]>);

/// The surface with the vertices of each cell made one.
pub(super) fn gathered(vertices: &[[f64; 3]], triangles: &[[u32; 3]], cell_mm: f64) -> Surface {
    let mut by_cell: FxHashMap<[i64; 3], u32> = FxHashMap::default();
    let mut sums: Vec<([f64; 3], f64)> = Vec::new();
    let of: Vec<u32> = vertices
        .iter()
        .map(|v| {
            let cell = v.map(|c| (c / cell_mm).floor() as i64);
            // What is nowhere has no neighbours.
            let cell = if v.iter().all(|c| c.is_finite()) { cell } else { [i64::MAX; 3] };
            let k = *by_cell.entry(cell).or_insert(sums.len() as u32) as usize;
            if k == sums.len() {
                sums.push(([0.0; 3], 0.0));
            }
            let (sum, count) = &mut sums[k];
            (0..3).for_each(|c| sum[c] += v[c]);
            *count += 1.0;
            k as u32
        })
        .collect();
    let mut there = FxHashSet::default();
    let triangles = triangles
        .iter()
        .map(|t| t.map(|v| of[v as usize]))
        .filter(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0])
        .filter(|[a, b, c]| there.insert([[*a, *b, *c], [*b, *c, *a], [*c, *a, *b]].into_iter().min()))
        .collect();
    (sums.into_iter().map(|(sum, count)| sum.map(|c| c / count)).collect(), triangles)
}

/// A cell with which a surface should have about so many triangles, mm.
pub(super) fn cell_for(vertices: &[[f64; 3]], triangles: &[[u32; 3]], count: usize) -> f64 {
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| vertices[v as usize]);
        let [u, v] = [b, c].map(|p| [p[0] - a[0], p[1] - a[1], p[2] - a[2]]);
        let cross = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
        cross.iter().map(|c| c * c).sum::<f64>().sqrt() / 2.0
    };
    // A cell of the surface holds about two triangles, and a slanted one cuts more cells.
    (2.5 * triangles.iter().map(area).sum::<f64>() / count.max(1) as f64).sqrt().max(1e-6)
}
