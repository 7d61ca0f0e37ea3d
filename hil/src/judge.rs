//! What must hold at the end of every run, from what the board did.
//!
//! Takes the job's commands and the board's deeds; gives what was executed how often, or the
//! first thing that is wrong. Knows no host: a host that lies is found out here. What must hold of a
//! resin job is in [`resin`].
pub mod resin;

use crate::world::source::Commands;
use outrigger::printer::mock::Executed as Did;
use std::collections::HashMap;

/// What was executed of a job.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Executed {
    /// Commands that were executed, in order and without a gap, from the first.
    pub through: usize,
    /// Commands that were executed more than once.
    pub twice: usize,
    /// Most times that one was executed.
    pub most: u32,
    /// Most commands that the way back after a start of the board went over again.
    pub back: usize,
    /// Starts of the board among them.
    pub starts: u32,
    /// Tails of lines that the board took for lines of their own.
    pub torn: usize,
    /// What went wrong first.
    pub wrong: Option<String>,
}

/// Follows the job's commands through all that the board did: `deeds` in the order in which
/// they ended, and the times of its starts.
///
/// Moves of the job come in order, each once; after a start of the board they may
/// begin anew at any move that is not beyond what was made. What is no move ends when
/// it is done, while earlier moves are still in the planner, so it has an order of its own.
///
/// A line of a host always has a number. A move without one is the tail of a
/// line: after a damaged line the board throws away what has arrived, and where that ends
/// just before the command letter of a line that is still on the wire, its tail is a line
/// without number or check. No sender that keeps more than one line on its way can prevent
/// that; such moves are counted apart, and the line itself comes again.
pub fn executed(commands: &Commands, deeds: &[Did], starts_ns: &[u64]) -> Executed {
    let mut track = Track::new(commands);
    let mut starts = starts_ns.iter().peekable();
    for deed in deeds.iter().filter(|d| d.whole) {
        while starts.next_if(|at_ns| **at_ns < deed.at_ns).is_some() {
            track.starts_anew();
        }
        if deed.number.is_none() && is_move(deed.command.as_bytes()) {
            track.done.torn += 1;
            continue;
        }
        track.took(deed.command.as_bytes());
    }
    track.done.starts = u32::try_from(starts_ns.len()).unwrap_or(u32::MAX);
    track.finish()
}

/// How far the job is.
struct Track<'a> {
    commands: &'a Commands,
    /// Where a move stands that is like no other.
    moves: HashMap<&'a [u8], usize>,
    times: Vec<u32>,
    next_move: usize,
    next_other: usize,
    fresh_start: bool,
    done: Executed,
}

impl<'a> Track<'a> {
    fn new(commands: &'a Commands) -> Self {
        let mut moves = HashMap::new();
        let mut often = Vec::new();
        for (at, command) in commands.iter().enumerate().filter(|(_, c)| is_move(c)) {
            if moves.insert(command, at).is_some() {
                often.push(command);
            }
        }
        for command in often {
            moves.remove(command);
        }
        let mut track = Self {
            commands,
            moves,
            times: vec![0; commands.len()],
            next_move: 0,
            next_other: 0,
            fresh_start: false,
            done: Executed::default(),
        };
        track.next_move = track.following(0, true);
        track.next_other = track.following(0, false);
        track
    }

    /// The first move, or the first that is none, from `at` on.
    fn following(&self, at: usize, moves: bool) -> usize {
        let found = self.commands.iter().skip(at).position(|c| is_move(c) == moves);
        found.map_or(self.commands.len(), |n| at + n)
    }

    fn starts_anew(&mut self) {
        self.fresh_start = true;
        self.done.starts += 1;
    }

    fn took(&mut self, command: &[u8]) {
        if self.commands.get(self.next_move) == Some(command) {
            return self.made(self.next_move, command);
        }
        match self.moves.get(command) {
            Some(at) => self.made(*at, command),
            // A line that stands in the macros too counts where it belongs, and is ours otherwise.
            None if self.commands.get(self.next_other) == Some(command) => {
                self.times[self.next_other] += 1;
                self.next_other = self.following(self.next_other + 1, false);
            }
            // After a start the way back leads in among moves that are still planned.
            None if self.done.starts > 0 => {
                let open = |at: &usize| self.times[*at] == 0 && self.commands.get(*at) == Some(command);
                if let Some(at) = (0..self.times.len()).find(open) {
                    self.times[at] += 1;
                }
            }
            None => {}
        }
    }

    fn made(&mut self, at: usize, command: &[u8]) {
        if at != self.next_move && !(self.fresh_start && at < self.next_move) {
            let (text, belongs) = (String::from_utf8_lossy(command), self.next_move + 1);
            self.done.wrong.get_or_insert(format!(
                "command {} ({text}) was executed where command {belongs} belongs",
                at + 1
            ));
        }
        if at < self.next_move {
            let again = self.commands.iter().take(self.next_move).skip(at).filter(|c| is_move(c)).count();
            self.done.back = self.done.back.max(again);
        }
        self.fresh_start = false;
        self.times[at] += 1;
        self.next_move = self.following(at + 1, true);
    }

    fn finish(mut self) -> Executed {
        let times = &self.times;
        self.done.through = times.iter().take_while(|n| **n > 0).count();
        let twice = self.commands.iter().zip(times).filter(|(c, n)| is_move(c) && **n > 1);
        self.done.twice = twice.count();
        self.done.most = times.iter().copied().max().unwrap_or_default();
        let left_out = self.commands.iter().zip(times).position(|(c, n)| is_move(c) && *n == 0);
        if let Some(at) = left_out
            && at < self.next_move
        {
            self.done.wrong.get_or_insert(format!("command {} was left out", at + 1));
        }
        self.done
    }
}

fn is_move(command: &[u8]) -> bool {
    command.starts_with(b"G1 ") || command.starts_with(b"G0 ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(deeds: &[&str], expect: (usize, usize, Option<&str>)) {
        let commands = Commands::of("G28\nG1 X1\nG1 X2\nM107\nG1 X3\nM107\n");
        let mut starts = Vec::new();
        let mut all = Vec::new();
        for (at_ns, deed) in (1..).zip(deeds) {
            let (command, whole) = (deed.trim_end_matches('-').to_owned(), !deed.ends_with('-'));
            match *deed {
                "start" => starts.push(at_ns),
                _ => {
                    let number = (!deed.starts_with('~')).then_some(at_ns as i64);
                    let command = command.trim_start_matches('~').to_owned();
                    all.push(Did { at_ns, number, command, at_mm: [0.0; 3], whole });
                }
            }
        }
        let done = executed(&commands, &all, &starts);
        let wrong = done.wrong.clone();
        assert_eq!((done.through, done.twice), (expect.0, expect.1), "{deeds:?} {done:?}");
        match expect.2 {
            Some(text) => assert!(wrong.is_some_and(|w| w.contains(text)), "{done:?}"),
            None => assert_eq!(wrong, None, "{deeds:?}"),
        }
    }

    #[test]
    fn order_gaps_and_repeats_are_seen() {
        check(&["G28", "G1 X1", "M105", "G1 X2", "M107", "G1 X3", "M107"], (6, 0, None));
        // What is no move overtakes those in the planner.
        check(&["G28", "M107", "M107", "G1 X1", "G1 X2", "G1 X3"], (6, 0, None));
        // The tail of a line.
        check(&["G28", "~G1 X2", "G1 X1", "G1 X2"], (3, 0, None));
        check(&["G28", "G1 X1"], (2, 0, None));
        check(&["G28", "G1 X1", "G1 X1"], (2, 1, Some("command 2 (G1 X1) was executed where command 3")));
        check(&["G28", "G1 X2"], (1, 0, Some("command 3 (G1 X2) was executed where command 2")));
        check(&["G28", "G1 X1", "G1 X2", "start", "G28", "G1 X1", "G1 X2"], (3, 2, None));
        check(&["G28", "G1 X1", "start", "G1 X2"], (3, 0, None));
        check(&["G28", "G1 X1-", "start", "G1 X2"], (1, 0, Some("where command 2 belongs")));
        check(&["G28", "G1 X1-", "start", "G1 X1", "G1 X2"], (3, 0, None));
        check(&["G28", "G1 X1", "start", "G28", "G1 X1", "start", "G1 X1"], (2, 1, None));
    }
}
