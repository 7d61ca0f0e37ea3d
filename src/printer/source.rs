//! Where the lines of a job come from.
//!
//! Takes nothing, gives the interface between what reads a job and what sends it.

/// A line that the printer should get.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JobLine<'a> {
    /// The command, as `outrigger_gcode::checksum::sendable` gives it.
    pub command: &'a [u8],
    /// Its line number in the file, from 1.
    pub number: u64,
}

/// Where the lines of a job come from.
pub trait Source {
    /// Goes to the next line; `false` after the last. An error ends the job,
    /// safely.
    fn advance(&mut self) -> Result<bool, SourceError>;

    /// The line where [`Source::advance`] stopped.
    fn line(&self) -> JobLine<'_>;

    /// Layers begun by the marks before that line; 0: none, or not marked.
    fn layer(&self) -> u32 {
        0
    }
}

/// A job that cannot be read on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceError {
    /// The last line that was read.
    pub line: u64,
    /// What went wrong.
    pub reason: String,
}
