//! One walk over the layers of a job: islands and overhangs, as asked for.
//!
//! Takes layers in batches. What concerns a pair of layers is found in parallel over
//! the batch; what has a memory is folded in order. So the memory is bounded by a
//! batch, and the result does not depend on the number of threads. Keeps no time
//! itself: [`Watch::lap`] tells the caller what the time since the last call was for.
use super::island::{Found, Islands, Standings};
use super::links::{Links, links};
use super::overhang::{Growth, Method, Overhangs, Piece, SelfSupport};
use super::regions::{Regions, joins};
use super::{overhang_image, overhang_layer};
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
    pub overhang: &'a [Piece],
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
    let mut islands = Islands::new();
    let by_layer = ask.layer.map(|a| Track::new(How::Layer(a), Method::Layer, a.rules.min_area_mm2));
    let by_image = ask.image.map(|a| Track::new(How::Image(a), Method::Image, a.rules.min_area_mm2));
    let mut tracks: Vec<Track> = by_layer.into_iter().chain(by_image).collect();
    let mut below = Layer::default();
    let (mut count, mut height_mm) = (0, 0.0);
    while let Some(batch) = layers.next_batch()? {
        watch.lap(Stage::Slice);
        let pairs: Vec<(&Layer, &Layer)> = std::iter::once(&below).chain(&batch).zip(&batch).collect();
        let linked: Vec<Links> = pairs.par_iter().map(|(below, layer)| links(below, layer)).collect();
        let standings: Vec<Standings> =
            batch.iter().zip(&linked).map(|(layer, links)| islands.push(layer, links)).collect();
        watch.lap(Stage::Islands);
        tracks.iter_mut().for_each(|track| track.batch(&pairs, &linked));
        watch.lap(Stage::Overhangs);
        for (k, (layer, standings)) in batch.iter().zip(&standings).enumerate() {
            let pieces = tracks.first().and_then(|t| t.pieces.get(k)).map_or(&[][..], |p| p);
            watch.layer(&Seen { layer, standings, overhang: pieces });
            (count, height_mm) = (layer.number + 1, layer.top_mm);
        }
        watch.lap(Stage::Watch);
        if let Some(last) = batch.into_iter().next_back() {
            below = last;
        }
    }
    let mut findings = Findings {
        layers: count,
        height_mm,
        islands: islands.finish(ask.min_island_mm2),
        layer: None,
        image: None,
    };
    for track in tracks {
        let found = track.regions.finish();
        if found.method == Method::Layer {
            findings.layer = Some(found)
        } else {
            findings.image = Some(found)
        }
    }
    Ok(findings)
}

/// Which way overhangs are looked for.
#[derive(Clone, Copy)]
enum How {
    Layer(LayerAsk),
    Image(ImageAsk),
}

impl How {
    fn reach_mm(&self, below: &Layer, layer: &Layer) -> f64 {
        let (How::Layer(LayerAsk { rules, .. }) | How::Image(ImageAsk { rules, .. })) = self;
        overhang_layer::reach_mm(below, layer, rules.angle_deg)
    }

    fn pieces(&self, below: &Layer, layer: &Layer, links: &Links) -> Vec<Piece> {
        match self {
            How::Layer(ask) => overhang_layer::pieces(below, layer, links, &ask.rules, ask.growth),
            How::Image(ask) => {
                let reach = self.reach_mm(below, layer);
                overhang_image::pieces(below, layer, links, reach, ask.growth, ask.pixel_mm)
            }
        }
    }
}

/// One way to look for overhangs, on its way up.
struct Track {
    how: How,
    regions: Regions,
    /// Those of each layer of the batch.
    pieces: Vec<Vec<Piece>>,
}

impl Track {
    fn new(how: How, method: Method, min_area_mm2: f64) -> Track {
        Track { how, regions: Regions::new(method, min_area_mm2), pieces: Vec::new() }
    }

    /// The pieces of a batch's layers, and the regions up to its end.
    fn batch(&mut self, pairs: &[(&Layer, &Layer)], linked: &[Links]) {
        let last = self.pieces.pop().unwrap_or_default();
        let how = self.how;
        self.pieces = pairs
            .par_iter()
            .zip(linked)
            .map(|((below, layer), links)| how.pieces(below, layer, links))
            .collect();
        let lower: Vec<&Vec<Piece>> = std::iter::once(&last).chain(&self.pieces).collect();
        let joins: Vec<Vec<(u32, u32)>> = pairs
            .par_iter()
            .zip(&self.pieces)
            .zip(lower)
            .map(|(((below, layer), pieces), lower)| joins(lower, pieces, how.reach_mm(below, layer)))
            .collect();
        for (((_, layer), pieces), joins) in pairs.iter().zip(&self.pieces).zip(&joins) {
            self.regions.push(layer.number, layer.plane_mm(), pieces, joins);
        }
    }
}
