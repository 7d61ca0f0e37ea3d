//! Many scenarios on one kind of target, some at a time.
//!
//! Takes scenarios, gives a line for each as it ends, and a tally. Knows no flags.
use super::program::Installed;
use super::stage::Setup;
use super::target::{Octoprint, Target};
use super::verdict::{Verdict, verdict};
use super::{Rig, Sort};
use crate::scenario::Scenario;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;

/// On what scenarios are played.
#[derive(Debug, Clone)]
pub enum Place {
    /// A mock for each.
    Mock,
    /// A virtual printer for each.
    Virtual(Octoprint),
    /// This port.
    Real(PathBuf),
}

impl Place {
    /// Which sort it is.
    pub fn sort(&self) -> Sort {
        match self {
            Place::Mock => Sort::Mock,
            Place::Virtual(_) => Sort::Virtual,
            Place::Real(_) => Sort::Real,
        }
    }

    fn target(&self, scenario: &Scenario, folder: &Path) -> anyhow::Result<Target> {
        match self {
            Place::Mock => Target::mock(&scenario.printer),
            Place::Virtual(octoprint) => Target::octoprint(octoprint, folder),
            Place::Real(port) => Ok(Target::Real(port.clone())),
        }
    }
}

/// What a suite is played with.
#[derive(Debug, Clone)]
pub struct Suite<'a> {
    /// On what.
    pub place: Place,
    /// The rig, and its file.
    pub rig: &'a Rig,
    /// None for the mock's.
    pub rig_file: Option<&'a Path>,
    /// The program under test.
    pub installed: &'a Installed,
    /// This binary.
    pub hil: &'a Path,
    /// The repository.
    pub root: &'a Path,
    /// Scenarios at a time. They wait most of the time, so more than processors are fine;
    /// a real printer can be lent to one only.
    pub at_a_time: usize,
}

/// How many held, did not hold and were skipped.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally {
    /// All that must hold did.
    pub hold: usize,
    /// Something did not.
    pub broken: usize,
    /// Not played.
    pub skipped: usize,
}

impl Suite<'_> {
    /// Plays them all; `each` is told of each as it ends, in the order in which they end.
    pub fn play(
        &self,
        scenarios: &[Scenario],
        mut each: impl FnMut(&Scenario, &anyhow::Result<Verdict>),
    ) -> Tally {
        let mut tally = Tally::default();
        let next = AtomicUsize::new(0);
        let (tell, told) = channel();
        std::thread::scope(|scope| {
            for _ in 0..self.at_a_time.clamp(1, scenarios.len().max(1)) {
                let (tell, next) = (tell.clone(), &next);
                scope.spawn(move || {
                    while let Some(scenario) = scenarios.get(next.fetch_add(1, Ordering::Relaxed)) {
                        if tell.send((scenario, self.one(scenario))).is_err() {
                            return;
                        }
                    }
                });
            }
            drop(tell);
            for (scenario, came) in told {
                match &came {
                    Ok(Verdict::Holds { .. }) => tally.hold += 1,
                    Ok(Verdict::Skipped(_)) => tally.skipped += 1,
                    Ok(Verdict::Broken { .. }) | Err(_) => tally.broken += 1,
                }
                each(scenario, &came);
            }
        });
        tally
    }

    fn one(&self, scenario: &Scenario) -> anyhow::Result<Verdict> {
        let setup = Setup {
            scenario,
            rig: self.rig,
            rig_file: self.rig_file,
            installed: self.installed,
            hil: self.hil,
            root: self.root,
        };
        verdict(setup, self.place.sort(), |folder| self.place.target(scenario, folder))
    }
}
