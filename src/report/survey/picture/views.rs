//! The job seen from the front and from the right, with a scale of heights.
use super::super::Survey;
use super::super::class::{ALL, Class};
use super::silhouette::{Place, View, outlines};
use super::{FAINT, HAIR, INK, PAPER, any_of, style};
use crate::report::canvas::{Anchor, Canvas, Style};
use crate::report::check::Report;

/// Greatest height of a view's content, px.
const HEIGHT_MAX: f64 = 520.0;

/// Empty border inside a view, px.
const BORDER: f64 = 20.0;

/// Between the views, px; the scale of heights is left of the first.
const GAP: f64 = 24.0;

/// Room for the scale of heights, px.
const SCALE: f64 = 44.0;

/// Room for the heading above, px.
const HEADING: f64 = 26.0;

/// Islands that are marked with their number.
pub(super) const MARKED_MAX: usize = 12;

/// Least extent that is scaled to the view, mm.
const EXTENT_MIN_MM: f64 = 1.0;

/// Both views.
pub(super) struct Views<'a> {
    report: &'a Report,
    survey: &'a Survey,
    origin: [f64; 2],
    scale: f64,
    /// Lowest and highest x, and y, mm.
    spans: [[f64; 2]; 2],
    height_mm: f64,
    shown: [bool; ALL.len()],
}

impl<'a> Views<'a> {
    /// At a place, together at most so wide, px.
    pub(super) fn new(report: &'a Report, survey: &'a Survey, origin: [f64; 2], width: f64) -> Views<'a> {
        let bounds = survey.shown();
        let spans = if bounds.min.x > bounds.max.x {
            [[0.0, EXTENT_MIN_MM]; 2]
        } else {
            let [low, high] = bounds.mm();
            [0, 1].map(|k| {
                let more = (EXTENT_MIN_MM - (high[k] - low[k])).max(0.0) / 2.0;
                [low[k] - more, high[k] + more]
            })
        };
        let height_mm = survey.elevation.rows().last().map_or(0.0, |r| r.top_mm).max(EXTENT_MIN_MM);
        let across: f64 = spans.iter().map(|s| s[1] - s[0]).sum();
        let room = width - SCALE - GAP - 4.0 * BORDER;
        let scale = (room / across).min(HEIGHT_MAX / height_mm);
        let rows = survey.elevation.rows();
        let shown = any_of(ALL.into_iter().filter(|&c| rows.iter().any(|r| !r.runs(0, c).is_empty())));
        Views { report, survey, origin, scale, spans, height_mm, shown }
    }

    pub(super) fn shows(&self, class: Class) -> bool {
        self.shown[class as usize]
    }

    /// Height of all, px.
    pub(super) fn height(&self) -> f64 {
        HEADING + self.inner() + 2.0 * BORDER
    }

    fn inner(&self) -> f64 {
        self.height_mm * self.scale
    }

    pub(super) fn draw(&self, to: &mut dyn Canvas) {
        let mut x = self.origin[0] + SCALE;
        for (axis, heading) in ["From the front", "From the right"].into_iter().enumerate() {
            let [low, high] = self.spans[axis];
            let width = (high - low) * self.scale + 2.0 * BORDER;
            let top = self.origin[1] + HEADING;
            to.text([x, top - 10.0], style(14.0, INK), heading);
            to.frame([x, top], [width, self.inner() + 2.0 * BORDER], PAPER, HAIR);
            let ground = top + BORDER + self.inner();
            let place = Place { zero: [x + BORDER - low * self.scale, ground], scale: self.scale };
            if axis == 0 {
                self.heights(to, &place, x);
            }
            to.line(&[[x + 6.0, ground], [x + width - 6.0, ground]], FAINT, 1.0);
            self.view(to, axis, &place);
            x += width + GAP;
        }
    }

    fn view(&self, to: &mut dyn Canvas, axis: usize, place: &Place) {
        // An island appears in one layer: too thin to see, so its mark tells the place.
        let span_mm = self.spans[axis];
        let view = View { of: &self.survey.elevation, axis, place: *place, span_mm };
        for class in ALL {
            to.fill(&outlines(&view, class), class.colour());
        }
        let mut labels: Vec<[f64; 2]> = Vec::new();
        for (k, island) in self.report.largest_islands().iter().take(MARKED_MAX).enumerate() {
            let at = [place.zero[0] + island.centroid_mm[axis] * self.scale, place.up(island.z_mm)];
            let dark = Class::Appears.colour();
            let half = ((island.bbox_mm[1][axis] - island.bbox_mm[0][axis]) / 2.0 * self.scale).max(3.0);
            to.line(&[[at[0] - half, at[1]], [at[0] + half, at[1]]], dark, 2.5);
            let (right, left) = ([at[0] + half + 4.0, at[1] + 4.0], [at[0] - half - 4.0, at[1] + 4.0]);
            // Beside the mark, on the side where no other number stands.
            let taken = |p: &[f64; 2]| {
                labels.iter().any(|l| (l[0] - p[0]).abs() < 14.0 && (l[1] - p[1]).abs() < 10.0)
            };
            let (at, anchor) = if taken(&right) { (left, Anchor::End) } else { (right, Anchor::Start) };
            if !taken(&at) {
                to.text(at, Style { size: 11.0, bold: true, colour: dark, anchor }, &(k + 1).to_string());
                labels.push(at);
            }
        }
    }

    /// The scale of heights, left of `x`.
    fn heights(&self, to: &mut dyn Canvas, place: &Place, x: f64) {
        let step = round_step(self.height_mm / (self.inner() / 48.0).max(1.0));
        let faint = Style { anchor: Anchor::End, ..style(12.0, FAINT) };
        let ticks = (self.height_mm / step + 1e-9).floor() as u32;
        for k in 0..=ticks {
            let z = f64::from(k) * step;
            let y = place.up(z);
            to.line(&[[x - 6.0, y], [x, y]], FAINT, 1.0);
            let digits = if step < 1.0 { 1 } else { 0 };
            let unit = if k == ticks && k > 0 { " mm" } else { "" };
            to.text([x - 9.0, y + 4.0], faint, &format!("{z:.digits$}{unit}"));
        }
    }
}

/// The smallest of 1, 2, 5, 10, 20 … (and tenths) that is no less.
pub(super) fn round_step(least: f64) -> f64 {
    let steps = [0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0];
    steps.into_iter().find(|&s| s >= least).unwrap_or(10_000.0)
}

#[cfg(test)]
mod tests {
    use super::round_step;

    #[test]
    fn steps_are_round() {
        let check = |least: f64, expect: f64| assert!((round_step(least) - expect).abs() < 1e-12, "{least}");
        check(0.01, 0.1);
        check(0.5, 0.5);
        check(0.51, 1.0);
        check(3.0, 5.0);
        check(1e9, 10_000.0);
    }
}
