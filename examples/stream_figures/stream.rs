//! One job from one host to one mock printer, and what that took.
use crate::host::{Host, PROFILE, Programs};
use crate::job::Job;
use crate::process::{self, Cost};
use anyhow::{Context, ensure};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The mock makes its terminal within this.
const MOCK_WITHIN: Duration = Duration::from_secs(10);

/// The printer of a run.
#[derive(Clone, Copy)]
pub(crate) struct Printer {
    /// Bits per second; 0 is a line without a limit.
    pub(crate) baud: u32,
    /// How many times faster than life it moves.
    pub(crate) speed: u32,
    /// Milliseconds that its replies are on their way.
    pub(crate) latency_ms: u32,
}

/// What a run took, and what the printer saw of it.
pub(crate) struct Run {
    pub(crate) cost: Cost,
    /// From the start of the process to the job's first line at the printer.
    pub(crate) first_line_s: f64,
    pub(crate) lines: u64,
    /// Share of the time in which the planner was empty, %.
    pub(crate) empty_percent: f64,
    /// From the first move to the end of the last, s.
    pub(crate) printing_s: f64,
}

/// Prints `job`, or the part of it that goes within `stop_after`.
///
/// # Errors
/// A process failed, or the printer got something else than the job.
pub(crate) fn stream(
    programs: &Programs,
    host: Host,
    job: &Job,
    printer: Printer,
    stop_after: Option<Duration>,
) -> anyhow::Result<Run> {
    // A folder for each run: nobody finds what the one before has left.
    let records = tempfile::tempdir()?;
    stream_again(programs, host, job, printer, stop_after, records.path())
}

/// The same with the records of runs before in `records`, which a host may know the job from.
///
/// # Errors
/// As [`stream`].
pub(crate) fn stream_again(
    programs: &Programs,
    host: Host,
    job: &Job,
    printer: Printer,
    stop_after: Option<Duration>,
    records: &Path,
) -> anyhow::Result<Run> {
    let folder = tempfile::tempdir()?;
    let (mock, mock_started) = start_mock(programs, printer, folder.path())?;
    let mut command = programs.command(host, &job.path, &folder.path().join("tty"), printer.baud, records);
    let ran = process::run(&mut command, &folder.path().join("log"), stop_after);
    let stats = end_mock(mock, folder.path())?;
    let (started, cost) = ran?;
    let number = |name: &str| stats[name].as_f64().with_context(|| format!("the mock tells no {name}"));
    let first_s = number("first_job_line_s")?;
    ensure!(first_s > 0.0, "{}: no line of the job came", host.name());
    // A resend would be the mock's fault or the sender's, and no figure of a whole link.
    for wrong in ["lines_lost", "lines_repeated", "overflow_bytes", "resends_asked"] {
        ensure!(number(wrong)? == 0.0, "{}: {wrong}: {}", host.name(), stats[wrong]);
    }
    let lines = number("lines_accepted")? as u64;
    if stop_after.is_none() {
        check_whole(host, job, &stats, lines)?;
    }
    Ok(Run {
        cost,
        first_line_s: (mock_started + Duration::from_secs_f64(first_s))
            .saturating_duration_since(started)
            .as_secs_f64(),
        lines,
        empty_percent: 100.0 * number("planner_empty_share")?,
        printing_s: number("moving_s")? + number("planner_empty_s")?,
    })
}

/// Whether the printer got every line of the job, in order.
fn check_whole(host: Host, job: &Job, stats: &Value, lines: u64) -> anyhow::Result<()> {
    ensure!(lines >= job.commands, "{}: {lines} lines of {}", host.name(), job.commands);
    if host.keeps_numbers() {
        ensure!(stats["digest"] == job.digest.as_str(), "{}: not the job's lines", host.name());
    }
    Ok(())
}

/// The mock and the time when it was there. It counts from a little earlier: what
/// is told of the first line is rather too long than too short.
fn start_mock(programs: &Programs, printer: Printer, folder: &Path) -> anyhow::Result<(Child, Instant)> {
    let tty = folder.join("tty");
    let mock = Command::new(&programs.outrigger)
        .args(["mock", "--profile", PROFILE, "--link"])
        .arg(&tty)
        .arg("--stats")
        .arg(folder.join("stats.json"))
        .args(["--baud", &printer.baud.to_string(), "--speed", &printer.speed.to_string()])
        .args(["--latency-ms", &printer.latency_ms.to_string()])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .context("cannot start the mock printer")?;
    let start = Instant::now();
    while !tty.exists() {
        ensure!(start.elapsed() < MOCK_WITHIN, "the mock printer makes no terminal");
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok((mock, Instant::now()))
}

fn end_mock(mut mock: Child, folder: &Path) -> anyhow::Result<Value> {
    process::interrupt(&mock)?;
    mock.wait()?;
    let text = fs::read(folder.join("stats.json")).context("the mock printer wrote no counts")?;
    Ok(serde_json::from_slice(&text)?)
}
