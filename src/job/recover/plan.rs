//! The way back into a job after the printer lost its state, as lines with reasons.
//!
//! Takes the place to come to, the height at which the nozzle stands and the profile's
//! rules; gives the steps in the one order that is safe. Knows no session.
use super::ResumeRules;
use super::walk::Walked;
use crate::job::tracker::{MAX_TOOLS, Tracker, modes, number};

/// The way back into a job after the printer lost its state.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plan {
    /// What is done, in order.
    pub steps: Vec<Step>,
    /// Commands of the file that are not sent again.
    pub after: u64,
    /// The file's line of the last of these; 0 if it is not known.
    pub line: u64,
    /// Moves that may be made twice, at most.
    pub most_twice: u64,
    /// Height that the nozzle, or a resin printer's plate, is taken to be at, mm.
    pub z_mm: f64,
    /// It is a resin printer's: the plate is what moves.
    pub of_plate: bool,
}

/// One step of a [`Plan`].
#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// For a person: `raise the nozzle by 10 mm`.
    pub what: String,
    /// Lines that are sent for it.
    pub lines: Vec<String>,
    /// What is known of the nozzle's height while it runs and after it.
    pub z: ZDuring,
}

/// What is known of the nozzle's height during a step of a [`Plan`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ZDuring {
    /// As before.
    Same,
    /// It moves: if the power fails now, it is not known; afterwards it is this, mm.
    MovesTo(f64),
}

/// Filament pushed where the profile has no priming macro, mm: the nozzle has oozed.
const PRIME_MM: f64 = 10.0;

/// How fast, mm/min.
const PRIME_MM_MIN: f64 = 150.0;

/// Pulled back on the way from priming to the part, mm.
const HOLD_BACK_MM: f64 = 2.0;

const FILAMENT_MM_MIN: f64 = 1_800.0;
const RAISE_MM_MIN: f64 = 300.0;
const TRAVEL_MM_MIN: f64 = 3_000.0;

/// The way from a nozzle that stands at `z_mm`, nothing else being known of the machine.
pub fn plan(walked: &Walked, z_mm: f64, rules: &ResumeRules) -> Plan {
    let want = &walked.tracker;
    let raised_mm = z_mm + rules.raise_mm;
    let mut steps = Vec::new();
    let mut step = |what: String, lines: Vec<String>, z: ZDuring| {
        if !lines.is_empty() {
            steps.push(Step { what, lines, z });
        }
    };
    let (what, lines) = soften(want, rules);
    step(what, lines, ZDuring::Same);
    step(
        format!("take the nozzle to be at {} mm and raise it by {} mm", number(z_mm), number(rules.raise_mm)),
        raise(z_mm, rules),
        ZDuring::MovesTo(raised_mm),
    );
    step("home X and Y, Z staying up".to_owned(), or(&rules.home, "G28 R0 X Y"), ZDuring::Same);
    step("restore bed levelling".to_owned(), rules.levelling.clone(), ZDuring::Same);
    step("heat up as the file wants it here".to_owned(), heat(want), ZDuring::Same);
    step("prime the nozzle beside the part".to_owned(), prime(rules), ZDuring::Same);
    let at = |axis| want.at_native_mm(axis).unwrap_or_default();
    step(
        format!("go above X {} Y {}", number(at(0)), number(at(1))),
        vec![
            // The priming macro may have left it lower.
            format!("G0 Z{} F{}", number(raised_mm), number(RAISE_MM_MIN)),
            format!("G0 X{} Y{} F{}", number(at(0)), number(at(1)), number(TRAVEL_MM_MIN)),
        ],
        ZDuring::Same,
    );
    let mut last = vec![format!("G0 Z{} F{}", number(at(2)), number(RAISE_MM_MIN))];
    last.extend(as_in_the_file(want));
    step(format!("go down to Z {} and go on", number(at(2))), last, ZDuring::MovesTo(at(2)));
    Plan {
        steps,
        after: walked.after,
        line: walked.last.0,
        most_twice: rules.most_twice(),
        z_mm,
        of_plate: false,
    }
}

fn or(lines: &[String], default: &str) -> Vec<String> {
    if lines.is_empty() { vec![default.to_owned()] } else { lines.to_vec() }
}

/// The bed first: the part must not come off while the nozzle pulls at it.
fn soften(want: &Tracker, rules: &ResumeRules) -> (String, Vec<String>) {
    let mut lines = Vec::new();
    let mut what = String::from("heat");
    if let Some(c) = want.dials.bed_c.filter(|c| *c > 0.0) {
        lines.push(format!("M190 S{}", number(c)));
        what += &format!(" the bed to {} °C, then", number(c));
    }
    let soft_c = number(f64::from(rules.soften_c));
    lines.push(format!("M109 S{soft_c}"));
    what += &format!(" the nozzle to {soft_c} °C, so that it comes off the part");
    (what, lines)
}

fn raise(z_mm: f64, rules: &ResumeRules) -> Vec<String> {
    let mut lines = vec!["G21".to_owned(), "G90".to_owned()];
    let z = number(z_mm);
    lines.extend(or(&rules.z_set, "G92 Z{z}").iter().map(|line| line.replace("{z}", &z)));
    lines.push("G91".to_owned());
    lines.push(format!("G1 Z{} F{}", number(rules.raise_mm), number(RAISE_MM_MIN)));
    lines.push("G90".to_owned());
    lines
}

fn heat(want: &Tracker) -> Vec<String> {
    let mut lines = Vec::new();
    let (dials, tool) = (&want.dials, want.tool());
    if let Some(c) = dials.chamber_c {
        lines.push(format!("M141 S{}", number(c)));
    }
    for other in (0..MAX_TOOLS).filter(|t| *t != tool) {
        if let Some(c) = dials.nozzles_c[other] {
            lines.push(format!("M104 T{other} S{}", number(c)));
        }
    }
    if tool > 0 {
        lines.push(format!("T{tool}"));
    }
    if let Some(c) = dials.nozzles_c.get(tool).copied().flatten() {
        lines.push(format!("M109 S{}", number(c)));
    }
    if let Some(c) = dials.bed_c.filter(|c| *c > 0.0) {
        lines.push(format!("M190 S{}", number(c)));
    }
    lines
}

fn prime(rules: &ResumeRules) -> Vec<String> {
    let mut lines = vec!["M83".to_owned()];
    match rules.prime.is_empty() {
        true => lines.push(format!("G1 E{} F{}", number(PRIME_MM), number(PRIME_MM_MIN))),
        false => lines.extend(rules.prime.iter().cloned()),
    }
    // The macro may have left other modes.
    lines.extend(["G21", "G90", "M83"].map(str::to_owned));
    lines.push(format!("G1 E-{} F{}", number(HOLD_BACK_MM), number(FILAMENT_MM_MIN)));
    lines
}

/// Filament, E, offsets, settings, factors, fans, feed rate, modes.
fn as_in_the_file(want: &Tracker) -> Vec<String> {
    let mut lines = Vec::new();
    let by_firmware = want.is_firmware_retracted();
    let push_mm = HOLD_BACK_MM - if by_firmware { 0.0 } else { want.retracted_mm().clamp(0.0, 100.0) };
    if push_mm != 0.0 {
        lines.push(format!("G1 E{} F{}", number(push_mm), number(FILAMENT_MM_MIN)));
    }
    lines.extend(want.settings().map(str::to_owned));
    if by_firmware {
        lines.push("G10".to_owned());
    }
    lines.push(format!("G92 E{}", number(want.e_mm().unwrap_or_default())));
    for (axis, letter) in [(0, 'X'), (1, 'Y'), (2, 'Z')] {
        if let (Some(native), Some(named)) = (want.at_native_mm(axis), want.at_mm(axis))
            && (native - named).abs() > 1e-9
        {
            lines.push(format!("G92 {letter}{}", number(named)));
        }
    }
    let fresh = Tracker::new(want.e_modes());
    lines.extend(modes(&fresh, want));
    lines
}
