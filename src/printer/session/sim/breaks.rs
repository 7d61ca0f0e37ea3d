//! Broken connections, dead hosts and pauses, at any time and over a noisy wire.
//!
//! The host here is the plainest that keeps the rules: it writes down what the session
//! asks for, late, and finds the job's line by it after a death.
use super::*;

/// What happens once so many lines of the job were fed.
#[derive(Debug, Clone, Copy)]
struct Break {
    at_fed: u64,
    what: What,
    /// How long it lasts.
    for_ms: u64,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    /// The cable comes off; of what was on its way, a part arrives.
    Unplug,
    /// The host dies; another takes over.
    Kill,
    /// The job is held, lines of our own run.
    Hold,
}

/// Which line of the job a number stands for, as it was written down.
#[derive(Debug, Clone, Default)]
struct Journal {
    /// `None`: numbers say nothing.
    first: Option<u32>,
    after: u64,
    own: Vec<u32>,
}

impl Journal {
    fn numbers(&mut self, first: u32, after: u64) {
        *self = Self { first: Some(first), after, own: Vec::new() };
    }

    /// Whether a printer that kept its state could say so: what was acknowledged was
    /// accepted, but for the few lines of which an `ok` proves nothing.
    fn can_be(&self, last: u32, acked: u64) -> bool {
        self.first.is_none_or(|first| last + 1 >= first) && self.commands_through(last) + 8 >= acked
    }

    fn commands_through(&self, last: u32) -> u64 {
        match self.first {
            None => self.after,
            Some(first) => {
                let own = self.own.iter().filter(|n| **n <= last).count() as u64;
                self.after + u64::from(last + 1 - first) - own
            }
        }
    }
}

#[derive(Debug, Clone)]
struct Outing {
    trial: Trial,
    breaks: Vec<Break>,
    ask_ms: u64,
    /// At the last break the board starts anew.
    reset: bool,
}

struct Host {
    outing: Outing,
    wire: Wire,
    journal: Journal,
    fed: u64,
    begun: bool,
    /// Lines that were acknowledged when it broke last.
    acked: u64,
    breaks: VecDeque<Break>,
    /// The cable is back, or another host there, at this time.
    back_ms: Option<(u64, What)>,
    allow_ms: Option<u64>,
    /// When the new numbers are kept, the job goes on.
    release_ms: Option<u64>,
    /// Lines of our own that were run to their end.
    own_done: usize,
    own_lines: usize,
    found: Option<Found>,
    outcome: Option<Outcome>,
    events: Vec<Event>,
}

fn settings(outing: &Outing) -> Settings {
    Settings {
        window: outing.trial.limit,
        boot_wait_ms: 10,
        asks: true,
        waits_for_link: true,
        cancel_macro: SAFE.map(String::from).to_vec(),
        ..Settings::default()
    }
}

impl Host {
    fn new(outing: Outing) -> Self {
        let wire = Wire {
            session: Session::new(settings(&outing), 0),
            firmware: Firmware::new(outing.trial.habits),
            dice: Dice { state: outing.trial.seed, hits: [0; 2] },
            noise: outing.trial.noise,
            now_ms: 0,
        };
        let breaks = outing.breaks.iter().copied().collect();
        Self {
            outing,
            wire,
            journal: Journal::default(),
            fed: 0,
            begun: false,
            acked: 0,
            breaks,
            back_ms: None,
            allow_ms: None,
            release_ms: None,
            own_done: 0,
            own_lines: 0,
            found: None,
            outcome: None,
            events: Vec::new(),
        }
    }

    fn run(mut self) -> Self {
        while self.outcome.is_none() && self.found.is_none() && self.wire.now_ms < 24 * 3_600_000 {
            self.wire.now_ms += 1;
            let now_ms = self.wire.now_ms;
            if self.back_ms.is_some() {
                self.without_cable(now_ms);
            } else {
                self.wire.carry_out();
                self.wire.carry_back();
                self.feed(now_ms);
                self.answer_asks(now_ms);
                self.strike(now_ms);
            }
            let session = &mut self.wire.session;
            if session.deadline().is_some_and(|at| at <= now_ms) {
                session.on_tick(now_ms);
            }
            while let Some(event) = self.wire.session.poll_event() {
                self.on_event(event);
            }
        }
        self
    }

    fn without_cable(&mut self, now_ms: u64) {
        // The board goes on; nobody hears it.
        self.wire.firmware.step(now_ms);
        let Some((at_ms, what)) = self.back_ms.filter(|(at, _)| now_ms >= *at) else {
            return;
        };
        self.back_ms = None;
        if self.outing.reset && self.breaks.is_empty() {
            self.wire.firmware.reset();
            assert!(at_ms <= now_ms);
        }
        match what {
            What::Kill => self.wire.session = Session::take_over(settings(&self.outing), now_ms),
            _ => self.wire.session.link_back(now_ms),
        }
    }

    fn feed(&mut self, now_ms: u64) {
        let session = &mut self.wire.session;
        if self.release_ms.is_some_and(|at| now_ms >= at) {
            self.release_ms = None;
            session.release(now_ms);
        }
        while session.wants_line() && self.journal.first.is_some() {
            if self.fed == self.outing.trial.lines {
                session.finish_job(now_ms);
                break;
            }
            self.fed += 1;
            session.feed(command(self.fed).as_bytes(), self.fed, now_ms);
        }
    }

    /// What is asked for is written down, and that takes its time.
    fn answer_asks(&mut self, now_ms: u64) {
        let Some(ask) = self.wire.session.asks() else {
            self.allow_ms = None;
            return;
        };
        let at_ms = *self.allow_ms.get_or_insert(now_ms + self.outing.ask_ms);
        if now_ms < at_ms {
            return;
        }
        self.allow_ms = None;
        match ask {
            Ask::Own { n } => self.journal.own.push(n),
            Ask::Renumber => {
                let after = self.wire.session.job_acked();
                self.journal = Journal { first: None, after, own: Vec::new() };
            }
            Ask::Count { n } => {
                let after = self.journal.after;
                self.journal.numbers(n, after);
            }
        }
        self.wire.session.allow(now_ms);
    }

    fn strike(&mut self, now_ms: u64) {
        // Before that there is nothing to find again.
        self.begun |= self.journal.first.is_some();
        let Some(strike) = self.breaks.front().copied().filter(|b| self.begun && self.fed >= b.at_fed) else {
            return;
        };
        self.breaks.pop_front();
        if strike.what == What::Hold {
            return self.wire.session.hold(now_ms);
        }
        let out = self.wire.session.output().to_vec();
        let part = self.wire.dice.roll(out.len() as u64 + 1) as usize;
        for line in out[..part].split_inclusive(|b| *b == b'\n') {
            self.wire.firmware.receive(line);
        }
        self.wire.session.written(part);
        self.acked = self.wire.session.job_acked();
        self.wire.session.link_lost("unplugged".into());
        self.back_ms = Some((now_ms + strike.for_ms, strike.what));
    }

    fn on_event(&mut self, event: Event) {
        let now_ms = self.wire.now_ms;
        let session = &mut self.wire.session;
        match &event {
            Event::Connected { .. } => session.hold(now_ms),
            Event::Held => {
                self.journal = Journal { first: None, after: session.job_acked(), own: Vec::new() };
                self.own_lines += 3;
                session.run_own(["M17", "G4 P1", "M18"], now_ms);
            }
            Event::OwnDone => {
                self.own_done += 3;
                self.journal.numbers(session.next_number(), self.journal.after);
                self.release_ms = Some(now_ms + self.outing.ask_ms);
            }
            Event::Found(Found::Counting { last }) => {
                let fresh = session.next_number() == 1;
                if fresh && !self.journal.can_be(*last, self.acked) {
                    self.found = Some(Found::Started);
                    return;
                }
                if fresh {
                    self.fed = self.journal.commands_through(*last);
                    self.release_ms = None;
                }
                if !session.go_on(*last, now_ms) {
                    self.found = Some(Found::Started);
                }
            }
            Event::Rejoined { .. } if self.journal.first.is_none() => {
                // After a death while held; the rest of our lines is forgotten.
                if session.wants_line() {
                    self.journal.numbers(session.next_number(), self.journal.after);
                }
            }
            Event::Found(found) => self.found = Some(*found),
            Event::Ended(how) => self.outcome = Some(how.clone()),
            _ => {}
        }
        self.events.push(event);
    }
}

fn outings() -> impl Strategy<Value = Outing> {
    let what = prop::sample::select(vec![What::Unplug, What::Kill, What::Hold]);
    let strike =
        (0_u64..300, what, 1_u64..400).prop_map(|(at_fed, what, for_ms)| Break { at_fed, what, for_ms });
    (trials(), prop::collection::vec(strike, 0..5), 0_u64..60, prop::bool::weighted(0.2)).prop_map(
        |(trial, mut breaks, ask_ms, reset)| {
            breaks.sort_by_key(|b| b.at_fed);
            Outing { trial, breaks, ask_ms, reset }
        },
    )
}

proptest! {
    #![proptest_config(cases())]

    /// Whatever breaks: as long as the board keeps its state, every line is executed
    /// once and in order; when it loses it, nothing follows.
    #[test]
    fn every_line_once_whatever_breaks(outing in outings()) {
        let strikes = |b: &&Break| b.what != What::Hold;
        let resets = outing.reset && outing.breaks.last().is_some_and(|b| b.what != What::Hold);
        let last_strike = outing.breaks.iter().filter(strikes).count();
        let end = Host::new(outing).run();
        let run = Run {
            outcome: end.outcome.clone(),
            accepted: end.wire.firmware.accepted.clone(),
            overflow: end.wire.firmware.overflow,
            took_ms: end.wire.now_ms,
            events: Vec::new(),
        };
        let tail: Vec<_> = end.events.iter().rev().take(20).collect();
        if resets {
            // At the board's start, or before the job there was nothing to lose.
            let stopped = end.found == Some(Found::Started) || end.outcome.is_some();
            prop_assert!(stopped, "{:?}", tail);
            prop_assert!(first_of_job(&run).is_ok(), "{:?} {:?}", first_of_job(&run), tail);
        } else {
            prop_assert_eq!(&run.outcome, &Some(Outcome::Finished), "{} strikes, {:?}", last_strike, tail);
            prop_assert_eq!(first_of_job(&run), Ok(300));
        }
    }
}
