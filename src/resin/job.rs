//! A resin job as types: its layers, its panel, and how the panel lies over the plate.
//!
//! Takes what a format read of an archive's settings, gives the layers' pictures one
//! at a time. Knows no format, no polygon and no file system.
use super::archive::{Archive, ArchiveError, MAX_ENTRY_BYTES};
use super::goo::{Goo, GooError};
use super::image::{Image, ImageError, Panel};
use super::recipe::Recipe;
use std::borrow::Cow;
use std::io::{Read, Seek};
use std::ops::RangeInclusive;

/// Most layers: 5 m at 0.05 mm.
pub const MAX_LAYERS: usize = 100_000;

/// Heights of a layer that are believed, mm.
pub const LAYER_MM: RangeInclusive<f64> = 0.001..=1.0;

/// Sides of a pixel that are believed, mm. The finest panels have 0.0076 mm; the grid
/// of the layers' polygons is 0.0001 mm.
pub const PIXEL_MM: RangeInclusive<f64> = 0.001..=1.0;

/// Exposures that are believed, s.
pub const EXPOSURE_S: RangeInclusive<f64> = 0.0..=3600.0;

/// The formats that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Prusa's SL1 and SL1S, as PrusaSlicer writes it.
    Sl1,
    /// NanoDLP's plates.
    NanoDlp,
    /// Elegoo's GOO, version V3.0.
    Goo,
}

impl Format {
    /// What machines call it, and what its files' names end in.
    #[must_use]
    pub fn key(self) -> &'static str {
        match self {
            Format::Sl1 => "sl1",
            Format::NanoDlp => "nanodlp",
            Format::Goo => "goo",
        }
    }

    /// The format of files whose name ends so behind the last dot, in whatever case.
    #[must_use]
    pub fn of_ending(ending: &str) -> Option<Format> {
        let ending = ending.to_ascii_lowercase();
        // SL1S is another printer, not another format.
        let known =
            [("sl1s", Format::Sl1), ("sl1", Format::Sl1), ("nanodlp", Format::NanoDlp), ("goo", Format::Goo)];
        known.into_iter().find(|(name, _)| *name == ending).map(|(_, format)| format)
    }
}

impl std::fmt::Display for Format {
    /// What people call it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Format::Sl1 => "SL1",
            Format::NanoDlp => "NanoDLP",
            Format::Goo => "GOO",
        })
    }
}

/// A layer of a job.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JobLayer {
    /// Which of the entries, or of the layers of a file that is no archive, holds its picture.
    pub(super) entry: usize,
    /// Height where it ends, mm above the plate.
    pub top_mm: f64,
    /// Its own height, mm.
    pub height_mm: f64,
    /// How long it is exposed, s.
    pub exposure_s: f64,
}

/// How a picture lies over the plate, seen from above: x to the right, y to the back.
///
/// A corner of pixels, `u` of them from the left and `v` from the top of the picture,
/// is first counted from the other side where reversed, and then taken as x and y,
/// or as y and x where swapped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Length of a pixel along a row and along a column, mm.
    pub pixel_mm: [f64; 2],
    /// Columns are counted from the right.
    pub reverse_u: bool,
    /// Rows are counted from the bottom, as in a picture that is upright.
    pub reverse_v: bool,
    /// Columns run to the back and rows to the right.
    pub swap: bool,
}

impl Placement {
    /// Where a place in a picture lies over the plate, mm: columns from the left and rows from the top,
    /// to x and y, from the corner of the panel.
    #[must_use]
    pub fn plate_mm(&self, panel: Panel, [u, v]: [f64; 2]) -> [f64; 2] {
        let turned = |at: f64, px: u32, reverse: bool| if reverse { f64::from(px) - at } else { at };
        let along = turned(u, panel.width_px, self.reverse_u) * self.pixel_mm[0];
        let across = turned(v, panel.height_px, self.reverse_v) * self.pixel_mm[1];
        if self.swap { [across, along] } else { [along, across] }
    }

    /// Whether the plate shows the picture mirrored, so that what runs
    /// counter-clockwise in the picture as seen runs clockwise over the plate.
    #[must_use]
    pub fn mirrored(&self) -> bool {
        self.reverse_u ^ !self.reverse_v ^ self.swap
    }
}

/// Why a job cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum JobError {
    /// The archive itself.
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    /// A GOO file itself.
    #[error(transparent)]
    Goo(#[from] GooError),
    /// An archive of something else.
    #[error(
        "the archive is no resin job that is read here: it has neither config.ini (SL1) nor plate.json, options.json or slicer.json (NanoDLP); it begins with {first:?}"
    )]
    UnknownFormat {
        /// Names of its first entries.
        first: Vec<String>,
    },
    /// A file of settings that cannot be understood.
    #[error("{entry:?} cannot be understood: {why}; export the job again")]
    Settings {
        /// Its name.
        entry: String,
        /// What is wrong and where.
        why: String,
    },
    /// A setting that is not there.
    #[error("{entry:?} has no {key}: {needed}; export the job again")]
    NoSetting {
        /// The file of settings.
        entry: String,
        /// The key.
        key: &'static str,
        /// What it is needed for.
        needed: &'static str,
    },
    /// A setting that cannot be right.
    #[error("{entry:?} says {key} = {found}: {wanted} is needed; export the job again")]
    BadSetting {
        /// The file of settings.
        entry: String,
        /// The key.
        key: &'static str,
        /// What stands there.
        found: String,
        /// What could be read.
        wanted: String,
    },
    /// The job has no layer.
    #[error("the archive holds no layer: no picture is named {pattern}; export the job again")]
    NoLayer {
        /// How layers are named.
        pattern: String,
    },
    /// More layers than any job.
    #[error("the archive holds {count} layers, at most {MAX_LAYERS} are read")]
    TooManyLayers {
        /// Layers found.
        count: usize,
    },
    /// Two pictures for one layer.
    #[error("layer {layer} has two pictures, {one:?} and {other:?}; export the job again")]
    LayerTwice {
        /// The number in the names.
        layer: u32,
        /// One of them.
        one: String,
        /// The other.
        other: String,
    },
    /// A layer between others is missing.
    #[error(
        "layer {layer} is missing: no {name:?} in the archive, which holds later layers; export the job again"
    )]
    LayerMissing {
        /// The number that no name has.
        layer: u32,
        /// The name that it would have.
        name: String,
    },
    /// The settings announce another number of layers.
    #[error(
        "{entry:?} announces {announced} layers, the archive holds {found}: cut off or mixed up; export the job again"
    )]
    LayerCount {
        /// The file of settings.
        entry: String,
        /// Layers that it announces.
        announced: u64,
        /// Pictures in the archive.
        found: usize,
    },
    /// A layer's picture.
    #[error("layer {layer} ({entry:?}): {source}")]
    Picture {
        /// From 0 at the plate.
        layer: u32,
        /// Name in the archive.
        entry: String,
        /// What is wrong with it.
        source: ImageError,
    },
}

/// Where a job's pictures are.
#[derive(Debug)]
pub(super) enum Source<R> {
    /// A zip: an entry a layer.
    Archive(Archive<R>),
    /// A GOO file.
    Goo(Goo<R>),
}

/// An open job.
#[derive(Debug)]
pub struct Job<R> {
    pub(super) source: Source<R>,
    pub(super) format: Format,
    pub(super) panel: Panel,
    pub(super) placement: Placement,
    pub(super) layers: Vec<JobLayer>,
    pub(super) recipe: Recipe,
}

impl<R: Read + Seek> Job<R> {
    /// The format that it was written in.
    #[must_use]
    pub fn format(&self) -> Format {
        self.format
    }

    /// The panel that its pictures are for.
    #[must_use]
    pub fn panel(&self) -> Panel {
        self.panel
    }

    /// How pictures lie over the plate.
    #[must_use]
    pub fn placement(&self) -> Placement {
        self.placement
    }

    /// The layers from the plate up, at least one.
    #[must_use]
    pub fn layers(&self) -> &[JobLayer] {
        &self.layers
    }

    /// How it is to be printed, as far as its settings tell.
    #[must_use]
    pub fn recipe(&self) -> &Recipe {
        &self.recipe
    }

    /// What holds a layer's picture, for messages: the name of an archive's entry, or
    /// where in the file; empty beyond the last layer.
    #[must_use]
    pub fn entry_name(&self, layer: u32) -> Cow<'_, str> {
        let Some(found) = self.layers.get(layer as usize) else { return Cow::Borrowed("") };
        match &self.source {
            Source::Archive(archive) => Cow::Borrowed(archive.name(found.entry)),
            Source::Goo(goo) => Cow::Owned(goo.name(found.entry)),
        }
    }

    /// Bytes that a layer's picture announces, packed; 0 beyond the last layer.
    #[must_use]
    pub fn packed_bytes(&self, layer: u32) -> u64 {
        let Some(found) = self.layers.get(layer as usize) else { return 0 };
        match &self.source {
            Source::Archive(archive) => archive.announced(found.entry),
            Source::Goo(goo) => goo.packed_bytes(found.entry),
        }
    }

    /// A layer's picture as the job holds it, from 0 at the plate: what
    /// [`Panel::rows`] of [`Job::panel`] reads, on any thread.
    ///
    /// # Errors
    /// There is no such layer, or the file is damaged there.
    pub fn packed(&mut self, layer: u32) -> Result<Vec<u8>, JobError> {
        let Some(found) = self.layers.get(layer as usize) else {
            return Err(JobError::LayerMissing { layer, name: "such picture".to_owned() });
        };
        match &mut self.source {
            Source::Archive(archive) => Ok(archive.read(found.entry, MAX_ENTRY_BYTES)?),
            Source::Goo(goo) => Ok(goo.packed(found.entry)?),
        }
    }

    /// A layer's picture, from 0 at the plate.
    ///
    /// # Errors
    /// As [`Job::packed`], and when the picture cannot be read.
    pub fn image(&mut self, layer: u32) -> Result<Image, JobError> {
        let packed = self.packed(layer)?;
        self.panel.image(&packed).map_err(|source| self.picture_error(layer, source))
    }

    /// What was wrong with a layer's picture, and where.
    #[must_use]
    pub fn picture_error(&self, layer: u32, source: ImageError) -> JobError {
        JobError::Picture { layer, entry: self.entry_name(layer).into_owned(), source }
    }
}

/// The pictures of a job in order: entries named with a number, without gaps.
///
/// `number` gives the number in a name, or nothing where the entry is no layer;
/// `name` gives the name of a number, for messages.
pub(super) fn in_order<R: Read + Seek>(
    archive: &Archive<R>,
    starts: RangeInclusive<u32>,
    pattern: &str,
    number: impl Fn(&str) -> Option<u32>,
    name: impl Fn(u32) -> String,
) -> Result<Vec<usize>, JobError> {
    let mut found: Vec<(u32, usize)> =
        archive.names().enumerate().filter_map(|(index, n)| Some((number(n)?, index))).collect();
    found.sort_unstable();
    if found.len() > MAX_LAYERS {
        return Err(JobError::TooManyLayers { count: found.len() });
    }
    let Some(&(first, _)) = found.first() else {
        return Err(JobError::NoLayer { pattern: pattern.to_owned() });
    };
    if let Some(pair) = found.windows(2).find(|w| w[0].0 == w[1].0) {
        let [one, other] = [pair[0].1, pair[1].1].map(|index| archive.name(index).to_owned());
        return Err(JobError::LayerTwice { layer: pair[0].0, one, other });
    }
    let first = first.clamp(*starts.start(), *starts.end());
    let gap = (first..).zip(&found).find(|(expected, (number, _))| expected != number);
    if let Some((layer, _)) = gap {
        return Err(JobError::LayerMissing { layer, name: name(layer) });
    }
    Ok(found.into_iter().map(|(_, index)| index).collect())
}
