//! Vertices that lie on a neighbour's edge (T-junctions).
//!
//! Takes a draft with open edges, splits such an edge at the vertices of other open
//! edges that lie on it, so that both sides have the same edges. Nothing moves: the
//! surface changes by less than the tolerance.
use super::draft::Draft;
use crate::mesh::report::Mended;
use crate::mesh::vector::{distance, dot, sub};
use crate::mesh::{bounds, twins};

/// Steps of search for each open edge, on average: several times what seams of real
/// files take. A file made to take more keeps its T-junctions.
const STEPS_PER_EDGE: usize = 64;

/// Steps for all edges: a few seconds at most.
const STEPS_MIN_MAX: [usize; 2] = [1_000_000, 50_000_000];

/// Most cells along a side of the mesh's diagonal.
const CELLS_MAX: f64 = 1024.0;

/// Splits open edges, at most one of each triangle; false if there was none to split.
pub(super) fn split(draft: &mut Draft, mended: &mut Mended) -> bool {
    let rim = draft.pairing.rim();
    let grid = Grid::new(draft, &rim);
    let [least, most] = STEPS_MIN_MAX;
    let mut steps = (STEPS_PER_EDGE * rim.len()).clamp(least, most);
    let mut used = vec![false; draft.triangles.len()];
    let mut on_edge = Vec::new();
    let mut splits = 0;
    for &h in &rim {
        let t = (h / 3) as usize;
        if used[t] {
            continue;
        }
        if !grid.vertices_on(draft, h, &mut steps, &mut on_edge) {
            break;
        }
        if !on_edge.is_empty() {
            used[t] = true;
            splits += on_edge.len() as u64;
            fan(draft, h, &on_edge);
        }
    }
    mended.split_edges += splits;
    if splits > 0 {
        draft.pair();
    }
    splits > 0
}

/// Cuts a triangle from the corner opposite a half-edge to vertices along it.
fn fan(draft: &mut Draft, h: u32, along: &[(f64, u32)]) {
    let [from, to] = draft.ends(h);
    let apex = twins::apex(&draft.triangles, h);
    let mut at = from;
    for (k, end) in along.iter().map(|&(_, v)| v).chain([to]).enumerate() {
        let piece = [at, end, apex];
        if k == 0 {
            draft.triangles[(h / 3) as usize] = piece;
        } else {
            draft.triangles.push(piece);
        }
        at = end;
    }
}

/// Vertices of open edges by cell.
struct Grid {
    low: [f64; 3],
    side: f64,
    /// Key of the cell and the vertex, sorted. A vertex stands in every cell that it
    /// is nearer to than the tolerance.
    entries: Vec<(u64, u32)>,
}

impl Grid {
    fn new(draft: &Draft, rim: &[u32]) -> Grid {
        let length = |&h: &u32| {
            let [a, b] = draft.ends(h).map(|v| draft.vertices[v as usize]);
            distance(a, b)
        };
        let mean = rim.iter().map(length).sum::<f64>() / rim.len().max(1) as f64;
        let side =
            mean.max(draft.diagonal_mm / CELLS_MAX).max(4.0 * draft.tolerance_mm).max(f64::MIN_POSITIVE);
        let margin = side + draft.tolerance_mm;
        let mut grid =
            Grid { low: bounds(&draft.vertices)[0].map(|c| c - margin), side, entries: Vec::new() };
        let mut vertices: Vec<u32> = rim.iter().flat_map(|&h| draft.ends(h)).collect();
        vertices.sort_unstable();
        vertices.dedup();
        for v in vertices {
            let place = draft.vertices[v as usize];
            let low = grid.cell(place.map(|c| c - draft.tolerance_mm));
            let high = grid.cell(place.map(|c| c + draft.tolerance_mm));
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    for z in low[2]..=high[2] {
                        grid.entries.push((key([x, y, z]), v));
                    }
                }
            }
        }
        grid.entries.sort_unstable();
        grid
    }

    fn cell(&self, place: [f64; 3]) -> [u64; 3] {
        [0, 1, 2].map(|k| ((place[k] - self.low[k]) / self.side).max(0.0) as u64)
    }

    fn in_cell(&self, cell: [u64; 3]) -> &[(u64, u32)] {
        let key = key(cell);
        let start = self.entries.partition_point(|e| e.0 < key);
        let rest = &self.entries[start..];
        &rest[..rest.iter().take_while(|e| e.0 == key).count()]
    }

    /// Finds the vertices on a half-edge in order, each with its distance from the
    /// beginning; false when the steps are used up.
    fn vertices_on(&self, draft: &Draft, h: u32, steps: &mut usize, found: &mut Vec<(f64, u32)>) -> bool {
        found.clear();
        let edge = draft.ends(h);
        let apex = twins::apex(&draft.triangles, h);
        let [from, to] = edge.map(|v| draft.vertices[v as usize]);
        let (along, whole) = (sub(to, from), distance(from, to));
        let main = (0..3).max_by(|&a, &b| along[a].abs().total_cmp(&along[b].abs())).unwrap_or(0);
        let ends = [self.cell(from), self.cell(to)];
        for slab in ends[0][main].min(ends[1][main])..=ends[0][main].max(ends[1][main]) {
            // Where the edge enters and leaves the slab of cells across its main direction.
            let at = |plane: u64| {
                let c = self.low[main] + plane as f64 * self.side;
                ((c - from[main]) / along[main]).clamp(0.0, 1.0)
            };
            let cells =
                [at(slab), at(slab + 1)].map(|t| self.cell([0, 1, 2].map(|k| from[k] + t * along[k])));
            let (p, q) = ((main + 1) % 3, (main + 2) % 3);
            for i in cells[0][p].min(cells[1][p])..=cells[0][p].max(cells[1][p]) {
                for j in cells[0][q].min(cells[1][q])..=cells[0][q].max(cells[1][q]) {
                    let mut cell = [slab; 3];
                    (cell[p], cell[q]) = (i, j);
                    let here = self.in_cell(cell);
                    let Some(left) = steps.checked_sub(here.len() + 1) else { return false };
                    *steps = left;
                    for &(_, v) in here.iter().filter(|e| !edge.contains(&e.1) && e.1 != apex) {
                        let offset = sub(draft.vertices[v as usize], from);
                        let t = dot(offset, along) / whole;
                        let foot = [0, 1, 2].map(|k| along[k] / whole * t);
                        let within = t > draft.tolerance_mm && t < whole - draft.tolerance_mm;
                        if within && distance(offset, foot) <= draft.tolerance_mm {
                            found.push((t, v));
                        }
                    }
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.dedup();
        true
    }
}

/// A cell's number; cells are fewer than 2^21 a side.
fn key(cell: [u64; 3]) -> u64 {
    debug_assert!(cell.iter().all(|&c| c < 1 << 21));
    cell[0] << 42 | cell[1] << 21 | cell[2]
}
