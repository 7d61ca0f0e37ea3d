//! The plate of a resin printer that cures from below, and the part that hangs on it.
//!
//! The plate rises layer by layer, so its height is that of the layer just cured, and the
//! highest that was cured is where the part's lower end touches the film. Takes heights,
//! says which ways are crashes. Knows neither commands nor time.
//!
//! # What counts as a crash
//! - A way down that ends more than [`PRESS_MM`] below the last layer presses the part into
//!   the film.
//! - A way that ends more than [`SLACK_MM`] beyond the travel, below or above.
//! - Homing down with a part on the plate. Homing up is none.

/// So far below the last layer the film gives way, mm.
const PRESS_MM: f64 = 0.02;

/// So far beyond its travel the plate still gets, mm.
const SLACK_MM: f64 = 0.01;

/// The plate and its part.
#[derive(Clone, Debug)]
pub(crate) struct Plate {
    homes_up: bool,
    z_max_mm: f64,
    cured_top_mm: Option<f64>,
    /// How far the part was pressed into the film at most, mm.
    pub(crate) pressed_in_mm: f64,
}

impl Plate {
    /// Travels from 0 to `z_max_mm`, with nothing on it.
    pub(crate) fn new(homes_up: bool, z_max_mm: f64) -> Self {
        Self { homes_up, z_max_mm, cured_top_mm: None, pressed_in_mm: 0.0 }
    }

    /// The light came on with the plate here.
    pub(crate) fn cure(&mut self, z_mm: f64) {
        self.cured_top_mm = Some(self.cured_top_mm.map_or(z_mm, |top_mm| top_mm.max(z_mm)));
    }

    /// The plate went from here to there: whether that was a crash.
    pub(crate) fn moved(&mut self, from_mm: f64, to_mm: f64) -> bool {
        let down = to_mm < from_mm;
        if let Some(top_mm) = self.cured_top_mm.filter(|_| down) {
            self.pressed_in_mm = self.pressed_in_mm.max(top_mm - to_mm);
        }
        let presses = down && self.cured_top_mm.is_some_and(|top_mm| to_mm < top_mm - PRESS_MM);
        let beyond = down && to_mm < -SLACK_MM || to_mm > from_mm && to_mm > self.z_max_mm + SLACK_MM;
        presses || beyond
    }

    /// The plate goes to its switch: where that is, and whether it was a crash.
    pub(crate) fn home(&self) -> (f64, bool) {
        if self.homes_up { (self.z_max_mm, false) } else { (0.0, self.cured_top_mm.is_some()) }
    }

    /// Somebody took the part off.
    pub(crate) fn remove_part(&mut self) {
        self.cured_top_mm = None;
    }

    /// The height of the last layer, mm; 0 when the plate is free.
    pub(crate) fn cured_top_mm(&self) -> f64 {
        self.cured_top_mm.unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With these layers cured, on 100 mm of travel: whether a way is a crash.
    fn check(cured_mm: &[f64], (from_mm, to_mm): (f64, f64), crash: bool) {
        let mut plate = Plate::new(true, 100.0);
        for &z_mm in cured_mm {
            plate.cure(z_mm);
        }
        assert_eq!(plate.moved(from_mm, to_mm), crash, "{cured_mm:?} {from_mm} {to_mm}");
    }

    #[test]
    fn a_part_pressed_into_the_film_is_a_crash() {
        let layers = [0.05, 0.1, 0.15];
        check(&layers, (5.0, 0.2), false);
        check(&layers, (5.0, 0.15), false);
        check(&layers, (5.0, 0.131), false);
        check(&layers, (5.0, 0.12), true);
        // The highest counts, in whatever order they came.
        check(&[10.0, 0.05], (20.0, 9.0), true);
        // Up again, out of the film.
        check(&layers, (0.0, 0.1), false);
        check(&[], (5.0, 0.0), false);
    }

    #[test]
    fn the_travel_ends_at_both_ends() {
        check(&[], (5.0, -0.005), false);
        check(&[], (5.0, -0.02), true);
        check(&[], (5.0, 100.005), false);
        check(&[], (5.0, 100.02), true);
        check(&[], (100.05, 100.03), false);
    }

    #[test]
    fn homing_up_is_safe_and_down_only_without_a_part() {
        for (homes_up, expect) in [(true, (100.0, false)), (false, (0.0, true))] {
            let mut plate = Plate::new(homes_up, 100.0);
            assert!(!plate.home().1);
            plate.cure(3.0);
            assert_eq!((plate.home(), plate.cured_top_mm()), (expect, 3.0));
            plate.remove_part();
            assert!(!plate.home().1 && plate.cured_top_mm() == 0.0);
        }
    }

    proptest::proptest! {
        #[test]
        fn lifting_is_never_a_crash(cured in 0.0f64..100.0, from in -1.0f64..100.0, by in 0.0f64..100.0) {
            check(&[cured], (from, (from + by).min(100.0).max(from)), false);
        }
    }
}
