//! SL1 and SL1S, as PrusaSlicer writes it: `config.ini`, the slicer's own settings in
//! `prusaslicer.ini`, and `<jobDir>NNNNN.png`, one a layer from 0.
//!
//! Takes an archive, gives a [`Job`]. The keys are those of PrusaSlicer's files; how
//! the picture lies over the plate is the inverse of what PrusaSlicer does when it
//! draws it. Knows no picture's content.
pub(super) mod write;

use super::archive::Archive;
use super::image::{Packing, Panel, size_px};
use super::job::{
    EXPOSURE_S, Format, Job, JobError, JobLayer, LAYER_MM, PIXEL_MM, Placement, Source, in_order,
};
use super::recipe::{Recipe, Stage};
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
    let recipe = recipe(&config, &slicer)?;
    let layers = layers(&config, &slicer, &entries, &recipe)?;
    Ok(Job { source: Source::Archive(archive), format: Format::Sl1, panel, placement, layers, recipe })
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

/// What the settings tell of the print. `expTimeFirst` fades over `numFade` layers to
/// `expTime`, as the printer's firmware does it: one layer on the plate, the others of
/// them between. Lift and waits are the printer's own.
fn recipe(config: &Ini, slicer: &Ini) -> Result<Recipe, JobError> {
    let others_s = config.within("expTime", EXPOSURE_S, "it is the exposure in s")?;
    let first_s = config.optional("expTimeFirst", EXPOSURE_S)?.unwrap_or(others_s);
    let fade = config.optional("numFade", 0.0..=MAX_FADE)?.unwrap_or(0.0).round() as u32;
    let stage = |exposure_s| Stage { exposure_s, ..Stage::default() };
    // For people only: no job is refused for one of these.
    let number = |ini: &Ini, key| ini.get(key).and_then(|v| v.parse::<f64>().ok());
    let told = |ini, key, within: RangeInclusive<f64>| number(ini, key).filter(|v| within.contains(v));
    let text = |keys: [&str; 2]| keys.iter().find_map(|key| config.get(key)).unwrap_or_default().to_owned();
    Ok(Recipe {
        bottom: stage(first_s),
        usual: stage(others_s),
        bottom_layers: fade.min(1),
        transition_layers: fade.saturating_sub(1),
        print_time_s: told(config, "printTime", 1.0..=1e8),
        resin_mm3: told(config, "usedMaterial", 1e-6..=1e6).map(|ml| ml * 1000.0),
        machine_z_mm: told(slicer, "max_print_height", 1.0..=10_000.0),
        printer: text(["printerModel", "printerProfile"]),
        resin: text(["materialName", "printProfile"]),
        pauses: Vec::new(),
        created: config.get("fileCreationTimestamp").and_then(created),
    })
}

/// `2026-11-22 at 04:39:04 UTC` without its words.
fn created(text: &str) -> Option<String> {
    let (day, time) = text.strip_suffix(" UTC")?.split_once(" at ")?;
    (day.len() == 10 && time.len() == 8).then(|| format!("{day} {time}"))
}

fn layers(config: &Ini, slicer: &Ini, entries: &[usize], recipe: &Recipe) -> Result<Vec<JobLayer>, JobError> {
    let height_mm = config.within("layerHeight", LAYER_MM, "it is the height of a layer in mm")?;
    // PrusaSlicer takes the layer height where this is 0.
    let first_mm = match slicer.optional("initial_layer_height", 0.0..=*LAYER_MM.end())? {
        Some(mm) if LAYER_MM.contains(&mm) => mm,
        _ => height_mm,
    };
    let layer = |(i, &entry): (usize, &usize)| JobLayer {
        entry,
        top_mm: first_mm + height_mm * i as f64,
        height_mm: if i == 0 { first_mm } else { height_mm },
        exposure_s: recipe.exposure_s(i as u32),
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
    let picture = |source| JobError::Picture { layer: 0, entry: entry.clone(), source };
    let found = size_px(&png).map_err(picture)?;
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
    let panel = Panel { width_px, height_px, packing: Packing::Grey };
    panel.fits(found).map_err(picture)?;
    Ok((panel, placement))
}

/// A file of `key = value` lines.
struct Ini {
    entry: String,
    keys: BTreeMap<String, String>,
}

impl Ini {
    fn read<R: Read + Seek>(archive: &mut Archive<R>, entry: &str) -> Result<Ini, JobError> {
        Ok(Ini::of(entry, &archive.read_named(entry, MAX_SETTINGS_BYTES)?))
    }

    fn of(entry: &str, bytes: &[u8]) -> Ini {
        let text = String::from_utf8_lossy(bytes);
        let pair = |line: &str| {
            let (key, value) = line.split_once('=')?;
            Some((key.trim().to_owned(), value.trim().to_owned()))
        };
        let lines = text.trim_start_matches('\u{feff}').lines();
        let keys = lines.filter(|l| !l.trim_start().starts_with(['#', ';'])).filter_map(pair).collect();
        Ini { entry: entry.to_owned(), keys }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin;
    use crate::resin::testing::{archive, grey, header, sl1, sl1_config, sl1_settings};
    use std::io::Cursor;

    type Entries = Vec<(String, Vec<u8>)>;

    /// A job of three layers of 3 × 2 px.
    fn entries() -> Entries {
        let mut entries = vec![
            ("config.ini".to_owned(), sl1_config(3).into_bytes()),
            ("prusaslicer.ini".to_owned(), sl1_settings(3, 2).into_bytes()),
            ("thumbnail/thumbnail400x400.png".to_owned(), grey(1, 1, &[9])),
        ];
        // Not in order: zip writers need not keep it.
        for i in [2, 0, 1] {
            entries.push((format!("job{i:05}.png"), grey(3, 2, &[i; 6])));
        }
        entries
    }

    fn open(entries: &Entries) -> Result<Job<Cursor<Vec<u8>>>, JobError> {
        resin::open(Cursor::new(archive(entries)))
    }

    #[test]
    fn layers_come_in_order_with_heights_and_exposures() {
        let mut job = open(&entries()).expect("a job");
        assert_eq!(job.format(), Format::Sl1);
        assert_eq!(job.panel(), Panel { width_px: 3, height_px: 2, packing: Packing::Grey });
        for (i, (top, height, exposure)) in
            [(0.1, 0.1, 25.0), (0.15, 0.05, 20.0), (0.2, 0.05, 15.0)].into_iter().enumerate()
        {
            let layer = job.layers()[i];
            assert!((layer.top_mm - top).abs() < 1e-12 && layer.height_mm == height, "{layer:?}");
            assert!((layer.exposure_s - exposure).abs() < 1e-12, "{layer:?}");
            let image = job.image(i as u32).expect("a picture");
            assert_eq!(image.pixels, [i as u8; 6]);
            assert_eq!(job.entry_name(i as u32), format!("job{i:05}.png"));
        }
        assert!(matches!(job.image(3), Err(JobError::LayerMissing { layer: 3, .. })));
    }

    #[test]
    fn exposure_fades_as_the_firmware_does() {
        let check = |fade: &str, expect: &[f64]| {
            let text =
                sl1_config(3).replace("expTime = 5", "expTime = 12").replace("First = 25", "First = 45");
            let config = Ini::of("config.ini", text.replace("numFade = 4", fade).as_bytes());
            let recipe = recipe(&config, &Ini::of("prusaslicer.ini", b"")).expect("a recipe");
            let found: Vec<f64> = (0..expect.len() as u32).map(|i| recipe.exposure_s(i)).collect();
            assert_eq!(found, expect, "{fade}");
        };
        check("numFade = 4", &[45.0, 36.75, 28.5, 20.25, 12.0, 12.0]);
        check("numFade = 1", &[45.0, 12.0]);
        check("numFade = 0", &[12.0, 12.0]);
        check("", &[12.0, 12.0]);
    }

    #[test]
    fn a_portrait_panel_is_turned_unless_its_pictures_are_not() {
        let check = |settings: &str, picture: [u32; 2], expect: Placement| {
            let mut entries = entries();
            let settings = format!(
                "{}{settings}",
                sl1_settings(3, 2).replace("display_width = 3", "display_width = 1.5")
            );
            entries[1].1 = settings.into_bytes();
            for entry in &mut entries[3..] {
                entry.1 = grey(picture[0], picture[1], &[0; 6]);
            }
            let job = open(&entries).expect("a job");
            assert_eq!(job.placement(), expect, "{settings_of:?}", settings_of = entries[1]);
            assert_eq!(job.panel().picture_px(), picture);
        };
        let upright = Placement { pixel_mm: [0.5, 1.0], reverse_u: false, reverse_v: true, swap: false };
        check("", [3, 2], upright);
        check("display_mirror_x = 1\n", [3, 2], Placement { reverse_u: true, ..upright });
        check("display_mirror_y = 1\n", [3, 2], Placement { reverse_v: false, ..upright });
        let portrait = "display_orientation = portrait\ndisplay_mirror_x = 1\n";
        let turned = Placement { pixel_mm: [1.0, 0.5], reverse_u: false, reverse_v: true, swap: true };
        check(portrait, [2, 3], turned);
        check(portrait, [3, 2], Placement { reverse_u: true, ..upright });
    }

    #[test]
    fn settings_of_the_slicers_kin_are_read() {
        let mut entries = entries();
        entries[1].0 = "qidislicer.ini".to_owned();
        let text = String::from_utf8(entries[1].1.clone()).expect("text");
        entries[1].1 = format!("\u{feff}# made by\r\n; a\r\n{}", text.replace('\n', "\r\n")).into_bytes();
        assert_eq!(open(&entries).expect("a job").layers().len(), 3);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let check = |change: &dyn Fn(&mut Entries), words: &[&str]| {
            let mut entries = entries();
            change(&mut entries);
            let said = open(&entries).expect_err("refused").to_string();
            assert!(words.iter().all(|w| said.contains(w)), "{said}");
        };
        let set = |file: usize, from: &'static str, to: &'static str| {
            move |e: &mut Entries| {
                let text = String::from_utf8(e[file].1.clone()).expect("text");
                assert!(text.contains(from));
                e[file].1 = text.replace(from, to).into_bytes();
            }
        };
        check(&|e| e.truncate(0), &["no resin job", "[]"]);
        check(&|e| drop(e.remove(0)), &["no resin job", "prusaslicer.ini"]);
        check(&|e| drop(e.remove(1)), &["no \"prusaslicer.ini\""]);
        check(&|e| e.truncate(3), &["no picture is named jobNNNNN.png"]);
        check(&|e| drop(e.remove(3)), &["announces 3 layers", "holds 2"]);
        check(&|e| drop(e.remove(4)), &["layer 0 is missing", "job00000.png"]);
        check(&|e| drop(e.remove(5)), &["layer 1 is missing", "job00001.png"]);
        check(&|e| e.push(("job000001.png".to_owned(), vec![])), &["layer 1 has two pictures"]);
        check(&|e| e[4].1 = grey(2, 2, &[0; 4]), &["layer 0", "job00000.png", "2 × 2 px", "3 × 2"]);
        check(&|e| e[4].1 = b"no picture".to_vec(), &["layer 0", "job00000.png", "cannot be read"]);
        let bomb = header(100_000, 100_000);
        check(&|e| e[4].1 = bomb.clone(), &["layer 0", "job00000.png", "100000 × 100000 px"]);
        check(&set(0, "jobDir = job", "jobDir ="), &["config.ini", "no jobDir"]);
        check(&set(0, "jobDir = job", "jobDir = ../job"), &["no picture is named ../jobNNNNN.png"]);
        check(&set(0, "layerHeight = 0.05", "layerHeight = 0"), &["layerHeight = 0", "0.001 to 1"]);
        check(&set(0, "layerHeight = 0.05", "layerHeight = nan"), &["layerHeight = nan"]);
        check(&set(0, "expTime = 5", "expTime = five"), &["config.ini", "expTime = five"]);
        check(&set(0, "numFade = 4", "numFade = 1e99"), &["numFade"]);
        check(&set(1, "display_pixels_x = 3", "display_pixels_x = 100000"), &["display_pixels_x = 100000"]);
        check(&set(1, "display_width = 3", "display_width = 1e-9"), &["display_width = 1e-9"]);
        check(&set(1, "display_height = 2", ""), &["prusaslicer.ini", "no display_height"]);
    }

    #[test]
    fn a_picture_that_is_unlike_the_first_is_found_when_it_is_read() {
        let mut entries = entries();
        entries[3].1 = grey(2, 3, &[0; 6]);
        let mut job = open(&entries).expect("a job");
        assert!(job.image(1).is_ok());
        let said = job.image(2).expect_err("refused").to_string();
        assert!(said.contains("layer 2 (\"job00002.png\"): the picture has 2 × 3 px"), "{said}");
    }

    #[test]
    fn names_are_never_paths() {
        let mut entries = entries();
        for odd in ["../job00003.png", "/etc/job00003.png", "job00003.png/", "C:\\job00003.png", "job3.png"] {
            entries.push((odd.to_owned(), vec![1]));
        }
        assert_eq!(open(&entries).expect("a job").layers().len(), 3);
    }

    #[test]
    fn a_job_made_for_other_tests_is_a_job() {
        let job = resin::open(Cursor::new(sl1(1, 1, &[vec![0], vec![255]]))).expect("a job");
        assert_eq!(job.layers().len(), 2);
    }
}
