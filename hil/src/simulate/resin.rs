//! Random resin jobs with random trouble: a seed says all of a run.
//!
//! Takes a seed; throws layers, a board, a wire, a disk, a display, a user and what goes wrong, runs
//! them in the virtual world, and says which invariant does not hold.
//!
//! # What must hold, whatever the seed
//! 1. Every run ends.
//! 2. No pulse of the light is longer than its layer's exposure by more than 5 %, but for what is
//!    excused below.
//! 3. A pulse has one picture all the time, at its layer's height; layers come in their order.
//! 4. A finished print has each layer once, or as often as it was told, and each pixel its dose
//!    within 1 %.
//! 5. The plate hits nothing, and does not move in the light.
//! 6. After the board has started anew nothing moves and nothing is lit before a person's word.
//! 7. A board and a display that work, and a user who cancels nothing, mean a finished job.
//! 8. The light is off at the end.
//!
//! # What is excused
//! No host can switch off a light that hangs on a board that does not run ([`Kind::Hang`]), or on
//! one that it does not reach. Where the controller keeps the time, the latter is the cable being
//! cut after the line with light on has arrived and before that with light off has; such runs are
//! counted. So are those in which a board halts while no host is there or hears it, or a host is killed
//! before it has sent a lost line again: the watchdog's, which is not simulated here. And where the
//! controller keeps the time, behind a damaged line the firmware may take the tail of the next for a
//! line of its own: light on, or the dwell once more.
use super::{FAILURES_MAX, Failure, LIMIT_NS, TAIL_LINES, lock};
use crate::dice::Dice;
use crate::judge::resin::{Exposed, exposed};
use crate::resin::{Job, again};
use crate::scenario::{Fault, Kind};
use crate::world::disk::DiskPlan;
use crate::world::plate::{Resin, ScreenPlan, Task};
use crate::world::source::Commands;
use crate::world::wire::Chances;
use crate::world::{Plan, Report, User, World};
use outrigger::job::state::State;
use outrigger::printer::exposure::script::{Layer, Timing, Way};
use outrigger::printer::mock::{Config, Executed, Faults, Personality};
use outrigger::printer::session::{Outcome, Safety};
use outrigger::printer::window::Limit;
use std::fmt::Write as _;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// What many runs came to.
#[derive(Debug, Default)]
pub struct Tally {
    /// Runs.
    pub runs: u64,
    /// Of these, finished, cancelled, failed, interrupted.
    pub ends: [u64; 4],
    /// Exposures.
    pub exposures: u64,
    /// The most that one was longer than it should be, as a share, where none was excused.
    pub longest: f64,
    /// Runs in which a pulse was too long and is excused: why, and how often.
    pub excused: std::collections::BTreeMap<&'static str, u64>,
    /// Lines and replies that something happened to.
    pub mishaps: u64,
    /// Processes that took a job up again.
    pub heirs: u64,
    /// Starts of boards in mid-job.
    pub starts: u64,
    /// Layers that were exposed again after a person's word.
    pub again: u64,
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
            "{} resin jobs, {:.0} simulated hours: {finished} finished, {cancelled} cancelled, {failed} \
             failed, {interrupted} interrupted; {} exposures, the longest {:+.2} % off; {} lines and replies \
             damaged or lost, {} jobs taken up again, {} starts of the board in mid-job, {} layers exposed \
             again at a person's word; too long and excused: {:?}",
            self.runs,
            self.simulated_s / 3600.0,
            self.exposures,
            self.longest * 100.0,
            self.mishaps,
            self.heirs,
            self.starts,
            self.again,
            self.excused
        )
    }
}

/// Runs the seeds from `first` on, on all processors.
///
/// # Errors
/// The built-in profile cannot be read.
pub fn many(first: u64, runs: u64) -> anyhow::Result<Tally> {
    let next = AtomicU64::new(0);
    let tally = Mutex::new(Tally::default());
    let broken = Mutex::new(None);
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
                    match Run::of(first + at, false) {
                        Ok(run) => {
                            let text = run.wrong().map(|_| explain(first + at));
                            run.count(text, &mut lock(&tally));
                        }
                        Err(why) => *broken.lock().unwrap_or_else(PoisonError::into_inner) = Some(why),
                    }
                }
            });
        }
    });
    match broken.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(why) => Err(why),
        None => Ok(tally.into_inner().unwrap_or_else(PoisonError::into_inner)),
    }
}

/// Runs one seed with a transcript; what does not hold, if anything, and all of the transcript.
///
/// # Errors
/// The built-in profile cannot be read.
pub fn one(seed: u64) -> anyhow::Result<(Option<String>, Vec<String>)> {
    let run = Run::of(seed, true)?;
    Ok((run.wrong(), run.report.transcript.iter().cloned().collect()))
}

fn explain(seed: u64) -> String {
    let Ok(run) = Run::of(seed, true) else { return "it cannot be run again".to_owned() };
    let what =
        run.wrong().unwrap_or_else(|| "the second run of this seed holds: it depends on more".to_owned());
    let mut text = format!("{what}\n{}\n", run.thrown);
    let skip = run.report.transcript.len().saturating_sub(TAIL_LINES);
    for line in run.report.transcript.iter().skip(skip) {
        let _ = writeln!(text, "{line}");
    }
    text
}

struct Run {
    seed: u64,
    job: Job,
    faults: Vec<Fault>,
    screen: ScreenPlan,
    hard_stop: bool,
    thrown: String,
    report: Report,
    done: Exposed,
}

impl Run {
    fn of(seed: u64, transcript: bool) -> anyhow::Result<Self> {
        let mut dice = Dice::new(seed);
        let job = job(&mut dice);
        let script = job.script()?;
        let commands = Commands::of_script(script.clone());
        let config = job.board(board(&mut dice, job.timing))?;
        let mut settings = job.settings(&config)?;
        settings.session.window = Limit::Bytes(config.rx_bytes.min(128) - 8);
        let noisy = dice.chance(500);
        let mut chances = |most: u64| Chances {
            corrupt: if noisy { dice.below(most) } else { 0 },
            lose: if noisy { dice.below(most / 2) } else { 0 },
            split: dice.chance(300),
            delay_ns: if dice.chance(300) { dice.below(30_000_000) } else { 0 },
        };
        let (out, back) = (chances(30), chances(30));
        let screen = screen(&mut dice);
        let plan = Plan {
            resin: Some(Resin { script, screen }),
            settings,
            config,
            board: Faults::default(),
            out,
            back,
            disk: DiskPlan { sync_ns: *dice.pick(&[1_000_000, 8_000_000, 40_000_000, 400_000_000]) },
            faults: faults(&mut dice, commands.len() as u64, job.timing),
            commands,
            user: User {
                resumes_ns: Some(dice.below(20_000_000_000)),
                confirms_ns: dice.chance(700).then(|| dice.below(60_000_000_000)),
            },
            hard_stop: dice.chance(800),
            seed: seed ^ 0x5eed,
            limit_ns: LIMIT_NS,
            transcript,
            watch_heat: false,
        };
        let thrown = format!(
            "{} layers, {:?}, homes {}; {:?}\nout {:?}\nback {:?}\n{:?} {:?} {:?} hard stop {}\nfaults {:#?}",
            job.layers.len(),
            job.timing,
            if job.homes_up { "up" } else { "down" },
            plan.config,
            plan.out,
            plan.back,
            plan.disk,
            plan.user,
            screen,
            plan.hard_stop,
            plan.faults
        );
        let (faults, hard_stop) = (plan.faults.clone(), plan.hard_stop);
        let report = World::new(plan).run();
        let done = exposed(&job.layers, &report.light, &report.shown, 1.0);
        Ok(Self { seed, job, faults, screen, hard_stop, thrown, report, done })
    }
}

impl Run {
    fn had(&self, kinds: &[Kind]) -> bool {
        self.faults.iter().any(|fault| kinds.contains(&fault.kind))
    }

    /// The first invariant that does not hold.
    fn wrong(&self) -> Option<String> {
        let (report, done) = (&self.report, &self.done);
        if !report.over {
            return Some(format!("1: it hangs in {:?}", report.state));
        }
        if let Some((_, text)) = done.too_long.first().filter(|_| self.excuse().is_none()) {
            return Some(format!("2: {text}"));
        }
        if let Some(text) = done.wrong.first() {
            return Some(format!("3: {text}"));
        }
        if report.state == State::Finished
            && self.excuse().is_none()
            && let Some(text) = done.whole(&self.job.layers, |layer| again(&report.told, layer)).first()
        {
            return Some(format!("4: {text}"));
        }
        let stats = &report.stats;
        if stats.crashes + stats.light_moved > 0 {
            return Some(format!("5: {} crashes, {} moves in the light", stats.crashes, stats.light_moved));
        }
        if let Some(wrong) = self.without_a_word() {
            return Some(wrong);
        }
        let torn = report.told.contains("in the middle of an exposure");
        let excused = self.starts_in_mid_job().count() > 0
            || torn
            || self.screen.fails.is_some()
            || self.had(&[Kind::Cancel, Kind::EmergencyStop, Kind::Halt]);
        if !excused && report.state != State::Finished {
            return Some(format!("7: it ends in {:?}: {:?}", report.state, report.outcome));
        }
        let told = matches!(report.outcome, Some(Outcome::Stopped { safety: Safety::Unknown, .. }))
            || report.told.contains("THE LIGHT MAY BE ON");
        if stats.light_on && !told && self.excuse().is_none() {
            return Some(format!("8: the light is on after {:?}", report.outcome));
        }
        None
    }

    /// Why an exposure may be too long.
    fn excuse(&self) -> Option<&'static str> {
        let tail = |d: &Executed| {
            d.number.is_none() && (d.command.starts_with("M106") || d.command.starts_with("G4 "))
        };
        match () {
            () if self.report.deeds.iter().any(tail) => Some("the tail of a line was executed"),
            () if self.had(&[Kind::Hang]) => Some("the board hung"),
            () if self.had(&[Kind::Halt]) && self.had(&DEAF) => Some("halted, and the host did not hear it"),
            () if self.had(&[Kind::Halt, Kind::EmergencyStop]) && !self.hard_stop => {
                Some("halted, and no reset")
            }
            () if self.had(&[Kind::Kill]) && self.report.mishaps > 0 => Some("killed while a line was lost"),
            () => None,
        }
    }

    /// Starts of the board after it had been sent a command of the job.
    fn starts_in_mid_job(&self) -> impl Iterator<Item = u64> {
        let begun_ns = self.report.begun_ns;
        let starts = self.report.starts_ns.iter().copied();
        starts.filter(move |at_ns| begun_ns.is_some_and(|begun_ns| *at_ns >= begun_ns))
    }

    /// 6: something after a start, and no person had said that all is clear.
    fn without_a_word(&self) -> Option<String> {
        let starts: Vec<_> = self.starts_in_mid_job().collect();
        let moves =
            self.report.deeds.iter().filter(|d| d.command.starts_with("G1") || d.command.starts_with("G28"));
        let moves = moves.map(|d| (d.at_ns, d.command.as_str()));
        let pulses = self.report.light.iter().map(|pulse| (pulse.begin.at_ns, "the light"));
        for (at_ns, what) in moves.chain(pulses) {
            let Some(since_ns) = starts.iter().copied().filter(|start| *start < at_ns).max() else {
                continue;
            };
            let said = self.report.confirmed_ns.iter().any(|at| (since_ns..=at_ns).contains(at));
            if !said {
                return Some(format!(
                    "6: {what} at {:.3} s, after a start at {:.3} s without a person's word",
                    at_ns as f64 / 1e9,
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
        tally.exposures += self.done.pulses_s.iter().map(|pulses| pulses.len() as u64).sum::<u64>();
        match self.done.too_long.first().and_then(|_| self.excuse()) {
            Some(why) => *tally.excused.entry(why).or_default() += 1,
            None => tally.longest = tally.longest.max(self.done.longest.unwrap_or(tally.longest)),
        }
        tally.mishaps += self.report.mishaps;
        tally.heirs += u64::from(self.report.processes - 1);
        tally.starts += self.starts_in_mid_job().count() as u64;
        tally.again += (0..self.job.layers.len() as u32)
            .map(|layer| again(&self.report.told, layer) as u64)
            .sum::<u64>();
        tally.simulated_s += self.report.ended_ns as f64 / 1e9;
        if let Some(text) = wrong {
            tally.failures.push(Failure { seed: self.seed, text });
        }
    }
}

/// Firmwares that a run may have: those of the mock's table that say `ok` when a line is done, as a
/// resin printer's must.
const FIRMWARES: [&str; 17] = [
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
];

/// Two to seven layers, each with times and ways of its own.
fn job(dice: &mut Dice) -> Job {
    let timing = *dice.pick(&[Timing::Controller, Timing::Controller, Timing::Pulse]);
    let mut z_mm = 0.0;
    let layers = (0..dice.between(2, 7)).map(|_| {
        z_mm += *dice.pick(&[0.025, 0.05, 0.1]);
        let way = |dice: &mut Dice| Way {
            mm: dice.between(10, 40) as f64 / 10.0,
            mm_min: dice.between(60, 300) as f64,
        };
        let none = |dice: &mut Dice, way: Way| if dice.chance(300) { Way::default() } else { way };
        let (lift, more) = (way(dice), way(dice));
        let lift = [lift, none(dice, more)];
        let up_mm = lift[0].mm + lift[1].mm;
        let slow = if dice.chance(300) { 0.0 } else { up_mm / 2.0 };
        Layer {
            z_mm,
            exposure_ms: dice.between(1_500, 4_000) as u32,
            power: dice.between(1, 255) as u8,
            lift,
            retract: [
                Way { mm: up_mm - slow, mm_min: dice.between(60, 300) as f64 },
                Way { mm: slow, mm_min: if slow > 0.0 { 60.0 } else { 0.0 } },
            ],
            settle_ms: dice.below(1_500) as u32,
            rest_ms: dice.below(1_000) as u32,
            top_ms: if dice.chance(300) { dice.below(1_000) as u32 } else { 0 },
        }
    });
    let layers = layers.collect();
    Job { layers, timing, homes_up: dice.chance(500) }
}

fn board(dice: &mut Dice, timing: Timing) -> Config {
    let name = *dice.pick::<&str>(&FIRMWARES);
    // Its buffer does not hold an exposure: such a profile is refused.
    let small = name == "rx-64" && timing != Timing::Pulse;
    let mut config = match Personality::find(name).filter(|_| !small) {
        Some(personality) => personality.config(),
        None => Config::default(),
    };
    config.baud = *dice.pick(&[115_200, 250_000]);
    config.dtr_reset = dice.chance(200);
    config
}

fn screen(dice: &mut Dice) -> ScreenPlan {
    let mut takes = |most_ms: u64| dice.below(most_ms * 1_000_000);
    let takes_ns = [takes(3_000), takes(100), takes(100)];
    let task = *dice.pick(&[Task::Load, Task::Show, Task::Blank]);
    let at = dice.between(1, 8) as u32;
    ScreenPlan { takes_ns, fails: dice.chance(80).then_some((task, at)) }
}

/// What keeps a host from hearing, or from being there.
const DEAF: [Kind; 4] = [Kind::Kill, Kind::Unplug, Kind::UnplugReset, Kind::HoldReplies];

/// Kinds with the thousandths of runs that have them.
const KINDS: [(Kind, u64); 16] = [
    (Kind::Kill, 300),
    (Kind::Kill, 150),
    (Kind::Unplug, 200),
    (Kind::Unplug, 50),
    (Kind::UnplugReset, 60),
    (Kind::Reset, 80),
    (Kind::PowerCut, 100),
    (Kind::Halt, 30),
    (Kind::Hang, 60),
    (Kind::Pause, 200),
    (Kind::Cancel, 80),
    (Kind::EmergencyStop, 30),
    (Kind::HoldReplies, 80),
    (Kind::Block, 80),
    (Kind::DiskSlow, 80),
    (Kind::DiskFails, 80),
];

fn faults(dice: &mut Dice, commands: u64, _timing: Timing) -> Vec<Fault> {
    let mut faults = Vec::new();
    for (kind, share) in KINDS {
        if !dice.chance(share) {
            continue;
        }
        // At a line, and then anywhere in what it takes.
        let mut fault = match dice.chance(900) {
            true => Fault::at_line(kind, dice.between(1, commands)),
            false => Fault::at_s(kind, dice.below(30_000) as f64 / 1000.0),
        };
        fault.after_s = match dice.below(3) {
            0 => dice.below(100_000) as f64 / 1e6,
            1 => dice.below(500) as f64 / 1000.0,
            _ => dice.below(5_000) as f64 / 1000.0,
        };
        let tenths = |dice: &mut Dice, most: u64| Some(dice.between(1, most) as f64 / 10.0);
        match kind {
            Kind::Kill => fault.for_s = tenths(dice, 300),
            Kind::Unplug | Kind::UnplugReset => fault.for_s = tenths(dice, 100),
            Kind::PowerCut => fault.for_s = tenths(dice, 600),
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
