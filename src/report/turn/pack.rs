//! The shapes of a turning page as bytes.
//!
//! Places are on a grid of 16 bits over the bounds of all that is shown. All numbers are
//! varints as in [`super::super::survey::pack`]; `web/viewer/README.md` has the format.
use super::super::embed::{deflated, put, put_signed};
use super::thin::{cell_for, gathered};
use crate::support::demand::Need;
use crate::support::tree::{Forest, Kind};
use rustc_hash::FxHashMap;
use serde::Serialize;

/// Most of a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Most {
    /// Triangles.
    pub(super) triangles: usize,
    /// Bytes of them, compressed.
    pub(super) bytes: usize,
}

/// With all the rest as much as leaves the page below some 8 MB.
pub(super) const MOST: Most = Most { triangles: 400_000, bytes: 7 << 19 };

/// Most places of what must be held.
pub(super) const NEEDS_MAX: usize = 60_000;

/// Coordinates at most, in steps of the grid.
const STEPS: f64 = 65535.0;

/// Unit of areas, mm².
const AREA_MM2: f64 = 1e-4;

/// How much of something the page holds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Kept {
    /// So many.
    pub(super) count: usize,
    /// Of so many.
    pub(super) of: usize,
    /// Gathered in cells of this size, mm; 0 where nothing was.
    pub(super) cell_mm: f64,
}

/// The grid of a page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// The place of (0, 0, 0), mm.
    pub(super) origin_mm: [f64; 3],
    /// Its step, mm.
    pub(super) step_mm: f64,
    high_mm: [f64; 3],
}

impl Grid {
    /// The finest that holds some places; those that are not finite do not count.
    pub(super) fn around(places: impl Iterator<Item = [f64; 3]>) -> Grid {
        let [mut low, mut high] = [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]];
        for at in places.filter(|at| at.iter().all(|c| c.is_finite())) {
            for k in 0..3 {
                low[k] = low[k].min(at[k]);
                high[k] = high[k].max(at[k]);
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 3], [1.0; 3]);
        }
        let longest = (0..3).map(|k| high[k] - low[k]).fold(1e-3, f64::max);
        Grid { origin_mm: low, step_mm: longest / STEPS, high_mm: high }
    }

    /// What it was made around, mm.
    pub(super) fn bounds_mm(&self) -> [[f64; 3]; 2] {
        [self.origin_mm, self.high_mm]
    }

    fn steps(&self, length_mm: f64) -> i64 {
        (length_mm / self.step_mm).round().clamp(0.0, STEPS) as i64
    }

    fn on(&self, at_mm: [f64; 3]) -> [i64; 3] {
        [0, 1, 2].map(|k| self.steps(at_mm[k] - self.origin_mm[k]))
    }
}

/// Writes places as steps from the last one.
struct Pen<'a> {
    grid: &'a Grid,
    last: [i64; 3],
}

impl<'a> Pen<'a> {
    fn new(grid: &'a Grid) -> Pen<'a> {
        Pen { grid, last: [0; 3] }
    }

    fn place(&mut self, out: &mut Vec<u8>, at_mm: [f64; 3]) {
        let at = self.grid.on(at_mm);
        (0..3).for_each(|k| put_signed(out, at[k] - self.last[k]));
        self.last = at;
    }
}

/// The part's triangles, fewer where they are too many. Triangles with a corner that is
/// not there, or is nowhere, are left out.
pub(super) fn part(
    grid: &Grid,
    vertices: &[[f64; 3]],
    triangles: &[[u32; 3]],
    most: Most,
) -> std::io::Result<(Vec<u8>, Kept)> {
    let is_place = |v: &u32| vertices.get(*v as usize).is_some_and(|v| v.iter().all(|c| c.is_finite()));
    let sound: Vec<[u32; 3]> = triangles.iter().filter(|t| t.iter().all(is_place)).copied().collect();
    let of = triangles.len();
    let mut count = sound.len();
    let mut cell_mm = 0.0_f64;
    let mut packed = Vec::new();
    if count <= most.triangles {
        packed = surface(grid, vertices, &sound);
    }
    // Ends: cells grow until all vertices are in a few of them.
    while count > most.triangles || (packed.len() > most.bytes && deflated(&packed)?.len() > most.bytes) {
        cell_mm = (cell_mm * 1.25).max(cell_for(vertices, &sound, most.triangles));
        let (vertices, triangles) = gathered(vertices, &sound, cell_mm);
        count = triangles.len();
        if count <= most.triangles {
            packed = surface(grid, &vertices, &triangles);
        }
    }
    Ok((packed, Kept { count, of, cell_mm }))
}

fn surface(grid: &Grid, vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Vec<u8> {
    let mut out = Vec::with_capacity(triangles.len() * 8);
    let mut pen = Pen::new(grid);
    let mut number = vec![u32::MAX; vertices.len()];
    let mut seen = 0;
    put(&mut out, triangles.len() as u64);
    for corner in triangles.iter().flatten() {
        let of = &mut number[*corner as usize];
        if *of == u32::MAX {
            *of = seen;
            seen += 1;
            put(&mut out, 0);
            pen.place(&mut out, vertices[*corner as usize]);
        } else {
            put(&mut out, u64::from(seen - *of));
        }
    }
    out
}

/// Appends what must be held, places gathered where they are too many.
pub(super) fn needs(out: &mut Vec<u8>, grid: &Grid, needs: &[Need]) -> Kept {
    let of = needs.len();
    let (mut cell_mm, mut gathered) = (0.0_f64, needs.to_vec());
    while gathered.len() > NEEDS_MAX {
        cell_mm = (cell_mm * 1.5).max(grid.step_mm * 64.0);
        let mut place: FxHashMap<([i64; 3], bool), usize> = FxHashMap::default();
        let mut fewer: Vec<Need> = Vec::new();
        for need in gathered {
            let cell = (need.at_mm.map(|c| (c / cell_mm).floor() as i64), need.island);
            match place.get(&cell) {
                Some(k) => fewer[*k].area_mm2 += need.area_mm2,
                None => {
                    place.insert(cell, fewer.len());
                    fewer.push(need);
                }
            }
        }
        gathered = fewer;
    }
    let mut pen = Pen::new(grid);
    put(out, gathered.len() as u64);
    for need in &gathered {
        pen.place(out, need.at_mm);
        let area = (need.area_mm2 / AREA_MM2).round().clamp(0.0, 1e12) as u64;
        put(out, area << 1 | u64::from(need.island));
    }
    Kept { count: gathered.len(), of, cell_mm }
}

/// Appends a forest, of which the first `most` nodes; gives how many.
pub(super) fn forest(out: &mut Vec<u8>, grid: &Grid, forest: &Forest, most: usize) -> usize {
    let nodes = &forest.nodes[..forest.nodes.len().min(most)];
    let mut pen = Pen::new(grid);
    put(out, nodes.len() as u64);
    for (k, node) in nodes.iter().enumerate() {
        put(
            out,
            match node.kind {
                Kind::Tip => 0,
                Kind::Joint => 1,
                Kind::Plate => 2,
                Kind::Model => 3,
            },
        );
        pen.place(out, node.at_mm);
        put(out, grid.steps(node.radius_mm) as u64);
        // A node that is not there: none below.
        let down = if (node.down as usize) < nodes.len() { i64::from(node.down) - k as i64 } else { 0 };
        put_signed(out, down);
    }
    nodes.len()
}
