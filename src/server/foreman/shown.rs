//! Changes of jobs, written down first; and what everybody may see of them.
use super::{Foreman, Refusal, rules};
use crate::server::config::ClearBed;
use crate::server::model::{Job, Stage};
use crate::station::now_unix_s;

/// Jobs that are over and still listed; the oldest go.
const MAX_OVER: usize = 200;

impl Foreman {
    /// Changes a job and writes it down; one that cannot be written stays as it was.
    pub(super) fn changed(&mut self, id: &str, change: impl FnOnce(&mut Job)) -> Result<(), Refusal> {
        let job = self.jobs.get_mut(id).ok_or(Refusal::NoSuch("job"))?;
        let mut new = job.clone();
        change(&mut new);
        self.means.shelf.write_job(&new)?;
        *job = new;
        Ok(())
    }

    /// Changes a job as something has come about: it is so even if it cannot be written down.
    pub(super) fn change(&mut self, id: &str, change: impl FnOnce(&mut Job)) {
        let Some(job) = self.jobs.get_mut(id) else { return };
        change(job);
        if let Err(why) = self.means.shelf.write_job(job) {
            tracing::error!(job = id, "{why}");
        }
        self.show(id);
    }

    pub(super) fn fail(&mut self, id: &str, words: &str) {
        self.change(id, |job| {
            job.state = Stage::Failed;
            job.error = Some(words.to_owned());
            job.ended_unix_s = Some(now_unix_s());
        });
    }

    // ---- what everybody sees ----

    /// A job with what follows from its state.
    pub(super) fn shown(&self, id: &str) -> Job {
        let job = &self.jobs[id];
        let printer = job.printer.as_str();
        let mut shown = job.clone();
        shown.state_words = job.state.words().to_owned();
        shown.can = rules::can(job);
        let place = self.places.get(printer);
        let first = self.next(printer).is_some_and(|first| first == job.id);
        let asks = place.is_none_or(|place| place.config.clear_bed == ClearBed::Ask);
        let broken_off = self.jobs.values().any(|o| o.printer == printer && o.state == Stage::Interrupted);
        let busy = self.jobs.values().any(|o| o.printer == printer && o.state.is_running());
        shown.waits_for = rules::waits_for(
            job,
            &rules::Around {
                first,
                broken_off,
                busy,
                bed_clear: !asks || !self.jobs.values().any(|other| rules::lies_on(other, printer)),
                ready: place.is_some_and(|place| place.ready),
                there: place.is_some(),
                resin: place.is_some_and(|place| place.wants.resin),
                before: place.map_or(&[], |place| place.wants.before.as_slice()),
            },
        );
        shown
    }

    pub(super) fn show(&mut self, id: &str) {
        let shown = self.shown(id);
        let printer = shown.printer.clone();
        self.means.view.show_job(shown);
        self.trim();
        self.show_place(&printer);
    }

    /// A printer's queue and bed, and the jobs whose waiting depends on them.
    pub(super) fn show_place(&self, printer: &str) {
        let mut waiting: Vec<_> =
            self.jobs.values().filter(|job| job.printer == printer && job.state.is_before()).collect();
        waiting.sort_by_key(|job| job.place);
        let queue = waiting.iter().map(|job| job.id.clone()).collect();
        let bed_clear = !self.jobs.values().any(|job| rules::lies_on(job, printer));
        self.means.view.show_place(printer, queue, bed_clear);
        for job in waiting {
            self.means.view.show_job(self.shown(&job.id));
        }
    }

    pub(super) fn show_all(&mut self) {
        let ids: Vec<_> = self.jobs.keys().cloned().collect();
        for id in ids {
            self.means.view.show_job(self.shown(&id));
        }
        let printers: Vec<_> = self.places.keys().cloned().collect();
        for printer in printers {
            self.show_place(&printer);
        }
    }

    /// The oldest jobs that are over go.
    pub(super) fn trim(&mut self) {
        let mut over: Vec<_> = self
            .jobs
            .values()
            .filter(|job| job.state.is_over() && !rules::lies_on(job, &job.printer))
            .map(|job| (job.ended_unix_s, job.id.clone()))
            .collect();
        if over.len() <= MAX_OVER {
            return;
        }
        over.sort();
        let many = over.len() - MAX_OVER;
        for (_, id) in over.into_iter().take(many) {
            let _ = self.means.shelf.remove_job(&id);
            self.jobs.remove(&id);
            self.means.view.gone("job", &id);
        }
    }
}
