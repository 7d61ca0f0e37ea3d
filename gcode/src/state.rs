//! What G-code lines do to a machine: modes, position, filament, tool.
//!
//! Takes parsed lines, gives the [`Effect`] of each. All in `f64`, millimetres
//! and mm/min; positions are set from the file's own numbers, never summed up in
//! absolute mode, so nothing drifts. Knows no dialect.
//!
//! Where firmware differs: `G91` makes E relative too and `G90` gives E back to
//! the last `M82`/`M83` (what every slicer's file means; Marlin's `G90` alone
//! would make E absolute, so slicers write `M83` after it).
use crate::line::{Command, Line};

/// Millimetres in an inch (`G20`).
const INCH_MM: f64 = 25.4;

/// Motion below this is none, mm (the last digit of any slicer's coordinates is 1e-6 or more).
pub const STILL_MM: f64 = 1e-7;

/// Filament motion below this is none, mm.
pub const STILL_E_MM: f64 = 1e-9;

/// An arc in the XY plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arc {
    /// `G2`.
    pub clockwise: bool,
    /// Centre in machine coordinates, mm.
    pub centre: [f64; 2],
    /// Given by `R` rather than `I`, `J`.
    pub by_radius: bool,
    /// More than one turn (`P`).
    pub turns: u8,
}

/// One straight or circular piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Move {
    /// Machine coordinates where it starts, mm.
    pub from: [f64; 3],
    /// Machine coordinates where it ends, mm.
    pub to: [f64; 3],
    /// Filament pushed (positive) or pulled back, mm.
    pub e: f64,
    /// Feed rate in force, mm/min.
    pub feed: f64,
    /// `None` for `G0`, `G1`.
    pub arc: Option<Arc>,
}

/// What a [`Move`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// XY motion that pushes filament.
    Deposit,
    /// Motion without filament, or of Z with filament pushed.
    Travel,
    /// Motion that pulls filament back.
    Wipe,
    /// Filament alone.
    Filament,
    /// Nothing moves (a feed rate on a line of its own).
    Still,
}

impl Move {
    /// What the move is.
    #[must_use]
    pub fn kind(&self) -> Kind {
        let moves = self.length_mm() > STILL_MM;
        if moves && self.e > STILL_E_MM && (self.arc.is_some() || self.moves_xy()) {
            Kind::Deposit
        } else if moves {
            if self.e < -STILL_E_MM { Kind::Wipe } else { Kind::Travel }
        } else if self.e.abs() > STILL_E_MM {
            Kind::Filament
        } else {
            Kind::Still
        }
    }

    /// Whether X or Y changes from end to end.
    #[must_use]
    pub fn moves_xy(&self) -> bool {
        (self.to[0] - self.from[0]).abs() > STILL_MM || (self.to[1] - self.from[1]).abs() > STILL_MM
    }

    /// Length of the path, mm; of an arc along its curve.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        let dz = self.to[2] - self.from[2];
        let flat = match self.arc {
            None => hypotenuse(self.to[0] - self.from[0], self.to[1] - self.from[1]),
            Some(arc) => (arc.sweep(self.from, self.to) * arc.radius(self.from)).abs(),
        };
        if dz == 0.0 { flat } else { hypotenuse(flat, dz) }
    }
}

/// As `hypot`, by one square root where the squares are neither too large nor too
/// small for it: any printer's coordinates. Every move is measured, several times.
fn hypotenuse(x: f64, y: f64) -> f64 {
    let squared = x * x + y * y;
    if squared == 0.0 || (1e-200..1e200).contains(&squared) { squared.sqrt() } else { x.hypot(y) }
}

/// Chords stand for arcs where only the place matters, mm.
const CHORD_MM: f64 = 0.5;

/// Most chords of one arc: a full turn of 800 mm radius at half a millimetre.
const MAX_CHORDS: f64 = 10_000.0;

impl Move {
    /// The path in the XY plane as straight pieces: one for a line, chords of about
    /// half a millimetre for an arc.
    pub fn chords(&self, mut piece: impl FnMut([f64; 2], [f64; 2])) {
        let flat = |p: [f64; 3]| [p[0], p[1]];
        let Some(arc) = self.arc else { return piece(flat(self.from), flat(self.to)) };
        let (radius, sweep) = (arc.radius(self.from), arc.sweep(self.from, self.to));
        let count = ((sweep * radius).abs() / CHORD_MM).ceil().clamp(1.0, MAX_CHORDS) as u32;
        let first = (self.from[1] - arc.centre[1]).atan2(self.from[0] - arc.centre[0]);
        let mut at = flat(self.from);
        for k in 1..=count {
            let angle = first + sweep * f64::from(k) / f64::from(count);
            let to = if k == count {
                flat(self.to)
            } else {
                [arc.centre[0] + radius * angle.cos(), arc.centre[1] + radius * angle.sin()]
            };
            piece(at, to);
            at = to;
        }
    }
}

impl Arc {
    /// Radius at a point on the arc, mm.
    #[must_use]
    pub fn radius(&self, at: [f64; 3]) -> f64 {
        (at[0] - self.centre[0]).hypot(at[1] - self.centre[1])
    }

    /// Signed angle from start to end, rad; a full turn when they coincide.
    #[must_use]
    pub fn sweep(&self, from: [f64; 3], to: [f64; 3]) -> f64 {
        use std::f64::consts::TAU;
        let angle = |p: [f64; 3]| (p[1] - self.centre[1]).atan2(p[0] - self.centre[0]);
        let mut sweep = angle(to) - angle(from);
        if self.clockwise && sweep >= -1e-9 {
            sweep -= TAU;
        } else if !self.clockwise && sweep <= 1e-9 {
            sweep += TAU;
        }
        let more = f64::from(self.turns.saturating_sub(1)) * TAU;
        if self.clockwise { sweep - more } else { sweep + more }
    }

    /// The same curve walked from its other end.
    #[must_use]
    pub fn reversed(self) -> Arc {
        Arc { clockwise: !self.clockwise, ..self }
    }
}

/// What a line did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effect {
    /// Nothing that the machine's state knows of.
    Other,
    /// `G0` to `G3`; [`Move::kind`] tells what it is.
    Motion(Move),
    /// `G10` without `P`, `L`: the firmware pulls the filament back.
    FirmwareRetract,
    /// `G11`.
    FirmwareUnretract,
    /// `G92` of E alone.
    SetE,
    /// `G92` of an axis, or of all.
    SetPosition,
    /// `G28`.
    Home,
    /// `G90`/`G91`/`M82`/`M83`/`G20`/`G21`.
    Mode,
    /// `Tn`.
    Tool(u16),
}

/// The state that lines build up.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// Machine coordinates, mm.
    pub position: [f64; 3],
    /// Machine coordinate = the file's coordinate + offset, mm (`G92`).
    pub offset: [f64; 3],
    /// The file's E, mm.
    pub e: f64,
    /// Feed rate, mm/min; 0 before the first F.
    pub feed: f64,
    /// `G90`.
    pub absolute: bool,
    /// The last of `M82`, `M83`.
    pub absolute_e: bool,
    /// `G91` in force makes E relative whatever `M82` said.
    e_follows_g91: bool,
    /// `G20`.
    pub inches: bool,
    /// Last `Tn`.
    pub tool: u16,
    /// `G10` in force.
    pub firmware_retracted: bool,
}

impl Default for Machine {
    fn default() -> Self {
        Machine {
            position: [0.0; 3],
            offset: [0.0; 3],
            e: 0.0,
            feed: 0.0,
            absolute: true,
            absolute_e: true,
            e_follows_g91: false,
            inches: false,
            tool: 0,
            firmware_retracted: false,
        }
    }
}

const AXES: [u8; 3] = *b"XYZ";

impl Machine {
    /// Whether E words are positions (true) or distances.
    #[must_use]
    pub fn e_is_absolute(&self) -> bool {
        self.absolute_e && !self.e_follows_g91
    }

    /// Does what the line says.
    pub fn apply(&mut self, line: &Line<'_>) -> Effect {
        let Command::Classic { letter, number, sub: None } = line.command else { return Effect::Other };
        match (letter, number) {
            (b'G', 0..=3) => Effect::Motion(self.motion(line, number)),
            (b'G', 10) if !line.words.has(b'P') && !line.words.has(b'L') => {
                self.firmware_retracted = true;
                Effect::FirmwareRetract
            }
            (b'G', 11) => {
                self.firmware_retracted = false;
                Effect::FirmwareUnretract
            }
            (b'G', 28) => self.home(line),
            (b'G', 92) => self.set_position(line),
            (b'G', 20 | 21) => self.mode(|m| m.inches = number == 20),
            (b'G', 90 | 91) => self.mode(|m| {
                m.absolute = number == 90;
                m.e_follows_g91 = number == 91;
            }),
            (b'M', 82 | 83) => self.mode(|m| {
                m.absolute_e = number == 82;
                m.e_follows_g91 = false;
            }),
            (b'T', _) => {
                self.tool = number;
                Effect::Tool(number)
            }
            _ => Effect::Other,
        }
    }

    fn mode(&mut self, set: impl FnOnce(&mut Machine)) -> Effect {
        set(self);
        Effect::Mode
    }

    fn unit(&self) -> f64 {
        if self.inches { INCH_MM } else { 1.0 }
    }

    fn motion(&mut self, line: &Line<'_>, number: u16) -> Move {
        let unit = self.unit();
        let from = self.position;
        let mut to = from;
        let mut e = 0.0;
        let (mut i, mut j, mut r, mut turns) = (0.0, 0.0, None, 0.0);
        for word in line.words.as_slice() {
            let Some(value) = word.value else { continue };
            let value = value * unit;
            match word.letter {
                b'X' => to[0] = self.target(0, value),
                b'Y' => to[1] = self.target(1, value),
                b'Z' => to[2] = self.target(2, value),
                b'E' if self.e_is_absolute() => {
                    e = value - self.e;
                    self.e = value;
                }
                b'E' => {
                    e = value;
                    self.e += value;
                }
                b'F' => self.feed = value,
                b'I' => i = value,
                b'J' => j = value,
                b'R' => r = Some(value),
                b'P' => turns = value / unit,
                _ => {}
            }
        }
        self.position = to;
        let arc = (number >= 2).then(|| {
            let clockwise = number == 2;
            let centre = match r {
                Some(r) => radius_centre(from, to, r, clockwise),
                None => [from[0] + i, from[1] + j],
            };
            Arc { clockwise, centre, by_radius: r.is_some(), turns: turns.clamp(0.0, 255.0) as u8 }
        });
        Move { from, to, e, feed: self.feed, arc }
    }

    fn target(&self, axis: usize, value: f64) -> f64 {
        if self.absolute { value + self.offset[axis] } else { self.position[axis] + value }
    }

    fn home(&mut self, line: &Line<'_>) -> Effect {
        let all = !AXES.iter().any(|&a| line.words.has(a));
        for (axis, &letter) in AXES.iter().enumerate() {
            if all || line.words.has(letter) {
                self.position[axis] = 0.0;
                self.offset[axis] = 0.0;
            }
        }
        Effect::Home
    }

    fn set_position(&mut self, line: &Line<'_>) -> Effect {
        let unit = self.unit();
        let bare = line.words.as_slice().is_empty();
        let mut moved = bare;
        for (axis, &letter) in AXES.iter().enumerate() {
            if bare || line.words.has(letter) {
                let value = line.words.get(letter).unwrap_or(0.0) * unit;
                self.offset[axis] = self.position[axis] - value;
                moved = true;
            }
        }
        if bare || line.words.has(b'E') {
            self.e = line.words.get(b'E').unwrap_or(0.0) * unit;
        }
        if moved { Effect::SetPosition } else { Effect::SetE }
    }
}

/// Centre of the arc of radius `r` (negative: the long way round) between two points.
fn radius_centre(from: [f64; 3], to: [f64; 3], r: f64, clockwise: bool) -> [f64; 2] {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let chord = dx.hypot(dy);
    let middle = [f64::midpoint(from[0], to[0]), f64::midpoint(from[1], to[1])];
    if chord < STILL_E_MM {
        return middle;
    }
    let height = (r * r - chord * chord / 4.0).max(0.0).sqrt();
    let side = if clockwise == (r > 0.0) { 1.0 } else { -1.0 };
    [middle[0] + side * height * dy / chord, middle[1] - side * height * dx / chord]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line::parse;
    use proptest::prelude::*;

    fn run(lines: &[&str]) -> (Machine, Effect) {
        let mut machine = Machine::default();
        let mut last = Effect::Other;
        for line in lines {
            last = machine.apply(&parse(line.as_bytes()));
        }
        (machine, last)
    }

    fn moved(lines: &[&str]) -> Move {
        match run(lines).1 {
            Effect::Motion(m) => m,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn modes() {
        let check = |lines: &[&str], to: [f64; 3], e: f64| {
            let m = moved(lines);
            assert_eq!((m.to, m.e), (to, e), "{lines:?}");
        };
        check(&["G1 X1 Y2 Z3 E4"], [1.0, 2.0, 3.0], 4.0);
        check(&["G1 E4", "G1 X1 E5"], [1.0, 0.0, 0.0], 1.0);
        check(&["M83", "G1 E4", "G1 X1 E5"], [1.0, 0.0, 0.0], 5.0);
        check(&["G1 X1", "G91", "G1 X1 E5", "G1 X1 E5"], [3.0, 0.0, 0.0], 5.0);
        check(&["G1 E10", "G91", "G1 E-2", "G90", "G1 X1 E8.5"], [1.0, 0.0, 0.0], 0.5);
        check(&["G20", "G1 X1"], [25.4, 0.0, 0.0], 0.0);
        check(&["G1 X10", "G92 X0", "G1 X5"], [15.0, 0.0, 0.0], 0.0);
        check(&["G1 E10", "G92 E0", "G1 E1"], [0.0; 3], 1.0);
        check(&["G1 X5 Y5 Z5", "G28 X", "G1 Z1"], [0.0, 5.0, 1.0], 0.0);
    }

    #[test]
    fn kinds() {
        let check = |line: &str, kind: Kind| assert_eq!(moved(&["M83", line]).kind(), kind, "{line}");
        check("G1 X1 E1", Kind::Deposit);
        check("G1 X1", Kind::Travel);
        check("G1 X1 E-1", Kind::Wipe);
        check("G1 E1", Kind::Filament);
        check("G1 F100", Kind::Still);
        check("G1 Z1 E1", Kind::Travel);
        check("G2 I1 E1", Kind::Deposit);
    }

    #[test]
    fn retraction_by_firmware() {
        assert_eq!(run(&["G10"]).1, Effect::FirmwareRetract);
        assert_eq!(run(&["G10 P1 S200"]).1, Effect::Other);
        assert!(!run(&["G10", "G11"]).0.firmware_retracted);
    }

    #[test]
    fn arcs() {
        use std::f64::consts::PI;
        let check = |lines: &[&str], centre: [f64; 2], length: f64| {
            let m = moved(lines);
            let arc = m.arc.unwrap();
            assert!(
                (arc.centre[0] - centre[0]).abs() < 1e-9 && (arc.centre[1] - centre[1]).abs() < 1e-9,
                "{arc:?}"
            );
            assert!((m.length_mm() - length).abs() < 1e-9, "{} {length}", m.length_mm());
        };
        check(&["G3 X-1 Y1 I-1 J0"], [-1.0, 0.0], 0.5 * PI);
        check(&["G2 X-1 Y1 I-1 J0"], [-1.0, 0.0], 1.5 * PI);
        check(&["G3 X0 Y0 I-1 J0"], [-1.0, 0.0], 2.0 * PI);
        check(&["G3 X-1 Y1 R1"], [-1.0, 0.0], 0.5 * PI);
        check(&["G3 X-1 Y1 R-1"], [0.0, 1.0], 1.5 * PI);
        check(&["G2 X1 Y1 R1"], [1.0, 0.0], 0.5 * PI);
    }

    proptest! {
        #[test]
        fn an_arc_walked_backwards_is_as_long(x in -50.0f64..50.0, y in -50.0f64..50.0, i in 1.0f64..50.0, j in 1.0f64..50.0, clockwise: bool) {
            let arc = Arc { clockwise, centre: [i, j], by_radius: false, turns: 0 };
            let angle = y.atan2(x);
            let r = i.hypot(j);
            let to = [i + r * angle.cos(), j + r * angle.sin(), 0.0];
            let there = Move { from: [0.0; 3], to, e: 1.0, feed: 1.0, arc: Some(arc) };
            let back = Move { from: to, to: [0.0; 3], arc: Some(arc.reversed()), ..there };
            prop_assert!((there.length_mm() - back.length_mm()).abs() < 1e-6);
        }

        #[test]
        fn any_line_is_survived(lines in proptest::collection::vec("[GMT][0-9]{1,2}( [XYZEFIJRP]-?[0-9]{1,30}(\\.[0-9]{1,9})?){0,4}", 0..20)) {
            let mut machine = Machine::default();
            for line in &lines {
                if let Effect::Motion(m) = machine.apply(&parse(line.as_bytes())) {
                    let _ = (m.kind(), m.length_mm());
                }
            }
        }
    }
}
