//! Post-processes a job of 200 MB and tells the most memory that it took.
//!
//! `cargo run --release --example peak_memory -- [FILE.gcode] [MB]`
//!
//! The job is made by repeating the layers of FILE (the corpus's demo job when
//! none is named) into a temporary file; `post` reads that and writes another,
//! in this process, as the `post` verb does. The peak is the kernel's own count
//! (`VmHWM` of `/proc/self/status`), so this runs on Linux. Exit status 1 when it
//! is beyond the target.
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use anyhow::{Context, ensure};
use common::long_job::LongJob;
use outrigger::post::{Options, post};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Size of the job, MB (10⁶ bytes).
const DEFAULT_MB: u64 = 200;

/// Most memory for a job of any size, MiB.
const TARGET_MIB: f64 = 150.0;

fn main() -> anyhow::Result<ExitCode> {
    let mut args = std::env::args_os().skip(1);
    let demo = || Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus/demo.gcode");
    let path = args.next().map_or_else(demo, PathBuf::from);
    let mb = match args.next() {
        Some(text) => text.to_string_lossy().parse().context("the size in MB is a whole number")?,
        None => DEFAULT_MB,
    };
    let short = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let job = LongJob::of(&short)
        .with_context(|| format!("{}: no two layers of a known slicer that begin alike", path.display()))?;
    drop(short);
    let mut input = tempfile::tempfile().context("no temporary file for the job")?;
    let mut output = tempfile::tempfile().context("no temporary file for the result")?;
    let bytes = job.write(mb * 1_000_000, BufWriter::new(&mut input)).context("cannot write the job")?;
    drop(job);
    let before = peak_mib()?;
    let started = Instant::now();
    let report = post(&mut input, &mut output, Options::default(), &|_| ())?;
    let seconds = started.elapsed().as_secs_f64();
    let peak = peak_mib()?;
    let written = output.metadata()?.len();
    ensure!(report.unchanged_reason.is_some() || written > 0, "post wrote nothing");
    let mut out = std::io::stdout().lock();
    let job_mb = bytes as f64 / 1e6;
    writeln!(out, "job:         {job_mb:.1} MB, {} layers, from {}", report.layers, path.display())?;
    let done = match &report.unchanged_reason {
        Some(why) => format!("left as it was: {why}"),
        None => format!("{} of {} sections reordered, verified", report.sections_changed, report.sections),
    };
    writeln!(out, "post:        {done}; {seconds:.2} s, {:.1} MB/s", job_mb / seconds)?;
    let verdict = if peak < TARGET_MIB { "met" } else { "MISSED" };
    writeln!(out, "peak memory: {peak:.1} MiB ({before:.1} MiB before); target {TARGET_MIB} MiB: {verdict}")?;
    Ok(ExitCode::from(u8::from(peak >= TARGET_MIB)))
}

/// The most memory that this process has held at once so far, MiB.
fn peak_mib() -> anyhow::Result<f64> {
    let status = std::fs::read_to_string("/proc/self/status").context("no /proc/self/status: not Linux?")?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:")).context("no VmHWM in it")?;
    let kib: f64 = line.trim().trim_end_matches("kB").trim().parse().context("VmHWM is no number")?;
    Ok(kib / 1024.0)
}
