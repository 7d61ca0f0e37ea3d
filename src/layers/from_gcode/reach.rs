//! How far supports reach beyond their own beads.
//!
//! A gap is left between supports and part so that they can be taken apart; they still
//! bear the part, and stand on it. So where a support ends, its last beads
//! fill the layers of the gap too. Where it goes on (another bead of support lies
//! in the same square of [`CELL_MM`]) nothing is added.
use super::levels::middle;
use super::trace::{Class, Path, Trace, grid};
use crate::layers::shape::{Point, UNITS_PER_MM};
use rustc_hash::FxHashSet;

/// Supports bear the part across a gap of this, mm, a little more than the file says,
/// and two layers and a quarter (Cura's trees end two layers below the part).
const CONTACT_MM: f64 = 0.3;
const CONTACT_MORE_MM: f64 = 0.1;
const CONTACT_MOST_MM: f64 = 2.0;

/// Side of the squares, mm: a few beads.
const CELL_MM: f64 = 1.0;

/// Points looked at on one segment at most; longer ones are looked at more coarsely.
const STEPS_MAX: f64 = 200.0;

/// Squares looked at in all, at most: those of 5 km of support. Beyond, gaps stay gaps.
const LOOKS_MAX: usize = 20_000_000;

/// Squares that lines of support touch, each with its layer.
type Cells = FxHashSet<(u32, i32, i32)>;

/// Pairs of a path and a layer that it fills besides its own, in the order of the paths.
pub(super) fn beyond(
    trace: &Trace,
    levels: &[i32],
    thickness: &[i32],
    ranges: &[Option<[usize; 2]>],
) -> Vec<(u32, usize)> {
    let supports = || trace.paths.iter().enumerate().filter(|(_, path)| class(trace, path) == Class::Support);
    let mut cells = Cells::default();
    let mut looks = 0;
    for (_, path) in supports() {
        let Some([first, last]) = ranges[path.sheet as usize] else { continue };
        along(trace.points_of(path), CELL_MM / 2.0, STEPS_MAX, |p| {
            looks += last - first + 1;
            if looks <= LOOKS_MAX {
                cells.extend((first..=last).map(|layer| cell(layer, p)));
            }
        });
        if looks > LOOKS_MAX {
            return Vec::new();
        }
    }
    let told = trace.contact_mm.map_or(0.0, |told| (told + CONTACT_MORE_MM).min(CONTACT_MOST_MM));
    let mut found = Vec::new();
    for (k, path) in supports() {
        let Some([first, last]) = ranges[path.sheet as usize] else { continue };
        looks += path.count as usize;
        if looks > LOOKS_MAX {
            return Vec::new();
        }
        let thick = thickness[path.sheet as usize];
        let reach = grid(told.max(CONTACT_MM)).max(thick.saturating_mul(9) / 4);
        let top = trace.sheets[path.sheet as usize].key.top;
        let (low, high) = (top.saturating_sub(thick).saturating_sub(reach), top.saturating_add(reach));
        let above = (last + 1..levels.len() - 1).take_while(|&layer| middle(levels, layer) < high);
        let below = (0..first).rev().take_while(|&layer| middle(levels, layer) > low);
        found.extend(
            above.chain(below).filter(|&layer| ends(trace, path, layer, &cells)).map(|l| (k as u32, l)),
        );
    }
    found
}

fn class(trace: &Trace, path: &Path) -> Class {
    trace.sheets[path.sheet as usize].key.class
}

fn cell(layer: usize, p: Point) -> (u32, i32, i32) {
    let at = |v: i32| v.div_euclid((CELL_MM * UNITS_PER_MM) as i32);
    (layer as u32, at(p.x), at(p.y))
}

/// Whether some of a path lies where the supports of a layer do not.
fn ends(trace: &Trace, path: &Path, layer: usize, cells: &Cells) -> bool {
    let mut ends = false;
    along(trace.points_of(path), CELL_MM / 2.0, STEPS_MAX, |p| ends |= !cells.contains(&cell(layer, p)));
    ends
}

/// Points of a path a step apart, its vertices and the middles of its segments among them.
pub(super) fn along(points: &[Point], step_mm: f64, most: f64, mut at: impl FnMut(Point)) {
    for ends in points.windows(2) {
        let [a, b] = [ends[0], ends[1]];
        let (dx, dy) = (f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y));
        let half = dx.hypot(dy) / (step_mm * UNITS_PER_MM) / 2.0;
        let steps = 2.0 * half.ceil().clamp(1.0, most / 2.0);
        for k in 0..steps as u32 {
            let t = f64::from(k) / steps;
            at(Point {
                x: (f64::from(a.x) + t * dx).round() as i32,
                y: (f64::from(a.y) + t * dy).round() as i32,
            });
        }
    }
    if let Some(&last) = points.last() {
        at(last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_along_a_path() {
        let check = |points: &[(i32, i32)], step_mm: f64, expect: &[(i32, i32)]| {
            let points: Vec<Point> = points.iter().map(|&(x, y)| Point { x, y }).collect();
            let mut found = Vec::new();
            along(&points, step_mm, 4.0, |p| found.push((p.x, p.y)));
            assert_eq!(found, expect);
        };
        check(&[(0, 0), (10, 20)], 1.0, &[(0, 0), (5, 10), (10, 20)]);
        check(&[(0, 0), (40_000, 0)], 1.0, &[(0, 0), (10_000, 0), (20_000, 0), (30_000, 0), (40_000, 0)]);
        check(&[(0, 0), (80_000, 0)], 1.0, &[(0, 0), (20_000, 0), (40_000, 0), (60_000, 0), (80_000, 0)]);
        check(&[(7, 7)], 1.0, &[(7, 7)]);
        check(&[], 1.0, &[]);
    }
}
