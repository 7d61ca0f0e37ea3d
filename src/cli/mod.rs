//! The verbs, one a file. Flags, help and progress bars live here and nowhere else.
//!
//! A verb is an `Args` struct (clap) and `run(Args) -> anyhow::Result<ExitCode>`.
//! Exit codes: 0 done; 1 the file or the printer is at fault (one clear line on
//! stderr: what, where, what to do); 2 wrong usage (clap's own).
mod check;
mod console;
mod demo;
mod files;
mod guard;
mod interrupt;
mod jobs;
mod material;
mod mock;
mod model;
mod page;
mod picture;
mod ports;
mod post;
mod print;
mod profile;
mod progress;
mod serial;
mod serve;
mod support;
mod user;

use crate::causes;
use clap::{Parser, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// A companion beside a 3D printer: finds what would print in the air, reorders infill so
/// that the head lifts least, proves that the job is still the same, and streams it
/// without losing a line
#[derive(Parser)]
#[command(name = "outrigger", version, arg_required_else_help = true)]
struct Cli {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    Demo(demo::Args),
    Check(check::Args),
    Support(support::Args),
    Post(post::Args),
    Print(print::Args),
    Serve(serve::Args),
    User(user::Args),
    Jobs(jobs::Args),
    Ports(ports::Args),
    Console(console::Args),
    Mock(mock::Args),
    Guard(guard::Args),
    Profile(profile::Args),
}

/// What a host needs of a printer's profile; `macros`: whether its start and end macros go
/// around the file. For the rig, which prints without the command line.
pub fn host_settings(profile: &crate::profile::Profile, macros: bool) -> crate::job::host::HostSettings {
    crate::station::settings::of(profile, macros)
}

/// How a resin printer of this profile is told; `None` where it is none. For the rig, too.
pub fn resin_rules(profile: &crate::profile::Profile) -> Option<crate::printer::exposure::script::Rules> {
    profile.msla().map(crate::station::settings::script_rules)
}

/// Runs the verb that the command line names.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let done = match cli.verb {
        Verb::Demo(args) => demo::run(&args),
        Verb::Check(args) => check::run(&args),
        Verb::Support(args) => support::run(&args),
        Verb::Post(args) => post::run(&args),
        Verb::Print(args) => print::run(args),
        Verb::Serve(args) => serve::run(&args),
        Verb::User(args) => user::run(&args),
        Verb::Jobs(args) => jobs::run(args),
        Verb::Ports(args) => ports::run(&args),
        Verb::Console(args) => console::run(&args),
        Verb::Mock(args) => mock::run(args),
        Verb::Guard(args) => guard::run(&args),
        Verb::Profile(args) => profile::run(args),
    };
    match done {
        Ok(code) => code,
        Err(error) => {
            eprintln!("outrigger: {}", causes::line(&error));
            ExitCode::from(1)
        }
    }
}

/// Writes a line to standard output; a reader that has gone away is no error.
fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}
