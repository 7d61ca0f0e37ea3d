//! Where the lines of a job come from.
//!
//! Takes what a host hears and does, gives the interface between what reads a job and what sends
//! it. A file's lines may go whenever there is room; those of a resin job also wait for pictures,
//! for what the printer says, and for time.

/// A line that the printer should get.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JobLine<'a> {
    /// The command, as `outrigger_gcode::checksum::sendable` gives it.
    pub command: &'a [u8],
    /// Its line number in the file, from 1.
    pub number: u64,
}

/// Where the lines of a job come from.
///
/// [`Source::advance`] goes through them all, also for one that only wants to know where they lead.
/// Who sends them asks [`Source::may`] before each, and tells the rest of what happens.
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

    /// Lines are sent from here on: for the first time, after a pause, or where the job was taken up.
    fn begin(&mut self) {}

    /// Whether the next line may be sent now.
    fn may(&mut self, _now_ms: u64) -> May {
        May::Go
    }

    /// Whether the job may be held before the next line: nothing is on that must not stay on.
    fn may_hold(&self) -> bool {
        true
    }

    /// Something happened that the lines may wait for.
    fn hear(&mut self, _news: News<'_>, _now_ms: u64) {}

    /// Whether a checkpoint is to be written down now; told once.
    fn take_note(&mut self) -> bool {
        false
    }

    /// Whether the printer is to be asked now which line it has accepted: what was lost on the way must
    /// not wait for the next line to show.
    fn take_question(&mut self, _now_ms: u64) -> bool {
        false
    }

    /// When [`Source::may`] is to be asked again at the latest, ms.
    fn due_ms(&self) -> Option<u64> {
        None
    }

    /// Where a job whose printer lost its state goes on, after so many commands that surely were
    /// acknowledged: of a job that knows better than its lines tell. The source then stands there.
    fn go_back(&mut self, _commands: u64) -> Option<Back> {
        None
    }

    /// Whether what was accepted so far ends in the middle of what cannot be left there.
    fn is_torn(&self) -> bool {
        false
    }

    /// Whether it is certain that none of the lines so far moves anything: then nothing is to be moved to
    /// make the printer safe, since nobody knows where its axes stand.
    fn is_unmoved(&self) -> bool {
        false
    }
}

/// Whether a line may be sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum May {
    /// Yes.
    Go,
    /// Once nothing at all is in flight: the lines from here on run without a gap.
    GoAlone,
    /// Not yet.
    Wait,
}

/// What a source is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum News<'a> {
    /// All commands up to this line were acknowledged.
    Acknowledged(u64),
    /// The printer said this.
    Said(&'a str),
    /// The printer asks for a line again.
    AskedAgain,
    /// The printer says that all that was sent has arrived, whatever it has acknowledged.
    Arrived,
    /// So many commands are written down as acknowledged.
    Durable(u64),
}

/// Where a job goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Back {
    /// Commands before it.
    pub after: u64,
    /// The layer that comes next, from 1.
    pub layer: u32,
    /// Something of that layer may be printed already.
    pub begun: bool,
    /// Where the head or plate stands, mm, if it cannot have been moving.
    pub at_mm: Option<f64>,
}

/// A job that cannot be read on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SourceError {
    /// The last line that was read.
    pub line: u64,
    /// What went wrong.
    pub reason: String,
}
