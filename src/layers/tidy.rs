//! Points that say nothing, taken out of a ring: doubles, points on the straight line
//! between their neighbours, and spikes that run out and straight back.
//!
//! Takes a closed ring, leaves one that encloses the same points, exactly; or none,
//! where it encloses nothing. Knows no other ring.
use super::shape::{Point, Ring};

/// Whether a ring bends at `b`.
fn bends(a: Point, b: Point, c: Point) -> bool {
    let along = |p: Point, q: Point| (i64::from(q.x) - i64::from(p.x), i64::from(q.y) - i64::from(p.y));
    let ((ax, ay), (bx, by)) = (along(a, b), along(b, c));
    ax * by != ay * bx
}

/// Takes out every point at which the ring does not bend; empties a ring that never does.
pub(crate) fn tidy(ring: &mut Ring) {
    let mut kept = 0;
    for k in 0..ring.len() {
        let point = ring[k];
        while kept > 0
            && (ring[kept - 1] == point || kept > 1 && !bends(ring[kept - 2], ring[kept - 1], point))
        {
            kept -= 1;
        }
        ring[kept] = point;
        kept += 1;
    }
    // Where the end meets the beginning.
    let mut from = 0;
    while kept - from > 2 {
        if !bends(ring[kept - 2], ring[kept - 1], ring[from]) {
            kept -= 1;
        } else if !bends(ring[kept - 1], ring[from], ring[from + 1]) {
            from += 1;
        } else {
            break;
        }
    }
    if kept - from > 2 {
        ring.truncate(kept);
        ring.drain(..from);
        ring.shrink_to_fit();
    } else {
        ring.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_bends_stay() {
        let check = |points: &[[i32; 2]], expect: &[[i32; 2]]| {
            let of = |p: &[[i32; 2]]| p.iter().map(|&[x, y]| Point { x, y }).collect::<Ring>();
            let mut ring = of(points);
            tidy(&mut ring);
            assert_eq!(ring, of(expect), "{points:?}");
        };
        check(&[], &[]);
        check(&[[0, 0]], &[]);
        check(&[[0, 0], [1, 0], [1, 0], [0, 0]], &[]);
        check(&[[0, 0], [1, 1], [2, 2], [1, 1]], &[]);
        check(&[[0, 0], [2, 0], [0, 2]], &[[0, 0], [2, 0], [0, 2]]);
        check(&[[0, 0], [0, 0], [1, 0], [2, 0], [2, 0], [1, 1], [0, 2], [0, 1]], &[[0, 0], [2, 0], [0, 2]]);
        // The first point, in the middle of a side.
        check(&[[1, 0], [2, 0], [0, 2], [0, 0]], &[[2, 0], [0, 2], [0, 0]]);
        // A spike outward, and one on a spike, leave nothing behind.
        check(&[[0, 0], [2, 0], [9, 0], [2, 0], [0, 2]], &[[0, 0], [2, 0], [0, 2]]);
        check(&[[0, 0], [2, 0], [9, 0], [9, 5], [9, 0], [2, 0], [0, 2]], &[[0, 0], [2, 0], [0, 2]]);
        check(&[[5, 5], [0, 0], [2, 0], [0, 2], [0, 0]], &[[0, 0], [2, 0], [0, 2]]);
    }
}
