//! What was done to a job, for people and for machines.
use super::measure::Totals;
use super::verify::Figures;
use serde::Serialize;

/// The report of one job. Its JSON fields are an interface: they are only added to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Layer marks.
    pub layers: u64,
    /// Runs of infill beads that might have been reordered.
    pub sections: u64,
    /// Sections that were.
    pub sections_changed: u64,
    /// Maximal runs of deposits.
    pub beads_before: u64,
    /// As `beads_before`, of the output.
    pub beads_after: u64,
    /// Ways between deposits with XY motion.
    pub jumps_before: u64,
    /// Of the output.
    pub jumps_after: u64,
    /// Times the filament is pulled back.
    pub retractions_before: u64,
    /// Of the output.
    pub retractions_after: u64,
    /// Jumps that rise above both ends.
    pub lifts_before: u64,
    /// Of the output.
    pub lifts_after: u64,
    /// XY travel between deposits, mm.
    pub travel_mm_before: f64,
    /// Of the output.
    pub travel_mm_after: f64,
    /// Estimated printing time, s.
    pub time_s_before: f64,
    /// Of the output.
    pub time_s_after: f64,
    /// What post-processing took, s.
    pub seconds: f64,
    /// Why the file was left as it is; `null` when it was changed.
    pub unchanged_reason: Option<String>,
}

impl Report {
    /// Puts in what was measured.
    pub fn put(&mut self, figures: &Figures) {
        let (before, after): (Totals, Totals) = (figures.before, figures.after);
        self.layers = figures.layers;
        (self.beads_before, self.beads_after) = (before.beads, after.beads);
        (self.jumps_before, self.jumps_after) = (before.jumps, after.jumps);
        (self.retractions_before, self.retractions_after) = (before.retractions, after.retractions);
        (self.lifts_before, self.lifts_after) = (before.lifts, after.lifts);
        (self.travel_mm_before, self.travel_mm_after) = (before.travel_mm, after.travel_mm);
        (self.time_s_before, self.time_s_after) = (figures.time_s_before, figures.time_s_after);
    }

    /// Makes the output the same as the input, for the reason given.
    pub fn unchanged(&mut self, reason: impl Into<String>) {
        self.beads_after = self.beads_before;
        self.jumps_after = self.jumps_before;
        self.retractions_after = self.retractions_before;
        self.lifts_after = self.lifts_before;
        self.travel_mm_after = self.travel_mm_before;
        self.time_s_after = self.time_s_before;
        self.sections_changed = 0;
        self.unchanged_reason = Some(reason.into());
    }
}
