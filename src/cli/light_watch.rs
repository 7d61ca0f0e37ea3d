//! `outrigger light-watch`: the process that switches a resin printer's light off when its host is dead.
//!
//! Started by a host that prints, never by a person; see `station/watchdog.rs`.
use crate::station::watchdog;
use anyhow::Context;
use std::process::ExitCode;

/// Switch a resin printer's light off when the program that printed on it has died (started by
/// `outrigger print` and `outrigger serve` themselves)
#[derive(clap::Args)]
#[command(hide = true)]
pub(super) struct Args {
    /// Lines that switch the light off.
    off: Vec<String>,
}

/// Runs the verb: words come on standard input, the port is standard output.
///
/// # Errors
/// The port is gone.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    watchdog::watch(&args.off).context("the light cannot be switched off")?;
    Ok(ExitCode::SUCCESS)
}
