//! The host's life: its first process, its death, its heirs; and what it says and wants.
use super::World;
use super::events::of_mock;
use super::plate::Plate;
use super::source::{Lines, Reading};
use crate::scenario::{Fault, Kind};
use outrigger::job::host::{Begin, Host, HostEvent, PortWish, Request};
use outrigger::job::record::Record;
use outrigger::job::recover::Case;
use outrigger::job::state::State;
use outrigger::printer::session::{Event, Outcome};
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

/// From the port being there again to its being open: who waits for it looks now
/// and then.
const REOPEN_NS: u64 = 250_000_000;

/// What is known of the processes.
#[derive(Debug)]
pub(super) struct Life {
    pub(super) outcome: Option<Outcome>,
    pub(super) state: State,
    pub(super) processes: u32,
    pub(super) fresh: u32,
    /// When the heir of a killed process begins.
    pub(super) restarts_ns: Option<u64>,
    /// Whether that heir has a person's word that part and nozzle are clear.
    confirmed: bool,
    /// What users want, in order.
    pub(super) requests: VecDeque<Request>,
    /// The job's file is another from this command on.
    changed_at: Arc<AtomicUsize>,
    /// When a person said that part and nozzle are clear.
    pub(super) confirmed_ns: Vec<u64>,
    /// The journal's medium refused, and has kept nothing since.
    pub(super) unkept: bool,
}

impl Default for Life {
    fn default() -> Self {
        Self {
            outcome: None,
            state: State::Accepted,
            processes: 0,
            fresh: 0,
            restarts_ns: None,
            confirmed: false,
            requests: VecDeque::new(),
            changed_at: Arc::new(AtomicUsize::new(usize::MAX)),
            confirmed_ns: Vec::new(),
            unkept: false,
        }
    }
}

impl World {
    /// The first process opens the port.
    pub(super) fn begin(&mut self) {
        self.start(true);
    }

    fn start(&mut self, fresh: bool) {
        self.life.processes += 1;
        self.life.fresh += u32::from(fresh);
        self.life.outcome = None;
        let opened = Record::Opened { port: "virtual".to_owned(), baud: self.plan.config.baud, at_unix_s: 0 };
        let Some(log) = self.disk.open(&opened) else {
            self.told.push_str("the journal cannot be read\n");
            return;
        };
        let begin = match fresh {
            true => Begin::Fresh,
            false => Begin::TakeOver { log: Box::new(log) },
        };
        let mut settings = self.plan.settings.clone();
        // Who says that all is clear waits at the terminal for the plan.
        settings.waits_for_person = std::mem::take(&mut self.life.confirmed);
        if settings.waits_for_person && self.life.confirmed_ns.last() != Some(&self.now_ns) {
            // The port was not there yet; the word is of when it is.
            self.life.confirmed_ns.push(self.now_ns);
        }
        self.note(format!("process {} begins: {begin:?}", self.life.processes));
        self.board.connect(self.now_ns);
        self.open = true;
        let lines = match &self.plan.resin {
            Some(resin) => {
                self.panel.borrow_mut().begins();
                Lines::Plate(Box::new(Plate::new(resin.script.clone(), Rc::clone(&self.panel))))
            }
            None => Lines::File(Reading::new(self.plan.commands.clone(), Arc::clone(&self.life.changed_at))),
        };
        self.host = Some(Host::new(settings, lines, &begin, self.now_ms()));
    }

    /// Whether anything will still begin by itself.
    pub(super) fn comes_more(&self) -> bool {
        self.life.restarts_ns.is_some() || self.events.waits_for_person()
    }

    /// The heir of a dead process begins when its time has come and the port is there.
    pub(super) fn start_heir(&mut self) {
        if self.life.restarts_ns.is_none_or(|at_ns| at_ns > self.now_ns) {
            return;
        }
        if self.link.gone_until_ns > self.now_ns {
            self.life.restarts_ns = Some(self.link.gone_until_ns);
            return;
        }
        self.life.restarts_ns = None;
        self.start(false);
    }

    /// kill -9: nothing is said to anybody; what is on the wire goes on.
    pub(super) fn kill_host(&mut self, for_ns: u64) {
        if self.host.take().is_none() {
            return;
        }
        self.close_port();
        self.panel.borrow_mut().killed();
        self.life.requests.clear();
        self.life.unkept = false;
        let dice = &mut self.dice;
        self.disk.process_dies(|records| dice.below(records as u64 + 1) as usize);
        self.life.restarts_ns = Some(self.now_ns + for_ns);
    }

    /// A person has looked: part and nozzle are clear.
    pub(super) fn confirm(&mut self) {
        if self.host.is_none() && self.life.state == State::Interrupted {
            self.life.confirmed = true;
            self.life.confirmed_ns.push(self.now_ns);
            self.life.restarts_ns = Some(self.now_ns);
        }
    }

    pub(super) fn change_file(&mut self) {
        self.life.changed_at.fetch_min(self.progress.sent, Ordering::Relaxed);
    }

    pub(super) fn unplug(&mut self, until_ns: u64) {
        self.link.unplug(until_ns);
        if self.plan.resin.is_some() {
            // What an adapter has and has not sent yet goes with its power.
            let for_s = (until_ns - self.now_ns) as f64 / 1e9;
            self.board.inject(self.now_ns, cut(for_s));
            self.board.take_hang_up();
        }
        let was_open = std::mem::take(&mut self.open);
        let now_ms = self.now_ms();
        if let Some(host) = self.host.as_mut().filter(|_| was_open) {
            host.link_lost("the device is gone".to_owned(), now_ms);
        }
    }

    fn close_port(&mut self) {
        self.open = false;
        self.opens_ns = None;
        self.link.back.cut();
    }

    /// The port is there and wanted.
    pub(super) fn open_port(&mut self) {
        if self.opens_ns.is_none_or(|at_ns| at_ns > self.now_ns) {
            return;
        }
        if self.link.gone_until_ns > self.now_ns {
            // It went again meanwhile.
            self.opens_ns = Some(self.link.gone_until_ns + REOPEN_NS);
            return;
        }
        self.opens_ns = None;
        self.open = true;
        self.board.connect(self.now_ns);
        let now_ms = self.now_ms();
        self.note("port open again".to_owned());
        if let Some(host) = &mut self.host {
            host.link_back(now_ms);
        }
    }

    /// All that the host has to say and wants, until it waits.
    pub(super) fn settle(&mut self) {
        loop {
            let mut any = self.requests();
            any |= self.take_records();
            any |= self.take_events();
            any |= self.take_output();
            any |= self.grant_wish();
            if !any {
                return;
            }
        }
    }

    fn requests(&mut self) -> bool {
        let now_ms = self.now_ms();
        // As the program does: nobody resumes before the journal is written again.
        let held = self.life.unkept && self.life.requests.front() == Some(&Request::Resume);
        let Some(host) = self.host.as_mut().filter(|_| !held) else {
            return false;
        };
        let Some(request) = self.life.requests.pop_front() else {
            return false;
        };
        host.request(request, now_ms);
        true
    }

    fn take_records(&mut self) -> bool {
        let mut any = false;
        while let Some(record) = self.host.as_mut().and_then(Host::poll_record) {
            self.note(format!("  record {record:?}"));
            self.disk.append(record);
            any = true;
        }
        if any {
            self.disk.begin(self.now_ns);
        }
        any
    }

    fn take_events(&mut self) -> bool {
        let mut any = false;
        while let Some(event) = self.host.as_mut().and_then(Host::poll_event) {
            any = true;
            if self.plan.transcript || self.plan.resin.is_some() {
                self.note(format!("  {event:?}"));
                self.told.push_str(&telling(&event));
                self.told.push('\n');
            }
            if event == HostEvent::Planned {
                self.life.requests.push_back(Request::Confirm);
            }
            if let HostEvent::State(state) = event {
                self.life.state = state;
                self.state_is(state);
            }
        }
        any
    }

    /// Whole lines go on their way, unless the port takes nothing.
    fn take_output(&mut self) -> bool {
        if !self.open || self.link.blocked_until_ns > self.now_ns {
            return false;
        }
        let Some(host) = self.host.as_mut().filter(|h| !h.output().is_empty()) else {
            return false;
        };
        let out = host.output().to_vec();
        host.written(out.len());
        let mut bytes = out.as_slice();
        while let Some(line) = self.link.out.take(&mut bytes) {
            self.write_down('>', &line);
            let number = number_of(&line);
            let command = self.advance_job(&line);
            self.line_goes_out(&line, command, number);
            if self.open {
                self.link.send(line, self.now_ns, &mut self.dice);
            }
        }
        true
    }

    /// Which new command of the job a line is, from 1; 0 for none.
    fn advance_job(&mut self, line: &[u8]) -> usize {
        let Some(next) = self.plan.commands.get(self.progress.sent) else {
            return 0;
        };
        if command_of(line) != Some(next) {
            return 0;
        }
        self.progress.sent += 1;
        self.progress.begun_ns.get_or_insert(self.now_ns);
        let since = self.progress.last_ns.replace(self.now_ns).unwrap_or(self.now_ns);
        self.progress.stall_ns = self.progress.stall_ns.max(self.now_ns - since);
        self.progress.sent
    }

    fn grant_wish(&mut self) -> bool {
        let now_ms = self.now_ms();
        let Some(host) = &mut self.host else {
            return false;
        };
        match host.port() {
            PortWish::Keep => false,
            PortWish::Reopen => {
                if self.opens_ns.is_some() || self.open {
                    return false;
                }
                self.opens_ns = Some(self.now_ns.max(self.link.gone_until_ns) + REOPEN_NS);
                false
            }
            PortWish::HardStop => {
                let resets = self.plan.hard_stop && self.open;
                if resets {
                    self.board.inject(self.now_ns, reset());
                }
                host.hard_stopped(resets, now_ms);
                true
            }
            PortWish::Close => {
                self.life.outcome = host.outcome().cloned();
                self.host = None;
                self.close_port();
                if self.plan.resin.is_some() {
                    self.panel.borrow_mut().ended();
                }
                self.disk.process_ends(self.now_ns);
                self.life.unkept = false;
                let now_ns = self.now_ns;
                self.note(format!("process ends in {:?} at {now_ns}", self.life.state));
                self.user_sees_the_end();
                true
            }
        }
    }
}

/// The cable is out: nothing goes through for so long.
fn cut(for_s: f64) -> outrigger::printer::mock::faults::Fault {
    outrigger::printer::mock::faults::Fault {
        kind: outrigger::printer::mock::faults::Kind::HangUp,
        for_s: Some(for_s),
        ..reset()
    }
}

/// What DTR does to a board that listens to it.
fn reset() -> outrigger::printer::mock::faults::Fault {
    of_mock(&Fault::at_s(Kind::Reset, 0.0), None)
}

/// An event as a user would see it.
fn telling(event: &HostEvent) -> String {
    match event {
        HostEvent::Told(text) => text.clone(),
        HostEvent::Refused(why) => (*why).to_owned(),
        HostEvent::Case(Case::Refused(why)) => why.to_string(),
        HostEvent::Session(Event::Ended(Outcome::Stopped { ending, safety })) => {
            format!("{} {safety:?}", ending_words(ending))
        }
        other => format!("{other:?}"),
    }
}

fn ending_words(ending: &outrigger::printer::session::Ending) -> String {
    match ending {
        outrigger::printer::session::Ending::Failed(failure) => failure.to_string(),
        other => format!("{other:?}"),
    }
}

/// The command of a framed line.
pub(crate) fn command_of(line: &[u8]) -> Option<&[u8]> {
    let line = line.strip_prefix(b"N")?;
    let digits = line.iter().take_while(|b| b.is_ascii_digit()).count();
    let line = line[digits..].strip_prefix(b" ")?;
    let star = line.iter().rposition(|b| *b == b'*')?;
    Some(&line[..star])
}

/// Its number.
pub(crate) fn number_of(line: &[u8]) -> Option<i64> {
    let digits = line.strip_prefix(b"N")?;
    let end = digits.iter().take_while(|b| b.is_ascii_digit()).count();
    std::str::from_utf8(&digits[..end]).ok()?.parse().ok()
}
