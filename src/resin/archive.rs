//! A zip archive, its entries read within bounds.
//!
//! Takes a reader of the whole file, gives its entries' names and, one at a time,
//! their bytes. Alone names the zip crate, which reads the directory once
//! [`bounds`] has held its figures against the file, and unpacks. An entry that holds
//! more than it announces ends in an error as soon as it does. Names are compared,
//! never used as paths. [`write`] makes archives. Knows no format of resin jobs.
pub mod write;

use super::bounds::{self, DirectoryError};
use std::collections::HashMap;
use std::io::{Read, Seek, SeekFrom};
use zip::read::{ArchiveOffset, Config};
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive, ZipReadOptions};

/// Most bytes of one entry, unpacked. A picture of 16,384 × 16,384 px that a slicer
/// wrote is far below; only noise is above.
pub const MAX_ENTRY_BYTES: u64 = 64 << 20;

/// Why an archive, or an entry of it, cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// It does not begin as a zip archive.
    #[error(
        "not a zip archive: it begins with {begins:02x?} instead of \"PK\", and not GOO either; give a .sl1, .nanodlp or .goo file as the slicer wrote it"
    )]
    NotZip {
        /// Its first bytes, at most four.
        begins: Vec<u8>,
    },
    /// Its directory is damaged, or not one of a resin job.
    #[error(transparent)]
    Directory(#[from] DirectoryError),
    /// Its directory is whole, but what it says of an entry is not.
    #[error("the archive's directory is damaged: {why}; export or copy the file again")]
    Listing {
        /// What is wrong with it.
        why: String,
    },
    /// Two entries share bytes of the file.
    #[error(
        "the entries {one:?} and {other:?} overlap in the archive, as in a zip bomb; export the job again"
    )]
    Overlap {
        /// One of them.
        one: String,
        /// The one that begins inside it.
        other: String,
    },
    /// No such entry.
    #[error("the archive holds no {name:?}")]
    Missing {
        /// Its name.
        name: String,
    },
    /// An entry announces more than is read.
    #[error("{name:?} announces {size} bytes, {limit} at most are read: nothing that a slicer writes")]
    TooLarge {
        /// Its name.
        name: String,
        /// Bytes that it announces.
        size: u64,
        /// Bytes that are allowed.
        limit: u64,
    },
    /// An entry is shorter than announced.
    #[error("{name:?} announces {size} bytes and holds {holds}: it is damaged; export the job again")]
    WrongSize {
        /// Its name.
        name: String,
        /// Bytes that it announces.
        size: u64,
        /// Bytes found.
        holds: u64,
    },
    /// An entry cannot be unpacked.
    #[error("{name:?} cannot be unpacked: {why}; export or copy the file again")]
    Entry {
        /// Its name.
        name: String,
        /// What is wrong with it.
        why: String,
    },
    /// The file itself cannot be read.
    #[error("the file cannot be read: {0}")]
    Io(#[from] std::io::Error),
}

/// An open archive.
#[derive(Debug)]
pub struct Archive<R> {
    zip: ZipArchive<R>,
    entries: Vec<Entry>,
    by_name: HashMap<Box<str>, usize>,
}

/// What the directory says of an entry.
#[derive(Debug)]
struct Entry {
    name: Box<str>,
    /// Bytes unpacked.
    size: u64,
    /// Where its local header begins in the file.
    start: u64,
    /// The first byte behind its content, if its local header were as short as can be.
    least_end: u64,
}

/// Bytes of the header before an entry's content, without name and extra fields.
const LOCAL_BYTES: u64 = 30;

/// Whether a file that begins so is a zip archive, as all resin archives are.
#[must_use]
pub fn is_zip(begins: &[u8]) -> bool {
    // The second is an archive of nothing.
    begins.starts_with(b"PK\x03\x04") || begins.starts_with(b"PK\x05\x06")
}

impl<R: Read + Seek> Archive<R> {
    /// Reads the directory, within the bounds of [`bounds`].
    ///
    /// # Errors
    /// The file is no zip archive, its directory is damaged or too large, two entries
    /// have one name, or entries overlap.
    pub fn open(mut reader: R) -> Result<Archive<R>, ArchiveError> {
        let mut begins = Vec::new();
        reader.seek(SeekFrom::Start(0))?;
        reader.by_ref().take(4).read_to_end(&mut begins)?;
        if !is_zip(&begins) {
            return Err(ArchiveError::NotZip { begins });
        }
        let span = bounds::check(&mut reader)?;
        // As announced: the crate is not to look for another directory elsewhere.
        let config = Config { archive_offset: ArchiveOffset::Known(0) };
        let zip = ZipArchive::with_config(config, reader).map_err(listing)?;
        let entries = (0..zip.len()).map(|i| entry(&zip, i)).collect::<Result<Vec<Entry>, _>>()?;
        if entries.len() as u64 != span.entries {
            return Err(ArchiveError::Listing {
                why: "two entries have one name by their extra fields".into(),
            });
        }
        if let Some(e) = entries.iter().find(|e| e.start >= span.at || e.least_end > span.at) {
            let why = format!("{:?} lies outside the file", e.name);
            return Err(ArchiveError::Listing { why });
        }
        let mut by_name = HashMap::with_capacity(entries.len());
        for (index, entry) in entries.iter().enumerate() {
            // Not the same bytes, but the same once what is not UTF-8 is replaced.
            if by_name.insert(entry.name.clone(), index).is_some() {
                return Err(DirectoryError::Twice { name: entry.name.to_string() }.into());
            }
        }
        let mut order: Vec<&Entry> = entries.iter().collect();
        order.sort_unstable_by_key(|e| e.start);
        if let Some(w) = order.windows(2).find(|w| w[0].least_end > w[1].start) {
            let [one, other] = [w[0].name.to_string(), w[1].name.to_string()];
            return Err(ArchiveError::Overlap { one, other });
        }
        Ok(Archive { zip, entries, by_name })
    }

    /// Names of all entries, in the order of the directory. What is not UTF-8 is replaced.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().map(|e| &*e.name)
    }

    /// Index of an entry by its whole name.
    #[must_use]
    pub fn find(&self, name: &str) -> Option<usize> {
        self.by_name.get(name).copied()
    }

    /// Name of an entry; empty where there is none.
    #[must_use]
    pub fn name(&self, index: usize) -> &str {
        self.entries.get(index).map_or("", |e| &e.name)
    }

    /// Bytes that an entry announces, unpacked; 0 where there is none.
    #[must_use]
    pub fn announced(&self, index: usize) -> u64 {
        self.entries.get(index).map_or(0, |e| e.size)
    }

    /// The bytes of an entry, at most `limit` of them.
    ///
    /// # Errors
    /// It announces more than the limit, holds more or less than it announces, its
    /// checksum is wrong, or it is packed or encrypted in a way that is not read.
    pub fn read(&mut self, index: usize, limit: u64) -> Result<Vec<u8>, ArchiveError> {
        let Some(Entry { name, size, .. }) = self.entries.get(index) else {
            return Err(ArchiveError::Missing { name: format!("entry {index}") });
        };
        let (name, size) = (|| name.to_string(), *size);
        if size > limit {
            return Err(ArchiveError::TooLarge { name: name(), size, limit });
        }
        let refused = |e: ZipError| match e {
            ZipError::Io(e) => ArchiveError::Io(e),
            e => ArchiveError::Entry { name: name(), why: e.to_string() },
        };
        let listed = self.zip.by_index_data(index).map_err(refused)?;
        if listed.encrypted() {
            return Err(ArchiveError::Entry { name: name(), why: "it is encrypted".to_owned() });
        }
        let method = listed.compression();
        if ![CompressionMethod::Stored, CompressionMethod::Deflated].contains(&method) {
            let why = format!("it is packed with {method}, only deflate is read");
            return Err(ArchiveError::Entry { name: name(), why });
        }
        // Its local header must agree with the directory.
        let options = ZipReadOptions::new().enforce_header_consistency(true);
        let content = self.zip.by_index_with_options(index, options).map_err(refused)?;
        // What the entry announces is not trusted with more than a first megabyte.
        let mut bytes = Vec::with_capacity(size.min(1 << 20) as usize);
        // The crate ends in an error at the first byte too many, and at a wrong checksum.
        content
            .take(size.saturating_add(1))
            .read_to_end(&mut bytes)
            .map_err(|e| ArchiveError::Entry { name: name(), why: e.to_string() })?;
        if bytes.len() as u64 != size {
            return Err(ArchiveError::WrongSize { name: name(), size, holds: bytes.len() as u64 });
        }
        Ok(bytes)
    }

    /// The bytes of an entry by its name.
    ///
    /// # Errors
    /// As [`Archive::read`], and when there is no such entry.
    pub fn read_named(&mut self, name: &str, limit: u64) -> Result<Vec<u8>, ArchiveError> {
        let index = self.find(name).ok_or_else(|| ArchiveError::Missing { name: name.to_owned() })?;
        self.read(index, limit)
    }
}

/// One entry of the directory.
fn entry<R: Read + Seek>(zip: &ZipArchive<R>, index: usize) -> Result<Entry, ArchiveError> {
    let entry = zip.by_index_data(index).map_err(listing)?;
    let start = entry.header_start();
    Ok(Entry {
        name: String::from_utf8_lossy(entry.name_raw()).into(),
        size: entry.size(),
        start,
        least_end: start.saturating_add(LOCAL_BYTES).saturating_add(entry.compressed_size()),
    })
}

fn listing(error: ZipError) -> ArchiveError {
    match error {
        ZipError::Io(e) => ArchiveError::Io(e),
        e => ArchiveError::Listing { why: e.to_string() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin::testing::{archive, stored};
    use std::io::Cursor;

    fn open(bytes: &[u8]) -> Result<Archive<Cursor<&[u8]>>, ArchiveError> {
        Archive::open(Cursor::new(bytes))
    }

    /// Reads everything of an archive and gives what was said, or nothing.
    fn says(bytes: &[u8]) -> String {
        let read =
            open(bytes).and_then(|mut a| (0..a.names().count()).try_for_each(|i| a.read(i, 1000).map(drop)));
        read.err().map(|e| e.to_string()).unwrap_or_default()
    }

    #[track_caller]
    fn check(bytes: &[u8], words: &[&str]) {
        let said = says(bytes);
        assert!(words.iter().all(|w| said.contains(w)) && said.is_empty() == words.is_empty(), "{said:?}");
    }

    /// Where some bytes stand, counted from the end.
    fn last(bytes: &[u8], of: &[u8]) -> usize {
        bytes.windows(of.len()).rposition(|w| w == of).expect("those bytes")
    }

    #[test]
    fn entries_come_back() {
        for bytes in [archive(&two()), stored(&two())] {
            let mut a = open(&bytes).expect("an archive");
            assert_eq!(a.names().collect::<Vec<_>>(), ["a.txt", "b/ü.png"]);
            assert_eq!(a.read_named("b/ü.png", 1000).expect("read"), [7; 300]);
            assert_eq!(a.read_named("a.txt", 5).expect("read"), b"hello");
            assert_eq!((a.announced(1), a.find("c")), (300, None));
            assert!(matches!(a.read_named("c", 9), Err(ArchiveError::Missing { .. })));
            assert!(matches!(a.read(2, 9), Err(ArchiveError::Missing { .. })));
            check(&bytes, &[]);
        }
    }

    fn two() -> [(&'static str, Vec<u8>); 2] {
        [("a.txt", b"hello".to_vec()), ("b/ü.png", vec![7; 300])]
    }

    #[test]
    fn what_is_no_archive_is_refused() {
        check(b"", &["not a zip archive", "[]"]);
        check(b"G28 X\n", &["not a zip archive", "[47, 32, 38, 20]"]);
        check(b"PK\x03\x04", &["cut off"]);
        let good = archive(&two());
        for cut in 4..good.len() {
            check(&good[..cut], &["cut off"]);
        }
    }

    #[test]
    fn any_damaged_byte_is_read_or_refused() {
        let good = archive(&two());
        for at in 0..good.len() {
            for flip in [1, 0x80, 0xff] {
                let mut bad = good.clone();
                bad[at] ^= flip;
                says(&bad);
            }
        }
    }

    #[test]
    fn a_bomb_ends_before_memory_is_spent() {
        let zeros = archive(&[("bomb.png", vec![0; 30_000_000])]);
        check(&zeros, &["\"bomb.png\" announces 30000000 bytes, 1000 at most"]);
        // It announces ten bytes, in the directory and before its content.
        let mut lying = zeros.clone();
        let directory = last(&lying, b"PK\x01\x02");
        lying[directory + 24..directory + 28].copy_from_slice(&10_u32.to_le_bytes());
        lying[22..26].copy_from_slice(&10_u32.to_le_bytes());
        check(&lying, &["\"bomb.png\"", "larger than its declared uncompressed size"]);
        // And one that announces more than it holds.
        let mut short = archive(&[("a", [1; 20])]);
        let directory = last(&short, b"PK\x01\x02");
        short[directory + 24..directory + 28].copy_from_slice(&999_u32.to_le_bytes());
        check(&short, &["\"a\"", "size mismatch"]);
        short[22..26].copy_from_slice(&999_u32.to_le_bytes());
        check(&short, &["announces 999 bytes and holds 20"]);
    }

    #[test]
    fn a_directory_that_lies_is_refused() {
        let good = stored(&two());
        let (first, end) = (good.len() - 22 - 105, good.len() - 22);
        assert!(good[first..].starts_with(b"PK\x01\x02"));
        let changed = |at: usize, bytes: &[u8]| {
            let mut bad = good.clone();
            bad[at..at + bytes.len()].copy_from_slice(bytes);
            bad
        };
        check(&changed(end + 8, &[1, 0, 1, 0]), &["damaged at byte", "more entries than announced"]);
        check(&changed(end + 10, &[1, 0]), &["archive of several"]);
        check(&changed(end + 8, &[3, 0, 3, 0]), &["damaged at byte"]);
        check(&changed(end + 12, &[255, 255, 255, 0]), &["outside the file"]);
        check(&changed(end + 12, &[255, 255, 255, 15]), &["no resin job"]);
        check(&changed(end + 16, &[0, 1, 0, 0]), &["the directory ends before it"]);
        check(&changed(first, b"Q"), &["no entry where one is announced"]);
        check(&changed(end + 4, &[1]), &["archive of several"]);
        check(&changed(first + 8, &[1]), &["\"a.txt\"", "encrypted"]);
        check(&changed(first + 10, &[12]), &["\"a.txt\"", "packed with Bzip2, only deflate"]);
        check(&changed(first + 16, &[0; 4]), &["\"a.txt\"", "CRC32"]);
        check(&changed(30 + 5, b"H"), &["\"a.txt\"", "checksum"]);
        check(&changed(first + 20, &[255; 3]), &["outside the file"]);
        check(&changed(first + 42, &[1]), &["\"a.txt\"", "local file header"]);
        check(&changed(first + 46, b"b"), &["\"b.txt\"", "filename mismatch"]);
        let twice = [("a", [1; 9]), ("b", [1; 9])];
        let mut twice = stored(&twice);
        let (directory, local) = (last(&twice, b"PK\x01\x02"), last(&twice, b"PK\x03\x04"));
        twice[directory + 46] = b'a';
        twice[local + 30] = b'a';
        check(&twice, &["two entries named \"a\""]);
        // The second entry's content is the first one's.
        twice[directory + 46] = b'b';
        twice[directory + 42..directory + 46].fill(0);
        check(&twice, &["overlap"]);
    }

    /// Ends an archive with a zip64 record: entries here and in all, bytes of the directory
    /// and where it begins.
    fn wide_end(bytes: &mut Vec<u8>, figures: [u64; 4]) {
        let at = bytes.len() as u64;
        bytes.extend(b"PK\x06\x06");
        bytes.extend(44_u64.to_le_bytes());
        bytes.extend([0; 12]);
        bytes.extend(figures.map(u64::to_le_bytes).concat());
        bytes.extend(b"PK\x06\x07\0\0\0\0");
        bytes.extend(at.to_le_bytes());
        bytes.extend([1, 0, 0, 0]);
        bytes.extend(b"PK\x05\x06\0\0\0\0");
        bytes.extend([0xff; 12]);
        bytes.extend([0, 0]);
    }

    #[test]
    fn too_many_entries_are_refused_by_their_number() {
        // A zip64 record that announces 2^40 entries of a directory as large.
        let mut bytes = b"PK\x03\x04".to_vec();
        wide_end(&mut bytes, [1 << 40, 1 << 40, 1 << 46, 0]);
        check(&bytes, &["1099511627776 entries", "no resin job"]);
    }

    #[test]
    fn zip64_is_read() {
        let good = stored(&[("a", [1; 9])]);
        let (directory, end) = (last(&good, b"PK\x01\x02"), good.len() - 22);
        let mut bytes = good[..directory].to_vec();
        let mut entry = good[directory..end].to_vec();
        entry[20..28].fill(0xff);
        entry[30] = 20;
        entry.extend([1, 0, 16, 0]);
        entry.extend([9_u64, 9].map(u64::to_le_bytes).concat());
        bytes.extend(&entry);
        wide_end(&mut bytes, [1, 1, entry.len() as u64, directory as u64]);
        assert_eq!(open(&bytes).expect("an archive").read_named("a", 9).expect("read"), [1; 9]);
    }

    #[test]
    fn the_crate_is_not_led_to_another_directory() {
        // A whole archive stands in the comment of another: the last record counts, or none.
        let good = stored(&two());
        let mut outer = good.clone();
        let at = outer.len() - 2;
        outer[at..].copy_from_slice(&(good.len() as u16).to_le_bytes());
        outer.extend(&good);
        check(&outer, &["the directory ends before it"]);
        // Nor to the first of two, where the second announces too much.
        let mut both = good.clone();
        both.extend(&good);
        let end = both.len() - 22;
        both[end + 8..end + 12].fill(0xee);
        check(&both, &["damaged"]);
    }
}
