//! Resin jobs: an image a layer, and how long each is exposed.
//!
//! Takes the bytes of a file, gives a job whose images can be read one at a
//! time. Knows no layer of polygons and no file system.
//!
//! # Layout
//! - [`job`]: a job as types, and why one cannot be read
//! - [`archive`]: a zip within bounds, read and written; alone names the zip crate;
//!   [`bounds`]: what is opened at all
//! - [`image`]: a picture's rows, read and packed; alone names the PNG crate here
//! - [`rewrite`]: a job written anew, with pictures changed; `convert`: in another format
//! - [`preview`]: the picture of the whole part that people see
//! - [`recipe`]: how a job is to be printed, in no format's own words
//! - `sl1`, `nanodlp`, [`goo`]: the formats, one a file
pub mod archive;
pub mod bounds;
mod convert;
pub mod goo;
pub mod image;
pub mod job;
mod nanodlp;
pub mod preview;
pub mod recipe;
pub mod rewrite;
mod sl1;
#[cfg(test)]
pub(crate) mod testing;

use archive::{Archive, ArchiveError};
use job::{Job, JobError};
use std::io::{Read, Seek, SeekFrom};

/// Whether a file that begins so may be a resin job: a zip archive, or GOO. Some
/// [`goo::MARK_BYTES`] bytes are enough.
#[must_use]
pub fn may_be_job(begins: &[u8]) -> bool {
    archive::is_zip(begins) || goo::is_goo(begins)
}

/// Opens a job, whatever its file is called: its first bytes and, in an archive, the
/// entries tell its format.
///
/// Reads the directory, the settings and the first picture's header; of GOO the head and
/// each layer's definition. The reader should be buffered.
///
/// # Errors
/// The file is none of these or a damaged one, no resin job, or its settings are missing
/// or cannot be right; the message says what and where.
pub fn open<R: Read + Seek>(mut reader: R) -> Result<Job<R>, JobError> {
    let mut begins = Vec::new();
    reader.seek(SeekFrom::Start(0)).map_err(ArchiveError::Io)?;
    reader.by_ref().take(goo::MARK_BYTES as u64).read_to_end(&mut begins).map_err(ArchiveError::Io)?;
    if goo::is_goo(&begins) {
        return goo::open(reader);
    }
    let archive = Archive::open(reader)?;
    if archive.find(sl1::CONFIG).is_some() {
        return sl1::open(archive);
    }
    if nanodlp::MARKS.iter().any(|mark| archive.find(mark).is_some()) {
        return nanodlp::open(archive);
    }
    Err(JobError::UnknownFormat { first: archive.names().take(3).map(str::to_owned).collect() })
}
