//! What a session tells: events on the way and how the job ended.
//!
//! Texts of the printer come unescaped and must be escaped before they are shown.
use crate::printer::action::{Action, Prompt};
use crate::printer::reply::{Busy, Position};
use crate::printer::temperature::Temperatures;
use thiserror::Error;

/// What happened, in the order in which it did.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// The printer answers and counts our lines; job lines may follow.
    Connected {
        /// What the printer calls its firmware.
        firmware: Option<String>,
        /// Temperatures come by themselves (AUTOREPORT_TEMP).
        auto_temperatures: bool,
        /// M108 and M112 are read ahead of the queue (EMERGENCY_PARSER).
        emergency_parser: bool,
    },
    /// A temperature report.
    Temperatures(Temperatures),
    /// A position report.
    Position(Position),
    /// The printer is still at work or waits for a person.
    Busy(Busy),
    /// The printer asked for line `n` again.
    Resend {
        /// Number on the wire.
        n: u32,
    },
    /// The printer says that it lacks nothing of what was fed, though not all of it is acknowledged.
    Arrived,
    /// No progress for a while: a probe went out.
    Probed {
        /// Timeouts in a row.
        timeouts: u32,
    },
    /// Many resends: cable, ground or speed deserve a look.
    ManyResends {
        /// Resend requests so far.
        resends: u64,
        /// Lines sent so far.
        lines: u64,
    },
    /// An action command, or a note that says the same.
    Action(Action),
    /// The printer asks something; `None`: it does no more. The answer is
    /// [`answer`](super::Session::answer).
    Prompt(Option<Prompt>),
    /// The printer waits for a person (M0, M600, run-out); `None`: it goes on.
    /// M108 or the answer to its prompt ends the wait.
    Waiting(Option<Waiting>),
    /// The printer does not know a command.
    UnknownCommand(String),
    /// An error that the printer survives.
    PrinterError(String),
    /// Any other line of the printer.
    Note(String),
    /// Nothing of the job is in flight and every move is made ([`hold`](super::Session::hold)).
    Held,
    /// Our own lines were all accepted ([`run_own`](super::Session::run_own)).
    OwnDone,
    /// A line of the job was left out, since it would upset the line numbers.
    Skipped {
        /// The job's own line number.
        job_line: u64,
    },
    /// Feeding has stopped; what the printer has and the safe sequence come next.
    Stopping(Ending),
    /// The port is gone in mid-job; the session waits for [`link_back`](super::Session::link_back).
    LinkLost {
        /// What the system said.
        reason: String,
    },
    /// What a printer that may be in mid-job was found to be. Told again if it starts
    /// anew before the answer.
    Found(Found),
    /// After [`go_on`](super::Session::go_on): both sides are proved to count alike, and
    /// the job goes on (or is held, if it was).
    Rejoined {
        /// What the printer calls its firmware.
        firmware: Option<String>,
    },
    /// An emergency stop is over, with or without effect.
    EmergencyStopped {
        /// What stopped the printer; `None`: nothing did.
        by: Option<StoppedBy>,
    },
    /// All is over; nothing follows.
    Ended(Outcome),
}

/// What the printer waits for a person to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waiting {
    /// A command that waits for a person (M0, M1, M600…) is at work.
    Command,
    /// `busy: paused for user`.
    User,
    /// `busy: paused for input`.
    Input,
}

/// What a printer that may be in mid-job says of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// It goes on counting: this was the last line that it accepted.
    Counting {
        /// Number on the wire.
        last: u32,
    },
    /// It has started anew: what it knew of the job is gone.
    Started,
    /// It answers, but says nothing of its last line.
    NotSaid,
}

/// What made an emergency stop take effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoppedBy {
    /// The firmware obeyed M112.
    Firmware,
    /// The board was reset (DTR) and said that it started anew.
    Reset,
}

/// Why a job ends before its last line.
#[derive(Debug, Clone, PartialEq)]
pub enum Ending {
    /// The user wanted it.
    Cancelled,
    /// It could not go on.
    Failed(Failure),
    /// The user wanted an emergency stop.
    EmergencyStop,
}

/// How the job ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// Every line was accepted and every move made.
    Finished,
    /// It ended early.
    Stopped {
        /// Why.
        ending: Ending,
        /// What became of the heaters.
        safety: Safety,
    },
}

/// What is known of the printer after a job that ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Safety {
    /// No line of the job had been sent.
    Untouched,
    /// The printer acknowledged the whole safe sequence.
    Acknowledged,
    /// The firmware halted or started again, which turns heaters off.
    ByFirmware,
    /// The printer did not acknowledge the safe sequence: heaters may be on.
    Unknown,
}

/// Why a job failed.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Failure {
    /// Nothing that we understand came back.
    #[error(
        "the printer does not answer ({}): check that it is on, the port and the baud rate",
        heard(*.bytes, *.lines)
    )]
    NoAnswer {
        /// Bytes received so far.
        bytes: u64,
        /// Lines among them that we understood.
        lines: u64,
    },
    /// `start` came in mid-job.
    #[error(
        "the printer was reset in mid-job (after line {job_line} of the file): check its power \
         supply and the USB cable; the job is lost on its side"
    )]
    Reset {
        /// Last line of the file that was acknowledged.
        job_line: u64,
    },
    /// `start` came again and again before the job.
    #[error(
        "the printer starts again and again ({starts} times): check its power supply, and whether \
         its firmware runs without a host"
    )]
    BootLoop {
        /// How often.
        starts: u32,
    },
    /// The firmware gave up.
    #[error("the printer halted: {text}")]
    Fatal {
        /// What it said, unescaped.
        text: String,
    },
    /// No sign of progress in spite of probes.
    #[error(
        "the printer stopped answering at line {job_line} of the file ({timeouts} timeouts in a \
         row): check the cable and whether it has hung"
    )]
    Timeouts {
        /// Last line of the file that was acknowledged.
        job_line: u64,
        /// Timeouts in a row.
        timeouts: u32,
    },
    /// One line was refused again and again.
    #[error(
        "the printer refused line N{n} ({text}) {resends} times: check the cable and that this \
         firmware takes lines of that length"
    )]
    Resends {
        /// Number on the wire.
        n: u32,
        /// The framed line.
        text: String,
        /// How often it was asked for.
        resends: u32,
    },
    /// The printer wants a line that is no longer kept, or that never was.
    #[error(
        "the printer asks for line N{n}, but only N{first} to N{last} can be sent again: it has \
         lost count, and going on would leave a gap"
    )]
    OddRequest {
        /// Number asked for.
        n: u32,
        /// Oldest line kept.
        first: u32,
        /// Newest line sent.
        last: u32,
    },
    /// The file gave a line that does not fit, although it was checked before.
    #[error("line {job_line} of the file is too long to be sent: {framed_len} characters framed")]
    LineTooLong {
        /// The job's own line number.
        job_line: u64,
        /// Characters of the framed line.
        framed_len: usize,
    },
    /// The job's lines could not be read on.
    #[error("the job cannot be read on after line {job_line}: {reason}")]
    Source {
        /// Last line that was read.
        job_line: u64,
        /// What went wrong.
        reason: String,
    },
    /// The port is gone.
    #[error("the connection to the printer is lost: {reason}")]
    PortLost {
        /// What the system said.
        reason: String,
    },
}

fn heard(bytes: u64, lines: u64) -> String {
    match (bytes, lines) {
        (0, _) => "nothing came back".to_owned(),
        (_, 0) => format!("{bytes} bytes came, but no line of a printer"),
        _ => format!("{lines} lines came, but none acknowledges a command"),
    }
}
