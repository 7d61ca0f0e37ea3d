//! What streaming costs and whether it keeps the planner fed, beside peers in one run.
//!
//! `cargo build --release && cargo run --release --example stream_figures -- [--load N] [--peers PYTHON]`
//!
//! `outrigger print`, a sender in C that does the least (`benches/peer_sender.c`, needs
//! `cc`) and, where `--peers` names a Python that has them, OctoPrint and Printrun's
//! printcore print the same jobs on the same `outrigger mock`. Told are:
//! - CPU seconds of the whole life of the process for 100,000 short lines without a baud
//!   limit, and its most memory,
//! - from the start of the process to the job's first line at the printer,
//! - memory and start of a job of 3 MB (whole) and one of 200 MB (its first seconds), while
//!   ours accepts it and once more when it knows it,
//! - the share of time in which the planner was empty, at several speeds, and the share
//!   that was lost: a planner short of moves slows down long before it is empty. With
//!   `--load N` once more beside N busy loops.
//!
//! Each run is checked: the printer got every line of the job once. Targets that are
//! missed are marked; the exit status is 1 only when a process fails, since times are
//! the machine's as well. Linux only: what a process takes comes from /proc.
mod host;
mod ideal;
mod job;
mod process;
mod stream;

use clap::{Parser, ValueEnum};
use host::{Host, Programs};
use ideal::ideal_s;
use job::{Job, Length};
use std::fmt::Display;
use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;
use stream::{Printer, Run, stream, stream_again};

/// Lines of the CPU measurement.
const LINES: u64 = 100_000;

/// Runs of ours and of the sender in C for it, turn and turn about: CPU times come in
/// hundredths of a second.
const CPU_RUNS: u32 = 5;

/// Runs of either for the planner beside busy loops, turn and turn about.
const LOADED_TURNS: u32 = 3;

/// So much of the large job is printed.
const LARGE_FOR: Duration = Duration::from_secs(15);

/// A line without a speed limit to a machine that is never the slow part.
const FAST: Printer = Printer { baud: 0, speed: 1000, latency_ms: 0 };

/// What a USB adapter holds replies back, in the planner measurements.
const LATENCY_MS: u32 = 1;

/// Bits per second (0: no limit) and moves a second of the planner measurements.
const FEEDS: [(u32, u32); 3] = [(250_000, 500), (115_200, 250), (0, 1000)];

const CPU_S: f64 = 1.2;
const CPU_RATIO: f64 = 2.0;
const MEMORY_MB: f64 = 12.0;
const FIRST_LINE_S: f64 = 0.3;
const EMPTY_POINTS: f64 = 0.5;

#[derive(Parser)]
struct Args {
    /// Measure the planner a second time, beside so many busy loops.
    #[arg(long, value_name = "N", default_value_t = 0)]
    load: u32,
    /// A Python with OctoPrint and Printrun.
    #[arg(long, value_name = "PYTHON")]
    peers: Option<PathBuf>,
    /// What to measure.
    #[arg(long, value_enum, value_delimiter = ',', default_values = ["cpu", "size", "planner"])]
    parts: Vec<Part>,
    /// Length of a planner measurement.
    #[arg(long, value_name = "N", default_value_t = 20)]
    seconds: u32,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Part {
    /// CPU for 100,000 lines; start to first line.
    Cpu,
    /// Memory and start by the size of the job.
    Size,
    /// Whether the planner stays fed.
    Planner,
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let folder = tempfile::tempdir()?;
    let programs = Programs::new(folder.path(), args.peers.clone())?;
    let figures = Figures { args, folder, programs };
    for part in &figures.args.parts {
        match part {
            Part::Cpu => figures.cpu()?,
            Part::Size => figures.size()?,
            Part::Planner => figures.planner()?,
        }
    }
    Ok(())
}

struct Figures {
    args: Args,
    folder: tempfile::TempDir,
    programs: Programs,
}

impl Figures {
    fn cpu(&self) -> anyhow::Result<()> {
        tell(format_args!(
            "\n{LINES} lines, no baud limit            CPU s   ratio to C   memory MB   first line s"
        ));
        let job = Job::write(self.folder.path(), Length::Moves(LINES), 250.0)?;
        let run = |host| stream(&self.programs, host, &job, FAST, None);
        let (mut ours, mut c) = (Vec::new(), Vec::new());
        for _ in 0..CPU_RUNS {
            ours.push(run(Host::Ours)?);
            c.push(run(Host::C)?);
        }
        let c_cpu_s = mean(&c, |r| r.cost.cpu_s);
        let row = |host: Host, runs: &[Run]| {
            let cpu_s = mean(runs, |r| r.cost.cpu_s);
            let (peak_mb, first_s) = (most(runs, |r| r.cost.peak_mb), mean(runs, |r| r.first_line_s));
            tell(format_args!(
                "  {:<12} {:>6.2} s wall {cpu_s:>15.3} {:>12.2} {peak_mb:>11.1} {first_s:>14.3}",
                host.name(),
                mean(runs, |r| r.cost.took_s),
                cpu_s / c_cpu_s,
            ));
        };
        row(Host::Ours, &ours);
        row(Host::C, &c);
        let cpu_s = mean(&ours, |r| r.cost.cpu_s);
        verdict("CPU s", cpu_s, CPU_S);
        verdict("CPU, ratio to the C sender", cpu_s / c_cpu_s, CPU_RATIO);
        verdict("memory MB", most(&ours, |r| r.cost.peak_mb), MEMORY_MB);
        verdict("start to first line s", mean(&ours, |r| r.first_line_s), FIRST_LINE_S);
        for host in self.peers() {
            let peer = run(host)?;
            row(host, std::slice::from_ref(&peer));
            tell(format_args!(
                "    ours to {}: CPU 1 : {:.0}, memory 1 : {:.1}, first line 1 : {:.0}",
                host.name(),
                peer.cost.cpu_s / cpu_s,
                peer.cost.peak_mb / most(&ours, |r| r.cost.peak_mb),
                peer.first_line_s / mean(&ours, |r| r.first_line_s),
            ));
        }
        Ok(())
    }

    fn size(&self) -> anyhow::Result<()> {
        tell("\nsize of the job                     lines sent   memory MB   first line s");
        for (mb, stop_after) in [(3, None), (200, Some(LARGE_FOR))] {
            let job = Job::write(self.folder.path(), Length::Bytes(mb * 1_000_000), 250.0)?;
            let row = |name: &str, run: &Run| {
                tell(format_args!(
                    "  {name:<12} {:>6.1} MB {:>24} {:>11.1} {:>14.3}",
                    job.bytes as f64 / 1e6,
                    run.lines,
                    run.cost.peak_mb,
                    run.first_line_s,
                ));
            };
            // The first run accepts the job, and reads it whole before anything moves; the
            // second knows it.
            let records = tempfile::tempdir()?;
            let ours = || stream_again(&self.programs, Host::Ours, &job, FAST, stop_after, records.path());
            let (accepts, knows) = (ours()?, ours()?);
            row("outrigger", &accepts);
            verdict("memory MB", accepts.cost.peak_mb, MEMORY_MB);
            row("accepted", &knows);
            verdict("memory MB", knows.cost.peak_mb, MEMORY_MB);
            verdict("start to first line s", knows.first_line_s, FIRST_LINE_S);
            row(Host::C.name(), &stream(&self.programs, Host::C, &job, FAST, stop_after)?);
        }
        Ok(())
    }

    fn planner(&self) -> anyhow::Result<()> {
        self.planner_beside(0)?;
        match self.args.load {
            0 => Ok(()),
            load => self.planner_beside(load),
        }
    }

    fn planner_beside(&self, load: u32) -> anyhow::Result<()> {
        tell(format_args!(
            "\nreplies {LATENCY_MS} ms on their way, {load} busy loops: planner empty   time lost"
        ));
        let _busy = Busy::start(load);
        // A loaded machine does not serve two runs alike.
        let turns = if load == 0 { 1 } else { LOADED_TURNS };
        for (baud, moves_s) in FEEDS {
            self.planner_at(baud, moves_s, turns)?;
        }
        Ok(())
    }

    fn planner_at(&self, baud: u32, moves_s: u32, turns: u32) -> anyhow::Result<()> {
        let moves = u64::from(moves_s * self.args.seconds);
        let job = Job::write(self.folder.path(), Length::Moves(moves), f64::from(moves_s))?;
        let (printer, ideal_s) = (Printer { baud, speed: 1, latency_ms: LATENCY_MS }, ideal_s(&job.path)?);
        let run = |host| stream(&self.programs, host, &job, printer, None);
        let row = |host: Host, runs: &[Run]| {
            let empty = mean(runs, |r| r.empty_percent);
            let lost = mean(runs, |r| 100.0 * (1.0 - ideal_s / r.printing_s));
            let name = host.name();
            tell(format_args!(
                "  {name:<12} {baud:>7} baud {moves_s:>6} moves/s {empty:>13.2} % {lost:>9.2} %"
            ));
            [empty, lost]
        };
        let (mut ours, mut c) = (Vec::new(), Vec::new());
        for _ in 0..turns {
            ours.push(run(Host::Ours)?);
            c.push(run(Host::C)?);
        }
        let (ours, c) = (row(Host::Ours, &ours), row(Host::C, &c));
        verdict("planner empty %", ours[0], c[0] + EMPTY_POINTS);
        verdict("time lost %", ours[1], c[1] + EMPTY_POINTS);
        for host in self.peers() {
            row(host, &[run(host)?]);
        }
        Ok(())
    }

    fn peers(&self) -> impl Iterator<Item = Host> {
        self.programs.hosts().into_iter().filter(|host| !matches!(host, Host::Ours | Host::C))
    }
}

/// Threads that do nothing but take their share of the processor.
struct Busy {
    over: std::sync::Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
}

impl Busy {
    fn start(count: u32) -> Self {
        let over = std::sync::Arc::new(AtomicBool::new(false));
        let spin = || {
            let over = std::sync::Arc::clone(&over);
            std::thread::spawn(move || while !over.load(Ordering::Relaxed) {})
        };
        let threads = (0..count).map(|_| spin()).collect();
        Self { over, threads }
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A thread that spins cannot fail.
            let _ = thread.join();
        }
    }
}

fn mean(runs: &[Run], figure: impl Fn(&Run) -> f64) -> f64 {
    runs.iter().map(figure).sum::<f64>() / runs.len() as f64
}

fn most(runs: &[Run], figure: impl Fn(&Run) -> f64) -> f64 {
    runs.iter().map(figure).fold(0.0, f64::max)
}

/// Says how a figure of ours stands to its target.
fn verdict(name: &str, figure: f64, target: f64) {
    let word = if figure <= target { "met" } else { "MISSED" };
    tell(format_args!("    {name}: {figure:.3}, target at most {target:.3}: {word}"));
}

fn tell(line: impl Display) {
    // Whoever closes the pipe has seen enough.
    let _ = writeln!(std::io::stdout(), "{line}");
}
