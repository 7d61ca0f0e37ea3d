//! `outrigger mock`: the mock printer on a pseudo-terminal.
use crate::printer::mock::{self, Config, Cornering, Dynamics, Faults, Machine, Options, Personality, Stats};
use crate::profile::msla::Homes;
use crate::profile::{self, Fdm, Msla, Profile, printer};
use anyhow::Context;
use clap::Args as ClapArgs;
use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;
use tokio::signal::unix::{SignalKind, signal};

/// Between two looks at whether the mock's thread is still there.
const LOOK_EVERY: Duration = Duration::from_millis(500);

/// A mock printer: a strict Marlin on a pseudo-terminal, to try hosts on.
///
/// It checks line numbers and checksums as Marlin 2.1 does, loses bytes that
/// do not fit its receive buffer, executes moves in time and warms up. Any
/// host can open it; Ctrl-C ends it and removes the link. It knows where the nozzle
/// really is and what stands on the bed, and counts as a crash what would be one;
/// SIGUSR1 takes the part off the bed.
#[derive(ClapArgs)]
pub(super) struct Args {
    /// Make this symbolic link to the pseudo-terminal.
    #[arg(long, value_name = "PATH")]
    link: Option<PathBuf>,
    /// Write counts to this file as JSON, every second and at the end.
    #[arg(long, value_name = "FILE.json")]
    stats: Option<PathBuf>,
    /// Faults to happen at lines and times, as TOML (see --help-faults).
    #[arg(long, value_name = "FILE.toml")]
    faults: Option<PathBuf>,
    /// Print what a faults file may say, and end.
    #[arg(long)]
    help_faults: bool,
    /// Machine to imitate: speeds, accelerations, hottest temperatures, and
    /// baud and DTR reset unless they are given.
    #[arg(long, value_name = "NAME")]
    profile: Option<String>,
    /// Firmware to imitate (see --help-personalities).
    #[arg(long, value_name = "NAME", value_parser = personality)]
    personality: Option<&'static Personality>,
    /// Print the names of the firmwares, and end.
    #[arg(long)]
    help_personalities: bool,
    /// Write every command that was executed to this file, a line each: seconds, number,
    /// where the nozzle really is, whether it was broken off, the command.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Speed of the serial line, bits per second; 0 has no limit [default: 250000].
    #[arg(long, value_name = "N")]
    baud: Option<u32>,
    /// How many times faster than life moves, heaters and pauses are.
    #[arg(long, value_name = "K", default_value_t = 1.0, value_parser = speed)]
    speed: f64,
    /// Size of the receive buffer in bytes; what does not fit is lost [default: 128].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(64..=4096))]
    rx_bytes: Option<u32>,
    /// Moves that are planned ahead, and one (BLOCK_BUFFER_SIZE) [default: 16].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(2..=1024))]
    blocks: Option<u32>,
    /// Nozzles, each with a heater [default: 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=mock::EXTRUDERS_MAX as i64))]
    extruders: Option<u32>,
    /// How long replies are on their way after their last bit, in ms, as USB adapters
    /// hold them back.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=1000))]
    latency_ms: u32,
    /// Say the free places in each ok: `ok N1 P15 B3`.
    #[arg(long)]
    advanced_ok: bool,
    /// Leave M108, M112 and M410 in the queue with everything else.
    #[arg(long)]
    no_emergency_parser: bool,
    /// Reset the board when the port is opened, as many boards do.
    #[arg(long)]
    dtr_reset: bool,
    /// With --dtr-reset: only when it is opened for the first time, or was last closed
    /// with HUPCL set, as on a real port, whose DTR else stays up.
    #[arg(long, requires = "dtr_reset")]
    keeps_dtr: bool,
}

/// One of the table, or what to do.
fn personality(name: &str) -> Result<&'static Personality, String> {
    Personality::find(name).ok_or_else(|| {
        let names = mock::PERSONALITIES.iter().map(|p| p.name);
        let near = profile::nearest(name, names).map(|n| format!("did you mean {n}? "));
        format!("{}--help-personalities lists all", near.unwrap_or_default())
    })
}

/// Slower than a hundredth or faster than a hundred thousand times is a slip.
pub(crate) fn speed(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(k) if (0.01..=100_000.0).contains(&k) => Ok(k),
        _ => Err("a number from 0.01 to 100000".to_owned()),
    }
}

/// Runs the verb until a signal ends it.
///
/// # Errors
/// A profile or faults file that cannot be read, no pseudo-terminal, or a
/// link or statistics file that cannot be written.
pub(super) fn run(args: Args) -> anyhow::Result<ExitCode> {
    let help = match (args.help_faults, args.help_personalities) {
        (true, _) => Some(mock::faults::HELP.to_owned()),
        (_, true) => Some(mock::personalities_help()),
        _ => None,
    };
    if let Some(help) = help {
        std::io::stdout().write_all(help.as_bytes()).context("cannot write to standard output")?;
        return Ok(ExitCode::SUCCESS);
    }
    let options = options(&args)?;
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .context("cannot start the runtime")?;
    let stats = runtime.block_on(async {
        // Before the link is there: who sees it may already send the signal.
        let mut interrupt = signal(SignalKind::interrupt())?;
        let mut terminate = signal(SignalKind::terminate())?;
        let mut hang_up = signal(SignalKind::hangup())?;
        let mut remove = signal(SignalKind::user_defined1())?;
        let handle = mock::spawn(options)?;
        announce(&handle)?;
        while handle.is_running() {
            tokio::select! {
                _ = interrupt.recv() => break,
                _ = terminate.recv() => break,
                _ = hang_up.recv() => break,
                _ = remove.recv() => handle.remove_part(),
                () = tokio::time::sleep(LOOK_EVERY) => {}
            }
        }
        anyhow::Ok(handle.stop()?)
    })?;
    eprintln!("{}", summary(&stats));
    Ok(ExitCode::SUCCESS)
}

fn options(args: &Args) -> anyhow::Result<Options> {
    let profile = args.profile.as_deref().map(profile::load_printer).transpose()?;
    let faults = match &args.faults {
        None => Faults::default(),
        Some(file) => {
            let text = std::fs::read_to_string(file).with_context(|| format!("{}", file.display()))?;
            Faults::parse(&text).with_context(|| format!("{}", file.display()))?
        }
    };
    let mut config = Config::default();
    if let Some(personality) = args.personality {
        personality.apply(&mut config);
    }
    config.speed = args.speed;
    config.advanced_ok |= args.advanced_ok;
    config.emergency_parser &= !args.no_emergency_parser;
    config.dtr_reset = args.dtr_reset;
    config.keeps_dtr = args.keeps_dtr;
    config.latency_ns = u64::from(args.latency_ms) * 1_000_000;
    if let Some(profile) = &profile {
        // Of the machine, what the personality says stays.
        let own = config.machine;
        let Machine { extruders, chamber, levelling, .. } = own;
        config.machine = Machine { extruders, chamber, levelling, ..machine(profile) };
        config.baud = profile.serial.baud;
        config.dtr_reset |= profile.serial.dtr_reset;
    }
    set(&mut config.rx_bytes, args.rx_bytes);
    set(&mut config.blocks, args.blocks);
    set(&mut config.machine.extruders, args.extruders);
    if let Some(baud) = args.baud {
        config.baud = baud;
    }
    Ok(Options { link: args.link.clone(), stats: args.stats.clone(), log: args.log.clone(), faults, config })
}

fn set(value: &mut usize, given: Option<u32>) {
    if let Some(given) = given {
        *value = given as usize;
    }
}

/// The machine of a profile, as the mock wants it: plain numbers.
pub(crate) fn machine(profile: &Profile) -> Machine {
    match &profile.kind {
        printer::Kind::Fdm(fdm) => of_filament(&profile.title, fdm),
        printer::Kind::Msla(msla) => of_resin(profile, msla),
    }
}

/// Its plate is Z; what else the mock has of a machine stands still and cold.
fn of_resin(profile: &Profile, msla: &Msla) -> Machine {
    let cutter =
        msla.light.on.lines().any(|line| ["M3", "M4"].contains(&line.split(' ').next().unwrap_or_default()));
    let own = Machine::resin(mock::ResinMachine {
        homes_up: msla.plate.homes == Homes::Up,
        z_max_mm: profile.bed.z_mm.0,
        light: if cutter { mock::LightPin::Cutter } else { mock::LightPin::Fan },
    });
    let [x, y, _, e] = own.dynamics.max_feed_mm_s;
    let [ax, ay, _, ae] = own.dynamics.max_accel_mm_s2;
    let accel_mm_s2 = msla.plate.accel_mm_s2.0;
    Machine {
        name: profile.title.clone(),
        dynamics: Dynamics {
            max_feed_mm_s: [x, y, msla.plate.max_mm_min.0 / 60.0, e],
            max_accel_mm_s2: [ax, ay, accel_mm_s2, ae],
            print_mm_s2: accel_mm_s2,
            travel_mm_s2: accel_mm_s2,
            ..own.dynamics
        },
        ..own
    }
}

fn of_filament(title: &str, fdm: &Fdm) -> Machine {
    let motion = &fdm.motion;
    let (feed, accel) = (motion.max_feed_mm_s, motion.max_accel_mm_s2);
    let cornering = match motion.cornering {
        printer::Cornering::JerkMmS(jerk) => Cornering::JerkMmS(jerk.0),
        printer::Cornering::JunctionMm(deviation) => Cornering::JunctionMm(deviation.0),
        // Klipper derives its junction deviation from the speed through a
        // right angle: v²·(√2 − 1)/a.
        printer::Cornering::SquareCornerMmS(v) => {
            Cornering::JunctionMm(v.0 * v.0 * (std::f64::consts::SQRT_2 - 1.0) / motion.print_mm_s2.0)
        }
    };
    Machine {
        name: title.to_owned(),
        dynamics: Dynamics {
            max_feed_mm_s: [feed.x.0, feed.y.0, feed.z.0, feed.e.0],
            max_accel_mm_s2: [accel.x.0, accel.y.0, accel.z.0, accel.e.0],
            print_mm_s2: motion.print_mm_s2.0,
            travel_mm_s2: motion.travel_mm_s2.0,
            retract_mm_s2: motion.retract_mm_s2.0,
            cornering,
        },
        nozzle_max_c: fdm.limits.nozzle_c.0,
        bed_max_c: fdm.limits.bed_c.0,
        ..Machine::default()
    }
}

/// The path on standard output, alone on its line, for scripts that wait for it.
fn announce(handle: &mock::Handle) -> anyhow::Result<()> {
    let mut out = std::io::stdout();
    writeln!(out, "{}", handle.path().display())
        .and_then(|()| out.flush())
        .context("cannot write to standard output")
}

fn summary(stats: &Stats) -> String {
    let light = match stats.light_pulses {
        0 => String::new(),
        pulses => format!("; {pulses} pulses of light, {:.1} s", stats.light_s),
    };
    format!(
        "mock printer: {} lines, {} moves, {:.1} mm of filament in {:.1} s; \
         {} resends, {} bytes lost, planner empty {:.1} % of the time{light}",
        stats.lines_accepted,
        stats.moves,
        stats.extruded_mm,
        stats.real_s,
        stats.resends_asked,
        stats.overflow_bytes,
        100.0 * stats.planner_empty_share
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_profiles_numbers_reach_the_machine() {
        let profile = profile::load_printer("prusa-mk3s").unwrap();
        let machine = machine(&profile);
        assert_eq!(machine.dynamics.max_feed_mm_s, [200.0, 200.0, 12.0, 120.0]);
        assert_eq!(machine.dynamics.cornering, Cornering::JerkMmS(8.0));
        assert_eq!(machine.nozzle_max_c, 300.0);
        let profile = profile::load_printer("generic-msla").unwrap();
        let machine = super::machine(&profile);
        assert_eq!((machine.dynamics.max_feed_mm_s[2], machine.dynamics.max_accel_mm_s2[2]), (5.0, 100.0));
        assert_eq!((machine.nozzle_max_c, machine.bed_max_c), (0.0, 0.0));
    }

    #[test]
    fn speeds_are_bounded() {
        assert_eq!(speed("10"), Ok(10.0));
        for wrong in ["0", "-1", "nan", "inf", "x", "1e9"] {
            assert!(speed(wrong).is_err(), "{wrong}");
        }
    }
}
