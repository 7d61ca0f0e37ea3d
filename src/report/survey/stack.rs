//! All layers, simplified and packed, for the page: bounded, whatever the job.
//!
//! Takes layers, keeps them packed. When they pass [`BYTES_MAX`] they get
//! coarser, up to [`TOLERANCE_MAX_MM`]; then every second layer goes, but those
//! where an island appears; then of these too. What was done is told.
use super::Seen;
use super::class::Class;
use super::pack::{Packed, pack, repack};
use crate::report::embed::put;

/// Most bytes of packed layers. Compressed and as text they take less than that.
pub const BYTES_MAX: usize = 12 << 20;

/// How far lines may be moved at first, mm: less than a printer can show.
const TOLERANCE_MM: f64 = 0.01;

/// How far lines may be moved at most, mm: less than a pixel of a screen that shows 100 mm.
const TOLERANCE_MAX_MM: f64 = 0.08;

/// Bytes besides the pieces that a layer is taken to need.
const OVERHEAD: usize = 16;

#[derive(Debug)]
struct Kept {
    number: u32,
    bottom_mm: f64,
    top_mm: f64,
    /// Whether an island appears.
    eventful: bool,
    packed: Packed,
}

/// The layers of a page.
#[derive(Debug)]
pub struct Stack {
    layers: Vec<Kept>,
    bytes: usize,
    tolerance_mm: f64,
    /// Layers between two that are kept although nothing happens in them.
    stride: u32,
    seen: u32,
    budget: usize,
}

impl Default for Stack {
    fn default() -> Stack {
        Stack::with_budget(BYTES_MAX)
    }
}

/// What a page holds of a job's layers.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Kind {
    /// Layers in the page.
    pub layers: usize,
    /// Layers of the job.
    pub of: u32,
    /// How far lines are from where they were, at most, mm.
    pub tolerance_mm: f64,
    /// Polygons that had no room, the smallest of their layers.
    pub left_out: u64,
}

impl Stack {
    /// With room for so many bytes.
    #[must_use]
    pub fn with_budget(budget: usize) -> Stack {
        Stack { layers: Vec::new(), bytes: 0, tolerance_mm: TOLERANCE_MM, stride: 1, seen: 0, budget }
    }

    /// Takes the next layer.
    pub fn add(&mut self, seen: Seen) {
        self.seen += 1;
        let eventful = seen.pieces().any(|(class, _)| class == Class::Appears);
        if !eventful && !seen.layer.number.is_multiple_of(self.stride) {
            return;
        }
        let packed = pack(seen.pieces(), self.tolerance_mm);
        self.bytes += packed.bytes.len() + OVERHEAD;
        let (number, bottom_mm, top_mm) = (seen.layer.number, seen.layer.bottom_mm, seen.layer.top_mm);
        self.layers.push(Kept { number, bottom_mm, top_mm, eventful, packed });
        while self.bytes > self.budget && self.layers.len() > 1 {
            self.shrink();
        }
    }

    fn shrink(&mut self) {
        if self.tolerance_mm < TOLERANCE_MAX_MM {
            self.tolerance_mm = (self.tolerance_mm * 2.0).min(TOLERANCE_MAX_MM);
            for layer in &mut self.layers {
                let left_out = layer.packed.left_out;
                layer.packed = repack(&layer.packed.bytes, self.tolerance_mm);
                layer.packed.left_out += left_out;
            }
        } else if self.layers.iter().filter(|l| !l.eventful).count() * 4 > self.layers.len() {
            self.stride = self.stride.saturating_mul(2);
            let stride = self.stride;
            self.layers.retain(|l| l.eventful || l.number.is_multiple_of(stride));
        } else {
            let mut keep = false;
            self.layers.retain(|_| {
                keep = !keep;
                keep
            });
        }
        self.bytes = self.layers.iter().map(|l| l.packed.bytes.len() + OVERHEAD).sum();
    }

    /// What it holds.
    #[must_use]
    pub fn kind(&self) -> Kind {
        Kind {
            layers: self.layers.len(),
            of: self.seen,
            // Each time they got coarser came on top of what was before.
            tolerance_mm: 2.0 * self.tolerance_mm - TOLERANCE_MM,
            left_out: self.layers.iter().map(|l| u64::from(l.packed.left_out)).sum(),
        }
    }

    /// The layers one after the other, each `number, bottom in µm, top in µm,
    /// bytes` as varints, and then so many bytes as [`super::pack`] says.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let mut out = Vec::with_capacity(self.bytes);
        let um = |mm: f64| (mm * 1000.0).round().max(0.0) as u64;
        for layer in &self.layers {
            put(&mut out, u64::from(layer.number));
            put(&mut out, um(layer.bottom_mm));
            put(&mut out, um(layer.top_mm));
            put(&mut out, layer.packed.bytes.len() as u64);
            out.extend_from_slice(&layer.packed.bytes);
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::island::Standing;
    use crate::layers::shape::{Point, Polygon, Region};
    use crate::layers::stack::Layer;

    /// A layer whose outline is a circle of many points.
    fn layer(number: u32, points: u32) -> Layer {
        let at = |k: u32| {
            let turn = f64::from(k) / f64::from(points) * std::f64::consts::TAU;
            Point::from_mm(20.0 * turn.cos(), 20.0 * turn.sin())
        };
        Layer {
            number,
            bottom_mm: f64::from(number) * 0.1,
            top_mm: f64::from(number + 1) * 0.1,
            part: Region { polygons: vec![Polygon { rings: vec![(0..points).map(at).collect()] }] },
            ..Layer::default()
        }
    }

    fn add(stack: &mut Stack, number: u32, points: u32, standing: Standing) {
        let layer = layer(number, points);
        stack.add(Seen { layer: &layer, standings: &[standing], overhangs: &[] });
    }

    #[test]
    fn a_small_job_is_kept_whole() {
        let mut stack = Stack::default();
        (0..50).for_each(|k| add(&mut stack, k, 1000, Standing::Body));
        assert_eq!(stack.kind(), Kind { layers: 50, of: 50, tolerance_mm: TOLERANCE_MM, left_out: 0 });
    }

    #[test]
    fn a_large_one_gets_coarser_and_then_thinner_but_keeps_its_events() {
        let mut stack = Stack::with_budget(20_000);
        let standing = |k| if k % 97 == 50 { Standing::Appears } else { Standing::Body };
        for k in 0..1000 {
            add(&mut stack, k, 500, standing(k));
            assert!(stack.bytes <= 20_000);
        }
        let kind = stack.kind();
        assert_eq!((kind.of, kind.tolerance_mm), (1000, 2.0 * TOLERANCE_MAX_MM - TOLERANCE_MM));
        assert!(kind.layers > 60 && kind.layers < 600, "{kind:?}");
        let numbers: Vec<u32> = stack.layers.iter().map(|l| l.number).collect();
        assert!((0..1000).filter(|k| k % 97 == 50).all(|k| numbers.contains(&k)), "{numbers:?}");
        assert!(numbers.windows(2).all(|w| w[0] < w[1]));
        assert!(stack.bytes().len() <= 20_000);
    }

    #[test]
    fn events_everywhere_are_bounded_too() {
        let mut stack = Stack::with_budget(10_000);
        (0..2000).for_each(|k| add(&mut stack, k, 300, Standing::Appears));
        assert!(stack.bytes().len() <= 10_000 && stack.kind().layers > 10);
    }
}
