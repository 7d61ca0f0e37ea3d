//! `outrigger jobs forget ID`: a job's records are removed.
use super::facts::Next;
use super::facts::{file_name, next, state_words};
use crate::cli::say;
use crate::job::disk::{Entry, JobId, Store, StoreError};
use anyhow::bail;
use std::io::{BufRead, IsTerminal, Read, Write};
use std::process::ExitCode;

/// A person's answer is no longer.
const MAX_ANSWER_BYTES: u64 = 1024;

pub(super) fn run(store: Option<&Store>, id: JobId, yes: bool) -> anyhow::Result<ExitCode> {
    let store = store.ok_or(StoreError::NoJob(id))?;
    let entry = store.look(id)?;
    if entry.live {
        return Err(StoreError::Busy(id).into());
    }
    if !yes {
        let resumable = match &entry.picture {
            Ok(picture) => next(&picture.log, false).contains(&Next::Resume),
            Err(_) => true,
        };
        if resumable {
            return Err(StoreError::Interrupted(id).into());
        }
        if !asked(&entry)? {
            say("nothing was changed");
            return Ok(ExitCode::from(1));
        }
    }
    store.forget(id, yes)?;
    say(&format!("job {id} is forgotten"));
    Ok(ExitCode::SUCCESS)
}

/// What a person says.
fn asked(entry: &Entry) -> anyhow::Result<bool> {
    let id = entry.id;
    let stdin = std::io::stdin();
    if !stdin.is_terminal() {
        bail!("nobody is there to be asked whether to forget job {id}: --yes says so");
    }
    let what = match &entry.picture {
        Ok(picture) => format!("{}, {}", file_name(&picture.log), state_words(&picture.log, false)),
        Err(_) => "unreadable".to_owned(),
    };
    let _ = write!(std::io::stderr(), "forget job {id} ({what})? [y/N] ");
    let mut answer = String::new();
    stdin.lock().take(MAX_ANSWER_BYTES).read_line(&mut answer)?;
    Ok(matches!(answer.trim(), "y" | "Y" | "yes"))
}
