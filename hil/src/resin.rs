//! Resin jobs for the virtual world, with the host and the board that print them.
//!
//! Takes how many layers, who keeps an exposure's time and where the plate's switch is; gives the
//! lines, the settings and the board as the program makes them of the built-in profile.
use crate::judge::resin::{Exposed, exposed};
use crate::scenario::Fault;
use crate::world::disk::DiskPlan;
use crate::world::plate::{Resin, ScreenPlan};
use crate::world::source::Commands;
use crate::world::wire::Chances;
use crate::world::{Plan, Report, User, World};
use outrigger::job::host::HostSettings;
use outrigger::printer::exposure::script::{Layer, Script, Timing, Way};
use outrigger::printer::mock::{Config, Dynamics, Faults, LightPin, Machine, ResinMachine};
use outrigger::profile::{Profile, load_printer};

/// The profile of these jobs.
pub const PROFILE: &str = "generic-msla";

/// A line of the firmware's that ends by itself, where the profile has none.
const PULSE: [&str; 2] = ["M810 M106 S{power}|G4 P{ms}|M107", "M810"];

/// What is printed, and by which rules.
#[derive(Debug, Clone)]
pub struct Job {
    /// From the plate up.
    pub layers: Vec<Layer>,
    /// Who keeps an exposure's time.
    pub timing: Timing,
    /// The plate's switch is at the top.
    pub homes_up: bool,
}

impl Job {
    /// So many layers of 0.05 mm that are exposed for so long.
    pub fn of(layers: u32, exposure_ms: u32, timing: Timing) -> Self {
        let layer = |n: u32| Layer {
            z_mm: f64::from(n) * 0.05,
            exposure_ms,
            power: 255,
            lift: [Way { mm: 3.0, mm_min: 60.0 }, Way { mm: 2.0, mm_min: 180.0 }],
            retract: [Way { mm: 3.0, mm_min: 180.0 }, Way { mm: 2.0, mm_min: 60.0 }],
            settle_ms: 500,
            rest_ms: 200,
            top_ms: 0,
        };
        Self { layers: (1..=layers).map(layer).collect(), timing, homes_up: false }
    }

    /// Its lines.
    ///
    /// # Errors
    /// The built-in profile cannot be read.
    pub fn script(&self) -> anyhow::Result<Script> {
        let rules = outrigger::cli::resin_rules(&profile()?);
        let Some(mut rules) = rules else { anyhow::bail!("{PROFILE} is no printer of resin") };
        rules.timing = self.timing;
        if rules.pulse.is_empty() {
            rules.pulse = PULSE.map(str::to_owned).to_vec();
        }
        Ok(Script::new(rules, self.layers.clone()))
    }

    /// The host's settings for a board like this.
    ///
    /// # Errors
    /// The built-in profile cannot be read.
    pub fn settings(&self, config: &Config) -> anyhow::Result<HostSettings> {
        let mut settings = crate::play::settings(&profile()?, config.dtr_reset);
        if let Some(plate) = &mut settings.resume.plate {
            plate.homes_up = self.homes_up;
        }
        Ok(settings)
    }

    /// The board with the machine that the profile has.
    ///
    /// # Errors
    /// The built-in profile cannot be read.
    pub fn board(&self, config: Config) -> anyhow::Result<Config> {
        let profile = profile()?;
        let machine = Machine::resin(ResinMachine {
            homes_up: self.homes_up,
            z_max_mm: profile.bed.z_mm.0,
            light: LightPin::Fan,
        });
        let Some(plate) = profile.msla().map(|msla| &msla.plate) else {
            anyhow::bail!("{PROFILE} is no printer of resin")
        };
        let accel_mm_s2 = plate.accel_mm_s2.0;
        let mut dynamics =
            Dynamics { print_mm_s2: accel_mm_s2, travel_mm_s2: accel_mm_s2, ..machine.dynamics };
        dynamics.max_feed_mm_s[2] = plate.max_mm_min.0 / 60.0;
        dynamics.max_accel_mm_s2[2] = accel_mm_s2;
        Ok(Config { machine: Machine { dynamics, ..machine }, ..config })
    }
}

/// What a display is like that nothing is wrong with: times of loading, showing, going dark, ns.
pub const SCREEN: ScreenPlan = ScreenPlan { takes_ns: [700_000_000, 20_000_000, 20_000_000], fails: None };

/// Baud of a board where nothing else is said: the profile's.
const BAUD: u32 = 115_200;

impl Job {
    /// A world in which it is printed and nothing goes wrong but this. A person resumes what is paused
    /// after 5 s, and says that all is clear 20 s after a break.
    ///
    /// # Errors
    /// The built-in profile cannot be read.
    pub fn plan(&self, faults: Vec<Fault>) -> anyhow::Result<Plan> {
        let script = self.script()?;
        let config = self.board(Config { baud: BAUD, ..Config::default() })?;
        Ok(Plan {
            commands: Commands::of_script(script.clone()),
            resin: Some(Resin { script, screen: SCREEN }),
            settings: self.settings(&config)?,
            config,
            board: Faults::default(),
            out: Chances::default(),
            back: Chances::default(),
            disk: DiskPlan { sync_ns: 8_000_000 },
            faults,
            user: User { resumes_ns: Some(5_000_000_000), confirms_ns: Some(20_000_000_000) },
            hard_stop: true,
            seed: 1,
            limit_ns: 3_600_000_000_000,
            transcript: false,
            watch_heat: false,
        })
    }

    /// Prints it; what came of it, and of its exposures.
    pub fn print(&self, plan: Plan) -> (Report, Exposed) {
        let speed = plan.config.speed;
        let report = World::new(plan).run();
        let done = exposed(&self.layers, &report.light, &report.shown, speed);
        (report, done)
    }
}

/// How often a user was told that this layer, from 0, is exposed once more.
pub fn again(told: &str, layer: u32) -> usize {
    let words = format!("go on with layer {}, which may have been exposed already", layer + 1);
    told.lines().filter(|line| line.starts_with(&words)).count()
}

fn profile() -> anyhow::Result<Profile> {
    Ok(load_printer(PROFILE)?)
}
