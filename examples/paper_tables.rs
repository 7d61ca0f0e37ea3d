//! The papers' tables of times, measured again on the whole `check` verb.
//!
//! `cargo build --release && cargo run --release --example paper_tables -- FOLDER`
//!
//! FOLDER holds the papers' models as STL files (armadillo-172972, dragon-159230,
//! bunny-56200, lucy-99970, lily-flower); rows with more triangles are made by halving
//! edges. Each row runs `outrigger check` as a process of its own, five times, and
//! compares the mean of the whole process, start and reading included, with the
//! paper's figure:
//! - islands at 0.025 mm: "Detection Method for Island Regions in 3D Printing", Table 1,
//!   at the larger heights (Intel i7-9700K); at least 40 times faster is asked for;
//! - overhangs at 0.04 mm: "Surfel convolutional neural network for support detection in
//!   additive manufacturing", Table 2, the image-based method; at least 50 times.
//!
//! The peak is the kernel's count for the process (`VmHWM`): Linux only. Exit status 1
//! when a row falls short.
#[path = "../benches/common/meshes.rs"]
mod meshes;

use anyhow::{Context, ensure};
use std::borrow::Cow;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::{Duration, Instant};

/// Runs that a mean is of, as in the papers.
const RUNS: u32 = 5;

/// Most memory of any row, MiB.
const TARGET_MIB: f64 = 400.0;

/// A row of a paper: file, triangles, seconds.
type Row = (&'static str, usize, f64);

const ISLANDS: &[Row] = &[
    ("armadillo-172972", 172_972, 22.1),
    ("armadillo-172972", 345_944, 22.2),
    ("dragon-159230", 159_230, 23.8),
    ("dragon-159230", 318_460, 26.5),
    ("lucy-99970", 350_697, 25.2),
    ("lucy-99970", 701_939, 26.6),
    ("bunny-56200", 56_200, 20.1),
    ("bunny-56200", 112_402, 20.3),
];

/// Triangles are twice the paper's vertices, or the file's own where it has more.
const OVERHANGS: &[Row] =
    &[("bunny-56200", 70_000, 38.2), ("armadillo-172972", 172_972, 53.6), ("lily-flower", 594_000, 3970.3)];

fn main() -> anyhow::Result<ExitCode> {
    let folder = PathBuf::from(std::env::args_os().nth(1).context("name the folder of the models")?);
    let good = table(
        "islands, 0.025 mm",
        &folder,
        ISLANDS,
        &["--layer-height", "0.025", "--overhang", "none"],
        40.0,
    )? & table("overhangs, 0.04 mm", &folder, OVERHANGS, &["--layer-height", "0.04"], 50.0)?;
    Ok(if good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn table(title: &str, folder: &Path, rows: &[Row], options: &[&str], target: f64) -> anyhow::Result<bool> {
    let mut out = std::io::stdout().lock();
    writeln!(
        out,
        "{title:<26} {:>9} {:>9} {:>8} {:>7} {:>8}",
        "triangles", "paper_s", "ours_s", "ratio", "peak_mib"
    )?;
    let mut good = true;
    for &(name, triangles, paper_s) in rows {
        let path = folder.join(name).with_extension("stl");
        let file = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        let own = meshes::read(&file).triangles.len();
        let file =
            if own < triangles { Cow::Owned(meshes::finer(&file, triangles)) } else { Cow::Borrowed(&file) };
        let mut model = tempfile::NamedTempFile::with_suffix(".stl")?;
        model.write_all(&file)?;
        let runs = (0..RUNS).map(|_| run(model.path(), options)).collect::<anyhow::Result<Vec<_>>>()?;
        let ours_s = runs.iter().map(|r| r.0.as_secs_f64()).sum::<f64>() / f64::from(RUNS);
        let peak_mib = runs.iter().map(|r| r.1).fold(0.0, f64::max);
        let ratio = paper_s / ours_s;
        let held = ratio >= target && peak_mib <= TARGET_MIB;
        good &= held;
        writeln!(
            out,
            "{name:<26} {:>9} {paper_s:>9} {ours_s:>8.3} {ratio:>7.0} {peak_mib:>8.0}{}",
            own.max(triangles),
            if held { "" } else { "  SHORT" }
        )?;
    }
    writeln!(out, "asked for: a ratio of {target} at least, a peak of {TARGET_MIB} MiB at most\n")?;
    Ok(good)
}

/// Wall time and peak memory (MiB) of one check.
fn run(model: &Path, options: &[&str]) -> anyhow::Result<(Duration, f64)> {
    // The example lies in target/release/examples, the program beside that folder.
    let program = std::env::current_exe()?.ancestors().nth(2).context("no build folder")?.join("outrigger");
    let start = Instant::now();
    let mut child = Command::new(&program)
        .args(["check", "--quiet"])
        .args(options)
        .arg(model)
        .stdout(Stdio::null())
        .spawn()
        .with_context(|| format!("cannot run {}: build it first", program.display()))?;
    let status = format!("/proc/{}/status", child.id());
    let mut peak_kib = 0.0_f64;
    // The high-water mark only rises: the last look, at most a millisecond before the end, tells.
    let ended = loop {
        let seen = std::fs::read_to_string(&status).ok().and_then(|text| {
            text.lines()
                .find_map(|l| l.strip_prefix("VmHWM:"))?
                .split_whitespace()
                .next()?
                .parse::<f64>()
                .ok()
        });
        peak_kib = peak_kib.max(seen.unwrap_or(0.0));
        if let Some(ended) = child.try_wait()? {
            break ended;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    ensure!(ended.success(), "check ended with {ended}");
    Ok((start.elapsed(), peak_kib / 1024.0))
}
