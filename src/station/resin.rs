//! A resin job for a printer: looked at from its first picture to its last, and made into lines.
//!
//! Takes an open job and a profile; refuses what this printer could not print, with what to do;
//! gives the script and how long each layer takes. Pictures are unpacked on all cores, a batch at a
//! time, so that a damaged one is found before the plate moves.
use super::settings;
use crate::printer::exposure::script::{Layer, Script, Way};
use crate::profile::Profile;
use crate::profile::msla::{Mirror, Msla};
use crate::resin::image::Panel;
use crate::resin::job::{Format, Job, JobLayer, Placement};
use crate::resin::recipe::{Recipe, Stage};
use anyhow::{Context, bail, ensure};
use rayon::prelude::*;
use std::io::{Read, Seek};

/// Pictures that are unpacked at a time: enough for all cores, and some megabytes packed.
const BATCH: u32 = 16;

/// Packed bytes of a batch at most, beyond the first picture.
const BATCH_BYTES: usize = 32 << 20;

/// The shortest exposure that is believed, s: less cures nothing, and is a slip in a file.
const SHORTEST_S: f64 = 0.05;

/// The lowest lift that is believed to take a layer off the film, mm, where the printer's top leaves
/// no more.
const LOWEST_LIFT_MM: f64 = 1.0;

/// A resin job as a printer is told.
pub(crate) struct Told {
    /// Its lines.
    pub(crate) script: Script,
    /// Time from the beginning to each layer's, and to the end, s: moves at their speed, waits and light.
    pub(crate) begins_s: Vec<f32>,
}

/// What a job becomes on this printer; its pictures are not looked at.
///
/// # Errors
/// It was made for another panel, is higher than the printer, or exposes for a time that cannot be.
pub(crate) fn told<R: Read + Seek>(job: &Job<R>, profile: &Profile) -> anyhow::Result<Told> {
    let msla = profile.msla().context("it prints no resin")?;
    fits(job.panel(), job.placement(), job.format(), msla)?;
    let top_mm = profile.bed.z_mm.0;
    let recipe = job.recipe();
    let mut layers = Vec::with_capacity(job.layers().len());
    let mut below_mm = 0.0;
    for (at, of_job) in (0_u32..).zip(job.layers()) {
        let layer = layer(at, of_job, recipe, msla, top_mm)?;
        ensure!(
            layer.z_mm > below_mm,
            "layer {at} ends at {} mm, no higher than the one below it: export the job again",
            layer.z_mm
        );
        below_mm = layer.z_mm;
        layers.push(layer);
    }
    let begins_s = begins_s(&layers, msla.lcd.settle_ms);
    Ok(Told { script: Script::new(settings::script_rules(msla), layers), begins_s })
}

/// Unpacks every picture; `watch` is told how many are done.
///
/// # Errors
/// The first that cannot be read or is not of the panel's size.
pub(crate) fn look<R: Read + Seek>(job: &mut Job<R>, mut watch: impl FnMut(u32)) -> anyhow::Result<()> {
    let panel = job.panel();
    let count = job.layers().len() as u32;
    let mut next = 0;
    while next < count {
        let (first, mut packed, mut bytes) = (next, Vec::new(), 0);
        while next < count && packed.len() < BATCH as usize && (packed.is_empty() || bytes < BATCH_BYTES) {
            let picture = job.packed(next)?;
            bytes += picture.len();
            packed.push(picture);
            next += 1;
        }
        let wrong = packed
            .par_iter()
            .enumerate()
            .find_map_first(|(at, picture)| Some((at, panel.rows(picture, |_| {}).err()?)));
        if let Some((at, why)) = wrong {
            return Err(job.picture_error(first + at as u32, why).into());
        }
        watch(next);
    }
    Ok(())
}

/// Whether the pictures are for this printer's panel, and lie on it as they should.
fn fits(panel: Panel, placement: Placement, format: Format, msla: &Msla) -> anyhow::Result<()> {
    let lcd = &msla.lcd;
    let (job, ours) = ([panel.width_px, panel.height_px], [lcd.width_px, lcd.height_px]);
    let sizes = format!("{} × {} px, and this printer's panel has {} × {}", job[0], job[1], ours[0], ours[1]);
    if job != ours && [job[1], job[0]] == ours {
        bail!(
            "its pictures are turned by a quarter: they have {sizes}. Export it for the other orientation \
             (portrait or landscape) of the display"
        );
    }
    if job != ours {
        bail!("it was made for another panel: its pictures have {sizes}. Export it for this printer");
    }
    // As seen from above, of a panel that shows pictures as they are.
    let made_for = [placement.reverse_u, !placement.reverse_v];
    let needs = match lcd.mirror {
        Mirror::None => [false, false],
        Mirror::X => [true, false],
        Mirror::Y => [false, true],
        Mirror::Xy => [true, true],
    };
    if placement.swap || made_for != needs {
        let words = |mirror: [bool; 2]| match mirror {
            [false, false] => "shows pictures as they are",
            [true, false] => "shows them mirrored left to right",
            [false, true] => "shows them mirrored top to bottom",
            [true, true] => "shows them upside down",
        };
        bail!(
            "its pictures are made for a panel that {}{}, and this one {} (lcd.mirror of the profile): the \
             part would come out as its mirror image. Set the mirroring of the display in the slicer \
             accordingly and export the {format} anew, or correct lcd.mirror",
            words(made_for),
            if placement.swap { " and is turned by a quarter" } else { "" },
            words(needs),
        );
    }
    Ok(())
}

/// What one layer needs: as the file says, and as the profile says where it says nothing.
fn layer(at: u32, of_job: &JobLayer, recipe: &Recipe, msla: &Msla, top_mm: f64) -> anyhow::Result<Layer> {
    let exposure_s = of_job.exposure_s;
    let most_s = msla.light.most_s;
    ensure!(
        (SHORTEST_S..=most_s).contains(&exposure_s),
        "layer {at} is to be exposed for {exposure_s} s; {SHORTEST_S} to {most_s} s are believed \
         (light.most_s of the profile): correct the exposure in the slicer and export it again"
    );
    let z_mm = of_job.top_mm;
    ensure!(
        z_mm <= top_mm,
        "layer {at} lies {z_mm:.2} mm high, and this printer reaches {top_mm} mm: make the part lower, or \
         correct bed.z_mm of the profile"
    );
    let stage = if at < recipe.bottom_layers { &recipe.bottom } else { &recipe.usual };
    let plate = &msla.plate;
    let wait_ms = |said: Option<f64>, or: u32| match said {
        // A float cast saturates, and the check bounds it.
        Some(s) if (0.0..=600.0).contains(&s) => (s * 1e3).round() as u32,
        _ => or,
    };
    let lift = within(lift(stage, msla), top_mm - z_mm);
    let height_mm = lift[0].mm + lift[1].mm;
    ensure!(
        height_mm >= LOWEST_LIFT_MM.min(plate.lift.slow_mm.0),
        "above layer {at} there is no room for a lift: it lies {z_mm:.2} mm high, and this printer reaches \
         {top_mm} mm: make the part lower, or correct bed.z_mm of the profile"
    );
    Ok(Layer {
        z_mm,
        exposure_ms: (exposure_s * 1e3).round() as u32,
        power: stage.light.map_or(255, |power| (power.clamp(0.0, 1.0) * 255.0).round() as u8),
        retract: retract(stage, msla, height_mm),
        lift,
        settle_ms: wait_ms(stage.waits_s[2], plate.settle_ms),
        rest_ms: wait_ms(stage.waits_s[0], plate.rest_ms),
        top_ms: wait_ms(stage.waits_s[1], plate.top_ms),
    })
}

/// A speed that the plate can have; nothing where the file tells none.
fn speed(said: Option<f64>, msla: &Msla) -> Option<f64> {
    said.filter(|v| *v > 0.0).map(|v| v.min(msla.plate.max_mm_min.0))
}

fn lift(stage: &Stage, msla: &Msla) -> [Way; 2] {
    let ours = &msla.plate.lift;
    let usual = [(ours.slow_mm.0, ours.slow_mm_min.0), (ours.fast_mm.0, ours.fast_mm_min.0)];
    let told = stage.lift[0].mm.is_some_and(|mm| mm > 0.0);
    [0, 1].map(|at| {
        let (mm, mm_min) = usual[at];
        let said = stage.lift[at];
        let mm = if told { said.mm.unwrap_or(0.0).max(0.0) } else { mm };
        Way { mm, mm_min: speed(said.mm_min, msla).unwrap_or(mm_min) }
    })
}

/// Cut off where the printer ends.
fn within([slow, fast]: [Way; 2], room_mm: f64) -> [Way; 2] {
    let slow_mm = slow.mm.min(room_mm.max(0.0));
    let fast_mm = fast.mm.min((room_mm - slow_mm).max(0.0));
    [Way { mm: slow_mm, ..slow }, Way { mm: fast_mm, ..fast }]
}

/// Fast, and the last of it slowly.
fn retract(stage: &Stage, msla: &Msla, height_mm: f64) -> [Way; 2] {
    let ours = &msla.plate.retract;
    let [first, second] = stage.retract;
    let two = second.mm.is_some_and(|mm| mm > 0.0);
    let slow_mm = match (first.mm, two) {
        (_, true) => second.mm.unwrap_or(0.0),
        (Some(mm), false) if mm > 0.0 => 0.0,
        _ => ours.slow_mm.0,
    };
    let slow_mm = slow_mm.min(height_mm);
    let fast_mm_min = speed(first.mm_min, msla).unwrap_or(ours.fast_mm_min.0);
    let slow_mm_min = match two {
        true => speed(second.mm_min, msla).unwrap_or(ours.slow_mm_min.0),
        // One speed for all of it, where the file tells one.
        false => speed(first.mm_min, msla).unwrap_or(ours.slow_mm_min.0),
    };
    [Way { mm: height_mm - slow_mm, mm_min: fast_mm_min }, Way { mm: slow_mm, mm_min: slow_mm_min }]
}

/// Time from the beginning to each layer's, and to the end, s.
fn begins_s(layers: &[Layer], lead_ms: u32) -> Vec<f32> {
    let mut at_s = 0.0;
    let mut begins = Vec::with_capacity(layers.len() + 1);
    let way_s = |way: &Way| if way.mm_min > 0.0 { way.mm / way.mm_min * 60.0 } else { 0.0 };
    for layer in layers {
        begins.push(at_s as f32);
        let waits_ms = layer.exposure_ms + lead_ms + layer.settle_ms + layer.rest_ms + layer.top_ms;
        let ways_s: f64 = layer.lift.iter().chain(&layer.retract).map(way_s).sum();
        at_s += ways_s + f64::from(waits_ms) / 1e3;
    }
    begins.push(at_s as f32);
    begins
}
