//! Proves that a rewritten job prints what the original prints.
//!
//! Takes the original's and the output's bytes layer by layer, reads both again
//! from the text, and compares. Written apart from the passes: it shares with
//! them the language (lines, machine, dialect) and none of their reasoning.
//!
//! What must hold in every layer:
//! - the same undirected segments with the same E, Z, feature, width, height, tool,
//!   speed, acceleration, limits, pressure advance and fan; what is neither infill
//!   nor gap fill in the file's order and direction too
//! - every other line byte for byte, in order, after the same number of deposits
//! - between deposits as much filament pulled back and pushed, for each retraction
//! - no more deposits with the filament pulled back than the file has, none pulled
//!   back deeper; no travel lower, further out or faster than the file's own
//! - at the layer's end the same position, modes, settings and retraction
use super::measure::{Measure, Totals};
use super::time::{Accelerations, Clock};
use outrigger_gcode::dialect::{Dialect, Feature, Mark, ObjectMark};
use outrigger_gcode::line::{Command, Line, key_value, parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine, Move};
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// Lengths are compared in this unit, mm.
const UNIT_MM: f64 = 1e-6;

/// Filament of one segment may differ by this, mm.
const E_MM: f64 = 1e-6;

/// Filament of all segments together may differ by this, mm.
const E_SUM_MM: f64 = 1e-3;

/// Filament moved between the deposits of one layer may differ by this, mm.
const PRIMED_MM: f64 = 1e-3;

/// Travels may leave the file's bounds by this, mm: an arc walked from its other
/// end has its centre rounded another way, and its bulge with it.
const BOUNDS_MM: f64 = 0.01;

/// Marlin takes 95 bytes of a framed line; `N12345678 ` and `*255` are 14 of them.
const MAX_CODE_BYTES: usize = 81;

/// What differs, and where.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("layer {layer}: {what}")]
pub struct Difference {
    /// Number of the layer.
    pub layer: u32,
    /// What differs.
    pub what: What,
}

/// What differs.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum What {
    /// A run of one feature begins or ends elsewhere.
    #[error("{0:?} would be printed in another place of the order")]
    Runs(Feature),
    /// Segments of infill.
    #[error("other segments of {0:?} would be printed")]
    Segments(Feature),
    /// Segments whose order must stay.
    #[error("the order or direction of {0:?} would change")]
    Order(Feature),
    /// Number of segments.
    #[error("{1} segments would be printed instead of {0}")]
    Count(usize, usize),
    /// Filament adds up to more or less.
    #[error("the filament differs by {0:.6} mm in all")]
    Filament(f64),
    /// Lines that are no motion.
    #[error("a command or comment would change or move: {0:?}")]
    Others(String),
    /// Deposits while pulled back.
    #[error("{0} deposits would begin with the filament pulled back")]
    Retracted(u64),
    /// Filament moved between deposits.
    #[error("{0:+.5} mm of filament would be moved between the deposits")]
    Primed(f64),
    /// Retraction depth.
    #[error("the filament would be pulled back {0:.5} mm, deeper than the file does")]
    Deeper(f64),
    /// Travel height.
    #[error("a travel would go at {0} mm, below the layer's own")]
    Low(f64),
    /// Travel bounds.
    #[error("a travel would leave the bounds of the file's own moves")]
    Outside,
    /// Travel speed.
    #[error("a travel would go at {0} mm/min, faster than the file's own")]
    Fast(f64),
    /// A line that Marlin would cut.
    #[error("a line would be longer than the firmware takes: {0:?}")]
    Long(String),
    /// The state at the end.
    #[error("{0} would not be as the file leaves it")]
    End(&'static str),
}

/// What holds for a deposit beside its place.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Context {
    feature: Feature,
    tool: u16,
    object: u64,
    width_mm: f64,
    height_mm: f64,
    /// Hash of all the settings in force.
    settings: u64,
}

/// A deposit, ends ordered so that its direction does not show.
#[derive(Clone, Copy, Debug)]
struct Segment {
    /// x, y, z of both ends and the centre of the arc, in [`UNIT_MM`].
    place: [i64; 8],
    /// 0 for a line, 1 for a clockwise arc from the lower end, 2 for the other.
    arc: u8,
    /// The ends were swapped.
    reversed: bool,
    e: f64,
    feed: f64,
    context: u32,
}

impl Segment {
    fn new(m: &Move, context: u32) -> Segment {
        let unit = |v: f64| (v / UNIT_MM).round() as i64;
        let (from, to) = (m.from.map(unit), m.to.map(unit));
        let reversed = to < from;
        let (a, b) = if reversed { (to, from) } else { (from, to) };
        let centre = m.arc.map_or([0, 0], |arc| arc.centre.map(unit));
        let arc = m.arc.map_or(0, |arc| 1 + u8::from(arc.clockwise == reversed));
        let place = [a[0], a[1], a[2], b[0], b[1], b[2], centre[0], centre[1]];
        Segment { place, arc, reversed, e: m.e, feed: m.feed, context }
    }

    fn key(&self) -> ([i64; 8], u8, i64, u64) {
        (self.place, self.arc, (self.e / UNIT_MM).round() as i64, self.feed.to_bits())
    }
}

/// What a layer's bytes do.
#[derive(Default)]
struct Reading {
    segments: Vec<Segment>,
    contexts: Vec<Context>,
    /// Deposits before it, and its hash.
    others: Vec<(u32, u64)>,
    lowest_travel: f64,
    /// Filament moved between deposits, mm, as if none were left pulled back at the end.
    primed_mm: f64,
    /// What each stretch with a retraction moved in all, mm: 0, or its extra.
    extras_mm: Vec<f64>,
    /// Filament moved since the last deposit, mm, and how far back it was then.
    since_mm: f64,
    back_mm: f64,
}

impl Reading {
    /// A move between deposits.
    fn primes(&mut self, e: f64) {
        self.primed_mm += e;
        self.since_mm += e;
        self.back_mm = self.back_mm.min(self.since_mm);
    }

    /// A deposit, or the end of the layer.
    fn ends_stretch(&mut self) {
        if self.back_mm < -E_SUM_MM {
            self.extras_mm.push(self.since_mm);
        }
        self.since_mm = 0.0;
        self.back_mm = 0.0;
    }

    /// What a retraction of this file pushes more than it pulled, mm.
    fn extra_mm(&self) -> f64 {
        let mut extras = self.extras_mm.clone();
        extras.sort_by(f64::total_cmp);
        extras.get(extras.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Reads one of the two files.
struct Side {
    dialect: Option<Dialect>,
    machine: Machine,
    context: Context,
    /// A name for the feature as the file spells it, to tell beads apart.
    feature_name: u32,
    settings: HashMap<Vec<u8>, u64>,
    measure: Measure,
    clock: Clock,
    low: [f64; 2],
    high: [f64; 2],
    fastest: f64,
    layers: u64,
}

impl Side {
    fn new(dialect: Option<Dialect>, accelerations: Accelerations) -> Side {
        Side {
            dialect,
            machine: Machine::default(),
            context: Context {
                feature: Feature::Unknown,
                tool: 0,
                object: 0,
                width_mm: 0.0,
                height_mm: 0.0,
                settings: 0,
            },
            feature_name: 0,
            settings: HashMap::new(),
            measure: Measure::default(),
            clock: Clock::new(accelerations),
            low: [f64::INFINITY; 2],
            high: [f64::NEG_INFINITY; 2],
            fastest: 0.0,
            layers: 0,
        }
    }

    fn read(&mut self, bytes: &[u8]) -> Reading {
        let mut reading = Reading { lowest_travel: f64::INFINITY, ..Reading::default() };
        let depth_mm = self.measure.depth_mm();
        for bytes in split_lines(bytes) {
            let line = parse(bytes);
            let mark = self.mark(&line);
            let effect = self.machine.apply(&line);
            let counted = match effect {
                Effect::Motion(m) => {
                    if let Some(Mark::Inline(feature)) = mark {
                        self.context.feature = feature;
                        self.feature_name = small_hash(line.comment_text());
                    }
                    self.motion(&m, &mut reading);
                    !line.words.complete
                }
                Effect::FirmwareRetract => {
                    self.measure.firmware_retract();
                    false
                }
                Effect::FirmwareUnretract => {
                    self.measure.firmware_unretract();
                    false
                }
                Effect::SetE => false,
                Effect::Tool(tool) => {
                    if tool != self.context.tool {
                        self.measure.tool_change();
                    }
                    self.context.tool = tool;
                    true
                }
                Effect::Home => {
                    self.measure.home();
                    true
                }
                Effect::SetPosition | Effect::Mode => true,
                Effect::Other => !self.setting(&line, mark),
            };
            if counted {
                reading.others.push((reading.segments.len() as u32, hash(bytes)));
            }
        }
        self.clock.rest();
        let left_back_mm = self.measure.depth_mm() - depth_mm;
        if left_back_mm.abs() > E_SUM_MM {
            // The stretch goes on in the next layer, or the file ends in it.
            reading.primes(left_back_mm);
        }
        reading.ends_stretch();
        reading
    }

    fn mark<'a>(&mut self, line: &Line<'a>) -> Option<Mark<'a>> {
        let mute = line.comment.is_empty()
            && !matches!(line.command, Command::Named(_) | Command::Classic { letter: b'M', .. });
        if mute {
            return None;
        }
        let mark = self.dialect.and_then(|d| d.mark(line));
        self.layers += u64::from(mark == Some(Mark::Layer));
        mark
    }

    fn motion(&mut self, m: &Move, reading: &mut Reading) {
        let kind = m.kind();
        self.measure.add(m, kind, self.feature_name, self.machine.tool);
        self.clock.add(m, kind);
        if kind == Kind::Deposit {
            reading.ends_stretch();
        } else {
            reading.primes(m.e);
        }
        if kind == Kind::Still || kind == Kind::Filament {
            return;
        }
        // An arc bulges beyond its ends, and a wipe back over it goes there too.
        m.chords(|a, b| {
            for p in [a, b] {
                self.low = [self.low[0].min(p[0]), self.low[1].min(p[1])];
                self.high = [self.high[0].max(p[0]), self.high[1].max(p[1])];
            }
        });
        if kind == Kind::Deposit {
            if reading.contexts.last() != Some(&self.context) {
                reading.contexts.push(self.context);
            }
            reading.segments.push(Segment::new(m, reading.contexts.len() as u32 - 1));
        } else {
            self.fastest = self.fastest.max(m.feed);
            if m.moves_xy() {
                reading.lowest_travel = reading.lowest_travel.min(m.from[2].min(m.to[2]));
            }
        }
    }

    /// Whether the line sets something that goes with the deposits after it.
    fn setting(&mut self, line: &Line<'_>, mark: Option<Mark<'_>>) -> bool {
        match mark {
            Some(Mark::Feature(feature)) => {
                self.context.feature = feature;
                self.feature_name = small_hash(line.comment_text());
                return true;
            }
            Some(Mark::Width(mm)) => {
                self.context.width_mm = mm;
                return true;
            }
            Some(Mark::Height(mm)) => {
                self.context.height_mm = mm;
                return true;
            }
            Some(Mark::WipeStart | Mark::WipeEnd) => return true,
            Some(Mark::Object(ObjectMark::Begin(name))) => self.context.object = hash(name),
            Some(Mark::Object(ObjectMark::End)) => self.context.object = 0,
            _ => {}
        }
        match line.command {
            Command::Classic { letter: b'G', number: 4, .. } => {
                let ms = line.words.get(b'P').unwrap_or(0.0) / 1_000.0;
                self.clock.dwell((ms + line.words.get(b'S').unwrap_or(0.0)).clamp(0.0, 1e6));
                false
            }
            Command::Classic { letter: b'M', number, sub: None } => self.m_code(line, number),
            Command::Named(b"SET_VELOCITY_LIMIT" | b"SET_PRESSURE_ADVANCE") => {
                self.clock.accelerations.learn_line(line);
                let mut extruder: &[u8] = b"";
                let mut rest = line.args;
                while let Ok((left, (key, value))) = key_value(rest) {
                    if key == b"EXTRUDER" {
                        extruder = value;
                    }
                    rest = left;
                }
                let mut rest = line.args;
                while let Ok((left, (key, value))) = key_value(rest) {
                    self.put(&[line.head, extruder, key], hash(value));
                    rest = left;
                }
                true
            }
            _ => false,
        }
    }

    fn m_code(&mut self, line: &Line<'_>, number: u16) -> bool {
        let bits = |v: Option<f64>| v.unwrap_or(f64::NAN).to_bits();
        match number {
            106 | 107 => {
                let fan = line.words.get(b'P').unwrap_or(0.0).to_bits().to_le_bytes();
                let full = line.words.get(b'S').unwrap_or(255.0);
                self.put(&[b"fan", &fan], (if number == 107 { 0.0 } else { full }).to_bits());
            }
            204 => {
                self.clock.accelerations.learn_line(line);
                // What T sets is a travel's, not a deposit's.
                let print = self.clock.accelerations.print_mm_s2;
                self.put(&[b"acceleration"], print.to_bits());
            }
            201 | 203 | 205 | 566 => {
                for word in line.words.as_slice() {
                    self.put(&[&number.to_le_bytes(), &[word.letter]], bits(word.value));
                }
            }
            572 | 900 => {
                let drive = line.words.get(b'T').or(line.words.get(b'D')).unwrap_or(0.0);
                for word in line.words.as_slice() {
                    let key = [&number.to_le_bytes()[..], &drive.to_bits().to_le_bytes(), &[word.letter]];
                    self.put(&key, bits(word.value));
                }
            }
            _ => return false,
        }
        true
    }

    /// Sets one setting; the hash of all is a sum, so that it is kept in step cheaply.
    fn put(&mut self, key: &[&[u8]], value: u64) {
        let key = key.join(&b'/');
        let entry = hash(&[key.as_slice(), &value.to_le_bytes()].concat());
        let old = self.settings.insert(key, entry).unwrap_or(0);
        self.context.settings = self.context.settings.wrapping_sub(old).wrapping_add(entry);
    }

    /// Whether reading the same bytes would do the same to both.
    fn stands_like(&self, other: &Side) -> bool {
        self.machine == other.machine
            && self.context == other.context
            && self.feature_name == other.feature_name
            && self.measure.stands_like(&other.measure)
            && self.clock.accelerations == other.clock.accelerations
    }
}

fn hash(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    // 0 is "none" among the objects.
    hasher.finish() | 1
}

fn small_hash(bytes: &[u8]) -> u32 {
    (hash(bytes) >> 32) as u32
}

/// What both files measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Figures {
    /// Of the original.
    pub before: Totals,
    /// Of the output.
    pub after: Totals,
    /// Estimated printing time of the original, s.
    pub time_s_before: f64,
    /// Of the output, s.
    pub time_s_after: f64,
    /// Layer marks.
    pub layers: u64,
}

/// Compares two files layer by layer.
pub struct Verifier {
    before: Side,
    after: Side,
    e_sum_mm: f64,
    /// Longest line of the input where it was compared, bytes, without its comment.
    longest: usize,
}

impl Verifier {
    /// At the beginning of both. Without a dialect nothing is known of features,
    /// and nothing may be reordered.
    #[must_use]
    pub fn new(dialect: Option<Dialect>, accelerations: Accelerations) -> Verifier {
        Verifier {
            before: Side::new(dialect, accelerations),
            after: Side::new(dialect, accelerations),
            e_sum_mm: 0.0,
            longest: 0,
        }
    }

    /// Compares a layer; `output` is `None` where it is the input itself.
    ///
    /// # Errors
    /// What differs.
    pub fn layer(&mut self, number: u32, input: &[u8], output: Option<&[u8]>) -> Result<(), Difference> {
        let output = output.unwrap_or(input);
        if input == output && self.before.stands_like(&self.after) {
            self.same(input);
            return Ok(());
        }
        let old = self.before.read(input);
        let new = self.after.read(output);
        self.compare(&old, &new, input, output).map_err(|what| Difference { layer: number, what })
    }

    /// The same bytes from the same state: read once for both.
    fn same(&mut self, input: &[u8]) {
        let (measure, seconds) = (self.before.measure.clone(), self.before.clock.rest());
        self.before.read(input);
        let gained = self.before.clock.rest() - seconds;
        self.after.measure.follow(&measure, &self.before.measure);
        self.after.clock.dwell(gained);
        let (before, after) = (&self.before, &mut self.after);
        after.clock.accelerations = before.clock.accelerations;
        after.machine.clone_from(&before.machine);
        after.context = before.context;
        after.feature_name = before.feature_name;
        after.settings.clone_from(&before.settings);
        after.layers = before.layers;
        after.fastest = after.fastest.max(before.fastest);
    }

    fn compare(&mut self, old: &Reading, new: &Reading, input: &[u8], output: &[u8]) -> Result<(), What> {
        self.segments(old, new)?;
        if old.others != new.others {
            return Err(What::Others(first_other(&old.others, &new.others, output)));
        }
        let more = new.extras_mm.len() as f64 - old.extras_mm.len() as f64;
        let due_mm = old.primed_mm + old.extra_mm() * more;
        if (new.primed_mm - due_mm).abs() > PRIMED_MM {
            return Err(What::Primed(new.primed_mm - due_mm));
        }
        let (before, after) = (&self.before, &self.after);
        if after.measure.retracted_deposits > before.measure.retracted_deposits {
            return Err(What::Retracted(after.measure.retracted_deposits));
        }
        if after.measure.deepest_mm > before.measure.deepest_mm + E_MM {
            return Err(What::Deeper(after.measure.deepest_mm));
        }
        let layer_z = old.segments.iter().map(|s| s.place[2].min(s.place[5])).min();
        let floor_mm = layer_z.map_or(f64::INFINITY, |z| z as f64 * UNIT_MM).min(old.lowest_travel);
        if new.lowest_travel < floor_mm - UNIT_MM {
            return Err(What::Low(new.lowest_travel));
        }
        self.lengths(input, output)?;
        self.ends()
    }

    /// Marlin cuts what is longer, and no line may be that was not.
    fn lengths(&mut self, input: &[u8], output: &[u8]) -> Result<(), What> {
        let code = |bytes: &&[u8]| memchr::memchr(b';', bytes).unwrap_or(bytes.len());
        let longest = |text: &[u8]| split_lines(text).map(|l| code(&l)).max().unwrap_or(0);
        self.longest = self.longest.max(longest(input));
        let most = self.longest.max(MAX_CODE_BYTES);
        match split_lines(output).find(|line| code(line) > most) {
            Some(line) => Err(What::Long(String::from_utf8_lossy(line).trim().to_owned())),
            None => Ok(()),
        }
    }

    fn segments(&mut self, old: &Reading, new: &Reading) -> Result<(), What> {
        if old.segments.len() != new.segments.len() {
            return Err(What::Count(old.segments.len(), new.segments.len()));
        }
        let run_of = |r: &Reading, k: usize| {
            let c = r.contexts[r.segments[k].context as usize];
            (c.feature, c.tool, c.object)
        };
        let mut from = 0;
        while from < old.segments.len() {
            let run = run_of(old, from);
            let mut to = from;
            while to < old.segments.len() && run_of(old, to) == run {
                if run_of(new, to) != run {
                    return Err(What::Runs(run.0));
                }
                to += 1;
            }
            self.run(run.0, old, new, from..to)?;
            from = to;
        }
        if self.e_sum_mm > E_SUM_MM { Err(What::Filament(self.e_sum_mm)) } else { Ok(()) }
    }

    fn run(
        &mut self,
        feature: Feature,
        old: &Reading,
        new: &Reading,
        range: std::ops::Range<usize>,
    ) -> Result<(), What> {
        let free = matches!(
            feature,
            Feature::Infill | Feature::GapFill | Feature::SolidInfill | Feature::Skin | Feature::AnyInfill
        );
        let (a, b) = (&old.segments[range.clone()], &new.segments[range]);
        // Sorted, infill printed in any order is the same; most of it was not touched at all.
        let sorted = |segments: &[Segment]| {
            let mut segments = segments.to_vec();
            segments.sort_unstable_by_key(Segment::key);
            segments
        };
        let touched = free && a.iter().zip(b).any(|(a, b)| a.key() != b.key());
        let (a, b) = if touched { (sorted(a), sorted(b)) } else { (a.to_vec(), b.to_vec()) };
        for (a, b) in a.iter().zip(&b) {
            let alike = a.place == b.place
                && a.arc == b.arc
                && a.feed == b.feed
                && (a.e - b.e).abs() <= E_MM
                && old.contexts[a.context as usize] == new.contexts[b.context as usize];
            if !alike && free {
                return Err(What::Segments(feature));
            }
            if !alike || (!free && a.reversed != b.reversed) {
                return Err(What::Order(feature));
            }
            self.e_sum_mm += (a.e - b.e).abs();
        }
        Ok(())
    }

    fn ends(&self) -> Result<(), What> {
        let (before, after) = (&self.before, &self.after);
        let (a, b) = (&before.machine, &after.machine);
        let near = |x: f64, y: f64| (x - y).abs() <= UNIT_MM;
        let checks = [
            ("the position", (0..3).all(|k| near(a.position[k], b.position[k]))),
            ("the feed rate", a.feed == b.feed),
            ("E", !a.e_is_absolute() || near(a.e, b.e)),
            ("a mode", {
                let modes = |m: &Machine| (m.absolute, m.e_is_absolute(), m.inches, m.tool, m.offset);
                modes(a) == modes(b)
            }),
            ("a setting", before.context == after.context),
            (
                "the retraction",
                a.firmware_retracted == b.firmware_retracted
                    && near(before.measure.depth_mm(), after.measure.depth_mm()),
            ),
        ];
        match checks.iter().find(|(_, holds)| !holds) {
            Some((what, _)) => Err(What::End(what)),
            None => Ok(()),
        }
    }

    /// What holds for the files as wholes.
    ///
    /// # Errors
    /// What differs.
    pub fn finish(mut self, last_layer: u32) -> Result<Figures, Difference> {
        let (before, after) = (&self.before, &self.after);
        let outside = (0..2)
            .any(|k| after.low[k] < before.low[k] - BOUNDS_MM || after.high[k] > before.high[k] + BOUNDS_MM);
        if outside {
            return Err(Difference { layer: last_layer, what: What::Outside });
        }
        if after.fastest > before.fastest {
            return Err(Difference { layer: last_layer, what: What::Fast(after.fastest) });
        }
        Ok(Figures {
            before: self.before.measure.totals(),
            after: self.after.measure.totals(),
            time_s_before: self.before.clock.rest(),
            time_s_after: self.after.clock.rest(),
            layers: self.before.layers,
        })
    }
}

/// The first line of the output that is not where the file has it, for people.
fn first_other(old: &[(u32, u64)], new: &[(u32, u64)], output: &[u8]) -> String {
    let differs = old.iter().zip(new).find(|(a, b)| a != b).map(|(_, b)| b.1);
    let line = differs.and_then(|h| split_lines(output).find(|bytes| hash(bytes) == h));
    String::from_utf8_lossy(line.unwrap_or(b"(at the layer's end)")).trim().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    const HEAD: &str =
        "M83\nM204 S1000\nM106 S100\n;TYPE:Internal infill\n;WIDTH:0.45\nG1 X0 Y0 Z.2 F9000\nG1 F1200\n";
    const BEAD_A: &str = "G1 X10 E1\n";
    const TRAVEL: &str = "G1 Y1 F9000\nG1 F1200\n";
    const BEAD_B: &str = "G1 X0 E1\n";
    const END: &str = "G1 X0 Y0 F9000\nM107\n";

    fn check(input: &str, output: &str, expect: Option<&str>) {
        let mut verifier = Verifier::new(Some(Dialect::Prusa), Accelerations::default());
        let got = verifier
            .layer(1, input.as_bytes(), Some(output.as_bytes()))
            .and_then(|()| verifier.finish(1).map(|_| ()));
        match (got, expect) {
            (Ok(()), None) => {}
            (Err(difference), Some(expect)) => {
                let text = difference.to_string();
                assert!(text.contains(expect), "{text} / {expect}\n{output}");
            }
            (got, _) => panic!("{got:?} instead of {expect:?}\n{output}"),
        }
    }

    #[test]
    fn a_reordered_and_reversed_section_is_the_same() {
        let input = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat();
        let output =
            [HEAD, "G1 X0 Y1 F9000\nG1 F1200\nG1 X10 E1\nG1 Y0 F9000\nG1 F1200\nG1 X0 E1\n", END].concat();
        check(&input, &input, None);
        check(&input, &output, None);
    }

    #[test]
    fn every_other_change_is_found() {
        let input = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat();
        let cases: &[(&str, &str, &str)] = &[
            ("G1 X10 E1", "G1 X10 E1.00001", "other segments"),
            ("G1 X10 E1", "G1 X10.001 E1", "other segments"),
            ("G1 X10 E1", "G1 X5 E.5\nG1 X10 E.5", "3 segments"),
            ("G1 X0 E1", "G1 X0 Z.21 E1", "other segments"),
            ("G1 F1200\nG1 X10", "G1 F1201\nG1 X10", "other segments"),
            ("G1 X10 E1", "M204 S900\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", "M106 S99\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", "M900 K1\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", ";WIDTH:0.5\nG1 X10 E1", "other segments"),
            ("G1 X10 E1", ";TYPE:Perimeter\nG1 X10 E1", "another place"),
            ("G1 X10 E1", "M104 S0\nG1 X10 E1", "command or comment"),
            ("G1 Y1 F9000", "G1 E-1\nG1 Y1 F9000", "between the deposits"),
            ("G1 Y1 F9000", "G1 E.01\nG1 Y1 F9000", "between the deposits"),
            (
                "G1 Y1 F9000\nG1 F1200\nG1 X0 E1\n",
                "G1 E-1\nG1 Y1 F9000\nG1 F1200\nG1 X0 E1\nG1 E1\n",
                "pulled back",
            ),
            ("G1 Y1 F9000", "G1 Z.1\nG1 Y1 F9000\nG1 Z.2", "below the layer"),
            ("G1 Y1 F9000", "G1 Y30 F9000\nG1 Y1", "leave the bounds"),
            ("G1 Y1 F9000", "G1 Y1 F12000", "faster"),
            ("G1 Y1 F9000", &format!("G1 Y1{} F9000", " ".repeat(80)), "longer than the firmware takes"),
            ("G1 X0 Y0 F9000\nM107", "G1 X0 Y.5 F9000\nM107", "the position"),
            ("G1 X0 Y0 F9000\nM107", "G1 X0 Y0 F9000\nG1 E-1\nG1 E1\nM107", "deeper"),
            ("\nM107", "\nM106 S1", "a setting"),
            ("\nM107", "\nM107\nM82", "command or comment"),
        ];
        for (old, new, expect) in cases {
            assert!(input.contains(old), "{old}");
            check(&input, &input.replacen(old, new, 1), Some(expect));
        }
    }

    #[test]
    fn a_wipe_over_an_arc_goes_where_the_arc_went() {
        let arc = "M83\n;TYPE:Internal infill\nG1 X0 Y0 F600\nG3 X10 Y0 I5 J0 E1\n";
        check(
            &[arc, "G1 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            &[arc, "G1 X5 Y-5 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            None,
        );
        check(
            &[arc, "G1 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            &[arc, "G1 X5 Y-5.1 E-1\nG1 E1\nG1 X0 Y0\n"].concat(),
            Some("leave the bounds"),
        );
    }

    #[test]
    fn walls_keep_order_and_direction() {
        let input = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat().replace("Internal infill", "Perimeter");
        let output =
            [HEAD, "G1 X0 Y1 F9000\nG1 F1200\nG1 X10 E1\nG1 Y0 F9000\nG1 F1200\nG1 X0 E1\n", END].concat();
        check(&input, &output.replace("Internal infill", "Perimeter"), Some("order or direction"));
        let other_way = "M83\n;TYPE:Perimeter\nG1 X10 F600\nG1 X0 E1\nG1 X0\n";
        check("M83\n;TYPE:Perimeter\nG1 X0 F600\nG1 X10 E1\nG1 X0\n", other_way, Some("order or direction"));
    }

    #[test]
    fn what_moves_through_time_keeps_its_place() {
        let input = [HEAD, BEAD_A, "M73 P5\n", TRAVEL, BEAD_B, END].concat();
        check(&input, &[HEAD, "M73 P5\n", BEAD_A, TRAVEL, BEAD_B, END].concat(), Some("M73 P5"));
    }

    #[test]
    fn an_unchanged_layer_counts_for_both() {
        let text = [HEAD, BEAD_A, TRAVEL, BEAD_B, END].concat();
        let mut verifier = Verifier::new(Some(Dialect::Prusa), Accelerations::default());
        for number in 0..3 {
            verifier.layer(number, text.as_bytes(), None).unwrap();
        }
        let figures = verifier.finish(3).unwrap();
        assert_eq!(figures.before, figures.after);
        assert!((figures.time_s_before - figures.time_s_after).abs() < 1e-9 && figures.time_s_before > 0.0);
        assert_eq!(figures.before.beads, 6);
    }
}
