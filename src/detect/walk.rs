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
use super::resin::voids::Hollows;
use super::resin::{self, Issues, Look};
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
    /// What would go wrong with a resin job ([`super::resin`]), in layers that keep their pictures.
    pub resin: bool,
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
    /// What would go wrong with a resin job.
    Resin,
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

/// Someone or nobody.
impl<W: Watch> Watch for Option<W> {
    fn lap(&mut self, stage: Stage) {
        if let Some(watch) = self {
            watch.lap(stage);
        }
    }

    fn layer(&mut self, seen: &Seen<'_>) {
        if let Some(watch) = self {
            watch.layer(seen);
        }
    }
}

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
    /// What would go wrong with a resin job, if asked for.
    pub resin: Option<Issues>,
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
    let mut pictures = ask.resin.then(Pictures::default);
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
        if let Some(pictures) = &mut pictures {
            pictures.batch(&pairs);
            watch.lap(Stage::Resin);
        }
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
        resin: pictures.map(|pictures| pictures.checks.finish()),
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

/// A resin job's pictures, on their way up.
#[derive(Default)]
struct Pictures {
    checks: resin::Checks,
    /// Those of the last layer.
    hollows: Option<Hollows>,
}

impl Pictures {
    fn batch(&mut self, pairs: &[(&Layer, &Layer)]) {
        let hollows: Vec<Option<Hollows>> =
            pairs.par_iter().map(|(_, layer)| layer.picture.as_ref().map(Hollows::of)).collect();
        let lower: Vec<Option<&Hollows>> =
            std::iter::once(self.hollows.as_ref()).chain(hollows.iter().map(Option::as_ref)).collect();
        let looks: Vec<Look> = pairs
            .par_iter()
            .zip(&hollows)
            .zip(lower)
            .filter_map(|(((below, layer), own), lower)| {
                let below = below.picture.as_ref().zip(lower);
                Some(Look::at(below, layer.picture.as_ref()?, own.as_ref()?))
            })
            .collect();
        for ((_, layer), look) in pairs.iter().zip(&looks) {
            self.checks.push(layer.number, [layer.bottom_mm, layer.top_mm], look);
        }
        self.hollows = hollows.into_iter().next_back().flatten();
    }
}

#[cfg(test)]
mod tests {
    use super::super::island::Standing;
    use super::super::testing::{layer, region};
    use super::*;
    use std::convert::Infallible;

    /// Layers in batches of this many.
    struct Given(Vec<Layer>, usize);

    impl Layers for Given {
        type Error = Infallible;

        fn count(&self) -> Option<u32> {
            None
        }

        fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, Infallible> {
            let batch: Vec<Layer> = self.0.drain(..self.1.min(self.0.len())).collect();
            Ok((!batch.is_empty()).then_some(batch))
        }
    }

    /// Notes what it sees.
    #[derive(Default)]
    struct Notes {
        laps: Vec<Stage>,
        layers: Vec<(u32, usize, usize)>,
    }

    impl Watch for Notes {
        fn lap(&mut self, stage: Stage) {
            self.laps.push(stage);
        }

        fn layer(&mut self, seen: &Seen<'_>) {
            assert_eq!(seen.standings.part.len(), seen.layer.part.polygons.len());
            let bodies = seen.standings.part.iter().filter(|s| **s == Standing::Body).count();
            self.layers.push((seen.layer.number, bodies, seen.overhang.len()));
        }
    }

    /// A post with a wall that leans out at 60°, a roof, and an island under the roof.
    fn scene() -> Vec<Layer> {
        let lean = 0.1 * f64::to_radians(60.0).tan();
        (0..20_u32)
            .map(|k| {
                let right = 2.0 + lean * f64::from(k.min(15));
                let mut rectangles = vec![[0.0, 0.0, right, 2.0]];
                if k >= 4 {
                    rectangles.push([8.0, 0.0, 9.0, 1.0]);
                }
                if k >= 16 {
                    rectangles.push([0.0, 0.0, 9.0, 2.0]);
                }
                layer(k, region(&rectangles, &[]))
            })
            .collect()
    }

    fn ask() -> Ask {
        let rules = SelfSupport { angle_deg: 45.0, bridge_mm: 0.0, min_area_mm2: 0.5 };
        Ask {
            min_island_mm2: 0.1,
            layer: Some(LayerAsk { rules, growth: Growth::Conditional }),
            image: Some(ImageAsk { rules, growth: Growth::Conditional, pixel_mm: 0.02 }),
            resin: false,
        }
    }

    #[test]
    fn batches_change_nothing() {
        let mut all = Vec::new();
        for size in [1, 3, 20] {
            let mut notes = Notes::default();
            let Ok(found) = walk(&mut Given(scene(), size), &ask(), &mut notes);
            let laps = notes.laps.len();
            assert_eq!(laps, 4 * 20_usize.div_ceil(size));
            assert_eq!(notes.laps[..4], [Stage::Slice, Stage::Islands, Stage::Overhangs, Stage::Watch]);
            all.push((found, notes.layers));
        }
        assert!(all[0] == all[1] && all[0] == all[2]);
        let (found, seen) = &all[0];
        assert_eq!((found.layers, seen.len()), (20, 20));
        assert!((found.height_mm - 2.0).abs() < 1e-9);
        // Layers 1 to 15 have a strip each, layer 4 the island besides, 16 the roof.
        let overhangs: Vec<usize> = seen.iter().map(|s| s.2).collect();
        let expect: Vec<usize> = (0..20)
            .map(|k| match k {
                4 => 2,
                1..=16 => 1,
                _ => 0,
            })
            .collect();
        assert_eq!(overhangs, expect);
    }

    #[test]
    fn strips_of_neighbouring_layers_are_one_region() {
        let Ok(found) = walk(&mut Given(scene(), 4), &ask(), &mut ());
        let island = &found.islands.islands[0];
        assert_eq!((found.islands.islands.len(), island.layer, island.end_layer), (1, 4, 16));
        for (overhangs, tolerance) in [(found.layer, 0.001), (found.image, 0.02)] {
            let overhangs = overhangs.expect("was asked for");
            // The leaning wall goes over into the roof; the island is by itself.
            let regions: Vec<_> =
                overhangs.regions.iter().map(|r| (r.layer, r.end_layer, r.island)).collect();
            assert_eq!(regions, [(1, 16, false), (4, 4, true)], "{overhangs:?}");
            let lean = 0.1 * f64::to_radians(60.0).tan();
            let (reach, right) = (0.1 + overhang_layer::SLACK_MM, 2.0 + 15.0 * lean);
            let strips = 15.0 * (lean - reach) * 2.0;
            // Under the roof: what neither the wall nor the island holds beside it.
            let beside = 1.0 + 2.0 * reach + reach * reach * std::f64::consts::FRAC_PI_4;
            let expect = strips + 2.0 * (9.0 - right - reach) - beside;
            let got = overhangs.regions[0].area_mm2;
            assert!((got / expect - 1.0).abs() < tolerance, "{got} {expect}");
            assert!((overhangs.regions[1].area_mm2 - 1.0).abs() < tolerance);
            assert!((overhangs.area_mm2 - got - overhangs.regions[1].area_mm2).abs() < 1e-9);
        }
    }

    #[test]
    fn small_regions_and_islands_are_listed_apart() {
        let mut ask = ask();
        (ask.min_island_mm2, ask.image) = (1.1, None);
        if let Some(layer) = &mut ask.layer {
            layer.rules.min_area_mm2 = 1.1;
        }
        let Ok(found) = walk(&mut Given(scene(), 4), &ask, &mut ());
        assert_eq!((found.islands.islands.len(), found.islands.small.len()), (0, 1));
        let overhangs = found.layer.expect("was asked for");
        assert_eq!((overhangs.regions.len(), overhangs.small.len()), (1, 1));
        assert!((overhangs.small_area_mm2 - 1.0).abs() < 1e-3);
        assert_eq!(found.image, None);
    }
}
