//! A person beside the job: commands, answers, and what the printer wants of one.
//!
//! M108, M410 and M876 are read by an emergency parser as the bytes arrive; they go
//! without a number, ahead of what waits. The line that is half out goes first: it costs
//! a few bytes, and a line cut in two would be asked for again. Firmware answers them
//! with a bare `ok` all the same, which acknowledges no line of the window: it is
//! recognised by its place among the others.
use super::kind::{is_urgent, kind_of, sets_line_number, stops};
use super::settings::*;
use super::{Event, Feed, Phase, Session, Waiting};
use crate::printer::action::{Action, Prompts, Step, says_runout};
use crate::printer::reply::Busy;
use crate::printer::window::Kind;
use outrigger_gcode::checksum::{fit, framed_len, sendable};
use std::collections::VecDeque;

/// What is between the session and a person.
#[derive(Debug, Default)]
pub(super) struct Person {
    /// Commands that wait for their turn among the lines.
    commands: VecDeque<Vec<u8>>,
    /// For each unnumbered command whose `ok` is awaited: the line that follows it.
    strays: VecDeque<u32>,
    prompts: Prompts,
    /// What the printer's busy notes say.
    noted: Option<Waiting>,
    /// The command that waits for a person, and since when.
    at_work: Option<(u32, u64)>,
    told: Option<Waiting>,
}

impl Person {
    /// Whether nothing of a person waits for its turn.
    pub(super) fn is_quiet(&self) -> bool {
        self.commands.is_empty()
    }

    pub(super) fn forget_commands(&mut self) {
        self.commands.clear();
    }

    /// Lines were lost or numbered anew: the `ok`s of what went between them may
    /// never come.
    pub(super) fn forget_strays(&mut self) {
        self.strays.clear();
    }

    /// The printer threw away what came after line `n`.
    pub(super) fn forget_strays_after(&mut self, n: u32) {
        self.strays.retain(|follows| *follows <= n);
    }

    /// Whether a bare `ok`, with all lines before `acked` acknowledged, is that of an
    /// unnumbered command.
    pub(super) fn takes_ok(&mut self, acked: u32) -> bool {
        let takes = self.strays.front().is_some_and(|follows| *follows <= acked);
        takes && self.strays.pop_front().is_some()
    }

    pub(super) fn noted(&mut self, busy: Busy) {
        self.noted = match busy {
            Busy::Processing => None,
            Busy::PausedForUser => Some(Waiting::User),
            Busy::PausedForInput => Some(Waiting::Input),
        };
    }

    /// Something was acknowledged: the printer goes on.
    pub(super) fn goes_on(&mut self) {
        self.noted = None;
    }

    pub(super) fn deadline(&self) -> Option<u64> {
        let (_, since_ms) = self.at_work.filter(|_| self.told.is_none())?;
        Some(since_ms + WAITING_AFTER_MS)
    }
}

impl Session {
    /// A command of a person. M112 is an emergency stop; M108, M410 and M876 go at once,
    /// unnumbered; any other goes as a line of our own between the job's (with
    /// [`Settings::asks`] once it is allowed), also while it is held.
    ///
    /// `false`, and nothing is sent, for what is no command, does not fit a line, sets the
    /// line number (M110), or comes when it cannot be sent: before the handshake is
    /// through, after a cancel or failure, with many others waiting.
    pub fn command(&mut self, command: &str, now_ms: u64) -> bool {
        let mut scratch = Vec::new();
        let Some(command) = sendable(command.as_bytes(), &mut scratch) else {
            return false;
        };
        if stops(command) {
            let works = !self.is_over();
            self.emergency_stop(now_ms);
            return works;
        }
        if is_urgent(command) {
            return self.interject(command, now_ms);
        }
        let waits = matches!(self.phase, Phase::Job | Phase::Lost { anew: false } | Phase::Search(_))
            || matches!(self.phase, Phase::Identify { whence, .. } if whence != super::Whence::Anew);
        // Numbers grow until it is its turn; six digits more than now are a long job.
        let n = self.window.next().saturating_mul(10).max(999_999);
        if !waits
            || self.ending.is_some()
            || self.person.commands.len() >= MAX_COMMANDS
            || sets_line_number(command)
            || fit(n, command, self.settings.max_line).is_err()
        {
            return false;
        }
        self.person.commands.push_back(command.to_vec());
        self.pump(now_ms);
        true
    }

    /// The answer to the prompt: the place of a button, from 0 ([`Event::Prompt`]).
    /// `false`, and nothing is sent, when nothing is asked.
    pub fn answer(&mut self, choice: u8, now_ms: u64) -> bool {
        let sent =
            self.person.prompts.is_open() && self.interject(format!("M876 S{choice}").as_bytes(), now_ms);
        if sent && self.person.prompts.close() {
            self.tell(Event::Prompt(None));
        }
        sent
    }

    /// Sends a command ahead of what is not written yet.
    fn interject(&mut self, command: &[u8], now_ms: u64) -> bool {
        let hears = matches!(
            self.phase,
            Phase::Identify { .. }
                | Phase::Job
                | Phase::WindDown { .. }
                | Phase::Safe { .. }
                | Phase::Search(_)
        );
        if !hears || fit(0, command, self.settings.max_line).is_err() {
            return false;
        }
        let begun = self.out_at > 0 && self.out[self.out_at - 1] != b'\n';
        let at = match begun {
            false => self.out_at,
            true => memchr::memchr(b'\n', &self.out[self.out_at..])
                .map_or(self.out.len(), |end| self.out_at + end + 1),
        };
        let lines_behind = self.out[at..].split(|b| *b == b'\n').filter(|l| l.first() == Some(&b'N')).count();
        if self.person.strays.len() < MAX_STRAYS && !matches!(self.phase, Phase::Search(_)) {
            let follows = self.window.cursor().saturating_sub(lines_behind as u32);
            self.person.strays.push_back(follows);
        }
        self.out.splice(at..at, command.iter().copied().chain([b'\n']));
        self.pump(now_ms);
        true
    }

    /// The next command of a person in the line's turn. `true`: one was numbered.
    pub(super) fn push_command(&mut self) -> bool {
        let Some(command) = self.person.commands.front() else {
            return false;
        };
        let n = self.window.next();
        if !self.window.has_room(framed_len(n, command.len()) + 1) {
            return false;
        }
        let command = self.person.commands.pop_front().unwrap_or_default();
        // The check before was for a longer number.
        let Ok(fitted) = fit(n, &command, self.settings.max_line) else {
            return true;
        };
        self.touched = true;
        self.proof_tries = 0;
        self.push_own(fitted, kind_of(fitted))
    }

    /// What follows `//action:`.
    pub(super) fn on_action(&mut self, action: &[u8]) {
        match self.person.prompts.take(action) {
            Step::Act(action) => self.tell(Event::Action(action)),
            Step::Show(prompt) => self.tell(Event::Prompt(prompt)),
            Step::Nothing => {}
        }
    }

    /// A note may say what other firmware says by an action.
    pub(super) fn on_note(&mut self, note: &[u8]) {
        if says_runout(note) {
            self.tell(Event::Action(Action::OutOfFilament { extruder: None }));
        }
        self.tell(Event::Note(String::from_utf8_lossy(note).into_owned()));
    }

    /// Tells when the printer begins to wait for a person, and when it goes on.
    pub(super) fn watch_person(&mut self, now_ms: u64) {
        let in_job = matches!(self.phase, Phase::Job) || matches!(self.feed, Feed::Held);
        let oldest = self.window.in_flight().next().filter(|tag| in_job && tag.kind == Kind::User);
        self.person.at_work = oldest.map(|_| match self.person.at_work {
            Some((n, since_ms)) if n == self.window.acked() => (n, since_ms),
            _ => (self.window.acked(), now_ms),
        });
        let works_ms = self.person.at_work.map(|(_, since_ms)| now_ms.saturating_sub(since_ms));
        let long = works_ms.is_some_and(|ms| ms >= WAITING_AFTER_MS);
        let now = match self.is_over() {
            true => None,
            false => self.person.noted.or(long.then_some(Waiting::Command)),
        };
        if now != self.person.told && !self.is_over() {
            self.person.told = now;
            self.tell(Event::Waiting(now));
        }
    }
}
