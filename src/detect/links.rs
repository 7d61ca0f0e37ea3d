//! Which polygons of the layer below a layer's polygons stand on.
//!
//! Takes two neighbouring layers, gives for each polygon of the upper one all polygons
//! of the lower one with which it shares area. Pure, so that pairs of layers are linked
//! in parallel. Knows no island.
use super::overlap::{Outline, sweep};
use crate::layers::shape::{Bounds, Polygon};
use crate::layers::stack::Layer;

/// For each polygon of a layer the polygons below that hold it.
///
/// Polygons of a layer are numbered: first those of the part, then those of the aid.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Links {
    starts: Vec<u32>,
    below: Vec<u32>,
}

impl Links {
    /// The polygons below that share area with polygon `k`, ascending.
    #[must_use]
    pub fn below(&self, k: usize) -> &[u32] {
        &self.below[self.starts[k] as usize..self.starts[k + 1] as usize]
    }

    /// Number of polygons of the upper layer.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// Whether the upper layer holds no polygon.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    fn of(mut pairs: Vec<(u32, u32)>, count: usize) -> Links {
        pairs.sort_unstable();
        let mut starts = vec![0_u32; count + 1];
        for &(k, _) in &pairs {
            starts[k as usize + 1] += 1;
        }
        for k in 0..count {
            starts[k + 1] += starts[k];
        }
        Links { starts, below: pairs.into_iter().map(|(_, b)| b).collect() }
    }
}

/// The polygons of a layer in the order in which [`Links`] number them.
pub fn polygons(layer: &Layer) -> impl Iterator<Item = &Polygon> {
    layer.part.polygons.iter().chain(&layer.aid.polygons)
}

/// Links the polygons of a layer to those below.
#[must_use]
pub fn links(below: &Layer, layer: &Layer) -> Links {
    let lower: Vec<Outline<'_>> = polygons(below).map(Outline::new).collect();
    let upper: Vec<Outline<'_>> = polygons(layer).map(Outline::new).collect();
    let mut pairs = Vec::new();
    candidates(&upper, &lower, |k, b| {
        if upper[k as usize].overlaps(&lower[b as usize]) {
            pairs.push((k, b));
        }
    });
    Links::of(pairs, upper.len())
}

/// All pairs whose bounds overlap.
fn candidates(upper: &[Outline<'_>], lower: &[Outline<'_>], mut see: impl FnMut(u32, u32)) {
    let x: fn(Bounds) -> (i32, i32) = |b| (b.min.x, b.max.x);
    let y: fn(Bounds) -> (i32, i32) = |b| (b.min.y, b.max.y);
    let total = |of: fn(Bounds) -> (i32, i32)| -> i64 {
        let extent = |o: &Outline<'_>| i64::from(of(o.bounds()).1) - i64::from(of(o.bounds()).0);
        upper.iter().chain(lower).map(extent).sum()
    };
    // Along the axis in which the polygons are shorter, fewer are open at once.
    let along = if total(x) <= total(y) { x } else { y };
    let spans = |all: &[Outline<'_>]| -> Vec<(i32, i32)> { all.iter().map(|o| along(o.bounds())).collect() };
    sweep(&spans(upper), &spans(lower), |k, b| {
        if upper[k as usize].bounds().overlap(lower[b as usize].bounds()) {
            see(k, b);
        }
        false
    });
}

#[cfg(test)]
mod tests {
    use super::super::testing::{layer, region, ring};
    use super::*;
    use crate::layers::shape::Region;

    #[test]
    fn all_that_overlap_are_linked() {
        let below =
            layer(0, region(&[[0.0, 0.0, 1.0, 1.0], [2.0, 0.0, 3.0, 1.0], [4.0, 0.0, 5.0, 1.0]], &[]));
        let mut above = layer(1, region(&[[0.5, 0.0, 2.5, 1.0], [5.0, 0.0, 6.0, 1.0]], &[]));
        above.aid = region(&[[4.5, 0.5, 4.6, 0.6]], &[]);
        let links = links(&below, &above);
        assert_eq!(links.len(), 3);
        let found: Vec<usize> = (0..3).map(|k| links.below(k).len()).collect();
        let order = if above.part.polygons[0].bounds().min.x < 40_000 { [2, 0, 1] } else { [0, 2, 1] };
        assert_eq!(found, order);
    }

    /// A plate with ten thousand holes and a peg in each: all bounds overlap the plate's.
    #[test]
    fn many_pegs_in_many_holes_take_no_time() {
        let square = |k: u32, inset: f64| {
            let (x, y) = (f64::from(k % 100), f64::from(k / 100));
            ring(x + inset, y + inset, x + 1.0 - inset, y + 1.0 - inset)
        };
        let hole = |k: u32| square(k, 0.1).into_iter().rev().collect();
        let rings = std::iter::once(ring(-1.0, -1.0, 101.0, 101.0)).chain((0..10_000).map(hole)).collect();
        let plate = layer(0, Region { polygons: vec![Polygon { rings }] });
        // Every fourth peg is as wide as its hole, every fourth one wider.
        let peg = |k: u32| Polygon { rings: vec![square(k, [0.2, 0.1, 0.2, 0.09][k as usize % 4])] };
        let pegs = layer(1, (0..10_000).map(peg).collect());
        let links = links(&plate, &pegs);
        assert!((0..10_000).all(|k| links.below(k).len() == usize::from(k % 4 == 3)));
    }
}
