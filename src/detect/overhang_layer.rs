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
//! Most of a residual piece is *proved* held first (`strip`), which spares the offset;
//! what is left after the offset of the rest may be bridged (`bridge`).
//!
//! Islands in the layer where they appear overhang whole; their pieces say so.
mod bridge;
mod gap;
mod held;
mod strip;

use super::links::{Links, polygons};
use super::overhang::{Growth, Piece, SelfSupport};
use crate::layers::polygon::{difference, grow, without};
use crate::layers::shape::{Bounds, Polygon, Region, UNITS_PER_MM, ring_length};
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
            let left = left_of(&borders.residual(piece), rules, reach);
            found.extend(left.into_iter().map(|polygon| Piece { polygon, island: false }));
        }
    }
    found
}

/// What of a residual piece neither reach nor bridge holds.
fn left_of(piece: &Residual, rules: &SelfSupport, reach: f64) -> Vec<Polygon> {
    let reach_units = reach * UNITS_PER_MM;
    let left = match strip::runs(piece, reach_units) {
        Some(runs) => runs.iter().flat_map(|run| left_of_run(piece, run, reach_units)).collect(),
        None => {
            let sectors = piece.sectors(reach_units);
            let held = gap::held_by(&piece.polygon.rings, &piece.free(), sectors, reach_units);
            without(&piece.polygon.rings, &held)
        }
    };
    let left: Vec<Polygon> = left.polygons.into_iter().filter(|p| !is_dust(p)).collect();
    if left.is_empty() || rules.bridge_mm <= 0.0 {
        return left;
    }
    bridge::unbridged(piece, left, rules.bridge_mm * UNITS_PER_MM)
}

fn left_of_run(piece: &Residual, run: &strip::Run, reach: f64) -> Vec<Polygon> {
    let sectors = piece.sectors_of(run.of, run.from, run.edges, reach, Bounds::of(&run.ring));
    without([&run.ring], sectors.iter().map(|s| &s.ring)).polygons
}

/// Whether a polygon is so thin that it comes from rounding: its mean width is twice its
/// area over the length of its border.
fn is_dust(polygon: &Polygon) -> bool {
    let length: f64 = polygon.rings.iter().map(|r| ring_length(r)).sum();
    2.0 * polygon.area_mm2() * UNITS_PER_MM * UNITS_PER_MM <= DUST * length
}

#[cfg(test)]
mod tests {
    use super::super::links::links;
    use super::super::overhang_image;
    use super::super::testing::{layer, region, ring};
    use super::*;
    use crate::layers::polygon::{Inside, resolve};
    use crate::layers::shape::{Point, Ring};
    use proptest::prelude::*;

    fn rules(angle_deg: f64, bridge_mm: f64) -> SelfSupport {
        SelfSupport { angle_deg, bridge_mm, min_area_mm2: 0.0 }
    }

    /// Pieces of the upper of two layers of 0.1 mm.
    fn found(below: &Region, above: &Region, rules: &SelfSupport, growth: Growth) -> Vec<Piece> {
        let (below, layer) = (layer(0, below.clone()), layer(1, above.clone()));
        pieces(&below, &layer, &links(&below, &layer), rules, growth)
    }

    fn area(pieces: &[Piece]) -> f64 {
        pieces.iter().map(|p| p.polygon.area_mm2()).sum()
    }

    /// Overhanging area with both kinds of growth.
    fn check(below: &Region, above: &Region, rules: SelfSupport, conditional: f64, naive: f64) {
        for (growth, expect) in [(Growth::Conditional, conditional), (Growth::Naive, naive)] {
            let got = area(&found(below, above, &rules, growth));
            assert!((got - expect).abs() < 0.003 + 0.002 * expect, "{growth:?}: {got} for {expect}");
        }
    }

    const POST: [f64; 4] = [0.0, 0.0, 2.0, 2.0];

    #[test]
    fn a_ledge_overhangs_beyond_the_reach() {
        let (below, ledge) = (region(&[POST], &[]), region(&[[0.0, 0.0, 5.0, 2.0]], &[]));
        check(&below, &ledge, rules(45.0, 0.0), 5.8, 5.8);
        check(&below, &ledge, rules(0.0, 0.0), 6.0, 6.0);
        check(&below, &ledge, rules(90.0, 0.0), 0.0, 0.0);
        // Around both corners of the post: quarter discs.
        let wide = region(&[[0.0, -2.0, 5.0, 4.0]], &[]);
        let reach = 0.1005;
        let held = reach * (2.0 + 2.0 + 2.0) + 2.0 * std::f64::consts::FRAC_PI_4 * reach * reach;
        check(&below, &wide, rules(45.0, 0.0), 30.0 - 4.0 - held, 30.0 - 4.0 - held);
    }

    #[test]
    fn a_wall_that_leans_is_reported_beyond_the_angle_alone() {
        let leaning = |angle: f64| {
            let out = 0.1 * f64::to_radians(angle).tan();
            // Along two opposite sides: at a corner of two the edge leans more than both.
            found(
                &region(&[[0.0, 0.0, 5.0, 5.0]], &[]),
                &region(&[[-out, 0.0, 5.0 + out, 5.0]], &[]),
                &rules(45.0, 0.0),
                Growth::Conditional,
            )
        };
        assert_eq!(leaning(44.0), []);
        assert_eq!(leaning(45.0), []);
        let found = leaning(46.0);
        assert!(found.len() == 2 && !found[0].island);
        let out = 0.1 * f64::to_radians(46.0).tan() - 0.1 - SLACK_MM;
        assert!((area(&found) / (10.0 * out) - 1.0).abs() < 0.1, "{}", area(&found));
    }

    /// Paper 001, Fig. 2 and Fig. 11, case 1: a stair beside a wall, a small gap between.
    #[test]
    fn growth_does_not_jump_a_gap() {
        let wall = [0.0, 0.0, 1.0, 5.0];
        let below = region(&[wall, [2.5, 0.0, 4.0, 5.0]], &[]);
        let above = region(&[wall, [1.05, 0.0, 4.0, 5.0]], &[]);
        // Reach 0.6: the stair holds itself from 1.9 on; the wall seems to up to 1.6.
        let rules = rules(f64::atan(5.995).to_degrees(), 0.0);
        check(&below, &above, rules, 5.0 * (1.9 - 1.05), 5.0 * (1.9 - 1.6));
    }

    /// The same where the gap is a slot in one and the same polygon.
    #[test]
    fn growth_does_not_jump_a_slot() {
        let below = region(&[[0.0, 0.0, 1.0, 5.0]], &[]);
        // A prong along the wall, a slot of 0.05, and a second prong, joined far away.
        let above = region(&[[0.0, 0.0, 4.0, 6.0]], &[[1.2, -1.0, 1.25, 5.0]]);
        let rules = rules(f64::atan(4.995).to_degrees(), 0.0);
        let all = 24.0 - 5.0 - 0.25;
        // Held, by a reach of 0.5: the first prong, and around the top of the wall the
        // strip above it. Beside the slot's end what is near over the slot and hangs together
        // around its end counts as held too: 0.25 mm of the second prong, from where the
        // end is within reach of the wall on, and a part of a disc below it.
        // The naive growth takes that along the whole slot.
        let slice = 0.5 * 0.5 * std::f64::consts::FRAC_PI_4;
        let conditional = 0.2 * 5.0 + 0.5 * 1.0 + slice;
        let naive = 0.45 * 5.0 + 0.5 * 1.0 + slice;
        let got = area(&found(&below, &above, &rules, Growth::Conditional));
        let around_the_end = 0.25 * 0.458 + 0.077;
        let expect = all - conditional - around_the_end;
        assert!((got - expect).abs() < 0.02, "{got} {expect}");
        let got = area(&found(&below, &above, &rules, Growth::Naive));
        assert!((got - (all - naive)).abs() < 0.01, "{got} {}", all - naive);
    }

    /// Paper 001, Fig. 11, case 2: a hole that closes. What lies farther than the reach
    /// from its rim overhangs; a hole narrower than twice the reach holds itself, with
    /// this rule as with the peers'.
    #[test]
    fn a_hole_that_closes_overhangs_in_its_middle() {
        let below = |side: f64| region(&[[0.0, 0.0, 9.0, 9.0]], &[[2.0, 2.0, 2.0 + side, 2.0 + side]]);
        let above = region(&[[0.0, 0.0, 9.0, 9.0]], &[]);
        let left = (3.0 - 2.0 * 0.1005_f64).powi(2);
        check(&below(3.0), &above, rules(45.0, 0.0), left, left);
        check(&below(0.2), &above, rules(45.0, 0.0), 0.0, 0.0);
    }

    #[test]
    fn islands_overhang_whole_and_say_so() {
        let (below, above) = (region(&[POST], &[]), region(&[POST, [3.0, 0.0, 4.0, 1.0]], &[]));
        for growth in [Growth::Conditional, Growth::Naive] {
            let found = found(&below, &above, &rules(45.0, 10.0), growth);
            assert!(found.len() == 1 && found[0].island && (area(&found) - 1.0).abs() < 1e-9);
        }
        let first = layer(0, above);
        let none = Layer::default();
        assert_eq!(pieces(&none, &first, &links(&none, &first), &rules(45.0, 0.0), Growth::Conditional), []);
    }

    #[test]
    fn a_bridge_between_two_ends_holds_itself() {
        let posts = region(&[POST, [6.0, 0.0, 8.0, 2.0]], &[]);
        let beam = region(&[[0.0, 0.0, 8.0, 2.0]], &[]);
        let left = |span: f64, below: &Region, above: &Region| {
            area(&found(below, above, &rules(45.0, span), Growth::Conditional))
        };
        assert!((left(0.0, &posts, &beam) - 2.0 * (4.0 - 0.201)).abs() < 1e-6);
        assert!(left(3.9, &posts, &beam) > 7.5, "too far");
        assert_eq!(left(4.1, &posts, &beam), 0.0);
        // One end is none.
        let ledge = region(&[[0.0, 0.0, 5.0, 2.0]], &[]);
        assert!((left(9.0, &region(&[POST], &[]), &ledge) - 5.8).abs() < 0.01);
        // A beam wider than its posts: strands beside them have no end to lie on.
        let wide = region(&[[0.0, -1.0, 8.0, 3.0]], &[]);
        let beside = left(4.1, &posts, &wide);
        assert!(beside > 2.0 * 8.0 * 0.85 && beside < 2.0 * 8.0, "{beside}");
        // Over a hole either way will do; aslant too.
        let hole = region(&[[0.0, 0.0, 9.0, 9.0]], &[[2.0, 2.0, 7.0, 4.0]]);
        let floor = region(&[[0.0, 0.0, 9.0, 9.0]], &[]);
        assert_eq!(left(2.1, &hole, &floor), 0.0);
        assert!(left(1.9, &hole, &floor) > 5.0);
        let aslant = |r: &Region| -> Region {
            let turn = |p: &Point| Point { x: (p.x * 4 - p.y * 3) / 5, y: (p.x * 3 + p.y * 4) / 5 };
            let rings = |p: &Polygon| Polygon {
                rings: p.rings.iter().map(|r| r.iter().map(turn).collect()).collect(),
            };
            r.polygons.iter().map(rings).collect()
        };
        assert_eq!(left(4.1, &aslant(&posts), &aslant(&beam)), 0.0);
    }

    fn shape() -> impl Strategy<Value = Region> {
        let point =
            (0..40, 0..40).prop_map(|(x, y)| Point::from_mm(f64::from(x) * 0.25, f64::from(y) * 0.25));
        let rings = prop::collection::vec(prop::collection::vec(point, 3..6), 1..4);
        rings.prop_map(|r| resolve(&r, Inside::Odd))
    }

    fn border(r: &Region) -> f64 {
        r.rings().map(|r| ring_length(r)).sum::<f64>() / UNITS_PER_MM
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// With no reach, what overhangs is what does not lie on the layer below.
        #[test]
        fn no_reach_is_the_difference(below in shape(), above in shape()) {
            let plain = difference(&above, &below).area_mm2();
            let got = area(&found(&below, &above, &rules(0.0, 0.0), Growth::Conditional));
            let rim = border(&above) + border(&below);
            prop_assert!(got <= plain + 1e-4 * rim && got >= plain - 3.0 * SLACK_MM * rim, "{got} {plain}");
        }

        /// A steeper angle never leaves more, and what jumps gaps never leaves more.
        #[test]
        fn more_is_held_the_steeper(below in shape(), above in shape(), angle in 10.0..80.0_f64) {
            let at = |angle: f64, growth| area(&found(&below, &above, &rules(angle, 0.0), growth));
            let rounding = 2e-3 * (border(&above) + border(&below)) + 1e-3;
            let here = at(angle, Growth::Conditional);
            prop_assert!(at(angle + 5.0, Growth::Conditional) <= here + rounding);
            prop_assert!(at(angle, Growth::Naive) <= here + rounding);
            let bridged = found(&below, &above, &rules(angle, 2.0), Growth::Conditional);
            prop_assert!(area(&bridged) <= here + rounding);
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(12))]

        /// Images of the same layers say the same, up to what pixels tell.
        #[test]
        fn images_agree(below in shape(), above in shape(), angle in 20.0..80.0_f64) {
            let (lower, upper) = (layer(0, below.clone()), layer(1, above.clone()));
            let links = links(&lower, &upper);
            let rules = rules(angle, 0.0);
            let reach = reach_mm(&lower, &upper, angle);
            // Pixels that the reach hardly spans tell little of it.
            let pixel = f64::min(0.04, reach / 4.0);
            let rim = border(&above) + border(&below);
            for growth in [Growth::Conditional, Growth::Naive] {
                let polygons = area(&pieces(&lower, &upper, &links, &rules, growth));
                let image = |pixel| area(&overhang_image::pieces(&lower, &upper, &links, reach, growth, pixel));
                // A neck narrower than a pixel is none to the image: finer ones see it.
                let mut finer = [1.0, 2.0, 4.0, 8.0].iter().map(|k| image(pixel / k));
                let near = finer.any(|image| (polygons - image).abs() < 0.004 * rim + 0.01);
                prop_assert!(near, "{growth:?} {polygons} {}", image(pixel / 8.0));
            }
        }
    }

    /// A wall at less than 45° whose corners lie askew: a triangle of the strip reaches
    /// beyond the long held edge at its tip, where the next edge holds it.
    #[test]
    fn what_a_long_edge_ends_the_next_one_holds() {
        let walled = |wall: &[(f64, f64)]| {
            let ring = [&[(-45.0, 34.0), (-45.0, 29.0)], wall].concat();
            let ring: Ring = ring.into_iter().map(|(x, y)| Point::from_mm(x, y)).collect();
            resolve(&[ring], Inside::NonZero)
        };
        let below =
            [(-40.8, 29.0), (-40.9273, 30.9684), (-40.9785, 31.8105), (-40.9775, 32.4346), (-40.95, 34.0)];
        let above = [(-40.72, 29.0), (-40.8285, 30.7755), (-40.8935, 31.8459), (-40.9, 33.0), (-40.88, 34.0)];
        let (below, above) = (walled(&below), walled(&above));
        assert!(difference(&above, &below).area_mm2() > 0.3);
        assert_eq!(found(&below, &above, &rules(45.0, 0.0), Growth::Conditional), []);
    }

    #[test]
    fn a_ring_of_overhang_is_zipped_whole() {
        // A strip all around within reach needs no boolean; beyond it is left whole.
        let below = region(&[[1.0, 1.0, 5.0, 5.0]], &[]);
        let above = |by: f64| region(&[[1.0 - by, 1.0 - by, 5.0 + by, 5.0 + by]], &[]);
        check(&below, &above(0.07), rules(45.0, 0.0), 0.0, 0.0);
        let rim = ring(0.0, 0.0, 1.0, 1.0);
        assert_eq!(ring_length(&rim) as i64, 40_000);
        let out: f64 = 0.5;
        let reach = 0.1005;
        let held = 16.0 * reach + std::f64::consts::PI * reach * reach;
        let left = 4.0 * 4.0 * out + 4.0 * out * out - held;
        check(&below, &above(out), rules(45.0, 0.0), left, left);
    }
}
