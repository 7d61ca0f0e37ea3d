//! A job's journal: records on a medium, each whole or not at all.
//!
//! Takes records and a [`Storage`], gives back the picture that they add up to. The
//! layout and the argument for each crash are in `docs/journal.md`; in short:
//!
//! ```text
//!   header | picture, to the page's end |  batch  batch  batch  0 0 0 0 0 …
//!   \______ written by `replace` ______/  \__ appended __/  \_ allocated ahead
//! ```
//!
//! A batch is all records of one sync: it is there if it is whole, at its place, of this
//! file's epoch, and every batch before it is there. Whatever goes wrong in writing, the
//! journal is replaced as a whole by the picture before anything else is promised.
//!
//! Knows no file system, no clock and no meaning of a record.
mod codec;

use super::record::{Accepted, Log, MAX_TEXT_BYTES, Record};
use super::storage::Storage;
use std::io;
use std::os::unix::ffi::OsStrExt;
use thiserror::Error;

/// What a journal begins with. The last byte ends a listing on some terminals, and is
/// broken by whoever takes the file for text.
pub const MAGIC: [u8; 8] = *b"OUTRJOB\x1a";

/// The layout's version. Another one is refused, never guessed at.
pub const VERSION: u16 = 1;

/// Bytes of the header.
const HEADER_BYTES: usize = 24;

/// Bytes before a payload: its length and its checksum.
const FRAME_BYTES: usize = 8;

/// What is appended shares no page of this size with the picture: a page torn while
/// records are added cannot take the acceptance with it.
const PAGE_BYTES: usize = 4096;

/// The tail is allocated ahead in steps of this, so that a sync of a record writes no
/// metadata: about half an hour of printing.
const TAIL_BYTES: usize = 16 * 1024;

/// Bytes of records after which the picture takes their place: a file of at most about
/// a third of a megabyte, rewritten a few times a day of printing.
const COMPACT_BYTES: usize = 256 * 1024;

/// Bytes of records that wait for a sync. Beyond (a medium that fails for long) the
/// picture, which is bounded, is written instead of them.
const MAX_PENDING_BYTES: usize = 64 * 1024;

/// Largest batch read: what may wait, and one record more.
const MAX_BATCH_BYTES: usize = 2 * MAX_PENDING_BYTES;

/// Largest file read. A picture of [`super::record::MAX_OWN`] numbers without two in a
/// row takes 2 MiB, and records come upon that.
pub const MAX_JOURNAL_BYTES: usize = 4 << 20;

/// Bytes looked at for whole batches behind a damaged one.
const MAX_SEARCH_BYTES: usize = 16 << 20;

/// What is wrong with a journal's bytes.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Unreadable {
    /// Other bytes, or a damaged header.
    #[error("this is no journal of Outrigger, or its first bytes are damaged")]
    NotAJournal,
    /// Written by another version of the program.
    #[error(
        "the journal has layout {0}, this program knows {VERSION}: use the version of Outrigger that wrote it"
    )]
    Version(u16),
    /// The header is whole, but not what follows.
    #[error("the journal's first record is damaged, so it is not known what job this is")]
    NoPicture,
}

/// Why a journal cannot be used.
#[derive(Debug, Error)]
pub enum JournalError {
    /// The medium's.
    #[error("cannot {what} the journal: {source}")]
    Medium {
        /// What was tried.
        what: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// There is none.
    #[error("there is no journal")]
    Missing,
    /// Its bytes say nothing.
    #[error(transparent)]
    Unreadable(#[from] Unreadable),
    /// A path longer than any that the system opens.
    #[error("the file's or the profile's path has more than {MAX_TEXT_BYTES} bytes")]
    PathTooLong,
}

fn cannot(what: &'static str) -> impl FnOnce(io::Error) -> JournalError {
    move |source| JournalError::Medium { what, source }
}

/// Bytes behind the last good batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Cut {
    /// Where they begin.
    pub at: u64,
    /// How many, up to the last that is not zero.
    pub bytes: u64,
    /// A whole batch is among them, which was written after what stands before it was
    /// synced: the medium has damaged what was on it already. A power cut does not (see
    /// `docs/journal.md`). The picture then is [distrusted](Log::distrust).
    pub middle: bool,
}

/// What a journal's bytes add up to.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// The job.
    pub log: Log,
    /// What could not be read of it.
    pub cut: Option<Cut>,
    stamp: Stamp,
}

/// What tells a file's records from all others that may have stood on the same sectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Stamp {
    /// Of the job.
    salt: u32,
    /// Counts the times that the file was replaced.
    epoch: u32,
}

impl Stamp {
    fn header(self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[..8].copy_from_slice(&MAGIC);
        bytes[8..10].copy_from_slice(&VERSION.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.salt.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.epoch.to_le_bytes());
        let sum = crc32fast::hash(&bytes[..20]);
        bytes[20..].copy_from_slice(&sum.to_le_bytes());
        bytes
    }

    fn of(bytes: &[u8]) -> Result<Self, Unreadable> {
        let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?));
        let header = bytes.first_chunk::<HEADER_BYTES>().ok_or(Unreadable::NotAJournal)?;
        if header[..8] != MAGIC || word(20) != Some(crc32fast::hash(&header[..20])) {
            return Err(Unreadable::NotAJournal);
        }
        let version = u16::from_le_bytes([header[8], header[9]]);
        match (version, word(12), word(16)) {
            (VERSION, Some(salt), Some(epoch)) => Ok(Self { salt, epoch }),
            _ => Err(Unreadable::Version(version)),
        }
    }

    /// The checksum of a payload that stands at `at` in the file.
    fn sum(self, at: usize, payload: &[u8]) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        for word in [self.salt, self.epoch, at as u32, payload.len() as u32] {
            hasher.update(&word.to_le_bytes());
        }
        hasher.update(payload);
        hasher.finalize()
    }

    /// Adds a payload, framed, to the bytes of a file of which `before` bytes are not
    /// in `out`.
    fn put(self, out: &mut Vec<u8>, before: usize, payload: &[u8]) {
        let sum = self.sum(before + out.len(), payload);
        out.extend_from_slice(&(payload.len() as u32).to_le_bytes());
        out.extend_from_slice(&sum.to_le_bytes());
        out.extend_from_slice(payload);
    }

    /// The payload framed at `at`, if there is a whole one of this file.
    fn get(self, bytes: &[u8], at: usize) -> Option<&[u8]> {
        let (len, rest) = bytes.get(at..)?.split_first_chunk()?;
        let (sum, rest) = rest.split_first_chunk()?;
        let len = usize::try_from(u32::from_le_bytes(*len)).ok().filter(|len| *len > 0)?;
        let payload = rest.get(..len)?;
        (self.sum(at, payload) == u32::from_le_bytes(*sum)).then_some(payload)
    }
}

/// What a journal's bytes add up to: up to the last good batch, whatever the bytes are.
///
/// # Errors
/// They do not begin with a whole picture of a job.
pub fn read(bytes: &[u8]) -> Result<Picture, Unreadable> {
    let stamp = Stamp::of(bytes)?;
    let first = stamp.get(bytes, HEADER_BYTES).ok_or(Unreadable::NoPicture)?;
    let mut log = codec::decode_picture(first).ok_or(Unreadable::NoPicture)?;
    let mut at = HEADER_BYTES + FRAME_BYTES + first.len();
    while let Some((records, next)) = batch(bytes, at, stamp) {
        records.iter().for_each(|record| log.apply(record));
        at = next;
    }
    let cut = cut(bytes, at, stamp);
    if cut.is_some_and(|cut| cut.middle) {
        log.distrust();
    }
    Ok(Picture { log, cut, stamp })
}

/// The batch at `at`, and where it ends.
fn batch(bytes: &[u8], at: usize, stamp: Stamp) -> Option<(Vec<Record>, usize)> {
    let payload = stamp.get(bytes, at).filter(|payload| payload.len() <= MAX_BATCH_BYTES)?;
    Some((codec::decode(payload)?, at + FRAME_BYTES + payload.len()))
}

/// What stands behind the last good batch, which ends at `at`.
fn cut(bytes: &[u8], at: usize, stamp: Stamp) -> Option<Cut> {
    let last = bytes[at..].iter().rposition(|byte| *byte != 0)?;
    let mut budget = MAX_SEARCH_BYTES;
    let mut middle = false;
    for from in at + 1..=at + last {
        // Most places have no length that fits; what is summed in vain is bounded.
        let len = bytes[from..].first_chunk().map_or(0, |len| u32::from_le_bytes(*len));
        let len = usize::try_from(len).unwrap_or(usize::MAX);
        if len == 0 || len > MAX_BATCH_BYTES.min(bytes.len() - from) {
            continue;
        }
        let Some(left) = budget.checked_sub(len) else { break };
        budget = left;
        if batch(bytes, from, stamp).is_some() {
            middle = true;
            break;
        }
    }
    Some(Cut { at: at as u64, bytes: last as u64 + 1, middle })
}

/// A job's journal, open for writing by the one host that holds the job.
#[derive(Debug)]
pub struct Journal<S> {
    storage: S,
    log: Log,
    stamp: Stamp,
    /// Records that are not written yet: the next batch's payload.
    pending: Vec<u8>,
    /// Where the batches on the medium end.
    end: usize,
    /// Bytes of the file; zeros from `end` on.
    allocated: usize,
    /// The picture takes the batches' place when `end` is beyond.
    compact_at: usize,
    /// A write or a sync has failed: nothing is known of the file but what was synced
    /// before, and only replacing it makes it good again.
    broken: bool,
}

impl<S: Storage> Journal<S> {
    /// A new journal; once this returns, the job is on the medium.
    ///
    /// # Errors
    /// The medium's; the job must not be taken for accepted.
    pub fn create(storage: S, accepted: Accepted) -> Result<Self, JournalError> {
        let longest = accepted.path.as_os_str().as_bytes().len().max(accepted.profile.len());
        if longest > MAX_TEXT_BYTES {
            return Err(JournalError::PathTooLong);
        }
        let log = Log::new(accepted);
        let stamp = Stamp { salt: crc32fast::hash(&codec::encode_picture(&log)), epoch: 0 };
        let mut journal = Self::over(storage, log, stamp);
        journal.compact()?;
        Ok(journal)
    }

    /// The journal of a job that was accepted before, and what was cut off its end. The
    /// file is written anew, so that nothing behind the cut can ever come back.
    ///
    /// # Errors
    /// The medium's, there is none, or its bytes say nothing.
    pub fn open(mut storage: S) -> Result<(Self, Option<Cut>), JournalError> {
        let bytes = storage.read(MAX_JOURNAL_BYTES).map_err(cannot("read"))?;
        let picture = read(&bytes.ok_or(JournalError::Missing)?)?;
        let mut journal = Self::over(storage, picture.log, picture.stamp);
        journal.compact()?;
        Ok((journal, picture.cut))
    }

    fn over(storage: S, log: Log, stamp: Stamp) -> Self {
        let pending = Vec::new();
        Self { storage, log, stamp, pending, end: 0, allocated: 0, compact_at: 0, broken: true }
    }

    /// The job, all appended records included.
    pub fn log(&self) -> &Log {
        &self.log
    }

    /// Whether the last write failed. The next [`Journal::sync`] writes all anew.
    pub fn is_broken(&self) -> bool {
        self.broken
    }

    /// Adds a record; nothing is written before [`Journal::sync`].
    pub fn append(&mut self, record: &Record) {
        self.log.apply(record);
        if self.broken {
            // The picture is written next, and this is in it.
            return;
        }
        codec::encode(record, &mut self.pending);
        if self.pending.len() > MAX_PENDING_BYTES {
            self.pending.clear();
            self.broken = true;
        }
    }

    /// Returns once all that was appended is on the medium.
    ///
    /// # Errors
    /// The medium's; what was appended since the last success may or may not be there.
    /// To be called again, with patience: the next call replaces the file.
    pub fn sync(&mut self) -> Result<(), JournalError> {
        if self.broken {
            return self.compact();
        }
        if self.pending.is_empty() {
            return Ok(());
        }
        self.write_pending().inspect_err(|_| self.broken = true)?;
        if self.end > self.compact_at {
            // The records are on the medium already, in either file: a failure here is
            // told at the next call, which tries again.
            let _ = self.compact();
        }
        Ok(())
    }

    fn write_pending(&mut self) -> Result<(), JournalError> {
        let mut bytes = Vec::with_capacity(FRAME_BYTES + self.pending.len());
        self.stamp.put(&mut bytes, self.end, &self.pending);
        let end = self.end + bytes.len();
        let mut allocated = self.allocated;
        if end > allocated {
            allocated = end.next_multiple_of(TAIL_BYTES);
            bytes.resize(allocated - self.end, 0);
        }
        self.storage.write(self.end as u64, &bytes).map_err(cannot("write to"))?;
        self.storage.sync().map_err(cannot("sync"))?;
        self.pending.clear();
        self.end = end;
        self.allocated = allocated;
        Ok(())
    }

    /// Writes the picture in the place of all records; once this returns, all that was
    /// appended is on the medium.
    ///
    /// # Errors
    /// The medium's; the file is then the old one or the new one.
    pub fn compact(&mut self) -> Result<(), JournalError> {
        self.broken = true;
        self.pending.clear();
        let stamp = Stamp { epoch: self.stamp.epoch.wrapping_add(1), ..self.stamp };
        // The next epoch is used up, whether or not the file gets there.
        self.stamp = stamp;
        let mut bytes = stamp.header().to_vec();
        let mut payload = codec::encode_picture(&self.log);
        let end = (bytes.len() + FRAME_BYTES + payload.len()).next_multiple_of(PAGE_BYTES);
        payload.resize(end - bytes.len() - FRAME_BYTES, 0);
        stamp.put(&mut bytes, 0, &payload);
        bytes.resize(end + TAIL_BYTES, 0);
        self.storage.replace(&bytes).map_err(cannot("write"))?;
        self.end = end;
        self.allocated = bytes.len();
        self.compact_at = end + COMPACT_BYTES;
        self.broken = false;
        Ok(())
    }
}

#[cfg(test)]
mod tests;
