//! A display in memory that remembers what it was told to show, and fails where it shall.
//!
//! For tests and the demo. Takes a clock, which may be virtual; gives a [`Record`] that any thread
//! may read. Its frames have a byte a pixel.
use super::layout::{Format, Layout};
use super::pack::Packer;
use super::painter::Painter;
use super::sum::Sum;
use super::{Frame, LcdError, Sink};
use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What was put in front of the lamp.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Nothing: all dark.
    Blank,
    /// The picture of so many-th successful [`Sink::show`], from 1.
    Picture(u64),
}

/// One successful call of [`Sink::show`] or [`Sink::blank`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// When, by the recorder's clock, ns.
    pub at_ns: u64,
    /// What.
    pub shown: Shown,
    /// [`Sum`] of the picture as it was given; blank has that of a dark picture.
    pub sum: u64,
}

#[derive(Debug, Default)]
struct State {
    changes: Vec<Change>,
    /// Calls, with those that failed.
    calls: Calls,
    /// Pictures that were shown.
    pictures: u64,
    fail: Fail,
}

#[derive(Debug, Default)]
struct Calls {
    show: u64,
    blank: u64,
}

#[derive(Debug, Default)]
struct Fail {
    show: BTreeSet<u64>,
    blank: BTreeSet<u64>,
}

/// What a recorder has seen, and where it shall fail. Clones are the same record.
#[derive(Clone, Debug, Default)]
pub struct Record {
    state: Arc<Mutex<State>>,
}

impl Record {
    /// All changes so far, in order.
    #[must_use]
    pub fn changes(&self) -> Vec<Change> {
        self.lock().changes.clone()
    }

    /// The `n`-th [`Sink::show`] shall fail, counted from 1 with those that fail.
    pub fn fail_show(&self, n: u64) {
        self.lock().fail.show.insert(n);
    }

    /// The `n`-th [`Sink::blank`] shall fail, counted likewise.
    pub fn fail_blank(&self, n: u64) {
        self.lock().fail.blank.insert(n);
    }

    /// A test that panicked while it held the record has left it whole.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// See the module.
pub struct Recorder<C> {
    packer: Packer,
    /// The sum of a dark picture.
    dark: u64,
    record: Record,
    clock: C,
}

impl<C: Fn() -> u64 + Send> Recorder<C> {
    /// A display for this panel. `clock` gives the time in ns, from whenever it likes.
    ///
    /// # Errors
    /// [`LcdError::Panel`].
    pub fn new(panel: Layout, clock: C) -> Result<Recorder<C>, LcdError> {
        let (layout, format) = panel.checked()?.plain();
        let packer = Packer::new(layout, format)?;
        let dark = Sum::dark([layout.width_px, layout.height_px]);
        Ok(Recorder { packer, dark, record: Record::default(), clock })
    }

    /// What it sees from now on and has seen.
    #[must_use]
    pub fn record(&self) -> Record {
        self.record.clone()
    }
}

impl<C: Fn() -> u64 + Send> Sink for Recorder<C> {
    fn layout(&self) -> Layout {
        self.packer.layout()
    }

    fn format(&self) -> Format {
        self.packer.format()
    }

    fn painter(&self) -> Painter {
        Painter::with(self.packer, None)
    }

    fn show(&mut self, frame: &Frame) -> Result<(), LcdError> {
        if !frame.is_of(self.layout(), self.format()) {
            return Err(LcdError::Foreign);
        }
        let mut state = self.record.lock();
        state.calls.show += 1;
        let call = state.calls.show;
        if state.fail.show.contains(&call) {
            return Err(LcdError::Told);
        }
        state.pictures += 1;
        let shown = Shown::Picture(state.pictures);
        state.changes.push(Change { at_ns: (self.clock)(), shown, sum: frame.sum() });
        Ok(())
    }

    fn blank(&mut self) -> Result<(), LcdError> {
        let mut state = self.record.lock();
        state.calls.blank += 1;
        let call = state.calls.blank;
        if state.fail.blank.contains(&call) {
            return Err(LcdError::Told);
        }
        state.changes.push(Change { at_ns: (self.clock)(), shown: Shown::Blank, sum: self.dark });
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::lcd::layout::{Order, Pixels};
    use std::sync::atomic::{AtomicU64, Ordering};

    const PANEL: Layout = Layout { width_px: 4, height_px: 2, pixels: Pixels::Packed { order: Order::Rgb } };

    fn frame(painter: &mut Painter, brightness: u8) -> Frame {
        (0..2).for_each(|_| painter.row(&[brightness; 4]).expect("a row"));
        painter.finish().expect("a frame")
    }

    #[test]
    fn what_was_shown_is_remembered_and_failures_come_where_they_shall() {
        let now = AtomicU64::new(100);
        let mut recorder = Recorder::new(PANEL, || now.fetch_add(1, Ordering::Relaxed)).unwrap();
        let record = recorder.record();
        record.fail_show(2);
        record.fail_blank(2);
        let mut painter = recorder.painter();
        let (grey, full) = (frame(&mut painter, 9), frame(&mut painter, 255));

        recorder.blank().expect("dark");
        recorder.show(&grey).expect("shown");
        assert!(matches!(recorder.show(&full), Err(LcdError::Told)));
        recorder.show(&full).expect("shown");
        assert!(matches!(recorder.blank(), Err(LcdError::Told)));
        recorder.blank().expect("dark");

        let dark = frame(&mut painter, 0).sum();
        let expect = [
            (100, Shown::Blank, dark),
            (101, Shown::Picture(1), grey.sum()),
            (102, Shown::Picture(2), full.sum()),
            (103, Shown::Blank, dark),
        ];
        assert_eq!(record.changes(), expect.map(|(at_ns, shown, sum)| Change { at_ns, shown, sum }));
    }

    #[test]
    fn a_frame_of_another_panel_is_refused() {
        let other = Layout { height_px: 1, ..PANEL };
        let mut painter = Recorder::new(other, || 0).unwrap().painter();
        painter.row(&[1; 4]).expect("a row");
        let frame = painter.finish().expect("a frame");
        let mut recorder = Recorder::new(PANEL, || 0).unwrap();
        assert!(matches!(recorder.show(&frame), Err(LcdError::Foreign)));
        assert!(recorder.record().changes().is_empty());
    }
}
