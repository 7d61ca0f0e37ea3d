//! What the colours and lines of the picture mean.
use super::panel::{RETRACTED, RETRACTED_WIDTH, TRAVEL, TRAVEL_WIDTH, begin_mark, end_mark, ramp};
use super::paths::{FAINT, MARGIN, WIDTH};
use super::strokes::Class;
use super::svg::{between, hex, text};
use std::fmt::Write;

/// Appends the legend, from `y` px down.
pub(super) fn legend(out: &mut String, y: f64) {
    let faint = format!("font-size=\"13\" fill=\"{FAINT}\"");
    let _ = writeln!(out, "<path d=\"M{MARGIN} {y:.1}H{:.1}\" stroke=\"#d5dce6\"/>", WIDTH - MARGIN);
    let y = y + 30.0;
    let classes = [
        (0.0, Class::Perimeter, "perimeters"),
        (140.0, Class::Infill, "infill"),
        (244.0, Class::Solid, "solid infill, gap fill"),
        (442.0, Class::Other, "skirt, support, other"),
    ];
    for (x, class, name) in classes {
        swatch(out, class, MARGIN + x, y);
        text(out, MARGIN + x + 44.0, y, &faint, name);
    }
    let travels = [
        (650.0, TRAVEL, TRAVEL_WIDTH, "travel"),
        (764.0, RETRACTED, RETRACTED_WIDTH, "travel, filament pulled back"),
    ];
    for (x, colour, width, name) in travels {
        let (x, y, colour) = (MARGIN + x, y - 4.5, hex(colour));
        let _ = writeln!(out, "<path d=\"M{x:.1} {y:.1}h34\" stroke=\"{colour}\" stroke-width=\"{width}\"/>");
        text(out, x + 42.0, y + 4.5, &faint, name);
    }
    let x = MARGIN + 1030.0;
    begin_mark(out, x, y - 4.5);
    text(out, x + 12.0, y, &faint, "begin");
    end_mark(out, x + 80.0, y - 4.5);
    text(out, x + 92.0, y, &faint, "end");
    text(
        out,
        MARGIN,
        y + 30.0,
        &faint,
        "Light to dark, and by number: the order of printing. Pale travels are the same on both sides. Figures: from the layer's first bead to its last.",
    );
}

/// The colours of a class from first to last.
fn swatch(out: &mut String, class: Class, x: f64, y: f64) {
    const STEPS: u32 = 4;
    let [first, last] = ramp(class);
    for step in 0..STEPS {
        let part = f64::from(step) / f64::from(STEPS - 1);
        let _ = writeln!(
            out,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"9\" height=\"12\" fill=\"{}\"/>",
            x + f64::from(step) * 9.0,
            y - 10.5,
            hex(between(first, last, part))
        );
    }
}
