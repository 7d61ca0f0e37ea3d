//! Where tips stand: the fewest that hold the demand, or one each fixed distance.
//!
//! A tip holds the needs of its region that are no farther from it than the spacing.
//! - [`fixed`] is the peers' way, and the baseline of paper 000: a square lattice with the
//!   pitch spacing × √2, so that no place of a cell is farther from its middle than the
//!   spacing, and the need nearest to the middle in each region.
//! - [`cover`] is ours: islands first; then again and again the place that holds the most
//!   of what is left (Chvátal's greedy cover, at most ln n from the best); then every tip
//!   that has become needless is taken away, and pairs are replaced by one.
//!
//! No choice of tips can hold needs of which each two are farther apart than twice the
//! spacing, or belong to two regions, with fewer tips than there are of these: their number
//! is the lower bound.
use super::demand::{Demand, Need};
use super::ranked::Ranked;
use super::rules::Rules;
use super::site::{Floor, Head, Reason, Site};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A place with a tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tip {
    /// Which need it stands under.
    pub need: u32,
    /// How.
    pub head: Head,
    /// Area that is nearer to it than to other tips, mm².
    pub area_mm2: f64,
}

/// Something that no tip holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unheld {
    /// Its lowest place, mm.
    pub place_mm: [f64; 3],
    /// Area, mm².
    pub area_mm2: f64,
    /// An island is among it.
    pub island: bool,
    /// Why.
    pub reason: Reason,
}

/// Tips, and what they do not hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Points {
    /// The tips, in the order of their needs.
    pub tips: Vec<Tip>,
    /// What cannot be held, a region each.
    pub unheld: Vec<Unheld>,
    /// Every place of these, mm.
    pub unheld_mm: Vec<[f64; 3]>,
    /// No choice of tips would be smaller than this.
    pub at_least: u32,
}

/// A tip on the part is chosen where it holds so many times as much as one on the plate.
const MODEL_PRICE: f64 = 3.0;

/// The same of a tip that is thinner than others, in a corner.
const THIN_PRICE: f64 = 1.5;

/// Rounds of replacing two tips by one.
const ROUNDS: u32 = 4;

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
            by_cell.entry(need.at_mm.map(|c| (c / cell_mm).floor() as i32)).or_default().push(k as u32);
        }
        Near { needs, cell_mm, by_cell }
    }

    /// Needs of the same region within a distance, the need itself included.
    fn within(&self, of: u32, distance_mm: f64) -> Vec<u32> {
        let need = &self.needs[of as usize];
        let low = need.at_mm.map(|c| ((c - distance_mm) / self.cell_mm).floor() as i32);
        let high = need.at_mm.map(|c| ((c + distance_mm) / self.cell_mm).floor() as i32);
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

/// A need by what a tip there would be worth.
type Offer = Ranked<u32, ()>;

/// All that is known of the needs: where tips can stand, and whom they hold.
struct Field<'a> {
    demand: &'a Demand,
    near: Near<'a>,
    heads: Vec<Result<Head, Reason>>,
    spacing_mm: f64,
}

impl<'a> Field<'a> {
    fn new(demand: &'a Demand, site: &Site<'_>, rules: &Rules) -> Field<'a> {
        let near = Near::new(&demand.needs, rules.spacing_mm);
        let heads = demand.needs.par_iter().map(|need| site.head(need.at_mm)).collect();
        Field { demand, near, heads, spacing_mm: rules.spacing_mm }
    }

    fn holds(&self, need: u32) -> Vec<u32> {
        self.near.within(need, self.spacing_mm)
    }

    fn price(&self, need: u32) -> Option<f64> {
        let head = self.heads[need as usize].as_ref().ok()?;
        let floor = if head.floor == Floor::Plate { 1.0 } else { MODEL_PRICE };
        Some(if head.is_whole { floor } else { floor * THIN_PRICE })
    }

    /// Worth of holding a need: its area, and something for being there at all.
    fn worth(&self, need: u32) -> f64 {
        self.demand.needs[need as usize].area_mm2 + 1e-3
    }

    /// Where a tip holds an island: right under it, or as near as there is room.
    fn under_island(&self, need: u32) -> Option<u32> {
        if self.price(need).is_some() {
            return Some(need);
        }
        let own = &self.demand.needs[need as usize];
        let layer = |k: &u32| (self.demand.needs[*k as usize].at_mm[2] - own.at_mm[2]).abs() < 1e-6;
        let can = |k: &u32| self.price(*k).is_some();
        let apart = |k: &u32| apart2(&self.demand.needs[*k as usize], own);
        let near = self.holds(need);
        near.into_iter().filter(|k| layer(k) && can(k)).min_by(|a, b| apart(a).total_cmp(&apart(b)))
    }

    fn points(&self, chosen: &[u32]) -> Points {
        let needs = &self.demand.needs;
        let mut area = vec![0.0; chosen.len()];
        let mut nearest: Vec<(f64, u32)> = vec![(f64::INFINITY, u32::MAX); needs.len()];
        for (tip, need) in chosen.iter().enumerate() {
            for held in self.holds(*need) {
                let apart = apart2(&needs[held as usize], &needs[*need as usize]);
                if apart < nearest[held as usize].0 {
                    nearest[held as usize] = (apart, tip as u32);
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
            self.near.within(k, 2.0 * self.spacing_mm).into_iter().for_each(|c| taken[c as usize] = true);
        }
        count
    }
}

/// One tip a fixed distance.
#[must_use]
pub fn fixed(demand: &Demand, site: &Site<'_>, rules: &Rules) -> Points {
    let field = Field::new(demand, site, rules);
    let mut chosen = lattice(&field);
    chosen.extend(islands(&field));
    chosen.sort_unstable();
    chosen.dedup();
    field.points(&chosen)
}

/// The needs nearest to the middles of a lattice's cells, one a cell and region.
fn lattice(field: &Field<'_>) -> Vec<u32> {
    let pitch_mm = field.spacing_mm * std::f64::consts::SQRT_2;
    let mut best: FxHashMap<(u32, [i32; 3]), (f64, u32)> = FxHashMap::default();
    for (k, need) in field.demand.needs.iter().enumerate() {
        if field.price(k as u32).is_none() {
            continue;
        }
        let cell = need.at_mm.map(|c| (c / pitch_mm).floor() as i32);
        let off = [0, 1].map(|c| need.at_mm[c] - (f64::from(cell[c]) + 0.5) * pitch_mm);
        let off = off[0].hypot(off[1]);
        let of = best.entry((need.region, cell)).or_insert((f64::INFINITY, 0));
        if off < of.0 {
            *of = (off, k as u32);
        }
    }
    let mut chosen: Vec<u32> = best.into_values().map(|(_, need)| need).collect();
    chosen.sort_unstable();
    chosen
}

/// Where the tips of islands stand.
fn islands(field: &Field<'_>) -> Vec<u32> {
    let needs = field.demand.needs.iter().enumerate();
    let mut found: Vec<u32> =
        needs.filter(|(_, n)| n.island).filter_map(|(k, _)| field.under_island(k as u32)).collect();
    found.sort_unstable();
    found.dedup();
    found
}

/// The fewest tips that hold all that can be held: from nothing, or from a lattice where that
/// leads to fewer, as it does under wide flat ceilings.
#[must_use]
pub fn cover(demand: &Demand, site: &Site<'_>, rules: &Rules) -> Points {
    let field = Field::new(demand, site, rules);
    let islands = islands(&field);
    let (greedy, regular) =
        rayon::join(|| completed(&field, &islands, &[]), || completed(&field, &islands, &lattice(&field)));
    field.points(if regular.len() < greedy.len() { &regular } else { &greedy })
}

/// Tips under all islands, those of a beginning, and the most valuable for what is left;
/// none that is needless.
fn completed(field: &Field<'_>, islands: &[u32], start: &[u32]) -> Vec<u32> {
    let count = field.demand.needs.len();
    let mut held = vec![0_u32; count];
    let mut chosen: Vec<u32> = islands.iter().chain(start).copied().collect();
    chosen.sort_unstable();
    chosen.dedup();
    for need in &chosen {
        field.holds(*need).into_iter().for_each(|k| held[k as usize] += 1);
    }
    let value = |need: u32, held: &[u32]| {
        let left = field.holds(need).into_iter().filter(|k| held[*k as usize] == 0);
        field.price(need).map_or(0.0, |price| left.map(|k| field.worth(k)).sum::<f64>() / price)
    };
    let offers: Vec<Offer> = (0..count as u32)
        .into_par_iter()
        .filter(|need| field.price(*need).is_some())
        .map(|need| Offer { value: value(need, &held), key: need, item: () })
        .collect();
    let mut offers = BinaryHeap::from(offers);
    while let Some(offer) = offers.pop() {
        let now = value(offer.key, &held);
        if now <= 0.0 {
            continue;
        }
        // What is held only grows, so values only fall: still at the top, it is the best.
        if offers.peek().is_some_and(|next| now < next.value) {
            offers.push(Offer { value: now, ..offer });
            continue;
        }
        field.holds(offer.key).into_iter().for_each(|k| held[k as usize] += 1);
        chosen.push(offer.key);
    }
    for _ in 0..ROUNDS {
        let before = chosen.len();
        drop_needless(field, islands, &mut held, &mut chosen);
        one_for_two(field, islands, &mut held, &mut chosen);
        if chosen.len() == before {
            break;
        }
    }
    chosen.sort_unstable();
    chosen
}

/// Takes away tips whose needs others hold, those with the least of their own first.
fn drop_needless(field: &Field<'_>, islands: &[u32], held: &mut [u32], chosen: &mut Vec<u32>) {
    let mut by_worth: Vec<(f64, u32)> =
        chosen.iter().map(|n| (field.holds(*n).iter().map(|k| field.worth(*k)).sum(), *n)).collect();
    by_worth.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (_, need) in by_worth {
        let holds = field.holds(need);
        if !islands.contains(&need) && holds.iter().all(|k| held[*k as usize] > 1) {
            holds.iter().for_each(|k| held[*k as usize] -= 1);
            chosen.retain(|c| *c != need);
        }
    }
}

/// Replaces two tips by one that holds what only they hold.
fn one_for_two(field: &Field<'_>, islands: &[u32], held: &mut [u32], chosen: &mut Vec<u32>) {
    let mut tips = chosen.clone();
    tips.sort_unstable();
    let is_tip: rustc_hash::FxHashSet<u32> = tips.iter().copied().collect();
    let mut gone = rustc_hash::FxHashSet::default();
    let alone = |need: u32, held: &[u32]| -> Vec<u32> {
        field.holds(need).into_iter().filter(|k| held[*k as usize] == 1).collect()
    };
    for a in tips {
        if gone.contains(&a) || islands.contains(&a) {
            continue;
        }
        let mine = alone(a, held);
        let around = field.near.within(a, 2.0 * field.spacing_mm);
        let partners = around.iter().filter(|b| **b > a && is_tip.contains(b) && !islands.contains(b));
        for b in partners.copied().collect::<Vec<u32>>() {
            if gone.contains(&b) || gone.contains(&a) {
                continue;
            }
            // Needs that both hold, and nobody else.
            let both: Vec<u32> = {
                let of_b: rustc_hash::FxHashSet<u32> = field.holds(b).into_iter().collect();
                field.holds(a).into_iter().filter(|k| held[*k as usize] == 2 && of_b.contains(k)).collect()
            };
            let must: Vec<u32> = mine.iter().copied().chain(alone(b, held)).chain(both).collect();
            let Some(first) = must.first() else { continue };
            let fits = |c: &u32| {
                let need = &field.demand.needs[*c as usize];
                let reach = field.spacing_mm * field.spacing_mm;
                must.iter().all(|k| apart2(&field.demand.needs[*k as usize], need) <= reach)
            };
            let price = |c: &u32| field.price(*c).unwrap_or(f64::INFINITY);
            let most = price(&a) + price(&b);
            let found = field.holds(*first).into_iter().find(|c| price(c) < most && fits(c));
            if let Some(c) = found {
                for old in [a, b] {
                    field.holds(old).into_iter().for_each(|k| held[k as usize] -= 1);
                    gone.insert(old);
                }
                field.holds(c).into_iter().for_each(|k| held[k as usize] += 1);
                chosen.retain(|k| *k != a && *k != b);
                chosen.push(c);
            }
        }
    }
    chosen.sort_unstable();
    chosen.dedup();
}
