//! Supports into sliced G-code, layer by layer.
//!
//! Takes a job that can be read twice, a writer and supports that can be cut at any
//! height; gives the job with the supports printed before the part in each layer, and
//! a [`MergeReport`]. No line of the job is changed, moved or left out: what is put in
//! leaves the machine as it found it. Knows no file system and no clock.
//!
//! # Layout
//! ```text
//! gcode::survey (heights, habits, flow) ────────────────────┐
//! layers ──► plan (sections, clipped, as paths) ──► weave ───┴─► text
//!                                                     └─ verify, from both texts
//! ```
//! `cross` tells which ways lead over supports. Some layers are in memory at once: [`BATCH_BYTES`] of text, or the largest layer.
mod cross;
mod plan;
mod report;
mod verify;
mod weave;

use super::gcode::survey::{self, Survey};
use super::gcode::{Failure, Refusal, of_damage, of_unfit, open};
use crate::layers::shape::Region;
use crate::post::Failure as Io;
use crate::post::annotate::Layers;
use crate::post::container::{Output, gcode};
use crate::post::layer::Layer;
use crate::support::section::Sections;
use rayon::prelude::*;
pub use report::{Clipped, MergeReport};
use std::io::{BufRead, Read, Seek, SeekFrom, Write};
pub use verify::{Difference, GROWN_MM, What};
use verify::{Made, Verifier};
use weave::Woven;

/// Text of the layers that are in work together, bytes.
pub const BATCH_BYTES: usize = 1 << 20;

/// How supports are printed, beside what the file says.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// Least distance between the edges of supports and of the part's beads beside them, mm.
    pub clearance_mm: f64,
    /// And of everything else that the file prints: skirt, tower, prime lines, its own supports.
    pub aid_clearance_mm: f64,
    /// Along the border of thick branches; thinner ones have one.
    pub rings: usize,
    /// Branches with a larger section than this are thick, mm²; so is all that lies on the plate.
    pub thick_mm2: f64,
    /// From line to line inside of thick branches, mm; infinite: hollow.
    pub spacing_mm: f64,
    /// Between the edges of the interface's lines, mm.
    pub interface_gap_mm: f64,
    /// Of the lines inside of branches; the interface's cross them.
    pub angle_deg: f64,
    /// The plate, where the caller knows it better than the file.
    pub bed: Option<Region>,
}

impl Default for Options {
    fn default() -> Options {
        Options {
            clearance_mm: 0.2,
            aid_clearance_mm: 0.3,
            rings: 2,
            thick_mm2: 3.0,
            spacing_mm: 2.0,
            interface_gap_mm: 0.2,
            angle_deg: 0.0,
            bed: None,
        }
    }
}

/// Puts supports into a job, text or binary G-code.
///
/// Heights are the file's own Z. On any failure what was written must not be used: the
/// input stands. `progress` is told how many layers are done, of how many.
///
/// # Errors
/// The input cannot be read or the output not written; the job is none that supports
/// can go into; or the proof from both texts fails.
pub fn into_gcode(
    input: &mut (impl Read + Seek + Send),
    output: &mut impl Write,
    sections: &dyn Sections,
    options: &Options,
    progress: &dyn Fn(u32, u32),
) -> Result<MergeReport, Failure> {
    merge(input, output, sections, options, progress).map_err(of_damage)
}

fn merge(
    input: &mut (impl Read + Seek + Send),
    output: &mut impl Write,
    sections: &dyn Sections,
    options: &Options,
    progress: &dyn Fn(u32, u32),
) -> Result<MergeReport, Failure> {
    let (container, survey) = open(input)?;
    let made = container.begin(input, &mut *output)?;
    input.seek(SeekFrom::Start(0)).map_err(Io::Read)?;
    let job = Job { survey: &survey, sections, options };
    let report = job.run(gcode(&mut *input), made, progress)?;
    container.end(input, output)?;
    Ok(report)
}

/// A layer on its way: read, planned, woven, written.
struct Done {
    layer: Layer,
    made: Option<(plan::Plan, Woven)>,
    /// What a reader will find, where that is not the input.
    found: Option<Vec<u8>>,
}

struct Job<'a> {
    survey: &'a Survey,
    sections: &'a dyn Sections,
    options: &'a Options,
}

impl Job<'_> {
    /// Reads the next layers while those before them are made, and those before these proved.
    fn run(
        &self,
        reader: impl BufRead + Send,
        mut output: Output<impl Write>,
        progress: &dyn Fn(u32, u32),
    ) -> Result<MergeReport, Failure> {
        let count = self.survey.slices.len() as u32;
        let mut report = MergeReport { width_mm: self.survey.width_mm, ..MergeReport::default() };
        let mut layers = Layers::new(reader, self.survey.dialect).without_covers();
        let mut verifier = Verifier::new(self.survey, self.options);
        let mut read = batch(&mut layers)?;
        let mut written: Vec<Done> = Vec::new();
        while !read.is_empty() || !written.is_empty() {
            let (next, (made, proved)) = rayon::join(
                || batch(&mut layers),
                || rayon::join(|| self.make(read), || prove(&mut verifier, &written)),
            );
            proved?;
            (read, written) = (next?, made?);
            for done in &mut written {
                let (number, input) = (done.layer.number, done.layer.input());
                report.layers = report.layers.max(number);
                let text = done.made.as_mut().map(|(_, woven)| std::mem::take(&mut woven.text));
                done.found = output.put(text, input).map_err(Io::Write)?;
                if let Some((plan, woven)) = &done.made {
                    self.count(&mut report, plan, woven);
                }
                progress(number.min(count), count);
            }
        }
        verifier.finish()?;
        output.finish().map_err(Io::Write)?;
        let top = self.survey.slices.iter().flatten().next_back().map_or(0.0, |slice| slice[1]);
        report.missing_top_mm = (self.sections.top_mm() - top).max(0.0);
        Ok(report)
    }

    fn make(&self, layers: Vec<Layer>) -> Result<Vec<Done>, Refusal> {
        layers.into_par_iter().map(|layer| self.layer(layer)).collect()
    }

    fn layer(&self, layer: Layer) -> Result<Done, Refusal> {
        let slice = self.survey.slices.get(layer.number as usize).copied().flatten();
        let made = match (slice, survey::entry(&layer)) {
            (Some(slice), Some(entry)) => {
                let at = weave::entry_point(&layer, entry);
                match plan::plan(&layer, slice, at, self.sections, self.survey, self.options)? {
                    Some(plan) => {
                        let woven = weave::weave(&layer, entry, &plan, self.survey, self.options)?;
                        Some((plan, woven))
                    }
                    None => None,
                }
            }
            _ => None,
        };
        Ok(Done { layer, made, found: None })
    }

    fn count(&self, report: &mut MergeReport, plan: &plan::Plan, woven: &Woven) {
        report.layers_supported += u32::from(!plan.paths.is_empty());
        report.paths += plan.paths.len() as u64;
        report.length_mm += woven.length_mm;
        report.filament_mm += woven.pushed_mm;
        report.volume_mm3 += woven.pushed_mm * self.survey.filament_mm2;
        report.lifts += woven.lifts;
        report.travels_lifted += woven.travels_lifted;
        report.clipped_by_part.join(&plan.clipped[0]);
        report.clipped_by_aids.join(&plan.clipped[1]);
        report.clipped_by_bed.join(&plan.clipped[2]);
    }
}

/// The layers as they were read and as they were written.
fn prove(verifier: &mut Verifier, layers: &[Done]) -> Result<(), Difference> {
    for done in layers {
        let input = done.layer.input();
        let text = done.found.as_deref().unwrap_or(input);
        let made = done.made.as_ref().map(|(plan, woven)| Made { text, added: &woven.added, plan });
        verifier.layer(done.layer.number, input, made)?;
    }
    Ok(())
}

/// The next layers, none at the end.
fn batch<R: BufRead>(layers: &mut Layers<R>) -> Result<Vec<Layer>, Failure> {
    let mut read = Vec::new();
    let mut bytes = 0;
    while bytes < BATCH_BYTES
        && let Some(layer) = layers.next_layer().map_err(of_unfit)?
    {
        bytes += layer.input().len();
        read.push(layer);
    }
    Ok(read)
}

#[cfg(test)]
mod tests;
