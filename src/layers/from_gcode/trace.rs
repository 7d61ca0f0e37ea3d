//! From lines of G-code to paths: what is deposited where, and what the file says of it.
//!
//! Takes a reader, gives a [`Trace`]. A path is a run of beads that join end to
//! end and are alike: same height, same width or flow, same feature. Paths that
//! lie at one height and are of one kind share a [`Sheet`].
use super::guess::{self, Beginning};
use super::{GcodeError, MAX_COORDINATE_MM, MAX_LINE_BYTES, MAX_POINTS};
use crate::layers::shape::{Bounds, Point, UNITS_PER_MM};
use outrigger_gcode::dialect::settings::{number_for_tool, setting};
use outrigger_gcode::dialect::{Dialect, Feature, Mark};
use outrigger_gcode::line::{Command, Line, parse};
use outrigger_gcode::state::{Effect, Kind, Machine, Move};
use rustc_hash::FxHashMap;
use std::io::{BufRead, Read};

/// What the beads of a path are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Class {
    /// Walls and solid infill.
    Part,
    /// Sparse infill: what it lies in counts as solid.
    Infill,
    /// Supports and raft: they bear the part.
    Support,
    /// Skirt, brim, tower, prime lines.
    Aid,
}

/// Beads that join end to end.
#[derive(Clone, Copy, Debug)]
pub(super) struct Path {
    /// Its first point.
    pub(super) first: u32,
    /// How many points.
    pub(super) count: u32,
    /// Its sheet.
    pub(super) sheet: u32,
    /// Width, mm; 0 where the file does not say it.
    pub(super) width_mm: f32,
    /// The file says it.
    pub(super) width_told: bool,
    /// Filament pushed a millimetre of way: mm, or mm³ where E counts volume.
    pub(super) flow: f32,
    /// The tool that printed it.
    pub(super) tool: u16,
}

/// Paths at one height, of one kind. Heights are in grid steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sheet {
    pub(super) key: SheetKey,
    /// Of its points.
    pub(super) bounds: Bounds,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct SheetKey {
    /// How often the part began anew below where it was.
    pub(super) pass: u32,
    /// Height of the nozzle; of a bead that rises, in its middle.
    pub(super) top: i32,
    /// Thickness as the file says it; 0 where it does not.
    pub(super) height: i32,
    pub(super) class: Class,
    /// Free threads over air, which are round.
    pub(super) bridge: bool,
    /// The nozzle rises along the bead.
    pub(super) slope: bool,
}

/// A whole job.
#[derive(Debug, Default)]
pub(super) struct Trace {
    pub(super) points: Vec<Point>,
    pub(super) paths: Vec<Path>,
    pub(super) sheets: Vec<Sheet>,
    pub(super) dialect: Option<Dialect>,
    pub(super) features_told: bool,
    pub(super) relative_e_guessed: bool,
    /// E counts mm³ rather than mm.
    pub(super) volumetric: bool,
    /// Diameter of each tool's filament, as the file says it.
    pub(super) filament: Option<String>,
    /// Distance between supports and part, mm.
    pub(super) contact_mm: Option<f64>,
    pub(super) lines: u64,
    pub(super) beads: u64,
}

impl Trace {
    pub(super) fn points_of(&self, path: &Path) -> &[Point] {
        &self.points[path.first as usize..(path.first + path.count) as usize]
    }

    /// Diameter of a tool's filament, mm, as the file says it.
    pub(super) fn filament_mm(&self, tool: u16) -> Option<f64> {
        number_for_tool(self.filament.as_deref()?, tool).filter(|d| (0.5..=5.0).contains(d))
    }
}

/// Shorter moves leave a blob rather than a bead, mm.
const MIN_LENGTH_MM: f64 = 1e-4;

/// Beads that begin this near to where the last one ended join it, grid steps.
const JOIN: i32 = 20;

/// Changes of Z below this along a bead are none, mm.
const FLAT_MM: f64 = 1e-4;

/// The part begins anew where it is printed this much below its highest bead, grid steps.
const ANEW: i32 = 300;

/// Flows that differ by less belong to one width.
const FLOW_RATIO: f64 = 0.03;

/// What rounding to the last digit of E leaves uncertain in one bead, mm.
const FLOW_ROUNDING_MM: f64 = 2e-5;

/// A bead at one height among beads that rise rises too, where its like would have
/// risen by less than this: Z has three decimals. Mm.
const RISE_MM: f64 = 0.005;

/// Thickest bead that a file may claim, mm.
const MAX_HEIGHT_MM: f64 = 3.0;

/// Chords of an arc lie within this of it, mm.
const CHORD_MM: f64 = 0.005;

/// Chords of an arc at most.
const MAX_CHORDS: f64 = 4096.0;

struct Tracer {
    machine: Machine,
    trace: Trace,
    known: FxHashMap<SheetKey, u32>,
    feature: Feature,
    /// The file marks its layers or features: what comes before the first is a prime line.
    marked: bool,
    started: bool,
    width_mm: f64,
    height_mm: f64,
    /// The layer's own thickness, said between its mark and its first bead.
    layer_height_mm: f64,
    fresh_layer: bool,
    pass: u32,
    /// Highest flat bead of this pass.
    reached: i32,
    run: Run,
    /// Filament and way of the last path so far.
    pushed: f64,
    way: f64,
}

/// Beads without a travel between them: whether they rise.
#[derive(Default)]
struct Run {
    way_mm: f64,
    rise_mm: f64,
    /// Way since Z last changed.
    flat_mm: f64,
}

impl Run {
    /// Takes one more bead; whether it is one that rises.
    fn rises(&mut self, rise_mm: f64, length_mm: f64) -> bool {
        self.way_mm += length_mm;
        self.rise_mm += rise_mm.abs();
        if rise_mm.abs() > FLAT_MM {
            self.flat_mm = 0.0;
            return true;
        }
        self.flat_mm += length_mm;
        self.rise_mm > 0.0 && self.flat_mm * self.rise_mm < RISE_MM * self.way_mm
    }
}

/// Reads a whole job.
pub(super) fn trace(mut reader: impl BufRead) -> Result<Trace, GcodeError> {
    let beginning = Beginning::read(&mut reader)?;
    let mut tracer = Tracer::new(&beginning);
    let mut reader = std::io::Cursor::new(beginning.bytes).chain(reader);
    let mut text = Vec::new();
    while tracer.read_line(&mut reader, &mut text)? {
        tracer.line(&text)?;
    }
    if tracer.trace.paths.is_empty() {
        return Err(GcodeError::Nothing);
    }
    tracer.settle();
    if !tracer.marked {
        guess::set_primes(&mut tracer.trace.sheets);
    }
    Ok(tracer.trace)
}

impl Tracer {
    fn new(beginning: &Beginning) -> Tracer {
        let mut machine = Machine::default();
        machine.absolute_e = !beginning.relative_e;
        let trace = Trace {
            dialect: beginning.dialect,
            relative_e_guessed: beginning.relative_e,
            ..Trace::default()
        };
        Tracer {
            machine,
            trace,
            known: FxHashMap::default(),
            feature: Feature::Unknown,
            marked: beginning.marked,
            started: false,
            width_mm: 0.0,
            height_mm: 0.0,
            layer_height_mm: 0.0,
            fresh_layer: false,
            pass: 0,
            reached: i32::MIN,
            run: Run::default(),
            pushed: 0.0,
            way: 0.0,
        }
    }

    fn read_line(&mut self, reader: &mut impl BufRead, text: &mut Vec<u8>) -> Result<bool, GcodeError> {
        text.clear();
        let line = self.trace.lines + 1;
        let read = reader
            .take(MAX_LINE_BYTES as u64 + 1)
            .read_until(b'\n', text)
            .map_err(|source| GcodeError::Read { line: self.trace.lines, source })?;
        if read > MAX_LINE_BYTES {
            return Err(GcodeError::LongLine { line });
        }
        if memchr::memchr(0, text).is_some() {
            return Err(GcodeError::Binary { line });
        }
        self.trace.lines = line;
        Ok(read > 0)
    }

    fn line(&mut self, text: &[u8]) -> Result<(), GcodeError> {
        let line = parse(text);
        let mark = match self.trace.dialect {
            Some(dialect) => dialect.mark(&line),
            None => guess::mark(&line),
        };
        let inline = match mark {
            Some(Mark::Inline(feature)) => Some(feature),
            Some(mark) => {
                self.mark(mark);
                None
            }
            None => {
                self.setting(&line);
                None
            }
        };
        match self.machine.apply(&line) {
            Effect::Motion(m) if m.kind() == Kind::Deposit => {
                let stays = |p: f64| p.is_finite() && p.abs() <= MAX_COORDINATE_MM;
                if !m.from.into_iter().chain(m.to).all(stays) {
                    return Err(GcodeError::Beyond { line: self.trace.lines });
                }
                self.trace.features_told |= inline.is_some();
                self.deposit(&m, inline.unwrap_or(self.feature))
            }
            Effect::Motion(m) => {
                if m.kind() == Kind::Travel {
                    self.run = Run::default();
                }
                Ok(())
            }
            Effect::Other => {
                self.volumetric(&line);
                Ok(())
            }
            _ => Ok(()),
        }
    }

    fn mark(&mut self, mark: Mark<'_>) {
        match mark {
            Mark::Layer => {
                self.started = true;
                self.fresh_layer = true;
            }
            Mark::Feature(feature) => {
                self.feature = feature;
                self.trace.features_told |= feature != Feature::Unknown && feature != Feature::Custom;
                self.started |= feature != Feature::Custom;
            }
            Mark::Width(width) => self.width_mm = width,
            Mark::Height(height) => {
                let sane = height > 0.0 && height <= MAX_HEIGHT_MM;
                self.height_mm = if sane { height } else { 0.0 };
                // The first one is the layer's: a layer that begins with a bridge says that one's too.
                if std::mem::take(&mut self.fresh_layer) {
                    self.layer_height_mm = self.height_mm;
                }
            }
            _ => {}
        }
    }

    /// Settings that slicers write as comments, at the end or the beginning of the file.
    fn setting(&mut self, line: &Line<'_>) {
        let Some((key, value)) = setting(line) else { return };
        match key {
            "filament_diameter" if value.len() < 1000 => self.trace.filament = Some(value.to_owned()),
            "use_volumetric_e" => self.trace.volumetric |= value == "1",
            "support_material_contact_distance" | "support_top_z_distance" => {
                self.trace.contact_mm = number_for_tool(value, 0);
            }
            _ => {}
        }
    }

    /// `M200 D1.75`: E counts mm³ from here on; slicers write it before the first bead.
    fn volumetric(&mut self, line: &Line<'_>) {
        if line.command == Command::classic(b'M', 200)
            && let Some(diameter) = line.words.get(b'D')
        {
            self.trace.volumetric = diameter > 0.0;
        }
    }

    /// `None`: leaves nothing that counts.
    fn class(&self, feature: Feature) -> Option<Class> {
        match feature {
            Feature::Support | Feature::SupportInterface => Some(Class::Support),
            Feature::Skirt | Feature::Tower | Feature::Custom => Some(Class::Aid),
            // It smooths what the layer has printed already.
            Feature::Ironing => None,
            Feature::Infill | Feature::AnyInfill => Some(Class::Infill),
            Feature::Unknown if self.marked && !self.started => Some(Class::Aid),
            _ => Some(Class::Part),
        }
    }

    fn deposit(&mut self, m: &Move, feature: Feature) -> Result<(), GcodeError> {
        self.fresh_layer = false;
        let length = m.length_mm();
        let Some(class) = self.class(feature) else { return Ok(()) };
        if length < MIN_LENGTH_MM {
            return Ok(());
        }
        let bridge =
            matches!(feature, Feature::Bridge | Feature::InternalBridge | Feature::OverhangPerimeter);
        let slope = self.run.rises(m.to[2] - m.from[2], length);
        let top = grid(f64::midpoint(m.from[2], m.to[2]));
        if !slope && class != Class::Aid {
            if top < self.reached.saturating_sub(ANEW) {
                self.pass += 1;
                self.reached = top;
            }
            self.reached = self.reached.max(top);
        }
        // A thread over air is as high as it is wide, but lies in its layer.
        let layer = self.layer_height_mm;
        let height = if bridge && layer > 0.0 { layer.min(self.height_mm) } else { self.height_mm };
        let key = SheetKey { pass: self.pass, top, height: grid(height), class, bridge, slope };
        self.extend(m, key, length);
        if self.trace.points.len() > MAX_POINTS {
            return Err(GcodeError::ManyBeads { line: self.trace.lines });
        }
        Ok(())
    }

    /// Appends the move to the last path, or begins another.
    fn extend(&mut self, m: &Move, key: SheetKey, length: f64) {
        let from = Point::from_mm(m.from[0], m.from[1]);
        let flow = m.e / length;
        let width = self.width_mm as f32;
        let tool = self.machine.tool;
        let near = |p: Point| (p.x - from.x).abs() <= JOIN && (p.y - from.y).abs() <= JOIN;
        let Trace { points, paths, sheets, beads, .. } = &mut self.trace;
        let alike = paths.last().is_some_and(|path| {
            let before = self.pushed / self.way;
            let same_flow =
                (flow - before).abs() <= FLOW_RATIO * before + FLOW_ROUNDING_MM / length.min(self.way);
            sheets[path.sheet as usize].key == key
                && path.tool == tool
                && path.width_mm == width
                && (width > 0.0 || same_flow)
                && points.last().is_some_and(|&p| near(p))
        });
        if !alike {
            if let Some(path) = paths.last_mut() {
                path.flow = (self.pushed / self.way) as f32;
            }
            let sheet = *self.known.entry(key).or_insert_with(|| {
                sheets.push(Sheet { key, bounds: Bounds::EMPTY });
                sheets.len() as u32 - 1
            });
            let first = points.len() as u32;
            points.push(from);
            let sheet_bounds = &mut sheets[sheet as usize].bounds;
            *sheet_bounds = sheet_bounds.with(from);
            paths.push(Path {
                first,
                count: 1,
                sheet,
                width_mm: width,
                width_told: width > 0.0,
                flow: 0.0,
                tool,
            });
            (self.pushed, self.way) = (0.0, 0.0);
        }
        self.pushed += m.e;
        self.way += length;
        if let Some(path) = paths.last_mut() {
            let bounds = &mut sheets[path.sheet as usize].bounds;
            flatten(m, |p| {
                points.push(p);
                *bounds = bounds.with(p);
                path.count += 1;
                *beads += 1;
            });
        }
    }

    /// The last path's flow, once nothing can be added to it.
    fn settle(&mut self) {
        if let Some(path) = self.trace.paths.last_mut() {
            path.flow = (self.pushed / self.way) as f32;
        }
    }
}

/// Millimetres in grid steps.
pub(super) fn grid(mm: f64) -> i32 {
    (mm * UNITS_PER_MM).round() as i32
}

/// The points of a move after its first: its end, or chords of its arc.
fn flatten(m: &Move, mut put: impl FnMut(Point)) {
    if let Some(arc) = m.arc {
        let (radius, sweep) = (arc.radius(m.from), arc.sweep(m.from, m.to));
        // The sagitta of a chord is r (1 − cos(step / 2)), about r step² / 8.
        let step = (8.0 * CHORD_MM / radius.max(CHORD_MM)).sqrt();
        let count = (sweep.abs() / step).ceil().clamp(1.0, MAX_CHORDS) as u32;
        let start = (m.from[1] - arc.centre[1]).atan2(m.from[0] - arc.centre[0]);
        for k in 1..count {
            let angle = start + sweep * f64::from(k) / f64::from(count);
            let at = [arc.centre[0] + radius * angle.cos(), arc.centre[1] + radius * angle.sin()];
            // A centre far off, of a damaged line, must not leave the grid.
            put(Point::from_mm(
                at[0].clamp(-MAX_COORDINATE_MM, MAX_COORDINATE_MM),
                at[1].clamp(-MAX_COORDINATE_MM, MAX_COORDINATE_MM),
            ));
        }
    }
    put(Point::from_mm(m.to[0], m.to[1]));
}
