//! How wide a bead is that the file gives no width for.
//!
//! The bead's cross-section is what is pushed a millimetre of way: ΔE π d² / 4 / length
//! for filament of diameter d. Slicers spread it over the layer's thickness h as a
//! rectangle between two half circles, so that width = area / h + h (1 − π / 4)
//! (Slic3r's and PrusaSlicer's Flow); Cura as a rectangle, width = area / h; threads
//! over air are round.
use super::levels::Stack;
use super::trace::{Path, Trace};
use super::{Facts, Options};
use crate::layers::shape::Point;
use outrigger_gcode::dialect::Dialect;
use std::f64::consts::FRAC_PI_4;

/// Widths outside are no bead's: a drip is thinner, a purge wider. Mm.
const WIDTHS_MM: [f64; 2] = [0.1, 3.0];

/// The usual diameter of filament, mm.
const USUAL_MM: f64 = 1.75;

/// The other one, mm.
const OTHER_MM: f64 = 2.85;

/// Widths that nozzles of 0.2 to 1 mm print, mm.
const LIKELY_MM: std::ops::Range<f64> = 0.22..1.4;

/// A bead's cross-section.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// A rectangle between half circles.
    Rounded,
    Rectangle,
    /// A circle.
    Thread,
}

/// Width of a bead of this cross-section, mm, for areas and heights above 0.
pub(super) fn width_mm(area_mm2: f64, height_mm: f64, shape: Shape) -> f64 {
    let thread = (area_mm2 / FRAC_PI_4).sqrt();
    match shape {
        Shape::Rectangle => area_mm2 / height_mm,
        // Less than a round thread as thick as the layer does not fill its height.
        Shape::Rounded if thread > height_mm => area_mm2 / height_mm + height_mm * (1.0 - FRAC_PI_4),
        Shape::Rounded | Shape::Thread => thread,
    }
}

/// Gives each path its width, for good, and sums up what was found.
pub(super) fn set_widths(trace: &mut Trace, stack: &Stack, options: &Options) -> Facts {
    let told = options.filament_mm.or(trace.filament_mm(0));
    let filament_mm = told.unwrap_or_else(|| likely_filament_mm(trace, stack));
    let section = |path: &Path| section_mm2(trace, path, options.filament_mm, filament_mm);
    let mut extruded_mm3 = 0.0;
    let mut widths_told = true;
    let mut widths = Vec::with_capacity(trace.paths.len());
    for path in &trace.paths {
        let area = section(path);
        extruded_mm3 += area * length_mm(trace.points_of(path));
        let width = if path.width_mm > 0.0 {
            f64::from(path.width_mm)
        } else {
            widths_told = false;
            width_mm(area, stack.thickness_mm(path.sheet), shape(trace, path))
        };
        widths.push(width.clamp(WIDTHS_MM[0], WIDTHS_MM[1]) as f32);
    }
    for (path, width) in trace.paths.iter_mut().zip(widths) {
        path.width_told = path.width_mm > 0.0;
        path.width_mm = width;
    }
    let keys = || trace.sheets.iter().map(|sheet| sheet.key);
    Facts {
        slicer: trace.dialect.map(Dialect::name),
        features_told: trace.features_told,
        widths_told,
        filament_mm,
        filament_told: told.is_some(),
        relative_e_guessed: trace.relative_e_guessed,
        objects_after_another: keys().map(|key| key.pass).max().unwrap_or(0),
        spiral: stack.spiral(),
        beads: trace.beads,
        extruded_mm3,
        lines: trace.lines,
    }
}

/// Cross-section of what is pushed along a path, mm².
fn section_mm2(trace: &Trace, path: &Path, own: Option<f64>, first: f64) -> f64 {
    let diameter = own.or(trace.filament_mm(path.tool)).unwrap_or(first);
    let flow = f64::from(path.flow);
    if trace.volumetric { flow } else { flow * FRAC_PI_4 * diameter * diameter }
}

fn shape(trace: &Trace, path: &Path) -> Shape {
    match trace.dialect {
        _ if trace.sheets[path.sheet as usize].key.bridge => Shape::Thread,
        Some(Dialect::Cura) => Shape::Rectangle,
        _ => Shape::Rounded,
    }
}

/// Way along points, mm.
fn length_mm(points: &[Point]) -> f64 {
    let step = |ends: &[Point]| {
        let ([ax, ay], [bx, by]) = (ends[0].mm(), ends[1].mm());
        (bx - ax).hypot(by - ay)
    };
    points.windows(2).map(step).sum()
}

/// The usual filament, unless its beads would be too thin by half and the other's are right.
fn likely_filament_mm(trace: &Trace, stack: &Stack) -> f64 {
    let mut widths: Vec<(f64, f64)> = trace
        .paths
        .iter()
        .filter(|path| path.width_mm == 0.0)
        .map(|path| {
            let area = section_mm2(trace, path, Some(USUAL_MM), USUAL_MM);
            let width = width_mm(area, stack.thickness_mm(path.sheet), Shape::Rectangle);
            (width, length_mm(trace.points_of(path)))
        })
        .collect();
    widths.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let half = widths.iter().map(|w| w.1).sum::<f64>() / 2.0;
    let mut before = 0.0;
    let middle = widths.iter().find(|w| {
        before += w.1;
        before >= half
    });
    let ratio = (OTHER_MM / USUAL_MM) * (OTHER_MM / USUAL_MM);
    match middle {
        Some(&(width, _)) if width < LIKELY_MM.start && LIKELY_MM.contains(&(width * ratio)) => OTHER_MM,
        _ => USUAL_MM,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_of_known_beads() {
        let check = |area: f64, height: f64, shape: Shape, expect: f64| {
            let width = width_mm(area, height, shape);
            assert!((width - expect).abs() < 1e-9, "{area} {height} {shape:?}: {width}");
        };
        check(0.08, 0.2, Shape::Rectangle, 0.4);
        // 0.25 wide between half circles of 0.2.
        check(0.05 + FRAC_PI_4 * 0.04, 0.2, Shape::Rounded, 0.45);
        check(FRAC_PI_4 * 0.04, 0.2, Shape::Rounded, 0.2);
        check(FRAC_PI_4 * 0.01, 0.2, Shape::Rounded, 0.1);
        check(FRAC_PI_4 * 0.16, 0.2, Shape::Thread, 0.4);
    }
}
