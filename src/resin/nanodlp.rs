//! NanoDLP's plates: a zip of `plate.json`, `profile.json`, `options.json` (or
//! `slicer.json`), and `1.png`, `2.png` …, one a layer.
//!
//! Takes an archive, gives a [`Job`]. File names are those of NanoDLP's own
//! documentation ("NanoDLP / ZIP File Format", which lets layers begin with 0 or 1);
//! the keys of the JSON files, which it leaves open, are those that UVtools, mslicer
//! and VoxelShift read and write. Not checked against a file of NanoDLP itself: how
//! the picture lies over the plate (taken as upright, mirrored left to right where
//! `ImageMirror` is not 0), and the exposure of transitional layers. Knows no
//! picture's content.
pub(super) mod write;

use super::archive::{Archive, MAX_ENTRY_BYTES};
use super::image::{ImageError, MAX_SIDE_PX, Packing, Panel, size_px};
use super::job::{
    EXPOSURE_S, Format, Job, JobError, JobLayer, LAYER_MM, PIXEL_MM, Placement, Source, in_order,
};
use super::recipe::{Recipe, Stage, Way};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use std::io::{Read, Seek};
use std::ops::RangeInclusive;

/// The slicer's settings: NanoDLP's name, and the one that UVtools knows.
const OPTIONS: [&str; 2] = ["options.json", "slicer.json"];
const PLATE: &str = "plate.json";
const PROFILE: &str = "profile.json";
const OVERRIDE: &str = "override.json";

/// Any of these makes an archive a NanoDLP job.
pub(super) const MARKS: [&str; 3] = [PLATE, OPTIONS[0], OPTIONS[1]];

/// Most bytes of a file of settings. Real ones have some kilobytes.
const MAX_SETTINGS_BYTES: u64 = 4 << 20;

/// The picture and the panel, in `options.json`.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "PascalCase")]
struct Options {
    p_width: Option<f64>,
    p_height: Option<f64>,
    /// Side of a pixel, mm.
    x_pixel_size: Option<f64>,
    y_pixel_size: Option<f64>,
    /// The same, µm, of older versions.
    x_res: Option<f64>,
    y_res: Option<f64>,
    /// Height of a layer, µm.
    thickness: Option<f64>,
    image_mirror: Option<f64>,
    dynamic_thickness: Option<Vec<f64>>,
}

/// The resin, in `profile.json` and, for this plate only, in `override.json`.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "PascalCase")]
struct Profile {
    /// Height of a layer, µm.
    depth: Option<f64>,
    cure_time: Option<f64>,
    support_cure_time: Option<f64>,
    support_layer_number: Option<f64>,
    transitional_layer: Option<f64>,
    /// The name of the resin's profile.
    title: Option<String>,
    /// How far the plate is lifted, mm.
    wait_height: Option<f64>,
    support_wait_height: Option<f64>,
    /// Waits between exposure and lift, at the top, and before the exposure, s.
    wait_after_print: Option<f64>,
    support_wait_after_print: Option<f64>,
    top_wait: Option<f64>,
    support_top_wait: Option<f64>,
    wait_before_print: Option<f64>,
    support_wait_before_print: Option<f64>,
    /// Among other things the power of the light, 0 to 1, as text.
    custom_values: serde_json::Map<String, serde_json::Value>,
}

/// The job, in `plate.json`.
#[derive(Default, Deserialize)]
#[serde(default, rename_all = "PascalCase")]
struct Plate {
    layers_count: Option<f64>,
    /// How long the print takes, s.
    print_time: Option<f64>,
    /// Heights of the layers where they differ.
    dynamic_thickness: Option<Vec<f64>>,
}

/// A number and where it stands.
struct Found {
    entry: &'static str,
    key: &'static str,
    value: f64,
}

/// Reads the settings and finds the pictures.
///
/// # Errors
/// A file of settings is missing or no JSON, a setting cannot be right, or layers are
/// missing, double, not as many as announced, or of different heights.
pub(super) fn open<R: Read + Seek>(mut archive: Archive<R>) -> Result<Job<R>, JobError> {
    let options_name = OPTIONS.into_iter().find(|n| archive.find(n).is_some()).unwrap_or(OPTIONS[0]);
    let options: Options = settings(&mut archive, options_name)?.unwrap_or_default();
    let plate: Plate = settings(&mut archive, PLATE)?.unwrap_or_default();
    let profile: Profile = settings(&mut archive, PROFILE)?.unwrap_or_default();
    let special: Profile = settings(&mut archive, OVERRIDE)?.unwrap_or_default();
    same_heights(options_name, options.dynamic_thickness.as_deref())?;
    same_heights(PLATE, plate.dynamic_thickness.as_deref())?;

    let entries = in_order(&archive, 0..=1, "1.png, 2.png …", layer_number, |n| format!("{n}.png"))?;
    let announced = plate.layers_count.unwrap_or(0.0).clamp(0.0, 1e9) as u64;
    if announced > 0 && announced != entries.len() as u64 {
        let found = entries.len();
        return Err(JobError::LayerCount { entry: PLATE.to_owned(), announced, found });
    }
    let panel = panel(&mut archive, &options, options_name, entries[0])?;
    let pixel_mm = [
        pixel_mm(options_name, ["XPixelSize", "XRes"], options.x_pixel_size, options.x_res)?,
        pixel_mm(options_name, ["YPixelSize", "YRes"], options.y_pixel_size, options.y_res)?,
    ];
    let reverse_u = options.image_mirror.is_some_and(|m| m != 0.0);
    let placement = Placement { pixel_mm, reverse_u, reverse_v: true, swap: false };
    let thickness = Found { entry: options_name, key: "Thickness", value: options.thickness.unwrap_or(0.0) };
    let recipe = Recipe {
        print_time_s: plate.print_time.filter(|s| (1.0..=1e8).contains(s)),
        ..recipe(&profile, &special)?
    };
    let layers = layers(height_mm(thickness, &profile, &special)?, &recipe, &entries);
    Ok(Job { source: Source::Archive(archive), format: Format::NanoDlp, panel, placement, layers, recipe })
}

/// The number in `12.png`; leading zeros are allowed, other names are no layers.
fn layer_number(name: &str) -> Option<u32> {
    let digits = name.strip_suffix(".png")?;
    let plain = (1..=9).contains(&digits.len()) && digits.bytes().all(|b| b.is_ascii_digit());
    plain.then(|| digits.parse().ok()).flatten()
}

fn settings<R: Read + Seek, T: DeserializeOwned>(
    archive: &mut Archive<R>,
    entry: &str,
) -> Result<Option<T>, JobError> {
    let Some(index) = archive.find(entry) else { return Ok(None) };
    let bytes = archive.read(index, MAX_SETTINGS_BYTES)?;
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
    serde_json::from_slice(text)
        .map(Some)
        .map_err(|e| JobError::Settings { entry: entry.to_owned(), why: e.to_string() })
}

/// What the list of heights counts in is documented nowhere: better no answer than a wrong one.
fn same_heights(entry: &str, heights: Option<&[f64]>) -> Result<(), JobError> {
    let differ = heights.and_then(|h| h.windows(2).find(|w| w[0] != w[1]));
    match differ {
        Some(w) => Err(JobError::BadSetting {
            entry: entry.to_owned(),
            key: "DynamicThickness",
            found: format!("{} beside {}", w[0], w[1]),
            wanted: "one height for all layers".to_owned(),
        }),
        None => Ok(()),
    }
}

fn checked(found: &Found, range: RangeInclusive<f64>, unit: &str) -> Result<f64, JobError> {
    if range.contains(&found.value) {
        return Ok(found.value);
    }
    let wanted = format!("a number from {} to {}{unit}", range.start(), range.end());
    let (entry, found_text) = (found.entry.to_owned(), found.value.to_string());
    Err(JobError::BadSetting { entry, key: found.key, found: found_text, wanted })
}

/// Side of a pixel, mm: the first key in mm, else the second in µm.
fn pixel_mm(
    entry: &'static str,
    [key, key_um]: [&'static str; 2],
    mm: Option<f64>,
    um: Option<f64>,
) -> Result<f64, JobError> {
    let um_as_mm = PIXEL_MM.start() * 1000.0..=PIXEL_MM.end() * 1000.0;
    match (mm, um) {
        (Some(value), _) if value != 0.0 => checked(&Found { entry, key, value }, PIXEL_MM, " mm"),
        (_, Some(value)) if value != 0.0 => {
            checked(&Found { entry, key: key_um, value }, um_as_mm, " µm").map(|um| um / 1000.0)
        }
        _ => {
            let needed = "the size of a pixel is unknown without it";
            Err(JobError::NoSetting { entry: entry.to_owned(), key, needed })
        }
    }
}

/// The panel: as large as `options.json` says, else as the first picture. A picture a
/// third as wide as the panel holds three of its pixels in each of its own.
fn panel<R: Read + Seek>(
    archive: &mut Archive<R>,
    options: &Options,
    entry: &'static str,
    first: usize,
) -> Result<Panel, JobError> {
    let png = archive.read(first, MAX_ENTRY_BYTES)?;
    let picture =
        |source: ImageError| JobError::Picture { layer: 0, entry: archive.name(first).to_owned(), source };
    let [width, height] = size_px(&png).map_err(picture)?;
    let said = |key, value: Option<f64>, otherwise: u32| match value {
        Some(value) if value != 0.0 => {
            checked(&Found { entry, key, value }, 1.0..=f64::from(MAX_SIDE_PX), " px").map(|v| v as u32)
        }
        _ => Ok(otherwise),
    };
    let width_px = said("PWidth", options.p_width, width)?;
    let height_px = said("PHeight", options.p_height, height)?;
    let third = width_px > 2 && width_px.div_ceil(3) == width;
    let packing = if third { Packing::Subpixels } else { Packing::Grey };
    let panel = Panel { width_px, height_px, packing };
    panel.fits([width, height]).map_err(picture)?;
    Ok(panel)
}

/// The height of a layer, mm.
fn height_mm(thickness: Found, profile: &Profile, special: &Profile) -> Result<f64, JobError> {
    let um = LAYER_MM.start() * 1000.0..=LAYER_MM.end() * 1000.0;
    let depth = special.depth.or(profile.depth).filter(|&d| d != 0.0);
    let height_um = match (thickness.value != 0.0, depth) {
        (false, Some(value)) => checked(&Found { entry: PROFILE, key: "Depth", value }, um, " µm")?,
        (false, None) => {
            let needed = "the height of a layer is unknown without it";
            return Err(JobError::NoSetting { entry: PROFILE.to_owned(), key: "Depth", needed });
        }
        (true, _) => checked(&thickness, um, " µm")?,
    };
    Ok(height_um / 1000.0)
}

/// What the profile tells of the print, and what was set for this plate only. The
/// transitional layers lie evenly between the first layers' exposure and the others'.
fn recipe(profile: &Profile, special: &Profile) -> Result<Recipe, JobError> {
    let setting = |key, value: fn(&Profile) -> Option<f64>, range: RangeInclusive<f64>| {
        let entry = if value(special).is_some() { OVERRIDE } else { PROFILE };
        let told = value(special).or(value(profile));
        told.map(|value| checked(&Found { entry, key, value }, range, "")).transpose()
    };
    let counted = || 0.0..=1e6;
    let others_s = setting("CureTime", |p| p.cure_time, EXPOSURE_S)?.unwrap_or(0.0);
    let first_s = setting("SupportCureTime", |p| p.support_cure_time, EXPOSURE_S)?.unwrap_or(others_s);
    let firsts = setting("SupportLayerNumber", |p| p.support_layer_number, counted())?.unwrap_or(0.0);
    let fade = setting("TransitionalLayer", |p| p.transitional_layer, counted())?.unwrap_or(0.0);
    // For what only other formats take: no job is refused for one of these.
    let told = |value: fn(&Profile) -> Option<f64>, range: RangeInclusive<f64>| {
        value(special).or(value(profile)).filter(|v| range.contains(v))
    };
    let power = |p: &Profile| p.custom_values.get("UvPwmValue").and_then(|v| v.as_str()?.parse().ok());
    let light = power(special).or(power(profile)).filter(|v| (0.0..=1.0).contains(v));
    let stage = |exposure_s, lift: fn(&Profile) -> Option<f64>, waits: [fn(&Profile) -> Option<f64>; 3]| {
        let lift = Way { mm: told(lift, 0.0..=1000.0).filter(|&mm| mm > 0.0), mm_min: None };
        let waits_s = waits.map(|wait| told(wait, EXPOSURE_S));
        Stage { exposure_s, lift: [lift, Way::default()], retract: [Way::default(); 2], waits_s, light }
    };
    let waits: [fn(&Profile) -> Option<f64>; 3] =
        [|p| p.wait_after_print, |p| p.top_wait, |p| p.wait_before_print];
    let first_waits: [fn(&Profile) -> Option<f64>; 3] =
        [|p| p.support_wait_after_print, |p| p.support_top_wait, |p| p.support_wait_before_print];
    Ok(Recipe {
        bottom: stage(first_s, |p| p.support_wait_height, first_waits),
        usual: stage(others_s, |p| p.wait_height, waits),
        bottom_layers: firsts.round() as u32,
        transition_layers: fade.round() as u32,
        resin: special.title.clone().or(profile.title.clone()).unwrap_or_default(),
        ..Recipe::default()
    })
}

fn layers(height_mm: f64, recipe: &Recipe, entries: &[usize]) -> Vec<JobLayer> {
    let layer = |(i, &entry): (usize, &usize)| JobLayer {
        entry,
        top_mm: height_mm * (i + 1) as f64,
        height_mm,
        exposure_s: recipe.exposure_s(i as u32),
    };
    entries.iter().enumerate().map(layer).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin;
    use crate::resin::testing::{BitDepth, ColorType, archive, grey, picture};
    use std::io::Cursor;

    type Entries = Vec<(&'static str, Vec<u8>)>;

    const OPTIONS_JSON: &str = r#"{"Type": "stl", "PWidth": 3, "PHeight": 2, "XPixelSize": 0.019, "YPixelSize": 0.024,
        "Thickness": 50, "ImageMirror": 1, "DynamicThickness": null, "MC": {"X": null}, "LayerCount": 0}"#;
    const PROFILE_JSON: &str = r#"{"Depth": 30, "CureTime": 2, "SupportCureTime": 20.0, "SupportLayerNumber": 2,
        "TransitionalLayer": 2, "CustomValues": {"UvPwmValue": "1.0"}}"#;

    /// A job of six layers of 3 × 2 px.
    fn entries() -> Entries {
        let mut entries: Entries = vec![
            ("meta.json", b"{\"FormatVersion\": 2}".to_vec()),
            ("options.json", OPTIONS_JSON.into()),
            ("plate.json", b"{\"LayersCount\": 6, \"DynamicThickness\": []}".to_vec()),
            ("profile.json", PROFILE_JSON.into()),
            ("3d.png", grey(1, 1, &[9])),
        ];
        for (i, name) in ["1.png", "2.png", "3.png", "4.png", "5.png", "6.png"].into_iter().enumerate() {
            entries.push((name, grey(3, 2, &[i as u8; 6])));
        }
        entries
    }

    type Made = Job<Cursor<Vec<u8>>>;

    fn open(entries: &Entries) -> Result<Made, JobError> {
        resin::open(Cursor::new(archive(entries)))
    }

    fn replaced(entries: &mut Entries, name: &str, from: &str, to: &str) {
        let entry = entries.iter_mut().find(|e| e.0 == name).expect("such an entry");
        let text = String::from_utf8(entry.1.clone()).expect("text");
        assert!(text.contains(from));
        entry.1 = text.replace(from, to).into_bytes();
    }

    #[test]
    fn a_plate_is_read() {
        let mut job = open(&entries()).expect("a job");
        assert_eq!(job.format(), Format::NanoDlp);
        assert_eq!(job.panel(), Panel { width_px: 3, height_px: 2, packing: Packing::Grey });
        let expect = Placement { pixel_mm: [0.019, 0.024], reverse_u: true, reverse_v: true, swap: false };
        assert_eq!(job.placement(), expect);
        let exposures: Vec<f64> = job.layers().iter().map(|l| l.exposure_s).collect();
        for (found, expect) in exposures.iter().zip([20.0, 20.0, 14.0, 8.0, 2.0, 2.0]) {
            assert!((found - expect).abs() < 1e-9, "{exposures:?}");
        }
        let tops: Vec<f64> = job.layers().iter().map(|l| (l.top_mm * 1e6).round()).collect();
        assert_eq!(tops, [5e4, 1e5, 1.5e5, 2e5, 2.5e5, 3e5]);
        assert_eq!(job.image(5).expect("a picture").pixels, [5; 6]);
    }

    #[test]
    fn names_and_keys_of_other_versions_are_read() {
        let check = |change: &dyn Fn(&mut Entries), expect: &dyn Fn(&Made)| {
            let mut entries = entries();
            change(&mut entries);
            expect(&open(&entries).expect("a job"));
        };
        check(&|e| e[1].0 = "slicer.json", &|j| assert_eq!(j.layers().len(), 6));
        check(&|e| drop(e.remove(2)), &|j| assert_eq!(j.layers().len(), 6));
        check(&|e| e[10].0 = "0.png", &|j| assert_eq!(j.entry_name(0), "0.png"));
        check(&|e| replaced(e, "options.json", "\"XPixelSize\": 0.019", "\"XRes\": 18"), &|j| {
            assert!((j.placement().pixel_mm[0] - 0.018).abs() < 1e-12);
        });
        check(&|e| replaced(e, "options.json", "\"Thickness\": 50", "\"Thickness\": 0"), &|j| {
            assert!((j.layers()[0].height_mm - 0.03).abs() < 1e-12);
        });
        check(&|e| e.push(("override.json", b"{\"CureTime\": 3}".to_vec())), &|j| {
            assert_eq!(j.layers()[5].exposure_s, 3.0);
        });
        check(&|e| replaced(e, "options.json", "\"PWidth\": 3, \"PHeight\": 2, ", ""), &|j| {
            assert_eq!(j.panel().picture_px(), [3, 2]);
        });
    }

    #[test]
    fn pictures_a_third_as_wide_hold_subpixels() {
        let mut entries = entries();
        for entry in &mut entries[5..] {
            entry.1 = picture(1, 2, ColorType::Rgb, BitDepth::Eight, &[0, 255, 128, 7, 8, 9]);
        }
        let mut job = open(&entries).expect("a job");
        assert_eq!(job.panel(), Panel { width_px: 3, height_px: 2, packing: Packing::Subpixels });
        assert_eq!(job.image(0).expect("a picture").pixels, [0, 255, 128, 7, 8, 9]);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let check = |change: &dyn Fn(&mut Entries), words: &[&str]| {
            let mut entries = entries();
            change(&mut entries);
            let said = match open(&entries) {
                Ok(mut job) => job.image(0).expect_err("refused").to_string(),
                Err(e) => e.to_string(),
            };
            assert!(words.iter().all(|w| said.contains(w)), "{said}");
        };
        let set = |name: &'static str, from: &'static str, to: &'static str| {
            move |e: &mut Entries| replaced(e, name, from, to)
        };
        check(&|e| e.truncate(5), &["no picture is named 1.png"]);
        check(&|e| drop(e.remove(7)), &["layer 3 is missing", "\"3.png\""]);
        check(&|e| drop(e.remove(5)), &["layer 1 is missing", "\"1.png\""]);
        check(&|e| drop(e.pop()), &["\"plate.json\" announces 6 layers", "holds 5"]);
        check(&|e| e.push(("01.png", vec![])), &["layer 1 has two pictures", "01.png"]);
        check(&|e| drop(e.remove(1)), &["\"options.json\" has no XPixelSize"]);
        check(&set("options.json", "0.019", "19"), &["XPixelSize = 19", "0.001 to 1 mm"]);
        check(&set("options.json", "50", "-50"), &["Thickness = -50"]);
        check(
            &set("options.json", "\"PWidth\": 3", "\"PWidth\": 4"),
            &["layer 0", "1.png", "3 × 2", "4 × 2"],
        );
        check(&set("options.json", "\"PWidth\": 3", "\"PWidth\": 1e9"), &["PWidth = 1000000000"]);
        check(
            &set("profile.json", "\"CureTime\": 2", "\"CureTime\": -2"),
            &["profile.json", "CureTime = -2"],
        );
        check(&set("profile.json", "{", "{{"), &["\"profile.json\" cannot be understood", "line 1"]);
        check(&set("plate.json", "[]", "[50, 100]"), &["plate.json", "DynamicThickness", "50 beside 100"]);
        check(
            &|e| {
                e[5].1 = picture(
                    3,
                    2,
                    ColorType::Rgb,
                    BitDepth::Eight,
                    &[0, 0, 9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
                )
            },
            &["layer 0", "coloured"],
        );
    }
}
