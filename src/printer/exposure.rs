//! Layers of a resin job on a printer: what is sent and shown, in which order, and what each step
//! waits for.
//!
//! Takes what the printer says and acknowledges, what the screen has done and what is durable, with
//! the time in ms of any steady clock; tells which line may go next and what the screen shall do.
//! Does no I/O, owns no clock, knows no file.
//!
//! # The table
//! | phase | what happens | it ends when | and then |
//! | --- | --- | --- | --- |
//! | [`Checking`](Phase::Checking) | the profile's questions, before anything moves | each is answered well | – |
//! | [`Between`](Phase::Between) | nothing; the only place for a pause | the host feeds on | the picture is loaded ahead |
//! | [`Moving`](Phase::Moving) | down to the layer, `M400`, `M118 Z_move_comp` | the printer says the word | it is written down that the layer may be exposed from now on |
//! | [`Settling`](Phase::Settling) | resin flows back | the time is over, the picture is loaded, the record durable | show |
//! | [`Showing`](Phase::Showing) | the picture goes to the display | the screen says so | – |
//! | [`Exposing`](Phase::Exposing) | light on, time, light off, `M118 light_off` | the printer says the word | blank; it is written down that the layer is exposed |
//! | [`Resting`](Phase::Resting) | the display goes dark, the resin sets | the rest is over, the display dark, the record durable | – |
//! | [`Lifting`](Phase::Lifting) | up, in two stages | the lines are taken | the next layer |
//!
//! A fault of the screen ends the job before the next line, and the safe sequence follows.
//!
//! # Why the light is not on for longer than it should
//! - [`Timing::Controller`]: a dwell (the display's own settling time), light on, the exposure's
//!   dwell and light off are written at once while nothing else is in flight. They arrive during
//!   the first dwell, so that from then on the controller alone keeps the time, whatever becomes
//!   of the host and the cable. A line that is damaged on its way is asked for again within that
//!   dwell too.
//! - [`Timing::Pulse`]: one line of the firmware's lights for a time and ends by itself. Nothing
//!   can come between. Each line goes alone: behind a damaged one the firmware throws away what has
//!   arrived, and the tail of the next, if that begins with a command, it would execute.
//! - [`Timing::Host`]: light on is acknowledged, the host keeps the time, light off is sent. A dead
//!   host is the watchdog's, a dead cable nobody's.
//!
//! A line that is lost shows by the next; the last ones of an exposure have none. So where light off is
//! not acknowledged in time, the printer is asked which line it has ([`Exposure::take_question`]); and
//! where the host keeps the time, light on likewise: its lines go alone, for the time to begin at
//! the answer to light on and no other's.
//!
//! # Why a picture does not change while the light is on
//! The screen is told to show before the first line of an exposure is given, and to go dark after
//! the printer has said the word behind the line that switches the light off; not earlier than the
//! light can be off, if a line was asked for again: the tail of one may have said it. Should that word get
//! lost on its way, all lines must be acknowledged *and* the exposure's time and [`LOST_WORD_MS`] be
//! over.
pub mod script;

#[cfg(test)]
mod tests;

use super::source::May;
use script::{Script, Step, Timing};

/// How long a word is waited for after the line that asks for it was acknowledged: what is lost on
/// the way is not said again.
pub const LOST_WORD_MS: u64 = 3_000;

/// So long after its time a line that switches the light is asked for: its way and that of its answer,
/// and a line that was sent again within the lead.
const LATE_MS: u64 = 20;

/// And again after so long.
const LATE_AGAIN_MS: u64 = 250;

/// So often for one line: a printer that has all its lines is just late.
const QUESTIONS: u32 = 4;

/// Where a layer is. See the module's table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Phase {
    /// Before anything moves: the firmware is asked what must be so.
    Checking,
    /// Before the layer's first line; the plate is up, the light off, the display dark.
    Between,
    /// On the way to the layer.
    Moving,
    /// There; the resin flows.
    Settling,
    /// The picture is on its way to the display.
    Showing,
    /// The light is on, or about to be, or was just now.
    Exposing,
    /// Dark again; before the lift.
    Resting,
    /// On the way up.
    Lifting,
    /// All layers are done.
    Over,
}

/// What happens to an exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event<'a> {
    /// The job's lines follow: from the first, or from wherever the script stands.
    Begin,
    /// The host took the next line.
    Taken,
    /// The printer acknowledged so many lines of the script.
    Acknowledged(u64),
    /// The printer said this line.
    Heard(&'a str),
    /// It asks for a line again.
    AskedAgain,
    /// It says that all lines taken so far have arrived, whatever it has acknowledged.
    Arrived,
    /// The screen has the layer's picture ready, from 0.
    Loaded(u32),
    /// The screen shows it.
    Shown(u32),
    /// The screen is dark.
    Blanked,
    /// So many lines are written down as acknowledged.
    Durable(u64),
    /// Time passed.
    Tick,
}

/// What is wanted of the screen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Unpack this layer's picture, from 0, and keep it ready.
    Load(u32),
    /// Show the one that is ready.
    Show(u32),
    /// Go dark.
    Blank,
}

/// The state machine. See the module's text.
#[derive(Debug, Clone)]
pub struct Exposure {
    script: Script,
    phase: Phase,
    /// Lines that were taken, have arrived for all that is known, were acknowledged, and written down as
    /// acknowledged.
    taken: u64,
    arrived: u64,
    acked: u64,
    durable: u64,
    /// The printer has said the phase's word.
    word: bool,
    /// The screen has done what it was told.
    screen: bool,
    /// The picture that the screen was told to load last, and has ready.
    wanted: Option<u32>,
    loaded: Option<u32>,
    /// When the phase's time is over, ms; 0: it has not begun.
    until_ms: u64,
    /// It is: what is still waited for is no matter of time.
    waited: bool,
    /// The exposure's own time is over, where the host keeps it.
    exposed: bool,
    /// When all lines of a phase were acknowledged, ms.
    acked_ms: Option<u64>,
    /// The time that it was told of last, ms.
    now_ms: u64,
    /// When the light is off at the earliest, where the controller keeps the time, ms.
    lit_until_ms: u64,
    /// A line of this exposure was asked for again.
    asked_again: bool,
    /// When the exposure's line that was taken last was, and when it is overdue, ms.
    sent_ms: u64,
    late_ms: u64,
    questions: u32,
    /// Lines before the first that is sent of this exposure: it waits until nothing else is in flight.
    alone_at: u64,
    notes: bool,
    lost_words: u64,
    /// The answer that a question of the profile wants was heard.
    answered: bool,
    failure: Option<String>,
}

impl Exposure {
    /// Before the first layer.
    pub fn new(script: Script) -> Self {
        Self {
            script,
            phase: Phase::Between,
            taken: 0,
            arrived: 0,
            acked: 0,
            durable: 0,
            word: false,
            screen: false,
            wanted: None,
            loaded: None,
            until_ms: 0,
            waited: false,
            exposed: false,
            acked_ms: None,
            now_ms: 0,
            lit_until_ms: 0,
            asked_again: false,
            sent_ms: 0,
            late_ms: 0,
            questions: 0,
            alone_at: 0,
            notes: false,
            lost_words: 0,
            answered: false,
            failure: None,
        }
    }

    /// Where it is.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The script.
    pub fn script(&self) -> &Script {
        &self.script
    }

    /// The layer that it is at, from 0; past the last: their number.
    pub fn layer(&self) -> u32 {
        self.script.place().layer
    }

    /// Words of the printer that got lost on their way.
    pub fn lost_words(&self) -> u64 {
        self.lost_words
    }

    /// Whether a pause may come before the next line.
    pub fn may_hold(&self) -> bool {
        matches!(self.phase, Phase::Between | Phase::Over)
    }

    /// Why nothing may move.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Whether a checkpoint is wanted now; told once.
    ///
    /// Not before every line is acknowledged that it is to tell of: the printer says a word ahead of the
    /// `ok` of the line that asked for it.
    pub fn take_note(&mut self) -> bool {
        self.acked >= self.taken && std::mem::take(&mut self.notes)
    }

    /// Whether the next line may go.
    pub fn may(&self) -> May {
        let place = self.script.place();
        match self.phase {
            Phase::Between | Phase::Over => May::Go,
            Phase::Checking if !place.first || place.lines == 0 || self.word => May::Go,
            Phase::Moving if matches!(place.step, Step::Home | Step::Lower) => May::Go,
            Phase::Lifting => May::Go,
            Phase::Exposing if place.step == Step::Expose => match self.timing() {
                _ if place.lines == self.alone_at => May::GoAlone,
                Timing::Host if place.light_ends && !self.exposed => May::Wait,
                // Its answer got lost; light off does not wait for that.
                Timing::Host if self.arrived >= self.taken => May::Go,
                Timing::Pulse | Timing::Host => May::GoAlone,
                Timing::Controller => May::Go,
            },
            _ => May::Wait,
        }
    }

    /// When [`Event::Tick`] is due, ms.
    pub fn due_ms(&self) -> Option<u64> {
        let waits = match self.phase {
            Phase::Settling | Phase::Resting => !self.waited,
            Phase::Exposing => {
                self.timing() == Timing::Host && self.script.place().light_ends && !self.exposed
            }
            _ => false,
        };
        let time = (waits && self.until_ms > 0).then_some(self.until_ms);
        [time, self.word_given_up_ms(), self.overdue_ms()].into_iter().flatten().min()
    }

    /// Whether the printer is to be asked now which line it has: what it lacks may be light off, or what
    /// got lost the answer to light on, from which the host measures.
    pub fn take_question(&mut self, now_ms: u64) -> bool {
        let asks = self.overdue_ms().is_some_and(|at| at <= now_ms);
        if asks {
            self.late_ms = now_ms + LATE_AGAIN_MS;
            self.questions += 1;
        }
        asks
    }

    /// When the light's line that was sent last should have been acknowledged.
    fn overdue_ms(&self) -> Option<u64> {
        let lit = self.phase == Phase::Exposing && self.questions < QUESTIONS;
        let [on, off] = self.script.lit_between().filter(|_| lit)?;
        let waits = |line: u64| self.taken >= line && self.arrived < line;
        let waits = match self.timing() {
            Timing::Pulse => false,
            Timing::Controller => waits(off),
            Timing::Host => waits(off) || waits(on),
        };
        waits.then_some(self.late_ms)
    }

    fn timing(&self) -> Timing {
        self.script.timing()
    }

    /// When a word that should have come is taken for lost.
    fn word_given_up_ms(&self) -> Option<u64> {
        let waits = matches!(self.phase, Phase::Moving | Phase::Exposing) && !self.word;
        // A question whose answer got lost has no answer: it is not given up here.
        let since = self.acked_ms.filter(|_| waits)?;
        Some(since + LOST_WORD_MS)
    }

    /// Goes elsewhere in the script, before [`Event::Begin`].
    pub fn go_to(&mut self, lines: u64) {
        self.script.go_to(lines);
    }

    /// Something happened. Orders for the screen are appended to `orders`.
    pub fn on(&mut self, event: Event<'_>, now_ms: u64, orders: &mut Vec<Order>) {
        self.now_ms = self.now_ms.max(now_ms);
        match event {
            Event::Begin => self.begin(orders),
            Event::Taken => self.took(orders),
            Event::Acknowledged(lines) => {
                self.acked = self.acked.max(lines);
                self.arrived = self.arrived.max(lines);
                self.acknowledged(now_ms);
            }
            Event::Heard(text) => self.heard(text),
            Event::AskedAgain => self.asked_again = true,
            Event::Arrived => {
                self.arrived = self.taken;
                // Nothing was sent twice: it came when it was sent.
                self.lights(if self.asked_again { now_ms } else { self.sent_ms });
            }
            Event::Loaded(layer) => self.loaded = Some(layer),
            Event::Shown(layer) if self.phase == Phase::Showing && layer == self.layer() => {
                self.screen = true;
            }
            Event::Blanked if self.phase == Phase::Resting => self.screen = true,
            Event::Shown(_) | Event::Blanked => {}
            Event::Durable(lines) => self.durable = self.durable.max(lines),
            Event::Tick => {}
        }
        self.tick(now_ms);
        while self.step_on(now_ms, orders) {}
    }

    /// The job's lines follow. After a host that died, or a loss of power, the script stands where
    /// the job goes on: the printer has made every move up to there.
    fn begin(&mut self, orders: &mut Vec<Order>) {
        let place = self.script.place();
        self.taken = place.lines;
        self.arrived = place.lines;
        self.acked = place.lines;
        (self.word, self.screen, self.acked_ms) = (false, false, None);
        orders.push(Order::Blank);
        self.phase = match place.step {
            _ if place.layer >= self.script.layers() => Phase::Over,
            Step::Check(_) => Phase::Checking,
            Step::Home | Step::Lower if place.first => Phase::Between,
            Step::Home | Step::Lower => Phase::Moving,
            // All lines down to the layer are there, and the head was found where they lead.
            Step::Expose if place.first => Phase::Moving,
            // It was never lit: its picture must be there first.
            Step::Expose if self.script.is_dark_yet() => Phase::Moving,
            Step::Expose => Phase::Exposing,
            Step::Lift if place.first => Phase::Exposing,
            Step::Lift => Phase::Lifting,
        };
        let all_sent = place.first && place.step == Step::Lift || self.script.is_dark_yet();
        self.word = all_sent;
        if place.layer < self.script.layers() && !matches!(self.phase, Phase::Exposing | Phase::Lifting) {
            (self.wanted, self.loaded) = (None, None);
            self.want_loaded(place.layer, orders);
        }
    }

    fn took(&mut self, orders: &mut Vec<Order>) {
        let was = self.script.place();
        self.script.advance();
        self.taken = self.script.place().lines;
        if let (Phase::Checking, Step::Check(_)) = (self.phase, was.step) {
            if was.first {
                (self.word, self.answered) = (false, false);
            }
            return;
        }
        if matches!(self.phase, Phase::Between | Phase::Checking) {
            self.phase = Phase::Moving;
            (self.word, self.acked_ms) = (false, None);
            self.asked_again = false;
            self.want_loaded(was.layer, orders);
        }
        if self.phase == Phase::Exposing && was.lines == self.alone_at {
            (self.word, self.acked_ms) = (false, None);
            // Of a host's own timing: the clock starts when light on is acknowledged.
            (self.until_ms, self.exposed) = (0, false);
            let in_all_ms = u64::from(self.script.lead_ms()) + u64::from(self.script.exposure_ms());
            self.lit_until_ms = self.now_ms + in_all_ms;
            self.late_ms = self.lit_until_ms + LATE_MS;
        }
        if self.phase == Phase::Exposing && self.timing() == Timing::Host {
            (self.sent_ms, self.late_ms, self.questions) = (self.now_ms, self.now_ms + LATE_MS, 0);
        }
        if self.phase == Phase::Lifting && self.script.place().layer > was.layer {
            self.phase = match self.script.place().layer < self.script.layers() {
                true => Phase::Between,
                false => Phase::Over,
            };
        }
    }

    fn want_loaded(&mut self, layer: u32, orders: &mut Vec<Order>) {
        if self.wanted != Some(layer) {
            self.wanted = Some(layer);
            orders.push(Order::Load(layer));
        }
    }

    /// The printer has acknowledged more.
    fn acknowledged(&mut self, now_ms: u64) {
        let place = self.script.place();
        let all = self.acked >= self.taken;
        if all {
            self.lights(now_ms);
        }
        let sent = match self.phase {
            Phase::Moving => place.step == Step::Expose,
            Phase::Exposing => place.step == Step::Lift,
            _ => false,
        };
        if sent && all && self.acked_ms.is_none() {
            // A light that the acknowledgements have misled about is off by then.
            let margin_ms = match self.phase {
                Phase::Exposing => u64::from(self.script.exposure_ms()) + u64::from(self.script.lead_ms()),
                _ => 0,
            };
            self.acked_ms = Some(now_ms + margin_ms);
        }
    }

    /// All lines have arrived: where the host keeps the time and the last of them was light on, the
    /// light is on since then.
    fn lights(&mut self, since_ms: u64) {
        let lit = self.phase == Phase::Exposing && self.timing() == Timing::Host;
        if lit && self.script.place().light_ends && self.until_ms == 0 {
            self.until_ms = since_ms + u64::from(self.script.exposure_ms());
        }
    }

    fn heard(&mut self, text: &str) {
        let place = self.script.place();
        if self.phase == Phase::Checking {
            return self.answer(text, place.lines);
        }
        let sent = match self.phase {
            Phase::Moving => place.step == Step::Expose,
            Phase::Exposing => place.step == Step::Lift,
            _ => return,
        };
        let step = if self.phase == Phase::Moving { Step::Lower } else { Step::Expose };
        // Behind a damaged line the firmware may have taken the tail of a later one for a line of its own.
        let too_early = self.phase == Phase::Exposing
            && self.timing() == Timing::Controller
            && self.asked_again
            && self.now_ms < self.lit_until_ms;
        if sent && !too_early && text.trim() == script::word(step, self.layer()) {
            self.word = true;
        }
    }

    /// The firmware answers the question that was asked last, or says that this was all.
    fn answer(&mut self, text: &str, lines: u64) {
        let n = (lines.max(1) - 1) as u32 / 2;
        let Some(check) = self.script.check(n) else { return };
        self.answered |= text.contains(&check.wants);
        if text.trim() == script::word(Step::Check(n), 0) && lines.is_multiple_of(2) {
            match self.answered {
                true => self.word = true,
                false => {
                    let (what, send, wants) = (&check.what, &check.send, &check.wants);
                    self.failure = Some(format!(
                        "nothing was moved, since the printer does not say that {what}: {send} must be \
                         answered with {wants:?}"
                    ));
                }
            }
        }
    }

    fn tick(&mut self, now_ms: u64) {
        if self.word_given_up_ms().is_some_and(|at| at <= now_ms) {
            self.word = true;
            self.lost_words += 1;
        }
        self.waited = now_ms >= self.until_ms;
        // The host's own timing: light off may go.
        if self.phase == Phase::Exposing
            && self.timing() == Timing::Host
            && self.script.place().light_ends
            && self.until_ms > 0
            && now_ms >= self.until_ms
        {
            self.exposed = true;
        }
    }

    /// One phase on, if it is at its end.
    fn step_on(&mut self, now_ms: u64, orders: &mut Vec<Order>) -> bool {
        let layer = self.layer();
        match self.phase {
            // The tail of a line may have said the word while the plate moves: its `ok` is one too many, so
            // that the last is that of the wait for the moves.
            Phase::Moving if self.word && self.asked_again && self.acked < self.taken => return false,
            Phase::Moving if self.word && self.script.place().step == Step::Expose => {
                self.phase = Phase::Settling;
                self.until_ms = now_ms + u64::from(self.script.settle_ms());
                self.waited = now_ms >= self.until_ms;
                self.notes = true;
            }
            Phase::Settling
                if self.waited && self.loaded == Some(layer) && self.durable >= self.script.place().lines =>
            {
                self.phase = Phase::Showing;
                self.screen = false;
                orders.push(Order::Show(layer));
            }
            Phase::Showing if self.screen => {
                self.phase = Phase::Exposing;
                (self.word, self.screen, self.acked_ms) = (false, false, None);
                self.alone_at = self.script.place().lines;
                (self.questions, self.asked_again) = (0, false);
            }
            Phase::Exposing if self.word && self.script.place().step == Step::Lift => {
                self.phase = Phase::Resting;
                self.screen = false;
                self.until_ms = now_ms + u64::from(self.script.rest_ms());
                self.waited = now_ms >= self.until_ms;
                self.notes = true;
                self.loaded = None;
                orders.push(Order::Blank);
                if layer + 1 < self.script.layers() {
                    self.want_loaded(layer + 1, orders);
                }
            }
            Phase::Resting if self.waited && self.screen && self.durable >= self.script.place().lines => {
                self.phase = Phase::Lifting;
            }
            _ => return false,
        }
        true
    }
}
