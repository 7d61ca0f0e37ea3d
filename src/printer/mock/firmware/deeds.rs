//! Which commands have really run: a move when its last piece has ended, anything
//! else when it is done.
//!
//! A command that was acknowledged and that a reset throws out of the planner never
//! ran, and this is where one can tell. Takes the ends of moves; knows no protocol.
use super::super::planner::Axes;
use super::Firmware;

/// Records kept for who does not fetch them: an hour of short moves. What comes later is
/// not kept.
const EXECUTED_MAX: usize = 1 << 20;

/// A command that ran. See [`Firmware::take_executed`].
#[derive(Clone, Debug, PartialEq)]
pub struct Executed {
    /// When it ended, on the board's clock.
    pub at_ns: u64,
    /// Its number on the wire, if it had one.
    pub number: Option<i64>,
    /// Its text without number and checksum.
    pub command: String,
    /// Where the nozzle then really was: X, Y, Z, mm.
    pub at_mm: [f64; 3],
    /// False when it was broken off.
    pub whole: bool,
}

/// A move that is in the planner, or on its way into it.
#[derive(Debug)]
pub(super) struct Deed {
    number: Option<i64>,
    /// FNV-1a does not commute: the text is needed when the move ends.
    command: Vec<u8>,
}

impl Firmware {
    /// A move's command is executed from now on.
    pub(super) fn begin_deed(&mut self, number: Option<i64>, command: &[u8]) {
        self.deeds.push_back(Deed { number, command: command.to_vec() });
    }

    /// The last piece of a move's command is in the planner.
    pub(super) fn deed_is_planned(&mut self) {
        // With nothing in the planner it is over already: it had no length.
        if !self.planner.end_command() {
            self.end_deed(true);
        }
    }

    /// The move that runs has come to its end.
    pub(super) fn end_move(&mut self) {
        let Some(ran) = self.planner.end_move(self.now_ns) else {
            return;
        };
        self.moved(ran.by_mm);
        for _ in 0..ran.ends {
            self.end_deed(true);
        }
    }

    /// The machine has really moved by so much.
    pub(super) fn moved(&mut self, by_mm: Axes) {
        let nozzle_c = self.nozzle_c();
        self.body.moved(by_mm, nozzle_c);
        self.light.plate_at(self.body.at_mm[2]);
    }

    fn end_deed(&mut self, whole: bool) {
        let Some(deed) = self.deeds.pop_front() else {
            return;
        };
        if whole {
            self.executed_digest.add(&deed.command);
        }
        self.note(deed.number, deed.command, whole);
    }

    /// All moves stop where they are; what was planned is dropped.
    pub(super) fn stop_moves(&mut self) {
        let stopped = self.planner.stop(self.now_ns);
        if stopped.ran_mm != [0.0; 4] {
            self.moved(stopped.ran_mm);
            self.end_deed(false);
        }
        self.deeds.clear();
        self.motion.stopped_short(stopped.left_mm);
    }

    /// The command at the head of the queue is done; moves are noted when they end.
    pub(super) fn note_executed(&mut self, number: Option<i64>) {
        let command = std::mem::take(&mut self.current);
        if !command.is_empty() {
            self.note(number, command, true);
        }
    }

    fn note(&mut self, number: Option<i64>, command: Vec<u8>, whole: bool) {
        if !self.config.record || self.executed.len() >= EXECUTED_MAX {
            return;
        }
        let command = String::from_utf8_lossy(&command).into_owned();
        self.executed.push(Executed { at_ns: self.now_ns, number, command, at_mm: self.body.at_mm, whole });
    }

    /// What was executed since the last call, in the order in which it ended: with
    /// [`super::super::Config::record`] only.
    pub fn take_executed(&mut self) -> Vec<Executed> {
        std::mem::take(&mut self.executed)
    }
}
