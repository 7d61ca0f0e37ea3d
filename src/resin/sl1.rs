//! SL1 and SL1S, as PrusaSlicer writes it: `config.ini`, the slicer's own settings in
//! `prusaslicer.ini`, and `<jobDir>NNNNN.png`, one a layer from 0.
//!
//! Takes an archive, gives a [`Job`]. The keys are those of PrusaSlicer's files; how
//! the picture lies over the plate is the inverse of what PrusaSlicer does when it
//! draws it. Knows no picture's content.
use super::archive::Archive;
use super::image::{Packing, Panel, size_px};
use super::job::{EXPOSURE_S, Format, Job, JobError, JobLayer, LAYER_MM, PIXEL_MM, Placement, in_order};
use std::collections::BTreeMap;
use std::io::{Read, Seek};
use std::ops::RangeInclusive;

/// The file that makes an archive an SL1 job.
pub(super) const CONFIG: &str = "config.ini";

/// Most bytes of a file of settings. Real ones have some kilobytes.
const MAX_SETTINGS_BYTES: u64 = 4 << 20;

/// Most layers that fade from the first exposure to the others'.
const MAX_FADE: f64 = 10_000.0;

/// Digits of a layer's number: five, or more from layer 100,000 up.
const DIGITS: RangeInclusive<usize> = 5..=9;

/// Reads the settings and finds the pictures.
///
/// # Errors
/// A file of settings or one of the keys is missing or cannot be right; layers are
/// missing, double, or not as many as announced (`numFast` + `numSlow`).
pub(super) fn open<R: Read + Seek>(mut archive: Archive<R>) -> Result<Job<R>, JobError> {
    let config = Ini::read(&mut archive, CONFIG)?;
    let slicer = slicer_settings(&mut archive)?;
    let prefix = config.text("jobDir", "the pictures are named after it")?.to_owned();
    let pattern = format!("{prefix}NNNNN.png");
    let name = |layer: u32| format!("{prefix}{layer:05}.png");
    let entries = in_order(&archive, 0..=0, &pattern, |n| layer_number(n, &prefix), name)?;
    announced(&config, entries.len())?;
    let (panel, placement) = panel(&mut archive, &slicer, entries[0])?;
    let layers = layers(&config, &slicer, &entries)?;
    Ok(Job { archive, format: Format::Sl1, panel, placement, layers })
}

/// The number in `<prefix>NNNNN.png`.
fn layer_number(name: &str, prefix: &str) -> Option<u32> {
    let digits = name.strip_prefix(prefix)?.strip_suffix(".png")?;
    (DIGITS.contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_digit()))
        .then(|| digits.parse().ok())
        .flatten()
}

/// A job that was cut off holds fewer pictures than it announces.
fn announced(config: &Ini, found: usize) -> Result<(), JobError> {
    let (fast, slow) = (config.number("numFast")?, config.number("numSlow")?);
    let announced = (fast.unwrap_or(0.0) + slow.unwrap_or(0.0)).clamp(0.0, 1e9) as u64;
    if fast.is_some() && announced != found as u64 {
        return Err(JobError::LayerCount { entry: config.entry.clone(), announced, found });
    }
    Ok(())
}

/// The settings of the slicer: PrusaSlicer's, or of its kin under another name.
fn slicer_settings<R: Read + Seek>(archive: &mut Archive<R>) -> Result<Ini, JobError> {
    const USUAL: &str = "prusaslicer.ini";
    let kin = |n: &&str| n.ends_with(".ini") && *n != CONFIG && !n.contains(['/', '\\']);
    let name = match archive.find(USUAL) {
        Some(_) => USUAL.to_owned(),
        None => archive.names().find(kin).unwrap_or(USUAL).to_owned(),
    };
    Ini::read(archive, &name)
}

/// Exposure of a layer, s: `expTimeFirst` fades over `numFade` layers to `expTime`,
/// as the printer's firmware does it.
fn exposure_s(layer: usize, first_s: f64, others_s: f64, fade: f64) -> f64 {
    let layer = layer as f64;
    if layer < fade { others_s + (first_s - others_s) * (fade - layer) / fade } else { others_s }
}

fn layers(config: &Ini, slicer: &Ini, entries: &[usize]) -> Result<Vec<JobLayer>, JobError> {
    let height_mm = config.within("layerHeight", LAYER_MM, "it is the height of a layer in mm")?;
    let others_s = config.within("expTime", EXPOSURE_S, "it is the exposure in s")?;
    let first_s = config.optional("expTimeFirst", EXPOSURE_S)?.unwrap_or(others_s);
    let fade = config.optional("numFade", 0.0..=MAX_FADE)?.unwrap_or(0.0);
    // PrusaSlicer takes the layer height where this is 0.
    let first_mm = match slicer.optional("initial_layer_height", 0.0..=*LAYER_MM.end())? {
        Some(mm) if LAYER_MM.contains(&mm) => mm,
        _ => height_mm,
    };
    let layer = |(i, &entry): (usize, &usize)| JobLayer {
        entry,
        top_mm: first_mm + height_mm * i as f64,
        height_mm: if i == 0 { first_mm } else { height_mm },
        exposure_s: exposure_s(i, first_s, others_s, fade),
    };
    Ok(entries.iter().enumerate().map(layer).collect())
}

/// The panel and how it lies over the plate.
///
/// PrusaSlicer draws x along rows and y up columns; for a panel in portrait it swaps
/// them and mirrors, and mirrors on top what the printer's `display_mirror_x` and `_y`
/// say. Other programs write pictures of a portrait panel unturned: then the picture's
/// own size tells.
fn panel<R: Read + Seek>(
    archive: &mut Archive<R>,
    slicer: &Ini,
    first: usize,
) -> Result<(Panel, Placement), JobError> {
    const WHY: &str = "the size of a pixel is unknown without it";
    let px = |key| slicer.within(key, 1.0..=f64::from(super::image::MAX_SIDE_PX), WHY);
    let (wide, high) = (px("display_pixels_x")? as u32, px("display_pixels_y")? as u32);
    let side = |key, px: u32| {
        let px = f64::from(px);
        slicer.within(key, px * PIXEL_MM.start()..=px * PIXEL_MM.end(), WHY).map(|mm| mm / px)
    };
    let pixel_mm = [side("display_width", wide)?, side("display_height", high)?];
    let png = archive.read(first, super::archive::MAX_ENTRY_BYTES)?;
    let entry = archive.name(first).to_owned();
    let found = size_px(&png).map_err(|source| JobError::Picture { layer: 0, entry, source })?;
    let said = slicer.get("display_orientation").is_some_and(|o| o.eq_ignore_ascii_case("portrait"));
    let portrait = if wide == high { said } else { found == [high, wide] || (said && found != [wide, high]) };
    let mirror = |key| slicer.get(key).is_some_and(|v| v == "1");
    let placement = Placement {
        pixel_mm: if portrait { [pixel_mm[1], pixel_mm[0]] } else { pixel_mm },
        reverse_u: mirror("display_mirror_x") != portrait,
        reverse_v: !mirror("display_mirror_y"),
        swap: portrait,
    };
    let [width_px, height_px] = if portrait { [high, wide] } else { [wide, high] };
    Ok((Panel { width_px, height_px, packing: Packing::Grey }, placement))
}

/// A file of `key = value` lines.
struct Ini {
    entry: String,
    keys: BTreeMap<String, String>,
}

impl Ini {
    fn read<R: Read + Seek>(archive: &mut Archive<R>, entry: &str) -> Result<Ini, JobError> {
        let bytes = archive.read_named(entry, MAX_SETTINGS_BYTES)?;
        let text = String::from_utf8_lossy(&bytes);
        let pair = |line: &str| {
            let (key, value) = line.split_once('=')?;
            Some((key.trim().to_owned(), value.trim().to_owned()))
        };
        let lines = text.trim_start_matches('\u{feff}').lines();
        let keys = lines.filter(|l| !l.trim_start().starts_with(['#', ';'])).filter_map(pair).collect();
        Ok(Ini { entry: entry.to_owned(), keys })
    }

    fn get(&self, key: &str) -> Option<&str> {
        self.keys.get(key).map(String::as_str).filter(|v| !v.is_empty())
    }

    fn text(&self, key: &'static str, needed: &'static str) -> Result<&str, JobError> {
        self.get(key).ok_or_else(|| JobError::NoSetting { entry: self.entry.clone(), key, needed })
    }

    fn number(&self, key: &'static str) -> Result<Option<f64>, JobError> {
        self.optional(key, f64::MIN..=f64::MAX)
    }

    fn optional(&self, key: &'static str, within: RangeInclusive<f64>) -> Result<Option<f64>, JobError> {
        let Some(found) = self.get(key) else { return Ok(None) };
        match found.parse::<f64>() {
            Ok(value) if within.contains(&value) => Ok(Some(value)),
            _ => {
                let wanted = format!("a number from {} to {}", within.start(), within.end());
                Err(JobError::BadSetting { entry: self.entry.clone(), key, found: found.to_owned(), wanted })
            }
        }
    }

    fn within(
        &self,
        key: &'static str,
        range: RangeInclusive<f64>,
        needed: &'static str,
    ) -> Result<f64, JobError> {
        let found = self.optional(key, range)?;
        found.ok_or_else(|| JobError::NoSetting { entry: self.entry.clone(), key, needed })
    }
}
