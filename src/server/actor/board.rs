//! What a printer's actor shows to everybody else: one picture behind a lock that is never held
//! for long.
//!
//! The actor writes, others take copies. Histories are bounded. Owns no port; the time comes with
//! what is written.
use crate::printer::temperature::{Reading, Temperatures};
use crate::server::model::{ConsoleLine, Heat, Heater, Level, Link, Message, Progress, Question, Sample};
use crate::station::escape::printable;
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Lines of the console that are kept.
const MAX_CONSOLE: usize = 500;

/// Temperatures that are kept: half an hour of one every [`SAMPLE_S`].
const MAX_SAMPLES: usize = 900;

/// Seconds between two temperatures that are kept.
pub(crate) const SAMPLE_S: u64 = 2;

/// Messages that are kept.
const MAX_MESSAGES: usize = 50;

/// The picture.
#[derive(Clone, Debug, Default)]
pub(crate) struct Picture {
    /// Grows with each change.
    pub(crate) version: u64,
    pub(crate) link: Link,
    pub(crate) error: Option<String>,
    pub(crate) firmware: Option<String>,
    /// What names the port in the jobs' records, once it was opened.
    pub(crate) device: Option<String>,
    pub(crate) heat: Heat,
    pub(crate) job: Option<String>,
    pub(crate) words: Option<&'static str>,
    pub(crate) progress: Option<Progress>,
    pub(crate) question: Option<Question>,
    pub(crate) waits_for_user: Option<String>,
    pub(crate) plan: Option<String>,
    /// Resends and probes of the job, and lines that the planner may have waited for.
    pub(crate) resends: u64,
    pub(crate) lines_sent: u64,
    /// How long the job may take to be parked.
    pub(crate) park: Duration,
}

/// See the module's text.
#[derive(Debug, Default)]
pub(crate) struct Board {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    picture: Picture,
    messages: VecDeque<Message>,
    console: VecDeque<ConsoleLine>,
    /// Console lines ever written, so that readers know which are new.
    console_total: u64,
    samples: VecDeque<Sample>,
    samples_total: u64,
}

impl Board {
    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Plain values: no invariant that a panic could break half-way.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The picture as it is.
    pub(crate) fn picture(&self) -> Picture {
        self.lock().picture.clone()
    }

    /// How often it was changed.
    pub(crate) fn version(&self) -> u64 {
        self.lock().picture.version
    }

    /// Changes the picture.
    pub(crate) fn change<T>(&self, change: impl FnOnce(&mut Picture) -> T) -> T {
        let mut inner = self.lock();
        inner.picture.version += 1;
        change(&mut inner.picture)
    }

    /// What happened lately.
    pub(crate) fn messages(&self) -> Vec<Message> {
        self.lock().messages.iter().cloned().collect()
    }

    /// Something happened.
    pub(crate) fn message(&self, at_unix_s: u64, level: Level, words: impl Into<String>) {
        let words = words.into();
        let mut inner = self.lock();
        inner.picture.version += 1;
        if inner.messages.len() >= MAX_MESSAGES {
            inner.messages.pop_front();
        }
        inner.messages.push_back(Message { at_unix_s, level, words });
    }

    /// A line of the console: `printer`, `us` or `note`.
    pub(crate) fn console(&self, at_unix_s: u64, from: &'static str, text: &str) {
        let text = printable(text);
        let mut inner = self.lock();
        if inner.console.len() >= MAX_CONSOLE {
            inner.console.pop_front();
        }
        inner.console.push_back(ConsoleLine { at_unix_s, from, text });
        inner.console_total += 1;
    }

    /// Console lines after the first `seen`, as far as they are kept, and how many there ever were.
    pub(crate) fn console_since(&self, seen: u64) -> (Vec<ConsoleLine>, u64) {
        let inner = self.lock();
        let new = usize::try_from(inner.console_total.saturating_sub(seen)).unwrap_or(usize::MAX);
        let skip = inner.console.len().saturating_sub(new);
        (inner.console.iter().skip(skip).cloned().collect(), inner.console_total)
    }

    /// The printer has told its temperatures.
    pub(crate) fn heat(&self, at_unix_s: u64, told: &Temperatures) {
        let heater = |reading: Option<Reading>| {
            reading.map(|r| Heater { actual_c: r.actual_c, target_c: r.target_c.unwrap_or(0.0) })
        };
        let heat =
            Heat { nozzle: heater(told.hotend()), bed: heater(told.bed), chamber: heater(told.chamber) };
        let mut inner = self.lock();
        if inner.picture.heat != heat {
            inner.picture.heat = heat;
            inner.picture.version += 1;
        }
        let last_s = inner.samples.back().map_or(0.0, |sample| sample[0]);
        if at_unix_s as f64 - last_s >= SAMPLE_S as f64 {
            if inner.samples.len() >= MAX_SAMPLES {
                inner.samples.pop_front();
            }
            let both = |h: Option<Heater>| h.map_or([0.0; 2], |h| [h.actual_c, h.target_c].map(f64::from));
            let ([nozzle, nozzle_target], [bed, bed_target]) = (both(heat.nozzle), both(heat.bed));
            inner.samples.push_back([at_unix_s as f64, nozzle, nozzle_target, bed, bed_target]);
            inner.samples_total += 1;
        }
    }

    /// All temperatures that are kept.
    pub(crate) fn samples(&self) -> Vec<Sample> {
        self.lock().samples.iter().copied().collect()
    }

    /// The newest temperature and how many there ever were.
    pub(crate) fn newest_sample(&self) -> (Option<Sample>, u64) {
        let inner = self.lock();
        (inner.samples.back().copied(), inner.samples_total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histories_are_bounded_and_told_from_where_one_left() {
        let board = Board::default();
        for n in 0..MAX_CONSOLE as u64 + 10 {
            board.console(n, "us", &format!("M{n}\x1b"));
            board.message(n, Level::Info, "x");
        }
        let (all, total) = board.console_since(0);
        assert_eq!((all.len(), total), (MAX_CONSOLE, MAX_CONSOLE as u64 + 10));
        assert_eq!(all[0].text, "M10\\u{1b}");
        board.console(0, "us", "last");
        let (new, _) = board.console_since(total);
        assert_eq!(new.len(), 1);
        assert_eq!(board.messages().len(), MAX_MESSAGES);
    }

    #[test]
    fn temperatures_are_sampled_not_all_kept() {
        let board = Board::default();
        let told = |c| Temperatures {
            active: Some(Reading { actual_c: c, target_c: Some(200.0) }),
            ..Temperatures::default()
        };
        for s in 100..=104 {
            board.heat(s, &told(s as f32));
        }
        let samples = board.samples();
        assert_eq!(
            samples,
            [
                [100.0, 100.0, 200.0, 0.0, 0.0],
                [102.0, 102.0, 200.0, 0.0, 0.0],
                [104.0, 104.0, 200.0, 0.0, 0.0]
            ]
        );
        assert_eq!(board.picture().heat.nozzle.map(|h| h.actual_c), Some(104.0));
    }
}
