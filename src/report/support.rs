//! What supports amount to, as JSON and as a table for people.
use crate::support::plan::Plan;
use crate::support::points::Unheld;
use serde::Serialize;
use std::fmt::Write;

/// Places that the table names; the JSON has all of them.
const NAMED: usize = 8;

/// What was planned. Fields are named with their units and only ever added to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The model's file.
    pub file: String,
    /// `straight` or `tree`.
    pub method: &'static str,
    /// `filament` or `resin`.
    pub process: &'static str,
    /// The material whose rules counted.
    pub material: String,
    /// Height of a layer, mm.
    pub layer_mm: f64,
    /// Area that must be held, seen from below, mm².
    pub demand_mm2: f64,
    /// Islands that must be held.
    pub islands: usize,
    /// Tips.
    pub tips: u32,
    /// No choice of tips that holds all of this has fewer.
    pub tips_at_least: u32,
    /// Where branches meet.
    pub junctions: u32,
    /// Feet on the plate.
    pub trunks_on_plate: u32,
    /// Feet on the part.
    pub landings_on_model: u32,
    /// All branches, mm.
    pub length_mm: f64,
    /// What is printed of them: the area of each layer's section times its height, mm³.
    pub volume_mm3: f64,
    /// What the slicer's own supports took that were replaced, mm³.
    pub replaced_mm3: f64,
    /// The model that the job was laid beside, if one was.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<Model>,
    /// What cannot be held.
    pub unroutable: Vec<Place>,
    /// Unheld pieces smaller than a tip, which print as what holds itself does: their number
    /// and their area, mm².
    pub negligible: (usize, f64),
    /// What the proof found amiss in the result; empty when it holds.
    pub amiss: Vec<String>,
    /// What the user should know.
    pub warnings: Vec<String>,
    /// Time, s.
    pub seconds: Seconds,
}

/// A job's model.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Model {
    /// Its file.
    pub file: String,
    /// How far it was moved to where the job prints it, mm.
    pub moved_mm: [f64; 3],
}

/// Something that cannot be held.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Place {
    /// Its lowest place, mm.
    pub place_mm: [f64; 3],
    /// Why.
    pub reason: &'static str,
    /// Area, mm².
    pub area_mm2: f64,
    /// An island is among it.
    pub island: bool,
}

/// Where the time went, s.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading and mending.
    pub read: f64,
    /// Layers, detection, space.
    pub look: f64,
    /// Tips and trees.
    pub plan: f64,
    /// The result read again.
    pub proof: f64,
    /// All.
    pub total: f64,
}

impl Report {
    /// Takes what a plan says; what is unheld and smaller than `least_mm2` without an island
    /// is negligible.
    pub fn put(&mut self, plan: &Plan, least_mm2: f64) {
        let tally = plan.forest.tally();
        (self.tips, self.junctions) = (tally.tips, tally.junctions);
        (self.trunks_on_plate, self.landings_on_model) = (tally.trunks_on_plate, tally.landings_on_model);
        (self.length_mm, self.tips_at_least) = (tally.length_mm, plan.points.at_least);
        let counts = |u: &&Unheld| u.island || u.area_mm2 >= least_mm2;
        self.unroutable = plan.points.unheld.iter().filter(counts).map(Place::from).collect();
        let small: Vec<f64> = plan.points.unheld.iter().filter(|u| !counts(u)).map(|u| u.area_mm2).collect();
        self.negligible = (small.len(), small.iter().sum());
    }

    /// As JSON, with a line end.
    ///
    /// # Errors
    /// The encoder's own; none is expected.
    pub fn json(&self) -> serde_json::Result<String> {
        Ok(serde_json::to_string_pretty(self)? + "\n")
    }

    /// For people.
    #[must_use]
    pub fn table(&self) -> String {
        let mut out = String::new();
        let _ = writeln!(
            out,
            "{}: {} layers of {} mm, {}: {:.1} mm² to hold, {} islands among it",
            self.file, self.process, self.layer_mm, self.material, self.demand_mm2, self.islands
        );
        let _ = writeln!(
            out,
            "{} tips (no fewer than {} could do), {} junctions, {} trunks on the plate, {} feet on the part",
            self.tips, self.tips_at_least, self.junctions, self.trunks_on_plate, self.landings_on_model
        );
        let _ = writeln!(out, "{:.0} mm of branches, {:.2} cm³", self.length_mm, self.volume_mm3 / 1e3);
        if self.replaced_mm3 > 0.0 {
            let _ = writeln!(out, "in place of the slicer's own, {:.2} cm³", self.replaced_mm3 / 1e3);
        }
        if let Some(model) = &self.model {
            let [x, y, z] = model.moved_mm;
            let moved = match model.moved_mm {
                [0.0, 0.0, 0.0] => String::new(),
                _ => format!(", moved by X {x:+.2} Y {y:+.2} Z {z:+.2} mm"),
            };
            let _ = writeln!(out, "beside its model {}{moved}", model.file);
        }
        if !self.unroutable.is_empty() {
            let _ = writeln!(out, "\n{} places cannot be held:", self.unroutable.len());
        }
        for place in self.unroutable.iter().take(NAMED) {
            let [x, y, z] = place.place_mm;
            let island = if place.island { ", an island" } else { "" };
            let _ = writeln!(
                out,
                "  X {x:7.1} Y {y:7.1} Z {z:7.2}: {:.2} mm²{island}: {}",
                place.area_mm2, place.reason
            );
        }
        if self.unroutable.len() > NAMED {
            let _ = writeln!(out, "  and {} more: see --json", self.unroutable.len() - NAMED);
        }
        if self.negligible.0 > 0 {
            let (count, mm2) = self.negligible;
            let _ = writeln!(out, "{count} unheld spots smaller than a tip, {mm2:.2} mm² in all");
        }
        for warning in &self.warnings {
            let _ = writeln!(out, "Note: {warning}");
        }
        let s = self.seconds;
        let _ = write!(
            out,
            "\n{:.2} s: reading {:.2}, looking {:.2}, planning {:.2}, proving {:.2}",
            s.total, s.read, s.look, s.plan, s.proof
        );
        out
    }
}

impl From<&Unheld> for Place {
    fn from(u: &Unheld) -> Place {
        Place { place_mm: u.place_mm, reason: u.reason.words(), area_mm2: u.area_mm2, island: u.island }
    }
}
