//! The sweep against every edge with every other, and against the boolean.
use super::*;
use crate::layers::polygon::{self, Inside};
use crate::layers::shape::twice_area;
use proptest::prelude::*;

fn ring(points: &[[i32; 2]]) -> Ring {
    points.iter().map(|&[x, y]| Point { x, y }).collect()
}

/// A square, counter-clockwise for a positive side, clockwise for a negative one.
fn square(x: i32, y: i32, side: i32) -> Ring {
    let (s, w) = (side.abs(), side < 0);
    let mut ring = ring(&[[x, y], [x + s, y], [x + s, y + s], [x, y + s]]);
    if w {
        ring[1..].reverse();
    }
    ring
}

#[test]
fn rings_nest_by_winding() {
    // Twice the area of each ring of each polygon.
    let check = |rings: &[Ring], expect: Option<&[&[i128]]>| {
        let found = Nester::default().nest(rings);
        let areas: Option<Vec<Vec<i128>>> = found
            .map(|r| r.polygons.iter().map(|p| p.rings.iter().map(|r| twice_area(r)).collect()).collect());
        let expect = expect.map(|e| e.iter().map(|p| p.to_vec()).collect());
        assert_eq!(areas, expect, "{rings:?}");
    };
    check(&[], Some(&[]));
    check(&[ring(&[[0, 0], [1, 1]])], Some(&[]));
    check(&[square(0, 0, 10)], Some(&[&[200]]));
    // A hole, whichever is given first; a body in a body; a body in a hole.
    check(&[square(0, 0, 10), square(1, 1, -5)], Some(&[&[200, -50]]));
    check(&[square(1, 1, -5), square(0, 0, 10)], Some(&[&[200, -50]]));
    check(&[square(1, 1, 5), square(0, 0, 10)], Some(&[&[200]]));
    check(&[square(0, 0, 10), square(1, 1, -8), square(2, 2, 5)], Some(&[&[200, -128], &[50]]));
    // What turns the wrong way is nothing outside, and undone by what is around it.
    check(&[square(0, 0, -10)], Some(&[]));
    check(&[square(0, 0, -10), square(1, 1, 5)], Some(&[]));
    check(&[square(0, 0, -10), square(1, 1, 8), square(2, 2, 5)], Some(&[&[50]]));
    // A cavity in a body in a body is filled; two cavities in each other are one.
    check(&[square(0, 0, 10), square(1, 1, 8), square(2, 2, -2)], Some(&[&[200]]));
    check(&[square(0, 0, 10), square(1, 1, -8), square(2, 2, -5)], Some(&[&[200, -128]]));
    check(&[square(0, 0, 10), square(1, 1, 8), square(2, 2, -5), square(3, 3, -2)], Some(&[&[200, -8]]));
    // Side by side; a hole finds its own.
    check(
        &[square(20, 0, 10), square(0, 0, 10), square(21, 1, -1), square(1, 5, -2)],
        Some(&[&[200, -8], &[200, -2]]),
    );
    // Touching at a corner, along a side, corner on side; crossing; twice the same; a spike.
    check(&[square(0, 0, 10), square(10, 10, 5)], None);
    check(&[square(0, 0, 10), square(10, 2, 5)], None);
    check(&[square(0, 0, 10), ring(&[[10, 5], [12, 3], [12, 8]])], None);
    check(&[square(0, 0, 10), square(5, 5, 10)], None);
    check(&[square(0, 0, 10), square(0, 0, 10)], None);
    check(&[ring(&[[0, 0], [10, 0], [20, 0], [10, 0], [0, 10]])], None);
    check(&[ring(&[[0, 0], [10, 10], [10, 0], [0, 10]])], None);
}

/// Whether two closed segments share a point, by signs of areas.
fn meet([a, b]: [Point; 2], [c, d]: [Point; 2]) -> bool {
    let within = |a: Point, b: Point, p: Point| {
        side(a, b, p) == 0
            && (a.x.min(b.x)..=a.x.max(b.x)).contains(&p.x)
            && (a.y.min(b.y)..=a.y.max(b.y)).contains(&p.y)
    };
    side(a, b, c).signum() * side(a, b, d).signum() < 0 && side(c, d, a).signum() * side(c, d, b).signum() < 0
        || within(a, b, c)
        || within(a, b, d)
        || within(c, d, a)
        || within(c, d, b)
}

/// Whether the way from `b` to `c` lies on the way from `a` to `b`, or is none.
fn turns_back(a: Point, b: Point, c: Point) -> bool {
    side(a, b, c) == 0 && (b.x - a.x) * (c.x - b.x) + (b.y - a.y) * (c.y - b.y) <= 0
}

/// Every edge against every other: the slow way to know what the sweep claims.
fn any_meet(rings: &[Ring]) -> bool {
    let mut edges = Vec::new();
    for ring in rings.iter().filter(|r| r.len() > 2) {
        let from = edges.len();
        for k in 0..ring.len() {
            edges.push(([ring[k], ring[(k + 1) % ring.len()]], from, k, ring.len()));
        }
    }
    let pair = |i: usize, j: usize| {
        let ((e, from, k, n), (f, other, l, _)) = (edges[i], edges[j]);
        let (next, previous) = (from == other && l == (k + 1) % n, from == other && k == (l + 1) % n);
        match (next, previous) {
            (true, _) => turns_back(e[0], e[1], f[1]),
            (_, true) => turns_back(f[0], f[1], e[1]),
            _ => meet(e, f),
        }
    };
    (0..edges.len()).any(|i| (0..i).any(|j| pair(i, j)))
}

fn same_region(a: &Region, b: &Region) -> bool {
    polygon::difference(a, b).is_empty() && polygon::difference(b, a).is_empty()
}

fn check(rings: &[Ring]) -> Result<bool, TestCaseError> {
    let found = Nester::default().nest(rings);
    prop_assert_eq!(found.is_none(), any_meet(rings));
    let Some(found) = found else { return Ok(false) };
    prop_assert!(same_region(&found, &polygon::resolve(rings, Inside::Positive)));
    for polygon in &found.polygons {
        prop_assert!(twice_area(&polygon.rings[0]) > 0);
        prop_assert!(polygon.rings[1..].iter().all(|r| twice_area(r) < 0));
    }
    // The order in which rings come, and where each begins, changes nothing.
    let mut turned = rings.to_vec();
    turned.reverse();
    turned.iter_mut().filter(|r| !r.is_empty()).for_each(|r| r.rotate_left(1));
    prop_assert_eq!(Nester::default().nest(&turned), Some(found));
    Ok(true)
}

/// Rings on a coarse grid, so that touching and vertical edges are the rule.
fn coarse() -> impl Strategy<Value = Vec<Ring>> {
    let point = (0..12_i32, 0..12_i32).prop_map(|(x, y)| Point { x, y });
    prop::collection::vec(prop::collection::vec(point, 2..5), 1..4)
}

/// Stars and boxes, turning either way: many of these do not meet.
fn stars() -> impl Strategy<Value = Vec<Ring>> {
    let star = (0..600_i32, 0..600_i32, 5..300_i32, 3..12_u32, any::<bool>()).prop_map(
        |(x, y, size, corners, turned)| {
            let at = |k: u32| {
                let angle = std::f64::consts::TAU * f64::from(k) / f64::from(corners);
                let radius = f64::from(size) * if k.is_multiple_of(2) { 1.0 } else { 0.6 };
                let point = |a: f64| (radius * a).round() as i32;
                Point { x: x + point(angle.cos()), y: y + point(angle.sin()) }
            };
            let mut ring: Ring = (0..corners).map(at).collect();
            if turned {
                ring.reverse();
            }
            ring
        },
    );
    prop::collection::vec(star, 1..9)
}

/// Small boxes and triangles far enough apart that many only just touch.
fn boxes() -> impl Strategy<Value = Vec<Ring>> {
    let one = (0..16_i32, 0..16_i32, 1..5_i32, 1..5_i32, 0..4_u8).prop_map(|(x, y, w, h, kind)| {
        let mut ring = ring(&[[x, y], [x + w, y], [x + w, y + h], [x, y + h]]);
        if kind & 1 == 1 {
            ring.reverse();
        }
        ring.truncate(if kind & 2 == 2 { 3 } else { 4 });
        ring
    });
    prop::collection::vec(one, 1..5)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, ..ProptestConfig::default() })]

    #[test]
    fn the_sweep_agrees_with_every_edge_against_every_other(rings in coarse()) {
        check(&rings)?;
    }

    #[test]
    fn touching_is_seen(rings in boxes()) {
        check(&rings)?;
    }

    #[test]
    fn nesting_agrees_with_the_boolean(rings in stars()) {
        check(&rings)?;
    }
}

#[test]
fn the_largest_coordinates_are_compared_exactly() {
    let m = crate::layers::shape::MAX_COORDINATE;
    let big = ring(&[[-m, -m], [m, -m], [m, m], [-m, m]]);
    // A sliver along the diagonal, one step off it.
    let sliver = ring(&[[1 - m, -m + 2], [m - 2, m - 1], [-m + 1, 3 - m]]);
    let found = Nester::default().nest(&[big.clone(), sliver.iter().rev().copied().collect()]).unwrap();
    assert_eq!(found.polygons[0].rings.len(), 2);
    let on_it = ring(&[[-m, -m + 5], [m, m], [-m + 1, 9 - m]]);
    assert_eq!(Nester::default().nest(&[big, on_it]), None);
}
