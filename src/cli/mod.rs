//! The verbs, one a file. Flags, help and progress bars live here and nowhere else.
//!
//! A verb is an `Args` struct (clap) and `run(Args) -> anyhow::Result<ExitCode>`.
//! Exit codes: 0 done; 1 the file or the printer is at fault (one clear line on
//! stderr: what, where, what to do); 2 wrong usage (clap's own).
use clap::{Parser, Subcommand};
use std::process::ExitCode;

pub mod mock;
pub(crate) mod print;
pub mod profile;

/// A daemon beside a 3D printer.
#[derive(Parser)]
#[command(name = "outrigger", version, about, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Mock(mock::Args),
    Print(print::Args),
    Profile(profile::Args),
}

/// Runs the verb that the command line names.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let done: anyhow::Result<ExitCode> = match cli.verb {
        Verb::Mock(args) => mock::run(args),
        Verb::Print(args) => print::run(args),
        Verb::Profile(args) => profile::run(args),
    };
    match done {
        Ok(code) => code,
        Err(e) => {
            eprintln!("outrigger: {e:#}");
            ExitCode::from(1)
        }
    }
}
