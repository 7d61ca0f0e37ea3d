//! What the board did, one deed after the other, for who judges a run.
//!
//! Takes deeds while somebody watches, gives them once. Off by default: a print of
//! a day would fill the memory.
use super::super::faults::Fault;
use super::Firmware;

/// Deeds kept for a watcher that does not fetch them; what comes after is dropped.
const DEEDS_MAX: usize = 1 << 16;

/// One deed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Deed {
    /// When, in nanoseconds since power-on.
    pub at_ns: u64,
    /// What.
    pub did: Did,
}

/// What the board did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Did {
    /// Took a command in hand.
    Took {
        /// Its number on the wire.
        number: Option<i64>,
        /// Its text, without number and checksum.
        command: Vec<u8>,
    },
    /// Switched all off: these planned moves were never made, or not to their end.
    Dropped {
        /// How many.
        moves: usize,
    },
    /// Began to start.
    Started,
}

impl Firmware {
    /// From now on deeds are kept for [`Self::take_deeds`].
    pub fn watch(&mut self) {
        self.deeds.get_or_insert_default();
    }

    /// What was done since the last call, oldest first; empty unless [`Self::watch`]ed.
    pub fn take_deeds(&mut self) -> Vec<Deed> {
        self.deeds.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// A fault that nobody knew of beforehand: one that is of a line waits for it, all
    /// others happen now.
    pub fn inject(&mut self, now_ns: u64, fault: Fault) {
        self.advance(now_ns);
        match fault.at_line {
            Some(_) => self.faults.add(fault),
            None => self.happen(fault),
        }
    }

    pub(super) fn note(&mut self, did: impl FnOnce() -> Did) {
        if let Some(deeds) = self.deeds.as_mut().filter(|deeds| deeds.len() < DEEDS_MAX) {
            deeds.push(Deed { at_ns: self.now_ns, did: did() });
        }
    }
}
