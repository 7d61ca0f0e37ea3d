//! How often the beads of a layer cross each other, by a sample.
//!
//! Lines that cross each other everywhere are no print: n of them cross n² / 2 times,
//! and uniting them would need time and memory for every crossing. The sample
//! is the same for the same layer, so the answer is too.
use crate::layers::shape::Point;

/// Up to this many segments cross too seldom to matter.
const FEW: usize = 1500;

/// Segments that are tried against all.
const SAMPLE: usize = 64;

/// Sparse infill of a plate of 500 mm, lines of three directions 2 mm apart, crosses some 100,000 times.
pub(super) const CROSSINGS_MAX: usize = 4_000_000;

/// Whether paths cross each other more often than [`CROSSINGS_MAX`], estimated.
pub(super) fn tangled<'a>(paths: impl Iterator<Item = &'a [Point]> + Clone) -> bool {
    let count: usize = paths.clone().map(|path| path.len().saturating_sub(1)).sum();
    if count <= FEW {
        return false;
    }
    let every = count.div_ceil(SAMPLE);
    let segments = || paths.clone().flat_map(|path| path.windows(2));
    let sample: Vec<&[Point]> = segments().step_by(every).collect();
    let crossings: usize = segments().map(|s| sample.iter().filter(|other| cross(s, other)).count()).sum();
    // Each crossing has two segments.
    crossings as f64 * count as f64 / sample.len() as f64 / 2.0 > CROSSINGS_MAX as f64
}

/// Which side of a line a point lies on.
fn side(line: &[Point], p: Point) -> i64 {
    let d = |a: i32, b: i32| i64::from(b) - i64::from(a);
    // Coordinates are below 2^27: products fit.
    (d(line[0].x, line[1].x) * d(line[0].y, p.y) - d(line[0].y, line[1].y) * d(line[0].x, p.x)).signum()
}

fn cross(a: &[Point], b: &[Point]) -> bool {
    let apart = |v: fn(&Point) -> i32| {
        let range = |s: &[Point]| (v(&s[0]).min(v(&s[1])), v(&s[0]).max(v(&s[1])));
        let ((a0, a1), (b0, b1)) = (range(a), range(b));
        a1 < b0 || b1 < a0
    };
    !apart(|p| p.x)
        && !apart(|p| p.y)
        && side(a, b[0]) * side(a, b[1]) < 0
        && side(b, a[0]) * side(b, a[1]) < 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_that_cross_everywhere_are_told_from_a_grid() {
        // Lines from side to side of a plate of 200 mm, every way.
        let line = |k: usize, n: usize| {
            let t = k as f64 / n as f64;
            let at = |v: f64| (v * 2_000_000.0) as i32;
            if k % 2 == 0 {
                vec![Point { x: at(t), y: 0 }, Point { x: at(1.0 - t), y: at(1.0) }]
            } else {
                vec![Point { x: 0, y: at(t) }, Point { x: at(1.0), y: at(1.0 - t) }]
            }
        };
        let check = |n: usize, expect: bool| {
            let paths: Vec<Vec<Point>> = (0..n).map(|k| line(k, n)).collect();
            assert_eq!(tangled(paths.iter().map(Vec::as_slice)), expect, "{n}");
        };
        check(1000, false);
        check(2000, false);
        check(6000, true);
        // Many short ones, side by side.
        let short: Vec<Vec<Point>> = (0..20_000)
            .map(|k| {
                vec![
                    Point { x: 100 * k, y: 0 },
                    Point { x: 100 * k, y: 900 },
                    Point { x: 100 * k + 150, y: 0 },
                ]
            })
            .collect();
        assert!(!tangled(short.iter().map(Vec::as_slice)));
    }
}
