//! A job that was broken off: found, walked to, taken up, or made safe.
//!
//! Takes the journal's picture and what the printer says of itself; goes on where
//! that is certain, plans the way back where the printer lost its state, and makes it
//! safe where nothing is certain. The file is walked in steps, so that a long one does
//! not hold up what else there is to do.
use super::life::sets_line_number;
use super::{Begin, Doing, Happening, Host, HostEvent, Then};
use crate::job::record::{Checkpoint, Log, Record};
use crate::job::recover::walk::{Walk, Walked};
use crate::job::recover::{Case, Plan, Refusal, ZDuring, case, height_mm, plan, plate};
use crate::job::state::{Decision, State, next};
use crate::job::tracker::Tracker;
use crate::printer::session::Found;
use crate::printer::source::Source;

/// Commands walked at a time: some milliseconds' work.
const WALK_COMMANDS: usize = 2_048;

/// How long after an unanswered question where its head is the printer is asked again, ms.
/// The answer may be lost; one that acknowledges lines before it runs them (Repetier) may
/// heat first.
const ASK_WHERE_AFTER_MS: [u64; 5] = [500, 2_000, 20_000, 120_000, 300_000];

/// Reports of a place where the file does not have the head, until they are believed.
const DIFFERING_REPORTS: u32 = 2;

/// What is known of the job that is taken up.
#[derive(Debug)]
pub(super) struct TakeUp {
    pub(super) log: Box<Log>,
    /// To make it safe, and nothing else.
    guards: bool,
    /// A person's word is given.
    confirmed: bool,
    case: Option<Case>,
    last: u32,
    walk: Option<Walk>,
    place: Option<Walked>,
    plan: Option<Plan>,
}

impl TakeUp {
    pub(super) fn case(&self) -> Option<&Case> {
        self.case.as_ref()
    }

    pub(super) fn plan(&self) -> Option<&Plan> {
        self.plan.as_ref()
    }
}

impl<S: Source> Host<S> {
    pub(super) fn begin(&mut self, begin: &Begin) {
        let (log, guards, confirmed) = match begin {
            Begin::Fresh => {
                self.happen(Happening::Start);
                return;
            }
            Begin::TakeOver { log } => (log, false, false),
            Begin::AfterReset { log, confirmed } => (log, false, *confirmed),
            Begin::MakeSafe { log } => (log, true, false),
        };
        self.state = log.state;
        if let Decision::Refuse(why) = next(self.state, Happening::TakeUp) {
            self.refuse(why);
            self.closing = true;
            return;
        }
        self.happen(Happening::TakeUp);
        self.doing = Doing::Finding;
        // It may have been reset, and its cold nozzle stick to the part.
        self.session.keep_still(true);
        self.acked = log.checkpoint;
        let log = log.clone();
        let taken =
            TakeUp { log, guards, confirmed, case: None, last: 0, walk: None, place: None, plan: None };
        self.taken = Some(Box::new(taken));
        if matches!(begin, Begin::AfterReset { .. }) {
            self.take_up(Found::Started);
        }
    }

    /// What the printer says of itself.
    pub(super) fn found(&mut self, found: Found, now_ms: u64) {
        match found {
            Found::Counting { last } if last > 0 && self.doing == Doing::Finding => {
                self.session.keep_still(false);
            }
            Found::Counting { last } if last > 0 => {}
            _ => self.session.keep_still(true),
        }
        match (self.doing, found) {
            (Doing::Finding, _) => self.take_up(found),
            // It has started while the file was walked.
            (Doing::Walking, Found::Started) if self.state == State::TakingOver => {
                self.gate = None;
                self.take_up(found);
            }
            (Doing::Walking | Doing::Waiting | Doing::Reconnecting, _) => {}
            (_, Found::Counting { last }) if self.session.go_on(last, now_ms) => {}
            (_, Found::Started | Found::Counting { last: 0 }) => self.lost_its_state(),
            (..) => self.not_known(now_ms),
        }
        if let Some(Case::NotKnown { .. } | Case::Unsafe) = self.case()
            && self.doing == Doing::Finding
        {
            self.make_safe_now(now_ms);
        }
        if self.case() == Some(&Case::NotBegun) && self.doing == Doing::Connecting {
            self.session.begin_anew(now_ms);
        }
    }

    fn take_up(&mut self, found: Found) {
        let Some(taken) = &mut self.taken else {
            return;
        };
        self.settings.resume.allow_for(taken.log.depth);
        self.depth = self.settings.resume.held_moves();
        let found_case = case(&taken.log, found, &self.settings.resume);
        if let Found::Counting { last } = found {
            taken.last = last;
        }
        taken.case = Some(found_case.clone());
        let (guards, rules) = (taken.guards, &self.settings.resume);
        self.begun = found_case != Case::NotBegun;
        let back_moves = rules.depth();
        self.tell(HostEvent::Case(found_case.clone()));
        match found_case {
            Case::HostDied { after, .. } => self.walk(after, 0),
            _ if guards && found == Found::Started => self.lost_its_state(),
            // What is known of it is walked to; the rest follows in `found`.
            _ if guards => self.set_case(Case::Unsafe),
            Case::NotBegun => {
                self.session.keep_still(false);
                self.happen(Happening::Start);
                self.acked = Checkpoint::default();
                self.doing = Doing::Connecting;
            }
            Case::PrinterReset { after, exact } => {
                self.happen(Happening::Reset);
                let confirmed = self.taken.as_ref().is_some_and(|t| t.confirmed);
                if self.settings.waits_for_person || confirmed {
                    self.walk(after, if exact { 0 } else { back_moves });
                } else {
                    self.closing = true;
                }
            }
            Case::Refused(_) | Case::Over => {
                self.happen(Happening::Reset);
                self.closing = true;
            }
            Case::NotKnown { certain, uncertain } => {
                self.book.push(Record::Note(format!("certain: {certain}; not known: {uncertain}")));
                if found == Found::Started {
                    // Its heaters are off.
                    self.happen(Happening::Reset);
                    self.closing = true;
                }
            }
            Case::Unsafe if found == Found::Started => self.lost_its_state(),
            Case::Unsafe => {}
        }
    }

    fn set_case(&mut self, case: Case) {
        if let Some(taken) = &mut self.taken {
            taken.case = Some(case);
        }
    }

    /// The printer started anew in mid-job: its heaters are off.
    pub(super) fn lost_its_state(&mut self) {
        if self.taken.as_ref().is_some_and(|t| t.log.state == State::Cancelling) {
            self.happen(Happening::Cancel);
        }
        self.note(0);
        self.happen(Happening::Reset);
        self.say("the printer has started anew: its heaters are off");
        self.closing = true;
    }

    /// Where the printer is cannot be known: heat off, head up.
    fn not_known(&mut self, now_ms: u64) {
        self.happen(Happening::Unknown);
        self.say("where the printer is cannot be known: it is made safe");
        // Nor how high it is.
        self.tracker = Tracker::new(self.settings.e_modes);
        self.doing = Doing::Finishing;
        self.session.cancel(now_ms);
    }

    fn make_safe_now(&mut self, now_ms: u64) {
        if self.closing {
            return;
        }
        if self.taken.as_ref().is_some_and(|t| t.log.made_safe.is_some()) {
            // It has gone up already, and once more would take it to the top at last; but
            // where a way back had begun, it is warm again.
            self.session.keep_still(true);
        }
        let was = self.taken.as_ref().map_or(State::Lost, |t| t.log.state);
        self.happen(if was == State::Cancelling { Happening::Cancel } else { Happening::Fail });
        self.doing = Doing::Finishing;
        self.session.cancel(now_ms);
    }

    // ---- walking ----

    fn walk(&mut self, to: u64, back_moves: u32) {
        self.doing = Doing::Walking;
        let walk = Walk::new(self.settings.e_modes, to, back_moves);
        if let Some(taken) = &mut self.taken {
            taken.walk = Some(walk);
        }
    }

    pub(super) fn is_walking(&self) -> bool {
        self.taken.as_ref().is_some_and(|t| t.walk.is_some()) && !self.closing
    }

    /// Some steps more through the file.
    pub(super) fn walk_on(&mut self, now_ms: u64) {
        let Some(mut walk) = self.taken.as_mut().and_then(|t| t.walk.take()) else {
            return;
        };
        for _ in 0..WALK_COMMANDS {
            if walk.is_done() {
                return self.walked(walk, now_ms);
            }
            match self.source.advance() {
                Ok(true) => {
                    let line = self.source.line();
                    if !sets_line_number(line.command) {
                        walk.step(line.command, line.number, self.source.layer());
                    }
                }
                Ok(false) => {
                    return self.cannot_walk("the file is shorter than what was printed of it", now_ms);
                }
                Err(e) => return self.cannot_walk(&format!("line {}: {}", e.line, e.reason), now_ms),
            }
        }
        if let Some(taken) = &mut self.taken {
            taken.walk = Some(walk);
        }
    }

    fn cannot_walk(&mut self, why: &str, now_ms: u64) {
        self.say(format!("the file cannot be followed: {why}"));
        self.book.push(Record::Note(why.to_owned()));
        match self.state {
            State::TakingOver => self.not_known(now_ms),
            // Already cold: it stays broken off.
            _ => self.closing = true,
        }
    }

    fn walked(&mut self, walk: Walk, now_ms: u64) {
        let Some(taken) = &mut self.taken else {
            return;
        };
        match taken.case {
            Some(Case::HostDied { after, .. }) => {
                let place = walk.exact();
                self.tracker = place.tracker;
                self.acked = Checkpoint {
                    commands: after,
                    line: place.last.0,
                    layer: place.last.1,
                    z_mm: self.tracker.z_mm(),
                    ..taken.log.checkpoint
                };
                self.fed = after;
                let torn = !taken.guards && self.source.is_torn();
                let ends = taken.guards || torn;
                let then = match ends {
                    true => Then::MakeSafe,
                    false => Then::GoOn { last: taken.last },
                };
                if ends {
                    if taken.log.state == State::Paused {
                        for line in &self.settings.pause_macro {
                            self.tracker.apply(line.as_bytes());
                        }
                    }
                    self.happen(Happening::Fail);
                    self.doing = Doing::Finishing;
                }
                if torn {
                    self.say(
                        "it broke off in the middle of an exposure, and how long that was is not known: it \
                         is made safe, and goes on at a person's word",
                    );
                }
                self.unnumber(then);
            }
            _ => self.plan_from(walk),
        }
        self.go_on(now_ms);
    }

    // ---- the printer kept its state ----

    pub(super) fn rejoin(&mut self, last: u32, now_ms: u64) {
        self.doing = Doing::Rejoining;
        if !self.session.go_on(last, now_ms) {
            self.not_known(now_ms);
        }
    }

    /// Both sides count alike again.
    pub(super) fn rejoined(&mut self, now_ms: u64) {
        match self.doing {
            Doing::Rejoining => self.session.hold(now_ms),
            Doing::Feeding if self.gate.is_none() => {
                self.happen(Happening::TakenOver);
                if std::mem::take(&mut self.wishes.pause) {
                    self.want_pause(now_ms);
                }
            }
            Doing::Feeding => _ = self.happen(Happening::TakenOver),
            Doing::Parked => _ = self.happen(Happening::Parked),
            Doing::HoldingEnd | Doing::EndMacro | Doing::Finishing => _ = self.happen(Happening::Exhausted),
            // What our lines lead to tells the state.
            _ => {}
        }
    }

    /// The printer has said where its head is.
    pub(super) fn verify(&mut self, now_ms: u64) {
        let Some(taken) = &self.taken else {
            return;
        };
        let (log_state, parked) = match taken.case {
            Some(Case::HostDied { parked, .. }) => (taken.log.state, parked),
            _ => return,
        };
        // Its last lines may have been lost on the way: then the end has not come yet.
        if log_state == State::Ending && self.fed >= taken.log.accepted.commands {
            return self.end_again(now_ms);
        }
        let Some(report) = self.reports[1] else {
            let tries = usize::try_from(self.asked_where).unwrap_or(usize::MAX);
            if let Some(after_ms) = ASK_WHERE_AFTER_MS.get(tries) {
                self.asked_where += 1;
                self.asks_where_ms = Some(now_ms + after_ms);
                return;
            }
            self.say("the printer does not say where its head is");
            return self.not_known(now_ms);
        };
        if parked {
            let want = self.tracker.clone();
            for line in &self.settings.pause_macro {
                self.tracker.apply(line.as_bytes());
            }
            self.tracker.relocate(report);
            if log_state != State::Paused {
                // It broke off on its way: E alone tells what was pulled back.
                let pulled_mm = match (want.e_mm(), report.e_mm) {
                    (Some(file), Some(now)) => file - now,
                    _ => 0.0,
                };
                self.tracker.pulled_back_from(&want, pulled_mm);
            }
            return self.found_parked(want, now_ms);
        }
        if let Err(differs) = self.tracker.agrees(report) {
            // A digit may have been lost on the way: two reports in a row must differ.
            self.asked_where += 1;
            if self.asked_where < DIFFERING_REPORTS {
                return self.run(vec!["M114".to_owned()], Doing::Verifying, now_ms);
            }
            let text = format!("its head is not where the file has it: {differs}");
            self.book.push(Record::Note(text.clone()));
            self.say(text);
            return self.not_known(now_ms);
        }
        self.tracker.resolve(report);
        self.lead_to_file(Happening::TakenOver);
    }

    /// The answer is overdue.
    pub(super) fn ask_where_again(&mut self, now_ms: u64) {
        if self.asks_where_ms.is_some_and(|at| at <= now_ms) {
            self.asks_where_ms = None;
            if self.doing == Doing::Verifying {
                self.run(vec!["M114".to_owned()], Doing::Verifying, now_ms);
            }
        }
    }

    /// The file was printed to its end; its end macro runs again.
    fn end_again(&mut self, now_ms: u64) {
        self.happen(Happening::Exhausted);
        self.run(self.settings.end_macro.clone(), Doing::EndMacro, now_ms);
    }

    // ---- the printer lost its state ----

    fn plan_from(&mut self, walk: Walk) {
        let Some(taken) = &mut self.taken else {
            return;
        };
        if let Some(plate) = &self.settings.resume.plate {
            let planned = match self.source.go_back(walk.at()) {
                Some(back) => plate::plan(&taken.log, walk, &back, &self.settings.pause_macro, plate),
                None => Err(Refusal::InPreparation),
            };
            return match planned {
                Ok((place, plan)) => self.planned(place, plan),
                Err(refusal) => self.refuse_resume(refusal),
            };
        }
        let shifted = walk.shifts_z();
        let place = match walk.place() {
            Ok(place) => place,
            Err(refusal) => return self.refuse_resume(refusal),
        };
        if shifted || place.tracker.at_mm(2) != place.tracker.at_native_mm(2) {
            return self.refuse_resume(Refusal::HeightShifted);
        }
        let Some(z_mm) = height_mm(&taken.log, &place, &self.settings.pause_macro) else {
            return self.refuse_resume(Refusal::HeightNotKnown);
        };
        let plan = plan(&place, z_mm, &self.settings.resume);
        self.planned(place, plan);
    }

    fn planned(&mut self, place: Walked, plan: Plan) {
        let Some(taken) = &mut self.taken else {
            return;
        };
        (taken.plan, taken.place) = (Some(plan), Some(place));
        self.doing = Doing::Waiting;
        let confirmed = taken.confirmed;
        self.tell(HostEvent::Planned);
        if confirmed {
            self.confirmed();
        }
    }

    fn refuse_resume(&mut self, refusal: Refusal) {
        self.set_case(Case::Refused(refusal));
        self.tell(HostEvent::Case(Case::Refused(refusal)));
        self.closing = true;
    }

    /// A person says that part and nozzle are clear.
    pub(super) fn want_confirm(&mut self, _now_ms: u64) {
        match next(self.state, Happening::Confirm) {
            Decision::To(_) if self.closing => self.refuse("the connection is being closed: resume it anew"),
            Decision::To(_) => {
                let planned = self.doing == Doing::Waiting;
                match &mut self.taken {
                    Some(taken) if taken.walk.is_some() || planned => taken.confirmed = true,
                    _ => return self.refuse("there is nothing to confirm"),
                }
                if planned {
                    self.confirmed();
                }
            }
            Decision::Refuse(why) => self.refuse(why),
            Decision::Stay => {}
        }
    }

    /// Written down before anything moves: from where it goes on, and how high the
    /// nozzle stands.
    fn confirmed(&mut self) {
        let Some((place, z_mm)) =
            self.taken.as_ref().and_then(|t| t.place.as_ref().zip(t.plan.as_ref().map(|p| p.z_mm)))
        else {
            return;
        };
        self.acked = Checkpoint {
            commands: place.after,
            line: place.last.0,
            layer: place.last.1,
            z_mm: place.tracker.z_mm(),
            ..self.acked
        };
        self.fed = place.after;
        self.happen(Happening::Confirm);
        self.unnumber(Then::WayBack);
        let at = self.book.push(Record::MadeSafe { z_mm: Some(z_mm) });
        self.gate = Some((at, Then::WayBack));
        self.doing = Doing::Reconnecting;
    }

    /// The handshake, unless it is through.
    pub(super) fn reconnect(&mut self, now_ms: u64) {
        self.doing = Doing::Reconnecting;
        // Until the nozzle is soft it sticks to the part.
        self.session.keep_still(true);
        self.tracker = Tracker::new(self.settings.e_modes);
        if self.session.is_held() {
            self.way_back(0);
        } else {
            self.session.begin_anew(now_ms);
        }
    }

    /// The next step, once what it does to the nozzle's height is written down.
    pub(super) fn way_back(&mut self, step: usize) {
        if self.gate.is_some_and(|(_, then)| then == Then::WayBack) {
            // Held before it is written down that the way back begins.
            return;
        }
        let Some(z) = self.plan().map(|plan| plan.steps.get(step).map(|s| s.z)) else {
            return;
        };
        match z {
            None => self.came_back(),
            Some(z) => {
                self.doing = Doing::WayBack(step);
                if let ZDuring::MovesTo(_) = z {
                    self.book.push(Record::MadeSafe { z_mm: None });
                }
                self.gate = Some((self.book.all(), Then::Step(step)));
            }
        }
    }

    pub(super) fn run_step(&mut self, step: usize, now_ms: u64) {
        let Some(step_of) = self.plan().and_then(|plan| plan.steps.get(step)).cloned() else {
            return;
        };
        self.say(step_of.what);
        if let ZDuring::MovesTo(_) = step_of.z {
            self.session.keep_still(false);
        }
        self.run(step_of.lines, Doing::WayBack(step), now_ms);
    }

    pub(super) fn step_done(&mut self, step: usize) {
        if let Some(ZDuring::MovesTo(z_mm)) = self.plan().and_then(|p| p.steps.get(step)).map(|s| s.z) {
            self.book.push(Record::MadeSafe { z_mm: Some(z_mm) });
        }
        self.way_back(step + 1);
    }

    /// The head is where the file has it.
    fn came_back(&mut self) {
        let Some(place) = self.taken.as_mut().and_then(|t| t.place.take()) else {
            return;
        };
        self.tracker = place.tracker;
        self.again = place.between;
        self.lead_to_file(Happening::Restored);
    }
}
