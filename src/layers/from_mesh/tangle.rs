//! Whether contours cross each other so often that untangling them would not end.
//!
//! Takes rings, gives an estimate of how many pairs of their edges cross. A boolean
//! holds every crossing in memory, and a small file (some thousand bodies that all
//! overlap) can have billions. Real parts with overlapping bodies have a few for each
//! body. Knows no region.
use crate::layers::shape::{Point, Ring};

/// Crossings that are no trouble: about 100 MB while a thread untangles them.
const FREE: u64 = 1 << 18;

/// Crossings for each edge that are no trouble either.
const FREE_PER_EDGE: u64 = 1;

/// Pairs looked at for each edge: at least 32 of them cross where the limit is reached.
const SAMPLES_PER_EDGE: usize = 16;

/// About how many pairs of edges cross, where that is beyond what can be untangled.
/// Pairs are drawn evenly from all, always the same ones for the same rings, so that
/// the estimate holds wherever the crossings lie; it is right within about a third.
pub(super) fn tangled(rings: &[Ring]) -> Option<u64> {
    let count = rings.iter().map(Vec::len).sum::<usize>();
    let pairs = (count as u64).saturating_mul(count as u64) / 2;
    let limit = FREE.max(FREE_PER_EDGE * count as u64);
    if pairs <= limit {
        return None;
    }
    let mut edges: Vec<[Point; 2]> = Vec::with_capacity(count);
    for ring in rings.iter().filter(|r| !r.is_empty()) {
        edges.extend(ring.windows(2).map(|e| [e[0], e[1]]));
        edges.push([ring[ring.len() - 1], ring[0]]);
    }
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
            let found = tangled(&needles(count, crossing));
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
}
