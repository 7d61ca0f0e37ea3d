//! A child process and what it takes: CPU time, memory, time. From /proc: Linux only.
use anyhow::{Context, bail};
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Kernel ticks a second in /proc (USER_HZ), the same on every Linux.
const TICKS_PER_S: f64 = 100.0;

/// Between two looks at a child. Its memory is told as of the last look.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// After this a host that was told to stop is killed.
const STOP_WITHIN: Duration = Duration::from_secs(10);

/// Longest run: a host that hangs shall not take the other figures with it.
const LONGEST: Duration = Duration::from_secs(900);

/// What a process and its descendants took.
pub(crate) struct Cost {
    /// Of its whole life, its descendants' included.
    pub(crate) cpu_s: f64,
    /// Most resident memory of any one of them.
    pub(crate) peak_mb: f64,
    pub(crate) took_s: f64,
}

/// Runs a command to its end, or stops it after `stop_after`: by SIGINT twice, as from a
/// person in a hurry.
///
/// # Errors
/// It failed by itself; with what it wrote to `log`.
pub(crate) fn run(
    command: &mut Command,
    log: &Path,
    stop_after: Option<Duration>,
) -> anyhow::Result<(Instant, Cost)> {
    let before_s = children_cpu_s()?;
    let output = fs::File::create(log)?;
    let started = Instant::now();
    command.stdin(Stdio::null()).stdout(output.try_clone()?).stderr(output);
    let mut child = command.spawn().with_context(|| format!("cannot start {command:?}"))?;
    let mut peak_mb = 0_f64;
    let mut stopped = 0;
    let status = loop {
        peak_mb = peak_mb.max(peak_of_family(child.id()));
        if let Some(status) = child.try_wait()? {
            break status;
        }
        let due = stop_after.filter(|&after| started.elapsed() >= after);
        match (due, stopped) {
            (Some(after), 2) if started.elapsed() > after + STOP_WITHIN => child.kill()?,
            (Some(_), 0 | 1) => {
                interrupt(&child)?;
                stopped += 1;
            }
            _ if started.elapsed() > LONGEST => child.kill()?,
            _ => {}
        }
        std::thread::sleep(LOOK_EVERY);
    };
    let cost = Cost { cpu_s: children_cpu_s()? - before_s, peak_mb, took_s: started.elapsed().as_secs_f64() };
    if stopped == 0 && !status.success() {
        bail!("{command:?}: {status}\n{}", fs::read_to_string(log).unwrap_or_default());
    }
    Ok((started, cost))
}

/// Sends SIGINT.
pub(crate) fn interrupt(child: &Child) -> anyhow::Result<()> {
    Command::new("kill").args(["-INT", &child.id().to_string()]).stderr(Stdio::null()).status()?;
    Ok(())
}

/// CPU time of all children that have ended, in s.
fn children_cpu_s() -> anyhow::Result<f64> {
    let stat = fs::read_to_string("/proc/self/stat").context("no /proc/self/stat: not Linux?")?;
    // cutime and cstime, the 16th and 17th field of all.
    let ticks = after_name(&stat).skip(13).take(2);
    let sum: f64 = ticks.map(|t| t.parse::<f64>()).sum::<Result<_, _>>()?;
    Ok(sum / TICKS_PER_S)
}

/// The fields after the name, which is in brackets and may hold blanks.
fn after_name(stat: &str) -> impl Iterator<Item = &str> {
    stat.rsplit(')').next().unwrap_or_default().split_whitespace()
}

/// Most memory that a process or one of its descendants has held so far (`VmHWM`), MB (10⁶).
fn peak_of_family(pid: u32) -> f64 {
    let children = fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).unwrap_or_default();
    let children = children.split_whitespace().filter_map(|child| child.parse().ok());
    children.map(peak_of_family).fold(peak_mb(pid).unwrap_or(0.0), f64::max)
}

fn peak_mb(pid: u32) -> Option<f64> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: f64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}
