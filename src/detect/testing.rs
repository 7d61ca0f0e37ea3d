//! Layers for the tests of this room.
use crate::layers::polygon::{Inside, resolve};
use crate::layers::shape::{Point, Region, Ring};
use crate::layers::stack::Layer;

/// A counter-clockwise rectangle from a corner to the opposite one, mm.
pub(super) fn ring(x0: f64, y0: f64, x1: f64, y1: f64) -> Ring {
    [(x0, y0), (x1, y0), (x1, y1), (x0, y1)].map(|p| Point::from_mm(p.0, p.1)).to_vec()
}

/// Rectangles `[x0, y0, x1, y1]` united; those in `holes` cut out.
pub(super) fn region(rectangles: &[[f64; 4]], holes: &[[f64; 4]]) -> Region {
    let all: Vec<Ring> = rectangles.iter().map(|r| ring(r[0], r[1], r[2], r[3])).collect();
    let solid = resolve(&all, Inside::NonZero);
    let cut: Vec<Ring> = holes.iter().map(|r| ring(r[0], r[1], r[2], r[3])).collect();
    crate::layers::polygon::difference(&solid, &resolve(&cut, Inside::NonZero))
}

/// Layer `number` of 0.1 mm each.
pub(super) fn layer(number: u32, part: Region) -> Layer {
    let bottom_mm = f64::from(number) * 0.1;
    Layer { number, bottom_mm, top_mm: bottom_mm + 0.1, part, ..Layer::default() }
}
