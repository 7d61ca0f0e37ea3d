//! For who judges a run: faults that nobody knew of beforehand, and when the board started.
use super::super::faults::Fault;
use super::Firmware;

/// Starts whose time is kept; a board that starts more often is broken anyway.
const STARTS_MAX: usize = 1000;

impl Firmware {
    /// A fault that nobody knew of beforehand: one that is of a line waits for it, all
    /// others happen now.
    pub fn inject(&mut self, now_ns: u64, fault: Fault) {
        self.advance(now_ns);
        match fault.at_line {
            Some(_) => self.faults.add(fault),
            None => self.happen(fault),
        }
    }

    /// When the board began to start, each time, ns.
    pub fn starts_ns(&self) -> &[u64] {
        &self.starts_ns
    }

    pub(super) fn note_start(&mut self) {
        if self.starts_ns.len() < STARTS_MAX {
            self.starts_ns.push(self.now_ns);
        }
    }
}
