//! A file that was checked from its first line to its last and can be sent.
use super::marks::Facts;
use super::settings;
use crate::printer::job_file::{Checked, check};
use crate::profile::Profile;
use anyhow::{Context, bail};
use std::fs::{File, Metadata};
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// A file that was checked and can be sent.
pub(in crate::cli) struct Job {
    pub(super) path: PathBuf,
    pub(super) file: File,
    stamp: Stamp,
    pub(super) checked: Checked,
    pub(super) facts: Facts,
}

/// What tells a file that was written to since.
#[derive(PartialEq)]
struct Stamp {
    bytes: u64,
    modified: Option<std::time::SystemTime>,
}

impl Stamp {
    fn of(meta: &Metadata) -> Self {
        Self { bytes: meta.len(), modified: meta.modified().ok() }
    }
}

impl Job {
    /// Checks a file from its first line to its last.
    ///
    /// # Errors
    /// It cannot be read, or not be printed by this printer; which line, and why.
    pub(in crate::cli) fn open(path: &Path, profile: &Profile) -> anyhow::Result<Self> {
        Self::check(path, settings::max_line(profile)).with_context(|| path.display().to_string())
    }

    fn check(path: &Path, max_line: Option<usize>) -> anyhow::Result<Self> {
        // Asked before opening: to open a pipe would wait for its writer.
        let meta = std::fs::metadata(path)?;
        if meta.is_dir() {
            bail!("this is a directory: name a G-code file");
        }
        if !meta.is_file() {
            bail!("this is no regular file: it is read twice, so save it as one first");
        }
        let file = File::open(path)?;
        let stamp = Stamp::of(&file.metadata()?);
        let mut facts = Facts::default();
        let checked = check(&file, max_line, |_, line| facts.see(line))?;
        Ok(Self { path: path.to_owned(), file, stamp, checked, facts })
    }

    /// From the first line again, if the file is still the one that was checked.
    pub(super) fn rewind(&mut self) -> anyhow::Result<()> {
        self.rewound().with_context(|| self.path.display().to_string())
    }

    fn rewound(&mut self) -> anyhow::Result<()> {
        if Stamp::of(&self.file.metadata()?) != self.stamp {
            bail!("the file was changed while it was checked: start again when it is finished");
        }
        self.file.seek(SeekFrom::Start(0))?;
        Ok(())
    }
}
