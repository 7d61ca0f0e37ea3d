//! `outrigger check`: what of a job would print in the air.
//!
//! The file's content says what it is, never its name. What was found is told as a
//! table, as JSON and as pictures; findings are no failure unless `--fail-on` says so.
mod flags;
mod kind;
mod output;
mod printer;
mod resin;
mod source;
mod watch;
mod words;

use super::files;
use super::interrupt::clean_up_on_signal;
use super::model::{Model, positive};
use crate::report::check::Report;
use clap::{Args as ClapArgs, ValueEnum};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

/// Find what of a model, a sliced job or a resin job would print in the air
///
/// FILE is a model (.stl), sliced G-code (.gcode, .bgcode) or a resin job (.sl1,
/// .nanodlp, .goo); its content says which. Islands are pieces of a layer that nothing below
/// holds; overhangs are parts that reach out too far over what is below them. G-code
/// and resin jobs are checked as they will be printed, with no model needed. A resin job's
/// pictures are searched for resin traps, suction cups, empty layers and what lies at the
/// panel's margin, too.
///
/// Layers are counted from 0 at the plate. The table gives the Z at which a layer is
/// printed; --json gives that as top_mm and the middle of the layer, where a model is
/// cut, as z_mm.
///
/// Exit status: 0 when the file was checked, whatever was found; 1 when it cannot be, or
/// when --fail-on names what was found; 2 for wrong usage.
#[derive(ClapArgs, Debug)]
pub(super) struct Args {
    /// The model or the job
    file: PathBuf,
    /// Write what was found as JSON; "-" is standard output
    ///
    /// Its fields are named with their units and only ever added to: file, kind, triangles,
    /// layers, height_mm, bbox_mm, rules, islands and small_islands (each with layer, z_mm,
    /// top_mm, end_layer, end_z_mm, end_top_mm, joins, area_mm2, max_area_mm2, centroid_mm,
    /// bbox_mm), floating_supports, overhangs (method, regions, area_mm2, small_regions,
    /// small_area_mm2, largest), overhangs_by_method, printer (name, findings with kind, line,
    /// lines, worst, words), resin (issues with kind, severity, layer, top_mm, end_layer,
    /// end_top_mm, area_mm2, volume_mm3, centroid_mm, bbox_mm, listed, hole with layer, top_mm,
    /// from_mm, to_mm, length_mm, words), mended, warnings, seconds.
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Draw what was found, by the name's ending: .svg or .png for one picture, .html
    /// for a page with a layer slider that needs no network
    #[arg(long, value_name = "FILE", value_parser = flags::picture)]
    picture: Option<PathBuf>,
    /// How overhangs are found
    #[arg(long, value_name = "METHOD", value_enum, default_value_t = Overhang::Layer)]
    overhang: Overhang,
    /// Exit with 1 when something is found
    #[arg(long, value_name = "FINDING", value_enum, value_delimiter = ',')]
    fail_on: Vec<Finding>,
    /// Say nothing unless something is wrong
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten, next_help_heading = "Models (.stl)")]
    model: Model,
    /// Diameter of the filament, for G-code that does not tell it
    #[arg(long, value_name = "MM", value_parser = positive, help_heading = "G-code")]
    filament_mm: Option<f64>,
    /// Look at what this printer could not do of the job, too: a name from `outrigger profile
    /// list`, or a file
    ///
    /// Lines that its firmware would cut, beads beside its bed or above its reach, temperatures
    /// that it or the material does not bear, heaters left on, a file that was cut short. Of a resin
    /// job: pictures for another panel or mirrored otherwise, exposures and heights beyond its own.
    #[arg(long, value_name = "NAME", help_heading = "Sliced jobs")]
    printer: Option<String>,
    #[command(flatten, next_help_heading = "What holds itself")]
    rules: flags::Rules,
}

/// How overhangs are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Overhang {
    /// Each layer against the one below, in polygons
    Layer,
    /// The faces of a model by their slope
    Normal,
    /// Each layer against the one below, in pixels: the reference for the others
    Image,
    /// All that the file allows
    All,
    /// Islands only
    None,
}

/// What may end a script.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Finding {
    /// Any island of at least the smallest area
    Islands,
    /// Any overhang of at least the smallest area
    Overhangs,
    /// Anything that the printer of --printer could not do
    Printer,
    /// Anything that would go wrong with a resin job, by its pictures and exposures
    Resin,
}

/// Runs the verb.
///
/// # Errors
/// The file cannot be read or checked, or an output not be written.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    clean_up_on_signal();
    if let Some(reason) = flags::at_odds(args) {
        return Ok(wrong_usage(&reason));
    }
    let opened = kind::open(&args.file)?;
    if let Some(reason) = flags::unfit(args, opened.kind) {
        return Ok(wrong_usage(&reason));
    }
    let checked = source::check(args, opened)?;
    output::write(args, &checked)?;
    Ok(verdict(args, &checked.report))
}

/// As clap ends when options do not go together.
fn wrong_usage(reason: &str) -> ExitCode {
    eprintln!("outrigger: {reason}");
    ExitCode::from(2)
}

/// Success, unless `--fail-on` names what was found.
fn verdict(args: &Args, report: &Report) -> ExitCode {
    let overhangs = report.overhangs_by_method.values().map(|found| found.regions).sum::<u64>();
    let amiss = report.printer.as_ref().map_or(0, |printer| printer.findings.len() as u64);
    let issues = report.resin.as_ref().map_or(0, |resin| resin.issues.len() as u64 + resin.unlisted);
    let counts = [
        (Finding::Islands, report.islands.len() as u64 + report.unlisted_islands, "islands"),
        (Finding::Overhangs, overhangs, "overhangs"),
        (Finding::Printer, amiss, "findings for the printer"),
        (Finding::Resin, issues, "resin issues"),
    ];
    let found = counts.iter().filter(|(finding, count, _)| *count > 0 && args.fail_on.contains(finding));
    let words: Vec<String> = found.map(|(_, count, name)| format!("{name}: {count}")).collect();
    if words.is_empty() {
        return ExitCode::SUCCESS;
    }
    eprintln!("outrigger: {}: {} (--fail-on)", files::display_name(&args.file), words.join(", "));
    ExitCode::from(1)
}

/// Whether standard output is taken by something for machines.
fn stdout_is_taken(args: &Args) -> bool {
    args.json.as_deref() == Some(Path::new("-"))
}
