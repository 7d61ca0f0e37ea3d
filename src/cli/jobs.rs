//! `outrigger jobs list | show ID | resume ID | forget ID`: what is written down of jobs.
//!
//! One verb a file below; what they tell of a job is put together in `facts`.
mod facts;
mod forget;
mod list;
mod resume;
mod show;
mod when;

use crate::job::disk::{JobId, Store, folder};
use clap::{Args as ClapArgs, Subcommand};
use std::path::PathBuf;
use std::process::ExitCode;

/// Jobs that were accepted: list them, look at one, go on with one, forget one.
///
/// Every job is written down when it is accepted, and how far it is while it is
/// printed, so that neither a crash nor a power cut loses it.
#[derive(ClapArgs)]
pub(super) struct Args {
    #[command(subcommand)]
    verb: Verb,
    /// The folder of the jobs' records; by itself $OUTRIGGER_STATE, else
    /// $STATE_DIRECTORY (systemd), else $XDG_STATE_HOME/outrigger, else
    /// ~/.local/state/outrigger.
    #[arg(long, value_name = "DIR", global = true)]
    state: Option<PathBuf>,
}

#[derive(Subcommand)]
enum Verb {
    /// List all jobs.
    List {
        /// Write JSON: `jobs`, each as `jobs show --json` writes it.
        #[arg(long)]
        json: bool,
    },
    /// Tell all that is known of a job, and what can be done with it.
    ///
    /// As JSON a job has the fields: `id`; `live` (an outrigger holds it now); `error` (its
    /// records cannot be read: nothing else is known) or: `state` (a word of
    /// docs/job-states.md) and `state_text`; `next` (`resume`, `print`, `forget`: what can be
    /// done with it now); `file`, `profile`, `bytes`, `sha256`, `commands`,
    /// `accepted_unix_s`; `starts`, and of the last one `port`, `baud`, `opened_unix_s`;
    /// `commands_done`, `percent`, `line`, `layer` (0: none yet, or not marked), `z_mm`,
    /// `nozzle_c`, `nozzle_target_c`, `bed_c`, `bed_target_c` at the last checkpoint;
    /// `made_safe` (the safe sequence was its last movement) and `made_safe_z_mm`; `note`;
    /// `damaged` (records in the middle are lost) and `lost_bytes`. What is not known is null.
    Show {
        /// The job's number.
        id: JobId,
        /// Write JSON.
        #[arg(long)]
        json: bool,
    },
    /// Go on with a job that was broken off.
    ///
    /// The printer is asked where it is. One that kept its state goes on in the middle of the
    /// layer, every line once. For one that was reset or lost its power the way back is
    /// shown first, step by step, and nothing moves before a person has said that part and
    /// nozzle are clear. Some jobs cannot go on after that: why is told, and the job stays.
    Resume(resume::Args),
    /// Forget a job for ever: its records, not its file.
    Forget {
        /// The job's number.
        id: JobId,
        /// Do not ask. Needed for a job that was broken off, and where nobody can be asked.
        #[arg(long)]
        yes: bool,
    },
}

/// Runs the verb.
///
/// # Errors
/// No such job, or its records cannot be used.
pub(super) fn run(args: Args) -> anyhow::Result<ExitCode> {
    let folder = folder(args.state.as_deref(), |name| std::env::var_os(name))?;
    // To look on makes no folder.
    let store = || Store::existing(&folder);
    match args.verb {
        Verb::List { json } => list::run(store()?.as_ref(), json),
        Verb::Show { id, json } => show::run(store()?.as_ref(), id, json),
        Verb::Resume(args) => resume::run(store()?.as_ref(), &args),
        Verb::Forget { id, yes } => forget::run(store()?.as_ref(), id, yes),
    }
}
