//! How long moves take: a trapezoid of speed for each, with look-ahead at the corners.
//!
//! An estimate to compare two orders of the same job with: the speed at a corner
//! is limited so that the velocity changes by at most [`CORNER_MM_S`] at once
//! (classic jerk), moves of filament alone stop at both ends.
use super::layer::{Layer, Row};
use outrigger_gcode::line::{Command, Line, parse};
use outrigger_gcode::state::{Kind, Move};

/// Largest change of velocity at a corner, mm/s: Marlin's classic jerk of 8 to 10.
const CORNER_MM_S: f64 = 8.0;

/// Acceleration of filament alone, mm/s².
const FILAMENT_MM_S2: f64 = 1_500.0;

/// Speed limit of filament alone, mm/s.
const FILAMENT_MM_S: f64 = 120.0;

/// Feed rate before the first F, mm/s.
const DEFAULT_MM_S: f64 = 25.0;

/// Slowest speed reckoned with, mm/s, so that no time is infinite.
const SLOWEST_MM_S: f64 = 1e-3;

/// Accelerations in force, mm/s².
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Accelerations {
    /// Of deposits.
    pub print_mm_s2: f64,
    /// Of everything else.
    pub travel_mm_s2: f64,
}

impl Default for Accelerations {
    fn default() -> Self {
        Accelerations { print_mm_s2: 1_000.0, travel_mm_s2: 1_000.0 }
    }
}

impl Accelerations {
    /// Takes an `M204`, or Klipper's `SET_VELOCITY_LIMIT ACCEL=`; ignores other lines.
    pub fn learn(&mut self, bytes: &[u8]) {
        self.learn_line(&parse(bytes));
    }

    /// As [`Accelerations::learn`], of a line that is parsed already.
    pub fn learn_line(&mut self, line: &Line<'_>) {
        match line.command {
            Command::Classic { letter: b'M', number: 204, .. } => {
                for word in line.words.as_slice() {
                    let Some(value) = word.value.filter(|v| *v > 0.0) else { continue };
                    match word.letter {
                        b'S' => *self = Accelerations { print_mm_s2: value, travel_mm_s2: value },
                        b'P' => self.print_mm_s2 = value,
                        b'T' => self.travel_mm_s2 = value,
                        _ => {}
                    }
                }
            }
            Command::Named(b"SET_VELOCITY_LIMIT") => {
                let mut rest = line.args;
                while let Ok((left, (key, value))) = outrigger_gcode::line::key_value(rest) {
                    let number = outrigger_gcode::number::decimal(value).map(|(_, d)| d.value);
                    if let (b"ACCEL", Ok(value)) = (key, number)
                        && value > 0.0
                    {
                        *self = Accelerations { print_mm_s2: value, travel_mm_s2: value };
                    }
                    rest = left;
                }
            }
            _ => {}
        }
    }

    fn of(self, kind: Kind) -> f64 {
        if kind == Kind::Deposit { self.print_mm_s2 } else { self.travel_mm_s2 }
    }
}

/// Reckons the time of moves as they come, in stretches that start and end at rest.
#[derive(Clone, Debug, Default)]
pub struct Clock {
    /// In force.
    pub accelerations: Accelerations,
    run: Vec<Piece>,
    seconds: f64,
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    length_mm: f64,
    speed_mm_s: f64,
    mm_s2: f64,
    /// Unit vectors of the directions in which it begins and ends.
    first: [f64; 3],
    last: [f64; 3],
}

/// Longest run kept for the look-ahead: a planner has 16 to 64 moves.
const MAX_RUN: usize = 4_096;

impl Clock {
    /// At zero and at rest.
    #[must_use]
    pub fn new(accelerations: Accelerations) -> Clock {
        Clock { accelerations, ..Clock::default() }
    }

    /// Adds a move.
    pub fn add(&mut self, m: &Move, kind: Kind) {
        let speed_mm_s = if m.feed > 0.0 { m.feed / 60.0 } else { DEFAULT_MM_S }.max(SLOWEST_MM_S);
        match kind {
            Kind::Still => {}
            Kind::Filament => {
                self.rest();
                let speed = speed_mm_s.min(FILAMENT_MM_S);
                self.seconds += trapezoid(m.e.abs(), 0.0, 0.0, speed, FILAMENT_MM_S2);
            }
            _ => {
                let (first, last) = directions(m);
                let mm_s2 = self.accelerations.of(kind);
                self.run.push(Piece { length_mm: m.length_mm(), speed_mm_s, mm_s2, first, last });
                if self.run.len() >= MAX_RUN {
                    self.rest();
                }
            }
        }
    }

    /// A dwell, s.
    pub fn dwell(&mut self, seconds: f64) {
        self.rest();
        self.seconds += seconds;
    }

    /// Comes to rest and gives the time so far, s.
    pub fn rest(&mut self) -> f64 {
        let run = &self.run;
        let mut speeds = vec![0.0; run.len() + 1];
        for k in 1..run.len() {
            let (a, b) = (&run[k - 1], &run[k]);
            let turn = (0..3).map(|i| (b.first[i] - a.last[i]).powi(2)).sum::<f64>().sqrt();
            let corner = if turn > 1e-9 { CORNER_MM_S / turn } else { f64::INFINITY };
            speeds[k] = a.speed_mm_s.min(b.speed_mm_s).min(corner);
        }
        for k in (0..run.len()).rev() {
            let reach: f64 = speeds[k + 1] * speeds[k + 1] + 2.0 * run[k].mm_s2 * run[k].length_mm;
            speeds[k] = speeds[k].min(reach.sqrt());
        }
        for (k, piece) in run.iter().enumerate() {
            let reach: f64 = speeds[k] * speeds[k] + 2.0 * piece.mm_s2 * piece.length_mm;
            speeds[k + 1] = speeds[k + 1].min(reach.sqrt());
            self.seconds +=
                trapezoid(piece.length_mm, speeds[k], speeds[k + 1], piece.speed_mm_s, piece.mm_s2);
        }
        self.run.clear();
        self.seconds
    }
}

/// The accelerations in force at a layer's row, as far as its settings tell.
#[must_use]
pub fn accelerations_at(layer: &Layer, row: &Row) -> Accelerations {
    let mut accelerations = Accelerations::default();
    for span in layer.state(row).channels {
        accelerations.learn(layer.bytes(span));
    }
    accelerations
}

/// Unit vectors along a move's beginning and end.
fn directions(m: &Move) -> ([f64; 3], [f64; 3]) {
    let straight = unit([m.to[0] - m.from[0], m.to[1] - m.from[1], m.to[2] - m.from[2]]);
    let Some(arc) = m.arc else { return (straight, straight) };
    let tangent = |p: [f64; 3]| {
        let (rx, ry) = (p[0] - arc.centre[0], p[1] - arc.centre[1]);
        if arc.clockwise { unit([ry, -rx, 0.0]) } else { unit([-ry, rx, 0.0]) }
    };
    (tangent(m.from), tangent(m.to))
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if length > 0.0 { v.map(|c| c / length) } else { v }
}

/// Seconds over a distance from one speed to another, at most `top`.
fn trapezoid(distance: f64, from: f64, to: f64, top: f64, mm_s2: f64) -> f64 {
    if distance <= 0.0 {
        return 0.0;
    }
    let top = top.max(from).max(to).max(SLOWEST_MM_S);
    let ramps = (2.0 * top * top - from * from - to * to) / (2.0 * mm_s2);
    if ramps <= distance {
        return (2.0 * top - from - to) / mm_s2 + (distance - ramps) / top;
    }
    let peak = ((2.0 * mm_s2 * distance + from * from + to * to) / 2.0).sqrt().max(from).max(to);
    (2.0 * peak - from - to) / mm_s2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seconds(moves: &[([f64; 3], f64, f64)]) -> f64 {
        let mut clock = Clock::default();
        let mut from = [0.0; 3];
        for &(to, e, feed) in moves {
            let m = Move { from, to, e, feed, arc: None };
            clock.add(&m, m.kind());
            from = to;
        }
        clock.rest()
    }

    #[test]
    fn known_times() {
        let check = |moves: &[([f64; 3], f64, f64)], expect: f64| {
            let got = seconds(moves);
            assert!((got - expect).abs() < 1e-9, "{got} {expect}");
        };
        // 100 mm at 100 mm/s: 0.1 s up, 0.1 s down over 5 mm each, 90 mm between.
        check(&[([100.0, 0.0, 0.0], 1.0, 6_000.0)], 0.2 + 0.9);
        // Never reaches 100 mm/s: 2 * sqrt(d / a).
        check(&[([4.0, 0.0, 0.0], 0.0, 6_000.0)], 2.0 * (4.0f64 / 1_000.0).sqrt());
        // A straight line in two pieces is as fast as in one.
        check(&[([50.0, 0.0, 0.0], 1.0, 6_000.0), ([100.0, 0.0, 0.0], 1.0, 6_000.0)], 1.1);
        check(&[([0.0; 3], -1.0, 2_400.0)], 2.0 * (1.0f64 / 1_500.0).sqrt());
        check(&[([0.0; 3], 0.0, 600.0)], 0.0);
    }

    #[test]
    fn a_corner_is_slower_than_a_straight_line() {
        let straight = seconds(&[([50.0, 0.0, 0.0], 1.0, 6_000.0), ([100.0, 0.0, 0.0], 1.0, 6_000.0)]);
        let corner = seconds(&[([50.0, 0.0, 0.0], 1.0, 6_000.0), ([50.0, 50.0, 0.0], 1.0, 6_000.0)]);
        let stop = 2.0 * seconds(&[([50.0, 0.0, 0.0], 1.0, 6_000.0)]);
        assert!(straight < corner && corner < stop);
    }

    #[test]
    fn accelerations_are_learned() {
        let check = |line: &str, print_mm_s2: f64, travel_mm_s2: f64| {
            let mut a = Accelerations::default();
            a.learn(line.as_bytes());
            assert_eq!(a, Accelerations { print_mm_s2, travel_mm_s2 }, "{line}");
        };
        check("M204 S800", 800.0, 800.0);
        check("M204 P800 T1500", 800.0, 1500.0);
        check("M204 P0", 1000.0, 1000.0);
        check("SET_VELOCITY_LIMIT ACCEL=3000 SQUARE_CORNER_VELOCITY=5", 3000.0, 3000.0);
        check("M205 X8", 1000.0, 1000.0);
    }
}
