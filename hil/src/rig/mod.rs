//! Scenarios through the real program: a proxy between it and a printer, and a watchdog beside.
//!
//! Takes scenarios and a [`Rig`]; starts `outrigger print` on a pseudo-terminal of ours, carries
//! bytes between it and the printer (a real port, the mock on its own pseudo-terminal, or
//! OctoPrint's virtual printer), does to them and to the program what the scenario says, and
//! judges what came of it.
//!
//! # Layout
//! Here what a rig's file says · [`skips`] what cannot be played where · [`tty`] terminals ·
//! [`program`] the program and what it says · [`account`] what went over the wire · [`stage`] the
//! loop that carries bytes, and `happen` what happens in it · [`target`] what is printed on ·
//! [`profile`] and job as they are here · [`verdict`] what must hold · [`suite`] many scenarios · [`watchdog`] makes the
//! printer safe when all this dies.
pub mod account;
mod happen;
pub mod profile;
pub mod program;
pub mod skips;
pub mod stage;
pub mod suite;
pub mod target;
pub mod tty;
pub mod verdict;
pub mod watchdog;

use serde::Deserialize;
use std::path::Path;

/// What a rig's file may say, for people.
pub const HELP: &str = r#"A rig, in TOML. Unknown keys are errors.

title = "Ender-3 on the bench"
profile = "ender-3"            # the printer's profile; its baud rate is used
dtr_reset = true               # toggling DTR resets the board
power_off = "usb-relay 1 off"  # a command that cuts the printer's power (optional;
power_on = "usb-relay 1 on"    #   both or neither)
lift_mm = 50                   # the jobs' moves are so much higher than they say [50]

[limits]                       # beyond these the watchdog makes the printer safe
nozzle_c = 230                 # measured, °C
bed_c = 70
scenario_s = 900               # one scenario's time
"#;

/// Largest rig file: the longest sensible one has under a kilobyte.
const FILE_BYTES_MAX: u64 = 64 * 1024;

/// A printer, and what may be done to it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// For people.
    pub title: String,
    /// The printer's profile.
    pub profile: String,
    /// Whether toggling DTR resets the board.
    #[serde(default)]
    pub dtr_reset: bool,
    /// Cuts the printer's power.
    pub power_off: Option<String>,
    /// Gives it back.
    pub power_on: Option<String>,
    /// The jobs' moves are so much higher than they say, mm: nothing is to be printed.
    #[serde(default = "lift_mm")]
    pub lift_mm: f64,
    /// What the watchdog allows.
    pub limits: Limits,
}

fn lift_mm() -> f64 {
    50.0
}

/// What the watchdog allows.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Measured at the nozzle, °C.
    pub nozzle_c: f64,
    /// Measured at the bed, °C.
    pub bed_c: f64,
    /// One scenario's time, s.
    pub scenario_s: f64,
}

impl Rig {
    /// The mock and its like: nothing can burn.
    pub fn mock() -> Self {
        Self {
            title: "mock printer".to_owned(),
            profile: crate::play::DEFAULT_PROFILE.to_owned(),
            dtr_reset: false,
            power_off: None,
            power_on: None,
            lift_mm: 0.0,
            limits: Limits { nozzle_c: 280.0, bed_c: 130.0, scenario_s: 300.0 },
        }
    }

    /// Reads a rig's file.
    ///
    /// # Errors
    /// It cannot be read, or says what makes no sense.
    pub fn load(path: &Path) -> anyhow::Result<Self> {
        let wrong = |why: String| anyhow::anyhow!("{}: {why}", path.display());
        let bytes = std::fs::metadata(path).map_err(|e| wrong(e.to_string()))?.len();
        anyhow::ensure!(bytes <= FILE_BYTES_MAX, wrong("this is too large to be a rig's file".to_owned()));
        let text = std::fs::read_to_string(path).map_err(|e| wrong(e.to_string()))?;
        Self::parse(&text).map_err(wrong)
    }

    /// Reads a rig from text.
    ///
    /// # Errors
    /// What makes no sense.
    pub fn parse(text: &str) -> Result<Self, String> {
        let rig: Rig = toml::from_str(text).map_err(|e| e.to_string())?;
        let Limits { nozzle_c, bed_c, scenario_s } = rig.limits;
        if !(0.0..=400.0).contains(&nozzle_c) || !(0.0..=200.0).contains(&bed_c) {
            return Err("limits: nozzle_c is 0 to 400, bed_c 0 to 200".to_owned());
        }
        if !(1.0..=86_400.0).contains(&scenario_s) {
            return Err("limits.scenario_s is outside 1 to 86400".to_owned());
        }
        if !(10.0..=200.0).contains(&rig.lift_mm) {
            return Err("lift_mm is outside 10 to 200: the nozzle stays away from the bed".to_owned());
        }
        if rig.power_off.is_some() != rig.power_on.is_some() {
            return Err("power_off and power_on go together: who cuts power must give it back".to_owned());
        }
        Ok(rig)
    }
}

/// What is printed on, as far as a scenario cares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sort {
    /// The mock: everything can be done to it.
    Mock,
    /// OctoPrint's virtual printer.
    Virtual,
    /// A real printer.
    Real,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigs_are_checked() {
        let limits = "[limits]\nnozzle_c = 230\nbed_c = 70\nscenario_s = 900\n";
        let check = |text: String, expect: &str| match (Rig::parse(&text), expect) {
            (Ok(_), "") => {}
            (Err(e), expect) if !expect.is_empty() => assert!(e.contains(expect), "{e}"),
            (other, _) => panic!("{text}: {other:?}"),
        };
        let head = "title = 't'\nprofile = 'ender-3'\n";
        check(format!("{head}{limits}"), "");
        check(format!("{head}dtr = true\n{limits}"), "unknown field `dtr`");
        check(format!("{head}lift_mm = 0\n{limits}"), "lift_mm");
        check(format!("{head}power_off = 'x'\n{limits}"), "go together");
        check(format!("{head}{}", limits.replace("230", "900")), "nozzle_c");
        check(format!("{head}{}", limits.replace("900", "0")), "scenario_s");
        let example = HELP.split_once("\n\n").unwrap().1;
        Rig::parse(example).unwrap();
    }
}
