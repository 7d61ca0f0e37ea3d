//! Visits the infill beads of each section in the order that lifts the head least (paper 002).
//!
//! Example: the lines of a raster around a hole, printed left half, right half,
//! with a lift at each change of side, become two beads with one lift.
//!
//! The candidate is the best of nearest neighbour and its restarts at break
//! points; it is written out beside the slicer's own order, way in and way out
//! included, and taken only where it is better in one of lifts, retractions,
//! jumps, travel and time and worse in none.
use super::super::emit::{Emitter, Floating, Mark, Refusal};
use super::super::habits::FileHabits;
use super::super::layer::{Layer, Modes, What};
use super::super::link::Habits;
use super::super::measure::Measure;
use super::super::pass::{Pass, Tally};
use super::super::section::{BeadRows, Neighbours, beads, is_link, sections};
use super::super::time::{Clock, accelerations_at};
use super::Wishes;
use crate::toolpath::bead::{Bead, Ends, LiftRule, Point, Visit, as_sliced, distance_mm};
use crate::toolpath::breakpoints::never_worse;
use crate::toolpath::walls::Walls;
use outrigger_gcode::state::{Kind, Move};
use std::cell::RefCell;
use std::ops::Range;

/// Less travel gained than this is not worth a changed file, mm.
const WORTH_MM: f64 = 0.01;

/// See the module.
pub(super) struct ReorderInfill {
    wishes: Wishes,
    file: FileHabits,
    links: Habits,
    tally: Tally,
}

/// A jump needs a retraction when it crosses a perimeter of the layer or is
/// longer than the file goes without one.
struct Rule<'a> {
    walls: &'a Walls,
    free_within_mm: f64,
    /// Answers given before: restarts ask for the same jumps over and over.
    answers: RefCell<Vec<Option<Answer>>>,
}

/// A jump, and whether it crosses a wall.
type Answer = ([Point; 2], bool);

/// Answers kept; a power of two. 160 kB, so that they stay in a second-level cache.
const ANSWERS: usize = 4_096;

impl LiftRule for Rule<'_> {
    fn needs_lift(&self, from: Point, to: Point) -> bool {
        distance_mm(from, to) > self.free_within_mm || self.crosses(from, to)
    }
}

impl Rule<'_> {
    fn crosses(&self, from: Point, to: Point) -> bool {
        let mixed = [from, to]
            .as_flattened()
            .iter()
            .fold(0u64, |hash, c| (hash.rotate_left(5) ^ c.to_bits()).wrapping_mul(0x9e37_79b9_7f4a_7c15));
        let slot = (mixed >> 40) as usize % ANSWERS;
        let mut answers = self.answers.borrow_mut();
        match answers[slot] {
            Some((jump, crosses)) if jump == [from, to] => crosses,
            _ => {
                let crosses = self.walls.crosses(from, to);
                answers[slot] = Some(([from, to], crosses));
                crosses
            }
        }
    }
}

impl ReorderInfill {
    pub(super) fn new(wishes: Wishes, file: FileHabits) -> ReorderInfill {
        ReorderInfill { wishes, file, links: Habits::default(), tally: Tally::default() }
    }
}

impl Pass for ReorderInfill {
    fn name(&self) -> &'static str {
        "reorder-infill"
    }

    fn layer(&mut self, layer: &mut Layer, neighbours: Neighbours<'_>) {
        if layer.number == 0 || (layer.is_first && !self.wishes.first_layer) || !is_plain(layer) {
            return;
        }
        let beads = beads(layer, neighbours);
        let sections = sections(layer, &beads);
        if sections.is_empty() {
            return;
        }
        let walls = walls(layer);
        let tool = layer.states[0].tool;
        let free_within_mm = self.file.free_within_mm(tool);
        let mut work = Work {
            layer,
            beads: &beads,
            rule: Rule { walls: &walls, free_within_mm, answers: RefCell::new(vec![None; ANSWERS]) },
            links: &mut self.links,
            emitter: Emitter::new(layer),
            next: 0,
            row: 0,
            changed: 0,
        };
        self.tally.sections += sections.len() as u64;
        let done = work.run(&sections);
        let changed = work.changed;
        if done.is_ok() && changed > 0 {
            let Emitter { rows, added, .. } = work.emitter;
            self.tally.changed += changed;
            layer.text.extend_from_slice(&added);
            layer.rows = rows;
        }
    }

    fn tally(&self) -> Tally {
        self.tally
    }
}

/// Whether positions can be written anew: millimetres, one origin.
fn is_plain(layer: &Layer) -> bool {
    let inches = layer.rows.iter().any(|r| matches!(r.what, What::Mode(Modes { inches: true, .. })));
    !inches && !layer.start.inches && layer.start.offset == layer.end.offset
}

fn walls(layer: &Layer) -> Walls {
    let mut segments = Vec::new();
    for row in &layer.rows {
        if let What::Move(m, Kind::Deposit) = row.what
            && layer.state(row).feature.is_perimeter()
        {
            m.chords(|a, b| segments.push([a, b]));
        }
    }
    Walls::new(segments)
}

/// One layer being rewritten.
struct Work<'a> {
    layer: &'a Layer,
    beads: &'a [BeadRows],
    rule: Rule<'a>,
    links: &'a mut Habits,
    emitter: Emitter<'a>,
    /// The bead to print next.
    next: usize,
    /// The first row not written yet.
    row: usize,
    changed: u64,
}

/// What an order costs as written.
#[derive(Clone, Copy, Debug)]
struct Written {
    lifts: u64,
    retractions: u64,
    jumps: u64,
    travel_mm: f64,
    seconds: f64,
}

impl Written {
    fn beats(self, other: Written) -> bool {
        let no_worse = self.lifts <= other.lifts
            && self.retractions <= other.retractions
            && self.jumps <= other.jumps
            && self.travel_mm <= other.travel_mm
            && self.seconds <= other.seconds + 1e-9;
        let better = self.lifts < other.lifts
            || self.retractions < other.retractions
            || self.travel_mm < other.travel_mm - WORTH_MM;
        no_worse && better
    }
}

impl Work<'_> {
    fn run(&mut self, sections: &[Range<usize>]) -> Result<(), Refusal> {
        for section in sections {
            self.fixed_until(section.start)?;
            self.section(section.clone())?;
        }
        self.fixed_until(self.beads.len())?;
        let end = self.layer.end.position;
        let rows = self.row..self.layer.rows.len();
        self.link(rows, [end[0], end[1]], [end[0], end[1]])?;
        self.emitter.finish();
        Ok(())
    }

    /// Where the file is before the rows not written yet.
    fn file_position(&self) -> Point {
        match self.next.checked_sub(1) {
            Some(before) => self.beads[before].bead.ends[1],
            None => [self.layer.start.position[0], self.layer.start.position[1]],
        }
    }

    fn link(&mut self, rows: Range<usize>, old_to: Point, to: Point) -> Result<(), Refusal> {
        let old = [self.file_position(), old_to];
        self.emitter.link(rows, old, to, &self.rule, self.links)
    }

    fn fixed_until(&mut self, until: usize) -> Result<(), Refusal> {
        while self.next < until {
            let bead = self.beads[self.next];
            let start = bead.bead.ends[0];
            self.link(self.row..bead.first, start, start)?;
            self.emitter.fixed_bead(&bead);
            self.row = bead.last + 1;
            self.next += 1;
        }
        Ok(())
    }

    fn section(&mut self, section: Range<usize>) -> Result<(), Refusal> {
        let exit_rows = self.exit_rows(&section);
        let own: Vec<Bead> = self.beads[section.clone()].iter().map(|b| b.bead).collect();
        let sliced = as_sliced(own.len());
        let (order, _) = never_worse(&sliced, &own, self.ends(&section, &exit_rows), &self.rule);
        let before = self.emitter.mark();
        if let Some(order) = order {
            self.learn(&section, &exit_rows);
            let old = self.written(&section, &sliced, &exit_rows, &before);
            self.emitter.back_to(&before);
            let new = self.written(&section, &order, &exit_rows, &before);
            self.emitter.back_to(&before);
            if let (Ok(old), Ok(new)) = (old, new)
                && new.beats(old)
            {
                self.changed += 1;
                return self.print(&section, &order);
            }
        }
        self.print(&section, &sliced)
    }

    /// The rows after a section up to the next bead, or to the layer's end.
    fn exit_rows(&self, section: &Range<usize>) -> Range<usize> {
        let from = self.beads[section.end - 1].last + 1;
        from..self.beads.get(section.end).map_or(self.layer.rows.len(), |b| b.first)
    }

    /// Learns how the file goes into, within and out of the section.
    fn learn(&mut self, section: &Range<usize>, exit_rows: &Range<usize>) {
        let rows = &self.layer.rows;
        let mut learn = |range: Range<usize>| {
            // What comes after a barrier may belong to the next layer.
            if rows[range.clone()].iter().all(|r| is_link(r.what)) {
                self.links.learn(self.layer, &rows[range]);
            }
        };
        learn(exit_rows.clone());
        learn(self.row..self.beads[section.start].first);
        for pair in self.beads[section.clone()].windows(2) {
            learn(pair[0].last + 1..pair[1].first);
        }
    }

    fn ends(&self, section: &Range<usize>, exit_rows: &Range<usize>) -> Ends {
        let clean = |range: Range<usize>| self.layer.rows[range].iter().all(|r| is_link(r.what));
        let at = self.emitter.position();
        let end = self.layer.end.position;
        let exit = self.beads.get(section.end).map_or([end[0], end[1]], |b| b.bead.ends[0]);
        Ends {
            entry: [at[0], at[1]],
            // Over a barrier the file's own retraction stands, whatever the order.
            entry_counts: clean(self.row..self.beads[section.start].first),
            exit: Some(exit),
            exit_counts: clean(exit_rows.clone()),
        }
    }

    /// Writes a section in this order.
    fn print(&mut self, section: &Range<usize>, order: &[Visit]) -> Result<(), Refusal> {
        let first = &self.beads[section.start];
        let last = &self.beads[section.end - 1];
        let mut floating = Floating::of(self.layer, first.first..last.last + 1);
        let mut before: Option<Visit> = None;
        for &visit in order {
            let k = section.start + visit.bead as usize;
            let bead = self.beads[k];
            let to = bead.bead.ends[usize::from(visit.reversed)];
            match before {
                None => self.link(self.row..first.first, first.bead.ends[0], to)?,
                Some(v) if !v.reversed && !visit.reversed && v.bead + 1 == visit.bead => {
                    self.copy_link(self.beads[k - 1].last + 1..bead.first);
                }
                Some(_) => self.emitter.jump(to, bead.first, &self.rule, self.links)?,
            }
            self.emitter.bead(&bead, visit.reversed, &mut floating);
            before = Some(visit);
        }
        self.row = last.last + 1;
        self.next = section.end;
        Ok(())
    }

    /// A link between beads that follow each other as they did; what floats is written in its turn.
    fn copy_link(&mut self, rows: Range<usize>) {
        for k in rows {
            if !matches!(self.layer.rows[k].what, What::Quiet | What::Progress) {
                self.emitter.copy_all(k..k + 1);
            }
        }
    }

    /// What the section in this order costs, with the way in and the way out.
    fn written(
        &mut self,
        section: &Range<usize>,
        order: &[Visit],
        exit_rows: &Range<usize>,
        before: &Mark,
    ) -> Result<Written, Refusal> {
        let (row, next) = (self.row, self.next);
        let z = self.emitter.position();
        let done = self.print(section, order).and_then(|()| {
            let end = self.layer.end.position;
            let to = self.beads.get(section.end).map_or([end[0], end[1]], |b| b.bead.ends[0]);
            self.link(exit_rows.clone(), to, to)
        });
        (self.row, self.next) = (row, next);
        done?;
        let here = self.emitter.position();
        let deposit = |at: [f64; 3]| Move { from: at, to: at, e: 1.0, feed: 0.0, arc: None };
        let mut measure = Measure::default();
        measure.add(&deposit(z), Kind::Deposit, 0, 0);
        let first = &self.layer.rows[self.beads[section.start].first];
        let mut clock = Clock::new(accelerations_at(self.layer, first));
        for row in self.emitter.since(before) {
            match row.what {
                What::Move(m, kind) => {
                    measure.add(&m, kind, 0, 0);
                    clock.add(&m, kind);
                }
                What::Channel(_) => clock.accelerations.learn(self.emitter.bytes(row.span)),
                What::Retract => measure.firmware_retract(),
                What::Unretract => measure.firmware_unretract(),
                _ => {}
            }
        }
        measure.add(&deposit(here), Kind::Deposit, 0, 0);
        let totals = measure.totals();
        Ok(Written {
            lifts: totals.lifts,
            retractions: totals.retractions,
            jumps: totals.jumps,
            travel_mm: totals.travel_mm,
            seconds: clock.rest(),
        })
    }
}
