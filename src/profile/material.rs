//! A material's profile: what a filament or a resin bears.
//!
//! Plain data, valid once it is built; [`super::keys`] documents each key.
use crate::units::Celsius;
use serde::{Deserialize, Serialize};

/// What Outrigger knows of one material. See [`super::load_material`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Material {
    /// Short name, as on the command line: `petg`.
    pub name: String,
    /// What it is called: `PETG (glycol-modified PET)`.
    pub title: String,
    /// Density in g/cm³; of a resin when cured.
    pub density_g_cm3: f64,
    /// What prints with nothing under it.
    pub self_support: SelfSupport,
    /// How it comes, and what only this kind has. Keys of the other kind are
    /// refused before this is built.
    #[serde(flatten)]
    pub kind: MaterialKind,
}

/// What prints with nothing under it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SelfSupport {
    /// Steepest overhang, degrees from the vertical: 0 is a wall, 90 a ceiling.
    pub angle_deg: f64,
    /// Longest span between two supported ends, mm.
    pub bridge_mm: f64,
    /// Smallest island that shows in the print, mm².
    pub min_area_mm2: f64,
}

/// How a material comes, with the keys that only this kind has.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum MaterialKind {
    /// On a spool; melted.
    Filament(Filament),
    /// In a bottle; cured by light.
    Resin,
}

/// The ranges in which a filament prints.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Filament {
    /// Temperature of the nozzle.
    pub nozzle_c: TemperatureRange,
    /// Temperature of the bed.
    pub bed_c: TemperatureRange,
    /// Part cooling fan after the first layers, per cent.
    pub fan_percent: FanRange,
}

impl MaterialKind {
    /// The word that stands for it in a file.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            MaterialKind::Filament(_) => "filament",
            MaterialKind::Resin => "resin",
        }
    }
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
