//! Jobs as files: one folder holds them all, and a lock tells who prints one.
//!
//! ```text
//! STATE/
//!   lock               held for moments: whoever changes the folder
//!   next-id            the number that no job had yet
//!   jobs/12.journal    the job
//!   jobs/12.lock       held by the host that prints it, until it ends or dies
//!   jobs/12.tmp        a journal that is being replaced
//! ```
//!
//! Takes a folder; gives journals, and what a person may know of each job. The kernel
//! releases a lock when its holder dies, however it dies: so a guardian sees that a
//! job's host lives. Asks no clock; knows no printer.
use super::digest;
use super::journal::{self, Cut, Journal, JournalError, MAX_JOURNAL_BYTES, Picture};
use super::record::{Accepted, Log};
use super::state::State;
use super::storage::Storage;
use rustix::fs::{FlockOperation, flock};
use std::ffi::OsString;
use std::fs::{DirBuilder, File, Metadata, OpenOptions};
use std::io::{self, ErrorKind, Read, Write};
use std::os::unix::fs::{DirBuilderExt, FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::Duration;
use thiserror::Error;

/// What people call a job by.
pub type JobId = u32;

/// Jobs that are over and kept for looking at; the oldest are forgotten.
pub const MAX_OVER: usize = 100;

/// Jobs looked at in one folder: more were put there by somebody else.
const MAX_JOBS: usize = 100_000;

/// How often the folder's lock is tried for…
const LOCK_TRIES: u32 = 500;

/// …and how long between: 5 s in all, far more than any change of the folder takes.
const LOCK_PAUSE: Duration = Duration::from_millis(10);

/// How often a job's lock is tried for: a process that is just being started has its
/// starter's locks for a moment, even one that the starter has let go of.
const TAKE_TRIES: u32 = 20;

/// Why the folder or a job in it cannot be used.
#[derive(Debug, Error)]
pub enum StoreError {
    /// No folder is named, and there is no home to put one in.
    #[error("there is no folder for the jobs' records: name one with --state or $OUTRIGGER_STATE")]
    NoFolder,
    /// The system refuses.
    #[error("cannot {what} {}: {source}", .path.display())]
    Io {
        /// What was tried.
        what: &'static str,
        /// With what.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Another program changes the folder, and does not end.
    #[error("another outrigger has held {} for 5 s: see whether it hangs", .0.display())]
    FolderBusy(PathBuf),
    /// No such job.
    #[error("there is no job {0}; `outrigger jobs list` names those that are known")]
    NoJob(JobId),
    /// Its host lives.
    #[error("job {0} is being printed by another outrigger, which still runs")]
    Busy(JobId),
    /// Its journal.
    #[error("job {id}: {source}")]
    Journal {
        /// The job.
        id: JobId,
        /// What is wrong.
        source: JournalError,
    },
    /// The numbers are used up, or somebody wrote the file.
    #[error("there is no number left for a job: see {}", .0.display())]
    NoNumber(PathBuf),
    /// An interrupted job is forgotten only by somebody who says so.
    #[error("job {0} was broken off and can perhaps be resumed; --yes forgets it nevertheless")]
    Interrupted(JobId),
}

fn io_at<'a>(what: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> StoreError + 'a {
    move |source| StoreError::Io { what, path: path.to_owned(), source }
}

/// The folder for the jobs' records: as named, else by the environment (`variable` is
/// [`std::env::var_os`]), else in the user's home.
///
/// # Errors
/// Nothing names one.
pub fn folder(
    named: Option<&Path>,
    variable: impl Fn(&str) -> Option<OsString>,
) -> Result<PathBuf, StoreError> {
    let set = |name| variable(name).filter(|value| !value.is_empty()).map(PathBuf::from);
    // An XDG path that is not absolute is to be ignored, says its specification.
    let xdg = || set("XDG_STATE_HOME").filter(|path| path.is_absolute());
    // systemd separates several folders by colons.
    let systemd = || {
        let all = set("STATE_DIRECTORY")?;
        all.to_string_lossy().split(':').next().map(PathBuf::from)
    };
    named
        .map(Path::to_owned)
        .or_else(|| set("OUTRIGGER_STATE"))
        .or_else(systemd)
        .or_else(|| xdg().map(|state| state.join("outrigger")))
        .or_else(|| set("HOME").map(|home| home.join(".local/state/outrigger")))
        .ok_or(StoreError::NoFolder)
}

/// A number that differs for a file that was written to or replaced; see
/// [`Accepted::stamp`].
pub fn stamp(meta: &Metadata) -> u64 {
    digest::stamp(&[
        meta.dev().into(),
        meta.ino().into(),
        meta.len().into(),
        meta.mtime().into(),
        meta.mtime_nsec().into(),
        meta.ctime().into(),
        meta.ctime_nsec().into(),
    ])
}

/// A folder of jobs.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
}

/// A job that this process holds: nobody else prints it until this is dropped.
#[derive(Debug)]
pub struct HeldJob {
    /// Its number.
    pub id: JobId,
    /// Its journal.
    pub journal: Journal<FileStorage>,
    /// What was cut off the journal's end when it was opened.
    pub cut: Option<Cut>,
    /// Released when the process ends, whatever ends it.
    pub lock: JobLock,
}

/// That a job is held. Dropping it lets go.
#[derive(Debug)]
pub struct JobLock {
    _file: File,
}

/// A job as one who looks on sees it.
#[derive(Debug)]
pub struct Entry {
    /// Its number.
    pub id: JobId,
    /// Whether a host holds it.
    pub live: bool,
    /// What is known of it.
    pub picture: Result<Picture, JournalError>,
}

impl Store {
    /// The folder, made if it is not there. Others may not look into it: it names files
    /// and printers.
    ///
    /// # Errors
    /// It cannot be made.
    pub fn open(folder: &Path) -> Result<Self, StoreError> {
        let store = Self { folder: folder.to_owned() };
        let jobs = store.jobs();
        if !jobs.is_dir() {
            DirBuilder::new()
                .recursive(true)
                .mode(0o700)
                .create(&jobs)
                .map_err(io_at("make the folder", &jobs))?;
            // What is new must be found after a power cut: each folder is named in the
            // one above it. One that cannot be synced was there before.
            for above in jobs.ancestors().skip(1).filter(|above| !above.as_os_str().is_empty()) {
                let _ = sync_folder(above);
            }
        }
        Ok(store)
    }

    /// The folder, if it is there.
    ///
    /// # Errors
    /// It cannot be looked at.
    pub fn existing(folder: &Path) -> Result<Option<Self>, StoreError> {
        let store = Self { folder: folder.to_owned() };
        let there = store.jobs().try_exists().map_err(io_at("look at", folder))?;
        Ok(there.then_some(store))
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.folder
    }

    /// Accepts a job. Once this returns, it is on the medium and held by this process. A
    /// job of the same file, bytes and profile that was accepted and never begun is
    /// taken instead of another.
    ///
    /// # Errors
    /// The folder's or the medium's: the job is not accepted.
    pub fn accept(&self, accepted: &Accepted) -> Result<HeldJob, StoreError> {
        let folder = self.lock()?;
        for id in self.ids()?.into_iter().rev() {
            let waits = |log: &Log| {
                log.state == State::Accepted && log.starts == 0 && same_job(&log.accepted, accepted)
            };
            if self.picture(id).is_ok_and(|picture| waits(&picture.log)) {
                match self.hold(id, &folder) {
                    Err(StoreError::Busy(_)) => {}
                    held => return held,
                }
            }
        }
        let id = self.new_id()?;
        let lock = self.take(id, &folder)?;
        let storage = FileStorage::new(self.journal_path(id));
        let journal = Journal::create(storage, accepted.clone()).map_err(|source| {
            // Whatever is there of it was not accepted.
            let _ = std::fs::remove_file(self.journal_path(id));
            let _ = std::fs::remove_file(self.lock_path(id));
            StoreError::Journal { id, source }
        })?;
        self.forget_old(&folder)?;
        Ok(HeldJob { id, journal, cut: None, lock })
    }

    /// The newest job of a file that has not been written to since ([`stamp`]), for the
    /// same profile: its sums need not be taken again.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn known(&self, path: &Path, stamp: u64, profile: &str) -> Result<Option<Accepted>, StoreError> {
        let same = |accepted: &Accepted| {
            accepted.stamp == stamp && accepted.path == path && accepted.profile == profile
        };
        let ids = self.ids()?;
        let mut known = ids.into_iter().rev().filter_map(|id| Some(self.picture(id).ok()?.log.accepted));
        Ok(known.find(same).filter(|_| stamp != 0))
    }

    /// Takes a job up that was accepted before.
    ///
    /// # Errors
    /// There is no such job, another host holds it, or its journal cannot be used.
    pub fn hold_job(&self, id: JobId) -> Result<HeldJob, StoreError> {
        let folder = self.lock()?;
        self.hold(id, &folder)
    }

    /// What is known of a job, without touching it.
    ///
    /// # Errors
    /// There is no such job, or the folder cannot be used.
    pub fn look(&self, id: JobId) -> Result<Entry, StoreError> {
        // First who holds it: a host that ends in between has written its last record.
        let live = self.is_live(id)?;
        match self.picture(id) {
            Err(JournalError::Missing) => Err(StoreError::NoJob(id)),
            picture => Ok(Entry { id, live, picture }),
        }
    }

    /// All jobs, oldest first. A journal that says nothing is among them.
    ///
    /// # Errors
    /// The folder cannot be used.
    pub fn list(&self) -> Result<Vec<Entry>, StoreError> {
        let mut entries = Vec::new();
        for id in self.ids()? {
            match self.look(id) {
                // Forgotten in between.
                Err(StoreError::NoJob(_)) => {}
                entry => entries.push(entry?),
            }
        }
        Ok(entries)
    }

    /// Whether a host holds the job.
    ///
    /// # Errors
    /// The folder cannot be used.
    pub fn is_live(&self, id: JobId) -> Result<bool, StoreError> {
        let folder = self.lock()?;
        match self.try_lock(id, &folder, false)? {
            Some(_) => Ok(false),
            None => Ok(true),
        }
    }

    /// Forgets a job for ever. `sure`: even one that might be resumed, or whose journal
    /// is damaged.
    ///
    /// # Errors
    /// There is no such job, a host holds it, or it needs a surer word.
    pub fn forget(&self, id: JobId, sure: bool) -> Result<(), StoreError> {
        let folder = self.lock()?;
        let over = match self.picture(id) {
            Err(JournalError::Missing) => return Err(StoreError::NoJob(id)),
            Ok(picture) => picture.log.state.is_over() || is_waiting(&picture.log),
            Err(_) => false,
        };
        let _lock = self.take(id, &folder)?;
        if !over && !sure {
            return Err(StoreError::Interrupted(id));
        }
        self.remove(id)
    }

    // ---- the folder ----

    fn jobs(&self) -> PathBuf {
        self.folder.join("jobs")
    }

    fn journal_path(&self, id: JobId) -> PathBuf {
        self.jobs().join(format!("{id}.journal"))
    }

    fn lock_path(&self, id: JobId) -> PathBuf {
        self.jobs().join(format!("{id}.lock"))
    }

    /// Numbers of all journals, ascending.
    fn ids(&self) -> Result<Vec<JobId>, StoreError> {
        let jobs = self.jobs();
        let cannot = || io_at("read the folder", &jobs);
        let mut ids = Vec::new();
        for entry in std::fs::read_dir(&jobs).map_err(cannot())?.take(4 * MAX_JOBS) {
            let name = entry.map_err(cannot())?.file_name();
            let id = name.to_str().and_then(|name| name.strip_suffix(".journal")).and_then(number);
            ids.extend(id.filter(|_| ids.len() < MAX_JOBS));
        }
        ids.sort_unstable();
        Ok(ids)
    }

    /// A number that no job had yet, as far as the folder knows.
    fn new_id(&self) -> Result<JobId, StoreError> {
        let path = self.folder.join("next-id");
        let told = std::fs::read_to_string(&path).ok().and_then(|text| number(text.trim())).unwrap_or(1);
        let above = self.ids()?.last().map_or(1, |last| last.saturating_add(1));
        let id = told.max(above);
        if id == JobId::MAX {
            return Err(StoreError::NoNumber(path));
        }
        let next = format!("{}\n", id + 1);
        replace(&path, &self.folder.join("next-id.tmp"), next.as_bytes()).map_err(io_at("write", &path))?;
        Ok(id)
    }

    fn picture(&self, id: JobId) -> Result<Picture, JournalError> {
        let bytes = FileStorage::new(self.journal_path(id)).read(MAX_JOURNAL_BYTES);
        let bytes = bytes.map_err(|source| JournalError::Medium { what: "read", source })?;
        Ok(journal::read(&bytes.ok_or(JournalError::Missing)?)?)
    }

    /// The oldest jobs that are over give way.
    fn forget_old(&self, folder: &FolderLock) -> Result<(), StoreError> {
        let ids = self.ids()?;
        if ids.len() <= MAX_OVER {
            return Ok(());
        }
        let over = |id: &JobId| self.picture(*id).is_ok_and(|picture| picture.log.state.is_over());
        let over: Vec<JobId> = ids.into_iter().filter(over).collect();
        let many = over.len().saturating_sub(MAX_OVER);
        // A host may still be at its last words.
        let free = over.iter().filter_map(|id| Some((id, self.take(*id, folder).ok()?)));
        for (id, _lock) in free.take(many) {
            self.remove(*id)?;
        }
        Ok(())
    }

    /// The journal first: a lock without a journal is nothing. To be called by who
    /// holds the job.
    fn remove(&self, id: JobId) -> Result<(), StoreError> {
        let path = self.journal_path(id);
        std::fs::remove_file(&path).map_err(io_at("remove", &path))?;
        let _ = std::fs::remove_file(self.jobs().join(format!("{id}.tmp")));
        let _ = std::fs::remove_file(self.lock_path(id));
        sync_folder(&self.jobs()).map_err(io_at("sync", &self.jobs()))
    }

    // ---- locks ----

    /// The whole folder, for a moment. A job's lock is tried only under it: so nobody
    /// who merely looks can be in the way of a host.
    fn lock(&self) -> Result<FolderLock, StoreError> {
        let path = self.folder.join("lock");
        let file = lock_file(&path).map_err(io_at("open", &path))?;
        for _ in 0..LOCK_TRIES {
            if try_flock(&file).map_err(io_at("lock", &path))? {
                return Ok(FolderLock { _file: file });
            }
            std::thread::sleep(LOCK_PAUSE);
        }
        Err(StoreError::FolderBusy(path))
    }

    /// A job's lock if nobody has it. Without `make` a file that is not there is a lock
    /// that nobody has.
    fn try_lock(
        &self,
        id: JobId,
        _folder: &FolderLock,
        make: bool,
    ) -> Result<Option<Option<File>>, StoreError> {
        let path = self.lock_path(id);
        let file = match make {
            true => lock_file(&path).map_err(io_at("open", &path))?,
            false => match File::open(&path) {
                Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Some(None)),
                file => file.map_err(io_at("open", &path))?,
            },
        };
        let free = try_flock(&file).map_err(io_at("lock", &path))?;
        Ok(free.then_some(Some(file)))
    }

    fn take(&self, id: JobId, folder: &FolderLock) -> Result<JobLock, StoreError> {
        for _ in 0..TAKE_TRIES {
            if let Some(Some(file)) = self.try_lock(id, folder, true)? {
                return Ok(JobLock { _file: file });
            }
            std::thread::sleep(LOCK_PAUSE);
        }
        Err(StoreError::Busy(id))
    }

    fn hold(&self, id: JobId, folder: &FolderLock) -> Result<HeldJob, StoreError> {
        if !self.journal_path(id).exists() {
            return Err(StoreError::NoJob(id));
        }
        let lock = self.take(id, folder)?;
        let storage = FileStorage::new(self.journal_path(id));
        let (journal, cut) = Journal::open(storage).map_err(|source| StoreError::Journal { id, source })?;
        Ok(HeldJob { id, journal, cut, lock })
    }
}

/// The folder's lock.
struct FolderLock {
    _file: File,
}

/// Nothing of it was sent.
fn is_waiting(log: &Log) -> bool {
    log.state == State::Accepted && log.starts == 0
}

/// The same bytes of the same file for the same printer, whenever it was accepted.
fn same_job(one: &Accepted, other: &Accepted) -> bool {
    (&one.path, one.digest, one.bytes, &one.profile)
        == (&other.path, other.digest, other.bytes, &other.profile)
}

/// `12`, not `+12` or `012`: a job has one name.
fn number(text: &str) -> Option<JobId> {
    let plain = text.bytes().all(|b| b.is_ascii_digit()) && !text.starts_with('0');
    text.parse().ok().filter(|_| plain)
}

fn lock_file(path: &Path) -> io::Result<File> {
    // Never truncated, never written: only its lock says anything.
    let open = OpenOptions::new().read(true).write(true).create(true).truncate(false).mode(0o600).open(path);
    match open {
        // Whoever may only look needs no more than to read it.
        Err(e) if matches!(e.kind(), ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem) => {
            File::open(path).map_err(|_| e)
        }
        open => open,
    }
}

fn try_flock(file: &File) -> io::Result<bool> {
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(true),
        Err(rustix::io::Errno::WOULDBLOCK) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Temporary file, sync, rename, sync of the folder; gives the open file.
fn replace(path: &Path, temporary: &Path, bytes: &[u8]) -> io::Result<File> {
    let options = || {
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(true).mode(0o600);
        options
    };
    let mut file = options().open(temporary)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    std::fs::rename(temporary, path)?;
    sync_folder(path.parent().unwrap_or(Path::new(".")))?;
    Ok(file)
}

/// A journal's file.
#[derive(Debug)]
pub struct FileStorage {
    path: PathBuf,
    /// The file that was written last; opened when it is needed.
    file: Option<File>,
}

impl FileStorage {
    /// The file at `path`, which may not be there yet.
    pub fn new(path: PathBuf) -> Self {
        Self { path, file: None }
    }

    fn file(&mut self) -> io::Result<&File> {
        if self.file.is_none() {
            self.file = Some(OpenOptions::new().read(true).write(true).open(&self.path)?);
        }
        self.file.as_ref().ok_or_else(|| io::Error::other("no file"))
    }
}

impl Storage for FileStorage {
    fn read(&mut self, max: usize) -> io::Result<Option<Vec<u8>>> {
        let file = match File::open(&self.path) {
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            file => file?,
        };
        let mut bytes = Vec::new();
        file.take(max as u64 + 1).read_to_end(&mut bytes)?;
        match bytes.len() > max {
            true => Err(io::Error::other(format!("it has more than {max} bytes"))),
            false => Ok(Some(bytes)),
        }
    }

    fn write(&mut self, offset: u64, bytes: &[u8]) -> io::Result<()> {
        self.file()?.write_all_at(bytes, offset)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.file()?.sync_data()
    }

    fn replace(&mut self, bytes: &[u8]) -> io::Result<()> {
        // Whatever happens now, the file that is open may no longer be the one in place.
        self.file = None;
        self.file = Some(replace(&self.path, &self.path.with_extension("tmp"), bytes)?);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
