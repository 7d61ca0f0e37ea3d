//! One walk over the layers of a job: islands and overhangs, as asked for.
//!
//! Takes layers in batches. What concerns a pair of layers is found in parallel over
//! the batch; what has a memory is folded in order. So the memory is bounded by a
//! batch, and the result does not depend on the number of threads. Keeps no time
//! itself: [`Watch::lap`] tells the caller what the time since the last call was for.
use super::island::{Found, Islands, Standings};
use super::links::{Links, links};
use super::overhang::{Growth, Overhangs, SelfSupport};
use crate::layers::shape::Region;
use crate::layers::stack::{Layer, Layers};
use rayon::prelude::*;

/// What to look for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Ask {
    /// Islands whose area stays below this are listed apart, mm².
    pub min_island_mm2: f64,
    /// Overhangs in polygons ([`super::overhang_layer`]).
    pub layer: Option<LayerAsk>,
    /// Overhangs in images ([`super::overhang_image`]).
    pub image: Option<ImageAsk>,
}

/// How to look for overhangs in polygons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerAsk {
    /// What holds itself.
    pub rules: SelfSupport,
    /// How what is held spreads.
    pub growth: Growth,
}

/// How to look for overhangs in images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImageAsk {
    /// What holds itself; bridges are no concern of images.
    pub rules: SelfSupport,
    /// How what is held spreads.
    pub growth: Growth,
    /// Side of a pixel, mm.
    pub pixel_mm: f64,
}

/// What the time since the last call was for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Getting a batch of layers.
    Slice,
    /// Islands.
    Islands,
    /// Overhangs, whichever way.
    Overhangs,
    /// Whatever [`Watch::layer`] did.
    Watch,
}

/// A layer with what was found in it.
#[derive(Debug)]
pub struct Seen<'a> {
    /// The layer.
    pub layer: &'a Layer,
    /// What each of its polygons is.
    pub standings: &'a Standings,
    /// Where it overhangs: of the polygons, or of the images where only these were asked for.
    pub overhang: &'a Region,
}

/// Someone who looks on: takes the time, shows progress, draws pictures.
pub trait Watch {
    /// A stage of a batch has ended.
    fn lap(&mut self, _stage: Stage) {}
    /// A layer is done; called in order.
    fn layer(&mut self, _seen: &Seen<'_>) {}
}

/// Nobody.
impl Watch for () {}

/// What the walk found.
#[derive(Clone, Debug, PartialEq)]
pub struct Findings {
    /// Number of layers.
    pub layers: u32,
    /// Height of the top of the last layer, mm.
    pub height_mm: f64,
    /// Islands.
    pub islands: Found,
    /// Overhangs by polygons, if asked for.
    pub layer: Option<Overhangs>,
    /// Overhangs by images, if asked for.
    pub image: Option<Overhangs>,
}

/// Walks over all layers.
///
/// # Errors
/// Those of the layers' source.
pub fn walk<L: Layers>(layers: &mut L, ask: &Ask, watch: &mut impl Watch) -> Result<Findings, L::Error> {
    let mut fold = Fold::new(ask);
    let mut below = Layer::default();
    while let Some(batch) = layers.next_batch()? {
        watch.lap(Stage::Slice);
        let pairs: Vec<(&Layer, &Layer)> = std::iter::once(&below).chain(&batch).zip(&batch).collect();
        let linked: Vec<Links> = pairs.par_iter().map(|(below, layer)| links(below, layer)).collect();
        let standings: Vec<Standings> =
            batch.iter().zip(&linked).map(|(layer, links)| fold.islands.push(layer, links)).collect();
        watch.lap(Stage::Islands);
        for (layer, standings) in batch.iter().zip(&standings) {
            fold.last = (layer.number + 1, layer.top_mm);
            watch.layer(&Seen { layer, standings, overhang: &Region::default() });
        }
        watch.lap(Stage::Watch);
        if let Some(last) = batch.into_iter().next_back() {
            below = last;
        }
    }
    Ok(fold.finish(ask))
}

/// What has a memory.
struct Fold {
    islands: Islands,
    /// Number of layers, height of the last one's top.
    last: (u32, f64),
}

impl Fold {
    fn new(_ask: &Ask) -> Fold {
        Fold { islands: Islands::new(), last: (0, 0.0) }
    }

    fn finish(self, ask: &Ask) -> Findings {
        let (layers, height_mm) = self.last;
        let islands = self.islands.finish(ask.min_island_mm2);
        Findings { layers, height_mm, islands, layer: None, image: None }
    }
}
