//! What would go wrong with a resin job, seen in its pictures.
//!
//! Takes each layer's [`Raster`], gives [`Issue`]s with the names that UVtools' users know, one
//! detector a file. What concerns a layer and the one below is found for itself ([`Look`]), on any
//! thread; what has a memory is folded from the plate up ([`Checks`]). Places are in pixels of the
//! pictures. Knows no panel and no picture's format.
//!
//! # Layout
//! - [`island`]: pieces that too little of the layer below holds
//! - [`overhang`]: pieces that reach out too far over it
//! - [`voids`]: resin traps and suction cups; [`drain`]: where a hole would let it out
//! - [`bounds`]: what lies at the panel's margin; empty layers need no file
//! - [`specks`]: islands that may be left out
//! - [`exposure`]: settings that are a slip; needs no picture
pub mod bounds;
pub mod drain;
pub mod exposure;
pub mod island;
pub mod overhang;
#[cfg(test)]
mod reference;
pub mod specks;
pub mod voids;

use crate::layers::raster::{Piece, Raster};
use voids::{Hollows, Links, Voids};

/// Issues that are listed; more are counted.
pub const MAX_ISSUES: usize = 10_000;

/// What kind of issue.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// A piece that begins in the air.
    Island,
    /// A piece that reaches out too far.
    Overhang,
    /// A hollow that stays full of resin.
    ResinTrap,
    /// A hollow that is closed towards the plate and sucks at each peel.
    SuctionCup,
    /// Something at the panel's margin.
    TouchingBounds,
    /// A layer without a pixel.
    EmptyLayer,
}

/// Something that would go wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Issue {
    /// What.
    pub kind: Kind,
    /// Its lowest layer.
    pub layer: u32,
    /// Its highest layer.
    pub end_layer: u32,
    /// Its pixels in the layer where it is largest.
    pub pixels: u64,
    /// Pixels times the heights of their layers, px mm; of hollows only, else 0.
    pub volume_px_mm: f64,
    /// Centre of gravity in the layer where it is largest, column and row.
    pub centroid_px: [f64; 2],
    /// First column and row that it touches, and those behind the last.
    pub box_px: [[u32; 2]; 2],
}

impl Issue {
    fn of(kind: Kind, layer: u32, piece: &Piece) -> Issue {
        Issue {
            kind,
            layer,
            end_layer: layer,
            pixels: piece.pixels,
            volume_px_mm: 0.0,
            centroid_px: piece.centroid(),
            box_px: [piece.low, piece.high],
        }
    }
}

/// What was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Issues {
    /// By kind, then from the plate up.
    pub list: Vec<Issue>,
    /// Issues that are in no list because there are too many; usually 0.
    pub unlisted: u64,
}

/// What is found in a layer with the one below it in view.
#[derive(Debug, Default)]
pub struct Look {
    islands: Vec<Piece>,
    overhangs: Vec<Piece>,
    margin: Option<Piece>,
    empty: bool,
    links: Links,
}

impl Look {
    /// Looks at a layer and the one below it; `hollows` are those of the two. The lowest layer has
    /// the plate below it, which holds all.
    #[must_use]
    pub fn at(below: Option<(&Raster, &Hollows)>, layer: &Raster, hollows: &Hollows) -> Look {
        let above_plate = |find: fn(&Raster, &Raster) -> Vec<Piece>| {
            below.map_or_else(Vec::new, |(below, _)| find(layer, below))
        };
        Look {
            islands: above_plate(island::islands),
            overhangs: above_plate(overhang::overhangs),
            margin: bounds::touching(layer),
            empty: layer.is_black(),
            links: hollows.links(below.map(|(_, below)| below)),
        }
    }
}

/// What was found up to a layer.
#[derive(Debug, Default)]
pub struct Checks {
    found: Issues,
    voids: Voids,
    /// What goes on from layer to layer.
    margin: Option<Issue>,
    empty: Option<Issue>,
}

impl Checks {
    /// Takes the next layer from the plate up, which lies between those heights.
    pub fn push(&mut self, layer: u32, span_mm: [f64; 2], look: &Look) {
        for (kind, pieces) in [(Kind::Island, &look.islands), (Kind::Overhang, &look.overhangs)] {
            for piece in pieces {
                self.found.add(Issue::of(kind, layer, piece));
            }
        }
        let margin = look.margin.as_ref().map(|piece| Issue::of(Kind::TouchingBounds, layer, piece));
        let nowhere = Issue {
            kind: Kind::EmptyLayer,
            layer,
            end_layer: layer,
            pixels: 0,
            volume_px_mm: 0.0,
            centroid_px: [0.0; 2],
            box_px: [[0; 2]; 2],
        };
        let empty = look.empty.then_some(nowhere);
        for (open, now) in [(&mut self.margin, margin), (&mut self.empty, empty)] {
            if let Some(over) = go_on(open, now) {
                self.found.add(over);
            }
        }
        self.voids.push(layer, span_mm, &look.links, |issue| self.found.add(issue));
    }

    /// The layers are over.
    #[must_use]
    pub fn finish(self) -> Issues {
        let Checks { mut found, voids, margin, empty } = self;
        voids.finish(|issue| found.add(issue));
        margin.into_iter().chain(empty).for_each(|open| found.add(open));
        found.list.sort_by_key(|issue| (issue.kind, issue.layer, issue.box_px));
        found
    }
}

impl Issues {
    fn add(&mut self, issue: Issue) {
        if self.list.len() < MAX_ISSUES { self.list.push(issue) } else { self.unlisted += 1 }
    }
}

/// Layers one upon another with the same issue are one issue; gives the one that is over.
fn go_on(open: &mut Option<Issue>, now: Option<Issue>) -> Option<Issue> {
    let Some(now) = now else { return open.take() };
    let Some(before) = open else {
        *open = Some(now);
        return None;
    };
    let [low, high] = before.box_px;
    let [now_low, now_high] = now.box_px;
    before.box_px = [
        [low[0].min(now_low[0]), low[1].min(now_low[1])],
        [high[0].max(now_high[0]), high[1].max(now_high[1])],
    ];
    before.end_layer = now.layer;
    if now.pixels > before.pixels {
        (before.pixels, before.centroid_px) = (now.pixels, now.centroid_px);
    }
    None
}
