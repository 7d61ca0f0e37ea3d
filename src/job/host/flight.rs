//! Commands of the file that were given to the session and not acknowledged yet.
//!
//! Takes them as they are fed, gives them back as they are acknowledged. Their
//! memory is used again: nothing is allocated in the long run. Bounded by the
//! session's window.
use std::collections::VecDeque;

/// One of them.
#[derive(Debug, Default)]
pub(super) struct Flying {
    pub(super) text: Vec<u8>,
    /// Line of the file.
    pub(super) line: u64,
    /// Layers begun.
    pub(super) layer: u32,
}

/// All of them, oldest first.
#[derive(Debug, Default)]
pub(super) struct Flight {
    flying: VecDeque<Flying>,
    spare: Vec<Flying>,
}

impl Flight {
    pub(super) fn push(&mut self, command: &[u8], line: u64, layer: u32) {
        let mut one = self.spare.pop().unwrap_or_default();
        one.text.clear();
        one.text.extend_from_slice(command);
        (one.line, one.layer) = (line, layer);
        self.flying.push_back(one);
    }

    /// The oldest, if its line is acknowledged.
    pub(super) fn pop(&mut self, acked_line: u64) -> Option<Flying> {
        self.flying.front().filter(|one| one.line <= acked_line)?;
        self.flying.pop_front()
    }

    /// Takes one back for its memory.
    pub(super) fn done(&mut self, one: Flying) {
        self.spare.push(one);
    }

    pub(super) fn iter(&self) -> impl Iterator<Item = &Flying> {
        self.flying.iter()
    }

    pub(super) fn clear(&mut self) {
        self.flying.clear();
    }
}
