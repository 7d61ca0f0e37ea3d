//! A polygon made smaller: convex ones, as nearly all branches are, without a polygon library.
use crate::layers::polygon::grow;
use crate::layers::shape::{Point as Grid, Polygon, Region, UNITS_PER_MM, ring_edges, twice_area};

/// Convex polygons of more corners are left to the library.
const MAX_CORNERS: usize = 256;

/// What is farther than a distance from the outside, mm.
pub(super) fn inset(polygon: &Polygon, distance_mm: f64) -> Region {
    match convex(polygon) {
        Some(ring) if distance_mm > 0.0 => {
            let distance = distance_mm * UNITS_PER_MM;
            moved(ring, distance).or_else(|| smaller(ring, distance)).into_iter().collect()
        }
        _ => grow(&Region { polygons: vec![polygon.clone()] }, -distance_mm),
    }
}

/// The only ring of a convex polygon.
fn convex(polygon: &Polygon) -> Option<&[Grid]> {
    let [ring] = polygon.rings.as_slice() else { return None };
    if !(3..=MAX_CORNERS).contains(&ring.len()) {
        return None;
    }
    let step = |a: Grid, b: Grid| [i64::from(b.x) - i64::from(a.x), i64::from(b.y) - i64::from(a.y)];
    let ways = ring_edges(ring).map(|[a, b]| step(a, b));
    let next = ways.clone().cycle().skip(1);
    let left = ways.clone().zip(next).all(|(u, v)| u[0] * v[1] - u[1] * v[0] >= 0);
    // Turning left all along, and once only: X turns around twice.
    let sides: Vec<bool> = ways.filter(|w| w[0] != 0).map(|w| w[0] > 0).collect();
    let turns = sides.iter().zip(sides.iter().cycle().skip(1)).filter(|(a, b)| a != b).count();
    (left && turns == 2).then_some(ring)
}

/// Moves each corner inwards; `None` where an edge would vanish, or corners are flat.
fn moved(ring: &[Grid], distance: f64) -> Option<Polygon> {
    let ways: Vec<[f64; 3]> = ring_edges(ring)
        .map(|[a, b]| {
            let (dx, dy) = (f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y));
            let length = (dx * dx + dy * dy).sqrt();
            [dx / length, dy / length, length]
        })
        .collect();
    let before = |k: usize| ways[(k + ways.len() - 1) % ways.len()];
    // The tangent of half a corner's turn: so much shorter an edge gets at that end.
    let turn = |k: usize| {
        let (u, v) = (before(k), ways[k]);
        let (sine, cosine) = (u[0] * v[1] - u[1] * v[0], u[0] * v[0] + u[1] * v[1]);
        sine / (1.0 + cosine)
    };
    let turns: Vec<f64> = (0..ways.len()).map(turn).collect();
    let mut corners = Vec::with_capacity(ring.len());
    for (k, p) in ring.iter().enumerate() {
        let (u, tangent) = (before(k), turns[k]);
        let left = before(k)[2] - distance * (tangent + turns[(k + ring.len() - 1) % ring.len()]);
        if !tangent.is_finite() || left.is_nan() || left < 1.0 {
            return None;
        }
        // Left of the edge before by the distance, and back along it.
        let x = f64::from(p.x) - distance * (u[1] + u[0] * tangent);
        let y = f64::from(p.y) + distance * (u[0] - u[1] * tangent);
        corners.push(Grid { x: x.round() as i32, y: y.round() as i32 });
    }
    Some(Polygon { rings: vec![corners] })
}

/// Cuts a strip off along each edge.
fn smaller(ring: &[Grid], distance: f64) -> Option<Polygon> {
    let mut points: Vec<[f64; 2]> = ring.iter().map(|p| [f64::from(p.x), f64::from(p.y)]).collect();
    let mut cut = Vec::with_capacity(points.len() + 1);
    for [a, b] in ring_edges(ring) {
        let (dx, dy) = (f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y));
        let length = (dx * dx + dy * dy).sqrt();
        if length == 0.0 {
            continue;
        }
        // How far inside of the edge's line, less the distance.
        let depth =
            |p: [f64; 2]| (dx * (p[1] - f64::from(a.y)) - dy * (p[0] - f64::from(a.x))) / length - distance;
        cut.clear();
        for (k, &p) in points.iter().enumerate() {
            let q = points[(k + 1) % points.len()];
            let (from, to) = (depth(p), depth(q));
            if from >= 0.0 {
                cut.push(p);
            }
            if (from < 0.0) != (to < 0.0) {
                let t = from / (from - to);
                cut.push([p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])]);
            }
        }
        std::mem::swap(&mut points, &mut cut);
        if points.is_empty() {
            return None;
        }
    }
    let mut ring: Vec<Grid> =
        points.iter().map(|p| Grid { x: p[0].round() as i32, y: p[1].round() as i32 }).collect();
    ring.dedup();
    if ring.len() > 1 && ring.first() == ring.last() {
        ring.pop();
    }
    (ring.len() > 2 && twice_area(&ring) > 0).then_some(Polygon { rings: vec![ring] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::polygon::{difference, stroke, union_all};
    use proptest::prelude::*;

    #[test]
    fn convex_is_told_from_not() {
        let check = |ring: &[(i32, i32)], expect: bool| {
            let ring = ring.iter().map(|&(x, y)| Grid { x, y }).collect();
            assert_eq!(convex(&Polygon { rings: vec![ring] }).is_some(), expect);
        };
        check(&[(0, 0), (9, 0), (9, 9), (0, 9)], true);
        check(&[(0, 0), (5, 0), (9, 0), (0, 9)], true);
        check(&[(0, 0), (9, 0), (2, 2), (0, 9)], false);
        check(&[(0, 0), (0, 9), (9, 9), (9, 0)], false);
        // A five-pointed star turns left all along, twice around.
        check(&[(0, 10), (-6, -8), (10, 3), (-10, 3), (6, -8)], false);
        check(&[(0, 0), (9, 0)], false);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn as_the_library_does_it(
            ends in [(-3.0..3.0f64, -3.0..3.0f64), (-3.0..3.0f64, -3.0..3.0f64)],
            radius in 0.1..2.0f64,
            distance in 0.01..2.5f64,
        ) {
            let path = ends.map(|(x, y)| Grid::from_mm(x, y)).to_vec();
            let region = stroke(&[path], radius);
            prop_assume!(region.polygons.len() == 1 && convex(&region.polygons[0]).is_some());
            let ring = &region.polygons[0].rings[0];
            if let Some(quick) = moved(ring, distance * UNITS_PER_MM) {
                let slow = smaller(ring, distance * UNITS_PER_MM).unwrap();
                prop_assert!((quick.area_mm2() - slow.area_mm2()).abs() < 1e-3, "{} {}", quick.area_mm2(), slow.area_mm2());
            }
            let (own, library) = (inset(&region.polygons[0], distance), grow(&region, -distance));
            let apart = union_all([&difference(&own, &library), &difference(&library, &own)]);
            prop_assert!(apart.area_mm2() < 2e-3 , "{} mm²", apart.area_mm2());
        }
    }
}
