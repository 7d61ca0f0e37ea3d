//! From demand and space to a forest.
use super::clearance::Clearance;
use super::demand::Demand;
use super::points::{Points, cover, fixed};
use super::rules::Rules;
use super::site::Site;
use super::skeleton::Skeleton;
use super::tree::Forest;
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

/// Supports.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// What is printed.
    pub forest: Forest,
    /// Where tips stand, and what none holds.
    pub points: Points,
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
    let skeleton = Skeleton::new(&site, &points);
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
    Plan { forest, points }
}

#[cfg(test)]
mod tests;
