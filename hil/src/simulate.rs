//! Random jobs with random trouble: a seed says all of a run.
//!
//! Takes a seed; throws a job, a board, a wire, a disk, a user and what goes wrong, runs them
//! in the virtual world, and says which invariant does not hold. A seed that fails is run again
//! with a transcript.
//!
//! # What must hold, whatever the seed
//! 1. Every run ends.
//! 2. Commands of the job are executed in order, none left out, each once while the board kept its state.
//! 3. After the board has started anew nothing of the job is executed before a person's word;
//!    after it at most [`TWICE_MOST`] commands are gone over again.
//! 4. A board that kept its state, and a user who cancels nothing, mean a finished job.
//! 5. A job that was cancelled or has failed has its heaters off, or the user is told that nobody knows.
//! 6. Nothing moves where it hits the part, or while it sticks to it.
pub mod resin;

use crate::dice::Dice;
use crate::judge::{Executed, executed};
use crate::play::settings;
use crate::scenario::{Fault, Kind, generated};
use crate::world::disk::DiskPlan;
use crate::world::source::Commands;
use crate::world::wire::Chances;
use crate::world::{Plan, Report, User, World};
use outrigger::job::state::State;
use outrigger::printer::mock::{Config, Faults, Personality};
use outrigger::printer::session::{Outcome, Safety};
use outrigger::printer::window::Limit;
use outrigger::profile::{Profile, load_printer};
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Commands that a resume after a start of the board may go over again: the commands
/// that the host sends beyond its last durable checkpoint, the largest planner and queue
/// of the firmwares here, and what a clean place for the restart is looked for in.
pub const TWICE_MOST: usize = 1024 + 64 + 32 + 18;

/// A simulated run that takes longer hangs, ns: the longest waits of the host follow each
/// other in far less than six hours.
const LIMIT_NS: u64 = 6 * 3_600_000_000_000;

/// Lines of the transcript that a failure shows.
const TAIL_LINES: usize = 120;

/// Failures after which no more seeds are tried.
const FAILURES_MAX: usize = 8;

/// A seed, and what does not hold.
#[derive(Debug)]
pub struct Failure {
    /// The seed.
    pub seed: u64,
    /// What, and the tail of the transcript.
    pub text: String,
}

/// What many runs came to.
#[derive(Debug, Default)]
pub struct Tally {
    /// Runs.
    pub runs: u64,
    /// Of these, finished, cancelled, failed, interrupted.
    pub ends: [u64; 4],
    /// Commands that were executed.
    pub commands: u64,
    /// Lines and replies that something happened to.
    pub mishaps: u64,
    /// Processes that took a job up again.
    pub heirs: u64,
    /// Starts of boards in mid-job.
    pub starts: u64,
    /// Simulated time, s.
    pub simulated_s: f64,
    /// What does not hold.
    pub failures: Vec<Failure>,
}

impl std::fmt::Display for Tally {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [finished, cancelled, failed, interrupted] = self.ends;
        write!(
            f,
            "{} runs, {:.0} simulated hours: {finished} finished, {cancelled} cancelled, {failed} failed, \
             {interrupted} interrupted; {} commands executed, {} lines and replies damaged or lost, \
             {} jobs taken up again, {} starts of the board in mid-job",
            self.runs,
            self.simulated_s / 3600.0,
            self.commands,
            self.mishaps,
            self.heirs,
            self.starts
        )
    }
}

/// Runs the seeds from `first` on, on all processors.
///
/// # Errors
/// The built-in profile cannot be read.
pub fn many(first: u64, runs: u64) -> anyhow::Result<Tally> {
    let profile = load_printer(crate::play::DEFAULT_PROFILE)?;
    let next = AtomicU64::new(0);
    let tally = Mutex::new(Tally::default());
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let enough = lock(&tally).failures.len() >= FAILURES_MAX;
                    if at >= runs || enough {
                        return;
                    }
                    let run = Run::of(first + at, &profile, false);
                    let wrong = run.wrong();
                    let text = wrong.map(|_| explain(first + at, &profile));
                    run.count(text, &mut lock(&tally));
                }
            });
        }
    });
    Ok(tally.into_inner().unwrap_or_else(PoisonError::into_inner))
}

/// Runs one seed with a transcript; what does not hold, if anything, and all of the transcript.
///
/// # Errors
/// The built-in profile cannot be read.
pub fn one(seed: u64) -> anyhow::Result<(Option<String>, Vec<String>)> {
    let run = Run::of(seed, &load_printer(crate::play::DEFAULT_PROFILE)?, true);
    Ok((run.wrong(), run.report.transcript.iter().cloned().collect()))
}

fn lock<T>(tally: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    tally.lock().unwrap_or_else(PoisonError::into_inner)
}

fn explain(seed: u64, profile: &Profile) -> String {
    let run = Run::of(seed, profile, true);
    let what =
        run.wrong().unwrap_or_else(|| "the second run of this seed holds: it depends on more".to_owned());
    let mut text = format!("{what}\n{}\n", run.thrown);
    let skip = run.report.transcript.len().saturating_sub(TAIL_LINES);
    for line in run.report.transcript.iter().skip(skip) {
        let _ = writeln!(text, "{line}");
    }
    text
}

/// One run.
struct Run {
    seed: u64,
    commands: Commands,
    faults: Vec<Kind>,
    user: User,
    /// What the dice said, for people.
    thrown: String,
    report: Report,
    done: Executed,
}

impl Run {
    fn of(seed: u64, profile: &Profile, transcript: bool) -> Self {
        let mut dice = Dice::new(seed);
        let commands = Commands::of(&job(&mut dice));
        let plan = throw(&mut dice, seed, &commands, profile, transcript);
        let faults = plan.faults.iter().map(|f| f.kind).collect();
        let user = plan.user;
        let thrown = format!(
            "{} commands; {:?}\nout {:?}\nback {:?}\n{:?} {:?}\nfaults {:#?}",
            commands.len(),
            plan.config,
            plan.out,
            plan.back,
            plan.disk,
            plan.user,
            plan.faults
        );
        let report = World::new(plan).run();
        let done = executed(&commands, &report.deeds, &report.starts_ns);
        Self { seed, commands, faults, user, thrown, report, done }
    }

    fn had(&self, kinds: &[Kind]) -> bool {
        self.faults.iter().any(|kind| kinds.contains(kind))
    }

    /// The first invariant that does not hold.
    fn wrong(&self) -> Option<String> {
        let (report, done) = (&self.report, &self.done);
        if !report.over {
            return Some(format!("1: it hangs in {:?}", report.state));
        }
        if let Some(wrong) = &done.wrong {
            return Some(format!("2: {wrong}"));
        }
        let starts = self.starts_in_mid_job().count();
        if starts == 0 && done.twice > 0 {
            return Some(format!(
                "2: {} commands were executed twice by a board that kept its state",
                done.twice
            ));
        }
        if done.back > TWICE_MOST {
            return Some(format!("3: {} commands were gone over again", done.back));
        }
        let stats = &report.stats;
        if stats.crashes + stats.moved_cold > 0 {
            return Some(format!(
                "6: {} crashes, {} moves of a nozzle that stuck",
                stats.crashes, stats.moved_cold
            ));
        }
        if let Some(wrong) = self.without_a_word() {
            return Some(wrong);
        }
        let whole = done.through == self.commands.len();
        if report.state == State::Finished && !whole {
            let missing = String::from_utf8_lossy(self.commands.get(done.through).unwrap_or_default());
            return Some(format!(
                "4: finished after {} of {} commands, without {missing}",
                done.through,
                self.commands.len()
            ));
        }
        // After a tail of a line was executed the head is not where the file has it.
        let excused =
            starts > 0 || done.torn > 0 || self.had(&[Kind::Cancel, Kind::EmergencyStop, Kind::Halt]);
        if !excused && report.state != State::Finished {
            return Some(format!("4: it ends in {:?}: {:?}", report.state, report.outcome));
        }
        self.hot()
    }

    /// 5: heaters, where the job is over.
    fn hot(&self) -> Option<String> {
        let stats = &self.report.stats;
        let hot = stats.heaters_on;
        let over = matches!(self.report.state, State::Cancelled | State::Failed);
        let told = matches!(self.report.outcome, Some(Outcome::Stopped { safety: Safety::Unknown, .. }));
        (over && hot && !told).then(|| {
            let outcome = &self.report.outcome;
            format!("5: heaters on after {outcome:?}: {} {}", stats.nozzle_target_c, stats.bed_target_c)
        })
    }

    /// Starts of the board after it had executed a command of the job.
    fn starts_in_mid_job(&self) -> impl Iterator<Item = u64> {
        let first = self.commands.get(0).unwrap_or_default();
        let first_ns = self.report.deeds.iter().find(|d| d.command.as_bytes() == first).map(|d| d.at_ns);
        let starts = self.report.starts_ns.iter().copied();
        starts.filter(move |at_ns| first_ns.is_some_and(|first_ns| *at_ns >= first_ns))
    }

    /// 3: a move of the job after a start, and no person had said that all is clear.
    fn without_a_word(&self) -> Option<String> {
        let starts: Vec<_> = self.starts_in_mid_job().collect();
        for deed in self.report.deeds.iter().filter(|d| d.whole && d.command.starts_with("G1 X")) {
            let Some(since_ns) = starts.iter().copied().filter(|at| *at < deed.at_ns).max() else {
                continue;
            };
            let said = self.report.confirmed_ns.iter().any(|at| (since_ns..=deed.at_ns).contains(at));
            if !said {
                return Some(format!(
                    "3: {} moves at {:.3} s, after a start at {:.3} s without a person's word",
                    deed.command,
                    deed.at_ns as f64 / 1e9,
                    since_ns as f64 / 1e9
                ));
            }
        }
        None
    }

    fn count(self, wrong: Option<String>, tally: &mut Tally) {
        tally.runs += 1;
        let end = [State::Finished, State::Cancelled, State::Failed, State::Interrupted];
        if let Some(at) = end.iter().position(|s| *s == self.report.state) {
            tally.ends[at] += 1;
        }
        tally.commands += self.done.through as u64;
        tally.mishaps += self.report.mishaps;
        tally.heirs += u64::from(self.report.processes - 1);
        tally.starts += self.starts_in_mid_job().count() as u64;
        tally.simulated_s += self.report.ended_ns as f64 / 1e9;
        let _ = self.user;
        if let Some(text) = wrong {
            tally.failures.push(Failure { seed: self.seed, text });
        }
    }
}

/// A job of 100 to 300 lines: heat, home, moves, and now and then a command that
/// takes its time.
fn job(dice: &mut Dice) -> String {
    let mut text = String::from("M140 S50\nG28\nM109 S200\nG92 E0\n");
    for n in 1..=dice.between(100, 300) {
        text.push_str(&generated(n));
        text.push('\n');
        if dice.chance(15) {
            let now_and_then = ["G4 P500", "M106 S255", "M107", "M109 S205", "M400", "M104 S195"];
            text.push_str(dice.pick::<&str>(&now_and_then));
            text.push('\n');
        }
    }
    text.push_str("M104 S0\nM140 S0\nM107\n");
    text
}

fn throw(dice: &mut Dice, seed: u64, commands: &Commands, profile: &Profile, transcript: bool) -> Plan {
    let mut config = match Personality::find(dice.pick::<&str>(&FIRMWARES)) {
        Some(personality) => personality.config(),
        None => Config::default(),
    };
    config.baud = *dice.pick(&[0, 115_200, 250_000]);
    config.speed = *dice.pick(&[1.0, 5.0, 20.0]);
    config.dtr_reset = dice.chance(200);
    let rx_bytes = config.rx_bytes;
    let mut settings = settings(profile, config.dtr_reset);
    // As a profile of this printer says.
    settings.resume.planner_moves = config.blocks as u32;
    settings.resume.queue_commands = config.queue as u32;
    settings.session.window = match dice.chance(150) {
        true => Limit::Lines(1),
        false => Limit::Bytes(rx_bytes.min(128) - 8),
    };
    let noisy = dice.chance(500);
    let mut chances = |most: u64| Chances {
        corrupt: if noisy { dice.below(most) } else { 0 },
        lose: if noisy { dice.below(most / 2) } else { 0 },
        split: dice.chance(300),
        delay_ns: if dice.chance(300) { dice.below(30_000_000) } else { 0 },
    };
    let (out, back) = (chances(30), chances(30));
    let sync_ns = *dice.pick(&[1_000_000, 8_000_000, 40_000_000, 400_000_000]);
    let user = User {
        resumes_ns: Some(dice.below(20_000_000_000)),
        confirms_ns: dice.chance(500).then(|| dice.below(60_000_000_000)),
    };
    Plan {
        commands: commands.clone(),
        resin: None,
        settings,
        config,
        board: Faults::default(),
        out,
        back,
        disk: DiskPlan { sync_ns },
        faults: faults(dice, commands.len() as u64),
        user,
        hard_stop: dice.chance(500),
        seed: seed ^ 0x5eed,
        limit_ns: LIMIT_NS,
        transcript,
        watch_heat: false,
    }
}

/// Firmwares that a run may have: those of the mock's table that look at line numbers.
const FIRMWARES: [&str; 18] = [
    "marlin-2.1",
    "marlin-2.1",
    "advanced-ok",
    "no-emergency-parser",
    "no-auto-report",
    "no-busy-notes",
    "no-prompts",
    "resend-without-ok",
    "resend-tight",
    "resend-with-n",
    "rs",
    "refuses-repeats",
    "rx-64",
    "rx-1024",
    "large",
    "marlin-1.1",
    "marlin-1.0",
    "repetier",
];

/// Kinds with the thousandths of runs that have them.
const KINDS: [(Kind, u64); 15] = [
    (Kind::Kill, 300),
    (Kind::Kill, 100),
    (Kind::Unplug, 250),
    (Kind::Unplug, 50),
    (Kind::UnplugReset, 60),
    (Kind::Reset, 80),
    (Kind::Halt, 20),
    (Kind::Hang, 80),
    (Kind::Pause, 200),
    (Kind::Cancel, 80),
    (Kind::EmergencyStop, 20),
    (Kind::HoldReplies, 80),
    (Kind::Block, 80),
    (Kind::DiskSlow, 80),
    (Kind::DiskFails, 80),
];

fn faults(dice: &mut Dice, commands: u64) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (kind, share) in KINDS {
        if !dice.chance(share) {
            continue;
        }
        // Most in mid-job, some while it begins or heats.
        let mut fault = match dice.chance(700) {
            true => Fault::at_line(kind, dice.between(1, commands)),
            false => Fault::at_s(kind, dice.below(100_000) as f64 / 1000.0),
        };
        fault.after_s = dice.below(500) as f64 / 1000.0;
        let tenths = |dice: &mut Dice, most: u64| Some(dice.between(1, most) as f64 / 10.0);
        match kind {
            Kind::Kill => fault.for_s = tenths(dice, 300),
            Kind::Unplug | Kind::UnplugReset => fault.for_s = tenths(dice, 100),
            Kind::Hang | Kind::HoldReplies | Kind::Block => fault.for_s = tenths(dice, 40),
            Kind::DiskSlow => fault.for_s = tenths(dice, 20),
            Kind::DiskFails => fault.for_s = tenths(dice, 300),
            Kind::Halt => fault.text = Some("Heating failed, system stopped! Heater_ID: 0".to_owned()),
            _ => {}
        }
        faults.push(fault);
    }
    faults
}
