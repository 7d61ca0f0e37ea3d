//! Where the tool is said to be, and the moves that take it elsewhere.
//!
//! Takes the words of G0 to G3, G10, G11, G92 and the modes; gives straight
//! pieces for the planner, arcs cut into chords. Knows no time.
use super::planner::Axes;
use super::words::Command;
use std::f64::consts::TAU;

/// No coordinate goes beyond this, mm: the host's numbers are anything.
const COORDINATE_MAX_MM: f64 = 1e6;

/// Longest chord of an arc, mm (Marlin's MAX_ARC_SEGMENT_MM).
const ARC_CHORD_MM: f64 = 1.0;

/// Most chords of one arc: a metre around at full resolution. A larger arc
/// gets longer chords, so that one line cannot hold the board for ever.
const ARC_CHORDS_MAX: u32 = 4096;

/// Speed before the first F, mm/s (Marlin's feedrate_mm_s at boot).
const FIRST_FEED_MM_S: f64 = 25.0;

const LETTERS: [u8; 4] = [b'X', b'Y', b'Z', b'E'];

/// The modes and the position that commands build on.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// Where the queued moves end, mm; E in filament.
    pub(crate) at_mm: Axes,
    /// What G92 added to X, Y and Z: the workspace's offset. A reset forgets it.
    shift_mm: [f64; 3],
    /// Axes that were homed.
    homed: [bool; 3],
    /// Of a resin printer: only Z is there, and goes so far up, mm.
    z_only_mm: Option<f64>,
    /// Soft endstops (M211).
    pub(crate) endstops_on: bool,
    relative: bool,
    e_relative: bool,
    inches: bool,
    feed_mm_s: f64,
    /// M220, a factor.
    pub(crate) feed_factor: f64,
    /// M221, a factor.
    pub(crate) flow_factor: f64,
    retracted: bool,
    /// M207: length in mm, speed in mm/s.
    pub(crate) retract: (f64, f64),
}

/// A straight line or an arc that is on its way into the planner.
#[derive(Clone, Debug)]
pub(crate) struct Path {
    from: Axes,
    to: Axes,
    arc: Option<Arc>,
    done: u32,
    pieces: u32,
    pub(crate) feed_mm_s: f64,
    /// How much filament a millimetre of E is (M221).
    flow: f64,
}

#[derive(Clone, Copy, Debug)]
struct Arc {
    centre: [f64; 2],
    radius: f64,
    from: f64,
    sweep: f64,
}

impl Default for Motion {
    fn default() -> Self {
        Self {
            at_mm: [0.0; 4],
            shift_mm: [0.0; 3],
            homed: [false; 3],
            z_only_mm: None,
            endstops_on: true,
            relative: false,
            e_relative: false,
            inches: false,
            feed_mm_s: FIRST_FEED_MM_S,
            feed_factor: 1.0,
            flow_factor: 1.0,
            retracted: false,
            retract: (3.0, 45.0),
        }
    }
}

impl Motion {
    /// As after a start; with Z alone, up to a height in mm, for a resin printer.
    pub(crate) fn new(z_only_mm: Option<f64>) -> Self {
        Self { z_only_mm, ..Self::default() }
    }

    /// Marlin's soft endstops for Z, in the native position; off before it was homed. A
    /// machine with X and Y goes without: its jobs are looked at by their own checks.
    fn within_endstops(&self, z_mm: f64) -> f64 {
        match self.z_only_mm.filter(|_| self.endstops_on && self.homed[2]) {
            Some(max_mm) => z_mm.min(max_mm + self.shift_mm[2]).max(self.shift_mm[2]),
            None => z_mm,
        }
    }

    /// G90 and G91: E goes along, as in Marlin.
    pub(crate) fn set_relative(&mut self, relative: bool) {
        self.relative = relative;
        self.e_relative = relative;
    }

    /// M82 and M83.
    pub(crate) fn set_e_relative(&mut self, relative: bool) {
        self.e_relative = relative;
    }

    /// G20 and G21.
    pub(crate) fn set_inches(&mut self, inches: bool) {
        self.inches = inches;
    }

    fn unit_mm(&self) -> f64 {
        if self.inches { 25.4 } else { 1.0 }
    }

    fn length(&self, command: &Command<'_>, letter: u8) -> Option<f64> {
        Some(command.value(letter)? * self.unit_mm())
    }

    /// G92: names the position anew; without axes nothing changes. `native` is
    /// G92.9, which leaves the workspace's offset alone.
    pub(crate) fn name_position(&mut self, command: &Command<'_>, native: bool) {
        for (axis, letter) in axes_there(self.z_only_mm) {
            if let Some(value) = self.length(command, letter) {
                let before = std::mem::replace(&mut self.at_mm[axis], clamp(value));
                if let Some(shift) = self.shift_mm.get_mut(axis).filter(|_| !native) {
                    *shift += self.at_mm[axis] - before;
                }
            }
        }
    }

    /// X, Y and Z as the steppers count them: without what G92 added.
    pub(crate) fn native_mm(&self) -> [f64; 3] {
        [0, 1, 2].map(|axis| self.at_mm[axis] - self.shift_mm[axis])
    }

    /// G28: the axes named are there afterwards, mm.
    pub(crate) fn home(&mut self, axes: [bool; 3], at_mm: [f64; 3]) {
        for (axis, homed) in axes.into_iter().enumerate() {
            if homed {
                self.at_mm[axis] = at_mm[axis];
                self.shift_mm[axis] = 0.0;
                self.homed[axis] = true;
            }
        }
    }

    pub(crate) fn is_homed(&self, axis: usize) -> bool {
        self.homed[axis]
    }

    /// How far Z goes up before homing: so far from where it is when it is not known,
    /// else up to there, and never down.
    pub(crate) fn raise_before_homing(&mut self, raise_mm: f64) -> f64 {
        let by_mm = if self.homed[2] { (raise_mm - self.at_mm[2]).max(0.0) } else { raise_mm };
        self.at_mm[2] += by_mm;
        by_mm
    }

    /// Moves that were planned were dropped: by so much it is not where it would be.
    pub(crate) fn stopped_short(&mut self, left_mm: Axes) {
        let [x, y, z, e] = left_mm;
        for (at_mm, left_mm) in self.at_mm.iter_mut().zip([x, y, z, e / self.flow_factor]) {
            *at_mm -= left_mm;
        }
    }

    /// G0 to G3: the path to the new position, which holds from now on.
    pub(crate) fn go(&mut self, command: &Command<'_>) -> Path {
        if let Some(feed) = self.length(command, b'F').filter(|f| *f > 0.0) {
            self.feed_mm_s = feed / 60.0;
        }
        let from = self.at_mm;
        let mut to = from;
        for (axis, letter) in axes_there(self.z_only_mm) {
            if let Some(value) = self.length(command, letter) {
                let relative = if axis == 3 { self.e_relative } else { self.relative };
                to[axis] = clamp(if relative { from[axis] + value } else { value });
            }
        }
        to[2] = self.within_endstops(to[2]);
        let arc = match command.code {
            2 | 3 if self.z_only_mm.is_none() => self.arc(command, from, to),
            _ => None,
        };
        self.at_mm = to;
        self.path(from, to, arc, self.feed_mm_s * self.feed_factor)
    }

    /// G10 and G11: the filament back or forward, once.
    pub(crate) fn firmware_retract(&mut self, back: bool) -> Option<Path> {
        if self.retracted == back {
            return None;
        }
        self.retracted = back;
        let (length, feed) = self.retract;
        // The named position of E stays, so the path is one of its own.
        let by = if back { -length } else { length };
        let to = [0.0, 0.0, 0.0, by];
        let mut path = self.path([0.0; 4], to, None, feed);
        path.flow = 1.0;
        Some(path)
    }

    fn path(&self, from: Axes, to: Axes, arc: Option<Arc>, feed_mm_s: f64) -> Path {
        let pieces = arc.map_or(1, |arc| {
            let chords = (arc.sweep.abs() * arc.radius / ARC_CHORD_MM).ceil();
            (chords as u32).clamp(1, ARC_CHORDS_MAX)
        });
        Path { from, to, arc, done: 0, pieces, feed_mm_s, flow: self.flow_factor }
    }

    /// The arc in the XY plane; `None` (a straight line then) where the words
    /// describe none.
    fn arc(&self, command: &Command<'_>, from: Axes, to: Axes) -> Option<Arc> {
        let clockwise = command.code == 2;
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let centre = if let Some(r) = self.length(command, b'R') {
            let chord = dx.hypot(dy);
            if chord == 0.0 || r == 0.0 {
                return None;
            }
            let off = (r * r - chord * chord / 4.0).max(0.0).sqrt();
            // The centre is left of the chord for the short way counter-clockwise.
            let side = if clockwise == (r > 0.0) { -1.0 } else { 1.0 };
            [from[0] + dx / 2.0 - side * off * dy / chord, from[1] + dy / 2.0 + side * off * dx / chord]
        } else {
            let (i, j) = (self.length(command, b'I'), self.length(command, b'J'));
            if i.is_none() && j.is_none() {
                return None;
            }
            [from[0] + i.unwrap_or(0.0), from[1] + j.unwrap_or(0.0)]
        };
        let angle = |p: Axes| (p[1] - centre[1]).atan2(p[0] - centre[0]);
        let start = angle(from);
        let mut sweep = (angle(to) - start).rem_euclid(TAU);
        if clockwise {
            sweep -= TAU;
        }
        if sweep.abs() < 1e-9 {
            // The end is the start: once around.
            sweep = if clockwise { -TAU } else { TAU };
        }
        Some(Arc { centre, radius: (from[0] - centre[0]).hypot(from[1] - centre[1]), from: start, sweep })
    }
}

impl Path {
    /// The next piece as a difference on each axis, E in real filament.
    pub(crate) fn next(&mut self) -> Option<Axes> {
        if self.done >= self.pieces {
            return None;
        }
        let before = self.point(self.done);
        self.done += 1;
        let after = self.point(self.done);
        let mut by = [0, 1, 2, 3].map(|axis| after[axis] - before[axis]);
        by[3] *= self.flow;
        Some(by)
    }

    /// What was not taken of it.
    pub(crate) fn rest(&self) -> Axes {
        let here = self.point(self.done);
        let mut rest = [0, 1, 2, 3].map(|axis| self.to[axis] - here[axis]);
        rest[3] *= self.flow;
        rest
    }

    /// Takes the filament out of the path; true when there was any.
    pub(crate) fn stop_filament(&mut self) -> bool {
        let moved = self.to[3] != self.from[3];
        self.to[3] = self.from[3];
        moved
    }

    fn point(&self, piece: u32) -> Axes {
        if piece == 0 {
            return self.from;
        }
        if piece == self.pieces {
            return self.to;
        }
        let part = f64::from(piece) / f64::from(self.pieces);
        let mut point = [0, 1, 2, 3].map(|a| self.from[a] + (self.to[a] - self.from[a]) * part);
        if let Some(arc) = self.arc {
            let angle = arc.from + arc.sweep * part;
            point[0] = arc.centre[0] + arc.radius * angle.cos();
            point[1] = arc.centre[1] + arc.radius * angle.sin();
        }
        point
    }
}

/// The axes that a machine has, with their letters: all, or Z alone.
fn axes_there(z_only_mm: Option<f64>) -> impl Iterator<Item = (usize, u8)> {
    LETTERS.into_iter().enumerate().filter(move |(axis, _)| z_only_mm.is_none() || *axis == 2)
}

fn clamp(value: f64) -> f64 {
    value.clamp(-COORDINATE_MAX_MM, COORDINATE_MAX_MM)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(motion: &mut Motion, line: &str) -> (usize, f64, f64) {
        let mut path = motion.go(&Command::parse(line.as_bytes()));
        let (mut pieces, mut length, mut filament) = (0, 0.0, 0.0);
        while let Some(by) = path.next() {
            pieces += 1;
            length += by[..3].iter().map(|d| d * d).sum::<f64>().sqrt();
            filament += by[3];
        }
        (pieces, length, filament)
    }

    /// From X10 Y0 E0, `lines` end at `at` after `length` mm of travel by the
    /// last line, with that much filament.
    fn check(lines: &[&str], at: Axes, length: f64, filament: f64) {
        let mut motion = Motion::default();
        run(&mut motion, "G1 X10 F600");
        let mut last = (0, 0.0, 0.0);
        for line in lines {
            let command = Command::parse(line.as_bytes());
            match (command.letter, command.code) {
                (b'G', 20) => motion.set_inches(true),
                (b'G', 90) => motion.set_relative(false),
                (b'G', 91) => motion.set_relative(true),
                (b'G', 92) => motion.name_position(&command, false),
                (b'M', 83) => motion.set_e_relative(true),
                (b'M', 221) => motion.flow_factor = command.value(b'S').unwrap() / 100.0,
                _ => last = run(&mut motion, line),
            }
        }
        for (found, expect) in motion.at_mm.iter().zip(at) {
            assert!((found - expect).abs() < 1e-9, "{lines:?}: {motion:?}");
        }
        assert!((last.1 - length).abs() < 1e-3, "{lines:?}: {last:?}");
        assert!((last.2 - filament).abs() < 1e-9, "{lines:?}: {last:?}");
    }

    #[test]
    fn lines_and_modes() {
        check(&["G1 X13 Y4 E1"], [13.0, 4.0, 0.0, 1.0], 5.0, 1.0);
        check(&["G91", "G1 X3 Y4 E1", "G1 X3 Y4 E1"], [16.0, 8.0, 0.0, 2.0], 5.0, 1.0);
        check(&["M83", "G1 X13 Y4 E1", "G1 E1"], [13.0, 4.0, 0.0, 2.0], 0.0, 1.0);
        check(&["G91", "G90", "G1 E1", "G1 E1"], [10.0, 0.0, 0.0, 1.0], 0.0, 0.0);
        check(&["G92 X0 E5", "G1 X1 E6"], [1.0, 0.0, 0.0, 6.0], 1.0, 1.0);
        check(&["G92", "G1 Z1"], [10.0, 0.0, 1.0, 0.0], 1.0, 0.0);
        check(&["G20", "G1 X1"], [25.4, 0.0, 0.0, 0.0], 15.4, 0.0);
        check(&["M221 S50", "G1 E2"], [10.0, 0.0, 0.0, 2.0], 0.0, 1.0);
        check(&["G1 F100"], [10.0, 0.0, 0.0, 0.0], 0.0, 0.0);
        check(&["G1 X99999999999 Z-99999999999"], [1e6, 0.0, -1e6, 0.0], 1_414_206.491_323, 0.0);
    }

    #[test]
    fn arcs() {
        let quarter = TAU * 10.0 / 4.0;
        check(&["G3 X0 Y10 I-10 E1"], [0.0, 10.0, 0.0, 1.0], quarter * 0.9996, 1.0);
        check(&["G2 X0 Y10 I-10"], [0.0, 10.0, 0.0, 0.0], 3.0 * quarter * 0.99958, 0.0);
        check(&["G3 X0 Y10 R10"], [0.0, 10.0, 0.0, 0.0], quarter * 0.9996, 0.0);
        check(&["G3 X0 Y10 R-10"], [0.0, 10.0, 0.0, 0.0], 3.0 * quarter * 0.99958, 0.0);
        check(&["G3 I-10"], [10.0, 0.0, 0.0, 0.0], 4.0 * quarter * 0.99958, 0.0);
        check(&["G3 X13 Y4"], [13.0, 4.0, 0.0, 0.0], 5.0, 0.0);
        let mut motion = Motion::default();
        let (pieces, ..) = run(&mut motion, "G3 I-999999");
        assert_eq!(pieces as u32, ARC_CHORDS_MAX);
    }

    #[test]
    fn firmware_retraction_happens_once() {
        let mut motion = Motion::default();
        let mut path = motion.firmware_retract(true).unwrap();
        assert_eq!(path.next(), Some([0.0, 0.0, 0.0, -3.0]));
        assert_eq!(path.next(), None);
        assert!(motion.firmware_retract(true).is_none());
        assert_eq!(motion.at_mm[3], 0.0);
        assert_eq!(motion.firmware_retract(false).unwrap().next(), Some([0.0, 0.0, 0.0, 3.0]));
    }

    proptest::proptest! {
        #[test]
        fn any_numbers_stay_finite(line in "G[0-3]( ?[XYZEFIJR]-?[0-9]{0,12}\\.?[0-9]{0,3}){0,8}") {
            let mut motion = Motion::default();
            motion.set_relative(true);
            for _ in 0..3 {
                let (_, length, filament) = run(&mut motion, &line);
                assert!(length.is_finite() && filament.is_finite());
            }
        }
    }
}
