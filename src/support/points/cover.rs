//! The fewest tips that hold the demand.
use super::super::demand::Demand;
use super::super::ranked::Ranked;
use super::super::rules::Rules;
use super::super::scar::Eye;
use super::super::site::Site;
use super::field::Field;
use super::{Points, islands, lattice};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::collections::{BTreeSet, BinaryHeap};

/// Rounds of replacing two tips by one, and of moving tips.
const ROUNDS: u32 = 4;

/// A tip is moved where it scars less by more than this.
const WORTH_MOVING: f64 = 0.02;

/// A need by what a tip there would be worth.
type Offer = Ranked<u32, ()>;

/// The fewest tips that hold all that can be held: from nothing, or from a lattice where that
/// leads to fewer, as it does under wide flat ceilings.
#[must_use]
pub fn cover(demand: &Demand, site: &Site<'_>, rules: &Rules) -> Points {
    let field = Field::new(demand, site, rules);
    let islands = islands(&field);
    let (greedy, regular) = rayon::join(
        || Choice::new(&field, &islands, &[]).fewest(),
        || Choice::new(&field, &islands, &lattice(&field)).fewest(),
    );
    let fewer = if regular.tips.len() < greedy.tips.len() { regular } else { greedy };
    let tips = fewer.least_scarred(&Eye::new(site.space)).tips;
    field.points(&tips.into_iter().collect::<Vec<u32>>())
}

/// Tips that are chosen, by the needs they stand under.
struct Choice<'a> {
    field: &'a Field<'a>,
    /// Tips under islands stay where they are; in order.
    islands: &'a [u32],
    tips: BTreeSet<u32>,
    /// How many tips hold each need.
    held: Vec<u32>,
}

impl<'a> Choice<'a> {
    /// Tips under all islands, and those of a beginning.
    fn new(field: &'a Field<'a>, islands: &'a [u32], start: &[u32]) -> Choice<'a> {
        let held = vec![0; field.demand.needs.len()];
        let mut choice = Choice { field, islands, tips: BTreeSet::new(), held };
        islands.iter().chain(start).for_each(|need| choice.take(*need));
        choice
    }

    /// All that can be held is held, by few tips.
    fn fewest(mut self) -> Choice<'a> {
        self.take_the_most_valuable();
        for _ in 0..ROUNDS {
            let before = self.tips.len();
            self.drop_needless();
            self.one_for_two();
            if self.tips.len() == before {
                break;
            }
        }
        self
    }

    fn take(&mut self, need: u32) {
        if self.tips.insert(need) {
            self.field.holds(need).iter().for_each(|k| self.held[*k as usize] += 1);
        }
    }

    fn drop(&mut self, need: u32) {
        if self.tips.remove(&need) {
            self.field.holds(need).iter().for_each(|k| self.held[*k as usize] -= 1);
        }
    }

    /// A tip that need not stand just there.
    fn is_free(&self, need: u32) -> bool {
        self.islands.binary_search(&need).is_err()
    }

    /// The needs that a tip there holds and no other does.
    fn only_held_by(&self, tip: u32) -> Vec<u32> {
        self.field.holds(tip).iter().copied().filter(|k| self.held[*k as usize] == 1).collect()
    }

    /// What a tip there would hold that none does, for its price.
    fn value(&self, need: u32) -> f64 {
        let holds = self.field.holds(need);
        let left = holds.iter().filter(|k| self.held[**k as usize] == 0);
        self.field.price(need).map_or(0.0, |price| left.map(|k| self.field.worth(*k)).sum::<f64>() / price)
    }

    fn take_the_most_valuable(&mut self) {
        let all = (0..self.held.len() as u32).into_par_iter();
        let offers = all.filter(|need| self.field.price(*need).is_some());
        let offers: Vec<Offer> =
            offers.map(|need| Offer { value: self.value(need), key: need, item: () }).collect();
        let mut offers = BinaryHeap::from(offers);
        while let Some(offer) = offers.pop() {
            let now = self.value(offer.key);
            if now <= 0.0 {
                continue;
            }
            // What is held only grows, so values only fall: still at the top, it is the best.
            if offers.peek().is_some_and(|next| now < next.value) {
                offers.push(Offer { value: now, ..offer });
                continue;
            }
            self.take(offer.key);
        }
    }

    /// Takes away tips whose needs others hold, those that hold the least first.
    fn drop_needless(&mut self) {
        let worth = |tip: u32| self.field.holds(tip).iter().map(|k| self.field.worth(*k)).sum::<f64>();
        let mut by_worth: Vec<(f64, u32)> = self.tips.iter().map(|tip| (worth(*tip), *tip)).collect();
        by_worth.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        for (_, tip) in by_worth {
            if self.is_free(tip) && self.only_held_by(tip).is_empty() {
                self.drop(tip);
            }
        }
    }

    /// Replaces two tips by one that holds what only they hold.
    fn one_for_two(&mut self) {
        for a in self.tips.clone() {
            let partners = self.field.around(a).into_iter().filter(|b| *b > a && self.tips.contains(b));
            for b in partners.collect::<Vec<u32>>() {
                if ![a, b].iter().all(|tip| self.tips.contains(tip) && self.is_free(*tip)) {
                    continue;
                }
                if let Some(one) = self.for_both(a, b) {
                    self.drop(a);
                    self.drop(b);
                    self.take(one);
                }
            }
        }
    }

    /// A tip that holds what only these two hold, and costs less than both.
    fn for_both(&self, a: u32, b: u32) -> Option<u32> {
        let field = self.field;
        let of_b = field.holds(b);
        let is_both = |k: &u32| self.held[*k as usize] == 2 && of_b.binary_search(k).is_ok();
        let mut must = [self.only_held_by(a), self.only_held_by(b)].concat();
        must.extend(field.holds(a).iter().filter(|k| is_both(k)));
        let price = |k: u32| field.price(k).unwrap_or(f64::INFINITY);
        let fits =
            |k: &u32| price(*k) < price(a) + price(b) && must.iter().all(|need| field.reaches(*k, *need));
        field.holds(*must.first()?).iter().copied().find(fits)
    }

    /// The same needs are held by no more tips, where they scar the least and cost no more.
    fn least_scarred(mut self, eye: &Eye<'_>) -> Choice<'a> {
        let mut scars = FxHashMap::default();
        for _ in 0..ROUNDS {
            if !self.less_scarred(eye, &mut scars) {
                break;
            }
            self.drop_needless();
        }
        self
    }

    /// Moves tips to where they scar less and hold what only they hold. Says whether any was
    /// moved.
    fn less_scarred(&mut self, eye: &Eye<'_>, scars: &mut FxHashMap<u32, f64>) -> bool {
        let field = self.field;
        let price = |k: u32| field.price(k).unwrap_or(f64::INFINITY);
        let mut scar = |k: u32| {
            let look = || eye.scar(field.demand.needs[k as usize].at_mm).weight();
            *scars.entry(k).or_insert_with(look)
        };
        let mut moved = false;
        for from in self.tips.clone() {
            if !self.is_free(from) {
                continue;
            }
            let must = self.only_held_by(from);
            let fits = |k: &u32| price(*k) <= price(from) && must.iter().all(|need| field.reaches(*k, *need));
            let mut best = (scar(from) - WORTH_MOVING, from);
            for to in field.around(from).into_iter().filter(fits) {
                let there = scar(to);
                if there < best.0 {
                    best = (there, to);
                }
            }
            if best.1 != from {
                self.drop(from);
                self.take(best.1);
                moved = true;
            }
        }
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::look::Look;
    use super::super::super::rules::{Process, Rules};
    use super::super::super::testing::{layers, region, seen};
    use super::*;

    /// What the tips of a part scar on average before and after they were moved.
    fn scars(process: Process, look: &Look) -> [f64; 2] {
        let rules = Rules::usual(process, 0.2);
        let site = Site::new(&look.space, &rules);
        let field = Field::new(&look.demand, &site, &rules);
        let (eye, islands) = (Eye::new(site.space), islands(&field));
        let few = Choice::new(&field, &islands, &[]).fewest();
        let (before, held) = (few.tips.clone(), few.held.clone());
        let after = few.least_scarred(&eye);
        assert!(after.tips.len() <= before.len(), "{} tips of {}", after.tips.len(), before.len());
        assert!(islands.iter().all(|tip| after.tips.contains(tip)));
        let mut counted = vec![0; held.len()];
        after
            .tips
            .iter()
            .flat_map(|tip| field.holds(*tip).into_owned())
            .for_each(|k| counted[k as usize] += 1);
        assert_eq!(counted, after.held);
        for (before, after) in held.iter().zip(&after.held) {
            assert!(*before == 0 || *after > 0, "a need was held and is not");
        }
        [before, after.tips].map(|tips| {
            let scar = |tip: &u32| eye.scar(field.demand.needs[*tip as usize].at_mm).weight();
            tips.iter().map(scar).sum::<f64>() / tips.len() as f64
        })
    }

    #[test]
    fn tips_leave_edges() {
        let mut saved = 0.0_f64;
        // A balcony that one tip or two hold from many places, and a plate on a leg.
        for (balcony, most) in [([10.0, 4.0, 12.5, 10.0], 0.3), ([0.0, 0.0, 30.0, 30.0], 0.45)] {
            for process in [Process::Filament, Process::Resin] {
                let part = |z: f64| {
                    let wall = [0.0, 0.0, 10.0, 14.0];
                    if z < 6.0 { region(&[wall]) } else { region(&[wall, balcony]) }
                };
                let [before, after] =
                    scars(process, &seen(layers(40, 0.2, part), &Rules::usual(process, 0.2)));
                assert!(
                    after <= before && after <= most,
                    "{balcony:?} {process:?}: {before:.3}, then {after:.3}"
                );
                saved = saved.max(before - after);
            }
        }
        assert!(saved > 0.05, "nothing was won: {saved:.3}");
    }
}
