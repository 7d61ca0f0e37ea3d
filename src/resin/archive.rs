//! A zip archive, its entries read within bounds.
//!
//! Takes a reader of the whole file, gives its entries' names and, one at a time,
//! their bytes. The directory's figures are believed only as far as they bound what
//! is read: an entry that holds more than it announces ends in an error as soon as
//! it does. Names are compared, never used as paths. Knows no format of resin jobs.
use super::directory::{self, DirectoryError, Entry};
use flate2::Crc;
use flate2::read::DeflateDecoder;
use rustc_hash::FxHashMap;
use std::io::{Read, Seek, SeekFrom};

/// Most bytes of one entry, unpacked. A picture of 16,384 × 16,384 px that a slicer
/// wrote is far below; only noise is above.
pub const MAX_ENTRY_BYTES: u64 = 64 << 20;

/// Why an archive, or an entry of it, cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ArchiveError {
    /// It does not begin as a zip archive.
    #[error(
        "not a zip archive: it begins with {begins:02x?} instead of \"PK\"; give a .sl1 or .nanodlp file as the slicer wrote it"
    )]
    NotZip {
        /// Its first bytes, at most four.
        begins: Vec<u8>,
    },
    /// Its directory is damaged, or not one of a resin job.
    #[error(transparent)]
    Directory(#[from] DirectoryError),
    /// Two entries of the same name: which one counts is anyone's guess.
    #[error("the archive holds two entries named {name:?}; export the job again")]
    Twice {
        /// Their name.
        name: String,
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
    /// An entry is not as long as announced.
    #[error(
        "{name:?} announces {size} bytes and holds {holds}: damaged, or a zip bomb; export the job again"
    )]
    WrongSize {
        /// Its name.
        name: String,
        /// Bytes that it announces.
        size: u64,
        /// "more" or the bytes found.
        holds: String,
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
    reader: R,
    entries: Vec<Entry>,
    by_name: FxHashMap<Box<str>, usize>,
}

/// Whether a file that begins so is a zip archive, as all resin archives are.
#[must_use]
pub fn is_zip(begins: &[u8]) -> bool {
    // The second is an archive of nothing.
    begins.starts_with(b"PK\x03\x04") || begins.starts_with(b"PK\x05\x06")
}

impl<R: Read + Seek> Archive<R> {
    /// Reads the directory, within the bounds of [`directory`].
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
        let entries = directory::read(&mut reader)?;
        let mut by_name = FxHashMap::default();
        for (index, entry) in entries.iter().enumerate() {
            if by_name.insert(entry.name.clone(), index).is_some() {
                return Err(ArchiveError::Twice { name: entry.name.to_string() });
            }
        }
        let mut order: Vec<&Entry> = entries.iter().collect();
        order.sort_unstable_by_key(|e| e.offset);
        if let Some(w) = order.windows(2).find(|w| w[0].least_end() > w[1].offset) {
            let [one, other] = [w[0].name.to_string(), w[1].name.to_string()];
            return Err(ArchiveError::Overlap { one, other });
        }
        Ok(Archive { reader, entries, by_name })
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
        let Some(entry) = self.entries.get(index) else {
            return Err(ArchiveError::Missing { name: format!("entry {index}") });
        };
        let name = || entry.name.to_string();
        if entry.size > limit {
            return Err(ArchiveError::TooLarge { name: name(), size: entry.size, limit });
        }
        entry.find_content(&mut self.reader).map_err(|why| ArchiveError::Entry { name: name(), why })?;
        let packed = self.reader.by_ref().take(entry.packed);
        // What the entry announces is not trusted with more than a first megabyte.
        let mut bytes = Vec::with_capacity(entry.size.min(1 << 20) as usize);
        let at_most = entry.size.saturating_add(1);
        match entry.method {
            Entry::STORED => packed.take(at_most).read_to_end(&mut bytes),
            _ => DeflateDecoder::new(packed).take(at_most).read_to_end(&mut bytes),
        }
        .map_err(|e| ArchiveError::Entry { name: name(), why: e.to_string() })?;
        if bytes.len() as u64 != entry.size {
            let more = bytes.len() as u64 > entry.size;
            let holds = if more { "more".to_owned() } else { bytes.len().to_string() };
            return Err(ArchiveError::WrongSize { name: name(), size: entry.size, holds });
        }
        let mut crc = Crc::new();
        crc.update(&bytes);
        if crc.sum() != entry.crc {
            return Err(ArchiveError::Entry { name: name(), why: "its checksum is wrong".to_owned() });
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
        check(&lying, &["\"bomb.png\" announces 10 bytes and holds more"]);
        // And one that announces more than it holds.
        let mut short = archive(&[("a", [1; 20])]);
        let directory = last(&short, b"PK\x01\x02");
        short[directory + 24..directory + 28].copy_from_slice(&999_u32.to_le_bytes());
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
        check(&changed(end + 10, &[1, 0]), &["more entries than announced"]);
        check(&changed(end + 10, &[3, 0]), &["damaged at byte"]);
        check(&changed(end + 12, &[255, 255, 255, 0]), &["outside the file"]);
        check(&changed(end + 12, &[255, 255, 255, 15]), &["no resin job"]);
        check(&changed(end + 16, &[0, 1, 0, 0]), &["no entry where one is announced"]);
        check(&changed(end + 4, &[1]), &["archive of several"]);
        check(&changed(first + 8, &[1]), &["\"a.txt\"", "encrypted"]);
        check(&changed(first + 10, &[12]), &["\"a.txt\"", "method 12"]);
        check(&changed(first + 16, &[0; 4]), &["\"a.txt\"", "checksum"]);
        check(&changed(first + 20, &[255; 3]), &["outside the file"]);
        check(&changed(first + 42, &[1]), &["\"a.txt\"", "no header at byte 1"]);
        check(&changed(first + 46, b"b"), &["\"b.txt\"", "another name"]);
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

    #[test]
    fn too_many_entries_are_refused_by_their_number() {
        // A zip64 record that announces 2^40 entries of a directory as large.
        let mut bytes = b"PK\x03\x04".to_vec();
        let at = bytes.len() as u64;
        bytes.extend(b"PK\x06\x06");
        bytes.resize(bytes.len() + 20, 0);
        for figure in [1_u64 << 40, 1 << 40, 1 << 46, 0] {
            bytes.extend(figure.to_le_bytes());
        }
        bytes.extend(b"PK\x06\x07\0\0\0\0");
        bytes.extend(at.to_le_bytes());
        bytes.extend([1, 0, 0, 0]);
        bytes.extend(b"PK\x05\x06\0\0\0\0");
        bytes.extend([0xff; 12]);
        bytes.extend([0, 0]);
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
        let at = bytes.len() as u64;
        bytes.extend(b"PK\x06\x06");
        bytes.resize(bytes.len() + 20, 0);
        for figure in [1, 1, entry.len() as u64, directory as u64] {
            bytes.extend(figure.to_le_bytes());
        }
        bytes.extend(b"PK\x06\x07\0\0\0\0");
        bytes.extend(at.to_le_bytes());
        bytes.extend([1, 0, 0, 0]);
        bytes.extend(b"PK\x05\x06\0\0\0\0");
        bytes.extend([0xff; 12]);
        bytes.extend([0, 0]);
        assert_eq!(open(&bytes).expect("an archive").read_named("a", 9).expect("read"), [1; 9]);
    }
}
