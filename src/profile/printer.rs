//! A printer's profile: plain data, valid once it is built.
//!
//! What each key means, its unit and its range stand in [`super::keys`], the
//! one place from which checks and help are made. This file knows no file
//! system and no serial port.
use super::macros::Macro;
use crate::units::{Celsius, Mm, MmPerS, MmPerS2};
use serde::{Deserialize, Serialize};

/// Everything Outrigger knows of one model of printer. See [`super::load_printer`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// Short name, as on the command line: `prusa-mk3s`.
    pub name: String,
    /// The maker's name for it: `Original Prusa i3 MK3S`.
    pub title: String,
    /// How it prints.
    pub kind: Kind,
    /// The family of firmware on the other end of the cable.
    pub firmware: Firmware,
    /// Bore of the nozzle that it is sold with.
    pub nozzle_mm: Mm,
    /// Diameter of the filament.
    pub filament_mm: Mm,
    /// The volume that can be printed.
    pub bed: Bed,
    /// How the host talks to it.
    pub serial: Serial,
    /// Temperatures that must not be passed.
    pub limits: Limits,
    /// Speeds and accelerations, for estimates and for the mock printer.
    pub motion: Motion,
    /// Commands that the host sends around a job.
    pub macros: Macros,
}

/// How a printer prints.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Melted filament.
    Fdm,
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
