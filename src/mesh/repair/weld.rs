//! Rims that nearly meet, joined.
//!
//! Takes a draft with open edges, makes vertices of them one that are nearer to
//! each other than the tolerance. Vertices inside a surface stay as they are, so
//! that no fine detail is lost.
use super::draft::Draft;
use crate::mesh::report::Mended;
use crate::mesh::vector::distance;
use std::collections::HashMap;

/// No further vertex in the cell.
const NONE: u32 = u32::MAX;

/// Joins vertices of open edges; each goes to the first within the tolerance.
pub(super) fn weld(draft: &mut Draft, mended: &mut Mended) {
    let mut rim: Vec<u32> = draft.pairing.rim().into_iter().flat_map(|h| draft.ends(h)).collect();
    rim.sort_unstable();
    rim.dedup();
    let Some(targets) = targets(draft, &rim, mended) else { return };
    for v in draft.triangles.as_flattened_mut() {
        *v = targets[*v as usize];
    }
    let collapsed: Vec<bool> = draft.triangles.iter().map(|[a, b, c]| a == b || b == c || c == a).collect();
    mended.degenerate_triangles += collapsed.iter().filter(|&&c| c).count() as u64;
    draft.drop_triangles(&collapsed);
    draft.pair();
}

/// For every vertex the one that it becomes; `None` where all stay.
///
/// The kept vertices are farther from each other than the tolerance, so that a cell
/// of twice its size holds a few dozen at most: linear in time, whatever the file.
fn targets(draft: &Draft, rim: &[u32], mended: &mut Mended) -> Option<Vec<u32>> {
    let side = 2.0 * draft.tolerance_mm;
    let cell = |c: f64| (c / side).floor() as i64;
    let mut first: HashMap<[i64; 3], u32> = HashMap::with_capacity(rim.len());
    let mut following = vec![NONE; rim.len()];
    let mut targets: Vec<u32> = (0..draft.vertices.len() as u32).collect();
    let mut welded = 0;
    for (k, &v) in rim.iter().enumerate() {
        let place = draft.vertices[v as usize];
        let low = place.map(|c| cell(c - draft.tolerance_mm));
        let high = place.map(|c| cell(c + draft.tolerance_mm));
        let near = (low[0]..=high[0])
            .flat_map(|x| (low[1]..=high[1]).map(move |y| [x, y]))
            .flat_map(|[x, y]| (low[2]..=high[2]).map(move |z| [x, y, z]))
            .filter_map(|key| first.get(&key))
            .find_map(|&head| {
                let chain = std::iter::successors(Some(head), |&j| {
                    Some(following[j as usize]).filter(|&n| n != NONE)
                });
                chain
                    .map(|j| rim[j as usize])
                    .find(|&w| distance(draft.vertices[w as usize], place) <= draft.tolerance_mm)
            });
        match near {
            Some(kept) => {
                targets[v as usize] = kept;
                welded += 1;
            }
            None => {
                following[k] = first.insert(place.map(cell), k as u32).unwrap_or(NONE);
            }
        }
    }
    mended.welded_vertices += welded;
    (welded > 0).then_some(targets)
}
