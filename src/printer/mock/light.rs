//! The UV light of a resin printer: when it was on, how strong, and where the plate was.
//!
//! Takes each change of the light and of the plate's height, with the board's time; gives
//! one [`Pulse`] for each interval in which the light was on with one power. Nothing is
//! merged: off and on again at the same moment are two. Knows neither commands nor pins.

/// Pulses that are kept: some hundred layers a day for years. Those beyond are counted only.
pub(crate) const PULSES_MAX: usize = 1 << 20;

/// A plate that went farther than this has moved, mm: less is rounding.
const MOVED_MM: f64 = 0.001;

/// A moment of the light: when, and where the plate really was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moment {
    /// On the board's clock, ns.
    pub at_ns: u64,
    /// The plate over the film, mm. Within a move it is told by the move's time: its ramps
    /// are left out of account.
    pub z_mm: f64,
}

/// The light was on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pulse {
    /// When it came on, or got this power.
    pub begin: Moment,
    /// When it went off, or got another power; `None` while it is on.
    pub end: Option<Moment>,
    /// 1 to 255.
    pub power: u8,
}

impl Pulse {
    /// How long it lasted for the machine, s; `None` while it is on. `speed` is
    /// [`super::Config::speed`]: mechanics and pauses run so many times faster than the
    /// board's clock.
    pub fn machine_s(&self, speed: f64) -> Option<f64> {
        Some(self.lasts_s(self.end?.at_ns, speed))
    }

    fn lasts_s(&self, until_ns: u64, speed: f64) -> f64 {
        until_ns.saturating_sub(self.begin.at_ns) as f64 / 1e9 * speed
    }
}

/// The light and what it did.
#[derive(Debug)]
pub(crate) struct Light {
    /// How many times faster than life the machine is.
    speed: f64,
    /// Most pulses that are kept.
    most: usize,
    kept: Vec<Pulse>,
    /// The one that is on, kept or not, and where the plate was last seen during it.
    running: Option<(Pulse, f64)>,
    pulses: u64,
    /// Of those that have ended, s of the machine's time.
    total_s: f64,
    longest_s: f64,
    moved: u64,
}

/// What [`Light::sums`] gives; times in s of the machine's time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sums {
    pub(crate) on: bool,
    pub(crate) pulses: u64,
    pub(crate) not_kept: u64,
    pub(crate) total_s: f64,
    pub(crate) longest_s: f64,
    /// How often the plate moved in the light.
    pub(crate) moved: u64,
}

impl Light {
    /// Off. `most` pulses are kept, [`PULSES_MAX`] but for tests.
    pub(crate) fn new(speed: f64, most: usize) -> Self {
        Self {
            speed,
            most,
            kept: Vec::new(),
            running: None,
            pulses: 0,
            total_s: 0.0,
            longest_s: 0.0,
            moved: 0,
        }
    }

    /// The light has this power from now on, 0 for off; true when a pulse began.
    pub(crate) fn set(&mut self, now: Moment, power: u8) -> bool {
        if self.running.map_or(0, |(pulse, _)| pulse.power) == power {
            return false;
        }
        self.plate_at(now.z_mm);
        if let Some((pulse, _)) = self.running.take() {
            // The one that runs is the last one kept, if it is kept at all.
            if let Some(kept) = self.kept.last_mut().filter(|kept| kept.end.is_none()) {
                kept.end = Some(now);
            }
            let lasts_s = pulse.lasts_s(now.at_ns, self.speed);
            self.total_s += lasts_s;
            self.longest_s = self.longest_s.max(lasts_s);
        }
        if power == 0 {
            return false;
        }
        let pulse = Pulse { begin: now, end: None, power };
        self.running = Some((pulse, now.z_mm));
        self.pulses += 1;
        if self.kept.len() < self.most {
            self.kept.push(pulse);
        }
        true
    }

    /// The plate has come to this height.
    pub(crate) fn plate_at(&mut self, z_mm: f64) {
        if let Some((_, seen_mm)) = &mut self.running
            && (z_mm - *seen_mm).abs() > MOVED_MM
        {
            *seen_mm = z_mm;
            self.moved += 1;
        }
    }

    /// All pulses that are kept, in order; one that is on comes last.
    pub(crate) fn pulses(&self) -> &[Pulse] {
        &self.kept
    }

    /// The sums as of now, with the pulse that is on.
    pub(crate) fn sums(&self, now_ns: u64) -> Sums {
        let running_s = self.running.map_or(0.0, |(pulse, _)| pulse.lasts_s(now_ns, self.speed));
        Sums {
            on: self.running.is_some(),
            pulses: self.pulses,
            not_kept: self.pulses - self.kept.len() as u64,
            total_s: self.total_s + running_s,
            longest_s: self.longest_s.max(running_s),
            moved: self.moved,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(at_ns: u64, z_mm: f64) -> Moment {
        Moment { at_ns, z_mm }
    }

    /// Changes (time, height, power) give pulses (begin, end, power).
    fn check(changes: &[(u64, f64, u8)], expect: &[(u64, Option<u64>, u8)]) {
        let mut light = Light::new(1.0, PULSES_MAX);
        for &(at_ns, z_mm, power) in changes {
            light.set(at(at_ns, z_mm), power);
        }
        let found: Vec<_> =
            light.pulses().iter().map(|p| (p.begin.at_ns, p.end.map(|end| end.at_ns), p.power)).collect();
        assert_eq!(found, expect, "{changes:?}");
    }

    #[test]
    fn each_time_on_is_a_pulse() {
        check(&[(1, 0.0, 0)], &[]);
        check(&[(1, 0.0, 255), (5, 0.0, 0)], &[(1, Some(5), 255)]);
        check(&[(1, 0.0, 255), (3, 0.0, 255), (5, 0.0, 0), (6, 0.0, 0)], &[(1, Some(5), 255)]);
        check(&[(1, 0.0, 255), (3, 0.0, 128)], &[(1, Some(3), 255), (3, None, 128)]);
        check(&[(1, 0.0, 9), (1, 0.0, 0), (1, 0.0, 9)], &[(1, Some(1), 9), (1, None, 9)]);
    }

    #[test]
    fn sums_are_in_the_machines_time_and_count_the_one_that_is_on() {
        let mut light = Light::new(40.0, PULSES_MAX);
        light.set(at(0, 1.0), 255);
        light.set(at(100_000_000, 1.0), 0);
        light.set(at(200_000_000, 1.0), 255);
        let sums = light.sums(250_000_000);
        assert_eq!((sums.on, sums.pulses, sums.moved), (true, 2, 0));
        assert_eq!((sums.total_s, sums.longest_s), (6.0, 4.0));
        assert_eq!(light.pulses()[0].machine_s(40.0), Some(4.0));
        assert_eq!(light.pulses()[1].machine_s(40.0), None);
    }

    #[test]
    fn a_plate_that_moves_in_the_light_is_seen() {
        let mut light = Light::new(1.0, PULSES_MAX);
        light.plate_at(5.0);
        light.set(at(0, 5.0), 255);
        light.plate_at(5.0005);
        assert_eq!(light.sums(0).moved, 0);
        light.plate_at(6.0);
        light.plate_at(5.0);
        assert_eq!(light.sums(0).moved, 2);
        // Off in the middle of a move.
        light.set(at(9, 5.5), 0);
        light.plate_at(7.0);
        assert_eq!(light.sums(9).moved, 3);
    }

    #[test]
    fn what_is_beyond_the_bound_is_counted() {
        let mut light = Light::new(1.0, 2);
        for n in 0..4 {
            light.set(at(10 * n, 0.0), 255);
            light.set(at(10 * n + 5, 0.0), 0);
        }
        light.set(at(100, 0.0), 255);
        let sums = light.sums(105);
        assert_eq!((light.pulses().len(), sums.pulses, sums.not_kept), (2, 5, 3));
        assert!((sums.total_s - 25e-9).abs() < 1e-15 && sums.on);
        assert!(light.pulses().iter().all(|pulse| pulse.end.is_some()));
    }

    proptest::proptest! {
        #[test]
        fn pulses_never_overlap_and_make_up_the_sum(
            changes in proptest::collection::vec((0u64..1000, 0u8..3), 0..60),
        ) {
            let mut light = Light::new(1.0, PULSES_MAX);
            let mut now_ns = 0;
            for (later_ns, power) in changes {
                now_ns += later_ns;
                light.set(at(now_ns, 0.0), power);
            }
            light.set(at(now_ns, 0.0), 0);
            let mut free_ns = 0;
            let mut sum_ns = 0;
            for pulse in light.pulses() {
                let end_ns = pulse.end.unwrap().at_ns;
                assert!(pulse.begin.at_ns >= free_ns && end_ns >= pulse.begin.at_ns && pulse.power > 0);
                sum_ns += end_ns - pulse.begin.at_ns;
                free_ns = end_ns;
            }
            assert!((light.sums(now_ns).total_s - sum_ns as f64 / 1e9).abs() < 1e-12);
        }
    }
}
