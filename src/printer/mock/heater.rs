//! A heater and what it heats: one time constant, in closed form.
//!
//! Takes a target and the time; gives the temperature at any later time, and
//! the time at which it gets somewhere, without ticking. Full power until the
//! target, then just what holds it; below the target it cools towards the
//! room. Knows no command and no clock.

/// Temperature of the room, °C.
pub(crate) const ROOM_C: f64 = 22.0;

/// Marlin's PWM range in temperature reports.
const FULL_POWER: f64 = 127.0;

/// Time to the temperature that a wait never reaches, e.g. below the room's:
/// Marlin gives up cooling after a minute without progress (MIN_COOLING_SLOPE_TIME).
const GIVE_UP_S: f64 = 60.0;

/// What a heater and its load are like.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Plant {
    /// Where full power would end, °C.
    pub(crate) full_power_c: f64,
    /// Time constant of heating and cooling, s.
    pub(crate) time_constant_s: f64,
}

/// A 40 W cartridge in a small block: 3.5 °C/s when cold, 210 °C after 70 s.
pub(crate) const NOZZLE: Plant = Plant { full_power_c: 450.0, time_constant_s: 120.0 };

/// A 24 V bed: 0.45 °C/s when cold, 60 °C after 100 s.
pub(crate) const BED: Plant = Plant { full_power_c: 130.0, time_constant_s: 240.0 };

/// A chamber of some 40 litres: 0.06 °C/s when cold.
pub(crate) const CHAMBER: Plant = Plant { full_power_c: 80.0, time_constant_s: 900.0 };

/// One heater. Times are simulated seconds and never run backwards.
#[derive(Clone, Debug)]
pub(crate) struct Heater {
    plant: Plant,
    target_c: f64,
    /// The temperature when the target was last set, and when that was.
    from_c: f64,
    from_s: f64,
}

impl Heater {
    pub(crate) fn new(plant: Plant) -> Self {
        Self { plant, target_c: 0.0, from_c: ROOM_C, from_s: 0.0 }
    }

    pub(crate) fn target_c(&self) -> f64 {
        self.target_c
    }

    /// Sets the target; 0 is off.
    pub(crate) fn set(&mut self, target_c: f64, now_s: f64) {
        self.from_c = self.temperature_c(now_s);
        self.from_s = now_s;
        self.target_c = target_c;
    }

    /// Whether the way to the target is up.
    pub(crate) fn heats(&self) -> bool {
        self.from_c < self.target_c
    }

    /// Where it drifts to on its present course.
    fn end_c(&self) -> f64 {
        if self.heats() { self.plant.full_power_c } else { ROOM_C }
    }

    pub(crate) fn temperature_c(&self, now_s: f64) -> f64 {
        let end = self.end_c();
        let fade = (-(now_s - self.from_s).max(0.0) / self.plant.time_constant_s).exp();
        let drift = end + (self.from_c - end) * fade;
        if self.heats() { drift.min(self.target_c) } else { drift.max(self.target_c) }
    }

    /// Power as Marlin reports it, 0 to 127.
    pub(crate) fn power(&self, now_s: f64) -> u32 {
        let now_c = self.temperature_c(now_s);
        if self.target_c <= 0.0 || now_c > self.target_c {
            return 0;
        }
        if now_c < self.target_c {
            return FULL_POWER as u32;
        }
        let hold = (self.target_c - ROOM_C) / (self.plant.full_power_c - ROOM_C);
        (FULL_POWER * hold.clamp(0.0, 1.0)).round() as u32
    }

    /// When it is within `window_c` of the target, in simulated seconds.
    pub(crate) fn reaches_s(&self, window_c: f64, now_s: f64) -> f64 {
        let now_c = self.temperature_c(now_s);
        if (now_c - self.target_c).abs() <= window_c {
            return now_s;
        }
        let end = self.end_c();
        let goal = if self.heats() { self.target_c - window_c } else { self.target_c + window_c };
        let ratio = (end - now_c) / (end - goal);
        if ratio.is_finite() && ratio > 1.0 {
            now_s + self.plant.time_constant_s * ratio.ln()
        } else {
            now_s + GIVE_UP_S
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_warms_up_holds_and_cools() {
        let mut nozzle = Heater::new(NOZZLE);
        assert_eq!(nozzle.temperature_c(1000.0), ROOM_C);
        nozzle.set(210.0, 1000.0);
        assert_eq!(nozzle.power(1001.0), 127);
        let there = nozzle.reaches_s(1.0, 1000.0);
        assert!((60.0..80.0).contains(&(there - 1000.0)), "{there}");
        assert!((nozzle.temperature_c(there) - 209.0).abs() < 0.01);
        assert_eq!(nozzle.temperature_c(there + 60.0), 210.0);
        assert_eq!(nozzle.power(there + 60.0), 56);
        assert_eq!(nozzle.reaches_s(1.0, there + 60.0), there + 60.0);
        nozzle.set(0.0, 2000.0);
        assert_eq!(nozzle.power(2000.0), 0);
        let cooler = nozzle.temperature_c(2060.0);
        assert!(cooler < 150.0 && cooler > 100.0, "{cooler}");
        assert!(nozzle.temperature_c(1e6) - ROOM_C < 0.001);
        // A lower target that is still hot is waited for on the way down.
        nozzle.set(200.0, 3000.0);
        nozzle.set(100.0, 3600.0);
        let there = nozzle.reaches_s(1.0, 3600.0);
        assert!((nozzle.temperature_c(there) - 101.0).abs() < 0.01);
    }

    #[test]
    fn what_cannot_be_reached_is_given_up() {
        let mut bed = Heater::new(BED);
        bed.set(10.0, 0.0);
        assert_eq!(bed.reaches_s(1.0, 0.0), GIVE_UP_S);
        bed.set(500.0, 100.0);
        assert_eq!(bed.reaches_s(1.0, 100.0), 100.0 + GIVE_UP_S);
        assert!(bed.temperature_c(1e9) <= 130.0);
    }
}
