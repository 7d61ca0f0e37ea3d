//! What is to be written down, and what waits for it.
//!
//! Takes records in order and how many of them the medium keeps; tells what is
//! durable. Knows no medium.
use crate::job::record::{Checkpoint, Record};
use std::collections::VecDeque;

/// Records on their way to the medium.
#[derive(Debug, Default)]
pub(super) struct Book {
    waiting: VecDeque<Record>,
    /// Records given out, and kept by the medium.
    given: u64,
    kept: u64,
    /// Which record tells what numbers on the wire mean now, as a count.
    meaning_at: u64,
    /// Checkpoints that are not durable yet: their record as a count, their commands.
    promised: VecDeque<(u64, u64)>,
    /// Commands of the last durable checkpoint.
    durable_commands: u64,
}

impl Book {
    /// Puts a record at the end; the count of records with it.
    pub(super) fn push(&mut self, record: Record) -> u64 {
        let at = self.given + self.waiting.len() as u64 + 1;
        match &record {
            Record::Checkpoint(Checkpoint { commands, .. }) | Record::Numbers { after: commands, .. } => {
                self.promised.push_back((at, *commands));
            }
            _ => {}
        }
        if matches!(record, Record::Numbers { .. } | Record::Unnumbered { .. } | Record::Own { .. }) {
            self.meaning_at = at;
        }
        self.waiting.push_back(record);
        at
    }

    pub(super) fn poll(&mut self) -> Option<Record> {
        let record = self.waiting.pop_front()?;
        self.given += 1;
        Some(record)
    }

    /// The medium keeps so many records.
    pub(super) fn kept(&mut self, records: u64) {
        self.kept = self.kept.max(records.min(self.given));
        while let Some((at, commands)) = self.promised.front()
            && *at <= self.kept
        {
            self.durable_commands = *commands;
            self.promised.pop_front();
        }
    }

    /// All records so far, as a count.
    pub(super) fn all(&self) -> u64 {
        self.given + self.waiting.len() as u64
    }

    /// Whether the first `count` records are durable.
    pub(super) fn has(&self, count: u64) -> bool {
        self.kept >= count
    }

    pub(super) fn has_all(&self) -> bool {
        self.has(self.all())
    }

    /// The record that tells what numbers mean now, as a count.
    pub(super) fn meaning_at(&self) -> u64 {
        self.meaning_at
    }

    pub(super) fn durable_commands(&self) -> u64 {
        self.durable_commands
    }
}
