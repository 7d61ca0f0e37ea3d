//! A job's lines, as a host reads them.
use outrigger::printer::source::{JobLine, Source, SourceError};
use outrigger_gcode::checksum::sendable;
use std::sync::Arc;

/// The commands of a job.
#[derive(Debug, Clone)]
pub struct Commands {
    lines: Arc<Vec<(u64, Vec<u8>)>>,
}

impl Commands {
    /// What of a job's text is sent.
    pub fn of(text: &str) -> Self {
        let mut scratch = Vec::new();
        let lines = text.lines().zip(1..).filter_map(|(line, n)| {
            sendable(line.as_bytes(), &mut scratch).map(|command| (n, command.to_vec()))
        });
        Self { lines: Arc::new(lines.collect()) }
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// The `at`th, from 0.
    pub fn get(&self, at: usize) -> Option<&[u8]> {
        self.lines.get(at).map(|(_, command)| command.as_slice())
    }

    /// All, in order.
    pub fn iter(&self) -> impl Iterator<Item = &[u8]> {
        self.lines.iter().map(|(_, command)| command.as_slice())
    }
}

/// Reads them from the first on.
#[derive(Debug)]
pub struct Reading {
    commands: Commands,
    /// How many were read.
    at: usize,
    /// The file is another from this command on.
    changed_at: Option<usize>,
}

impl Reading {
    /// From the first.
    pub fn new(commands: Commands, changed_at: Option<usize>) -> Self {
        Self { commands, at: 0, changed_at }
    }

    /// From here on the file is another.
    pub fn change(&mut self, at: usize) {
        self.changed_at = Some(at);
    }
}

impl Source for Reading {
    fn advance(&mut self) -> Result<bool, SourceError> {
        if self.changed_at.is_some_and(|at| self.at >= at) {
            let line = self.at as u64;
            return Err(SourceError {
                line,
                reason: "the file has changed since it was accepted".to_owned(),
            });
        }
        self.at += 1;
        Ok(self.at <= self.commands.len())
    }

    fn line(&self) -> JobLine<'_> {
        let nothing: (u64, &[u8]) = (0, b"");
        let line = self.at.checked_sub(1).and_then(|at| self.commands.lines.get(at));
        let (number, command) = line.map_or(nothing, |(n, c)| (*n, c.as_slice()));
        JobLine { command, number }
    }
}
