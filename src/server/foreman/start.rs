//! From a waiting job to a host that holds it; and what is made of jobs that a dead daemon had.
//!
//! Opening a job reads its whole file, which takes seconds for a large one on a Pi: that is done by
//! a thread of its own, which sends word.
use super::{Foreman, Message, NotReady, Ready, Refusal};
use crate::causes;
use crate::job::disk::{Store, StoreError};
use crate::job::host::Begin;
use crate::job::state::State;
use crate::profile::load_printer;
use crate::server::actor::Print;
use crate::server::model::{GivenUp, Job, Printed, Stage};
use crate::station::{Folder, Job as Checked, lasting_name, now_unix_s};
use std::path::PathBuf;
use std::time::Duration;

/// How often a job that is still held is tried, and the pause between: its journal's thread ends
/// within a second.
const BUSY_TRIES: u32 = 40;
const BUSY_PAUSE: Duration = Duration::from_millis(50);

/// Where the bytes are that are printed.
fn path(foreman: &Foreman, job: &Job) -> PathBuf {
    let shelf = &foreman.means.shelf;
    match job.printed {
        Printed::Mended => shelf.of_job(&job.id, "mended"),
        Printed::Original => {
            let reordered = shelf.made(&job.file, &job.printer, "reordered");
            if reordered.exists() { reordered } else { shelf.content(&job.file) }
        }
    }
}

/// Gets a job ready that nothing was sent of.
pub(super) fn fresh(foreman: &mut Foreman, id: &str) {
    let Some(job) = foreman.jobs.get(id).cloned() else { return };
    let path = path(foreman, &job);
    let Some(place) = foreman.places.get_mut(&job.printer) else { return };
    place.preparing = Some(job.id.clone());
    let device = place.handle.board.picture().device.unwrap_or_default();
    let profile = place.config.profile.clone();
    let store = foreman.means.folder.store.path().to_owned();
    in_thread(foreman, id, move || {
        let passing = |why: anyhow::Error| NotReady { words: causes::line(&why), for_good: false };
        let last = |why: anyhow::Error| NotReady { words: causes::line(&why), for_good: true };
        let folder = Folder::open(Some(&store)).map_err(|e| passing(e.into()))?;
        let loaded = load_printer(&profile).map_err(|e| last(e.into()))?;
        let name = lasting_name(&profile).map_err(last)?;
        let checked = Checked::open(&path, &loaded, &name, Some(&folder.store), |_, _| {}).map_err(last)?;
        // Whoever wanted the start has seen to the bed.
        folder.clear_bed(&device, true).map_err(passing)?;
        let held = folder.store.accept(&checked.accepted).map_err(|e| passing(e.into()))?;
        Ok(Box::new(Print { id: job.id, name: job.name, job: checked, held, begin: Begin::Fresh }))
    });
}

/// Gets a broken-off job ready for the way back. Since then our own connection has counted lines
/// anew: what the printer knew of the job is gone.
pub(super) fn resume(foreman: &mut Foreman, id: &str) -> Result<(), Refusal> {
    let job = foreman.jobs.get(id).cloned().ok_or(Refusal::NoSuch("job"))?;
    let record = job.record.ok_or_else(|| Refusal::Conflict("nothing of it was sent".to_owned()))?;
    let place = foreman.places.get_mut(&job.printer).ok_or(Refusal::NoSuch("printer"))?;
    if place.preparing.is_some() {
        return Ok(());
    }
    if !place.ready {
        return Err(Refusal::Conflict("the printer is not connected: switch it on first".to_owned()));
    }
    place.preparing = Some(job.id.clone());
    let store = foreman.means.folder.store.path().to_owned();
    in_thread(foreman, id, move || {
        let passing = |why: anyhow::Error| NotReady { words: causes::line(&why), for_good: false };
        let store = Folder::open(Some(&store)).map_err(|e| passing(e.into()))?.store;
        let held = store.hold_job(record).map_err(|e| passing(e.into()))?;
        let log = held.journal.log().clone();
        let profile = load_printer(&log.accepted.profile).map_err(|e| passing(e.into()))?;
        let checked = Checked::again(&log.accepted, &profile).map_err(passing)?;
        let begin = Begin::AfterReset { log: Box::new(log), confirmed: false };
        Ok(Box::new(Print { id: job.id, name: job.name, job: checked, held, begin }))
    });
    Ok(())
}

fn in_thread(foreman: &Foreman, id: &str, get: impl FnOnce() -> Ready + Send + 'static) {
    let (post, job) = (foreman.means.post.clone(), id.to_owned());
    let started = std::thread::Builder::new().name("open job".to_owned()).spawn({
        let (post, job) = (post.clone(), job.clone());
        move || {
            let _ = post.send(Message::Ready { job, ready: get() });
        }
    });
    if let Err(why) = started {
        let words = format!("the system has no thread left: {why}");
        let _ = post.send(Message::Ready { job, ready: Err(NotReady { words, for_good: false }) });
    }
}

/// Ends a broken-off job that nobody holds any more: nobody shall resume it or make it safe.
pub(super) fn close(foreman: &mut Foreman, id: &str) -> Result<(), Refusal> {
    let job = foreman.jobs.get(id).ok_or(Refusal::NoSuch("job"))?;
    if let Some(record) = job.record {
        let gone = |why: &anyhow::Error| matches!(why.downcast_ref(), Some(StoreError::NoJob(_)));
        match given_up(&foreman.means.folder, record) {
            Err(why) if !gone(&why) => return Err(Refusal::Conflict(causes::line(&why))),
            _ => {}
        }
    }
    if foreman.jobs[id].given_up == Some(GivenUp::Forget) {
        return forget(foreman, id);
    }
    foreman.change(id, |job| {
        (job.state, job.error) = (Stage::Cancelled, None);
        job.ended_unix_s = Some(now_unix_s());
    });
    Ok(())
}

/// Who has just ended may still hold it for a moment.
fn given_up(folder: &Folder, record: u32) -> anyhow::Result<()> {
    let mut tries = 0;
    loop {
        match folder.give_up(record, "given up by a person") {
            Err(why) if tries < BUSY_TRIES && matches!(why.downcast_ref(), Some(StoreError::Busy(_))) => {
                tries += 1;
                std::thread::sleep(BUSY_PAUSE);
            }
            done => return done,
        }
    }
}

/// Nobody shall hear of a job any more.
pub(super) fn forget(foreman: &mut Foreman, id: &str) -> Result<(), Refusal> {
    let printer = foreman.jobs.get(id).ok_or(Refusal::NoSuch("job"))?.printer.clone();
    foreman.means.shelf.remove_job(id)?;
    foreman.jobs.remove(id);
    foreman.means.view.gone("job", id);
    foreman.show_place(&printer);
    Ok(())
}

/// After a restart: jobs that a host had stand as their journals say, and what a person had seen to is to
/// be seen to again.
pub(super) fn settle(foreman: &mut Foreman) {
    let said: Vec<_> = foreman.jobs.values().filter(|job| job.prepared).map(|job| job.id.clone()).collect();
    for id in said {
        foreman.change(&id, |job| job.prepared = false);
    }
    let begun: Vec<_> = foreman
        .jobs
        .values()
        .filter(|job| {
            (job.state.is_running() || job.state == Stage::Interrupted) && !is_taken_up(foreman, job)
        })
        .map(|job| (job.id.clone(), job.record))
        .collect();
    for (id, record) in begun {
        let stands = record.map(|record| stands(&foreman.means.folder.store, record));
        foreman.change(&id, |job| match stands {
            // Nothing was written down before nothing was sent.
            None | Some(Stands::NotBegun) => (job.state, job.record) = (Stage::Queued, None),
            Some(Stands::At(state)) => {
                // No host has it: what was active is broken off.
                job.state = if state.is_over() { Stage::of(state) } else { Stage::Interrupted };
                if state.is_over() {
                    job.ended_unix_s.get_or_insert_with(now_unix_s);
                }
            }
            Some(Stands::Gone(why)) => {
                job.state = Stage::Failed;
                job.error = Some(format!("what was written down of it cannot be used: {why}"));
                job.ended_unix_s = Some(now_unix_s());
            }
        });
    }
}

fn is_taken_up(foreman: &Foreman, job: &Job) -> bool {
    foreman.places.get(&job.printer).is_some_and(|place| place.preparing.as_ref() == Some(&job.id))
}

enum Stands {
    NotBegun,
    At(State),
    Gone(String),
}

fn stands(store: &Store, record: u32) -> Stands {
    let picture = match store.look(record) {
        Ok(entry) => entry.picture.map_err(|e| e.to_string()),
        Err(why) => Err(why.to_string()),
    };
    match picture {
        Ok(picture) if picture.log.state == State::Accepted && picture.log.starts == 0 => Stands::NotBegun,
        Ok(picture) => Stands::At(picture.log.state),
        Err(why) => Stands::Gone(why),
    }
}

/// The job that a dead daemon was printing there, to be taken up before anything is said to the
/// printer: it may have kept its state, and go on at once.
pub(super) fn taken_up(foreman: &mut Foreman, printer: &str) -> Option<Box<Print>> {
    let running = |job: &&Job| job.printer == printer && job.state.is_running();
    let job = foreman.jobs.values().find(running)?.clone();
    let store = &foreman.means.folder.store;
    let record = job.record?;
    match stands(store, record) {
        Stands::At(state) if state.is_active() => {}
        _ => return None,
    }
    let taken = || -> anyhow::Result<Box<Print>> {
        let held = store.hold_job(record)?;
        let log = held.journal.log().clone();
        let checked = Checked::again(&log.accepted, &load_printer(&log.accepted.profile)?)?;
        let begin = Begin::TakeOver { log: Box::new(log) };
        Ok(Box::new(Print { id: job.id.clone(), name: job.name.clone(), job: checked, held, begin }))
    };
    match taken() {
        Ok(print) => Some(print),
        Err(why) => {
            tracing::warn!(job = job.id, "not taken up: {}", causes::line(&why));
            None
        }
    }
}
