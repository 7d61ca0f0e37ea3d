//! A NanoDLP plate of another format's job: its settings.
//!
//! Takes what is known of a job, gives an archive with `meta.json`, the same settings
//! as `options.json` (NanoDLP's name) and `slicer.json` (UVtools'), `plate.json`,
//! `profile.json` and `3d.png`; pictures follow, from `1.png` on. Keys are those that
//! our reader and UVtools read; what they leave open is left to NanoDLP, and so is
//! `info.json`. Chosen where it is not told: a lift of 5 mm. Speeds are in NanoDLP's
//! G-code, not here.
use super::{MARKS, OPTIONS, OVERRIDE, PLATE, PROFILE};
use crate::resin::archive::write::{ArchiveWriter, Packed};
use crate::resin::convert::{Facts, number};
use crate::resin::image::pack::thumbnail;
use crate::resin::recipe::Stage;
use crate::resin::rewrite::RewriteError;
use serde_json::{Value, json};
use std::io::{Seek, Write};

/// The picture for people, and its sides as NanoDLP has it, px.
pub(in crate::resin) const THUMBNAIL: &str = "3d.png";
const THUMBNAIL_PX: [u32; 2] = [607, 487];

const META: &str = "meta.json";

/// Lift where none is told, mm.
const LIFT_MM: f64 = 5.0;

/// The name of a layer's picture.
pub(in crate::resin) fn layer_name(layer: u32) -> String {
    format!("{}.png", layer + 1)
}

/// Whether a member is one of NanoDLP's files of settings.
pub(in crate::resin) fn is_settings(name: &str) -> bool {
    MARKS.contains(&name) || [PROFILE, OVERRIDE, META].contains(&name)
}

/// An archive with all but the layers' pictures.
pub(in crate::resin) fn begin<W: Write + Seek>(
    facts: &Facts<'_>,
    out: W,
    notes: &mut Vec<String>,
) -> Result<ArchiveWriter<W>, RewriteError> {
    let recipe = facts.recipe;
    if !facts.even() {
        notes.push(format!(
            "height: the first layer is {} mm high as all others are, not {} mm",
            facts.heights_mm[1], facts.heights_mm[0]
        ));
    }
    facts.compare_exposures(|layer| recipe.exposure_s(layer), notes);
    if recipe.usual.lift[0].mm.is_none() {
        notes.push(format!("lift: not told; {LIFT_MM} mm is written"));
    }
    let speeds = |stage: &Stage| {
        stage.lift.iter().chain(&stage.retract).any(|way| way.mm_min.is_some_and(|speed| speed > 0.0))
    };
    if speeds(&recipe.bottom) || speeds(&recipe.usual) {
        notes.push("speeds and second stages of lift and retract: NanoDLP has them in its G-code".to_owned());
    }
    let mut zip = ArchiveWriter::new(out);
    let mut put =
        |name: &str, value: &Value| zip.add(name, format!("{value:#}\n").as_bytes(), Packed::Deflated);
    put(META, &meta())?;
    let options = options(facts);
    put(OPTIONS[0], &options)?;
    put(OPTIONS[1], &options)?;
    put(PLATE, &plate(facts))?;
    put(PROFILE, &profile(facts))?;
    if let Some(Ok(png)) = facts.preview.map(|preview| thumbnail(&preview.fitted(THUMBNAIL_PX))) {
        zip.add(THUMBNAIL, &png, Packed::Deflated)?;
    }
    Ok(zip)
}

fn meta() -> Value {
    json!({
        "FormatVersion": 2,
        "Distro": "generic",
        "Program": "Outrigger",
        "Version": env!("CARGO_PKG_VERSION"),
        "Profile": true,
    })
}

fn options(facts: &Facts<'_>) -> Value {
    let (panel, [x_mm, y_mm]) = (facts.panel, facts.placement.pixel_mm);
    let height_um = number(facts.heights_mm[1] * 1000.0);
    json!({
        "Type": "stl",
        "PWidth": panel.width_px,
        "PHeight": panel.height_px,
        "XOffset": panel.width_px / 2,
        "YOffset": panel.height_px / 2,
        "XPixelSize": number(x_mm),
        "YPixelSize": number(y_mm),
        "XRes": number(x_mm * 1000.0),
        "YRes": number(y_mm * 1000.0),
        "Thickness": height_um,
        "SupportDepth": height_um,
        "SupportLayerNumber": facts.recipe.bottom_layers,
        "ImageMirror": u8::from(facts.placement.reverse_u),
        "DisplayController": 1,
        "LayerCount": facts.layers.len(),
        "DynamicThickness": [],
    })
}

fn plate(facts: &Facts<'_>) -> Value {
    let print_time_s = facts.recipe.print_time_s.unwrap_or_else(|| facts.exposures_s());
    json!({
        "PlateID": 0,
        "ProfileID": 0,
        "Path": "job",
        "LayersCount": facts.layers.len(),
        "PrintTime": print_time_s as u64,
        "PrintEst": print_time_s as u64,
        "DynamicThickness": [],
        "ZMin": 0,
        "ZMax": number(facts.top_mm()),
    })
}

fn profile(facts: &Facts<'_>) -> Value {
    let recipe = facts.recipe;
    let height_um = number(facts.heights_mm[1] * 1000.0);
    let lift_mm = |stage: &Stage| {
        let both = [stage.lift[0].mm?, stage.lift[1].mm.unwrap_or(0.0)];
        Some(number(both[0] + both[1]))
    };
    let usual_mm = lift_mm(&recipe.usual).unwrap_or(LIFT_MM);
    let wait = |seconds: Option<f64>| number(seconds.unwrap_or(0.0));
    let [after, top, before] = recipe.usual.waits_s.map(wait);
    let [first_after, first_top, first_before] = recipe.bottom.waits_s.map(wait);
    json!({
        "ResinID": 0,
        "ProfileID": 0,
        "Title": recipe.resin,
        "Depth": height_um,
        "SupportDepth": height_um,
        "CureTime": number(recipe.usual.exposure_s),
        "SupportCureTime": number(recipe.bottom.exposure_s),
        "SupportLayerNumber": recipe.bottom_layers,
        "TransitionalLayer": recipe.transition_layers,
        "WaitHeight": usual_mm,
        "SupportWaitHeight": lift_mm(&recipe.bottom).unwrap_or(usual_mm),
        "WaitAfterPrint": after,
        "TopWait": top,
        "WaitBeforePrint": before,
        "SupportWaitAfterPrint": first_after,
        "SupportTopWait": first_top,
        "SupportWaitBeforePrint": first_before,
        "CustomValues": { "UvPwmValue": format!("{:.3}", recipe.usual.light.unwrap_or(1.0)) },
    })
}
