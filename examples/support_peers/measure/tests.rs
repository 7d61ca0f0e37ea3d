use super::*;
use outrigger::layers::polygon::{Inside, resolve};
use outrigger::support::demand::Need;

/// Rectangles `[x0, y0, x1, y1]` united, mm.
fn region(rectangles: &[[f64; 4]]) -> Region {
    let ring = |r: &[f64; 4]| {
        [(r[0], r[1]), (r[2], r[1]), (r[2], r[3]), (r[0], r[3])].map(|(x, y)| Point::from_mm(x, y)).to_vec()
    };
    resolve(&rectangles.iter().map(ring).collect::<Vec<_>>(), Inside::NonZero)
}

/// A roof of 10 × 2 mm from layer 5 on, over supports that end `free` layers below it.
fn roof(free: usize, supports: &[[f64; 4]]) -> [Vec<Region>; 2] {
    let part = (0..8).map(|k| if k < 5 { region(&[]) } else { region(&[[0.0, 0.0, 10.0, 2.0]]) });
    [part.collect(), vec![region(supports); 5 - free]]
}

fn printed<'a>([part, support]: &'a [Vec<Region>; 2], gap: usize) -> Printed<'a> {
    Printed { part, support, layer_mm: 0.2, gap, skip: 0 }
}

fn need(x: f64, area_mm2: f64, island: bool) -> Need {
    Need { at_mm: [x, 1.0, 1.0], area_mm2, region: 0, island, under: None }
}

#[test]
fn a_support_that_ends_beside_the_part_is_no_contact() {
    let layers = roof(0, &[[1.0, 0.5, 2.0, 1.5], [20.0, 0.0, 21.0, 1.0]]);
    let found = contacts(&printed(&layers, 0));
    assert_eq!(found.len(), 1);
    assert!((found[0].area_mm2 - 1.0).abs() < 1e-9 && (found[0].pieces[0].z_mm - 1.0).abs() < 1e-9);
}

#[test]
fn a_gap_counts_as_far_as_it_is_allowed() {
    for (free, gap, expect) in [(1, 0, 0), (1, 1, 1), (2, 1, 0), (2, 2, 1)] {
        let layers = roof(free, &[[1.0, 0.5, 2.0, 1.5]]);
        let found = contacts(&printed(&layers, gap));
        assert_eq!(found.len(), expect, "{free} {gap}");
        assert!(found.iter().all(|c| (c.pieces[0].z_mm - 1.0).abs() < 1e-9));
    }
}

#[test]
fn what_meets_a_slope_in_steps_is_one_contact() {
    // The part grows by 0.2 mm a layer over a block from 1 to 2 mm, and there is another block.
    let part: Vec<Region> =
        (0..10).map(|k| region(&[[0.0, 0.0, 0.9 + 0.2 * f64::from(k), 1.0], [5.0, 0.0, 5.1, 1.0]])).collect();
    let block = region(&[[1.0, 0.0, 2.0, 1.0]]);
    let support: Vec<Region> = part.iter().map(|p| difference(&block, p)).collect();
    let layers = [part, support];
    let found = contacts(&printed(&layers, 0));
    assert_eq!(found.len(), 1);
    assert!((found[0].area_mm2 - 0.9).abs() < 1e-6, "{}: from 1.1 mm on, 1.0 in layer 0", found[0].area_mm2);
}

#[test]
fn a_demand_is_measured() {
    let layers = roof(0, &[[0.0, 0.0, 1.0, 2.0], [9.0, 0.0, 10.0, 2.0], [4.9, 0.9, 5.1, 1.1]]);
    let needs =
        vec![need(0.5, 0.0, true), need(0.5, 1.0, false), need(3.0, 2.0, false), need(8.0, 7.0, false)];
    let demand = Demand { needs, regions: 1, area_mm2: 10.0, cell_mm: 1.0, cut_off: false };
    let found = figures(&demand, &printed(&layers, 0));
    assert_eq!((found.islands, found.contacts, found.idle), ([1, 1], 3, 0));
    assert!((found.far_mm[0] - 1.0).abs() < 1e-9 && (found.far_mm[1] - 1.9).abs() < 1e-9, "{found:?}");
    assert!((found.area_mm2 - 7.0).abs() < 1e-9 && (found.load - 50.0).abs() < 1e-6, "{found:?}");
}

#[test]
fn no_contact_holds_nothing() {
    let layers = roof(0, &[]);
    let demand = Demand { needs: vec![need(0.5, 1.0, true)], ..Demand::default() };
    let found = figures(&demand, &printed(&layers, 0));
    assert_eq!((found.islands, found.contacts), ([0, 1], 0));
    assert!(found.far_mm[1].is_infinite());
}
