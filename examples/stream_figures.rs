//! What streaming costs, and whether it keeps the planner fed.
//!
//! `cargo build --release && cargo run --release --example stream_figures`
//!
//! Runs `outrigger mock` and `outrigger print` from the same build as two
//! processes over a pseudo-terminal and prints:
//! - the CPU seconds of the whole life of `print` for 100,000 short lines without
//!   a baud limit (at most 1.5 is wanted),
//! - the share of time in which the planner was empty at 250,000 baud and
//!   500 moves/s (less than 3 % is wanted), and at 115,200 baud and 250 moves/s.
//!
//! Linux only: CPU times come from /proc/self/stat. Exit status 1 when a process fails;
//! the figures are for the reader to judge.
use std::error::Error;
use std::fmt::Write as _;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Lines of the CPU measurement.
const LINES: u32 = 100_000;

/// Length of the moves of the planner measurement, in s of printing.
const PLANNER_S: u32 = 30;

/// Kernel ticks a second in /proc (USER_HZ), the same on every Linux.
const TICKS_PER_S: f64 = 100.0;

fn main() -> Result<(), Box<dyn Error>> {
    let binary = binary()?;
    let folder = tempfile::tempdir()?;
    let mut out = std::io::stdout();

    let job = job(folder.path(), LINES, 0.2)?;
    let run = stream(&binary, folder.path(), &job, 250_000, &["--baud", "0", "--speed", "1000"])?;
    let (cpu_s, took_s) = (run.cpu_s, run.took_s);
    writeln!(out, "{LINES} lines: {cpu_s:.2} CPU s in {took_s:.2} s")?;

    for (baud, moves_s) in [(250_000, 500), (115_200, 250)] {
        // 50 mm/s: what a planner of 16 such short blocks still reaches at the
        // machine's acceleration.
        let length_mm = 50.0 / f64::from(moves_s);
        let job = self::job(folder.path(), moves_s * PLANNER_S, length_mm)?;
        let run = stream(&binary, folder.path(), &job, baud, &["--baud", &baud.to_string()])?;
        let empty = run.stats["planner_empty_share"].as_f64().unwrap_or(1.0) * 100.0;
        let (cpu_s, gaps) = (run.cpu_s, &run.stats["planner_gaps"]);
        writeln!(
            out,
            "{baud} baud, {moves_s} moves/s: planner empty {empty:.2} % ({gaps} gaps), {cpu_s:.2} CPU s in {PLANNER_S} s"
        )?;
    }
    Ok(())
}

/// The `outrigger` beside this example's folder.
fn binary() -> Result<PathBuf, Box<dyn Error>> {
    let exe = std::env::current_exe()?;
    let binary = exe.ancestors().nth(2).ok_or("no build folder")?.join("outrigger");
    if !binary.exists() {
        return Err(format!("{}: build it first", binary.display()).into());
    }
    Ok(binary)
}

/// `count` moves of `length_mm` to and fro at 50 mm/s.
fn job(folder: &Path, count: u32, length_mm: f64) -> Result<PathBuf, Box<dyn Error>> {
    let mut text = String::from("G28\nM83\nG1 X10 Y50 Z5 F3000\n");
    let (mut x_mm, mut step_mm) = (10.0, length_mm);
    for n in 0..count {
        x_mm += step_mm;
        if !(10.0..190.0).contains(&x_mm) {
            step_mm = -step_mm;
        }
        writeln!(text, "G1 X{x_mm:.3} Y{:.3}", 50.0 + f64::from(n) / 10_000.0)?;
    }
    let path = folder.join("job.gcode");
    fs::write(&path, text)?;
    Ok(path)
}

struct Run {
    cpu_s: f64,
    took_s: f64,
    stats: serde_json::Value,
}

fn stream(binary: &Path, folder: &Path, job: &Path, baud: u32, mock: &[&str]) -> Result<Run, Box<dyn Error>> {
    let (link, stats) = (folder.join("tty"), folder.join("stats.json"));
    let mut printer = Command::new(binary)
        .args(["mock", "--profile", "prusa-mk3s", "--link"])
        .arg(&link)
        .arg("--stats")
        .arg(&stats)
        .args(mock)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()?;
    let start = Instant::now();
    while !link.exists() && start.elapsed() < Duration::from_secs(10) {
        std::thread::sleep(Duration::from_millis(10));
    }
    let (before_s, start) = (children_cpu_s()?, Instant::now());
    let printed = Command::new(binary)
        .arg("print")
        .arg(job)
        .arg("--port")
        .arg(&link)
        .args(["--profile", "prusa-mk3s", "--no-macros", "--baud", &baud.to_string()])
        .stdout(Stdio::null())
        .status()?;
    let (cpu_s, took_s) = (children_cpu_s()? - before_s, start.elapsed().as_secs_f64());
    Command::new("kill").args(["-INT", &printer.id().to_string()]).status()?;
    printer.wait()?;
    if !printed.success() {
        return Err("the print failed".into());
    }
    let stats = serde_json::from_slice(&fs::read(&stats)?)?;
    Ok(Run { cpu_s, took_s, stats })
}

/// CPU time of all children that have ended, in s.
fn children_cpu_s() -> Result<f64, Box<dyn Error>> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    // Fields after the name, which is in brackets and may hold blanks; cutime
    // and cstime are the 16th and 17th of all.
    let fields = stat.rsplit(')').next().unwrap_or_default();
    let ticks = fields.split_whitespace().skip(13).take(2);
    let sum: f64 = ticks.map(|t| t.parse::<f64>()).sum::<Result<_, _>>()?;
    Ok(sum / TICKS_PER_S)
}
