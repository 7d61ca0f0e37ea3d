//! Layers from sliced G-code: the beads of each layer, each swept with its width, united.
//!
//! Takes the text of a job (and no model), gives [`BeadLayers`]: what is solid
//! between the heights at which the part is printed, in height order even where
//! objects are printed one after another. Supports, skirt, brim, raft, wipe tower and
//! the start macro's prime lines are told apart from the part where the file says
//! what is what; [`Facts`] tells whether it does. Knows no file system.
//!
//! Memory: the beads' points, 8 bytes each (about a twelfth of the text, at most
//! [`MAX_POINTS`]), and the polygons of one batch.
//!
//! # Layout
//! Data flow in this order: `trace` (lines → paths) · `guess` (what the beginning
//! tells) · `levels` (heights → layers, and which sheets fill them) · `reach`
//! (supports bear across a gap) · `bead` (flow and height → width) · `region`
//! (the paths of a layer → polygons; fills what holds sparse infill) · `locate` (what a
//! point lies in)
mod bead;
mod guess;
mod levels;
mod locate;
mod reach;
mod region;
mod trace;

#[cfg(test)]
mod tests;

use super::shape::Bounds;
use super::stack::{Layer, Layers};
use levels::Stack;
use rayon::prelude::*;
use std::io::BufRead;
use trace::{Path, Trace};

/// Longest line, bytes: slicers' longest are start macros of some kilobytes.
pub const MAX_LINE_BYTES: usize = 1 << 20;

/// Most points of a job: 192 MB of them, of about half a gigabyte of text.
pub const MAX_POINTS: usize = 24 << 20;

/// Most layers: a metre at 0.025 mm.
pub const MAX_LAYERS: usize = 40_000;

/// Most points in one layer: a plate of 500 mm filled with lines of 1 mm at every 0.25 mm.
pub const MAX_LAYER_POINTS: usize = 2 << 20;

/// Coordinates beyond this are no printer's, mm.
pub const MAX_COORDINATE_MM: f64 = 10_000.0;

/// Layers in a batch: enough for all cores, and few enough that their polygons are small.
const BATCH: usize = 32;

/// Points in a batch beyond which it takes no further layer.
const BATCH_POINTS: usize = 1 << 20;

/// Why there are no layers.
#[derive(Debug, thiserror::Error)]
pub enum GcodeError {
    /// The reader failed.
    #[error("cannot read on after line {line}: {source}")]
    Read {
        /// The last line that was read, from 1.
        line: u64,
        /// Why.
        source: std::io::Error,
    },
    /// A line longer than [`MAX_LINE_BYTES`].
    #[error("line {line} is longer than {MAX_LINE_BYTES} bytes: this is not G-code text")]
    LongLine {
        /// Counted from 1.
        line: u64,
    },
    /// A zero byte, which no text has.
    #[error("line {line} holds a zero byte: this is not G-code text")]
    Binary {
        /// Counted from 1.
        line: u64,
    },
    /// A position that no printer reaches.
    #[error("line {line} moves beyond {MAX_COORDINATE_MM} mm: no printer's coordinates")]
    Beyond {
        /// Counted from 1.
        line: u64,
    },
    /// More than [`MAX_POINTS`].
    #[error("by line {line} there are more than {MAX_POINTS} beads: too large a job to be checked at once")]
    ManyBeads {
        /// Counted from 1.
        line: u64,
    },
    /// More than [`MAX_LAYERS`].
    #[error("beads lie at more than {MAX_LAYERS} heights: this is no layered job")]
    ManyLayers,
    /// More than [`MAX_LAYER_POINTS`].
    #[error("the layer at Z {z_mm:.3} mm has more than {MAX_LAYER_POINTS} beads: too many to be united")]
    LargeLayer {
        /// Height where the layer ends, mm.
        z_mm: f64,
    },
    /// Lines that cross each other everywhere.
    #[error("the beads of the layer at Z {z_mm:.3} mm cross each other everywhere: this is no print")]
    Tangled {
        /// Height where the layer ends, mm.
        z_mm: f64,
    },
    /// Nothing is extruded while the head moves.
    #[error("no line extrudes while it moves: there is nothing to check in this file")]
    Nothing,
}

/// What the caller knows better than the file.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Diameter of the filament, mm; `None`: what the file says, else what its beads'
    /// widths make likely.
    pub filament_mm: Option<f64>,
}

/// What was found in a file, beside its layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Facts {
    /// The slicer whose comments were understood.
    pub slicer: Option<&'static str>,
    /// Whether the file says what is support, skirt or tower. Where it does not,
    /// everything counts as part.
    pub features_told: bool,
    /// Whether widths are the file's own; otherwise they come from the extruded volume.
    pub widths_told: bool,
    /// Diameter of the (first) filament, mm.
    pub filament_mm: f64,
    /// Whether it is the file's or the caller's; otherwise it was guessed.
    pub filament_told: bool,
    /// E words were taken as distances though no line says so: as positions they make no sense.
    pub relative_e_guessed: bool,
    /// How often the part begins anew below where it was: objects printed one by one, less one.
    pub objects_after_another: u32,
    /// Part of the job is a spiral, taken as layers of constant thickness.
    pub spiral: bool,
    /// Pieces of straight bead that were read.
    pub beads: u64,
    /// Extruded while moving, mm³: all of it, aids included.
    pub extruded_mm3: f64,
    /// Lines read.
    pub lines: u64,
}

/// The layers of a job, ready to be made.
#[derive(Debug)]
pub struct BeadLayers {
    trace: Trace,
    stack: Stack,
    facts: Facts,
    next: usize,
}

/// Reads a whole job.
///
/// # Errors
/// What makes the text no job that can be checked, see [`GcodeError`].
pub fn read(reader: impl BufRead, options: &Options) -> Result<BeadLayers, GcodeError> {
    let mut trace = trace::trace(reader)?;
    let stack = levels::stack(&trace)?;
    let facts = bead::set_widths(&mut trace, &stack, options);
    Ok(BeadLayers { trace, stack, facts, next: 0 })
}

impl BeadLayers {
    /// What the file says and what had to be guessed.
    #[must_use]
    pub fn facts(&self) -> &Facts {
        &self.facts
    }

    /// Bounds of all beads' middles.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        Bounds::of(&self.trace.points)
    }

    /// Height of the last layer's top, mm.
    #[must_use]
    pub fn height_mm(&self) -> f64 {
        self.stack.layers().checked_sub(1).map_or(0.0, |last| self.stack.heights_mm(last)[1])
    }

    /// How many layers the next batch takes: bounded in layers and in points.
    fn batch(&self) -> std::ops::Range<usize> {
        let last = (self.next + BATCH).min(self.stack.layers());
        let mut points = 0;
        let end = (self.next..last).find(|&k| {
            points += self.stack.points(k);
            points > BATCH_POINTS && k > self.next
        });
        self.next..end.unwrap_or(last)
    }

    fn layer(&self, k: usize) -> Result<Layer, GcodeError> {
        let paths: Vec<&Path> =
            self.stack.paths(k).iter().map(|&path| &self.trace.paths[path as usize]).collect();
        let [bottom_mm, top_mm] = self.stack.heights_mm(k);
        match region::regions(&self.trace, &paths) {
            Some((part, aid)) => Ok(Layer { number: k as u32, bottom_mm, top_mm, part, aid, picture: None }),
            None => Err(GcodeError::Tangled { z_mm: top_mm }),
        }
    }
}

impl Layers for BeadLayers {
    type Error = GcodeError;

    fn count(&self) -> Option<u32> {
        Some(self.stack.layers() as u32)
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, GcodeError> {
        let batch = self.batch();
        if batch.is_empty() {
            return Ok(None);
        }
        self.next = batch.end;
        // The first layer at fault, whichever thread finds it: all are made first.
        let made: Vec<Result<Layer, GcodeError>> = batch.into_par_iter().map(|k| self.layer(k)).collect();
        made.into_iter().collect::<Result<_, _>>().map(Some)
    }
}
