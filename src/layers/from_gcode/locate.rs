//! What a point lies in: material, a hole, or outside.
//!
//! Takes a region, gives answers from the edge next to the left of a point. Edges
//! are sorted into rows, so that an answer costs the edges of one row. Knows
//! no polygon library.
use crate::layers::shape::{Point, Region};

/// What a point lies in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Face {
    /// Inside a polygon.
    Material,
    /// In a hole.
    Hole(Hole),
    /// In no polygon and no hole.
    Outside,
}

/// A hole of a region: ring `ring` of polygon `polygon`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Hole {
    pub(super) polygon: u32,
    pub(super) ring: u32,
}

/// Edges of an outer or inner ring, low end first.
struct Edge {
    low: Point,
    high: Point,
    polygon: u32,
    ring: u32,
    /// The ring runs down along it.
    falls: bool,
}

/// Answers for one region.
pub(super) struct Locator {
    edges: Vec<Edge>,
    /// Rows of edges: indices, and where each row's begin.
    rows: Vec<u32>,
    starts: Vec<usize>,
    bottom: i32,
    row_height: i32,
    /// For each polygon what its outer ring lies in.
    parents: Vec<Face>,
}

/// Rows at most: a long edge is listed in each row that it crosses.
const ROWS_MAX: usize = 4096;

impl Locator {
    pub(super) fn new(region: &Region) -> Locator {
        let mut edges = Vec::with_capacity(region.len());
        for (polygon, p) in region.polygons.iter().enumerate() {
            for (ring, points) in p.rings.iter().enumerate() {
                let Some(&last) = points.last() else { continue };
                let mut a = last;
                for &b in points {
                    if a.y != b.y {
                        let falls = b.y < a.y;
                        let (low, high) = if falls { (b, a) } else { (a, b) };
                        edges.push(Edge { low, high, polygon: polygon as u32, ring: ring as u32, falls });
                    }
                    a = b;
                }
            }
        }
        let bounds = region.bounds();
        let height = (i64::from(bounds.max.y) - i64::from(bounds.min.y)).max(0);
        let rows = (edges.len() / 4).clamp(1, ROWS_MAX);
        let row_height = (height / rows as i64 + 1) as i32;
        let mut locator = Locator {
            edges,
            rows: Vec::new(),
            starts: vec![0; rows + 1],
            bottom: bounds.min.y,
            row_height,
            parents: Vec::new(),
        };
        locator.sort_into_rows(rows);
        locator.parents = vec![Face::Outside; region.polygons.len()];
        locator.find_parents(region);
        locator
    }

    fn row(&self, y: i32) -> usize {
        ((i64::from(y) - i64::from(self.bottom)) / i64::from(self.row_height)) as usize
    }

    fn sort_into_rows(&mut self, rows: usize) {
        let mut counts = vec![0_usize; rows];
        for edge in &self.edges {
            counts[self.row(edge.low.y)..=self.row(edge.high.y)].iter_mut().for_each(|count| *count += 1);
        }
        let mut at = 0;
        for (row, count) in counts.iter().enumerate() {
            self.starts[row] = at;
            at += count;
        }
        self.starts[rows] = at;
        let mut next = self.starts.clone();
        let mut rows_of_edges = vec![0; at];
        for (k, edge) in self.edges.iter().enumerate() {
            for at in &mut next[self.row(edge.low.y)..=self.row(edge.high.y)] {
                rows_of_edges[*at] = k as u32;
                *at += 1;
            }
        }
        self.rows = rows_of_edges;
    }

    /// From the left to the right: what lies to the left of a polygon is known before it.
    fn find_parents(&mut self, region: &Region) {
        let leftmost = |k: usize| region.polygons[k].rings.first()?.iter().min().copied();
        let mut order: Vec<(Point, usize)> =
            (0..region.polygons.len()).filter_map(|k| Some((leftmost(k)?, k))).collect();
        order.sort_unstable();
        for (point, k) in order {
            self.parents[k] = self.left_of(point, Some(k as u32));
        }
    }

    /// What a point lies in; on an edge either side of it.
    pub(super) fn at(&self, p: Point) -> Face {
        self.left_of(p, None)
    }

    /// What the outer ring of each polygon lies in.
    pub(super) fn parents(&self) -> &[Face] {
        &self.parents
    }

    /// What lies between a point and the next edge to its left, edges of one polygon aside.
    fn left_of(&self, p: Point, but: Option<u32>) -> Face {
        if p.y < self.bottom || self.starts.len() < self.row(p.y) + 2 {
            return Face::Outside;
        }
        let row = self.row(p.y);
        let mut best: Option<(f64, &Edge)> = None;
        for &k in &self.rows[self.starts[row]..self.starts[row + 1]] {
            let edge = &self.edges[k as usize];
            // Half open, so that a point at the height of a vertex meets one of its edges.
            if edge.low.y > p.y || edge.high.y <= p.y || Some(edge.polygon) == but {
                continue;
            }
            let along =
                (f64::from(p.y) - f64::from(edge.low.y)) / (f64::from(edge.high.y) - f64::from(edge.low.y));
            let x = f64::from(edge.low.x) + along * (f64::from(edge.high.x) - f64::from(edge.low.x));
            if x < f64::from(p.x) && best.is_none_or(|(other, _)| x > other) {
                best = Some((x, edge));
            }
        }
        let Some((_, edge)) = best else { return Face::Outside };
        // Material lies to the left of every edge as its ring runs.
        if edge.falls {
            Face::Material
        } else if edge.ring > 0 {
            Face::Hole(Hole { polygon: edge.polygon, ring: edge.ring })
        } else {
            self.parents[edge.polygon as usize]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::polygon::{Inside, resolve};
    use proptest::prelude::*;

    fn ring(x: i32, y: i32, side: i32) -> Vec<Point> {
        [(x, y), (x + side, y), (x + side, y + side), (x, y + side)].map(|(x, y)| Point { x, y }).to_vec()
    }

    #[test]
    fn squares_in_squares() {
        let rings = [ring(0, 0, 100), ring(10, 10, 80), ring(20, 20, 60), ring(30, 30, 40), ring(200, 0, 10)];
        let region = resolve(&rings, Inside::Odd);
        assert_eq!(region.polygons.len(), 3);
        let locator = Locator::new(&region);
        let check = |x: i32, y: i32, expect: &str| {
            let found = match locator.at(Point { x, y }) {
                Face::Material => "material".to_owned(),
                Face::Outside => "outside".to_owned(),
                Face::Hole(h) => {
                    let low =
                        region.polygons[h.polygon as usize].rings[h.ring as usize].iter().min().unwrap();
                    format!("hole from {}", low.x)
                }
            };
            assert_eq!(found, expect, "{x} {y}");
        };
        check(5, 50, "material");
        check(95, 50, "material");
        check(15, 50, "hole from 10");
        check(85, 50, "hole from 10");
        check(25, 50, "material");
        check(50, 50, "hole from 30");
        check(150, 5, "outside");
        check(205, 5, "material");
        check(-1, 5, "outside");
        check(50, 101, "outside");
        check(50, -1, "outside");
        let inner = region.polygons.iter().position(|p| p.bounds().min.x == 20).unwrap();
        assert!(matches!(locator.parents()[inner], Face::Hole(_)));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn agrees_with_parity(
            squares in proptest::collection::vec((0i32..60, 0i32..60, 3i32..40), 1..10),
            probes in proptest::collection::vec((0i32..100, 0i32..100), 30),
        ) {
            let rings: Vec<Vec<Point>> = squares.iter().map(|&(x, y, s)| ring(4 * x, 4 * y, 4 * s)).collect();
            let region = resolve(&rings, Inside::Odd);
            let locator = Locator::new(&region);
            for (x, y) in probes {
                // Between the lines on which all edges lie.
                let (x, y) = (4 * x + 1, 4 * y + 1);
                let inside = squares.iter().filter(|&&(a, b, s)| {
                    (4 * a..4 * (a + s)).contains(&x) && (4 * b..4 * (b + s)).contains(&y)
                });
                let solid = inside.count() % 2 == 1;
                prop_assert_eq!(locator.at(Point { x, y }) == Face::Material, solid);
            }
        }
    }
}
