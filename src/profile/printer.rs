//! A printer's profile: plain data, valid once it is built.
//!
//! What each key means, its unit and its range stand in [`super::keys`], the
//! one place from which checks and help are made. This file knows no file
//! system and no serial port.
use super::macros::Macro;
use super::msla::Msla;
use crate::units::{Celsius, Mm, MmPerS, MmPerS2};
use serde::{Deserialize, Serialize};

/// Everything Outrigger knows of one model of printer. See [`super::load_printer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Profile {
    /// Short name, as on the command line: `prusa-mk3s`.
    pub name: String,
    /// The maker's name for it: `Original Prusa i3 MK3S`.
    pub title: String,
    /// The family of firmware on the other end of the cable.
    pub firmware: Firmware,
    /// How long a printer whose host died waits for another before it is made safe, s.
    #[serde(default = "orphan_timeout_s")]
    pub orphan_timeout_s: u32,
    /// The volume that can be printed.
    pub bed: Bed,
    /// How the host talks to it.
    pub serial: Serial,
    /// Commands that the host sends around a job.
    pub macros: Macros,
    /// The way back into a job after the board was reset or lost its power; `None`
    /// where nobody has said that there is a safe one. A printer of filament's: of one
    /// of resin, [`super::msla::Plate`] says enough.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resume: Option<Resume>,
    /// How it prints, and what only this kind has. Keys of the other kind are refused
    /// before this is built.
    #[serde(flatten)]
    pub kind: Kind,
}

impl Profile {
    /// What only a printer of filament has, if it is one.
    #[must_use]
    pub fn fdm(&self) -> Option<&Fdm> {
        match &self.kind {
            Kind::Fdm(fdm) => Some(fdm),
            Kind::Msla(_) => None,
        }
    }

    /// What only a printer of resin has, if it is one.
    #[must_use]
    pub fn msla(&self) -> Option<&Msla> {
        match &self.kind {
            Kind::Fdm(_) => None,
            Kind::Msla(msla) => Some(msla),
        }
    }

    /// [`Profile::fdm`], for who can do nothing without.
    ///
    /// # Errors
    /// It is a printer of resin.
    pub fn want_fdm(&self) -> Result<&Fdm, NotFdm> {
        self.fdm().ok_or_else(|| NotFdm { name: self.name.clone() })
    }
}

/// G-code was to be printed by, or looked at for, a printer that cures pictures.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name} is a resin printer: its jobs are pictures (SL1, NanoDLP, GOO), not G-code")]
pub struct NotFdm {
    /// The profile's name.
    pub name: String,
}

/// Long enough for a person to start the host again, and short for a nozzle that
/// stands hot on a part.
fn orphan_timeout_s() -> u32 {
    300
}

/// How a printer prints, with the keys that only this kind has.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Kind {
    /// Melted filament.
    Fdm(Box<Fdm>),
    /// Resin, cured by the light behind an LCD.
    Msla(Box<Msla>),
}

impl Kind {
    /// The word that stands for it in a file.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Kind::Fdm(_) => "fdm",
            Kind::Msla(_) => "msla",
        }
    }
}

/// What only a printer of filament has.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fdm {
    /// Bore of the nozzle that it is sold with.
    pub nozzle_mm: Mm,
    /// Diameter of the filament.
    pub filament_mm: Mm,
    /// Temperatures that must not be passed.
    pub limits: Limits,
    /// Speeds and accelerations, for estimates and for the mock printer.
    pub motion: Motion,
}

/// Families of firmware, as far as their serial protocols differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Firmware {
    /// Marlin and makers' builds of it.
    Marlin,
    /// Prusa's own descendants of Marlin (8-bit and Buddy).
    Prusa,
    /// Klipper, through its pseudo-terminal.
    Klipper,
    /// Repetier-Firmware.
    Repetier,
    /// RepRapFirmware (Duet).
    RepRapFirmware,
}

/// The printable volume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bed {
    /// Outline of the bed.
    pub shape: BedShape,
    /// Where X 0, Y 0 is.
    pub origin: Origin,
    /// Width; of a circle, the diameter.
    pub x_mm: Mm,
    /// Depth; of a circle, the diameter.
    pub y_mm: Mm,
    /// Height.
    pub z_mm: Mm,
}

/// Outline of a bed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BedShape {
    /// `x_mm` by `y_mm`.
    Rectangle,
    /// A delta's disc.
    Circle,
}

/// Where X 0, Y 0 lies on the bed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Origin {
    /// The front left corner.
    Corner,
    /// The middle.
    Centre,
}

/// The serial link.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Serial {
    /// Bits per second; over native USB any value serves.
    pub baud: u32,
    /// How much may be on its way unacknowledged.
    pub window: Window,
    /// Longest framed line, in bytes without its line end, that the firmware
    /// takes whole; `None` where it has no limit that matters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_line: Option<u32>,
    /// True where raising DTR (opening the port) resets the board.
    pub dtr_reset: bool,
    /// What stops a board that does not hear M112; see [`Serial::hard_stop`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hard_stop: Option<HardStop>,
}

impl Serial {
    /// What stops a board that does not hear M112. A profile that does not say so gets
    /// what `dtr_reset` makes possible.
    pub fn hard_stop(&self) -> HardStop {
        self.hard_stop.unwrap_or(if self.dtr_reset { HardStop::Dtr } else { HardStop::None })
    }
}

/// What stops a board that does not hear M112.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HardStop {
    /// Lowering and raising DTR: it resets the board.
    Dtr,
    /// Nothing that a host could do.
    None,
}

/// How much may be on its way unacknowledged.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Window {
    /// This many bytes: no more than the receive buffer holds.
    Bytes(u32),
    /// This many lines.
    Lines(u32),
}

/// Temperatures that must not be passed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Limits {
    /// Hottest nozzle of the stock hot end.
    pub nozzle_c: Celsius,
    /// Hottest bed; 0 where the bed has no heater.
    pub bed_c: Celsius,
}

/// One value for each axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axes<T> {
    /// X.
    pub x: T,
    /// Y.
    pub y: T,
    /// Z.
    pub z: T,
    /// The extruder.
    pub e: T,
}

/// Speeds and accelerations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motion {
    /// Acceleration of printing moves (M204 P).
    pub print_mm_s2: MmPerS2,
    /// Acceleration of travel moves (M204 T).
    pub travel_mm_s2: MmPerS2,
    /// Acceleration of retractions (M204 R).
    pub retract_mm_s2: MmPerS2,
    /// What a corner costs.
    pub cornering: Cornering,
    /// Fastest speed of each axis (M203).
    pub max_feed_mm_s: Axes<MmPerS>,
    /// Highest acceleration of each axis (M201).
    pub max_accel_mm_s2: Axes<MmPerS2>,
}

/// The firmware's rule for the speed through a corner.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Cornering {
    /// Classic jerk: the step in X or Y speed that is taken at once (M205 X Y).
    JerkMmS(MmPerS),
    /// Junction deviation (M205 J).
    JunctionMm(Mm),
    /// Klipper's speed through a corner of 90°.
    SquareCornerMmS(MmPerS),
}

/// Commands that the host sends around a job, on top of the file's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Macros {
    /// Before the file's first line.
    #[serde(default)]
    pub start: Macro,
    /// After the file's last line.
    #[serde(default)]
    pub end: Macro,
    /// After the last line before a pause.
    #[serde(default)]
    pub pause: Macro,
    /// When a job is given up, from whatever state it is in.
    pub cancel: Macro,
}

/// The way back into a job after the board was reset or lost its power.
///
/// The order of the steps is the host's; here is what this machine needs in them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Resume {
    /// X and Y can be homed without Z. Not so on deltas, polar machines and SCARAs.
    pub homes_xy_alone: bool,
    /// Homing X and Y cannot touch a part that stands on the bed once Z was raised.
    pub homing_clears_part: bool,
    /// How far Z is raised before anything moves in X or Y.
    #[serde(default = "raise_mm")]
    pub raise_mm: Mm,
    /// The nozzle that sticks to the part comes off it at this temperature, and does
    /// not drip yet.
    #[serde(default = "soften_c")]
    pub soften_c: Celsius,
    /// Moves that the firmware plans ahead: acknowledged, and lost with its power.
    #[serde(default = "planner_moves")]
    pub planner_moves: u32,
    /// Commands that the firmware queues besides.
    #[serde(default = "queue_commands")]
    pub queue_commands: u32,
    /// Tells the firmware the height, `{z}`, without a move.
    #[serde(default = "z_set")]
    pub z_set: Macro,
    /// Homes X and Y without a move of Z.
    #[serde(default = "home")]
    pub home: Macro,
    /// Turns on the bed levelling that the firmware kept.
    #[serde(default)]
    pub levelling: Macro,
    /// Presses filament out where there is no part, at the raised height.
    #[serde(default)]
    pub prime: Macro,
}

/// Clear of a part whose edge has curled up, and of a Z that sagged.
fn raise_mm() -> Mm {
    Mm(10.0)
}

/// Above the glass transition of what is printed below 300 °C, below where it flows.
fn soften_c() -> Celsius {
    Celsius(150.0)
}

/// Marlin's BLOCK_BUFFER_SIZE.
fn planner_moves() -> u32 {
    16
}

/// Marlin's BUFSIZE.
fn queue_commands() -> u32 {
    4
}

/// Every firmware knows it.
fn z_set() -> Macro {
    Macro("G92 Z{z}".to_owned())
}

/// R0: without the raise that Marlin makes before homing.
fn home() -> Macro {
    Macro("G28 R0 X Y".to_owned())
}
