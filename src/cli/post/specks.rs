//! `outrigger post --remove-islands`: islands of a resin job that stay small are left out.
//!
//! What is written is read again: nothing but their pixels may differ, and no island may be there that
//! was not before. Otherwise the file stays.
use super::resin::{Open, Report, open, written};
use super::{Args, resin};
use crate::cli::files::{Replacement, Seen};
use crate::cli::progress;
use crate::detect::resin::island::islands;
use crate::detect::resin::specks::{Found, Specks};
use crate::layers::from_images::FromImages;
use crate::layers::raster::Raster;
use crate::layers::stack::Layers;
use crate::merge::out_of_images::{Without, prove};
use anyhow::{Context, ensure};
use std::collections::BTreeSet;
use std::fs::File;
use std::path::Path;

/// Takes the specks out of a job, at most that large, mm². Where there are none OUT is a copy, and without
/// OUT the file stays.
///
/// # Errors
/// The job cannot be read, the result does not hold, or it cannot be written.
pub(super) fn removed(args: &Args, file: &File, path: &Path, max_mm2: f64) -> anyhow::Result<Report> {
    let seen = Seen::of(file)?;
    let mut job = open(file)?;
    let mut report = resin::report_of(&job);
    let target = args.output.as_deref().unwrap_or(path);
    let format = resin::named(target).unwrap_or(job.format());
    report.kind_out = Some(format.key());
    let [along_mm, across_mm] = job.placement().pixel_mm;
    let max_pixels = (max_mm2 / (along_mm * across_mm)).floor() as u64;
    let before = look(args, open(file)?, max_pixels)?;
    (report.removed_islands, report.removed_pixels) = (before.specks.specks, before.specks.pixels);
    if before.specks.specks == 0 && format == job.format() {
        report.unchanged_reason = Some(format!("it has no island that stays below {max_mm2} mm²"));
        if args.output.is_some() {
            let mut source = file.try_clone().context("cannot read the file")?;
            Replacement::beside(target)?.copy_of(&mut source)?.put(file)?;
        }
        return Ok(report);
    }
    let (mut replacement, made) = written(args, &mut job, format, &Without(&before.specks.rows), target)?;
    let after = look(args, open(replacement.file())?, max_pixels)?;
    let new = after.islands.difference(&before.islands).count();
    ensure!(new == 0, "the result does not hold: {new} islands came; this is a fault of the program");
    prove(&mut open(file)?, &mut open(replacement.file())?, &before.specks.rows)
        .context("the result does not hold")?;
    ensure!(seen.still_holds(file, path), "it was replaced or changed while it was read");
    replacement.put(file)?;
    (report.notes, report.layers_changed, report.unchanged_reason) = (made.notes, made.changed, None);
    report.islands_left = after.islands.len() as u64;
    Ok(report)
}

/// What a job has.
struct Look {
    specks: Found,
    /// All islands: layer, first column and row, and those behind the last.
    islands: BTreeSet<(u32, [u32; 2], [u32; 2])>,
}

fn look(args: &Args, job: Open<'_>, max_pixels: u64) -> anyhow::Result<Look> {
    let mut layers = FromImages::new(job).keeping_pictures();
    let bar = progress::layers(layers.count(), args.quiet);
    let (mut specks, mut found) = (Specks::new(max_pixels), BTreeSet::new());
    let mut below: Option<Raster> = None;
    while let Some(batch) = layers.next_batch()? {
        for layer in batch {
            let Some(picture) = layer.picture else { continue };
            if let Some(below) = &below {
                let islands = islands(&picture, below);
                found.extend(islands.iter().map(|piece| (layer.number, piece.low, piece.high)));
            }
            specks.push(layer.number, &picture);
            bar.set_position(u64::from(layer.number) + 1);
            below = Some(picture);
        }
    }
    bar.finish_and_clear();
    Ok(Look { specks: specks.finish(), islands: found })
}
