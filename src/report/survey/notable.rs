//! The few layers that a picture shows from above: those where the largest islands
//! appear; in a job without islands those with the largest overhangs.
use super::Seen;
use super::class::Class;
use super::pack::{Packed, STEP_MM, pack};
use crate::layers::shape::Polygon;

/// Layers that a picture shows.
pub const SHOWN_MAX: usize = 12;

/// How far lines may be moved, mm.
const TOLERANCE_MM: f64 = 0.02;

/// A layer worth a picture.
#[derive(Clone, Debug)]
pub struct Shown {
    /// From 0 at the plate.
    pub number: u32,
    /// Z at which it is printed, mm.
    pub top_mm: f64,
    /// The islands that appear here, mm².
    pub island_mm2: f64,
    /// The overhangs here, mm².
    pub overhang_mm2: f64,
    packed: Packed,
}

/// The layers chosen so far.
#[derive(Debug, Default)]
pub struct Notable {
    layers: Vec<Shown>,
}

impl Shown {
    /// Its pieces in the order of drawing.
    #[must_use]
    pub fn pieces(&self) -> Vec<(Class, Polygon)> {
        super::pack::unpack(&self.packed.bytes).unwrap_or_default()
    }

    /// Millimetres of a point of its pieces.
    #[must_use]
    pub fn mm(p: crate::layers::shape::Point) -> [f64; 2] {
        [f64::from(p.x) * STEP_MM, f64::from(p.y) * STEP_MM]
    }

    fn worth(&self) -> (f64, f64) {
        (self.island_mm2, self.overhang_mm2)
    }
}

impl Notable {
    /// Takes the next layer.
    pub fn add(&mut self, seen: Seen) {
        let (island_mm2, overhang_mm2) = (seen.area_mm2(Class::Appears), seen.area_mm2(Class::Overhang));
        let worth = (island_mm2, overhang_mm2);
        if worth <= (0.0, 0.0) {
            return;
        }
        if self.layers.len() >= SHOWN_MAX {
            let least = (0..self.layers.len()).min_by(|&a, &b| {
                let (a, b) = (&self.layers[a], &self.layers[b]);
                // Among equals the higher one goes.
                (a.worth().partial_cmp(&b.worth()))
                    .unwrap_or(std::cmp::Ordering::Equal)
                    .then(b.number.cmp(&a.number))
            });
            let Some(least) = least.filter(|&k| self.layers[k].worth() < worth) else { return };
            self.layers.remove(least);
        }
        self.layers.push(Shown {
            number: seen.layer.number,
            top_mm: seen.layer.top_mm,
            island_mm2,
            overhang_mm2,
            packed: pack(seen.pieces(), TOLERANCE_MM),
        });
    }

    /// The layers from the plate up: those with islands, or if there is none the others.
    pub fn layers(&self) -> impl Iterator<Item = &Shown> {
        let islands = self.layers.iter().any(|l| l.island_mm2 > 0.0);
        self.layers.iter().filter(move |l| !islands || l.island_mm2 > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::island::Standing;
    use crate::detect::overhang::Piece;
    use crate::layers::shape::{Point, Region};
    use crate::layers::stack::Layer;

    fn square(side_mm: f64) -> Polygon {
        let corners = [(0.0, 0.0), (side_mm, 0.0), (side_mm, side_mm), (0.0, side_mm)];
        Polygon { rings: vec![corners.map(|(x, y)| Point::from_mm(x, y)).to_vec()] }
    }

    #[test]
    fn the_largest_islands_are_shown_from_the_plate_up() {
        let mut notable = Notable::default();
        for number in 0..40 {
            let part = Region { polygons: vec![square(1.0 + f64::from(number * 7 % 40))] };
            let layer = Layer { number, part, ..Layer::default() };
            let overhangs = [Piece { polygon: square(100.0), island: false }];
            let standing = if number % 2 == 0 { Standing::Appears } else { Standing::Body };
            notable.add(Seen { layer: &layer, standings: &[standing], overhangs: &overhangs });
        }
        let found: Vec<u32> = notable.layers().map(|l| l.number).collect();
        let mut expect: Vec<u32> = (0..40).filter(|n| n % 2 == 0).collect();
        expect.sort_by_key(|n| std::cmp::Reverse(n * 7 % 40));
        expect.truncate(SHOWN_MAX);
        expect.sort_unstable();
        assert_eq!(found, expect);
        let shown = notable.layers().next().expect("a layer");
        assert_eq!(shown.pieces()[0].0, Class::Appears);
    }

    #[test]
    fn without_islands_it_is_the_overhangs() {
        let mut notable = Notable::default();
        for number in 0..3 {
            let layer = Layer { number, ..Layer::default() };
            let overhangs: Vec<Piece> =
                (0..number).map(|_| Piece { polygon: square(1.0), island: false }).collect();
            notable.add(Seen { layer: &layer, standings: &[], overhangs: &overhangs });
        }
        assert_eq!(notable.layers().map(|l| l.number).collect::<Vec<_>>(), [1, 2]);
    }
}
