//! Where a job that was broken off stands, and what may be done about it.
//!
//! Takes the journal's picture and what the printer says of itself; gives one of the
//! cases that a person is told of. Pure.
//!
//! # What is certain after a loss of state
//! A firmware says `ok` when a command is in its queue or planner, not when the move
//! is made. So of the `n` commands that the last durable checkpoint says were
//! acknowledged, those before the last [`ResumeRules::depth`] surely were executed,
//! and nothing beyond `n + MAX_AHEAD` was sent. The job is taken up again before the
//! former, so nothing is left out, and what is printed twice is at most
//! [`ResumeRules::most_twice`] commands.
pub mod one_by_one;
mod plan;
pub mod plate;
pub mod walk;

pub use plan::{Plan, Step, ZDuring, plan};
pub use plate::{PlateRules, lower_again};

use super::host::MAX_AHEAD;
use super::record::{Log, Numbers};
use super::state::State;
use crate::printer::session::Found;
use walk::Walked;

/// What a profile says of resuming after the printer lost its state.
#[derive(Debug, Clone, PartialEq)]
pub struct ResumeRules {
    /// X and Y can be homed without Z (not on a delta, polar or SCARA machine).
    pub homes_xy_alone: bool,
    /// Homing X and Y cannot touch a part on the bed once Z was raised.
    pub homing_clears_part: bool,
    /// How far Z is raised before anything moves in X or Y, mm.
    pub raise_mm: f64,
    /// Temperature at which the nozzle comes off the part, °C.
    pub soften_c: f32,
    /// Moves that the firmware plans ahead (BLOCK_BUFFER_SIZE).
    pub planner_moves: u32,
    /// Commands that it queues (BUFSIZE).
    pub queue_commands: u32,
    /// Tells the firmware its Z without moving; `{z}` is the height. None: `G92 Z{z}`.
    pub z_set: Vec<String>,
    /// Homes X and Y without Z. None: `G28 R0 X Y`.
    pub home: Vec<String>,
    /// Restores bed levelling.
    pub levelling: Vec<String>,
    /// Primes the nozzle off the part, Z being raised. None: 10 mm of filament where X and
    /// Y are after homing.
    pub prime: Vec<String>,
    /// A resin printer's own rules: what is above does not concern it.
    pub plate: Option<PlateRules>,
}

impl Default for ResumeRules {
    /// A Marlin of which nothing is known: no resume after a loss of power.
    fn default() -> Self {
        Self {
            homes_xy_alone: false,
            homing_clears_part: false,
            raise_mm: 10.0,
            soften_c: 150.0,
            planner_moves: 16,
            queue_commands: 4,
            z_set: Vec::new(),
            home: Vec::new(),
            levelling: vec!["M420 S1".to_owned()],
            prime: Vec::new(),
            plate: None,
        }
    }
}

/// An `ok` does not prove acceptance: a line with a damaged `N` is answered too, and
/// so may be the one before the refusal arrives.
pub const UNPROVED_OKS: u32 = 2;

/// So many moves further back a place is looked for at which a restart shows least:
/// the start of a travel.
pub const CLEAN_BACK_MOVES: u32 = 16;

impl ResumeRules {
    /// Moves before the last acknowledged command that may not have been made.
    pub fn depth(&self) -> u32 {
        self.held_moves().saturating_add(UNPROVED_OKS)
    }

    /// Moves that the firmware may have accepted and not made.
    pub fn held_moves(&self) -> u32 {
        self.planner_moves.saturating_add(self.queue_commands)
    }

    /// Reckons with a printer that has told that it may hold so many moves: what it
    /// tells counts where the profile says less.
    pub fn allow_for(&mut self, moves: u32) {
        self.planner_moves = self.planner_moves.max(moves.saturating_sub(self.queue_commands));
    }

    /// Moves that are made twice at most by a resume after a loss of state.
    pub fn most_twice(&self) -> u64 {
        MAX_AHEAD + u64::from(self.depth()) + u64::from(CLEAN_BACK_MOVES)
    }
}

/// Where a job that was broken off stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Case {
    /// Nothing of the file was sent: it may start from its beginning.
    NotBegun,
    /// The printer kept its state: the job goes on after so many of its commands.
    HostDied {
        /// Commands of the file that the printer has accepted.
        after: u64,
        /// It was parked, or on its way there or back: it waits for a person's word.
        parked: bool,
    },
    /// The printer lost its state; after a person's word the job goes on after so
    /// many commands, of which the last few may be printed twice.
    PrinterReset {
        /// Commands of the file that were acknowledged. The job goes on some moves
        /// before (see the module's text) unless `exact`.
        after: u64,
        /// All of these were executed and nothing after them.
        exact: bool,
    },
    /// The printer lost its state and the job cannot be resumed: why.
    Refused(Refusal),
    /// Not to be known: what is certain, and what is not.
    NotKnown {
        /// For the user.
        certain: String,
        /// For the user.
        uncertain: String,
    },
    /// It was being ended when its host died: that is done first.
    Unsafe,
    /// It is over.
    Over,
}

/// Why a job cannot be resumed after the printer lost its state.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum Refusal {
    /// Delta, polar, SCARA.
    #[error("this printer cannot home X and Y without moving Z, and Z cannot be homed over a part")]
    HomingMovesZ,
    /// The profile does not say that homing is clear of the part.
    #[error(
        "the profile does not say that homing X and Y is clear of a part on the bed \
         (resume.homing_clears_part)"
    )]
    HomingMayHitPart,
    /// Objects are printed one by one, and some are finished.
    #[error("objects are printed one after the other, and the head could hit those that are finished")]
    OneByOne,
    /// It broke off before its first layer.
    #[error(
        "it broke off in its preparation, before anything was printed: clear the bed, forget it, print it anew"
    )]
    InPreparation,
    /// It broke off while the nozzle was being moved up or down by us.
    #[error("how high the nozzle stands is not known: it was being moved when it broke off")]
    HeightNotKnown,
    /// `G92 Z` is in force: heights in the file are not the printer's.
    #[error("the file shifts its heights (G92 Z), so the nozzle's cannot be told to the printer")]
    HeightShifted,
    /// The medium has lost some of what was written down.
    #[error("records were lost from its journal, so it may be further than what is left of them says")]
    RecordsLost,
    /// Too many commands without a move for what is kept of them.
    #[error("the file has too many commands without a move where it broke off")]
    TooManyCommands,
}

/// Tells the cases apart.
pub fn case(log: &Log, found: Found, rules: &ResumeRules) -> Case {
    if log.state.is_over() {
        return Case::Over;
    }
    if log.state == State::Cancelling || (log.state == State::Failing && found != Found::Started) {
        return Case::Unsafe;
    }
    let reached = reached(log);
    if !begun(log) {
        return Case::NotBegun;
    }
    match found {
        // The heaters are off, and the head is elsewhere.
        _ if log.made_safe.is_some() => after_reset(log, rules),
        // A board that has started before we listened counts from 0; the handshake of
        // a job's host alone goes beyond.
        Found::Started | Found::Counting { last: 0 } => after_reset(log, rules),
        Found::Counting { last } => match &log.numbers {
            Numbers::Nothing { after } => host_died(log, *after),
            Numbers::Job { after, .. } => match log.numbers.commands_through(last) {
                Some(n) if (reached..=reached + MAX_AHEAD).contains(&n) && n >= *after => {
                    Case::HostDied { after: n, parked: false }
                }
                _ => not_known(
                    log,
                    format!("the printer's last line is N{last}, and this job cannot have come to that"),
                ),
            },
        },
        Found::NotSaid => {
            not_known(log, "the printer does not say which line it has accepted last".to_owned())
        }
    }
}

/// Commands of the file that surely were acknowledged.
fn reached(log: &Log) -> u64 {
    match &log.numbers {
        Numbers::Nothing { after } => *after,
        Numbers::Job { after, .. } => log.checkpoint.commands.max(*after),
    }
}

/// Whether anything of the file may have been sent.
fn begun(log: &Log) -> bool {
    log.numbers != Numbers::Nothing { after: 0 } || log.checkpoint.commands > 0
}

fn host_died(log: &Log, after: u64) -> Case {
    // A pause may come behind the last command, too.
    let pauses = matches!(log.state, State::Pausing | State::Paused | State::Resuming);
    let parked = pauses || log.state != State::Ending && after < log.accepted.commands;
    Case::HostDied { after, parked }
}

fn not_known(log: &Log, uncertain: String) -> Case {
    Case::NotKnown {
        certain: format!(
            "the first {} commands of the file (to line {}) were acknowledged",
            reached(log),
            log.checkpoint.line
        ),
        uncertain,
    }
}

fn after_reset(log: &Log, rules: &ResumeRules) -> Case {
    if log.damaged {
        return Case::Refused(Refusal::RecordsLost);
    }
    if rules.plate.is_some() {
        // What is written down tells exactly where; whether it can be resumed, the plan.
        return Case::PrinterReset { after: reached(log), exact: true };
    }
    if !rules.homes_xy_alone {
        return Case::Refused(Refusal::HomingMovesZ);
    }
    if !rules.homing_clears_part {
        return Case::Refused(Refusal::HomingMayHitPart);
    }
    let exact = matches!(log.numbers, Numbers::Nothing { .. });
    let in_motion = match log.made_safe {
        Some(z_mm) => z_mm.is_none(),
        // Between the pause and the next line of the file the head is anywhere but
        // when it is parked.
        None => exact && log.state != State::Paused,
    };
    if in_motion {
        return not_known(log, "how high the nozzle stands: it was being moved when it broke off".to_owned());
    }
    Case::PrinterReset { after: reached(log), exact }
}

/// Height at which the nozzle stands after a loss of state, mm: as it was written down, as
/// the pause macro has left it, or the lowest of where the moves in question lead, so
/// that what it is taken for is never higher than it is.
pub fn height_mm(log: &Log, walked: &Walked, pause_macro: &[String]) -> Option<f64> {
    match log.made_safe {
        Some(z_mm) => z_mm,
        None if log.state == State::Paused => {
            let mut parked = walked.tracker.clone();
            for line in pause_macro {
                parked.apply(line.as_bytes());
            }
            parked.at_mm(2)
        }
        None => Some(walked.lowest_mm),
    }
}

#[cfg(test)]
mod tests;
