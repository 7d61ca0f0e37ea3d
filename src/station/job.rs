//! A file that was checked from its first line to its last and can be sent.
use super::marks::{Facts, Marks};
use super::settings;
use crate::job::digest::{Scan, Verified};
use crate::job::disk::{Store, stamp};
use crate::job::record::Accepted;
use crate::printer::job_file::{Checked, Reader, check};
use crate::printer::source::{JobLine, Source, SourceError};
use crate::profile::Profile;
use anyhow::{Context, bail};
use std::cell::RefCell;
use std::fs::{File, Metadata};
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::rc::Rc;
use std::time::{SystemTime, UNIX_EPOCH};

/// A file as large as this, which was accepted before and not written to since, is not
/// read twice: its sums are known. A smaller one takes no time, and is read for its
/// layers and times too.
const KNOWN_BYTES: u64 = 16 << 20;

/// A file that was checked and can be sent.
pub(crate) struct Job {
    file: File,
    /// What is written down of it.
    pub(crate) accepted: Accepted,
    pub(crate) checked: Checked,
    pub(crate) facts: Facts,
}

impl Job {
    /// Checks a file from its first line to its last. `profile_name` is what finds the
    /// profile again: a name, or an absolute path.
    ///
    /// # Errors
    /// It cannot be read, or not be printed by this printer; which line, and why. A resin
    /// printer prints no lines at all.
    pub(crate) fn open(
        path: &Path,
        profile: &Profile,
        profile_name: &str,
        store: Option<&Store>,
    ) -> anyhow::Result<Self> {
        Self::check(path, profile, profile_name, store).with_context(|| path.display().to_string())
    }

    fn check(path: &Path, profile: &Profile, name: &str, store: Option<&Store>) -> anyhow::Result<Self> {
        profile.want_fdm()?;
        let (file, meta) = regular(path)?;
        let path = std::fs::canonicalize(path)?;
        let stamp = stamp(&meta);
        if meta.len() >= KNOWN_BYTES
            && let Some(Ok(Some(known))) = store.map(|store| store.known(&path, stamp, name))
        {
            let accepted = Accepted { at_unix_s: now_unix_s(), ..known };
            let checked = accepted.checked();
            return Ok(Self { file, accepted, checked, facts: Facts::default() });
        }
        let mut facts = Facts::default();
        let mut scan = Scan::new(&file, meta.len())?;
        let checked = check(&mut scan, settings::max_line(profile), |_, line| facts.see(line))?;
        let sums = scan.finish()?;
        let accepted = Accepted {
            path,
            digest: sums.digest,
            bytes: sums.bytes,
            commands: checked.commands,
            last_line: checked.last_command,
            chunk_bytes: sums.chunk_bytes,
            chunks: sums.chunks,
            profile: name.to_owned(),
            at_unix_s: now_unix_s(),
            stamp,
        };
        Ok(Self { file, accepted, checked, facts })
    }

    /// The file of a job that was accepted before, if it is still the same.
    ///
    /// # Errors
    /// It is gone, or was changed.
    pub(crate) fn again(accepted: &Accepted) -> anyhow::Result<Self> {
        Self::same(accepted).with_context(|| accepted.path.display().to_string())
    }

    fn same(accepted: &Accepted) -> anyhow::Result<Self> {
        let (mut file, meta) = regular(&accepted.path)?;
        let changed = "the file was changed since the job was accepted: the rest of what is on the bed is \
                       no longer known";
        if meta.len() != accepted.bytes {
            bail!(changed);
        }
        // One that was not written to needs no reading: each chunk is verified before it is sent.
        if stamp(&meta) != accepted.stamp {
            let mut scan = Scan::new(&file, meta.len())?;
            std::io::copy(&mut scan, &mut std::io::sink())?;
            if scan.finish()?.digest != accepted.digest {
                bail!(changed);
            }
            file.seek(SeekFrom::Start(0))?;
        }
        Ok(Self { file, accepted: accepted.clone(), checked: accepted.checked(), facts: Facts::default() })
    }

    /// Its lines, verified chunk by chunk as they are read.
    ///
    /// # Errors
    /// The file cannot be read from its beginning.
    pub(crate) fn lines(&self, marks: Rc<RefCell<Marks>>) -> anyhow::Result<impl Source + use<>> {
        let mut file = self.file.try_clone()?;
        file.seek(SeekFrom::Start(0))?;
        let read_marks = Rc::clone(&marks);
        let verified = Verified::new(file, self.accepted.sums());
        let reader = Reader::new(verified, self.checked, move |number, line: &[u8]| {
            read_marks.borrow_mut().see(number, line);
        });
        Ok(Marked { reader, marks })
    }
}

/// A regular file, open. Asked before opening: to open a pipe would wait for its writer.
fn regular(path: &Path) -> anyhow::Result<(File, Metadata)> {
    let meta = std::fs::metadata(path)?;
    if meta.is_dir() {
        bail!("this is a directory: name a G-code file");
    }
    if !meta.is_file() {
        bail!("this is no regular file: it is read twice, so save it as one first");
    }
    let file = File::open(path)?;
    let meta = file.metadata()?;
    Ok((file, meta))
}

/// Lines that know their layer.
struct Marked<R, F> {
    reader: Reader<R, F>,
    marks: Rc<RefCell<Marks>>,
}

impl<R: Read, F: FnMut(u64, &[u8])> Source for Marked<R, F> {
    fn advance(&mut self) -> Result<bool, SourceError> {
        self.reader.advance()
    }

    fn line(&self) -> JobLine<'_> {
        self.reader.line()
    }

    fn layer(&self) -> u32 {
        self.marks.borrow().read
    }
}

/// Seconds since 1970; 0 where the clock says that it is earlier.
pub(crate) fn now_unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}
