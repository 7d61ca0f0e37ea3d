//! A job file that must not change: its digest, and a reader that gives out nothing
//! that differs.
//!
//! Takes anything that can be read. [`Scan`] sums up a file while something else reads
//! it for the first time; [`Verified`] reads it again, chunk by chunk, and gives a
//! chunk's bytes out only when they are those of the first reading. Works on the
//! file's raw bytes, below whatever decodes them. Memory: one chunk, 64 KiB up to
//! files of 256 MiB. Knows no file system and no G-code.
use super::record::{Accepted, Digest};
use crate::printer::job_file::Checked;
use sha2::{Digest as _, Sha256};
use std::io::{self, Read, Seek, SeekFrom};

/// Smallest chunk: what is verified at once.
pub const MIN_CHUNK_BYTES: u32 = 64 * 1024;

/// Chunks of a file at most: 64 KiB of digests in the journal. A larger file has larger
/// chunks.
pub const MAX_CHUNKS: usize = 4096;

/// Largest chunk, and with it the largest file: 64 GiB. No slicer comes near.
pub const MAX_CHUNK_BYTES: u32 = 16 << 20;

/// What a file's bytes sum up to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Sums {
    /// SHA-256 of all bytes.
    pub digest: Digest,
    /// Bytes.
    pub bytes: u64,
    /// Bytes of a chunk, the last may be shorter.
    pub chunk_bytes: u32,
    /// The first 16 bytes of the SHA-256 of each chunk.
    pub chunks: Vec<[u8; 16]>,
}

/// Bytes of a chunk in a file of so many; `None`: the file is too large.
fn chunk_bytes(bytes: u64) -> Option<u32> {
    let mut chunk = MIN_CHUNK_BYTES;
    while bytes.div_ceil(u64::from(chunk)) > MAX_CHUNKS as u64 {
        chunk = chunk.checked_mul(2).filter(|chunk| *chunk <= MAX_CHUNK_BYTES)?;
    }
    Some(chunk)
}

fn short(hasher: Sha256) -> [u8; 16] {
    let whole: Digest = hasher.finalize().into();
    let mut short = [0; 16];
    short.copy_from_slice(&whole[..16]);
    short
}

/// A number that differs for a file that was written to: the first 8 bytes of the
/// SHA-256 of `parts`, which are whatever the file system tells of it; never 0.
pub fn stamp(parts: &[i128]) -> u64 {
    let mut hasher = Sha256::new();
    parts.iter().for_each(|part| hasher.update(part.to_le_bytes()));
    let whole: Digest = hasher.finalize().into();
    let (first, _) = whole.split_first_chunk().unwrap_or((&[1; 8], &[]));
    u64::from_le_bytes(*first).max(1)
}

/// Sums up a file while it is read.
#[derive(Debug)]
pub struct Scan<R> {
    file: R,
    whole: Sha256,
    chunk: Sha256,
    in_chunk: u32,
    sums: Sums,
    expected: u64,
}

impl<R: Read> Scan<R> {
    /// Over a file of `bytes` bytes, from its first.
    ///
    /// # Errors
    /// It is larger than any that is printed ([`MAX_CHUNK_BYTES`]).
    pub fn new(file: R, bytes: u64) -> io::Result<Self> {
        let Some(chunk_bytes) = chunk_bytes(bytes) else {
            return Err(io::Error::other("it is larger than 64 GiB"));
        };
        let sums = Sums { digest: Digest::default(), bytes: 0, chunk_bytes, chunks: Vec::new() };
        Ok(Self { file, whole: Sha256::new(), chunk: Sha256::new(), in_chunk: 0, sums, expected: bytes })
    }

    /// Reads what is left, and gives the sums.
    ///
    /// # Errors
    /// The reader's; or the file is not as long as it was said to be: it is being
    /// written to.
    pub fn finish(mut self) -> io::Result<Sums> {
        io::copy(&mut self, &mut io::sink())?;
        if self.sums.bytes != self.expected {
            return Err(io::Error::other("the file was changed while it was checked"));
        }
        if self.in_chunk > 0 {
            self.sums.chunks.push(short(std::mem::take(&mut self.chunk)));
        }
        self.sums.digest = self.whole.finalize().into();
        Ok(self.sums)
    }

    fn see(&mut self, mut bytes: &[u8]) {
        self.whole.update(bytes);
        self.sums.bytes += bytes.len() as u64;
        while !bytes.is_empty() {
            let room = (self.sums.chunk_bytes - self.in_chunk) as usize;
            let (now, later) = bytes.split_at(room.min(bytes.len()));
            self.chunk.update(now);
            self.in_chunk += now.len() as u32;
            if self.in_chunk == self.sums.chunk_bytes {
                self.sums.chunks.push(short(std::mem::take(&mut self.chunk)));
                self.in_chunk = 0;
            }
            bytes = later;
        }
    }
}

impl<R: Read> Read for Scan<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let len = self.file.read(buffer)?;
        // A file that grows without end shall not grow the list of chunks.
        if self.sums.bytes + len as u64 > self.expected {
            return Err(io::Error::other("the file was changed while it was checked"));
        }
        self.see(&buffer[..len]);
        Ok(len)
    }
}

/// Gives a file's bytes as they were accepted, or an error before the first that
/// differs. What was added behind the accepted end is not read: the job is printed as it
/// was accepted.
#[derive(Debug)]
pub struct Verified<R> {
    file: R,
    bytes: u64,
    chunk_bytes: u32,
    chunks: Vec<[u8; 16]>,
    /// Where the next byte is given out.
    at: u64,
    /// Where the file stands: always at a chunk's beginning, or its end.
    stands: u64,
    /// The current chunk, and where it begins.
    chunk: Vec<u8>,
    begins: u64,
    /// Once an error was told, nothing more is given out.
    failed: bool,
}

impl<R: Read> Verified<R> {
    /// Over the file from its first byte.
    pub fn new(file: R, sums: Sums) -> Self {
        Self {
            file,
            bytes: sums.bytes,
            chunk_bytes: sums.chunk_bytes,
            chunks: sums.chunks,
            at: 0,
            stands: 0,
            chunk: Vec::new(),
            begins: 0,
            failed: false,
        }
    }

    /// What of the current chunk lies ahead.
    fn ahead(&self) -> &[u8] {
        let from = self.at.checked_sub(self.begins).and_then(|from| usize::try_from(from).ok());
        from.and_then(|from| self.chunk.get(from..)).unwrap_or_default()
    }

    /// Reads and verifies the chunk where the file stands.
    fn fill(&mut self) -> io::Result<()> {
        self.chunk.clear();
        let changed = || {
            io::Error::new(
                io::ErrorKind::InvalidData,
                "the file was changed since the job was accepted; print it as a new job",
            )
        };
        if std::mem::replace(&mut self.failed, true) {
            return Err(changed());
        }
        let which = usize::try_from(self.stands / u64::from(self.chunk_bytes)).map_err(|_| changed())?;
        let expect = *self.chunks.get(which).ok_or_else(changed)?;
        let len = (self.bytes - self.stands).min(u64::from(self.chunk_bytes));
        let got = (&mut self.file).take(len).read_to_end(&mut self.chunk);
        if got.is_err() || short(Sha256::new_with_prefix(&self.chunk)) != expect {
            self.chunk.clear();
            return Err(got.err().unwrap_or_else(changed));
        }
        self.failed = false;
        self.begins = self.stands;
        self.stands += len;
        Ok(())
    }
}

impl<R: Read> Read for Verified<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.at >= self.bytes {
            return Ok(0);
        }
        if self.ahead().is_empty() {
            self.fill()?;
        }
        let ready = self.ahead();
        let len = ready.len().min(buffer.len());
        buffer[..len].copy_from_slice(&ready[..len]);
        self.at += len as u64;
        Ok(len)
    }
}

impl<R: Read + Seek> Seek for Verified<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => Some(at),
            SeekFrom::End(by) => self.bytes.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        let at = at.ok_or_else(|| io::Error::from(io::ErrorKind::InvalidInput))?;
        self.at = at;
        let chunk = u64::from(self.chunk_bytes);
        let next = match self.ahead().is_empty() {
            true => at.min(self.bytes) / chunk * chunk,
            // It follows the one that is there.
            false => self.begins + self.chunk.len() as u64,
        };
        if next != self.stands {
            self.stands = next;
            self.file.seek(SeekFrom::Start(next))?;
        }
        Ok(at)
    }
}

impl Accepted {
    /// What its file must sum up to.
    pub fn sums(&self) -> Sums {
        Sums {
            digest: self.digest,
            bytes: self.bytes,
            chunk_bytes: self.chunk_bytes,
            chunks: self.chunks.clone(),
        }
    }

    /// What the check of its file found, as far as a second reading needs it.
    pub fn checked(&self) -> Checked {
        Checked {
            lines: self.last_line,
            commands: self.commands,
            last_command: self.last_line,
            shortened: 0,
            bytes: 0,
        }
    }
}

#[cfg(test)]
mod tests;
