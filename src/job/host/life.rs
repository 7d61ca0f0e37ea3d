//! The plain way of a job: lines fed, acknowledged, written down.
//!
//! Takes the session's events, gives it lines and leave. Knows neither pauses nor
//! failures beyond who is to be called.
use super::{
    CHECKPOINT_COMMANDS, CHECKPOINT_LAYER_MS, CHECKPOINT_MS, Doing, Happening, Host, HostEvent, MAX_AHEAD,
    Then,
};
use crate::job::record::{Checkpoint, Record};
use crate::job::state::State;
use crate::printer::action::Action;
use crate::printer::session::{Ask, Event};
use crate::printer::source::{May, News, Source};
use crate::printer::temperature::{Reading, Temperatures};
use outrigger_gcode::line::{Command, parse};
use outrigger_gcode::state::Kind;

impl<S: Source> Host<S> {
    /// Does all that can be done now.
    pub(super) fn go_on(&mut self, now_ms: u64) {
        loop {
            while let Some(event) = self.session.poll_event() {
                self.on_event(&event, now_ms);
                self.tell(HostEvent::Session(event));
            }
            self.acknowledge(now_ms);
            self.answer_ask(now_ms);
            let passed = self.pass_gate(now_ms);
            self.source.hear(News::Durable(self.book.durable_commands()), now_ms);
            self.note_progress(now_ms);
            if self.doing == Doing::Feeding && self.source.take_question(now_ms) {
                self.session.ask_which_line();
            }
            if !self.feed_one(now_ms) && !passed {
                return;
            }
        }
    }

    fn on_event(&mut self, event: &Event, now_ms: u64) {
        match event {
            Event::Connected { .. } => self.connected(now_ms),
            Event::Held => self.held(now_ms),
            Event::OwnDone => self.own_done(now_ms),
            Event::Temperatures(t) => self.acked.note_temperatures(t),
            Event::Position(p) => {
                self.reports[0].get_or_insert(*p);
                self.reports[1] = Some(*p);
                if self.doing == Doing::Verifying && self.asks_where_ms.take().is_some() {
                    self.verify(now_ms);
                }
            }
            Event::Waiting(Some(_)) => self.printer_waits(),
            Event::Waiting(None) => _ = self.happen(Happening::Answered),
            Event::Action(action) => self.act(action, now_ms),
            Event::LinkLost { .. } => {
                self.link_down = true;
                self.happen(Happening::LinkLost);
            }
            Event::Note(text) => self.source.hear(News::Said(text), now_ms),
            Event::Resend { .. } => self.source.hear(News::AskedAgain, now_ms),
            Event::Arrived => self.source.hear(News::Arrived, now_ms),
            Event::Found(found) => self.found(*found, now_ms),
            Event::Rejoined { .. } => self.rejoined(now_ms),
            Event::Ended(outcome) => self.ended(outcome, now_ms),
            _ => {}
        }
    }

    fn connected(&mut self, now_ms: u64) {
        if self.state == State::TakingOver {
            // The port went and came back before anything was sent. A way back needs a
            // person's word anew: it may have been away for long.
            if self.plan().is_some() {
                return self.lost_its_state();
            }
            self.happen(Happening::Start);
        }
        self.session.hold(now_ms);
    }

    /// The printer waits for a person. A pause that was on its way would wait behind that,
    /// and both be answered by the same word: a pause for want of filament is done with the
    /// change that the printer makes by itself; a person's own comes after it.
    fn printer_waits(&mut self) {
        let pausing = self.state == State::Pausing && self.doing == Doing::Holding;
        if self.happen(Happening::Asked) && pausing {
            self.wishes.pause = !std::mem::take(&mut self.wishes.ran_out);
        }
    }

    /// Nothing of the job is in flight.
    fn held(&mut self, now_ms: u64) {
        match self.doing {
            Doing::Connecting => {
                let lines = self.settings.start_macro.clone();
                match lines.is_empty() {
                    true => self.lead_to_file(Happening::Ready),
                    false => self.run(lines, Doing::StartMacro, now_ms),
                }
            }
            Doing::Holding if self.state == State::Pausing => self.unnumber(Then::Park),
            // The printer has asked a person in between, and has its answer.
            Doing::Holding => self.lead_to_file(Happening::Answered),
            Doing::HoldingEnd => self.unnumber(Then::EndMacro),
            Doing::Rejoining => self.run(vec!["M114".to_owned()], Doing::Verifying, now_ms),
            Doing::Reconnecting => self.way_back(0),
            _ => {}
        }
    }

    /// Our own lines were all accepted.
    fn own_done(&mut self, now_ms: u64) {
        let lines = std::mem::take(&mut self.own);
        if matches!(self.doing, Doing::Parking) {
            self.tracker_before_parking();
        }
        for line in &lines {
            self.tracker.apply(line.as_bytes());
        }
        match self.doing {
            Doing::StartMacro => self.lead_to_file(Happening::Ready),
            Doing::Parking => self.parked_now(now_ms),
            Doing::Cooling => self.cooled(now_ms),
            Doing::Asking => self.unpark(now_ms),
            Doing::Unparking => self.unparked(),
            Doing::EndMacro => {
                self.doing = Doing::Finishing;
                self.session.finish_job(now_ms);
            }
            Doing::Verifying => self.verify(now_ms),
            Doing::WayBack(step) => self.step_done(step),
            _ => {}
        }
    }

    /// Runs lines of our own while the job is held.
    pub(super) fn run(&mut self, lines: Vec<String>, doing: Doing, now_ms: u64) {
        self.doing = doing;
        self.reports = [None; 2];
        self.session.run_own(lines.iter().map(String::as_str), now_ms);
        self.own = lines;
    }

    /// The file's next line may go once it is written down which number it gets.
    pub(super) fn lead_to_file(&mut self, happening: Happening) {
        self.note(0);
        self.book.push(Record::Numbers { first: self.session.next_number(), after: self.acked.commands });
        self.numbered = true;
        self.begun = true;
        self.happen(happening);
        self.source.begin();
        self.doing = Doing::Feeding;
        self.gate = Some((self.book.all(), Then::Feed));
    }

    /// Numbers say nothing of the file from now on; what follows waits for the record.
    pub(super) fn unnumber(&mut self, then: Then) {
        self.note(0);
        let at = self.book.push(Record::Unnumbered { after: self.acked.commands });
        self.numbered = false;
        self.gate = Some((at, then));
    }

    /// Does what has waited for records that are now durable.
    fn pass_gate(&mut self, now_ms: u64) -> bool {
        let Some((_, then)) = self.gate.filter(|(at, _)| self.book.has(*at)) else {
            return false;
        };
        self.gate = None;
        match then {
            Then::Feed => {
                if self.wishes.pause && self.happen(Happening::Pause) {
                    self.wishes.pause = false;
                    // The file's next line has not gone: numbers mean nothing again.
                    self.unnumber(Then::Park);
                    return true;
                }
                self.session.release(now_ms);
            }
            Then::Park => self.park(now_ms),
            Then::EndMacro => self.run(self.settings.end_macro.clone(), Doing::EndMacro, now_ms),
            Then::GoOn { last } => self.rejoin(last, now_ms),
            Then::MakeSafe => self.session.cancel(now_ms),
            Then::WayBack => self.reconnect(now_ms),
            Then::Step(step) => self.run_step(step, now_ms),
        }
        true
    }

    /// What the session asks for is written down, then allowed.
    fn answer_ask(&mut self, now_ms: u64) {
        let Some(ask) = self.session.asks() else {
            self.ask_at = None;
            return;
        };
        let at = match (self.ask_at, ask) {
            (Some(at), _) => at,
            (None, Ask::Own { n }) if self.numbered => self.book.push(Record::Own { n }),
            // Not before it is durable that numbers say nothing.
            (None, Ask::Own { .. }) => self.book.meaning_at(),
            (None, Ask::Renumber) => {
                self.numbered = false;
                self.book.push(Record::Unnumbered { after: self.acked.commands })
            }
            (None, Ask::Count { n }) => {
                self.numbered = true;
                self.book.push(Record::Numbers { first: n, after: self.acked.commands })
            }
        };
        if self.book.has(at) {
            self.ask_at = None;
            self.session.allow(now_ms);
        } else {
            self.ask_at = Some(at);
        }
    }

    /// Lines that the printer has acknowledged move the tracked machine.
    fn acknowledge(&mut self, now_ms: u64) {
        let line = self.session.job_acked();
        while let Some(one) = self.flight.pop(line) {
            if let Some(m) = self.tracker.apply(&one.text)
                && m.kind() == Kind::Deposit
            {
                self.bead_mm = m.to[2];
            }
            self.acked.commands += 1;
            self.acked.line = one.line;
            self.acked.layer = one.layer;
            self.acked.z_mm = self.tracker.z_mm();
            self.source.hear(News::Acknowledged(one.line), now_ms);
            self.flight.done(one);
        }
    }

    /// A checkpoint, when it is due.
    fn note_progress(&mut self, now_ms: u64) {
        if self.session.depth() > self.depth {
            self.depth = self.session.depth();
            self.book.push(Record::Depth(self.depth));
        }
        let (commands, at_ms, bead_mm) = self.noted;
        let more = self.acked.commands - commands.min(self.acked.commands);
        let passed_ms = now_ms.saturating_sub(at_ms);
        let new_height = (bead_mm - self.bead_mm).abs() > 1e-6;
        if self.source.take_note()
            || more >= CHECKPOINT_COMMANDS
            || more > 0 && passed_ms >= CHECKPOINT_MS
            || more > 0 && new_height && passed_ms >= CHECKPOINT_LAYER_MS
        {
            self.note(now_ms);
        }
    }

    /// Writes a checkpoint; at 0 without counting time anew.
    pub(super) fn note(&mut self, now_ms: u64) {
        self.noted = (self.acked.commands, now_ms.max(self.noted.1), self.bead_mm);
        self.book.push(Record::Checkpoint(self.acked));
    }

    /// Gives the session the file's next line. `false`: it takes none, or there is none.
    fn feed_one(&mut self, now_ms: u64) -> bool {
        if self.doing != Doing::Feeding
            || self.gate.is_some()
            || !self.session.wants_line()
            || self.fed >= self.book.durable_commands() + MAX_AHEAD
        {
            return false;
        }
        if let Some(kept) = self.again.pop_front() {
            self.flight.push(&kept.text, kept.number, kept.layer);
            self.fed += 1;
            self.session.feed(&kept.text, kept.number, now_ms);
            return true;
        }
        if self.wishes.pause && self.state == State::Printing && self.source.may_hold() {
            self.wishes.pause = false;
            self.want_pause(now_ms);
            return true;
        }
        match self.source.may(now_ms) {
            May::Wait => return false,
            May::GoAlone if !self.session.is_quiet() => return false,
            May::Go | May::GoAlone => {}
        }
        match self.source.advance() {
            Ok(true) => {
                let line = self.source.line();
                if sets_line_number(line.command) {
                    let job_line = line.number;
                    self.tell(HostEvent::Session(Event::Skipped { job_line }));
                    return true;
                }
                self.flight.push(line.command, line.number, self.source.layer());
                self.fed += 1;
                self.session.feed(line.command, line.number, now_ms);
            }
            Ok(false) => self.exhausted(now_ms),
            Err(e) => {
                self.doing = Doing::Finishing;
                self.keep_still_if_unmoved();
                self.session.source_failed(e.line, e.reason, now_ms);
            }
        }
        true
    }

    pub(super) fn exhausted(&mut self, now_ms: u64) {
        self.happen(Happening::Exhausted);
        if self.settings.end_macro.is_empty() {
            self.doing = Doing::Finishing;
            self.session.finish_job(now_ms);
        } else {
            self.doing = Doing::HoldingEnd;
            self.session.hold(now_ms);
        }
    }

    /// The printer's own wishes.
    fn act(&mut self, action: &Action, now_ms: u64) {
        match action {
            Action::Pause if self.state == State::Printing => self.want_pause(now_ms),
            Action::OutOfFilament { .. } => {
                self.say("the filament has run out");
                // Where the firmware changes it by itself, it asks.
                if self.state == State::Printing {
                    self.wishes.ran_out = true;
                    self.want_pause(now_ms);
                }
            }
            Action::Resume if self.state == State::Paused => self.want_resume(now_ms),
            Action::Cancel if self.state.is_active() => self.want_cancel(now_ms),
            _ => {}
        }
    }
}

impl Checkpoint {
    fn note_temperatures(&mut self, t: &Temperatures) {
        let both = |r: Reading, was: [f32; 2]| [r.actual_c, r.target_c.unwrap_or(was[1])];
        if let Some(r) = t.hotend() {
            self.nozzle_c = both(r, self.nozzle_c);
        }
        if let Some(r) = t.bed {
            self.bed_c = both(r, self.bed_c);
        }
    }
}

/// M110 would upset the count; it is no command of the job.
pub(super) fn sets_line_number(command: &[u8]) -> bool {
    matches!(command.first(), Some(b'M' | b'm'))
        && matches!(parse(command).command, Command::Classic { letter: b'M', number: 110, .. })
}
