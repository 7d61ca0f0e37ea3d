//! All that is known of the needs: where tips can stand, and whom they hold.
use super::super::cells::cell;
use super::super::demand::{Demand, Need};
use super::super::rules::Rules;
use super::super::site::{Floor, Head, Reason, Site};
use super::{Points, Tip, Unheld};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::borrow::Cow;
use std::cmp::Ordering;

/// A tip on the part is chosen where it holds so many times as much as one on the plate.
const MODEL_PRICE: f64 = 3.0;

/// The same of a tip that is thinner than others, in a corner.
const THIN_PRICE: f64 = 1.5;

/// Most entries of the lists of who holds whom that are kept: 32 MB. Where there are more,
/// they are looked up each time.
const MAX_LISTED: usize = 8 << 20;

/// A tip holds an island of which a place is so near to its axis, in parts of its radius.
const MEETS: f64 = 0.8;

/// Needs that are listed at once.
const AT_ONCE: usize = 1 << 14;

/// Needs by place.
struct Near<'a> {
    needs: &'a [Need],
    cell_mm: f64,
    by_cell: FxHashMap<[i32; 3], Vec<u32>>,
}

impl<'a> Near<'a> {
    fn new(needs: &'a [Need], cell_mm: f64) -> Near<'a> {
        let mut by_cell: FxHashMap<[i32; 3], Vec<u32>> = FxHashMap::default();
        for (k, need) in needs.iter().enumerate() {
            by_cell.entry(cell(need.at_mm, cell_mm)).or_default().push(k as u32);
        }
        Near { needs, cell_mm, by_cell }
    }

    /// Needs of the same region within a distance, the need itself included.
    fn within(&self, of: u32, distance_mm: f64) -> Vec<u32> {
        let need = &self.needs[of as usize];
        let low = cell(need.at_mm.map(|c| c - distance_mm), self.cell_mm);
        let high = cell(need.at_mm.map(|c| c + distance_mm), self.cell_mm);
        let mut found = Vec::new();
        for x in low[0]..=high[0] {
            for y in low[1]..=high[1] {
                for z in low[2]..=high[2] {
                    let here = self.by_cell.get(&[x, y, z]).into_iter().flatten();
                    found.extend(here.copied().filter(|k| {
                        let other = &self.needs[*k as usize];
                        other.region == need.region && apart2(other, need) <= distance_mm * distance_mm
                    }));
                }
            }
        }
        found.sort_unstable();
        found
    }
}

fn apart2(a: &Need, b: &Need) -> f64 {
    (0..3).map(|k| (a.at_mm[k] - b.at_mm[k]).powi(2)).sum()
}

/// For each need those that a tip there holds, one list behind another.
struct Lists {
    starts: Vec<u32>,
    held: Vec<u32>,
}

impl Lists {
    /// None where they have more entries than so many.
    fn new(near: &Near<'_>, spacing_mm: f64, most: usize) -> Option<Lists> {
        let mut lists = Lists { starts: vec![0], held: Vec::new() };
        let all: Vec<u32> = (0..near.needs.len() as u32).collect();
        for some in all.chunks(AT_ONCE) {
            let found: Vec<Vec<u32>> = some.par_iter().map(|k| near.within(*k, spacing_mm)).collect();
            if lists.held.len() + found.iter().map(Vec::len).sum::<usize>() > most {
                return None;
            }
            for list in found {
                lists.held.extend(list);
                lists.starts.push(lists.held.len() as u32);
            }
        }
        Some(lists)
    }

    fn of(&self, need: u32) -> &[u32] {
        let [from, to] = [need, need + 1].map(|k| self.starts[k as usize] as usize);
        &self.held[from..to]
    }
}

/// The needs, and what tips under them would be.
pub(super) struct Field<'a> {
    pub(super) demand: &'a Demand,
    near: Near<'a>,
    lists: Option<Lists>,
    heads: Vec<Result<Head, Reason>>,
    pub(super) spacing_mm: f64,
}

impl<'a> Field<'a> {
    /// Looks at the places of all needs.
    pub(super) fn new(demand: &'a Demand, site: &Site<'_>, rules: &Rules) -> Field<'a> {
        let near = Near::new(&demand.needs, rules.spacing_mm);
        let heads: Vec<_> = demand.needs.par_iter().map(|need| site.head(need.at_mm)).collect();
        let lists = Lists::new(&near, rules.spacing_mm, MAX_LISTED);
        Field { demand, near, lists, heads, spacing_mm: rules.spacing_mm }
    }

    /// The needs that a tip under this one holds, in order.
    pub(super) fn holds(&self, need: u32) -> Cow<'_, [u32]> {
        match &self.lists {
            Some(lists) => Cow::Borrowed(lists.of(need)),
            None => Cow::Owned(self.near.within(need, self.spacing_mm)),
        }
    }

    /// The needs of the same region that are at most twice the spacing away, in order.
    pub(super) fn around(&self, need: u32) -> Vec<u32> {
        self.near.within(need, 2.0 * self.spacing_mm)
    }

    /// Whether a tip under one need holds another of its region.
    pub(super) fn reaches(&self, tip: u32, need: u32) -> bool {
        let [tip, need] = [tip, need].map(|k| &self.demand.needs[k as usize]);
        apart2(tip, need) <= self.spacing_mm * self.spacing_mm
    }

    /// What a tip there costs, beside others; none where it cannot stand.
    pub(super) fn price(&self, need: u32) -> Option<f64> {
        let head = self.heads[need as usize].as_ref().ok()?;
        let floor = if head.floor == Floor::Plate { 1.0 } else { MODEL_PRICE };
        Some(if head.is_whole { floor } else { floor * THIN_PRICE })
    }

    /// Worth of holding a need: its area, and something for being there at all.
    pub(super) fn worth(&self, need: u32) -> f64 {
        self.demand.needs[need as usize].area_mm2 + 1e-3
    }

    /// Where a tip holds an island: at its middle, or at the place of it that has room and is
    /// the nearest to this.
    pub(super) fn under_island(&self, need: u32) -> Option<u32> {
        let own = &self.demand.needs[need as usize];
        let of = |k: &u32| &self.demand.needs[*k as usize];
        let near = self.holds(need);
        let places: Vec<u32> =
            near.iter().copied().filter(|k| of(k).under.is_some() && of(k).under == own.under).collect();
        // A head that leans meets the underside beside its contact.
        let meets = |head: Head| {
            let [x, y] = head.axis_mm(own.at_mm[2]);
            let apart = |p: &u32| (of(p).at_mm[0] - x).hypot(of(p).at_mm[1] - y);
            places.iter().any(|p| apart(p) <= MEETS * head.contact_radius_mm)
        };
        let fits = |k: &u32| self.heads[*k as usize].is_ok_and(meets);
        let apart = |k: &u32| apart2(of(k), own);
        places.iter().copied().filter(fits).min_by(|a, b| apart(a).total_cmp(&apart(b)))
    }

    /// The tips there, and what they do not hold.
    pub(super) fn points(&self, chosen: &[u32]) -> Points {
        let needs = &self.demand.needs;
        let mut area = vec![0.0; chosen.len()];
        let mut nearest: Vec<(f64, u32)> = vec![(f64::INFINITY, u32::MAX); needs.len()];
        for (tip, need) in chosen.iter().enumerate() {
            for held in self.holds(*need).iter() {
                let apart = apart2(&needs[*held as usize], &needs[*need as usize]);
                if apart < nearest[*held as usize].0 {
                    nearest[*held as usize] = (apart, tip as u32);
                }
            }
        }
        let mut unheld: FxHashMap<u32, Unheld> = FxHashMap::default();
        let mut unheld_mm = Vec::new();
        for (k, (need, (_, tip))) in needs.iter().zip(&nearest).enumerate() {
            // An island hangs on the tip under itself, whatever else is near.
            let held = !need.island || self.under_island(k as u32).is_some();
            if let Some(area) = area.get_mut(*tip as usize).filter(|_| held) {
                *area += need.area_mm2;
                continue;
            }
            unheld_mm.push(need.at_mm);
            let reason = self.heads[k].err().unwrap_or(Reason::NoRoom);
            let first = Unheld { place_mm: need.at_mm, area_mm2: 0.0, island: false, reason };
            let of = unheld.entry(need.region).or_insert(first);
            of.area_mm2 += need.area_mm2;
            of.island |= need.island;
            if need.at_mm[2] < of.place_mm[2] {
                of.place_mm = need.at_mm;
            }
        }
        let tip = |(need, area_mm2): (&u32, f64)| {
            let head = self.heads[*need as usize].ok()?;
            Some(Tip { need: *need, head, area_mm2 })
        };
        let mut unheld: Vec<Unheld> = unheld.into_values().collect();
        unheld.sort_by(|a, b| {
            let key = |u: &Unheld| [u.place_mm[2], u.place_mm[1], u.place_mm[0]];
            key(a).partial_cmp(&key(b)).unwrap_or(Ordering::Equal)
        });
        let tips = chosen.iter().zip(area).filter_map(tip).collect();
        Points { tips, unheld, unheld_mm, at_least: self.at_least() }
    }

    /// Needs so far apart that each wants a tip of its own, taken as they come.
    fn at_least(&self) -> u32 {
        let mut taken = vec![false; self.demand.needs.len()];
        let mut count = 0;
        for k in 0..self.demand.needs.len() as u32 {
            if taken[k as usize] || self.holds(k).iter().all(|c| self.price(*c).is_none()) {
                continue;
            }
            count += 1;
            self.around(k).into_iter().for_each(|c| taken[c as usize] = true);
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::rules::Process;
    use super::super::super::testing::{layers, region, seen};
    use super::*;
    use proptest::prelude::*;

    /// An island over a shelf that leaves no room for a tip but at its end.
    #[test]
    fn an_island_is_held_where_it_has_room() {
        let island = [10.0, 0.0, 20.0, 1.0];
        // The post's own overhang ends next to the island's middle, and has room.
        let part = |shelf_to: f64| {
            seen(
                layers(60, 0.1, |z| match z {
                    z if z < 4.6 => region(&[[0.0, 0.0, 2.0, 12.0]]),
                    z if z < 4.9 => region(&[[0.0, 0.0, 2.0, 12.0], [0.0, -2.0, shelf_to, 1.4]]),
                    z if z < 5.0 => region(&[[0.0, 0.0, 2.0, 12.0]]),
                    _ => region(&[[0.0, 0.0, 2.0, 12.0], [0.0, 1.5, 16.0, 12.0], island]),
                }),
                &Rules::usual(Process::Resin, 0.1),
            )
        };
        for (shelf_to, from) in [(9.0, Some(14.9)), (16.0, Some(16.0)), (21.0, None)] {
            let look = part(shelf_to);
            let (rules, demand) = (Rules::usual(Process::Resin, 0.1), &look.demand);
            let site = Site::new(&look.space, &rules);
            let field = Field::new(demand, &site, &rules);
            let middle = demand.needs.iter().position(|n| n.island).expect("an island") as u32;
            let under = field.under_island(middle);
            let tip = under.map(|k| demand.needs[k as usize].at_mm);
            // Where its axis meets the underside there is something of the island as well.
            if let Some(head) = under.and_then(|k| field.heads[k as usize].ok()) {
                let ([x, y], wide) = (head.axis_mm(5.0), head.contact_radius_mm);
                assert!(
                    (10.0 - wide..=20.0 + wide).contains(&x) && (-wide..=1.0 + wide).contains(&y),
                    "{head:?}"
                );
            }
            match (tip, from) {
                (Some([x, y, _]), Some(from)) => {
                    assert!((from..=20.0).contains(&x) && (0.0..=1.0).contains(&y), "{shelf_to}: {tip:?}");
                }
                (None, None) => {}
                _ => panic!("{shelf_to}: {tip:?}"),
            }
        }
    }

    proptest! {
        /// Lists say what looking it up says, or there are none.
        #[test]
        fn lists_are_as_looked_up(places in prop::collection::vec(([0.0..9.0, 0.0..9.0, 0.0..2.0_f64], 0..3_u32), 1..80)) {
            let need = |(at_mm, region): ([f64; 3], u32)| Need { at_mm, area_mm2: 1.0, region, island: false, under: None };
            let needs: Vec<Need> = places.into_iter().map(need).collect();
            let near = Near::new(&needs, 2.0);
            let all = 0..needs.len() as u32;
            let looked_up: Vec<Vec<u32>> = all.clone().map(|k| {
                let within = |c: &u32| needs[*c as usize].region == needs[k as usize].region
                    && apart2(&needs[*c as usize], &needs[k as usize]) <= 4.0;
                all.clone().filter(within).collect()
            }).collect();
            let entries = looked_up.iter().map(Vec::len).sum();
            let lists = Lists::new(&near, 2.0, entries).expect("they fit");
            for (k, list) in looked_up.iter().enumerate() {
                prop_assert_eq!(lists.of(k as u32), &list[..]);
                prop_assert_eq!(&near.within(k as u32, 2.0), list);
            }
            prop_assert!(Lists::new(&near, 2.0, entries - 1).is_none());
        }
    }
}
