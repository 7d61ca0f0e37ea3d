//! A job's lines, as a host reads them.
use super::plate::Plate;
use outrigger::printer::exposure::script::Script;
use outrigger::printer::source::{Back, JobLine, May, News, Source, SourceError};
use outrigger_gcode::checksum::sendable;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

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

    /// All lines of a resin job.
    pub fn of_script(mut script: Script) -> Self {
        let mut lines = Vec::new();
        while script.advance() {
            lines.push((lines.len() as u64 + 1, script.line().as_bytes().to_vec()));
        }
        Self { lines: Arc::new(lines) }
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
    changed_at: Arc<AtomicUsize>,
}

impl Reading {
    /// From the first. Whoever holds `changed_at` may change the file: it is another from that
    /// command on.
    pub fn new(commands: Commands, changed_at: Arc<AtomicUsize>) -> Self {
        Self { commands, at: 0, changed_at }
    }
}

impl Source for Reading {
    fn advance(&mut self) -> Result<bool, SourceError> {
        if self.at >= self.changed_at.load(Ordering::Relaxed) {
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

/// A job of either sort.
#[derive(Debug)]
pub(super) enum Lines {
    /// Of G-code.
    File(Reading),
    /// Of resin.
    Plate(Box<Plate>),
}

impl Lines {
    fn source(&self) -> &dyn Source {
        match self {
            Lines::File(file) => file,
            Lines::Plate(plate) => &**plate,
        }
    }

    fn source_mut(&mut self) -> &mut dyn Source {
        match self {
            Lines::File(file) => file,
            Lines::Plate(plate) => &mut **plate,
        }
    }
}

impl Source for Lines {
    fn advance(&mut self) -> Result<bool, SourceError> {
        self.source_mut().advance()
    }

    fn line(&self) -> JobLine<'_> {
        self.source().line()
    }

    fn layer(&self) -> u32 {
        self.source().layer()
    }

    fn begin(&mut self) {
        self.source_mut().begin();
    }

    fn may(&mut self, now_ms: u64) -> May {
        self.source_mut().may(now_ms)
    }

    fn may_hold(&self) -> bool {
        self.source().may_hold()
    }

    fn hear(&mut self, news: News<'_>, now_ms: u64) {
        self.source_mut().hear(news, now_ms);
    }

    fn take_note(&mut self) -> bool {
        self.source_mut().take_note()
    }

    fn take_question(&mut self, now_ms: u64) -> bool {
        self.source_mut().take_question(now_ms)
    }

    fn due_ms(&self) -> Option<u64> {
        self.source().due_ms()
    }

    fn go_back(&mut self, commands: u64) -> Option<Back> {
        self.source_mut().go_back(commands)
    }

    fn is_torn(&self) -> bool {
        self.source().is_torn()
    }
}
