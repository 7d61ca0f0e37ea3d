//! What must be held: islands where they begin, and overhangs in small portions.
//!
//! Looks on at a [`crate::detect::walk`] and takes the overhanging pieces of each layer.
//! Their places are gathered in cells: a cell stands for the area of all pieces in it, at
//! the lowest place of the first of these. Cells that touch belong to one region, so that
//! a finger does not count as held by the tip under its neighbour.
//!
//! Choices: an island of at least the smallest area asked for is a need of its own, at
//! the layer in which it appears, at its centroid or, where that lies outside of it, at
//! the innermost of some places inside. Regions of less area in all that hold no such
//! island need nothing, nor does what is so near the plate that this catches it as it sags; they are those that `check` lists apart.
use crate::detect::island::Island;
use crate::detect::walk::{Seen, Watch};
use crate::layers::scan::spans;
use crate::layers::shape::{Place, Point, Polygon, ring_edges};
use rustc_hash::{FxHashMap, FxHashSet};

/// Cells at most: 40 m² of overhang in cells of 1 mm would be more than any part has.
pub const MAX_NEEDS: usize = 4_000_000;

/// A portion of what must be held.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Need {
    /// Its lowest place, mm: the underside of the layer that overhangs.
    pub at_mm: [f64; 3],
    /// Area seen from below, mm².
    pub area_mm2: f64,
    /// Which overhang it belongs to.
    pub region: u32,
    /// It is where an island begins: something must stand right under it.
    pub island: bool,
}

/// All that must be held, islands first, each from the lowest up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Demand {
    /// The portions.
    pub needs: Vec<Need>,
    /// Regions that they form.
    pub regions: u32,
    /// Area in all, mm².
    pub area_mm2: f64,
    /// Side of a cell, mm.
    pub cell_mm: f64,
    /// There were more cells than [`MAX_NEEDS`]; the highest are missing.
    pub cut_off: bool,
}

/// Gathers a [`Demand`] during a walk.
#[derive(Debug)]
pub struct Gather {
    cell_mm: f64,
    cells: FxHashMap<[i32; 3], Need>,
    /// Pieces of islands in the layer where they appear: layer, centroid, place.
    islands: Vec<(u32, [f64; 2], [f64; 3])>,
    cut_off: bool,
}

impl Gather {
    /// In cells of this size, mm.
    #[must_use]
    pub fn new(cell_mm: f64) -> Gather {
        Gather { cell_mm, cells: FxHashMap::default(), islands: Vec::new(), cut_off: false }
    }

    fn put(&mut self, at_mm: [f64; 3], area_mm2: f64) {
        let cell = at_mm.map(|c| (c / self.cell_mm).floor() as i32);
        if self.cells.len() >= MAX_NEEDS && !self.cells.contains_key(&cell) {
            self.cut_off = true;
            return;
        }
        let need = Need { at_mm, area_mm2: 0.0, region: 0, island: false };
        self.cells.entry(cell).or_insert(need).area_mm2 += area_mm2;
    }

    fn piece(&mut self, polygon: &Polygon, z_mm: f64) {
        let places = places(polygon, self.cell_mm / 2.0);
        let share = polygon.area_mm2() / places.len() as f64;
        for at in places {
            self.put([at[0], at[1], z_mm], share);
        }
    }

    /// What was gathered. `islands` are those that count; regions without one need at
    /// least `min_area_mm2`, and begin no lower than `caught_mm`.
    #[must_use]
    pub fn finish(mut self, islands: &[Island], min_area_mm2: f64, caught_mm: f64) -> Demand {
        self.cells.retain(|_, need| need.at_mm[2] >= caught_mm);
        let cell_mm = self.cell_mm;
        let mut needs: Vec<Need> = self.cells.into_values().collect();
        let key = |n: &Need| (n.at_mm[2], n.at_mm[1], n.at_mm[0]);
        let order = |a: &Need, b: &Need| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2))
        };
        // The same polygon gave the same centroid.
        let mark = |layer: u32, centroid_mm: [f64; 2]| (layer, centroid_mm.map(f64::to_bits));
        let counts: FxHashSet<_> = islands.iter().map(|i| mark(i.layer, i.centroid_mm)).collect();
        let counted = self
            .islands
            .iter()
            .filter(|(layer, centroid_mm, _)| counts.contains(&mark(*layer, *centroid_mm)))
            .map(|(.., at_mm)| Need { at_mm: *at_mm, area_mm2: 0.0, region: 0, island: true });
        needs.extend(counted);
        needs.sort_by(|a, b| b.island.cmp(&a.island).then_with(|| order(a, b)));
        let regions = join(&mut needs, cell_mm);
        let mut area = vec![(0.0, false); regions as usize];
        for need in &needs {
            let of = &mut area[need.region as usize];
            *of = (of.0 + need.area_mm2, of.1 || need.island);
        }
        needs.retain(|n| area[n.region as usize].1 || area[n.region as usize].0 >= min_area_mm2);
        let area_mm2 = needs.iter().map(|n| n.area_mm2).sum();
        Demand { needs, regions, area_mm2, cell_mm, cut_off: self.cut_off }
    }
}

impl Watch for Gather {
    fn layer(&mut self, seen: &Seen<'_>) {
        let z_mm = seen.layer.bottom_mm;
        for piece in seen.overhang {
            self.piece(&piece.polygon, z_mm);
            if piece.island {
                let at = inside(&piece.polygon, self.cell_mm);
                let centroid = piece.polygon.centroid_mm();
                self.islands.push((seen.layer.number, centroid, [at[0], at[1], z_mm]));
            }
        }
    }
}

/// Places that stand for a polygon: a lattice inside it, and its border.
fn places(polygon: &Polygon, pitch_mm: f64) -> Vec<[f64; 2]> {
    let mut found = Vec::new();
    let [min, max] = polygon.bounds().mm();
    let first = min.map(|c| (c / pitch_mm).ceil() as i64);
    let last = max.map(|c| (c / pitch_mm).floor() as i64);
    let rows: Vec<f64> = (first[1]..=last[1]).map(|y| y as f64 * pitch_mm).collect();
    for (y_mm, pieces) in rows.iter().zip(spans(&polygon.rings, Point::mm, &rows)) {
        for piece in pieces {
            let from = first[0].max((piece[0] / pitch_mm).ceil() as i64);
            let to = last[0].min((piece[1] / pitch_mm).floor() as i64);
            found.extend((from..=to).map(|x| [x as f64 * pitch_mm, *y_mm]));
        }
    }
    for ring in &polygon.rings {
        // One place each pitch along the ring, wherever its points are.
        let mut left = 0.0;
        for [a, b] in ring_edges(ring) {
            let (a, b) = (a.mm(), b.mm());
            let long = (b[0] - a[0]).hypot(b[1] - a[1]);
            while left < long {
                let t = left / long;
                found.push([a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t]);
                left += pitch_mm;
            }
            left -= long;
        }
    }
    found
}

/// The centroid where it lies inside, else the middle of the widest of some cuts.
fn inside(polygon: &Polygon, pitch_mm: f64) -> [f64; 2] {
    let centroid = polygon.centroid_mm();
    if polygon.place(Point::from_mm(centroid[0], centroid[1])) == Place::Inside {
        return centroid;
    }
    let [min, max] = polygon.bounds().mm();
    let count = ((max[1] - min[1]) / pitch_mm).ceil().clamp(8.0, 256.0);
    let cuts: Vec<f64> =
        (0..count as u32).map(|k| min[1] + (max[1] - min[1]) * (f64::from(k) + 0.5) / count).collect();
    let mut best = (-1.0, centroid);
    for (y, pieces) in cuts.iter().zip(spans(&polygon.rings, Point::mm, &cuts)) {
        for [from, to] in pieces {
            if to - from > best.0 {
                best = (to - from, [(from + to) / 2.0, *y]);
            }
        }
    }
    best.1
}

/// Numbers the regions: cells that are at most one cell apart belong together.
fn join(needs: &mut [Need], cell_mm: f64) -> u32 {
    let cell = |n: &Need| n.at_mm.map(|c| (c / cell_mm).floor() as i32);
    let mut by_cell: FxHashMap<[i32; 3], Vec<usize>> = FxHashMap::default();
    for (k, need) in needs.iter().enumerate() {
        by_cell.entry(cell(need)).or_default().push(k);
    }
    let mut region = vec![u32::MAX; needs.len()];
    let mut count = 0;
    for start in 0..needs.len() {
        if region[start] != u32::MAX {
            continue;
        }
        region[start] = count;
        let mut todo = vec![start];
        while let Some(k) = todo.pop() {
            let own = cell(&needs[k]);
            for step in 0..27 {
                let near = [own[0] + step % 3 - 1, own[1] + step / 3 % 3 - 1, own[2] + step / 9 - 1];
                for other in by_cell.get(&near).into_iter().flatten() {
                    if region[*other] == u32::MAX {
                        region[*other] = count;
                        todo.push(*other);
                    }
                }
            }
        }
        count += 1;
    }
    needs.iter_mut().zip(region).for_each(|(need, region)| need.region = region);
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::Region;
    use crate::support::rules::{Process, Rules};
    use crate::support::testing::{layers, region, seen};

    fn demand(part: impl Fn(f64) -> Region) -> Demand {
        let rules = Rules::usual(Process::Resin, 0.1);
        seen(layers(100, 0.1, part), &rules).demand
    }

    #[test]
    fn what_stands_needs_nothing() {
        let found = demand(|_| region(&[[0.0, 0.0, 5.0, 5.0]]));
        assert_eq!((found.needs.len(), found.area_mm2, found.regions), (0, 0.0, 0));
    }

    #[test]
    fn an_island_is_a_need_at_its_lowest_layer_and_its_centroid() {
        // A post, and a block that hangs from a roof.
        let found = demand(|z| match z {
            z if z < 4.0 => region(&[[0.0, 0.0, 2.0, 2.0]]),
            z if z < 8.0 => region(&[[0.0, 0.0, 2.0, 2.0], [6.0, 0.0, 8.0, 2.0]]),
            _ => region(&[[0.0, 0.0, 8.0, 2.0]]),
        });
        let first = found.needs[0];
        assert!(first.island);
        assert_eq!(found.needs.iter().filter(|n| n.island).count(), 1);
        for (got, expect) in first.at_mm.iter().zip([7.0, 1.0, 4.0]) {
            assert!((got - expect).abs() < 1e-9, "{first:?}");
        }
        // The island's underside; the roof between post and block is a bridge of 4 mm.
        let of =
            |region: u32| found.needs.iter().filter(|n| n.region == region).map(|n| n.area_mm2).sum::<f64>();
        assert!((of(first.region) - 4.0).abs() < 1e-6, "{}", of(first.region));
        assert_eq!(found.regions, 2);
        let roof = found.area_mm2 - of(first.region);
        assert!(roof > 6.0 && roof < 8.0, "{roof}: 4 × 2 mm, but for what leans over from both ends");
    }

    #[test]
    fn an_island_that_is_hollow_is_held_inside_its_rim() {
        let found = demand(|z| {
            let ring =
                [[0.0, 0.0, 9.0, 1.0], [0.0, 8.0, 9.0, 9.0], [0.0, 0.0, 1.0, 9.0], [8.0, 0.0, 9.0, 9.0]];
            if z > 3.0 { region(&ring) } else { Region::default() }
        });
        let [x, y, z] = found.needs[0].at_mm;
        assert!((z - 3.0).abs() < 1e-9, "{z}");
        let within = 1.0..=8.0;
        assert!(!within.contains(&x) || !within.contains(&y), "{x} {y}");
    }

    #[test]
    fn all_of_an_underside_is_near_a_need() {
        let found =
            demand(
                |z| if z < 5.0 { region(&[[0.0, 0.0, 1.0, 1.0]]) } else { region(&[[0.0, 0.0, 20.0, 6.0]]) },
            );
        for x in 0..40 {
            for y in 0..12 {
                let at = [0.25 + 0.5 * f64::from(x), 0.25 + 0.5 * f64::from(y), 5.0];
                if at[0] < 1.2 && at[1] < 1.2 {
                    continue;
                }
                let apart = |n: &Need| (0..3).map(|k| (n.at_mm[k] - at[k]).powi(2)).sum::<f64>().sqrt();
                let least = found.needs.iter().map(apart).fold(f64::INFINITY, f64::min);
                assert!(least < 2.0 * found.cell_mm, "{at:?}: {least}");
            }
        }
        assert!((found.area_mm2 - 119.0).abs() < 1.0, "{}", found.area_mm2);
    }

    #[test]
    fn specks_need_nothing() {
        // 0.2 × 0.2 mm, less than the smallest area that counts.
        let found = demand(|z| {
            let speck = if z > 3.0 && z < 3.3 { [[5.0, 5.0, 5.2, 5.2]] } else { [[0.0, 0.0, 1.0, 1.0]] };
            region(&[speck[0], [0.0, 0.0, 1.0, 1.0]])
        });
        assert!(found.needs.is_empty(), "{:?}", found.needs);
    }
}
