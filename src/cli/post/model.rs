//! `outrigger post --supports MODEL.stl`: the model that a job was sliced from, laid beside it.
use crate::cli::files;
use crate::detect::overhang::SelfSupport;
use crate::layers::stack::Layers;
use crate::mesh::{self, Mesh, place};
use crate::report::support::{Model, Report};
use crate::support::look::Look;
use crate::support::model::fit::shift_mm;
use crate::support::model::{Outlines, asked};
use crate::support::rules::Rules;
use anyhow::Context;
use std::io::BufReader;
use std::path::Path;

/// Bytes that are read at a time.
const BUFFER_BYTES: usize = 256 << 10;

/// Adds what the model says must be held to what the job says; `again` are the job's layers
/// once more.
///
/// # Errors
/// The model cannot be read, or is not what the job prints there.
pub(super) fn added<L: Layers>(
    path: &Path,
    align: bool,
    (seen, outlines): (&mut Look, &Outlines),
    again: L,
    own: SelfSupport,
    rules: &Rules,
    report: &mut Report,
) -> anyhow::Result<()> {
    let file = files::display_name(path);
    let mesh = laid(path, align, outlines, rules, report).context(file)?;
    let job = std::mem::take(&mut seen.demand);
    let model = asked(&mesh, outlines, again, &seen.space, own, rules)?;
    seen.demand = job.with(model);
    Ok(())
}

/// The model where the job prints it.
fn laid(
    path: &Path,
    align: bool,
    outlines: &Outlines,
    rules: &Rules,
    report: &mut Report,
) -> anyhow::Result<Mesh> {
    let (mut mesh, read) =
        mesh::read(&mut BufReader::with_capacity(BUFFER_BYTES, files::open_regular(path)?))?;
    report.warnings.extend(read.warnings());
    let doubt = place::place(&mut mesh, &place::Placing::default())?;
    let told =
        |fault| doubt.iter().fold(anyhow::Error::new(fault), |e, doubt| anyhow::anyhow!("{e}; {doubt}"));
    let by_mm = shift_mm(&mesh, outlines, rules.process, align).map_err(told)?;
    mesh.vertices.iter_mut().for_each(|v| *v = [0, 1, 2].map(|k| v[k] + by_mm[k]));
    report.model = Some(Model { file: files::display_name(path), moved_mm: by_mm });
    Ok(mesh)
}
