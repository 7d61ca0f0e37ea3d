//! Trees made better as long as their cost falls: knots moved, branches led elsewhere.
//!
//! A round goes over all knots in order. Each meeting is moved by steps that get finer;
//! each branch is tried on the other branches and ways near it, and on a way of its own.
//! What is cheaper when all that it changes is counted stays. A round that gains less than
//! one part in a thousand is the last.
use super::site::Way;
use super::skeleton::{Knot, Skeleton};
use super::tree::leans_within;
use crate::mesh::vector::distance;

/// Rounds at most.
const ROUNDS: u32 = 8;

/// Steps by which a meeting is moved, mm.
const STEPS_MM: [f64; 4] = [2.0, 0.8, 0.3, 0.1];

/// Branches that a branch is tried on, the nearest.
const PLACES: usize = 10;

/// Cost less than this is none, mm³.
const EPSILON: f64 = 1e-6;

/// Makes trees better.
pub(super) fn improve(skeleton: &mut Skeleton<'_>) {
    let mut cost = skeleton.cost();
    for _ in 0..ROUNDS {
        for k in 0..skeleton.knots.len() {
            if skeleton.knots[k].alive {
                skeleton.shift(k);
            }
        }
        for k in 0..skeleton.knots.len() {
            if skeleton.knots[k].alive && skeleton.may_join(k) {
                skeleton.lead_elsewhere(k);
            }
        }
        let now = skeleton.cost();
        if now > cost * 0.999 {
            break;
        }
        cost = now;
    }
}

/// Where a branch could end: on the branch below a knot, at a place.
#[derive(Clone, Copy)]
struct Goal {
    /// Knot above the branch.
    above: usize,
    at_mm: [f64; 3],
    /// Index of the way's point that comes next, where it is a way.
    next: Option<usize>,
    estimate: f64,
}

impl Skeleton<'_> {
    /// Cost of everything, mm³.
    pub(super) fn cost(&self) -> f64 {
        (0..self.knots.len())
            .filter(|k| self.knots[*k].alive && self.knots[*k].down.is_none())
            .map(|k| self.tree_cost(k))
            .sum()
    }

    fn root(&self, mut k: usize) -> usize {
        while let Some(down) = self.knots[k].down {
            k = down;
        }
        k
    }

    /// Cost of the tree that stands on a lowest knot.
    fn tree_cost(&self, root: usize) -> f64 {
        let mut cost = self.way_cost(root);
        let mut todo = self.knots[root].ups.clone();
        while let Some(k) = todo.pop() {
            let down = self.knots[k].down.unwrap_or(root);
            cost += self.branch_cost(k, self.knots[down].at_mm);
            todo.extend(&self.knots[k].ups);
        }
        cost
    }

    /// Moves a meeting to where its branches are cheapest.
    fn shift(&mut self, k: usize) {
        if self.knots[k].head.is_some() {
            return;
        }
        for step in STEPS_MM {
            for _ in 0..6 {
                let Some((at_mm, way)) = self.better_place(k, step) else { break };
                self.knots[k].at_mm = at_mm;
                if self.knots[k].down.is_none() {
                    self.knots[k].way = way;
                }
                self.recount(k);
            }
        }
    }

    fn better_place(&self, k: usize, step: f64) -> Option<([f64; 3], Option<Way>)> {
        let at = self.knots[k].at_mm;
        let mut best = (self.cost_at(k, at, self.knots[k].way.as_ref()) - EPSILON, None);
        for d in 0..26 {
            // All neighbours of a cube but its middle.
            let d = if d < 13 { d } else { d + 1 };
            let by = [d % 3, d / 3 % 3, d / 9].map(|c| f64::from(c) - 1.0);
            let to = [0, 1, 2].map(|c| at[c] + by[c] * step);
            if to[2] <= self.site.rules.foot_height_mm {
                continue;
            }
            let fits =
                self.knots[k].ups.iter().all(|up| leans_within(self.knots[*up].at_mm, to, self.site.slope));
            if !fits {
                continue;
            }
            let way = match self.knots[k].down {
                Some(down) if leans_within(to, self.knots[down].at_mm, self.site.slope) => None,
                Some(_) => continue,
                None => match self.site.way(to) {
                    Some(way) => Some(way),
                    None => continue,
                },
            };
            let cost = self.cost_at(k, to, way.as_ref());
            if cost >= best.0 {
                continue;
            }
            let clear = self.knots[k].ups.iter().all(|up| self.site.branch_fits(self.knots[*up].at_mm, to));
            let clear = clear
                && self.knots[k].down.is_none_or(|down| self.site.branch_fits(to, self.knots[down].at_mm));
            if clear {
                best = (cost, Some((to, way)));
            }
        }
        best.1
    }

    /// Cost of the branches at a meeting if it were there.
    fn cost_at(&self, k: usize, at_mm: [f64; 3], way: Option<&Way>) -> f64 {
        let above: f64 = self.knots[k].ups.iter().map(|up| self.branch_cost(*up, at_mm)).sum();
        let knot = &self.knots[k];
        let below = match knot.down {
            Some(down) => self.cost_between(k, at_mm, self.knots[down].at_mm),
            None => way.map_or(0.0, |way| self.site.cost(way, knot.load, knot.length_mm)),
        };
        above + below
    }

    /// Counts loads and lengths anew from a knot down.
    fn recount(&mut self, k: usize) {
        let mut at = Some(k);
        while let Some(k) = at {
            let (mut load, mut length_mm) = (0, 0.0_f64);
            if let Some(head) = self.knots[k].head {
                (load, length_mm) = (1, distance(head.contact_mm, head.end_mm));
            }
            for up in &self.knots[k].ups {
                let up = &self.knots[*up];
                load += up.load;
                length_mm = length_mm.max(up.length_mm + distance(up.at_mm, self.knots[k].at_mm));
            }
            (self.knots[k].load, self.knots[k].length_mm) = (load, length_mm);
            at = self.knots[k].down;
        }
    }

    /// Tries a branch on others.
    fn lead_elsewhere(&mut self, k: usize) {
        let own_root = self.root(k);
        let now = match self.knots[k].down {
            Some(down) => self.branch_cost(k, self.knots[down].at_mm),
            None => self.way_cost(k),
        };
        let mut goals = self.goals(k);
        goals.retain(|g| g.estimate < now - EPSILON);
        goals.sort_by(|a, b| a.estimate.total_cmp(&b.estimate).then(a.above.cmp(&b.above)));
        goals.truncate(PLACES);
        for goal in goals {
            if !self.site.branch_fits(self.knots[k].at_mm, goal.at_mm) {
                continue;
            }
            let other_root = self.root(goal.above);
            let before = self.tree_cost(own_root)
                + if other_root == own_root { 0.0 } else { self.tree_cost(other_root) };
            let kept = self.keep(k, goal.above);
            let count = self.knots.len();
            if self.lead(k, goal) {
                let mut roots: Vec<usize> = vec![self.root(k)];
                // What has lost the branch may stand elsewhere.
                roots.extend(kept.iter().filter(|(k, _)| self.knots[*k].alive).map(|(k, _)| self.root(*k)));
                roots.sort_unstable();
                roots.dedup();
                let after: f64 = roots.iter().map(|r| self.tree_cost(*r)).sum();
                if after < before - EPSILON {
                    return;
                }
            }
            self.knots.truncate(count);
            for (k, knot) in kept {
                self.knots[k] = knot;
            }
        }
    }

    /// All knots that leading a branch elsewhere could change, as they are.
    fn keep(&self, k: usize, above: usize) -> Vec<(usize, Knot)> {
        let mut kept: Vec<usize> = Vec::new();
        for start in [k, above] {
            let mut at = Some(start);
            while let Some(k) = at {
                kept.push(k);
                at = self.knots[k].down;
            }
        }
        if let Some(down) = self.knots[k].down {
            kept.extend(&self.knots[down].ups);
        }
        kept.sort_unstable();
        kept.dedup();
        kept.into_iter().map(|k| (k, self.knots[k].clone())).collect()
    }

    /// Leads a branch to a place on another. `false`: what it leaves cannot stand without it.
    fn lead(&mut self, k: usize, goal: Goal) -> bool {
        if let Some(down) = self.knots[k].down {
            self.knots[down].ups.retain(|up| *up != k);
            self.knots[k].down = None;
            if !self.leave(down, goal.above) {
                return false;
            }
        }
        let new = self.knots.len();
        let below = self.knots[goal.above].down;
        let way = match (below, goal.next) {
            (None, Some(next)) => {
                let Some(way) = &self.knots[goal.above].way else { return false };
                let rest = Way::new(goal.at_mm, way.points_mm[next..].to_vec(), way.floor);
                // The branch above it has no bends of its own any more.
                if !self.fits(goal.above, goal.at_mm) {
                    return false;
                }
                Some(rest)
            }
            (Some(_), None) => None,
            // It was led elsewhere in between.
            _ => return false,
        };
        self.knots.push(Knot {
            at_mm: goal.at_mm,
            down: below,
            ups: vec![k, goal.above],
            load: 0,
            length_mm: 0.0,
            head: None,
            alive: true,
            way,
        });
        if let Some(below) = below {
            let ups = &mut self.knots[below].ups;
            ups.retain(|up| *up != goal.above);
            ups.push(new);
        }
        for up in [k, goal.above] {
            (self.knots[up].down, self.knots[up].way) = (Some(new), None);
        }
        self.recount(new);
        true
    }

    /// A meeting that has lost a branch: with one left it is none, and that one goes on
    /// straight to what is below.
    fn leave(&mut self, k: usize, keep: usize) -> bool {
        if self.knots[k].ups.len() != 1 || k == keep {
            self.recount(k);
            return !self.knots[k].ups.is_empty();
        }
        let up = self.knots[k].ups[0];
        match self.knots[k].down {
            Some(down) => {
                if !self.fits(up, self.knots[down].at_mm) {
                    self.recount(k);
                    return true;
                }
                let ups = &mut self.knots[down].ups;
                ups.retain(|u| *u != k);
                ups.push(up);
                self.knots[up].down = Some(down);
                self.knots[k].alive = false;
                self.recount(down);
            }
            None => {
                let Some(way) = self.site.way(self.knots[up].at_mm) else {
                    self.recount(k);
                    return true;
                };
                (self.knots[up].down, self.knots[up].way) = (None, Some(way));
                self.knots[k].alive = false;
            }
        }
        true
    }

    /// Places on other branches where a branch could end, with what it would cost itself.
    fn goals(&self, k: usize) -> Vec<Goal> {
        let from = self.knots[k].at_mm;
        let own = self.knots[k].down;
        // What stands on this knot must not carry it.
        let mut above = vec![false; self.knots.len()];
        let mut todo = vec![k];
        while let Some(k) = todo.pop() {
            above[k] = true;
            todo.extend(&self.knots[k].ups);
        }
        let mut goals = Vec::new();
        for (j, knot) in self.knots.iter().enumerate() {
            if above[j] || !knot.alive || !self.may_join(j) || knot.at_mm[2] > from[2] + 60.0 {
                continue;
            }
            let mut put = |a: [f64; 3], b: [f64; 3], next: Option<usize>| {
                if let Some(at_mm) = self.meets(from, a, b) {
                    let estimate = self.branch_cost(k, at_mm);
                    goals.push(Goal { above: j, at_mm, next, estimate });
                }
            };
            match (&knot.down, &knot.way) {
                (Some(down), _) if own != Some(*down) => put(knot.at_mm, self.knots[*down].at_mm, None),
                (None, Some(way)) => {
                    let mut a = knot.at_mm;
                    for (next, b) in way.points_mm.iter().enumerate() {
                        // The first stretch only: what is above would have to bend.
                        if next < 2 {
                            put(a, *b, Some(next));
                        }
                        a = *b;
                    }
                }
                _ => {}
            }
        }
        goals
    }

    /// The highest place on a branch from `a` down to `b` that a branch from `from` reaches.
    fn meets(&self, from: [f64; 3], a: [f64; 3], b: [f64; 3]) -> Option<[f64; 3]> {
        let low = self.site.rules.foot_height_mm;
        let at = |t: f64| [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t);
        let reached = |p: [f64; 3]| leans_within(from, p, self.site.slope);
        // The share of the branch that counts: it ends above the foot, and branches need room
        // to meet.
        let end = if b[2] < low { ((a[2] - low) / (a[2] - b[2])).clamp(0.0, 1.0) } else { 1.0 };
        let (mut lo, mut hi) = (0.02, end * 0.98);
        if lo >= hi || !reached(at(hi)) {
            return None;
        }
        if reached(at(lo)) {
            return Some(at(lo));
        }
        for _ in 0..20 {
            let middle = (lo + hi) / 2.0;
            if reached(at(middle)) { hi = middle } else { lo = middle }
        }
        Some(at(hi))
    }
}
