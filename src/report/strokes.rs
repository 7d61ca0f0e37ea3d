//! A layer as a pen would draw it: beads, and the jumps between them, in order.
//!
//! Takes a [`Layer`], gives its [`Paths`]. What is a bead, a jump, a retraction
//! or a lift is [`Measure`]'s word, so that what is drawn is what is counted.
//! What comes before the layer's first deposit and after its last is left out:
//! the ways from layer to layer belong to neither.
use crate::post::layer::{Layer, What};
use crate::post::measure::{Measure, Totals};
use crate::toolpath::bead::Point;
use outrigger_gcode::dialect::Feature;
use outrigger_gcode::state::{Kind, Move};

/// Features as a picture tells them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Class {
    /// Walls.
    Perimeter,
    /// Sparse infill.
    Infill,
    /// Solid infill of all kinds, bridges, gap fill, ironing.
    Solid,
    /// Skirt, supports, tower, macros.
    Other,
}

impl From<Feature> for Class {
    fn from(feature: Feature) -> Class {
        match feature {
            feature if feature.is_perimeter() => Class::Perimeter,
            Feature::Infill | Feature::AnyInfill => Class::Infill,
            feature if feature.is_part() => Class::Solid,
            _ => Class::Other,
        }
    }
}

/// What the pen does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pen {
    /// A bead.
    Bead {
        /// Of what.
        class: Class,
        /// Width, mm; 0 when the file does not say.
        width_mm: f64,
    },
    /// A jump from one bead to another.
    Jump {
        /// The filament was pulled back for it.
        retracted: bool,
        /// The nozzle was raised for it.
        lifted: bool,
    },
}

/// One stretch of the head's way.
#[derive(Clone, Debug, PartialEq)]
pub struct Stroke {
    /// What is done.
    pub pen: Pen,
    /// The way, mm. At least two points.
    pub points: Vec<Point>,
}

/// A layer's strokes, in the order of the print.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Paths {
    /// Number of the layer, from 1.
    pub number: u32,
    /// Height of its first deposit, mm; 0 when there is none.
    pub z_mm: f64,
    /// The strokes.
    pub strokes: Vec<Stroke>,
    /// Counts and sums from the first deposit to the last.
    pub totals: Totals,
}

impl Paths {
    /// The strokes of a layer.
    #[must_use]
    pub fn of(layer: &Layer) -> Paths {
        let is_deposit = |what: &What| matches!(what, What::Move(_, Kind::Deposit));
        let mut reader =
            Reader { paths: Paths { number: layer.number, ..Paths::default() }, ..Reader::default() };
        let first = layer.rows.iter().position(|row| is_deposit(&row.what));
        let last = layer.rows.iter().rposition(|row| is_deposit(&row.what));
        let (Some(first), Some(last)) = (first, last) else { return reader.paths };
        for row in &layer.rows[first..=last] {
            let state = layer.state(row);
            if reader.tool.replace(state.tool).is_some_and(|tool| tool != state.tool) {
                reader.measure.tool_change();
            }
            match row.what {
                What::Move(m, kind) => reader.add(&m, kind, state.feature, state.width_mm),
                What::Retract => reader.measure.firmware_retract(),
                What::Unretract => reader.measure.firmware_unretract(),
                _ => {}
            }
        }
        reader.paths.totals = reader.measure.totals();
        reader.paths
    }
}

#[derive(Default)]
struct Reader {
    paths: Paths,
    measure: Measure,
    tool: Option<u16>,
    /// The way since the last deposit.
    way: Vec<Point>,
    /// Counts at the last deposit.
    counted: Totals,
}

impl Reader {
    fn add(&mut self, m: &Move, kind: Kind, feature: Feature, width_mm: f64) {
        let deposits = kind == Kind::Deposit;
        // After a macro or a G92 the head is elsewhere: what follows is another bead.
        let at = self.paths.strokes.last().and_then(|s| s.points.last().copied());
        if deposits && self.way.is_empty() && at.is_some_and(|at| at != [m.from[0], m.from[1]]) {
            self.measure.home();
        }
        self.measure.add(m, kind, feature as u32, self.tool.unwrap_or(0));
        match kind {
            Kind::Deposit => self.deposit(m, feature, width_mm),
            Kind::Travel | Kind::Wipe => append(&mut self.way, m),
            Kind::Filament | Kind::Still => {}
        }
    }

    fn deposit(&mut self, m: &Move, feature: Feature, width_mm: f64) {
        let (before, now) = (self.counted, self.measure.totals());
        self.counted = now;
        let points = std::mem::take(&mut self.way);
        if now.jumps > before.jumps {
            let retracted = now.retractions > before.retractions;
            let pen = Pen::Jump { retracted, lifted: now.lifts > before.lifts };
            self.paths.strokes.push(Stroke { pen, points });
        }
        if now.beads == 1 && self.paths.strokes.is_empty() {
            self.paths.z_mm = m.to[2];
        }
        if now.beads > before.beads {
            let pen = Pen::Bead { class: feature.into(), width_mm };
            self.paths.strokes.push(Stroke { pen, points: Vec::new() });
        }
        if let Some(stroke) = self.paths.strokes.last_mut() {
            append(&mut stroke.points, m);
        }
    }
}

fn append(points: &mut Vec<Point>, m: &Move) {
    m.chords(|from, to| {
        if points.is_empty() {
            points.push(from);
        }
        points.push(to);
    });
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;
    use crate::post::annotate::Layers;
    use outrigger_gcode::dialect::Dialect;

    /// The layers of a job in PrusaSlicer's dialect, from the first mark on.
    pub(crate) fn layers(job: &str) -> Vec<Layer> {
        let mut reader = Layers::new(job.as_bytes(), Dialect::Prusa);
        let next = || reader.next_layer().unwrap();
        std::iter::from_fn(next).filter(|layer| layer.number > 0).collect()
    }

    /// One layer of these commands, separated by `|`.
    pub(crate) fn paths(commands: &str) -> Paths {
        let lines = commands.replace('|', "\n");
        let layers = layers(&format!("M83\n;LAYER_CHANGE\n;TYPE:Internal infill\n;WIDTH:0.5\n{lines}\n"));
        layers.first().map(Paths::of).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::testing::paths;
    use super::*;

    /// `b` a bead, `j` a jump, `r` one with the filament pulled back, `l` one that is lifted too; with points.
    fn drawn(commands: &str) -> String {
        let stroke = |s: &Stroke| {
            let pen = match s.pen {
                Pen::Bead { class: Class::Infill, .. } => 'b',
                Pen::Bead { .. } => 'B',
                Pen::Jump { lifted: true, .. } => 'l',
                Pen::Jump { retracted: true, .. } => 'r',
                Pen::Jump { .. } => 'j',
            };
            let points: Vec<_> = s.points.iter().map(|p| format!("{},{}", p[0], p[1])).collect();
            format!("{pen} {}", points.join(" "))
        };
        paths(commands).strokes.iter().map(stroke).collect::<Vec<_>>().join("; ")
    }

    #[test]
    fn strokes_follow_the_head() {
        let check = |commands: &str, expect: &str| assert_eq!(drawn(commands), expect, "{commands}");
        check("", "");
        check("G1 X1|G1 Y1", "");
        check("G1 X5|G1 X6 E1|G1 Y1 E1|G1 X9 Y9", "b 5,0 6,0 6,1");
        check("G1 X1 E1|G1 X3|G1 X4 E1", "b 0,0 1,0; j 1,0 3,0; b 3,0 4,0");
        check("G1 X1 E1|G1 E-1|G1 X3|G1 X3 Y1|G1 E1|G1 X4 E1", "b 0,0 1,0; r 1,0 3,0 3,1; b 3,1 4,1");
        check(
            "G1 X1 E1|G1 E-.8|G1 Z1|G1 X3|G1 Z0|G1 E.8|G1 X4 E1",
            "b 0,0 1,0; l 1,0 1,0 3,0 3,0; b 3,0 4,0",
        );
        check("G1 X1 E1|G10|G1 X3|G11|G1 X4 E1", "b 0,0 1,0; r 1,0 3,0; b 3,0 4,0");
        check("G1 X1 E1|;TYPE:Perimeter|G1 X2 E1", "b 0,0 1,0; B 1,0 2,0");
        check("G1 X1 E1|G28|G1 X2 E1", "b 0,0 1,0; b 0,0 2,0");
        check("G1 X1 E1|G1 F600|G1 X2 E1|G1 Z5", "b 0,0 1,0 2,0");
    }

    #[test]
    fn totals_are_of_what_is_drawn() {
        // The retraction after the last deposit belongs to the way to the next layer.
        let paths = paths("G1 Z.3|G1 X1 E1|G1 X3|G1 X4 E1|G1 E-1|G1 X50");
        let expect = Totals { beads: 2, jumps: 1, retractions: 0, lifts: 0, travel_mm: 2.0 };
        assert_eq!((paths.totals, paths.z_mm, paths.number), (expect, 0.3, 1));
    }

    #[test]
    fn every_feature_has_a_class() {
        let check = |feature: Feature, expect| assert_eq!(Class::from(feature), expect, "{feature:?}");
        check(Feature::OverhangPerimeter, Class::Perimeter);
        check(Feature::AnyInfill, Class::Infill);
        check(Feature::Skin, Class::Solid);
        check(Feature::GapFill, Class::Solid);
        check(Feature::SupportInterface, Class::Other);
        check(Feature::Unknown, Class::Other);
    }
}
