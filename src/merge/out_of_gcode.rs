//! The slicer's own supports out of sliced G-code.
//!
//! Takes a job that can be read twice and a writer; gives the job without the beads of its
//! supports, and what was [`Taken`]. Every other bead, setting and comment is there as it
//! was, in its order. Knows no file system and no clock.
//!
//! # Layout
//! ```text
//! lines ──► taker (holds what stands between two beads) ──► text
//!                                             └─ verify, from both texts
//! ```
//! Between the last bead that stays and the next one, the way to the supports, among them
//! and back is one way: pulled back and lifted by the file's own habits. What depends on
//! where the nozzle is (macros, tool changes) finds it where it was.
//!
//! Choices: a brim around supports is no support and stays; layers that held nothing else
//! keep their comments; times and filament that the file tells of itself are not corrected.
//! A part that stands on a raft is refused, and so are supports of a tool of their own.
//! Memory: a layer's text, and what stands between two beads.
mod taker;
mod verify;

use super::gcode::{Failure, of_damage, of_unfit, open};
use crate::post::Failure as Io;
use crate::post::annotate::Layers;
use crate::post::container::gcode;
use std::io::{Read, Seek, SeekFrom, Write};
use taker::Taker;
use verify::Verifier;
pub use verify::{Difference, What};

/// What was taken out.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Taken {
    /// Beads.
    pub beads: u64,
    /// Their filament, mm.
    pub filament_mm: f64,
    /// Their volume, mm³.
    pub volume_mm3: f64,
    /// Ways that were closed where they were.
    pub ways: u64,
}

/// Takes a job's supports out of it, text or binary G-code.
///
/// On any failure what was written must not be used: the input stands. `progress` is told
/// how many layers are done, of how many.
///
/// # Errors
/// The input cannot be read or the output not written; the job is none that supports can
/// be taken out of; or the proof from both texts fails.
pub fn out_of_gcode(
    input: &mut (impl Read + Seek),
    output: &mut impl Write,
    progress: &dyn Fn(u32, u32),
) -> Result<Taken, Failure> {
    take(input, output, progress).map_err(of_damage)
}

fn take(
    input: &mut (impl Read + Seek),
    output: &mut impl Write,
    progress: &dyn Fn(u32, u32),
) -> Result<Taken, Failure> {
    let (container, survey) = open(input)?;
    let count = survey.slices.len() as u32;
    let mut made = container.begin(input, &mut *output)?;
    input.seek(SeekFrom::Start(0)).map_err(Io::Read)?;
    let mut layers = Layers::new(gcode(&mut *input), survey.dialect).without_covers();
    let (mut taker, mut verifier) = (Taker::new(&survey), Verifier::new(survey.dialect));
    while let Some(layer) = layers.next_layer().map_err(of_unfit)? {
        taker.layer(&layer)?;
        let text = taker.written();
        let found = made.put(Some(text), layer.input()).map_err(Io::Write)?;
        verifier.layer(layer.number, layer.input(), found.as_deref().unwrap_or(layer.input()))?;
        progress(layer.number.min(count), count);
    }
    let taken = taker.finish()?;
    let found = made.put(Some(taker.written()), b"").map_err(Io::Write)?;
    verifier.layer(count, b"", found.as_deref().unwrap_or(b""))?;
    verifier.finish(count)?;
    made.finish().map_err(Io::Write)?;
    drop(layers);
    container.end(input, output)?;
    Ok(taken)
}

#[cfg(test)]
mod tests;
