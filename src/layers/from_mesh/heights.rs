//! The heights of the layers of a mesh, and the planes that cut it.
//!
//! Takes what the user wants and how high the part is, gives planes on the grid.
//! Knows no triangle.
use super::SliceError;
use crate::layers::shape::UNITS_PER_MM;
use crate::layers::stack::Layer;

/// Thinnest layer, mm: ten steps of the grid, a tenth of what any printer can do.
pub const MIN_LAYER_MM: f64 = 0.001;

/// Thickest layer, mm.
pub const MAX_LAYER_MM: f64 = 100.0;

/// Most layers of a job: 20 m at 0.01 mm.
pub const MAX_LAYERS: u32 = 2_000_000;

/// How thick layers are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerHeights {
    /// Thickness of every layer but the first, mm.
    pub layer_mm: f64,
    /// Thickness of the first layer, mm.
    pub first_mm: f64,
}

impl LayerHeights {
    /// All layers of the same thickness, mm.
    #[must_use]
    pub fn even(layer_mm: f64) -> LayerHeights {
        LayerHeights { layer_mm, first_mm: layer_mm }
    }

    /// Where a layer begins and ends, mm. Each height is computed by itself, so that
    /// nothing adds up.
    fn of(self, number: u32) -> [f64; 2] {
        let top = |n: u32| self.first_mm + f64::from(n) * self.layer_mm;
        [number.checked_sub(1).map_or(0.0, top), top(number)]
    }

    fn check(self) -> Result<(), SliceError> {
        for (option, mm) in [("--layer-height", self.layer_mm), ("--first-layer-height", self.first_mm)] {
            if !(MIN_LAYER_MM..=MAX_LAYER_MM).contains(&mm) {
                return Err(SliceError::LayerHeight { option, mm });
            }
        }
        Ok(())
    }
}

/// Where all layers begin and end.
#[derive(Debug)]
pub(super) enum Levels {
    /// As the user wants them.
    Even(LayerHeights),
    /// As they are given, mm.
    Given(Vec<[f64; 2]>),
}

impl Levels {
    /// A layer of nothing, with its number and heights.
    pub(super) fn empty_layer(&self, number: u32) -> Layer {
        let [bottom_mm, top_mm] = match self {
            Levels::Even(heights) => heights.of(number),
            Levels::Given(levels) => levels[number as usize],
        };
        Layer { number, bottom_mm, top_mm, ..Layer::default() }
    }

    /// The planes from the plate up, in grid steps: the middle of each layer, rounded by
    /// itself. A part whose top is there ends in the last layer whose middle it reaches
    /// beyond; layers that are given go on above it, empty.
    pub(super) fn planes(&self, top: i32) -> Result<Vec<i32>, SliceError> {
        match self {
            Levels::Even(heights) => self.below(*heights, top),
            Levels::Given(levels) => self.rising(levels.len() as u32),
        }
    }

    /// A layer's plane, in grid steps.
    fn plane(&self, number: u32) -> f64 {
        (self.empty_layer(number).plane_mm() * UNITS_PER_MM).round()
    }

    /// Planes of heights from a job.
    fn rising(&self, count: u32) -> Result<Vec<i32>, SliceError> {
        // What is not finite or too high for the grid becomes something that does not rise.
        let planes: Vec<i32> = (0..count).map(|number| self.plane(number) as i32).collect();
        let falls = planes.windows(2).position(|p| p[1] <= p[0]).map(|k| k + 1);
        match falls.or(planes.first().is_none_or(|p| *p < 0).then_some(0)) {
            Some(layer) => Err(SliceError::Heights { layer: layer as u32 }),
            None => Ok(planes),
        }
    }

    /// Planes of layers of one thickness.
    fn below(&self, heights: LayerHeights, top: i32) -> Result<Vec<i32>, SliceError> {
        heights.check()?;
        let part_mm = f64::from(top) / UNITS_PER_MM;
        let expected = (part_mm - heights.first_mm) / heights.layer_mm + 1.0;
        if expected > f64::from(MAX_LAYERS) {
            return Err(SliceError::TooManyLayers { part_mm, layer_mm: heights.layer_mm });
        }
        let mut planes = Vec::with_capacity(expected.max(0.0) as usize + 2);
        for number in 0.. {
            let plane = self.plane(number);
            if plane >= f64::from(top) {
                break;
            }
            planes.push(plane as i32);
        }
        if planes.is_empty() {
            return Err(SliceError::Flat { part_mm, first_mm: heights.first_mm });
        }
        Ok(planes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_the_middles_of_the_layers() {
        let check = |layer_mm: f64, first_mm: f64, top: i32, expect: Result<&[i32], &str>| {
            let found =
                Levels::Even(LayerHeights { layer_mm, first_mm }).planes(top).map_err(|e| e.to_string());
            match (&found, expect) {
                (Ok(planes), Ok(expect)) => assert_eq!(planes, expect),
                (Err(message), Err(part)) => assert!(message.contains(part), "{message}"),
                _ => panic!("{found:?} instead of {expect:?}"),
            }
        };
        check(0.2, 0.2, 6000, Ok(&[1000, 3000, 5000]));
        // The third plane is at the very top: there is nothing above it.
        check(0.2, 0.2, 5000, Ok(&[1000, 3000]));
        check(0.2, 0.3, 7000, Ok(&[1500, 4000, 6000]));
        check(0.025, 0.025, 501, Ok(&[125, 375]));
        check(0.2, 0.2, 1000, Err("less than half"));
        check(0.2, 0.2, 0, Err("less than half"));
        for mm in [0.0, -0.1, 1e-9, 1e9, f64::NAN, f64::INFINITY] {
            check(mm, 0.2, 5000, Err("--layer-height"));
            check(0.2, mm, 5000, Err("--first-layer-height"));
        }
        check(0.001, 0.2, 500_000_000, Err("--layer-height"));
    }

    #[test]
    fn heights_do_not_drift() {
        let heights = LayerHeights::even(0.025);
        let last = *Levels::Even(heights).planes(200_000_000).unwrap().last().unwrap();
        assert_eq!(last, 200_000_000 - 125);
    }

    #[test]
    fn planes_of_a_job_are_the_middles_of_its_layers_as_long_as_they_rise() {
        let check = |levels: &[[f64; 2]], expect: Result<&[i32], u32>| {
            let expect = expect.map(<[i32]>::to_vec).map_err(|layer| SliceError::Heights { layer });
            assert_eq!(Levels::Given(levels.to_vec()).planes(1000), expect);
        };
        check(&[[0.0, 0.3], [0.3, 0.4], [0.4, 0.6]], Ok(&[1500, 3500, 5000]));
        check(&[[0.0, 0.3], [0.3, 0.2]], Ok(&[1500, 2500]));
        check(&[[0.0, 0.3], [0.0, 0.3]], Err(1));
        check(&[[0.0, 0.2], [0.2, f64::NAN]], Err(1));
        check(&[[0.0, 0.2], [1e9, 1e9], [1e9, 2e9]], Err(2));
        check(&[[-1.0, 0.2]], Err(0));
        check(&[], Err(0));
    }
}
