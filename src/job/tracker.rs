//! The machine's state that the lines sent so far add up to.
//!
//! Takes every line that the printer has accepted, ours too; gives position, modes,
//! fans, temperatures, and ([`back`]) the lines that bring another state back to this
//! one. Pure. Knows the firmware's own state (acceleration, what a person set at the
//! printer) only as far as lines say it.
mod back;

pub(in crate::job) use back::number;
pub use back::{modes, unpark};

use crate::printer::reply::Position;
use outrigger_gcode::line::{Command, Line, parse};
use outrigger_gcode::state::{Effect, Machine, Move};

/// What `G90` and `G91` do to E.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum EModes {
    /// E goes along (Marlin).
    #[default]
    WithAxes,
    /// E has `M82` and `M83` alone (Prusa's Marlin, Klipper, Repetier, RepRapFirmware).
    Alone,
}

/// Tools whose temperature and flow are kept; Marlin knows at most 8.
pub const MAX_TOOLS: usize = 8;

/// Fans that are kept; Marlin knows at most 8.
pub const MAX_FANS: usize = 8;

/// Settings kept for a printer that lost them (M204, M900 …), the latest of each kind.
pub const MAX_KEPT_SETTINGS: usize = 32;

/// Longest setting kept, bytes; the firmware takes no longer line.
const MAX_KEPT_BYTES: usize = 95;

/// What lines have set, as far as they did: `None` is what the firmware has had before.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Dials {
    /// Of each fan, 0 to 255.
    pub fans: [Option<f64>; MAX_FANS],
    /// Wanted of each nozzle, °C.
    pub nozzles_c: [Option<f64>; MAX_TOOLS],
    /// Wanted of the bed, °C.
    pub bed_c: Option<f64>,
    /// Wanted of the chamber, °C.
    pub chamber_c: Option<f64>,
    /// M220, percent.
    pub speed_percent: Option<f64>,
    /// What `M220 B` has put aside.
    speed_aside: Option<f64>,
    /// M221 of each tool, percent.
    pub flow_percent: [Option<f64>; MAX_TOOLS],
}

/// The machine's state. See the module's text.
#[derive(Debug, Clone)]
pub struct Tracker {
    machine: Machine,
    e_modes: EModes,
    /// Whether X, Y and Z are known in the file's coordinates: not after homing or a
    /// command that we do not know, until an absolute move.
    known: [bool; 3],
    e_known: bool,
    /// What lines have set.
    pub dials: Dials,
    /// Filament through the drive, mm, and the most that ever was: the difference is
    /// pulled back.
    fed_mm: f64,
    most_mm: f64,
    keeps_settings: bool,
    settings: Vec<Vec<u8>>,
}

impl Tracker {
    /// A machine of which nothing is known but that it is in the modes of a fresh start.
    pub fn new(e_modes: EModes) -> Self {
        Self {
            machine: Machine::default(),
            e_modes,
            known: [false; 3],
            e_known: false,
            dials: Dials::default(),
            fed_mm: 0.0,
            most_mm: 0.0,
            keeps_settings: false,
            settings: Vec::new(),
        }
    }

    /// The same, which also keeps what a printer that loses its state must be told again.
    pub fn keeping_settings(e_modes: EModes) -> Self {
        Self { keeps_settings: true, ..Self::new(e_modes) }
    }

    /// A line was accepted. The move that it makes, if it is one.
    pub fn apply(&mut self, command: &[u8]) -> Option<Move> {
        let line = parse(command);
        let (letter, number) = match line.command {
            Command::Classic { letter, number, sub } => {
                if sub.is_some() && letter == b'G' {
                    // G92.9, G28.1 …: said to the firmware, not to the file's coordinates.
                    self.position_unknown();
                    return None;
                }
                (letter, number)
            }
            Command::Named(word) => {
                self.named(word);
                self.keep(command);
                return None;
            }
            Command::None | Command::Unknown => return None,
        };
        match letter {
            b'G' => self.g(&line, number),
            b'M' => {
                self.m(&line, number, command);
                None
            }
            _ => {
                self.machine.apply(&line);
                None
            }
        }
    }

    fn g(&mut self, line: &Line<'_>, number: u16) -> Option<Move> {
        let e_was_absolute = self.machine.e_is_absolute();
        let feed_was = self.machine.feed;
        let effect = self.machine.apply(line);
        if self.machine.feed <= 0.0 {
            // Firmware ignores F0.
            self.machine.feed = feed_was;
        }
        match effect {
            Effect::Motion(m) => {
                self.moved(line, &m);
                return Some(m);
            }
            Effect::Home => self.each_named(line, |tracker, axis| tracker.known[axis] = false),
            Effect::SetE => self.e_known = true,
            Effect::SetPosition => {
                self.each_named(line, |tracker, axis| tracker.known[axis] = true);
                self.e_known |= line.words.has(b'E') || line.words.as_slice().is_empty();
            }
            Effect::Mode if number == 90 || number == 91 => {
                let absolute = match self.e_modes {
                    EModes::WithAxes => number == 90,
                    EModes::Alone => e_was_absolute,
                };
                self.machine.apply(&parse(if absolute { b"M82" } else { b"M83" }));
            }
            // Parking, cleaning, levelling, probing, calibration: the head goes
            // elsewhere and may stay there.
            Effect::Other if matches!(number, 12 | 27 | 29..=35 | 38 | 42 | 61 | 76 | 80 | 81 | 425) => {
                self.position_unknown();
            }
            _ => {}
        }
        None
    }

    /// For each of X, Y, Z that the line names, or all if it names none.
    fn each_named(&mut self, line: &Line<'_>, mut then: impl FnMut(&mut Self, usize)) {
        let all = !b"XYZ".iter().any(|a| line.words.has(*a)) && !line.words.has(b'E');
        for (axis, letter) in b"XYZ".iter().enumerate() {
            if all || line.words.has(*letter) {
                then(self, axis);
            }
        }
    }

    fn moved(&mut self, line: &Line<'_>, m: &Move) {
        for word in line.words.as_slice() {
            match word.letter {
                letter @ b'X'..=b'Z' if self.machine.absolute && word.value.is_some() => {
                    self.known[usize::from(letter - b'X')] = true;
                }
                b'E' if self.machine.e_is_absolute() && word.value.is_some() && !self.e_known => {
                    // How far it went from where it was is not known.
                    self.e_known = true;
                    return;
                }
                _ => {}
            }
        }
        self.fed_mm += m.e * self.flow();
        self.most_mm = self.most_mm.max(self.fed_mm);
    }

    fn m(&mut self, line: &Line<'_>, number: u16, command: &[u8]) {
        let words = &line.words;
        let s = words.get(b'S');
        let target = s.or(words.get(b'R'));
        let named_tool = words.get(b'T').map_or(self.tool(), index);
        let dials = &mut self.dials;
        match number {
            82 | 83 => {
                self.machine.apply(line);
            }
            104 | 109 => {
                if let (Some(slot), Some(c)) = (dials.nozzles_c.get_mut(named_tool), target) {
                    *slot = Some(c);
                }
            }
            140 | 190 => dials.bed_c = target.or(dials.bed_c),
            141 | 191 => dials.chamber_c = target.or(dials.chamber_c),
            106 | 107 => {
                let fan = words.get(b'P').map_or(0, index);
                if let Some(slot) = dials.fans.get_mut(fan) {
                    let value = if number == 107 { 0.0 } else { s.unwrap_or(255.0) };
                    *slot = Some(value.clamp(0.0, 255.0));
                }
            }
            220 => {
                if words.has(b'B') {
                    dials.speed_aside = dials.speed_percent;
                }
                if words.has(b'R') {
                    dials.speed_percent = dials.speed_aside;
                }
                dials.speed_percent = s.or(dials.speed_percent);
            }
            221 => {
                if let (Some(slot), Some(percent)) = (dials.flow_percent.get_mut(named_tool), s) {
                    *slot = Some(percent);
                }
            }
            201..=205 | 207..=209 | 92 | 572 | 592 | 593 | 851 | 900 => self.keep(command),
            _ => {}
        }
    }

    /// A macro of the firmware may do anything; the named settings of slicers do not move.
    fn named(&mut self, word: &[u8]) {
        const STILL: [&[u8]; 5] =
            [b"EXCLUDE_OBJECT", b"SET_VELOCITY", b"SET_PRESSURE", b"SET_PRINT_STATS", b"SET_INPUT_SHAPER"];
        if !STILL.iter().any(|s| word.starts_with(s)) {
            self.position_unknown();
        }
    }

    fn keep(&mut self, command: &[u8]) {
        let still = !command.starts_with(b"EXCLUDE") && !command.starts_with(b"SET_PRINT");
        let setting = command.starts_with(b"SET_") || matches!(command.first(), Some(b'M' | b'm'));
        if !self.keeps_settings || !still || !setting || command.len() > MAX_KEPT_BYTES {
            return;
        }
        let kind = kind_of_setting(command);
        self.settings.retain(|kept| kind_of_setting(kept) != kind);
        if self.settings.len() == MAX_KEPT_SETTINGS {
            self.settings.remove(0);
        }
        self.settings.push(command.to_vec());
    }

    fn position_unknown(&mut self) {
        self.known = [false; 3];
    }

    fn flow(&self) -> f64 {
        self.dials.flow_percent.get(self.tool()).copied().flatten().unwrap_or(100.0) / 100.0
    }

    // ---- what is known ----

    /// The tool in use.
    pub fn tool(&self) -> usize {
        usize::from(self.machine.tool)
    }

    /// X (0), Y or Z (2) in the coordinates that lines are in, mm.
    pub fn at_mm(&self, axis: usize) -> Option<f64> {
        self.known[axis].then(|| self.machine.position[axis] - self.machine.offset[axis])
    }

    /// The same in the coordinates of a machine that was just homed, `G92` being left out.
    pub fn at_native_mm(&self, axis: usize) -> Option<f64> {
        self.known[axis].then_some(self.machine.position[axis])
    }

    /// `G10` is in force.
    pub fn is_firmware_retracted(&self) -> bool {
        self.machine.firmware_retracted
    }

    /// What `G90` and `G91` do to E.
    pub fn e_modes(&self) -> EModes {
        self.e_modes
    }

    /// Z as [`Tracker::at_mm`], a guess where it is not known.
    pub fn z_mm(&self) -> f64 {
        self.machine.position[2] - self.machine.offset[2]
    }

    /// E as lines count it, mm.
    pub fn e_mm(&self) -> Option<f64> {
        self.e_known.then_some(self.machine.e)
    }

    /// Filament pulled back from where it last was furthest, mm.
    pub fn retracted_mm(&self) -> f64 {
        self.most_mm - self.fed_mm
    }

    /// The settings kept, oldest first.
    pub fn settings(&self) -> impl Iterator<Item = &str> {
        self.settings.iter().filter_map(|s| std::str::from_utf8(s).ok())
    }

    /// Takes from the printer's report what is not known from lines.
    pub fn resolve(&mut self, report: Position) {
        for (axis, value) in [report.x_mm, report.y_mm, report.z_mm].into_iter().enumerate() {
            if !self.known[axis] {
                self.machine.position[axis] = value + self.machine.offset[axis];
                self.known[axis] = true;
            }
        }
        if let (false, Some(e)) = (self.e_known, report.e_mm) {
            self.machine.e = e;
            self.e_known = true;
        }
    }

    /// Takes X, Y and Z from the printer's report: somebody may have moved it.
    pub fn relocate(&mut self, report: Position) {
        self.known = [false; 3];
        self.resolve(report);
    }

    /// Takes the filament as pulled back by so many mm more than `than`.
    pub fn pulled_back_from(&mut self, than: &Tracker, mm: f64) {
        self.fed_mm = than.fed_mm - mm;
        self.most_mm = than.most_mm;
    }

    /// Whether the printer is where the lines lead; else what differs, for a person.
    ///
    /// # Errors
    /// The axis and both values.
    pub fn agrees(&self, report: Position) -> Result<(), String> {
        let said = [report.x_mm, report.y_mm, report.z_mm];
        for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
            if let Some(expect) = self.at_mm(axis)
                && (expect - said[axis]).abs() > AGREES_MM
            {
                return Err(format!("{name} should be at {expect:.2} mm and is at {:.2} mm", said[axis]));
            }
        }
        if let (Some(expect), Some(said)) = (self.e_mm(), report.e_mm)
            && (expect - said).abs() > AGREES_MM + expect.abs() * AGREES_E_SHARE
        {
            return Err(format!("E should be at {expect:.2} mm and is at {said:.2} mm"));
        }
        Ok(())
    }
}

/// Reports have two decimals, and firmware computes in single precision.
const AGREES_MM: f64 = 0.021;

/// Firmware adds E up in single precision, line by line: what a long job's sum drifts.
const AGREES_E_SHARE: f64 = 1e-4;

/// A word's value as an index; what is none is beyond every table.
fn index(value: f64) -> usize {
    if (0.0..1000.0).contains(&value) { value as usize } else { usize::MAX }
}

/// Command and letters, without values: `M205 X8 Y8` → `M205 X Y`. A T that names a tool
/// is kept with its value; that of `M204` is the acceleration of travels.
fn kind_of_setting(command: &[u8]) -> Vec<u8> {
    let mut kind = Vec::with_capacity(16);
    let names_tools = !command.trim_ascii_start().to_ascii_uppercase().starts_with(b"M204");
    for (at, word) in command.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).enumerate() {
        let whole = at == 0 || names_tools && word[0].eq_ignore_ascii_case(&b'T');
        let key = word.iter().position(|b| *b == b'=').unwrap_or(1);
        kind.extend_from_slice(if whole { word } else { &word[..key] });
        kind.push(b' ');
    }
    kind
}

#[cfg(test)]
mod tests;
