//! What others tell: the inspector, the printers, the threads that get jobs ready; and what can
//! start thereupon.
use super::{Foreman, Ready, rules, start};
use crate::causes;
use crate::job::state::State;
use crate::server::actor::{self, Order, Told};
use crate::server::config::ClearBed;
use crate::server::inspect::Done;
use crate::server::model::{Job, MendState, Stage};
use crate::station::{guardian, now_unix_s};

impl Foreman {
    pub(super) fn done(&mut self, done: Done) {
        match done {
            Done::Looked { file, printer, kind, check } => {
                let Some(known) = self.files.get_mut(&file) else { return };
                known.kind = kind;
                known.checks.insert(printer.clone(), *check);
                if let Err(why) = self.means.shelf.write_file(known) {
                    // It is looked at again after a restart.
                    tracing::warn!("{why}");
                }
                self.means.view.show_file(known.clone());
                let wait: Vec<_> = self
                    .jobs
                    .values()
                    .filter(|job| job.file == file && job.printer == printer && job.state == Stage::Checking)
                    .map(|job| job.id.clone())
                    .collect();
                for id in wait {
                    self.decide(&id);
                    self.show(&id);
                }
            }
            Done::Mended { job: id, mend } => {
                if self.jobs.get(&id).is_none_or(|job| job.state != Stage::Mending) {
                    return;
                }
                let next = if mend.state == MendState::Done { Stage::Mended } else { Stage::Held };
                self.change(&id, |job| (job.state, job.mend) = (next, Some(*mend)));
            }
        }
    }

    pub(super) fn told(&mut self, printer: &str, told: Told) {
        match told {
            Told::Ready => self.set_ready(printer, true),
            Told::Away => {
                self.set_ready(printer, false);
                self.take_words_back(printer);
            }
            Told::Gone => {
                self.set_ready(printer, false);
                if let Some(place) = self.places.get_mut(printer) {
                    place.gone = true;
                }
            }
            Told::Job(id, state) => {
                self.change(&id, |job| {
                    job.state = Stage::of(state);
                    if state == State::Printing {
                        job.started_unix_s.get_or_insert_with(now_unix_s);
                    }
                    if state.is_over() {
                        job.ended_unix_s = Some(now_unix_s());
                    }
                });
            }
            Told::Over { job, state, words, safety } => {
                self.set_ready(printer, false);
                if let Some(crate::printer::session::Safety::Unknown) = safety {
                    tracing::error!(
                        printer,
                        job,
                        "heaters or the light may be on: the printer confirmed nothing"
                    );
                }
                self.change(&job, |job| match state {
                    // Nothing of it was sent: it waits on.
                    State::Accepted => {
                        (job.state, job.record, job.error) = (Stage::Queued, None, words);
                    }
                    state => {
                        job.state = Stage::of(state);
                        job.error = words;
                        if state.is_over() {
                            job.ended_unix_s.get_or_insert_with(now_unix_s);
                        }
                    }
                });
                let given_up = |job: &Job| job.given_up.is_some() && job.state == Stage::Interrupted;
                if self.jobs.get(&job).is_some_and(given_up)
                    && let Err(why) = start::close(self, &job)
                {
                    self.change(&job, |job| job.error = Some(why.to_string()));
                }
                self.show_place(printer);
            }
        }
    }

    /// A printer that was away may have been opened, filled or emptied: what was said of it no longer counts.
    fn take_words_back(&mut self, printer: &str) {
        let said = |job: &&Job| job.printer == printer && job.state == Stage::Queued && job.prepared;
        let ids: Vec<_> = self.jobs.values().filter(said).map(|job| job.id.clone()).collect();
        for id in ids {
            self.change(&id, |job| job.prepared = false);
        }
    }

    pub(super) fn set_ready(&mut self, printer: &str, ready: bool) {
        if let Some(place) = self.places.get_mut(printer) {
            place.ready = ready;
        }
    }

    /// A job that was got ready.
    pub(super) fn ready(&mut self, id: &str, ready: Ready) {
        let Some(printer) = self.jobs.get(id).map(|job| job.printer.clone()) else { return };
        let Some(place) = self.places.get_mut(&printer) else { return };
        place.preparing = None;
        let resumes = self.jobs[id].state == Stage::Interrupted;
        match ready {
            Ok(print) if self.jobs[id].state == Stage::Queued || resumes => {
                let record = actor::record(&print);
                // From here on a restart looks for its journal: it is never started twice.
                let noted = self.changed(id, |job| {
                    (job.state, job.record, job.error) = (Stage::Starting, Some(record), None);
                    job.prepared = false;
                    job.ended_unix_s = None;
                });
                if let Err(why) = noted {
                    self.set_ready(&printer, false);
                    return self.change(id, |job| job.error = Some(why.to_string()));
                }
                if self.means.guards
                    && let Err(why) = guardian::start(&self.means.folder.store, record)
                {
                    let why = causes::line(&why);
                    tracing::warn!(
                        job = id,
                        "no guardian ({why}): if this process dies, heaters or the light stay on"
                    );
                }
                let place = &self.places[&printer];
                if !place.handle.give(Order::Print(print)) {
                    let back = if resumes { Stage::Interrupted } else { Stage::Queued };
                    self.change(id, |job| job.state = back);
                }
                self.set_ready(&printer, false);
                self.show(id);
            }
            // Cancelled meanwhile; what was accepted in the journal was never begun.
            Ok(_) => {}
            Err(not) if not.for_good && !resumes => self.fail(id, &not.words),
            Err(not) => {
                self.set_ready(&printer, false);
                self.change(id, |job| job.error = Some(not.words));
            }
        }
        self.show_place(&printer);
    }

    /// Starts what can be started.
    pub(super) fn advance(&mut self) {
        if self.ending {
            return;
        }
        let ids: Vec<_> = self.places.keys().cloned().collect();
        for printer in ids {
            let place = &self.places[&printer];
            if !place.ready || place.preparing.is_some() {
                continue;
            }
            let clear = place.config.clear_bed == ClearBed::Assume
                || !self.jobs.values().any(|job| rules::lies_on(job, &printer));
            let broken_off = |job: &Job| job.printer == printer && job.state == Stage::Interrupted;
            if self.jobs.values().any(broken_off) {
                continue;
            }
            let before = &place.wants.before;
            let next = self.next(&printer).filter(|id| !rules::wants_word(&self.jobs[id], clear, before));
            if let Some(id) = next {
                start::fresh(self, &id);
            }
        }
    }
}
