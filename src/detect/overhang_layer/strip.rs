//! Residual pieces as strips: what of them needs no boolean to be proved held.
//!
//! Most residual pieces are strips between the border of what is below (the held chain)
//! and the polygon's own border (the free chain). A strip is zipped up: triangles are
//! drawn between the two chains, from one end to the other. If all of them turn the right
//! way they tile the piece: a map of a disc onto the plane that keeps the orientation
//! everywhere and runs once around the piece's border covers each of its points once.
//!
//! A triangle that lies within reach of a held edge or vertex *of its own* is held, each
//! of its points by a straight way inside the piece. So is one whose parts each lie within
//! reach of an edge close by along the border, on its left: that is what a boolean with
//! what these edges hold would find. The others come in runs; only these are left to booleans, with the held edges beside them along the border: nothing across
//! a gap is asked, and a notch narrower than the reach is measured across. A piece that
//! cannot be zipped (no point behind a slot sees a held edge) is no strip.
use super::held::{Residual, V, at, cross, distance_2, minus};
use crate::layers::shape::{Point, Ring};

/// A triangle may be turned the wrong way by this, grid steps, since booleans round.
const ROUNDED: f64 = 1.5;

/// Held edges this far beyond the ends of a run, in parts of the reach along the border,
/// are asked too: more than one, since a border that winds comes back near.
const WINDOW: f64 = 4.0;

/// Held edges to either side of a triangle that may hold a part of it.
const CLOSE_BY: usize = 4;

/// How often a triangle is halved to find what holds its parts: what is left then is thin
/// against the reach, and asking on would cost more than the boolean.
const HALVED: u32 = 6;

/// Held edges times parts of a stretch that are looked at; beyond it the stretch stays whole.
const MOST_LOOKS: usize = 1 << 18;

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

    /// The runs between states of the zipper, all with the held edges within reach of the
    /// stretch that they are parts of.
    fn runs(&self, stretch: &Stretch, reach: f64) -> Vec<Run> {
        let (from, edges) = self.beside(stretch.open, stretch.shut, reach);
        let whole = [(stretch.open, stretch.shut)];
        let parts = if stretch.parts.len() * edges <= MOST_LOOKS { &stretch.parts[..] } else { &whole };
        let ring = |&(open, shut): &(State, State)| -> Ring {
            tidy(self.held[shut.0..=open.0].iter().chain(&self.free[open.1..=shut.1]).copied().collect())
        };
        parts.iter().map(|part| Run { ring: ring(part), of: self.of, from, edges }).collect()
    }

    /// The first held edge within reach of what lies between two states, by its index in
    /// the ring, and their number.
    fn beside(&self, open: State, shut: State, reach: f64) -> (usize, usize) {
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
        // A triangle may reach beyond the held edge that its tip ends: the next one counts.
        (low, high) = (low.saturating_sub(1), (high + 1).min(last));
        // Around a closed chain the ends meet: take the whole of it when one is near.
        if self.closed && (low == 0 || high == last) {
            (low, high) = (0, last);
        }
        ((self.from + low) % self.around, high - low)
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
    let mut stretch: Option<Stretch> = None;
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
        let state = (i, j);
        if if take_back { back } else { on } == Some(true) {
            runs.extend(stretch.take().into_iter().flat_map(|s| strip.runs(&s.shut(state), reach)));
        } else {
            let corner = if take_back { held[i - 1] } else { free[j + 1] };
            let edges = close_by(&held, i, reach);
            let held = covered(&edges, [held[i], free[j], corner], reach * reach, HALVED);
            stretch.get_or_insert_with(|| Stretch::new(state)).triangle(state, held);
        }
        if take_back { i -= 1 } else { j += 1 }
    }
    runs.extend(stretch.into_iter().flat_map(|s| strip.runs(&s.shut((i, j)), reach)));
    Some(runs)
}

/// Where the zipper stands: the places in the held chain and in the free one.
type State = (usize, usize);

/// Triangles in a row that no edge of their own holds.
struct Stretch {
    open: State,
    shut: State,
    /// The runs in it of triangles that are not proved held by what is close by either.
    parts: Vec<(State, State)>,
    /// Where the last run began, until it ends.
    begun: Option<State>,
}

impl Stretch {
    fn new(open: State) -> Stretch {
        Stretch { open, shut: open, parts: Vec::new(), begun: None }
    }

    /// The triangle that the zipper draws from here.
    fn triangle(&mut self, from: State, held: bool) {
        match (held, self.begun) {
            (false, None) => self.begun = Some(from),
            (true, Some(begun)) => {
                self.parts.push((begun, from));
                self.begun = None;
            }
            _ => {}
        }
    }

    fn shut(mut self, at: State) -> Stretch {
        self.shut = at;
        self.parts.extend(self.begun.take().map(|begun| (begun, at)));
        self
    }
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

/// Some edges of the held chain before and after a vertex, none farther along it than the [`WINDOW`].
fn close_by(held: &[V], i: usize, reach: f64) -> Vec<(V, V)> {
    let far = |way: f64| way > WINDOW * reach;
    let mut edges = Vec::with_capacity(2 * CLOSE_BY);
    let mut way = 0.0;
    for k in (0..i).rev().take(CLOSE_BY) {
        edges.push((held[k], held[k + 1]));
        way += length_2(held[k], held[k + 1]).sqrt();
        if far(way) {
            break;
        }
    }
    way = 0.0;
    for k in (i..held.len() - 1).take(CLOSE_BY) {
        edges.push((held[k], held[k + 1]));
        way += length_2(held[k], held[k + 1]).sqrt();
        if far(way) {
            break;
        }
    }
    edges
}

/// Whether parts of a triangle, halved so many times, each lie within reach of one of the
/// edges and to its left. What is so near one edge is convex: the corners tell.
fn covered(edges: &[(V, V)], corners: [V; 3], reach_2: f64, halved: u32) -> bool {
    let holds = |&(a, b): &(V, V), p: V| {
        let side = cross(minus(b, a), minus(p, a));
        (side >= 0.0 || side * side <= length_2(a, b)) && distance_2(p, a, b) <= reach_2
    };
    if edges.iter().any(|e| corners.iter().all(|&p| holds(e, p))) {
        return true;
    }
    if halved == 0 || !corners.iter().all(|&p| edges.iter().any(|e| holds(e, p))) {
        return false;
    }
    let longest = |k: usize| length_2(corners[k], corners[(k + 1) % 3]);
    let k = if longest(0) >= longest(1).max(longest(2)) {
        0
    } else if longest(1) >= longest(2) {
        1
    } else {
        2
    };
    let [a, b, c] = [0, 1, 2].map(|n| corners[(k + n) % 3]);
    let middle = [(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0];
    covered(edges, [a, middle, c], reach_2, halved - 1) && covered(edges, [middle, b, c], reach_2, halved - 1)
}
