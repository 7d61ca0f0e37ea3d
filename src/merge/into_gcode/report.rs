//! What was put into a job.
use crate::layers::shape::Region;
use serde::Serialize;

/// What could not be printed of the planned sections, for one cause.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Clipped {
    /// Summed over the layers, mm².
    pub area_mm2: f64,
    /// Layers in which something was clipped.
    pub layers: u32,
    /// The first of them.
    pub first_layer: u32,
    /// Height of the nozzle there, mm.
    pub first_z_mm: f64,
    /// The largest piece there: the middle of its bounds, mm.
    pub first_place_mm: [f64; 2],
}

/// Less is rounding, mm².
const LEAST_MM2: f64 = 1e-3;

impl Clipped {
    /// What went from one region to the other.
    pub(super) fn add(&mut self, layer: u32, z_mm: f64, before: &Region, after: &Region) {
        let lost = before.area_mm2() - after.area_mm2();
        if lost < LEAST_MM2 {
            return;
        }
        let place = || {
            let lost = crate::layers::polygon::difference(before, after);
            let largest = lost.polygons.iter().max_by(|a, b| a.area_mm2().total_cmp(&b.area_mm2()));
            let [low, high] = largest.map_or(lost.bounds(), |p| p.bounds()).mm();
            [f64::midpoint(low[0], high[0]), f64::midpoint(low[1], high[1])]
        };
        if self.layers == 0 {
            (self.first_layer, self.first_z_mm, self.first_place_mm) = (layer, z_mm, place());
        }
        // A body and an interface in one layer count once each at most.
        self.area_mm2 += lost;
        self.layers += 1;
    }

    /// What an earlier layer's count becomes with a later one's.
    pub(super) fn join(&mut self, later: &Clipped) {
        if self.layers == 0 {
            *self = *later;
        } else {
            self.area_mm2 += later.area_mm2;
            self.layers += later.layers;
        }
    }
}

/// What was put into a job, and what was not. Fields are only ever added to.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MergeReport {
    /// Layer marks of the job.
    pub layers: u32,
    /// Layers into which supports went.
    pub layers_supported: u32,
    /// Paths of supports, interfaces among them.
    pub paths: u64,
    /// Their length, mm.
    pub length_mm: f64,
    /// Filament that they take, mm.
    pub filament_mm: f64,
    /// Their volume, mm³.
    pub volume_mm3: f64,
    /// Width of their beads, mm.
    pub width_mm: f64,
    /// Lifts of their own travels, ways in and out included.
    pub lifts: u64,
    /// Travels of the file that would have led over supports and go above them now.
    pub travels_lifted: u64,
    /// Clipped for the part and its clearance.
    pub clipped_by_part: Clipped,
    /// Clipped for skirt, tower, the slicer's own supports and prime lines.
    pub clipped_by_aids: Clipped,
    /// Clipped at the plate's border.
    pub clipped_by_bed: Clipped,
    /// Height of the supports that the job is too low for, mm; 0 where it is not.
    pub missing_top_mm: f64,
}

impl MergeReport {
    /// What was left out of the sections, and why, for people; nothing where nothing was.
    #[must_use]
    pub fn words(&self) -> Vec<String> {
        let told = |clipped: &Clipped, why: &str| {
            let [x, y] = clipped.first_place_mm;
            (clipped.layers > 0).then(|| {
                format!(
                    "in {} layers supports give way to {why}: first at X {x:.1} Y {y:.1} Z {:.2}",
                    clipped.layers, clipped.first_z_mm
                )
            })
        };
        [
            told(&self.clipped_by_part, "the part"),
            told(&self.clipped_by_aids, "what else the job prints (skirt, tower, its own supports)"),
            told(&self.clipped_by_bed, "the border of the plate"),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}
