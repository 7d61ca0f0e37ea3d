//! A resin job's lines and its display on the virtual clock.
//!
//! Takes orders as the program's own screen thread does, one after the other, each with the time
//! that it takes; gives what was done and when, and what the panel has shown. The machine of
//! exposures is the project's own. The panel outlives a process that is killed, and keeps its picture.
use outrigger::printer::exposure::script::Script;
use outrigger::printer::exposure::{Event, Exposure, Order, Phase};
use outrigger::printer::source::{Back, JobLine, May, News, Source, SourceError};
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

/// Until when a picture stays that may be lit: as the program has it.
const LIGHT_MARGIN: f64 = 1.05;

/// What a screen can be told to do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Task {
    /// Unpack a picture.
    Load,
    /// Show it.
    Show,
    /// Go dark.
    Blank,
}

/// What the display is like.
#[derive(Debug, Clone, Copy, Default)]
pub struct ScreenPlan {
    /// Time of a task, ns: of loading, showing and going dark.
    pub takes_ns: [u64; 3],
    /// It fails at so manieth of this task, from 1.
    pub fails: Option<(Task, u32)>,
}

/// A resin job in the world.
#[derive(Debug, Clone)]
pub struct Resin {
    /// Its lines.
    pub script: Script,
    /// The display.
    pub screen: ScreenPlan,
}

/// What the panel showed from when on; `None`: nothing.
pub type Shown = (u64, Option<u32>);

#[derive(Debug)]
enum Did {
    Loaded(u32),
    Shown(u32),
    Blanked,
    Failed(String),
}

/// The panel, and the thread before it.
#[derive(Debug)]
pub(super) struct Panel {
    plan: ScreenPlan,
    now_ns: u64,
    /// Orders with the time at which they are done.
    orders: VecDeque<(u64, Order)>,
    did: VecDeque<Did>,
    ready: Option<u32>,
    counts: [u32; 3],
    lit_until_ns: Option<u64>,
    shown: Vec<Shown>,
}

impl Panel {
    pub(super) fn new(plan: ScreenPlan) -> Self {
        Self {
            plan,
            now_ns: 0,
            orders: VecDeque::new(),
            did: VecDeque::new(),
            ready: None,
            counts: [0; 3],
            lit_until_ns: None,
            shown: Vec::new(),
        }
    }

    fn tell(&mut self, order: Order) {
        let task = match order {
            Order::Load(_) => Task::Load,
            Order::Show(_) => Task::Show,
            Order::Blank => Task::Blank,
        };
        let begins_ns = self.orders.back().map_or(self.now_ns, |(at_ns, _)| self.now_ns.max(*at_ns));
        self.orders.push_back((begins_ns + self.plan.takes_ns[task as usize], order));
    }

    /// When something is done next.
    pub(super) fn next_ns(&self) -> Option<u64> {
        self.orders.front().map(|(at_ns, _)| *at_ns)
    }

    /// Does what is due; whether there is something to look at.
    pub(super) fn advance(&mut self, now_ns: u64) -> bool {
        self.now_ns = now_ns;
        while let Some((at_ns, order)) = self.orders.front().copied().filter(|(at_ns, _)| *at_ns <= now_ns) {
            self.orders.pop_front();
            let did = self.obey(order, at_ns);
            self.did.push_back(did);
        }
        !self.did.is_empty()
    }

    fn obey(&mut self, order: Order, at_ns: u64) -> Did {
        let task = match order {
            Order::Load(_) => Task::Load,
            Order::Show(_) => Task::Show,
            Order::Blank => Task::Blank,
        };
        self.counts[task as usize] += 1;
        if self.plan.fails == Some((task, self.counts[task as usize])) {
            return Did::Failed(format!("the display fails at {task:?}"));
        }
        match order {
            Order::Load(layer) => {
                self.ready = Some(layer);
                Did::Loaded(layer)
            }
            Order::Show(layer) if self.ready == Some(layer) => {
                self.shown.push((at_ns, Some(layer)));
                Did::Shown(layer)
            }
            Order::Show(layer) => Did::Failed(format!("layer {layer} is to be shown and is not ready")),
            Order::Blank => {
                self.shown.push((at_ns, None));
                Did::Blanked
            }
        }
    }

    /// Another process begins: what was done before is none of its news.
    pub(super) fn begins(&mut self) {
        self.did.clear();
    }

    /// The process was killed: the panel keeps what it shows.
    pub(super) fn killed(&mut self) {
        self.orders.clear();
        self.did.clear();
        self.ready = None;
        self.lit_until_ns = None;
    }

    /// The process ends: it goes dark, but not in the light.
    pub(super) fn ended(&mut self) {
        let at_ns = self.lit_until_ns.take().unwrap_or_default().max(self.now_ns);
        self.killed();
        self.orders.push_back((at_ns, Order::Blank));
    }

    /// All that it showed.
    pub(super) fn into_shown(mut self) -> Vec<Shown> {
        self.advance(u64::MAX);
        self.shown
    }
}

/// A resin job's lines, as a host reads them.
#[derive(Debug)]
pub(super) struct Plate {
    machine: Exposure,
    panel: Rc<RefCell<Panel>>,
    orders: Vec<Order>,
    failed: Option<String>,
    line: Vec<u8>,
}

impl Plate {
    pub(super) fn new(script: Script, panel: Rc<RefCell<Panel>>) -> Self {
        Self { machine: Exposure::new(script), panel, orders: Vec::new(), failed: None, line: Vec::new() }
    }

    fn on(&mut self, event: Event<'_>, now_ms: u64) {
        self.machine.on(event, now_ms, &mut self.orders);
        let mut panel = self.panel.borrow_mut();
        if self.machine.phase() != Phase::Exposing {
            panel.lit_until_ns = None;
        } else if panel.lit_until_ns.is_none() {
            let script = self.machine.script();
            let ms = f64::from(script.exposure_ms()) * LIGHT_MARGIN + f64::from(script.lead_ms());
            panel.lit_until_ns = Some(panel.now_ns + (ms * 1e6) as u64);
        }
        self.orders.drain(..).for_each(|order| panel.tell(order));
    }

    fn look(&mut self, now_ms: u64) {
        loop {
            let did = self.panel.borrow_mut().did.pop_front();
            match did {
                None => return,
                Some(Did::Loaded(layer)) => self.on(Event::Loaded(layer), now_ms),
                Some(Did::Shown(layer)) => self.on(Event::Shown(layer), now_ms),
                Some(Did::Blanked) => self.on(Event::Blanked, now_ms),
                Some(Did::Failed(why)) => _ = self.failed.get_or_insert(why),
            }
        }
    }

    fn failure(&self) -> Option<&str> {
        self.failed.as_deref().or(self.machine.failure())
    }
}

impl Source for Plate {
    fn advance(&mut self) -> Result<bool, SourceError> {
        let place = self.machine.script().place();
        if let Some(why) = self.failure() {
            return Err(SourceError { line: place.lines, reason: why.to_owned() });
        }
        if place.layer >= self.machine.script().layers() {
            return Ok(false);
        }
        self.on(Event::Taken, 0);
        self.line.clear();
        self.line.extend_from_slice(self.machine.script().line().as_bytes());
        Ok(true)
    }

    fn line(&self) -> JobLine<'_> {
        JobLine { command: &self.line, number: self.machine.script().place().lines }
    }

    fn layer(&self) -> u32 {
        self.machine.layer() + 1
    }

    fn begin(&mut self) {
        self.on(Event::Begin, 0);
    }

    fn may(&mut self, now_ms: u64) -> May {
        self.look(now_ms);
        self.on(Event::Tick, now_ms);
        match self.failure() {
            Some(_) => May::Go,
            None => self.machine.may(),
        }
    }

    fn may_hold(&self) -> bool {
        self.machine.may_hold()
    }

    fn hear(&mut self, news: News<'_>, now_ms: u64) {
        match news {
            News::Acknowledged(line) => self.on(Event::Acknowledged(line), now_ms),
            News::Said(text) => self.on(Event::Heard(text), now_ms),
            News::AskedAgain => self.on(Event::AskedAgain, now_ms),
            News::Arrived => self.on(Event::Arrived, now_ms),
            News::Durable(lines) => self.on(Event::Durable(lines), now_ms),
        }
    }

    fn take_note(&mut self) -> bool {
        self.machine.take_note()
    }

    fn take_question(&mut self, now_ms: u64) -> bool {
        self.machine.take_question(now_ms)
    }

    fn due_ms(&self) -> Option<u64> {
        self.machine.due_ms()
    }

    fn go_back(&mut self, commands: u64) -> Option<Back> {
        let standing = self.machine.script().standing(commands);
        self.machine.go_to(standing.from);
        Some(Back {
            after: standing.from,
            layer: standing.layer + 1,
            begun: standing.exposed,
            at_mm: standing.at_mm,
        })
    }

    fn is_torn(&self) -> bool {
        self.machine.script().is_torn()
    }
}
