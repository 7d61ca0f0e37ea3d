//! What people want of jobs, and what becomes of a job before it is printed.
use super::{Foreman, Refusal, rules, start};
use crate::job::host::Request;
use crate::server::actor::Order;
use crate::server::config::OnFindings;
use crate::server::inspect::Work;
use crate::server::model::{Can, CheckState, GivenUp, Job, Kind, Level, Mend, Printed, Stage};
use crate::server::shelf::new_id;
use crate::station::now_unix_s;

/// Jobs that wait, in all: whoever queues more has made a mistake.
const MAX_WAITING: usize = 500;

impl Foreman {
    pub(super) fn queue(
        &mut self,
        file: &str,
        printer: &str,
        hold: bool,
        by: String,
    ) -> Result<Job, Refusal> {
        let found = self.files.get(file).ok_or(Refusal::NoSuch("file"))?;
        if !self.places.contains_key(printer) {
            return Err(Refusal::NoSuch("printer"));
        }
        self.fits(&self.means.shelf.content(file), &found.name, printer)?;
        if self.jobs.values().filter(|job| job.state.is_before()).count() >= MAX_WAITING {
            return Err(Refusal::Conflict(format!("{MAX_WAITING} jobs wait already")));
        }
        let id = new_id('J').map_err(|_| Refusal::Ending)?;
        let place = self.jobs.values().map(|job| job.place).max().map_or(1, |last| last + 1);
        let job = Job {
            id: id.clone(),
            printer: printer.to_owned(),
            file: file.to_owned(),
            name: found.name.clone(),
            created_unix_s: now_unix_s(),
            by,
            place,
            hold,
            ..Job::default()
        };
        // Accepted is what is on the medium.
        self.means.shelf.write_job(&job)?;
        self.jobs.insert(id.clone(), job);
        self.pursue(&id);
        self.show(&id);
        Ok(self.shown(&id))
    }

    /// Goes on with a job that was not sent yet, as far as it goes by itself.
    pub(super) fn pursue(&mut self, id: &str) {
        let Some(job) = self.jobs.get(id) else { return };
        match job.state {
            Stage::Checking => {
                let (file, printer) = (job.file.clone(), job.printer.clone());
                let check = self.files.get(&file).and_then(|file| file.checks.get(&printer)).cloned();
                match check.map(|check| check.state) {
                    Some(CheckState::Clean | CheckState::Found | CheckState::Failed) => self.decide(id),
                    Some(CheckState::Checking) => {}
                    Some(CheckState::Waiting) | None if self.files.contains_key(&file) => {
                        self.look(&file, &printer);
                    }
                    Some(CheckState::Waiting) | None => {
                        self.fail(id, "its file is gone: upload it again");
                    }
                }
            }
            Stage::Mending => {
                let work = self.of(&job.printer).map(|of| Work::Mend {
                    job: job.id.clone(),
                    file: job.file.clone(),
                    name: job.name.clone(),
                    of,
                });
                if let Some(work) = work {
                    let _ = self.means.work.send(work);
                }
            }
            _ => {}
        }
    }

    /// What the printer's setting makes of what was found.
    pub(super) fn decide(&mut self, id: &str) {
        let Some(job) = self.jobs.get(id) else { return };
        let Some(place) = self.places.get(&job.printer) else { return };
        let file = self.files.get(&job.file);
        let check = file.and_then(|file| file.checks.get(&job.printer));
        let resin = file.is_some_and(|file| file.kind == Kind::Resin);
        let state = check.map_or(CheckState::Failed, |check| check.state);
        let words = check.and_then(|check| check.words.clone());
        // It was queued by an older daemon, or its printer has another profile now.
        if resin && !place.wants.resin {
            return self.fail(id, "this is a resin job, and the printer prints filament");
        }
        let gcode = file.is_some_and(|file| file.kind == Kind::Gcode);
        if gcode && place.wants.resin {
            return self.fail(id, "this is G-code, and the printer cures resin: its jobs are pictures");
        }
        let next = match (state, place.config.on_findings) {
            _ if job.approved => Stage::Queued,
            _ if job.hold => Stage::Held,
            (CheckState::Clean, _) | (_, OnFindings::Warn) => Stage::Queued,
            // What could not be read cannot be mended either.
            (CheckState::Failed, _) | (_, OnFindings::Hold) => Stage::Held,
            (_, OnFindings::Mend) => Stage::Mending,
        };
        if next == Stage::Queued && state == CheckState::Found && !job.approved {
            let words =
                format!("{}: the check found something; it is printed all the same, as set", job.name);
            place.handle.board.message(now_unix_s(), Level::Warning, words);
        }
        self.change(id, |job| {
            job.state = next;
            job.error = words.map(|words| format!("it could not be checked: {words}"));
            if next == Stage::Mending {
                job.mend = Some(Mend::default());
            }
        });
        if next == Stage::Mending {
            self.pursue(id);
        }
    }

    pub(super) fn act(&mut self, id: &str, what: Can, by: &str) -> Result<Job, Refusal> {
        let job = self.jobs.get(id).ok_or(Refusal::NoSuch("job"))?;
        if !rules::can(job).contains(&what) {
            let words = format!("that cannot be: the job is {}", job.state.words());
            return Err(Refusal::Conflict(words));
        }
        let (printer, file) = (job.printer.clone(), job.file.clone());
        match (what, job.state) {
            (Can::Approve, Stage::Mended) => self.changed(id, |job| {
                (job.state, job.printed, job.approved) = (Stage::Queued, Printed::Mended, true);
            })?,
            (Can::Approve | Can::Original, _) => self.changed(id, |job| {
                (job.state, job.printed, job.approved) = (Stage::Queued, Printed::Original, true);
            })?,
            (Can::Mend, _) => {
                self.changed(id, |job| {
                    (job.state, job.mend, job.printed) =
                        (Stage::Mending, Some(Mend::default()), Printed::Original);
                })?;
                self.pursue(id);
            }
            (Can::Start, _) => self.changed(id, |job| job.start_anyway = true)?,
            (Can::Cancel, state) if state.is_before() => self.changed(id, |job| {
                job.state = Stage::Cancelled;
                job.ended_unix_s = Some(now_unix_s());
            })?,
            (Can::Cancel, Stage::Interrupted) => self.give_up(id, GivenUp::Cancel)?,
            (Can::Forget, Stage::Interrupted) => {
                let shown = self.shown(id);
                self.give_up(id, GivenUp::Forget)?;
                return Ok(shown);
            }
            (Can::Cancel, _) => self.ask(&printer, Request::Cancel)?,
            (Can::Pause, _) => self.ask(&printer, Request::Pause)?,
            (Can::Confirm, _) => self.ask(&printer, Request::Confirm)?,
            (Can::Resume, Stage::Interrupted) => start::resume(self, id)?,
            (Can::Resume, _) => self.ask(&printer, Request::Resume)?,
            (Can::Forget, _) => {
                let shown = self.shown(id);
                start::forget(self, id)?;
                return Ok(shown);
            }
            (Can::Again, _) => return self.queue(&file, &printer, false, by.to_owned()),
        }
        self.show(id);
        Ok(self.shown(id))
    }

    /// A broken-off job is no longer wanted. A host that waits for a person's word leaves it first.
    fn give_up(&mut self, id: &str, how: GivenUp) -> Result<(), Refusal> {
        self.changed(id, |job| job.given_up = Some(how))?;
        let printer = self.jobs[id].printer.clone();
        let place = self.places.get(&printer);
        let held = place.is_some_and(|place| place.handle.board.picture().job.as_deref() == Some(id));
        match held {
            true => self.ask(&printer, Request::Cancel),
            false => start::close(self, id),
        }
    }

    /// The first of the jobs that wait for their turn.
    pub(super) fn next(&self, printer: &str) -> Option<String> {
        let queued = self.jobs.values().filter(|job| job.printer == printer && job.state == Stage::Queued);
        queued.min_by_key(|job| job.place).map(|job| job.id.clone())
    }

    pub(super) fn ask(&self, printer: &str, request: Request) -> Result<(), Refusal> {
        let place = self.places.get(printer).ok_or(Refusal::NoSuch("printer"))?;
        match place.handle.give(Order::Ask(request)) {
            true => Ok(()),
            false => Err(Refusal::Conflict("the printer does not take orders now: try again".to_owned())),
        }
    }

    pub(super) fn reorder(&mut self, printer: &str, order: &[String]) -> Result<(), Refusal> {
        if !self.places.contains_key(printer) {
            return Err(Refusal::NoSuch("printer"));
        }
        let mut waiting: Vec<_> = self
            .jobs
            .values()
            .filter(|job| job.printer == printer && job.state.is_before())
            .map(|job| (job.place, job.id.clone()))
            .collect();
        waiting.sort();
        let mut places: Vec<u64> = waiting.iter().map(|(place, _)| *place).collect();
        places.sort_unstable();
        let rank = |id: &String| order.iter().position(|wanted| wanted == id).unwrap_or(order.len());
        waiting.sort_by_key(|(place, id)| (rank(id), *place));
        for (place, (_, id)) in places.into_iter().zip(waiting) {
            if self.jobs[&id].place != place {
                self.changed(&id, |job| job.place = place)?;
                self.show(&id);
            }
        }
        self.show_place(printer);
        Ok(())
    }

    /// A person has said that nothing is on the bed, or that all is so that a printer of resin may begin.
    pub(super) fn bed_clear(&mut self, printer: &str) -> Result<(), Refusal> {
        let place = self.places.get(printer).ok_or(Refusal::NoSuch("printer"))?;
        let (asks, ready) = (!place.wants.before.is_empty(), place.ready);
        let standing = |job: &&Job| job.printer == printer && job.state == Stage::Interrupted;
        if let Some(job) = self.jobs.values().find(standing) {
            let words = format!("job {} ({}) was broken off: resume or forget it", job.id, job.name);
            return Err(Refusal::Conflict(words));
        }
        let on_it: Vec<_> =
            self.jobs.values().filter(|job| rules::lies_on(job, printer)).map(|j| j.id.clone()).collect();
        for id in on_it {
            self.changed(&id, |job| job.cleared = true)?;
        }
        // The word is for the next start and no later one: what somebody saw to yesterday may be otherwise.
        if asks && let Some(id) = self.next(printer) {
            if !ready {
                self.show_place(printer);
                let words =
                    "the printer cannot begin now: see that it is connected and idle, then say so again";
                return Err(Refusal::Conflict(words.to_owned()));
            }
            self.changed(&id, |job| job.prepared = true)?;
            self.show(&id);
        }
        self.show_place(printer);
        Ok(())
    }
}
