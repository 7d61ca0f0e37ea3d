//! Starts a guardian (`outrigger guard`): a process that makes the printer safe when we are dead.
//!
//! Takes the folder of the jobs and the guardian's words. Knows nothing of what a guardian does.
use crate::job::disk::{JobId, Store};
use anyhow::Context;
use std::ffi::OsString;
use std::process::{Command, Stdio};

/// This program, also where its file was replaced or removed since it was started: an update in
/// the middle of a print. OUTRIGGER_EXE names another way to run it: under an emulator, which does not
/// reach what is started from within.
pub(crate) fn program() -> OsString {
    std::env::var_os("OUTRIGGER_EXE").unwrap_or_else(|| "/proc/self/exe".into())
}

/// Starts a guardian for a job that this process prints.
///
/// # Errors
/// It cannot be started; the job may go on, and somebody should be told.
pub(crate) fn start(store: &Store, id: JobId) -> anyhow::Result<()> {
    spawn(store, ["guard".into(), "--job".into(), id.to_string().into()])
}

/// This program once more, with no ties to our folder, terminal and pipes. Whoever runs
/// out of patience with a dead parent inherits it; a living one collects it in a thread.
///
/// # Errors
/// This program cannot be found or started.
pub(crate) fn spawn(store: &Store, arguments: impl IntoIterator<Item = OsString>) -> anyhow::Result<()> {
    let state = std::path::absolute(store.path()).context("cannot find the folder of the jobs")?;
    let mut child = Command::new(program())
        .args(arguments)
        .arg("--state")
        .arg(state)
        .current_dir("/")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .context("cannot start it")?;
    // A guardian that ends before us must not stay as a zombie.
    let _ = std::thread::Builder::new().name("guardian".to_owned()).spawn(move || child.wait());
    Ok(())
}
