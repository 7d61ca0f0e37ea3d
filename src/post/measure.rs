//! What the head does between deposits, counted.
//!
//! Takes moves in turn; gives jumps, travel, retractions and lifts:
//! - *bead*: a maximal run of deposits of one feature and tool with nothing between that moves
//! - *jump*: the stretch between two deposits with XY motion between them
//! - *travel*: XY length of the moves without filament in those stretches
//! - *retraction*: the filament goes from the nozzle to pulled back, in however many moves; `G10` is one
//! - *lift*: such a stretch whose highest z is above both its ends
use outrigger_gcode::state::{Kind, Move};
use serde::Serialize;

/// Filament pulled back less than this is not a retraction, mm.
pub(crate) const RETRACTED_MM: f64 = 0.02;

/// Z above both ends of a jump by more than this is a lift, mm.
const LIFTED_MM: f64 = 1e-4;

/// Counts and sums.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Totals {
    /// Maximal runs of deposits.
    pub beads: u64,
    /// Stretches between deposits with XY motion.
    pub jumps: u64,
    /// Times the filament was pulled back.
    pub retractions: u64,
    /// Jumps that rose above both ends.
    pub lifts: u64,
    /// XY travel between deposits, mm.
    pub travel_mm: f64,
}

/// What a move that is not a deposit adds before it is known that a deposit follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Between {
    travel_mm: f64,
    wipe_mm: f64,
    top_mm: f64,
    moved: bool,
}

/// Counts as the moves go by.
#[derive(Clone, Debug, PartialEq)]
pub struct Measure {
    totals: Totals,
    /// Filament position and its furthest, mm.
    filament: f64,
    furthest: f64,
    firmware_retracted: bool,
    /// Deposits begun while the filament was pulled back.
    pub retracted_deposits: u64,
    /// Deepest retraction, mm.
    pub deepest_mm: f64,
    /// Height of the last deposit's end, mm; none before the first.
    last_z: Option<f64>,
    between: Between,
    /// Feature and tool of the bead that the last move belonged to.
    bead: Option<(u32, u16)>,
}

impl Default for Measure {
    fn default() -> Self {
        Measure {
            totals: Totals::default(),
            filament: 0.0,
            furthest: 0.0,
            firmware_retracted: false,
            retracted_deposits: 0,
            deepest_mm: 0.0,
            last_z: None,
            between: Between::default(),
            bead: None,
        }
    }
}

impl Measure {
    /// What was counted so far.
    #[must_use]
    pub fn totals(&self) -> Totals {
        self.totals
    }

    /// Adds what another count gained, for a stretch that was counted elsewhere.
    pub fn follow(&mut self, before: &Measure, after: &Measure) {
        let gained = |own: u64, b: u64, a: u64| own + (a - b);
        let (own, b, a) = (self.totals, before.totals, after.totals);
        let deposits = gained(self.retracted_deposits, before.retracted_deposits, after.retracted_deposits);
        let deepest = self.deepest_mm.max(after.deepest_mm);
        *self = after.clone();
        self.retracted_deposits = deposits;
        self.deepest_mm = deepest;
        self.totals = Totals {
            beads: gained(own.beads, b.beads, a.beads),
            jumps: gained(own.jumps, b.jumps, a.jumps),
            retractions: gained(own.retractions, b.retractions, a.retractions),
            lifts: gained(own.lifts, b.lifts, a.lifts),
            travel_mm: own.travel_mm + (a.travel_mm - b.travel_mm),
        };
    }

    /// Whether two counts stand alike but for what they have counted.
    #[must_use]
    pub fn stands_like(&self, other: &Measure) -> bool {
        (self.filament - self.furthest) == (other.filament - other.furthest)
            && self.firmware_retracted == other.firmware_retracted
            && self.last_z == other.last_z
            && self.between == other.between
            && self.bead == other.bead
    }

    /// Whether the filament is pulled back.
    #[must_use]
    pub fn is_retracted(&self) -> bool {
        self.firmware_retracted || self.filament < self.furthest - RETRACTED_MM
    }

    /// Depth to which the filament is pulled back by E, mm.
    #[must_use]
    pub fn depth_mm(&self) -> f64 {
        self.furthest - self.filament
    }

    /// A move; `feature` is any number that tells features apart.
    pub fn add(&mut self, m: &Move, kind: Kind, feature: u32, tool: u16) {
        if kind == Kind::Still {
            return;
        }
        let was_retracted = self.is_retracted();
        self.filament(m.e);
        if kind == Kind::Deposit {
            self.deposit(m, was_retracted, feature, tool);
            return;
        }
        self.bead = None;
        let between = &mut self.between;
        between.moved = true;
        between.top_mm = between.top_mm.max(m.to[2]);
        match kind {
            Kind::Travel => between.travel_mm += (m.to[0] - m.from[0]).hypot(m.to[1] - m.from[1]),
            Kind::Wipe => between.wipe_mm += m.length_mm(),
            _ => {}
        }
    }

    fn filament(&mut self, e: f64) {
        let was_back = self.filament < self.furthest - RETRACTED_MM;
        self.filament += e;
        if !was_back && self.filament < self.furthest - RETRACTED_MM {
            self.totals.retractions += 1;
        }
        self.deepest_mm = self.deepest_mm.max(self.furthest - self.filament);
        self.furthest = self.furthest.max(self.filament);
    }

    fn deposit(&mut self, m: &Move, was_retracted: bool, feature: u32, tool: u16) {
        if was_retracted {
            self.retracted_deposits += 1;
            self.filament = self.furthest;
        }
        if let Some(last_z) = self.last_z
            && self.between.moved
        {
            self.totals.travel_mm += self.between.travel_mm;
            self.totals.jumps += u64::from(self.between.travel_mm + self.between.wipe_mm > 1e-6);
            let higher_end = last_z.max(m.from[2]);
            self.totals.lifts += u64::from(self.between.top_mm > higher_end + LIFTED_MM);
        }
        self.last_z = Some(m.to[2]);
        self.between = Between { top_mm: f64::NEG_INFINITY, ..Between::default() };
        if self.bead != Some((feature, tool)) {
            self.totals.beads += 1;
            self.bead = Some((feature, tool));
        }
    }

    /// `G10`.
    pub fn firmware_retract(&mut self) {
        self.totals.retractions += u64::from(!self.firmware_retracted);
        self.firmware_retracted = true;
        self.bead = None;
    }

    /// `G11`.
    pub fn firmware_unretract(&mut self) {
        self.firmware_retracted = false;
        self.bead = None;
    }

    /// `G28`: where a bead was, there is none.
    pub fn home(&mut self) {
        self.bead = None;
    }

    /// Another tool's filament is at its nozzle.
    pub fn tool_change(&mut self) {
        self.filament = self.furthest;
        self.bead = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use outrigger_gcode::line::parse;
    use outrigger_gcode::state::{Effect, Machine};

    fn measure(text: &str) -> Measure {
        let mut machine = Machine::default();
        let mut measure = Measure::default();
        for line in text.split_inclusive('|') {
            match machine.apply(&parse(line.trim_end_matches('|').as_bytes())) {
                Effect::Motion(m) => measure.add(&m, m.kind(), 0, machine.tool),
                Effect::FirmwareRetract => measure.firmware_retract(),
                Effect::FirmwareUnretract => measure.firmware_unretract(),
                _ => {}
            }
        }
        measure
    }

    #[test]
    fn counts() {
        let check = |text: &str, beads: u64, jumps: u64, retractions: u64, lifts: u64, travel_mm: f64| {
            let expect = Totals { beads, jumps, retractions, lifts, travel_mm };
            assert_eq!(measure(text).totals(), expect, "{text}");
        };
        check("M83|G1 X1 E1|G1 X2 E1", 1, 0, 0, 0, 0.0);
        check("M83|G1 X1 E1|G1 X3|G1 X4 E1", 2, 1, 0, 0, 2.0);
        check("M83|G1 X1 E1|G1 E-1|G1 Z1|G1 X3|G1 Z0|G1 E1|G1 X4 E1", 2, 1, 1, 1, 2.0);
        check("M83|G1 X1 E1|G1 E-.5|G1 X0 E-.4|G1 E-.1|G1 X3|G1 E1|G1 X4 E1", 2, 1, 1, 0, 3.0);
        check("G1 X1 E1|G10|G1 X3|G11|G1 X4 E2", 2, 1, 1, 0, 2.0);
        check("M83|G1 X1 E1|G1 F600|G1 X2 E1", 1, 0, 0, 0, 0.0);
        check("M83|G1 X5|G1 X6 E1|G1 X9", 1, 0, 0, 0, 0.0);
        check("M83|G1 X1 E1|G1 Z.4|G1 X2 E1", 2, 0, 0, 0, 0.0);
    }

    #[test]
    fn deposits_while_retracted_are_counted() {
        assert_eq!(measure("M83|G1 X1 E1|G1 E-1|G1 X2 E1").retracted_deposits, 1);
        assert_eq!(measure("M83|G1 X1 E1|G1 E-1|G1 E1|G1 X2 E1").retracted_deposits, 0);
        assert_eq!(measure("M83|G1 X1 E1|G1 E-2.5").deepest_mm, 2.5);
    }

    #[test]
    fn a_stretch_counted_elsewhere_adds_up() {
        let before = measure("M83|G1 X1 E1");
        let after = measure("M83|G1 X1 E1|G1 E-1|G1 X3|G1 E1|G1 X4 E1");
        let mut own = before.clone();
        assert!(own.stands_like(&before));
        own.follow(&before, &after);
        assert_eq!(own, after);
    }
}
