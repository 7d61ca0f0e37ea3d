//! The outlines of what is seen from the front or the side, in px.
//!
//! Takes the rows of an [`Elevation`], gives outlines of each class: stretches
//! that lie over one another one to one become one outline.
use super::super::class::Class;
use super::super::elevation::{Elevation, Run};
use crate::layers::shape::UNITS_PER_MM;
use crate::report::canvas::Outline;

/// Rows lower than this are drawn as one, and gaps narrower than it closed, px.
const PIXEL_PX: f64 = 0.5;

/// Most points of a class in a view: what bounds an SVG.
const POINTS_MAX: usize = 30_000;

/// Rows are made no higher than twice this for it, px: then there are few of them.
const COARSEST_PX: f64 = 32.0;

/// Where mm are in the picture.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// px of x (or y) = 0 and z = 0.
    pub(super) zero: [f64; 2],
    /// px a mm.
    pub(super) scale: f64,
}

impl Place {
    /// px of a stretch's end, grid steps.
    fn across(&self, units: i32) -> f64 {
        self.zero[0] + f64::from(units) / UNITS_PER_MM * self.scale
    }

    /// px of a height, mm.
    pub(super) fn up(&self, z_mm: f64) -> f64 {
        self.zero[1] - z_mm * self.scale
    }
}

/// Some rows drawn as one.
struct Band {
    bottom_mm: f64,
    top_mm: f64,
    runs: Vec<Run>,
}

/// An outline that grows upward: its left side and its right side.
struct Open {
    last: Run,
    left: Vec<[f64; 2]>,
    right: Vec<[f64; 2]>,
}

/// What is looked at, and how.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) of: &'a Elevation,
    /// 0 from the front, 1 from the right.
    pub(super) axis: usize,
    pub(super) place: Place,
    /// What lies outside is cut off, mm.
    pub(super) span_mm: [f64; 2],
}

/// The outlines of a class: as fine as can be seen, coarser where there would be too many.
pub(super) fn outlines(view: &View, class: Class) -> Vec<Outline> {
    let mut pixel = PIXEL_PX;
    loop {
        let found = at_fineness(view, class, pixel);
        if pixel > COARSEST_PX || found.iter().map(Vec::len).sum::<usize>() <= POINTS_MAX {
            return found;
        }
        pixel *= 2.0;
    }
}

/// The outlines with rows at least so high and gaps at least so wide, px.
fn at_fineness(view: &View, class: Class, pixel: f64) -> Vec<Outline> {
    let place = &view.place;
    let mut done = Vec::new();
    let mut open: Vec<Open> = Vec::new();
    let mut top_mm = f64::NEG_INFINITY;
    for band in bands(view, class, pixel) {
        let mut before = std::mem::take(&mut open);
        if band.bottom_mm > top_mm {
            done.extend(before.drain(..).map(closed));
        }
        top_mm = band.top_mm;
        let meets = |a: &Run, b: &Run| a[0] <= b[1] && b[0] <= a[1];
        for run in &band.runs {
            let below: Vec<usize> = (0..before.len()).filter(|&k| meets(&before[k].last, run)).collect();
            let alone = below.len() == 1
                && band.runs.iter().filter(|other| meets(&before[below[0]].last, other)).count() == 1;
            let mut outline = if alone {
                before.swap_remove(below[0])
            } else {
                Open { last: *run, left: Vec::new(), right: Vec::new() }
            };
            outline.last = *run;
            let [left, right] = run.map(|units| place.across(units));
            for z in [band.bottom_mm, band.top_mm] {
                step(&mut outline.left, [left, place.up(z)]);
                step(&mut outline.right, [right, place.up(z)]);
            }
            open.push(outline);
        }
        done.extend(before.into_iter().map(closed));
    }
    done.extend(open.into_iter().map(closed));
    done
}

/// Appends a point of a side; where the side goes on straight the last one gives way.
fn step(side: &mut Vec<[f64; 2]>, to: [f64; 2]) {
    if let [.., a, b] = side.as_slice()
        && a[0] == b[0]
        && b[0] == to[0]
    {
        side.pop();
    }
    side.push(to);
}

fn closed(open: Open) -> Outline {
    open.left.into_iter().chain(open.right.into_iter().rev()).collect()
}

fn bands(view: &View, class: Class, pixel: f64) -> Vec<Band> {
    let mut bands: Vec<Band> = Vec::new();
    let least_mm = pixel / view.place.scale;
    for row in view.of.rows() {
        let runs = row.runs(view.axis, class).iter();
        let runs: Vec<Run> = runs.filter_map(|run| within(*run, view.span_mm)).collect();
        if runs.is_empty() {
            continue;
        }
        match bands.last_mut() {
            Some(last) if last.top_mm >= row.bottom_mm && last.top_mm - last.bottom_mm < least_mm => {
                last.top_mm = row.top_mm;
                last.runs.extend(runs);
            }
            _ => bands.push(Band { bottom_mm: row.bottom_mm, top_mm: row.top_mm, runs }),
        }
    }
    // A gap of less than a row's height does not show either.
    let gap = (least_mm * UNITS_PER_MM) as i32;
    for band in &mut bands {
        band.runs.sort_unstable();
        band.runs.dedup_by(|next, kept| {
            let joined = next[0] <= kept[1].saturating_add(gap);
            kept[1] = if joined { kept[1].max(next[1]) } else { kept[1] };
            joined
        });
    }
    bands
}

/// What of a stretch lies in a span.
fn within([from, to]: Run, [low_mm, high_mm]: [f64; 2]) -> Option<Run> {
    let [low, high] = [low_mm, high_mm].map(|mm| (mm * UNITS_PER_MM).round() as i32);
    (from <= high && to >= low).then(|| [from.max(low), to.min(high)])
}

#[cfg(test)]
mod tests {
    use super::super::super::Seen;
    use super::*;
    use crate::layers::shape::{Point, Polygon, Region};
    use crate::layers::stack::Layer;

    /// Layers of 1 mm with stretches of x in mm.
    fn elevation(rows: &[&[(f64, f64)]]) -> Elevation {
        let mut elevation = Elevation::default();
        for (number, runs) in rows.iter().enumerate() {
            let square = |&(from, to): &(f64, f64)| {
                let corners = [(from, 0.0), (to, 0.0), (to, 1.0), (from, 1.0)];
                Polygon { rings: vec![corners.map(|(x, y)| Point::from_mm(x, y)).to_vec()] }
            };
            let layer = Layer {
                number: number as u32,
                bottom_mm: number as f64,
                top_mm: number as f64 + 1.0,
                part: Region { polygons: runs.iter().map(square).collect() },
                ..Layer::default()
            };
            elevation.add(Seen { layer: &layer, standings: &[], overhangs: &[] });
        }
        elevation
    }

    fn view(of: &Elevation, place: Place, span_mm: [f64; 2]) -> View<'_> {
        View { of, axis: 0, place, span_mm }
    }

    fn area(outline: &Outline) -> f64 {
        let next = |k: usize| outline[(k + 1) % outline.len()];
        (0..outline.len()).map(|k| outline[k][0] * next(k)[1] - outline[k][1] * next(k)[0]).sum::<f64>().abs()
            / 2.0
    }

    fn check(rows: &[&[(f64, f64)]], outlines_expected: usize, area_expected: f64) {
        let place = Place { zero: [0.0, 100.0], scale: 2.0 };
        let found = outlines(&view(&elevation(rows), place, [-1.0, 20.0]), Class::Body);
        assert_eq!(found.len(), outlines_expected, "{found:?}");
        let sum: f64 = found.iter().map(area).sum();
        assert!((sum - 4.0 * area_expected).abs() < 1e-6, "{sum}");
    }

    #[test]
    fn what_stands_on_each_other_is_one_outline() {
        check(&[&[(0.0, 4.0)], &[(1.0, 3.0)], &[(1.0, 3.0)]], 1, 8.0);
        // A fork: the stem, and two branches.
        check(&[&[(0.0, 9.0)], &[(0.0, 3.0), (5.0, 9.0)], &[(0.0, 3.0), (5.0, 9.0)]], 3, 23.0);
        // Two that meet, and a gap in height.
        check(&[&[(0.0, 3.0), (5.0, 9.0)], &[(0.0, 9.0)], &[], &[(0.0, 9.0)]], 4, 25.0);
        check(&[&[]], 0, 0.0);
    }

    #[test]
    fn what_is_out_of_the_picture_is_cut_off() {
        let place = Place { zero: [0.0, 0.0], scale: 1.0 };
        let rows: [&[(f64, f64)]; 1] = [&[(-9.0, 2.0), (3.0, 4.0), (8.0, 9.0)]];
        let found = outlines(&view(&elevation(&rows), place, [-1.0, 5.0]), Class::Body);
        let sum: f64 = found.iter().map(area).sum();
        assert!(found.len() == 2 && (sum - 4.0).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn rows_lower_than_a_pixel_are_one() {
        let rows: Vec<&[(f64, f64)]> = vec![&[(0.0, 1.0)]; 1000];
        let place = Place { zero: [0.0, 0.0], scale: 0.001 };
        let found = outlines(&view(&elevation(&rows), place, [0.0, 1.0]), Class::Body);
        assert_eq!((found.len(), found[0].len()), (1, 4));
    }

    #[test]
    fn a_heap_of_crumbs_is_drawn_coarser() {
        // Forty crumbs a layer, each time elsewhere: nothing stands on anything.
        let rows: Vec<Vec<(f64, f64)>> = (0..2000)
            .map(|k| {
                (0..40).map(|c| f64::from(c) * 5.0 + f64::from(k % 2) * 2.5).map(|x| (x, x + 1.0)).collect()
            })
            .collect();
        let rows: Vec<&[(f64, f64)]> = rows.iter().map(Vec::as_slice).collect();
        let place = Place { zero: [0.0, 0.0], scale: 1.0 };
        let found = outlines(&view(&elevation(&rows), place, [0.0, 300.0]), Class::Body);
        let points: usize = found.iter().map(Vec::len).sum();
        assert!(points <= POINTS_MAX && !found.is_empty(), "{points}");
    }
}
