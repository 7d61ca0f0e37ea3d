//! The walk through a file to where a job is taken up again.
//!
//! Takes the file's commands one by one up to a position, gives the machine's state
//! there, and for a restart some moves earlier the commands in between. Bounded in
//! memory; the caller bounds the time by walking in steps.
use super::one_by_one::OneByOne;
use super::{CLEAN_BACK_MOVES, Refusal};
use crate::job::tracker::{EModes, Tracker};
use outrigger_gcode::state::Kind;
use std::collections::VecDeque;

/// Commands kept before the position: the moves that a firmware may not have made are
/// among them, unless a file has a hundred commands to a move.
const KEPT_COMMANDS: u64 = 4_096;

/// Their bytes; Marlin's are at most 95 each, and Klipper's outlines a few kilobytes.
const KEPT_BYTES: usize = 1 << 20;

/// A command of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kept {
    /// As it is sent.
    pub text: Vec<u8>,
    /// Its line in the file.
    pub number: u64,
    /// Layers begun.
    pub layer: u32,
}

#[derive(Debug)]
struct Passed {
    kept: Kept,
    moved: Option<Kind>,
    z_mm: f64,
}

/// Where the walk has come to.
#[derive(Debug)]
pub struct Walk {
    to: u64,
    back_moves: u32,
    at: u64,
    lead: Tracker,
    /// State before the first of `passed`.
    base: Option<Box<Tracker>>,
    passed: VecDeque<Passed>,
    bytes: usize,
    seen: OneByOne,
    last: (u64, u32),
}

/// A place in the file at which the job is taken up.
#[derive(Debug)]
pub struct Walked {
    /// The machine's state there.
    pub tracker: Tracker,
    /// Commands before it.
    pub after: u64,
    /// Line of the file and layer of the last of these, if they are known.
    pub last: (u64, u32),
    /// Commands between it and where the walk has ended.
    pub between: VecDeque<Kept>,
    /// Lowest height of the head between, mm.
    pub lowest_mm: f64,
    /// Moves between.
    pub moves: u32,
}

impl Walk {
    /// A walk over `to` commands; the place wanted is so many moves before, or exactly
    /// there (0).
    pub fn new(e_modes: EModes, to: u64, back_moves: u32) -> Self {
        Self {
            to,
            back_moves,
            at: 0,
            lead: Tracker::keeping_settings(e_modes),
            base: None,
            passed: VecDeque::new(),
            bytes: 0,
            seen: OneByOne::default(),
            last: (0, 0),
        }
    }

    /// Commands walked.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// Whether all is walked.
    pub fn is_done(&self) -> bool {
        self.at >= self.to
    }

    /// The next command of the file.
    pub fn step(&mut self, command: &[u8], number: u64, layer: u32) {
        let keeps = self.back_moves > 0 && self.to - self.at <= KEPT_COMMANDS;
        if keeps && self.base.is_none() {
            self.base = Some(Box::new(self.lead.clone()));
        }
        let moved = self.lead.apply(command);
        if let Some(m) = &moved {
            self.seen.see(m);
        }
        self.at += 1;
        self.last = (number, layer);
        if keeps {
            self.bytes += command.len();
            if self.bytes > KEPT_BYTES {
                // Too long to keep: told at the end.
                self.passed.clear();
                return;
            }
            let kept = Kept { text: command.to_vec(), number, layer };
            self.passed.push_back(Passed { kept, moved: moved.map(|m| m.kind()), z_mm: self.lead.z_mm() });
        }
    }

    /// The machine's state where the walk is.
    pub fn tracker(&self) -> &Tracker {
        &self.lead
    }

    /// Whether the file's heights are not the printer's where it stands (`G92 Z`).
    pub fn shifts_z(&self) -> bool {
        self.lead.at_mm(2) != self.lead.at_native_mm(2)
    }

    /// The place exactly where the walk has ended.
    pub fn exact(self) -> Walked {
        Walked {
            lowest_mm: self.lead.z_mm(),
            tracker: self.lead,
            after: self.at,
            last: self.last,
            between: VecDeque::new(),
            moves: 0,
        }
    }

    /// The place at which the job is taken up by a printer that has lost its state.
    ///
    /// # Errors
    /// Why there is none.
    pub fn place(self) -> Result<Walked, Refusal> {
        if !self.seen.printed() {
            return Err(Refusal::InPreparation);
        }
        if self.seen.found() {
            return Err(Refusal::OneByOne);
        }
        if self.back_moves == 0 {
            let whole = self.exact();
            return if whole.knows_its_place() { Ok(whole) } else { Err(Refusal::InPreparation) };
        }
        let first = self.first_again()?;
        let Some(mut tracker) = self.base.map(|base| *base) else {
            return Err(Refusal::TooManyCommands);
        };
        let mut passed = self.passed;
        let kept_before = self.at - passed.len() as u64;
        let mut last = (0, 0);
        for gone in passed.drain(..first) {
            tracker.apply(&gone.kept.text);
            last = (gone.kept.number, gone.kept.layer);
        }
        let lowest_mm = passed.iter().map(|p| p.z_mm).fold(tracker.z_mm(), f64::min);
        let moves = passed.iter().filter(|p| p.made_a_move()).count() as u32;
        let walked = Walked {
            tracker,
            after: kept_before + first as u64,
            last,
            between: passed.into_iter().map(|p| p.kept).collect(),
            lowest_mm,
            moves,
        };
        if walked.knows_its_place() { Ok(walked) } else { Err(Refusal::InPreparation) }
    }

    /// Index of the first command that is sent again.
    fn first_again(&self) -> Result<usize, Refusal> {
        let mut moves = 0;
        let mut enough = None;
        for (at, passed) in self.passed.iter().enumerate().rev() {
            if !passed.made_a_move() {
                continue;
            }
            moves += 1;
            if moves < self.back_moves {
                continue;
            }
            // A restart shows least where the head travels anyway.
            if passed.moved == Some(Kind::Travel) {
                return Ok(at);
            }
            enough = enough.or(Some(at));
            if moves >= self.back_moves + CLEAN_BACK_MOVES {
                break;
            }
        }
        match enough {
            Some(at) => Ok(at),
            // The file's beginning is among what is kept.
            None if self.at <= KEPT_COMMANDS && !self.passed.is_empty() => Err(Refusal::InPreparation),
            None => Err(Refusal::TooManyCommands),
        }
    }
}

impl Passed {
    fn made_a_move(&self) -> bool {
        self.moved.is_some_and(|kind| kind != Kind::Still)
    }
}

impl Walked {
    fn knows_its_place(&self) -> bool {
        (0..3).all(|axis| self.tracker.at_mm(axis).is_some())
    }
}
