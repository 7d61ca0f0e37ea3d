//! The motion planner: as many moves ahead as its ring holds (15 of 16), trapezoids with look-ahead.
//!
//! Takes moves as lengths per axis and a speed; gives the times at which they
//! end. Every move speeds up and slows down at its acceleration, and starts
//! at the speed that the corner before it and the moves behind it allow:
//!
//! ```text
//!   speed
//!     ^      ______________
//!     |     /              \
//!     |____/ entry          \____ exit = entry of the next
//!     +---------------------------> time
//! ```
//!
//! Two things of Marlin are left out, because they would hide from a test
//! what a slow sender does: the wait of 100 ms for company before the first
//! move, and the slowing down while the queue is short (SLOWDOWN). Knows no
//! command; its times are those of the caller's clock.
use std::collections::VecDeque;

/// Marlin's own choice of BLOCK_BUFFER_SIZE: a ring of 16 that holds one move less.
pub(crate) const BLOCKS: usize = 16;

/// No move takes longer than this: coordinates are the host's, and a clock
/// that overflows helps nobody. A fortnight, in seconds.
const MOVE_S_MAX: f64 = 14.0 * 86_400.0;

/// X, Y, Z and E.
pub(crate) type Axes = [f64; 4];

/// The rule for the speed through a corner.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Cornering {
    /// Classic jerk of every axis, mm/s.
    JerkMmS(f64),
    /// Junction deviation, mm.
    JunctionMm(f64),
}

/// Speeds and accelerations, as M201, M203, M204 and M205 set them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dynamics {
    /// Fastest speed of each axis, mm/s.
    pub max_feed_mm_s: Axes,
    /// Highest acceleration of each axis, mm/s².
    pub max_accel_mm_s2: Axes,
    /// Acceleration of printing moves, mm/s².
    pub print_mm_s2: f64,
    /// Acceleration of travel moves, mm/s².
    pub travel_mm_s2: f64,
    /// Acceleration of moves of the filament alone, mm/s².
    pub retract_mm_s2: f64,
    /// What a corner costs.
    pub cornering: Cornering,
}

#[derive(Clone, Copy, Debug)]
struct Block {
    by_mm: Axes,
    /// Commands whose last move this is.
    ends: u32,
    length_mm: f64,
    direction: Axes,
    nominal_mm_s: f64,
    accel_mm_s2: f64,
    /// What the corner before it allows.
    entry_max_mm_s: f64,
    entry_mm_s: f64,
}

/// A move that has run to its end.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ran {
    pub(crate) by_mm: Axes,
    /// Commands that it was the last move of.
    pub(crate) ends: u32,
}

/// What a stop left of the moves.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Stopped {
    /// How far the running one got.
    pub(crate) ran_mm: Axes,
    /// All that was planned and will not happen.
    pub(crate) left_mm: Axes,
}

/// The queue of moves and the one that runs.
#[derive(Debug)]
pub(crate) struct Planner {
    /// Moves that the ring holds.
    size: usize,
    pub(crate) dynamics: Dynamics,
    /// How many times faster than the real machine.
    speed: f64,
    /// The first one runs.
    blocks: VecDeque<Block>,
    /// When the running one began and ends, and how fast it then is.
    running_since_ns: u64,
    running_end_ns: u64,
    running_exit_mm_s: f64,
    /// Moves that have begun to run.
    pub(crate) moves: u64,
    /// Most moves that were planned at a time.
    pub(crate) planned_most: usize,
    /// Time in which moves ran, ns.
    pub(crate) moving_ns: u64,
    /// Time between two moves, less what the firmware itself was waiting, ns.
    pub(crate) empty_ns: u64,
    /// How often it ran dry between two moves, whatever the reason.
    pub(crate) gaps: u64,
    /// When the last move ended, and what [`Self::excuse`] had come to then.
    gap: Option<(u64, u64)>,
    excused_ns: u64,
}

impl Planner {
    /// `blocks` is BLOCK_BUFFER_SIZE.
    pub(crate) fn new(dynamics: Dynamics, speed: f64, blocks: usize) -> Self {
        let size = blocks.saturating_sub(1).max(1);
        Self {
            size,
            dynamics,
            speed,
            blocks: VecDeque::with_capacity(size),
            running_since_ns: 0,
            running_end_ns: 0,
            running_exit_mm_s: 0.0,
            moves: 0,
            planned_most: 0,
            moving_ns: 0,
            empty_ns: 0,
            gaps: 0,
            gap: None,
            excused_ns: 0,
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Free places, as `P` of ADVANCED_OK.
    pub(crate) fn free(&self) -> usize {
        self.size - self.blocks.len()
    }

    /// When the running move ends.
    pub(crate) fn next_end_ns(&self) -> Option<u64> {
        (!self.blocks.is_empty()).then_some(self.running_end_ns)
    }

    /// Adds a move; the caller has seen that there is room. A move of no
    /// length is none: false then.
    pub(crate) fn push(&mut self, now_ns: u64, by_mm: Axes, feed_mm_s: f64) -> bool {
        debug_assert!(self.free() > 0);
        let Some(block) = self.plan(by_mm, feed_mm_s) else {
            return false;
        };
        let idle = self.blocks.is_empty();
        self.blocks.push_back(block);
        self.planned_most = self.planned_most.max(self.blocks.len());
        if idle {
            if let Some((since_ns, excused_then)) = self.gap.take() {
                let excused = self.excused_ns - excused_then;
                self.empty_ns += now_ns.saturating_sub(since_ns).saturating_sub(excused);
                self.gaps += u64::from(now_ns > since_ns);
            }
            self.running_exit_mm_s = 0.0;
            self.start(now_ns);
        } else {
            self.look_ahead();
        }
        true
    }

    /// The last move that was added is the last of its command: false when there is
    /// none left to wait for.
    pub(crate) fn end_command(&mut self) -> bool {
        match self.blocks.back_mut() {
            Some(last) => last.ends += 1,
            None => return false,
        }
        true
    }

    /// Ends the move that ends now and starts the next without a pause.
    pub(crate) fn end_move(&mut self, now_ns: u64) -> Option<Ran> {
        let ran = self.blocks.pop_front().map(|block| Ran { by_mm: block.by_mm, ends: block.ends });
        if self.blocks.is_empty() {
            self.gap = Some((now_ns, self.excused_ns));
        } else {
            self.start(now_ns);
        }
        ran
    }

    /// The board itself waited (heating, dwelling, homing, a question to the
    /// user): what of that time had no move is no fault of the sender.
    pub(crate) fn excuse(&mut self, since_ns: u64, now_ns: u64) {
        if let Some((gap_ns, _)) = self.gap {
            self.excused_ns += now_ns.saturating_sub(since_ns.max(gap_ns));
        }
    }

    /// How far the running move has got, by its time: its ramps are left out of account.
    pub(crate) fn ran_mm(&self, now_ns: u64) -> Axes {
        let done = self.done(now_ns);
        self.blocks.front().map_or([0.0; 4], |block| block.by_mm.map(|mm| mm * done))
    }

    /// The share of the running move's time that is over, 0 to 1.
    fn done(&self, now_ns: u64) -> f64 {
        let left_ns = self.running_end_ns.saturating_sub(now_ns);
        let lasts_ns = (self.running_end_ns - self.running_since_ns).max(1);
        1.0 - (left_ns as f64 / lasts_ns as f64).clamp(0.0, 1.0)
    }

    /// Drops everything at once (M410, a kill, a reset). How far the running move got
    /// is told by its time: its ramps are left out of account.
    pub(crate) fn stop(&mut self, now_ns: u64) -> Stopped {
        let mut stopped = Stopped::default();
        if self.blocks.is_empty() {
            return stopped;
        }
        let left_ns = self.running_end_ns.saturating_sub(now_ns);
        let done = self.done(now_ns);
        for (at, block) in self.blocks.iter().enumerate() {
            let part = if at == 0 { done } else { 0.0 };
            for axis in 0..4 {
                stopped.ran_mm[axis] += block.by_mm[axis] * part;
                stopped.left_mm[axis] += block.by_mm[axis] * (1.0 - part);
            }
        }
        self.moving_ns -= left_ns;
        self.blocks.clear();
        self.gap = Some((now_ns, self.excused_ns));
        stopped
    }

    fn plan(&self, by_mm: Axes, feed_mm_s: f64) -> Option<Block> {
        let xyz = by_mm[..3].iter().map(|d| d * d).sum::<f64>().sqrt();
        let filament_only = xyz == 0.0;
        let length_mm = if filament_only { by_mm[3].abs() } else { xyz };
        if !(length_mm > 0.0 && length_mm.is_finite()) {
            return None;
        }
        let limits = &self.dynamics;
        let mut accel_mm_s2 = if filament_only {
            limits.retract_mm_s2
        } else if by_mm[3] == 0.0 {
            limits.travel_mm_s2
        } else {
            limits.print_mm_s2
        };
        let mut nominal_mm_s = feed_mm_s;
        let direction = by_mm.map(|d| d / length_mm);
        for (axis, part) in direction.iter().map(|d| d.abs()).enumerate() {
            if part > 0.0 {
                nominal_mm_s = nominal_mm_s.min(limits.max_feed_mm_s[axis] / part);
                accel_mm_s2 = accel_mm_s2.min(limits.max_accel_mm_s2[axis] / part);
            }
        }
        let accel_mm_s2 = accel_mm_s2.max(1.0);
        let nominal_mm_s = nominal_mm_s.max(0.05); // Marlin's MINIMUM_PLANNER_SPEED
        let entry_max_mm_s = self.blocks.back().map_or(0.0, |before| {
            self.corner(before, &direction, accel_mm_s2).min(before.nominal_mm_s).min(nominal_mm_s)
        });
        Some(Block {
            by_mm,
            ends: 0,
            length_mm,
            direction,
            nominal_mm_s,
            accel_mm_s2,
            entry_max_mm_s,
            entry_mm_s: 0.0,
        })
    }

    /// The speed at which the corner between two moves may be taken.
    fn corner(&self, before: &Block, direction: &Axes, accel_mm_s2: f64) -> f64 {
        let pairs = || before.direction.iter().zip(direction);
        match self.dynamics.cornering {
            Cornering::JerkMmS(jerk) => {
                let step = pairs().map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                if step > 1e-9 { jerk / step } else { f64::INFINITY }
            }
            Cornering::JunctionMm(deviation) => {
                // Marlin, Planner::_populate_block; the idea is Jeon's (2011).
                let norm = |v: &Axes| v.iter().map(|x| x * x).sum::<f64>().sqrt();
                let dot: f64 = pairs().map(|(a, b)| a * b).sum();
                let cos = -dot / (norm(&before.direction) * norm(direction));
                if cos > 0.999_999 {
                    return 0.0;
                }
                let sin_half = (0.5 * (1.0 - cos.max(-1.0))).sqrt();
                if sin_half > 0.999_999_9 {
                    return f64::INFINITY;
                }
                (accel_mm_s2 * deviation * sin_half / (1.0 - sin_half)).sqrt()
            }
        }
    }

    /// Sets the entry speeds of the moves that do not run yet.
    fn look_ahead(&mut self) {
        let reach = |v: f64, block: &Block| (v * v + 2.0 * block.accel_mm_s2 * block.length_mm).sqrt();
        let mut exit = 0.0;
        for block in self.blocks.range_mut(1..).rev() {
            block.entry_mm_s = block.entry_max_mm_s.min(reach(exit, block));
            exit = block.entry_mm_s;
        }
        let mut entry = self.running_exit_mm_s;
        for block in self.blocks.range_mut(1..) {
            block.entry_mm_s = block.entry_mm_s.min(entry);
            entry = reach(block.entry_mm_s, block);
        }
    }

    /// Starts the first move. Its exit speed is settled now, as in Marlin: a
    /// move that comes later can no longer lift it.
    fn start(&mut self, now_ns: u64) {
        let entry = self.running_exit_mm_s;
        let exit = self.blocks.get(1).map_or(0.0, |next| next.entry_mm_s);
        let Some(block) = self.blocks.front() else {
            return;
        };
        let seconds = trapezoid_s(block, entry, exit).min(MOVE_S_MAX) / self.speed;
        let lasts_ns = (seconds * 1e9) as u64;
        self.running_exit_mm_s = exit;
        self.running_since_ns = now_ns;
        self.running_end_ns = now_ns + lasts_ns;
        self.moving_ns += lasts_ns;
        self.moves += 1;
    }
}

/// How long a move takes from one speed to another, s.
fn trapezoid_s(block: &Block, entry: f64, exit: f64) -> f64 {
    let Block { length_mm: length, nominal_mm_s: nominal, accel_mm_s2: accel, .. } = *block;
    let peak =
        ((2.0 * accel * length + entry * entry + exit * exit) / 2.0).sqrt().min(nominal).max(entry).max(exit);
    let ramps = (2.0 * peak * peak - entry * entry - exit * exit) / (2.0 * accel);
    let cruise = (length - ramps).max(0.0);
    (2.0 * peak - entry - exit) / accel + cruise / peak
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: u64 = 1_000_000_000;

    fn dynamics() -> Dynamics {
        Dynamics {
            max_feed_mm_s: [200.0, 200.0, 12.0, 120.0],
            max_accel_mm_s2: [1000.0, 1000.0, 200.0, 5000.0],
            print_mm_s2: 1000.0,
            travel_mm_s2: 1000.0,
            retract_mm_s2: 1250.0,
            cornering: Cornering::JerkMmS(10.0),
        }
    }

    /// Runs the planner dry; gives the time at which it is.
    fn drain(planner: &mut Planner) -> u64 {
        let mut now = 0;
        while let Some(end) = planner.next_end_ns() {
            now = end;
            planner.end_move(now);
        }
        now
    }

    fn check_one(by: Axes, feed: f64, expect_s: f64) {
        let mut planner = Planner::new(dynamics(), 1.0, BLOCKS);
        planner.push(0, by, feed);
        let took = drain(&mut planner) as f64 / 1e9;
        assert!((took - expect_s).abs() < 1e-6, "{by:?} F{feed}: {took} s");
    }

    #[test]
    fn one_move_is_a_trapezoid_from_rest_to_rest() {
        check_one([100.0, 0.0, 0.0, 0.0], 100.0, 0.1 + 0.9 + 0.1);
        // Too short to reach its speed: two ramps of 10 mm.
        check_one([20.0, 0.0, 0.0, 0.0], 200.0, 2.0 * (20.0f64 / 1000.0).sqrt());
        // Z is held to 12 mm/s and 200 mm/s².
        check_one([0.0, 0.0, 12.0, 0.0], 100.0, 1.0 + 12.0 / 200.0);
        // Filament alone.
        check_one([0.0, 0.0, 0.0, -2.0], 40.0, 2.0 / 40.0 + 40.0 / 1250.0);
        // A feed of nothing is the planner's slowest.
        check_one([0.05, 0.0, 0.0, 0.0], 0.0, 1.0 + 0.05 / 1000.0);
        // Nothing moves.
        check_one([0.0; 4], 100.0, 0.0);
        check_one([f64::NAN, 0.0, 0.0, 0.0], 100.0, 0.0);
        check_one([1e300, 0.0, 0.0, 0.0], 100.0, 0.0);
        check_one([1e100, 0.0, 0.0, 0.0], 100.0, MOVE_S_MAX);
    }

    #[test]
    fn straight_on_there_is_no_stop_and_back_there_is() {
        let run = |second: Axes| {
            let mut planner = Planner::new(dynamics(), 1.0, BLOCKS);
            planner.push(0, [1e-3, 0.0, 0.0, 0.0], 100.0);
            planner.push(0, [50.0, 0.0, 0.0, 1.0], 100.0);
            planner.push(0, second, 100.0);
            drain(&mut planner) as f64 / 1e9
        };
        let straight = run([50.0, 0.0, 0.0, 1.0]);
        let back = run([-50.0, 0.0, 0.0, 1.0]);
        let corner = run([0.0, 50.0, 0.0, 1.0]);
        assert!((straight - 1.1).abs() < 0.01, "{straight}");
        // Jerk 10: reversal at 5 mm/s, a right angle at 10 mm/s.
        assert!(back > straight + 0.08 && back < straight + 0.1, "{back}");
        assert!(corner < back && corner > straight + 0.07, "{corner}");
    }

    #[test]
    fn junction_deviation_slows_corners_too() {
        let mut with = dynamics();
        with.cornering = Cornering::JunctionMm(0.013);
        let mut planner = Planner::new(with, 1.0, BLOCKS);
        planner.push(0, [1.0, 0.0, 0.0, 0.0], 100.0);
        let right_angle = planner.plan([0.0, 1.0, 0.0, 0.0], 100.0).unwrap();
        // v² = a·d·s/(1-s) with s = sin 45°.
        let sin = std::f64::consts::FRAC_1_SQRT_2;
        let expect = (1000.0 * 0.013 * sin / (1.0 - sin)).sqrt();
        assert!((right_angle.entry_max_mm_s - expect).abs() < 1e-3);
        let straight = planner.plan([1.0, 0.0, 0.0, 0.0], 100.0).unwrap();
        assert_eq!(straight.entry_max_mm_s, 100.0);
        let back = planner.plan([-1.0, 0.0, 0.0, 0.0], 100.0).unwrap();
        assert_eq!(back.entry_max_mm_s, 0.0);
    }

    #[test]
    fn empty_time_is_what_lies_between_moves_and_is_not_the_firmwares() {
        let mut planner = Planner::new(dynamics(), 1.0, BLOCKS);
        let ten = [10.0, 0.0, 0.0, 0.0];
        planner.push(0, ten, 10.0);
        let first = planner.next_end_ns().unwrap();
        planner.end_move(first);
        assert_eq!(planner.empty_ns, 0, "a job may end here");
        planner.push(first + 3 * S, ten, 10.0);
        assert_eq!((planner.empty_ns, planner.gaps), (3 * S, 1));
        let second = planner.next_end_ns().unwrap();
        planner.end_move(second);
        planner.excuse(second, second + 5 * S); // G4 P5000
        planner.push(second + 6 * S, ten, 10.0);
        assert_eq!(planner.empty_ns, 4 * S);
        // No gap at all.
        planner.push(second + 6 * S, ten, 10.0);
        let third = planner.next_end_ns().unwrap();
        planner.end_move(third);
        assert_eq!((planner.empty_ns, planner.gaps), (4 * S, 2));
        assert_eq!(planner.moves, 4);
    }

    #[test]
    fn a_faster_clock_and_a_stop() {
        let mut planner = Planner::new(dynamics(), 10.0, BLOCKS);
        planner.push(0, [100.0, 0.0, 0.0, 0.0], 100.0);
        assert_eq!(planner.next_end_ns(), Some(110_000_000));
        planner.push(0, [0.0, 50.0, 0.0, 1.0], 100.0);
        let stopped = planner.stop(11_000_000);
        assert_eq!(planner.moving_ns, 11_000_000);
        // Of 110 ms a tenth was over.
        assert!((stopped.ran_mm[0] - 10.0).abs() < 1e-9 && (stopped.left_mm[0] - 90.0).abs() < 1e-9);
        assert_eq!((stopped.ran_mm[1], stopped.left_mm[1], stopped.left_mm[3]), (0.0, 50.0, 1.0));
        assert!(planner.is_empty() && planner.next_end_ns().is_none());
    }

    proptest::proptest! {
        /// Whatever is pushed, no move takes less time than its length at its
        /// speed, nor more than from rest to rest.
        #[test]
        fn durations_are_sane(moves in proptest::collection::vec((-20.0f64..20.0, -20.0f64..20.0, 0.0f64..1.0, 1.0f64..300.0), 1..15)) {
            for cornering in [Cornering::JerkMmS(8.0), Cornering::JunctionMm(0.013)] {
                let mut with = dynamics();
                with.cornering = cornering;
                let mut planner = Planner::new(with, 1.0, BLOCKS);
                let (mut least, mut most) = (0.0, 0.0);
                for (x, y, e, feed) in &moves {
                    let by = [*x, *y, 0.0, *e];
                    if let Some(block) = planner.plan(by, *feed) {
                        least += block.length_mm / block.nominal_mm_s;
                        most += trapezoid_s(&block, 0.0, 0.0);
                    }
                    planner.push(0, by, *feed);
                }
                let took = drain(&mut planner) as f64 / 1e9;
                assert!(took >= least - 1e-6 && took <= most + 1e-6, "{least} {took} {most}");
            }
        }
    }
}
