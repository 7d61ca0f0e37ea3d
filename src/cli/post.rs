//! `outrigger post`: the slicer's hook.
//!
//! In place the contract of the slicers holds: whatever is in doubt, the file
//! stays as it was and the exit status is 0, with the reason on stderr; a
//! non-zero status would fail the slicer's whole export. A resin job goes another way
//! ([`resin`]), by its content.
mod model;
mod resin;
mod specks;
mod supports;

use super::files::{self, Replacement};
use super::interrupt::clean_up_on_signal;
use super::{page, picture, progress};
use crate::causes;
use crate::post::passes::Wishes;
use crate::post::report::Report;
use crate::post::time::Accelerations;
use crate::post::{Failure, Options, post};
use crate::profile::load_printer;
use clap::Args as ClapArgs;
use serde::Serialize;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Instant;

/// Reorder the infill of a sliced job, put supports into a job, convert a resin job
///
/// Edits FILE in place, as a slicer's post-processing script, or writes to OUT. Without
/// --supports the infill is put into the order in which the head lifts least.
/// The result is read again and must print the same; otherwise, and whenever
/// anything else is in doubt, FILE stays byte for byte as it was.
///
/// In PrusaSlicer, OrcaSlicer and SuperSlicer: Print settings, Output options,
/// Post-processing scripts: /path/to/outrigger post
///
/// A resin job is written to OUT in the format that OUT's name ends in (.sl1, .sl1s,
/// .nanodlp, .goo), its pictures as they are; a line tells each thing that the format has
/// no place for, or wants and the job does not tell. In its own format it is copied.
/// --remove-islands takes out what would print in the air and stays small.
#[derive(ClapArgs, Debug)]
pub(super) struct Args {
    /// The job: G-code of PrusaSlicer, SuperSlicer, OrcaSlicer, Bambu Studio, Cura or Slic3r,
    /// as text or binary (.bgcode), which it stays; or a resin job: SL1, SL1S, NanoDLP, GOO
    file: PathBuf,
    /// Write the result here and leave FILE alone
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Write what was done as JSON; "-" is standard output
    ///
    /// Of a resin job its fields are kind, kind_out, layers, layers_changed, notes,
    /// removed_islands, removed_pixels, islands_left, seconds, unchanged_reason. With --supports they are those of `outrigger support
    /// --json`, replaced_mm3 (of the slicer's own), and model with file and moved_mm.
    #[arg(long, value_name = "FILE.json")]
    report: Option<PathBuf>,
    /// Draw the most improved layer's paths, before and after, as SVG; with --supports the job
    /// with what holds it: a page that turns, .html, that needs no network
    #[arg(long, value_name = "FILE")]
    picture: Option<PathBuf>,
    /// Grow supports under what would print in the air, and put them into the job
    ///
    /// `auto` needs no model: the job's own beads or images say what must be held. What the
    /// slicer has supported is held already, so that only what it forgot is added; `missing`
    /// is another word for that. `replace` takes the slicer's own supports out first (G-code
    /// only). With the model that the job was sliced from (STL), as it lay on the plate, what
    /// this says must be held is held as well. Nothing is reordered then.
    #[arg(long, value_name = "auto|missing|replace|MODEL.stl")]
    supports: Option<Supports>,
    /// Move the model to where the job prints it: along the plate and up, never turned or scaled
    #[arg(long, requires = "supports")]
    align: bool,
    /// Write a result in which some places cannot be held; it should not be printed
    #[arg(long, requires = "supports")]
    allow_unroutable: bool,
    /// The material, from `outrigger profile list` or a file [default: the G-code's own
    /// filament where it names one, else pla; for resin jobs resin-standard]
    #[arg(long, value_name = "NAME", requires = "supports")]
    material: Option<String>,
    /// Leave out islands of a resin job that stay smaller than this, mm², rather than support them
    ///
    /// Such an island has nothing below it in any layer, and nothing that stands needs it.
    #[arg(long, value_name = "MM2", value_parser = super::model::positive, conflicts_with = "supports")]
    remove_islands: Option<f64>,
    /// Reorder the first layer too
    #[arg(long)]
    first_layer: bool,
    /// The printer's profile, whose accelerations the time estimate takes until the
    /// job sets its own: a name from `outrigger profile list`, or a file
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    /// Say nothing unless something is wrong
    #[arg(short, long)]
    quiet: bool,
}

impl Args {
    /// The model that the job was sliced from.
    fn model(&self) -> Option<&Path> {
        match &self.supports {
            Some(Supports::Model(path)) => Some(path),
            _ => None,
        }
    }
}

/// What `--supports` asks for.
#[derive(Clone, Debug, PartialEq)]
enum Supports {
    /// What the job needs beside the slicer's own.
    Missing,
    /// All of it anew.
    Replace,
    /// What the job and its model need beside the slicer's own.
    Model(PathBuf),
}

impl FromStr for Supports {
    type Err = String;

    fn from_str(text: &str) -> Result<Supports, String> {
        match text {
            "auto" | "missing" => Ok(Supports::Missing),
            "replace" => Ok(Supports::Replace),
            file if Path::new(file).exists() => Ok(Supports::Model(file.into())),
            _ => Err("it is neither auto, missing or replace, nor is there a model of that name".to_owned()),
        }
    }
}

/// A job that was post-processed.
pub(super) struct Done {
    /// What was done to it.
    pub(super) report: Report,
    /// The job as it was, even where it was replaced.
    pub(super) input: File,
    /// Where the result is.
    pub(super) target: PathBuf,
}

/// Runs the verb.
///
/// # Errors
/// FILE cannot be read at all, or with `--output` OUT cannot be written.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    clean_up_on_signal();
    if args.align && args.model().is_none() {
        eprintln!("outrigger: --align moves a model: name it with --supports");
        return Ok(ExitCode::from(2));
    }
    let is_page = args.picture.as_deref().map(page::is_page);
    if args.supports.is_some() && is_page == Some(false) {
        eprintln!("outrigger: the picture of supports is a page: its name must end in .html");
        return Ok(ExitCode::from(2));
    }
    if resin::is_resin(&args.file) {
        if let Some(reason) = resin::unfit(args) {
            eprintln!("outrigger: {reason}");
            return Ok(ExitCode::from(2));
        }
        return if args.supports.is_some() { supports::run(args) } else { resin::run(args) };
    }
    if args.remove_islands.is_some() {
        eprintln!("outrigger: --remove-islands is for resin jobs; {} is none", args.file.display());
        return Ok(ExitCode::from(2));
    }
    if let Some(output) = args.output.as_deref().filter(|to| resin::named(to).is_some()) {
        anyhow::bail!(
            "{} is no resin job, and {} would be none; name a .sl1, .nanodlp or .goo file",
            args.file.display(),
            output.display()
        );
    }
    if args.supports.is_some() {
        if args.first_layer {
            eprintln!("outrigger: --first-layer does not go with --supports");
            return Ok(ExitCode::from(2));
        }
        return supports::run(args);
    }
    let done = post_file(args)?;
    if let Some(reason) = &done.report.unchanged_reason {
        eprintln!("outrigger: {}: left as it was: {reason}", files::display_name(&args.file));
    } else if !args.quiet {
        // What goes to standard output for machines goes there alone.
        let taken = [&args.report, &args.picture].into_iter().flatten().any(|to| to == Path::new("-"));
        let words = summary(&done.report);
        if taken { eprintln!("{words}") } else { super::say(&words) }
    }
    let reported = args.report.as_ref().map_or(Ok(()), |to| write_report(&done.report, to));
    let drawn = args.picture.as_ref().map_or(Ok(()), |to| picture(args, &done, to));
    forgive(args, reported)?;
    forgive(args, drawn)?;
    Ok(ExitCode::SUCCESS)
}

/// In place the job is whole, or as it was, and the export must not fail for want of a report
/// or a picture.
fn forgive(args: &Args, done: anyhow::Result<()>) -> anyhow::Result<()> {
    match done {
        Err(error) if args.output.is_none() => eprintln!("outrigger: {}", causes::line(&error)),
        done => done?,
    }
    Ok(())
}

/// Post-processes the file: all of the verb but its words.
///
/// # Errors
/// FILE cannot be read at all, or with `--output` OUT cannot be written.
fn post_file(args: &Args) -> anyhow::Result<Done> {
    let path = files::resolve(&args.file)?;
    let started = Instant::now();
    let mut input = files::open_regular(&path)?;
    let target = args.output.as_deref().unwrap_or(&path);
    let mut report = match process(args, &mut input, &path, target) {
        Ok(report) => report,
        Err(error) if args.output.is_none() => {
            // In place: the export must not fail for our sake.
            let mut report = Report::default();
            report.unchanged(causes::line(&error));
            report
        }
        Err(error) => return Err(error),
    };
    report.seconds = started.elapsed().as_secs_f64();
    Ok(Done { report, input, target: target.to_owned() })
}

fn process(args: &Args, input: &mut File, path: &Path, target: &Path) -> anyhow::Result<Report> {
    let seen = files::Seen::of(input)?;
    let mut replacement = Replacement::beside(target)?;
    let options = Options {
        wishes: Wishes { first_layer: args.first_layer },
        accelerations: accelerations(args.profile.as_deref())?,
    };
    let bar = progress::bytes(seen.length, args.quiet);
    let mut report =
        post(input, replacement.file(), options, &|bytes| bar.set_position(bytes)).map_err(|failure| {
            match failure {
                Failure::Read(e) => anyhow::Error::new(e).context(format!("cannot read {}", path.display())),
                Failure::Write(e) => {
                    anyhow::Error::new(e).context(format!("cannot write beside {}", target.display()))
                }
            }
        })?;
    bar.finish_and_clear();
    if !seen.still_holds(input, path) {
        anyhow::ensure!(
            args.output.is_none(),
            "{} was replaced or changed while it was read",
            path.display()
        );
        report.unchanged("it was replaced or changed while it was read");
        return Ok(report);
    }
    if report.unchanged_reason.is_none() {
        replacement.put(input)?;
    } else if args.output.is_some() {
        replacement.copy_of(input)?.put(input)?;
    }
    Ok(report)
}

/// What holds until the job says otherwise.
fn accelerations(profile: Option<&str>) -> anyhow::Result<Accelerations> {
    let Some(name) = profile else { return Ok(Accelerations::default()) };
    let motion = load_printer(name)?.want_fdm()?.motion;
    Ok(Accelerations { print_mm_s2: motion.print_mm_s2.0, travel_mm_s2: motion.travel_mm_s2.0 })
}

/// A report as JSON; "-" is standard output.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_report(report: &impl Serialize, to: &Path) -> anyhow::Result<()> {
    let mut json = serde_json::to_string_pretty(report)?;
    json.push('\n');
    files::write_text(&json, to, "report")
}

fn picture(args: &Args, done: &Done, to: &Path) -> anyhow::Result<()> {
    let shown = match done.report.unchanged_reason {
        Some(_) => None,
        None => picture::write(&files::display_name(&args.file), done, to)?,
    };
    if shown.is_none() {
        eprintln!("outrigger: no picture: nothing was changed");
    }
    Ok(())
}

/// One line for people.
fn summary(r: &Report) -> String {
    let change = |before: f64, after: f64| {
        if before > 0.0 { format!("{:+.1} %", (after / before - 1.0) * 100.0) } else { "0 %".to_owned() }
    };
    format!(
        "{} of {} infill sections reordered and verified: travel {:.2} m → {:.2} m ({}), retractions {} → {}, lifts {} → {}, time {:.0} s → {:.0} s",
        r.sections_changed,
        r.sections,
        r.travel_mm_before / 1e3,
        r.travel_mm_after / 1e3,
        change(r.travel_mm_before, r.travel_mm_after),
        r.retractions_before,
        r.retractions_after,
        r.lifts_before,
        r.lifts_after,
        r.time_s_before,
        r.time_s_after,
    )
}
