//! The lines that bring a machine from one tracked state back to another.
//!
//! Takes the state now and the state wanted, gives lines. Knows no printer.
use super::{MAX_TOOLS, Tracker};

/// Speed of the way back in X and Y, mm/min: slow enough for any machine.
const TRAVEL_MM_MIN: f64 = 3_000.0;

/// Speed of Z, mm/min.
const LIFT_MM_MIN: f64 = 600.0;

/// Speed of filament, mm/min.
const FILAMENT_MM_MIN: f64 = 1_800.0;

/// Less filament than this is none, mm.
const NO_FILAMENT_MM: f64 = 1e-6;

/// A number as short as it goes, exact to 1 nm.
pub(in crate::job) fn number(value: f64) -> String {
    let text = format!("{value:.6}");
    match text.trim_end_matches('0').trim_end_matches('.') {
        "" | "-0" => "0".to_owned(),
        short => short.to_owned(),
    }
}

/// `T1 ` where another tool than the one in use is meant.
fn of_tool(tool: usize, in_use: usize) -> String {
    if tool == in_use { String::new() } else { format!("T{tool} ") }
}

/// From where the head is parked back to where it was: heat first, then X and Y at the
/// parked height (raised before, if it is lower or not known), Z, filament, E, factors,
/// fans, feed rate, modes. `clear_mm` is the room above the part when the parked height is
/// not known.
pub fn unpark(now: &Tracker, want: &Tracker, clear_mm: f64) -> Vec<String> {
    let mut lines = heat(now, want);
    lines.extend(["G21", "G90", "M83"].map(str::to_owned));
    if now.tool() != want.tool() {
        lines.push(format!("T{}", want.tool()));
    }
    travel(now, want, clear_mm, &mut lines);
    filament(now, want, &mut lines);
    lines.extend(modes(now, want));
    lines
}

/// Targets that differ; waits for those of the tool in use and of the bed.
fn heat(now: &Tracker, want: &Tracker) -> Vec<String> {
    let mut lines = Vec::new();
    let in_use = now.tool();
    let (now, tool, want) = (&now.dials, want.tool(), &want.dials);
    let changed = |now: Option<f64>, want: Option<f64>| want.filter(|_| now != want);
    let bed = changed(now.bed_c, want.bed_c);
    if let Some(c) = bed {
        lines.push(format!("M140 S{}", number(c)));
    }
    if let Some(c) = changed(now.chamber_c, want.chamber_c) {
        lines.push(format!("M141 S{}", number(c)));
    }
    for other in (0..MAX_TOOLS).filter(|t| *t != tool) {
        if let Some(c) = changed(now.nozzles_c[other], want.nozzles_c[other]) {
            lines.push(format!("M104 {}S{}", of_tool(other, in_use), number(c)));
        }
    }
    if let Some(c) = want.nozzles_c.get(tool).and_then(|c| changed(now.nozzles_c[tool], *c)) {
        lines.push(format!("M109 {}S{}", of_tool(tool, in_use), number(c)));
    }
    if let Some(c) = bed.filter(|c| *c > 0.0) {
        lines.push(format!("M190 S{}", number(c)));
    }
    lines
}

/// X and Y high, then Z. In absolute millimetres of the coordinates that hold now.
fn travel(now: &Tracker, want: &Tracker, clear_mm: f64, lines: &mut Vec<String>) {
    let target =
        |axis: usize| want.known[axis].then(|| want.machine.position[axis] - now.machine.offset[axis]);
    let z = target(2);
    if let Some(z) = z {
        match now.at_mm(2) {
            Some(at) if at >= z => {}
            Some(_) => lines.push(format!("G0 Z{} F{}", number(z), number(LIFT_MM_MIN))),
            None => lines.push(format!("G0 Z{} F{}", number(z + clear_mm), number(LIFT_MM_MIN))),
        }
    }
    let mut across = String::from("G0");
    for (axis, letter) in [(0, 'X'), (1, 'Y')] {
        if let Some(at) = target(axis) {
            across += &format!(" {letter}{}", number(at));
        }
    }
    if across.len() > 2 {
        lines.push(format!("{across} F{}", number(TRAVEL_MM_MIN)));
    }
    if let Some(z) = z {
        lines.push(format!("G0 Z{} F{}", number(z), number(LIFT_MM_MIN)));
    }
    for (axis, letter) in [(0, 'X'), (1, 'Y'), (2, 'Z')] {
        if want.known[axis] && (want.machine.offset[axis] - now.machine.offset[axis]).abs() > NO_FILAMENT_MM {
            let at = want.machine.position[axis] - want.machine.offset[axis];
            lines.push(format!("G92 {letter}{}", number(at)));
        }
    }
}

/// What was pulled back is pushed again, and E named as it was. E is relative here.
fn filament(now: &Tracker, want: &Tracker, lines: &mut Vec<String>) {
    match (now.machine.firmware_retracted, want.machine.firmware_retracted) {
        (true, false) => lines.push("G11".to_owned()),
        (false, true) => lines.push("G10".to_owned()),
        _ => {}
    }
    let push_mm = (want.fed_mm - now.fed_mm) / now.flow();
    if push_mm.abs() > NO_FILAMENT_MM {
        lines.push(format!("G1 E{} F{}", number(push_mm), number(FILAMENT_MM_MIN)));
    }
    if let Some(e) = want.e_mm() {
        lines.push(format!("G92 E{}", number(e)));
    }
}

/// Factors and fans that differ, the feed rate and all modes. Begins in millimetres.
pub fn modes(now: &Tracker, want: &Tracker) -> Vec<String> {
    let mut lines = Vec::new();
    if let Some(percent) = want.dials.speed_percent.filter(|p| now.dials.speed_percent != Some(*p)) {
        lines.push(format!("M220 S{}", number(percent)));
    }
    let in_use = want.tool();
    for (tool, (now, want)) in now.dials.flow_percent.iter().zip(want.dials.flow_percent).enumerate() {
        if let Some(percent) = want.filter(|p| *now != Some(*p)) {
            lines.push(format!("M221 {}S{}", of_tool(tool, in_use), number(percent)));
        }
    }
    for (fan, (now, want)) in now.dials.fans.iter().zip(want.dials.fans).enumerate() {
        if let Some(value) = want.filter(|v| *now != Some(*v)) {
            lines.push(match fan {
                0 => format!("M106 S{}", number(value)),
                _ => format!("M106 P{fan} S{}", number(value)),
            });
        }
    }
    let machine = &want.machine;
    if machine.feed > 0.0 {
        lines.push(format!("G1 F{}", number(machine.feed)));
    }
    if machine.inches {
        lines.push("G20".to_owned());
    }
    lines.push(if machine.absolute { "G90" } else { "G91" }.to_owned());
    lines.push(if machine.e_is_absolute() { "M82" } else { "M83" }.to_owned());
    lines
}
