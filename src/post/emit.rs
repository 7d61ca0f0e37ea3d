//! Writes the rows of a layer in a new order: beads either way round, and the way between them made anew.
//!
//! Takes a layer and, one after the other, the beads to print; keeps a cursor of
//! what the lines written so far have done to the machine (position, E, feed
//! rate, settings, retraction), so that each line is written as it must be from
//! there. What cannot be made is refused, and the caller goes another way.
use super::layer::{Channel, Layer, Modes, Row, Span, What};
use super::link::{Habits, Retraction, Sample, Travel, Wipe, is_regular};
use super::rewrite::{Change, rewrite};
use super::section::{BeadRows, is_link};
use crate::toolpath::bead::{LiftRule, Point, distance_mm};
use outrigger_gcode::line::{Command, Line, parse};
use outrigger_gcode::number::{Format, write_decimal};
use outrigger_gcode::state::{Kind, Move};
use std::ops::Range;

/// Two positions or filament lengths closer than this are the same, mm (the last
/// digit of any slicer's numbers is 1e-6 or more).
const SAME_MM: f64 = 1e-9;

/// Filament pulled back by more than this is a retraction, mm.
const RETRACTED_MM: f64 = 0.02;

/// How feed rates are written.
const FEED: Format = Format { decimals: 6, bare_point: false };

/// Why an order cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum Refusal {
    #[error("the file has no retraction to make one like it")]
    NoRetraction,
    #[error("the file has no travel to make one like it")]
    NoTravel,
    #[error("a command that may depend on the position comes before the next travel")]
    Anchored,
    #[error("something between two beads moves that cannot be made anew")]
    Irregular,
    #[error("the way is not retracted and would need it")]
    Unretracted,
    #[error("the way has no travel to lead elsewhere")]
    NoWay,
}

/// What the lines written so far have done.
#[derive(Clone, Debug)]
struct Cursor {
    position: [f64; 3],
    e: f64,
    /// E words of the file can be copied as they are.
    e_in_step: bool,
    feed: f64,
    channels: [Span; Channel::COUNT],
    absolute_e: bool,
    depth_mm: f64,
    firmware_retracted: bool,
    /// The bead printed last, and which way round.
    last: Option<(BeadRows, bool)>,
}

/// A place to come back to.
pub(super) struct Mark {
    rows: usize,
    added: usize,
    cursor: Cursor,
}

/// See the module.
pub(super) struct Emitter<'a> {
    layer: &'a Layer,
    pub(super) rows: Vec<Row>,
    pub(super) added: Vec<u8>,
    cursor: Cursor,
}

/// Lines that go with the time rather than with a bead (`M73`, notes): each is
/// written after as many deposits of its section as came before it in the file.
#[derive(Default)]
pub(super) struct Floating {
    rows: Vec<(usize, Row)>,
    next: usize,
    deposits: usize,
}

impl Floating {
    /// Those between a section's first and last deposit.
    pub(super) fn of(layer: &Layer, rows: Range<usize>) -> Floating {
        let mut floating = Floating::default();
        let mut deposits = 0;
        for row in &layer.rows[rows] {
            match row.what {
                What::Move(_, Kind::Deposit) => deposits += 1,
                What::Progress | What::Quiet => floating.rows.push((deposits, *row)),
                _ => {}
            }
        }
        floating
    }
}

impl<'a> Emitter<'a> {
    pub(super) fn new(layer: &'a Layer) -> Emitter<'a> {
        let start = &layer.start;
        Emitter {
            layer,
            rows: Vec::with_capacity(layer.rows.len() + 64),
            added: Vec::new(),
            cursor: Cursor {
                position: start.position,
                e: start.e,
                e_in_step: true,
                feed: start.feed,
                channels: layer.states[0].channels,
                absolute_e: Modes::from(start).absolute_e,
                depth_mm: 0.0,
                firmware_retracted: start.firmware_retracted,
                last: None,
            },
        }
    }

    pub(super) fn mark(&self) -> Mark {
        Mark { rows: self.rows.len(), added: self.added.len(), cursor: self.cursor.clone() }
    }

    pub(super) fn back_to(&mut self, mark: &Mark) {
        self.rows.truncate(mark.rows);
        self.added.truncate(mark.added);
        self.cursor = mark.cursor.clone();
    }

    pub(super) fn since(&self, mark: &Mark) -> &[Row] {
        &self.rows[mark.rows..]
    }

    pub(super) fn position(&self) -> [f64; 3] {
        self.cursor.position
    }

    fn at(&self) -> Point {
        [self.cursor.position[0], self.cursor.position[1]]
    }

    fn is_retracted(&self) -> bool {
        self.cursor.firmware_retracted || self.cursor.depth_mm > RETRACTED_MM
    }

    pub(super) fn bytes(&self, span: Span) -> &[u8] {
        let base = self.layer.text.len();
        match (span.start as usize).checked_sub(base) {
            Some(start) => &self.added[start..span.end as usize - base],
            None => self.layer.bytes(span),
        }
    }

    /// Puts down a row with the text that `write` appends.
    fn add(&mut self, what: What, state: u32, write: impl FnOnce(&mut Vec<u8>)) {
        let base = self.layer.text.len();
        let start = base + self.added.len();
        write(&mut self.added);
        let span = Span { start: start as u32, end: (base + self.added.len()) as u32 };
        self.rows.push(Row { span, what, state });
        self.follow(&self.rows[self.rows.len() - 1].clone());
    }

    fn push(&mut self, row: Row) {
        self.rows.push(row);
        self.follow(&row);
    }

    /// Does to the cursor what the row does to the machine.
    fn follow(&mut self, row: &Row) {
        let cursor = &mut self.cursor;
        match row.what {
            What::Move(m, kind) => {
                cursor.position = m.to;
                cursor.feed = m.feed;
                cursor.e += m.e;
                cursor.depth_mm = if kind == Kind::Deposit { 0.0 } else { (cursor.depth_mm - m.e).max(0.0) };
            }
            What::SetE(e) => {
                cursor.e = e;
                cursor.e_in_step = true;
            }
            What::Channel(channel) => cursor.channels[channel as usize] = row.span,
            What::Retract => cursor.firmware_retracted = true,
            What::Unretract => cursor.firmware_retracted = false,
            What::Mode(modes) => cursor.absolute_e = modes.absolute_e,
            _ => {}
        }
    }

    fn xyz(&self) -> Format {
        Format { decimals: self.layer.style.xyz_decimals, bare_point: self.layer.style.bare_point }
    }

    /// A change of a coordinate to a machine position.
    fn set(&self, axis: usize, position: f64) -> (u8, Change) {
        let value = position - self.layer.start.offset[axis];
        (b"XYZ"[axis], Change::Set(value, self.xyz()))
    }

    /// A change of E that pushes `e` mm.
    fn set_e(&self, e: f64) -> (u8, Change) {
        let format =
            Format { decimals: self.layer.style.e_decimals, bare_point: self.layer.style.bare_point };
        (b'E', Change::Set(if self.cursor.absolute_e { self.cursor.e + e } else { e }, format))
    }

    /// Sets the feed rate by a line of its own.
    fn feed_line(&mut self, feed: f64, state: u32) {
        if self.cursor.feed == feed {
            return;
        }
        let at = self.cursor.position;
        let m = Move { from: at, to: at, e: 0.0, feed, arc: None };
        let ending = self.layer.style.ending();
        self.add(What::Move(m, Kind::Still), state, |out| {
            out.extend_from_slice(b"G1 F");
            write_decimal(out, feed, FEED);
            out.extend_from_slice(ending);
        });
    }

    /// Sets every setting that differs from what `state` had.
    fn settle(&mut self, state: u32) {
        let wanted = self.layer.states[state as usize].channels;
        for channel in Channel::ALL {
            let span = wanted[channel as usize];
            let differs = self.bytes(span) != self.bytes(self.cursor.channels[channel as usize]);
            if differs && span != Span::default() {
                self.push(Row { span, what: What::Channel(channel), state });
            }
        }
    }

    // ------------------------------------------------------------ as it was

    /// Copies a row, mended where the cursor is not where the file was.
    fn copy(&mut self, row: &Row) {
        let What::Move(m, kind) = row.what else { return self.push(*row) };
        let at = self.cursor.position;
        let apart = distance_mm(self.at(), [m.from[0], m.from[1]]) > SAME_MM;
        let e_fits = !self.cursor.absolute_e || self.cursor.e_in_step;
        if !apart && e_fits && self.cursor.feed == m.feed && at[2] == m.from[2] {
            return self.push(*row);
        }
        let line = parse(self.layer.bytes(row.span));
        let has_feed = line.words.has(b'F');
        if !has_feed && self.cursor.feed != m.feed {
            self.feed_line(m.feed, row.state);
        }
        let mut changes: [Option<(u8, Change)>; 3] = [None; 3];
        let mut to = m.to;
        if apart {
            for axis in 0..2 {
                if m.moves_xy() {
                    changes[axis] = Some(self.set(axis, m.to[axis]));
                } else {
                    to[axis] = at[axis];
                    if line.words.has(b"XY"[axis]) {
                        changes[axis] = Some(self.set(axis, at[axis]));
                    }
                }
            }
        }
        changes[2] = self.mended_e(&line, m.e);
        let m = Move { from: at, to, ..m };
        if changes.iter().all(Option::is_none) {
            return self.push(Row { what: What::Move(m, kind), ..*row });
        }
        let changes: Vec<_> = changes.into_iter().flatten().collect();
        self.add(What::Move(m, kind), row.state, |out| rewrite(&line, line.head, &changes, out));
    }

    /// The E word that a copied line needs, where the file's own does not fit.
    fn mended_e(&mut self, line: &Line<'_>, e: f64) -> Option<(u8, Change)> {
        if !self.cursor.absolute_e || self.cursor.e_in_step {
            return None;
        }
        let written = line.words.get(b'E')?;
        if (written - e - self.cursor.e).abs() < SAME_MM {
            self.cursor.e_in_step = true;
            return None;
        }
        Some(self.set_e(e))
    }

    /// Copies rows as they are.
    pub(super) fn copy_all(&mut self, rows: Range<usize>) {
        for k in rows {
            let row = self.layer.rows[k];
            self.copy(&row);
        }
    }

    // ---------------------------------------------------------------- beads

    /// Prints a bead as the file does, floating lines included.
    pub(super) fn fixed_bead(&mut self, bead: &BeadRows) {
        self.begin_bead(bead.first);
        self.copy_all(bead.first..bead.last + 1);
        self.cursor.last = Some((*bead, false));
    }

    /// Prints a bead of a section.
    pub(super) fn bead(&mut self, bead: &BeadRows, reversed: bool, floating: &mut Floating) {
        if reversed {
            for k in (bead.first..=bead.last).rev() {
                let row = self.layer.rows[k];
                if let What::Move(m, Kind::Deposit) = row.what {
                    self.backwards(&row, m, bead.first);
                    self.float(floating);
                }
            }
        } else {
            self.begin_bead(bead.first);
            for k in bead.first..=bead.last {
                let row = self.layer.rows[k];
                match row.what {
                    What::Progress | What::Quiet => {}
                    What::Move(_, Kind::Deposit) => {
                        self.copy(&row);
                        self.float(floating);
                    }
                    _ => self.copy(&row),
                }
            }
        }
        self.cursor.last = Some((*bead, reversed));
    }

    /// Settings and feed rate for a bead whose first deposit is at this row.
    fn begin_bead(&mut self, first: usize) {
        let row = self.layer.rows[first];
        self.settle(row.state);
        let own_feed = parse(self.layer.bytes(row.span)).words.has(b'F');
        if let What::Move(m, _) = row.what
            && !own_feed
        {
            self.feed_line(m.feed, row.state);
        }
    }

    /// One deposit from its end to its start.
    fn backwards(&mut self, row: &Row, m: Move, first: usize) {
        self.settle(row.state);
        let line = parse(self.layer.bytes(row.span));
        let feed_in_line = parse(self.layer.bytes(self.layer.rows[first].span)).words.has(b'F');
        let mut changes = vec![self.set(0, m.from[0]), self.set(1, m.from[1]), (b'Z', Change::Drop)];
        if self.cursor.feed == m.feed || !feed_in_line {
            self.feed_line(m.feed, row.state);
            changes.push((b'F', Change::Drop));
        } else {
            changes.push((b'F', Change::Set(m.feed, FEED)));
        }
        if self.cursor.absolute_e {
            changes.push(self.set_e(m.e));
            self.cursor.e_in_step = false;
        }
        let mut head = line.head.to_vec();
        if let Some(arc) = m.arc {
            if let Some(digit) = head.last_mut() {
                *digit = if arc.clockwise { b'3' } else { b'2' };
            }
            if !arc.by_radius {
                let change = |v: f64| Change::Set(v, self.xyz());
                changes.push((b'I', change(arc.centre[0] - m.to[0])));
                changes.push((b'J', change(arc.centre[1] - m.to[1])));
            }
        }
        let back = Move { from: m.to, to: m.from, arc: m.arc.map(|a| a.reversed()), ..m };
        self.add(What::Move(back, Kind::Deposit), row.state, |out| rewrite(&line, &head, &changes, out));
    }

    /// After a deposit of a section: the floating lines whose turn it is.
    fn float(&mut self, floating: &mut Floating) {
        floating.deposits += 1;
        while let Some(&(after, row)) = floating.rows.get(floating.next)
            && after <= floating.deposits
        {
            self.push(row);
            floating.next += 1;
        }
    }

    // ---------------------------------------------------------------- links

    /// Goes to where a bead starts, over the rows that stood before it in the file.
    /// `old` is where the file went from and to.
    pub(super) fn link(
        &mut self,
        rows: Range<usize>,
        old: [Point; 2],
        to: Point,
        rule: &impl LiftRule,
        habits: &Habits,
    ) -> Result<(), Refusal> {
        let same = distance_mm(self.at(), old[0]) < SAME_MM && distance_mm(to, old[1]) < SAME_MM;
        // Another bead may have been printed last than in the file.
        self.cursor.e_in_step = false;
        let layer = self.layer;
        if same {
            self.copy_all(rows);
            Ok(())
        } else if layer.rows[rows.clone()].iter().all(|r| is_link(r.what)) {
            let own = &layer.rows[rows.clone()];
            let regular = is_regular(layer, own);
            let pulls = own.iter().any(|row| match row.what {
                What::Move(m, _) => m.e < 0.0,
                what => what == What::Retract,
            });
            let from_there = distance_mm(self.at(), old[0]) < SAME_MM;
            // The file's own way of retracting where it stands (with PrusaSlicer's move
            // inwards from a wall, say) is the best one, and where that is needed it stays.
            if from_there && pulls && (!regular || rule.needs_lift(self.at(), to)) {
                return self.led_elsewhere(rows, old[0], to, rule);
            }
            if !regular {
                return Err(Refusal::Irregular);
            }
            for row in &layer.rows[rows.clone()] {
                if matches!(row.what, What::Quiet | What::Progress) {
                    self.push(*row);
                }
            }
            self.jump(to, rows.end, rule, habits)
        } else {
            self.led_elsewhere(rows, old[0], to, rule)
        }
    }

    /// A link made anew, to the bead that begins at row `first`.
    pub(super) fn jump(
        &mut self,
        to: Point,
        first: usize,
        rule: &impl LiftRule,
        habits: &Habits,
    ) -> Result<(), Refusal> {
        let state = self.layer.rows.get(first).map_or(0, |r| r.state);
        // What comes next is out of step with the file's own E words.
        self.cursor.e_in_step = false;
        if distance_mm(self.at(), to) < SAME_MM {
            return Ok(());
        }
        if !rule.needs_lift(self.at(), to) {
            let travel = habits.plain().ok_or(Refusal::NoTravel)?.clone();
            self.travel(to, &travel, state);
            return Ok(());
        }
        let (retraction, travel) = habits.retracted.as_ref().ok_or(Refusal::NoRetraction)?.clone();
        let z = self.cursor.position[2];
        self.retract(&retraction, state);
        if let Some((sample, height_mm)) = &retraction.up {
            self.vertical(sample, z + height_mm, state);
        }
        self.travel(to, &travel, state);
        if let Some(sample) = &retraction.down {
            self.vertical(sample, z, state);
        }
        if let Some([_, unretract]) = &retraction.firmware {
            self.add(What::Unretract, state, |out| out.extend_from_slice(unretract));
        }
        for (sample, e) in &retraction.unretract {
            self.filament(sample, *e, state);
        }
        Ok(())
    }

    fn travel(&mut self, to: Point, travel: &Travel, state: u32) {
        for (k, channel) in Channel::OF_TRAVEL.into_iter().enumerate() {
            let text = &travel.channels[k];
            if !text.is_empty() && self.bytes(self.cursor.channels[channel as usize]) != text.as_slice() {
                self.add(What::Channel(channel), state, |out| out.extend_from_slice(text));
            }
        }
        let changes = [self.set(0, to[0]), self.set(1, to[1]), (b'Z', Change::Drop), (b'E', Change::Drop)];
        let to = [to[0], to[1], self.cursor.position[2]];
        self.like(&travel.line, to, 0.0, &changes, state);
    }

    fn vertical(&mut self, sample: &Sample, z: f64, state: u32) {
        let at = self.cursor.position;
        let mut changes = vec![self.set(2, z), (b'E', Change::Drop)];
        let line = parse(&sample.text);
        changes.extend((0..2).filter(|&k| line.words.has(b"XY"[k])).map(|k| self.set(k, at[k])));
        self.like(sample, [at[0], at[1], z], 0.0, &changes, state);
    }

    fn filament(&mut self, sample: &Sample, e: f64, state: u32) {
        let changes = [self.set_e(e), (b'X', Change::Drop), (b'Y', Change::Drop), (b'Z', Change::Drop)];
        self.like(sample, self.cursor.position, e, &changes, state);
    }

    /// A move like the sample, to another place.
    fn like(&mut self, sample: &Sample, to: [f64; 3], e: f64, changes: &[(u8, Change)], state: u32) {
        let line = parse(&sample.text);
        let mut changes = changes.to_vec();
        if line.words.has(b'F') || self.cursor.feed != sample.feed {
            changes.push((b'F', Change::Set(sample.feed, FEED)));
        }
        // A wipe may have gone along an arc; what is made like it is straight.
        let is_arc = matches!(line.command, Command::Classic { letter: b'G', number: 2 | 3, .. });
        let head: &[u8] = if is_arc { b"G1" } else { line.head };
        if is_arc {
            changes.extend(b"IJRP".map(|letter| (letter, Change::Drop)));
        }
        let m = Move { from: self.cursor.position, to, e, feed: sample.feed, arc: None };
        self.add(What::Move(m, m.kind()), state, |out| rewrite(&line, head, &changes, out));
    }

    /// Pulls the filament back as the file does, wiping over the bead printed last.
    fn retract(&mut self, retraction: &Retraction, state: u32) {
        let mut left = retraction.depth_mm();
        let mut sample = None;
        if let Some((line, e)) = &retraction.before {
            self.filament(line, -e, state);
            left -= e;
            sample = Some(line);
        }
        if let Some(wipe) = &retraction.wipe {
            left -= self.wipe(wipe, state);
            sample = sample.or(retraction.unretract.first().map(|u| &u.0));
        }
        let unit = 10f64.powi(-i32::from(self.layer.style.e_decimals));
        if left > unit / 2.0 {
            let line = retraction.after.as_ref().map(|a| &a.0).or(sample);
            if let Some(line) = line {
                self.filament(&line.clone(), -left, state);
            }
        }
        if let Some([retract, _]) = &retraction.firmware {
            self.add(What::Retract, state, |out| out.extend_from_slice(retract));
        }
    }

    /// Wipes back over the last bead, and forth again where it is shorter than the
    /// wipe. Gives the filament pulled back, mm.
    fn wipe(&mut self, wipe: &Wipe, state: u32) -> f64 {
        let points = self.wipe_points(wipe.length_mm);
        let length: f64 = points.windows(2).map(|p| distance_mm(p[0], p[1])).sum();
        if points.len() < 2 || wipe.length_mm <= 0.0 {
            return 0.0;
        }
        let [begin, end] = &wipe.marks;
        if !begin.is_empty() {
            self.add(What::WipeMark, state, |out| out.extend_from_slice(begin));
        }
        if !parse(&wipe.line.text).words.has(b'F') {
            self.feed_line(wipe.line.feed, state);
        }
        let unit = 10f64.powi(i32::from(self.layer.style.e_decimals));
        let total = wipe.e * (length / wipe.length_mm).min(1.0);
        let (mut gone, mut pulled) = (0.0, 0.0);
        for pair in points.windows(2) {
            gone += distance_mm(pair[0], pair[1]);
            // Rounded as a sum, so that rounding does not add up.
            let due = (total * gone / length * unit).round() / unit;
            let e = due - pulled;
            pulled = due;
            let to = [pair[1][0], pair[1][1], self.cursor.position[2]];
            let changes = [self.set(0, to[0]), self.set(1, to[1]), self.set_e(-e), (b'Z', Change::Drop)];
            self.like(&wipe.line, to, -e, &changes, state);
        }
        if !end.is_empty() {
            self.add(What::WipeMark, state, |out| out.extend_from_slice(end));
        }
        pulled
    }

    /// From the nozzle back over the last bead, `length_mm` in all, turning at its ends.
    fn wipe_points(&self, length_mm: f64) -> Vec<Point> {
        let mut path: Vec<Point> = vec![self.at()];
        let Some((bead, reversed)) = self.cursor.last else { return path };
        let mut forward: Vec<Point> = vec![bead.bead.ends[0]];
        for row in &self.layer.rows[bead.first..=bead.last] {
            if let What::Move(m, Kind::Deposit) = row.what {
                m.chords(|_, b| forward.push(b));
            }
        }
        if !reversed {
            forward.reverse();
        }
        let whole: f64 = forward.windows(2).map(|p| distance_mm(p[0], p[1])).sum();
        // A nozzle that is not where the bead ended does not wipe.
        if whole < 0.05 || distance_mm(forward[0], self.at()) > SAME_MM {
            return path;
        }
        let mut left = length_mm;
        let mut back = false;
        while left > SAME_MM {
            let stops: Vec<Point> =
                if back { forward.iter().rev().copied().collect() } else { forward.clone() };
            for pair in stops.windows(2) {
                let step = distance_mm(pair[0], pair[1]);
                if step < SAME_MM {
                    continue;
                }
                let t = (left / step).min(1.0);
                path.push([
                    pair[0][0] + t * (pair[1][0] - pair[0][0]),
                    pair[0][1] + t * (pair[1][1] - pair[0][1]),
                ]);
                left -= step * t;
                if left <= SAME_MM {
                    break;
                }
            }
            back = !back;
        }
        path
    }

    /// The rows of a link as they are, barriers included, but that the wipe goes over
    /// the bead printed last and the last travel to `to`, straight.
    fn led_elsewhere(
        &mut self,
        rows: Range<usize>,
        from: Point,
        to: Point,
        rule: &impl LiftRule,
    ) -> Result<(), Refusal> {
        let layer = self.layer;
        let is_travel = |row: &Row| matches!(row.what, What::Move(m, Kind::Travel) if m.moves_xy());
        let last_travel = rows.clone().rev().find(|&k| is_travel(&layer.rows[k]));
        // The travels right before the last one are corners on the old way.
        let is_corner = |row: &Row| match row.what {
            What::Move(m, kind) => kind == Kind::Still || (is_travel(row) && m.from[2] == m.to[2]),
            what => matches!(what, What::Channel(_) | What::Progress | What::Quiet),
        };
        let way = last_travel.map_or(rows.end, |last| {
            (rows.start..last).rev().take_while(|&k| is_corner(&layer.rows[k])).last().unwrap_or(last)
        });
        let left_from = self.at();
        let mut was = from;
        let mut k = rows.start;
        while k < rows.end {
            let row = layer.rows[k];
            let moved = distance_mm(self.at(), was) > SAME_MM;
            if let What::Move(m, _) = row.what {
                was = [m.to[0], m.to[1]];
            }
            match row.what {
                What::Anchor | What::Mode(_) if moved => return Err(Refusal::Anchored),
                What::Move(_, Kind::Wipe) if moved => {
                    k = self.wipe_anew(k, rows.end, &mut was);
                    continue;
                }
                What::Move(m, _) if Some(k) == last_travel => {
                    if !self.is_retracted() && rule.needs_lift(left_from, to) {
                        return Err(Refusal::Unretracted);
                    }
                    self.copy_to(&row, m, to);
                }
                What::Move(..) if is_travel(&row) && k >= way && Some(k) < last_travel => {}
                _ => self.copy(&row),
            }
            k += 1;
        }
        // Which bead comes next is the caller's choice.
        self.cursor.e_in_step = false;
        if distance_mm(self.at(), to) > SAME_MM { Err(Refusal::NoWay) } else { Ok(()) }
    }

    /// Replaces the wiping moves from row `k` on by as much wiping over the last
    /// bead; gives the row after them.
    fn wipe_anew(&mut self, k: usize, end: usize, was: &mut Point) -> usize {
        let rows = &self.layer.rows[k..end];
        let count =
            rows.iter().take_while(|r| matches!(r.what, What::Move(_, Kind::Wipe | Kind::Still))).count();
        let mut wipe: Option<Wipe> = None;
        let state = rows[0].state;
        for row in &rows[..count] {
            let What::Move(m, Kind::Wipe) = row.what else { continue };
            *was = [m.to[0], m.to[1]];
            let sample = Sample { text: self.layer.bytes(row.span).to_vec(), feed: m.feed };
            let wipe =
                wipe.get_or_insert(Wipe { line: sample, e: 0.0, length_mm: 0.0, marks: Default::default() });
            wipe.e -= m.e;
            wipe.length_mm += m.length_mm();
        }
        if let Some(wipe) = wipe {
            self.cursor.e_in_step = false;
            let pulled = self.wipe(&wipe, state);
            let left = wipe.e - pulled;
            if left > SAME_MM {
                self.filament(&wipe.line.clone(), -left, state);
            }
        }
        k + count
    }

    /// A travel of the file, led to another place.
    fn copy_to(&mut self, row: &Row, m: Move, to: Point) {
        let line = parse(self.layer.bytes(row.span));
        if !line.words.has(b'F') && self.cursor.feed != m.feed {
            self.feed_line(m.feed, row.state);
        }
        let changes = [self.set(0, to[0]), self.set(1, to[1])];
        let led = Move { from: self.cursor.position, to: [to[0], to[1], m.to[2]], ..m };
        self.add(What::Move(led, Kind::Travel), row.state, |out| rewrite(&line, line.head, &changes, out));
    }

    // ------------------------------------------------------------ the end

    /// Leaves the machine as the file does at the layer's end.
    pub(super) fn finish(&mut self) {
        let end = &self.layer.end;
        let state = self.layer.states.len() as u32 - 1;
        if self.cursor.absolute_e && (self.cursor.e - end.e).abs() > SAME_MM {
            let e = end.e;
            let (_, change) = self.set_e(0.0);
            let Change::Set(_, format) = change else { return };
            let ending = self.layer.style.ending();
            self.add(What::SetE(e), state, |out| {
                out.extend_from_slice(b"G92 E");
                write_decimal(out, e, format);
                out.extend_from_slice(ending);
            });
        }
        self.settle(state);
        self.feed_line(end.feed, state);
    }
}
