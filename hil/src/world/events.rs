//! What happens when, and to whom.
use super::{STATES, World};
use crate::scenario::{Fault, Kind, Lines, Place};
use crate::world::wire::Mishap;
use outrigger::job::host::Request;
use outrigger::job::state::State;
use outrigger::printer::mock::faults;

/// Faults that wait, and those whose time is known.
#[derive(Debug, Default)]
pub(super) struct Events {
    waiting: Vec<Fault>,
    due: Vec<(u64, Fault)>,
    /// When the first one happened.
    pub(super) first_ns: Option<u64>,
}

fn ns(seconds: f64) -> u64 {
    (seconds * 1e9) as u64
}

impl Events {
    pub(super) fn new(faults: &[Fault]) -> Self {
        let mut events = Self::default();
        for fault in faults {
            match fault.at_s {
                Some(at_s) => events.due.push((ns(at_s + fault.after_s), fault.clone())),
                None => events.waiting.push(fault.clone()),
            }
        }
        events
    }

    pub(super) fn next_ns(&self) -> Option<u64> {
        self.due.iter().map(|(at_ns, _)| *at_ns).min()
    }

    /// Whether a person or a supervisor will still do something about the job.
    pub(super) fn waits_for_person(&self) -> bool {
        self.due.iter().any(|(_, f)| matches!(f.kind, Kind::Confirm))
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
        let now = self.events.trigger(self.now_ns, |f| match (&f.at_line, &f.at_command) {
            (Some(Lines::One(at)), _) => command > 0 && *at == command as u64,
            (_, Some(text)) => memfind(line, text.as_bytes()),
            _ => false,
        });
        for fault in now {
            self.happen(fault, number);
        }
    }

    /// The job is in another state.
    pub(super) fn state_is(&mut self, state: State) {
        let name = STATES.iter().find(|(s, _)| *s == state).map_or("", |(_, name)| name);
        let now = self.events.trigger(self.now_ns, |f| f.at_state.as_deref() == Some(name));
        for fault in now {
            self.happen(fault, None);
        }
        let resumes = matches!(state, State::Paused | State::Asking);
        if let Some(after_ns) = self.plan.user.resumes_ns.filter(|_| resumes) {
            self.events.due.push((self.now_ns + after_ns, Fault::at_s(Kind::Resume, 0.0)));
        }
    }

    /// A process has ended: where it left the job interrupted, the user may look.
    pub(super) fn user_sees_the_end(&mut self) {
        let interrupted = self.life.state == State::Interrupted;
        if let Some(after_ns) = self.plan.user.confirms_ns.filter(|_| interrupted) {
            self.events.due.push((self.now_ns + after_ns, Fault::at_s(Kind::Confirm, 0.0)));
        }
    }

    /// Everything whose time has come.
    pub(super) fn happen_due(&mut self) {
        while let Some(at) = self.events.due.iter().position(|(at_ns, _)| *at_ns <= self.now_ns) {
            let (_, fault) = self.events.due.remove(at);
            self.happen(fault, None);
        }
    }

    fn happen(&mut self, fault: Fault, number: Option<i64>) {
        self.events.first_ns.get_or_insert(self.now_ns);
        self.note(format!("! {}", fault.kind.name()));
        match fault.kind.place() {
            Place::Wire => self.on_the_wire(&fault),
            Place::Board => self.on_the_board(fault, number),
            Place::Host => self.on_the_host(fault),
            Place::Disk => match fault.kind {
                Kind::DiskSlow => self.disk.slow(ns(fault.for_s.unwrap_or_default())),
                _ => self.disk.fail(self.now_ns + ns(fault.for_s.unwrap_or_default())),
            },
        }
    }

    fn on_the_wire(&mut self, fault: &Fault) {
        let until_ns = self.now_ns + ns(fault.for_s.unwrap_or_default());
        let times = fault.times.unwrap_or(1) as usize;
        let lines = |mishap| std::iter::repeat_n(mishap, times);
        match fault.kind {
            Kind::CorruptLine => self.link.next_lines.extend(lines(Mishap::Corrupt(fault.byte.or(Some(5))))),
            Kind::LoseLine => self.link.next_lines.extend(lines(Mishap::Lose)),
            Kind::LoseEnd => self.link.next_lines.extend(lines(Mishap::LoseEnd)),
            Kind::CorruptReply => {
                self.link.next_replies.extend(lines(Mishap::Corrupt(fault.byte.or(Some(1)))));
            }
            Kind::LoseReply => self.link.next_replies.extend(lines(Mishap::Lose)),
            Kind::HoldLines => self.link.out.hold(until_ns),
            Kind::HoldReplies => self.link.back.hold(until_ns),
            Kind::Insert => {
                self.link.inserted.extend_from_slice(fault.text.as_deref().unwrap_or_default().as_bytes());
            }
            Kind::Block => self.link.blocked_until_ns = until_ns,
            _ => self.unplug(until_ns),
        }
    }

    fn on_the_board(&mut self, fault: Fault, number: Option<i64>) {
        let kind = match fault.kind {
            Kind::ResendWithoutOk => faults::Kind::ResendWithoutOk,
            Kind::DropOk => faults::Kind::DropOk,
            Kind::Say => faults::Kind::Say,
            Kind::Halt => faults::Kind::Kill,
            Kind::Hang => faults::Kind::Hang,
            _ => faults::Kind::Reset,
        };
        if matches!(fault.kind, Kind::UnplugReset | Kind::PowerCut) {
            self.unplug(self.now_ns + ns(fault.for_s.unwrap_or_default()));
        }
        let of_line = matches!(fault.kind, Kind::ResendWithoutOk | Kind::DropOk);
        let injected = faults::Fault {
            at_line: number.filter(|_| of_line),
            at_s: None,
            kind,
            for_s: fault.for_s.filter(|_| fault.kind == Kind::Hang),
            text: fault.text,
            byte: fault.byte,
            times: fault.times,
        };
        self.board.inject(self.now_ns, injected);
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

fn memfind(line: &[u8], text: &[u8]) -> bool {
    !text.is_empty() && line.windows(text.len()).any(|w| w == text)
}
