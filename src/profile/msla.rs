//! What only a printer of resin has: the LCD, the light behind it, the plate.
//!
//! Plain data, valid once it is built; [`super::keys`] documents each key, and `proof` holds
//! what they say together. The plate and the light hang on the firmware, the LCD on the host.
use super::macros::Macro;
use crate::units::{Mm, MmPerMin, MmPerS2};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

pub(super) mod proof;

/// Where the light's power stands in `light.on` and `light.pulse`: 0 to 255.
pub const POWER_PLACE: &str = "{power}";
/// Where the milliseconds stand in `light.pulse` and `light.dwell`.
pub const MS_PLACE: &str = "{ms}";
/// Where the word to be said stands in `plate.done`.
pub const WORD_PLACE: &str = "{word}";
/// Longest word that is put in the place of [`WORD_PLACE`], in bytes: a name and a counter.
pub const WORD_BYTES_MAX: usize = 17;

/// What only a printer of resin has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Msla {
    /// The panel that shows the pictures.
    pub lcd: Lcd,
    /// The light behind it.
    pub light: Light,
    /// What the part hangs on.
    pub plate: Plate,
    /// What is to be so before a print.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub before: Vec<Before>,
}

/// The panel that shows the pictures.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lcd {
    /// Pixels of a row of the panel: what a job's picture has, 1 to 16,384.
    pub width_px: u32,
    /// Rows of the panel, 1 to 16,384.
    pub height_px: u32,
    /// How the panel's pixels lie in the display's.
    pub pixels: Pixels,
    /// How a picture is turned before it is shown.
    #[serde(default, skip_serializing_if = "Mirror::is_none")]
    pub mirror: Mirror,
    /// Where pictures go.
    pub sink: Sink,
    /// How long a picture is shown before the light goes on, ms.
    pub settle_ms: u32,
}

/// How a panel's pixels lie in those of the display that the system knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Pixels {
    /// One in one.
    Grey,
    /// Three neighbours of a row are red, green and blue of one.
    Rgb,
    /// Three neighbours of a row are blue, green and red of one.
    Bgr,
}

impl Pixels {
    /// How many of the panel's pixels are one of the display's.
    #[must_use]
    pub fn in_one(self) -> u32 {
        match self {
            Pixels::Grey => 1,
            Pixels::Rgb | Pixels::Bgr => 3,
        }
    }
}

/// How a picture is turned before it is shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mirror {
    /// Not at all.
    #[default]
    None,
    /// Left and right change places.
    X,
    /// Top and bottom change places.
    Y,
    /// Both: half a turn.
    Xy,
}

impl Mirror {
    fn is_none(&self) -> bool {
        *self == Mirror::None
    }
}

/// Where pictures go.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Sink {
    /// A framebuffer by its name in `/dev`: `fb0`.
    Framebuffer(String),
    /// Files in a folder: to look at what would be shown.
    Folder(PathBuf),
}

/// The light behind the panel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Light {
    /// Switches it on at `{power}`, 0 to 255.
    pub on: Macro,
    /// Switches it off.
    pub off: Macro,
    /// Whose clock ends an exposure.
    pub timed_by: TimedBy,
    /// Lines of which the last lights for `{ms}` at `{power}` and ends by itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pulse: Option<Macro>,
    /// Waits for `{ms}`; what follows is done after it.
    #[serde(default = "dwell")]
    pub dwell: Macro,
    /// A firmware that halts (M112) switches this pin off.
    pub off_when_halted: bool,
    /// Longest exposure that is believed, s.
    #[serde(default = "most_s")]
    pub most_s: f64,
}

impl Light {
    /// Longest exposure that is believed, ms; 600,000 at most.
    #[must_use]
    pub fn most_ms(&self) -> u32 {
        // In range since the profile was checked; a float cast saturates.
        (self.most_s * 1000.0).round() as u32
    }
}

/// Whose clock ends an exposure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TimedBy {
    /// The firmware's: on, dwell and off lie in its queue together.
    Controller,
    /// Ours.
    Host,
}

/// What the part hangs on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plate {
    /// Where its switch is. Up: it is homed away from the vat, with a part on it too.
    pub homes: Homes,
    /// How it comes off the film where the job's file says nothing.
    pub lift: Lift,
    /// How it goes back down where the job's file says nothing.
    pub retract: Retract,
    /// After the move, before the picture, ms.
    pub settle_ms: u32,
    /// After the light, before the lift, ms.
    pub rest_ms: u32,
    /// At the top of the lift, ms.
    pub top_ms: u32,
    /// Lines after which the printer says `{word}` alone on a line once the plate stands.
    #[serde(default = "done")]
    pub done: Macro,
    /// Fastest that it moves.
    pub max_mm_min: MmPerMin,
    /// How it gains speed.
    pub accel_mm_s2: MmPerS2,
    /// Homes it; before a print only.
    #[serde(default = "home")]
    pub home: Macro,
    /// How far it is raised at a pause or cancel.
    #[serde(default = "clear_mm")]
    pub clear_mm: Mm,
}

/// Where a plate's switch is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Homes {
    /// At the top: homing moves away from the vat.
    Up,
    /// At the bottom: homing drives whatever hangs on the plate onto the film.
    Down,
}

/// A lift: slow while the part comes off the film, then fast.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lift {
    /// The slow part's way.
    pub slow_mm: Mm,
    /// And its speed.
    pub slow_mm_min: MmPerMin,
    /// The fast part's way; 0: there is none.
    pub fast_mm: Mm,
    /// And its speed.
    pub fast_mm_min: MmPerMin,
}

/// A retract: fast through the free way, then slow through the resin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Retract {
    /// The slow part's way, the last before the layer's height; 0: there is none.
    pub slow_mm: Mm,
    /// And its speed.
    pub slow_mm_min: MmPerMin,
    /// The speed before.
    pub fast_mm_min: MmPerMin,
}

/// What is to be so before a print.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Before {
    /// In words for a person: `the vat is full and the cover closed`.
    pub what: String,
    /// Asks the firmware; with [`Before::wants`], or a person is asked.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub send: Option<String>,
    /// What some line of its answer must contain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wants: Option<String>,
}

/// Every firmware knows it.
fn dwell() -> Macro {
    Macro("G4 P{ms}".to_owned())
}

/// Above the first layers' exposure of slow resins on weak lights; far below what would
/// overheat a panel before a person sees it.
fn most_s() -> f64 {
    120.0
}

/// Marlin has no word of its own for it: M400 ends when the planner is empty.
fn done() -> Macro {
    Macro("M400\nM118 {word}".to_owned())
}

/// Marlin's; X and Y may not exist.
fn home() -> Macro {
    Macro("G28 Z".to_owned())
}

/// Clear of the film's pull and of the resin, so that a person sees the part.
fn clear_mm() -> Mm {
    Mm(20.0)
}
