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
    begins.starts_with(b"PK\x03\x04")
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
