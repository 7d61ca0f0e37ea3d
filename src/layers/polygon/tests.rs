//! Booleans against a board of cells, overlaps against lines that part triangles.
use super::*;
use crate::layers::shape::twice_area;
use proptest::prelude::*;

fn square(x: f64, y: f64, side: f64) -> Region {
    let corner = |dx: f64, dy: f64| Point::from_mm(x + dx, y + dy);
    let ring = vec![corner(0.0, 0.0), corner(side, 0.0), corner(side, side), corner(0.0, side)];
    Region { polygons: vec![Polygon { rings: vec![ring] }] }
}

#[test]
fn booleans_have_the_areas_they_should() {
    let (a, b) = (square(0.0, 0.0, 2.0), square(1.0, 1.0, 2.0));
    let check = |found: Region, area: f64, polygons: usize| {
        assert!((found.area_mm2() - area).abs() < 1e-6, "{found:?}");
        assert_eq!(found.polygons.len(), polygons);
    };
    check(union(&a, &b), 7.0, 1);
    check(intersection(&a, &b), 1.0, 1);
    check(difference(&a, &b), 3.0, 1);
    check(union(&a, &square(2.0, 2.0, 1.0)), 5.0, 2);
    check(resolve(a.rings().chain(b.rings()), Inside::NonZero), 7.0, 1);
    check(resolve(a.rings().chain(b.rings()), Inside::Odd), 6.0, 2);
}

#[test]
fn touching_is_not_overlapping() {
    let a = square(0.0, 0.0, 2.0);
    let check = |b: Region, expect: bool| {
        assert_eq!(overlaps(&a.polygons[0], &b.polygons[0]), expect, "{b:?}");
    };
    check(square(2.0, 0.0, 1.0), false);
    check(square(2.0, 2.0, 1.0), false);
    check(square(1.9999, 1.9999, 1.0), true);
    check(square(0.5, 0.5, 1.0), true);
    check(square(-1.0, -1.0, 9.0), true);
    check(a.clone(), true);
}

#[test]
fn offsets_are_discs_and_strips() {
    let area = |r: &Region| r.area_mm2();
    let pi = std::f64::consts::PI;
    assert!((area(&grow(&square(0.0, 0.0, 2.0), 1.0)) - (4.0 + 8.0 + pi)).abs() < 0.02);
    assert!((area(&grow(&square(0.0, 0.0, 2.0), -0.5)) - 1.0).abs() < 1e-6);
    let path = vec![Point::from_mm(0.0, 0.0), Point::from_mm(3.0, 0.0)];
    assert!((area(&stroke(&[path], 0.5)) - (3.0 + pi / 4.0)).abs() < 0.02);
}

const SIDE: usize = 10;

type Boxes = [([i32; 2], [i32; 2], bool)];

/// How often boxes wind around each cell of a board.
fn board(boxes: &Boxes) -> [i32; SIDE * SIDE] {
    let mut cells = [0; SIDE * SIDE];
    for (min, max, turned) in boxes {
        for y in min[1]..max[1] {
            for x in min[0]..max[0] {
                cells[y as usize * SIDE + x as usize] += if *turned { -1 } else { 1 };
            }
        }
    }
    cells
}

/// The number of cells, and of pieces of them that hang together by their sides.
fn pieces(cells: &[bool; SIDE * SIDE]) -> (usize, usize) {
    let mut full = *cells;
    let (count, mut pieces) = (full.iter().filter(|&&f| f).count(), 0);
    while let Some(start) = full.iter().position(|&f| f) {
        pieces += 1;
        let mut stack = vec![start];
        while let Some(at) = stack.pop() {
            if std::mem::take(&mut full[at]) {
                let (x, y) = (at % SIDE, at / SIDE);
                stack.extend((x > 0).then(|| at - 1));
                stack.extend((x + 1 < SIDE).then_some(at + 1));
                stack.extend((y > 0).then(|| at - SIDE));
                stack.extend((y + 1 < SIDE).then_some(at + SIDE));
            }
        }
    }
    (count, pieces)
}

fn boxes() -> impl Strategy<Value = Vec<([i32; 2], [i32; 2], bool)>> {
    let one = (0..9_i32, 0..9_i32, 1..6_i32, 1..6_i32, any::<bool>())
        .prop_map(|(x, y, w, h, turned)| ([x, y], [(x + w).min(10), (y + h).min(10)], turned));
    prop::collection::vec(one, 1..14)
}

fn rings_of(boxes: &Boxes) -> Vec<Ring> {
    let ring = |(min, max, turned): &([i32; 2], [i32; 2], bool)| {
        let mut ring: Ring = [(min[0], min[1]), (max[0], min[1]), (max[0], max[1]), (min[0], max[1])]
            .map(|(x, y)| Point { x: 100 * x, y: 100 * y })
            .to_vec();
        if *turned {
            ring.reverse();
        }
        ring
    };
    boxes.iter().map(ring).collect()
}

/// Area and pieces are as they must be, rings simple and turned the right way.
fn is_sound(region: &Region, (cells, count): (usize, usize)) -> Result<(), TestCaseError> {
    prop_assert_eq!(region.rings().map(|r| twice_area(r)).sum::<i128>(), 20_000 * cells as i128);
    prop_assert_eq!(region.polygons.len(), count, "{:?}", region);
    for polygon in &region.polygons {
        for (k, ring) in polygon.rings.iter().enumerate() {
            prop_assert!((twice_area(ring) > 0) == (k == 0));
            let mut corners = ring.clone();
            corners.sort_unstable();
            corners.dedup();
            prop_assert_eq!(corners.len(), ring.len(), "a ring that meets itself: {:?}", ring);
        }
    }
    Ok(())
}

fn triangle() -> impl Strategy<Value = Ring> {
    let point = || (0..9_i32, 0..9_i32).prop_map(|(x, y)| Point { x: 700 * x, y: 700 * y });
    prop::collection::vec(point(), 3).prop_filter_map("flat", |mut ring| match twice_area(&ring) {
        0 => None,
        1.. => Some(ring),
        _ => {
            ring.reverse();
            Some(ring)
        }
    })
}

/// Whether no line along a side parts two counter-clockwise triangles: exact, by signs of areas.
fn triangles_overlap(a: &Ring, b: &Ring) -> bool {
    let parts =
        |a: &Ring, b: &Ring| (0..3).any(|k| b.iter().all(|&p| twice_area(&[a[k], a[(k + 1) % 3], p]) <= 0));
    !parts(a, b) && !parts(b, a)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn regions_are_what_they_say(boxes in boxes()) {
        let rings = rings_of(&boxes);
        for (inside, rule) in [
            (Inside::Positive, (|w| w > 0) as fn(i32) -> bool),
            (Inside::NonZero, |w| w != 0),
            (Inside::Odd, |w| w & 1 == 1),
        ] {
            is_sound(&resolve(&rings, inside), pieces(&board(&boxes).map(rule)))?;
        }
    }

    #[test]
    fn booleans_agree_with_cells(a in boxes(), b in boxes(), c in boxes()) {
        // What is in `c` is in both, so that whole polygons are the same now and then.
        let filled = |boxes: &Boxes| board(boxes).map(|w| w != 0);
        let region = |boxes: &Boxes| resolve(&rings_of(boxes), Inside::NonZero);
        let (a, b) = ([&a[..], &c].concat(), [&b[..a.len() % b.len()], &c].concat());
        let (cells_a, cells_b) = (filled(&a), filled(&b));
        let both = |f: fn(bool, bool) -> bool| pieces(&std::array::from_fn(|k| f(cells_a[k], cells_b[k])));
        let (a, b) = (region(&a), region(&b));
        is_sound(&union(&a, &b), both(|a, b| a || b))?;
        is_sound(&union_all([&a, &b, &a]), both(|a, b| a || b))?;
        is_sound(&intersection(&a, &b), both(|a, b| a && b))?;
        is_sound(&difference(&a, &b), both(|a, b| a && !b))?;
        is_sound(&without(a.rings(), b.rings()), both(|a, b| a && !b))?;
        is_sound(&within(a.rings(), b.rings()), both(|a, b| a && b))?;
        for polygon in &a.polygons {
            let only = Region { polygons: vec![polygon.clone()] };
            let expect = !intersection(&only, &b).is_empty();
            prop_assert_eq!(overlaps_any(polygon, &b.polygons), expect);
        }
    }

    #[test]
    fn overlapping_is_exact(a in triangle(), b in triangle()) {
        let expect = triangles_overlap(&a, &b);
        let [a, b] = [a, b].map(|ring| Polygon { rings: vec![ring] });
        prop_assert_eq!(overlaps(&a, &b), expect);
    }
}

/// How far a point lies from a region's border, grid steps; negative inside.
fn depth(region: &Region, [x, y]: [f64; 2]) -> f64 {
    let (mut within, mut nearest) = (false, f64::INFINITY);
    for ring in region.rings() {
        for k in 0..ring.len() {
            let at = |k: usize| [ring[k % ring.len()].x, ring[k % ring.len()].y].map(f64::from);
            let ([ax, ay], [bx, by]) = (at(k), at(k + 1));
            within ^= (ay > y) != (by > y) && ax + (y - ay) / (by - ay) * (bx - ax) > x;
            let (dx, dy) = (bx - ax, by - ay);
            let along = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
            nearest = nearest.min((ax + along * dx - x).hypot(ay + along * dy - y));
        }
    }
    if within { -nearest } else { nearest }
}

/// Regions with holes, pieces, narrow necks and sharp tips, about 1 mm wide.
fn regions() -> impl Strategy<Value = Region> {
    let point = || (0..100_i32, 0..100_i32).prop_map(|(x, y)| Point { x: 100 * x, y: 100 * y });
    let rings = || prop::collection::vec(prop::collection::vec(point(), 3..9), 1..4);
    (rings(), rings()).prop_map(|(solid, cut)| {
        let of = |rings: &[Ring]| resolve(rings, Inside::NonZero);
        difference(&of(&solid), &of(&cut))
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 120, ..ProptestConfig::default() })]

    #[test]
    fn grown_is_what_lies_within_the_distance(
        region in regions(),
        steps in prop_oneof![-3000..3000_i32, -60..60_i32],
        points in prop::collection::vec((-3000..13000_i32, -3000..13000_i32), 100),
    ) {
        let distance = f64::from(steps);
        let grown = grow(&region, distance / UNITS_PER_MM);
        for (x, y) in points {
            let at = [f64::from(x) + 0.3, f64::from(y) + 0.7];
            let beyond = depth(&region, at) - distance;
            // The tolerance of arcs, and rounding where edges run together.
            if beyond.abs() > 24.0 {
                prop_assert_eq!(depth(&grown, at) < 0.0, beyond < 0.0, "{:?} {}", at, beyond);
            }
        }
    }
}

#[test]
fn growing_knows_its_limits() {
    let square: Ring = [(0, 0), (9000, 0), (9000, 9000), (0, 9000)].map(|(x, y)| Point { x, y }).to_vec();
    let region = resolve([&square], Inside::Positive);
    let check = |mm: f64, area_mm2: std::ops::RangeInclusive<f64>| {
        let found = grow(&region, mm).area_mm2();
        assert!(area_mm2.contains(&found), "{mm}: {found}");
    };
    check(0.0, 0.81..=0.81);
    check(f64::NAN, 0.81..=0.81);
    check(-0.4, 0.009_999..=0.010_001);
    check(-0.45, 0.0..=0.0);
    check(-1e300, 0.0..=0.0);
    // 4 × 0.9 × 0.1 and a disc of 0.1 mm more.
    check(0.1, 1.20..=1.201_5);
    // No farther than the grid: all of it, about 107 m wide.
    check(1e300, 1.1e10..=1.2e10);
    assert!(grow(&Region::default(), 1.0).is_empty());
}
