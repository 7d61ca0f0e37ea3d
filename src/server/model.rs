//! The objects that the daemon tells of: printers, files, checks, jobs.
//!
//! Plain data with the names of `docs/api.md`, which is an interface: fields are only ever added.
//! What must outlive the process is written down in the same form. Knows no socket, no file and no
//! thread.
use super::config::OnFindings;
use crate::job::state::State;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use utoipa::ToSchema;

/// A printer, as it is now.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub(crate) struct Printer {
    /// Its short name.
    pub(crate) id: String,
    /// What people call it.
    pub(crate) name: String,
    /// Its profile's name.
    pub(crate) profile: String,
    /// What it prints with.
    pub(crate) kind: PrinterKind,
    /// What a person must have seen to before each print; empty: nothing.
    pub(crate) before: Vec<String>,
    /// Where its connection stands.
    pub(crate) state: Link,
    /// The same in words, or what its job does.
    pub(crate) state_words: String,
    /// Why it is not there.
    pub(crate) error: Option<String>,
    /// What the firmware calls itself.
    pub(crate) firmware: Option<String>,
    /// The last that it has told.
    pub(crate) temperatures: Heat,
    /// The hottest that its profile allows.
    pub(crate) limits: Limits,
    /// What it can print.
    pub(crate) bed_mm: Bed,
    /// Whether nothing is known to lie on the bed.
    pub(crate) bed_clear: bool,
    /// The job that has it.
    pub(crate) job: Option<String>,
    /// How far that is.
    pub(crate) progress: Option<Progress>,
    /// What the printer asks.
    pub(crate) question: Option<Question>,
    /// What it waits for a person to do.
    pub(crate) waits_for_user: Option<String>,
    /// What is done after a yes to get back into a broken-off job.
    pub(crate) plan: Option<String>,
    /// What happens to a job in which the check finds something.
    pub(crate) on_findings: OnFindings,
    /// A webcam's picture.
    pub(crate) webcam_url: Option<String>,
    /// Jobs that wait, the next first.
    pub(crate) queue: Vec<String>,
    /// What happened lately, the newest last.
    pub(crate) messages: Vec<Message>,
}

/// What a printer prints with.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PrinterKind {
    /// Filament, through a nozzle onto a bed.
    #[default]
    Fdm,
    /// Resin, cured through a masking display onto a plate.
    Msla,
}

/// Where the connection to a printer stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Link {
    /// Nobody has its port, by a person's wish.
    #[default]
    Offline,
    /// Its port is looked for, or it has not answered yet.
    Connecting,
    /// It answers and has nothing to do.
    Ready,
    /// A job has it.
    Busy,
    /// Its actor broke down; the others go on.
    Failed,
}

/// The heaters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Heat {
    /// The hotend in use.
    pub(crate) nozzle: Option<Heater>,
    /// The bed.
    pub(crate) bed: Option<Heater>,
    /// The chamber.
    pub(crate) chamber: Option<Heater>,
}

/// One heater.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Heater {
    /// Measured, °C.
    pub(crate) actual_c: f32,
    /// Wanted, °C; 0: off.
    pub(crate) target_c: f32,
}

/// The hottest that is allowed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Limits {
    /// Of the nozzle, °C.
    pub(crate) nozzle_c: f64,
    /// Of the bed, °C; 0: it has no heater.
    pub(crate) bed_c: f64,
}

/// What can be printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Bed {
    /// Width, mm.
    pub(crate) x: f64,
    /// Depth, mm.
    pub(crate) y: f64,
    /// Height, mm.
    pub(crate) z: f64,
    /// It is a disc.
    pub(crate) round: bool,
    /// X 0, Y 0 is its middle.
    pub(crate) centred: bool,
}

/// How far a job is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Progress {
    /// Of its lines, 0 to 1.
    pub(crate) fraction: f64,
    /// The last line of the file that was acknowledged.
    pub(crate) line: u64,
    /// The last line that will be sent.
    pub(crate) lines: u64,
    /// The layer that is printed, from 1; 0: not told by the file.
    pub(crate) layer: u64,
    /// Layers; 0: not told by the file.
    pub(crate) layers: u64,
    /// Height of the last bead, mm.
    pub(crate) z_mm: Option<f64>,
    /// Since its first line, s.
    pub(crate) elapsed_s: f64,
    /// What is left, s.
    pub(crate) left_s: Option<f64>,
}

/// What a printer asks a person.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Question {
    /// Its words.
    pub(crate) text: String,
    /// Its buttons, in order.
    pub(crate) choices: Vec<String>,
}

/// How much a message or a log line matters.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Level {
    /// To know.
    #[default]
    Info,
    /// To look at.
    Warning,
    /// To act upon.
    Error,
}

/// Something that happened.
#[derive(Clone, Debug, Default, PartialEq, Serialize, ToSchema)]
pub(crate) struct Message {
    /// When.
    pub(crate) at_unix_s: u64,
    /// How much it matters.
    pub(crate) level: Level,
    /// What, for people.
    pub(crate) words: String,
}

/// A line of a printer's console.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
pub(crate) struct ConsoleLine {
    /// When.
    pub(crate) at_unix_s: u64,
    /// `printer`, `us` or `note`.
    pub(crate) from: &'static str,
    /// What was said.
    pub(crate) text: String,
}

/// A temperature sample: time (s since 1970), nozzle and its target, bed and its target (°C).
pub(crate) type Sample = [f64; 5];

/// What a file is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Kind {
    /// G-code, text or binary.
    Gcode,
    /// A resin job.
    Resin,
    /// Nothing that could be told.
    #[default]
    Unknown,
}

/// An uploaded file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct File {
    /// Its name here: nobody else chooses it.
    pub(crate) id: String,
    /// What people call it.
    pub(crate) name: String,
    /// Bytes.
    pub(crate) bytes: u64,
    /// SHA-256 of these, hexadecimal.
    pub(crate) sha256: String,
    /// When it came, s since 1970.
    pub(crate) uploaded_unix_s: u64,
    /// Who sent it.
    pub(crate) by: String,
    /// What it is.
    pub(crate) kind: Kind,
    /// What was found in it, for each printer that it was checked for.
    #[serde(default)]
    pub(crate) checks: BTreeMap<String, Check>,
}

/// Where a check stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum CheckState {
    /// Others are looked at first.
    #[default]
    Waiting,
    /// It is looked at.
    Checking,
    /// Nothing that should stop it.
    Clean,
    /// Something that a person should see.
    Found,
    /// It could not be checked.
    Failed,
}

/// What was found in a file, for one printer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Check {
    /// Where it stands.
    pub(crate) state: CheckState,
    /// Why it failed.
    pub(crate) words: Option<String>,
    /// Pieces that begin in the air.
    pub(crate) islands: u64,
    /// Regions that reach out too far.
    pub(crate) overhangs: u64,
    /// What this printer could not do.
    pub(crate) printer_findings: u64,
    /// What is good to know.
    pub(crate) notes: u64,
    /// The worst, one by one.
    pub(crate) findings: Vec<Finding>,
    /// Its picture's address.
    pub(crate) picture: Option<String>,
    /// How long it took.
    pub(crate) seconds: f64,
    /// The job's infill was put into a better order: in words.
    #[serde(default)]
    pub(crate) reordered: Option<String>,
}

/// How serious a finding is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Severity {
    /// The print will fail, or the printer cannot do it.
    Stop,
    /// The print may fail there.
    Look,
    /// It will hardly be seen.
    #[default]
    Note,
}

/// One thing that was found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Finding {
    /// One word for machines.
    pub(crate) kind: String,
    /// How serious it is.
    pub(crate) severity: Severity,
    /// A sentence for people.
    pub(crate) words: String,
    /// Layer, from 0.
    pub(crate) layer: Option<u64>,
    /// Height at which it is printed, mm.
    pub(crate) z_mm: Option<f64>,
    /// Line of the file, from 1.
    pub(crate) line: Option<u64>,
    /// Area, mm².
    pub(crate) area_mm2: Option<f64>,
}

/// Where a job stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Stage {
    /// Its file is looked at.
    #[default]
    Checking,
    /// Something was found: a person decides.
    Held,
    /// Supports are grown.
    Mending,
    /// Mended: it waits for a yes on its picture.
    Mended,
    /// It waits for its turn.
    Queued,
    /// See [`State`].
    Starting,
    /// See [`State`].
    Printing,
    /// See [`State`].
    Pausing,
    /// See [`State`].
    Paused,
    /// See [`State`].
    Resuming,
    /// See [`State`].
    Asking,
    /// See [`State`].
    Lost,
    /// See [`State`].
    TakingOver,
    /// See [`State`].
    Recovering,
    /// See [`State`].
    Ending,
    /// See [`State`].
    Cancelling,
    /// See [`State`].
    Failing,
    /// See [`State`].
    Interrupted,
    /// See [`State`].
    Finished,
    /// See [`State`].
    Cancelled,
    /// See [`State`].
    Failed,
}

impl Stage {
    /// That of a job which a host has.
    pub(crate) fn of(state: State) -> Self {
        match state {
            State::Accepted | State::Starting => Stage::Starting,
            State::Printing => Stage::Printing,
            State::Pausing => Stage::Pausing,
            State::Paused => Stage::Paused,
            State::Resuming => Stage::Resuming,
            State::Asking => Stage::Asking,
            State::Lost => Stage::Lost,
            State::TakingOver => Stage::TakingOver,
            State::Recovering => Stage::Recovering,
            State::Ending => Stage::Ending,
            State::Cancelling => Stage::Cancelling,
            State::Failing => Stage::Failing,
            State::Interrupted => Stage::Interrupted,
            State::Finished => Stage::Finished,
            State::Cancelled => Stage::Cancelled,
            State::Failed => Stage::Failed,
        }
    }

    /// Nothing of it was sent yet, and it is not over.
    pub(crate) fn is_before(self) -> bool {
        matches!(self, Stage::Checking | Stage::Held | Stage::Mending | Stage::Mended | Stage::Queued)
    }

    /// Nothing follows but being forgotten.
    pub(crate) fn is_over(self) -> bool {
        matches!(self, Stage::Finished | Stage::Cancelled | Stage::Failed)
    }

    /// A host has it.
    pub(crate) fn is_running(self) -> bool {
        !self.is_before() && !self.is_over() && self != Stage::Interrupted
    }

    /// For people.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Stage::Checking => "being checked",
            Stage::Held => "held: the check found something; you decide",
            Stage::Mending => "being mended",
            Stage::Mended => "mended: look at its picture and say yes",
            Stage::Queued => "waiting for its turn",
            Stage::Starting => State::Starting.words(),
            Stage::Printing => State::Printing.words(),
            Stage::Pausing => State::Pausing.words(),
            Stage::Paused => State::Paused.words(),
            Stage::Resuming => State::Resuming.words(),
            Stage::Asking => State::Asking.words(),
            Stage::Lost => State::Lost.words(),
            Stage::TakingOver => State::TakingOver.words(),
            Stage::Recovering => State::Recovering.words(),
            Stage::Ending => State::Ending.words(),
            Stage::Cancelling => State::Cancelling.words(),
            Stage::Failing => State::Failing.words(),
            Stage::Interrupted => State::Interrupted.words(),
            Stage::Finished => State::Finished.words(),
            Stage::Cancelled => State::Cancelled.words(),
            Stage::Failed => State::Failed.words(),
        }
    }
}

/// What may be wanted of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Can {
    /// Print it as it is, or the mended one.
    Approve,
    /// Give the mended one up: print it as it was sliced.
    Original,
    /// Grow supports.
    Mend,
    /// Start it although the bed was not said to be clear.
    Start,
    /// End it, or take it out of the queue.
    Cancel,
    /// Park and wait.
    Pause,
    /// Go on, also after it was broken off.
    Resume,
    /// Part and nozzle are clear.
    Confirm,
    /// Hear no more of it.
    Forget,
    /// Queue the same file once more.
    Again,
}

/// Which of its files is printed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Printed {
    /// As it was sliced; its infill may be in a better order.
    #[default]
    Original,
    /// With the supports that were grown.
    Mended,
}

/// Where a mending stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum MendState {
    /// It is made.
    #[default]
    Running,
    /// It is there.
    Done,
    /// It cannot be.
    Failed,
}

/// A job with supports that were grown.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Mend {
    /// Where it stands.
    pub(crate) state: MendState,
    /// What was done, or why not.
    pub(crate) words: String,
    /// The page of part and supports.
    pub(crate) picture: Option<String>,
    /// The paths of a layer before and after reordering.
    pub(crate) paths_picture: Option<String>,
    /// Material of the supports, mm³.
    pub(crate) added_mm3: f64,
}

/// What becomes of a job that was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum GivenUp {
    /// It is cancelled, and stays in the list.
    Cancel,
    /// It is forgotten.
    Forget,
}

/// A file on its way to a printer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub(crate) struct Job {
    /// Its name here.
    pub(crate) id: String,
    /// The printer.
    pub(crate) printer: String,
    /// The file.
    pub(crate) file: String,
    /// What people call it.
    pub(crate) name: String,
    /// When it was queued, s since 1970.
    pub(crate) created_unix_s: u64,
    /// By whom.
    pub(crate) by: String,
    /// Where it stands.
    pub(crate) state: Stage,
    /// The same for people.
    #[serde(default)]
    pub(crate) state_words: String,
    /// What it waits for.
    #[serde(default)]
    pub(crate) waits_for: Option<String>,
    /// What may be wanted of it now.
    #[serde(default)]
    pub(crate) can: Vec<Can>,
    /// The mended one, where there is any.
    #[serde(default)]
    pub(crate) mend: Option<Mend>,
    /// Which is printed.
    #[serde(default)]
    pub(crate) printed: Printed,
    /// The number of its journal (`outrigger jobs show N`), once it was begun.
    #[serde(default)]
    pub(crate) record: Option<u32>,
    /// When its first line was sent.
    #[serde(default)]
    pub(crate) started_unix_s: Option<u64>,
    /// When it was over.
    #[serde(default)]
    pub(crate) ended_unix_s: Option<u64>,
    /// Why it failed, and what to do.
    #[serde(default)]
    pub(crate) error: Option<String>,
    /// Somebody has seen to what is to be so before it ([`Printer::before`]). It holds for one start.
    #[serde(default)]
    pub(crate) prepared: bool,
    /// Somebody said that it may start whatever lies on the bed.
    #[serde(default)]
    pub(crate) start_anyway: bool,
    /// Its place among those that wait.
    #[serde(default)]
    pub(crate) place: u64,
    /// It waits for a person even if nothing is found.
    #[serde(default)]
    pub(crate) hold: bool,
    /// Somebody has said that nothing of it lies on the bed any more.
    #[serde(default)]
    pub(crate) cleared: bool,
    /// It was broken off, and a person has given it up; whoever holds it is waited for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) given_up: Option<GivenUp>,
    /// A person has said that it shall be printed.
    #[serde(default)]
    pub(crate) approved: bool,
}
