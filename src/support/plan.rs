//! From demand and space to a forest.
use super::clearance::Clearance;
use super::demand::Demand;
use super::points::{Points, Unheld, cover, fixed};
use super::rules::Rules;
use super::site::{Reason, Site};
use super::skeleton::Skeleton;
use super::tree::{Forest, distance};
use super::{grow, improve, vanek};

/// How tips are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placing {
    /// One each fixed distance.
    Fixed,
    /// The fewest.
    Cover,
}

/// How branches run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Branching {
    /// Each on its own.
    Straight,
    /// Trees as in "Clever Support".
    Vanek,
    /// Trees that save most.
    Tree,
}

/// Supports, and what they do not hold.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// What is printed.
    pub forest: Forest,
    /// Where tips stand.
    pub points: Points,
    /// What cannot be held, the lowest first.
    pub unheld: Vec<Unheld>,
    /// Every place of it, mm.
    pub unheld_mm: Vec<[f64; 3]>,
}

type Join = for<'a> fn(&mut Skeleton<'a>);

fn joined<'a>(mut skeleton: Skeleton<'a>, join: Join) -> Skeleton<'a> {
    join(&mut skeleton);
    skeleton
}

/// Plans supports. The same input gives the same plan.
#[must_use]
pub fn plan(
    demand: &Demand,
    space: &Clearance,
    rules: &Rules,
    placing: Placing,
    branching: Branching,
) -> Plan {
    let site = Site::new(space, rules);
    let points = match placing {
        Placing::Fixed => fixed(demand, &site, rules),
        Placing::Cover => cover(demand, &site, rules),
    };
    let (skeleton, lost) = Skeleton::new(&site, &points);
    let forest = match branching {
        Branching::Straight => skeleton,
        Branching::Vanek => joined(skeleton, vanek::join),
        Branching::Tree => {
            // Two beginnings lead to two ends: the cheaper one.
            let made = [grow::join as Join, vanek::join].map(|join| {
                let mut skeleton = joined(skeleton.clone(), join);
                improve::improve(&mut skeleton);
                skeleton
            });
            let [a, b] = made;
            if b.cost() < a.cost() { b } else { a }
        }
    }
    .forest();
    let mut unheld = points.unheld.clone();
    let mut unheld_mm: Vec<[f64; 3]> =
        points.unheld_needs.iter().map(|k| demand.needs[*k as usize].at_mm).collect();
    for k in &lost {
        // All that this tip would have held.
        let at = demand.needs[points.tips[*k].need as usize].at_mm;
        let near = demand.needs.iter().map(|n| n.at_mm).filter(|n| distance(*n, at) <= rules.spacing_mm);
        unheld_mm.extend(near);
    }
    unheld.extend(lost.into_iter().map(|k| {
        let tip = &points.tips[k];
        let need = &demand.needs[tip.need as usize];
        Unheld { place_mm: need.at_mm, area_mm2: tip.area_mm2, island: need.island, reason: Reason::NoFloor }
    }));
    Plan { forest, points, unheld, unheld_mm }
}

#[cfg(test)]
mod tests;
