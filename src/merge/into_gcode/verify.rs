//! Proves that a result is the same job with supports and nothing else.
//!
//! Takes both texts layer by layer, which stretches of the result are said to be new,
//! and the sections as they were planned. Reads both texts again. It shares with what
//! made them the language, and the section of a bead; none of their reasoning.
//!
//! What must hold:
//! - the result without the new stretches is the input, byte for byte
//! - every line of the input does the same in both: the same move with the same E, feed
//!   rate, feature, width and height, the filament pulled back as far; a travel may run
//!   higher, and then comes down before anything else happens
//! - new are only moves, retractions, comments of feature and size, and `G92 E`
//! - a new bead is marked as support, lies at the layer's height, its middle within the
//!   planned section (grown by [`GROWN_MM`]; a dot's ends by 0.4 widths besides), its edge
//!   at least the clearance from every bead of the file in the layer, with the filament
//!   of its width and thickness, and none pulled back
//! - new moves are no lower than the layer, no faster than the file's own, no
//!   retraction deeper than its deepest, no line longer than firmware takes
//! - no travel of the file leads over new beads at their height
use super::Options;
use super::cross::distance_mm as between_mm;
use super::plan::Plan;
use crate::layers::shape::{Place, Point as Grid, Polygon, ring_edges};
use crate::merge::gcode::flow::Shape;
use crate::merge::gcode::side::{PULLED_MM, Side, UNIT_MM, near};
use crate::merge::gcode::survey::Survey;
use crate::toolpath::bead::{Point, distance_mm};
use outrigger_gcode::dialect::{Dialect, Feature, Mark};
use outrigger_gcode::line::{Command, parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine, Move};
use std::ops::Range;

/// Beads may lie beyond the planned section by so much, mm: roundings of the grid and of arcs.
pub const GROWN_MM: f64 = 0.03;

/// Points looked at along a bead lie this near to each other, mm.
const STEP_MM: f64 = 0.5;

/// Filament of a bead may differ by this share and by rounding, mm.
const E_SHARE: f64 = 0.002;
const E_MM: f64 = 2e-5;

/// Roundings of what is kept clear, mm.
const CLEAR_MM: f64 = 0.04;

/// Width of prime lines, as far as supports keep from them, mm.
const PURGE_MM: f64 = 1.0;

/// Marlin takes 95 bytes of a framed line; `N12345678 ` and `*255` are 14 of them.
const MAX_CODE_BYTES: usize = 81;

/// Where the proof fails.
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
    /// The input's bytes are not all there, or others are.
    #[error("a line of the slicer would be changed, moved or left out")]
    Bytes,
    /// A line of the input does something else.
    #[error("{0:?} would do something else than before: {1}")]
    Line(String, &'static str),
    /// A line that supports have no need of.
    #[error("{0:?} would be put in")]
    Foreign(String),
    /// A bead outside of the planned sections.
    #[error("a bead at {0:.3} {1:.3} would lie outside of the planned supports")]
    Outside(f64, f64),
    /// A bead too near to those of the file.
    #[error("a bead of supports at {0:.3} {1:.3} would come within {2:.3} mm of what the file prints")]
    Near(f64, f64, f64),
    /// A bead with too much or too little filament.
    #[error("a bead of supports would take {0:.5} mm of filament instead of {1:.5}")]
    Flow(f64, f64),
    /// A bead that is printed wrongly.
    #[error("a bead of supports would be printed {0}")]
    Bead(&'static str),
    /// A move that the file would not make.
    #[error("a new move would go {0}")]
    Move(&'static str),
    /// A travel of the file at the height of new beads.
    #[error("a travel of the file would lead over supports at {0:.3} {1:.3}")]
    Dragged(f64, f64),
    /// A line that Marlin would cut.
    #[error("a line would be longer than the firmware takes: {0:?}")]
    Long(String),
    /// The state at the layer's end.
    #[error("{0} would not be as the file leaves it")]
    End(&'static str),
}

/// What is said of a layer's result.
pub(super) struct Made<'a> {
    pub(super) text: &'a [u8],
    pub(super) added: &'a [Range<usize>],
    pub(super) plan: &'a Plan,
}

/// A bead, and whether it is the part's.
#[derive(Clone, Copy, Debug)]
struct Bead {
    ends: [Point; 2],
    width_mm: f64,
    part: bool,
}

/// Beads that join, with the bounds of their middles.
struct Run {
    beads: Vec<[Point; 2]>,
    low: Point,
    high: Point,
    length_mm: f64,
}

impl Run {
    /// Whether a segment comes within a distance of the bounds.
    fn is_near(&self, [a, b]: [Point; 2], distance_mm: f64) -> bool {
        (0..2).all(|k| {
            a[k].min(b[k]) <= self.high[k] + distance_mm && a[k].max(b[k]) >= self.low[k] - distance_mm
        })
    }
}

/// Compares two jobs layer by layer.
pub(super) struct Verifier {
    dialect: Dialect,
    shape: Shape,
    e_per_mm3: f64,
    width_mm: f64,
    clearances_mm: [f64; 2],
    before: Side,
    after: Side,
    /// Beads before the first layer: they stand on the plate, to this height.
    purge: Vec<(Bead, f64)>,
}

impl Verifier {
    pub(super) fn new(survey: &Survey, options: &Options) -> Verifier {
        Verifier {
            dialect: survey.dialect,
            shape: Shape::of(survey.dialect),
            e_per_mm3: survey.e_per_mm3,
            width_mm: survey.width_mm,
            clearances_mm: [options.clearance_mm, options.aid_clearance_mm],
            before: Side::new(),
            after: Side::new(),
            purge: Vec::new(),
        }
    }

    /// Compares a layer; `made` is `None` where nothing was put in.
    ///
    /// # Errors
    /// What differs.
    pub(super) fn layer(
        &mut self,
        layer: u32,
        input: &[u8],
        made: Option<Made<'_>>,
    ) -> Result<(), Difference> {
        self.compare(layer, input, made).map_err(|what| Difference { layer, what })
    }

    fn compare(&mut self, layer: u32, input: &[u8], made: Option<Made<'_>>) -> Result<(), What> {
        let mut check = Layer::new(made.as_ref().map(|m| m.plan));
        let absolute = self.before.machine.e_is_absolute();
        let mut rest = input;
        let text = made.as_ref().map_or(input, |m| m.text);
        let mut from = 0;
        let added = made.as_ref().map_or(&[][..], |m| m.added);
        for new in added.iter().chain([&(text.len()..text.len())]) {
            let kept = text.get(from..new.start).ok_or(What::Bytes)?;
            rest = rest.strip_prefix(kept).ok_or(What::Bytes)?;
            for bytes in split_lines(kept) {
                self.kept(bytes, &mut check)?;
            }
            for bytes in split_lines(text.get(new.clone()).ok_or(What::Bytes)?) {
                self.new_line(bytes, &mut check)?;
            }
            from = new.end;
        }
        if !rest.is_empty() || from != text.len() {
            return Err(What::Bytes);
        }
        if layer == 0 {
            let standing =
                check.own.iter().map(|(bead, z)| (Bead { width_mm: PURGE_MM, part: false, ..*bead }, *z));
            self.purge = standing.collect();
        }
        if let Some(plan) = check.plan {
            self.beads(plan, &check)?;
        }
        self.ends(absolute)
    }

    /// A line of the input, in both.
    fn kept(&mut self, bytes: &[u8], check: &mut Layer<'_>) -> Result<(), What> {
        let line = parse(bytes);
        let fails = |why| Err(What::Line(String::from_utf8_lossy(bytes).trim().to_owned(), why));
        let stood = (self.before.machine.position, self.after.machine.position);
        let depths = (self.before.depth_mm, self.after.depth_mm);
        let (a, b) = (self.before.read(&line, self.dialect), self.after.read(&line, self.dialect));
        let deeper = (depths.0 - depths.1).abs() > PULLED_MM
            || self.before.machine.firmware_retracted != self.after.machine.firmware_retracted;
        match (a, b) {
            (Effect::Motion(a), Effect::Motion(b)) => {
                if a.feed != b.feed {
                    return fails("its feed rate");
                }
                let kind = a.kind();
                let travels = kind == Kind::Travel && a.e == 0.0 && b.e == 0.0 || kind == Kind::Still;
                if travels {
                    let flat = (0..2).all(|k| (a.to[k] - b.to[k]).abs() < UNIT_MM);
                    if !flat || b.to[2] < a.to[2] - UNIT_MM || !matches!(b.kind(), Kind::Travel | Kind::Still)
                    {
                        return fails("where it leads");
                    }
                    check.travels.extend((b.kind() == Kind::Travel && !check.added.is_empty()).then_some(b));
                    return Ok(());
                }
                if !near(a.from, b.from) || !near(a.to, b.to) || a.arc != b.arc && a.arc.is_none() {
                    return fails("where it leads");
                }
                if (a.e - b.e).abs() > UNIT_MM {
                    return fails("its filament");
                }
                if deeper {
                    return fails("with the filament pulled back");
                }
                if kind == Kind::Deposit {
                    if self.before.context != self.after.context {
                        return fails("what it is");
                    }
                    self.own_bead(&a, check);
                }
                Ok(())
            }
            (a, b) if std::mem::discriminant(&a) != std::mem::discriminant(&b) => fails("its effect"),
            _ => {
                let mute = line.command == Command::None
                    || matches!(line.command, Command::Classic { letter: b'M', number: 73, .. });
                if !mute && (!near(stood.0, stood.1) || deeper) {
                    return fails("where it stands");
                }
                Ok(())
            }
        }
    }

    fn own_bead(&self, m: &Move, check: &mut Layer<'_>) {
        let context = self.before.context;
        let width_mm = if context.width_mm > 0.0 {
            context.width_mm
        } else if let Some(plan) = check.plan {
            self.shape.width_mm(m.e / m.length_mm() / self.e_per_mm3, plan.top_mm - plan.bottom_mm)
        } else {
            PURGE_MM
        };
        let bead = |ends| Bead { ends, width_mm: width_mm.clamp(0.1, 3.0), part: context.feature.is_part() };
        m.chords(|a, b| check.own.push((bead([a, b]), m.to[2])));
    }

    /// A new line, in the result alone.
    fn new_line(&mut self, bytes: &[u8], check: &mut Layer<'_>) -> Result<(), What> {
        let line = parse(bytes);
        let foreign = || Err(What::Foreign(String::from_utf8_lossy(bytes).trim().to_owned()));
        let Some(plan) = check.plan else { return foreign() };
        if memchr::memchr(b';', bytes).unwrap_or(bytes.trim_ascii_end().len()) > MAX_CODE_BYTES {
            return Err(What::Long(String::from_utf8_lossy(bytes).trim().to_owned()));
        }
        let inline = match self.dialect.mark(&line) {
            Some(Mark::Inline(feature)) => Some(feature),
            _ => None,
        };
        if line.command == Command::None {
            return match self.dialect.mark(&line) {
                Some(Mark::Feature(_) | Mark::Width(_) | Mark::Height(_)) => {
                    self.after.read(&line, self.dialect);
                    check.run = false;
                    Ok(())
                }
                _ => foreign(),
            };
        }
        let depth_mm = self.after.depth_mm;
        let own = self.after.context.feature;
        let effect = self.after.read(&line, self.dialect);
        if inline.is_some() {
            // What Slic3r says of one move holds for that one.
            self.after.context.feature = own;
        }
        match effect {
            Effect::Motion(m) if m.arc.is_none() && line.words.complete => {
                let kind = m.kind();
                check.run &= kind == Kind::Deposit || kind == Kind::Still;
                match kind {
                    Kind::Deposit => {
                        let feature = inline.unwrap_or(own);
                        self.new_bead(plan, &m, feature, depth_mm, check)
                    }
                    Kind::Wipe => Err(What::Move("while it pulls filament back")),
                    Kind::Travel if m.e != 0.0 => Err(What::Move("up with filament")),
                    Kind::Travel if m.to[2] < plan.top_mm - UNIT_MM => Err(What::Move("below the layer")),
                    Kind::Travel | Kind::Filament | Kind::Still => Ok(()),
                }
            }
            Effect::SetE | Effect::FirmwareRetract | Effect::FirmwareUnretract => {
                check.run = false;
                Ok(())
            }
            _ => foreign(),
        }
    }

    fn new_bead(
        &self,
        plan: &Plan,
        m: &Move,
        feature: Feature,
        depth_mm: f64,
        check: &mut Layer<'_>,
    ) -> Result<(), What> {
        if !feature.is_support() {
            return Err(What::Bead("as something else"));
        }
        if depth_mm > PULLED_MM || self.after.machine.firmware_retracted {
            return Err(What::Bead("with the filament pulled back"));
        }
        if (m.from[2] - plan.top_mm).abs() > UNIT_MM || (m.to[2] - plan.top_mm).abs() > UNIT_MM {
            return Err(What::Bead("at another height"));
        }
        let thickness = plan.top_mm - plan.bottom_mm;
        let due = m.length_mm() * self.shape.area_mm2(self.width_mm, thickness) * self.e_per_mm3;
        if (m.e - due).abs() > E_MM + E_SHARE * due {
            return Err(What::Flow(m.e, due));
        }
        let ends = [[m.from[0], m.from[1]], [m.to[0], m.to[1]]];
        let low = [ends[0][0].min(ends[1][0]), ends[0][1].min(ends[1][1])];
        let high = [ends[0][0].max(ends[1][0]), ends[0][1].max(ends[1][1])];
        match check.added.last_mut().filter(|_| check.run) {
            Some(run) => {
                run.beads.push(ends);
                run.length_mm += m.length_mm();
                for k in 0..2 {
                    run.low[k] = run.low[k].min(low[k]);
                    run.high[k] = run.high[k].max(high[k]);
                }
            }
            None => check.added.push(Run { beads: vec![ends], low, high, length_mm: m.length_mm() }),
        }
        check.run = true;
        Ok(())
    }

    /// What holds for the layer's new beads together.
    fn beads(&self, plan: &Plan, check: &Layer<'_>) -> Result<(), What> {
        let planned: Vec<Planned<'_>> = plan
            .section
            .body
            .polygons
            .iter()
            .chain(&plan.section.interface.polygons)
            .map(Planned::new)
            .collect();
        let mut last = 0;
        for run in &check.added {
            // A dot is a line of 0.785 widths where a disc is meant.
            let dot = run.beads.len() == 1 && run.length_mm < 0.8 * self.width_mm;
            let grown = GROWN_MM + if dot { 0.4 * self.width_mm } else { 0.0 };
            for (n, &[a, b]) in run.beads.iter().enumerate() {
                let steps = (distance_mm(a, b) / STEP_MM).ceil().max(1.0);
                // Each begins where the one before it ended.
                for k in u32::from(n > 0)..=steps as u32 {
                    let t = f64::from(k) / steps;
                    let p = [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
                    if !planned.get(last).is_some_and(|own| own.holds(p, grown)) {
                        last = (planned.iter().position(|own| own.holds(p, grown)))
                            .ok_or(What::Outside(p[0], p[1]))?;
                    }
                }
            }
        }
        // From left to right, so that few are looked at for each bead of the file.
        let mut runs: Vec<&Run> = check.added.iter().collect();
        runs.sort_by(|a, b| a.low[0].total_cmp(&b.low[0]));
        let widest = runs.iter().map(|run| run.high[0] - run.low[0]).fold(0.0, f64::max);
        let near = |ends: [Point; 2], distance: f64| {
            let (left, right) =
                (ends[0][0].min(ends[1][0]) - distance, ends[0][0].max(ends[1][0]) + distance);
            let from = runs.partition_point(|run| run.low[0] < left - widest);
            let reached = runs[from..].iter().take_while(move |run| run.low[0] <= right);
            reached.filter(move |run| run.is_near(ends, distance))
        };
        let purge = self.purge.iter().filter(|(_, z)| plan.bottom_mm < *z).map(|(bead, _)| bead);
        for own in check.own.iter().map(|(bead, _)| bead).chain(purge) {
            let clearance = self.clearances_mm[usize::from(!own.part)];
            let least = (own.width_mm + self.width_mm) / 2.0 + clearance - CLEAR_MM;
            for run in near(own.ends, least) {
                for &bead in &run.beads {
                    let gap = between_mm(bead, own.ends);
                    if gap < least {
                        let edge = gap - (own.width_mm + self.width_mm) / 2.0;
                        return Err(What::Near(bead[0][0], bead[0][1], edge));
                    }
                }
            }
        }
        for m in check.travels.iter().filter(|m| check.low(m, plan)) {
            let way = [[m.from[0], m.from[1]], [m.to[0], m.to[1]]];
            for run in near(way, 0.0) {
                if let Some(bead) = run.beads.iter().find(|bead| between_mm(**bead, way) < UNIT_MM) {
                    return Err(What::Dragged(bead[0][0], bead[0][1]));
                }
            }
        }
        Ok(())
    }

    /// The layer's end. `absolute`: E words were positions when it began. Where they become so
    /// only later, what E is called then depends on all that went before, and every move
    /// that it makes a difference to is compared as a move.
    fn ends(&self, absolute: bool) -> Result<(), What> {
        let (a, b) = (&self.before.machine, &self.after.machine);
        let near = |x: f64, y: f64| (x - y).abs() < UNIT_MM;
        let checks = [
            ("the position", (0..3).all(|k| near(a.position[k], b.position[k]))),
            ("the feed rate", a.feed == b.feed),
            ("E", !(absolute && a.e_is_absolute()) || near(a.e, b.e)),
            ("a mode", {
                let modes = |m: &Machine| (m.absolute, m.e_is_absolute(), m.inches, m.tool, m.offset);
                modes(a) == modes(b)
            }),
            ("what is printed", self.before.context == self.after.context),
            ("the retraction", {
                a.firmware_retracted == b.firmware_retracted
                    && (self.before.depth_mm - self.after.depth_mm).abs() < PULLED_MM
            }),
        ];
        checks.iter().find(|(_, holds)| !holds).map_or(Ok(()), |(what, _)| Err(What::End(what)))
    }

    /// What holds for the jobs as wholes.
    ///
    /// # Errors
    /// What differs.
    pub(super) fn finish(self) -> Result<(), Difference> {
        let fails = |what| Err(Difference { layer: 0, what: What::Move(what) });
        if self.after.deepest_mm > self.before.deepest_mm + PULLED_MM {
            return fails("with the filament pulled back deeper than the file does");
        }
        if self.after.fastest > self.before.fastest {
            return fails("faster than the file's own");
        }
        Ok(())
    }
}

/// What is found in a layer.
struct Layer<'a> {
    plan: Option<&'a Plan>,
    /// Beads of the file, and their heights.
    own: Vec<(Bead, f64)>,
    added: Vec<Run>,
    /// The next new bead joins the last one.
    run: bool,
    /// Of the file, as the result makes them, after the first new bead.
    travels: Vec<Move>,
}

impl<'a> Layer<'a> {
    fn new(plan: Option<&'a Plan>) -> Layer<'a> {
        Layer { plan, own: Vec::new(), added: Vec::new(), run: false, travels: Vec::new() }
    }

    /// Whether a travel is at the height of the new beads.
    fn low(&self, m: &Move, plan: &Plan) -> bool {
        m.moves_xy() && m.from[2].min(m.to[2]) <= plan.top_mm + GROWN_MM
    }
}

/// A planned polygon and its bounds, mm.
struct Planned<'a> {
    polygon: &'a Polygon,
    bounds: [Point; 2],
}

impl Planned<'_> {
    fn new(polygon: &Polygon) -> Planned<'_> {
        Planned { polygon, bounds: polygon.bounds().mm() }
    }

    /// Whether a point lies in it, or within a distance of its border.
    fn holds(&self, p: Point, grown_mm: f64) -> bool {
        let [low, high] = self.bounds;
        if (0..2).any(|k| p[k] < low[k] - grown_mm || p[k] > high[k] + grown_mm) {
            return false;
        }
        if self.polygon.place(Grid::from_mm(p[0], p[1])) != Place::Outside {
            return true;
        }
        let near = |[a, b]: [Grid; 2]| super::cross::to_segment_mm(p, [a.mm(), b.mm()]) <= grown_mm;
        self.polygon.rings.iter().any(|ring| ring_edges(ring).any(near))
    }
}
