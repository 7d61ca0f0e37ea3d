//! Whether ways lead over what supports have printed, and how near lines come.
use crate::layers::shape::{Place, Point as Grid, Polygon, Region, ring_edges};
use crate::toolpath::bead::Point;

/// Ways this near to supports lead over them, mm: the spread of a bead.
const SPREAD_MM: f64 = 0.1;

/// Boxes sorted by where they begin, so that a few are looked at for each question.
#[derive(Clone, Debug, Default)]
pub(super) struct Boxes {
    /// Low x, low y, high x, high y, and whose it is.
    sorted: Vec<([f64; 4], usize)>,
    widest: f64,
}

impl Boxes {
    /// The polygons' bounds, grown, mm.
    pub(super) fn new<'a>(polygons: impl Iterator<Item = &'a Polygon>, grown_mm: f64) -> Boxes {
        let of = |p: &Polygon| {
            let [low, high] = p.bounds().mm();
            [low[0] - grown_mm, low[1] - grown_mm, high[0] + grown_mm, high[1] + grown_mm]
        };
        let mut sorted: Vec<([f64; 4], usize)> = polygons.enumerate().map(|(k, p)| (of(p), k)).collect();
        sorted.sort_unstable_by(|a, b| a.0[0].total_cmp(&b.0[0]).then(a.1.cmp(&b.1)));
        let widest = sorted.iter().map(|(b, _)| b[2] - b[0]).fold(0.0, f64::max);
        Boxes { sorted, widest }
    }

    /// Those that share a point with the bounds of a segment.
    pub(super) fn met(&self, a: Point, b: Point) -> impl Iterator<Item = usize> {
        let (low, high) = ([a[0].min(b[0]), a[1].min(b[1])], [a[0].max(b[0]), a[1].max(b[1])]);
        let from = self.sorted.partition_point(|(own, _)| own[0] < low[0] - self.widest);
        let reached = self.sorted[from..].iter().take_while(move |(own, _)| own[0] <= high[0]);
        reached
            .filter(move |(own, _)| own[2] >= low[0] && own[1] <= high[1] && own[3] >= low[1])
            .map(|(_, k)| *k)
    }
}

/// Where supports are printed in a layer.
#[derive(Clone, Debug, Default)]
pub(super) struct Shadow {
    polygons: Vec<Polygon>,
    boxes: Boxes,
}

impl Shadow {
    pub(super) fn new(regions: [&Region; 2]) -> Shadow {
        let polygons: Vec<Polygon> = regions.into_iter().flat_map(|r| r.polygons.iter().cloned()).collect();
        let boxes = Boxes::new(polygons.iter(), SPREAD_MM);
        Shadow { polygons, boxes }
    }

    /// Whether a straight way leads over some of it.
    pub(super) fn meets(&self, from: Point, to: Point) -> bool {
        let (a, b) = (Grid::from_mm(from[0], from[1]), Grid::from_mm(to[0], to[1]));
        self.boxes.met(from, to).any(|k| {
            let polygon = &self.polygons[k];
            crosses(polygon, a, b) || polygon.place(a) != Place::Outside || brushes(polygon, from, to)
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
    polygon.rings.iter().flatten().any(|p| to_segment_mm(p.mm(), [from, to]) < SPREAD_MM)
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
    let ends =
        [to_segment_mm(a[0], b), to_segment_mm(a[1], b), to_segment_mm(b[0], a), to_segment_mm(b[1], a)];
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
