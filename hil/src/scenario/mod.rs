//! A scenario: a job, a firmware, what goes wrong and when, and what must hold at the end.
//!
//! Takes the text of a file under `tests/scenarios`, gives a [`Scenario`] or the reason why it
//! is none. Plain data; who plays it is no matter here: the virtual clock ([`crate::play`]) and
//! the rig play the same files. What a file may say is in [`HELP`].
mod help;
mod job;

pub use help::HELP;
pub(crate) use job::generated;
pub use job::{Job, JobLines, MAX_LINES, ResinJob, TimedBy};

use serde::Deserialize;
use std::path::Path;

/// Most faults of a scenario, sweeps unrolled not counted.
const MAX_FAULTS: usize = 64;

/// Most values of one sweep.
const MAX_SWEEP: usize = 64;

/// Longest time that a scenario may name, s: a day.
const MAX_S: f64 = 86_400.0;

/// One file under `tests/scenarios`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scenario {
    /// The file's name without its end.
    #[serde(skip)]
    pub name: String,
    /// One sentence for people.
    pub title: String,
    /// What is printed.
    pub job: Job,
    /// On what.
    #[serde(default)]
    pub printer: Printer,
    /// Noise on the wire all the time.
    #[serde(default)]
    pub noise: Noise,
    /// What goes wrong, and what people do.
    #[serde(default)]
    pub fault: Vec<Fault>,
    /// What must hold at the end.
    pub expect: Expect,
}

/// The printer of a scenario.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Printer {
    /// A name from the mock's table of personalities; a list plays the scenario once for each.
    pub personality: Option<Names>,
    /// The profile that the host is given.
    pub profile: Option<String>,
    /// How many times faster than life the mechanics are.
    pub speed: Option<f64>,
    /// So many lines may be unacknowledged, whatever the profile says.
    pub window_lines: Option<usize>,
    /// Opening the port resets the board, and so does a hard stop.
    pub dtr_reset: bool,
    /// The board can be reset by a hard stop.
    pub hard_stop: bool,
}

/// One name or several to sweep over.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub enum Names {
    /// This one.
    One(String),
    /// The scenario is played once for each.
    Sweep(Vec<String>),
}

/// Noise in both directions, in thousandths of lines.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Noise {
    /// Where the dice begin.
    pub seed: u64,
    /// Lines to the board of which a byte is damaged.
    pub corrupt_line: u64,
    /// Lines to the board that are lost.
    pub lose_line: u64,
    /// Replies of which a byte is damaged.
    pub corrupt_reply: u64,
    /// Replies that are lost.
    pub lose_reply: u64,
    /// Whether bytes come in random pieces.
    pub split: bool,
    /// Most ms that a piece takes longer than the line's speed wants.
    pub delay_ms: u64,
}

/// Where something happens: to whom a fault belongs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// The wire, on the host's side.
    Wire,
    /// The board.
    Board,
    /// The host's process or its user.
    Host,
    /// The journal's disk.
    Disk,
}

macro_rules! kinds {
    ($($kind:ident $name:literal $place:ident,)*) => {
        /// What happens.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
        #[serde(rename_all = "snake_case")]
        #[expect(missing_docs, reason = "the table of HELP describes each")]
        pub enum Kind { $($kind,)* }

        impl Kind {
            /// All of them.
            pub const ALL: &[Kind] = &[$(Kind::$kind,)*];

            /// As it stands in a file.
            pub fn name(self) -> &'static str {
                match self { $(Kind::$kind => $name,)* }
            }

            /// Where it happens.
            pub fn place(self) -> Place {
                match self { $(Kind::$kind => Place::$place,)* }
            }
        }
    };
}

kinds! {
    CorruptLine "corrupt_line" Wire,
    LoseLine "lose_line" Wire,
    LoseEnd "lose_end" Wire,
    HoldLines "hold_lines" Wire,
    CorruptReply "corrupt_reply" Wire,
    LoseReply "lose_reply" Wire,
    HoldReplies "hold_replies" Wire,
    Insert "insert" Wire,
    Block "block" Wire,
    Unplug "unplug" Wire,
    UnplugReset "unplug_reset" Board,
    ResendWithoutOk "resend_without_ok" Board,
    DropOk "drop_ok" Board,
    Say "say" Board,
    Halt "halt" Board,
    Reset "reset" Board,
    Hang "hang" Board,
    PowerCut "power_cut" Board,
    FilamentOut "filament_out" Board,
    Pause "pause" Host,
    Resume "resume" Host,
    Cancel "cancel" Host,
    EmergencyStop "emergency_stop" Host,
    Answer "answer" Host,
    Send "send" Host,
    Kill "kill" Host,
    Confirm "confirm" Host,
    ChangeFile "change_file" Host,
    DiskSlow "disk_slow" Disk,
    DiskFails "disk_fails" Disk,
}

/// One thing that happens.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// When this command of the job goes out for the first time, from 1; a list plays
    /// the scenario once for each.
    pub at_line: Option<Lines>,
    /// When a line with this text in it goes out for the first time.
    pub at_command: Option<String>,
    /// Seconds since the first port was opened.
    pub at_s: Option<f64>,
    /// When the job comes to this state.
    pub at_state: Option<String>,
    /// So much later.
    #[serde(default)]
    pub after_s: f64,
    /// What.
    #[serde(rename = "do")]
    pub kind: Kind,
    /// How long, s.
    pub for_s: Option<f64>,
    /// Text of what is said or sent.
    pub text: Option<String>,
    /// How many lines or replies in a row.
    pub times: Option<u32>,
    /// Which byte of the line, from 0.
    pub byte: Option<usize>,
    /// How far Z sinks while there is no power, mm.
    pub sag_mm: Option<f64>,
    /// The button's place.
    pub button: Option<u8>,
}

/// One line or several to sweep over.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub enum Lines {
    /// This one.
    One(u64),
    /// The scenario is played once for each.
    Sweep(Vec<u64>),
}

/// How a job may end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum End {
    /// Printed to its last line.
    Finished,
    /// Ended by the user.
    Cancelled,
    /// Ended by a fault.
    Failed,
    /// Broken off with the part on the bed; a person decides.
    Interrupted,
    /// Never begun: the file cannot be printed.
    Refused,
}

/// What is asked of the heaters at the end.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Heaters {
    /// Off after a cancel, a failure or a refusal.
    #[default]
    Off,
    /// Nothing.
    Any,
}

/// What must hold at the end.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expect {
    /// How it ends.
    pub outcome: End,
    /// Commands of the job that may be gone over twice, after a resume.
    #[serde(default)]
    pub twice_at_most: u64,
    /// Longest time without a new command of the job on the wire, s of the board's clock;
    /// the default is what one heating may take.
    pub stall_s: Option<f64>,
    /// Longest time from the first fault to the end, s.
    pub over_s: Option<f64>,
    /// Longest time from the fault to both heaters' targets being 0, s.
    pub cold_s: Option<f64>,
    /// `any`: nothing is asked of the heaters at the end.
    #[serde(default)]
    pub heaters: Heaters,
    /// Words that the user must be told.
    #[serde(default)]
    pub told: Vec<String>,
    /// Commands that the board must have got, in this order.
    #[serde(default)]
    pub commands: Vec<String>,
    /// How often the board may start.
    pub boots: Option<u64>,
    /// Commands of the job after which nothing of it may have been executed.
    pub none_after: Option<u64>,
}

/// Why a file is no scenario.
#[derive(Debug, thiserror::Error)]
pub enum ScenarioError {
    /// Cannot be read.
    #[error("{path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// Not TOML, or an unknown key; the text has line and column.
    #[error("{name}: {text}")]
    Toml {
        /// The scenario.
        name: String,
        /// Where and why.
        text: String,
    },
    /// It says what makes no sense.
    #[error("{name}: {why} (outrigger-hil --help-scenarios says what may stand there)")]
    Senseless {
        /// The scenario.
        name: String,
        /// Why.
        why: String,
    },
}

impl Scenario {
    /// Reads a scenario from text; sweeps are not unrolled.
    ///
    /// # Errors
    /// [`ScenarioError`]: what is wrong and where.
    pub fn parse(name: &str, text: &str) -> Result<Self, ScenarioError> {
        let mut scenario: Scenario = toml::from_str(text)
            .map_err(|e| ScenarioError::Toml { name: name.to_owned(), text: e.to_string() })?;
        name.clone_into(&mut scenario.name);
        match scenario.wrong() {
            Some(why) => Err(ScenarioError::Senseless { name: name.to_owned(), why }),
            None => Ok(scenario),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`ScenarioError`]: what is wrong and where.
    pub fn load(path: &Path) -> Result<Self, ScenarioError> {
        let text = std::fs::read_to_string(path)
            .map_err(|source| ScenarioError::Read { path: path.display().to_string(), source })?;
        let name = path.file_stem().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        Self::parse(&name, &text)
    }

    /// All scenarios of a folder, by name.
    ///
    /// # Errors
    /// [`ScenarioError`] of the first that is none.
    pub fn load_all(folder: &Path) -> Result<Vec<Self>, ScenarioError> {
        let read = |source| ScenarioError::Read { path: folder.display().to_string(), source };
        let mut paths = Vec::new();
        for entry in std::fs::read_dir(folder).map_err(read)? {
            let path = entry.map_err(read)?.path();
            if path.extension().is_some_and(|e| e == "toml") {
                paths.push(path);
            }
        }
        paths.sort();
        paths.iter().map(|path| Self::load(path)).collect()
    }

    /// One scenario for each value that a fault sweeps over, named `NAME@LINE`.
    pub fn unroll(&self) -> Vec<Self> {
        if let Some(Names::Sweep(names)) = &self.printer.personality {
            let one = |name: &String| {
                let mut one = self.clone();
                one.printer.personality = Some(Names::One(name.clone()));
                one.name = format!("{}@{name}", self.name);
                one
            };
            return names.iter().map(one).flat_map(|s| s.unroll()).collect();
        }
        let swept = self.fault.iter().position(|f| matches!(f.at_line, Some(Lines::Sweep(_))));
        let Some(at) = swept else {
            return vec![self.clone()];
        };
        let Some(Lines::Sweep(lines)) = &self.fault[at].at_line else {
            return vec![self.clone()];
        };
        let one = |line: &u64| {
            let mut one = self.clone();
            one.fault[at].at_line = Some(Lines::One(*line));
            one.name = format!("{}@{line}", self.name);
            one
        };
        lines.iter().map(one).flat_map(|s| s.unroll()).collect()
    }

    fn wrong(&self) -> Option<String> {
        if self.fault.len() > MAX_FAULTS {
            return Some(format!("more than {MAX_FAULTS} faults"));
        }
        if let Some(why) = self.job.wrong() {
            return Some(why);
        }
        if self.job.resin.is_some() && self.printer.profile.is_some() {
            return Some("job.resin has a profile of its own".to_owned());
        }
        if self.printer.speed.is_some_and(|s| !(0.01..=1000.0).contains(&s)) {
            return Some("printer.speed is outside 0.01 to 1000".to_owned());
        }
        if matches!(&self.printer.personality, Some(Names::Sweep(n)) if n.is_empty() || n.len() > MAX_SWEEP) {
            return Some(format!("printer.personality sweeps over 1 to {MAX_SWEEP} names"));
        }
        if self.printer.window_lines == Some(0) {
            return Some("printer.window_lines is 0".to_owned());
        }
        let noise = self.noise;
        let shares = [noise.corrupt_line, noise.lose_line, noise.corrupt_reply, noise.lose_reply];
        if shares.iter().any(|s| *s > 1000) || noise.delay_ms > 10_000 {
            return Some("noise is in thousandths, and delay_ms at most 10000".to_owned());
        }
        let faults = self.fault.iter().enumerate();
        faults.filter_map(|(n, f)| Some(format!("fault {} ({}) {}", n + 1, f.kind.name(), f.wrong()?))).next()
    }
}

impl Fault {
    /// This kind at this command of the job, with nothing else said.
    pub fn at_line(kind: Kind, line: u64) -> Self {
        Self { at_line: Some(Lines::One(line)), ..Self::bare(kind) }
    }

    /// This kind at this time, with nothing else said.
    pub fn at_s(kind: Kind, at_s: f64) -> Self {
        Self { at_s: Some(at_s), ..Self::bare(kind) }
    }

    fn bare(kind: Kind) -> Self {
        Self {
            at_line: None,
            at_command: None,
            at_s: None,
            at_state: None,
            after_s: 0.0,
            kind,
            for_s: None,
            text: None,
            times: None,
            byte: None,
            sag_mm: None,
            button: None,
        }
    }

    fn wrong(&self) -> Option<String> {
        let whens =
            [self.at_line.is_some(), self.at_command.is_some(), self.at_s.is_some(), self.at_state.is_some()];
        if whens.iter().filter(|w| **w).count() != 1 {
            return Some("needs one of at_line, at_command, at_s, at_state".to_owned());
        }
        if matches!(&self.at_line, Some(Lines::Sweep(lines)) if lines.is_empty() || lines.len() > MAX_SWEEP) {
            return Some(format!("sweeps over 1 to {MAX_SWEEP} lines"));
        }
        let times = [self.at_s, self.for_s, Some(self.after_s), self.sag_mm];
        if times.into_iter().flatten().any(|s| !(0.0..=MAX_S).contains(&s)) {
            return Some(format!("has a number outside 0 to {MAX_S}"));
        }
        if let Some(state) = &self.at_state
            && !crate::world::STATES.iter().any(|(_, name)| name == state)
        {
            return Some(format!("waits for a state {state:?} that there is not"));
        }
        let lasts = matches!(
            self.kind,
            Kind::HoldLines
                | Kind::HoldReplies
                | Kind::Block
                | Kind::Unplug
                | Kind::UnplugReset
                | Kind::Hang
                | Kind::PowerCut
                | Kind::Kill
                | Kind::DiskSlow
                | Kind::DiskFails
        );
        if lasts != self.for_s.is_some() {
            return Some(if lasts { "needs for_s" } else { "takes no for_s" }.to_owned());
        }
        let says = matches!(self.kind, Kind::Say | Kind::Halt | Kind::Insert | Kind::Send);
        if says != self.text.is_some() {
            return Some(if says { "needs text" } else { "takes no text" }.to_owned());
        }
        let of_line = matches!(self.kind, Kind::ResendWithoutOk | Kind::DropOk);
        if of_line && self.at_line.is_none() {
            return Some("needs at_line".to_owned());
        }
        None
    }
}

#[cfg(test)]
mod tests;
