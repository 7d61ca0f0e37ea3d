//! The machine's state that the lines sent so far add up to.
//!
//! Takes every line that the printer accepts, ours too; gives position, modes, fans,
//! temperatures, and the lines that bring another state back to this one. Pure.

/// What `G90` and `G91` do to E.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EModes {
    /// E goes along (Marlin).
    #[default]
    WithAxes,
    /// E has `M82` and `M83` alone (Prusa's Marlin, Klipper, Repetier, RepRapFirmware).
    Alone,
}
