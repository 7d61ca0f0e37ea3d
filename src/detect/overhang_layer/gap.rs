//! Growth that jumps no gap.
//!
//! The sectors over the held edges of a residual piece may leave it through a free edge
//! and come back in through another: across a slot, or around a corner. [`may_jump`] says whether
//! that can be, and [`spread`] then grows in [`STEPS`] small steps, and after each keeps
//! only what hangs together with what was reached before. A way around a corner is so
//! measured to within one step, and no gap is ever jumped.
use super::held::{Borders, Residual, V, at, cross, distance_2, minus};
use crate::detect::overlap::{Outline, sweep};
use crate::layers::polygon::{grow, intersection, within, without};
use crate::layers::shape::{Region, UNITS_PER_MM};

/// Steps in which growth goes where it could jump.
pub(super) const STEPS: u32 = 4;

type Edge = (V, V);

/// Whether what a held edge holds could come back into the piece through a free edge.
pub(super) fn may_jump(piece: &Residual, reach: f64) -> bool {
    let (mut held, mut free): (Vec<Edge>, Vec<Edge>) = (Vec::new(), Vec::new());
    for (ring, marks) in piece.polygon.rings.iter().zip(&piece.held) {
        for (k, &mark) in marks.iter().enumerate() {
            let edge = (at(ring[k]), at(ring[(k + 1) % ring.len()]));
            if mark { held.push(edge) } else { free.push(edge) }
        }
    }
    let span = |e: &Edge, more: f64| {
        let (low, high) = (e.0[0].min(e.1[0]) - more, e.0[0].max(e.1[0]) + more);
        (low.floor() as i32, high.ceil() as i32)
    };
    let held_spans: Vec<_> = held.iter().map(|e| span(e, reach)).collect();
    let free_spans: Vec<_> = free.iter().map(|e| span(e, 0.0)).collect();
    sweep(&held_spans, &free_spans, |h, f| comes_back(held[h as usize], free[f as usize], reach))
}

/// Whether a way of at most `reach` from the held edge can cross the free one from its
/// outer side (the right) to its inner one.
fn comes_back((a, b): Edge, (c, d): Edge, reach: f64) -> bool {
    let apart = |k: usize| a[k].max(b[k]) + reach < c[k].min(d[k]) || c[k].max(d[k]) + reach < a[k].min(b[k]);
    let side = |p: V, q: V, r: V| cross(minus(q, p), minus(r, p));
    // A step of the grid to the wrong side is rounding.
    let length = minus(d, c)[0].hypot(minus(d, c)[1]);
    let outside = |p: V| side(c, d, p) < -2.0 * length;
    let before = |p: V| side(a, b, p) > 0.0;
    !apart(1) && (outside(a) || outside(b)) && (before(c) || before(d)) && near((a, b), (c, d), reach)
}

/// Whether two edges that do not cross come this near.
fn near((a, b): Edge, (c, d): Edge, reach: f64) -> bool {
    let reach_2 = reach * reach;
    distance_2(a, c, d) <= reach_2
        || distance_2(b, c, d) <= reach_2
        || distance_2(c, a, b) <= reach_2
        || distance_2(d, a, b) <= reach_2
}

/// The piece without what is held, where growth could jump.
pub(super) fn spread(piece: &Residual, borders: &Borders, reach_mm: f64) -> Region {
    let step = reach_mm / f64::from(STEPS);
    let first = within(&piece.polygon.rings, &piece.sectors(step * UNITS_PER_MM));
    let held = |p: &_| borders.residual(Clone::clone(p)).held.iter().flatten().any(|h| *h);
    let mut reached: Region = first.polygons.into_iter().filter(held).collect();
    let whole = Region { polygons: vec![piece.polygon.clone()] };
    for _ in 1..STEPS {
        if reached.is_empty() {
            break;
        }
        let wider = intersection(&whole, &grow(&reached, step));
        let before: Vec<Outline<'_>> = reached.polygons.iter().map(Outline::new).collect();
        let joined = |p: &_| {
            let outline = Outline::new(p);
            before.iter().any(|b| b.overlaps(&outline))
        };
        reached = wider.polygons.iter().filter(|p| joined(p)).cloned().collect();
    }
    without(&piece.polygon.rings, reached.rings())
}
