//! Trees after Vanek, Galicia and Benes, "Clever Support: Efficient Support Structure
//! Generation for Digital Fabrication" (2014): the baseline of paper 000.
//!
//! From the highest place down: a branch goes to the nearest of the plate, the part below
//! it, and the highest meetings of its cone with those of the others. Where the text is
//! silent: what blocks the way to a meeting rules it out, and of equal ones the first counts.
use super::ranked::Ranked;
use super::skeleton::Skeleton;
use crate::mesh::vector::distance;
use std::collections::BinaryHeap;

/// A lowest knot by its height.
type High = Ranked<usize, ()>;

fn high(at_mm: [f64; 3], key: usize) -> High {
    High { value: at_mm[2], key, item: () }
}

/// Lets branches meet.
pub(super) fn join(skeleton: &mut Skeleton<'_>) {
    let all = 0..skeleton.knots.len();
    let mut lowest: Vec<usize> = all.filter(|k| skeleton.may_join(*k)).collect();
    let mut queue: BinaryHeap<High> = lowest.iter().map(|k| high(skeleton.knots[*k].at_mm, *k)).collect();
    while let Some(Ranked { key: a, .. }) = queue.pop() {
        if skeleton.knots[a].down.is_some() {
            continue;
        }
        lowest.retain(|k| *k != a && skeleton.knots[*k].down.is_none());
        let ground = skeleton.knots[a].way.as_ref().map_or(f64::INFINITY, |way| way.length_mm);
        let mut near: Vec<(f64, usize, [f64; 3])> = lowest
            .iter()
            .filter_map(|b| {
                let at = skeleton.cone_meeting(a, *b)?;
                let length = distance(skeleton.knots[a].at_mm, at);
                (length < ground).then_some((length, *b, at))
            })
            .collect();
        near.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
        let found = near.into_iter().find_map(|(_, b, at)| {
            let fits = skeleton.fits(a, at) && skeleton.fits(b, at);
            let way = fits.then(|| skeleton.site.way(at)).flatten()?;
            Some((b, at, way))
        });
        if let Some((b, at, way)) = found {
            let new = skeleton.join(a, b, at, way);
            lowest.push(new);
            queue.push(high(at, new));
        }
    }
}
