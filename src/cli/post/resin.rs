//! `outrigger post` with a resin job: the same job in another format, or without small islands
//! ([`super::specks`]).
//!
//! There is no hook of a slicer here: without an output there is nothing to do, and the
//! file stays. With one, the format is what its name ends in.
use super::{Args, Supports, forgive, specks, write_report};
use crate::causes;
use crate::cli::files::{self, Replacement, Seen};
use crate::cli::progress;
use crate::resin::job::{Format, Job};
use crate::resin::rewrite::{Edits, Rewritten, Untouched, rewrite};
use crate::resin::{self, goo::MARK_BYTES};
use anyhow::Context;
use serde::Serialize;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

/// Bytes that are read and written at a time.
const BUFFER_BYTES: usize = 256 << 10;

/// Endings that name a format.
const ENDINGS: &str = ".sl1, .sl1s, .nanodlp or .goo";

/// The report. Its JSON fields are an interface: they are only added to.
#[derive(Debug, Default, Serialize)]
pub(super) struct Report {
    /// Format of FILE: `sl1`, `nanodlp` or `goo`; `null` when it cannot be read.
    kind: Option<&'static str>,
    /// Format of OUT; that of FILE where there is none.
    pub(super) kind_out: Option<&'static str>,
    /// Layers of the job.
    layers: u32,
    /// Layers whose picture was changed.
    pub(super) layers_changed: u32,
    /// What OUT's format has no place for, or wants and is not told; a line each.
    pub(super) notes: Vec<String>,
    /// Islands that were left out (--remove-islands).
    pub(super) removed_islands: u64,
    /// Their pixels in all layers.
    pub(super) removed_pixels: u64,
    /// Islands of which less than a quarter is held, in what was written.
    pub(super) islands_left: u64,
    /// What it took, s.
    seconds: f64,
    /// Why the file was left as it is; `null` when something was written otherwise.
    pub(super) unchanged_reason: Option<String>,
}

/// Whether a file begins as a resin job. A file that cannot be read does not.
pub(super) fn is_resin(path: &Path) -> bool {
    let mut begins = Vec::new();
    let read = files::open_regular(path)
        .and_then(|file| Ok(file.take(MARK_BYTES as u64).read_to_end(&mut begins)?));
    read.is_ok() && resin::may_be_job(&begins)
}

/// The format that a name ends in.
pub(super) fn named(path: &Path) -> Option<Format> {
    Format::of_ending(path.extension()?.to_str()?)
}

/// Why options do not go with a resin job.
pub(super) fn unfit(args: &Args) -> Option<String> {
    let file = args.file.display();
    let given = [
        ("--first-layer", args.first_layer),
        ("--picture without --supports", args.picture.is_some() && args.supports.is_none()),
        ("--profile", args.profile.is_some()),
        ("--supports replace", args.supports == Some(Supports::Replace)),
    ];
    if let Some((name, _)) = given.into_iter().find(|(_, given)| *given) {
        return Some(format!("{name} is for G-code; {file} is a resin job"));
    }
    let output = args.output.as_deref().filter(|to| named(to).is_none())?;
    Some(format!("the name {} must end in {ENDINGS}: it tells the format", output.display()))
}

/// Writes the job to OUT, or says that there is nothing to do.
///
/// # Errors
/// FILE cannot be read, or OUT cannot be written. Without OUT only that FILE is gone.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let started = Instant::now();
    let path = files::resolve(&args.file)?;
    let file = files::open_regular(&path)?;
    let removed = args.remove_islands.map(|max_mm2| specks::removed(args, &file, &path, max_mm2));
    let mut report = match (&args.output, removed) {
        (Some(_), Some(removed)) => removed?,
        (None, Some(Ok(report))) => report,
        (Some(output), None) => convert(args, &file, &path, output)?,
        // As with G-code: nothing that is in doubt ends in an error without OUT.
        (None, Some(Err(error))) => {
            Report { unchanged_reason: Some(causes::line(&error)), ..Report::default() }
        }
        (None, None) => match open(&file) {
            Ok(job) => report_of(&job),
            Err(error) => Report { unchanged_reason: Some(causes::line(&error)), ..Report::default() },
        },
    };
    report.seconds = started.elapsed().as_secs_f64();
    tell(args, &report);
    if let Some(to) = &args.report {
        forgive(args, write_report(&report, to))?;
    }
    Ok(ExitCode::SUCCESS)
}

pub(super) type Open<'a> = Job<BufReader<&'a File>>;

pub(super) fn open(file: &File) -> anyhow::Result<Open<'_>> {
    Ok(resin::open(BufReader::with_capacity(BUFFER_BYTES, file))?)
}

/// What is said of a job that nothing was done to.
pub(super) fn report_of(job: &Open<'_>) -> Report {
    let kind = Some(job.format().key());
    Report {
        kind,
        kind_out: kind,
        layers: job.layers().len() as u32,
        layers_changed: 0,
        notes: Vec::new(),
        removed_islands: 0,
        removed_pixels: 0,
        islands_left: 0,
        seconds: 0.0,
        unchanged_reason: Some(format!(
            "there is nothing to do to a resin job; -o with a name that ends in {ENDINGS} writes it in that format"
        )),
    }
}

fn convert(args: &Args, file: &File, path: &Path, output: &Path) -> anyhow::Result<Report> {
    let seen = Seen::of(file)?;
    let mut job = open(file)?;
    let mut report = report_of(&job);
    let target = named(output).unwrap_or(job.format());
    report.kind_out = Some(target.key());
    let replacement = if target == job.format() {
        report.unchanged_reason = Some("OUT is a copy: it has the same format".to_owned());
        Replacement::beside(output)?.copy_of(&mut file.try_clone().context("cannot read the file")?)?
    } else {
        let (replacement, written) = written(args, &mut job, target, &Untouched, output)?;
        (report.notes, report.layers_changed, report.unchanged_reason) =
            (written.notes, written.changed, None);
        replacement
    };
    anyhow::ensure!(
        seen.still_holds(file, path),
        "{} was replaced or changed while it was read",
        path.display()
    );
    replacement.put(file)?;
    Ok(report)
}

/// Writes the job, in another format or with other pictures.
///
/// # Errors
/// It cannot be read, or what is to replace `output` not be written.
pub(super) fn written(
    args: &Args,
    job: &mut Open<'_>,
    target: Format,
    edits: &impl Edits,
    output: &Path,
) -> anyhow::Result<(Replacement, Rewritten)> {
    let mut replacement = Replacement::beside(output)?;
    let bar = progress::layers(Some(job.layers().len() as u32), args.quiet);
    let refused = || format!("cannot write beside {}", output.display());
    let mut out = BufWriter::with_capacity(BUFFER_BYTES, replacement.file());
    let written = rewrite(job, &mut out, target, edits, &mut |layers| bar.set_position(layers.into()));
    let written = match written {
        Err(error) if error.is_output() => return Err(anyhow::Error::new(error).context(refused())),
        written => written?,
    };
    out.flush().with_context(refused)?;
    drop(out);
    bar.finish_and_clear();
    Ok((replacement, written))
}

/// What was done, for people: a line, and one for each thing that could not be carried over.
fn tell(args: &Args, report: &Report) {
    let left = args.output.is_none() || args.remove_islands.is_some();
    if let Some(reason) = report.unchanged_reason.as_deref().filter(|_| left) {
        return eprintln!("outrigger: {}: left as it was: {reason}", files::display_name(&args.file));
    }
    if args.quiet {
        return;
    }
    let (from, to) = (report.kind.unwrap_or_default(), report.kind_out.unwrap_or_default());
    let mut words = if from == to {
        format!("{} layers of {from} copied as they are", report.layers)
    } else {
        format!("{} layers from {from} to {to} in {:.1} s", report.layers, report.seconds)
    };
    if args.remove_islands.is_some() {
        words = format!(
            "{} islands left out ({} px in {} layers); islands left: {}; {:.1} s",
            report.removed_islands,
            report.removed_pixels,
            report.layers_changed,
            report.islands_left,
            report.seconds
        );
    }
    for note in &report.notes {
        words += "\nNote: ";
        words += note;
    }
    let taken = args.report.as_deref() == Some(Path::new("-"));
    if taken { eprintln!("{words}") } else { crate::cli::say(&words) }
}
