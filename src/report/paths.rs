//! The picture of one layer's paths, before and after, side by side: an SVG.
//!
//! Takes a [`Pair`] of layers and the job's name, gives the SVG's text, below
//! 1 MB whatever the layer holds. Both sides have the same scale.
use super::frame::Frame;
use super::gain::Pair;
use super::legend::legend;
use super::panel::draw;
use super::strokes::Paths;
use super::svg::{escaped, text};
use crate::post::measure::Totals;
use std::fmt::Write;

/// Width of the picture, px.
pub(super) const WIDTH: f64 = 1400.0;

/// Empty border around everything, and between the sides, px.
pub(super) const MARGIN: f64 = 28.0;

/// Width of one side, px.
const SIDE: f64 = (WIDTH - 3.0 * MARGIN) / 2.0;

/// Highest side, px: a tall narrow part must still fit a screen.
const SIDE_HEIGHT_MAX: f64 = 720.0;

/// Lowest side, px.
const SIDE_HEIGHT_MIN: f64 = 200.0;

/// Where the sides begin, px: the title and the headings are above.
const TOP: f64 = 128.0;

/// Room for the figures under a side, px.
const FIGURES: f64 = 84.0;

/// Room for the legend, px.
const LEGEND: f64 = 88.0;

/// Characters of the job's name that are shown.
const NAME_MAX: usize = 90;

/// Dark text.
const INK: &str = "#0f172a";

/// Text that steps back.
pub(super) const FAINT: &str = "#64748b";

/// The SVG. `job` is the job's name for people; it is shown as text whatever it holds.
#[must_use]
pub fn svg(job: &str, pair: &Pair) -> String {
    let strokes = pair.before.strokes.iter().chain(&pair.after.strokes);
    let frame = Frame::around(strokes, SIDE, SIDE_HEIGHT_MAX, SIDE_HEIGHT_MIN);
    let height = TOP + frame.size[1] + FIGURES + LEGEND;
    let mut out = String::new();
    let _ = writeln!(
        out,
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height:.0}\" \
         viewBox=\"0 0 {WIDTH} {height:.0}\" \
         font-family=\"Inter, 'Segoe UI', 'Helvetica Neue', Helvetica, Arial, 'DejaVu Sans', sans-serif\">"
    );
    title(&mut out, job, pair);
    let (before, after) = (&pair.before.totals, &pair.after.totals);
    side(&mut out, ["Before", "as sliced"], &pair.before, &pair.after, &frame.at([MARGIN, TOP]));
    figures(&mut out, MARGIN, TOP + frame.size[1], before, None);
    let right = MARGIN + SIDE + MARGIN;
    side(&mut out, ["After", "infill reordered"], &pair.after, &pair.before, &frame.at([right, TOP]));
    figures(&mut out, right, TOP + frame.size[1], after, Some(before));
    legend(&mut out, TOP + frame.size[1] + FIGURES);
    out.push_str("</svg>\n");
    out
}

fn title(out: &mut String, job: &str, pair: &Pair) {
    let mut name: String = job.chars().take(NAME_MAX).collect();
    if name.len() < job.len() {
        name.push('…');
    }
    let layer = format!("Layer {}, z = {:.2} mm", pair.before.number, pair.before.z_mm);
    let _ = writeln!(out, "<title>{}: {}</title>", escaped(&name), escaped(&layer));
    out.push_str("<rect width=\"100%\" height=\"100%\" fill=\"#f4f6f9\"/>\n");
    text(out, MARGIN, 46.0, &format!("font-size=\"26\" font-weight=\"700\" fill=\"{INK}\""), &layer);
    text(out, MARGIN, 70.0, &format!("font-size=\"14\" fill=\"{FAINT}\""), &name);
}

fn side(out: &mut String, [heading, note]: [&str; 2], paths: &Paths, other: &Paths, frame: &Frame) {
    let [x, y] = frame.origin;
    let [width, height] = frame.size;
    let _ = writeln!(
        out,
        "<text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"17\" font-weight=\"700\" fill=\"{INK}\">{heading}\
         <tspan dx=\"8\" font-weight=\"400\" font-size=\"14\" fill=\"{FAINT}\">{note}</tspan></text>",
        y - 12.0
    );
    let _ = writeln!(
        out,
        "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"8\" fill=\"#fff\" \
         stroke=\"#d5dce6\"/>"
    );
    let note = |out: &mut String, y: f64, words: &str| {
        let attributes = format!("font-size=\"14\" text-anchor=\"middle\" fill=\"{FAINT}\"");
        text(out, x + width / 2.0, y, &attributes, words);
    };
    if paths.strokes.is_empty() {
        note(out, y + height / 2.0, "nothing is printed in this layer");
        return;
    }
    let left_out = draw(out, paths, other, frame);
    if left_out > 0 {
        let words = format!("{left_out} of {} paths had no room in this picture", paths.strokes.len());
        note(out, y + height - 8.0, &words);
    }
}

/// The figures of a side, and their change where there is something to compare.
fn figures(out: &mut String, x: f64, y: f64, totals: &Totals, before: Option<&Totals>) {
    let column = SIDE / 4.0;
    let counts = |of: fn(&Totals) -> u64| (of(totals) as f64, before.map(|b| of(b) as f64));
    let rows = [
        ("beads", counts(|t| t.beads), ""),
        ("jumps", counts(|t| t.jumps), ""),
        ("retractions", counts(|t| t.retractions), ""),
        ("travel", (totals.travel_mm, before.map(|b| b.travel_mm)), " mm"),
    ];
    for (k, (name, (now, before), unit)) in rows.into_iter().enumerate() {
        let x = x + column * k as f64;
        let attributes = format!("font-size=\"22\" font-weight=\"700\" fill=\"{INK}\"");
        text(out, x, y + 34.0, &attributes, &format!("{now:.0}{unit}"));
        let change = before.map(|before| change(before, now)).unwrap_or_default();
        let colour = if change.starts_with('−') { "#15803d" } else { FAINT };
        let _ = writeln!(
            out,
            "<text x=\"{x:.1}\" y=\"{:.1}\" font-size=\"13\" fill=\"{FAINT}\">{name}\
             <tspan dx=\"7\" font-weight=\"700\" fill=\"{colour}\">{change}</tspan></text>",
            y + 54.0
        );
    }
}

/// `−12 %`, `+3 %`, `same`, and `new` where there was nothing.
fn change(before: f64, now: f64) -> String {
    match (now / before - 1.0) * 100.0 {
        _ if (now - before).abs() < 0.5 => "same".to_owned(),
        p if !p.is_finite() => "new".to_owned(),
        p if p < 0.0 => format!("−{:.0} %", -p),
        p => format!("+{p:.0} %"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::strokes::testing::paths;
    use super::super::strokes::{Class, Pen, Stroke};
    use super::*;
    use proptest::prelude::*;

    /// The picture of one layer's commands, separated by `|`, before and after.
    fn picture(before: &str, after: &str) -> String {
        svg("job.gcode", &Pair { before: paths(before), after: paths(after) })
    }

    fn count(svg: &str, what: &str) -> usize {
        svg.matches(what).count()
    }

    /// Every element is closed in turn, every attribute quoted, and no text is read as markup.
    #[track_caller]
    fn well_formed(svg: &str) {
        let mut open = Vec::new();
        for piece in svg.split('<').skip(1) {
            let (tag, text) = piece.split_once('>').expect("a tag ends");
            assert!(!text.contains('>'), "{text}");
            assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
            let name = tag.split(' ').next().unwrap_or_default();
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name)),
                None if !tag.ends_with('/') => open.push(name),
                None => {}
            }
        }
        assert!(open.is_empty(), "{open:?}");
    }

    #[test]
    fn what_is_printed_is_drawn_once() {
        let before = "G1 X9 E1|G1 X20|G1 X30 E1|G1 E-1|G1 X50|G1 E1|G1 X60 E1";
        let after = "G1 X9 E1|G1 X20|G1 X30 E1|G1 X50|G1 X60 E1";
        let svg = picture(before, after);
        well_formed(&svg);
        let drawn = ["class=\"bead infill\"", "class=\"travel\"", "class=\"retracted\"", "class=\"order\""]
            .map(|what| count(&svg, what));
        assert_eq!(drawn, [6, 3, 1, 6]);
        assert!(svg.contains("Layer 1, z = 0.00 mm"));
        assert!(svg.contains("retractions<tspan dx=\"7\" font-weight=\"700\" fill=\"#15803d\">−100 %<"));
        assert!(svg.contains("travel<tspan dx=\"7\" font-weight=\"700\" fill=\"#64748b\">same<"));
    }

    proptest! {
        /// Counted from the script that the moves are made from, not from the moves.
        #[test]
        fn counts_are_those_of_the_job(script: Vec<(u8, u8, u8)>) {
            let (mut commands, mut expect, mut way) = ("G1 X1 E.1".to_owned(), [1, 0, 0], 0);
            for (what, x, y) in script {
                // Never twice in one place: a move of no length is none.
                way += 1;
                let to = format!("X{x}.{way:04} Y{y}");
                match what % 4 {
                    0 | 1 => commands += &format!("|G1 {to} E.1"),
                    2 => {
                        commands += &format!("|G1 {to}|G1 X{x}.9 Y{y}.5 E.1");
                        expect = [expect[0] + 1, expect[1] + 1, expect[2]];
                    }
                    _ => {
                        commands += &format!("|G1 E-1|G1 Z1|G1 {to}|G1 Z0|G1 E1|G1 X{x}.9 Y{y}.5 E.1");
                        expect = [expect[0] + 1, expect[1], expect[2] + 1];
                    }
                }
            }
            let svg = svg("a", &Pair { before: paths(&commands), after: Paths::default() });
            well_formed(&svg);
            let drawn = ["class=\"bead", "class=\"travel\"", "class=\"retracted\""].map(|what| count(&svg, what));
            prop_assert_eq!(drawn, expect);
        }
    }

    #[test]
    fn a_name_is_only_text() {
        let pair = Pair { before: paths("G1 X9 E1"), after: paths("G1 X9 E1") };
        let svg = svg("</title><script>alert(1)</script>&\x1b\"'", &pair);
        well_formed(&svg);
        assert_eq!(count(&svg, "<script"), 0);
        assert_eq!(count(&svg, "&lt;script&gt;alert(1)"), 2);
        assert_eq!(count(&super::svg(&"ä".repeat(5000), &pair), "ä"), 2 * NAME_MAX);
    }

    #[test]
    fn an_empty_layer_says_so() {
        let svg = picture("", "");
        well_formed(&svg);
        assert_eq!(count(&svg, "nothing is printed in this layer"), 2);
        assert!(!svg.contains("NaN") && !svg.contains("\"inf"));
        well_formed(&picture("G1 X1 E1", ""));
    }

    #[test]
    fn a_huge_layer_stays_small() {
        let at = |k: u32| [f64::from(k.wrapping_mul(7919) % 250_000) / 1e3, f64::from(k % 211)];
        let bead = Pen::Bead { class: Class::Infill, width_mm: 0.45 };
        let jump = Pen::Jump { retracted: true, lifted: true };
        let stroke = |k: u32| Stroke {
            pen: if k.is_multiple_of(2) { bead } else { jump },
            points: vec![at(k), at(k + 1)],
        };
        let many = Paths { strokes: (0..250_000).map(stroke).collect(), ..Paths::default() };
        let endless = Stroke { pen: bead, points: (0..500_000).map(at).collect() };
        let long = Paths { strokes: vec![endless], ..Paths::default() };
        for paths in [many, long] {
            let svg = svg("huge", &Pair { before: paths.clone(), after: paths });
            well_formed(&svg);
            assert!(svg.len() < 1_000_000, "{} bytes", svg.len());
            assert_eq!(count(&svg, "had no room in this picture"), 2);
        }
    }

    #[test]
    fn wild_coordinates_draw_nothing_wild() {
        let wild = [f64::NAN, f64::INFINITY, 1e300, -1e300];
        let points = wild.iter().flat_map(|&x| wild.map(|y| [x, y])).collect();
        let strokes = vec![Stroke { pen: Pen::Bead { class: Class::Other, width_mm: f64::NAN }, points }];
        let paths = Paths { strokes, ..Paths::default() };
        let svg = svg("wild", &Pair { before: paths.clone(), after: paths });
        well_formed(&svg);
        assert!(!svg.contains("NaN") && !svg.contains("\"inf"));
    }

    #[test]
    fn changes_are_told_in_percent() {
        let check = |before, now, expect: &str| assert_eq!(change(before, now), expect);
        check(50.0, 44.0, "−12 %");
        check(50.0, 50.2, "same");
        check(50.0, 60.0, "+20 %");
        check(0.0, 0.0, "same");
        check(0.0, 3.0, "new");
    }
}
