//! What everybody may read of files and jobs at any time, and who hears of changes.
//!
//! The foreman writes, the network's side reads: a lock that is held for a copy only. Changes go
//! out as the text messages of the WebSocket.
use crate::server::model::{File, Job};
use std::collections::BTreeMap;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};
use tokio::sync::broadcast;

/// Messages that a slow reader may be behind before it begins anew.
const MAX_BEHIND: usize = 256;

/// A message of the WebSocket.
#[derive(Clone, Debug)]
pub(crate) struct News {
    /// Only those with this scope hear it.
    pub(crate) scope: Scope,
    /// JSON.
    pub(crate) text: Arc<str>,
}

/// Who hears a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scope {
    /// Whoever may read.
    Read,
    /// Whoever may command a printer.
    Control,
    /// Admins.
    Admin,
}

/// See the module's text.
#[derive(Debug)]
pub(crate) struct View {
    inner: RwLock<Inner>,
    news: broadcast::Sender<News>,
}

#[derive(Debug, Default)]
struct Inner {
    files: BTreeMap<String, File>,
    jobs: BTreeMap<String, Job>,
    places: BTreeMap<String, Place>,
}

/// A printer's queue and bed.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Place {
    /// Jobs that wait, the next first.
    pub(crate) queue: Vec<String>,
    /// Whether nothing is known to lie on the bed.
    pub(crate) bed_clear: bool,
    /// Grows with each change.
    pub(crate) version: u64,
}

impl Default for View {
    fn default() -> Self {
        Self { inner: RwLock::default(), news: broadcast::channel(MAX_BEHIND).0 }
    }
}

impl View {
    fn read(&self) -> RwLockReadGuard<'_, Inner> {
        self.inner.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Inner> {
        self.inner.write().unwrap_or_else(PoisonError::into_inner)
    }

    /// From now on hears of changes.
    pub(crate) fn listen(&self) -> broadcast::Receiver<News> {
        self.news.subscribe()
    }

    /// How many listen.
    pub(crate) fn listeners(&self) -> usize {
        self.news.receiver_count()
    }

    /// Tells those who listen. Nobody is waited for.
    pub(crate) fn tell(&self, scope: Scope, message: impl FnOnce() -> serde_json::Value) {
        if self.news.receiver_count() > 0 {
            let _ = self.news.send(News { scope, text: message().to_string().into() });
        }
    }

    /// All files, the newest first.
    pub(crate) fn files(&self) -> Vec<File> {
        let mut files: Vec<_> = self.read().files.values().cloned().collect();
        files.sort_by(|a, b| (b.uploaded_unix_s, &b.id).cmp(&(a.uploaded_unix_s, &a.id)));
        files
    }

    /// A file.
    pub(crate) fn file(&self, id: &str) -> Option<File> {
        self.read().files.get(id).cloned()
    }

    /// The newest file of a name.
    pub(crate) fn file_named(&self, name: &str) -> Option<File> {
        let inner = self.read();
        let named = inner.files.values().filter(|file| file.name == name);
        named.max_by_key(|file| (file.uploaded_unix_s, &file.id)).cloned()
    }

    /// All jobs, the newest first.
    pub(crate) fn jobs(&self) -> Vec<Job> {
        let mut jobs: Vec<_> = self.read().jobs.values().cloned().collect();
        jobs.sort_by(|a, b| (b.created_unix_s, b.place, &b.id).cmp(&(a.created_unix_s, a.place, &a.id)));
        jobs
    }

    /// A job.
    pub(crate) fn job(&self, id: &str) -> Option<Job> {
        self.read().jobs.get(id).cloned()
    }

    /// A printer's queue and bed.
    pub(crate) fn place(&self, printer: &str) -> Place {
        self.read().places.get(printer).cloned().unwrap_or_default()
    }

    // ---- the foreman's side ----

    pub(super) fn show_file(&self, file: File) {
        self.tell(Scope::Read, || serde_json::json!({"type": "file", "file": file}));
        self.write().files.insert(file.id.clone(), file);
    }

    pub(super) fn show_job(&self, job: Job) {
        if self.read().jobs.get(&job.id) == Some(&job) {
            return;
        }
        self.tell(Scope::Read, || serde_json::json!({"type": "job", "job": job}));
        self.write().jobs.insert(job.id.clone(), job);
    }

    pub(super) fn show_place(&self, printer: &str, queue: Vec<String>, bed_clear: bool) {
        let mut inner = self.write();
        let place = inner.places.entry(printer.to_owned()).or_default();
        if (&place.queue, place.bed_clear) != (&queue, bed_clear) {
            *place = Place { queue, bed_clear, version: place.version + 1 };
        }
    }

    pub(super) fn gone(&self, what: &'static str, id: &str) {
        match what {
            "file" => drop(self.write().files.remove(id)),
            _ => drop(self.write().jobs.remove(id)),
        }
        self.tell(Scope::Read, || serde_json::json!({"type": "gone", "what": what, "id": id}));
    }
}
