//! How mm on the bed become px in the picture.
//!
//! Takes the strokes of both sides, gives a [`Frame`] that holds them all: the
//! sides compare only when they have one scale.
use super::strokes::Stroke;
use super::svg::number;
use crate::toolpath::bead::{Point, distance_mm};

/// Points nearer to the last one than this are left out, px: nobody sees them.
const VISIBLE_PX: f64 = 0.3;

/// Empty border inside the frame, px.
const BORDER_PX: f64 = 18.0;

/// Nothing is drawn farther out than this, px: viewers' own arithmetic ends somewhere.
const FAR_PX: f64 = 1e5;

/// Smallest extent that is scaled to the frame, mm.
const EXTENT_MIN_MM: f64 = 5.0;

/// How mm become px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    /// Left and top edge, px.
    pub(super) origin: [f64; 2],
    /// Width and height, px.
    pub(super) size: [f64; 2],
    /// px a mm.
    scale: f64,
    /// What is in the middle, mm.
    centre: Point,
}

impl Frame {
    /// A frame `width` px wide and at most `max_height` px high around all of these strokes.
    pub(super) fn around<'a>(
        strokes: impl Iterator<Item = &'a Stroke>,
        width: f64,
        max_height: f64,
        min_height: f64,
    ) -> Frame {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for point in strokes.flat_map(|s| &s.points).filter(|p| p.iter().all(|c| c.is_finite())) {
            for axis in 0..2 {
                low[axis] = low[axis].min(point[axis]);
                high[axis] = high[axis].max(point[axis]);
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 2], [0.0; 2]);
        }
        let extent = [0, 1].map(|axis| (high[axis] - low[axis]).max(EXTENT_MIN_MM));
        let inner = [width - 2.0 * BORDER_PX, max_height - 2.0 * BORDER_PX];
        let scale = (inner[0] / extent[0]).min(inner[1] / extent[1]);
        let height = (extent[1] * scale + 2.0 * BORDER_PX).max(min_height);
        let centre = [0, 1].map(|axis| f64::midpoint(low[axis], high[axis]));
        Frame { origin: [0.0; 2], size: [width, height], scale, centre }
    }

    /// The same elsewhere.
    pub(super) fn at(self, origin: [f64; 2]) -> Frame {
        Frame { origin, ..self }
    }

    /// px a mm.
    pub(super) fn scale(&self) -> f64 {
        self.scale
    }

    /// px of a point; Y goes up on the bed and down in the picture.
    pub(super) fn place(&self, point: Point) -> [f64; 2] {
        let [x, y] = [0, 1].map(|axis| {
            let px = (point[axis] - self.centre[axis]) * self.scale;
            if px.is_finite() { px.clamp(-FAR_PX, FAR_PX) } else { 0.0 }
        });
        [self.origin[0] + self.size[0] / 2.0 + x, self.origin[1] + self.size[1] / 2.0 - y]
    }

    /// Appends `Mx yLx y…`; false when the text would grow beyond `limit`.
    pub(super) fn path(&self, out: &mut String, points: &[Point], limit: usize) -> bool {
        let mut last: Option<[f64; 2]> = None;
        for (k, &point) in points.iter().enumerate() {
            let at = self.place(point);
            let is_last = k + 1 == points.len();
            if !is_last && last.is_some_and(|last| distance_mm(last, at) < VISIBLE_PX) {
                continue;
            }
            if out.len() > limit {
                return false;
            }
            out.push(if last.is_none() { 'M' } else { 'L' });
            number(out, at[0]);
            out.push(' ');
            number(out, at[1]);
            last = Some(at);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::super::strokes::Pen;
    use super::*;

    fn frame(points: &[Point]) -> Frame {
        let pen = Pen::Jump { retracted: false, lifted: false };
        let strokes = [Stroke { pen, points: points.to_vec() }];
        Frame::around(strokes.iter(), 236.0, 136.0, 50.0).at([10.0, 20.0])
    }

    #[test]
    fn all_is_inside_and_to_scale() {
        let check = |points: &[Point], size: [f64; 2], expect: &[[f64; 2]]| {
            let frame = frame(points);
            let placed: Vec<_> = points.iter().map(|&p| frame.place(p)).collect();
            assert_eq!((frame.size, placed.as_slice()), (size, expect), "{points:?}");
        };
        // As wide as the frame, 20 px a mm; Y goes up.
        check(&[[50.0, 7.0], [60.0, 9.0]], [236.0, 136.0], &[[28.0, 108.0], [228.0, 68.0]]);
        // As high as the frame.
        check(&[[0.0, 0.0], [10.0, 100.0]], [236.0, 136.0], &[[123.0, 138.0], [133.0, 38.0]]);
        check(&[[3.0, 3.0]], [236.0, 136.0], &[[128.0, 88.0]]);
        // What is nowhere is in the middle.
        check(&[[0.0, 0.0], [f64::NAN, f64::INFINITY]], [236.0, 136.0], &[[128.0, 88.0], [128.0, 88.0]]);
    }

    #[test]
    fn a_path_has_only_points_that_show() {
        let frame = frame(&[[0.0, 0.0], [10.0, 0.0]]);
        let mut out = String::new();
        let points: Vec<Point> = (0..=1000).map(|k| [f64::from(k) / 1000.0, 0.0]).collect();
        assert!(frame.path(&mut out, &points, 10_000));
        // 20 px at 0.3 px or more, and the last.
        assert!((60..70).contains(&out.matches('L').count()), "{out}");
        assert!(!frame.path(&mut out, &points, 10));
    }
}
