//! A GOO file of another format's job.
//!
//! Takes what is known of a job and its pictures as runs, gives the bytes of a file.
//! Chosen where it is not told: lift 5 mm at 60 mm/min, back at 150 mm/min, no second
//! stage, no waits but 0.5 s before the exposure, light at full power, a printer as high
//! as the job or 200 mm, the print time (exposures, waits and ways), and no price.
use super::KeepError;
use super::head::{self, DELIMITER, Definition, END, HEAD_BYTES, Names, PREVIEWS, Settings, Way as RawWay};
use crate::resin::convert::Facts;
use crate::resin::preview::to_565;
use crate::resin::recipe::{Recipe, Stage, Way};
use std::io::Write;

/// Lift and the way back where they are not told.
const LIFT: RawWay = RawWay { mm: 5.0, mm_min: 60.0 };
const RETRACT_MM_MIN: f32 = 150.0;
/// Waits where they are not told: for the resin to come to rest before the exposure, s.
const WAITS_S: [f32; 3] = [0.0, 0.0, 0.5];
/// Height of a printer that is not told, mm.
const MACHINE_Z_MM: f32 = 200.0;
/// What a file says of its age where nobody knows it: no clock is asked.
const CREATED: &str = "2000-01-01 00:00:00";
/// Full power of the light.
const FULL: f64 = 255.0;

/// A file under construction.
#[derive(Debug)]
pub(in crate::resin) struct Builder<W> {
    out: W,
    definitions: std::vec::IntoIter<Definition>,
}

impl<W: Write> Builder<W> {
    /// Writes the head.
    ///
    /// # Errors
    /// The writer refuses.
    pub(in crate::resin) fn begin(
        facts: &Facts<'_>,
        mut out: W,
        notes: &mut Vec<String>,
    ) -> Result<Builder<W>, KeepError> {
        not_told(facts, notes);
        let settings = settings(facts);
        let previews = PREVIEWS.map(|(side, _)| {
            let fitted = facts.preview.map(|preview| preview.fitted([side, side]));
            fitted.map_or_else(Vec::new, |preview| preview.pixels.into_iter().map(to_565).collect())
        });
        let head = head::write(names(facts.recipe), settings, &previews);
        out.write_all(&head).map_err(KeepError::Write)?;
        let definitions: Vec<Definition> =
            (0..facts.layers.len()).map(|layer| definition(facts, &settings, layer)).collect();
        Ok(Builder { out, definitions: definitions.into_iter() })
    }

    /// Writes the next layer, its picture as runs.
    ///
    /// # Errors
    /// The writer refuses.
    pub(in crate::resin) fn layer(&mut self, picture: &[u8]) -> Result<(), KeepError> {
        let Some(definition) = self.definitions.next() else { return Ok(()) };
        let definition = Definition { bytes: picture.len() as u32, ..definition }.write();
        let mut put = |bytes: &[u8]| self.out.write_all(bytes).map_err(KeepError::Write);
        put(&definition)?;
        put(picture)?;
        put(&DELIMITER)
    }

    /// Writes what stands behind the last layer.
    ///
    /// # Errors
    /// The writer refuses.
    pub(in crate::resin) fn finish(mut self) -> Result<(), KeepError> {
        self.out.write_all(&END).and_then(|()| self.out.flush()).map_err(KeepError::Write)
    }
}

/// Says what is chosen here and matters to a print.
fn not_told(facts: &Facts<'_>, notes: &mut Vec<String>) {
    let recipe = facts.recipe;
    let lift = recipe.usual.lift[0];
    if lift.mm.is_none() || lift.mm_min.is_none() {
        let mm = lift.mm.map_or(LIFT.mm, |mm| mm as f32);
        notes.push(format!(
            "lift: not told; {mm} mm at {} mm/min and back at {RETRACT_MM_MIN} mm/min is written",
            LIFT.mm_min
        ));
    }
    if recipe.machine_z_mm.is_none() {
        notes.push(format!("height of the printer: not told; {} mm is written", machine_z_mm(facts)));
    }
    if facts.preview.is_none() {
        notes.push("thumbnail: there is none; the previews are black".to_owned());
    }
}

fn machine_z_mm(facts: &Facts<'_>) -> f32 {
    let least_mm = facts.top_mm().ceil() as f32;
    facts.recipe.machine_z_mm.map_or(MACHINE_Z_MM, |mm| mm as f32).max(least_mm)
}

fn names(recipe: &Recipe) -> Names {
    Names {
        program: ["Outrigger".to_owned(), env!("CARGO_PKG_VERSION").to_owned()],
        created: recipe.created.clone().unwrap_or_else(|| CREATED.to_owned()),
        printer: [recipe.printer.clone(), recipe.printer.clone()],
        profile: recipe.resin.clone(),
        levels: [1, 0, 0],
    }
}

/// The first way and the second; what is not told of the first is `otherwise`.
fn ways([first, second]: [Way; 2], otherwise: RawWay) -> [RawWay; 2] {
    let or = |told: Option<f64>, other: f32| told.map_or(other, |v| v as f32);
    [
        RawWay { mm: or(first.mm, otherwise.mm), mm_min: or(first.mm_min, otherwise.mm_min) },
        RawWay { mm: or(second.mm, 0.0), mm_min: or(second.mm_min, 0.0) },
    ]
}

fn lift(stage: &Stage) -> [RawWay; 2] {
    ways(stage.lift, LIFT)
}

/// As far as the lift goes, where nothing else is told.
fn retract(stage: &Stage) -> [RawWay; 2] {
    let mm = lift(stage).iter().map(|way| way.mm).sum();
    ways(stage.retract, RawWay { mm, mm_min: RETRACT_MM_MIN })
}

fn waits_s(stage: &Stage) -> [f32; 3] {
    let mut waits = WAITS_S;
    for (wait, told) in waits.iter_mut().zip(stage.waits_s) {
        *wait = told.map_or(*wait, |s| s as f32);
    }
    waits
}

fn light(stage: &Stage) -> u16 {
    (stage.light.unwrap_or(1.0) * FULL).round() as u16
}

/// What waits and ways of a layer take, s.
fn moves_s(stage: &Stage) -> f64 {
    let ways = lift(stage).into_iter().chain(retract(stage));
    let ways_s = ways.filter(|w| w.mm_min > 0.0).map(|w| f64::from(w.mm) / f64::from(w.mm_min) * 60.0);
    ways_s.sum::<f64>() + waits_s(stage).iter().map(|s| f64::from(*s)).sum::<f64>()
}

fn settings(facts: &Facts<'_>) -> Settings {
    let recipe = facts.recipe;
    let stages = [recipe.bottom, recipe.usual];
    let (panel, placement) = (facts.panel, facts.placement);
    let firsts = recipe.bottom_layers.min(facts.layers.len() as u32);
    let taken_s = facts.exposures_s()
        + f64::from(firsts) * moves_s(&recipe.bottom)
        + f64::from(facts.layers.len() as u32 - firsts) * moves_s(&recipe.usual);
    let [lifts, retracts] = [stages.map(|s| lift(&s)), stages.map(|s| retract(&s))];
    Settings {
        layers: facts.layers.len() as u32,
        panel_px: [panel.width_px as u16, panel.height_px as u16],
        mirror: [placement.reverse_u.into(), (!placement.reverse_v).into()],
        panel_mm: [
            (f64::from(panel.width_px) * placement.pixel_mm[0]) as f32,
            (f64::from(panel.height_px) * placement.pixel_mm[1]) as f32,
        ],
        machine_z_mm: machine_z_mm(facts),
        layer_mm: facts.heights_mm[1] as f32,
        exposure_s: recipe.usual.exposure_s as f32,
        delay_mode: 1,
        light_off_s: 0.0,
        waits_s: stages.map(|s| waits_s(&s)),
        bottom_exposure_s: recipe.bottom.exposure_s as f32,
        bottom_layers: recipe.bottom_layers,
        lift: lifts.map(|l| l[0]),
        retract: retracts.map(|r| r[0]),
        lift2: lifts.map(|l| l[1]),
        retract2: retracts.map(|r| r[1]),
        light: stages.map(|s| light(&s)),
        by_layer: (!facts.even() || !facts.exposed_by_recipe()).into(),
        print_time_s: recipe.print_time_s.unwrap_or(taken_s) as u32,
        volume_mm3: recipe.resin_mm3.unwrap_or(0.0) as f32,
        mass_g: 0.0,
        price: 0.0,
        currency: *b"$\0\0\0\0\0\0\0",
        layers_at: HEAD_BYTES as u32,
        grey: 1,
        transition_layers: recipe.transition_layers.min(u16::MAX.into()) as u16,
    }
}

fn definition(facts: &Facts<'_>, settings: &Settings, layer: usize) -> Definition {
    let first = (layer as u64) < u64::from(settings.bottom_layers);
    let i = usize::from(!first);
    let found = facts.layers[layer];
    Definition {
        pause: 0,
        pause_z_mm: settings.machine_z_mm,
        top_mm: found.top_mm as f32,
        exposure_s: found.exposure_s as f32,
        light_off_s: 0.0,
        waits_s: settings.waits_s[i],
        lift: [settings.lift[i], settings.lift2[i]],
        retract: [settings.retract[i], settings.retract2[i]],
        light: settings.light[i],
        delimiter: DELIMITER,
        bytes: 0,
    }
}
