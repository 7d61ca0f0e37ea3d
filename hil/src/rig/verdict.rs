//! What must hold of a scenario on the rig: the virtual world's judge, on what was seen here.
//!
//! Takes a scenario and a target, gives a [`Verdict`]. The mock's deeds are its own; of another
//! printer, the account of the wire says what it must have taken.
use super::account::targets;
use super::skips::skips;
use super::stage::{Setup, Stage};
use super::target::Target;
use crate::judge::executed;
use crate::play::judge;
use crate::scenario::{End, Expect};
use crate::world::Report;
use outrigger::printer::mock::{Executed, Stats};
use std::time::{Duration, Instant};

/// Time after the last process in which the board's own moves come to an end: the mock's
/// planner holds a second's worth at most.
const AFTERMATH: Duration = Duration::from_millis(300);

/// What the program says of the printer's heaters at the end, and what a scenario calls that.
const SAFETY: [(&str, &str); 4] = [
    ("nothing of it was sent", "Untouched"),
    ("has run the cancel macro", "Acknowledged"),
    ("has switched its heaters off", "ByFirmware"),
    ("HEATERS MAY BE ON", "Unknown"),
];

/// What came of one scenario.
#[derive(Debug)]
pub enum Verdict {
    /// All that must hold does.
    Holds {
        /// How long it took, s.
        took_s: f64,
    },
    /// It does not, and why; with the tail of the transcript.
    Broken {
        /// What does not hold.
        wrong: Vec<String>,
        /// What was said on the wire and happened, and what the user was told.
        transcript: Vec<String>,
    },
    /// It was not played, and why.
    Skipped(String),
}

/// Plays a scenario and judges it. The target is made only if it is played.
///
/// # Errors
/// It cannot be played at all: no port, no profile, no process.
pub fn verdict(
    setup: Setup<'_>,
    sort: super::Sort,
    target: impl FnOnce(&std::path::Path) -> anyhow::Result<Target>,
) -> anyhow::Result<Verdict> {
    if let Some(why) = skips(setup.scenario, sort, setup.rig) {
        return Ok(Verdict::Skipped(why));
    }
    let folder = tempfile::tempdir()?;
    let started = Instant::now();
    let scenario = setup.scenario;
    let mut stage = Stage::new(setup, target(folder.path())?, folder.path())?;
    stage.play()?;
    stage.program.kill();
    std::thread::sleep(AFTERMATH);
    let report = report(&mut stage);
    let unsafe_end = !report.over;
    let wrong = match stage.program.job() {
        Some(_) => {
            let done = executed(&stage.commands, &report.deeds, &report.starts_ns);
            judge(&scenario.expect, &stage.commands, &report, &done)
        }
        None => refused(&scenario.expect, &report.told),
    };
    stage.close(unsafe_end)?;
    if wrong.is_empty() {
        return Ok(Verdict::Holds { took_s: started.elapsed().as_secs_f64() });
    }
    let mut transcript: Vec<String> = report.transcript.into();
    transcript.push(format!("the user was told:\n{}", report.told));
    Ok(Verdict::Broken { wrong, transcript })
}

/// A job that was never begun has no record: that is right only where it was to be refused.
fn refused(expect: &Expect, told: &str) -> Vec<String> {
    if expect.outcome != End::Refused {
        return vec!["the job was never begun".to_owned()];
    }
    let lower = told.to_lowercase();
    let missing = expect.told.iter().filter(|words| !lower.contains(&words.to_lowercase()));
    missing.map(|words| format!("the user was not told of {words:?}")).collect()
}

fn report(stage: &mut Stage<'_>) -> Report {
    let (deeds, starts_ns, stats) = stage.target.deeds().unwrap_or_else(|| by_wire(stage));
    Report {
        over: stage.over,
        outcome: None,
        state: stage.program.job().unwrap_or(stage.state),
        processes: stage.program.processes,
        // Only the first process is told to print; those after it resume.
        fresh: 1,
        deeds,
        starts_ns,
        light: Vec::new(),
        shown: Vec::new(),
        stats,
        told: told(&stage.program.said()),
        ended_ns: stage.ended_ns.max(stage.events.first_ns.unwrap_or_default()),
        begun_ns: None,
        fault_ns: stage.events.first_ns,
        cold_ns: stage.cold_ns,
        stall_ns: stage.account.stall_ns,
        sent: stage.account.sent,
        mishaps: stage.link.out.mishaps + stage.link.back.mishaps,
        confirmed_ns: std::mem::take(&mut stage.confirmed_ns),
        transcript: std::mem::take(&mut stage.transcript),
    }
}

/// What the user was told, with a scenario's own names for it.
fn told(said: &str) -> String {
    let named = SAFETY.iter().filter(|(words, _)| said.contains(words));
    named.fold(said.to_owned(), |told, (_, name)| told + name + "\n")
}

/// What a printer that cannot be asked must have done.
fn by_wire(stage: &Stage<'_>) -> (Vec<Executed>, Vec<u64>, Stats) {
    let took = stage.account.took().to_vec();
    let (nozzle_target_c, bed_target_c) = targets(&took);
    let heaters_on = nozzle_target_c > 0.0 || bed_target_c > 0.0;
    let stats = Stats { heaters_on, nozzle_target_c, bed_target_c, ..Stats::default() };
    (took, stage.account.starts_ns.clone(), stats)
}

impl Stage<'_> {
    /// The end: heaters off, and the watchdog is let go; or it is called, where nobody knows
    /// what the printer does.
    ///
    /// # Errors
    /// The watchdog had to act, or could not.
    fn close(&mut self, call: bool) -> anyhow::Result<()> {
        let real = self.target.sort() == super::Sort::Real;
        if let Some(fd) = self.device.as_ref().filter(|_| real) {
            super::watchdog::switch_off(fd)?;
        }
        let Some(leash) = self.leash.take() else { return Ok(()) };
        match call && real {
            true => leash.act()?,
            false => leash.done()?,
        }
        Ok(())
    }
}
