//! Prints beads: as the file does, or from their end to their start.
use super::super::layer::{Layer, Row, What};
use super::super::rewrite::{Change, rewrite};
use super::super::section::BeadRows;
use super::{Emitter, FEED};
use outrigger_gcode::line::parse;
use outrigger_gcode::state::{Kind, Move};
use std::ops::Range;

/// Lines that go with the time rather than with a bead (`M73`, notes): each is
/// written after as many deposits of its section as came before it in the file.
#[derive(Default)]
pub(in crate::post) struct Floating {
    rows: Vec<(usize, Row)>,
    next: usize,
    deposits: usize,
}

impl Floating {
    /// Those between a section's first and last deposit.
    pub(in crate::post) fn of(layer: &Layer, rows: Range<usize>) -> Floating {
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

impl Emitter<'_> {
    /// Prints a bead as the file does, floating lines included.
    pub(in crate::post) fn fixed_bead(&mut self, bead: &BeadRows) {
        self.begin_bead(bead.first);
        self.copy_all(bead.first..bead.last + 1);
        self.cursor.last = Some((*bead, false));
    }

    /// Prints a bead of a section.
    pub(in crate::post) fn bead(&mut self, bead: &BeadRows, reversed: bool, floating: &mut Floating) {
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
        if let What::Move(m, _) = row.what {
            self.feed_for(&parse(self.layer.bytes(row.span)), m.feed, row.state);
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
}
