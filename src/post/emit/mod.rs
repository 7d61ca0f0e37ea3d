//! Writes the rows of a layer in a new order: beads either way round, and the way between them made anew.
//!
//! Takes a layer and, one after the other, the beads to print; keeps a cursor of
//! what the lines written so far have done to the machine (position, E, feed
//! rate, settings, retraction), so that each line is written as it must be from
//! there. What cannot be made is refused, and the caller goes another way.
mod beads;
mod links;

use super::layer::{Channel, Layer, Modes, Row, Span, What};
use super::measure::RETRACTED_MM;
use super::rewrite::{Change, rewrite};
use super::section::BeadRows;
use crate::toolpath::bead::{Point, distance_mm};
pub(super) use beads::Floating;
use outrigger_gcode::line::{Line, parse};
use outrigger_gcode::number::{Format, write_decimal};
use outrigger_gcode::state::{Kind, Move};
use std::ops::Range;

/// Two positions or filament lengths closer than this are the same, mm (the last
/// digit of any slicer's numbers is 1e-6 or more).
const SAME_MM: f64 = 1e-9;

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

    fn e_format(&self) -> Format {
        Format { decimals: self.layer.style.e_decimals, bare_point: self.layer.style.bare_point }
    }

    /// A change of E that pushes `e` mm.
    fn set_e(&self, e: f64) -> (u8, Change) {
        let value = if self.cursor.absolute_e { self.cursor.e + e } else { e };
        (b'E', Change::Set(value, self.e_format()))
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

    /// Sets the feed rate for a line that does not set it itself.
    fn feed_for(&mut self, line: &Line<'_>, feed: f64, state: u32) {
        if !line.words.has(b'F') {
            self.feed_line(feed, state);
        }
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
        self.feed_for(&line, m.feed, row.state);
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

    /// Leaves the machine as the file does at the layer's end.
    pub(super) fn finish(&mut self) {
        let end = &self.layer.end;
        let state = self.layer.states.len() as u32 - 1;
        if self.cursor.absolute_e && (self.cursor.e - end.e).abs() > SAME_MM {
            let (e, format) = (end.e, self.e_format());
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
