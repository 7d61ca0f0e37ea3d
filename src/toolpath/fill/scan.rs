//! Parallel lines through a polygon: where they are inside.
use crate::layers::scan::spans;
use crate::layers::shape::Polygon;
use crate::toolpath::bead::Point;

/// Coordinates along and across lines at an angle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    cosine: f64,
    sine: f64,
}

impl Frame {
    /// Counter-clockwise from X.
    pub(super) fn new(angle_deg: f64) -> Frame {
        // Right angles to the last bit: no line of a square's raster may slant.
        let quarter = angle_deg / 90.0;
        if quarter == quarter.round() {
            let (cosine, sine) =
                [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][quarter.rem_euclid(4.0) as usize % 4];
            return Frame { cosine, sine };
        }
        let (sine, cosine) = angle_deg.to_radians().sin_cos();
        Frame { cosine, sine }
    }

    /// Along a direction.
    pub(super) fn along(way: Point) -> Frame {
        let length = way[0].hypot(way[1]);
        if length > 0.0 { Frame { cosine: way[0] / length, sine: way[1] / length } } else { Frame::new(0.0) }
    }

    /// Turned by a right angle, counter-clockwise.
    pub(super) fn across(self) -> Frame {
        Frame { cosine: -self.sine, sine: self.cosine }
    }

    /// Of a point on the plate: how far along the lines, and how far across.
    pub(super) fn of(self, p: Point) -> Point {
        [p[0] * self.cosine + p[1] * self.sine, p[1] * self.cosine - p[0] * self.sine]
    }

    /// The point on the plate.
    pub(super) fn back(self, p: Point) -> Point {
        [p[0] * self.cosine - p[1] * self.sine, p[0] * self.sine + p[1] * self.cosine]
    }

    /// How far across a polygon lies: lowest and highest, mm.
    pub(super) fn extent(self, polygon: &Polygon) -> Option<[f64; 2]> {
        let across = polygon.rings.first()?.iter().map(|p| self.of(p.mm())[1]);
        let ends = across.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], y| [a.min(y), b.max(y)]);
        (ends[0] <= ends[1]).then_some(ends)
    }
}

/// For each of some lines, told by how far across they lie (ascending), the pieces
/// that are inside of a polygon: from and to, along the line.
pub(super) fn intervals(polygon: &Polygon, frame: Frame, offsets: &[f64]) -> Vec<Vec<[f64; 2]>> {
    spans(&polygon.rings, |p| frame.of(p.mm()), offsets)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::Point as Grid;

    #[test]
    fn lines_go_around_holes() {
        let ring = |low: f64, high: f64| {
            [(low, low), (high, low), (high, high), (low, high)].map(|(x, y)| Grid::from_mm(x, y)).to_vec()
        };
        let mut hole = ring(1.0, 2.0);
        hole.reverse();
        let polygon = Polygon { rings: vec![ring(0.0, 4.0), hole] };
        let check = |angle: f64, offset: f64, expect: &[[f64; 2]]| {
            assert_eq!(intervals(&polygon, Frame::new(angle), &[offset])[0], expect, "{angle} {offset}");
        };
        check(0.0, 1.5, &[[0.0, 1.0], [2.0, 4.0]]);
        check(90.0, -1.5, &[[0.0, 1.0], [2.0, 4.0]]);
        check(180.0, -3.0, &[[-4.0, 0.0]]);
        check(0.0, 5.0, &[]);
        // Through vertices: the lower border counts, the upper one does not.
        check(0.0, 1.0, &[[0.0, 1.0], [2.0, 4.0]]);
        check(0.0, 2.0, &[[0.0, 4.0]]);
        check(0.0, 4.0, &[]);
    }

    #[test]
    fn frames_turn_there_and_back() {
        for angle in [0.0, 30.0, 90.0, -90.0, 725.5, 270.0] {
            let frame = Frame::new(angle);
            let p = frame.back(frame.of([3.0, -2.0]));
            assert!((p[0] - 3.0).abs() < 1e-12 && (p[1] + 2.0).abs() < 1e-12, "{angle}");
        }
        assert_eq!(Frame::new(90.0).back([1.0, 0.0]), [0.0, 1.0]);
        assert_eq!(Frame::along([0.0, 2.0]).of([0.0, 5.0]), [5.0, 0.0]);
    }
}
