//! One look at a job's layers: what must be held, and where branches may go.
use super::clearance::{Clearance, Drawing};
use super::demand::{Demand, Gather, ask};
use super::rules::Rules;
use crate::detect::overhang::SelfSupport;
use crate::detect::walk::{Findings, Seen, Stage, Watch, walk};
use crate::layers::shape::{Bounds, Region};
use crate::layers::stack::{Layer, Layers};

/// What was seen.
#[derive(Debug)]
pub struct Look {
    /// What must be held.
    pub demand: Demand,
    /// Where branches may go.
    pub space: Clearance,
    /// What detection says of the part.
    pub findings: Findings,
    /// The part lies within these; what is printed beside it may not.
    pub part: Bounds,
}

/// Layers that are drawn as they pass.
struct Drawn<'a, L> {
    layers: &'a mut L,
    drawing: Drawing,
    part: Bounds,
}

impl<L: Layers> Layers for Drawn<'_, L> {
    type Error = L::Error;

    fn count(&self) -> Option<u32> {
        self.layers.count()
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, L::Error> {
        let batch = self.layers.next_batch()?;
        if let Some(batch) = &batch {
            self.drawing.add(batch);
            self.part = batch.iter().fold(self.part, |all, layer| all.joined(layer.part.bounds()));
        }
        Ok(batch)
    }
}

/// Shows each layer to two who look on.
struct Both<'a, W> {
    gather: Gather,
    other: &'a mut W,
}

impl<W: Watch> Watch for Both<'_, W> {
    fn lap(&mut self, stage: Stage) {
        self.other.lap(stage);
    }

    fn layer(&mut self, seen: &Seen<'_>) {
        self.gather.layer(seen);
        self.other.layer(seen);
    }
}

/// Looks at all layers of a part within `bounds` and `height_mm`, on a plate (without a border
/// where that is empty), by what its material holds itself, for supports by these rules.
///
/// # Errors
/// Those of the layers' source.
pub fn look<L: Layers>(
    layers: &mut L,
    (bounds, height_mm): (Bounds, f64),
    plate: &Region,
    own: SelfSupport,
    rules: &Rules,
    watch: &mut impl Watch,
) -> Result<Look, L::Error> {
    let mut drawn = Drawn { layers, drawing: Drawing::new(bounds, height_mm, plate), part: Bounds::EMPTY };
    let mut both = Both { gather: Gather::new(rules.cell_mm()), other: watch };
    let findings = walk(&mut drawn, &ask(own), &mut both)?;
    let demand = both.gather.finish(&findings.islands.islands, own.min_area_mm2, rules.caught_mm);
    Ok(Look { demand, space: drawn.drawing.finish(), findings, part: drawn.part })
}
