//! Which spots of a layer are printed on: a bitmap of its beads.
//!
//! Takes the beads of the part in one layer (segments with widths), answers
//! whether a bead of a neighbouring layer lies over printed plastic all along.
//! Coarse on purpose and only ever too careful: a spot counts as printed when
//! the middle of its cell is under a bead.
use super::bead::{Point, distance_mm};

/// Side of a cell, mm: about half of a usual bead's width.
const CELL_MM: f64 = 0.25;

/// Most cells of a bitmap (2 MB); larger layers have no cover, so nothing on or under them is freed.
const MAX_CELLS: usize = 16 << 20;

/// A bead counts this much wider than it is, mm: neighbouring beads touch by
/// their rounded flanks, which leaves cells between them that are not bare.
const FLANK_MM: f64 = 0.06;

/// The bitmap.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cover {
    column: i64,
    row: i64,
    columns: usize,
    rows: usize,
    bits: Vec<u64>,
}

/// One printed segment: its ends and its width, mm.
pub type Stroke = (Point, Point, f64);

impl Cover {
    /// Draws the strokes; `None` when there are none or they span more than [`MAX_CELLS`].
    #[must_use]
    pub fn new(strokes: &[Stroke]) -> Option<Cover> {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for (a, b, width) in strokes {
            for p in [a, b] {
                for k in 0..2 {
                    low[k] = low[k].min(p[k] - width);
                    high[k] = high[k].max(p[k] + width);
                }
            }
        }
        let spans = [high[0] - low[0], high[1] - low[1]];
        let numbers =
            strokes.iter().all(|(a, b, w)| [a[0], a[1], b[0], b[1], *w].iter().all(|v| v.is_finite()));
        // A span is negative when there is no stroke.
        if !numbers || !spans.iter().all(|s| (0.0..1e5).contains(s)) {
            return None;
        }
        let [columns, rows] = spans.map(|s| (s / CELL_MM) as usize + 2);
        if columns.checked_mul(rows).is_none_or(|n| n > MAX_CELLS) {
            return None;
        }
        let mut cover = Cover {
            column: floor(low[0] / CELL_MM),
            row: floor(low[1] / CELL_MM),
            columns,
            rows,
            bits: vec![0; (columns * rows).div_ceil(64)],
        };
        for stroke in strokes {
            cover.draw(*stroke);
        }
        Some(cover)
    }

    /// Sets the cells whose middle is within half a width of the segment: on each
    /// row one run of cells, for the shape (two discs and the band between) has no dents.
    fn draw(&mut self, (a, b, width): Stroke) {
        let reach = width / 2.0 + FLANK_MM;
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        let length = (dx * dx + dy * dy).sqrt();
        let (nx, ny) = if length > 0.0 { (-dy / length * reach, dx / length * reach) } else { (0.0, 0.0) };
        // The band's long sides, parallel: from above each of the ends to above the
        // other. Its short sides lie within the discs.
        let slope = dx / dy;
        let sides = [[a[0] + nx, a[1] + ny], [a[0] - nx, a[1] - ny]];
        let first = -floor(0.5 - (a[1].min(b[1]) - reach) / CELL_MM);
        let last = floor((a[1].max(b[1]) + reach) / CELL_MM - 0.5);
        for row in first..=last {
            let y = (row as f64 + 0.5) * CELL_MM;
            let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
            let mut span = |x0: f64, x1: f64| (low, high) = (low.min(x0), high.max(x1));
            for p in [a, b] {
                let half = reach * reach - (y - p[1]) * (y - p[1]);
                if half >= 0.0 {
                    span(p[0] - half.sqrt(), p[0] + half.sqrt());
                }
            }
            for [x, from_y] in sides {
                let to_y = from_y + dy;
                if (from_y <= y) != (to_y <= y) {
                    let x = x + (y - from_y) * slope;
                    span(x, x);
                }
            }
            if low <= high {
                self.set_run(-floor(0.5 - low / CELL_MM), floor(high / CELL_MM - 0.5), row);
            }
        }
    }

    /// Sets a run of cells of a row, a word at a time.
    fn set_run(&mut self, from: i64, to: i64, row: i64) {
        let (Some(mut k), Some(end)) = (self.index(from, row), self.index(to, row)) else { return };
        while k <= end {
            let last = end.min(k | 63);
            let ones = u64::MAX >> (63 - (last - k));
            self.bits[k / 64] |= ones << (k % 64);
            k = last + 1;
        }
    }

    fn index(&self, column: i64, row: i64) -> Option<usize> {
        let column = usize::try_from(column - self.column).ok().filter(|&c| c < self.columns)?;
        let row = usize::try_from(row - self.row).ok().filter(|&r| r < self.rows)?;
        Some(row * self.columns + column)
    }

    /// Whether the spot is printed on.
    #[must_use]
    pub fn at(&self, p: Point) -> bool {
        let cell = |v: f64| floor(v / CELL_MM);
        self.index(cell(p[0]), cell(p[1])).is_some_and(|k| self.bits[k / 64] >> (k % 64) & 1 == 1)
    }

    /// Whether the whole segment is, tried at every half cell.
    #[must_use]
    pub fn along(&self, a: Point, b: Point) -> bool {
        let steps = (distance_mm(a, b) / (CELL_MM / 2.0)).ceil().max(1.0);
        if steps > MAX_CELLS as f64 {
            return false;
        }
        (0..=steps as usize).all(|k| {
            let t = k as f64 / steps;
            self.at([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])])
        })
    }
}

/// The next lower whole number; a call of the mathematics library where the
/// processor's base set has no such instruction, so spelt out.
fn floor(v: f64) -> i64 {
    let whole = v as i64;
    whole - i64::from(v < whole as f64)
}

#[cfg(test)]
mod tests {
    use super::super::bead::testing::point;
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn solid_lines_cover_and_sparse_ones_do_not() {
        let lines = |pitch: f64| -> Cover {
            let strokes: Vec<Stroke> =
                (0..20).map(|k| ([0.0, f64::from(k) * pitch], [20.0, f64::from(k) * pitch], 0.45)).collect();
            Cover::new(&strokes).unwrap()
        };
        assert!(lines(0.45).along([1.0, 1.0], [8.0, 8.0]));
        assert!(!lines(2.0).along([1.0, 1.0], [8.0, 8.0]));
        assert!(lines(2.0).along([1.0, 2.0], [8.0, 2.0]));
        assert!(!lines(0.45).along([1.0, 1.0], [8.0, 18.0]));
    }

    #[test]
    fn nonsense_has_no_cover() {
        assert_eq!(Cover::new(&[]), None);
        assert_eq!(Cover::new(&[([0.0, 0.0], [1e300, 0.0], 0.4)]), None);
        assert_eq!(Cover::new(&[([f64::NAN, 0.0], [1.0, 0.0], 0.4)]), None);
    }

    proptest! {
        #[test]
        fn a_set_cell_is_near_a_stroke_and_a_stroke_is_set(a in point(), b in point(), width in 0.3f64..1.0, probe in point()) {
            let cover = Cover::new(&[(a, b, width)]).unwrap();
            prop_assert!(cover.along(a, b));
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let length2 = dx * dx + dy * dy;
            let t = if length2 > 0.0 { (((probe[0] - a[0]) * dx + (probe[1] - a[1]) * dy) / length2).clamp(0.0, 1.0) } else { 0.0 };
            let gap = distance_mm(probe, [a[0] + t * dx, a[1] + t * dy]);
            // A cell's corner is 0.18 mm from its middle.
            if cover.at(probe) {
                prop_assert!(gap <= width / 2.0 + FLANK_MM + 0.18);
            } else {
                prop_assert!(gap >= width / 2.0 + FLANK_MM - 0.18);
            }
        }
    }
}
