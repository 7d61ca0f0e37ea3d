//! One of two texts that a proof compares: what its lines have done so far.
use outrigger_gcode::dialect::{Dialect, Feature, Mark};
use outrigger_gcode::line::Line;
use outrigger_gcode::state::{Effect, Kind, Machine};

/// Lengths that differ by less are the same, mm.
pub(in crate::merge) const UNIT_MM: f64 = 1e-6;

/// Filament pulled back by less is pushed again but for rounding: a slicer's wipes are sums
/// of rounded numbers, mm.
pub(in crate::merge) const PULLED_MM: f64 = 0.01;

/// Whether two places are the same, mm.
pub(in crate::merge) fn near(a: [f64; 3], b: [f64; 3]) -> bool {
    (0..3).all(|k| (a[k] - b[k]).abs() < UNIT_MM)
}

/// What is in force beside the machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::merge) struct Context {
    pub(in crate::merge) feature: Feature,
    pub(in crate::merge) width_mm: f64,
    pub(in crate::merge) height_mm: f64,
}

/// One of the two texts.
pub(in crate::merge) struct Side {
    pub(in crate::merge) machine: Machine,
    pub(in crate::merge) context: Context,
    /// Filament pulled back, mm; since the last bead.
    pub(in crate::merge) depth_mm: f64,
    pub(in crate::merge) deepest_mm: f64,
    pub(in crate::merge) fastest: f64,
}

impl Side {
    pub(in crate::merge) fn new() -> Side {
        let context = Context { feature: Feature::Unknown, width_mm: 0.0, height_mm: 0.0 };
        Side { machine: Machine::default(), context, depth_mm: 0.0, deepest_mm: 0.0, fastest: 0.0 }
    }

    pub(in crate::merge) fn read(&mut self, line: &Line<'_>, dialect: Dialect) -> Effect {
        match dialect.mark(line) {
            Some(Mark::Feature(feature) | Mark::Inline(feature)) => self.context.feature = feature,
            Some(Mark::Width(mm)) => self.context.width_mm = mm,
            Some(Mark::Height(mm)) => self.context.height_mm = mm,
            _ => {}
        }
        let effect = self.machine.apply(line);
        if let Effect::Motion(m) = effect {
            self.depth_mm = if m.kind() == Kind::Deposit { 0.0 } else { (self.depth_mm - m.e).max(0.0) };
            self.deepest_mm = self.deepest_mm.max(self.depth_mm);
            self.fastest = self.fastest.max(m.feed);
        }
        effect
    }
}
