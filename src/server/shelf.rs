//! The data folder: uploaded files, what was found in them, and the jobs that wait.
//!
//! Takes objects and bytes, gives them back after a restart. Files have names of our own
//! ([`new_id`]); nothing that a client says becomes part of a path. Everything is written whole
//! or not at all: temporary file, sync, rename, sync of the folder. Knows no queue and no network.
//!
//! ```text
//! files/F…/content          the bytes            queue/J…/job.json     a job
//! files/F…/file.json        what is known        queue/J…/mended       with supports, and its pictures
//! files/F…/PRINTER.*        check, picture, reordered
//! incoming/                 uploads on their way; emptied at the start
//! auth.json                 users and keys, for this user's eyes only
//! ```
use super::model::{File, Job};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Files and jobs that are read at the start, each: as many as a folder of a host in daily use
/// gets in years, and few enough for a Pi.
pub(crate) const MAX_KEPT: usize = 10_000;

/// Largest description of a file or a job, bytes.
const MAX_JSON_BYTES: u64 = 1 << 20;

/// The data folder could not be used.
#[derive(Debug, thiserror::Error)]
#[error("cannot {what} {}: {source}", path.display())]
pub(crate) struct ShelfError {
    what: &'static str,
    path: PathBuf,
    /// What the system said.
    pub(crate) source: io::Error,
}

impl ShelfError {
    /// The medium is full.
    pub(crate) fn is_full(&self) -> bool {
        matches!(self.source.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
    }
}

fn at<'a>(what: &'static str, path: &'a Path) -> impl FnOnce(io::Error) -> ShelfError + 'a {
    move |source| ShelfError { what, path: path.to_owned(), source }
}

/// A name that nobody chooses: a letter and 24 hexadecimal digits, of which the first half is the
/// time in ms, so that names sort as things came, and the rest is random.
///
/// # Errors
/// The system has no randomness.
pub(crate) fn new_id(letter: char) -> io::Result<String> {
    let ms = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_millis() as u64);
    Ok(format!("{letter}{:012x}{}", ms & 0xffff_ffff_ffff, random_hex()?))
}

/// Twelve random hexadecimal digits.
///
/// # Errors
/// The system has no randomness.
pub(crate) fn random_hex() -> io::Result<String> {
    let mut bytes = [0_u8; 6];
    getrandom::fill(&mut bytes).map_err(|e| io::Error::other(e.to_string()))?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Whether a text is a name of [`new_id`]: the only ones that become part of a path.
pub(crate) fn is_id(text: &str, letter: char) -> bool {
    let mut chars = text.chars();
    chars.next() == Some(letter)
        && text.len() == 25
        && chars.all(|c| c.is_ascii_digit() || ('a'..='f').contains(&c))
}

/// The data folder.
#[derive(Clone, Debug)]
pub(crate) struct Shelf {
    folder: PathBuf,
}

/// What a folder held.
#[derive(Debug, Default)]
pub(crate) struct Found {
    pub(crate) files: Vec<File>,
    pub(crate) jobs: Vec<Job>,
    /// What could not be read, for the log.
    pub(crate) amiss: Vec<String>,
}

impl Shelf {
    /// Opens or makes the folder, for nobody else's eyes. Uploads that were not finished go.
    ///
    /// # Errors
    /// It cannot be made or written to.
    pub(crate) fn open(folder: &Path) -> Result<Self, ShelfError> {
        let shelf = Self { folder: folder.to_owned() };
        let incoming = shelf.incoming();
        if incoming.is_dir() {
            fs::remove_dir_all(&incoming).map_err(at("empty", &incoming))?;
        }
        for folder in [shelf.files(), shelf.queue(), incoming] {
            fs::DirBuilder::new().recursive(true).mode(0o700).create(&folder).map_err(at("make", &folder))?;
        }
        Ok(shelf)
    }

    /// The folder as it is, for who only wants to know where things are.
    pub(crate) fn beside(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    fn files(&self) -> PathBuf {
        self.folder.join("files")
    }

    fn queue(&self) -> PathBuf {
        self.folder.join("queue")
    }

    fn incoming(&self) -> PathBuf {
        self.folder.join("incoming")
    }

    /// A file's folder; its name is one of ours ([`is_id`]).
    fn file(&self, id: &str) -> PathBuf {
        debug_assert!(is_id(id, 'F'), "{id}");
        self.files().join(id)
    }

    /// Where a file's bytes are.
    pub(crate) fn content(&self, id: &str) -> PathBuf {
        self.file(id).join("content")
    }

    /// Something that was made of a file for a printer: `check.json`, `layers.html`,
    /// `reordered`. Printers' names are the configuration's: letters, digits, - and _.
    pub(crate) fn made(&self, id: &str, printer: &str, what: &str) -> PathBuf {
        self.file(id).join(format!("{printer}.{what}"))
    }

    /// Something that was made of a job: `mended`, `supports.html`, `paths.svg`.
    pub(crate) fn of_job(&self, id: &str, what: &str) -> PathBuf {
        debug_assert!(is_id(id, 'J'), "{id}");
        self.queue().join(id).join(what)
    }

    /// Where users and keys are.
    pub(crate) fn auth(&self) -> PathBuf {
        self.folder.join("auth.json")
    }

    /// What is there.
    pub(crate) fn read(&self) -> Found {
        let mut found = Found::default();
        for (id, path) in entries(&self.files(), 'F') {
            match read_json::<File>(&path.join("file.json")) {
                Ok(Some(file)) if file.id == id => found.files.push(file),
                // An upload that was cut off between its folder and its description.
                Ok(None) => drop(fs::remove_dir_all(&path)),
                Ok(Some(_)) => found.amiss.push(format!("{}: not its own description", path.display())),
                Err(why) => found.amiss.push(why.to_string()),
            }
        }
        for (id, path) in entries(&self.queue(), 'J') {
            match read_json::<Job>(&path.join("job.json")) {
                Ok(Some(job)) if job.id == id => found.jobs.push(job),
                Ok(None) => drop(fs::remove_dir_all(&path)),
                Ok(Some(_)) => found.amiss.push(format!("{}: not its own description", path.display())),
                Err(why) => found.amiss.push(why.to_string()),
            }
        }
        found.files.sort_by(|a, b| (a.uploaded_unix_s, &a.id).cmp(&(b.uploaded_unix_s, &b.id)));
        found.jobs.sort_by(|a, b| (a.created_unix_s, &a.id).cmp(&(b.created_unix_s, &b.id)));
        found
    }

    /// A place for an upload, in the same file system.
    ///
    /// # Errors
    /// None can be made.
    pub(crate) fn upload(&self) -> Result<tempfile::NamedTempFile, ShelfError> {
        let folder = self.incoming();
        tempfile::Builder::new().prefix("upload-").tempfile_in(&folder).map_err(at("write in", &folder))
    }

    /// Makes an upload a file, on the medium once this returns.
    ///
    /// # Errors
    /// The medium's; there is no such file then.
    pub(crate) fn keep(&self, upload: tempfile::NamedTempFile, file: &File) -> Result<(), ShelfError> {
        let folder = self.file(&file.id);
        let kept = self.keep_in(&folder, upload, file);
        if kept.is_err() {
            let _ = fs::remove_dir_all(&folder);
        }
        kept
    }

    fn keep_in(&self, folder: &Path, upload: tempfile::NamedTempFile, file: &File) -> Result<(), ShelfError> {
        fs::DirBuilder::new().mode(0o700).create(folder).map_err(at("make", folder))?;
        let content = folder.join("content");
        upload.as_file().sync_all().map_err(at("write", &content))?;
        upload.persist(&content).map_err(|e| at("write", &content)(e.error))?;
        // The description last: a folder without it is no file.
        self.write_file(file)?;
        sync_folder(&self.files())
    }

    /// Writes a file's description.
    ///
    /// # Errors
    /// The medium's; what was there before is still there.
    pub(crate) fn write_file(&self, file: &File) -> Result<(), ShelfError> {
        write_json(&self.file(&file.id).join("file.json"), file)
    }

    /// Writes a job's description, on the medium once this returns.
    ///
    /// # Errors
    /// The medium's; what was there before is still there.
    pub(crate) fn write_job(&self, job: &Job) -> Result<(), ShelfError> {
        let folder = self.queue().join(&job.id);
        let is_new = !folder.is_dir();
        if is_new {
            fs::DirBuilder::new().mode(0o700).create(&folder).map_err(at("make", &folder))?;
        }
        let written = write_json(&folder.join("job.json"), job);
        if is_new && written.is_ok() {
            return sync_folder(&self.queue());
        }
        if is_new {
            // What was not accepted leaves nothing.
            let _ = fs::remove_dir_all(&folder);
        }
        written
    }

    /// Removes a file and all that was made of it.
    ///
    /// # Errors
    /// The medium's.
    pub(crate) fn remove_file(&self, id: &str) -> Result<(), ShelfError> {
        let folder = self.file(id);
        // Without its description it is none, whatever comes next.
        let _ = fs::remove_file(folder.join("file.json"));
        fs::remove_dir_all(&folder).map_err(at("remove", &folder))
    }

    /// Removes a job and all that was made of it.
    ///
    /// # Errors
    /// The medium's.
    pub(crate) fn remove_job(&self, id: &str) -> Result<(), ShelfError> {
        let folder = self.queue().join(id);
        let _ = fs::remove_file(folder.join("job.json"));
        fs::remove_dir_all(&folder).map_err(at("remove", &folder))
    }

    /// A name of this daemon that stays the same, for who looks for it in the network.
    pub(crate) fn uuid(&self) -> String {
        let path = self.folder.join("uuid");
        if let Ok(text) = fs::read_to_string(&path)
            && text.trim().len() == 36
        {
            return text.trim().to_owned();
        }
        let random = || random_hex().unwrap_or_else(|_| "0".repeat(12));
        let digits = random() + &random() + &random();
        // Version 4, variant 1, as RFC 9562 has it.
        let uuid = format!(
            "{}-{}-4{}-8{}-{}",
            &digits[..8],
            &digits[8..12],
            &digits[13..16],
            &digits[17..20],
            &digits[20..32]
        );
        let _ = fs::write(&path, &uuid);
        uuid
    }

    /// Bytes that are free to us where the folder is.
    ///
    /// # Errors
    /// The system does not tell.
    pub(crate) fn free_bytes(&self) -> Result<u64, ShelfError> {
        let told = rustix::fs::statvfs(&self.folder).map_err(|e| at("look at", &self.folder)(e.into()))?;
        Ok(told.f_bavail.saturating_mul(told.f_frsize))
    }
}

fn entries(folder: &Path, letter: char) -> Vec<(String, PathBuf)> {
    let Ok(all) = fs::read_dir(folder) else { return Vec::new() };
    all.flatten()
        .filter_map(|entry| Some((entry.file_name().into_string().ok()?, entry.path())))
        .filter(|(name, _)| is_id(name, letter))
        .take(MAX_KEPT)
        .collect()
}

fn read_json<T: DeserializeOwned>(path: &Path) -> Result<Option<T>, ShelfError> {
    let Some(text) = read_text(path)? else { return Ok(None) };
    serde_json::from_str(&text).map(Some).map_err(|e| at("read", path)(io::Error::other(e)))
}

/// Reads a small text; `None`: there is none.
///
/// # Errors
/// It cannot be read.
pub(crate) fn read_text(path: &Path) -> Result<Option<String>, ShelfError> {
    let file = match fs::File::open(path) {
        Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
        file => file.map_err(at("read", path))?,
    };
    let mut text = String::new();
    file.take(MAX_JSON_BYTES).read_to_string(&mut text).map_err(at("read", path))?;
    Ok(Some(text))
}

fn write_json(path: &Path, value: &impl Serialize) -> Result<(), ShelfError> {
    let text = serde_json::to_string_pretty(value).map_err(|e| at("write", path)(io::Error::other(e)))?;
    write_text(path, &text)
}

/// Writes a small text whole, for this user's eyes only.
///
/// # Errors
/// The medium's; what was there before is still there.
pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), ShelfError> {
    let temporary = path.with_extension("tmp");
    let write = || -> io::Result<()> {
        let mut options = fs::OpenOptions::new();
        options.write(true).create(true).truncate(true).mode(0o600);
        let mut file = options.open(&temporary)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    };
    let written = write().map_err(at("write", path));
    if written.is_err() {
        let _ = fs::remove_file(&temporary);
    }
    written?;
    sync_folder(path.parent().unwrap_or(Path::new(".")))
}

fn sync_folder(folder: &Path) -> Result<(), ShelfError> {
    fs::File::open(folder).and_then(|f| f.sync_all()).map_err(at("sync", folder))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(id: &str) -> File {
        File { id: id.to_owned(), name: "../../etc/passwd".to_owned(), bytes: 3, ..File::default() }
    }

    #[test]
    fn what_was_kept_is_there_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(folder.path()).unwrap();
        let file = file(&new_id('F').unwrap());
        let mut upload = shelf.upload().unwrap();
        upload.write_all(b"G28").unwrap();
        shelf.keep(upload, &file).unwrap();
        let job = Job { id: new_id('J').unwrap(), file: file.id.clone(), ..Job::default() };
        shelf.write_job(&job).unwrap();
        let unfinished = shelf.upload().unwrap().keep().unwrap().1;
        let found = Shelf::open(folder.path()).unwrap().read();
        assert_eq!((found.files, found.jobs), (vec![file.clone()], vec![job]));
        assert!(found.amiss.is_empty());
        assert!(!unfinished.exists());
        assert_eq!(fs::read(shelf.content(&file.id)).unwrap(), b"G28");
    }

    #[test]
    fn a_folder_without_a_description_is_no_file() {
        let folder = tempfile::tempdir().unwrap();
        let shelf = Shelf::open(folder.path()).unwrap();
        let id = new_id('F').unwrap();
        fs::create_dir(folder.path().join("files").join(&id)).unwrap();
        assert!(shelf.read().files.is_empty());
        assert!(!folder.path().join("files").join(&id).exists());
        // A damaged one is told and left alone.
        let id = new_id('F').unwrap();
        let path = folder.path().join("files").join(&id);
        fs::create_dir(&path).unwrap();
        fs::write(path.join("file.json"), "{").unwrap();
        assert_eq!(shelf.read().amiss.len(), 1);
        assert!(path.exists());
    }

    #[test]
    fn only_our_own_names_are_names() {
        let check = |text: &str, expect| assert_eq!(is_id(text, 'F'), expect, "{text}");
        check(&new_id('F').unwrap(), true);
        check(&new_id('J').unwrap(), false);
        check("F0123456789abcdef01234567", true);
        check("F0123456789ABCDEF01234567", false);
        check("F../../../../../../../etc", false);
        check("F0123456789abcdef0123456é", false);
        check("", false);
    }
}
