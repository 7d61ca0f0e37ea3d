//! Residual pieces as strips: what of them needs no boolean to be proved held.
//!
//! Most residual pieces are strips between the border of what is below (the held chain)
//! and the polygon's own border (the free chain). A strip is zipped up: triangles are
//! drawn between the two chains, from one end to the other. If all of them turn the right
//! way they tile the piece: a map of a disc onto the plane that keeps the orientation
//! everywhere and runs once around the piece's border covers each of its points once.
//!
//! A triangle that lies within reach of a held edge or vertex *of its own* is held, each
//! of its points by a straight way inside the piece. The others come in runs; only these
//! are left to booleans, with the held edges beside them along the border: nothing across
//! a gap is asked, and a notch narrower than the reach is measured across. A piece that
//! cannot be zipped (no point behind a slot sees a held edge) is no strip.
use super::held::{Residual, V, at, cross, distance_2, minus};
use crate::layers::shape::{Point, Ring};

/// A triangle may be turned the wrong way by this, grid steps, since booleans round.
const ROUNDED: f64 = 1.5;

/// Held edges this far beyond the ends of a run, in parts of the reach along the border,
/// are asked too: more than one, since a border that winds comes back near.
const WINDOW: f64 = 4.0;

/// A part of a strip that is not proved held.
#[derive(Debug)]
pub(super) struct Run {
    /// Its border.
    pub(super) ring: Ring,
    /// The ring of the piece that its held edges belong to.
    pub(super) of: usize,
    /// The first held edge within reach, by the index in that ring.
    pub(super) from: usize,
    /// Number of held edges within reach.
    pub(super) edges: usize,
}

/// Two chains with the piece between them. Along the piece's border `held` comes first.
struct Strip {
    held: Vec<Point>,
    free: Vec<Point>,
    of: usize,
    /// Index in the ring of the first held point, and the ring's length.
    from: usize,
    around: usize,
    /// Whether the held chain is a whole ring.
    closed: bool,
}

impl Strip {
    fn of(piece: &Residual) -> Option<Strip> {
        match piece.polygon.rings.as_slice() {
            [ring] => {
                let (held, n) = (&piece.held[0], ring.len());
                // One held chain alone: exactly one edge is held after a free one.
                let mut starts = (0..n).filter(|&k| held[k] && !held[(k + n - 1) % n]);
                let (Some(from), None) = (starts.next(), starts.next()) else { return None };
                let length = held.iter().filter(|h| **h).count();
                let chain = |from: usize, edges: usize| (0..=edges).map(|k| ring[(from + k) % n]).collect();
                let free = chain(from + length, n - length);
                Some(Strip { held: chain(from, length), free, of: 0, from, around: n, closed: false })
            }
            [_, _] => {
                let all = |k: usize, as_held: bool| piece.held[k].iter().all(|h| *h == as_held);
                let of = (0..2).find(|&k| all(k, true) && all(1 - k, false))?;
                let (held, free) = (&piece.polygon.rings[of], &piece.polygon.rings[1 - of]);
                let off = |k: &usize| minus(at(free[*k]), at(*held.first().unwrap_or(&free[0])));
                let first = (0..free.len()).min_by(|a, b| {
                    let length = |v: V| v[0].hypot(v[1]);
                    length(off(a)).total_cmp(&length(off(b)))
                })?;
                let closed = |ring: &Ring, from: usize| -> Vec<Point> {
                    (0..=ring.len()).map(|k| ring[(from + k) % ring.len()]).collect()
                };
                let around = held.len();
                Some(Strip {
                    held: closed(held, 0),
                    free: closed(free, first),
                    of,
                    from: 0,
                    around,
                    closed: true,
                })
            }
            _ => None,
        }
    }

    /// The run between two states of the zipper, with the held edges within reach.
    fn run(&self, open: (usize, usize), shut: (usize, usize), reach: f64) -> Run {
        let ring: Ring =
            self.held[shut.0..=open.0].iter().chain(&self.free[open.1..=shut.1]).copied().collect();
        let last = self.held.len() - 1;
        let step = |k: usize| {
            let d = minus(at(self.held[k + 1]), at(self.held[k]));
            d[0].hypot(d[1])
        };
        let (mut low, mut way) = (shut.0, 0.0);
        while low > 0 && way <= WINDOW * reach {
            low -= 1;
            way += step(low);
        }
        let (mut high, mut on) = (open.0, 0.0);
        while high < last && on <= WINDOW * reach {
            on += step(high);
            high += 1;
        }
        // Around a closed chain the ends meet: take the whole of it when one is near.
        if self.closed && (low == 0 || high == last) {
            (low, high) = (0, last);
        }
        let from = (self.from + low) % self.around;
        Run { ring: tidy(ring), of: self.of, from, edges: high - low }
    }
}

/// Without a point that comes twice in a row.
fn tidy(mut ring: Ring) -> Ring {
    ring.dedup();
    while ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    ring
}

/// The parts of a piece that are not proved to lie within reach (grid steps) of what
/// holds it; `None` where the piece is no strip.
pub(super) fn runs(piece: &Residual, reach: f64) -> Option<Vec<Run>> {
    let strip = Strip::of(piece)?;
    let (held, free): (Vec<V>, Vec<V>) =
        (strip.held.iter().map(|p| at(*p)).collect(), strip.free.iter().map(|p| at(*p)).collect());
    let mut runs = Vec::new();
    let mut open: Option<(usize, usize)> = None;
    // From the end of the held chain backward, from the start of the free one forward.
    let (mut i, mut j) = (held.len() - 1, 0);
    while i > 0 || j + 1 < free.len() {
        let back = (i > 0).then(|| over_edge(held[i - 1], held[i], free[j], reach)).flatten();
        let on = (j + 1 < free.len()).then(|| under_edge(&held, i, free[j], free[j + 1], reach)).flatten();
        let take_back = match (back, on) {
            (None, None) => return None,
            (Some(_), None) => true,
            (None, Some(_)) => false,
            // The shorter diagonal keeps the two sides in step.
            (Some(_), Some(_)) => length_2(held[i - 1], free[j]) <= length_2(held[i], free[j + 1]),
        };
        let proved = if take_back { back } else { on } == Some(true);
        match (proved, open) {
            (false, None) => open = Some((i, j)),
            (true, Some(from)) => {
                runs.push(strip.run(from, (i, j), reach));
                open = None;
            }
            _ => {}
        }
        if take_back { i -= 1 } else { j += 1 }
    }
    if let Some(from) = open {
        runs.push(strip.run(from, (i, j), reach));
    }
    Some(runs)
}

fn length_2(a: V, b: V) -> f64 {
    let d = minus(b, a);
    d[0] * d[0] + d[1] * d[1]
}

/// Whether a triangle turns left, or is flat up to rounding.
fn turns_left(a: V, b: V, c: V) -> bool {
    let twice = cross(minus(b, a), minus(c, a));
    twice >= 0.0
        || twice * twice <= ROUNDED * ROUNDED * length_2(a, b).max(length_2(b, c)).max(length_2(c, a))
}

/// The triangle over a held edge with its tip at `tip`: whether it is proved held, if it tiles.
fn over_edge(a: V, b: V, tip: V, reach: f64) -> Option<bool> {
    turns_left(a, b, tip).then(|| distance_2(tip, a, b) <= reach * reach)
}

/// The triangle over a free edge `a → b` with its tip at the held vertex `i`, likewise. The
/// distance from an edge is convex, so the farthest point of a triangle is a corner.
fn under_edge(held: &[V], i: usize, a: V, b: V, reach: f64) -> Option<bool> {
    let tip = held[i];
    let within = |c: V, d: V| distance_2(a, c, d) <= reach * reach && distance_2(b, c, d) <= reach * reach;
    turns_left(tip, a, b).then(|| {
        within(tip, tip)
            || (i > 0 && within(held[i - 1], tip))
            || (i + 1 < held.len() && within(tip, held[i + 1]))
    })
}
