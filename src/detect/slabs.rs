//! Edges by height, so that a point looks only at those beside it.
//!
//! Takes edges, gives those that reach into a range of heights, and perhaps a few
//! more. Holds at most four entries an edge, in the mean, whatever the shape.
use crate::layers::shape::{Point, Ring, ring_edges};

/// From a point to a point.
pub(super) type Edge = (Point, Point);

/// The edges of a ring in their order, those of no length left out.
pub(super) fn edges(ring: &Ring) -> impl Iterator<Item = Edge> + Clone + '_ {
    ring_edges(ring).map(|[a, b]| (a, b)).filter(|(a, b)| a != b)
}

/// The index.
#[derive(Debug)]
pub(super) struct Slabs {
    bottom: i64,
    height: i64,
    starts: Vec<u32>,
    edges: Vec<Edge>,
}

impl Slabs {
    /// Of these edges.
    pub(super) fn new(edges: impl Iterator<Item = Edge> + Clone) -> Slabs {
        let (mut low, mut high, mut total, mut count) = (i64::MAX, i64::MIN, 0_i64, 0_i64);
        for (a, b) in edges.clone() {
            let (ay, by) = (i64::from(a.y), i64::from(b.y));
            (low, high) = (low.min(ay.min(by)), high.max(ay.max(by)));
            total += (ay - by).abs();
            count += 1;
        }
        if count == 0 {
            return Slabs { bottom: 0, height: 1, starts: vec![0], edges: Vec::new() };
        }
        // Rounded up: an edge reaches into `length / height + 2` slabs at most.
        let height = ((total + 2 * count - 1) / (2 * count)).max((high - low) / count).max(1);
        let mut slabs = Slabs { bottom: low, height, starts: Vec::new(), edges: Vec::new() };
        let count = slabs.at(high) + 1;
        let mut starts = vec![0_u32; count + 1];
        for (a, b) in edges.clone() {
            let (low, high) = (slabs.at(a.y.min(b.y).into()), slabs.at(a.y.max(b.y).into()));
            starts[low + 1..=high + 1].iter_mut().for_each(|n| *n += 1);
        }
        for k in 0..count {
            starts[k + 1] += starts[k];
        }
        let mut next = starts.clone();
        slabs.edges = vec![(Point::default(), Point::default()); starts[count] as usize];
        for (a, b) in edges {
            let (low, high) = (slabs.at(a.y.min(b.y).into()), slabs.at(a.y.max(b.y).into()));
            for slot in &mut next[low..=high] {
                slabs.edges[*slot as usize] = (a, b);
                *slot += 1;
            }
        }
        slabs.starts = starts;
        slabs
    }

    fn at(&self, y: i64) -> usize {
        usize::try_from((y - self.bottom) / self.height).unwrap_or(0)
    }

    /// All edges that reach into the heights from `low` to `high`. One may come twice where
    /// these are two heights, never where they are one.
    pub(super) fn near(&self, low: i64, high: i64) -> &[Edge] {
        let last = self.starts.len() - 1;
        let (from, to) = (self.at(low).min(last), (self.at(high) + 1).min(last));
        &self.edges[self.starts[from] as usize..self.starts[to.max(from)] as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn no_edge_is_missed(
            ring in prop::collection::vec((-50..50_i32, -50..50_i32), 0..40),
            low in -60..60_i64,
            rise in 0..30_i64,
        ) {
            let ring: Ring = ring.into_iter().map(|(x, y)| Point { x, y }).collect();
            let slabs = Slabs::new(edges(&ring));
            let near = slabs.near(low, low + rise);
            let mut alone = slabs.near(low, low).to_vec();
            alone.sort_unstable();
            let mut all: Vec<Edge> = edges(&ring).collect();
            all.sort_unstable();
            // The ring itself may run along an edge more than once.
            for edge in &alone {
                let count = |list: &[Edge]| list.iter().filter(|e| *e == edge).count();
                prop_assert!(count(&alone) <= count(&all));
            }
            prop_assert!(slabs.edges.len() <= 4 * ring.len());
            for edge in edges(&ring) {
                let (a, b) = (i64::from(edge.0.y), i64::from(edge.1.y));
                if a.min(b) <= low + rise && low <= a.max(b) {
                    prop_assert!(near.contains(&edge));
                }
            }
        }
    }
}
