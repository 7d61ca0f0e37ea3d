//! `outrigger-hil`: plays the scenarios through the real program.
//!
//! Takes flags, prints a line a scenario. Two other programs live in this binary, so that one
//! build has all: the watchdog, and, where [`RUNS_AS`] is set, `outrigger` itself.
use anyhow::Context;
use clap::{Parser, Subcommand};
use outrigger_hil::play;
use outrigger_hil::rig::program::{Installed, RUNS_AS};
use outrigger_hil::rig::skips::skips;
use outrigger_hil::rig::suite::{Place, Suite, Tally};
use outrigger_hil::rig::target::Octoprint;
use outrigger_hil::rig::verdict::Verdict;
use outrigger_hil::rig::{self, Rig, watchdog};
use outrigger_hil::scenario::{self, Scenario};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Instant;

/// Scenarios at a time where each has a printer of its own.
const AT_A_TIME: usize = 8;

/// Names the Python that has the package `octoprint`.
const PYTHON: &str = "OUTRIGGER_OCTOPRINT_PYTHON";

/// Names the script that puts OctoPrint's virtual printer on a pseudo-terminal.
const SCRIPT: &str = "OUTRIGGER_OCTOPRINT_SCRIPT";

/// Play the scenarios of tests/scenarios through the real program
///
/// With no port, they are played against the mock printer over a pseudo-terminal, and against
/// OctoPrint's virtual printer where a Python with the package `octoprint` is found. With
/// --port, on a real printer: it HEATS, HOMES AND MOVES. Read hil/README.md before. A watchdog
/// process makes the printer safe when this one dies, hangs, takes too long, or the printer
/// becomes too hot.
///
/// Exit codes: 0 all that was played holds; 1 something does not, or could not be played; 2
/// wrong usage.
#[derive(Parser)]
#[command(name = "outrigger-hil", version)]
struct Args {
    /// A real printer's port, such as /dev/ttyUSB0 or a link of /dev/serial/by-id.
    #[arg(long, value_name = "DEV", requires = "rig", conflicts_with_all = ["octoprint", "mock"])]
    port: Option<PathBuf>,
    /// What the printer is, and what may be done to it (see --help-rigs).
    #[arg(long, value_name = "FILE.toml", requires = "port")]
    rig: Option<PathBuf>,
    /// Do not ask before the real printer heats and moves.
    #[arg(long, requires = "port")]
    yes: bool,
    /// Against the mock alone.
    #[arg(long, conflicts_with = "octoprint")]
    mock: bool,
    /// In the virtual world instead: no program, no terminal, and hours in a moment.
    #[arg(long, conflicts_with_all = ["port", "mock", "octoprint"])]
    virtual_clock: bool,
    /// Against OctoPrint's virtual printer alone, by this Python [default:
    /// $OUTRIGGER_OCTOPRINT_PYTHON or python3].
    #[arg(long, value_name = "PYTHON", num_args = 0..=1)]
    octoprint: Option<Option<PathBuf>>,
    /// The script that puts OctoPrint's virtual printer on a pseudo-terminal [default:
    /// $OUTRIGGER_OCTOPRINT_SCRIPT or ../shared/peers/virtual_printer_pty.py beside the repository].
    #[arg(long, value_name = "FILE.py")]
    script: Option<PathBuf>,
    /// Only scenarios whose name begins so; may be given several times.
    #[arg(long, value_name = "NAME")]
    only: Vec<String>,
    /// Say what would be played and what skipped, and end.
    #[arg(long)]
    list: bool,
    /// Scenarios at a time, where each has a printer of its own [default: 8].
    #[arg(long, value_name = "N")]
    jobs: Option<usize>,
    /// Show so many last lines of what was said where something does not hold.
    #[arg(long, value_name = "N", default_value_t = 0)]
    lines: usize,
    /// The folder of the scenarios [default: the repository's].
    #[arg(long, value_name = "DIR")]
    scenarios: Option<PathBuf>,
    /// Another `outrigger` than the one that was built with this.
    #[arg(long, value_name = "PATH")]
    program: Option<PathBuf>,
    /// Print what a scenario's file may say, and end.
    #[arg(long)]
    help_scenarios: bool,
    /// Print what a rig's file may say, and end.
    #[arg(long)]
    help_rigs: bool,
    #[command(subcommand)]
    verb: Option<Verb>,
}

#[derive(Subcommand)]
enum Verb {
    /// Make a printer safe when its runner dies (started by the runner itself).
    #[command(hide = true)]
    Watchdog {
        #[arg(long)]
        port: PathBuf,
        #[arg(long)]
        baud: u32,
        #[arg(long)]
        rig: Option<PathBuf>,
        /// The process to kill before anything else is done.
        #[arg(long)]
        runner: u32,
    },
}

fn main() -> ExitCode {
    if std::env::var_os(RUNS_AS).is_some() {
        // A guardian outlives its starter; anything else here must not outlive the rig.
        if std::env::args().nth(1).is_none_or(|verb| verb != "guard") {
            let kill = Some(rustix::process::Signal::KILL);
            let _ = rustix::process::set_parent_process_death_signal(kill);
        }
        return outrigger::cli::main();
    }
    match run(&Args::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("outrigger-hil: {error:#}");
            ExitCode::from(1)
        }
    }
}

fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(Verb::Watchdog { port, baud, rig, runner }) = &args.verb {
        let rig = rig.as_deref().map_or_else(|| Ok(Rig::mock()), Rig::load)?;
        let acted = watchdog::watch(port, *baud, &rig, *runner)?;
        return Ok(ExitCode::from(if acted { watchdog::ACTED } else { 0 }));
    }
    if args.help_scenarios || args.help_rigs {
        say(if args.help_rigs { rig::HELP } else { scenario::HELP }.trim_end());
        return Ok(ExitCode::SUCCESS);
    }
    let root = root();
    let scenarios = scenarios(args, &root)?;
    if args.virtual_clock {
        let holds = virtually(&scenarios, &root, args.lines);
        return Ok(ExitCode::from(u8::from(!holds)));
    }
    let rig = args.rig.as_deref().map_or_else(|| Ok(Rig::mock()), Rig::load)?;
    let hil = std::env::current_exe().context("cannot find this program")?;
    let installed = match &args.program {
        Some(path) => Installed { path: path.clone(), is_hil: false },
        None => Installed { path: hil.clone(), is_hil: true },
    };
    let mut all = Tally::default();
    for place in places(args, &root) {
        let place = match place {
            Ok(place) => place,
            Err(why) => {
                say(&why);
                continue;
            }
        };
        let real = args.port.is_some();
        let suite = Suite {
            place,
            rig: &rig,
            rig_file: args.rig.as_deref(),
            installed: &installed,
            hil: &hil,
            root: &root,
            at_a_time: if real { 1 } else { args.jobs.unwrap_or(AT_A_TIME) },
        };
        if args.list {
            list(&suite, &scenarios);
            continue;
        }
        if real && !args.yes && !agreed(&suite, &scenarios)? {
            anyhow::bail!("nothing was done");
        }
        let tally = on_the_rig(&suite, &scenarios, args.lines);
        all.broken += tally.broken;
    }
    Ok(ExitCode::from(u8::from(all.broken > 0)))
}

/// The repository: where this crate's sources are.
fn root() -> PathBuf {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    root.canonicalize().unwrap_or(root)
}

/// Those that are asked for, sweeps unrolled.
fn scenarios(args: &Args, root: &Path) -> anyhow::Result<Vec<Scenario>> {
    let folder = args.scenarios.clone().unwrap_or_else(|| root.join("tests/scenarios"));
    let all = Scenario::load_all(&folder)?;
    let mut all: Vec<_> = all.iter().flat_map(Scenario::unroll).collect();
    let wanted =
        |s: &Scenario| args.only.is_empty() || args.only.iter().any(|o| s.name.starts_with(o.as_str()));
    all.retain(wanted);
    anyhow::ensure!(!all.is_empty(), "{}: no scenario of that name", folder.display());
    Ok(all)
}

/// What is to be played on; the words for what is not to be had.
fn places(args: &Args, root: &Path) -> Vec<Result<Place, String>> {
    if let Some(port) = &args.port {
        return vec![Ok(Place::Real(port.clone()))];
    }
    if args.mock {
        return vec![Ok(Place::Mock)];
    }
    let octoprint = octoprint(args, root).map(Place::Virtual);
    match args.octoprint {
        Some(_) => vec![octoprint],
        None => vec![Ok(Place::Mock), octoprint],
    }
}

/// OctoPrint's virtual printer, if it is there.
fn octoprint(args: &Args, root: &Path) -> Result<Octoprint, String> {
    let named =
        |flag: Option<PathBuf>, name: &str| flag.or_else(|| std::env::var_os(name).map(PathBuf::from));
    let python = named(args.octoprint.clone().flatten(), PYTHON).unwrap_or_else(|| "python3".into());
    let script = named(args.script.clone(), SCRIPT)
        .unwrap_or_else(|| root.join("../shared/peers/virtual_printer_pty.py"));
    let skipped = |why: String| Err(format!("octoprint: skipped: {why}"));
    if !script.is_file() {
        return skipped(format!("{} is not there (--script names it)", script.display()));
    }
    let has = Command::new(&python)
        .args(["-c", "import octoprint.plugins.virtual_printer"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    match has {
        Ok(status) if status.success() => Ok(Octoprint { python, script }),
        Ok(_) => skipped(format!("{} has no package octoprint", python.display())),
        Err(e) => skipped(format!("{}: {e}", python.display())),
    }
}

/// What a place is called in the lines.
fn called(place: &Place) -> String {
    match place {
        Place::Mock => "mock".to_owned(),
        Place::Virtual(_) => "octoprint".to_owned(),
        Place::Real(port) => port.display().to_string(),
    }
}

fn list(suite: &Suite<'_>, scenarios: &[Scenario]) {
    let name = called(&suite.place);
    for scenario in scenarios {
        match skips(scenario, suite.place.sort(), suite.rig) {
            Some(why) => say(&format!("{name}: {}: skipped: {why}", scenario.name)),
            None => say(&format!("{name}: {}: {}", scenario.name, scenario.title)),
        }
    }
}

fn on_the_rig(suite: &Suite<'_>, scenarios: &[Scenario], lines: usize) -> Tally {
    let (name, started) = (called(&suite.place), Instant::now());
    let tally = suite.play(scenarios, |scenario, came| {
        let head = format!("{name}: {}", scenario.name);
        match came {
            Ok(Verdict::Holds { took_s }) => say(&format!("{head}: holds ({took_s:.1} s)")),
            Ok(Verdict::Skipped(why)) => say(&format!("{head}: skipped: {why}")),
            Ok(Verdict::Broken { wrong, transcript }) => {
                say(&format!("{head}: DOES NOT HOLD: {}", wrong.join("; ")));
                for line in transcript.iter().skip(transcript.len().saturating_sub(lines + 1)).take(lines + 1)
                {
                    if lines > 0 {
                        say(line);
                    }
                }
            }
            Err(why) => say(&format!("{head}: DOES NOT HOLD: {why:#}")),
        }
    });
    let Tally { hold, broken, skipped } = tally;
    let took_s = started.elapsed().as_secs_f64();
    say(&format!("{name}: {hold} hold, {broken} do not, {skipped} were skipped, in {took_s:.0} s"));
    tally
}

/// Plays them on the virtual clock; whether all hold.
fn virtually(scenarios: &[Scenario], root: &Path, lines: usize) -> bool {
    let mut broken = 0;
    for scenario in scenarios {
        let complaint = match play::play(scenario, root) {
            Ok(played) => played.complaint(lines),
            Err(why) => Some(format!("{why:#}")),
        };
        let head = format!("virtual clock: {}", scenario.name);
        match complaint {
            None => say(&format!("{head}: holds")),
            Some(why) => {
                broken += 1;
                say(&format!("{head}: DOES NOT HOLD: {}", why.trim_end()));
            }
        }
    }
    say(&format!("virtual clock: {} hold, {broken} do not", scenarios.len() - broken));
    broken == 0
}

/// Tells what will happen to the real printer, and waits for a yes.
fn agreed(suite: &Suite<'_>, scenarios: &[Scenario]) -> anyhow::Result<bool> {
    let Rig { title, limits, lift_mm, power_off, .. } = suite.rig;
    let playable = |s: &&Scenario| skips(s, suite.place.sort(), suite.rig).is_none();
    let count = scenarios.iter().filter(playable).count();
    say(&format!(
        "{title} on {}: {count} scenarios, one after the other. Each HEATS nozzle and bed, HOMES, and makes \
         small moves {lift_mm} mm above the bed; some stop the printer with M112 or pull its plug{}. A watchdog \
         allows {} °C at the nozzle, {} °C at the bed and {} s a scenario. The bed must be empty and the \
         filament out, and somebody must stay beside it.",
        called(&suite.place),
        if power_off.is_some() { " or its power" } else { "" },
        limits.nozzle_c,
        limits.bed_c,
        limits.scenario_s,
    ));
    write!(std::io::stdout(), "Type yes to begin: ")?;
    std::io::stdout().flush()?;
    let mut word = String::new();
    std::io::stdin().read_line(&mut word)?;
    Ok(word.trim() == "yes")
}

/// A line on standard output; a reader that has gone away is no error.
fn say(text: &str) {
    let _ = writeln!(std::io::stdout(), "{text}");
}
