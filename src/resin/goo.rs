//! GOO, Elegoo's format of its own printers (version V3.0): no archive, but a head with
//! two previews, then for each layer a definition and a picture of runs.
//!
//! Takes a reader of the whole file, gives a [`Job`]. Nothing in the file tells where a
//! layer is but the lengths of those before it: they are followed once, when it is
//! opened. Source: Elegoo's "Goo Format Spec V1.2", and UVtools where that is silent:
//! the checksum, the end of the file, and that `mirror` says how pictures are, not what
//! the printer is to do. Not checked against a printer. Knows no picture's content.
mod head;
mod keep;
pub mod runs;
mod write;

pub use keep::KeepError;
pub(super) use keep::Keeper;
pub(super) use write::Builder;

use super::archive::MAX_ENTRY_BYTES;
use super::image::{MAX_SIDE_PX, Packing, Panel};
use super::job::{
    EXPOSURE_S, Format, Job, JobError, JobLayer, LAYER_MM, MAX_LAYERS, PIXEL_MM, Placement, Source,
};
use super::preview::{self, Preview};
use super::recipe::{Recipe, Stage, Way};
use head::{DEFINITION_BYTES, DELIMITER, Definition, END, HEAD_BYTES, LEAST_HEAD_BYTES, Names, Settings};
use std::io::{self, Read, Seek, SeekFrom};
use std::ops::RangeInclusive;

/// Bytes that tell a file of this kind, and its version.
pub const MARK_BYTES: usize = 12;

/// Ways of the plate that are believed, mm, and how fast, mm/min.
const WAY_MM: RangeInclusive<f32> = 0.0..=1000.0;
const WAY_MM_MIN: RangeInclusive<f32> = 0.0..=100_000.0;

/// Why a file cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum GooError {
    /// Of a version whose fields are others.
    #[error("the file is GOO of version {found:?}, only \"V3.0\" is read; export it as V3.0 or as SL1")]
    Version {
        /// What it says.
        found: String,
    },
    /// It ends too early.
    #[error("the file ends inside {what}, which begins at byte {at}: it is cut off; export or copy it again")]
    Cut {
        /// Where that begins.
        at: u64,
        /// A part of the file.
        what: String,
    },
    /// Something else than must be there.
    #[error("the file is damaged at byte {at}: {what} is expected there; export or copy it again")]
    Damaged {
        /// Where in the file.
        at: u64,
        /// What the format has there.
        what: String,
    },
    /// A picture that announces more than is read.
    #[error(
        "layer {layer} announces a picture of {bytes} bytes, at most {MAX_ENTRY_BYTES} are read: nothing that a slicer writes"
    )]
    TooLarge {
        /// From 0 at the plate.
        layer: u32,
        /// What it announces.
        bytes: u32,
    },
    /// The file itself cannot be read.
    #[error("the file cannot be read: {0}")]
    Io(#[from] io::Error),
}

/// Whether a file that begins so is of this format, of whatever version.
#[must_use]
pub fn is_goo(begins: &[u8]) -> bool {
    let begins = begins.get(..MARK_BYTES).unwrap_or_default();
    begins.starts_with(b"V") && begins.ends_with(&head::MAGIC[4..])
}

/// Where a layer is.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Where its definition begins; the picture is behind it.
    at: u64,
    /// Bytes of its picture.
    bytes: u32,
}

impl Place {
    fn picture_at(self) -> u64 {
        self.at + DEFINITION_BYTES as u64
    }

    /// Where the next layer begins.
    fn end(self) -> u64 {
        self.picture_at() + u64::from(self.bytes) + DELIMITER.len() as u64
    }
}

/// An open file.
#[derive(Debug)]
pub(super) struct Goo<R> {
    reader: R,
    /// Bytes of the whole file.
    length: u64,
    places: Vec<Place>,
    /// Where the first layer begins.
    layers_at: u64,
    /// Where the last one ends.
    layers_end: u64,
}

/// Reads the head and every layer's definition.
///
/// # Errors
/// Another version; a file that is cut off, or does not hold what its head announces; a
/// setting that cannot be right.
pub(super) fn open<R: Read + Seek>(mut reader: R) -> Result<Job<R>, JobError> {
    let length = reader.seek(SeekFrom::End(0)).map_err(GooError::Io)?;
    let head = read_head(&mut reader, length)?;
    let settings = Settings::read(&head);
    let recipe = recipe(&Names::read(&head), &settings);
    let count = settings.layers as usize;
    if count > MAX_LAYERS {
        return Err(JobError::TooManyLayers { count });
    }
    if count == 0 {
        return Err(bad("the head", "its number of layers", 0, "1 or more"));
    }
    let (panel, placement) = panel(&settings)?;
    let layers_at = u64::from(settings.layers_at);
    let mut goo = Goo { reader, length, places: Vec::new(), layers_at, layers_end: layers_at };
    let (layers, pauses) = goo.follow(count)?;
    let recipe = Recipe { pauses, ..recipe };
    Ok(Job { source: Source::Goo(goo), format: Format::Goo, panel, placement, layers, recipe })
}

/// The bytes before the first layer, as far as anything is known of them.
fn read_head<R: Read + Seek>(reader: &mut R, length: u64) -> Result<Vec<u8>, GooError> {
    let mut head = Vec::new();
    reader.seek(SeekFrom::Start(0))?;
    reader.by_ref().take(HEAD_BYTES as u64).read_to_end(&mut head)?;
    if is_goo(&head) && !head.starts_with(&head::MAGIC) {
        return Err(GooError::Version { found: String::from_utf8_lossy(&head[..4]).into_owned() });
    }
    if !head.starts_with(&head::MAGIC) {
        return Err(GooError::Damaged { at: 0, what: "\"V3.0\" and the format's mark".to_owned() });
    }
    if head.len() < LEAST_HEAD_BYTES {
        return Err(GooError::Cut { at: 0, what: "the head".to_owned() });
    }
    let layers_at = u64::from(Settings::read(&head).layers_at);
    if layers_at < LEAST_HEAD_BYTES as u64 || layers_at >= length {
        let what = format!(
            "where layers begin, between {LEAST_HEAD_BYTES} and the file's end at {length} and not at {layers_at},"
        );
        return Err(GooError::Damaged { at: LEAST_HEAD_BYTES as u64 - 4, what });
    }
    head.truncate(layers_at as usize);
    Ok(head)
}

impl<R: Read + Seek> Goo<R> {
    /// Follows the layers' lengths to the end of the file.
    fn follow(&mut self, count: usize) -> Result<(Vec<JobLayer>, Vec<u32>), JobError> {
        let (mut layers, mut pauses) = (Vec::<JobLayer>::new(), Vec::new());
        let mut at = self.layers_at;
        self.reader.seek(SeekFrom::Start(at)).map_err(GooError::Io)?;
        for layer in 0..count {
            let definition = self.definition(layer, at)?;
            let place = Place { at, bytes: definition.bytes };
            self.places.push(place);
            let before_mm = layers.last().map_or(0.0, |l| l.top_mm);
            layers.push(job_layer(layer, &definition, before_mm)?);
            pauses.extend((definition.pause == 1).then_some(layer as u32));
            let whole = place.end();
            if whole > self.length {
                return Err(GooError::Cut { at, what: format!("layer {layer}") }.into());
            }
            // Within a buffer where it can be: most layers are small.
            let skipped = i64::from(place.bytes) + DELIMITER.len() as i64;
            self.reader.seek_relative(skipped).map_err(GooError::Io)?;
            at = whole;
        }
        self.layers_end = at;
        let mut end = Vec::new();
        self.reader.by_ref().take(END.len() as u64).read_to_end(&mut end).map_err(GooError::Io)?;
        if end != END {
            let what = format!("the mark of the end, behind {count} layers,");
            return Err(GooError::Damaged { at, what }.into());
        }
        Ok((layers, pauses))
    }

    /// The definition at which the reader stands.
    fn definition(&mut self, layer: usize, at: u64) -> Result<Definition, GooError> {
        let mut bytes = [0; DEFINITION_BYTES];
        self.reader.read_exact(&mut bytes).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => GooError::Cut { at, what: format!("layer {layer}") },
            _ => GooError::Io(e),
        })?;
        let definition = Definition::read(&bytes);
        if definition.delimiter != DELIMITER {
            return Err(GooError::Damaged { at: at + 64, what: format!("a line end in layer {layer}") });
        }
        Ok(definition)
    }

    /// Bytes of a picture, packed.
    pub(super) fn packed_bytes(&self, entry: usize) -> u64 {
        self.places.get(entry).map_or(0, |place| place.bytes.into())
    }

    /// Where a layer is, for messages.
    pub(super) fn name(&self, entry: usize) -> String {
        self.places.get(entry).map_or_else(String::new, |place| format!("byte {}", place.at))
    }

    /// The large preview; nothing where it is black.
    pub(super) fn preview(&mut self) -> Result<Option<Preview>, GooError> {
        let (side, at) = head::PREVIEWS[1];
        self.reader.seek(SeekFrom::Start(at as u64))?;
        let mut bytes = vec![0; 2 * (side * side) as usize];
        self.reader.read_exact(&mut bytes)?;
        let pixels = bytes.as_chunks::<2>().0.iter().map(|b| preview::from_565(u16::from_be_bytes(*b)));
        let preview = Preview { width_px: side, height_px: side, pixels: pixels.collect() };
        Ok(Some(preview).filter(|p| p.pixels.iter().any(|&pixel| pixel != [0; 3])))
    }

    /// A picture as it stands in the file.
    pub(super) fn packed(&mut self, entry: usize) -> Result<Vec<u8>, GooError> {
        let layer = entry as u32;
        let Some(place) = self.places.get(entry) else {
            return Err(GooError::Cut { at: self.length, what: format!("layer {layer}") });
        };
        if u64::from(place.bytes) > MAX_ENTRY_BYTES {
            return Err(GooError::TooLarge { layer, bytes: place.bytes });
        }
        self.reader.seek(SeekFrom::Start(place.picture_at()))?;
        let mut bytes = Vec::with_capacity(place.bytes.min(1 << 20) as usize);
        self.reader.by_ref().take(place.bytes.into()).read_to_end(&mut bytes)?;
        if bytes.len() as u64 != u64::from(place.bytes) {
            return Err(GooError::Cut { at: place.at, what: format!("layer {layer}") });
        }
        Ok(bytes)
    }
}

/// The panel, and how its pictures lie.
fn panel(settings: &Settings) -> Result<(Panel, Placement), JobError> {
    let [width_px, height_px] = settings.panel_px.map(u32::from);
    for px in [width_px, height_px] {
        if !(1..=MAX_SIDE_PX).contains(&px) {
            return Err(bad("the head", "a side of the panel in px", px, &format!("1 to {MAX_SIDE_PX}")));
        }
    }
    let mut pixel_mm = [0.0; 2];
    for (side, pixel_mm) in pixel_mm.iter_mut().enumerate() {
        *pixel_mm = decimal(settings.panel_mm[side]) / f64::from(settings.panel_px[side]);
        if !PIXEL_MM.contains(pixel_mm) {
            let wanted = format!("{} to {} mm for each pixel", PIXEL_MM.start(), PIXEL_MM.end());
            return Err(bad("the head", "a side of the panel in mm", settings.panel_mm[side], &wanted));
        }
    }
    let [mirror_x, mirror_y] = settings.mirror.map(|flag| flag != 0);
    let placement = Placement { pixel_mm, reverse_u: mirror_x, reverse_v: !mirror_y, swap: false };
    Ok((Panel { width_px, height_px, packing: Packing::Runs }, placement))
}

fn job_layer(layer: usize, definition: &Definition, before_mm: f64) -> Result<JobLayer, JobError> {
    let name = || format!("layer {layer}");
    let top_mm = decimal(definition.top_mm);
    let height_mm = top_mm - before_mm;
    // A number of four bytes is off by up to 0.00003 mm at 300 mm.
    if !(LAYER_MM.start() - 1e-4..=LAYER_MM.end() + 1e-4).contains(&height_mm) {
        let wanted = format!("{before_mm} mm and {} to {} more", LAYER_MM.start(), LAYER_MM.end());
        return Err(bad(&name(), "its Z in mm", definition.top_mm, &wanted));
    }
    let exposure_s = decimal(definition.exposure_s);
    if !EXPOSURE_S.contains(&exposure_s) {
        let wanted = format!("{} to {} s", EXPOSURE_S.start(), EXPOSURE_S.end());
        return Err(bad(&name(), "its exposure in s", definition.exposure_s, &wanted));
    }
    Ok(JobLayer { entry: layer, top_mm, height_mm, exposure_s })
}

fn bad(entry: &str, key: &'static str, found: impl ToString, wanted: &str) -> JobError {
    JobError::BadSetting { entry: entry.to_owned(), key, found: found.to_string(), wanted: wanted.to_owned() }
}

/// The shortest decimal number that is this one in four bytes: 0.05, not 0.0500000007.
fn decimal(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

/// What the head tells of the print. What cannot be right counts as not told.
fn recipe(names: &Names, settings: &Settings) -> Recipe {
    let told = |value: f32, range: RangeInclusive<f32>| range.contains(&value).then(|| decimal(value));
    let way = |way: head::Way| Way { mm: told(way.mm, WAY_MM), mm_min: told(way.mm_min, WAY_MM_MIN) };
    let seconds = 0.0..=*EXPOSURE_S.end() as f32;
    let stage = |i: usize, exposure_s: f32| Stage {
        exposure_s: told(exposure_s, seconds.clone()).unwrap_or(0.0),
        lift: [way(settings.lift[i]), way(settings.lift2[i])],
        retract: [way(settings.retract[i]), way(settings.retract2[i])],
        waits_s: settings.waits_s[i].map(|s| told(s, seconds.clone())),
        light: (settings.light[i] <= 255).then(|| f64::from(settings.light[i]) / 255.0),
    };
    Recipe {
        bottom: stage(0, settings.bottom_exposure_s),
        usual: stage(1, settings.exposure_s),
        // More than there are is all of them; other formats do not take any number.
        bottom_layers: settings.bottom_layers.min(MAX_LAYERS as u32),
        transition_layers: settings.transition_layers.into(),
        print_time_s: (settings.print_time_s > 0).then(|| settings.print_time_s.into()),
        resin_mm3: told(settings.volume_mm3, 0.0..=1e9).filter(|&v| v > 0.0),
        machine_z_mm: told(settings.machine_z_mm, WAY_MM).filter(|&mm| mm > 0.0),
        printer: names.printer[0].clone(),
        resin: names.profile.clone(),
        pauses: Vec::new(),
        created: Some(names.created.clone()).filter(|c| !c.is_empty()),
    }
}

#[cfg(test)]
pub(super) mod tests;
