//! Host, journal, disk, wire and board on one virtual clock.
//!
//! Takes a [`Plan`]: the job, both sides' settings, what happens when. [`World::run`] jumps
//! from one deadline to the next, never sleeps, and gives a [`Report`] of what the board did
//! and the user was told. Judges nothing.
//!
//! # Layout
//! Here the plan, the report and the loop · `events` what happens when and to whom · `process`
//! the host's life, death and heirs · [`link`] and [`wire`] the line, both ways and one · [`disk`] the
//! journal's medium · [`source`] the job's lines · [`plate`] those of a resin job, and its display.
pub mod disk;
pub mod events;
pub mod link;
pub mod plate;
mod process;
pub mod source;
pub mod wire;

use crate::dice::Dice;
use crate::scenario::Fault;
use disk::{Disk, DiskPlan, Synced};
use link::Link;
use outrigger::job::host::{Host, HostSettings, Request};
use outrigger::job::record::Accepted;
use outrigger::job::state::State;
use outrigger::printer::mock::{Config, Executed, Faults, Firmware, Pulse, Stats};
use outrigger::printer::session::Outcome;
use plate::{Panel, Resin, ScreenPlan, Shown};
use source::{Commands, Lines};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use wire::Chances;

/// Every state with its name in scenarios.
pub const STATES: [(State, &str); 17] = [
    (State::Accepted, "accepted"),
    (State::Starting, "starting"),
    (State::Printing, "printing"),
    (State::Pausing, "pausing"),
    (State::Paused, "paused"),
    (State::Resuming, "resuming"),
    (State::Asking, "asking"),
    (State::Lost, "lost"),
    (State::TakingOver, "taking_over"),
    (State::Recovering, "recovering"),
    (State::Ending, "ending"),
    (State::Cancelling, "cancelling"),
    (State::Failing, "failing"),
    (State::Interrupted, "interrupted"),
    (State::Finished, "finished"),
    (State::Cancelled, "cancelled"),
    (State::Failed, "failed"),
];

/// Lines of the transcript that are kept: hours of a run that hangs and reports temperatures.
const TRANSCRIPT_LINES: usize = 50_000;

/// Steps without any passing of time after which the world is said to be stuck: a
/// live lock between two sans-I/O cores would otherwise be an endless loop.
const STUCK_STEPS: u32 = 100_000;

/// Time after the last process's end in which the board's own moves come to an end, ns.
const AFTERMATH_NS: u64 = 120_000_000_000;

/// All that a run needs to be told.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What is printed.
    pub commands: Commands,
    /// It is a resin job, and these are its commands.
    pub resin: Option<Resin>,
    /// The host's.
    pub settings: HostSettings,
    /// The board's.
    pub config: Config,
    /// The board's scripted faults.
    pub board: Faults,
    /// What happens to lines to the board.
    pub out: Chances,
    /// What happens to replies.
    pub back: Chances,
    /// The journal's medium.
    pub disk: DiskPlan,
    /// What happens, and when.
    pub faults: Vec<Fault>,
    /// What the user does by himself.
    pub user: User,
    /// Whether the host can reset the board.
    pub hard_stop: bool,
    /// Where the dice begin.
    pub seed: u64,
    /// When a run that has not ended is stopped, ns.
    pub limit_ns: u64,
    /// Whether a transcript is kept.
    pub transcript: bool,
    /// Whether the heaters are looked at all the time, to know when they went off.
    pub watch_heat: bool,
}

/// What the user does by himself, whenever it comes to it.
#[derive(Debug, Clone, Copy, Default)]
pub struct User {
    /// Resumes what is paused or waits for a person after so long, ns.
    pub resumes_ns: Option<u64>,
    /// Says that part and nozzle are clear, and resumes what is interrupted, so long after, ns.
    pub confirms_ns: Option<u64>,
}

/// What came of a run.
#[derive(Debug)]
pub struct Report {
    /// Whether it came to an end by itself.
    pub over: bool,
    /// The last process's outcome.
    pub outcome: Option<Outcome>,
    /// The last process's last state.
    pub state: State,
    /// Processes that worked on the job.
    pub processes: u32,
    /// Processes that began it from its first line.
    pub fresh: u32,
    /// What the board did.
    pub deeds: Vec<Executed>,
    /// When the board began to start, each time, ns.
    pub starts_ns: Vec<u64>,
    /// When its light was on.
    pub light: Vec<Pulse>,
    /// What the display showed.
    pub shown: Vec<Shown>,
    /// The board's counts at the end.
    pub stats: Stats,
    /// What the user was told.
    pub told: String,
    /// When the last process ended, ns.
    pub ended_ns: u64,
    /// When the first command of the job went out, ns.
    pub begun_ns: Option<u64>,
    /// When the first fault happened, ns.
    pub fault_ns: Option<u64>,
    /// When both heaters' targets were first 0 after it, ns; only if watched.
    pub cold_ns: Option<u64>,
    /// Longest time between new commands of the job on the wire, ns.
    pub stall_ns: u64,
    /// Commands of the job that went out.
    pub sent: usize,
    /// Lines and replies that something happened to.
    pub mishaps: u64,
    /// When a person said that part and nozzle are clear, ns.
    pub confirmed_ns: Vec<u64>,
    /// The tail of what was said, if it was kept.
    pub transcript: VecDeque<String>,
}

/// How far the job is on the wire, and how long that took.
#[derive(Debug, Default)]
struct Progress {
    sent: usize,
    begun_ns: Option<u64>,
    last_ns: Option<u64>,
    stall_ns: u64,
}

/// Host, journal, disk, wire and board.
#[derive(Debug)]
pub struct World {
    plan: Plan,
    now_ns: u64,
    dice: Dice,
    board: Firmware,
    link: Link,
    /// The host has the port open.
    open: bool,
    /// The host wants it open, and gets it then.
    opens_ns: Option<u64>,
    disk: Disk,
    panel: Rc<RefCell<Panel>>,
    host: Option<Host<Lines>>,
    life: process::Life,
    events: events::Events,
    progress: Progress,
    cold_ns: Option<u64>,
    told: String,
    transcript: VecDeque<String>,
}

impl World {
    /// A world at time 0, before the first process.
    pub fn new(plan: Plan) -> Self {
        let config = Config { record: true, ..plan.config.clone() };
        let board = Firmware::new(config, plan.board.clone());
        let screen = plan.resin.as_ref().map_or_else(ScreenPlan::default, |resin| resin.screen);
        let accepted = Accepted {
            path: "/virtual/job.gcode".into(),
            commands: plan.commands.len() as u64,
            profile: crate::play::DEFAULT_PROFILE.to_owned(),
            ..Accepted::default()
        };
        Self {
            now_ns: 0,
            dice: Dice::new(plan.seed),
            board,
            link: Link::new(plan.out, plan.back),
            open: false,
            opens_ns: None,
            disk: Disk::new(plan.disk, accepted, plan.seed),
            panel: Rc::new(RefCell::new(Panel::new(screen))),
            host: None,
            life: process::Life::default(),
            events: events::Events::new(&plan.faults),
            progress: Progress::default(),
            cold_ns: None,
            told: String::new(),
            transcript: VecDeque::new(),
            plan,
        }
    }

    /// Runs it to its end.
    pub fn run(mut self) -> Report {
        self.begin();
        let mut over = false;
        let mut steps = 0;
        while self.now_ns <= self.plan.limit_ns && steps < STUCK_STEPS {
            self.settle();
            if self.host.is_none() && !self.comes_more() {
                over = true;
                break;
            }
            let Some(next_ns) = self.next_ns() else {
                break;
            };
            steps = if next_ns > self.now_ns { 0 } else { steps + 1 };
            self.now_ns = self.now_ns.max(next_ns);
            self.step();
        }
        self.report(over)
    }

    fn report(mut self, over: bool) -> Report {
        let ended_ns = self.now_ns;
        self.board.advance(ended_ns + AFTERMATH_NS);
        // The last host is gone with its share of it.
        self.host = None;
        let shown = Rc::into_inner(self.panel).map_or_else(Vec::new, |panel| panel.into_inner().into_shown());
        Report {
            over,
            outcome: self.life.outcome.take(),
            state: self.life.state,
            processes: self.life.processes,
            fresh: self.life.fresh,
            deeds: self.board.take_executed(),
            starts_ns: self.board.starts_ns().to_vec(),
            light: self.board.light().to_vec(),
            shown,
            stats: self.board.stats(),
            told: self.told,
            ended_ns,
            begun_ns: self.progress.begun_ns,
            fault_ns: self.events.first_ns,
            cold_ns: self.cold_ns,
            stall_ns: self.progress.stall_ns,
            sent: self.progress.sent,
            mishaps: self.link.out.mishaps + self.link.back.mishaps,
            confirmed_ns: self.life.confirmed_ns,
            transcript: self.transcript,
        }
    }

    /// When something is due next.
    fn next_ns(&self) -> Option<u64> {
        let host = self.host.as_ref().and_then(Host::deadline).map(|ms| ms * 1_000_000);
        let blocked = (self.link.blocked_until_ns > self.now_ns).then_some(self.link.blocked_until_ns);
        [
            host,
            blocked,
            self.opens_ns,
            self.link.back.next_ns(),
            self.link.out.next_ns(),
            self.board.deadline_ns(),
            self.disk.next_ns(),
            self.panel.borrow().next_ns(),
            self.events.next_ns(),
            self.life.restarts_ns,
        ]
        .into_iter()
        .flatten()
        .min()
    }

    /// Everything that is due by now.
    fn step(&mut self) {
        self.look_at_panel();
        self.happen_due();
        self.start_heir();
        self.open_port();
        while let Some(bytes) = self.link.out.arrived(self.now_ns, self.board.room()) {
            self.board.receive(self.now_ns, &bytes);
        }
        self.board.advance(self.now_ns);
        self.hear_board();
        while let Some(bytes) = self.link.back.arrived(self.now_ns, usize::MAX) {
            let now_ms = self.now_ms();
            if let Some(host) = self.host.as_mut().filter(|_| self.open) {
                host.on_bytes(&bytes, now_ms);
                self.settle();
            }
        }
        let now_ms = self.now_ms();
        match (self.disk.synced(self.now_ns), &mut self.host) {
            (Some(Synced::Durable(records)), Some(host)) => {
                self.life.unkept = false;
                host.durable(records, now_ms);
            }
            // As the program does: a disk that refuses pauses the job.
            (Some(Synced::Refused), Some(host))
                if !std::mem::replace(&mut self.life.unkept, true) && !host.is_over() =>
            {
                host.request(Request::Pause, now_ms);
            }
            _ => {}
        }
        if let Some(host) = self.host.as_mut().filter(|h| h.deadline().is_some_and(|at| at <= now_ms)) {
            host.on_tick(now_ms);
        }
        self.look_at_heat();
    }

    /// What the display has done is news for the host.
    fn look_at_panel(&mut self) {
        let news = self.panel.borrow_mut().advance(self.now_ns);
        let now_ms = self.now_ms();
        if let Some(host) = self.host.as_mut().filter(|_| news) {
            host.look(now_ms);
            self.settle();
        }
    }

    fn now_ms(&self) -> u64 {
        self.now_ns / 1_000_000
    }

    /// Replies of the board go on their way.
    fn hear_board(&mut self) {
        let mut out = Vec::new();
        self.board.take_output(&mut out);
        if self.now_ns < self.link.gone_until_ns || !self.open {
            // Nobody has the port open: a terminal forgets what nobody reads.
            return;
        }
        let mut said = Vec::new();
        let keep = self.plan.transcript;
        self.link.reply(&out, self.now_ns, &mut self.dice, |line| {
            if keep {
                said.push(line.to_vec());
            }
        });
        for line in said {
            self.write_down('<', &line);
        }
    }

    fn look_at_heat(&mut self) {
        if self.plan.watch_heat && self.events.first_ns.is_some() && self.cold_ns.is_none() {
            let stats = self.board.stats();
            if !stats.heaters_on {
                self.cold_ns = Some(self.now_ns);
            }
        }
    }

    fn write_down(&mut self, mark: char, line: &[u8]) {
        if self.plan.transcript {
            let text = String::from_utf8_lossy(line).trim_end().escape_debug().to_string();
            self.note(format!("{mark} {text}"));
        }
    }

    fn note(&mut self, text: String) {
        if self.plan.transcript {
            if self.transcript.len() == TRANSCRIPT_LINES {
                self.transcript.pop_front();
            }
            self.transcript.push_back(format!("{:11.4} {text}", self.now_ns as f64 / 1e9));
        }
    }
}

impl World {
    /// The report of a job that no process ever began, and why.
    pub fn unused(mut self, told: String) -> Report {
        self.told = told;
        self.report(true)
    }
}
