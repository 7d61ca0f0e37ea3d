//! Files as the verbs need them: opened for sure, replaced whole or not at all.
use anyhow::Context;
use std::fs::{File, Metadata};
use std::io::{Seek, SeekFrom, Write};
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use tempfile::NamedTempFile;

/// Temporary files to remove when the user interrupts.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the temporary files of whatever is unfinished.
pub(super) fn remove_unfinished() {
    if let Ok(mut paths) = UNFINISHED.lock() {
        for path in paths.drain(..) {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// The file behind a path, links followed, so that a link stays a link when its file is replaced.
///
/// # Errors
/// There is no such file.
pub(super) fn resolve(path: &Path) -> anyhow::Result<PathBuf> {
    path.canonicalize().with_context(|| format!("cannot open {}", path.display()))
}

/// Opens a regular file.
///
/// # Errors
/// It cannot be read, or is a directory or a device.
pub(super) fn open_regular(path: &Path) -> anyhow::Result<File> {
    let meta = path.metadata().with_context(|| format!("cannot open {}", path.display()))?;
    anyhow::ensure!(meta.is_file(), "{} is no regular file; name a sliced job", path.display());
    File::open(path).with_context(|| format!("cannot open {}", path.display()))
}

/// What people know the file by: the slicer's temporary name says nothing, the
/// one that it will have is in the environment.
pub(super) fn display_name(path: &Path) -> String {
    match std::env::var_os("SLIC3R_PP_OUTPUT_NAME") {
        Some(name) if !name.is_empty() => name.to_string_lossy().into_owned(),
        _ => path.display().to_string(),
    }
}

/// Writes a whole text to a file; "-" is standard output. `what` names it for people.
///
/// # Errors
/// The file cannot be written.
pub(super) fn write_text(text: &str, to: &Path, what: &str) -> anyhow::Result<()> {
    if to == Path::new("-") {
        super::say(text.trim_end());
        return Ok(());
    }
    std::fs::write(to, text).with_context(|| format!("cannot write the {what} {}", to.display()))
}

/// Writes a whole file: the old one stays until the new one is complete. `what` names
/// it for people.
///
/// # Errors
/// The file cannot be written; the old one, if any, is as it was.
pub(super) fn write_whole(bytes: &[u8], to: &Path, what: &str) -> anyhow::Result<()> {
    let failed = || format!("cannot write the {what} {}", to.display());
    // A device or a pipe is written to; a link's target is replaced, not the link.
    let known = to.canonicalize().ok();
    let target = known.as_deref().unwrap_or(to);
    if target.metadata().is_ok_and(|meta| !meta.is_file()) {
        return std::fs::write(target, bytes).with_context(failed);
    }
    let old = target.metadata().ok();
    // As for any new file: the process's mask takes from it.
    let mode = old.as_ref().map_or(0o666, |_| 0o600);
    let mut replacement = Replacement::with_mode(target, mode).with_context(failed)?;
    replacement.file().write_all(bytes).with_context(failed)?;
    replacement.put_new(old.as_ref()).with_context(failed)
}

/// A file as it was when it was opened.
pub(super) struct Seen {
    device: u64,
    inode: u64,
    modified: (i64, i64),
    /// Bytes.
    pub(super) length: u64,
}

impl Seen {
    /// # Errors
    /// The file's metadata cannot be read.
    pub(super) fn of(file: &File) -> anyhow::Result<Seen> {
        Ok(Seen::from(&file.metadata().context("cannot read the file's metadata")?))
    }

    fn from(meta: &Metadata) -> Seen {
        Seen {
            device: meta.dev(),
            inode: meta.ino(),
            modified: (meta.mtime(), meta.mtime_nsec()),
            length: meta.len(),
        }
    }

    /// Whether the path still names that file, and nobody has written to it.
    pub(super) fn still_holds(&self, file: &File, path: &Path) -> bool {
        let same = |meta: std::io::Result<Metadata>| {
            meta.is_ok_and(|m| {
                let now = Seen::from(&m);
                (now.device, now.inode, now.modified, now.length)
                    == (self.device, self.inode, self.modified, self.length)
            })
        };
        same(file.metadata()) && same(path.metadata())
    }
}

fn folder(target: &Path) -> &Path {
    target.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file beside `target` that has no name and is gone with its handle.
///
/// # Errors
/// The folder cannot be written to.
pub(super) fn unnamed_beside(target: &Path) -> anyhow::Result<File> {
    let folder = folder(target);
    tempfile::tempfile_in(folder).with_context(|| format!("cannot write in {}", folder.display()))
}

/// A temporary file beside the one that it will replace.
pub(super) struct Replacement {
    temporary: NamedTempFile,
    target: PathBuf,
}

impl Drop for Replacement {
    fn drop(&mut self) {
        if let Ok(mut paths) = UNFINISHED.lock() {
            paths.retain(|p| p != self.temporary.path());
        }
    }
}

impl Replacement {
    /// # Errors
    /// The folder cannot be written to.
    pub(super) fn beside(target: &Path) -> anyhow::Result<Replacement> {
        // Nobody else's to read before it has the mode of what it replaces.
        Replacement::with_mode(target, 0o600)
    }

    fn with_mode(target: &Path, mode: u32) -> anyhow::Result<Replacement> {
        let folder = folder(target);
        let temporary = tempfile::Builder::new()
            .prefix(".outrigger-")
            .permissions(std::fs::Permissions::from_mode(mode))
            .tempfile_in(folder)
            .with_context(|| format!("cannot write in {}", folder.display()))?;
        if let Ok(mut paths) = UNFINISHED.lock() {
            paths.push(temporary.path().to_owned());
        }
        Ok(Replacement { temporary, target: target.to_owned() })
    }

    /// The file to write to.
    pub(super) fn file(&mut self) -> &mut File {
        self.temporary.as_file_mut()
    }

    /// Makes it a copy of another file.
    ///
    /// # Errors
    /// Reading or writing fails.
    pub(super) fn copy_of(mut self, source: &mut File) -> anyhow::Result<Replacement> {
        let file = self.temporary.as_file_mut();
        file.set_len(0).and_then(|()| file.seek(SeekFrom::Start(0))).context("cannot write")?;
        source.seek(SeekFrom::Start(0)).context("cannot read")?;
        std::io::copy(source, file)
            .with_context(|| format!("cannot write beside {}", self.target.display()))?;
        Ok(self)
    }

    /// Puts it in the target's place, with the mode and owner of `like`: written
    /// through to the disk first, so that a power cut leaves the old file or the new.
    ///
    /// # Errors
    /// The file stays as it was.
    pub(super) fn put(self, like: &File) -> anyhow::Result<()> {
        let meta = like.metadata().context("cannot read the file's metadata")?;
        let file = self.temporary.as_file();
        file.set_permissions(std::fs::Permissions::from_mode(meta.mode() & 0o7777))
            .context("cannot keep the file's mode")?;
        let own = file.metadata().context("cannot read the file's metadata")?;
        if (own.uid(), own.gid()) != (meta.uid(), meta.gid()) {
            std::os::unix::fs::fchown(file, Some(meta.uid()), Some(meta.gid()))
                .context("cannot keep the file's owner")?;
        }
        self.rename()
    }

    /// Puts it in the target's place, with the mode of the old file if there is one.
    fn put_new(self, old: Option<&Metadata>) -> anyhow::Result<()> {
        if let Some(old) = old {
            let mode = std::fs::Permissions::from_mode(old.mode() & 0o7777);
            self.temporary.as_file().set_permissions(mode).context("cannot keep the file's mode")?;
        }
        self.rename()
    }

    fn rename(self) -> anyhow::Result<()> {
        let file = self.temporary.as_file();
        file.sync_all().with_context(|| format!("cannot write beside {}", self.target.display()))?;
        std::fs::rename(self.temporary.path(), &self.target)
            .with_context(|| format!("cannot replace {}", self.target.display()))?;
        if let Some(folder) = self.target.parent().filter(|f| !f.as_os_str().is_empty()) {
            // The rename itself may be lost in a power cut without this; either file is whole.
            let _ = File::open(folder).and_then(|f| f.sync_all());
        }
        Ok(())
    }
}
