//! Whether a file prints its objects one after the other.
//!
//! Takes the moves of a job in order, tells whether the head has gone down beside
//! something that was finished. Knows no slicer's words for it: PrusaSlicer's
//! `complete_objects` and Cura's `print_sequence` both end in this.
use outrigger_gcode::state::{Kind, Move};

/// Layers of supports and of different heights lie less than this below the highest
/// bead so far; the next object begins further down, mm. Objects finished below this
/// height are in nobody's way once Z was raised.
pub const DROP_MM: f64 = 2.0;

/// The detector.
#[derive(Debug, Clone, Copy, Default)]
pub struct OneByOne {
    highest_mm: Option<f64>,
    found: bool,
    printed: bool,
}

impl OneByOne {
    /// One move of the job.
    pub fn see(&mut self, m: &Move) {
        if m.kind() != Kind::Deposit {
            return;
        }
        self.printed = true;
        let z = m.to[2];
        match self.highest_mm {
            Some(highest) if z < highest - DROP_MM => self.found = true,
            Some(highest) if z <= highest => {}
            _ => self.highest_mm = Some(z),
        }
    }

    /// An object was finished before the last move.
    pub fn found(&self) -> bool {
        self.found
    }

    /// Anything was printed at all.
    pub fn printed(&self) -> bool {
        self.printed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use outrigger_gcode::line::parse;
    use outrigger_gcode::state::{Effect, Machine};

    fn check(lines: &[&str], expect: bool) {
        let (mut machine, mut seen) = (Machine::default(), OneByOne::default());
        machine.apply(&parse(b"M83"));
        for line in lines {
            if let Effect::Motion(m) = machine.apply(&parse(line.as_bytes())) {
                seen.see(&m);
            }
        }
        assert_eq!(seen.found(), expect, "{lines:?}");
    }

    #[test]
    fn the_head_that_goes_down_again_has_finished_something() {
        // Layer by layer, with z-hops and a purge line above the first layer.
        check(
            &["G1 Z0.3", "G1 X9 E1", "G1 Z0.2", "G1 X1 E1", "G1 Z9", "G1 X5", "G1 Z0.4", "G1 X2 E1"],
            false,
        );
        // Spiral vase.
        check(&["G1 X1 Z0.2 E1", "G1 X2 Z0.3 E1", "G1 X3 Z9 E1", "G1 X4 Z9.1 E1"], false);
        // Two objects.
        check(&["G1 Z0.2", "G1 X1 E1", "G1 Z12", "G1 X2 E1", "G1 Z0.2", "G1 X50 E1"], true);
        // The second object was not begun.
        check(&["G1 Z0.2", "G1 X1 E1", "G1 Z12", "G1 X2 E1", "G1 Z0.2", "G1 X50"], false);
    }
}
