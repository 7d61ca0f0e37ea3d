//! A zip archive's directory, read within bounds (PKWARE's APPNOTE 6.3.10, sections
//! 4.3 and 4.5.3).
//!
//! Takes a reader of the whole file, gives its entries. Nothing is held by announced
//! figures: their number and the directory's size are bounded first, which the zip
//! crate's reader offers no way to do. Knows no unpacking and no format of jobs.
use std::io::{Read, Seek, SeekFrom};

/// Most entries: twice the layers of the tallest job.
pub const MAX_ENTRIES: u64 = 200_000;

/// Most bytes of the directory, which is held in memory.
pub const MAX_DIRECTORY_BYTES: u64 = 64 << 20;

/// Bytes of the record at the end, without its comment.
const END_BYTES: u64 = 22;
/// Bytes of a directory entry, without name, extra fields and comment.
const ENTRY_BYTES: usize = 46;
/// Bytes of the header before an entry's content, without name and extra fields.
const LOCAL_BYTES: usize = 30;
/// Stands in a 32-bit field whose value is in the zip64 extra field.
const ELSEWHERE: u64 = 0xffff_ffff;

/// Why a directory cannot be read.
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
    /// The file itself cannot be read.
    #[error("the file cannot be read: {0}")]
    Io(#[from] std::io::Error),
}

/// One entry, as the directory has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its name; what is not UTF-8 is replaced.
    pub name: Box<str>,
    /// How it is packed: [`Entry::STORED`], [`Entry::DEFLATED`], or something not read.
    pub method: u16,
    /// Bit 0: encrypted.
    pub flags: u16,
    /// CRC-32 of the bytes unpacked.
    pub crc: u32,
    /// Bytes in the file.
    pub packed: u64,
    /// Bytes unpacked, as announced.
    pub size: u64,
    /// Where its local header begins in the file.
    pub offset: u64,
}

impl Entry {
    /// Not packed.
    pub const STORED: u16 = 0;
    /// Packed with deflate.
    pub const DEFLATED: u16 = 8;

    /// The first byte behind its content, if its local header were as short as can be.
    #[must_use]
    pub fn least_end(&self) -> u64 {
        self.offset.saturating_add(LOCAL_BYTES as u64).saturating_add(self.packed)
    }

    /// Moves the reader to the first byte of the content.
    ///
    /// # Errors
    /// What is wrong: packed in a way that is not read, or the local header is damaged
    /// or names something else.
    pub fn find_content<R: Read + Seek>(&self, reader: &mut R) -> Result<(), String> {
        if self.flags & 1 != 0 {
            return Err("it is encrypted".to_owned());
        }
        if ![Entry::STORED, Entry::DEFLATED].contains(&self.method) {
            return Err(format!("it is packed with method {}, only deflate is read", self.method));
        }
        let mut header = [0; LOCAL_BYTES];
        let read = |e: std::io::Error| e.to_string();
        reader.seek(SeekFrom::Start(self.offset)).map_err(read)?;
        reader.read_exact(&mut header).map_err(read)?;
        if !header.starts_with(b"PK\x03\x04") {
            return Err(format!("there is no header at byte {} of the file", self.offset));
        }
        let mut name = vec![0; usize::from(le16(&header, 26))];
        reader.read_exact(&mut name).map_err(read)?;
        if String::from_utf8_lossy(&name) != *self.name {
            return Err(format!("its header at byte {} of the file has another name", self.offset));
        }
        reader.seek_relative(i64::from(le16(&header, 28))).map_err(read)
    }
}

/// Where the directory lies.
struct Span {
    entries: u64,
    at: u64,
    bytes: u64,
    /// The record that tells so: the directory ends before it.
    end: u64,
}

/// Reads a whole directory.
///
/// # Errors
/// It is missing, damaged, or larger than [`MAX_ENTRIES`] and [`MAX_DIRECTORY_BYTES`].
pub fn read<R: Read + Seek>(reader: &mut R) -> Result<Vec<Entry>, DirectoryError> {
    let span = span(reader)?;
    if span.entries > MAX_ENTRIES || span.bytes > MAX_DIRECTORY_BYTES {
        return Err(DirectoryError::TooLarge { entries: span.entries, bytes: span.bytes });
    }
    if span.at.checked_add(span.bytes).is_none_or(|end| end > span.end) {
        return Err(DirectoryError::Damaged { at: span.end, why: "it lies outside the file" });
    }
    let mut directory = vec![0; span.bytes as usize];
    reader.seek(SeekFrom::Start(span.at))?;
    reader.read_exact(&mut directory)?;
    let mut rest = &directory[..];
    let mut entries = Vec::new();
    for _ in 0..span.entries {
        let at = span.at + (directory.len() - rest.len()) as u64;
        let damaged = |why| DirectoryError::Damaged { at, why };
        let entry = entry(&mut rest).map_err(damaged)?;
        if entry.offset >= span.at || entry.least_end() > span.at {
            return Err(damaged("the entry's content lies outside the file"));
        }
        entries.push(entry);
    }
    if rest.starts_with(b"PK\x01\x02") {
        let at = span.at + (directory.len() - rest.len()) as u64;
        return Err(DirectoryError::Damaged { at, why: "more entries than announced" });
    }
    Ok(entries)
}

/// Finds the record at the end of the file whose comment ends with the file.
fn span<R: Read + Seek>(reader: &mut R) -> Result<Span, DirectoryError> {
    let length = reader.seek(SeekFrom::End(0))?;
    let from = length.saturating_sub(END_BYTES + u64::from(u16::MAX));
    reader.seek(SeekFrom::Start(from))?;
    let mut tail = Vec::new();
    reader.by_ref().take(length - from).read_to_end(&mut tail)?;
    let last = tail.len().checked_sub(END_BYTES as usize).ok_or(DirectoryError::NoEnd)?;
    let ends = |&i: &usize| {
        tail[i..].starts_with(b"PK\x05\x06")
            && i + END_BYTES as usize + usize::from(le16(&tail, i + 20)) == tail.len()
    };
    let i = (0..=last).rev().find(ends).ok_or(DirectoryError::NoEnd)?;
    let end = from + i as u64;
    let record = &tail[i..];
    if le16(record, 4) != le16(record, 6) {
        return Err(DirectoryError::Damaged { at: end, why: "it is one part of an archive of several" });
    }
    let (entries, bytes, at) =
        (u64::from(le16(record, 10)), u64::from(le32(record, 12)), u64::from(le32(record, 16)));
    let elsewhere = entries == 0xffff || bytes == ELSEWHERE || at == ELSEWHERE;
    let locator = i.checked_sub(20).map(|j| &tail[j..i]).filter(|l| l.starts_with(b"PK\x06\x07"));
    if let (true, Some(locator)) = (elsewhere, locator) {
        return zip64_span(reader, le64(locator, 8), end);
    }
    Ok(Span { entries, at, bytes, end })
}

/// The zip64 record that a locator points to.
fn zip64_span<R: Read + Seek>(reader: &mut R, at: u64, before: u64) -> Result<Span, DirectoryError> {
    let damaged = DirectoryError::Damaged { at, why: "no zip64 record where one is announced" };
    if at.checked_add(56).is_none_or(|end| end > before) {
        return Err(damaged);
    }
    let mut record = [0; 56];
    reader.seek(SeekFrom::Start(at))?;
    reader.read_exact(&mut record)?;
    if !record.starts_with(b"PK\x06\x06") {
        return Err(damaged);
    }
    Ok(Span { entries: le64(&record, 32), bytes: le64(&record, 40), at: le64(&record, 48), end: at })
}

/// Takes one entry off the front of the directory.
fn entry(rest: &mut &[u8]) -> Result<Entry, &'static str> {
    let fixed = rest.get(..ENTRY_BYTES).ok_or("it ends inside an entry")?;
    if !fixed.starts_with(b"PK\x01\x02") {
        return Err("no entry where one is announced");
    }
    let name_end = ENTRY_BYTES + usize::from(le16(fixed, 28));
    let extra_end = name_end + usize::from(le16(fixed, 30));
    let end = extra_end + usize::from(le16(fixed, 32));
    let whole = rest.get(..end).ok_or("it ends inside an entry")?;
    let mut wide = zip64_extra(&whole[name_end..extra_end]);
    let mut value = |narrow: u32| -> Result<u64, &'static str> {
        match u64::from(narrow) {
            ELSEWHERE => {
                let (now, later) = wide.split_at_checked(8).ok_or("a zip64 figure is missing")?;
                wide = later;
                Ok(le64(now, 0))
            }
            narrow => Ok(narrow),
        }
    };
    // In this order in the extra field (4.5.3).
    let (size, packed, offset) = (value(le32(fixed, 24))?, value(le32(fixed, 20))?, value(le32(fixed, 42))?);
    let entry = Entry {
        name: String::from_utf8_lossy(&whole[ENTRY_BYTES..name_end]).into(),
        method: le16(fixed, 10),
        flags: le16(fixed, 8),
        crc: le32(fixed, 16),
        packed,
        size,
        offset,
    };
    *rest = &rest[end..];
    Ok(entry)
}

/// The figures of the zip64 extra field, if there is one.
fn zip64_extra(mut extra: &[u8]) -> &[u8] {
    while let Some((head, rest)) = extra.split_at_checked(4) {
        let length = usize::from(le16(head, 2)).min(rest.len());
        if le16(head, 0) == 1 {
            return &rest[..length];
        }
        extra = &rest[length..];
    }
    &[]
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
