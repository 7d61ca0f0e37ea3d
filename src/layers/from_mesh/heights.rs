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

    /// A layer of nothing, with its number and heights. Each height is computed by
    /// itself, so that nothing adds up.
    pub(super) fn empty_layer(self, number: u32) -> Layer {
        let top = |n: u32| self.first_mm + f64::from(n) * self.layer_mm;
        let bottom_mm = number.checked_sub(1).map_or(0.0, top);
        Layer { number, bottom_mm, top_mm: top(number), ..Layer::default() }
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

/// The planes below the top of a part, from the plate up, in grid steps: the middle
/// of each layer, rounded by itself. A part ends in the last layer whose middle it
/// reaches beyond.
pub(super) fn planes(heights: LayerHeights, top: i32) -> Result<Vec<i32>, SliceError> {
    heights.check()?;
    let part_mm = f64::from(top) / UNITS_PER_MM;
    let expected = (part_mm - heights.first_mm) / heights.layer_mm + 1.0;
    if expected > f64::from(MAX_LAYERS) {
        return Err(SliceError::TooManyLayers { part_mm, layer_mm: heights.layer_mm });
    }
    let mut planes = Vec::with_capacity(expected.max(0.0) as usize + 2);
    for number in 0.. {
        let plane = (heights.empty_layer(number).plane_mm() * UNITS_PER_MM).round();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn planes_are_the_middles_of_the_layers() {
        let check = |layer_mm: f64, first_mm: f64, top: i32, expect: Result<&[i32], &str>| {
            let found = planes(LayerHeights { layer_mm, first_mm }, top).map_err(|e| e.to_string());
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
        let last = *planes(heights, 200_000_000).unwrap().last().unwrap();
        assert_eq!(last, 200_000_000 - 125);
    }
}
