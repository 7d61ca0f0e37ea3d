//! From where the plate can be reached, and the ways there.
//!
//! What is free in the lowest slab reaches the plate; in each slab above, what is free and a
//! step away from a place below that reaches it. A step is as far as a branch leans aside in
//! the height of a slab.
use super::{Clearance, Grid, PARTS, SLAB_CELLS};
use rayon::prelude::*;

impl Clearance {
    /// From where a branch of this radius and distance, mm, gets to the plate when it leans
    /// at most by `slope` (mm sideways a mm down).
    #[must_use]
    pub fn reach(&self, radius_mm: f64, slope: f64) -> Reach {
        let words = self.grid.size[0].div_ceil(64);
        let deep = self.grid.size[1];
        let bound = ((radius_mm / self.grid.cell_mm + 0.5) * PARTS).ceil().clamp(0.0, 255.0) as u8;
        let free: Vec<Vec<u64>> = self
            .away
            .par_iter()
            .map(|slab| {
                let mut bits = vec![0_u64; words * deep];
                for (y, row) in slab.chunks_exact(self.grid.size[0]).enumerate() {
                    for (x, away) in row.iter().enumerate().filter(|(_, away)| **away >= bound) {
                        let _ = away;
                        bits[y * words + x / 64] |= 1 << (x % 64);
                    }
                }
                bits
            })
            .collect();
        let step = (slope * SLAB_CELLS).floor().clamp(0.0, 16.0) as i64;
        let mut slabs: Vec<Vec<u64>> = Vec::with_capacity(free.len());
        for free in free {
            let next = match slabs.last() {
                None => free,
                Some(below) => {
                    let mut spread = spread(below, words, deep, step);
                    spread.iter_mut().zip(&free).for_each(|(s, f)| *s &= f);
                    spread
                }
            };
            slabs.push(next);
        }
        Reach { grid: self.grid, words, step, slope, slabs }
    }
}

/// Bits spread by a disc of `step` cells.
fn spread(bits: &[u64], words: usize, deep: usize, step: i64) -> Vec<u64> {
    // Along rows, for each distance that a row of the disc has.
    let half = |dy: i64| (((step * step - dy * dy) as f64).sqrt() + 1e-9).floor() as u32;
    let row_spread = |row: &[u64], by: u32| -> Vec<u64> {
        let mut out = row.to_vec();
        for _ in 0..by {
            let was = out.clone();
            for (k, word) in out.iter_mut().enumerate() {
                let left = if k > 0 { was[k - 1] >> 63 } else { 0 };
                let right = was.get(k + 1).map_or(0, |w| w << 63);
                *word |= was[k] << 1 | left | was[k] >> 1 | right;
            }
        }
        out
    };
    let mut out = vec![0; words * deep];
    for dy in 0..=step {
        let by = half(dy);
        for y in 0..deep {
            let row = row_spread(&bits[y * words..(y + 1) * words], by);
            for to in [y as i64 + dy, y as i64 - dy] {
                if let Ok(to) = usize::try_from(to)
                    && to < deep
                {
                    out[to * words..(to + 1) * words].iter_mut().zip(&row).for_each(|(o, r)| *o |= r);
                }
            }
        }
    }
    out
}

/// From where the plate can be reached.
#[derive(Debug)]
pub struct Reach {
    grid: Grid,
    words: usize,
    step: i64,
    slope: f64,
    slabs: Vec<Vec<u64>>,
}

impl Reach {
    fn has(&self, slab: usize, cell: [i64; 2]) -> bool {
        let Some(index) = self.grid.index(cell[0], cell[1]) else { return false };
        let Some(bits) = self.slabs.get(slab) else {
            // Above the part: as from its highest slab.
            return self.slabs.is_empty() || self.has(self.slabs.len() - 1, cell);
        };
        let (x, y) = (index % self.grid.size[0], index / self.grid.size[0]);
        bits[y * self.words + x / 64] >> (x % 64) & 1 == 1
    }

    /// Whether the plate can be reached from a place.
    #[must_use]
    pub fn reaches(&self, at: [f64; 3]) -> bool {
        self.has(self.grid.slab(at[2]), self.grid.cell([at[0], at[1]]))
    }

    /// A way down to the plate, from just below a place to `end_mm` above the plate: straight
    /// down where that leads there, aside where it does not. `None` where there is none.
    #[must_use]
    pub fn way(&self, from: [f64; 3], end_mm: f64) -> Option<Vec<[f64; 3]>> {
        if !self.reaches(from) {
            return None;
        }
        let mut cell = self.grid.cell([from[0], from[1]]);
        let mut at = [from[0], from[1]];
        let mut way = Vec::new();
        let highest = self.grid.slab(from[2]).min(self.slabs.len());
        for slab in (0..highest).rev() {
            if self.has(slab, cell) {
                continue;
            }
            let found = self.nearest(slab, cell)?;
            // Where the slab above ends it goes aside, within the height of a slab.
            let z = ((slab + 2) as f64 * self.grid.slab_mm).min(from[2]);
            let aside = ((slab + 1) as f64 * self.grid.slab_mm).min(z);
            // The nearest place of that cell.
            let to = self.grid.nearest_in(found, at);
            if (to[0] - at[0]).hypot(to[1] - at[1]) > (z - aside) * self.slope + 1e-9 {
                // It begins too low in its slab to go aside in time.
                return None;
            }
            if z < from[2] {
                way.push([at[0], at[1], z]);
            }
            (cell, at) = (found, to);
            way.push([at[0], at[1], aside]);
        }
        way.push([at[0], at[1], end_mm]);
        way.dedup_by(|b, a| a == b);
        Some(way)
    }

    /// The nearest cell within a step from which the plate is reached, first of equals.
    fn nearest(&self, slab: usize, cell: [i64; 2]) -> Option<[i64; 2]> {
        let around = -self.step..=self.step;
        around
            .clone()
            .flat_map(|dy| around.clone().map(move |dx| [dx, dy]))
            .filter(|d| d[0] * d[0] + d[1] * d[1] <= self.step * self.step)
            .filter(|d| self.has(slab, [cell[0] + d[0], cell[1] + d[1]]))
            .min_by_key(|d| (d[0] * d[0] + d[1] * d[1], d[1], d[0]))
            .map(|d| [cell[0] + d[0], cell[1] + d[1]])
    }
}
