//! Whether edges cross each other so often that a boolean of them would not end.
//!
//! Takes the edges of contours or of beads, gives an estimate of how many pairs of
//! them cross. A boolean holds every crossing in memory, and a small file can have
//! billions: some thousand bodies that all overlap, lines drawn across each other
//! everywhere. What is to be printed has a few for each body, or a few for each line.
//! Knows no region.
use super::shape::Point;

/// Pairs looked at for each edge: at least 32 of them cross where the limit is reached.
const SAMPLES_PER_EDGE: usize = 16;

/// About how many pairs of edges cross, where that is more than `free` and more than
/// there are edges: those many are no trouble. Pairs are drawn evenly from all, always
/// the same ones for the same edges, so that the estimate holds wherever the crossings
/// lie; at the limit it is right within about a third.
pub(super) fn tangled(edges: impl Iterator<Item = [Point; 2]> + Clone, free: u64) -> Option<u64> {
    let count = edges.clone().count();
    let pairs = (count as u64).saturating_mul(count as u64) / 2;
    let limit = free.max(count as u64);
    if pairs <= limit {
        return None;
    }
    let edges: Vec<[Point; 2]> = edges.collect();
    let mut state = 0_u64;
    let mut draw = || {
        // SplitMix64; the upper half of a product spreads evenly over the edges.
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((u128::from(z ^ (z >> 31)) * edges.len() as u128) >> 64) as usize
    };
    let samples = SAMPLES_PER_EDGE * count;
    let found = (0..samples).filter(|_| cross(edges[draw()], edges[draw()])).count() as u64;
    let estimate = (u128::from(found) * u128::from(pairs) / samples as u128) as u64;
    (estimate > limit).then_some(estimate)
}

/// Whether two edges cross within both.
fn cross([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let side = |a: Point, b: Point, p: Point| {
        let along = |q: Point| (i64::from(q.x) - i64::from(a.x), i64::from(q.y) - i64::from(a.y));
        let ((bx, by), (px, py)) = (along(b), along(p));
        (bx * py - by * px).signum()
    };
    side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::{Ring, ring_edges};

    /// Upright needles, and as many lying ones that cross each of them `times` = 4 ways, or none.
    fn needles(count: i32, crossing: bool) -> Vec<Ring> {
        let ring = |p: [[i32; 2]; 3]| p.map(|[x, y]| Point { x, y }).to_vec();
        let upright = (0..count).map(|k| ring([[9 * k, 0], [9 * k + 4, 0], [9 * k + 2, 9 * count]]));
        let away = if crossing { 0 } else { 20 * count };
        let lying =
            (0..count).map(|k| ring([[away, 9 * k + 2], [away, 9 * k], [away + 9 * count, 9 * k + 1]]));
        upright.chain(lying).collect()
    }

    #[test]
    fn crossings_are_counted_well_enough() {
        let check = |count: i32, crossing: bool, expect: Option<u64>| {
            let rings = needles(count, crossing);
            let found = tangled(rings.iter().flat_map(|ring| ring_edges(ring)), 1 << 18);
            assert_eq!(found.is_some(), expect.is_some(), "{count}: {found:?}");
            let (found, expect) = (found.unwrap_or_default(), expect.unwrap_or_default());
            assert!(found.abs_diff(expect) <= expect / 4, "{found} instead of {expect}");
        };
        check(100, true, None);
        check(200, true, None);
        // Nearly every needle of one kind crosses nearly every one of the other four times.
        check(800, true, Some(4 * 800 * 800));
        check(2000, false, None);
    }

    #[test]
    fn lines_that_cross_everywhere_are_told_from_a_grid() {
        // Lines from side to side of a plate of 200 mm, every way.
        let line = |k: usize, n: usize| {
            let t = k as f64 / n as f64;
            let at = |v: f64| (v * 2_000_000.0) as i32;
            if k.is_multiple_of(2) {
                [Point { x: at(t), y: 0 }, Point { x: at(1.0 - t), y: at(1.0) }]
            } else {
                [Point { x: 0, y: at(t) }, Point { x: at(1.0), y: at(1.0 - t) }]
            }
        };
        let check = |n: usize, expect: bool| {
            assert_eq!(tangled((0..n).map(|k| line(k, n)), 60_000).is_some(), expect, "{n}");
        };
        check(200, false);
        check(300, false);
        check(1000, true);
        // Many short ones, side by side.
        let short = (0..20_000).flat_map(|k| {
            let [a, b, c] = [[0, 0], [0, 900], [150, 0]].map(|[x, y]| Point { x: 100 * k + x, y });
            [[a, b], [b, c]]
        });
        assert_eq!(tangled(short, 60_000), None);
    }
}
