//! One of the two files that are compared: what its bytes do, layer by layer.
use super::super::measure::Measure;
use super::super::time::{Accelerations, Clock};
use super::{E_SUM_MM, UNIT_MM};
use outrigger_gcode::dialect::{Dialect, Feature, Mark, ObjectMark};
use outrigger_gcode::line::{Command, Line, key_value, parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine, Move};
use std::collections::HashMap;
use std::hash::{DefaultHasher, Hash, Hasher};

/// What holds for a deposit beside its place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Context {
    pub(super) feature: Feature,
    pub(super) tool: u16,
    pub(super) object: u64,
    width_mm: f64,
    height_mm: f64,
    /// Hash of all the settings in force.
    settings: u64,
}

/// A deposit, ends ordered so that its direction does not show.
#[derive(Clone, Copy, Debug)]
pub(super) struct Segment {
    /// x, y, z of both ends and the centre of the arc, in [`UNIT_MM`].
    pub(super) place: [i64; 8],
    /// 0 for a line, 1 for a clockwise arc from the lower end, 2 for the other.
    pub(super) arc: u8,
    /// The ends were swapped.
    pub(super) reversed: bool,
    pub(super) e: f64,
    pub(super) feed: f64,
    pub(super) context: u32,
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

    pub(super) fn key(&self) -> ([i64; 8], u8, i64, u64) {
        (self.place, self.arc, (self.e / UNIT_MM).round() as i64, self.feed.to_bits())
    }
}

/// What a layer's bytes do.
#[derive(Default)]
pub(super) struct Reading {
    pub(super) segments: Vec<Segment>,
    pub(super) contexts: Vec<Context>,
    /// Deposits before it, and its hash.
    pub(super) others: Vec<(u32, u64)>,
    pub(super) lowest_travel: f64,
    /// Filament moved between deposits, mm, as if none were left pulled back at the end.
    pub(super) primed_mm: f64,
    /// What each stretch with a retraction moved in all, mm: 0, or its extra.
    pub(super) extras_mm: Vec<f64>,
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
    pub(super) fn extra_mm(&self) -> f64 {
        let mut extras = self.extras_mm.clone();
        extras.sort_by(f64::total_cmp);
        extras.get(extras.len() / 2).copied().unwrap_or(0.0)
    }
}

/// Reads one of the two files.
pub(super) struct Side {
    dialect: Option<Dialect>,
    pub(super) machine: Machine,
    pub(super) context: Context,
    /// A name for the feature as the file spells it, to tell beads apart.
    pub(super) feature_name: u32,
    pub(super) settings: HashMap<Vec<u8>, u64>,
    pub(super) measure: Measure,
    pub(super) clock: Clock,
    pub(super) low: [f64; 2],
    pub(super) high: [f64; 2],
    pub(super) fastest: f64,
    pub(super) layers: u64,
}

impl Side {
    pub(super) fn new(dialect: Option<Dialect>, accelerations: Accelerations) -> Side {
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

    pub(super) fn read(&mut self, bytes: &[u8]) -> Reading {
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
            if kind == Kind::Travel && m.e != 0.0 {
                // Filament pushed on the way up or down: it belongs where it stands.
                let place = m.from.into_iter().chain(m.to).map(|v| (v / UNIT_MM).round() as i64);
                let all: Vec<u8> =
                    place.chain([(m.e / UNIT_MM).round() as i64]).flat_map(i64::to_le_bytes).collect();
                reading.others.push((reading.segments.len() as u32, hash(&all)));
            }
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
    pub(super) fn stands_like(&self, other: &Side) -> bool {
        self.machine == other.machine
            && self.context == other.context
            && self.feature_name == other.feature_name
            && self.measure.stands_like(&other.measure)
            && self.clock.accelerations == other.clock.accelerations
    }
}

pub(super) fn hash(bytes: &[u8]) -> u64 {
    let mut hasher = DefaultHasher::new();
    bytes.hash(&mut hasher);
    // 0 is "none" among the objects.
    hasher.finish() | 1
}

fn small_hash(bytes: &[u8]) -> u32 {
    (hash(bytes) >> 32) as u32
}
