//! An SL1 job of another format's: its settings.
//!
//! Takes what is known of a job, gives an archive with `config.ini`, `prusaslicer.ini`
//! and the thumbnails; pictures follow. Keys are those that PrusaSlicer writes and our
//! reader, PrusaSlicer and UVtools read. Not told and so chosen: the print time (the
//! exposures alone).
use crate::resin::archive::write::{ArchiveWriter, Packed};
use crate::resin::convert::{Facts, number};
use crate::resin::image::pack::thumbnail;
use crate::resin::recipe::{Recipe, Stage};
use crate::resin::rewrite::RewriteError;
use std::io::{Seek, Write};

/// The files of settings.
pub(in crate::resin) const SETTINGS: [&str; 2] = [super::CONFIG, "prusaslicer.ini"];

/// What the pictures are named after.
const JOB: &str = "job";

/// Sides of the thumbnails that PrusaSlicer writes, px.
const THUMBNAILS: [[u32; 2]; 2] = [[400, 400], [800, 480]];

/// The name of a layer's picture.
pub(in crate::resin) fn layer_name(layer: u32) -> String {
    format!("{JOB}{layer:05}.png")
}

/// An archive with all but the layers' pictures.
pub(in crate::resin) fn begin<W: Write + Seek>(
    facts: &Facts<'_>,
    out: W,
    notes: &mut Vec<String>,
) -> Result<ArchiveWriter<W>, RewriteError> {
    let fade = facts.recipe.bottom_layers.saturating_add(facts.recipe.transition_layers);
    let fade = fade.min(super::MAX_FADE as u32);
    let mut zip = ArchiveWriter::new(out);
    zip.add(SETTINGS[0], config(facts, fade).as_bytes(), Packed::Deflated)?;
    zip.add(SETTINGS[1], slicer(facts, fade).as_bytes(), Packed::Deflated)?;
    if let Some(preview) = facts.preview {
        for [width, height] in THUMBNAILS {
            if let Ok(png) = thumbnail(&preview.fitted([width, height])) {
                zip.add(&format!("thumbnail/thumbnail{width}x{height}.png"), &png, Packed::Deflated)?;
            }
        }
    }
    let read = Recipe {
        bottom_layers: fade.min(1),
        transition_layers: fade.saturating_sub(1),
        ..facts.recipe.clone()
    };
    facts.compare_exposures(|layer| read.exposure_s(layer), notes);
    let moved = |stage: &Stage| {
        let told = stage.lift.iter().chain(&stage.retract).any(|way| way.mm.is_some());
        told || stage.waits_s.iter().any(Option::is_some) || stage.light.is_some()
    };
    if moved(&facts.recipe.bottom) || moved(&facts.recipe.usual) {
        notes.push("lift, waits and light power: an SL1 printer has its own".to_owned());
    }
    Ok(zip)
}

fn lines(pairs: &[(&str, String)]) -> String {
    // A value is one line, whatever the job that is read had in it.
    let line = |(key, value): &(&str, String)| format!("{key} = {}\n", value.replace(char::is_control, " "));
    pairs.iter().map(line).collect()
}

fn config(facts: &Facts<'_>, fade: u32) -> String {
    let recipe = facts.recipe;
    let text = |value: f64| number(value).to_string();
    let print_time_s = recipe.print_time_s.unwrap_or_else(|| facts.exposures_s());
    let mut pairs = vec![
        ("action", "print".to_owned()),
        ("expTime", text(recipe.usual.exposure_s)),
        ("expTimeFirst", text(recipe.bottom.exposure_s)),
        ("expUserProfile", "0".to_owned()),
        ("hollow", "0".to_owned()),
        ("jobDir", JOB.to_owned()),
        ("layerHeight", text(facts.heights_mm[1])),
        ("materialName", recipe.resin.clone()),
        ("numFade", fade.to_string()),
        ("numFast", facts.layers.len().to_string()),
        ("numSlow", "0".to_owned()),
        ("printProfile", String::new()),
        ("printTime", text(print_time_s)),
        ("printerModel", recipe.printer.clone()),
        ("printerProfile", String::new()),
        ("printerVariant", String::new()),
        ("prusaSlicerVersion", concat!("Outrigger-", env!("CARGO_PKG_VERSION")).to_owned()),
        ("usedMaterial", text(recipe.resin_mm3.unwrap_or(0.0) / 1000.0)),
    ];
    if let Some((day, time)) = recipe.created.as_deref().and_then(|created| created.split_once(' ')) {
        pairs.insert(4, ("fileCreationTimestamp", format!("{day} at {time} UTC")));
    }
    lines(&pairs)
}

fn slicer(facts: &Facts<'_>, fade: u32) -> String {
    let text = |value: f64| number(value).to_string();
    let flag = |set: bool| u8::from(set).to_string();
    let placement = facts.placement;
    let [mut px, mut pixel_mm] =
        [[facts.panel.width_px, facts.panel.height_px].map(f64::from), placement.pixel_mm];
    if placement.swap {
        px.reverse();
        pixel_mm.reverse();
    }
    let orientation = if placement.swap { "portrait" } else { "landscape" };
    let mut pairs = vec![
        ("display_height", text(px[1] * pixel_mm[1])),
        ("display_mirror_x", flag(placement.reverse_u != placement.swap)),
        ("display_mirror_y", flag(!placement.reverse_v)),
        ("display_orientation", orientation.to_owned()),
        ("display_pixels_x", text(px[0])),
        ("display_pixels_y", text(px[1])),
        ("display_width", text(px[0] * pixel_mm[0])),
        ("exposure_time", text(facts.recipe.usual.exposure_s)),
        ("faded_layers", fade.to_string()),
        ("initial_exposure_time", text(facts.recipe.bottom.exposure_s)),
        ("initial_layer_height", text(facts.heights_mm[0])),
        ("layer_height", text(facts.heights_mm[1])),
        ("printer_technology", "SLA".to_owned()),
    ];
    if let Some(mm) = facts.recipe.machine_z_mm {
        pairs.insert(12, ("max_print_height", text(mm)));
    }
    lines(&pairs)
}
