//! How a job is to be printed, in no format's own words.
//!
//! What a format reads of its settings besides pictures, panel and heights, and what
//! another format writes. A setting that a format does not know is nothing here.
//! Knows no format and no file.

/// How a job is to be printed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recipe {
    /// The layers on the plate.
    pub bottom: Stage,
    /// The others.
    pub usual: Stage,
    /// Layers on the plate, exposed as `bottom` says.
    pub bottom_layers: u32,
    /// Layers behind them whose exposures lie evenly between the two.
    pub transition_layers: u32,
    /// How long the print takes by the program that made the job, s.
    pub print_time_s: Option<f64>,
    /// Resin that it takes, mm³.
    pub resin_mm3: Option<f64>,
    /// How high the printer can print, mm.
    pub machine_z_mm: Option<f64>,
    /// The printer's name; empty where it is not told.
    pub printer: String,
    /// The resin's or its profile's name; empty where it is not told.
    pub resin: String,
    /// Layers before which the print pauses, from 0.
    pub pauses: Vec<u32>,
    /// When the job was made, `YYYY-MM-DD hh:mm:ss`.
    pub created: Option<String>,
}

/// How a layer is printed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stage {
    /// How long it is exposed, s.
    pub exposure_s: f64,
    /// Up after the exposure, in one or two stages.
    pub lift: [Way; 2],
    /// And down again.
    pub retract: [Way; 2],
    /// Waits between exposure and lift, at the top, and before the next exposure, s.
    pub waits_s: [Option<f64>; 3],
    /// Power of the light, 0 to 1.
    pub light: Option<f64>,
}

/// A way of the plate.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Way {
    /// How far, mm.
    pub mm: Option<f64>,
    /// How fast, mm/min.
    pub mm_min: Option<f64>,
}

impl Recipe {
    /// Exposure of a layer, from 0 at the plate, s.
    #[must_use]
    pub fn exposure_s(&self, layer: u32) -> f64 {
        let steps = f64::from(self.transition_layers) + 1.0;
        let past = (f64::from(layer) + 1.0 - f64::from(self.bottom_layers)).clamp(0.0, steps);
        let (first_s, others_s) = (self.bottom.exposure_s, self.usual.exposure_s);
        first_s + (others_s - first_s) * past / steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transition_layers_lie_evenly_between() {
        let check = |bottom_layers, transition_layers, expect: &[f64]| {
            let stage = |exposure_s| Stage { exposure_s, ..Stage::default() };
            let recipe = Recipe {
                bottom: stage(35.0),
                usual: stage(3.25),
                bottom_layers,
                transition_layers,
                ..Recipe::default()
            };
            for (layer, expect) in (0..).zip(expect) {
                assert!((recipe.exposure_s(layer) - expect).abs() < 1e-9, "{layer}: {recipe:?}");
            }
        };
        // As a slicer of Elegoo's wrote them.
        check(2, 4, &[35.0, 35.0, 28.65, 22.3, 15.95, 9.6, 3.25, 3.25]);
        check(1, 0, &[35.0, 3.25, 3.25]);
        check(0, 0, &[3.25, 3.25]);
    }
}
