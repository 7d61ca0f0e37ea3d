//! A checked job as pictures: what was seen of its layers, and how it is shown.
//!
//! Takes the layers from the plate up, each with what its pieces are; keeps of
//! them what pictures need, in bounded memory; gives an SVG, a PNG or a page
//! with a layer slider. Knows no file system.
//!
//! # Layout
//! - [`class`]: what a piece of a layer is, and its colours
//! - [`elevation`]: the job seen from the front and from the side
//! - [`notable`]: the few layers that a picture shows from above
//! - [`stack`]: all layers, simplified and packed, for the page
//! - [`pack`]: a layer as bytes, the page's format
//! - [`simplify`]: rings with fewer points
//! - [`picture`], [`page`]: what comes of it
pub mod class;
pub mod elevation;
pub mod notable;
pub mod pack;
pub mod page;
pub mod picture;
mod simplify;
pub mod stack;

use crate::detect::island::Standing;
use crate::detect::overhang::Piece;
use crate::detect::walk;
use crate::layers::shape::{Bounds, Point, Polygon};
use crate::layers::stack::Layer;
use class::Class;

/// A layer, and what its pieces are.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// The layer.
    pub layer: &'a Layer,
    /// What each polygon of its part is, in their order; where it is shorter, body.
    pub standings: &'a [Standing],
    /// What of the part has too little below it.
    pub overhangs: &'a [Piece],
}

impl<'a> From<&walk::Seen<'a>> for Seen<'a> {
    fn from(seen: &walk::Seen<'a>) -> Seen<'a> {
        Seen { layer: seen.layer, standings: &seen.standings.part, overhangs: seen.overhang }
    }
}

impl<'a> Seen<'a> {
    /// The pieces in the order of drawing: what comes later covers.
    pub fn pieces(self) -> impl Iterator<Item = (Class, &'a Polygon)> {
        let aid = self.layer.aid.polygons.iter().map(|p| (Class::Aid, p));
        let of = |k: usize| match self.standings.get(k) {
            None | Some(Standing::Body) => Class::Body,
            Some(Standing::Island) => Class::Island,
            Some(Standing::Appears) => Class::Appears,
        };
        let part = self.layer.part.polygons.iter().enumerate().map(move |(k, p)| (of(k), p));
        // An island that appears is drawn as such.
        let overhangs = self.overhangs.iter().filter(|o| !o.island);
        aid.chain(part).chain(overhangs.map(|o| (Class::Overhang, &o.polygon)))
    }

    /// Area of the pieces of a class, mm².
    #[must_use]
    pub fn area_mm2(self, class: Class) -> f64 {
        self.pieces().filter(|(c, _)| *c == class).map(|(_, p)| p.area_mm2()).sum()
    }
}

/// What is kept of a job's layers.
#[derive(Debug)]
pub struct Survey {
    /// Seen from the front and from the side.
    pub elevation: elevation::Elevation,
    /// The layers worth a picture.
    pub notable: notable::Notable,
    /// All layers, when a page is asked for.
    pub stack: Option<stack::Stack>,
    /// Of all pieces.
    all: Bounds,
    /// Of the part alone.
    part: Bounds,
}

/// What is printed besides the part is shown up to so far from it, mm: a skirt, but
/// not the prime line at the other end of the plate.
const BESIDE_MM: f64 = 6.0;

impl Survey {
    /// Of no layer yet. `stack`: whether a page will be made of it.
    #[must_use]
    pub fn new(stack: bool) -> Survey {
        Survey {
            elevation: elevation::Elevation::default(),
            notable: notable::Notable::default(),
            stack: stack.then(stack::Stack::default),
            all: Bounds::EMPTY,
            part: Bounds::EMPTY,
        }
    }

    /// What pictures show, seen from above: the part, and what is printed close to it.
    /// [`Bounds::EMPTY`] when nothing is printed.
    #[must_use]
    pub fn shown(&self) -> Bounds {
        if self.part == Bounds::EMPTY {
            return self.all;
        }
        let beside = Point::from_mm(BESIDE_MM, BESIDE_MM);
        let (part, all) = (self.part, self.all);
        let least = |c: i32, by: i32, limit: i32| c.saturating_sub(by).max(limit);
        let most = |c: i32, by: i32, limit: i32| c.saturating_add(by).min(limit);
        Bounds {
            min: Point {
                x: least(part.min.x, beside.x, all.min.x),
                y: least(part.min.y, beside.y, all.min.y),
            },
            max: Point { x: most(part.max.x, beside.x, all.max.x), y: most(part.max.y, beside.y, all.max.y) },
        }
    }

    /// Takes the next layer.
    pub fn add(&mut self, seen: Seen) {
        self.part = self.part.joined(seen.layer.part.bounds());
        self.all = self.part.joined(self.all).joined(seen.layer.aid.bounds());
        self.elevation.add(seen);
        self.notable.add(seen);
        if let Some(stack) = &mut self.stack {
            stack.add(seen);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::Region;

    /// A square of 10 mm from a place on.
    fn square(x_mm: f64) -> Region {
        let corners = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)];
        let ring = corners.map(|(x, y)| Point::from_mm(x + x_mm, y)).to_vec();
        Region { polygons: vec![Polygon { rings: vec![ring] }] }
    }

    fn shown(part: Region, aid: Region) -> [[f64; 2]; 2] {
        let mut survey = Survey::new(false);
        let layer = Layer { part, aid, ..Layer::default() };
        survey.add(Seen { layer: &layer, standings: &[], overhangs: &[] });
        survey.shown().mm()
    }

    #[test]
    fn the_part_fills_the_picture() {
        let nothing = Region::default;
        assert_eq!(shown(square(0.0), nothing()), [[0.0, 0.0], [10.0, 10.0]]);
        assert_eq!(shown(square(0.0), square(3.0)), [[0.0, 0.0], [13.0, 10.0]]);
        assert_eq!(shown(square(0.0), square(-100.0)), [[-6.0, 0.0], [10.0, 10.0]]);
        assert_eq!(shown(nothing(), square(50.0)), [[50.0, 0.0], [60.0, 10.0]]);
        assert_eq!(Survey::new(true).shown(), Bounds::EMPTY);
    }
}
