//! A job written anew: some of its pictures changed, everything else as it is.
//!
//! Takes an open [`Job`] and what is to be done to its pictures ([`Edits`]), gives the
//! bytes of a job. A job that keeps its format keeps all that is in it: settings,
//! thumbnails and members that nobody here knows are copied as they are packed, and so
//! are pictures that stay. Pictures that change are unpacked, changed and packed on all
//! cores, a batch at a time, and written in order. Knows no format's insides.
use super::archive::Archive;
use super::archive::write::{ArchiveWriter, Packed, WriteError};
use super::convert::convert;
use super::goo::{KeepError, Keeper};
use super::image::pack::PackError;
use super::image::{Image, ImageError, Panel};
use super::job::{Format, Job, JobError, Source};
use rayon::prelude::*;
use std::io::{Read, Seek, Write};

/// Most layers of a batch: enough for all cores of a board, and for progress to be seen.
const MAX_BATCH: usize = 32;

/// Most bytes of a batch's pictures, packed and unpacked, unless one alone has more:
/// what a board with 1 GB can spare. The largest panel sold takes 133 MB a picture.
const BATCH_BYTES: u64 = 256 << 20;

/// What is to be done to a job's pictures. Called from many threads, in any order.
pub trait Edits: Sync {
    /// Whether a layer, from 0 at the plate, may be changed at all. Others are neither
    /// unpacked nor shown.
    fn touches(&self, layer: u32) -> bool;

    /// Changes a layer's picture in place. Its size must stay; rows run from the top of
    /// the picture, which lies over the plate as [`Job::placement`] says.
    fn edit(&self, layer: u32, image: &mut Image) -> Edit;
}

/// What became of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Edit {
    /// It is as it was: its packed bytes are copied.
    Kept,
    /// It was changed.
    Changed,
}

/// Leaves all pictures as they are.
#[derive(Clone, Copy, Debug)]
pub struct Untouched;

impl Edits for Untouched {
    fn touches(&self, _: u32) -> bool {
        false
    }

    fn edit(&self, _: u32, _: &mut Image) -> Edit {
        Edit::Kept
    }
}

/// What was written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rewritten {
    /// Layers in all.
    pub layers: u32,
    /// Layers whose picture was changed.
    pub changed: u32,
    /// What another format has no place for, or wants and is not told: a line each.
    /// Empty where the format is kept.
    pub notes: Vec<String>,
}

/// Why a job cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum RewriteError {
    /// The job that is read.
    #[error(transparent)]
    Job(#[from] JobError),
    /// The archive that is written, or what is copied into it.
    #[error(transparent)]
    Archive(#[from] WriteError),
    /// The GOO file that is written, or what is copied into it.
    #[error(transparent)]
    Goo(#[from] KeepError),
    /// Heights that the other format cannot say.
    #[error(
        "layer {layer} is {height_mm} mm high and others {others_mm} mm: {target} has one height for all but the first; write it as .goo"
    )]
    Uneven {
        /// The format that was to be written.
        target: Format,
        /// From 0 at the plate.
        layer: u32,
        /// Its height, mm.
        height_mm: f64,
        /// Height of the second layer, mm.
        others_mm: f64,
    },
    /// A picture that cannot be packed.
    #[error("layer {layer}: {source}")]
    Pack {
        /// From 0 at the plate.
        layer: u32,
        /// Why not.
        source: PackError,
    },
}

impl RewriteError {
    /// Whether the output is at fault and not the job.
    #[must_use]
    pub fn is_output(&self) -> bool {
        matches!(self, RewriteError::Archive(WriteError::Io(_)) | RewriteError::Goo(KeepError::Write(_)))
    }
}

/// Writes a job, in its own format or another one, with the pictures that `edits` changes.
///
/// In its own format all that is not changed stays byte for byte. `out` should be buffered and must be empty. `done` is told how many layers are
/// written, now and then. Memory: a batch's pictures (256 MB, or one picture) and, on
/// each thread, one that is being packed.
///
/// # Errors
/// The job cannot be read, a changed picture is not of the panel's size, another format
/// cannot say the layers' heights, or `out` refuses. What `out` holds then is no job.
pub fn rewrite<R: Read + Seek, W: Write + Seek>(
    job: &mut Job<R>,
    out: W,
    target: Format,
    edits: &impl Edits,
    done: &mut dyn FnMut(u32),
) -> Result<Rewritten, RewriteError> {
    if target != job.format() {
        return convert(job, out, target, edits, done);
    }
    let panel = job.panel();
    let touches = |layer| edits.touches(layer);
    let change = |layer, packed: &[u8]| changed(panel, edits, layer, packed);
    let mut written = Rewritten::default();
    let mut count = |part: Part, changed: bool| {
        written.layers += u32::from(part.layer.is_some());
        written.changed += u32::from(changed);
        done(written.layers);
    };
    match &job.source {
        Source::Archive(archive) => {
            let parts = members(archive, job);
            let mut zip = ArchiveWriter::new(out);
            zip.comment(archive)?;
            in_batches(job, &parts, &touches, &change, |job, part, changed| {
                let Source::Archive(archive) = &mut job.source else { return Ok(()) };
                match &changed {
                    Some(bytes) => zip.add(archive.name(part.entry), bytes, Packed::Deflated)?,
                    None => zip.copy(archive, part.entry)?,
                }
                count(part, changed.is_some());
                Ok(())
            })?;
            zip.finish()?;
        }
        Source::Goo(_) => {
            let parts: Vec<Part> =
                (0..).zip(job.layers()).map(|(n, l)| Part { entry: l.entry, layer: Some(n) }).collect();
            let Source::Goo(goo) = &mut job.source else { return Ok(written) };
            let mut keeper = Keeper::begin(goo, out)?;
            in_batches(job, &parts, &touches, &change, |job, part, changed| {
                let Source::Goo(goo) = &mut job.source else { return Ok(()) };
                keeper.layer(goo, part.entry, changed.as_deref())?;
                count(part, changed.is_some());
                Ok(())
            })?;
            let Source::Goo(goo) = &mut job.source else { return Ok(written) };
            keeper.finish(goo)?;
        }
    }
    Ok(written)
}

/// A part of a job, in the order in which it is written.
#[derive(Clone, Copy, Debug)]
pub(super) struct Part {
    /// Which entry of an archive, or which layer of another file, it is.
    pub(super) entry: usize,
    /// The layer whose picture it is.
    pub(super) layer: Option<u32>,
}

/// The entries of an archive in the order of its directory.
fn members<R: Read + Seek>(archive: &Archive<R>, job: &Job<R>) -> Vec<Part> {
    let mut parts: Vec<Part> =
        (0..archive.names().count()).map(|entry| Part { entry, layer: None }).collect();
    for (layer, found) in (0..).zip(job.layers()) {
        parts[found.entry].layer = Some(layer);
    }
    parts
}

/// What is wrong with one picture.
pub(super) enum Fault {
    Picture(ImageError),
    Pack(PackError),
}

/// The new bytes of a picture, or nothing where it stays.
pub(super) type Made = Result<Option<Vec<u8>>, Fault>;

/// What is made of a picture.
fn changed(panel: Panel, edits: &impl Edits, layer: u32, packed: &[u8]) -> Made {
    let mut image = panel.image(packed).map_err(Fault::Picture)?;
    match edits.edit(layer, &mut image) {
        Edit::Kept => Ok(None),
        Edit::Changed => panel.pack(&image).map(Some).map_err(Fault::Pack),
    }
}

/// Goes over the parts of a job: pictures that `wants` names are read and given to
/// `work` on all cores, then each part to `put`, in order, with what `work` made of it.
pub(super) fn in_batches<R: Read + Seek>(
    job: &mut Job<R>,
    mut parts: &[Part],
    wants: &dyn Fn(u32) -> bool,
    work: &(impl Fn(u32, &[u8]) -> Made + Sync),
    mut put: impl FnMut(&mut Job<R>, Part, Option<Vec<u8>>) -> Result<(), RewriteError>,
) -> Result<(), RewriteError> {
    let panel = job.panel();
    let picture_bytes = u64::from(panel.width_px) * u64::from(panel.height_px);
    while !parts.is_empty() {
        // The wanted layers of a batch, and the parts up to the next one.
        let (mut packed, mut bytes, mut length) = (Vec::new(), 0, 0);
        for part in parts {
            if let Some(layer) = part.layer.filter(|&layer| wants(layer)) {
                bytes += job.packed_bytes(layer).saturating_add(picture_bytes);
                if packed.len() == MAX_BATCH || (bytes > BATCH_BYTES && !packed.is_empty()) {
                    break;
                }
                packed.push((layer, job.packed(layer)?));
            }
            length += 1;
        }
        let (batch, later) = parts.split_at(length);
        parts = later;
        let made: Vec<_> = packed.par_iter().map(|(layer, bytes)| work(*layer, bytes)).collect();
        let mut made = packed.iter().map(|(layer, _)| *layer).zip(made).peekable();
        for part in batch {
            let own = made.next_if(|(layer, _)| part.layer == Some(*layer));
            let new = match own {
                Some((layer, made)) => made.map_err(|fault| fault.of(job, layer))?,
                None => None,
            };
            put(job, *part, new)?;
        }
    }
    Ok(())
}

impl Fault {
    fn of<R: Read + Seek>(self, job: &Job<R>, layer: u32) -> RewriteError {
        match self {
            Fault::Picture(source) => job.picture_error(layer, source).into(),
            Fault::Pack(source) => RewriteError::Pack { layer, source },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin;
    use crate::resin::testing::{archive, grey, sl1_config, sl1_settings};
    use std::io::Cursor;
    use std::sync::Mutex;

    /// Turns some layers' pictures into their negatives, and notes what it saw.
    struct Negatives {
        touched: Vec<u32>,
        changed: Vec<u32>,
        seen: Mutex<Vec<u32>>,
    }

    impl Negatives {
        fn of(touched: &[u32], changed: &[u32]) -> Negatives {
            Negatives { touched: touched.to_vec(), changed: changed.to_vec(), seen: Mutex::default() }
        }
    }

    impl Edits for Negatives {
        fn touches(&self, layer: u32) -> bool {
            self.touched.contains(&layer)
        }

        fn edit(&self, layer: u32, image: &mut Image) -> Edit {
            self.seen.lock().expect("no panic").push(layer);
            if !self.changed.contains(&layer) {
                return Edit::Kept;
            }
            image.pixels.iter_mut().for_each(|p| *p = 255 - *p);
            Edit::Changed
        }
    }

    /// A job of 100 layers of 3 × 2 px, its entries in no order, with members that nobody knows.
    fn entries() -> Vec<(String, Vec<u8>)> {
        let mut entries: Vec<(String, Vec<u8>)> =
            (0..100).rev().map(|i| (format!("job{i:05}.png"), grey(3, 2, &[i as u8; 6]))).collect();
        entries.insert(50, ("config.ini".to_owned(), sl1_config(100).into_bytes()));
        entries.insert(0, ("thumbnail/thumbnail400x400.png".to_owned(), grey(1, 1, &[9])));
        entries.push(("prusaslicer.ini".to_owned(), sl1_settings(3, 2).into_bytes()));
        entries.push(("of another program".to_owned(), vec![7; 1000]));
        entries
    }

    type Written = (Vec<u8>, Rewritten, Vec<u32>);

    fn rewritten(job: &[u8], edits: &impl Edits) -> Result<Written, RewriteError> {
        let mut job = resin::open(Cursor::new(job)).expect("a job");
        let (mut out, mut progress) = (Cursor::new(Vec::new()), Vec::new());
        let written = rewrite(&mut job, &mut out, Format::Sl1, edits, &mut |layers| progress.push(layers))?;
        Ok((out.into_inner(), written, progress))
    }

    #[test]
    fn a_job_that_nobody_touches_is_the_same() {
        let job = archive(&entries());
        let (out, written, _) = rewritten(&job, &Untouched).expect("written");
        assert!(out == job);
        assert_eq!(written, Rewritten { layers: 100, ..Rewritten::default() });
    }

    #[test]
    fn only_changed_pictures_are_packed_anew() {
        let job = archive(&entries());
        let edits = Negatives::of(&(10..80).collect::<Vec<_>>(), &[10, 44, 79]);
        let (out, written, progress) = rewritten(&job, &edits).expect("written");
        assert_eq!((written.layers, written.changed, written.notes.len()), (100, 3, 0));
        assert_eq!(progress.last(), Some(&100));
        assert!(progress.is_sorted());
        let mut seen = edits.seen.into_inner().expect("no panic");
        seen.sort_unstable();
        assert_eq!(seen, (10..80).collect::<Vec<u32>>());
        assert_eq!(out, rewritten(&job, &Negatives::of(&[10, 44, 79], &[10, 44, 79])).expect("written").0);

        let mut read = resin::open(Cursor::new(&out[..])).expect("a job");
        for layer in 0..100 {
            let value = layer as u8;
            let expect = if [10, 44, 79].contains(&layer) { 255 - value } else { value };
            assert_eq!(read.image(layer).expect("a picture").pixels, [expect; 6]);
        }
        let (mut before, mut after) = (opened(&job), opened(&out));
        assert!(before.names().eq(after.names()), "every member keeps its place");
        for (i, (name, _)) in entries().iter().enumerate() {
            let same = before.read(i, 1 << 20).expect("read") == after.read(i, 1 << 20).expect("read");
            let changed = [10, 44, 79].iter().any(|l| *name == format!("job{l:05}.png"));
            assert_eq!(same, !changed, "{name}");
        }
    }

    fn opened(bytes: &[u8]) -> Archive<Cursor<&[u8]>> {
        Archive::open(Cursor::new(bytes)).expect("an archive")
    }

    #[test]
    fn what_cannot_be_read_or_packed_is_named() {
        let mut damaged = entries();
        damaged[4].1 = grey(3, 3, &[0; 9]);
        let damaged = archive(&damaged);
        let said = |e: Result<Written, RewriteError>| e.expect_err("refused").to_string();
        let all = Negatives::of(&(0..100).collect::<Vec<_>>(), &[]);
        let words = said(rewritten(&damaged, &all));
        assert!(words.starts_with("layer 96 (\"job00096.png\"): the picture has 3 × 3 px"), "{words}");
        // A picture that nobody looks at is copied as it is.
        assert!(rewritten(&damaged, &Untouched).expect("written").0 == damaged);

        struct Cut;
        impl Edits for Cut {
            fn touches(&self, layer: u32) -> bool {
                layer == 7
            }
            fn edit(&self, _: u32, image: &mut Image) -> Edit {
                image.pixels.pop();
                Edit::Changed
            }
        }
        let words = said(rewritten(&archive(&entries()), &Cut));
        assert!(words.starts_with("layer 7: the picture has 3 × 2 px and 5 bytes"), "{words}");
    }
}
