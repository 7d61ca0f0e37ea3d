//! The foreman: one thread that alone decides what becomes of files and jobs.
//!
//! Takes [`Message`]s, one after the other: uploads, people's wishes, what the inspector found,
//! what printers tell. Writes each decision down before it is acknowledged, shows it in the
//! [`View`], and gives orders to the printers' actors. Nobody else changes a file or a job, so no
//! two decisions can cross. Owns no socket and no port; what takes long (checks, opening a large
//! job) is done by others, who send word.
//!
//! - `files`, `jobs`: what people want · `told`: what others tell, and what can start thereupon
//! - [`rules`]: what may be wanted of a job, and what it waits for: pure
//! - [`start`]: from a waiting job to a host that holds it
//! - `shown`: changes, written down first · [`view`]: what everybody may read at any time
mod files;
mod jobs;
mod rules;
mod shown;
mod start;
#[cfg(test)]
mod tests;
mod told;
pub(crate) mod view;

use super::actor::{Handle, Order, Print, Told};
use super::config;
use super::inspect::{Done, Work};
use super::model::{Can, File, Job};
use super::shelf::{Shelf, ShelfError};
use crate::profile::Profile;
use crate::station::{Folder, settings};
use std::collections::BTreeMap;
use std::sync::{Arc, mpsc};
use tokio::sync::oneshot;
use view::View;

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Refusal {
    /// There is no such thing.
    #[error("there is no such {0}")]
    NoSuch(&'static str),
    /// It cannot be now.
    #[error("{0}")]
    Conflict(String),
    /// A file is of no use to a printer.
    #[error("{0}")]
    Unfit(String),
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
    wants: Wants,
    handle: Handle,
    /// It can take a job.
    ready: bool,
    /// A job is got ready for it.
    preparing: Option<String>,
    /// Its actor has ended.
    gone: bool,
}

/// What a printer wants of jobs and people, by its profile.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Wants {
    /// Its jobs are pictures: it cures resin.
    pub(crate) resin: bool,
    /// What a person must have seen to before each print.
    pub(crate) before: Vec<String>,
}

impl Wants {
    /// Those of a profile.
    pub(crate) fn of(profile: &Profile) -> Self {
        let before = settings::asks(profile).into_iter().map(str::to_owned).collect();
        Self { resin: profile.msla().is_some(), before }
    }
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
    pub(crate) fn place(&mut self, config: config::Printer, wants: Wants, handle: Handle) {
        let id = config.id.clone();
        let place = Place { config, wants, handle, ready: false, preparing: None, gone: false };
        self.places.insert(id, place);
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
}
