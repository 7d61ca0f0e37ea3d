//! Resin jobs: an image a layer, and how long each is exposed.
//!
//! Takes the bytes of an archive, gives a job whose images can be read one at a
//! time. Knows no layer of polygons and no file system.
//!
//! # Layout
//! - [`job`]: a job as types, and why one cannot be read
//! - [`archive`]: a zip within bounds, read and written; alone names the zip crate;
//!   [`bounds`]: what is opened at all
//! - [`image`]: a picture's rows, read and packed; alone names the PNG crate here
//! - [`rewrite`]: a job written anew, with pictures changed
//! - `sl1`, `nanodlp`: the formats, one a file
pub mod archive;
pub mod bounds;
pub mod image;
pub mod job;
mod nanodlp;
pub mod rewrite;
mod sl1;
#[cfg(test)]
pub(crate) mod testing;

use archive::Archive;
use job::{Job, JobError};
use std::io::{Read, Seek};

/// Opens a job, whatever its file is called: the archive's entries tell its format.
///
/// Reads the directory, the settings and the first picture's header. The reader should
/// be buffered.
///
/// # Errors
/// The file is no archive or a damaged one, no resin job, or its settings are missing
/// or cannot be right; the message says what and where.
pub fn open<R: Read + Seek>(reader: R) -> Result<Job<R>, JobError> {
    let archive = Archive::open(reader)?;
    if archive.find(sl1::CONFIG).is_some() {
        return sl1::open(archive);
    }
    if nanodlp::MARKS.iter().any(|mark| archive.find(mark).is_some()) {
        return nanodlp::open(archive);
    }
    Err(JobError::UnknownFormat { first: archive.names().take(3).map(str::to_owned).collect() })
}
