//! Overhangs by polygons: a layer without what the layer below holds.
//!
//! Takes two neighbouring layers with their [`Links`], gives the [`Piece`]s of the upper
//! one that neither the lower one nor the material's own strength holds. Works on one
//! pair at a time, so that pairs run in parallel. Knows no image and no mesh.
//!
//! What is held reaches sideways by [`reach_mm`]: the distance between the layers'
//! planes times the tangent of the steepest angle that holds itself. How it spreads is
//! a choice ([`Growth`]):
//! - *Naive*, as the image-based peers do (paper 001, section 1): everything within that
//!   distance of the layer below, across gaps too; a stair beside a wall then looks held
//!   (Fig. 2, and Fig. 11, case 1).
//! - *Conditional*: the way must lie within the layer's own polygon. Then what lies below
//!   matters only through the edges on which a residual piece (a polygon without what is
//!   below it) meets it, since a shortest way leaves the layer below for the last time
//!   there and stays in the piece. Each residual piece is decided by itself.
//!
//! Most of a residual piece is *proved* held first ([`strip`]), which spares the offset;
//! what is left after the offset of the rest may be bridged ([`bridge`]).
//!
//! Islands in the layer where they appear overhang whole; their pieces say so.
mod bridge;
mod gap;
mod held;
mod strip;

use super::links::{Links, polygons};
use super::overhang::{Growth, Piece, SelfSupport};
use crate::layers::polygon::{difference, grow, without};
use crate::layers::shape::{Point, Polygon, Region, UNITS_PER_MM};
use crate::layers::stack::Layer;
use held::Residual;

/// What is no wider than this on average comes from rounding, grid steps.
const DUST: f64 = 3.0;

/// Added to the reach, mm, so that a wall at exactly the steepest angle holds itself
/// although its points are rounded to the grid.
pub const SLACK_MM: f64 = 0.000_5;

/// Longest reach, mm: an angle of 90° asks for no end.
const LONGEST_REACH_MM: f64 = 100.0;

/// How far sideways what lies below holds a layer, mm.
#[must_use]
pub fn reach_mm(below: &Layer, layer: &Layer, angle_deg: f64) -> f64 {
    let rise = (layer.plane_mm() - below.plane_mm()).max(0.0);
    let slope = angle_deg.clamp(0.0, 90.0).to_radians().tan();
    (rise * slope + SLACK_MM).clamp(0.0, LONGEST_REACH_MM)
}

/// The overhanging pieces of a layer.
#[must_use]
pub fn pieces(
    below: &Layer,
    layer: &Layer,
    links: &Links,
    rules: &SelfSupport,
    growth: Growth,
) -> Vec<Piece> {
    if layer.number == 0 {
        return Vec::new();
    }
    let reach = reach_mm(below, layer, rules.angle_deg);
    match growth {
        Growth::Conditional => conditional(below, layer, links, rules, reach),
        Growth::Naive => naive(below, layer, links, reach),
    }
}

fn naive(below: &Layer, layer: &Layer, links: &Links, reach: f64) -> Vec<Piece> {
    let all: Region = polygons(below).cloned().collect();
    let held = if all.is_empty() { all } else { grow(&all, reach) };
    let mut found = Vec::new();
    for (k, polygon) in layer.part.polygons.iter().enumerate() {
        let island = links.below(k).is_empty();
        let only = Region { polygons: vec![polygon.clone()] };
        let left = difference(&only, &held).polygons;
        found.extend(left.into_iter().filter(|p| !is_dust(p)).map(|polygon| Piece { polygon, island }));
    }
    found
}

fn conditional(below: &Layer, layer: &Layer, links: &Links, rules: &SelfSupport, reach: f64) -> Vec<Piece> {
    let lower: Vec<&Polygon> = polygons(below).collect();
    let mut found = Vec::new();
    for (k, polygon) in layer.part.polygons.iter().enumerate() {
        let holding: Vec<&Polygon> = links.below(k).iter().map(|&b| lower[b as usize]).collect();
        if holding.is_empty() {
            found.push(Piece { polygon: polygon.clone(), island: true });
            continue;
        }
        if holding.contains(&polygon) {
            continue;
        }
        let residual = without(&polygon.rings, holding.iter().flat_map(|p| &p.rings));
        let residual: Vec<Polygon> = residual.polygons.into_iter().filter(|p| !is_dust(p)).collect();
        if residual.is_empty() {
            continue;
        }
        let borders = held::Borders::new(polygon, &holding);
        for piece in residual {
            let left = left_of(&borders.residual(piece), &borders, rules, reach);
            found.extend(left.into_iter().map(|polygon| Piece { polygon, island: false }));
        }
    }
    found
}

/// What of a residual piece neither reach nor bridge holds.
fn left_of(piece: &Residual, borders: &held::Borders, rules: &SelfSupport, reach: f64) -> Vec<Polygon> {
    let reach_units = reach * UNITS_PER_MM;
    let left = match strip::runs(piece, reach_units) {
        Some(runs) => runs.iter().flat_map(|run| left_of_run(piece, run, reach_units)).collect(),
        None if gap::may_jump(piece, reach_units) => gap::spread(piece, borders, reach),
        None => without(&piece.polygon.rings, &piece.sectors(reach_units)),
    };
    let left: Vec<Polygon> = left.polygons.into_iter().filter(|p| !is_dust(p)).collect();
    if left.is_empty() || rules.bridge_mm <= 0.0 {
        return left;
    }
    bridge::unbridged(piece, left, rules.bridge_mm * UNITS_PER_MM)
}

fn left_of_run(piece: &Residual, run: &strip::Run, reach: f64) -> Vec<Polygon> {
    let sectors = piece.sectors_of(run.of, run.from, run.edges, reach);
    without([&run.ring], &sectors).polygons
}

/// Whether a polygon is so thin that it comes from rounding: its mean width is twice its
/// area over the length of its border.
fn is_dust(polygon: &Polygon) -> bool {
    let length: f64 = polygon.rings.iter().map(|r| length(r)).sum();
    2.0 * polygon.area_mm2() * UNITS_PER_MM * UNITS_PER_MM <= DUST * length
}

fn length(ring: &[Point]) -> f64 {
    let ends = ring.iter().zip(ring.iter().cycle().skip(1));
    ends.map(|(a, b)| (f64::from(b.x) - f64::from(a.x)).hypot(f64::from(b.y) - f64::from(a.y))).sum()
}
