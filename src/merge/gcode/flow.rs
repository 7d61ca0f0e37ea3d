//! Between a bead's width and its cross-section.
//!
//! A bead is a rectangle between two half circles, area = (w − h) h + π h² / 4 (Slic3r's
//! and PrusaSlicer's Flow); Cura takes it for a rectangle, area = w h.
use outrigger_gcode::dialect::Dialect;
use std::f64::consts::FRAC_PI_4;

/// What a slicer takes beads for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::merge) enum Shape {
    Rounded,
    Rectangle,
}

impl Shape {
    pub(in crate::merge) fn of(dialect: Dialect) -> Shape {
        if dialect == Dialect::Cura { Shape::Rectangle } else { Shape::Rounded }
    }

    /// Cross-section of a bead, mm².
    pub(in crate::merge) fn area_mm2(self, width_mm: f64, height_mm: f64) -> f64 {
        match self {
            Shape::Rectangle => width_mm * height_mm,
            Shape::Rounded if width_mm > height_mm => {
                (width_mm - height_mm) * height_mm + FRAC_PI_4 * height_mm * height_mm
            }
            // Thinner than the layer: a thread.
            Shape::Rounded => FRAC_PI_4 * width_mm * width_mm,
        }
    }

    /// Width of a bead, mm.
    pub(in crate::merge) fn width_mm(self, area_mm2: f64, height_mm: f64) -> f64 {
        let thread = (area_mm2 / FRAC_PI_4).max(0.0).sqrt();
        match self {
            Shape::Rectangle => area_mm2 / height_mm,
            Shape::Rounded if thread > height_mm => area_mm2 / height_mm + height_mm * (1.0 - FRAC_PI_4),
            Shape::Rounded => thread,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn widths_come_back() {
        let check = |shape: Shape, width: f64, height: f64, area: f64| {
            let got = shape.area_mm2(width, height);
            assert!((got - area).abs() < 1e-9, "{shape:?} {width} {height}: {got}");
            assert!((shape.width_mm(got, height) - width).abs() < 1e-9);
        };
        check(Shape::Rectangle, 0.4, 0.2, 0.08);
        check(Shape::Rounded, 0.45, 0.2, 0.05 + FRAC_PI_4 * 0.04);
        check(Shape::Rounded, 0.1, 0.2, FRAC_PI_4 * 0.01);
    }
}
