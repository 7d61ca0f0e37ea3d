//! Layers from above, side by side: those where the largest islands appear, or
//! where most overhangs.
use super::super::Survey;
use super::super::class::{ALL, Class};
use super::super::notable::Shown;
use super::super::pack::STEP_MM;
use super::super::simplify::simplified;
use super::views::round_step;
use super::{FAINT, HAIR, INK, PAPER, any_of, bold, style};
use crate::layers::shape::{Point, Polygon};
use crate::report::canvas::{Anchor, Canvas, Outline, Style};
use crate::report::check::height_words;

/// Layers in a row.
const COLUMNS: usize = 4;

/// Between the layers, px.
const GAP: f64 = 20.0;

/// Empty border inside a layer's frame, px.
const BORDER: f64 = 12.0;

/// Room for the words under a layer, px.
const CAPTION: f64 = 46.0;

/// Room for the heading, px.
const HEADING: f64 = 26.0;

/// Greatest height of a layer's content, px.
const HEIGHT_MAX: f64 = 320.0;

/// How far lines may be moved, px: nobody sees it.
const VISIBLE_PX: f64 = 0.25;

/// Most points of one layer: what bounds an SVG.
const POINTS_MAX: usize = 20_000;

/// An island smaller than this has a ring around it, px.
const RING_PX: f64 = 14.0;

/// Most rings in a layer: with more, rings are all that would be seen.
const RINGS_MAX: usize = 60;

/// Least extent that is scaled to the frame, mm.
const EXTENT_MIN_MM: f64 = 1.0;

/// The layers, and where they are.
pub(super) struct Sheet<'a> {
    layers: Vec<&'a Shown>,
    origin: [f64; 2],
    /// Of a layer's frame, px.
    size: [f64; 2],
    scale: f64,
    /// What is in the middle of a frame, mm.
    centre: [f64; 2],
    shown: [bool; ALL.len()],
}

impl<'a> Sheet<'a> {
    /// At a place, so wide, px.
    pub(super) fn new(survey: &'a Survey, origin: [f64; 2], width: f64) -> Sheet<'a> {
        let layers: Vec<&Shown> = survey.notable.layers().collect();
        let cell = (width - GAP * (COLUMNS - 1) as f64) / COLUMNS as f64;
        let (mut extent, mut centre) = ([EXTENT_MIN_MM; 2], [0.0; 2]);
        let bounds = survey.shown();
        if bounds.min.x <= bounds.max.x {
            let [low, high] = bounds.mm();
            extent = [0, 1].map(|k| (high[k] - low[k]).max(EXTENT_MIN_MM));
            centre = [0, 1].map(|k| f64::midpoint(low[k], high[k]));
        }
        let scale = ((cell - 2.0 * BORDER) / extent[0]).min(HEIGHT_MAX / extent[1]);
        let height = (extent[1] * scale).max(80.0) + 2.0 * BORDER;
        let shown = any_of(layers.iter().flat_map(|l| l.pieces()).map(|(class, _)| class));
        Sheet { layers, origin, size: [cell, height], scale, centre, shown }
    }

    pub(super) fn shows(&self, class: Class) -> bool {
        self.shown[class as usize]
    }

    /// Height of all, px.
    pub(super) fn height(&self) -> f64 {
        let rows = self.layers.len().div_ceil(COLUMNS);
        if rows == 0 { 0.0 } else { HEADING + rows as f64 * (self.size[1] + CAPTION) }
    }

    pub(super) fn draw(&self, to: &mut dyn Canvas) {
        let Some(first) = self.layers.first() else { return };
        let what = if first.island_mm2 > 0.0 { "islands appear" } else { "most overhangs" };
        let heading = format!("From above: the layers where {what}");
        to.text([self.origin[0], self.origin[1] + 12.0], bold(15.0), &heading);
        for (k, layer) in self.layers.iter().enumerate() {
            let (row, column) = (k / COLUMNS, k % COLUMNS);
            let x = self.origin[0] + column as f64 * (self.size[0] + GAP);
            let y = self.origin[1] + HEADING + row as f64 * (self.size[1] + CAPTION);
            self.layer(to, layer, [x, y]);
        }
    }

    fn layer(&self, to: &mut dyn Canvas, layer: &Shown, [x, y]: [f64; 2]) {
        to.frame([x, y], self.size, PAPER, HAIR);
        let middle = [x + self.size[0] / 2.0, y + self.size[1] / 2.0];
        let mut room = POINTS_MAX;
        let mut rings = Vec::new();
        let pieces = layer.pieces();
        for class in ALL {
            let mut outlines = Vec::new();
            for (_, polygon) in pieces.iter().filter(|(c, _)| *c == class) {
                if class == Class::Appears {
                    rings.extend(self.ring(polygon, middle));
                }
                if self.fits(polygon, middle, [x, y]) {
                    self.outlines(polygon, middle, &mut room, &mut outlines);
                }
            }
            to.fill(&outlines, class.colour());
        }
        rings.truncate(RINGS_MAX);
        for (centre, radius) in rings {
            to.circle(centre, radius, Class::Appears.colour(), 1.5);
        }
        self.scale_bar(to, [x + self.size[0] - BORDER, y + self.size[1] - BORDER]);
        let words = format!("layer {}, Z {} mm", layer.number, height_words(layer.top_mm));
        to.text([x, y + self.size[1] + 18.0], style(13.0, INK), &words);
        let mut areas = Vec::new();
        if layer.island_mm2 > 0.0 {
            areas.push(format!("islands {:.2} mm²", layer.island_mm2));
        }
        if layer.overhang_mm2 > 0.0 {
            areas.push(format!("overhangs {:.2} mm²", layer.overhang_mm2));
        }
        to.text([x, y + self.size[1] + 34.0], style(12.0, FAINT), &areas.join(" · "));
    }

    fn place(&self, p: Point, middle: [f64; 2]) -> [f64; 2] {
        let [x, y] = Shown::mm(p);
        [middle[0] + (x - self.centre[0]) * self.scale, middle[1] - (y - self.centre[1]) * self.scale]
    }

    fn outlines(&self, polygon: &Polygon, middle: [f64; 2], room: &mut usize, to: &mut Vec<Outline>) {
        let tolerance = VISIBLE_PX / self.scale / STEP_MM;
        for ring in &polygon.rings {
            let points = simplified(ring, tolerance);
            if points.len() > *room {
                continue;
            }
            *room -= points.len();
            to.push(points.into_iter().map(|p| self.place(p, middle)).collect());
        }
    }

    /// Whether it lies within the frame; a prime line at the other end of the plate does not.
    fn fits(&self, polygon: &Polygon, middle: [f64; 2], [x, y]: [f64; 2]) -> bool {
        let bounds = polygon.bounds();
        let [low, high] = [bounds.min, bounds.max].map(|p| self.place(p, middle));
        low[0] >= x && high[0] <= x + self.size[0] && high[1] >= y && low[1] <= y + self.size[1]
    }

    /// Around an island that is hard to see.
    fn ring(&self, polygon: &Polygon, middle: [f64; 2]) -> Option<([f64; 2], f64)> {
        let bounds = polygon.bounds();
        let [a, b] = [bounds.min, bounds.max].map(|p| self.place(p, middle));
        let size = (b[0] - a[0]).max(a[1] - b[1]);
        let centre = [f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])];
        (size < RING_PX).then_some((centre, RING_PX * 0.75))
    }

    /// A bar of a round length that ends at a place.
    fn scale_bar(&self, to: &mut dyn Canvas, [x, y]: [f64; 2]) {
        let mm = round_step(30.0 / self.scale);
        let start = x - mm * self.scale;
        to.line(&[[start, y - 4.0], [start, y], [x, y], [x, y - 4.0]], FAINT, 1.2);
        let label = Style { anchor: Anchor::End, ..style(11.0, FAINT) };
        to.text([x, y - 8.0], label, &format!("{mm} mm"));
    }
}
