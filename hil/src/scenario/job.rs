//! The job of a scenario, as lines.
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Most lines of a job: what a virtual printer makes within a second.
pub const MAX_LINES: u64 = 50_000;

/// What is printed: one of `lines`, `gcode`, `corpus` and `resin`.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Job {
    /// So many generated moves.
    pub lines: Option<u64>,
    /// What comes before these.
    pub start: Option<Vec<String>>,
    /// What comes after so many of these.
    pub insert: BTreeMap<String, String>,
    /// This text.
    pub gcode: Option<String>,
    /// This file of `gcode/corpus`.
    pub corpus: Option<String>,
    /// These layers of resin.
    pub resin: Option<ResinJob>,
}

/// A job of resin.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ResinJob {
    /// How many layers.
    pub layers: u32,
    /// How long each is exposed, s.
    pub exposure_s: f64,
    /// Who keeps the time.
    #[serde(default)]
    pub timed_by: TimedBy,
    /// The plate's switch is at the top.
    #[serde(default)]
    pub homes_up: bool,
}

/// Who keeps an exposure's time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TimedBy {
    /// The controller: on, dwell, off.
    #[default]
    Controller,
    /// The controller, by a line that ends by itself.
    Pulse,
    /// The host.
    Host,
}

/// A job's text.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JobLines {
    /// All lines, comments included, as a file has them.
    pub text: String,
}

/// Most layers of a resin job.
const RESIN_LAYERS_MAX: u32 = 1_000;

/// What a generated job begins with: heat, home, known modes.
const START: [&str; 7] = ["M140 S50", "M104 S150", "G28", "M190 S50", "M109 S200", "G92 E0", "M106 S128"];

/// Moves of one generated layer.
const LAYER_MOVES: u64 = 40;

impl Job {
    /// A job of so many generated moves.
    pub fn of_lines(lines: u64) -> Self {
        Self { lines: Some(lines), ..Self::default() }
    }

    pub(super) fn wrong(&self) -> Option<String> {
        let ways = [self.lines.is_some(), self.gcode.is_some(), self.corpus.is_some(), self.resin.is_some()];
        if ways.iter().filter(|w| **w).count() != 1 {
            return Some("job needs one of lines, gcode, corpus, resin".to_owned());
        }
        let fits = |job: ResinJob| {
            (1..=RESIN_LAYERS_MAX).contains(&job.layers) && (0.1..=60.0).contains(&job.exposure_s)
        };
        if self.resin.is_some_and(|job| !fits(job)) {
            return Some(format!("job.resin has 1 to {RESIN_LAYERS_MAX} layers, each 0.1 to 60 s"));
        }
        if self.lines.is_some_and(|n| n == 0 || n > MAX_LINES) {
            return Some(format!("job.lines is outside 1 to {MAX_LINES}"));
        }
        if self.lines.is_none() && (self.start.is_some() || !self.insert.is_empty()) {
            return Some("job.start and job.insert go with job.lines".to_owned());
        }
        let key = |k: &String| k.parse::<u64>().is_ok_and(|k| self.lines.is_some_and(|n| k <= n));
        if !self.insert.keys().all(key) {
            return Some("job.insert has a key that is no number of moves".to_owned());
        }
        if self.corpus.as_ref().is_some_and(|name| name.contains('/') || name.contains("..")) {
            return Some("job.corpus is the name of a file in gcode/corpus".to_owned());
        }
        None
    }

    /// Its text. `root` is the repository.
    ///
    /// # Errors
    /// The corpus has no such file.
    pub fn text(&self, root: &Path) -> std::io::Result<JobLines> {
        let text = match (&self.gcode, &self.corpus) {
            (Some(text), _) => text.clone(),
            (_, Some(name)) => std::fs::read_to_string(root.join("gcode/corpus").join(name))?,
            _ => self.generated(),
        };
        Ok(JobLines { text })
    }

    fn generated(&self) -> String {
        let mut text = String::new();
        match &self.start {
            Some(lines) => lines.iter().for_each(|l| push(&mut text, l)),
            None => START.iter().for_each(|l| push(&mut text, l)),
        }
        let insert = |text: &mut String, after: u64| {
            if let Some(line) = self.insert.get(&after.to_string()) {
                push(text, line);
            }
        };
        insert(&mut text, 0);
        for n in 1..=self.lines.unwrap_or_default() {
            if (n - 1) % LAYER_MOVES == 0 {
                let layer = (n - 1) / LAYER_MOVES;
                push(&mut text, &format!(";LAYER:{layer}"));
            }
            push(&mut text, &self::generated(n));
            insert(&mut text, n);
        }
        text
    }
}

/// The `n`th generated move, from 1: like no other, 1 to 3 mm long, on a part in the
/// middle of a small bed, a layer of 0.2 mm every 40 moves.
pub(crate) fn generated(n: u64) -> String {
    let within = (n - 1) % LAYER_MOVES;
    let z = 0.2 * ((n - 1) / LAYER_MOVES + 1) as f64;
    let (x, y) = (60.0 + (within % 10) as f64 * 3.0, 60.0 + (within / 10) as f64 * 2.0);
    let e = n as f64 * 0.05;
    match within {
        0 => format!("G1 X{x:.1} Y{y:.1} Z{z:.1} E{e:.2} F3000"),
        _ => format!("G1 X{x:.1} Y{y:.1} E{e:.2}"),
    }
}

fn push(text: &mut String, line: &str) {
    text.push_str(line);
    text.push('\n');
}
