//! M810 to M819: commands kept under a number, and run within the command that names it.
//!
//! As Marlin's GCODE_MACROS: `M810 G4 P5|M107` keeps, `M810` runs. What is run says no `ok`;
//! the one of `M810` comes when all of it is done. A start forgets all of them.
use super::super::words::Command;
use super::Firmware;
use super::execute::Next;
use std::collections::VecDeque;

/// M810 to M819: the most that Marlin has (GCODE_MACROS_SLOTS).
pub(super) const MACROS: usize = 10;

/// Marlin's GCODE_MACROS_SLOT_SIZE: longer ones are refused.
const MACRO_BYTES_MAX: usize = 50;

/// Most commands of one run, those of macros that it runs in turn among them. Marlin's stack
/// ends a macro that runs itself; here what is beyond does not run.
const RUN_MAX: usize = 100;

/// A macro that runs.
#[derive(Debug)]
pub(super) struct Script {
    left: VecDeque<Vec<u8>>,
    /// Commands begun.
    begun: usize,
    /// The command that runs it.
    own: Vec<u8>,
}

impl Firmware {
    /// M810 to M819.
    pub(super) fn keep_or_run(&mut self, command: &Command<'_>) -> Next {
        let slot = command.code as usize - 810;
        if command.rest.len() > MACRO_BYTES_MAX {
            self.say(b"Error:Macro too long.\n");
            return Next::Ok;
        }
        if !command.rest.is_empty() {
            self.macros[slot] = command.rest.to_vec();
            return Next::Ok;
        }
        if self.macros[slot].is_empty() {
            return Next::Ok;
        }
        let own = std::mem::take(&mut self.current);
        let script = self.script.get_or_insert_with(|| Script { left: VecDeque::new(), begun: 0, own });
        for line in self.macros[slot].rsplit(|&byte| byte == b'|') {
            script.left.push_front(line.to_vec());
        }
        script.left.truncate(RUN_MAX.saturating_sub(script.begun));
        Next::Script
    }

    /// The next command of the macro that runs; `None` when it is at its end, which is its
    /// command's end too.
    pub(super) fn next_of_script(&mut self) -> Option<Vec<u8>> {
        let script = self.script.as_mut()?;
        if let Some(line) = script.left.pop_front() {
            script.begun += 1;
            return Some(line);
        }
        self.current = std::mem::take(&mut script.own);
        self.script = None;
        self.done();
        None
    }
}
