//! A file's own habits of retracting: from the settings that it carries, or failing those from its moves.
use outrigger_gcode::dialect::settings::{number_for_tool, setting};
use outrigger_gcode::dialect::{Dialect, Feature, Mark};
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine};
use std::io::BufRead;

/// How far the file goes without pulling the filament back.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct FileHabits {
    /// `retract_before_travel`, one for each tool, as written.
    before_travel: Option<String>,
    /// Travels within the part are not retracted however long they are.
    only_when_crossing: bool,
    /// Learned where there are no settings.
    learned: Option<Learned>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Learned {
    /// Shortest travel with a retraction, mm; infinite where there is none.
    shortest_retracted_mm: f64,
    /// Longest travel without one between infill beads of one kind, mm.
    longest_free_mm: f64,
}

impl FileHabits {
    /// Longest travel that crosses nothing and goes without a retraction, mm.
    ///
    /// By `retract_before_travel`; without settings by the file itself: the shortest
    /// length at which it retracts, or the longest at which it does not between
    /// beads of one infill, where that is more (Cura's combing goes any way inside
    /// the part without retracting).
    #[must_use]
    pub fn free_within_mm(&self, tool: u16) -> f64 {
        if self.only_when_crossing {
            return f64::INFINITY;
        }
        if let Some(mm) = self.before_travel.as_deref().and_then(|v| number_for_tool(v, tool)) {
            return mm;
        }
        self.learned.map_or(0.0, |l| l.shortest_retracted_mm.max(l.longest_free_mm))
    }

    /// Whether the settings were enough, or the moves must be read.
    #[must_use]
    pub fn is_known(&self) -> bool {
        self.before_travel.is_some()
    }

    /// Reads the settings in a stretch of the file (its beginning or its end).
    pub fn read_settings(&mut self, text: &[u8]) {
        for bytes in split_lines(text) {
            // Settings are comments; the moves between need not be parsed.
            if !bytes.trim_ascii_start().starts_with(b";") {
                continue;
            }
            let line = parse(bytes);
            match setting(&line) {
                Some(("retract_before_travel" | "retraction_minimum_travel", value))
                    if number_for_tool(value, 0).is_some() =>
                {
                    self.before_travel = Some(value.to_owned());
                }
                Some(("only_retract_when_crossing_perimeters" | "reduce_infill_retraction", value)) => {
                    self.only_when_crossing = value.starts_with('1');
                }
                _ => {}
            }
        }
    }

    /// Learns from all the moves of a file.
    ///
    /// # Errors
    /// The reader's.
    pub fn learn(&mut self, mut reader: impl BufRead, dialect: Dialect) -> std::io::Result<()> {
        let mut scan = Scan::new(dialect);
        let mut bytes = Vec::new();
        loop {
            bytes.clear();
            let limit = super::annotate::MAX_LINE_BYTES as u64;
            if std::io::Read::take(&mut reader, limit).read_until(b'\n', &mut bytes)? == 0 {
                break;
            }
            scan.line(&bytes);
        }
        self.learned = Some(scan.learned);
        Ok(())
    }
}

/// Follows the moves and looks at each jump.
struct Scan {
    dialect: Dialect,
    machine: Machine,
    feature: Feature,
    learned: Learned,
    /// XY length since the last deposit, mm, and the feature of that deposit.
    travel_mm: f64,
    left: Feature,
    retracted: bool,
}

impl Scan {
    fn new(dialect: Dialect) -> Scan {
        Scan {
            dialect,
            machine: Machine::default(),
            feature: Feature::Unknown,
            learned: Learned { shortest_retracted_mm: f64::INFINITY, longest_free_mm: 0.0 },
            travel_mm: 0.0,
            left: Feature::Unknown,
            retracted: false,
        }
    }

    fn line(&mut self, bytes: &[u8]) {
        let line = parse(bytes);
        if !line.comment.is_empty()
            && let Some(Mark::Feature(f) | Mark::Inline(f)) = self.dialect.mark(&line)
        {
            self.feature = f;
        }
        match self.machine.apply(&line) {
            Effect::Motion(m) => match m.kind() {
                Kind::Deposit => self.deposit(),
                Kind::Travel => self.travel_mm += m.length_mm() * f64::from(u8::from(m.moves_xy())),
                Kind::Wipe => self.retracted = true,
                Kind::Filament => self.retracted |= m.e < 0.0,
                Kind::Still => {}
            },
            Effect::FirmwareRetract => self.retracted = true,
            _ => {}
        }
    }

    fn deposit(&mut self) {
        if self.travel_mm > 0.0 && self.left.is_part() {
            let learned = &mut self.learned;
            if self.retracted {
                learned.shortest_retracted_mm = learned.shortest_retracted_mm.min(self.travel_mm);
            } else if self.left == self.feature && self.feature == Feature::Infill {
                learned.longest_free_mm = learned.longest_free_mm.max(self.travel_mm);
            }
        }
        self.travel_mm = 0.0;
        self.retracted = false;
        self.left = self.feature;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_come_first() {
        let check = |text: &str, tool: u16, expect: f64| {
            let mut habits = FileHabits::default();
            habits.read_settings(text.as_bytes());
            assert_eq!(habits.free_within_mm(tool), expect, "{text}");
            assert!(habits.is_known());
        };
        check("; retract_before_travel = 1,2\n", 0, 1.0);
        check("; retract_before_travel = 1,2\n", 1, 2.0);
        check("; retraction_minimum_travel = 1.5\n", 3, 1.5);
        check("; only_retract_when_crossing_perimeters = 1\n; retract_before_travel = 2\n", 0, f64::INFINITY);
        check("; only_retract_when_crossing_perimeters = 0\n; retract_before_travel = 2\n", 0, 2.0);
    }

    #[test]
    fn without_settings_the_moves_tell() {
        let check = |body: &str, expect: f64| {
            let mut habits = FileHabits::default();
            let text = format!(";TYPE:FILL\nG1 X1 E1\n{body}");
            habits.learn(text.as_bytes(), Dialect::Cura).unwrap();
            assert_eq!(habits.free_within_mm(0), expect, "{body}");
            assert!(!habits.is_known());
        };
        check("", f64::INFINITY);
        check("G1 E0\nG0 X4\nG1 E1\nG1 X5 E2\n", 3.0);
        check("G0 X9\nG1 X10 E2\nG1 E1\nG0 X12\nG1 E2\nG1 X13 E3\n", 8.0);
        check("G0 X9\n;TYPE:SKIN\nG1 X10 E2\nG1 E1\nG0 X12\nG1 E2\nG1 X13 E3\n", 2.0);
    }
}
