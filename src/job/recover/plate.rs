//! The way back into a resin job after the printer lost its state.
//!
//! Takes what is written down of the job and where its source says that it goes on; gives the steps
//! in the one order that is safe: dark first, up next, and down to the next layer by the job's own
//! lines. A plate with a part on it is never homed downward. Pure.
use super::Refusal;
use super::plan::{Plan, Step, ZDuring};
use super::walk::{Walk, Walked};
use crate::job::record::{Log, Numbers};
use crate::job::state::State;
use crate::job::tracker::{Tracker, number};
use crate::printer::source::Back;

/// What a profile says of a plate that must find its place again.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlateRules {
    /// Its switch is at the top: homing leads away from the vat.
    pub homes_up: bool,
    /// Homes it.
    pub home: Vec<String>,
    /// How high it is then, mm.
    pub top_mm: f64,
    /// Switches the light off.
    pub light_off: Vec<String>,
    /// How far it is raised where it is not homed, mm.
    pub raise_mm: f64,
}

/// How fast it is raised, mm/min: a part may still stick to the film.
const RAISE_MM_MIN: f64 = 60.0;

/// Down again after a pause, mm/min; the job's own lines go slower where it matters.
const LOWER_MM_MIN: f64 = 180.0;

/// From where the plate is parked back to where the job left it: the height alone.
pub fn lower_again(want: &Tracker) -> Vec<String> {
    let mut lines = vec!["G21".to_owned(), "G90".to_owned()];
    if let Some(z_mm) = want.at_mm(2) {
        lines.push(format!("G1 Z{} F{}", number(z_mm), number(LOWER_MM_MIN)));
    }
    lines
}

/// The place to go on, and the way there.
///
/// # Errors
/// Nothing was exposed yet, or nobody can know how high the plate stands.
pub fn plan(
    log: &Log,
    walk: Walk,
    back: &Back,
    pause_macro: &[String],
    rules: &PlateRules,
) -> Result<(Walked, Plan), Refusal> {
    if back.after == 0 && !back.begun {
        return Err(Refusal::InPreparation);
    }
    let walked = walk.exact();
    let z_mm = height_mm(log, &walked.tracker, back, pause_macro);
    let z_mm = match (z_mm, rules.homes_up) {
        (Some(z_mm), _) => z_mm,
        (None, true) => rules.top_mm,
        (None, false) => return Err(Refusal::HeightNotKnown),
    };
    let mut steps = vec![Step {
        what: "switch the light off".to_owned(),
        lines: rules.light_off.clone(),
        z: ZDuring::Same,
    }];
    steps.push(match rules.homes_up {
        true => Step {
            what: "home the plate, which is upward".to_owned(),
            lines: rules.home.clone(),
            z: ZDuring::MovesTo(rules.top_mm),
        },
        false => Step {
            what: format!(
                "take the plate to be at {} mm and raise it by {} mm",
                number(z_mm),
                number(rules.raise_mm)
            ),
            lines: raise(z_mm, rules.raise_mm),
            z: ZDuring::MovesTo(z_mm + rules.raise_mm),
        },
    });
    let again = match back.begun {
        true => ", which may have been exposed already and is exposed now",
        false => "",
    };
    steps.push(Step {
        what: format!("go on with layer {}{again}", back.layer),
        lines: vec!["G21".to_owned(), "G90".to_owned()],
        z: ZDuring::Same,
    });
    let place = Walked { after: back.after, last: (back.after, back.layer.saturating_sub(1)), ..walked };
    let (after, line) = (back.after, back.after);
    Ok((place, Plan { steps, after, line, most_twice: 0, z_mm, of_plate: true }))
}

fn raise(z_mm: f64, by_mm: f64) -> Vec<String> {
    let up = format!("G1 Z{} F{}", number(by_mm), number(RAISE_MM_MIN));
    let named = format!("G92 Z{}", number(z_mm));
    ["G21", "G90", &named, "G91", &up, "G90"].map(str::to_owned).to_vec()
}

/// How high the plate stands, mm, if it cannot have been moving.
fn height_mm(log: &Log, there: &Tracker, back: &Back, pause_macro: &[String]) -> Option<f64> {
    match (log.made_safe, log.state, &log.numbers) {
        (Some(z_mm), ..) => z_mm,
        (None, State::Paused, _) => {
            let mut parked = there.clone();
            for line in pause_macro {
                parked.apply(line.as_bytes());
            }
            parked.at_mm(2)
        }
        (None, _, Numbers::Nothing { .. }) => None,
        (None, _, Numbers::Job { .. }) => back.at_mm,
    }
}
