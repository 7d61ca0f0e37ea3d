//! A file that was checked from its first line to its last and can be sent.
use super::marks::{Facts, Marks};
use super::plate::{Exposures, Plate};
use super::resin::{Told, look, told};
use super::screen::Screen;
use super::settings;
use super::watchdog::LightWatch;
use crate::job::digest::{Scan, Sums, Verified};
use crate::job::disk::{Store, stamp};
use crate::job::record::Accepted;
use crate::printer::job_file::{Checked, Reader, check};
use crate::printer::lcd::Sink;
use crate::printer::source::{Back, JobLine, May, News, Source, SourceError};
use crate::profile::Profile;
use crate::resin;
use anyhow::{Context, bail};
use std::cell::RefCell;
use std::fs::{File, Metadata};
use std::io::{Read, Seek, SeekFrom};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

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
    /// What is made of it, where it is no G-code.
    resin: Option<Told>,
}

/// Who shows the pictures of a resin job.
pub(crate) struct Display {
    /// Where they go.
    pub(crate) sink: Box<dyn Sink>,
    /// Who switches the light off when we are dead.
    pub(crate) watch: LightWatch,
    /// Called whenever one is ready or shown, from another thread.
    pub(crate) wake: Box<dyn Fn() + Send>,
    /// How many times faster than life the printer is: 1 but for a mock.
    pub(crate) speed: f64,
    /// Where it is told how the exposures went.
    pub(crate) measured: Rc<RefCell<Exposures>>,
}

impl Job {
    /// Checks a file from its first line, or picture, to its last. `profile_name` is what finds the
    /// profile again: a name, or an absolute path; `watch` hears how many pictures of how many
    /// are looked at.
    ///
    /// # Errors
    /// It cannot be read, or not be printed by this printer; which line or layer, and why.
    pub(crate) fn open(
        path: &Path,
        profile: &Profile,
        profile_name: &str,
        store: Option<&Store>,
        watch: impl FnMut(u32, u32),
    ) -> anyhow::Result<Self> {
        let opened = match profile.msla() {
            None => Self::check(path, profile, profile_name, store),
            Some(_) => Self::look(path, profile, profile_name, watch),
        };
        opened.with_context(|| path.display().to_string())
    }

    fn check(path: &Path, profile: &Profile, name: &str, store: Option<&Store>) -> anyhow::Result<Self> {
        let (file, meta) = regular(path)?;
        if is_resin(&file)? {
            bail!(
                "this is a resin job, and {} prints filament: name the profile of a resin printer (kind \
                 msla; `outrigger profile list` shows them)",
                profile.name
            );
        }
        let path = std::fs::canonicalize(path)?;
        let stamp = stamp(&meta);
        if meta.len() >= KNOWN_BYTES
            && let Some(Ok(Some(known))) = store.map(|store| store.known(&path, stamp, name))
        {
            let accepted = Accepted { at_unix_s: now_unix_s(), ..known };
            let checked = accepted.checked();
            return Ok(Self { file, accepted, checked, facts: Facts::default(), resin: None });
        }
        let mut facts = Facts::default();
        let mut scan = Scan::new(&file, meta.len())?;
        let checked = check(&mut scan, settings::max_line(profile), |_, line| facts.see(line))?;
        let sums = scan.finish()?;
        let accepted = accepted(path, sums, checked, name, stamp);
        Ok(Self { file, accepted, checked, facts, resin: None })
    }

    /// The same of a resin job.
    fn look(
        path: &Path,
        profile: &Profile,
        name: &str,
        mut watch: impl FnMut(u32, u32),
    ) -> anyhow::Result<Self> {
        let (file, meta) = regular(path)?;
        if !is_resin(&file)? {
            bail!(
                "{} is a resin printer: its jobs are pictures (SL1, NanoDLP, GOO), and this is none",
                profile.name
            );
        }
        let path = std::fs::canonicalize(path)?;
        let mut scan = Scan::new(&file, meta.len())?;
        std::io::copy(&mut scan, &mut std::io::sink())?;
        let sums = scan.finish()?;
        // From here on no byte is read but those that were summed up.
        let mut pictures = resin::open(Verified::new(Own::new(&file)?, sums.clone()))?;
        let told = told(&pictures, profile)?;
        let layers = told.script.layers();
        look(&mut pictures, |done| watch(done, layers))?;
        let checked = checked(&told);
        let accepted = accepted(path, sums, checked, name, stamp(&meta));
        let facts = facts(&told);
        Ok(Self { file, accepted, checked, facts, resin: Some(told) })
    }

    /// The file of a job that was accepted before, if it is still the same.
    ///
    /// # Errors
    /// It is gone, or was changed.
    pub(crate) fn again(accepted: &Accepted, profile: &Profile) -> anyhow::Result<Self> {
        Self::same(accepted, profile).with_context(|| accepted.path.display().to_string())
    }

    fn same(accepted: &Accepted, profile: &Profile) -> anyhow::Result<Self> {
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
        let mut job = Self {
            file,
            accepted: accepted.clone(),
            checked: accepted.checked(),
            facts: Facts::default(),
            resin: None,
        };
        if profile.msla().is_some() {
            let told = told(&resin::open(job.verified()?)?, profile)?;
            if checked(&told).commands != accepted.commands {
                bail!(
                    "the printer's profile was changed since, and what was written down of the job no longer fits"
                );
            }
            (job.facts, job.resin) = (facts(&told), Some(told));
        }
        Ok(job)
    }

    fn verified(&self) -> std::io::Result<Verified<Own>> {
        Ok(Verified::new(Own::new(&self.file)?, self.accepted.sums()))
    }

    /// Whether it is a resin job: somebody must show its pictures.
    pub(crate) fn is_resin(&self) -> bool {
        self.resin.is_some()
    }

    /// How long the longest layer of a resin job takes; nothing of other jobs, which may be paused anywhere.
    pub(crate) fn longest_layer(&self) -> Duration {
        let begins_s = self.resin.as_ref().map_or(&[][..], |told| &told.begins_s);
        let longest_s = begins_s.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f32::max);
        Duration::try_from_secs_f32(longest_s).unwrap_or_default()
    }

    /// Its lines, verified chunk by chunk as they are read. Without a display those of a resin job
    /// only tell where they lead.
    ///
    /// # Errors
    /// The file cannot be read from its beginning.
    pub(crate) fn lines(&self, marks: Rc<RefCell<Marks>>, display: Option<Display>) -> anyhow::Result<Lines> {
        if let Some(told) = &self.resin {
            let (speed, measured, watch) = match &display {
                Some(display) => (display.speed, Rc::clone(&display.measured), display.watch.clone()),
                None => (1.0, Rc::default(), LightWatch::default()),
            };
            let screen = match display {
                Some(display) => {
                    Some(Screen::start(resin::open(self.verified()?)?, display.sink, display.wake)?)
                }
                None => None,
            };
            let begins_s = told.begins_s.as_slice().into();
            let plate = Plate::new(told.script.clone(), screen, watch, speed, measured, marks, begins_s);
            return Ok(Lines::Plate(Box::new(plate)));
        }
        let read_marks = Rc::clone(&marks);
        let see: See = Box::new(move |number, line: &[u8]| read_marks.borrow_mut().see(number, line));
        let reader = Reader::new(self.verified()?, self.checked, see);
        Ok(Lines::File(Box::new(Marked { reader, marks })))
    }
}

fn accepted(path: PathBuf, sums: Sums, checked: Checked, name: &str, stamp: u64) -> Accepted {
    Accepted {
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
    }
}

/// The lines of a resin job are counted as a file's are.
fn checked(told: &Told) -> Checked {
    let lines = told.script.len();
    Checked { lines, commands: lines, last_command: lines, shortened: 0, bytes: 0 }
}

fn facts(told: &Told) -> Facts {
    let total_s = told.begins_s.last().map(|s| f64::from(*s));
    Facts::of(u64::from(told.script.layers()), total_s)
}

/// Whether a file begins as a resin job does; it then stands at its beginning.
fn is_resin(file: &File) -> std::io::Result<bool> {
    let (mut file, mut begins) = (file, Vec::new());
    file.take(resin::goo::MARK_BYTES as u64).read_to_end(&mut begins)?;
    file.seek(SeekFrom::Start(0))?;
    Ok(resin::may_be_job(&begins))
}

/// A regular file, open. Asked before opening: to open a pipe would wait for its writer.
fn regular(path: &Path) -> anyhow::Result<(File, Metadata)> {
    let meta = std::fs::metadata(path)?;
    if meta.is_dir() {
        bail!("this is a directory: name a sliced file");
    }
    if !meta.is_file() {
        bail!("this is no regular file: it is read twice, so save it as one first");
    }
    let file = File::open(path)?;
    let meta = file.metadata()?;
    Ok((file, meta))
}

type See = Box<dyn FnMut(u64, &[u8])>;

/// A job's lines.
pub(crate) enum Lines {
    /// Those of a file.
    File(Box<Marked>),
    /// Those of a resin job.
    Plate(Box<Plate>),
}

/// A file that is read from its beginning, wherever others who have it open stand.
#[derive(Debug)]
pub(crate) struct Own {
    file: File,
    at: u64,
}

impl Own {
    fn new(file: &File) -> std::io::Result<Self> {
        Ok(Self { file: file.try_clone()?, at: 0 })
    }
}

impl Read for Own {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let len = self.file.read_at(buffer, self.at)?;
        self.at += len as u64;
        Ok(len)
    }
}

impl Seek for Own {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.file.metadata()?.len().checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.ok_or_else(|| std::io::Error::from(std::io::ErrorKind::InvalidInput))?;
        Ok(self.at)
    }
}

/// Lines that know their layer.
pub(crate) struct Marked {
    reader: Reader<Verified<Own>, See>,
    marks: Rc<RefCell<Marks>>,
}

impl Source for Lines {
    fn advance(&mut self) -> Result<bool, SourceError> {
        match self {
            Lines::File(file) => file.reader.advance(),
            Lines::Plate(plate) => plate.advance(),
        }
    }

    fn line(&self) -> JobLine<'_> {
        match self {
            Lines::File(file) => file.reader.line(),
            Lines::Plate(plate) => plate.line(),
        }
    }

    fn layer(&self) -> u32 {
        match self {
            Lines::File(file) => file.marks.borrow().read,
            Lines::Plate(plate) => plate.layer(),
        }
    }

    fn begin(&mut self) {
        if let Lines::Plate(plate) = self {
            plate.begin();
        }
    }

    fn may(&mut self, now_ms: u64) -> May {
        match self {
            Lines::File(_) => May::Go,
            Lines::Plate(plate) => plate.may(now_ms),
        }
    }

    fn may_hold(&self) -> bool {
        match self {
            Lines::File(_) => true,
            Lines::Plate(plate) => plate.may_hold(),
        }
    }

    fn hear(&mut self, news: News<'_>, now_ms: u64) {
        if let Lines::Plate(plate) = self {
            plate.hear(news, now_ms);
        }
    }

    fn take_note(&mut self) -> bool {
        match self {
            Lines::File(_) => false,
            Lines::Plate(plate) => plate.take_note(),
        }
    }

    fn take_question(&mut self, now_ms: u64) -> bool {
        match self {
            Lines::Plate(plate) => plate.take_question(now_ms),
            _ => false,
        }
    }

    fn due_ms(&self) -> Option<u64> {
        match self {
            Lines::File(_) => None,
            Lines::Plate(plate) => plate.due_ms(),
        }
    }

    fn go_back(&mut self, commands: u64) -> Option<Back> {
        match self {
            Lines::File(_) => None,
            Lines::Plate(plate) => plate.go_back(commands),
        }
    }

    fn is_torn(&self) -> bool {
        match self {
            Lines::File(_) => false,
            Lines::Plate(plate) => plate.is_torn(),
        }
    }

    fn is_unmoved(&self) -> bool {
        match self {
            Lines::File(_) => false,
            Lines::Plate(plate) => plate.is_unmoved(),
        }
    }
}

/// Seconds since 1970; 0 where the clock says that it is earlier.
pub(crate) fn now_unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}
