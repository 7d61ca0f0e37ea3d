//! A scenario in the virtual world: from the file to the verdict.
//!
//! Takes a [`Scenario`], gives what came of it or the first thing that does not hold, with
//! the tail of the transcript.
use crate::judge::resin::Exposed;
use crate::judge::{Executed, executed};
use crate::resin;
use crate::scenario::{End, Expect, Heaters, Names, ResinJob, Scenario, TimedBy};
use crate::world::disk::DiskPlan;
use crate::world::source::Commands;
use crate::world::wire::Chances;
use crate::world::{Plan, Report, User, World};
use outrigger::job::host::HostSettings;
use outrigger::job::state::State;
use outrigger::printer::exposure::script::Timing;
use outrigger::printer::mock::{Config, Faults, Personality};
use outrigger::printer::session::DEFAULT_BOOT_WAIT_MS;
use outrigger::printer::window::Limit;
use outrigger::profile::{self, Profile};
use std::path::Path;

/// The profile when a scenario names none.
pub const DEFAULT_PROFILE: &str = "ender-3";

/// A simulated run that takes longer hangs: two hours are many times what any job
/// here lasts, its longest heating included.
const LIMIT_NS: u64 = 2 * 3_600_000_000_000;

/// Longest time without a new command of the job when a scenario says nothing: heating
/// and homing.
const STALL_S: f64 = 400.0;

/// Lines of the transcript that a failure shows where nothing else is said.
pub const TAIL_LINES: usize = 60;

/// Time of one sync where the disk is well, ns.
const SYNC_NS: u64 = 8_000_000;

/// Listening for `start` where opening the port does not reset the board, ms.
const NO_RESET_WAIT_MS: u64 = 50;

/// What a scenario was found to do.
#[derive(Debug)]
pub struct Played {
    /// What came of it.
    pub report: Report,
    /// What the board executed of the job.
    pub executed: Executed,
    /// What does not hold.
    pub wrong: Vec<String>,
}

impl Played {
    /// What does not hold, and the last so many lines of the transcript.
    pub fn complaint(&self, lines: usize) -> Option<String> {
        if self.wrong.is_empty() {
            return None;
        }
        let skip = self.report.transcript.len().saturating_sub(lines);
        let tail: Vec<_> = self.report.transcript.iter().skip(skip).map(String::as_str).collect();
        Some(format!("{}\n{}", self.wrong.join("\n"), tail.join("\n")))
    }
}

/// Plays one scenario, sweeps unrolled. `root` is the repository.
///
/// # Errors
/// It cannot be played at all: no such profile, personality or corpus file.
pub fn play(scenario: &Scenario, root: &Path) -> anyhow::Result<Played> {
    if let Some(job) = scenario.job.resin {
        return play_resin(scenario, job);
    }
    let name = scenario.printer.profile.as_deref().unwrap_or(DEFAULT_PROFILE);
    let profile = profile::load_printer(name)?;
    let text = scenario.job.text(root)?.text;
    let commands = Commands::of(&text);
    let noise = scenario.noise;
    let chances =
        |corrupt, lose| Chances { corrupt, lose, split: noise.split, delay_ns: noise.delay_ms * 1_000_000 };
    let printer = &scenario.printer;
    let mut config = match &printer.personality {
        Some(Names::One(name)) => personality(name)?,
        _ => Config::default(),
    };
    config.speed = printer.speed.unwrap_or(1.0);
    config.dtr_reset |= printer.dtr_reset;
    let mut settings = settings(&profile, config.dtr_reset);
    if let Some(lines) = printer.window_lines {
        settings.session.window = Limit::Lines(lines);
    }
    if let Some(refusal) = refusal(&text, &settings) {
        return Ok(refused(scenario, refusal));
    }
    let config_resets = config.dtr_reset;
    let plan = Plan {
        commands: commands.clone(),
        resin: None,
        settings,
        config,
        board: Faults::default(),
        out: chances(noise.corrupt_line, noise.lose_line),
        back: chances(noise.corrupt_reply, noise.lose_reply),
        disk: DiskPlan { sync_ns: SYNC_NS },
        faults: scenario.fault.clone(),
        user: User::default(),
        hard_stop: printer.hard_stop || config_resets,
        seed: noise.seed,
        limit_ns: LIMIT_NS,
        transcript: true,
        watch_heat: scenario.expect.cold_s.is_some(),
    };
    let report = World::new(plan).run();
    let executed = executed(&commands, &report.deeds, &report.starts_ns);
    let wrong = judge(&scenario.expect, &commands, &report, &executed);
    Ok(Played { report, executed, wrong })
}

/// The same of a resin job.
fn play_resin(scenario: &Scenario, job: ResinJob) -> anyhow::Result<Played> {
    let timing = match job.timed_by {
        TimedBy::Controller => Timing::Controller,
        TimedBy::Pulse => Timing::Pulse,
        TimedBy::Host => Timing::Host,
    };
    let exposure_ms = (job.exposure_s * 1e3).round() as u32;
    let job = resin::Job { homes_up: job.homes_up, ..resin::Job::of(job.layers, exposure_ms, timing) };
    let mut plan = job.plan(scenario.fault.clone())?;
    let (noise, printer) = (scenario.noise, &scenario.printer);
    let chances =
        |corrupt, lose| Chances { corrupt, lose, split: noise.split, delay_ns: noise.delay_ms * 1_000_000 };
    (plan.out, plan.back) =
        (chances(noise.corrupt_line, noise.lose_line), chances(noise.corrupt_reply, noise.lose_reply));
    let mut config = match &printer.personality {
        Some(Names::One(name)) => personality(name)?,
        _ => Config::default(),
    };
    config.baud = plan.config.baud;
    config.speed = printer.speed.unwrap_or(1.0);
    config.dtr_reset |= printer.dtr_reset;
    plan.config = job.board(config)?;
    plan.settings = job.settings(&plan.config)?;
    if let Some(lines) = printer.window_lines {
        plan.settings.session.window = Limit::Lines(lines);
    }
    plan.hard_stop = printer.hard_stop || plan.config.dtr_reset;
    plan.user = User::default();
    plan.seed = noise.seed;
    plan.limit_ns = LIMIT_NS;
    plan.transcript = true;
    let (report, done) = job.print(plan);
    let wrong = judge_resin(&scenario.expect, &job, &report, &done);
    Ok(Played { report, executed: Executed::default(), wrong })
}

/// What of the expectations concerns a resin job, and all that must always hold of one.
fn judge_resin(expect: &Expect, job: &resin::Job, report: &Report, done: &Exposed) -> Vec<String> {
    let mut wrong = done.wrong.clone();
    wrong.extend(done.too_long.iter().map(|(_, text)| text.clone()));
    let mut hold = |holds: bool, what: String| {
        if !holds {
            wrong.push(what);
        }
    };
    let (state, stats) = (report.state, &report.stats);
    hold(report.over, format!("it hangs in {state:?}"));
    let ends = end_of(state) == Some(expect.outcome);
    hold(ends, format!("it ends in {state:?} ({:?}), not {:?}", report.outcome, expect.outcome));
    hold(report.fresh == 1, format!("the job was begun {} times", report.fresh));
    hold(!stats.light_on, "the light is on at the end".to_owned());
    hold(stats.crashes == 0, format!("the plate crashed {} times", stats.crashes));
    hold(stats.light_moved == 0, format!("the plate moved in the light {} times", stats.light_moved));
    if let Some(boots) = expect.boots {
        let starts = report.starts_ns.len() as u64;
        hold(starts == boots, format!("the board started {starts} times, not {boots}"));
    }
    if let Some(over_s) = expect.over_s {
        let took_s = (report.ended_ns - report.fault_ns.unwrap_or_default()) as f64 / 1e9;
        hold(took_s <= over_s, format!("from the fault to the end it took {took_s:.2} s, not {over_s}"));
    }
    if expect.outcome == End::Finished {
        wrong.extend(done.whole(&job.layers, |layer| resin::again(&report.told, layer)));
    }
    wrong.extend(commands_missing(expect, report));
    wrong.extend(not_told(expect, &report.told));
    wrong
}

/// A board by the name of its personality.
///
/// # Errors
/// There is none of that name.
pub fn personality(name: &str) -> anyhow::Result<Config> {
    let found = Personality::find(name).map(Personality::config);
    found.ok_or_else(|| anyhow::anyhow!("there is no personality {name:?}"))
}

/// What a host needs of a profile. Without `resets`, opening the port does not reset the board.
pub fn settings(profile: &Profile, resets: bool) -> HostSettings {
    let mut settings = outrigger::cli::host_settings(profile, true);
    settings.session.boot_wait_ms = if resets { DEFAULT_BOOT_WAIT_MS } else { NO_RESET_WAIT_MS };
    settings
}

/// Why a job is not begun, as `outrigger print` finds it before it opens the port.
fn refusal(text: &str, settings: &HostSettings) -> Option<String> {
    outrigger::printer::job_file::check(text.as_bytes(), settings.session.max_line, |_, _| {})
        .err()
        .map(|e| e.to_string())
}

/// A job that is not begun: nothing was said to any printer.
fn refused(scenario: &Scenario, refusal: String) -> Played {
    let plan = Plan {
        commands: Commands::of(""),
        resin: None,
        settings: HostSettings::default(),
        config: Config::default(),
        board: Faults::default(),
        out: Chances::default(),
        back: Chances::default(),
        disk: DiskPlan { sync_ns: SYNC_NS },
        faults: Vec::new(),
        user: User::default(),
        hard_stop: false,
        seed: 0,
        limit_ns: 0,
        transcript: false,
        watch_heat: false,
    };
    let report = World::new(plan).unused(refusal);
    let mut wrong = Vec::new();
    if scenario.expect.outcome != End::Refused {
        wrong.push(format!("it was refused: {}", report.told));
    }
    wrong.extend(not_told(&scenario.expect, &report.told));
    Played { report, executed: Executed::default(), wrong }
}

fn not_told(expect: &Expect, told: &str) -> Vec<String> {
    let lower = told.to_lowercase();
    let missing = expect.told.iter().filter(|words| !lower.contains(&words.to_lowercase()));
    missing.map(|words| format!("the user was not told of {words:?}")).collect()
}

/// All that must hold; what does not.
pub fn judge(expect: &Expect, commands: &Commands, report: &Report, done: &Executed) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut hold = |holds: bool, what: String| {
        if !holds {
            wrong.push(what);
        }
    };
    let seconds = |ns: u64| ns as f64 / 1e9;
    hold(report.over, format!("it hangs in {:?}", report.state));
    let end = end_of(report.state);
    hold(
        end == Some(expect.outcome),
        format!("it ends in {:?} ({:?}), not {:?}", report.state, report.outcome, expect.outcome),
    );
    if let Some(text) = &done.wrong {
        hold(false, text.clone());
    }
    if expect.outcome == End::Finished {
        hold(
            done.through == commands.len(),
            format!("{} of {} commands were executed", done.through, commands.len()),
        );
    }
    hold(
        done.twice as u64 <= expect.twice_at_most,
        format!("{} commands were executed twice, {} at most were to be", done.twice, expect.twice_at_most),
    );
    // One at most for each line that was damaged.
    hold(
        done.torn as u64 <= report.stats.resends_asked,
        format!("{} tails of lines were executed", done.torn),
    );
    hold(report.fresh == 1, format!("the job was begun {} times", report.fresh));
    if expect.outcome != End::Interrupted && expect.heaters == Heaters::Off {
        let stats = &report.stats;
        hold(
            !stats.heaters_on || expect.outcome == End::Finished,
            format!("heaters are on at the end: {} and {} °C", stats.nozzle_target_c, stats.bed_target_c),
        );
    }
    hold(report.stats.crashes == 0, format!("the nozzle crashed {} times", report.stats.crashes));
    hold(report.stats.moved_cold == 0, "the nozzle moved while it stuck to the part".to_owned());
    let stall_s = expect.stall_s.unwrap_or(STALL_S);
    hold(
        seconds(report.stall_ns) <= stall_s,
        format!("nothing new went out for {:.2} s, {stall_s} s at most were to be", seconds(report.stall_ns)),
    );
    let fault_ns = report.fault_ns.unwrap_or_default();
    if let Some(over_s) = expect.over_s {
        let took_s = seconds(report.ended_ns - fault_ns);
        hold(took_s <= over_s, format!("from the fault to the end it took {took_s:.2} s, not {over_s}"));
    }
    if let Some(cold_s) = expect.cold_s {
        let took_s = report.cold_ns.map(|at| seconds(at - fault_ns));
        hold(
            took_s.is_some_and(|t| t <= cold_s),
            format!("from the fault to heaters off it took {took_s:?} s, not {cold_s}"),
        );
    }
    if let Some(boots) = expect.boots {
        let starts = u64::from(done.starts);
        hold(starts == boots, format!("the board started {starts} times, not {boots}"));
    }
    if let Some(none_after) = expect.none_after {
        let through = done.through as u64;
        hold(through <= none_after, format!("{through} commands were executed, {none_after} were to be"));
    }
    wrong.extend(commands_missing(expect, report));
    wrong.extend(not_told(expect, &report.told));
    wrong
}

fn end_of(state: State) -> Option<End> {
    match state {
        State::Finished => Some(End::Finished),
        State::Cancelled => Some(End::Cancelled),
        State::Failed => Some(End::Failed),
        State::Interrupted => Some(End::Interrupted),
        _ => None,
    }
}

fn commands_missing(expect: &Expect, report: &Report) -> Option<String> {
    let mut took = report.deeds.iter();
    let missing = expect.commands.iter().find(|c| !took.any(|t| t.command == **c))?;
    Some(format!("the board did not get {missing:?} (in this order)"))
}
