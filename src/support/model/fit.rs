//! Whether a model lies where a job prints it, and how far from there.
//!
//! Sections of the model at the heights of some of the job's layers are laid upon the job's
//! own, both without their holes, since infill leaves holes in beads. They agree where the
//! areas that only one of them covers are no larger than what the width of a bead, a slicer's
//! compensations and pixels do along the outline. A resin job may show more than the model:
//! its supports.
//!
//! How far they are apart is found in two steps: upward by where the part begins (filament)
//! or ends (resin, where below the part there may be supports), along the plate by the
//! medians over the layers of how far the boxes around both are apart, at their middles and
//! at either corner; whichever agrees in most layers counts.
use super::Outlines;
use crate::layers::from_mesh::{FromMesh, SliceError};
use crate::layers::polygon::{Inside, difference, resolve};
use crate::layers::shape::{Bounds, Point, Region, Ring, UNITS_PER_MM, ring_length};
use crate::layers::stack::{Layer, Layers};
use crate::mesh::Mesh;
use crate::support::rules::Process;
use rayon::prelude::*;

/// How far outlines may be apart, mm.
const OUTLINE_MM: f64 = 0.25;

/// Share of the area that may differ where the outline is short.
const AREA_SHARE: f64 = 0.05;

/// Area that may always differ, mm².
const SPECK_MM2: f64 = 0.5;

/// Share of the layers in which they must agree.
const AGREE_SHARE: f64 = 0.9;

/// Sizes that are no further apart are the same, mm.
const SIZE_MM: f64 = 0.6;

/// Why a model is not the job's.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum Misfit {
    /// There is nothing to compare.
    #[error("the job prints nothing that could be the model")]
    NoPart,
    /// It was scaled or turned, or is not alone.
    #[error(
        "the job prints a part of {} mm and the model is {} mm: give the model as it was sliced, with all that lies on the plate",
        size(.job_mm), size(.model_mm)
    )]
    Size {
        /// The job's part, mm.
        job_mm: [f64; 3],
        /// The model, mm.
        model_mm: [f64; 3],
    },
    /// It would agree somewhere else.
    #[error(
        "the job prints the model elsewhere: X {:+.2} Y {:+.2} Z {:+.2} mm from where it lies; --align moves it there",
        by_mm[0], by_mm[1], by_mm[2]
    )]
    Elsewhere {
        /// From the model to the job, mm.
        by_mm: [f64; 3],
    },
    /// It is another.
    #[error(
        "the model has another shape than what the job prints, in {differ} of {of} layers that were compared, first at Z {first_mm:.2}"
    )]
    Shape {
        /// Layers in which they do not agree.
        differ: usize,
        /// Layers that were compared.
        of: usize,
        /// Top of the first of them, mm.
        first_mm: f64,
    },
    /// It cannot be cut.
    #[error("the model: {0}")]
    Slice(#[from] SliceError),
}

fn size(mm: &[f64; 3]) -> String {
    mm.map(|c| format!("{c:.1}")).join(" × ")
}

/// How the model agrees with the job at some place.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    agree: usize,
    of: usize,
    /// Top of the first layer in which they do not, mm.
    first_mm: Option<f64>,
}

impl Score {
    fn is_fit(&self) -> bool {
        self.of > 0 && self.agree as f64 >= AGREE_SHARE * self.of as f64
    }
}

/// How far the job prints the model from where it lies, mm; not at all where it agrees as it
/// is. The model stands on the plate.
///
/// # Errors
/// It agrees nowhere, or, unless `align`, not where it lies.
pub fn shift_mm(mesh: &Mesh, outlines: &Outlines, process: Process, align: bool) -> Result<[f64; 3], Misfit> {
    let [first, last] = outlines.span.ok_or(Misfit::NoPart)?;
    let [begin_mm, end_mm] = [outlines.heights[first as usize][0], outlines.heights[last as usize][1]];
    let [low, high] = mesh.bounds_mm();
    let up_mm = match process {
        Process::Filament => begin_mm,
        Process::Resin => snapped(end_mm - (high[2] - low[2]), &outlines.heights),
    };
    let judge = Judge::new(mesh, outlines, process, 0.0)?;
    let as_it_is = judge.score([0.0; 2]);
    if as_it_is.is_fit() {
        return Ok([0.0; 3]);
    }
    let judge = if up_mm == 0.0 { judge } else { Judge::new(mesh, outlines, process, up_mm)? };
    let scored = judge.shifts_mm().into_iter().map(|by_mm| (judge.score(by_mm), by_mm));
    let best = scored.max_by_key(|(score, _)| score.agree).filter(|(score, _)| score.is_fit());
    if let Some((_, [x, y])) = best {
        let by_mm = [x, y, up_mm];
        return if align { Ok(by_mm) } else { Err(Misfit::Elsewhere { by_mm }) };
    }
    let [min, max] = outlines.bounds.mm();
    let job_mm = [max[0] - min[0], max[1] - min[1], end_mm - begin_mm];
    let model_mm = [0, 1, 2].map(|k| high[k] - low[k]);
    // The top layer is one whose middle the part reaches.
    let layer_mm = (end_mm - begin_mm) / f64::from(last - first + 1);
    let apart =
        [0, 1, 2].map(|k| (job_mm[k] - model_mm[k]) / (SIZE_MM + if k == 2 { layer_mm } else { 0.0 }));
    let other = |apart: &f64| *apart < -1.0 || *apart > 1.0 && process == Process::Filament;
    if apart.iter().any(other) {
        return Err(Misfit::Size { job_mm, model_mm });
    }
    let Score { agree, of, first_mm } = as_it_is;
    Err(Misfit::Shape { differ: of - agree, of, first_mm: first_mm.unwrap_or(begin_mm) })
}

/// The height at which a layer begins that is the nearest to this, mm.
fn snapped(up_mm: f64, heights: &[[f64; 2]]) -> f64 {
    let begin = heights.iter().map(|h| h[0]);
    begin.min_by(|a, b| (a - up_mm).abs().total_cmp(&(b - up_mm).abs())).unwrap_or(0.0)
}

/// Sections of both at the same heights, without their holes.
struct Judge {
    pairs: Vec<Pair>,
    process: Process,
}

struct Pair {
    top_mm: f64,
    job: Region,
    model: Region,
    /// What may differ, mm².
    slack_mm2: f64,
}

impl Judge {
    /// With the model raised.
    fn new(mesh: &Mesh, outlines: &Outlines, process: Process, up_mm: f64) -> Result<Judge, SliceError> {
        let heights = |(number, _): &(u32, _)| outlines.heights[*number as usize];
        // Layers below the raised model do not meet it, and so the layers are lowered instead.
        let lowered = outlines.kept.iter().map(heights).map(|h| h.map(|mm| mm - up_mm));
        let kept = lowered.zip(&outlines.kept).filter(|(h, _)| h[0] + h[1] >= 0.0);
        let (lowered, kept): (Vec<[f64; 2]>, Vec<_>) = kept.unzip();
        let mut sections = FromMesh::at(mesh, lowered)?;
        let mut models = Vec::new();
        while let Some(batch) = sections.next_batch()? {
            models.extend(batch);
        }
        let pair = |(model, (_, job)): (Layer, &(u32, Vec<Ring>))| {
            let outer: Vec<_> = model.part.polygons.iter().filter_map(|p| p.rings.first()).collect();
            let model_filled = resolve(outer, Inside::NonZero);
            let long_mm = model_filled.rings().map(|r| ring_length(r)).sum::<f64>() / UNITS_PER_MM;
            let area_mm2 = model_filled.area_mm2();
            Pair {
                top_mm: model.top_mm + up_mm,
                job: resolve(job, Inside::NonZero),
                model: model_filled,
                slack_mm2: (OUTLINE_MM * long_mm).max(AREA_SHARE * area_mm2) + SPECK_MM2,
            }
        };
        let pairs = models.into_par_iter().zip(kept).map(pair).collect();
        Ok(Judge { pairs, process })
    }

    /// How both agree with the model moved along the plate.
    fn score(&self, by_mm: [f64; 2]) -> Score {
        let judged = self.pairs.par_iter().map(|pair| pair.agrees(by_mm, self.process));
        let judged: Vec<Option<bool>> = judged.collect();
        let mut score = Score::default();
        for (pair, agrees) in self.pairs.iter().zip(judged) {
            let Some(agrees) = agrees else { continue };
            score.of += 1;
            score.agree += usize::from(agrees);
            if !agrees {
                score.first_mm.get_or_insert(pair.top_mm);
            }
        }
        score
    }

    /// Ways along the plate that may bring the model to the job, mm.
    fn shifts_mm(&self) -> Vec<[f64; 2]> {
        let both = self.pairs.iter().filter(|p| !p.model.is_empty() && !p.job.is_empty());
        let apart = |[from, to]: [Bounds; 2]| {
            let [from, to] = [from.mm(), to.mm()];
            let corners = [0, 1].map(|c| [0, 1].map(|k| to[c][k] - from[c][k]));
            [corners[0], corners[1], [0, 1].map(|k| (corners[0][k] + corners[1][k]) / 2.0)]
        };
        let all: Vec<[[f64; 2]; 3]> = both.map(|p| apart([p.model.bounds(), p.job.bounds()])).collect();
        let Some(last) = all.last() else { return Vec::new() };
        let middle = |k: usize, axis: usize| {
            let mut values: Vec<f64> = all.iter().map(|a| a[k][axis]).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        // The last is for a resin job with supports on one side, of which the top has none.
        [0, 1, 2].map(|k| [middle(k, 0), middle(k, 1)]).into_iter().chain([last[2]]).collect()
    }
}

impl Pair {
    /// Whether they agree; nothing where there is nothing to compare.
    fn agrees(&self, by_mm: [f64; 2], process: Process) -> Option<bool> {
        let may_show_more = process == Process::Resin;
        if self.model.is_empty() && may_show_more {
            return None;
        }
        let by = Point::from_mm(by_mm[0], by_mm[1]);
        let mut model = self.model.clone();
        let points = model.polygons.iter_mut().flat_map(|p| &mut p.rings).flatten();
        points.for_each(|p| *p = Point { x: p.x + by.x, y: p.y + by.y });
        let fits = |region: &Region| region.area_mm2() <= self.slack_mm2;
        Some(fits(&difference(&model, &self.job)) && (may_show_more || fits(&difference(&self.job, &model))))
    }
}

#[cfg(test)]
mod tests;
