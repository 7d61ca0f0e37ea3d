//! Small holes, filled.
//!
//! Takes a draft with open edges, fills those of its rims that are small
//! with the triangles of least area between their vertices (Barequet and Sharir,
//! "Filling gaps in the boundary of a polyhedron", 1995, section 3). Large ones are
//! left: they may be meant, and a filling would be invented.
use super::around;
use super::draft::Draft;
use super::rim::Rims;
use crate::mesh::report::Mended;
use crate::mesh::shells::Shells;
use crate::mesh::vector::{area, distance};

/// Most edges of a rim that is filled: the search takes their cube.
const EDGES_MAX: usize = 64;

/// Longest rim that is filled, in parts of the mesh's diagonal.
const PERIMETER: f64 = 0.5;

/// Largest part of its shell's area that a filling may have: a cup's opening, a box's
/// lid and a bust's missing base have 5 % and more.
const AREA: f64 = 0.01;

/// Widest slit that is filled however long it is (its area by half its perimeter),
/// in parts of the diagonal: 10 µm for a part of 100 mm.
const SLIT_WIDTH: f64 = 1e-4;

/// Largest part of the whole mesh's area that a hole of three corners has when it is
/// filled: a triangle that went missing.
const TRIANGLE_AREA: f64 = 0.5;

/// Where a rim bends by less than the angle of this sine it has no corner: a neighbour
/// of the missing triangle was cut there.
const STRAIGHT: f64 = 1e-4;

/// Areas of triangles that are computed for all holes together: 1 s or so.
const AREAS_MAX: usize = 100_000_000;

/// Fills what is small.
pub(super) fn fill(draft: &mut Draft, mended: &mut Mended) {
    let shells = Shells::of(&draft.vertices, &draft.triangles, &draft.pairing.twins);
    let whole_mm2 = shells.list.iter().map(|s| s.area_mm2).sum();
    let mut areas = AREAS_MAX;
    let mut added = Vec::new();
    for rim in Rims::of(draft).iter() {
        if !(3..=EDGES_MAX).contains(&rim.len()) {
            continue;
        }
        let Some(left) = areas.checked_sub(rim.len().pow(3) / 6) else { break };
        areas = left;
        let area_mm2 = |&h: &u32| shells.list[shells.of[(h / 3) as usize] as usize].area_mm2;
        let shell_mm2 = rim.iter().map(area_mm2).fold(0.0, f64::max);
        let Some((triangles, filling_mm2)) = cover(draft, rim) else { continue };
        if is_small(draft, rim, filling_mm2, [shell_mm2, whole_mm2]) {
            mended.filled_holes += 1;
            mended.filling_triangles += triangles.len() as u64;
            added.extend(triangles);
        }
    }
    if !added.is_empty() {
        draft.triangles.extend(added);
        draft.pair();
        around::pair(draft);
    }
}

/// Whether a rim is a hole that nobody meant; the shell is the largest that it borders.
fn is_small(draft: &Draft, rim: &[u32], filling_mm2: f64, [shell_mm2, whole_mm2]: [f64; 2]) -> bool {
    let length = |&h: &u32| {
        let [a, b] = draft.ends(h).map(|v| draft.vertices[v as usize]);
        distance(a, b)
    };
    let perimeter: f64 = rim.iter().map(length).sum();
    let a_triangle = corners(draft, rim) == 3 && filling_mm2 <= TRIANGLE_AREA * whole_mm2;
    let a_slit = filling_mm2 <= SLIT_WIDTH * draft.diagonal_mm * perimeter / 2.0;
    let a_spot = perimeter <= PERIMETER * draft.diagonal_mm && filling_mm2 <= AREA * shell_mm2;
    a_triangle || a_slit || a_spot
}

/// How many corners a rim has.
fn corners(draft: &Draft, rim: &[u32]) -> usize {
    let at = |v: u32| draft.vertices[v as usize];
    let ways = rim.iter().zip(rim.iter().cycle().skip(1));
    ways.filter(|&(&h, &after)| {
        let ([a, b], [c, d]) = (draft.ends(h), draft.ends(after));
        // A rim's half-edges may follow each other at either end.
        let [from, corner, to] = if b == c { [a, b, d] } else { [b, a, c] }.map(at);
        2.0 * area(from, corner, to) > STRAIGHT * distance(from, corner) * distance(corner, to)
    })
    .count()
}

/// The triangles of least total area over a rim, facing as the surface does, and
/// that area; `None` where all would fold back onto a triangle that is there.
fn cover(draft: &Draft, rim: &[u32]) -> Option<(Vec<[u32; 3]>, f64)> {
    let count = rim.len();
    let vertices: Vec<u32> = rim.iter().map(|&h| draft.ends(h)[0]).collect();
    let place = |k: usize| draft.vertices[vertices[k] as usize];
    // least[i * count + j]: least area over the rim from vertex i to j, closed by a straight line; by way of which vertex.
    let mut least = vec![(0.0_f64, 0_usize); count * count];
    for span in 2..count {
        for i in 0..count - span {
            let j = i + span;
            let mut best = (f64::INFINITY, 0);
            for m in i + 1..j {
                let rest = least[i * count + m].0 + least[m * count + j].0;
                if rest < best.0 && !folds(rim, [i, m, j]) {
                    let total = rest + area(place(i), place(m), place(j));
                    if total < best.0 {
                        best = (total, m);
                    }
                }
            }
            least[i * count + j] = best;
        }
    }
    let total = least[count - 1].0;
    if !total.is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(count - 2);
    let mut stack = vec![(0, count - 1)];
    while let Some((i, j)) = stack.pop() {
        if j - i > 1 {
            let m = least[i * count + j].1;
            // The other way round than the rim, whose half-edges these are to meet.
            triangles.push([vertices[i], vertices[j], vertices[m]]);
            stack.extend([(i, m), (m, j)]);
        }
    }
    Some((triangles, total))
}

/// Whether a triangle between three vertices of a rim would lie back to back on one
/// that has two of its edges on the rim.
fn folds(rim: &[u32], [i, m, j]: [usize; 3]) -> bool {
    let same = |a: usize, b: usize| rim[a] / 3 == rim[b] / 3;
    let [first, second, third] = [m == i + 1, j == m + 1, i == 0 && j == rim.len() - 1];
    first && second && same(i, m) || second && third && same(m, j) || third && first && same(j, i)
}
