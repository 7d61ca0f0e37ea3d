//! Open chains of a plane made into rings: what a mesh with holes leaves.
//!
//! Takes chains from rim to rim, gives rings and how wide the gaps were. Knows no
//! mesh. There is no right answer to a hole, only a modest one: ends are joined to
//! the nearest beginnings within [`MAX_GAP`], nearest first; a chain that finds
//! nothing so near is closed by a straight line.
use crate::layers::shape::{Point, Ring};

/// Widest gap over which different chains are joined, grid steps: 2 mm, which spans
/// the holes that mending leaves and seldom reaches another wall.
const MAX_GAP: i64 = 20_000;

/// Beginnings looked at for each end, nearest in x first. More than a few within
/// [`MAX_GAP`] are no surface but a heap of loose triangles, for which time is bounded.
const MAX_CANDIDATES: usize = 64;

/// Widest gap that is none, grid steps: ends that rounding has parted.
const NO_GAP: f64 = 1.5;

/// Rings made of chains.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Joined {
    pub(super) rings: Vec<Ring>,
    /// Rings with a gap in them: one of more than [`NO_GAP`].
    pub(super) open: usize,
    /// Widest gap that a straight line closed, grid steps.
    pub(super) widest: f64,
}

/// A way from the end of a chain to the beginning of one (the same, perhaps).
type Gap = (i64, u32, u32);

fn squared(a: Point, b: Point) -> i64 {
    let (dx, dy) = (i64::from(a.x) - i64::from(b.x), i64::from(a.y) - i64::from(b.y));
    dx * dx + dy * dy
}

/// How far it is, grid steps; nothing where there is no point.
fn gap(from: Option<&Point>, to: Option<&Point>) -> f64 {
    from.zip(to).map_or(0.0, |(&from, &to)| (squared(from, to) as f64).sqrt())
}

/// Joins chains. Gives the same for the same chains in the same order.
pub(super) fn join(chains: &[Ring]) -> Joined {
    let mut next: Vec<Option<u32>> = vec![None; chains.len()];
    let mut taken = vec![false; chains.len()];
    for (_, end, begin) in gaps(chains) {
        if next[end as usize].is_none() && !taken[begin as usize] {
            next[end as usize] = Some(begin);
            taken[begin as usize] = true;
        }
    }
    // What begins nowhere else first: from there a row of chains runs to its end.
    let mut joined = Joined::default();
    let mut used = vec![false; chains.len()];
    let rows = (0..chains.len()).filter(|&c| !taken[c]);
    for start in rows.chain((0..chains.len()).filter(|&c| taken[c])) {
        let mut ring = Ring::new();
        let mut widest = 0.0_f64;
        let mut at = Some(start as u32);
        while let Some(chain) = at.filter(|&c| !used[c as usize]) {
            used[chain as usize] = true;
            let points = &chains[chain as usize];
            widest = widest.max(gap(ring.last(), points.first()));
            ring.extend_from_slice(points);
            at = next[chain as usize];
        }
        if !ring.is_empty() {
            widest = widest.max(gap(ring.last(), ring.first()));
            joined.open += usize::from(widest > NO_GAP);
            joined.widest = joined.widest.max(widest);
            joined.rings.push(ring);
        }
    }
    joined
}

/// Gaps of at most [`MAX_GAP`], narrowest first.
fn gaps(chains: &[Ring]) -> Vec<Gap> {
    let mut begins: Vec<(Point, u32)> =
        (0..).zip(chains).filter_map(|(k, c)| c.first().map(|&p| (p, k))).collect();
    begins.sort_unstable();
    let mut found = Vec::new();
    for (end, chain) in (0_u32..).zip(chains) {
        let Some(&from) = chain.last() else { continue };
        let middle = begins.partition_point(|(p, _)| p.x < from.x);
        let mut look = |&(to, begin): &(Point, u32)| {
            let gap = squared(from, to);
            if gap <= MAX_GAP * MAX_GAP {
                found.push((gap, end, begin));
            }
            (i64::from(to.x) - i64::from(from.x)).abs() <= MAX_GAP
        };
        // As far as the gap may be wide, to the right and to the left.
        let _ = begins[middle..].iter().take(MAX_CANDIDATES).all(&mut look);
        let _ = begins[..middle].iter().rev().take(MAX_CANDIDATES).all(&mut look);
    }
    found.sort_unstable();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chain(points: &[[i32; 2]]) -> Ring {
        points.iter().map(|&[x, y]| Point { x, y }).collect()
    }

    #[test]
    fn ends_find_the_nearest_beginnings() {
        let check = |chains: &[&[[i32; 2]]], rings: &[&[[i32; 2]]], open: usize, widest: f64| {
            let chains: Vec<Ring> = chains.iter().map(|c| chain(c)).collect();
            let rings: Vec<Ring> = rings.iter().map(|r| chain(r)).collect();
            assert_eq!(join(&chains), Joined { rings, open, widest });
        };
        check(&[], &[], 0, 0.0);
        // One with a gap is closed straight, however wide the gap.
        check(
            &[&[[0, 0], [90_000, 0], [90_000, 40_000]]],
            &[&[[0, 0], [90_000, 0], [90_000, 40_000]]],
            1,
            9_700_000_000_f64.sqrt(),
        );
        // Two halves of a square, the second given first.
        check(
            &[&[[100, 103], [0, 100], [0, 4]], &[[0, 0], [100, 0], [100, 100]]],
            &[&[[100, 103], [0, 100], [0, 4], [0, 0], [100, 0], [100, 100]]],
            1,
            4.0,
        );
        // Ends that rounding parted are no gap.
        check(&[&[[0, 0], [9, 0], [9, 9], [1, 1]]], &[&[[0, 0], [9, 0], [9, 9], [1, 1]]], 0, 2_f64.sqrt());
        // A third too far away stays by itself; direction counts, so that ends do not join ends.
        check(
            &[&[[0, 0], [9, 0]], &[[50_000, 0], [50_001, 5]], &[[9, 1], [0, 1]]],
            &[&[[0, 0], [9, 0], [9, 1], [0, 1]], &[[50_000, 0], [50_001, 5]]],
            1,
            26_f64.sqrt(),
        );
    }

    #[test]
    fn twenty_thousand_loose_ends_take_no_time() {
        let chains: Vec<Ring> = (0..20_000).map(|k| chain(&[[k % 7, k], [k % 5, k + 3]])).collect();
        let points: usize = join(&chains).rings.iter().map(Vec::len).sum();
        assert_eq!(points, 40_000);
    }
}
