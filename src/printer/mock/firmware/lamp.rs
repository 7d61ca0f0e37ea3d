//! The light of a resin printer: which pin it hangs on, and what commands make of it.
//!
//! A fan changes when its command is executed, whatever moves; spindle and laser wait for
//! the moves first. Gives the log of pulses; knows no protocol.
use super::super::config::LightPin;
use super::super::light::{Moment, Pulse};
use super::super::words::Command;
use super::Firmware;
use super::wait::{After, Wait};

impl Firmware {
    /// Every interval in which the light was on, in order, at most 2^20 of them; one that
    /// is on comes last, with its end open. Empty on a machine without a light.
    pub fn light(&self) -> &[Pulse] {
        self.light.pulses()
    }

    /// Whether M3, M4 and M5 are there.
    pub(super) fn has_cutter(&self) -> bool {
        self.config.machine.resin.is_some_and(|resin| resin.light == LightPin::Cutter)
    }

    /// M3, M4 and M5: without S at full power.
    pub(super) fn cut(&self, command: &Command<'_>) -> Wait {
        let power = if command.code == 5 { 0.0 } else { command.value(b'S').unwrap_or(255.0) };
        Wait::Drain(After::Cutter { power: power.clamp(0.0, 255.0) as u8 })
    }

    /// Fan or cutter may have changed: so may the light.
    pub(super) fn look_at_light(&mut self) {
        let Some(resin) = self.config.machine.resin else {
            return;
        };
        let power = match resin.light {
            LightPin::Fan => self.fan,
            LightPin::Cutter => self.cutter,
        };
        let z_mm = self.body.at_mm[2] + self.planner.ran_mm(self.now_ns)[2];
        if self.light.set(Moment { at_ns: self.now_ns, z_mm }, power) {
            self.body.cure(z_mm);
        }
    }
}
