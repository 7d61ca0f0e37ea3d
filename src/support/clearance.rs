//! Where branches may go: the space around a part. From where the plate is reached is told by
//! [`reach`].
//!
//! Takes layers from the plate up. They are drawn into slabs of square cells, everything
//! that a slab holds at any height being one picture; each cell then knows how far it is
//! from the part in its slab. A branch leans at most as far as a cell is wide a half slab,
//! so looking at each half slab sees all that it could meet.
//!
//! Distances are those between the centres of cells less half a cell: they err by at most
//! a cell to either side. What lies outside of the grid is not free.
pub mod reach;

use crate::layers::scan::spans;
use crate::layers::shape::{Bounds, Point, Region, ring_edges};
use crate::layers::stack::Layer;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Cells in all, two bytes each.
const MAX_CELLS: f64 = 40e6;

/// Finest cell, mm.
const FINEST_MM: f64 = 0.2;

/// A slab is so many cells high.
const SLAB_CELLS: f64 = 2.0;

/// Room around the part in which branches may pass it, mm.
const MARGIN_MM: f64 = 12.0;

/// A distance is kept in eighths of a cell.
const PARTS: f64 = 8.0;

/// The part drawn into slabs, while layers come.
#[derive(Debug)]
pub struct Drawing {
    grid: Grid,
    /// Of each cell how far up its slab the part reaches, in 255ths; 0: nowhere.
    slabs: Vec<Vec<u8>>,
    /// Cells that do not lie on the plate.
    off: Vec<bool>,
}

/// How cells lie over the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Grid {
    /// Lower left corner of the first cell, mm.
    origin: [f64; 2],
    cell_mm: f64,
    slab_mm: f64,
    size: [usize; 2],
}

impl Grid {
    fn index(&self, x: i64, y: i64) -> Option<usize> {
        let within = |k: i64, size: usize| usize::try_from(k).ok().filter(|k| *k < size);
        Some(within(y, self.size[1])? * self.size[0] + within(x, self.size[0])?)
    }

    fn cell(&self, at: [f64; 2]) -> [i64; 2] {
        [0, 1].map(|k| ((at[k] - self.origin[k]) / self.cell_mm).floor() as i64)
    }

    /// The place of a cell that is nearest to another place.
    fn nearest_in(&self, cell: [i64; 2], at: [f64; 2]) -> [f64; 2] {
        let inset = self.cell_mm * 0.01;
        [0, 1].map(|k| {
            let low = self.origin[k] + cell[k] as f64 * self.cell_mm;
            at[k].clamp(low + inset, low + self.cell_mm - inset)
        })
    }

    fn slab(&self, z_mm: f64) -> usize {
        // A place just on a border belongs below: it is a bottom as often as a top.
        ((z_mm / self.slab_mm - 1e-6).floor().max(0.0)) as usize
    }
}

impl Drawing {
    /// Nothing yet of a part that lies within `bounds` and is `height_mm` high. Beside `plate`
    /// nothing is free; an empty one has no border. Cells are 0.2 mm wide, wider where there
    /// would be more than 40 million.
    #[must_use]
    pub fn new(bounds: Bounds, height_mm: f64, plate: &Region) -> Drawing {
        let [min, max] = bounds.mm();
        let origin = min.map(|c| c - MARGIN_MM);
        let wide = [0, 1].map(|k| (max[k] - min[k]).max(0.0) + 2.0 * MARGIN_MM);
        let height = height_mm.max(0.1);
        let volume = wide[0] * wide[1] * height / SLAB_CELLS;
        let cell_mm = FINEST_MM.max((volume / MAX_CELLS).cbrt());
        let size = wide.map(|w| (w / cell_mm).ceil() as usize + 1);
        let slab_mm = cell_mm * SLAB_CELLS;
        let grid = Grid { origin, cell_mm, slab_mm, size };
        let mut off = vec![false; size[0] * size[1]];
        if !plate.is_empty() {
            let mut on = vec![0; off.len()];
            grid.draw_region(plate, 1, &mut on);
            off.iter_mut().zip(on).for_each(|(off, on)| *off = on == 0);
        }
        Drawing { grid, slabs: Vec::new(), off }
    }

    /// Draws layers, on all cores.
    pub fn add(&mut self, layers: &[Layer]) {
        let grid = self.grid;
        let mut by_slab: BTreeMap<usize, Vec<&Layer>> = BTreeMap::new();
        for layer in layers.iter().filter(|l| !l.part.is_empty() || !l.aid.is_empty()) {
            let [low, high] = [grid.slab(layer.bottom_mm + 1e-6), grid.slab(layer.top_mm)];
            for slab in low..=high.max(low) {
                by_slab.entry(slab).or_default().push(layer);
            }
        }
        let drawn: Vec<(usize, Vec<u8>)> =
            by_slab.into_par_iter().map(|(slab, layers)| (slab, grid.draw(slab, &layers))).collect();
        for (slab, picture) in drawn {
            if self.slabs.len() <= slab {
                self.slabs.resize(slab + 1, Vec::new());
            }
            let own = &mut self.slabs[slab];
            if own.is_empty() {
                *own = picture;
            } else {
                own.iter_mut().zip(picture).for_each(|(a, b)| *a = (*a).max(b));
            }
        }
    }

    /// All layers were drawn.
    #[must_use]
    pub fn finish(mut self) -> Clearance {
        let grid = self.grid;
        let cells = grid.size[0] * grid.size[1];
        for slab in &mut self.slabs {
            slab.resize(cells, 0);
        }
        let blocked = |slab: &Vec<u8>| {
            slab.iter().zip(&self.off).map(|(part, off)| u8::from(*part > 0 || *off)).collect::<Vec<u8>>()
        };
        let away = self.slabs.par_iter().map(|slab| grid.distances(&blocked(slab))).collect();
        Clearance { grid, tops: self.slabs, away }
    }
}

impl Grid {
    fn draw(&self, slab: usize, layers: &[&Layer]) -> Vec<u8> {
        let mut picture = vec![0; self.size[0] * self.size[1]];
        for layer in layers {
            let up = (layer.top_mm / self.slab_mm - slab as f64) * 255.0;
            let level = up.ceil().clamp(1.0, 255.0) as u8;
            self.draw_region(&layer.part, level, &mut picture);
            // What is printed besides is in the way as well.
            self.draw_region(&layer.aid, level, &mut picture);
        }
        picture
    }

    /// Every cell whose centre lies inside, and every one that a border runs through.
    fn draw_region(&self, region: &Region, level: u8, picture: &mut [u8]) {
        let place = |p: Point| {
            let at = p.mm();
            [0, 1].map(|k| (at[k] - self.origin[k]) / self.cell_mm)
        };
        let mut put = |at: [f64; 2]| {
            if let Some(index) = self.index(at[0].floor() as i64, at[1].floor() as i64) {
                picture[index] = picture[index].max(level);
            }
        };
        for ring in region.rings() {
            for [a, b] in ring_edges(ring) {
                let (a, b) = (place(a), place(b));
                let long = (b[0] - a[0]).abs().max((b[1] - a[1]).abs());
                let steps = (long * 2.0).ceil().clamp(1.0, 1e6);
                for k in 0..steps as u32 {
                    let t = f64::from(k) / steps;
                    put([a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]);
                }
            }
        }
        let middles: Vec<f64> = (0..self.size[1]).map(|row| row as f64 + 0.5).collect();
        for (row, pieces) in spans(region.rings(), place, &middles).into_iter().enumerate() {
            let cells = &mut picture[row * self.size[0]..(row + 1) * self.size[0]];
            for piece in pieces {
                let [from, to] = piece.map(|x| ((x - 0.5).ceil().max(0.0) as usize).min(cells.len()));
                cells[from..to].iter_mut().for_each(|c| *c = (*c).max(level));
            }
        }
    }

    /// How far each cell is from a drawn one, in eighths of a cell, at most 255 (Meijster,
    /// Roerdink and Hesselink, "A general algorithm for computing distance transforms in
    /// linear time", 2000).
    fn distances(&self, picture: &[u8]) -> Vec<u8> {
        const FAR: u16 = 1_000;
        let [wide, deep] = self.size;
        // Along columns first.
        let mut column = vec![FAR; wide * deep];
        for y in 0..deep {
            for x in 0..wide {
                let above = if y > 0 { column[(y - 1) * wide + x].saturating_add(1) } else { FAR };
                column[y * wide + x] = if picture[y * wide + x] > 0 { 0 } else { above.min(FAR) };
            }
        }
        for y in (0..deep.saturating_sub(1)).rev() {
            for x in 0..wide {
                let under = column[(y + 1) * wide + x].saturating_add(1);
                column[y * wide + x] = column[y * wide + x].min(under);
            }
        }
        let mut found = vec![0; wide * deep];
        let (mut sites, mut starts) = (vec![0_i64; wide], vec![0_i64; wide]);
        for y in 0..deep {
            let g = |x: i64| i64::from(column[y * wide + x as usize]);
            let f = |x: i64, i: i64| (x - i) * (x - i) + g(i) * g(i);
            let mut q = 0_usize;
            (sites[0], starts[0]) = (0, 0);
            for u in 1..wide as i64 {
                loop {
                    if f(starts[q], sites[q]) <= f(starts[q], u) {
                        let i = sites[q];
                        let from = 1 + (u * u - i * i + g(u) * g(u) - g(i) * g(i)).div_euclid(2 * (u - i));
                        if from < wide as i64 {
                            q += 1;
                            (sites[q], starts[q]) = (u, from);
                        }
                        break;
                    }
                    if q == 0 {
                        sites[0] = u;
                        break;
                    }
                    q -= 1;
                }
            }
            for u in (0..wide as i64).rev() {
                let squared = f(u, sites[q]) as f64;
                found[y * wide + u as usize] = (squared.sqrt() * PARTS).min(255.0) as u8;
                if u == starts[q] && q > 0 {
                    q -= 1;
                }
            }
        }
        found
    }
}

/// The space around a part.
#[derive(Debug)]
pub struct Clearance {
    grid: Grid,
    tops: Vec<Vec<u8>>,
    away: Vec<Vec<u8>>,
}

impl Clearance {
    /// Height of a slab, mm.
    #[must_use]
    pub fn slab_mm(&self) -> f64 {
        self.grid.slab_mm
    }

    /// Width of a cell, mm.
    #[must_use]
    pub fn cell_mm(&self) -> f64 {
        self.grid.cell_mm
    }

    /// What was drawn lies within these, mm.
    #[must_use]
    pub fn bounds_mm(&self) -> [[f64; 3]; 2] {
        let Grid { origin: [x, y], cell_mm, size, slab_mm } = self.grid;
        let wide = size.map(|cells| cells as f64 * cell_mm);
        [[x, y, 0.0], [x + wide[0], y + wide[1], self.tops.len() as f64 * slab_mm]]
    }

    /// How far a place is from the part in its slab, or from the border of the plate, mm;
    /// negative inside and outside of the grid; large values are cut off at some 30 cells.
    #[must_use]
    pub fn away_mm(&self, at: [f64; 3]) -> f64 {
        let cell = self.grid.cell([at[0], at[1]]);
        let Some(index) = self.grid.index(cell[0], cell[1]) else { return -1.0 };
        let Some(slab) = self.away.get(self.grid.slab(at[2])) else {
            return 255.0 / PARTS * self.grid.cell_mm;
        };
        (f64::from(slab[index]) / PARTS - 0.5) * self.grid.cell_mm
    }

    /// Whether something of the part lies in the cell of a place, in its slab.
    #[must_use]
    pub fn is_part(&self, at: [f64; 3]) -> bool {
        let cell = self.grid.cell([at[0], at[1]]);
        let slab = (at[2] >= 0.0).then(|| self.tops.get(self.grid.slab(at[2]))).flatten();
        slab.zip(self.grid.index(cell[0], cell[1])).is_some_and(|(slab, index)| slab[index] > 0)
    }

    /// Whether one looks past the part from a place, in a direction of length 1 along the plate.
    #[must_use]
    pub fn sees_past(&self, from: [f64; 3], direction: [f64; 2]) -> bool {
        let mut at = from;
        loop {
            if self.is_part(at) {
                return false;
            }
            let away = self.away_mm(at);
            if away < 0.0 {
                // Out of the grid.
                return true;
            }
            // Nothing is nearer than that.
            let step = away.max(self.grid.cell_mm);
            (at[0], at[1]) = (at[0] + direction[0] * step, at[1] + direction[1] * step);
        }
    }

    /// Whether a ball may be there: its radius and the distance to keep, mm.
    #[must_use]
    pub fn is_free(&self, at: [f64; 3], radius_mm: f64) -> bool {
        self.away_mm(at) >= radius_mm
    }

    /// Whether a branch may run there, as thick and as far from the part as `radii` say in
    /// sum at its two ends, mm.
    #[must_use]
    pub fn is_clear(&self, from: [f64; 3], to: [f64; 3], radii_mm: [f64; 2]) -> bool {
        self.along(from, to).all(|(at, t)| self.is_free(at, radii_mm[0] + (radii_mm[1] - radii_mm[0]) * t))
    }

    /// How far the nearest place of a way is from the part, mm.
    #[must_use]
    pub fn away_along_mm(&self, from: [f64; 3], to: [f64; 3]) -> f64 {
        self.along(from, to).map(|(at, _)| self.away_mm(at)).fold(f64::INFINITY, f64::min)
    }

    /// Places along a way, so close that no cell and no slab is left out, and which part of
    /// the way lies before each.
    fn along(&self, from: [f64; 3], to: [f64; 3]) -> impl Iterator<Item = ([f64; 3], f64)> + use<> {
        let flat = (to[0] - from[0]).hypot(to[1] - from[1]);
        let steps = ((from[2] - to[2]).abs() * 2.0 / self.grid.slab_mm).max(flat / self.grid.cell_mm);
        let steps = steps.ceil().clamp(1.0, 1e5) as u32;
        (0..=steps).map(move |k| {
            let t = f64::from(k) / f64::from(steps);
            ([0, 1, 2].map(|k| from[k] + (to[k] - from[k]) * t), t)
        })
    }

    /// The highest place of the part straight below a place, mm; `None`: the plate.
    #[must_use]
    pub fn floor_mm(&self, at: [f64; 3]) -> Option<f64> {
        self.floor_of(self.grid.cell([at[0], at[1]]), at[2])
    }

    /// Whether what is straight below a place is wide enough to stand on, and not too steep:
    /// the cells around are about as high.
    #[must_use]
    pub fn is_floor(&self, at: [f64; 3]) -> bool {
        let [x, y] = self.grid.cell([at[0], at[1]]);
        let Some(floor) = self.floor_of([x, y], at[2]) else { return false };
        // A border marks the cells that it runs along: one further in is truly inside.
        let around = [[1, 0], [-1, 0], [0, 1], [0, -1], [2, 0], [-2, 0], [0, 2], [0, -2]];
        around.into_iter().all(|[dx, dy]| {
            let near = self.floor_of([x + dx, y + dy], at[2]);
            near.is_some_and(|near| (near - floor).abs() <= self.grid.slab_mm * 1.5)
        })
    }

    fn floor_of(&self, cell: [i64; 2], z_mm: f64) -> Option<f64> {
        let index = self.grid.index(cell[0], cell[1])?;
        let below = self.grid.slab(z_mm).min(self.tops.len());
        let slab = (0..below).rev().find(|slab| self.tops[*slab][index] > 0)?;
        Some((slab as f64 + f64::from(self.tops[slab][index]) / 255.0) * self.grid.slab_mm)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::support::testing::{layers, region};
    use proptest::prelude::*;

    /// A wall 2 mm thick with a roof over what is to its right, 10 mm up.
    fn nook() -> Clearance {
        let bounds = Bounds { min: Point::from_mm(0.0, 0.0), max: Point::from_mm(12.0, 10.0) };
        let mut drawing = Drawing::new(bounds, 12.0, &Region::default());
        let all = layers(60, 0.2, |z| match z {
            z if z < 10.0 => region(&[[0.0, 0.0, 2.0, 10.0]]),
            _ => region(&[[0.0, 0.0, 12.0, 10.0]]),
        });
        all.chunks(7).for_each(|batch| drawing.add(batch));
        drawing.finish()
    }

    #[test]
    fn distances_are_those_to_the_part() {
        let space = nook();
        let check = |at: [f64; 3], expect: f64| {
            let away = space.away_mm(at);
            assert!((away - expect).abs() <= 1.5 * space.cell_mm(), "{at:?}: {away} for {expect}");
        };
        check([5.0, 5.0, 3.0], 3.0);
        check([2.5, 5.0, 3.0], 0.5);
        check([-3.0, 5.0, 3.0], 3.0);
        check([-3.0, -4.0, 3.0], 5.0);
        check([5.0, 5.0, 11.0], 0.0);
        assert!(space.away_mm([5.0, 5.0, 13.0]) > 3.0, "nothing is above the part");
        assert!(space.away_mm([100.0, 5.0, 3.0]) < 0.0, "outside nothing is free");
        let at = |z| [5.0, 5.0, z];
        assert!(space.is_clear(at(9.0), at(0.0), [2.0, 2.0]));
        assert!(!space.is_clear(at(11.0), at(0.0), [0.1, 0.1]));
        assert!(!space.is_clear([1.0, 5.0, 9.0], at(1.0), [0.1, 0.1]));
    }

    #[test]
    fn nothing_is_free_beside_the_plate() {
        let bounds = Bounds { min: Point::default(), max: Point::from_mm(2.0, 2.0) };
        let mut drawing = Drawing::new(bounds, 4.0, &region(&[[-1.0, -1.0, 5.0, 5.0]]));
        drawing.add(&[Layer { top_mm: 4.0, part: region(&[[0.0, 0.0, 2.0, 2.0]]), ..Layer::default() }]);
        let space = drawing.finish();
        let check = |x: f64, expect: f64| {
            let away = space.away_mm([x, 1.0, 2.0]);
            assert!((away - expect).abs() <= 1.5 * space.cell_mm(), "X {x}: {away} for {expect}");
        };
        check(3.0, 1.0);
        check(4.5, 0.5);
        check(3.5, 1.5);
        assert!(space.away_mm([5.5, 1.0, 2.0]) < 0.0 && space.away_mm([-1.5, 1.0, 2.0]) < 0.0);
        assert!(!space.is_part([5.5, 1.0, 2.0]) && space.is_part([1.0, 1.0, 2.0]));
    }

    #[test]
    fn floors_are_what_is_below() {
        let space = nook();
        let floor = |x: f64, z: f64| space.floor_mm([x, 5.0, z]);
        assert_eq!(floor(5.0, 9.0), None);
        assert!((floor(5.0, 13.0).unwrap() - 12.0).abs() < 0.05);
        assert!((floor(1.0, 13.0).unwrap() - 12.0).abs() < 0.05);
    }

    #[test]
    fn what_is_walled_in_does_not_reach_the_plate() {
        // A cup, open above, and beside it a chimney that leans away.
        let bounds = Bounds { min: Point::from_mm(0.0, 0.0), max: Point::from_mm(20.0, 20.0) };
        let mut drawing = Drawing::new(bounds, 10.0, &Region::default());
        let cup = layers(50, 0.2, |z| {
            let walls = [
                [0.0, 0.0, 20.0, 1.0],
                [0.0, 19.0, 20.0, 20.0],
                [0.0, 0.0, 1.0, 20.0],
                [19.0, 0.0, 20.0, 20.0],
            ];
            if z < 1.0 { region(&[[0.0, 0.0, 20.0, 20.0]]) } else { region(&walls) }
        });
        drawing.add(&cup);
        let space = drawing.finish();
        let reach = space.reach(0.5, 1.0);
        let check = |at: [f64; 3], expect: bool| {
            assert_eq!(reach.reaches(at), expect, "{at:?}");
            assert_eq!(reach.way(at, 0.5).is_some(), expect, "{at:?}");
        };
        check([10.0, 10.0, 5.0], false);
        check([10.0, 10.0, 30.0], false);
        check([22.0, 10.0, 5.0], true);
        check([-2.0, -2.0, 9.0], true);
        assert!((space.floor_mm([10.0, 10.0, 5.0]).unwrap() - 1.0).abs() < 0.05);
    }

    #[test]
    fn a_way_goes_round_what_is_below() {
        // A plate in the air, 10 mm wide, at 10 mm, and a post beside it.
        let bounds = Bounds { min: Point::from_mm(0.0, 0.0), max: Point::from_mm(30.0, 10.0) };
        let mut drawing = Drawing::new(bounds, 20.0, &Region::default());
        drawing.add(&layers(100, 0.2, |z| match z {
            z if z > 10.0 && z < 11.0 => region(&[[0.0, 0.0, 10.0, 10.0], [28.0, 0.0, 30.0, 2.0]]),
            _ => region(&[[28.0, 0.0, 30.0, 2.0]]),
        }));
        let space = drawing.finish();
        let reach = space.reach(0.5, 1.0);
        let way = reach.way([8.0, 5.0, 16.0], 0.5).expect("a way");
        let last = way.last().unwrap();
        assert!(last[0] > 10.4 && last[2] == 0.5, "{way:?}");
        assert!(way.windows(2).all(|w| w[0][2] >= w[1][2]), "it only goes down: {way:?}");
        assert_eq!(reach.way([5.0, 5.0, 12.0], 0.5), None, "too close above to lean past it");
    }

    proptest! {
        /// Distances are those of all pairs of cells.
        #[test]
        fn distances_are_exact(cells in prop::collection::vec(any::<prop::sample::Index>(), 0..12), wide in 1..24_usize, deep in 1..24_usize) {
            let grid = Grid { origin: [0.0; 2], cell_mm: 0.2, slab_mm: 0.4, size: [wide, deep] };
            let mut picture = vec![0_u8; wide * deep];
            cells.iter().for_each(|c| picture[c.index(wide * deep)] = 1);
            let found = grid.distances(&picture);
            for (k, found) in found.iter().enumerate() {
                let apart = |o: usize| {
                    let d = [(k % wide).abs_diff(o % wide), (k / wide).abs_diff(o / wide)];
                    ((d[0] * d[0] + d[1] * d[1]) as f64).sqrt()
                };
                let least = (0..picture.len()).filter(|o| picture[*o] > 0).map(apart).fold(f64::INFINITY, f64::min);
                prop_assert_eq!(*found, (least * PARTS).min(255.0) as u8);
            }
        }
    }
}
