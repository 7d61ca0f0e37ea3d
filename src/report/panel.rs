//! One side of the picture: a layer's strokes to scale, in a frame.
//!
//! Takes strokes in mm and a [`Frame`], appends SVG elements to a text of bounded
//! length. What is on top is drawn last: beads, travels, retracted travels, then
//! marks.
use super::frame::Frame;
use super::strokes::{Class, Paths, Pen, Stroke};
use super::svg::{Rgb, between, hex, number};
use crate::toolpath::bead::{Point, distance_mm};
use std::collections::HashSet;
use std::fmt::Write;

/// Room for the beads of one side, bytes. With that of the travels and their
/// arrows, twice, a picture stays below 900 kB, which light viewers still show.
const BEAD_BYTES: usize = 290_000;

/// Room for the travels of one side, bytes; their arrows take half as much again at most.
const TRAVEL_BYTES: usize = 90_000;

/// Up to so many beads of infill are numbered; more numbers would hide them.
const NUMBERED_MAX: usize = 60;

/// A retracted travel shorter than this has no arrow, px: it would cover it.
const ARROW_FROM_PX: f64 = 22.0;

/// Length of an arrow, px.
const ARROW_PX: f64 = 9.0;

/// Widest bead drawn, mm: what a file says beyond this is a slip.
const WIDTH_MAX_MM: f64 = 3.0;

/// How strongly a jump shows that is on both sides: what changed stands out.
const SHARED_OPACITY: f64 = 0.35;

/// A bead's width where the file does not say it, mm: that of a 0.4 mm nozzle.
const WIDTH_MM: f64 = 0.45;

/// Part of a bead's width that is drawn, so that neighbours stay apart.
const WIDTH_SHARE: f64 = 0.8;

/// Travel without retraction.
pub(super) const TRAVEL: Rgb = [0x33, 0x41, 0x55];

/// Travel with the filament pulled back.
pub(super) const RETRACTED: Rgb = [0xd9, 0x04, 0x4f];

/// Width of a travel's line, px.
pub(super) const TRAVEL_WIDTH: f64 = 1.2;

/// Width of a retracted travel's line, px.
pub(super) const RETRACTED_WIDTH: f64 = 1.8;

/// The colours of a class, of its first bead and its last.
pub(super) fn ramp(class: Class) -> [Rgb; 2] {
    match class {
        Class::Perimeter => [[0xcb, 0xd8, 0xe6], [0x8f, 0xa8, 0xc4]],
        Class::Infill => [[0xfd, 0xe6, 0x8a], [0xd9, 0x77, 0x06]],
        Class::Solid => [[0xb6, 0xe9, 0xdc], [0x0f, 0x91, 0x80]],
        Class::Other => [[0xe2, 0xe2, 0xe2], [0xb0, 0xb0, 0xb0]],
    }
}

/// The name of a class in the picture's elements.
fn name(class: Class) -> &'static str {
    match class {
        Class::Perimeter => "perimeter",
        Class::Infill => "infill",
        Class::Solid => "solid",
        Class::Other => "other",
    }
}

/// Appends a layer's strokes. Jumps that the `other` side has too step back.
/// Gives how many strokes had no room.
pub(super) fn draw(out: &mut String, paths: &Paths, other: &Paths, frame: &Frame) -> usize {
    let strokes = &paths.strokes;
    let others: HashSet<Ends> = other.strokes.iter().filter_map(jump_ends).collect();
    let mut left_out = beads(out, strokes, frame);
    for (retracted, shared) in [(false, true), (true, true), (false, false), (true, false)] {
        let wanted = |stroke: &&Stroke| {
            matches!(stroke.pen, Pen::Jump { retracted: r, .. } if r == retracted)
                && jump_ends(stroke).is_some_and(|ends| others.contains(&ends)) == shared
        };
        left_out += jumps(out, strokes.iter().filter(wanted), frame, retracted, shared);
    }
    numbers(out, strokes, frame);
    ends(out, strokes, frame);
    left_out
}

fn beads(out: &mut String, strokes: &[Stroke], frame: &Frame) -> usize {
    let limit = out.len() + BEAD_BYTES;
    let count =
        |class| strokes.iter().filter(|s| matches!(s.pen, Pen::Bead { class: c, .. } if c == class)).count();
    let classes = [Class::Perimeter, Class::Infill, Class::Solid, Class::Other];
    let totals = classes.map(count);
    let mut drawn = [0_usize; 4];
    let mut left_out = 0;
    out.push_str("<g fill=\"none\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n");
    for stroke in strokes {
        let Pen::Bead { class, width_mm } = stroke.pen else { continue };
        let k = class as usize;
        let part = drawn[k] as f64 / totals[k].saturating_sub(1).max(1) as f64;
        drawn[k] += 1;
        let before = out.len();
        let [first, last] = ramp(class);
        let _ = write!(
            out,
            "<path class=\"bead {}\" stroke=\"{}\"",
            name(class),
            hex(between(first, last, part))
        );
        let width_mm = if width_mm > 0.0 { width_mm.min(WIDTH_MAX_MM) } else { WIDTH_MM };
        out.push_str(" stroke-width=\"");
        number(out, (width_mm * WIDTH_SHARE * frame.scale()).max(0.5));
        out.push_str("\" d=\"");
        if frame.path(out, &stroke.points, limit) {
            out.push_str("\"/>\n");
        } else {
            out.truncate(before);
            left_out += 1;
        }
    }
    out.push_str("</g>\n");
    left_out
}

/// Where a jump begins and ends, to a hundredth of a millimetre, the lesser end first.
type Ends = [[i64; 2]; 2];

fn jump_ends(stroke: &Stroke) -> Option<Ends> {
    let Pen::Jump { .. } = stroke.pen else { return None };
    // A float cast saturates: no coordinate is too wild.
    let place = |point: &Point| point.map(|c| (c * 100.0).round() as i64);
    let mut ends = [place(stroke.points.first()?), place(stroke.points.last()?)];
    ends.sort_unstable();
    Some(ends)
}

fn jumps<'a>(
    out: &mut String,
    strokes: impl Iterator<Item = &'a Stroke>,
    frame: &Frame,
    retracted: bool,
    shared: bool,
) -> usize {
    let limit = out.len() + TRAVEL_BYTES / 4;
    let mut left_out = 0;
    let (class, colour, width) =
        if retracted { ("retracted", RETRACTED, RETRACTED_WIDTH) } else { ("travel", TRAVEL, TRAVEL_WIDTH) };
    let opacity = if shared { SHARED_OPACITY } else { 1.0 };
    let colour = hex(colour);
    let _ = writeln!(
        out,
        "<g fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" \
         opacity=\"{opacity}\">"
    );
    let mut arrows = String::new();
    for stroke in strokes {
        let before = out.len();
        let _ = write!(out, "<path class=\"{class}\" d=\"");
        if frame.path(out, &stroke.points, limit) {
            out.push_str("\"/>\n");
            if retracted && arrows.len() < TRAVEL_BYTES / 8 {
                arrow(&mut arrows, &stroke.points, frame);
            }
        } else {
            out.truncate(before);
            left_out += 1;
        }
    }
    if !arrows.is_empty() {
        let _ = writeln!(out, "<path fill=\"{colour}\" stroke=\"none\" d=\"{arrows}\"/>");
    }
    out.push_str("</g>\n");
    left_out
}

/// Appends an arrow head in the middle of the longest straight piece, where it is long enough.
fn arrow(out: &mut String, points: &[Point], frame: &Frame) {
    let length = |w: &[Point]| distance_mm(w[0], w[1]);
    let Some(longest) = points.windows(2).max_by(|a, b| length(a).total_cmp(&length(b))) else { return };
    let (from, to) = (frame.place(longest[0]), frame.place(longest[1]));
    let long = distance_mm(from, to);
    if !long.is_finite() || long < ARROW_FROM_PX {
        return;
    }
    let along = [(to[0] - from[0]) / long, (to[1] - from[1]) / long];
    let tip = [0, 1].map(|k| f64::midpoint(from[k], to[k]) + along[k] * ARROW_PX / 2.0);
    let side = |sign: f64| {
        let (back, out) = (ARROW_PX, ARROW_PX * 0.42 * sign);
        [tip[0] - along[0] * back - along[1] * out, tip[1] - along[1] * back + along[0] * out]
    };
    for (letter, [x, y]) in [('M', tip), ('L', side(1.0)), ('L', side(-1.0))] {
        out.push(letter);
        number(out, x);
        out.push(' ');
        number(out, y);
    }
    out.push('z');
}

/// Numbers the beads of infill in their order, where few.
fn numbers(out: &mut String, strokes: &[Stroke], frame: &Frame) {
    let is_infill = |s: &&Stroke| matches!(s.pen, Pen::Bead { class: Class::Infill | Class::Solid, .. });
    if strokes.iter().filter(is_infill).count() > NUMBERED_MAX {
        return;
    }
    let _ =
        writeln!(out, "<g font-size=\"9.5\" font-weight=\"700\" fill=\"#7c2d12\" text-anchor=\"middle\">");
    for (k, stroke) in strokes.iter().filter(is_infill).enumerate() {
        let Some(&first) = stroke.points.first() else { continue };
        let [x, y] = frame.place(first);
        let (n, baseline) = (k + 1, y + 3.4);
        let _ = writeln!(
            out,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"7.2\" fill=\"#fff\" fill-opacity=\"0.88\" stroke=\"#c2a36b\" \
             stroke-width=\"0.7\"/><text class=\"order\" x=\"{x:.1}\" y=\"{baseline:.1}\">{n}</text>"
        );
    }
    out.push_str("</g>\n");
}

/// Where the layer begins: a ring. Where it ends: a square.
fn ends(out: &mut String, strokes: &[Stroke], frame: &Frame) {
    if let Some(&first) = strokes.first().and_then(|s| s.points.first()) {
        let [x, y] = frame.place(first);
        begin_mark(out, x, y);
    }
    if let Some(&last) = strokes.last().and_then(|s| s.points.last()) {
        let [x, y] = frame.place(last);
        end_mark(out, x, y);
    }
}

/// The ring.
pub(super) fn begin_mark(out: &mut String, x: f64, y: f64) {
    let _ = writeln!(
        out,
        "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"5\" fill=\"#fff\" stroke=\"#0f172a\" stroke-width=\"2\"/>"
    );
}

/// The square.
pub(super) fn end_mark(out: &mut String, x: f64, y: f64) {
    let _ = writeln!(
        out,
        "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"9\" height=\"9\" fill=\"#0f172a\" stroke=\"#fff\" stroke-width=\"1\"/>",
        x - 4.5,
        y - 4.5
    );
}
