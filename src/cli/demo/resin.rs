//! `outrigger demo --resin`: a resin job is checked, mended, printed on a mock printer, and its light
//! measured.
//!
//! Makes a job in which something begins in the air, has the program's own verbs find and mend it,
//! prints it as `outrigger print` does, and holds what the mock's light and the display have seen
//! against what the job says. Takes a folder, leaves its files there.
mod compare;
mod job;

use super::{Args, baud, folder, heading, mock_verb};
use crate::causes;
use crate::cli::print::{Listening, Person, Printing, letters, print, runtime};
use crate::cli::say;
use crate::job::host::Begin;
use crate::printer::find::{Places, Wanted, connect};
use crate::printer::lcd::recorder::{Record, Recorder};
use crate::printer::lcd::sum::Sum;
use crate::printer::mock;
use crate::printer::port::OpenMode;
use crate::profile::{Profile, load_printer};
use crate::resin;
use crate::station::guardian::program;
use crate::station::{Job, display, settings};
use anyhow::{Context, bail, ensure};
use compare::{Asked, Compared};
use serde_json::Value;
use std::ffi::OsStr;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// The printer.
const PROFILE: &str = include_str!("resin/printer.toml");

/// Names in the folder.
const JOB: &str = "lamp.sl1";
const MENDED: &str = "mended.sl1";
const PRINTER: &str = "printer.toml";
const FOUND: &str = "found.json";
const LEFT: &str = "left.json";
const GROWN: &str = "grown.json";

/// The whole way.
///
/// # Errors
/// The folder cannot be written to, the print was cancelled, or what was exposed is not what the job says.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let began = Instant::now();
    let folder = folder(args.dir.as_deref())?;
    say(
        "The whole way of a resin job: from the slicer's pictures to the last exposure.\nNo hardware is needed; Ctrl-C cancels.",
    );
    let put = |name: &str, bytes: &[u8]| {
        let path = folder.join(name);
        std::fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))
    };
    put(PRINTER, PROFILE.as_bytes())?;
    let profile = load_printer(&folder.join(PRINTER).display().to_string())?;
    let bytes = job::sl1()?;
    put(JOB, &bytes)?;

    heading(1, "A sliced job is looked at before anything moves");
    say(&format!(
        "   {JOB}: a twisted column and a gallows, {} layers on a panel of\n   {} × {} pixels ({:.0} kB), without supports.",
        job::LAYERS,
        job::PANEL_PX[0],
        job::PANEL_PX[1],
        bytes.len() as f64 / 1e3
    ));
    let found = verb(&folder, FOUND, &["check", JOB, "--picture", "layers.html", "--json", FOUND])?;
    let islands = islands(&found)?;
    islands.iter().for_each(|island| say(&format!("   - {}", words(island))));
    ensure!(!islands.is_empty(), "the check found nothing: please report this");

    heading(2, "It is mended: supports under what would print in the air");
    let grown = verb(&folder, GROWN, &["post", JOB, "--supports", "auto", "-o", MENDED, "--report", GROWN])?;
    let figure = |key: &str| grown[key].as_f64().unwrap_or_default();
    say(&format!(
        "   supports with {} tips, {:.1} mm³, drawn into the pictures",
        figure("tips"),
        figure("volume_mm3")
    ));
    let left = verb(&folder, LEFT, &["check", MENDED, "--json", LEFT])?;
    let amiss = self::islands(&left)?.len() + left["resin"]["issues"].as_array().map_or(0, Vec::len);
    ensure!(amiss == 0, "{amiss} things are still amiss in {MENDED}: please report this");
    say("   What was made was read again: no island is left, nor anything else amiss.");

    heading(3, "It is printed on a mock printer");
    say(&format!(
        "   A strict Marlin on a pseudo-terminal whose plate and light are {} times\n   faster than life; its display is in memory.\n   $ outrigger print {MENDED} --port mock --profile {PRINTER}",
        args.speed
    ));
    let (printer, record) = printed(args, &profile, &folder)?;

    heading(4, "What was asked, and what the printer's light and display have seen");
    let pulses = printer.light();
    let stats = printer.stop()?;
    let compared = Compared::new(asked(&folder.join(MENDED))?, &pulses, &record.changes(), args.speed);
    say(&compared.table());
    compared.verdict()?;
    ensure!(
        stats.light_moved == 0 && stats.crashes == 0,
        "the plate moved in the light {} times and crashed {} times: please report this",
        stats.light_moved,
        stats.crashes
    );
    say("\n   Measured by the mock's own clock, in the machine's time, from each change of\n   \
         the light; which picture it was, by the sum of what the display showed then.\n   \
         The plate never moved in the light. (What the print itself says above of its\n   \
         exposures is by when answers arrived: what this computer did meanwhile is in\n   \
         it, as many times over as the printer is faster than life.)");
    say(&format!(
        "\nDone in {:.0} s. All files stay in {}\n\n\
         With a printer of your own:\n  \
         outrigger profile show generic-msla > mine.toml   and make it your printer's\n  \
         outrigger print job.sl1 --port DEV --profile mine.toml",
        began.elapsed().as_secs_f64(),
        folder.display()
    ));
    Ok(ExitCode::SUCCESS)
}

/// Runs one of the program's own verbs in the folder, as a person would, and reads its report.
fn verb(folder: &Path, report: &str, words: &[&str]) -> anyhow::Result<Value> {
    say(&format!("   $ outrigger {}", words.join(" ")));
    let ran = Command::new(program())
        .current_dir(folder)
        .args(words.iter().map(OsStr::new))
        .arg("--quiet")
        .stdin(Stdio::null())
        .output()
        .context("cannot start this program again")?;
    ensure!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr).trim());
    let path = folder.join(report);
    let text = std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_slice(&text).with_context(|| format!("{} is no report", path.display()))
}

/// The islands of a check's report.
fn islands(report: &Value) -> anyhow::Result<Vec<Value>> {
    report["islands"].as_array().cloned().context("the check's report lists no islands")
}

fn words(island: &Value) -> String {
    let figure = |value: &Value| value.as_f64().unwrap_or_default();
    format!(
        "an island: layer {}, {:.1} mm up, at X {:.1} Y {:.1} ({:.1} mm²)",
        figure(&island["layer"]),
        figure(&island["top_mm"]),
        figure(&island["centroid_mm"][0]),
        figure(&island["centroid_mm"][1]),
        figure(&island["area_mm2"])
    )
}

/// Prints the job, and gives the printer and what its display was told.
///
/// # Errors
/// It was not printed to its end.
fn printed(args: &Args, profile: &Profile, folder: &Path) -> anyhow::Result<(mock::Handle, Record)> {
    let config = mock::Config {
        baud: baud(profile, args.speed),
        speed: args.speed,
        dtr_reset: profile.serial.dtr_reset,
        machine: mock_verb::machine(profile),
        ..mock::Config::default()
    };
    let printer = mock::spawn(mock::Options { config, ..mock::Options::default() })?;
    let msla = profile.msla().context("the demo's profile is of a resin printer")?;
    let since = printer.started();
    // The mock's clock: what was shown can be held against when the light was on.
    let clock = move || u64::try_from(since.elapsed().as_nanos()).unwrap_or(u64::MAX);
    let display = Recorder::new(display::layout(&msla.lcd), clock)?;
    let record = display.record();
    let job = Job::open(&folder.join(MENDED), profile, PRINTER, None, |_, _| {})?;
    runtime()?.block_on(async {
        let letters = letters()?;
        let wanted = Wanted::Path(printer.path().display().to_string());
        let mode = OpenMode::Fresh { reset: profile.serial.dtr_reset };
        let rate = crate::cli::serial::rate(None, profile.serial.baud);
        let connection =
            connect(&wanted, rate, mode, settings::boot_wait_ms(profile), &Places::default()).await?;
        let listening = Listening::start(false, &letters)?;
        let printing = Printing {
            job,
            name: MENDED.to_owned(),
            profile,
            connection,
            started: tokio::time::Instant::now(),
            device: wanted.to_string(),
            held: None,
            begin: Begin::Fresh,
            macros: true,
            person: Person::Away,
            verbose: false,
            speed: args.speed,
            sink: Some(Box::new(display)),
        };
        print(printing, letters, listening.hint()).await
    })?;
    Ok((printer, record))
}

/// What the job asks for, from its file.
fn asked(path: &Path) -> anyhow::Result<Vec<Asked>> {
    let file = File::open(path).with_context(|| path.display().to_string())?;
    let mut job = resin::open(BufReader::new(file))?;
    let panel = job.panel();
    let mut asked = Vec::new();
    for (at, layer) in (0..).zip(job.layers().to_vec()) {
        let mut sum = Sum::new();
        let packed = job.packed(at)?;
        if let Err(why) = panel.rows(&packed, |row| sum.row(row)) {
            bail!("{}", causes::line(&job.picture_error(at, why).into()));
        }
        asked.push(Asked { exposure_s: layer.exposure_s, top_mm: layer.top_mm, sum: sum.finish() });
    }
    Ok(asked)
}
