//! The machine's body: where the nozzle really is, and what stands on the bed.
//!
//! Takes the moves that ran, homing, sagging and resets; counts what must not
//! happen. What the firmware believes is another matter: G92 does not reach
//! this, a reset does not move it. Of a resin printer it has the [`Plate`] instead, whose
//! rules are its own. Knows neither commands nor time.
//!
//! # What counts as a crash
//! - After a reset or a power cut with a part on the bed the nozzle stands on the part,
//!   and nobody knows where. Until Z has gone up by [`CLEAR_MM`] over the highest that
//!   was printed, every move in X or Y is one.
//! - At any time: a move whose way leads [`COLLIDE_MM`] or more below what was printed
//!   there.
//! - Homing Z, or probing, with a part on the bed, wherever the nozzle is.
use super::plate::Plate;
use super::stats::Digest;

/// So far above the part the nozzle is clear of it, mm: more than a curled edge.
const CLEAR_MM: f64 = 0.5;

/// So far below what was printed the nozzle drives into it, mm: beads overlap, first
/// layers are squeezed, and a Z that sagged by tenths is felt and survived.
const COLLIDE_MM: f64 = 0.5;

/// A nozzle that stands on the part sticks to it below this, °C.
const STUCK_C: f64 = 110.0;

/// Heights are kept in squares of this side, mm, and so many in a row, from this corner
/// on; what lies beyond counts with the outermost.
const SQUARE_MM: f64 = 5.0;
const SQUARES: usize = 120;
const CORNER_MM: f64 = -200.0;

/// Most squares that are looked at along one move: a longer one is looked at in places.
const LOOKS_MAX: usize = 256;

/// What stands on the bed.
#[derive(Clone, Debug)]
struct Part {
    top_mm: f64,
    /// Heights by square; 0 where there is nothing.
    heights_mm: Vec<f32>,
}

/// The machine's body.
#[derive(Clone, Debug, Default)]
pub(crate) struct Body {
    /// Where the nozzle is, mm above the bed and from the corner.
    pub(crate) at_mm: [f64; 3],
    part: Option<Box<Part>>,
    /// Since a reset with a part on the bed, until Z was raised.
    lost: bool,
    /// X or Y has moved since that reset.
    went_aside: bool,
    /// Of a resin printer.
    plate: Option<Plate>,
    pub(crate) crashes: u64,
    pub(crate) moved_cold: u64,
    pub(crate) first_xy_after_reset_z_mm: Option<f64>,
    pub(crate) deposits: Digest,
}

impl Body {
    /// With a bed, or with the plate of a resin printer.
    pub(crate) fn new(plate: Option<Plate>) -> Self {
        Self { plate, ..Self::default() }
    }

    /// The light came on: the layer at this height of the plate is cured.
    pub(crate) fn cure(&mut self, z_mm: f64) {
        if let Some(plate) = &mut self.plate {
            plate.cure(z_mm);
        }
    }

    /// How far a part on a resin printer's plate was pressed into the film at most, mm.
    pub(crate) fn pressed_in_mm(&self) -> f64 {
        self.plate.as_ref().map_or(0.0, |plate| plate.pressed_in_mm)
    }

    /// A move ran, or a piece of one: X, Y, Z and filament, with the nozzle this hot.
    pub(crate) fn moved(&mut self, by_mm: [f64; 4], nozzle_c: f64) {
        let from = self.at_mm;
        let to = [0, 1, 2].map(|axis| from[axis] + by_mm[axis]);
        if let Some(plate) = &mut self.plate {
            self.crashes += u64::from(plate.moved(from[2], to[2]));
            self.at_mm = to;
            return;
        }
        let aside = by_mm[0] != 0.0 || by_mm[1] != 0.0;
        if self.lost {
            self.moved_lost(from, by_mm, aside, nozzle_c);
        }
        self.at_mm = to;
        if self.drives_in(from, to) {
            self.crashes += 1;
        }
        if by_mm[3] > 0.0 && aside {
            self.deposit(from, to, by_mm[3]);
        }
    }

    fn moved_lost(&mut self, from: [f64; 3], by_mm: [f64; 4], aside: bool, nozzle_c: f64) {
        let top_mm = self.part_top_mm();
        let moves = aside || by_mm[2] != 0.0;
        if moves && nozzle_c < STUCK_C && from[2] <= top_mm + CLEAR_MM / 2.0 {
            self.moved_cold += 1;
        }
        if !aside {
            return;
        }
        if !std::mem::replace(&mut self.went_aside, true) {
            self.first_xy_after_reset_z_mm = Some(from[2]);
        }
        if from[2] < top_mm + CLEAR_MM {
            self.crashes += 1;
        } else {
            self.lost = false;
        }
    }

    /// An axis goes to its switch, at 0.
    pub(crate) fn home(&mut self, axis: usize, nozzle_c: f64) {
        if let (Some(plate), 2) = (&self.plate, axis) {
            let (at_mm, crash) = plate.home();
            self.crashes += u64::from(crash);
            self.at_mm[2] = at_mm;
            return;
        }
        if axis == 2 {
            self.probe();
            self.at_mm[2] = 0.0;
            return;
        }
        let mut by_mm = [0.0; 4];
        by_mm[axis] = -self.at_mm[axis];
        // The carriage finds its switch, and goes aside, even if it stands there.
        if by_mm[axis] == 0.0 {
            by_mm[axis] = f64::MIN_POSITIVE;
        }
        self.moved(by_mm, nozzle_c);
        self.at_mm[axis] = 0.0;
    }

    /// The nozzle or a probe goes down to the bed.
    pub(crate) fn probe(&mut self) {
        self.crashes += u64::from(self.part.is_some());
    }

    /// The motors were off: the nozzle came down by so much.
    pub(crate) fn sag(&mut self, by_mm: f64) {
        self.at_mm[2] -= by_mm;
    }

    /// The board forgot where the nozzle is.
    pub(crate) fn lose(&mut self) {
        self.lost = self.part.is_some();
        self.went_aside = false;
        self.first_xy_after_reset_z_mm = None;
    }

    /// Somebody took the part off the bed.
    pub(crate) fn remove_part(&mut self) {
        self.part = None;
        self.lost = false;
        if let Some(plate) = &mut self.plate {
            plate.remove_part();
        }
    }

    /// The highest of what was printed, mm; 0 when the bed is free.
    pub(crate) fn part_top_mm(&self) -> f64 {
        let cured_mm = self.plate.as_ref().map_or(0.0, Plate::cured_top_mm);
        self.part.as_ref().map_or(cured_mm, |part| part.top_mm)
    }

    /// Whether a way leads through what was printed.
    fn drives_in(&self, from: [f64; 3], to: [f64; 3]) -> bool {
        let Some(part) = &self.part else {
            return false;
        };
        let lowest_mm = from[2].min(to[2]);
        if lowest_mm > part.top_mm - COLLIDE_MM || (from[0] == to[0] && from[1] == to[1] && to[2] >= from[2])
        {
            return false;
        }
        looks(from, to).any(|at| {
            f64::from(part.heights_mm[square(at)]) > 0.0
                && at[2] <= f64::from(part.heights_mm[square(at)]) - COLLIDE_MM
        })
    }

    fn deposit(&mut self, from: [f64; 3], to: [f64; 3], filament_mm: f64) {
        let empty = || Box::new(Part { top_mm: 0.0, heights_mm: vec![0.0; SQUARES * SQUARES] });
        let part = self.part.get_or_insert_with(empty);
        part.top_mm = part.top_mm.max(from[2]).max(to[2]);
        for at in looks(from, to) {
            let height = &mut part.heights_mm[square(at)];
            *height = height.max(at[2] as f32);
        }
        // To a thousandth: sums of the same moves may differ in their last bits.
        for value in from.into_iter().chain(to).chain([filament_mm]) {
            self.deposits.mix(&((value * 1000.0).round() as i64).to_le_bytes());
        }
        self.deposits.count();
    }
}

/// Points along a straight way, both ends among them, one a square or nearer.
fn looks(from: [f64; 3], to: [f64; 3]) -> impl Iterator<Item = [f64; 3]> {
    let far = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()) / SQUARE_MM;
    let steps = if far.is_finite() { (far.ceil() as usize).clamp(1, LOOKS_MAX) } else { 1 };
    (0..=steps).map(move |step| {
        let part = step as f64 / steps as f64;
        [0, 1, 2].map(|axis| from[axis] + (to[axis] - from[axis]) * part)
    })
}

fn square(at: [f64; 3]) -> usize {
    let index = |mm: f64| (((mm - CORNER_MM) / SQUARE_MM).max(0.0) as usize).min(SQUARES - 1);
    index(at[1]) * SQUARES + index(at[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOT: f64 = 210.0;

    /// A tower of 20 mm at 100, 100, printed layer by layer; the nozzle stands on it.
    fn tower() -> Body {
        let mut body = Body::default();
        body.moved([100.0, 100.0, 0.0, 0.0], HOT);
        for _ in 0..100 {
            body.moved([0.0, 0.0, 0.2, 0.0], HOT);
            body.moved([4.0, 0.0, 0.0, 1.0], HOT);
            body.moved([-4.0, 0.0, 0.0, 1.0], HOT);
        }
        assert_eq!((body.crashes, body.part_top_mm().round()), (0, 20.0));
        body
    }

    /// After a power cut with that sag, these steps make so many crashes, cold moves.
    fn check(sag_mm: f64, steps: &[([f64; 4], f64)], expect: (u64, u64)) {
        let mut body = tower();
        body.sag(sag_mm);
        body.lose();
        for (by_mm, nozzle_c) in steps {
            body.moved(*by_mm, *nozzle_c);
        }
        assert_eq!((body.crashes, body.moved_cold), expect, "{sag_mm} {steps:?}");
    }

    #[test]
    fn after_a_power_cut_up_comes_before_aside() {
        let (up, down, aside) = ([0.0, 0.0, 10.0, 0.0], [0.0, 0.0, -10.0, 0.0], [-50.0, 0.0, 0.0, 0.0]);
        let back = [50.0, 0.0, 0.0, 0.0];
        check(0.3, &[(up, 150.0), (aside, 150.0), (back, HOT), (down, HOT)], (0, 0));
        check(0.3, &[(aside, 150.0)], (1, 0));
        check(0.0, &[([0.0, 0.0, 0.4, 0.0], 150.0), (aside, 150.0)], (1, 0));
        check(0.3, &[(up, 40.0)], (0, 1));
        // A raise that does not make good what sagged.
        check(10.0, &[(up, 150.0), (aside, 150.0)], (1, 0));
        // Down beside the tower is no crash, down onto it too deep is.
        check(0.0, &[(up, 150.0), (aside, 150.0), ([0.0, 0.0, -25.0, 0.0], HOT)], (0, 0));
        check(0.0, &[(up, 150.0), (aside, 150.0), (back, HOT), ([0.0, 0.0, -12.0, 0.0], HOT)], (1, 0));
    }

    #[test]
    fn homing_z_over_a_part_is_a_crash_and_without_it_none() {
        let mut body = tower();
        body.moved([0.0, 0.0, 10.0, 0.0], HOT);
        body.home(0, HOT);
        body.home(1, HOT);
        assert_eq!((body.crashes, body.at_mm[0]), (0, 0.0));
        body.home(2, HOT);
        assert_eq!(body.crashes, 1);
        body.remove_part();
        body.home(2, HOT);
        assert_eq!((body.crashes, body.part_top_mm()), (1, 0.0));
    }

    #[test]
    fn homing_counts_as_going_aside_even_at_the_switch() {
        let mut body = Body::default();
        body.moved([0.0, 0.0, 0.2, 0.0], HOT);
        body.moved([10.0, 0.0, 0.0, 1.0], HOT);
        body.moved([-10.0, 0.0, 0.0, 1.0], HOT);
        body.lose();
        body.home(0, HOT);
        assert_eq!((body.crashes, body.first_xy_after_reset_z_mm), (1, Some(0.2)));
    }

    #[test]
    fn objects_one_by_one_are_no_crash() {
        let mut body = tower();
        body.moved([0.0, 0.0, 5.0, 0.0], HOT);
        body.moved([50.0, 0.0, 0.0, 0.0], HOT);
        body.moved([0.0, 0.0, -24.8, 0.0], HOT);
        body.moved([10.0, 0.0, 0.0, 1.0], HOT);
        assert_eq!(body.crashes, 0);
        body.moved([-60.0, 0.0, 0.0, 0.0], HOT);
        assert_eq!(body.crashes, 1, "through the tower");
    }

    proptest::proptest! {
        #[test]
        fn any_way_is_looked_at_in_bounded_time(x in -1e9f64..1e9, y in -1e9f64..1e9, z in -1e3f64..1e3) {
            let mut body = tower();
            body.moved([x, y, z, 1.0], HOT);
            body.moved([-x, -y, -z, 1.0], HOT);
        }
    }
}
