//! The picture of a checked job: seen from the front and from the right, the list
//! of its islands, and from above the layers where the largest of them appear.
//!
//! Takes a [`Report`] and a [`Survey`], gives an SVG's text or a PNG's bytes: the
//! same drawing. An SVG stays below some 4 MB whatever the job.
//!
//! # Layout
//! - `views`: elevations with a scale of heights; `silhouette`: their outlines
//! - `sheet`: layers from above
mod sheet;
mod silhouette;
mod views;

use super::Survey;
use super::class::{ALL, Class};
use crate::report::canvas::png::{EncodingError, Png};
use crate::report::canvas::svg::Svg;
use crate::report::canvas::{Anchor, Canvas, Style, font, shortened};
use crate::report::check::{Report, height_words};
use crate::report::svg::Rgb;

/// Width of the picture, px.
const WIDTH: f64 = 1400.0;

/// Empty border around everything, and between its parts, px.
const MARGIN: f64 = 32.0;

/// Width of the list of islands, px.
const LIST: f64 = 400.0;

/// Where the views begin, px: the title is above.
const TOP: f64 = 128.0;

/// Height of a line of the list, px.
const LINE: f64 = 24.0;

/// Lines of the list.
const LINES_MAX: usize = 14;

/// Room for the legend, px.
const LEGEND: f64 = 56.0;

/// Dark text.
const INK: Rgb = [0x0f, 0x17, 0x2a];

/// Text that steps back.
const FAINT: Rgb = [0x64, 0x74, 0x8b];

/// Thin lines.
const HAIR: Rgb = [0xd5, 0xdc, 0xe6];

/// Behind everything.
const GROUND: Rgb = [0xf4, 0xf6, 0xf9];

/// Behind a view.
const PAPER: Rgb = [0xff, 0xff, 0xff];

/// Why there is no picture.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// Not enough memory for the pixels.
    #[error("there is no memory for the picture's pixels; ask for an .svg")]
    Memory,
    /// The encoder's own.
    #[error("the picture cannot be encoded as PNG: {0}; ask for an .svg")]
    Encode(#[from] EncodingError),
}

/// The picture as SVG.
#[must_use]
pub fn svg(report: &Report, survey: &Survey) -> String {
    let layout = Layout::of(report, survey);
    let mut svg = Svg::new([WIDTH, layout.height], report.name());
    layout.draw(&mut svg);
    svg.finish()
}

/// The picture as PNG.
///
/// # Errors
/// Memory, or the encoder's.
pub fn png(report: &Report, survey: &Survey) -> Result<Vec<u8>, PictureError> {
    let layout = Layout::of(report, survey);
    let mut png = Png::new([WIDTH, layout.height]).ok_or(PictureError::Memory)?;
    layout.draw(&mut png);
    Ok(png.finish()?)
}

fn style(size: f64, colour: Rgb) -> Style {
    Style { size, bold: false, colour, anchor: Anchor::Start }
}

fn bold(size: f64) -> Style {
    Style { size, bold: true, colour: INK, anchor: Anchor::Start }
}

/// Where everything is.
struct Layout<'a> {
    report: &'a Report,
    views: views::Views<'a>,
    sheet: sheet::Sheet<'a>,
    height: f64,
}

impl<'a> Layout<'a> {
    fn of(report: &'a Report, survey: &'a Survey) -> Layout<'a> {
        let views = views::Views::new(report, survey, [MARGIN, TOP], WIDTH - 3.0 * MARGIN - LIST);
        let list = (list(report).len() as f64 + 3.0) * LINE;
        let sheet_top = TOP + views.height().max(list) + MARGIN;
        let sheet = sheet::Sheet::new(survey, [MARGIN, sheet_top], WIDTH - 2.0 * MARGIN);
        let height = sheet_top + sheet.height() + LEGEND;
        Layout { report, views, sheet, height }
    }

    fn draw(&self, to: &mut dyn Canvas) {
        to.frame([-1.0, -1.0], [WIDTH + 2.0, self.height + 2.0], GROUND, GROUND);
        self.title(to);
        self.views.draw(to);
        self.list(to);
        self.sheet.draw(to);
        self.legend(to, self.height - LEGEND);
    }

    fn title(&self, to: &mut dyn Canvas) {
        to.text([MARGIN, 46.0], bold(26.0), &shortened(self.report.name(), 80));
        to.text([MARGIN, 72.0], style(14.0, FAINT), &facts(self.report));
        to.text([MARGIN, 98.0], bold(16.0), &verdict(self.report));
    }

    fn list(&self, to: &mut dyn Canvas) {
        let x = WIDTH - MARGIN - LIST;
        let heading = if self.report.islands.is_empty() { "Largest overhangs" } else { "Largest islands" };
        let lines = list(self.report);
        if lines.is_empty() {
            return;
        }
        to.text([x, TOP + 16.0], bold(15.0), heading);
        for (k, words) in lines.iter().enumerate() {
            to.text([x, TOP + 16.0 + LINE * (k as f64 + 1.3)], style(14.0, INK), words);
        }
    }

    fn legend(&self, to: &mut dyn Canvas, y: f64) {
        to.line(&[[MARGIN, y], [WIDTH - MARGIN, y]], HAIR, 1.0);
        let mut x = MARGIN;
        for class in [Class::Body, Class::Appears, Class::Island, Class::Overhang, Class::Aid] {
            if !self.views.shows(class) && !self.sheet.shows(class) {
                continue;
            }
            to.frame([x, y + 20.5], [18.0, 12.0], class.colour(), class.colour());
            to.text([x + 26.0, y + 31.0], style(13.0, FAINT), class.title());
            x += 26.0 + font::width(class.title(), 13.0) + 36.0;
        }
    }
}

/// One line of facts.
fn facts(report: &Report) -> String {
    let mut facts = vec![report.kind.to_owned()];
    if let Some(triangles) = report.triangles {
        facts.push(format!("{triangles} triangles"));
    }
    facts.push(format!("{} layers", report.layers));
    facts.push(format!("{:.2} mm high", report.height_mm));
    let rules = &report.rules;
    facts.push(format!("{}: overhangs hold to {:.0}° from the vertical", rules.material, rules.angle_deg));
    facts.join(" · ")
}

/// One line of what was found.
fn verdict(report: &Report) -> String {
    let number = |n: usize, one: &str, many: &str| match n {
        0 => format!("no {many}"),
        1 => format!("1 {one}"),
        n => format!("{n} {many}"),
    };
    let mut words = number(report.islands.len(), "island", "islands");
    if !report.small_islands.is_empty() {
        let least = report.rules.min_area_mm2;
        words += &format!(" (and {} below {least} mm²)", report.small_islands.len());
    }
    if let Some(found) = &report.overhangs {
        let regions = number(found.regions as usize, "overhang", "overhangs");
        words += &format!(" · {regions} ({})", found.method);
        if found.regions > 0 {
            words += &format!(", {:.1} mm² seen from below", found.area_mm2);
        }
    }
    words
}

/// The list beside the views.
fn list(report: &Report) -> Vec<String> {
    // Away with the sign of −0.
    let tenths = |mm: f64| (mm * 10.0).round() / 10.0 + 0.0;
    let place = |at: [f64; 2]| format!("X {:.1} Y {:.1}", tenths(at[0]), tenths(at[1]));
    let mut lines: Vec<String> = if report.islands.is_empty() {
        let regions = report.overhangs.iter().flat_map(|found| &found.largest);
        regions
            .map(|r| {
                format!(
                    "layer {}, Z {}: {:.2} mm² at {}",
                    r.layer,
                    height_words(r.top_mm),
                    r.area_mm2,
                    place(r.centroid_mm)
                )
            })
            .collect()
    } else {
        let mark = |(k, i): (usize, &&crate::report::check::Island)| {
            let number = if k < views::MARKED_MAX { format!("{}  ", k + 1) } else { String::new() };
            format!(
                "{number}layer {}, Z {}: {:.2} mm² at {}",
                i.layer,
                height_words(i.top_mm),
                i.area_mm2,
                place(i.centroid_mm)
            )
        };
        report.largest_islands().iter().enumerate().map(mark).collect()
    };
    let all = lines.len();
    if all > LINES_MAX {
        lines.truncate(LINES_MAX - 1);
        lines.push(format!("and {} more", all - lines.len()));
    }
    lines
}

/// Whether a class is anywhere in what was kept.
fn any_of(classes: impl Iterator<Item = Class>) -> [bool; ALL.len()] {
    let mut found = [false; ALL.len()];
    classes.for_each(|class| found[class as usize] = true);
    found
}

#[cfg(test)]
mod tests {
    use super::super::Seen;
    use super::*;
    use crate::detect::island::Standing;
    use crate::layers::shape::{Point, Polygon, Region};
    use crate::layers::stack::Layer;
    use crate::report::check::testing::island;

    fn square(x: f64, y: f64, side: f64) -> Polygon {
        let corners = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)];
        Polygon { rings: vec![corners.map(|(x, y)| Point::from_mm(x, y)).to_vec()] }
    }

    fn add(survey: &mut Survey, number: u32, polygons: Vec<Polygon>, standing: Standing) {
        let standings = vec![standing; polygons.len()];
        let layer = Layer {
            number,
            bottom_mm: f64::from(number) * 0.1,
            top_mm: f64::from(number + 1) * 0.1,
            part: Region { polygons },
            ..Layer::default()
        };
        survey.add(Seen { layer: &layer, standings: &standings, overhangs: &[] });
    }

    fn well_drawn(svg: &str) {
        assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
    }

    #[test]
    fn nothing_at_all_is_a_picture_too() {
        let report = Report { file: "a/b.stl".into(), ..Report::default() };
        let text = svg(&report, &Survey::new(false));
        well_drawn(&text);
        assert!(text.contains(">b.stl</text>") && text.contains(">no islands</text>"));
        assert!(png(&report, &Survey::new(false)).is_ok_and(|bytes| bytes.starts_with(b"\x89PNG")));
    }

    #[test]
    fn islands_are_numbered_in_the_list_and_in_both_views() {
        let mut survey = Survey::new(false);
        add(&mut survey, 0, vec![square(0.0, 0.0, 9.0)], Standing::Body);
        add(&mut survey, 1, vec![square(1.0, -3.0, 1.0)], Standing::Appears);
        let report = Report { file: "a".into(), islands: vec![island(1, 1.0)], ..Report::default() };
        let text = svg(&report, &survey);
        well_drawn(&text);
        assert!(text.contains(">1  layer 1, Z 0.20: 1.00 mm² at X 1.5 Y -2.5</text>"));
        assert_eq!(text.matches(">1</text>").count(), 2);
        assert!(text.contains(">layer 1, Z 0.20 mm</text>"));
    }

    #[test]
    fn a_name_is_only_text() {
        let report = Report { file: "</title><script>".into(), ..Report::default() };
        let text = svg(&report, &Survey::new(false));
        assert!(!text.contains("<script") && text.matches("&lt;script&gt;").count() == 2);
    }

    #[test]
    fn crumbs_everywhere_stay_a_small_picture() {
        let mut survey = Survey::new(false);
        for number in 0..8 {
            let shift = f64::from(number) * 0.37;
            let crumb = |k: u32| square(f64::from(k % 100) + shift, f64::from(k / 100), 0.3);
            add(&mut survey, number, (0..3_000).map(crumb).collect(), Standing::Appears);
        }
        let text = svg(&Report::default(), &survey);
        well_drawn(&text);
        assert!(text.len() < 5_000_000, "{} bytes", text.len());
    }
}
