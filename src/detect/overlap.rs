//! Whether two polygons share area, exactly.
//!
//! Takes polygons on the grid, gives a yes or a no that no rounding touches: two that
//! meet along an edge or in a vertex only share nothing. A quick proof (a vertex of one
//! strictly inside the other, or an edge that both have) spares most of the work; what
//! it leaves is decided from all edges ([`Outline::overlaps`]). Knows no layer.
//!
//! Paper 003, section 3.2 asks the same question by two booleans (is anything left of
//! the loop when its residual is taken away?); here no area is computed.
use super::slabs::{Edge, Slabs, edges};
use crate::layers::shape::{Bounds, Point, Polygon};
use std::sync::OnceLock;

/// Where a point lies with regard to a polygon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    Inside,
    /// On an edge, or on a vertex.
    Border,
    Outside,
}

/// Edges of a polygon that has fewer than this are looked through one by one.
const INDEXED_FROM: usize = 64;

/// Vertices of each polygon that the quick proof tries.
const TRIED: usize = 6;

/// A polygon made ready for questions.
#[derive(Debug)]
pub struct Outline<'a> {
    polygon: &'a Polygon,
    bounds: Bounds,
    edges: usize,
    slabs: OnceLock<Slabs>,
}

fn edges_of(polygon: &Polygon) -> impl Iterator<Item = Edge> + Clone + '_ {
    polygon.rings.iter().flat_map(edges)
}

/// Twice the area of the triangle `a b p`: positive where `p` lies to the left of `a → b`.
fn turn(a: Point, b: Point, p: Point) -> i64 {
    let (ax, ay) = (i64::from(a.x), i64::from(a.y));
    (i64::from(b.x) - ax) * (i64::from(p.y) - ay) - (i64::from(b.y) - ay) * (i64::from(p.x) - ax)
}

/// A point in half steps of the grid, so that the middle of an edge is one.
#[derive(Clone, Copy)]
struct Halved {
    x: i64,
    y: i64,
}

impl Halved {
    fn of(p: Point) -> Halved {
        Halved { x: 2 * i64::from(p.x), y: 2 * i64::from(p.y) }
    }

    fn middle(a: Point, b: Point) -> Halved {
        Halved { x: i64::from(a.x) + i64::from(b.x), y: i64::from(a.y) + i64::from(b.y) }
    }
}

/// What one edge says of a point.
enum Beside {
    On,
    /// A ray from the point to the right crosses the edge.
    Crossed,
    Not,
}

fn beside((a, b): Edge, p: Halved) -> Beside {
    let (ay, by) = (2 * i64::from(a.y), 2 * i64::from(b.y));
    if (ay > p.y) != (by > p.y) {
        let (dx, dy) = (i64::from(b.x) - i64::from(a.x), i64::from(b.y) - i64::from(a.y));
        let side = dx * (p.y - ay) - dy * (p.x - 2 * i64::from(a.x));
        return match side {
            0 => Beside::On,
            s if (s > 0) == (dy > 0) => Beside::Crossed,
            _ => Beside::Not,
        };
    }
    let (ax, bx) = (2 * i64::from(a.x), 2 * i64::from(b.x));
    let level = ay == p.y && by == p.y && ax.min(bx) <= p.x && p.x <= ax.max(bx);
    if level || (ax, ay) == (p.x, p.y) || (bx, by) == (p.x, p.y) { Beside::On } else { Beside::Not }
}

impl<'a> Outline<'a> {
    /// Makes a polygon ready.
    #[must_use]
    pub fn new(polygon: &'a Polygon) -> Outline<'a> {
        Outline { polygon, bounds: polygon.bounds(), edges: polygon.len(), slabs: OnceLock::new() }
    }

    /// Bounds of the polygon.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        self.bounds
    }

    fn holds(&self, p: Halved) -> bool {
        let (min, max) = (Halved::of(self.bounds.min), Halved::of(self.bounds.max));
        min.x <= p.x && p.x <= max.x && min.y <= p.y && p.y <= max.y
    }

    fn slabs(&self) -> &Slabs {
        self.slabs.get_or_init(|| Slabs::new(edges_of(self.polygon)))
    }

    /// Hands every edge that may lie beside the point to `see`, until it says enough.
    fn each_beside(&self, p: Halved, mut see: impl FnMut(Edge) -> bool) {
        if self.edges < INDEXED_FROM {
            edges_of(self.polygon).any(&mut see);
        } else {
            let slabs = self.slabs();
            // What lies beside a point half a step above a whole height reaches down to that
            // height: one slab holds all of it, and each edge once.
            let height = p.y.div_euclid(2);
            slabs.near(height, height).iter().any(|&e| see(e));
        }
    }

    fn place(&self, p: Halved) -> Place {
        if !self.holds(p) {
            return Place::Outside;
        }
        let (mut inside, mut border) = (false, false);
        self.each_beside(p, |edge| {
            match beside(edge, p) {
                Beside::On => border = true,
                Beside::Crossed => inside = !inside,
                Beside::Not => {}
            }
            border
        });
        match (border, inside) {
            (true, _) => Place::Border,
            (_, true) => Place::Inside,
            _ => Place::Outside,
        }
    }

    /// Whether an edge through this point of the border runs the way `a → b` runs.
    fn runs_along(&self, p: Halved, (a, b): Edge) -> bool {
        let way = |(a, b): Edge| (i64::from(b.x) - i64::from(a.x), i64::from(b.y) - i64::from(a.y));
        let (ux, uy) = way((a, b));
        let mut along = false;
        self.each_beside(p, |edge| {
            let (vx, vy) = way(edge);
            let same = matches!(beside(edge, p), Beside::On) && ux * vy == uy * vx;
            // Parallel: the signs alone tell whether they run the same way.
            along = same && ux.signum() == vx.signum() && uy.signum() == vy.signum();
            along
        });
        along
    }

    /// A point of the polygon strictly inside the other, if a few tries find one.
    fn proves(&self, other: &Outline<'_>) -> bool {
        let Some(outer) = self.polygon.rings.first() else { return false };
        let step = (outer.len() / TRIED).max(1);
        outer.iter().step_by(step).take(TRIED).any(|&p| other.place(Halved::of(p)) == Place::Inside)
    }

    /// Whether a few tries prove that the two share area; no is no proof of anything.
    #[must_use]
    pub fn surely_overlaps(&self, other: &Outline<'_>) -> bool {
        self.bounds.overlap(other.bounds)
            && (self.polygon == other.polygon || self.proves(other) || other.proves(self))
    }

    /// Whether the two share area.
    ///
    /// ```
    /// use outrigger::detect::overlap::Outline;
    /// use outrigger::layers::shape::{Point, Polygon};
    /// let square = |x: f64| Polygon {
    ///     rings: vec![[(0., 0.), (1., 0.), (1., 1.), (0., 1.)].map(|p| Point::from_mm(p.0 + x, p.1)).to_vec()],
    /// };
    /// let (a, b, c) = (square(0.0), square(1.0), square(0.9999));
    /// assert!(!Outline::new(&a).overlaps(&Outline::new(&b)), "they share an edge");
    /// assert!(Outline::new(&a).overlaps(&Outline::new(&c)));
    /// ```
    #[must_use]
    pub fn overlaps(&self, other: &Outline<'_>) -> bool {
        self.surely_overlaps(other) || self.overlaps_by_edges(other)
    }

    /// The same from all edges, exactly and without a quick proof.
    ///
    /// Where two edges cross properly there is area on all four sides. Where none do,
    /// edges meet in vertices only; cut there, each piece of an edge lies inside,
    /// outside or on the border of the other polygon as its middle does. Two open
    /// connected sets share area exactly if a piece of one's border lies inside the
    /// other, or along its border with the material on the same side.
    #[must_use]
    pub fn overlaps_by_edges(&self, other: &Outline<'_>) -> bool {
        if !self.bounds.overlap(other.bounds) {
            return false;
        }
        let mut mine = Pieces::new(self, other.bounds);
        let mut theirs = Pieces::new(other, self.bounds);
        mine.cut_by(&mut theirs) || mine.enter(other) || theirs.enter(self)
    }
}

/// The edges of a polygon that reach into some bounds, and where others touch them.
struct Pieces {
    edges: Vec<Edge>,
    /// Whether the edge goes on from the one before it in `edges`.
    goes_on: Vec<bool>,
    /// Vertices of the other polygon on an edge: its index, the point.
    contacts: Vec<(u32, Point)>,
}

impl Pieces {
    fn new(outline: &Outline<'_>, window: Bounds) -> Pieces {
        let mut pieces = Pieces { edges: Vec::new(), goes_on: Vec::new(), contacts: Vec::new() };
        if outline.edges >= INDEXED_FROM {
            let slabs = outline.slabs();
            let near = slabs.near(window.min.y.into(), window.max.y.into());
            // A small window on a large polygon: its edges are picked out, their order is lost.
            if near.len() < outline.edges / 4 {
                pieces.edges.extend(near.iter().filter(|e| reaches(**e, window)));
                pieces.edges.sort_unstable();
                pieces.edges.dedup();
                pieces.goes_on = vec![false; pieces.edges.len()];
                return pieces;
            }
        }
        for edge in edges_of(outline.polygon).filter(|e| reaches(*e, window)) {
            pieces.goes_on.push(pieces.edges.last().is_some_and(|last| last.1 == edge.0));
            pieces.edges.push(edge);
        }
        pieces
    }

    /// Finds where the edges meet; true as soon as two cross properly.
    fn cut_by(&mut self, other: &mut Pieces) -> bool {
        // Sweeping along the axis in which the edges are shorter leaves fewer pairs.
        let extent = |edges: &[Edge], of: fn(Point) -> i32| -> i64 {
            edges.iter().map(|&(a, b)| (i64::from(of(a)) - i64::from(of(b))).abs()).sum()
        };
        let x: fn(Point) -> i32 = |p| p.x;
        let y: fn(Point) -> i32 = |p| p.y;
        let total = |of| extent(&self.edges, of) + extent(&other.edges, of);
        let along = if total(x) < total(y) { x } else { y };
        let spans = |edges: &[Edge]| -> Vec<(i32, i32)> {
            edges.iter().map(|&(a, b)| (along(a).min(along(b)), along(a).max(along(b)))).collect()
        };
        let (mine, theirs) = (&self.edges, &other.edges);
        let (contacts, their_contacts) = (&mut self.contacts, &mut other.contacts);
        sweep(&spans(mine), &spans(theirs), |i, k| {
            let ((a, b), (c, d)) = (mine[i as usize], theirs[k as usize]);
            let sides = [turn(c, d, a), turn(c, d, b), turn(a, b, c), turn(a, b, d)].map(i64::signum);
            if sides[0] * sides[1] < 0 && sides[2] * sides[3] < 0 {
                return true;
            }
            for (p, side) in [(a, sides[0]), (b, sides[1])] {
                if side == 0 && within(p, c, d) {
                    contacts.push((i, p));
                    their_contacts.push((k, p));
                }
            }
            for (p, side) in [(c, sides[2]), (d, sides[3])] {
                if side == 0 && within(p, a, b) {
                    contacts.push((i, p));
                    their_contacts.push((k, p));
                }
            }
            false
        })
    }

    /// Whether a piece of an edge lies inside the polygon, or along its border with
    /// the material on the same side. No edges cross properly, contacts are known.
    fn enter(&mut self, polygon: &Outline<'_>) -> bool {
        self.contacts.sort_unstable();
        self.contacts.dedup();
        let mut contacts = self.contacts.as_slice();
        for (i, &(a, b)) in self.edges.iter().enumerate() {
            let here = contacts.iter().take_while(|c| c.0 as usize == i).count();
            let (points, rest) = contacts.split_at(here);
            contacts = rest;
            // What goes on untouched lies where the piece before it did.
            if points.is_empty() && self.goes_on[i] {
                continue;
            }
            let mut stops: Vec<Point> = points.iter().map(|c| c.1).chain([a, b]).collect();
            stops.sort_unstable();
            stops.dedup();
            if stops.windows(2).any(|s| piece_enters(polygon, (a, b), s[0], s[1])) {
                return true;
            }
        }
        false
    }
}

fn piece_enters(polygon: &Outline<'_>, edge: Edge, from: Point, to: Point) -> bool {
    let middle = Halved::middle(from, to);
    match polygon.place(middle) {
        Place::Inside => true,
        Place::Border => polygon.runs_along(middle, edge),
        Place::Outside => false,
    }
}

/// Whether the bounds of an edge meet some others, borders included.
fn reaches((a, b): Edge, window: Bounds) -> bool {
    let meet = |a: i32, b: i32, low: i32, high: i32| a.min(b) <= high && low <= a.max(b);
    meet(a.x, b.x, window.min.x, window.max.x) && meet(a.y, b.y, window.min.y, window.max.y)
}

/// Whether a point on the line through `a` and `b` lies between them or on one of them.
fn within(p: Point, a: Point, b: Point) -> bool {
    let between = |v: i32, s: i32, t: i32| s.min(t) <= v && v <= s.max(t);
    between(p.x, a.x, b.x) && between(p.y, a.y, b.y)
}

/// Hands every pair whose spans (begin and end, both included) meet to `see`, until it
/// says enough; whether it did.
pub(super) fn sweep(
    mine: &[(i32, i32)],
    theirs: &[(i32, i32)],
    mut see: impl FnMut(u32, u32) -> bool,
) -> bool {
    let by_start = |spans: &[(i32, i32)]| {
        let mut order: Vec<u32> = (0..spans.len() as u32).collect();
        order.sort_by_key(|&i| spans[i as usize].0);
        order
    };
    let (my_order, their_order) = (by_start(mine), by_start(theirs));
    let (mut my_open, mut their_open): (Vec<u32>, Vec<u32>) = (Vec::new(), Vec::new());
    let (mut m, mut t) = (0, 0);
    // Where one side is used up and nothing of it is open, no pair can come any more.
    while (m < mine.len() || !my_open.is_empty()) && (t < theirs.len() || !their_open.is_empty()) {
        let my_next = my_order.get(m).map(|&i| (mine[i as usize].0, i));
        let their_next = their_order.get(t).map(|&k| (theirs[k as usize].0, k));
        match (my_next, their_next) {
            (Some((start, i)), next) if next.is_none_or(|n| start <= n.0) => {
                their_open.retain(|&k| theirs[k as usize].1 >= start);
                if their_open.iter().any(|&k| see(i, k)) {
                    return true;
                }
                my_open.push(i);
                m += 1;
            }
            (_, Some((start, k))) => {
                my_open.retain(|&i| mine[i as usize].1 >= start);
                if my_open.iter().any(|&i| see(i, k)) {
                    return true;
                }
                their_open.push(k);
                t += 1;
            }
            _ => break,
        }
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::polygon::{Inside, intersection, overlaps, resolve};
    use crate::layers::shape::{Region, Ring};
    use proptest::prelude::*;

    /// Of a coarse grid: many shapes then share edges or vertices and nothing else.
    const STEP: i32 = 5040;

    /// Rings on the coarse grid.
    fn rings(steps: i32, most: usize) -> impl Strategy<Value = Vec<Ring>> {
        let point = (0..steps, 0..steps).prop_map(|(x, y)| Point { x: x * STEP, y: y * STEP });
        prop::collection::vec(prop::collection::vec(point, 3..7), 1..most)
    }

    fn shape(steps: i32) -> impl Strategy<Value = Region> {
        rings(steps, 5).prop_map(|r| resolve(&r, Inside::Odd))
    }

    /// The polygons with no vertex off the coarse grid. Only of these the library's
    /// answer is exact: it rounds crossings to the grid, and so does not see what is
    /// thinner than a step of it.
    fn coarse(r: &Region) -> impl Iterator<Item = &Polygon> {
        let on_grid = |p: &Point| p.x % STEP == 0 && p.y % STEP == 0;
        r.polygons.iter().filter(move |p| p.rings.iter().flatten().all(on_grid))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(600))]

        /// Quick proof, all edges, and the areas of full booleans agree.
        #[test]
        fn quick_and_full_agree(a in shape(7), b in shape(7)) {
            for p in coarse(&a) {
                for q in coarse(&b) {
                    let (o, r) = (Outline::new(p), Outline::new(q));
                    let exact = o.overlaps_by_edges(&r);
                    prop_assert_eq!(r.overlaps_by_edges(&o), exact);
                    prop_assert_eq!(overlaps(p, q), exact);
                    prop_assert_eq!(o.overlaps(&r), exact);
                    prop_assert!(exact || !o.surely_overlaps(&r));
                    let only = |p: &Polygon| Region { polygons: vec![p.clone()] };
                    prop_assert_eq!(!intersection(&only(p), &only(q)).is_empty(), exact);
                }
            }
        }

        /// A small polygon against a large one, whose edges are picked out by height.
        #[test]
        fn small_windows_change_nothing(
            teeth in prop::collection::vec((1..9_i32, 1..9_i32), 40..60),
            x in 0..120_i32, y in 0..10_i32, w in 1..6_i32, h in 1..6_i32,
        ) {
            // A comb of teeth of all lengths, its back below.
            let mut ring: Ring = vec![Point { x: 0, y: -STEP }];
            ring.push(Point { x: 2 * teeth.len() as i32 * STEP, y: -STEP });
            for (k, &(up, down)) in teeth.iter().enumerate().rev() {
                let left = 2 * k as i32;
                ring.extend([(left + 2, down - 1), (left + 1, 10 - up), (left, 0)].map(|(x, y)| Point {
                    x: x * STEP,
                    y: y * STEP,
                }));
            }
            let comb = resolve(&[ring], Inside::NonZero);
            let corner = |dx: i32, dy: i32| Point { x: (x + dx) * STEP, y: (y + dy) * STEP };
            let small = Polygon { rings: vec![vec![corner(0, 0), corner(w, 0), corner(w, h), corner(0, h)]] };
            prop_assert!(coarse(&comb).any(|p| p.len() >= INDEXED_FROM));
            for polygon in coarse(&comb) {
                let (o, r) = (Outline::new(polygon), Outline::new(&small));
                prop_assert_eq!(o.overlaps_by_edges(&r), overlaps(polygon, &small));
                prop_assert_eq!(r.overlaps_by_edges(&o), overlaps(polygon, &small));
            }
        }

        /// The index by height sees what looking at all edges sees.
        #[test]
        fn the_index_changes_nothing(a in shape(9), x in 0..100_000_i64, y in 0..100_000_i64) {
            for polygon in &a.polygons {
                let plain = Outline::new(polygon);
                let indexed = Outline { edges: INDEXED_FROM, ..Outline::new(polygon) };
                for p in [Halved { x, y }, Halved { x: x / 10080 * 10080, y: y / 10080 * 10080 }] {
                    prop_assert_eq!(plain.place(p), indexed.place(p));
                }
            }
        }
    }

    #[test]
    fn the_farthest_corners_do_not_overflow() {
        let m = crate::layers::shape::MAX_COORDINATE;
        let square = |lo: i32, hi: i32| Polygon {
            rings: vec![[(lo, lo), (hi, lo), (hi, hi), (lo, hi)].map(|(x, y)| Point { x, y }).to_vec()],
        };
        let (all, part, other) = (square(-m, m), square(-m, -m + 1), square(m - 1, m));
        let check = |a: &Polygon, b: &Polygon, expect: bool| {
            assert_eq!(Outline::new(a).overlaps_by_edges(&Outline::new(b)), expect);
            assert_eq!(Outline::new(a).overlaps(&Outline::new(b)), expect);
        };
        check(&all, &part, true);
        check(&all, &all, true);
        check(&part, &other, false);
    }

    #[test]
    fn a_sweep_sees_each_pair_that_meets_once() {
        let mine = [(0, 5), (3, 4), (9, 9), (6, 7)];
        let theirs = [(5, 6), (-3, 0), (4, 20)];
        let mut seen = Vec::new();
        sweep(&mine, &theirs, |i, k| {
            seen.push((i, k));
            false
        });
        seen.sort_unstable();
        let meet = |i: usize, k: usize| mine[i].0 <= theirs[k].1 && theirs[k].0 <= mine[i].1;
        let expect: Vec<(u32, u32)> = (0..4)
            .flat_map(|i| (0..3).filter(move |&k| meet(i, k)).map(move |k| (i as u32, k as u32)))
            .collect();
        assert_eq!(seen, expect);
    }
}
