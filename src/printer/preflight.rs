//! What of a job its printer could not do, or should not: found before the first line is sent.
//!
//! Takes what a printer and its material bear, as plain values, and the lines of a job as
//! [`super::job_file::check`] gives them; gives [`Finding`]s, one for each kind, with the first
//! line and the worst value.
//!
//! Choices:
//! - Only beads count as outside the volume. Printers park and purge beside the bed, and
//!   firmware stops a travel at its ends; lines before the first layer mark are the start
//!   G-code's own, where there are such marks.
//! - What a macro does (Klipper's `START_PRINT`, `END_PRINT`) is not known: a temperature that
//!   no line of the file sets is not judged, and after a macro at the end nothing is said of
//!   heaters.
use outrigger_gcode::dialect::{LayerMark, layer_mark};
use outrigger_gcode::line::{Command, Line, parse};
use outrigger_gcode::state::{Effect, Kind as MoveKind, Machine, Move};

/// How far the middle of a bead may lie beyond the border, mm: rounding, and half of a bead.
const SLACK_MM: f64 = 0.5;

/// Temperatures this near to a limit are within it, °C.
const SLACK_C: f64 = 0.5;

/// Where a printer can print.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Volume {
    /// Lowest X, Y, mm; Z begins at 0.
    pub low_mm: [f64; 2],
    /// Highest X, Y, Z, mm.
    pub high_mm: [f64; 3],
    /// The bed is the disc that fits between these.
    pub round: bool,
}

impl Volume {
    /// How far a place of the plate lies outside, mm; 0 inside.
    fn beyond_mm(&self, [x, y]: [f64; 2]) -> f64 {
        let middle = [0, 1].map(|k| (self.low_mm[k] + self.high_mm[k]) / 2.0);
        if self.round {
            let radius = (self.high_mm[0] - self.low_mm[0]) / 2.0;
            return ((x - middle[0]).hypot(y - middle[1]) - radius).max(0.0);
        }
        let out = |k: usize, c: f64| (self.low_mm[k] - c).max(c - self.high_mm[k]);
        out(0, x).max(out(1, y)).max(0.0)
    }
}

/// At what temperatures a material is printed, lowest and highest, °C.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Melts {
    /// Of the nozzle.
    pub nozzle_c: [f64; 2],
    /// Of the bed.
    pub bed_c: [f64; 2],
}

/// What a printer bears.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bears {
    /// Where it can print.
    pub volume: Volume,
    /// Hottest nozzle, °C.
    pub nozzle_max_c: f64,
    /// Hottest bed, °C.
    pub bed_max_c: f64,
    /// What is in it, if that is known.
    pub material: Option<Melts>,
    /// The host sends commands of its own after the job, which end it.
    pub ends_jobs: bool,
}

/// What is wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A bead lies beside the bed: by how much, mm.
    OutsideBed,
    /// A bead lies above what can be reached: its height, mm.
    AboveTop,
    /// A nozzle hotter than the printer bears, °C.
    NozzleTooHot,
    /// A bed hotter than the printer bears, °C.
    BedTooHot,
    /// A nozzle hotter than the material bears, °C.
    NozzleAboveMaterial,
    /// A bed hotter than the material bears, °C.
    BedAboveMaterial,
    /// Beads with a nozzle colder than the material melts, °C.
    NozzleBelowMaterial,
    /// The job ends and leaves heaters on: the hottest, °C.
    HeatersLeftOn,
    /// The job ends with a bead.
    CutShort,
}

impl Kind {
    /// One word for machines.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Kind::OutsideBed => "outside_bed",
            Kind::AboveTop => "above_top",
            Kind::NozzleTooHot => "nozzle_too_hot",
            Kind::BedTooHot => "bed_too_hot",
            Kind::NozzleAboveMaterial => "nozzle_above_material",
            Kind::BedAboveMaterial => "bed_above_material",
            Kind::NozzleBelowMaterial => "nozzle_below_material",
            Kind::HeatersLeftOn => "heaters_left_on",
            Kind::CutShort => "cut_short",
        }
    }

    /// It is told of a job whose end was read.
    #[must_use]
    pub fn is_of_the_end(self) -> bool {
        matches!(self, Kind::HeatersLeftOn | Kind::CutShort)
    }
}

/// Something that is wrong with a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finding {
    /// What.
    pub kind: Kind,
    /// The first line of the file, from 1, where it is so.
    pub line: u64,
    /// Lines in all.
    pub lines: u64,
    /// The worst value, in the unit of the kind; 0 where there is none.
    pub worst: f64,
}

impl Finding {
    /// For people.
    #[must_use]
    pub fn words(&self, bears: &Bears) -> String {
        let Finding { line, worst, .. } = *self;
        let material = bears.material.unwrap_or(Melts { nozzle_c: [0.0; 2], bed_c: [0.0; 2] });
        let what = match self.kind {
            Kind::OutsideBed => format!(
                "it prints up to {worst:.1} mm beside the bed: move the part, or slice for this printer"
            ),
            Kind::AboveTop => format!(
                "it prints at Z {worst:.1} mm, above the {:.0} mm that this printer reaches",
                bears.volume.high_mm[2]
            ),
            Kind::NozzleTooHot => {
                format!("the nozzle goes to {worst:.0} °C, and this printer bears {:.0}", bears.nozzle_max_c)
            }
            Kind::BedTooHot if bears.bed_max_c == 0.0 => {
                format!("the bed goes to {worst:.0} °C, and this one has no heater")
            }
            Kind::BedTooHot => {
                format!("the bed goes to {worst:.0} °C, and this printer bears {:.0}", bears.bed_max_c)
            }
            Kind::NozzleAboveMaterial => format!(
                "the nozzle goes to {worst:.0} °C, and the material bears {:.0}",
                material.nozzle_c[1]
            ),
            Kind::BedAboveMaterial => {
                format!("the bed goes to {worst:.0} °C, and the material bears {:.0}", material.bed_c[1])
            }
            Kind::NozzleBelowMaterial => format!(
                "it prints with the nozzle at {worst:.0} °C, and the material melts from {:.0} on",
                material.nozzle_c[0]
            ),
            Kind::HeatersLeftOn => format!("it ends with a heater at {worst:.0} °C: nothing switches it off"),
            Kind::CutShort => "it ends in the middle of printing: the file may be cut short".to_owned(),
        };
        format!("line {line}: {what}")
    }
}

/// Looks at a job line by line.
#[derive(Clone, Debug)]
pub struct Preflight {
    bears: Bears,
    machine: Machine,
    /// Targets that the file has set, °C.
    nozzle_c: Option<f64>,
    bed_c: Option<f64>,
    found: Vec<Finding>,
    layers_marked: bool,
    last_bead: u64,
    last_command: u64,
    /// A macro came after the last bead.
    ended_by_macro: bool,
}

impl Preflight {
    /// For a printer that bears this.
    #[must_use]
    pub fn new(bears: Bears) -> Preflight {
        Preflight {
            bears,
            machine: Machine::default(),
            nozzle_c: None,
            bed_c: None,
            found: Vec::new(),
            layers_marked: false,
            last_bead: 0,
            last_command: 0,
            ended_by_macro: false,
        }
    }

    /// The next line, with its number from 1 and comments.
    pub fn line(&mut self, number: u64, bytes: &[u8]) {
        let line = parse(bytes);
        match line.command {
            Command::None | Command::Unknown => {
                let mark = layer_mark(line.comment_text());
                if matches!(mark, Some(LayerMark::Change | LayerMark::Cura)) && !self.layers_marked {
                    self.layers_marked = true;
                    // What came before were the start G-code's own beads.
                    self.found.retain(|f| {
                        !matches!(f.kind, Kind::OutsideBed | Kind::AboveTop | Kind::NozzleBelowMaterial)
                    });
                }
                return;
            }
            Command::Named(_) => self.ended_by_macro = true,
            Command::Classic { letter: b'M', number: code, sub: None } => self.heat(number, code, &line),
            Command::Classic { .. } => {}
        }
        self.last_command = number;
        if let Effect::Motion(moved) = self.machine.apply(&line)
            && moved.kind() == MoveKind::Deposit
        {
            self.bead(number, &moved);
        }
    }

    fn heat(&mut self, number: u64, code: u16, line: &Line<'_>) {
        let is_nozzle = matches!(code, 104 | 109);
        if !is_nozzle && !matches!(code, 140 | 190) {
            return;
        }
        let value = |letter: u8| line.words.get(letter);
        let Some(c) = value(b'S').or_else(|| value(b'R')) else { return };
        let material = self.bears.material;
        let (most, range, hot, above) = if is_nozzle {
            let range = material.map(|m| m.nozzle_c);
            (self.bears.nozzle_max_c, range, Kind::NozzleTooHot, Kind::NozzleAboveMaterial)
        } else {
            (self.bears.bed_max_c, material.map(|m| m.bed_c), Kind::BedTooHot, Kind::BedAboveMaterial)
        };
        if c > most + SLACK_C {
            self.note(hot, number, c);
        } else if range.is_some_and(|[_, highest]| c > highest + SLACK_C) {
            self.note(above, number, c);
        }
        // Of several tools only the one that prints is judged by what it prints at.
        let own = value(b'T').is_none_or(|tool| tool == f64::from(self.machine.tool));
        match is_nozzle {
            true if own => self.nozzle_c = Some(c),
            true => {}
            false => self.bed_c = Some(c),
        }
    }

    fn bead(&mut self, number: u64, moved: &Move) {
        (self.last_bead, self.ended_by_macro) = (number, false);
        let volume = self.bears.volume;
        let mut beyond = 0.0_f64;
        moved.chords(|from, to| beyond = beyond.max(volume.beyond_mm(from)).max(volume.beyond_mm(to)));
        if beyond > SLACK_MM {
            self.note(Kind::OutsideBed, number, beyond);
        }
        let z_mm = moved.from[2].max(moved.to[2]);
        if z_mm > volume.high_mm[2] + SLACK_MM {
            self.note(Kind::AboveTop, number, z_mm);
        }
        if let (Some(c), Some(melts)) = (self.nozzle_c, self.bears.material)
            && c < melts.nozzle_c[0] - SLACK_C
        {
            self.note(Kind::NozzleBelowMaterial, number, c);
        }
    }

    fn note(&mut self, kind: Kind, line: u64, value: f64) {
        let lowest = kind == Kind::NozzleBelowMaterial;
        match self.found.iter_mut().find(|f| f.kind == kind) {
            Some(known) => {
                known.lines += 1;
                known.worst = if lowest { known.worst.min(value) } else { known.worst.max(value) };
            }
            None => self.found.push(Finding { kind, line, lines: 1, worst: value }),
        }
    }

    /// After the last line: what was found, in the order of the kinds.
    #[must_use]
    pub fn finish(mut self) -> Vec<Finding> {
        let hottest = self.nozzle_c.unwrap_or(0.0).max(self.bed_c.unwrap_or(0.0));
        if self.last_bead > 0 && self.last_bead == self.last_command {
            self.note(Kind::CutShort, self.last_bead, 0.0);
        } else if hottest > 0.0 && !self.ended_by_macro && !self.bears.ends_jobs {
            self.note(Kind::HeatersLeftOn, self.last_command, hottest);
        }
        self.found.sort_by_key(|f| f.kind);
        self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::job_file;
    use proptest::prelude::*;

    const BEARS: Bears = Bears {
        volume: Volume { low_mm: [0.0; 2], high_mm: [200.0, 100.0, 150.0], round: false },
        nozzle_max_c: 260.0,
        bed_max_c: 100.0,
        material: Some(Melts { nozzle_c: [190.0, 230.0], bed_c: [0.0, 70.0] }),
        ends_jobs: false,
    };

    fn found(bears: Bears, job: &str) -> Vec<(Kind, u64, u64, f64)> {
        let mut preflight = Preflight::new(bears);
        job_file::check(job.as_bytes(), None, |number, line| preflight.line(number, line)).expect("a job");
        preflight
            .finish()
            .into_iter()
            .map(|f| (f.kind, f.line, f.lines, (f.worst * 10.0).round() / 10.0))
            .collect()
    }

    /// Lines between a usual start (6 lines) and a usual end.
    #[track_caller]
    fn check(lines: &str, expect: &[(Kind, u64, u64, f64)]) {
        let job = format!(
            "M140 S60\nM109 S210\nG28\nM83\nG1 Y-3 F1000\nG1 X60 E9\n;LAYER_CHANGE\nG1 X50 Y50 Z0.2\n{lines}\nG1 E-1\nM104 S0\nM140 S0\nM84\n"
        );
        assert_eq!(found(BEARS, &job), expect, "{lines}");
    }

    #[test]
    fn a_usual_job_has_nothing() {
        check("G1 X60 E1", &[]);
        // On the border, and travels anywhere; standby of another tool.
        check("G1 X200.4 Y100 E1\nG1 X-30 Y300 Z400\nG1 Z0.2\nM104 T1 S150\nG1 X9 Y9\nG1 X10 E1", &[]);
    }

    #[test]
    fn beads_outside() {
        check("G1 X205 E1\nG1 X203 E1\nG1 X60", &[(Kind::OutsideBed, 9, 2, 5.0)]);
        check("G1 Y-2 E1", &[(Kind::OutsideBed, 9, 1, 2.0)]);
        check("G1 Z151\nG1 X60 E1\nG1 X70 E1", &[(Kind::AboveTop, 10, 2, 151.0)]);
        // Half circles of 10 mm to the right and to the left, whose ends lie inside.
        check("G1 X190 Y60\nG2 X190 Y40 J-10 E1\nG1 X195 Y40\nG2 X195 Y60 J10 E1", &[]);
        check("G1 X195 Y60\nG2 X195 Y40 J-10 E1", &[(Kind::OutsideBed, 10, 1, 5.0)]);
        let round = Bears {
            volume: Volume { low_mm: [-50.0; 2], high_mm: [50.0, 50.0, 99.0], round: true },
            ..BEARS
        };
        let job = |x: f64| format!("G28\nM83\nG1 X{x} Y{x}\nG1 X0 Y0 E1\nM84\n");
        assert_eq!(found(round, &job(35.0)), []);
        assert_eq!(found(round, &job(40.0)), [(Kind::OutsideBed, 4, 1, 6.6)]);
    }

    #[test]
    fn temperatures() {
        check("M104 S240\nG1 X60 E1", &[(Kind::NozzleAboveMaterial, 9, 1, 240.0)]);
        check("M104 T1 S300\nM109 R290\nG1 X60 E1", &[(Kind::NozzleTooHot, 9, 2, 300.0)]);
        check(
            "M190 S80\nM140 S120\nG1 X60 E1",
            &[(Kind::BedTooHot, 10, 1, 120.0), (Kind::BedAboveMaterial, 9, 1, 80.0)],
        );
        check("M104 S170\nG1 X60 E1\nM104 S0\nG1 X70 E1", &[(Kind::NozzleBelowMaterial, 10, 2, 0.0)]);
        let bare = Bears { material: None, bed_max_c: 0.0, ..BEARS };
        let job = "M140 S50\nM104 S255\nM83\nG1 X9 E1\nM104 S0\nM140 S0\n";
        assert_eq!(found(bare, job), [(Kind::BedTooHot, 1, 1, 50.0)]);
        // A macro heats: nothing is known.
        assert_eq!(found(BEARS, "START_PRINT EXTRUDER=150\nM83\nG1 X9 E1\nEND_PRINT\n"), []);
    }

    #[test]
    fn ends() {
        let job = |end: &str| format!("M104 S200\nM140 S60\nM83\nG1 X9 E1\n{end}");
        for (end, expect) in [
            ("M104 S0\nM140 S0\n", None),
            ("M104 S0\n", Some((Kind::HeatersLeftOn, 5, 1, 60.0))),
            ("M84\n", Some((Kind::HeatersLeftOn, 5, 1, 200.0))),
            ("END_PRINT\n", None),
            ("; settings\n; M104 S0\n", Some((Kind::CutShort, 4, 1, 0.0))),
            ("", Some((Kind::CutShort, 4, 1, 0.0))),
        ] {
            assert_eq!(found(BEARS, &job(end)), Vec::from_iter(expect), "{end}");
        }
        let ends = Bears { ends_jobs: true, ..BEARS };
        assert_eq!(found(ends, &job("M84\n")), []);
    }

    proptest! {
        /// No line is too bad, and each kind is told once.
        #[test]
        fn any_lines(lines in prop::collection::vec("[GMTXYZESR0-9. ;:*-]{0,24}", 0..60)) {
            let mut preflight = Preflight::new(BEARS);
            (1..).zip(&lines).for_each(|(number, line)| preflight.line(number, line.as_bytes()));
            let found = preflight.finish();
            prop_assert!(found.windows(2).all(|f| f[0].kind < f[1].kind));
            prop_assert!(found.iter().all(|f| f.line >= 1 && f.line <= lines.len() as u64));
            prop_assert!(found.iter().all(|f| !f.words(&BEARS).is_empty()));
        }
    }
}
