//! The foreman: one thread that alone decides what becomes of files and jobs.
//!
//! Takes [`Message`]s, one after the other: uploads, people's wishes, what the inspector found,
//! what printers tell. Writes each decision down before it is acknowledged, shows it in the
//! [`View`], and gives orders to the printers' actors. Nobody else changes a file or a job, so no
//! two decisions can cross. Owns no socket and no port; what takes long (checks, opening a large
//! job) is done by others, who send word.
//!
//! - [`view`]: what everybody may read at any time
//! - [`start`]: from a waiting job to a host that holds it
//! - [`rules`]: what may be wanted of a job, and what it waits for
mod rules;
mod start;
#[cfg(test)]
mod tests;
pub(crate) mod view;

use super::actor::{Handle, Order, Print, Told};
use super::config::{self, ClearBed, OnFindings};
use super::inspect::{Done, For, Work};
use super::model::{Can, Check, CheckState, File, Job, Kind, Level, Mend, MendState, Printed, Stage};
use super::shelf::{Shelf, ShelfError, new_id};
use crate::job::host::Request;
use crate::job::state::State;
use crate::station::{Folder, guardian, now_unix_s};
use std::collections::BTreeMap;
use std::sync::{Arc, mpsc};
use tokio::sync::oneshot;
use view::View;

/// Jobs that are over and still listed; the oldest go.
const MAX_OVER: usize = 200;

/// Jobs that wait, in all: whoever queues more has made a mistake.
const MAX_WAITING: usize = 500;

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Refusal {
    /// There is no such thing.
    #[error("there is no such {0}")]
    NoSuch(&'static str),
    /// It cannot be now.
    #[error("{0}")]
    Conflict(String),
    /// The medium refuses.
    #[error(transparent)]
    Shelf(#[from] ShelfError),
    /// The daemon is ending, or a part of it is gone.
    #[error("the daemon is ending")]
    Ending,
}

/// Who is told what came of a wish.
pub(crate) type Answer<T> = oneshot::Sender<Result<T, Refusal>>;

/// A job that was got ready for its printer, or why it could not be.
pub(crate) type Ready = Result<Box<Print>, NotReady>;

/// Why a job could not be got ready.
#[derive(Debug)]
pub(crate) struct NotReady {
    /// In words.
    pub(crate) words: String,
    /// It will not be the next time either.
    pub(crate) for_good: bool,
}

/// What the foreman hears.
pub(crate) enum Message {
    /// An upload is whole, on the medium.
    Uploaded {
        /// Its bytes.
        upload: tempfile::NamedTempFile,
        /// What is known of it.
        file: Box<File>,
        /// For which printer it is to be looked at at once.
        printer: Option<String>,
        /// Who waits.
        answer: Answer<File>,
    },
    /// A file is to be forgotten.
    Remove {
        /// The file.
        file: String,
        /// Who waits.
        answer: Answer<()>,
    },
    /// A file is to be printed.
    Queue {
        /// The file.
        file: String,
        /// The printer.
        printer: String,
        /// It waits for a person even if nothing is found.
        hold: bool,
        /// Who wants it.
        by: String,
        /// Who waits.
        answer: Answer<Job>,
    },
    /// A person wants something of a job.
    Act {
        /// The job.
        job: String,
        /// What.
        what: Can,
        /// Who wants it.
        by: String,
        /// Who waits.
        answer: Answer<Job>,
    },
    /// The order of those that wait.
    Reorder {
        /// The printer.
        printer: String,
        /// Jobs, the next first.
        order: Vec<String>,
        /// Who waits.
        answer: Answer<()>,
    },
    /// Nothing lies on a printer's bed.
    BedClear {
        /// The printer.
        printer: String,
        /// Who waits.
        answer: Answer<()>,
    },
    /// Is anybody there?
    Ping {
        /// Who waits.
        answer: Answer<()>,
    },
    /// The inspector has done something.
    Done(Done),
    /// A printer tells something.
    Told {
        /// The printer.
        printer: String,
        /// What.
        told: Told,
    },
    /// A job is ready for its printer, or not.
    Ready {
        /// The job.
        job: String,
        /// See [`Ready`].
        ready: Ready,
    },
    /// The daemon ends.
    End,
}

/// One printer, as the foreman knows it.
struct Place {
    config: config::Printer,
    handle: Handle,
    /// It can take a job.
    ready: bool,
    /// A job is got ready for it.
    preparing: Option<String>,
    /// Its actor has ended.
    gone: bool,
}

/// What the foreman needs.
pub(crate) struct Means {
    pub(crate) shelf: Shelf,
    /// The jobs' records.
    pub(crate) folder: Folder,
    /// Where work for the inspector goes.
    pub(crate) work: mpsc::Sender<Work>,
    /// Where its own messages come from, for those who do something for it.
    pub(crate) post: mpsc::Sender<Message>,
    pub(crate) view: Arc<View>,
    /// Whether it starts a guardian beside each job.
    pub(crate) guards: bool,
    /// Uploaded files are kept up to so many bytes.
    pub(crate) keep_bytes: u64,
}

/// See the module's text.
pub(crate) struct Foreman {
    means: Means,
    files: BTreeMap<String, File>,
    jobs: BTreeMap<String, Job>,
    places: BTreeMap<String, Place>,
    ending: bool,
}

impl Foreman {
    /// A foreman over what was found in the data folder.
    pub(crate) fn new(means: Means, files: Vec<File>, jobs: Vec<Job>) -> Self {
        let files = files.into_iter().map(|file| (file.id.clone(), file)).collect();
        let jobs = jobs.into_iter().map(|job| (job.id.clone(), job)).collect();
        Self { means, files, jobs, places: BTreeMap::new(), ending: false }
    }

    /// The job that a printer is to take up before anything is said to it.
    pub(crate) fn taken_up_by(&mut self, printer: &str) -> Option<Box<Print>> {
        start::taken_up(self, printer)
    }

    /// A printer that is there from now on.
    pub(crate) fn place(&mut self, config: config::Printer, handle: Handle) {
        let id = config.id.clone();
        self.places.insert(id, Place { config, handle, ready: false, preparing: None, gone: false });
    }

    /// Hears messages until the daemon and all its printers have ended.
    pub(crate) fn run(mut self, inbox: &mpsc::Receiver<Message>) {
        while let Ok(message) = inbox.recv() {
            if matches!(message, Message::End) {
                self.ending = true;
            }
            self.hear(message);
            if self.ending && self.places.values().all(|place| place.gone) {
                return;
            }
            self.advance();
        }
    }

    /// What was left undone when the daemon ended.
    pub(crate) fn begin(&mut self) {
        start::settle(self);
        let ids: Vec<_> = self.jobs.keys().cloned().collect();
        for id in ids {
            self.pursue(&id);
        }
        for file in self.files.values() {
            self.means.view.show_file(file.clone());
        }
        self.show_all();
        self.advance();
    }

    fn hear(&mut self, message: Message) {
        match message {
            Message::Uploaded { upload, file, printer, answer } => {
                let _ = answer.send(self.uploaded(upload, *file, printer.as_deref()));
            }
            Message::Remove { file, answer } => {
                let _ = answer.send(self.remove(&file));
            }
            Message::Queue { file, printer, hold, by, answer } => {
                let _ = answer.send(self.queue(&file, &printer, hold, by));
            }
            Message::Act { job, what, by, answer } => {
                let _ = answer.send(self.act(&job, what, &by));
            }
            Message::Reorder { printer, order, answer } => {
                let _ = answer.send(self.reorder(&printer, &order));
            }
            Message::BedClear { printer, answer } => {
                let _ = answer.send(self.bed_clear(&printer));
            }
            Message::Ping { answer } => {
                let _ = answer.send(Ok(()));
            }
            Message::Done(done) => self.done(done),
            Message::Told { printer, told } => self.told(&printer, told),
            Message::Ready { job, ready } => self.ready(&job, ready),
            Message::End => {
                for place in self.places.values() {
                    place.handle.give(Order::Leave);
                }
            }
        }
    }

    // ---- files ----

    fn uploaded(
        &mut self,
        upload: tempfile::NamedTempFile,
        file: File,
        printer: Option<&str>,
    ) -> Result<File, Refusal> {
        self.make_room(file.bytes);
        self.means.shelf.keep(upload, &file)?;
        let id = file.id.clone();
        self.means.view.show_file(file.clone());
        self.files.insert(id.clone(), file);
        if let Some(printer) = printer {
            self.look(&id, printer);
        }
        Ok(self.files[&id].clone())
    }

    /// The oldest files that no job needs give way.
    fn make_room(&mut self, bytes: u64) {
        let total = |files: &BTreeMap<String, File>| files.values().map(|f| f.bytes).sum::<u64>();
        let mut by_age: Vec<_> = self.files.values().map(|f| (f.uploaded_unix_s, f.id.clone())).collect();
        by_age.sort();
        for (_, id) in by_age {
            if total(&self.files).saturating_add(bytes) <= self.means.keep_bytes {
                return;
            }
            let _ = self.remove(&id);
        }
    }

    fn remove(&mut self, id: &str) -> Result<(), Refusal> {
        if !self.files.contains_key(id) {
            return Err(Refusal::NoSuch("file"));
        }
        if let Some(job) = self.jobs.values().find(|job| job.file == id && !job.state.is_over()) {
            let words = format!("job {} needs it ({}): cancel that first", job.id, job.state.words());
            return Err(Refusal::Conflict(words));
        }
        self.means.shelf.remove_file(id)?;
        self.files.remove(id);
        self.means.view.gone("file", id);
        Ok(())
    }

    /// Has a file looked at for a printer, unless that is done or on its way.
    fn look(&mut self, id: &str, printer: &str) {
        let Some(of) = self.of(printer) else { return };
        let Some(file) = self.files.get_mut(id) else { return };
        let known = file.checks.get(printer).is_some_and(|check| check.state != CheckState::Waiting);
        if known {
            return;
        }
        file.checks.insert(printer.to_owned(), Check { state: CheckState::Checking, ..Check::default() });
        let work = Work::Look { file: id.to_owned(), name: file.name.clone(), of };
        self.means.view.show_file(file.clone());
        let _ = self.means.work.send(work);
    }

    fn of(&self, printer: &str) -> Option<For> {
        let config = &self.places.get(printer)?.config;
        Some(For {
            printer: printer.to_owned(),
            profile: config.profile.clone(),
            material: config.material.clone(),
            reorder: config.reorder,
        })
    }

    // ---- jobs ----

    fn queue(&mut self, file: &str, printer: &str, hold: bool, by: String) -> Result<Job, Refusal> {
        let found = self.files.get(file).ok_or(Refusal::NoSuch("file"))?;
        if !self.places.contains_key(printer) {
            return Err(Refusal::NoSuch("printer"));
        }
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
    fn pursue(&mut self, id: &str) {
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
    fn decide(&mut self, id: &str) {
        let Some(job) = self.jobs.get(id) else { return };
        let Some(place) = self.places.get(&job.printer) else { return };
        let file = self.files.get(&job.file);
        let check = file.and_then(|file| file.checks.get(&job.printer));
        let resin = file.is_some_and(|file| file.kind == Kind::Resin);
        let state = check.map_or(CheckState::Failed, |check| check.state);
        let words = check.and_then(|check| check.words.clone());
        if resin {
            return self.fail(id, "this is a resin job, and the printer prints filament");
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

    fn act(&mut self, id: &str, what: Can, by: &str) -> Result<Job, Refusal> {
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

    fn ask(&self, printer: &str, request: Request) -> Result<(), Refusal> {
        let place = self.places.get(printer).ok_or(Refusal::NoSuch("printer"))?;
        match place.handle.give(Order::Ask(request)) {
            true => Ok(()),
            false => Err(Refusal::Conflict("the printer does not take orders now: try again".to_owned())),
        }
    }

    fn reorder(&mut self, printer: &str, order: &[String]) -> Result<(), Refusal> {
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

    fn bed_clear(&mut self, printer: &str) -> Result<(), Refusal> {
        if !self.places.contains_key(printer) {
            return Err(Refusal::NoSuch("printer"));
        }
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
        self.show_place(printer);
        Ok(())
    }

    // ---- what others tell ----

    fn done(&mut self, done: Done) {
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

    fn told(&mut self, printer: &str, told: Told) {
        match told {
            Told::Ready => self.set_ready(printer, true),
            Told::Away => self.set_ready(printer, false),
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
                    tracing::error!(printer, job, "heaters may be on: the printer confirmed nothing");
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
                self.show_place(printer);
            }
        }
    }

    fn set_ready(&mut self, printer: &str, ready: bool) {
        if let Some(place) = self.places.get_mut(printer) {
            place.ready = ready;
        }
    }

    /// A job that was got ready.
    fn ready(&mut self, id: &str, ready: Ready) {
        let Some(printer) = self.jobs.get(id).map(|job| job.printer.clone()) else { return };
        let Some(place) = self.places.get_mut(&printer) else { return };
        place.preparing = None;
        let resumes = self.jobs[id].state == Stage::Interrupted;
        match ready {
            Ok(print) if self.jobs[id].state == Stage::Queued || resumes => {
                let record = super::actor::record(&print);
                // From here on a restart looks for its journal: it is never started twice.
                let noted = self.changed(id, |job| {
                    (job.state, job.record, job.error) = (Stage::Starting, Some(record), None);
                    job.ended_unix_s = None;
                });
                if let Err(why) = noted {
                    self.set_ready(&printer, false);
                    return self.change(id, |job| job.error = Some(why.to_string()));
                }
                if self.means.guards
                    && let Err(why) = guardian::start(&self.means.folder.store, record)
                {
                    tracing::warn!(job = id, "no guardian ({why:#}): if this process dies, heaters stay on");
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
    fn advance(&mut self) {
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
            let next = self
                .jobs
                .values()
                .filter(|job| job.printer == printer && job.state == Stage::Queued)
                .min_by_key(|job| job.place)
                .filter(|job| clear || job.start_anyway)
                .map(|job| job.id.clone());
            if let Some(id) = next {
                start::fresh(self, &id);
            }
        }
    }

    // ---- changes ----

    /// Changes a job and writes it down; one that cannot be written stays as it was.
    fn changed(&mut self, id: &str, change: impl FnOnce(&mut Job)) -> Result<(), Refusal> {
        let job = self.jobs.get_mut(id).ok_or(Refusal::NoSuch("job"))?;
        let mut new = job.clone();
        change(&mut new);
        self.means.shelf.write_job(&new)?;
        *job = new;
        Ok(())
    }

    /// Changes a job as something has come about: it is so even if it cannot be written down.
    fn change(&mut self, id: &str, change: impl FnOnce(&mut Job)) {
        let Some(job) = self.jobs.get_mut(id) else { return };
        change(job);
        if let Err(why) = self.means.shelf.write_job(job) {
            tracing::error!(job = id, "{why}");
        }
        self.show(id);
    }

    fn fail(&mut self, id: &str, words: &str) {
        self.change(id, |job| {
            job.state = Stage::Failed;
            job.error = Some(words.to_owned());
            job.ended_unix_s = Some(now_unix_s());
        });
    }

    // ---- what is shown ----

    /// A job with what follows from its state.
    fn shown(&self, id: &str) -> Job {
        let job = &self.jobs[id];
        let printer = job.printer.as_str();
        let mut shown = job.clone();
        shown.state_words = job.state.words().to_owned();
        shown.can = rules::can(job);
        let place = self.places.get(printer);
        let first = self
            .jobs
            .values()
            .filter(|other| other.printer == printer && other.state == Stage::Queued)
            .min_by_key(|other| other.place)
            .is_some_and(|first| first.id == job.id);
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
            },
        );
        shown
    }

    fn show(&mut self, id: &str) {
        let shown = self.shown(id);
        let printer = shown.printer.clone();
        self.means.view.show_job(shown);
        self.trim();
        self.show_place(&printer);
    }

    /// A printer's queue and bed, and the jobs whose waiting depends on them.
    fn show_place(&self, printer: &str) {
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

    fn show_all(&mut self) {
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
    fn trim(&mut self) {
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
