//! The words of Marlin 2.1.2.1: what the board says, byte for byte.
//!
//! Takes values, gives text (other firmwares by their habits); every line ends in `\n` alone. Knows nothing of
//! when it is said.
use super::config::{Config, Habits, Repeats, ResendForm};
use super::heater::Heater;
use super::line::Verdict;
use std::fmt::Write;

/// A question with HOST_PROMPT_SUPPORT: M0, M1, and M600 once the nozzle is parked.
pub(crate) fn prompt(title: &str) -> String {
    format!(
        "//action:prompt_end\n//action:prompt_begin {title}\n//action:prompt_button Continue\n//action:prompt_show\n"
    )
}

/// M600 once the nozzle is parked, to those at the printer.
pub(crate) const INSERT: &str = "echo:Insert filament and press button\n";

/// The lines of a start; `cause` is `PowerUp` or ` External Reset`.
pub(crate) fn boot(habits: &Habits, cause: &str) -> String {
    format!(
        "start\n{cause}\n{}\n\n\
         echo: Last Updated: 2023-02-11 | Author: (outrigger, mock)\n\
         echo: Compiled: Feb 11 2023\n\
         echo: Free Memory: 5187  PlannerBufferBytes: 1488\n\
         echo:Hardcoded Default Settings Loaded\n",
        habits.version
    )
}

/// All heaters of a machine.
#[derive(Debug)]
pub(crate) struct Heaters {
    /// One an extruder.
    pub(crate) nozzles: Vec<Heater>,
    pub(crate) tool: usize,
    pub(crate) bed: Heater,
    pub(crate) chamber: Option<Heater>,
}

impl Heaters {
    pub(crate) fn nozzle(&self) -> &Heater {
        &self.nozzles[self.tool]
    }

    pub(crate) fn all(&self) -> impl Iterator<Item = &Heater> {
        self.nozzles.iter().chain([&self.bed]).chain(&self.chamber)
    }

    pub(crate) fn all_off(&mut self, now_s: f64) {
        for heater in self.nozzles.iter_mut().chain([&mut self.bed]).chain(&mut self.chamber) {
            heater.set(0.0, now_s);
        }
    }

    /// `T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0`, with more than one nozzle `T0:` and `T1:` too.
    pub(crate) fn temperatures(&self, now_s: f64) -> String {
        let mut text = String::with_capacity(64);
        let nozzle = self.nozzle();
        one(&mut text, "T", nozzle, now_s);
        text.push(' ');
        one(&mut text, "B", &self.bed, now_s);
        if let Some(chamber) = &self.chamber {
            text.push(' ');
            one(&mut text, "C", chamber, now_s);
        }
        let several = if self.nozzles.len() > 1 { self.nozzles.as_slice() } else { &[] };
        for (at, nozzle) in several.iter().enumerate() {
            text.push(' ');
            one(&mut text, &format!("T{at}"), nozzle, now_s);
        }
        // Writing to a String cannot fail.
        let _ = write!(text, " @:{} B@:{}", nozzle.power(now_s), self.bed.power(now_s));
        if let Some(chamber) = &self.chamber {
            let _ = write!(text, " C@:{}", chamber.power(now_s));
        }
        for (at, nozzle) in several.iter().enumerate() {
            let _ = write!(text, " @{at}:{}", nozzle.power(now_s));
        }
        text
    }
}

fn one(text: &mut String, name: &str, heater: &Heater, now_s: f64) {
    let _ = write!(text, "{name}:{:.2} /{:.2}", heater.temperature_c(now_s), heater.target_c());
}

/// A line while M109 or M190 waits: `W:?` until the temperature is there,
/// then the seconds that are left.
pub(crate) fn heating(temperatures: &str, left_s: Option<u64>) -> String {
    match left_s {
        None => format!(" {temperatures} W:?\n"),
        Some(s) => format!(" {temperatures} W:{s}\n"),
    }
}

/// The keep-alive of a command that takes long.
pub(crate) fn busy(waits_for_user: bool) -> &'static [u8] {
    if waits_for_user { b"echo:busy: paused for user\n" } else { b"echo:busy: processing\n" }
}

/// Appends ` N12 P15 B3`, the number only if the line has one.
pub(crate) fn advanced_ok(ok: &mut Vec<u8>, number: Option<i64>, free: (usize, usize)) {
    if let Some(n) = number {
        ok.extend(format!(" N{n}").bytes());
    }
    ok.extend(format!(" P{} B{}", free.0, free.1).bytes());
}

/// Why a line is refused, in Marlin's words or Repetier's.
pub(crate) fn refusal(repeats: Repeats, why: &Verdict, last: i64) -> String {
    if repeats == Repeats::Skipped {
        return match why {
            Verdict::WrongChecksum => "Error:Wrong checksum\n".to_owned(),
            Verdict::NoChecksum => "Error:Missing checksum\n".to_owned(),
            Verdict::WrongNumber(n) => format!("Error:expected line {} got {n}\n", last.saturating_add(1)),
            _ => format!("Error:expected line {}\n", last.saturating_add(1)),
        };
    }
    let words = match why {
        Verdict::WrongChecksum => "checksum mismatch",
        Verdict::NoChecksum => "No Checksum with line number",
        _ => "Line Number is not Last Line Number+1",
    };
    format!("Error:{words}, Last Line: {last}\n")
}

/// The request for a resend, without its `ok`.
pub(crate) fn resend(form: ResendForm, next: i64) -> String {
    match form {
        ResendForm::Marlin => format!("Resend: {next}\n"),
        ResendForm::Tight => format!("Resend:{next}\n"),
        ResendForm::WithN => format!("Resend: N:{next}\n"),
        ResendForm::Short => format!("rs {next}\n"),
    }
}

/// M115: identity and capabilities.
pub(crate) fn identity(config: &Config) -> String {
    let (machine, habits) = (&config.machine, &config.habits);
    let mut text = format!(
        "FIRMWARE_NAME:{} (outrigger mock) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin \
         PROTOCOL_VERSION:1.0 MACHINE_TYPE:{} EXTRUDER_COUNT:{} \
         UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff\n",
        habits.version, machine.name, machine.extruders
    );
    if !habits.capabilities {
        return text;
    }
    for (name, on) in [
        ("SERIAL_XON_XOFF", false),
        ("BINARY_FILE_TRANSFER", false),
        ("EEPROM", false),
        ("VOLUMETRIC", true),
        ("AUTOREPORT_POS", false),
        ("AUTOREPORT_TEMP", habits.auto_report),
        ("PROGRESS", false),
        ("PRINT_JOB", true),
        ("AUTOLEVEL", machine.levelling),
        ("RUNOUT", false),
        ("Z_PROBE", machine.levelling),
        ("LEVELING_DATA", machine.levelling),
        ("BUILD_PERCENT", true),
        ("SOFTWARE_POWER", false),
        ("TOGGLE_LIGHTS", false),
        ("CASE_LIGHT_BRIGHTNESS", false),
        ("EMERGENCY_PARSER", config.emergency_parser),
        ("HOST_ACTION_COMMANDS", true),
        ("PROMPT_SUPPORT", habits.prompts),
        ("SDCARD", false),
        ("ARCS", true),
        ("BABYSTEPPING", false),
        ("CHAMBER_TEMPERATURE", machine.chamber),
    ] {
        text += &format!("Cap:{name}:{}\n", u8::from(on));
    }
    text
}

/// M114: the position, and the steps planned, 80, 80 and 400 a millimetre, which
/// know nothing of G92.
pub(crate) fn position(at_mm: [f64; 4], native_mm: [f64; 3]) -> String {
    let [x, y, z, e] = at_mm;
    let steps = |mm: f64, per_mm: f64| (mm * per_mm).round() as i64;
    format!(
        "X:{x:.2} Y:{y:.2} Z:{z:.2} E:{e:.2} Count X:{} Y:{} Z:{}\n",
        steps(native_mm[0], 80.0),
        steps(native_mm[1], 80.0),
        steps(native_mm[2], 400.0)
    )
}
