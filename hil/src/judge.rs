//! What must hold at the end of every run, from what the board did.
//!
//! Takes the job's commands and the board's deeds; gives what was executed how often, or the
//! first thing that is wrong. Knows no host: a host that lies is found out here.
use crate::world::source::Commands;
use outrigger::printer::mock::{Deed, Did};
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
    /// What went wrong first.
    pub wrong: Option<String>,
}

/// Follows the job's commands through all that the board did.
///
/// Commands of the job come in order, each once; after a start of the board they may
/// begin anew at any command that is not beyond what was made, and moves that were
/// planned and never made do not count as executed.
pub fn executed(commands: &Commands, deeds: &[Deed]) -> Executed {
    let mut index: HashMap<&[u8], Vec<usize>> = HashMap::new();
    for (at, command) in commands.iter().enumerate() {
        index.entry(command).or_default().push(at);
    }
    let mut done = Executed::default();
    let mut times = vec![0_u32; commands.len()];
    // Commands of the job in the order in which they were executed: the last of them
    // may turn out not to have been made.
    let mut order: Vec<usize> = Vec::new();
    let mut next = 0;
    let mut fresh_start = false;
    for deed in deeds {
        match &deed.did {
            Did::Took { command, .. } => {
                let Some(places) = index.get(command.as_slice()) else {
                    continue;
                };
                // A line that stands in the job several times, such as M107 or G28, and in
                // the macros too: it counts where it belongs, and is ours otherwise.
                let unique = places.len() == 1 && is_move(command);
                let at = match places.contains(&next) {
                    true => next,
                    false if unique => places[0],
                    false => continue,
                };
                if at != next && !(fresh_start && at <= next) {
                    let text = String::from_utf8_lossy(command);
                    done.wrong.get_or_insert(format!(
                        "command {} ({text}) was executed where command {} belongs",
                        at + 1,
                        next + 1
                    ));
                }
                if at < next {
                    done.back = done.back.max(next - at);
                }
                fresh_start = false;
                times[at] += 1;
                order.push(at);
                next = at + 1;
            }
            Did::Dropped { moves } => {
                // Moves that were planned and never made.
                let mut left = *moves;
                while left > 0 {
                    let Some(at) = order.pop() else { break };
                    if is_move(commands.get(at).unwrap_or_default()) {
                        left -= 1;
                    }
                    times[at] -= 1;
                    next = at;
                }
            }
            Did::Started => {
                done.starts += 1;
                fresh_start = true;
            }
        }
    }
    done.through = times.iter().take_while(|n| **n > 0).count();
    done.twice = times.iter().filter(|n| **n > 1).count();
    done.most = times.iter().copied().max().unwrap_or_default();
    if let Some(gap) = times[done.through..].iter().position(|n| *n > 0) {
        done.wrong.get_or_insert(format!("command {} was left out", done.through + 1));
        let _ = gap;
    }
    done
}

fn is_move(command: &[u8]) -> bool {
    command.starts_with(b"G1 ") || command.starts_with(b"G0 ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn took(command: &str) -> Deed {
        Deed { at_ns: 0, did: Did::Took { number: None, command: command.as_bytes().to_vec() } }
    }

    fn check(deeds: &[&str], expect: (usize, usize, Option<&str>)) {
        let commands = Commands::of("G28\nG1 X1\nG1 X2\nM107\nG1 X3\nM107\n");
        let deeds: Vec<_> = deeds
            .iter()
            .map(|d| match *d {
                "start" => Deed { at_ns: 0, did: Did::Started },
                "drop1" => Deed { at_ns: 0, did: Did::Dropped { moves: 1 } },
                other => took(other),
            })
            .collect();
        let done = executed(&commands, &deeds);
        let wrong = done.wrong.clone();
        assert_eq!((done.through, done.twice), (expect.0, expect.1), "{deeds:?} {done:?}");
        match expect.2 {
            Some(text) => assert!(wrong.is_some_and(|w| w.contains(text)), "{done:?}"),
            None => assert_eq!(wrong, None),
        }
    }

    #[test]
    fn order_gaps_and_repeats_are_seen() {
        check(&["G28", "G1 X1", "M105", "G1 X2", "M107", "G1 X3", "M107"], (6, 0, None));
        check(&["G28", "G1 X1"], (2, 0, None));
        check(&["G28", "G1 X1", "G1 X1"], (2, 1, Some("command 2 (G1 X1) was executed where command 3")));
        check(&["G28", "G1 X2"], (1, 0, Some("command 3 (G1 X2) was executed where command 2")));
        check(&["G28", "G1 X1", "G1 X2", "start", "G28", "G1 X1", "G1 X2"], (3, 2, None));
        check(&["G28", "G1 X1", "start", "G1 X2"], (3, 0, None));
        check(&["G28", "G1 X1", "drop1", "start", "G1 X2"], (1, 0, Some("where command 2 belongs")));
        check(&["G28", "G1 X1", "drop1", "start", "G1 X1", "G1 X2"], (3, 0, None));
    }
}
