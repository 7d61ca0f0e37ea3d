//! The outside of what a job prints, where there is no mesh of it: as triangles to look at.
//!
//! Takes the space that was drawn of a job, gives a closed surface. Voids that nothing outside
//! leads to, as sparse infill leaves, are not shown. Dual surface nets (Gibson, "Constrained
//! elastic surface nets", 1998): a corner in each cube of eight cells of which some are inside
//! and some are not, moved towards its neighbours within the cube. Details smaller than a cell
//! may be missing: nothing is planned by this surface.
use crate::layers::shape::Bounds;
use crate::support::clearance::Clearance;
use rustc_hash::FxHashMap;

/// Cells at most: some 160 each way, and a byte each.
const CELLS_MAX: f64 = 4e6;

/// Rounds of moving corners.
const ROUNDS: u32 = 3;

/// How far a corner is moved from where it began, cells.
const MOVED_MAX: f64 = 0.5;

/// A surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Hull {
    /// Corners, mm.
    pub vertices: Vec<[f64; 3]>,
    /// Three indices into `vertices` each, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// The outside of what was drawn within bounds along the plate: those of the part leave out
/// purge lines, and skirts beside it.
#[must_use]
pub fn hull(space: &Clearance, within: Bounds) -> Hull {
    let cells = Cells::of(space, within);
    let (mut vertices, quads) = cells.net();
    smooth(&mut vertices, &quads);
    let to_mm = |at: &[f64; 3]| [0, 1, 2].map(|k| cells.origin_mm[k] + at[k] * cells.step_mm[k]);
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    Hull {
        vertices: vertices.iter().map(to_mm).collect(),
        triangles: quads.into_iter().flat_map(halves).collect(),
    }
}

/// Cells that are inside, with a cell of air on each side.
struct Cells {
    size: [usize; 3],
    /// Middle of the first cell, mm.
    origin_mm: [f64; 3],
    step_mm: [f64; 3],
    inside: Vec<bool>,
}

impl Cells {
    fn of(space: &Clearance, within: Bounds) -> Cells {
        let [mut low, mut high] = space.bounds_mm();
        let [from, to] = within.mm();
        for k in 0..2 {
            (low[k], high[k]) = (low[k].max(from[k]), high[k].min(to[k]));
        }
        let wide = [0, 1, 2].map(|k| (high[k] - low[k]).max(0.0));
        let finest = [space.cell_mm(), space.cell_mm(), space.slab_mm()];
        let count: f64 = (0..3).map(|k| wide[k] / finest[k] + 2.0).product();
        let coarser = (count / CELLS_MAX).cbrt().max(1.0);
        let step_mm = finest.map(|mm| mm * coarser);
        let size = [0, 1, 2].map(|k| (wide[k] / step_mm[k]).ceil() as usize + 2);
        let origin_mm = [0, 1, 2].map(|k| low[k] - step_mm[k] / 2.0);
        let mut cells = Cells { size, origin_mm, step_mm, inside: Vec::new() };
        cells.inside = vec![true; size.iter().product()];
        cells.let_air_in(|at| space.is_part(at));
        cells
    }

    fn index(&self, [x, y, z]: [usize; 3]) -> usize {
        (z * self.size[1] + y) * self.size[0] + x
    }

    /// Marks what is not printed and can be reached from the first cell.
    fn let_air_in(&mut self, is_printed: impl Fn([f64; 3]) -> bool) {
        let mut todo = vec![[0_usize; 3]];
        self.inside[0] = false;
        while let Some(cell) = todo.pop() {
            for (axis, forth) in [(0, true), (0, false), (1, true), (1, false), (2, true), (2, false)] {
                let mut next = cell;
                next[axis] = if forth { cell[axis] + 1 } else { cell[axis].wrapping_sub(1) };
                if next[axis] >= self.size[axis] || !self.inside[self.index(next)] {
                    continue;
                }
                let at = [0, 1, 2].map(|k| self.origin_mm[k] + next[k] as f64 * self.step_mm[k]);
                // What was cut off at the bounds has air beside it.
                let is_border = (0..3).any(|k| next[k] == 0 || next[k] + 1 == self.size[k]);
                if is_border || !is_printed(at) {
                    let index = self.index(next);
                    self.inside[index] = false;
                    todo.push(next);
                }
            }
        }
    }

    /// Corners in steps of cells, and the four around each face between inside and outside.
    fn net(&self) -> (Vec<[f64; 3]>, Vec<[u32; 4]>) {
        let (mut vertices, mut quads) = (Vec::new(), Vec::new());
        let mut numbers: FxHashMap<usize, u32> = FxHashMap::default();
        for z in 0..self.size[2] {
            for y in 0..self.size[1] {
                for x in 0..self.size[0] {
                    let cell = [x, y, z];
                    let own = self.inside[self.index(cell)];
                    for axis in 0..3 {
                        let mut next = cell;
                        next[axis] += 1;
                        if next[axis] == self.size[axis] || self.inside[self.index(next)] == own {
                            continue;
                        }
                        // The cubes around, counter-clockwise seen along the axis. The air on
                        // all sides keeps them in the grid.
                        let [a, b] = [(axis + 1) % 3, (axis + 2) % 3];
                        let around = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|back: [usize; 2]| {
                            let mut cube = cell;
                            cube[a] -= back[0];
                            cube[b] -= back[1];
                            *numbers.entry(self.index(cube)).or_insert_with(|| {
                                vertices.push(self.corner(cube));
                                vertices.len() as u32 - 1
                            })
                        });
                        quads.push(if own { around } else { [around[3], around[2], around[1], around[0]] });
                    }
                }
            }
        }
        (vertices, quads)
    }

    /// The middle of where a cube's edges lead from inside to outside.
    fn corner(&self, cube: [usize; 3]) -> [f64; 3] {
        let is_inside =
            |k: usize| self.inside[self.index([0, 1, 2].map(|axis| cube[axis] + (k >> axis & 1)))];
        let place = |k: usize| [0, 1, 2].map(|axis| (cube[axis] + (k >> axis & 1)) as f64);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for from in 0..8 {
            for to in [from | 1, from | 2, from | 4] {
                if to != from && is_inside(from) != is_inside(to) {
                    let (p, q) = (place(from), place(to));
                    sum = [0, 1, 2].map(|k| sum[k] + (p[k] + q[k]) / 2.0);
                    count += 1.0;
                }
            }
        }
        sum.map(|c| c / count)
    }
}

/// Moves corners to the middle of their neighbours.
fn smooth(vertices: &mut [[f64; 3]], quads: &[[u32; 4]]) {
    let first = vertices.to_vec();
    for _ in 0..ROUNDS {
        let mut sums = vec![([0.0; 3], 0.0); vertices.len()];
        for quad in quads {
            for k in 0..4 {
                let [from, to] = [quad[k] as usize, quad[(k + 1) % 4] as usize];
                let sum = &mut sums[from];
                *sum = ([0, 1, 2].map(|c| sum.0[c] + vertices[to][c]), sum.1 + 1.0);
            }
        }
        for ((vertex, first), (sum, count)) in vertices.iter_mut().zip(&first).zip(sums) {
            if count > 0.0 {
                let middle = |k: usize| (sum[k] / count).clamp(first[k] - MOVED_MAX, first[k] + MOVED_MAX);
                *vertex = [0, 1, 2].map(middle);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::{Point, Region};
    use crate::layers::stack::Layer;
    use crate::support::clearance::Drawing;
    use crate::support::testing::{layers, region};
    use std::collections::HashMap;

    fn hull_of(height_mm: f64, part: impl Fn(f64) -> Region) -> Hull {
        let layers = layers((height_mm / 0.2).round() as u32, 0.2, part);
        let bounds = layers.iter().fold(Bounds::EMPTY, |b, l| b.joined(l.part.bounds()));
        let mut drawing = Drawing::new(bounds, height_mm, &Region::default());
        drawing.add(&layers);
        hull(&drawing.finish(), bounds)
    }

    /// The volume, mm³, and whether each edge is met once each way.
    fn measured(hull: &Hull) -> (f64, bool) {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        let mut volume = 0.0;
        for t in &hull.triangles {
            let [a, b, c] = t.map(|k| hull.vertices[k as usize]);
            volume += a[0] * (b[1] * c[2] - b[2] * c[1])
                + a[1] * (b[2] * c[0] - b[0] * c[2])
                + a[2] * (b[0] * c[1] - b[1] * c[0]);
            (0..3).for_each(|k| *edges.entry((t[k], t[(k + 1) % 3])).or_default() += 1);
        }
        (volume / 6.0, edges.iter().all(|((a, b), n)| edges.get(&(*b, *a)) == Some(n)))
    }

    #[test]
    fn it_is_closed_and_of_the_parts_volume() {
        let table = |z: f64| region(&[if z < 6.0 { [4.0, 4.0, 8.0, 8.0] } else { [0.0, 0.0, 12.0, 12.0] }]);
        let (volume, closed) = measured(&hull_of(9.0, table));
        let expect = 6.0 * 16.0 + 3.0 * 144.0;
        assert!(closed && (volume / expect - 1.0).abs() < 0.1, "{volume} mm³, not {expect}");
        let hull = hull_of(9.0, table);
        for k in 0..3 {
            let reach = |of: fn(f64, f64) -> f64, from| hull.vertices.iter().map(|v| v[k]).fold(from, of);
            let (low, high) = (reach(f64::min, 99.0), reach(f64::max, -99.0));
            let top = if k == 2 { 9.0 } else { 12.0 };
            assert!(low.abs() < 0.3 && (high - top).abs() < 0.3, "axis {k}: {low} to {high}");
        }
    }

    #[test]
    fn what_lies_outside_of_the_bounds_is_left_out() {
        let both = |_: f64| region(&[[0.0, 0.0, 5.0, 5.0], [30.0, 0.0, 31.0, 50.0]]);
        let layers = [Layer { top_mm: 4.0, part: both(0.0), ..Layer::default() }];
        let mut drawing = Drawing::new(layers[0].part.bounds(), 4.0, &Region::default());
        drawing.add(&layers);
        let space = drawing.finish();
        let first = Bounds { min: Point::default(), max: Point::from_mm(5.0, 5.0) };
        let (volume, closed) = measured(&hull(&space, first));
        assert!(closed && (volume / 100.0 - 1.0).abs() < 0.15, "{volume}");
        assert!(measured(&hull(&space, layers[0].part.bounds())).0 > 250.0);
        assert_eq!(hull(&space, Bounds::EMPTY), Hull::default());
    }

    #[test]
    fn what_is_enclosed_is_not_shown() {
        // Walls of 1 mm around nothing, closed and with a hole in the roof.
        let walls =
            [[0.0, 0.0, 12.0, 1.0], [0.0, 11.0, 12.0, 12.0], [0.0, 0.0, 1.0, 12.0], [11.0, 0.0, 12.0, 12.0]];
        let roof = [[0.0, 0.0, 12.0, 5.0], [0.0, 7.0, 12.0, 12.0]];
        let floor = [[0.0, 0.0, 12.0, 12.0]];
        let room = |z: f64, roof: &[[f64; 4]]| match z {
            z if z < 1.0 => region(&floor),
            z if z < 9.0 => region(&walls),
            _ => region(roof),
        };
        let (closed, open) = (hull_of(10.0, |z| room(z, &floor)), hull_of(10.0, |z| room(z, &roof)));
        let (volume, sound) = measured(&closed);
        assert!(sound && (volume / 1440.0 - 1.0).abs() < 0.05, "{volume}");
        assert!(open.triangles.len() as f64 > 1.5 * closed.triangles.len() as f64);
        assert_eq!(hull_of(0.2, |_| Region::default()), Hull::default());
    }
}
