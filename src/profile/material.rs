//! A material's profile: the ranges in which a filament prints.
//!
//! Plain data, valid once it is built; [`super::keys`] documents each key.
use crate::units::Celsius;
use serde::{Deserialize, Serialize};

/// What Outrigger knows of one kind of filament. See [`super::load_material`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Short name, as on the command line: `petg`.
    pub name: String,
    /// What it is called: `PETG (glycol-modified PET)`.
    pub title: String,
    /// How it comes.
    pub kind: MaterialKind,
    /// Density in g/cm³.
    pub density_g_cm3: f64,
    /// Temperature of the nozzle.
    pub nozzle_c: TemperatureRange,
    /// Temperature of the bed.
    pub bed_c: TemperatureRange,
    /// Part cooling fan after the first layers, per cent.
    pub fan_percent: FanRange,
}

/// How a material comes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MaterialKind {
    /// On a spool.
    Filament,
}

/// `min <= usual <= max`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TemperatureRange {
    /// Coolest.
    pub min: Celsius,
    /// Where to start.
    pub usual: Celsius,
    /// Hottest.
    pub max: Celsius,
}

/// `min <= max`, in per cent of full speed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FanRange {
    /// Least.
    pub min: f64,
    /// Most.
    pub max: f64,
}
