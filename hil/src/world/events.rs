//! What happens when, and to whom.
use super::{STATES, World};
use crate::scenario::{Fault, Kind, Lines, Place};
use crate::world::link::ns;
use outrigger::job::host::Request;
use outrigger::job::state::State;
use outrigger::printer::mock::faults;

/// How often a user tries to resume a job: he reads why it was refused.
const CONFIRMS_MAX: usize = 4;

/// Faults that wait, and those whose time is known.
#[derive(Debug, Default)]
pub struct Events {
    waiting: Vec<Fault>,
    due: Vec<(u64, Fault)>,
    /// When the first one happened.
    pub first_ns: Option<u64>,
}

impl Events {
    /// What a scenario lists.
    pub fn new(faults: &[Fault]) -> Self {
        let mut events = Self::default();
        for fault in faults {
            match fault.at_s {
                Some(at_s) => events.due.push((ns(at_s + fault.after_s), fault.clone())),
                None => events.waiting.push(fault.clone()),
            }
        }
        events
    }

    /// When the next one is due.
    pub fn next_ns(&self) -> Option<u64> {
        self.due.iter().map(|(at_ns, _)| *at_ns).min()
    }

    /// Whether a person or a supervisor will still do something about the job.
    pub fn waits_for_person(&self) -> bool {
        self.due.iter().any(|(_, f)| matches!(f.kind, Kind::Confirm))
    }

    /// A line goes out: what waited for it. `command` counts from 1 and is 0 for what is
    /// not of the job or goes out again.
    pub fn line(&mut self, line: &[u8], command: usize, now_ns: u64) -> Vec<Fault> {
        self.trigger(now_ns, |f| match (&f.at_line, &f.at_command) {
            (Some(Lines::One(at)), _) => command > 0 && *at == command as u64,
            (_, Some(text)) => memfind(line, text.as_bytes()),
            _ => false,
        })
    }

    /// The job is in another state: what waited for it.
    pub fn state(&mut self, state: State, now_ns: u64) -> Vec<Fault> {
        let name = STATES.iter().find(|(s, _)| *s == state).map_or("", |(_, name)| name);
        self.trigger(now_ns, |f| f.at_state.as_deref() == Some(name))
    }

    /// One whose time has come.
    pub fn take_due(&mut self, now_ns: u64) -> Option<Fault> {
        let at = self.due.iter().position(|(at_ns, _)| *at_ns <= now_ns)?;
        Some(self.due.remove(at).1)
    }

    /// It is to happen then.
    pub fn later(&mut self, at_ns: u64, fault: Fault) {
        self.due.push((at_ns, fault));
    }

    /// Takes those whose trigger this is; those that are to come later get their time.
    fn trigger(&mut self, now_ns: u64, is_it: impl Fn(&Fault) -> bool) -> Vec<Fault> {
        let mut now = Vec::new();
        let mut at = 0;
        while at < self.waiting.len() {
            if !is_it(&self.waiting[at]) {
                at += 1;
                continue;
            }
            let fault = self.waiting.remove(at);
            match fault.after_s > 0.0 {
                true => self.due.push((now_ns + ns(fault.after_s), fault)),
                false => now.push(fault),
            }
        }
        now
    }
}

impl World {
    /// A line goes out: what waited for it happens. `command` counts from 1 and is 0 for
    /// what is not of the job or goes out again. `number` is the wire's.
    pub(super) fn line_goes_out(&mut self, line: &[u8], command: usize, number: Option<i64>) {
        if self.events.waiting.is_empty() {
            return;
        }
        let now = self.events.line(line, command, self.now_ns);
        for fault in now {
            self.happen(fault, number);
        }
    }

    /// The job is in another state.
    pub(super) fn state_is(&mut self, state: State) {
        let now = self.events.state(state, self.now_ns);
        for fault in now {
            self.happen(fault, None);
        }
        let resumes = matches!(state, State::Paused | State::Asking);
        if let Some(after_ns) = self.plan.user.resumes_ns.filter(|_| resumes) {
            self.events.later(self.now_ns + after_ns, Fault::at_s(Kind::Resume, 0.0));
        }
    }

    /// A process has ended: where it left the job interrupted, the user may look.
    pub(super) fn user_sees_the_end(&mut self) {
        let interrupted =
            self.life.state == State::Interrupted && self.life.confirmed_ns.len() < CONFIRMS_MAX;
        if let Some(after_ns) = self.plan.user.confirms_ns.filter(|_| interrupted) {
            self.events.later(self.now_ns + after_ns, Fault::at_s(Kind::Confirm, 0.0));
        }
    }

    /// Everything whose time has come.
    pub(super) fn happen_due(&mut self) {
        while let Some(fault) = self.events.take_due(self.now_ns) {
            self.happen(fault, None);
        }
    }

    fn happen(&mut self, fault: Fault, number: Option<i64>) {
        self.events.first_ns.get_or_insert(self.now_ns);
        self.note(format!("! {}", fault.kind.name()));
        match fault.kind.place() {
            Place::Wire if fault.kind == Kind::Unplug => {
                self.unplug(self.now_ns + ns(fault.for_s.unwrap_or_default()));
            }
            Place::Wire => self.link.happen(&fault, self.now_ns),
            Place::Board => self.on_the_board(fault, number),
            Place::Host => self.on_the_host(fault),
            Place::Disk => match fault.kind {
                Kind::DiskSlow => self.disk.slow(ns(fault.for_s.unwrap_or_default())),
                _ => self.disk.fail(self.now_ns + ns(fault.for_s.unwrap_or_default())),
            },
        }
    }

    fn on_the_board(&mut self, fault: Fault, number: Option<i64>) {
        if matches!(fault.kind, Kind::UnplugReset | Kind::PowerCut) {
            self.unplug(self.now_ns + ns(fault.for_s.unwrap_or_default()));
        }
        self.board.inject(self.now_ns, of_mock(&fault, number));
    }

    fn on_the_host(&mut self, fault: Fault) {
        let request = match fault.kind {
            Kind::Pause => Request::Pause,
            Kind::Resume => Request::Resume,
            Kind::Cancel => Request::Cancel,
            Kind::EmergencyStop => Request::EmergencyStop,
            Kind::Answer => Request::Answer(fault.button.unwrap_or_default()),
            Kind::Send => Request::Command(fault.text.unwrap_or_default()),
            Kind::Kill => return self.kill_host(ns(fault.for_s.unwrap_or_default())),
            Kind::Confirm => return self.confirm(),
            _ => return self.change_file(),
        };
        self.life.requests.push_back(request);
    }
}

/// A scenario's fault in the mock's own words. `number` is that of the line that it may be of.
pub fn of_mock(fault: &Fault, number: Option<i64>) -> faults::Fault {
    let kind = match fault.kind {
        Kind::ResendWithoutOk => faults::Kind::ResendWithoutOk,
        Kind::DropOk => faults::Kind::DropOk,
        Kind::Say => faults::Kind::Say,
        Kind::Halt => faults::Kind::Kill,
        Kind::Hang => faults::Kind::Hang,
        Kind::PowerCut => faults::Kind::PowerCut,
        Kind::FilamentOut => faults::Kind::FilamentOut,
        _ => faults::Kind::Reset,
    };
    let of_line = matches!(fault.kind, Kind::ResendWithoutOk | Kind::DropOk);
    let lasts = matches!(fault.kind, Kind::Hang | Kind::PowerCut);
    faults::Fault {
        at_line: number.filter(|_| of_line),
        at_s: None,
        kind,
        for_s: fault.for_s.filter(|_| lasts),
        text: fault.text.clone(),
        byte: fault.byte,
        times: fault.times,
        sag_mm: fault.sag_mm,
        unplugs: None,
        reset: None,
    }
}

fn memfind(line: &[u8], text: &[u8]) -> bool {
    !text.is_empty() && line.windows(text.len()).any(|w| w == text)
}
