//! Puts lines into a layer: the supports before the part, and lifts around travels that
//! would lead over them.
//!
//! Takes a layer and its [`Plan`], gives the new text and which stretches of it are new.
//! No line of the file is changed, moved or left out: what is put in ends as the
//! machine was before it. Travels of the file run above the supports where they are
//! led over them, between a way up and a way down. Where the file labels objects, a
//! layer's supports stand in the object whose bead comes first.
use super::Options;
use super::Refusal;
use super::cross::Shadow;
use super::plan::{Plan, free_mm};
use crate::merge::gcode::flow::Shape;
use crate::merge::gcode::pen::{At, Pen};
use crate::merge::gcode::survey::Survey;
use crate::post::layer::{Channel, Layer, Modes, Row, What};
use crate::post::measure::RETRACTED_MM;
use crate::toolpath::bead::{Point, distance_mm};
use outrigger_gcode::dialect::{Dialect, Mark};
use outrigger_gcode::line::parse;
use outrigger_gcode::state::{Kind, Machine, Move};
use std::ops::Range;

/// A travel so little above the supports still drags over them, mm.
const ABOVE_MM: f64 = 0.05;

/// Two sizes are written alike when they differ by less, mm.
const SAME_MM: f64 = 1e-4;

/// A layer with supports.
#[derive(Debug, Default)]
pub(super) struct Woven {
    pub(super) text: Vec<u8>,
    /// Stretches of the text that are new, in order.
    pub(super) added: Vec<Range<usize>>,
    pub(super) lifts: u64,
    pub(super) travels_lifted: u64,
    pub(super) pushed_mm: f64,
    pub(super) length_mm: f64,
}

/// # Errors
/// Something in the layer that supports cannot be written beside.
pub(super) fn weave(
    layer: &Layer,
    entry: usize,
    plan: &Plan,
    survey: &Survey,
    options: &Options,
) -> Result<Woven, Refusal> {
    let mut machine = layer.start.clone();
    for row in &layer.rows[..entry] {
        machine.apply(&parse(layer.bytes(row.span)));
    }
    let fixed = layer.start.offset == layer.end.offset && machine.offset == layer.start.offset;
    if !machine.absolute || !fixed {
        return Err(Refusal::Relative { layer: layer.number });
    }
    let mut woven = Woven::default();
    let mut put: Vec<(usize, Vec<u8>)> = Vec::new();
    if !plan.paths.is_empty() {
        put.push((entry, supports(layer, entry, &machine, plan, survey, options, &mut woven)?));
        travels(layer, entry, &machine, plan, survey, &mut put, &mut woven)?;
    }
    write(layer, put, &mut woven);
    Ok(woven)
}

/// The layer's lines with the others put in before some of its rows.
fn write(layer: &Layer, put: Vec<(usize, Vec<u8>)>, woven: &mut Woven) {
    let more: usize = put.iter().map(|p| p.1.len()).sum();
    woven.text.reserve(layer.input().len() + more);
    let mut from = layer.input.start as usize;
    for (row, text) in put {
        let to = layer.rows.get(row).map_or(layer.input.end, |row| row.span.start) as usize;
        woven.text.extend_from_slice(&layer.text[from..to]);
        from = to;
        let start = woven.text.len();
        woven.text.extend_from_slice(&text);
        woven.added.push(start..woven.text.len());
    }
    woven.text.extend_from_slice(&layer.text[from..layer.input.end as usize]);
}

fn at(machine: &Machine) -> At {
    At {
        position: machine.position,
        offset: machine.offset,
        e: machine.e,
        absolute_e: machine.e_is_absolute(),
        feed: machine.feed,
    }
}

/// The lines that print a layer's supports and come back.
fn supports(
    layer: &Layer,
    entry: usize,
    machine: &Machine,
    plan: &Plan,
    survey: &Survey,
    options: &Options,
    woven: &mut Woven,
) -> Result<Vec<u8>, Refusal> {
    let before = at(machine);
    let mut pen = Pen::new(survey, layer.style, before);
    let words = Words::new(layer, entry, survey, plan)?;
    let area = Shape::of(survey.dialect).area_mm2(survey.width_mm, plan.top_mm - plan.bottom_mm);
    let free = free_mm(options);
    let mut said = None;
    for path in &plan.paths {
        let here = [pen.at.position[0], pen.at.position[1]];
        let start = path.points[0];
        if said.is_none() || distance_mm(here, start) > free {
            pen.lift(start);
        } else if here != start {
            pen.go(start);
        }
        if said != Some(path.interface) {
            words.begin(&mut pen, path.interface, said.is_none());
            said = Some(path.interface);
        }
        let own = survey.feeds[usize::from(path.interface)];
        pen.feed(if plan.first { own.min(survey.first_feed) } else { own });
        for &point in &path.points[1..] {
            let here = [pen.at.position[0], pen.at.position[1]];
            woven.length_mm += distance_mm(here, point);
            pen.bead(point, area, words.inline(path.interface));
        }
    }
    pen.lift([before.position[0], before.position[1]]);
    words.end(&mut pen);
    pen.feed(before.feed);
    pen.restore_e(before.e);
    woven.lifts += pen.lifts;
    woven.pushed_mm += pen.pushed_mm;
    Ok(pen.out)
}

/// What the dialect calls supports, and how it goes on afterwards.
struct Words<'a> {
    dialect: Dialect,
    width: Option<Vec<u8>>,
    height: Option<Vec<u8>>,
    /// What was in force, to be said again.
    before: [&'a [u8]; 3],
}

impl<'a> Words<'a> {
    fn new(layer: &'a Layer, entry: usize, survey: &Survey, plan: &Plan) -> Result<Words<'a>, Refusal> {
        let state = layer.state(&layer.rows[entry]);
        let dialect = survey.dialect;
        let text = |channel: Channel| layer.bytes(state.channels[channel as usize]);
        let before = [text(Channel::Type), text(Channel::Width), text(Channel::Height)];
        if before[0].is_empty() && dialect != Dialect::Slic3r {
            return Err(Refusal::NoFeature { layer: layer.number });
        }
        let [width, height] = match dialect {
            Dialect::Prusa | Dialect::Orca => [&b";WIDTH:"[..], b";HEIGHT:"],
            Dialect::Bambu => [&b"; LINE_WIDTH: "[..], b"; LAYER_HEIGHT: "],
            Dialect::Cura | Dialect::Slic3r => [&b""[..], b""],
        };
        // A size is said only where the file says it, and where it is another one.
        let size = |name: &[u8], mm: f64, before: &[u8]| {
            let was = match dialect.mark(&parse(before)) {
                Some(Mark::Width(was) | Mark::Height(was)) => was,
                _ => return None,
            };
            let differs = (was - mm).abs() > SAME_MM;
            (!name.is_empty() && differs).then(|| {
                let mut text = name.to_vec();
                let format = outrigger_gcode::number::Format { decimals: 5, bare_point: false };
                outrigger_gcode::number::write_decimal(&mut text, mm, format);
                text
            })
        };
        Ok(Words {
            dialect,
            width: size(width, survey.width_mm, before[1]),
            height: size(height, plan.top_mm - plan.bottom_mm, before[2]),
            before,
        })
    }

    fn begin(&self, pen: &mut Pen<'_>, interface: bool, sizes: bool) {
        let name: [&[u8]; 2] = match self.dialect {
            Dialect::Prusa => [b";TYPE:Support material", b";TYPE:Support material interface"],
            Dialect::Orca => [b";TYPE:Support", b";TYPE:Support interface"],
            Dialect::Bambu => [b"; FEATURE: Support", b"; FEATURE: Support interface"],
            Dialect::Cura => [b";TYPE:SUPPORT", b";TYPE:SUPPORT-INTERFACE"],
            Dialect::Slic3r => return,
        };
        pen.text(name[usize::from(interface)]);
        for size in [&self.width, &self.height].into_iter().flatten().filter(|_| sizes) {
            pen.text(size);
        }
    }

    /// What Slic3r says at the end of each bead.
    fn inline(&self, interface: bool) -> &'static [u8] {
        match (self.dialect, interface) {
            (Dialect::Slic3r, false) => b" ; support material",
            (Dialect::Slic3r, true) => b" ; support material interface",
            _ => b"",
        }
    }

    fn end(&self, pen: &mut Pen<'_>) {
        let said = [self.dialect != Dialect::Slic3r, self.width.is_some(), self.height.is_some()];
        for (text, said) in self.before.into_iter().zip(said) {
            if said {
                // The line that set it has its own ending, but for the file's last.
                pen.text(text.trim_ascii_end());
            }
        }
    }
}

/// Lifts around the file's travels over this layer's supports.
fn travels(
    layer: &Layer,
    entry: usize,
    machine: &Machine,
    plan: &Plan,
    survey: &Survey,
    put: &mut Vec<(usize, Vec<u8>)>,
    woven: &mut Woven,
) -> Result<(), Refusal> {
    let mut now = Now {
        at: at(machine),
        absolute: machine.absolute,
        depth_mm: 0.0,
        firmware: machine.firmware_retracted,
    };
    let mut k = entry;
    while k < layer.rows.len() {
        let row = &layer.rows[k];
        let over = match row.what {
            What::Move(m, Kind::Travel) if m.moves_xy() && m.arc.is_none() => {
                leads_over(&m, plan.top_mm, &plan.shadow)
            }
            _ => false,
        };
        if !over {
            now.follow(layer, row);
            k += 1;
            continue;
        }
        if !now.absolute {
            return Err(Refusal::Relative { layer: layer.number });
        }
        woven.travels_lifted += 1;
        let end = flat_run(layer, k);
        if end > k {
            lift_run(layer, k..end, &mut now, survey, put);
        } else if let What::Move(m, _) = row.what {
            lead_above(layer, k, m, &now, survey, put);
            now.follow(layer, row);
        }
        k = end.max(k + 1);
    }
    Ok(())
}

fn leads_over(m: &Move, top_mm: f64, shadow: &Shadow) -> bool {
    let flat = |p: [f64; 3]| [p[0], p[1]];
    m.from[2].min(m.to[2]) <= top_mm + ABOVE_MM && shadow.meets(flat(m.from), flat(m.to))
}

/// What the file's lines have done so far.
struct Now {
    at: At,
    absolute: bool,
    depth_mm: f64,
    firmware: bool,
}

impl Now {
    fn follow(&mut self, layer: &Layer, row: &Row) {
        match row.what {
            What::Move(m, kind) => {
                self.at.position = m.to;
                self.at.feed = m.feed;
                self.at.e = self.e_after(layer, row, &m);
                self.depth_mm = if kind == Kind::Deposit { 0.0 } else { (self.depth_mm - m.e).max(0.0) };
            }
            What::SetE(e) => self.at.e = e,
            What::Retract => self.firmware = true,
            What::Unretract => self.firmware = false,
            What::Mode(Modes { absolute, absolute_e, .. }) => {
                self.absolute = absolute;
                self.at.absolute_e = absolute_e;
            }
            _ => {}
        }
    }

    /// E as the file writes it where it is a position: sums would drift.
    fn e_after(&self, layer: &Layer, row: &Row, m: &Move) -> f64 {
        if m.e == 0.0 {
            return self.at.e;
        }
        let written = self.at.absolute_e.then(|| parse(layer.bytes(row.span)).words.get(b'E')).flatten();
        written.unwrap_or(self.at.e + m.e)
    }

    fn is_back(&self) -> bool {
        self.firmware || self.depth_mm > RETRACTED_MM
    }
}

/// Where the travels end that go on from this one at one height, without saying it and
/// with nothing but travels and notes between. The row itself, if it is none such.
fn flat_run(layer: &Layer, from: usize) -> usize {
    let mut end = from;
    for (k, row) in layer.rows.iter().enumerate().skip(from) {
        match row.what {
            What::Move(m, Kind::Travel) => {
                let says_z = parse(layer.bytes(row.span)).words.has(b'Z');
                if m.from[2] != m.to[2] || m.arc.is_some() || m.e != 0.0 || says_z {
                    break;
                }
                end = k + 1;
            }
            What::Move(_, Kind::Still) => {
                if parse(layer.bytes(row.span)).words.has(b'Z') {
                    break;
                }
            }
            What::Quiet | What::Progress => {}
            _ => break,
        }
    }
    end
}

/// The file's own travels at a greater height.
fn lift_run(
    layer: &Layer,
    rows: Range<usize>,
    now: &mut Now,
    survey: &Survey,
    put: &mut Vec<(usize, Vec<u8>)>,
) {
    let z = now.at.position[2];
    let mut pen = Pen::new(survey, layer.style, now.at);
    let back = now.is_back();
    if !back {
        pen.pull();
    }
    pen.rise(z + survey.hop_mm);
    pen.feed(now.at.feed);
    put.push((rows.start, std::mem::take(&mut pen.out)));
    for row in &layer.rows[rows.clone()] {
        now.follow(layer, row);
    }
    pen.at.position = [now.at.position[0], now.at.position[1], z + survey.hop_mm];
    pen.at.feed = now.at.feed;
    pen.rise(z);
    if !back {
        pen.push();
    }
    pen.feed(now.at.feed);
    pen.restore_e(now.at.e);
    put.push((rows.end, pen.out));
}

/// The way of one travel above the supports, before it: it finds itself where it leads to.
fn lead_above(layer: &Layer, k: usize, m: Move, now: &Now, survey: &Survey, put: &mut Vec<(usize, Vec<u8>)>) {
    let mut pen = Pen::new(survey, layer.style, now.at);
    let back = now.is_back();
    if !back {
        pen.pull();
    }
    pen.rise(m.from[2].max(m.to[2]) + survey.hop_mm);
    pen.go([m.to[0], m.to[1]]);
    pen.rise(m.to[2]);
    if !back {
        pen.push();
    }
    pen.feed(now.at.feed);
    pen.restore_e(now.at.e);
    put.push((k, pen.out));
}

/// Where supports are entered, in the plane.
pub(super) fn entry_point(layer: &Layer, entry: usize) -> Point {
    match layer.rows[entry].what {
        What::Move(m, _) => [m.from[0], m.from[1]],
        _ => [0.0, 0.0],
    }
}
