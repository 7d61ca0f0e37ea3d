//! `outrigger profile list | show NAME | check FILE`: printer and material profiles.
use crate::profile::{self, Any};
use anyhow::Context;
use clap::{Args as ClapArgs, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// Printer and material profiles.
///
/// A profile is a TOML file. Those that come with Outrigger are named
/// (`prusa-mk3s`, `petg`); your own is named by its path, which ends in .toml.
/// To make one, start from the nearest: `outrigger profile show ender-3 > mine.toml`.
#[derive(ClapArgs)]
pub(super) struct Args {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Subcommand)]
enum Verb {
    /// Lists the profiles that come with Outrigger, with their kinds.
    List {
        /// Write JSON: `printers` and `materials`, each with `name`, `kind` and `title`.
        #[arg(long)]
        json: bool,
    },
    /// Prints a profile with every key explained; the output is a profile itself.
    Show {
        /// Name of a profile, or the path of a file that ends in .toml.
        name: String,
        /// Write JSON, without the explanations.
        #[arg(long)]
        json: bool,
    },
    /// Checks profiles of your own: keys, types, ranges, and that `cancel` is safe.
    Check {
        /// Files to check.
        #[arg(required = true)]
        files: Vec<String>,
    },
}

/// Runs the verb.
///
/// # Errors
/// A profile that cannot be loaded, or an output that cannot be written.
pub(super) fn run(args: Args) -> anyhow::Result<ExitCode> {
    match args.verb {
        Verb::List { json } => list(json)?,
        Verb::Show { name, json } => show(&name, json)?,
        Verb::Check { files } => return check(&files),
    }
    Ok(ExitCode::SUCCESS)
}

/// A line of the list: name, kind and title.
struct Listed {
    name: &'static str,
    kind: &'static str,
    title: String,
}

fn list(json: bool) -> anyhow::Result<()> {
    let mut printers = Vec::new();
    for name in profile::printer_names() {
        let found = profile::load_printer(name)?;
        printers.push(Listed { name, kind: found.kind.word(), title: found.title });
    }
    let mut materials = Vec::new();
    for name in profile::material_names() {
        let found = profile::load_material(name)?;
        materials.push(Listed { name, kind: found.kind.word(), title: found.title });
    }
    if json {
        let listed = |list: &[Listed]| -> Vec<serde_json::Value> {
            let one = |l: &Listed| serde_json::json!({ "name": l.name, "kind": l.kind, "title": l.title });
            list.iter().map(one).collect()
        };
        let all = serde_json::json!({
            "printers": listed(&printers), "materials": listed(&materials),
        });
        return print(&format!("{all:#}\n"));
    }
    let all = || printers.iter().chain(&materials);
    let names = all().map(|l| l.name.len()).max().unwrap_or(0);
    let kinds = all().map(|l| l.kind.len()).max().unwrap_or(0);
    let mut text = String::new();
    for (head, list) in [("Printers", &printers), ("Materials", &materials)] {
        text += &format!("{head}\n");
        for Listed { name, kind, title } in list {
            text += &format!("  {name:names$}  {kind:kinds$}  {title}\n");
        }
    }
    print(&text)
}

fn show(name: &str, json: bool) -> anyhow::Result<()> {
    let profile = profile::load_any(name)?;
    if json {
        let value = match &profile {
            Any::Printer(p) => serde_json::to_string_pretty(p)?,
            Any::Material(m) => serde_json::to_string_pretty(m)?,
        };
        return print(&format!("{value}\n"));
    }
    print(&profile::explain::explain(&profile)?)
}

/// Looks at every file even after a bad one, so that one run names all faults.
fn check(files: &[String]) -> anyhow::Result<ExitCode> {
    let mut code = ExitCode::SUCCESS;
    for file in files {
        match profile::load_any(file) {
            Ok(Any::Printer(p)) => {
                print(&format!("{file}: {} printer {:?} is valid\n", p.kind.word(), p.name))?
            }
            Ok(Any::Material(m)) => print(&format!("{file}: {} {:?} is valid\n", m.kind.word(), m.name))?,
            Err(e) => {
                eprintln!("outrigger: {e}");
                code = ExitCode::from(1);
            }
        }
    }
    Ok(code)
}

/// Writes to standard output; a reader that has gone (`| head`) is no error.
fn print(text: &str) -> anyhow::Result<()> {
    match std::io::stdout().write_all(text.as_bytes()) {
        Err(e) if e.kind() == std::io::ErrorKind::BrokenPipe => Ok(()),
        done => done.context("cannot write to standard output"),
    }
}
