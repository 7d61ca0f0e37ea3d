//! Our trees: again and again the meeting that saves most.
//!
//! Every two lowest knots that are near each other have a cheapest meeting; the one that
//! saves the most material of all is made first, and its knot looks for meetings in turn.
//! What this leaves is for [`super::improve`].
use super::ranked::Ranked;
use super::skeleton::{Meeting, Skeleton};
use rayon::prelude::*;
use std::collections::BinaryHeap;

/// Neighbours that a knot looks at.
const NEIGHBOURS: usize = 12;

/// A meeting of two, by what it saves.
type Offer = Ranked<[usize; 2], Meeting>;

/// Lets branches meet.
pub(super) fn join(skeleton: &mut Skeleton<'_>) {
    let all = 0..skeleton.knots.len();
    let mut lowest: Vec<usize> = all.filter(|k| skeleton.may_join(*k)).collect();
    let first: Vec<Vec<Offer>> = lowest.par_iter().map(|a| offers(skeleton, *a, &lowest)).collect();
    let mut queue: BinaryHeap<Offer> = first.into_iter().flatten().collect();
    while let Some(Ranked { key: [a, b], item: meeting, .. }) = queue.pop() {
        if skeleton.knots[a].down.is_some() || skeleton.knots[b].down.is_some() {
            continue;
        }
        let new = skeleton.join(a, b, meeting.at_mm, meeting.way);
        lowest.retain(|k| skeleton.knots[*k].down.is_none());
        queue.extend(offers(skeleton, new, &lowest));
        lowest.push(new);
    }
}

fn offers(skeleton: &Skeleton<'_>, a: usize, lowest: &[usize]) -> Vec<Offer> {
    let at = skeleton.knots[a].at_mm;
    let mut near: Vec<(f64, usize)> = lowest
        .iter()
        .filter(|b| **b != a)
        .map(|b| {
            let other = skeleton.knots[*b].at_mm;
            let flat = (at[0] - other[0]).hypot(at[1] - other[1]);
            // What is apart in height only meets for nothing.
            (flat + 0.2 * (at[2] - other[2]).abs(), *b)
        })
        .collect();
    let order = |x: &(f64, usize), y: &(f64, usize)| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1));
    if near.len() > NEIGHBOURS {
        near.select_nth_unstable_by(NEIGHBOURS, order);
        near.truncate(NEIGHBOURS);
    }
    near.sort_by(order);
    near.into_iter()
        .filter_map(|(_, b)| {
            let meeting = skeleton.best_meeting(a, b)?;
            let saves = skeleton.way_cost(a) + skeleton.way_cost(b) - meeting.cost;
            (saves > 1e-9).then_some(Offer { value: saves, key: [a.min(b), a.max(b)], item: meeting })
        })
        .collect()
}
