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
use super::cells::{around, cell};
use crate::detect::island::Island;
use crate::detect::overhang::{Growth, SelfSupport};
use crate::detect::walk::{Ask, LayerAsk, Seen, Watch};
use crate::layers::scan::spans;
use crate::layers::shape::{Place, Point, Polygon, ring_edges};
use rustc_hash::{FxHashMap, FxHashSet};
use std::cmp::Ordering;

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
    /// The island that this is a place of, by a number: a tip here holds it as well.
    pub under: Option<u32>,
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

/// Most places of an island where a tip may stand for the one at its centroid.
const MAX_PLACES: usize = 64;

/// An island where it appears.
#[derive(Debug)]
struct Appears {
    layer: u32,
    centroid_mm: [f64; 2],
    z_mm: f64,
    /// Where a tip should stand, and where else it may, mm.
    places: Vec<[f64; 2]>,
}

/// What a walk looks for that a [`Gather`] looks on at.
pub(super) fn ask(own: SelfSupport) -> Ask {
    Ask {
        min_island_mm2: own.min_area_mm2,
        layer: Some(LayerAsk { rules: own, growth: Growth::Conditional }),
        image: None,
        resin: false,
    }
}

/// Gathers a [`Demand`] during a walk.
#[derive(Debug)]
pub struct Gather {
    cell_mm: f64,
    cells: FxHashMap<[i32; 3], Need>,
    /// Pieces of islands in the layer where they appear.
    islands: Vec<Appears>,
    cut_off: bool,
}

impl Gather {
    /// In cells of this size, mm.
    #[must_use]
    pub fn new(cell_mm: f64) -> Gather {
        Gather { cell_mm, cells: FxHashMap::default(), islands: Vec::new(), cut_off: false }
    }

    fn put(&mut self, at_mm: [f64; 3], area_mm2: f64) {
        let cell = cell(at_mm, self.cell_mm);
        if self.cells.len() >= MAX_NEEDS && !self.cells.contains_key(&cell) {
            self.cut_off = true;
            return;
        }
        let need = Need { at_mm, area_mm2: 0.0, region: 0, island: false, under: None };
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
        // The same polygon gave the same centroid.
        let mark = |layer: u32, centroid_mm: [f64; 2]| (layer, centroid_mm.map(f64::to_bits));
        let counts: FxHashSet<_> = islands.iter().map(|i| mark(i.layer, i.centroid_mm)).collect();
        let counted = self.islands.iter().filter(|i| counts.contains(&mark(i.layer, i.centroid_mm)));
        for (number, island) in (0..).zip(counted) {
            let under = |(k, at): (usize, &[f64; 2])| Need {
                at_mm: [at[0], at[1], island.z_mm],
                area_mm2: 0.0,
                region: 0,
                island: k == 0,
                under: Some(number),
            };
            needs.extend(island.places.iter().enumerate().map(under));
        }
        let mut demand = Demand::of(needs, cell_mm, self.cut_off);
        let mut area = vec![(0.0, false); demand.regions as usize];
        for need in &demand.needs {
            let of = &mut area[need.region as usize];
            *of = (of.0 + need.area_mm2, of.1 || need.island);
        }
        let of = |n: &Need| area[n.region as usize];
        demand.needs.retain(|n| of(n).1 || of(n).0 >= min_area_mm2);
        demand.area_mm2 = demand.needs.iter().map(|n| n.area_mm2).sum();
        demand
    }
}

impl Demand {
    /// What either asks for, in cells of this one's size. A cell of both needs the larger of
    /// their areas, at the lower of their places; islands in cells that touch are one.
    #[must_use]
    pub fn with(self, other: Demand) -> Demand {
        let cell_mm = self.cell_mm;
        let cell = |n: &Need| cell(n.at_mm, cell_mm);
        let mut needs = self.needs;
        let islands: FxHashSet<[i32; 3]> = needs.iter().filter(|n| n.island).map(cell).collect();
        let is_known = |n: &&Need| around(cell(n)).any(|near| islands.contains(&near));
        let known: FxHashSet<_> =
            other.needs.iter().filter(|n| n.island).filter(is_known).map(|n| n.under).collect();
        let numbers = needs.iter().filter_map(|n| n.under).max().map_or(0, |most| most + 1);
        let mut at: FxHashMap<[i32; 3], usize> =
            needs.iter().enumerate().filter(|(_, n)| n.under.is_none()).map(|(k, n)| (cell(n), k)).collect();
        for need in other.needs {
            if need.under.is_some() {
                if !known.contains(&need.under) {
                    needs.push(Need { under: need.under.map(|k| k + numbers), ..need });
                }
            } else if let Some(k) = at.get(&cell(&need)) {
                let same = &mut needs[*k];
                same.area_mm2 = same.area_mm2.max(need.area_mm2);
                if need.at_mm[2] < same.at_mm[2] {
                    same.at_mm = need.at_mm;
                }
            } else {
                at.insert(cell(&need), needs.len());
                needs.push(need);
            }
        }
        let cut_off = self.cut_off || other.cut_off || needs.len() > MAX_NEEDS;
        needs.truncate(MAX_NEEDS);
        Demand::of(needs, cell_mm, cut_off)
    }

    /// Leaves out what is not to be held after all.
    pub fn keep(&mut self, is_needed: impl Fn(&Need) -> bool) {
        let mut needs = std::mem::take(&mut self.needs);
        needs.retain(is_needed);
        *self = Demand::of(needs, self.cell_mm, self.cut_off);
    }

    /// Needs in their order, and to which regions they belong.
    fn of(mut needs: Vec<Need>, cell_mm: f64, cut_off: bool) -> Demand {
        let key = |n: &Need| [n.at_mm[2], n.at_mm[1], n.at_mm[0]];
        let order = |a: &Need, b: &Need| key(a).partial_cmp(&key(b)).unwrap_or(Ordering::Equal);
        needs.sort_by(|a, b| b.island.cmp(&a.island).then_with(|| order(a, b)));
        let regions = join(&mut needs, cell_mm);
        let area_mm2 = needs.iter().map(|n| n.area_mm2).sum();
        Demand { needs, regions, area_mm2, cell_mm, cut_off }
    }
}

impl Watch for Gather {
    fn layer(&mut self, seen: &Seen<'_>) {
        let z_mm = seen.layer.bottom_mm;
        for piece in seen.overhang {
            self.piece(&piece.polygon, z_mm);
            if piece.island {
                let (layer, centroid_mm) = (seen.layer.number, piece.polygon.centroid_mm());
                let others = places(&piece.polygon, self.cell_mm / 2.0);
                let every = others.len().div_ceil(MAX_PLACES - 1).max(1);
                let first = inside(&piece.polygon, self.cell_mm);
                let places = std::iter::once(first).chain(others.into_iter().step_by(every)).collect();
                self.islands.push(Appears { layer, centroid_mm, z_mm, places });
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
    let cell = |n: &Need| cell(n.at_mm, cell_mm);
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
            for near in around(cell(&needs[k])) {
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
    fn an_island_tells_where_else_it_may_be_held() {
        // The tongue touches the post's own overhang, one cell away.
        let found = demand(|z| match z {
            z if z < 4.0 => region(&[[0.0, 0.0, 2.0, 2.0]]),
            _ => region(&[[0.0, 0.0, 4.0, 2.0], [4.3, 0.0, 9.3, 1.0], [8.3, 0.0, 9.3, 5.0]]),
        });
        let under: Vec<&Need> = found.needs.iter().filter(|n| n.under == Some(0)).collect();
        assert!(under[0].island && under[1..].iter().all(|n| !n.island && n.region == under[0].region));
        assert!((10..=MAX_PLACES).contains(&under.len()), "{}", under.len());
        let bar = |[x, y, _]: [f64; 3]| (4.3..=9.3).contains(&x) && (0.0..=1.0).contains(&y);
        let arm = |[x, y, _]: [f64; 3]| (8.3..=9.3).contains(&x) && (0.0..=5.0).contains(&y);
        for need in under {
            assert!((bar(need.at_mm) || arm(need.at_mm)) && (need.at_mm[2] - 4.0).abs() < 1e-9, "{need:?}");
        }
    }

    #[test]
    fn two_demands_are_one() {
        let need = |x: f64, z: f64, area_mm2: f64| Need {
            at_mm: [x, 0.5, z],
            area_mm2,
            region: 0,
            island: false,
            under: None,
        };
        let island = |x: f64, under: u32| Need { island: true, under: Some(under), ..need(x, 5.0, 0.0) };
        let place = |x: f64, under: u32| Need { under: Some(under), ..need(x, 5.0, 0.0) };
        let of = |needs: Vec<Need>| Demand::of(needs, 1.0, false);
        let a = of(vec![island(1.5, 0), place(1.7, 0), need(0.5, 5.4, 1.0), need(8.5, 3.0, 2.0)]);
        let b = of(vec![
            island(2.5, 0),
            place(2.7, 0),
            island(30.5, 1),
            place(30.6, 1),
            need(0.5, 5.2, 0.5),
            need(20.5, 3.0, 4.0),
        ]);
        let both = a.with(b);
        let got: Vec<_> = both.needs.iter().map(|n| (n.at_mm[0], n.at_mm[2], n.area_mm2, n.under)).collect();
        // Of both islands that touch one is left; in the shared cell the larger area at the lower place.
        let expect = [
            (1.5, 5.0, 0.0, Some(0)),
            (30.5, 5.0, 0.0, Some(2)),
            (8.5, 3.0, 2.0, None),
            (20.5, 3.0, 4.0, None),
            (1.7, 5.0, 0.0, Some(0)),
            (30.6, 5.0, 0.0, Some(2)),
            (0.5, 5.2, 1.0, None),
        ];
        assert_eq!(got, expect);
        assert_eq!((both.regions, both.area_mm2), (4, 7.0));
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
