//! Branches while they are still being laid out: knots, and the ways of the lowest.
//!
//! A knot is the end of a tip's head or a place where branches meet; between knots branches
//! are straight. The lowest knot of a tree has a [`Way`] to what it stands on. Methods
//! build skeletons; [`Skeleton::forest`] gives what is printed.
use super::points::Points;
use super::site::{Floor, Head, Site, Way};
use super::tree::{Forest, GROUND, Kind, frustum_mm3, leans_within};
use crate::mesh::vector::distance;

/// The end of a head, or a meeting.
#[derive(Clone, Debug)]
pub(super) struct Knot {
    pub(super) at_mm: [f64; 3],
    /// The knot that it stands on; `None` where it has a way of its own.
    pub(super) down: Option<usize>,
    pub(super) ups: Vec<usize>,
    /// Tips that it carries.
    pub(super) load: u32,
    /// Longest way up to one of these, mm.
    pub(super) length_mm: f64,
    /// The end of a head, which stays where it is.
    pub(super) head: Option<Head>,
    /// It is part of the skeleton.
    pub(super) alive: bool,
    pub(super) way: Option<Way>,
}

/// Branches on their way down.
#[derive(Clone, Debug)]
pub(super) struct Skeleton<'a> {
    pub(super) site: &'a Site<'a>,
    pub(super) knots: Vec<Knot>,
}

/// Where two branches would meet, and what all would cost then.
#[derive(Clone, Debug)]
pub(super) struct Meeting {
    pub(super) at_mm: [f64; 3],
    pub(super) cost: f64,
    pub(super) way: Way,
}

impl<'a> Skeleton<'a> {
    /// Heads alone, each with its way down: that there is one is how it was chosen
    /// ([`Site::head`]).
    pub(super) fn new(site: &'a Site<'a>, points: &Points) -> Skeleton<'a> {
        let knot = |head: Head| {
            let way = site.way(head.end_mm)?;
            Some(Knot {
                at_mm: head.end_mm,
                down: None,
                ups: Vec::new(),
                load: 1,
                length_mm: distance(head.contact_mm, head.end_mm),
                head: Some(head),
                alive: true,
                way: Some(way),
            })
        };
        Skeleton { site, knots: points.tips.iter().filter_map(|tip| knot(tip.head)).collect() }
    }

    /// Whether a branch may leave this knot for another than its own way: one that stands on
    /// the plate may not.
    pub(super) fn may_join(&self, k: usize) -> bool {
        self.knots[k].at_mm[2] > self.site.rules.foot_height_mm
    }

    /// Cost of the branch from a knot to a place below, mm³.
    pub(super) fn branch_cost(&self, k: usize, to_mm: [f64; 3]) -> f64 {
        self.cost_between(k, self.knots[k].at_mm, to_mm)
    }

    /// The same if the knot were elsewhere.
    pub(super) fn cost_between(&self, k: usize, from_mm: [f64; 3], to_mm: [f64; 3]) -> f64 {
        let knot = &self.knots[k];
        let radius = self.site.rules.radius_mm(knot.load, knot.length_mm);
        frustum_mm3(distance(from_mm, to_mm), [radius; 2])
    }

    /// Cost of a lowest knot's way.
    pub(super) fn way_cost(&self, k: usize) -> f64 {
        let knot = &self.knots[k];
        knot.way.as_ref().map_or(0.0, |way| self.site.cost(way, knot.load, knot.length_mm))
    }

    /// Whether a branch from a knot may run straight to a place.
    pub(super) fn fits(&self, k: usize, to_mm: [f64; 3]) -> bool {
        let from_mm = self.knots[k].at_mm;
        leans_within(from_mm, to_mm, self.site.slope) && self.site.branch_fits(from_mm, to_mm)
    }

    /// What a meeting of two lowest knots at a place would cost.
    fn meeting(&self, a: usize, b: usize, at_mm: [f64; 3]) -> Option<Meeting> {
        if at_mm[2] <= self.site.rules.foot_height_mm || !self.fits(a, at_mm) || !self.fits(b, at_mm) {
            return None;
        }
        let way = self.site.way(at_mm)?;
        let tips = self.knots[a].load + self.knots[b].load;
        let length = [a, b].map(|k| self.knots[k].length_mm + distance(self.knots[k].at_mm, at_mm));
        let below = self.site.cost(&way, tips, length[0].max(length[1]));
        let cost = self.branch_cost(a, at_mm) + self.branch_cost(b, at_mm) + below;
        Some(Meeting { at_mm, cost, way })
    }

    /// The highest place where the cones below two knots meet (Vanek, Galicia and Benes,
    /// "Clever Support", 2014): `None` where that is below the plate.
    pub(super) fn cone_meeting(&self, a: usize, b: usize) -> Option<[f64; 3]> {
        self.meeting_at(a, b, 0.0)
    }

    /// The same, lower by `lower_mm`, each branch leaning alike.
    fn meeting_at(&self, a: usize, b: usize, lower_mm: f64) -> Option<[f64; 3]> {
        let (p, q) = (self.knots[a].at_mm, self.knots[b].at_mm);
        let slope = self.site.slope;
        let flat = (p[0] - q[0]).hypot(p[1] - q[1]);
        let z = ((p[2] + q[2] - flat / slope) / 2.0).min(p[2]).min(q[2]) - lower_mm;
        let (from_p, from_q) = (slope * (p[2] - z), slope * (q[2] - z));
        let all = from_p + from_q;
        if z <= 0.0 {
            return None;
        }
        if all <= 1e-9 {
            return Some([p[0], p[1], z]);
        }
        // No further than where the other one is.
        let share = (from_p / all * flat).max(flat - from_q).min(from_p.min(flat)).max(0.0);
        let t = if flat > 1e-9 { share / flat } else { 0.0 };
        Some([p[0] + (q[0] - p[0]) * t, p[1] + (q[1] - p[1]) * t, z])
    }

    /// Below one knot, where the other one reaches it.
    fn under(&self, a: usize, b: usize, lower_mm: f64) -> Option<[f64; 3]> {
        let (p, q) = (self.knots[a].at_mm, self.knots[b].at_mm);
        let flat = (p[0] - q[0]).hypot(p[1] - q[1]);
        let z = (p[2] - flat / self.site.slope).min(q[2]) - lower_mm;
        (z > 0.0).then_some([q[0], q[1], z])
    }

    /// The cheapest meeting of two lowest knots, if any is cheaper than two ways.
    pub(super) fn best_meeting(&self, a: usize, b: usize) -> Option<Meeting> {
        let apart = self.way_cost(a) + self.way_cost(b);
        let mut best: Option<Meeting> = None;
        for lower_mm in [0.0, 0.6, 1.5, 4.0, 8.0] {
            let places =
                [self.meeting_at(a, b, lower_mm), self.under(a, b, lower_mm), self.under(b, a, lower_mm)];
            for at_mm in places.into_iter().flatten() {
                let found = self.meeting(a, b, at_mm);
                if let Some(found) = found.filter(|f| f.cost < best.as_ref().map_or(apart, |b| b.cost)) {
                    best = Some(found);
                }
            }
            if best.is_some() {
                break;
            }
        }
        best
    }

    /// Two lowest knots meet; gives the new knot.
    pub(super) fn join(&mut self, a: usize, b: usize, at_mm: [f64; 3], way: Way) -> usize {
        let new = self.knots.len();
        let mut length_mm = 0.0_f64;
        for k in [a, b] {
            let knot = &mut self.knots[k];
            (knot.down, knot.way) = (Some(new), None);
            length_mm = length_mm.max(knot.length_mm + distance(knot.at_mm, at_mm));
        }
        let load = self.knots[a].load + self.knots[b].load;
        self.knots.push(Knot {
            at_mm,
            down: None,
            ups: vec![a, b],
            load,
            length_mm,
            head: None,
            alive: true,
            way: Some(way),
        });
        new
    }

    /// What is printed.
    pub(super) fn forest(&self) -> Forest {
        let rules = self.site.rules;
        let mut forest = Forest::default();
        let mut index = vec![GROUND; self.knots.len()];
        for (k, knot) in self.knots.iter().enumerate().filter(|(_, k)| k.alive) {
            index[k] = forest.push(knot.at_mm, Kind::Joint, GROUND, rules.branch_mm / 2.0);
        }
        for (k, knot) in self.knots.iter().enumerate().filter(|(_, k)| k.alive) {
            let own = index[k];
            if let Some(head) = knot.head {
                let node = &mut forest.nodes[own as usize];
                (node.radius_mm, node.fixed) = (head.end_radius_mm, true);
                forest.push(head.contact_mm, Kind::Tip, own, head.contact_radius_mm);
            }
            match (knot.down, &knot.way) {
                (Some(down), _) => forest.nodes[own as usize].down = index[down],
                (None, Some(way)) => put_way(&mut forest, own, way, rules.tip_mm / 2.0),
                (None, None) => {}
            }
        }
        forest.thicken(rules, |from, to| self.site.room_mm(from, to));
        forest
    }
}

/// Adds a way below a node.
fn put_way(forest: &mut Forest, top: u32, way: &Way, tip_radius_mm: f64) {
    let Some((last, bends)) = way.points_mm.split_last() else {
        // The head itself stands on the plate.
        let node = &mut forest.nodes[top as usize];
        (node.kind, node.fixed) = (Kind::Plate, true);
        return;
    };
    let mut above = top;
    for at_mm in bends {
        let bend = forest.push(*at_mm, Kind::Joint, GROUND, forest.nodes[top as usize].radius_mm);
        forest.nodes[above as usize].down = bend;
        above = bend;
    }
    let (kind, radius_mm) = match way.floor {
        Floor::Plate => (Kind::Plate, forest.nodes[above as usize].radius_mm),
        Floor::Model => (Kind::Model, tip_radius_mm),
    };
    let foot = forest.push(*last, kind, GROUND, radius_mm);
    forest.nodes[above as usize].down = foot;
}
