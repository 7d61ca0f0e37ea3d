//! What may be wrong with binary G-code, where, and what the user can do.
use super::header::Kind;

/// A fault, and where it lies.
#[derive(Debug, thiserror::Error)]
#[error("binary G-code, block {block} (from byte {byte}): {fault}")]
pub struct Error {
    /// Number of the block, from 1; 0 is the file's header.
    pub block: u32,
    /// Where in the file the block begins.
    pub byte: u64,
    /// What is wrong.
    pub fault: Fault,
}

/// What is wrong.
#[derive(Debug, thiserror::Error)]
pub enum Fault {
    /// The reader failed.
    #[error("cannot be read: {0}")]
    Read(#[source] std::io::Error),
    /// The file does not begin with [`super::MAGIC`].
    #[error("does not begin with GCDE: this is no binary G-code")]
    Magic,
    /// A version of the format that is not known.
    #[error("version {0} of the format is not known (1 is): export the job as text G-code")]
    Version(u32),
    /// A kind of checksum that is not known.
    #[error("checksums of kind {0} are not known: export the job as text G-code")]
    ChecksumKind(u16),
    /// A compression that is not known.
    #[error("compression {0} is not known: export the job as text G-code, or the file is damaged")]
    Compression(u16),
    /// An encoding of G-code that is not known.
    #[error("G-code encoding {0} is not known: export the job as text G-code, or the file is damaged")]
    Encoding(u16),
    /// The length of a block of unknown kind cannot be told.
    #[error("a block of kind {0} is not known, and where it ends cannot be told: export the job as text")]
    UnknownKind(u16),
    /// The file ends within the block.
    #[error("the file ends within the block: it was cut off, export it or copy it again")]
    Truncated,
    /// The checksum does not match.
    #[error("the checksum is wrong: the file is damaged, export it or copy it again")]
    Checksum,
    /// A block announces more than any slicer writes.
    #[error(
        "announces {size} bytes, more than the {limit} that a {kind} block may have: the file is damaged"
    )]
    TooLarge {
        /// Of which kind.
        kind: Kind,
        /// What the header says, bytes.
        size: u32,
        /// What is taken, bytes.
        limit: u32,
    },
    /// Less or more than announced came out, or nothing that can be unpacked.
    #[error(
        "does not unpack to the {expected} bytes that it announces: the file is damaged, export it again"
    )]
    Unpack {
        /// What the header says, bytes.
        expected: u32,
    },
    /// The text has a byte that MeatPack cannot hold.
    #[error("MeatPack cannot hold the byte 255 of a line: export the job as text G-code")]
    Unpackable,
    /// A line longer than a block.
    #[error("a line of {0} bytes does not fit into a block")]
    LongLine(usize),
    /// What was written does not read back: a mistake of ours, found before it did harm.
    #[error("what was written does not read back as the same text: please report this file")]
    Mismatch,
}

impl From<Error> for std::io::Error {
    /// The reader's own error as it was; all else as invalid data, with the
    /// [`Error`] inside (see [`damage`]).
    fn from(error: Error) -> Self {
        match error.fault {
            Fault::Read(source) => source,
            _ => std::io::Error::new(std::io::ErrorKind::InvalidData, error),
        }
    }
}

/// What is wrong with the container, when that is why reading its text failed.
#[must_use]
pub fn damage(error: &std::io::Error) -> Option<&Error> {
    error.get_ref().and_then(|inner| inner.downcast_ref())
}
