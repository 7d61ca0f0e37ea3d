//! Whether a zip archive's directory may be opened at all.
//!
//! Takes a reader of the whole file, gives where the directory ends, or why it is
//! refused. The zip crate sets memory aside by announced figures, and where a record
//! at the end is damaged it tries whatever looks like an earlier one. So the figures
//! are held against the file first: their number, the directory's size, and that as
//! many entries as announced fill the directory exactly, which ends where its record
//! begins (PKWARE's APPNOTE 6.3.10, sections 4.3.12 to 4.3.16). The crate then takes
//! that record or gives up. Knows nothing of an entry but its length and its name.
use std::collections::HashSet;
use std::io::{Read, Seek, SeekFrom};

/// Most entries: twice the layers of the tallest job.
pub const MAX_ENTRIES: u64 = 200_000;

/// Most bytes of the directory: 80 for each entry of the longest, 800 of a usual one.
/// The crate takes up to 13 times as much memory, for extra fields without content.
pub const MAX_DIRECTORY_BYTES: u64 = 16 << 20;

/// Bytes of the record at the end, without its comment.
const END_BYTES: u64 = 22;
/// Bytes of a zip64 record without extensions, which nobody writes.
const WIDE_BYTES: u64 = 56;
/// Bytes of what stands between the two and tells where the zip64 record is.
const LOCATOR_BYTES: u64 = 20;
/// Bytes of a directory entry, without name, extra fields and comment.
const ENTRY_BYTES: usize = 46;

/// Why an archive is not opened.
#[derive(Debug, thiserror::Error)]
pub enum DirectoryError {
    /// No record at the end of the file.
    #[error(
        "the archive has no directory at its end: the file is cut off or damaged; export or copy it again"
    )]
    NoEnd,
    /// The directory contradicts itself or the file.
    #[error("the archive's directory is damaged at byte {at}: {why}; export or copy the file again")]
    Damaged {
        /// Where in the file.
        at: u64,
        /// What is wrong there.
        why: &'static str,
    },
    /// More than any job has.
    #[error(
        "the archive announces {entries} entries in a directory of {bytes} bytes, at most {MAX_ENTRIES} in {MAX_DIRECTORY_BYTES} are read: this is no resin job"
    )]
    TooLarge {
        /// Entries that it announces.
        entries: u64,
        /// Bytes that the directory announces.
        bytes: u64,
    },
    /// Two entries of the same name: which one counts is anyone's guess.
    #[error("the archive holds two entries named {name:?}; export the job again")]
    Twice {
        /// Their name.
        name: String,
    },
    /// The file itself cannot be read.
    #[error("the file cannot be read: {0}")]
    Io(#[from] std::io::Error),
}

/// Where a directory lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Its entries, as announced and found.
    pub entries: u64,
    /// Where in the file it begins: behind the last entry's content.
    pub at: u64,
    /// Its bytes.
    pub bytes: u64,
    /// The record that tells so.
    end: u64,
}

/// Looks at the directory without reading what its entries say.
///
/// # Errors
/// It is missing, damaged, larger than [`MAX_ENTRIES`] and [`MAX_DIRECTORY_BYTES`], or
/// names two entries alike.
pub fn check<R: Read + Seek>(reader: &mut R) -> Result<Span, DirectoryError> {
    let span = span(reader)?;
    if span.entries > MAX_ENTRIES || span.bytes > MAX_DIRECTORY_BYTES {
        return Err(DirectoryError::TooLarge { entries: span.entries, bytes: span.bytes });
    }
    let damaged = |why| DirectoryError::Damaged { at: span.end, why };
    match span.at.checked_add(span.bytes) {
        Some(end) if end == span.end => {}
        Some(end) if end < span.end => return Err(damaged("the directory ends before it")),
        _ => return Err(damaged("the directory lies outside the file")),
    }
    let mut directory = vec![0; span.bytes as usize];
    reader.seek(SeekFrom::Start(span.at))?;
    reader.read_exact(&mut directory)?;
    let mut names = HashSet::new();
    let mut rest = &directory[..];
    for _ in 0..span.entries {
        let at = span.at + (directory.len() - rest.len()) as u64;
        let name = next_name(&mut rest).map_err(|why| DirectoryError::Damaged { at, why })?;
        if !names.insert(name) {
            return Err(DirectoryError::Twice { name: String::from_utf8_lossy(name).into_owned() });
        }
    }
    if !rest.is_empty() {
        let at = span.end - rest.len() as u64;
        return Err(DirectoryError::Damaged { at, why: "more entries than announced" });
    }
    Ok(span)
}

/// Reads the last record at the end of the file, whose comment must end with the file.
fn span<R: Read + Seek>(reader: &mut R) -> Result<Span, DirectoryError> {
    let length = reader.seek(SeekFrom::End(0))?;
    let from = length.saturating_sub(END_BYTES + LOCATOR_BYTES + u64::from(u16::MAX));
    reader.seek(SeekFrom::Start(from))?;
    let mut tail = Vec::new();
    reader.by_ref().take(length - from).read_to_end(&mut tail)?;
    // The last one and no other: it is the one that the crate finds.
    let i = tail.windows(4).rposition(|w| w == b"PK\x05\x06").ok_or(DirectoryError::NoEnd)?;
    let record = &tail[i..];
    let whole =
        record.len() as u64 >= END_BYTES && END_BYTES + u64::from(le16(record, 20)) == record.len() as u64;
    if !whole {
        return Err(DirectoryError::NoEnd);
    }
    let end = from + i as u64;
    let (entries, bytes, at) = (le16(record, 10), le32(record, 12), le32(record, 16));
    let elsewhere = entries == u16::MAX || bytes == u32::MAX || at == u32::MAX;
    let locator = i.checked_sub(LOCATOR_BYTES as usize).map(|j| &tail[j..i]);
    if let Some(locator) = locator.filter(|l| elsewhere && l.starts_with(b"PK\x06\x07")) {
        return wide_span(reader, locator, end - LOCATOR_BYTES);
    }
    if le32(record, 4) != 0 || le16(record, 8) != entries {
        return Err(DirectoryError::Damaged { at: end, why: "it is one part of an archive of several" });
    }
    Ok(Span { entries: entries.into(), at: at.into(), bytes: bytes.into(), end })
}

/// Reads the zip64 record that a locator points to, which ends where the locator begins.
fn wide_span<R: Read + Seek>(reader: &mut R, locator: &[u8], before: u64) -> Result<Span, DirectoryError> {
    let at = le64(locator, 8);
    let damaged = |why| DirectoryError::Damaged { at, why };
    if at.checked_add(WIDE_BYTES) != Some(before) {
        return Err(damaged("no zip64 record where one is announced"));
    }
    let mut record = [0; WIDE_BYTES as usize];
    reader.seek(SeekFrom::Start(at))?;
    reader.read_exact(&mut record)?;
    // Its length is counted from behind this figure.
    if !record.starts_with(b"PK\x06\x06") || le64(&record, 4) != WIDE_BYTES - 12 {
        return Err(damaged("no zip64 record where one is announced"));
    }
    let [here, entries, bytes, start] = [24, 32, 40, 48].map(|i| le64(&record, i));
    let parts = [le32(locator, 4), le32(&record, 16), le32(&record, 20), le32(locator, 16).saturating_sub(1)];
    if parts != [0; 4] || here != entries {
        return Err(damaged("it is one part of an archive of several"));
    }
    Ok(Span { entries, at: start, bytes, end: at })
}

/// Takes one entry off the front of the directory, gives its name.
fn next_name<'a>(rest: &mut &'a [u8]) -> Result<&'a [u8], &'static str> {
    let fixed = rest.get(..ENTRY_BYTES).ok_or("it ends inside an entry")?;
    if !fixed.starts_with(b"PK\x01\x02") {
        return Err("no entry where one is announced");
    }
    let [name, extra, comment] = [28, 30, 32].map(|i| usize::from(le16(fixed, i)));
    let (whole, later) =
        rest.split_at_checked(ENTRY_BYTES + name + extra + comment).ok_or("it ends inside an entry")?;
    *rest = later;
    Ok(&whole[ENTRY_BYTES..ENTRY_BYTES + name])
}

fn le16(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

fn le32(bytes: &[u8], at: usize) -> u32 {
    u32::from(le16(bytes, at)) | u32::from(le16(bytes, at + 2)) << 16
}

fn le64(bytes: &[u8], at: usize) -> u64 {
    u64::from(le32(bytes, at)) | u64::from(le32(bytes, at + 4)) << 32
}
