//! What is known of a job, for people and for programs.
//!
//! Takes a job as the folder shows it; gives words, a share, what can be done next, and
//! the JSON fields that the verb's help lists.
use crate::job::disk::{Entry, JobId};
use crate::job::record::Log;
use crate::job::state::State;
use crate::station::escape::printable;
use serde::Serialize;

/// What can be done with a job.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Next {
    /// `jobs resume`
    Resume,
    /// `print`
    Print,
    /// `jobs forget`
    Forget,
}

/// What can be done with it now.
pub(super) fn next(log: &Log, live: bool) -> &'static [Next] {
    match log.state {
        _ if live => &[],
        State::Accepted if log.starts == 0 => &[Next::Print, Next::Forget],
        state if state.is_over() => &[Next::Forget],
        _ => &[Next::Resume, Next::Forget],
    }
}

/// Whether its host died and nobody has taken it up: heaters may be on.
pub(super) fn is_orphan(log: &Log, live: bool) -> bool {
    !live && (log.state.is_active() || log.state == State::Accepted && log.starts > 0)
}

/// Its state, in a few words.
pub(super) fn state_words(log: &Log, live: bool) -> String {
    match is_orphan(log, live) {
        true => format!("broken off ({})", log.state.words()),
        false => log.state.words().to_owned(),
    }
}

/// How much of it was acknowledged, in percent of its commands.
pub(super) fn percent(log: &Log) -> f64 {
    match log.state {
        State::Finished => 100.0,
        _ => {
            let done = log.checkpoint.commands.min(log.accepted.commands);
            100.0 * done as f64 / log.accepted.commands.max(1) as f64
        }
    }
}

/// The file's name without its folder, fit for a terminal.
pub(super) fn file_name(log: &Log) -> String {
    let path = &log.accepted.path;
    printable(&path.file_name().unwrap_or(path.as_os_str()).to_string_lossy())
}

/// A state's word in JSON, which is part of the interface.
fn word(state: State) -> &'static str {
    match state {
        State::Accepted => "accepted",
        State::Starting => "starting",
        State::Printing => "printing",
        State::Pausing => "pausing",
        State::Paused => "paused",
        State::Resuming => "resuming",
        State::Asking => "asking",
        State::Lost => "lost",
        State::TakingOver => "taking_over",
        State::Recovering => "recovering",
        State::Ending => "ending",
        State::Cancelling => "cancelling",
        State::Failing => "failing",
        State::Interrupted => "interrupted",
        State::Finished => "finished",
        State::Cancelled => "cancelled",
        State::Failed => "failed",
    }
}

/// A job as JSON.
#[derive(Serialize)]
#[serde(untagged)]
pub(super) enum Json {
    /// Its records can be read.
    Known(Box<Known>),
    /// They cannot.
    Unreadable {
        /// Its number.
        id: JobId,
        /// Whether a host holds it.
        live: bool,
        /// Why.
        error: String,
    },
}

/// The fields, as the verb's help explains them.
#[derive(Serialize)]
pub(super) struct Known {
    id: JobId,
    live: bool,
    state: &'static str,
    state_text: String,
    next: &'static [Next],
    file: String,
    profile: String,
    bytes: u64,
    sha256: String,
    commands: u64,
    accepted_unix_s: u64,
    starts: u32,
    port: Option<String>,
    baud: Option<u32>,
    opened_unix_s: Option<u64>,
    commands_done: u64,
    percent: f64,
    line: u64,
    layer: u32,
    z_mm: f64,
    nozzle_c: f32,
    nozzle_target_c: f32,
    bed_c: f32,
    bed_target_c: f32,
    made_safe: bool,
    made_safe_z_mm: Option<f64>,
    note: Option<String>,
    damaged: bool,
    lost_bytes: u64,
}

/// A job as JSON.
pub(super) fn json(entry: &Entry) -> Json {
    let (id, live) = (entry.id, entry.live);
    let picture = match &entry.picture {
        Ok(picture) => picture,
        Err(error) => return Json::Unreadable { id, live, error: error.to_string() },
    };
    let log = &picture.log;
    let (accepted, at) = (&log.accepted, &log.checkpoint);
    let opened = log.opened.as_ref();
    Json::Known(Box::new(Known {
        id,
        live,
        state: word(log.state),
        state_text: state_words(log, live),
        next: next(log, live),
        file: accepted.path.to_string_lossy().into_owned(),
        profile: accepted.profile.clone(),
        bytes: accepted.bytes,
        sha256: hex(&accepted.digest),
        commands: accepted.commands,
        accepted_unix_s: accepted.at_unix_s,
        starts: log.starts,
        port: opened.map(|(port, ..)| port.clone()),
        baud: opened.map(|(_, baud, _)| *baud),
        opened_unix_s: opened.map(|(.., at)| *at),
        commands_done: at.commands,
        percent: percent(log),
        line: at.line,
        layer: at.layer,
        z_mm: at.z_mm,
        nozzle_c: at.nozzle_c[0],
        nozzle_target_c: at.nozzle_c[1],
        bed_c: at.bed_c[0],
        bed_target_c: at.bed_c[1],
        made_safe: log.made_safe.is_some(),
        made_safe_z_mm: log.made_safe.flatten(),
        note: log.note.clone(),
        damaged: log.damaged,
        lost_bytes: picture.cut.map_or(0, |cut| cut.bytes),
    }))
}

/// Bytes as `sha256sum` writes them.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}
