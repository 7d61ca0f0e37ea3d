//! Whether a board that opening may have reset listens already.
//!
//! A boot loader swallows what comes too early. Takes lines and the time in ms.
use crate::printer::reply::Reply;

/// After its `start` a board prints its settings; it listens when it falls silent.
const QUIET_MS: u64 = 250;

/// A board's boot.
#[derive(Debug)]
pub(super) struct Boot {
    /// The end of it as far as is known; `None`: it is over.
    until_ms: Option<u64>,
    started: bool,
}

impl Boot {
    /// `boot_ms`: how long it takes if nothing is heard of it; 0 if there is none.
    pub(super) fn new(boot_ms: u64, now_ms: u64) -> Self {
        Self { until_ms: (boot_ms > 0).then_some(now_ms + boot_ms), started: false }
    }

    /// A line came.
    pub(super) fn hear(&mut self, class: &Reply<'_>, now_ms: u64) {
        self.started |= matches!(class, Reply::Start);
        if self.started && (self.until_ms.is_some() || matches!(class, Reply::Start)) {
            self.until_ms = Some(now_ms + QUIET_MS);
        }
    }

    /// Time passed.
    pub(super) fn tick(&mut self, now_ms: u64) {
        if self.until_ms.is_some_and(|until_ms| until_ms <= now_ms) {
            *self = Self { until_ms: None, started: false };
        }
    }

    /// When it ends, if it has not.
    pub(super) fn until_ms(&self) -> Option<u64> {
        self.until_ms
    }
}
