//! What a check found, for machines and for people's tables.
//!
//! Takes what the detectors give, gives a [`Report`] that is written as JSON. Its
//! fields are an interface: named with their units, documented here, and only
//! ever added to. Lengths are mm, areas mm², angles degrees, times seconds;
//! layers are counted from 0 at the plate; `z_mm` is the height of the plane that
//! was cut or that stands for the layer (its middle), `top_mm` the Z at which a
//! printer prints it.
mod resin;

pub use resin::{Ground, Hole, Resin, ResinIssue, Severity};

use crate::detect;
use crate::detect::overhang::{Method, OverhangRegion};
use serde::Serialize;
use std::collections::BTreeMap;

/// Regions of a detector that are listed one by one, the largest.
pub const LARGEST_REGIONS: usize = 100;

/// What a check found.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// The file, as it was named.
    pub file: String,
    /// What it is: `stl`, `gcode`, `bgcode`, `sl1` or `nanodlp`.
    pub kind: &'static str,
    /// Triangles that were sliced; `null` where there is no mesh.
    pub triangles: Option<u64>,
    /// Layers.
    pub layers: u32,
    /// Top of the last layer; of a mesh its own height.
    pub height_mm: f64,
    /// Bounds of all that is printed, seen from above; `null` when nothing is.
    pub bbox_mm: Option<[[f64; 2]; 2]>,
    /// What counts as holding itself.
    pub rules: Rules,
    /// Islands at least as large as the rules' smallest area, from the plate up.
    pub islands: Vec<Island>,
    /// Islands that stay smaller than that.
    pub small_islands: Vec<Island>,
    /// Supports, brims and towers that begin in the air, as far as the file tells them
    /// from the part.
    pub floating_supports: Vec<Island>,
    /// Islands that are in no list because there are too many; usually 0.
    pub unlisted_islands: u64,
    /// What the overhang detector found; `null` when none was asked for. Of all
    /// detectors that of the polygons.
    pub overhangs: Option<Overhangs>,
    /// What each detector found, by its name.
    pub overhangs_by_method: BTreeMap<&'static str, Overhangs>,
    /// What the printer that was named could not do of a job; `null` where none was.
    pub printer: Option<Printer>,
    /// What would go wrong with a resin job, seen in its pictures; `null` where the file is none.
    pub resin: Option<Resin>,
    /// What was mended in the mesh; `null` where there is no mesh.
    pub mended: Option<serde_json::Value>,
    /// What the user should know, a sentence each.
    pub warnings: Vec<String>,
    /// Wall-clock time.
    pub seconds: Seconds,
}

/// What counts as holding itself.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Rules {
    /// The material whose profile they come from.
    pub material: String,
    /// Steepest overhang that holds itself, from the vertical: 0 is a wall, 90 a ceiling.
    pub angle_deg: f64,
    /// Longest bridge between two held ends.
    pub bridge_mm: f64,
    /// Islands and overhangs smaller than this are listed apart.
    pub min_area_mm2: f64,
}

/// A job beside the printer that would print it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Printer {
    /// The profile's name.
    pub name: String,
    /// What is wrong, the most serious kind first.
    pub findings: Vec<Amiss>,
}

/// Something that a printer could not do, or should not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Amiss {
    /// What kind: `line_too_long`, `outside_bed`, `above_top`, `nozzle_too_hot`,
    /// `bed_too_hot`, `nozzle_above_material`, `bed_above_material`,
    /// `nozzle_below_material`, `heaters_left_on`, `cut_short`, or `unreadable`; of a resin job
    /// `unfit`.
    pub kind: &'static str,
    /// The first line of the file where it is so, from 1; 0 where no line can be told.
    pub line: u64,
    /// Lines where it is so.
    pub lines: u64,
    /// The worst value, mm or °C by the kind; 0 where there is none.
    pub worst: f64,
    /// In words, with what to do.
    pub words: String,
}

/// A piece of the part that nothing below holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Island {
    /// Where it appears.
    pub layer: u32,
    /// Height of that layer's plane.
    pub z_mm: f64,
    /// Z at which that layer is printed.
    pub top_mm: f64,
    /// First layer in which it hangs together with what stands on the plate; its last
    /// layer where it never does.
    pub end_layer: u32,
    /// Height of that layer's plane.
    pub end_z_mm: f64,
    /// Z at which that layer is printed.
    pub end_top_mm: f64,
    /// Whether it ever joins what stands on the plate.
    pub joins: bool,
    /// Area in the layer where it appears.
    pub area_mm2: f64,
    /// Largest area in one layer before it joins; islands that met share it.
    pub max_area_mm2: f64,
    /// Centre of gravity in the layer where it appears.
    pub centroid_mm: [f64; 2],
    /// Lowest and highest x, y in the layer where it appears.
    pub bbox_mm: [[f64; 2]; 2],
}

/// What one overhang detector found.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Overhangs {
    /// `normal`, `layer` or `image`.
    pub method: &'static str,
    /// Number of regions at least as large as the rules' smallest area.
    pub regions: u64,
    /// Their area, seen from below.
    pub area_mm2: f64,
    /// Number of smaller regions.
    pub small_regions: u64,
    /// Their area.
    pub small_area_mm2: f64,
    /// Regions that are in neither number because there are too many; usually 0.
    pub unlisted: u64,
    /// The largest regions, the largest first: at most [`LARGEST_REGIONS`].
    pub largest: Vec<Region>,
}

/// Overhanging pieces that hang together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Region {
    /// Lowest layer.
    pub layer: u32,
    /// Height of its plane; of faces their lowest point.
    pub z_mm: f64,
    /// Z at which that layer is printed.
    pub top_mm: f64,
    /// Highest layer.
    pub end_layer: u32,
    /// Height of its plane; of faces their highest point.
    pub end_z_mm: f64,
    /// Z at which that layer is printed.
    pub end_top_mm: f64,
    /// Area seen from below.
    pub area_mm2: f64,
    /// Area of the faces themselves; that seen from below where layers were looked at.
    pub surface_mm2: f64,
    /// Centre of gravity.
    pub centroid_mm: [f64; 2],
    /// Lowest and highest x, y.
    pub bbox_mm: [[f64; 2]; 2],
    /// Whether it is, in part, an island's first layer.
    pub island: bool,
}

/// Wall-clock time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Seconds {
    /// Reading and mending the file.
    pub read: f64,
    /// Making layers of it.
    pub slice: f64,
    /// Finding islands.
    pub islands: f64,
    /// Finding overhangs.
    pub overhangs: f64,
    /// Finding what would go wrong with a resin job.
    pub resin: f64,
    /// Gathering what pictures need, and drawing them.
    pub pictures: f64,
    /// All of it.
    pub total: f64,
}

/// The Z at which each layer is printed, from the plate up, mm.
#[derive(Clone, Debug, Default)]
pub struct Tops(pub Vec<f64>);

impl Tops {
    /// The Z at which a layer is printed, mm.
    #[must_use]
    pub fn of(&self, layer: u32) -> f64 {
        self.0.get(layer as usize).or(self.0.last()).copied().unwrap_or_default()
    }

    /// The layer that holds a height, mm.
    #[must_use]
    pub fn layer_at(&self, z_mm: f64) -> u32 {
        let above = self.0.partition_point(|&top| top <= z_mm);
        above.min(self.0.len().saturating_sub(1)) as u32
    }

    /// What the detector found, with the Z at which it is printed.
    #[must_use]
    pub fn island(&self, found: &detect::island::Island) -> Island {
        Island {
            layer: found.layer,
            z_mm: found.z_mm,
            top_mm: self.of(found.layer),
            end_layer: found.end_layer,
            end_z_mm: found.end_z_mm,
            end_top_mm: self.of(found.end_layer),
            joins: found.joins,
            area_mm2: found.area_mm2,
            max_area_mm2: found.max_area_mm2,
            centroid_mm: found.centroid_mm,
            bbox_mm: found.bbox_mm,
        }
    }

    /// What a detector found, with the Z at which it is printed.
    #[must_use]
    pub fn overhangs(&self, found: &detect::overhang::Overhangs) -> Overhangs {
        let mut largest: Vec<_> = found.regions.iter().collect();
        largest.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2).then(a.layer.cmp(&b.layer)));
        largest.truncate(LARGEST_REGIONS);
        Overhangs {
            method: name(found.method),
            regions: found.regions.len() as u64,
            area_mm2: found.area_mm2,
            small_regions: found.small.len() as u64,
            small_area_mm2: found.small_area_mm2,
            unlisted: found.unlisted,
            largest: largest.into_iter().map(|region| self.region(region)).collect(),
        }
    }

    fn region(&self, found: &OverhangRegion) -> Region {
        Region {
            layer: found.layer,
            z_mm: found.z_mm,
            top_mm: self.of(found.layer),
            end_layer: found.end_layer,
            end_z_mm: found.end_z_mm,
            end_top_mm: self.of(found.end_layer),
            area_mm2: found.area_mm2,
            surface_mm2: found.surface_mm2,
            centroid_mm: found.centroid_mm,
            bbox_mm: found.bbox_mm,
            island: found.island,
        }
    }
}

/// A height for people, mm: to a hundredth, and to a micrometre where layers need it.
#[must_use]
pub fn height_words(mm: f64) -> String {
    let text = format!("{mm:.3}");
    text.strip_suffix('0').map_or(text.clone(), str::to_owned)
}

/// A detector's name, as on the command line.
#[must_use]
pub fn name(method: Method) -> &'static str {
    match method {
        Method::Normal => "normal",
        Method::Layer => "layer",
        Method::Image => "image",
    }
}

impl Report {
    /// The JSON's text, with a line's end. Numbers that are none are `null`.
    ///
    /// # Errors
    /// The encoder's own; none is expected.
    pub fn json(&self) -> serde_json::Result<String> {
        let mut text = serde_json::to_string_pretty(self)?;
        text.push('\n');
        Ok(text)
    }

    /// Puts in what a detector found. Of several the polygons' is the report's own.
    pub fn put_overhangs(&mut self, found: Overhangs) {
        if self.overhangs.is_none() || found.method == name(Method::Layer) {
            self.overhangs = Some(found.clone());
        }
        self.overhangs_by_method.insert(found.method, found);
    }

    /// The file's name without its folder.
    #[must_use]
    pub fn name(&self) -> &str {
        self.file.rsplit('/').find(|part| !part.is_empty()).unwrap_or(&self.file)
    }

    /// The islands, the largest first; of equals the lowest.
    #[must_use]
    pub fn largest_islands(&self) -> Vec<&Island> {
        let mut islands: Vec<&Island> = self.islands.iter().collect();
        islands.sort_by(|a, b| b.area_mm2.total_cmp(&a.area_mm2).then(a.layer.cmp(&b.layer)));
        islands
    }
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;

    /// An island of 1 mm a side where `layer` layers of 0.1 mm are below.
    pub(crate) fn island(layer: u32, area_mm2: f64) -> Island {
        let z_mm = f64::from(layer) * 0.1 + 0.05;
        Island {
            layer,
            z_mm,
            top_mm: z_mm + 0.05,
            end_layer: layer + 10,
            end_z_mm: z_mm + 1.0,
            end_top_mm: z_mm + 1.05,
            joins: true,
            area_mm2,
            max_area_mm2: area_mm2,
            centroid_mm: [1.5, -2.5],
            bbox_mm: [[1.0, -3.0], [2.0, -2.0]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::testing::island;
    use super::*;

    #[test]
    fn the_largest_come_first_and_of_equals_the_lowest() {
        let islands = vec![island(9, 1.0), island(3, 2.0), island(7, 2.0), island(1, 0.5)];
        let report = Report { islands, ..Report::default() };
        let found: Vec<u32> = report.largest_islands().iter().map(|i| i.layer).collect();
        assert_eq!(found, [3, 7, 9, 1]);
    }

    #[test]
    fn heights_are_as_fine_as_layers() {
        assert_eq!([5.2, 0.125, 12.0].map(height_words), ["5.20", "0.125", "12.00"]);
    }

    #[test]
    fn the_fields_are_those_that_are_documented() {
        let report = Report { islands: vec![island(9, 1.0)], ..Report::default() };
        let json: serde_json::Value = serde_json::from_str(&report.json().expect("text")).expect("JSON");
        let names = |v: &serde_json::Value| {
            v.as_object().expect("an object").keys().cloned().collect::<Vec<_>>().join(" ")
        };
        assert_eq!(
            names(&json),
            "bbox_mm file floating_supports height_mm islands kind layers mended overhangs overhangs_by_method \
             printer resin rules seconds small_islands triangles unlisted_islands warnings"
        );
        assert_eq!(
            names(&json["islands"][0]),
            "area_mm2 bbox_mm centroid_mm end_layer end_top_mm end_z_mm joins layer max_area_mm2 top_mm z_mm"
        );
        assert_eq!(names(&json["seconds"]), "islands overhangs pictures read resin slice total");
        assert_eq!(json["islands"][0]["bbox_mm"], serde_json::json!([[1.0, -3.0], [2.0, -2.0]]));
        assert!(json["triangles"].is_null() && json["overhangs"].is_null());
    }
}
