//! A resin job as a source of lines: the machine of [`exposure`](crate::printer::exposure), a
//! screen, and a clock that measures.
//!
//! Takes what the host hears; gives the screen its orders and the host its lines. Without a screen it
//! only tells where the lines lead.
use super::marks::Marks;
use super::screen::{Did, Screen};
use super::watchdog::{Keeper, LightWatch};
use crate::printer::exposure::script::{Script, Step, Timing};
use crate::printer::exposure::{Event, Exposure, Order, Phase};
use crate::printer::source::{Back, JobLine, May, News, Source, SourceError};
use std::cell::RefCell;
use std::rc::Rc;
use std::time::{Duration, Instant};

/// The light is switched off by the watchdog when it was on for longer than its time by this share: some
/// time before the 5 % that it may be.
const WATCH_MARGIN: f64 = 0.03;

/// How the exposures went, by when the printer acknowledged light on and light off.
///
/// The way of the answers is in it: what it tells is at least as bad as what was.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Exposures {
    /// How many were measured.
    pub(crate) count: u64,
    /// Sum of what they differ from the job's by, ms.
    sum_ms: f64,
    /// The most that one was shorter and longer, ms: the first is 0 or less.
    pub(crate) range_ms: Option<[f64; 2]>,
    /// Words of the printer that got lost.
    pub(crate) lost_words: u64,
    /// The longest that a layer took beyond its moves, waits and exposure, ms.
    pub(crate) overhead_ms: f64,
}

impl Exposures {
    fn add(&mut self, off_ms: f64) {
        self.count += 1;
        self.sum_ms += off_ms;
        let [least, most] = self.range_ms.unwrap_or([off_ms; 2]);
        self.range_ms = Some([least.min(off_ms), most.max(off_ms)]);
    }

    /// For a person, once a job is over.
    pub(crate) fn words(&self) -> Option<String> {
        let [least, most] = self.range_ms?;
        let mean_ms = self.sum_ms / self.count as f64;
        let lost = match self.lost_words {
            0 => String::new(),
            n => format!("; {n} answers of the printer got lost"),
        };
        Some(format!(
            "{} exposures, {mean_ms:+.1} ms off on average, from {least:+.1} to {most:+.1} ms (by the \
             printer's answers, their way included){lost}",
            self.count
        ))
    }
}

/// A resin job's lines.
pub(crate) struct Plate {
    machine: Exposure,
    screen: Option<Screen>,
    watch: LightWatch,
    /// The watchdog knows that the light may be on.
    watched: bool,
    orders: Vec<Order>,
    failed: Option<String>,
    /// How many times faster than life the printer is: 1 but for a mock.
    speed: f64,
    /// When the light of the layer went on, by the printer's answer.
    lit: Option<Instant>,
    measured: Rc<RefCell<Exposures>>,
    marks: Rc<RefCell<Marks>>,
    /// Time from the beginning to each layer's, s.
    begins_s: Rc<[f32]>,
    line: Vec<u8>,
}

impl Plate {
    /// Before the first line.
    pub(crate) fn new(
        script: Script,
        screen: Option<Screen>,
        watch: LightWatch,
        speed: f64,
        measured: Rc<RefCell<Exposures>>,
        marks: Rc<RefCell<Marks>>,
        begins_s: Rc<[f32]>,
    ) -> Self {
        if let Some(total_s) = begins_s.last() {
            marks.borrow_mut().see(0, format!(";TIME:{total_s}").as_bytes());
        }
        Self {
            machine: Exposure::new(script),
            screen,
            watch,
            watched: false,
            orders: Vec::new(),
            failed: None,
            speed,
            lit: None,
            measured,
            marks,
            begins_s,
            line: Vec::new(),
        }
    }

    fn on(&mut self, event: Event<'_>, now_ms: u64) {
        self.machine.on(event, now_ms, &mut self.orders);
        self.measured.borrow_mut().lost_words = self.machine.lost_words();
        self.lit();
        if let Some(screen) = &self.screen {
            self.orders.drain(..).for_each(|order| screen.tell(order));
        }
        self.orders.clear();
    }

    /// Until when the picture must stay, and when the light is to be switched off, whatever happens
    /// to us.
    fn lit(&mut self) {
        let Some(screen) = &mut self.screen else { return };
        // From the first of its lines on.
        let place = self.machine.script().place();
        let begun = place.step != Step::Expose || !place.first;
        let lit = self.machine.phase() == Phase::Exposing && begun;
        if lit == self.watched {
            return;
        }
        self.watched = lit;
        if !lit {
            screen.lit_until = None;
            return self.watch.dark();
        }
        let script = self.machine.script();
        let exposure_s = f64::from(script.exposure_ms()) * (1.0 + WATCH_MARGIN);
        let most_s = (exposure_s + f64::from(script.lead_ms())) / 1e3 / self.speed;
        let most = Duration::from_secs_f64(most_s);
        screen.lit_until = Some(Instant::now() + most);
        let keeper = match script.timing() {
            Timing::Host => Keeper::Host,
            Timing::Controller | Timing::Pulse => Keeper::Controller,
        };
        self.watch.lit(most, keeper);
    }

    /// What the screen has done.
    fn look(&mut self, now_ms: u64) {
        while let Some(did) = self.screen.as_ref().and_then(Screen::did) {
            match did {
                Did::Loaded(layer) => self.on(Event::Loaded(layer), now_ms),
                Did::Shown(layer) => self.on(Event::Shown(layer), now_ms),
                Did::Blanked => self.on(Event::Blanked, now_ms),
                Did::Failed(why) => _ = self.failed.get_or_insert(why),
            }
        }
    }

    fn measure(&mut self, line: u64) {
        let script = self.machine.script();
        let Some([on, off]) = script.lit_between() else { return };
        if line == on {
            self.lit = Some(Instant::now());
            if script.timing() == Timing::Host {
                let most_s = f64::from(script.exposure_ms()) / 1e3 * (1.0 + WATCH_MARGIN) / self.speed;
                self.watch.lit(Duration::from_secs_f64(most_s), Keeper::Host);
            }
        }
        if line == off
            && let Some(lit) = self.lit.take()
        {
            let took_ms = lit.elapsed().as_secs_f64() * 1e3 * self.speed;
            self.measured.borrow_mut().add(took_ms - f64::from(script.exposure_ms()));
        }
    }

    fn failure(&self) -> Option<&str> {
        self.failed.as_deref().or(self.machine.failure())
    }
}

impl Source for Plate {
    fn advance(&mut self) -> Result<bool, SourceError> {
        if let Some(why) = self.failure() {
            return Err(SourceError { line: self.machine.script().place().lines, reason: why.to_owned() });
        }
        let place = self.machine.script().place();
        if place.layer >= self.machine.script().layers() {
            return Ok(false);
        }
        let begins = place.layer == 0 && place.lines == 0 || place.layer > 0 && place.first;
        if begins && place.step == Step::Lower || place.lines == 0 {
            let mut marks = self.marks.borrow_mut();
            marks.see(place.lines + 1, b";LAYER_CHANGE");
            let begins_s = self.begins_s.get(place.layer as usize).copied().unwrap_or_default();
            marks.see(place.lines + 1, format!(";TIME_ELAPSED:{begins_s}").as_bytes());
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
        self.marks.borrow().read
    }

    fn begin(&mut self) {
        self.on(Event::Begin, 0);
    }

    fn may(&mut self, now_ms: u64) -> May {
        self.look(now_ms);
        self.on(Event::Tick, now_ms);
        match self.failure() {
            // What is wrong is told by going on.
            Some(_) => May::Go,
            None => self.machine.may(),
        }
    }

    fn may_hold(&self) -> bool {
        self.machine.may_hold()
    }

    fn hear(&mut self, news: News<'_>, now_ms: u64) {
        match news {
            News::Acknowledged(line) => {
                self.measure(line);
                self.on(Event::Acknowledged(line), now_ms);
            }
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
        let back = Back {
            after: standing.from,
            layer: standing.layer + 1,
            begun: standing.exposed,
            at_mm: standing.at_mm,
        };
        self.machine.go_to(standing.from);
        Some(back)
    }

    fn is_torn(&self) -> bool {
        self.machine.script().is_torn()
    }

    fn is_unmoved(&self) -> bool {
        let place = self.machine.script().place();
        place.layer == 0
            && (place.lines == 0
                || matches!(place.step, Step::Check(_))
                || place.step == Step::Home && place.first)
    }
}
