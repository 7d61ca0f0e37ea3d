//! Rings that neither cross nor touch, nested into polygons by one sweep.
//!
//! Takes closed rings on the grid, gives the [`Region`] that they wind around a
//! positive number of times, or says that two of them (or a ring and itself) share a
//! point, which [`super::polygon::resolve`] then has to untangle. Nearly all layers
//! of real meshes are free of that, and this is several times faster than a boolean.
//! Exact: integers only. Knows no polygon library and not where rings come from.
//!
//! The sweep is that of Shamos and Hoey, "Geometric intersection problems", 17th
//! Annual Symposium on Foundations of Computer Science (1976): vertices from left to
//! right (from low to high where x is the same), the edges over the sweep line in
//! order from low to high, and whatever become neighbours are tested. When no test
//! fails, nothing meets anything. The edge right below the first vertex of a ring
//! then tells where that ring lies.
use super::shape::{Point, Polygon, Region, Ring};

/// Most edges over the sweep line: each vertex may have to move half of them.
const MAX_STATUS: usize = 1 << 14;

/// Marks a ring that the sweep has not reached, and a ring around which there is none.
const NONE: u32 = u32::MAX;

/// The sweep's memory, kept from layer to layer.
#[derive(Default)]
pub struct Nester {
    points: Vec<Corner>,
    /// x above, index into `points` below: 32 bits each.
    order: Vec<u64>,
    status: Vec<Edge>,
    rings: Vec<Nested>,
}

/// A vertex and its neighbours in its ring.
#[derive(Clone, Copy)]
struct Corner {
    at: Point,
    previous: u32,
    next: u32,
    ring: u32,
}

/// An edge over the sweep line; `left < right` in the order of the sweep.
#[derive(Clone, Copy)]
struct Edge {
    left: Point,
    right: Point,
    /// Index of the vertex at the right end.
    end: u32,
    ring: u32,
    /// Whether its ring runs from left to right along it.
    rightward: bool,
}

/// What the sweep learns of a ring at its first vertex.
#[derive(Clone, Copy)]
struct Nested {
    /// Winding number on the left of its walk; on the right it is one less.
    left: i32,
    counter_clockwise: bool,
    /// The ring right around it.
    parent: u32,
    /// The nearest border at it or around it.
    border: u32,
    /// Its first vertex in the order of the sweep.
    first: u32,
    /// Its first vertex as it was given.
    from: u32,
}

impl Nested {
    const UNSEEN: Nested =
        Nested { left: 0, counter_clockwise: false, parent: NONE, border: NONE, first: NONE, from: NONE };

    /// Whether it parts what is wound around (at least once) from what is not.
    fn is_border(self) -> bool {
        self.left == 1
    }
}

/// Two edges share a point; or so many lie over each other that a boolean, which keeps
/// them in a tree, is the better way.
struct Touch;

/// Twice the area of the triangle `a`, `b`, `c`: positive when `c` is on the left of `a` → `b`.
fn side(a: Point, b: Point, c: Point) -> i64 {
    let across = |p: Point, q: Point| (i64::from(p.x) - i64::from(q.x), i64::from(p.y) - i64::from(q.y));
    let ((bx, by), (cx, cy)) = (across(b, a), across(c, a));
    bx * cy - by * cx
}

impl Edge {
    /// Positive where a point within the edge's reach lies above it.
    fn below(&self, p: Point) -> i64 {
        side(self.left, self.right, p)
    }

    /// Whether it stays strictly below another that is strictly above it at the sweep
    /// line. Two edges that end in the same vertex meet there and nowhere else.
    fn stays_below(&self, above: &Edge) -> bool {
        if self.end == above.end {
            true
        } else if self.right < above.right {
            above.below(self.right) < 0
        } else {
            self.below(above.right) > 0
        }
    }
}

impl Nester {
    /// The region wound around by the rings at least once, counter-clockwise counting
    /// up and clockwise down: bodies within bodies are one, what turns the wrong way
    /// is a hole in a body and nothing outside of it.
    ///
    /// `None` where edges cross, touch, or lie on each other, other than neighbours in
    /// a ring at their common vertex, and where more than 16,384 lie over each other. Rings of fewer than three points are nothing.
    /// Each ring of the result begins at its leftmost (then lowest) vertex, polygons
    /// come in the order of theirs, and so do the holes of a polygon: equal rings give
    /// equal regions, whatever order they came in.
    ///
    /// Takes O(n log n) time for n vertices where few edges lie over each other.
    #[must_use]
    pub fn nest(&mut self, rings: &[Ring]) -> Option<Region> {
        self.load(rings).ok()?;
        for k in 0..self.order.len() {
            self.step(self.order[k] as u32).ok()?;
        }
        Some(self.region(rings))
    }

    /// Takes the rings over and puts the vertices in order; no two may be equal.
    fn load(&mut self, rings: &[Ring]) -> Result<(), Touch> {
        self.points.clear();
        self.order.clear();
        self.status.clear();
        self.rings.clear();
        self.rings.resize(rings.len(), Nested::UNSEEN);
        for (ring, points) in rings.iter().enumerate() {
            if points.len() < 3 {
                continue;
            }
            let from = self.points.len() as u32;
            let last = from + points.len() as u32 - 1;
            self.rings[ring].from = from;
            for (k, &at) in (from..).zip(points) {
                let previous = if k == from { last } else { k - 1 };
                let next = if k == last { from } else { k + 1 };
                self.points.push(Corner { at, previous, next, ring: ring as u32 });
                self.order.push(u64::from((at.x as u32) ^ 0x8000_0000) << 32 | u64::from(k));
            }
        }
        self.order.sort();
        // The keys hold no y: vertices above each other are few, and are put right here.
        let points = &self.points;
        for same_x in self.order.chunk_by_mut(|a, b| a >> 32 == b >> 32) {
            if same_x.len() > 1 {
                same_x.sort_by_key(|&key| points[key as u32 as usize].at.y);
                let at = |key: u64| points[key as u32 as usize].at;
                if same_x.windows(2).any(|two| at(two[0]) == at(two[1])) {
                    return Err(Touch);
                }
            }
        }
        Ok(())
    }

    /// One vertex: the edges that end there leave the sweep line, those that begin enter it.
    fn step(&mut self, v: u32) -> Result<(), Touch> {
        let corner = self.points[v as usize];
        let (previous, next) =
            (self.points[corner.previous as usize].at, self.points[corner.next as usize].at);
        let at = self.status.partition_point(|e| e.below(corner.at) > 0);
        let edge = |right: Point, end: u32| Edge {
            left: corner.at,
            right,
            end,
            ring: corner.ring,
            rightward: end == corner.next,
        };
        match (previous < corner.at, next < corner.at) {
            (true, true) => self.end(v, at),
            (true, false) => self.pass(v, at, edge(next, corner.next)),
            (false, true) => self.pass(v, at, edge(previous, corner.previous)),
            (false, false) => {
                let (one, other) = (edge(previous, corner.previous), edge(next, corner.next));
                match side(corner.at, previous, next) {
                    0 => Err(Touch),
                    1.. => self.begin(v, at, one, other),
                    _ => self.begin(v, at, other, one),
                }
            }
        }
    }

    /// Both edges end in `v`: what was below and what was above them become neighbours.
    fn end(&mut self, v: u32, at: usize) -> Result<(), Touch> {
        match self.status.get(at..at + 2) {
            Some([a, b]) if a.end == v && b.end == v => drop(self.status.drain(at..at + 2)),
            _ => return Err(Touch),
        }
        match (at.checked_sub(1).and_then(|k| self.status.get(k)), self.status.get(at)) {
            (Some(below), Some(above)) if !below.stays_below(above) => Err(Touch),
            _ => Ok(()),
        }
    }

    /// One edge ends in `v`, and another takes its place.
    fn pass(&mut self, v: u32, at: usize, edge: Edge) -> Result<(), Touch> {
        match self.status.get_mut(at) {
            Some(old) if old.end == v => *old = edge,
            _ => return Err(Touch),
        }
        self.fits_above(at, &edge)?;
        self.fits_below(at + 1, &edge)
    }

    /// Both edges begin in `v`; a ring not seen before learns here where it lies.
    fn begin(&mut self, v: u32, at: usize, low: Edge, high: Edge) -> Result<(), Touch> {
        self.fits_above(at, &low)?;
        self.fits_below(at, &high)?;
        if self.status.len() >= MAX_STATUS {
            return Err(Touch);
        }
        let ring = low.ring as usize;
        if self.rings[ring].first == NONE {
            let (outside, parent) = match at.checked_sub(1).map(|k| self.status[k]) {
                None => (0, NONE),
                Some(below) => {
                    let around = self.rings[below.ring as usize];
                    let winding = around.left - i32::from(!below.rightward);
                    let within = around.counter_clockwise == below.rightward;
                    (winding, if within { below.ring } else { around.parent })
                }
            };
            let counter_clockwise = low.rightward;
            let left = outside + i32::from(counter_clockwise);
            let nested = Nested { left, counter_clockwise, parent, first: v, ..self.rings[ring] };
            let border = if nested.is_border() { low.ring } else { self.border_at(parent) };
            self.rings[ring] = Nested { border, ..nested };
        }
        self.status.splice(at..at, [low, high]);
        Ok(())
    }

    fn border_at(&self, ring: u32) -> u32 {
        self.rings.get(ring as usize).map_or(NONE, |r| r.border)
    }

    /// Whether the edge below place `at` stays below a new one.
    fn fits_above(&self, at: usize, edge: &Edge) -> Result<(), Touch> {
        match at.checked_sub(1).and_then(|k| self.status.get(k)) {
            Some(below) if !below.stays_below(edge) => Err(Touch),
            _ => Ok(()),
        }
    }

    /// Whether the edge at place `at` is above a new one, and stays so.
    fn fits_below(&self, at: usize, edge: &Edge) -> Result<(), Touch> {
        match self.status.get(at) {
            Some(above) if above.below(edge.left) >= 0 || !edge.stays_below(above) => Err(Touch),
            _ => Ok(()),
        }
    }

    /// The borders, holes with the outer ring that they lie in.
    fn region(&self, rings: &[Ring]) -> Region {
        let mut borders: Vec<u32> = (0..rings.len() as u32).collect();
        borders.retain(|&r| self.rings[r as usize].is_border() && self.rings[r as usize].first != NONE);
        borders.sort_unstable_by_key(|&r| self.points[self.rings[r as usize].first as usize].at);
        let mut polygons: Vec<Polygon> = Vec::new();
        let mut polygon_of = vec![NONE; if borders.len() > 1 { rings.len() } else { 0 }];
        for &border in &borders {
            let nested = self.rings[border as usize];
            let begin = (nested.first - nested.from) as usize;
            let points = &rings[border as usize];
            let mut ring = Vec::with_capacity(points.len());
            ring.extend_from_slice(&points[begin..]);
            ring.extend_from_slice(&points[..begin]);
            if nested.counter_clockwise {
                if let Some(place) = polygon_of.get_mut(border as usize) {
                    *place = polygons.len() as u32;
                }
                polygons.push(Polygon { rings: vec![ring] });
            } else {
                // A hole's surroundings are solid, so that the nearest border around
                // is the outer ring of a polygon, which began farther left.
                let around = polygon_of[self.border_at(nested.parent) as usize];
                polygons[around as usize].rings.push(ring);
            }
        }
        Region { polygons }
    }
}

#[cfg(test)]
mod tests;
