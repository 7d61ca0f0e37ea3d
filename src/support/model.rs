//! The model of a job: what of it must be held, beside what the job itself tells.
//!
//! A job tells its demand by its beads or pictures. These are as wide as a bead and as
//! coarse as a pixel, and in a resin job nothing tells part from support; the model knows
//! both. It is cut at the job's own heights, where [`fit`] found that the job prints it.
//! - [`Outlines`] looks on while the job is looked at, and keeps what the fit is judged by
//! - [`asked`]: what the model says must be held
pub mod fit;

use super::clearance::Clearance;
use super::demand::{Demand, Gather, Need, ask};
use super::rules::{Process, Rules};
use crate::detect::overhang::SelfSupport;
use crate::detect::walk::{Seen, Watch, walk};
use crate::layers::from_mesh::{FromMesh, SliceError};
use crate::layers::polygon::{difference, grow};
use crate::layers::shape::{Bounds, Ring};
use crate::layers::stack::{Layer, Layers};
use crate::mesh::Mesh;
use rayon::prelude::*;
use std::collections::VecDeque;

/// Layers whose outlines are kept: at least so many, at most twice as many.
const KEPT: usize = 64;

/// What a picture shows so near to the model is the model, mm.
const EDGE_MM: f64 = 0.1;

/// What is kept of a job to lay a model beside it.
#[derive(Debug)]
pub struct Outlines {
    /// Where each layer begins and ends, mm.
    heights: Vec<[f64; 2]>,
    /// Some layers by their numbers, each with the outer borders of its part.
    kept: Vec<(u32, Vec<Ring>)>,
    /// Every so many layers are kept.
    every: u32,
    /// The first and the last layer with something of the part.
    span: Option<[u32; 2]>,
    bounds: Bounds,
}

impl Default for Outlines {
    fn default() -> Outlines {
        Outlines { heights: Vec::new(), kept: Vec::new(), every: 1, span: None, bounds: Bounds::EMPTY }
    }
}

impl Watch for Outlines {
    fn layer(&mut self, seen: &Seen<'_>) {
        let layer = seen.layer;
        self.heights.push([layer.bottom_mm, layer.top_mm]);
        if layer.part.is_empty() {
            return;
        }
        let first = self.span.map_or(layer.number, |[first, _]| first);
        self.span = Some([first, layer.number]);
        self.bounds = self.bounds.joined(layer.part.bounds());
        if !layer.number.is_multiple_of(self.every) {
            return;
        }
        let outer = layer.part.polygons.iter().filter_map(|p| p.rings.first()).cloned();
        self.kept.push((layer.number, outer.collect()));
        if self.kept.len() > 2 * KEPT {
            self.every *= 2;
            self.kept.retain(|(number, _)| number.is_multiple_of(self.every));
        }
    }
}

/// Why the model's demand is not known.
#[derive(Debug, thiserror::Error)]
pub enum Failure<E: std::error::Error + 'static> {
    /// The job.
    #[error(transparent)]
    Job(E),
    /// The model.
    #[error("the model: {0}")]
    Model(#[from] SliceError),
}

/// What a model that lies where the job prints it asks for: its islands and overhangs that
/// neither its own lower layers nor the job's supports hold, where the job prints something.
/// `job` are the job's layers once more, and `space` is what was drawn of them.
///
/// # Errors
/// Those of both sources.
pub fn asked<L: Layers>(
    mesh: &Mesh,
    outlines: &Outlines,
    job: L,
    space: &Clearance,
    own: SelfSupport,
    rules: &Rules,
) -> Result<Demand, Failure<L::Error>> {
    let model = FromMesh::at(mesh, outlines.heights.clone())?;
    let mut layers = Beside { model, job, ready: VecDeque::new(), process: rules.process };
    let mut gather = Gather::new(rules.cell_mm());
    let findings = walk(&mut layers, &ask(own), &mut gather)?;
    let mut demand = gather.finish(&findings.islands.islands, own.min_area_mm2, rules.caught_mm);
    let aside = [-1.0, 0.0, 1.0].map(|k| k * space.cell_mm());
    let is_printed = |need: &Need| {
        let [x, y, z] = need.at_mm;
        let above_mm = z + space.slab_mm() / 2.0;
        aside.iter().any(|dx| aside.iter().any(|dy| space.is_part([x + dx, y + dy, above_mm])))
    };
    demand.keep(is_printed);
    Ok(demand)
}

/// The layers of a model with what the job prints besides as their aid.
struct Beside<'a, L> {
    model: FromMesh<'a>,
    job: L,
    /// Layers of the model for which those of the job are still to come.
    ready: VecDeque<Layer>,
    process: Process,
}

impl<L: Layers> Layers for Beside<'_, L> {
    type Error = Failure<L::Error>;

    fn count(&self) -> Option<u32> {
        self.model.count()
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, Self::Error> {
        let Some(batch) = self.job.next_batch().map_err(Failure::Job)? else { return Ok(None) };
        while self.ready.len() < batch.len() {
            let Some(more) = self.model.next_batch()? else { break };
            self.ready.extend(more);
        }
        let count = batch.len().min(self.ready.len());
        let pairs: Vec<(Layer, Layer)> = self.ready.drain(..count).zip(batch).collect();
        let process = self.process;
        let aided = |(model, job): (Layer, Layer)| {
            let aid = match process {
                Process::Filament => job.aid,
                // Pictures do not tell: what is not the model supports it.
                Process::Resin => difference(&job.part, &grow(&model.part, EDGE_MM)),
            };
            Layer { aid, ..model }
        };
        Ok(Some(pairs.into_par_iter().map(aided).collect()))
    }
}
