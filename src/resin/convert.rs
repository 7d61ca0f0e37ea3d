//! A job in another format.
//!
//! Takes an open [`Job`], gives the bytes of one of another format: pictures, panel,
//! heights and what the recipe tells, and a line for each thing that the other format
//! has no place for or wants and is not told. Pictures are never turned: where the
//! other format knows no turned panel, the part lies turned on the plate, never
//! mirrored. What a format writes is in its own file. Knows no bytes of a format.
use super::archive::Archive;
use super::archive::write::{ArchiveWriter, Packed};
use super::image::{Packing, Panel, coloured};
use super::job::{Format, Job, JobLayer, Placement, Source};
use super::preview::Preview;
use super::recipe::Recipe;
use super::rewrite::{Edit, Edits, Fault, Made, Part, RewriteError, Rewritten, in_batches};
use super::{goo, nanodlp, sl1};
use std::io::{Read, Seek, Write};
use std::sync::atomic::{AtomicU32, Ordering};

/// Largest thumbnail that is read, packed.
const MAX_THUMBNAIL_BYTES: u64 = 4 << 20;

/// Difference of heights, mm, and of exposures, s, that is none: half of the last digit
/// that anybody shows.
const SAME_MM: f64 = 0.000_5;
const SAME_S: f64 = 0.005;

/// Names of members that are listed at most.
const LISTED: usize = 5;

/// What a format writes of a job besides its pictures.
pub(super) struct Facts<'a> {
    pub(super) recipe: &'a Recipe,
    pub(super) layers: &'a [JobLayer],
    pub(super) panel: Panel,
    pub(super) placement: Placement,
    /// Height of the first layer and of the others, mm.
    pub(super) heights_mm: [f64; 2],
    pub(super) preview: Option<&'a Preview>,
}

impl Facts<'_> {
    /// Height of the whole job, mm.
    pub(super) fn top_mm(&self) -> f64 {
        self.layers.last().map_or(0.0, |l| l.top_mm)
    }

    /// All exposures together, s.
    pub(super) fn exposures_s(&self) -> f64 {
        self.layers.iter().map(|l| l.exposure_s).sum()
    }

    /// Says so where layers would be exposed otherwise than in the job that is read.
    pub(super) fn compare_exposures(&self, exposure_s: impl Fn(u32) -> f64, notes: &mut Vec<String>) {
        let differs = |(n, layer): &(u32, &JobLayer)| (exposure_s(*n) - layer.exposure_s).abs() > SAME_S;
        let differing: Vec<_> = (0..).zip(self.layers).filter(differs).collect();
        if let Some((n, layer)) = differing.first() {
            notes.push(format!(
                "exposure: {} of {} layers differ; layer {n} has {:.2} s instead of {:.2} s",
                differing.len(),
                self.layers.len(),
                exposure_s(*n),
                layer.exposure_s
            ));
        }
    }

    /// Whether every layer is exposed as the recipe alone says.
    pub(super) fn exposed_by_recipe(&self) -> bool {
        let by_recipe = |(n, layer): (u32, &JobLayer)| self.recipe.exposure_s(n) - layer.exposure_s;
        (0..).zip(self.layers).all(|layer| by_recipe(layer).abs() <= SAME_S)
    }

    /// Whether all layers have one height.
    pub(super) fn even(&self) -> bool {
        (self.heights_mm[0] - self.heights_mm[1]).abs() <= SAME_MM
    }
}

/// A number with six digits behind the point at most.
pub(super) fn number(value: f64) -> f64 {
    (value * 1e6).round() / 1e6
}

/// A file under construction.
enum Sink<W: Write + Seek> {
    Archive(Box<ArchiveWriter<W>>),
    Goo(goo::Builder<W>),
}

/// Writes a job in another format.
///
/// # Errors
/// As [`super::rewrite::rewrite`], and when the other format cannot hold its heights.
pub(super) fn convert<R: Read + Seek, W: Write + Seek>(
    job: &mut Job<R>,
    out: W,
    target: Format,
    edits: &impl Edits,
    done: &mut dyn FnMut(u32),
) -> Result<Rewritten, RewriteError> {
    let mut notes = Vec::new();
    let preview = preview(job, &mut notes);
    let from = job.panel();
    let packing = if target == Format::Goo { Packing::Runs } else { Packing::Grey };
    let panel = Panel { packing, ..from };
    let facts = Facts {
        recipe: job.recipe(),
        layers: job.layers(),
        panel,
        placement: placement(job.placement(), target, &mut notes),
        heights_mm: heights_mm(job.layers(), target)?,
        preview: preview.as_ref(),
    };
    left_behind(job, &mut notes);
    let mut sink = match target {
        Format::Sl1 => Sink::Archive(Box::new(sl1::write::begin(&facts, out, &mut notes)?)),
        Format::NanoDlp => Sink::Archive(Box::new(nanodlp::write::begin(&facts, out, &mut notes)?)),
        Format::Goo => Sink::Goo(goo::Builder::begin(&facts, out, &mut notes)?),
    };
    let name = match target {
        Format::NanoDlp => nanodlp::write::layer_name,
        _ => sl1::write::layer_name,
    };
    let parts: Vec<Part> =
        (0..).zip(job.layers()).map(|(n, l)| Part { entry: l.entry, layer: Some(n) }).collect();
    let changed = AtomicU32::new(0);
    let work = |layer, packed: &[u8]| converted([from, panel], edits, &changed, layer, packed);
    let mut layers = 0;
    in_batches(job, &parts, &|_| true, &work, |_, _, made| {
        let made = made.unwrap_or_default();
        match &mut sink {
            Sink::Archive(zip) => zip.add(&name(layers), &made, Packed::Deflated)?,
            Sink::Goo(goo) => goo.layer(&made)?,
        }
        layers += 1;
        done(layers);
        Ok(())
    })?;
    match sink {
        Sink::Archive(zip) => drop(zip.finish()?),
        Sink::Goo(goo) => goo.finish()?,
    }
    Ok(Rewritten { layers, changed: changed.into_inner(), notes })
}

/// A picture for the other panel.
fn converted(
    [from, to]: [Panel; 2],
    edits: &impl Edits,
    changed: &AtomicU32,
    layer: u32,
    packed: &[u8],
) -> Made {
    if !edits.touches(layer) {
        return to.repack(from, packed).map_err(Fault::Picture)?.map(Some).map_err(Fault::Pack);
    }
    let mut image = from.image(packed).map_err(Fault::Picture)?;
    if edits.edit(layer, &mut image) == Edit::Changed {
        changed.fetch_add(1, Ordering::Relaxed);
    }
    to.pack(&image).map(Some).map_err(Fault::Pack)
}

/// How the same pictures lie where the other format cannot say all.
fn placement(found: Placement, target: Format, notes: &mut Vec<String>) -> Placement {
    let sayable = match target {
        Format::Sl1 => true,
        Format::NanoDlp => !found.swap && found.reverse_v,
        Format::Goo => !found.swap,
    };
    if sayable {
        return found;
    }
    let turn = if found.swap { "90°" } else { "180°" };
    notes.push(format!(
        "the part lies turned by {turn} on the plate: {target} cannot say how this panel stands"
    ));
    Placement { reverse_u: found.mirrored(), reverse_v: true, swap: false, ..found }
}

/// Height of the first layer and of the others, where that tells all.
fn heights_mm(layers: &[JobLayer], target: Format) -> Result<[f64; 2], RewriteError> {
    let first_mm = layers.first().map_or(0.0, |l| l.height_mm);
    let others_mm = layers.get(1).map_or(first_mm, |l| l.height_mm);
    let expect = |n: usize| first_mm + others_mm * n as f64;
    let uneven = layers.iter().enumerate().find(|(n, l)| (l.top_mm - expect(*n)).abs() > SAME_MM);
    match uneven {
        Some((n, layer)) if target != Format::Goo => Err(RewriteError::Uneven {
            target,
            layer: n as u32,
            height_mm: number(layer.height_mm),
            others_mm: number(others_mm),
        }),
        // Each layer has its own there, and the head that of most.
        _ => Ok([number(first_mm), number(others_mm)]),
    }
}

/// The largest thumbnail of a job.
fn preview<R: Read + Seek>(job: &mut Job<R>, notes: &mut Vec<String>) -> Option<Preview> {
    let found = match &mut job.source {
        Source::Archive(archive) => thumbnail(archive),
        Source::Goo(goo) => goo.preview().map_err(|e| e.to_string()),
    };
    found.unwrap_or_else(|why| {
        notes.push(format!("thumbnail: {why}"));
        None
    })
}

/// Whether a member of an archive is a picture for people.
fn is_thumbnail(name: &str) -> bool {
    name == nanodlp::write::THUMBNAIL || (name.starts_with("thumbnail/") && name.ends_with(".png"))
}

fn thumbnail<R: Read + Seek>(archive: &mut Archive<R>) -> Result<Option<Preview>, String> {
    let largest = |index: &usize| (archive.announced(*index), *index);
    let found = (0..archive.names().count()).filter(|&i| is_thumbnail(archive.name(i))).max_by_key(largest);
    let Some(index) = found else { return Ok(None) };
    let png = archive.read(index, MAX_THUMBNAIL_BYTES).map_err(|e| e.to_string())?;
    coloured(&png).map(Some).map_err(|e| e.to_string())
}

/// What no other format has a place for.
fn left_behind<R: Read + Seek>(job: &Job<R>, notes: &mut Vec<String>) {
    let pauses = &job.recipe().pauses;
    if let Some(first) = pauses.first() {
        notes.push(format!("pauses: {} are left out, the first at layer {first}", pauses.len()));
    }
    let Source::Archive(archive) = &job.source else { return };
    let mut pictures: Vec<usize> = job.layers().iter().map(|l| l.entry).collect();
    pictures.sort_unstable();
    let known = |name: &str| {
        is_thumbnail(name) || sl1::write::SETTINGS.contains(&name) || nanodlp::write::is_settings(name)
    };
    let others: Vec<&str> = (0..)
        .zip(archive.names())
        .filter(|(i, name)| pictures.binary_search(i).is_err() && !known(name) && !name.ends_with('/'))
        .map(|(_, name)| name)
        .collect();
    if !others.is_empty() {
        let listed: Vec<String> = others.iter().take(LISTED).map(|name| format!("{name:?}")).collect();
        let more = others.len() - listed.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        notes.push(format!("left out of the archive: {}{more}", listed.join(", ")));
    }
}

#[cfg(test)]
mod tests;
