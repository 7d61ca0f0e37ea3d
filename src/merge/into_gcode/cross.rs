//! Whether ways lead over what supports have printed, and how near lines come.
use crate::layers::shape::{Place, Point as Grid, Polygon, Region, ring_edges};
use crate::toolpath::bead::Point;

/// Ways are told apart from supports within this, grid steps: 0.1 mm, the spread of a bead.
const SPREAD: i32 = 1_000;

/// Where supports are printed in a layer.
#[derive(Clone, Debug, Default)]
pub(super) struct Shadow {
    polygons: Vec<Polygon>,
}

impl Shadow {
    pub(super) fn new(regions: [&Region; 2]) -> Shadow {
        Shadow { polygons: regions.into_iter().flat_map(|r| r.polygons.iter().cloned()).collect() }
    }

    /// Whether a straight way leads over some of it.
    pub(super) fn meets(&self, from: Point, to: Point) -> bool {
        let (a, b) = (Grid::from_mm(from[0], from[1]), Grid::from_mm(to[0], to[1]));
        let (low, high) = ([a.x.min(b.x), a.y.min(b.y)], [a.x.max(b.x), a.y.max(b.y)]);
        self.polygons.iter().any(|polygon| {
            let own = polygon.bounds();
            let apart = high[0] < own.min.x.saturating_sub(SPREAD)
                || high[1] < own.min.y.saturating_sub(SPREAD)
                || low[0] > own.max.x.saturating_add(SPREAD)
                || low[1] > own.max.y.saturating_add(SPREAD);
            !apart && (polygon.place(a) != Place::Outside || crosses(polygon, a, b) || brushes(polygon, from, to))
        })
    }
}

fn crosses(polygon: &Polygon, a: Grid, b: Grid) -> bool {
    let side = |p: Grid, q: Grid, r: Grid| {
        let along = |s: Grid| (i64::from(s.x) - i64::from(p.x), i64::from(s.y) - i64::from(p.y));
        let ((qx, qy), (rx, ry)) = (along(q), along(r));
        (qx * ry - qy * rx).signum()
    };
    let edges = polygon.rings.iter().flat_map(|ring| ring_edges(ring));
    edges.into_iter().any(|[c, d]| side(a, b, c) * side(a, b, d) <= 0 && side(c, d, a) * side(c, d, b) <= 0)
}

/// Whether a way comes within the spread of a bead at the border.
fn brushes(polygon: &Polygon, from: Point, to: Point) -> bool {
    let near = f64::from(SPREAD) / crate::layers::shape::UNITS_PER_MM;
    polygon.rings.iter().flatten().any(|p| to_segment_mm(p.mm(), [from, to]) < near)
}

/// From a point to a segment, mm.
pub(super) fn to_segment_mm(p: Point, [a, b]: [Point; 2]) -> f64 {
    let (d, e) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
    let squared = d[0] * d[0] + d[1] * d[1];
    let t = if squared > 0.0 { ((d[0] * e[0] + d[1] * e[1]) / squared).clamp(0.0, 1.0) } else { 0.0 };
    let (x, y) = (e[0] - t * d[0], e[1] - t * d[1]);
    (x * x + y * y).sqrt()
}

/// Between two segments, mm; 0 where they cross.
pub(super) fn distance_mm(a: [Point; 2], b: [Point; 2]) -> f64 {
    let side = |p: Point, q: Point, r: Point| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let apart = |p: [Point; 2], q: [Point; 2]| side(p[0], p[1], q[0]) * side(p[0], p[1], q[1]) > 0.0;
    if !apart(a, b) && !apart(b, a) {
        let parallel = side(a[0], a[1], b[0]) == 0.0 && side(a[0], a[1], b[1]) == 0.0;
        if !parallel {
            return 0.0;
        }
    }
    let ends = [to_segment_mm(a[0], b), to_segment_mm(a[1], b), to_segment_mm(b[0], a), to_segment_mm(b[1], a)];
    ends.into_iter().fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::polygon::stroke;

    #[test]
    fn ways_over_and_beside_a_branch() {
        let disc = stroke(&[vec![Grid::from_mm(10.0, 10.0)]], 2.0);
        let shadow = Shadow::new([&disc, &Region::default()]);
        let check = |from: Point, to: Point, expect: bool| {
            assert_eq!(shadow.meets(from, to), expect, "{from:?} {to:?}");
        };
        check([0.0, 10.0], [20.0, 10.0], true);
        check([10.0, 10.0], [10.1, 10.0], true);
        check([0.0, 10.0], [7.0, 10.0], false);
        check([0.0, 12.05], [20.0, 12.05], true);
        check([0.0, 12.2], [20.0, 12.2], false);
        check([0.0, 0.0], [20.0, 5.0], false);
        assert!(!Shadow::default().meets([0.0, 0.0], [9.0, 9.0]));
    }

    #[test]
    fn distances_of_segments() {
        let check = |a: [Point; 2], b: [Point; 2], expect: f64| {
            assert!((distance_mm(a, b) - expect).abs() < 1e-12, "{a:?} {b:?}: {}", distance_mm(a, b));
            assert!((distance_mm(b, a) - expect).abs() < 1e-12);
        };
        check([[0.0, 0.0], [2.0, 2.0]], [[0.0, 2.0], [2.0, 0.0]], 0.0);
        check([[0.0, 0.0], [2.0, 0.0]], [[0.0, 1.0], [2.0, 1.0]], 1.0);
        check([[0.0, 0.0], [1.0, 0.0]], [[3.0, 0.0], [4.0, 0.0]], 2.0);
        check([[0.0, 0.0], [4.0, 0.0]], [[1.0, 0.0], [2.0, 0.0]], 0.0);
        check([[0.0, 0.0], [0.0, 0.0]], [[3.0, 4.0], [3.0, 4.0]], 5.0);
    }
}
