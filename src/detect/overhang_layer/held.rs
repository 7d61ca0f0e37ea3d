//! Which edges of a residual piece lie on what is below, and how far these hold it.
//!
//! Takes a polygon, what holds it from below, and a residual piece of the two; gives the
//! piece with each edge marked *held* (on the border of what is below, the piece on this
//! side and what is below on the other) or *free* (on the polygon's own border).
use super::super::slabs::{Slabs, edges};
use crate::layers::shape::{Bounds, MAX_COORDINATE, Point, Polygon, Ring, ring_edges};
use std::f64::consts::{FRAC_PI_2, PI};

/// Booleans move points by up to a grid step; what is this near an edge lies on it.
pub(super) const NEAR: f64 = 1.5;

/// Widest part of a circle for which one chord stands, radians: it keeps within 0.4 % of the radius.
const CHORD: f64 = std::f64::consts::PI / 18.0;

/// Parts of one edge at most: one that is so much longer than the reach is cut coarser.
const MOST_PARTS: f64 = 4096.0;

/// All of the grid.
const EVERYWHERE: Bounds = Bounds {
    min: Point { x: -MAX_COORDINATE, y: -MAX_COORDINATE },
    max: Point { x: MAX_COORDINATE, y: MAX_COORDINATE },
};

/// A vector or a place in grid steps.
pub(super) type V = [f64; 2];

/// From a place to a place.
pub(super) type Edge = (V, V);

pub(super) fn at(p: Point) -> V {
    [f64::from(p.x), f64::from(p.y)]
}

pub(super) fn minus(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1]]
}

pub(super) fn cross(a: V, b: V) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

pub(super) fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Distance of a point from an edge, squared.
pub(super) fn distance_2(p: V, a: V, b: V) -> f64 {
    let (along, to) = (minus(b, a), minus(p, a));
    let length = dot(along, along);
    let t = if length > 0.0 { (dot(to, along) / length).clamp(0.0, 1.0) } else { 0.0 };
    let off = [to[0] - t * along[0], to[1] - t * along[1]];
    dot(off, off)
}

/// A piece of a polygon under which there is nothing.
#[derive(Debug)]
pub(super) struct Residual {
    pub(super) polygon: Polygon,
    /// For each ring, for each edge from the vertex of that index on: whether it is held.
    pub(super) held: Vec<Vec<bool>>,
}

/// The borders of a polygon and of what holds it, to look edges up.
#[derive(Debug)]
pub(super) struct Borders {
    own: Index,
    below: Index,
}

impl Borders {
    pub(super) fn new(polygon: &Polygon, below: &[&Polygon]) -> Borders {
        Borders {
            own: Index(Slabs::new(polygon.rings.iter().flat_map(edges))),
            below: Index(Slabs::new(below.iter().flat_map(|p| p.rings.iter().flat_map(edges)))),
        }
    }

    /// Marks the edges of a residual piece.
    pub(super) fn residual(&self, polygon: Polygon) -> Residual {
        let held = polygon.rings.iter().map(|ring| self.held(ring)).collect();
        Residual { polygon, held }
    }

    fn held(&self, ring: &Ring) -> Vec<bool> {
        // What is below lies on the other side: its border runs the other way.
        // Where both borders run together, what is below is not under the polygon.
        ring_edges(ring).map(|[a, b]| self.below.along(b, a) && !self.own.along(a, b)).collect()
    }
}

/// The edges of some rings, to be found again.
#[derive(Debug)]
struct Index(Slabs);

impl Index {
    /// Whether an edge lies along `a → b`, up to rounding, and runs the same way.
    fn along(&self, a: Point, b: Point) -> bool {
        let (from, to) = (at(a), at(b));
        let middle = [(from[0] + to[0]) / 2.0, (from[1] + to[1]) / 2.0];
        let way = minus(to, from);
        let y = (i64::from(a.y) + i64::from(b.y)) / 2;
        let near = self.0.near(y - 3, y + 3);
        near.iter().any(|&(c, d)| {
            let (c, d) = (at(c), at(d));
            dot(minus(d, c), way) > 0.0 && distance_2(middle, c, d) <= NEAR * NEAR
        })
    }
}

impl Residual {
    /// The edges of a ring that are not held.
    pub(super) fn free(&self) -> Vec<Edge> {
        let mut free = Vec::new();
        for (ring, held) in self.polygon.rings.iter().zip(&self.held) {
            let ends = ring_edges(ring).zip(held);
            free.extend(ends.filter(|(_, held)| !**held).map(|([a, b], _)| (at(a), at(b))));
        }
        free
    }

    /// What all held edges hold; see [`Residual::sectors_of`].
    pub(super) fn sectors(&self, reach: f64) -> Vec<Sector> {
        let rings = self.polygon.rings.iter().enumerate();
        rings.flat_map(|(of, ring)| self.sectors_of(of, 0, ring.len(), reach, EVERYWHERE)).collect()
    }

    /// For each held edge of some edges of a ring the rectangle over it that it holds, and
    /// at each vertex of one the part of a circle between: within `reach` grid steps of
    /// the held edges as far as the piece is on that side. They overlap. Those that
    /// cannot reach into `window` are left out.
    pub(super) fn sectors_of(
        &self,
        of: usize,
        from: usize,
        edges: usize,
        reach: f64,
        window: Bounds,
    ) -> Vec<Sector> {
        let (ring, held) = (&self.polygon.rings[of], &self.held[of]);
        let n = ring.len();
        let way = |k: usize| unit(minus(at(ring[(k + 1) % n]), at(ring[k])));
        let reaches = |a: Point, b: Point| {
            // Two steps of the grid more, since ends are rounded.
            let far = |p: i32, q: i32, low: i32, high: i32| {
                f64::from(p.max(q)) + reach + 2.0 < f64::from(low)
                    || f64::from(p.min(q)) - reach - 2.0 > f64::from(high)
            };
            !far(a.x, b.x, window.min.x, window.max.x) && !far(a.y, b.y, window.min.y, window.max.y)
        };
        let mut sectors = Vec::new();
        for k in (from..=from + edges).map(|k| k % n) {
            let before = (k + n - 1) % n;
            let (a, b) = (ring[k], ring[(k + 1) % n]);
            if !reaches(a, b) {
                continue;
            }
            let (in_way, out_way) = (way(before), way(k));
            if held[k] {
                sectors.push(rectangle(at(a), at(b), reach));
            }
            if held[k] || held[before] {
                let back = [-in_way[0], -in_way[1]];
                let start = if held[k] { left(out_way) } else { out_way };
                let end = if held[before] { left(in_way) } else { back };
                // The whole angle of the piece here, without what the rectangles cover.
                let covered = f64::from(u8::from(held[k]) + u8::from(held[before])) * FRAC_PI_2;
                let angle = turn(out_way, back) - covered;
                let slice = slice(a, start, end, angle, reach);
                sectors.extend(slice.map(|ring| Sector { ring, source: (at(a), at(a)) }));
            }
        }
        sectors
    }
}

/// What one held edge or vertex holds.
#[derive(Debug)]
pub(super) struct Sector {
    /// Counter-clockwise.
    pub(super) ring: Ring,
    /// The edge, or twice the vertex.
    pub(super) source: Edge,
}

impl Sector {
    /// All within reach of the source, on either side of it, in parts of the source no
    /// longer than half the reach: room for the ways to what a part holds, and
    /// hardly more.
    pub(super) fn parts(self, reach: f64) -> Vec<Sector> {
        let (a, b) = self.source;
        let along = minus(b, a);
        let count = (2.0 * along[0].hypot(along[1]) / reach.max(1.0)).ceil().clamp(1.0, MOST_PARTS);
        let stop = |k: u32| [0, 1].map(|c: usize| a[c] + along[c] * f64::from(k) / count);
        (0..count as u32).map(|k| capsule(stop(k), stop(k + 1), reach)).collect()
    }
}

/// All within reach of an edge.
fn capsule(a: V, b: V, reach: f64) -> Sector {
    let way = if a == b { [1.0, 0.0] } else { unit(minus(b, a)) };
    let halves = (PI / (2.0 * CHORD)).round();
    let half = |end: V, from: V| {
        (0..=halves as u32).map(move |k| point(end, turned(from, PI * f64::from(k) / halves), reach))
    };
    let (right, left) = ([way[1], -way[0]], left(way));
    Sector { ring: half(b, right).chain(half(a, left)).collect(), source: (a, b) }
}

/// The rectangle to the left of an edge.
fn rectangle(a: V, b: V, reach: f64) -> Sector {
    let up = left(unit(minus(b, a)));
    let near = |p: V| point(p, up, 0.0);
    let far = |p: V| point(p, up, reach);
    Sector { ring: vec![near(a), near(b), far(b), far(a)], source: (a, b) }
}

fn unit(v: V) -> V {
    let length = v[0].hypot(v[1]);
    if length > 0.0 { [v[0] / length, v[1] / length] } else { v }
}

/// A quarter turn counter-clockwise.
fn left(v: V) -> V {
    [-v[1], v[0]]
}

/// Turned counter-clockwise by an angle.
fn turned(v: V, angle: f64) -> V {
    let (sin, cos) = angle.sin_cos();
    [v[0] * cos - v[1] * sin, v[0] * sin + v[1] * cos]
}

/// The angle from one direction counter-clockwise to another, 0 to 2π.
fn turn(from: V, to: V) -> f64 {
    let angle = cross(from, to).atan2(dot(from, to));
    if angle < 0.0 { angle + 2.0 * PI } else { angle }
}

fn point(from: V, way: V, reach: f64) -> Point {
    let along = |k: usize| (from[k] + way[k] * reach).round() as i32;
    Point { x: along(0), y: along(1) }
}

/// A slice of the disc around a point, of this angle from one direction to another.
fn slice(centre: Point, from: V, to: V, angle: f64, reach: f64) -> Option<Ring> {
    if angle < 1e-4 {
        return None;
    }
    let chords = (angle / CHORD).ceil().max(1.0);
    let mut ring = vec![centre, point(at(centre), from, reach)];
    for k in 1..chords as u32 {
        ring.push(point(at(centre), turned(from, angle * f64::from(k) / chords), reach));
    }
    ring.push(point(at(centre), to, reach));
    Some(ring)
}
