//! A zip archive that is written: entries copied as they are packed, and new ones.
//!
//! Takes entries in the order in which they are to stand, gives the bytes of an archive
//! to a writer. The same calls give the same bytes: new entries carry no date. Knows no
//! format of resin jobs.
use super::{Archive, ArchiveError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex, PoisonError};
use zip::result::ZipError;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, DateTime, ZipWriter};

/// How a new entry is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packed {
    /// Its bytes as they are.
    Stored,
    /// Deflated, quickly: text, and pictures, which slicers pack twice too.
    Deflated,
}

/// Why an archive cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// The writer refused.
    #[error("{0}")]
    Io(#[from] io::Error),
    /// An entry of the other archive cannot be copied.
    #[error(transparent)]
    Read(#[from] ArchiveError),
    /// What no archive can hold.
    #[error("{name:?} cannot be put into an archive: {why}")]
    Entry {
        /// Its name.
        name: String,
        /// Why not.
        why: String,
    },
}

/// An archive under construction.
#[derive(Debug)]
pub struct ArchiveWriter<W: Write + Seek> {
    zip: ZipWriter<Watched<W>>,
    fault: Fault,
}

impl<W: Write + Seek> ArchiveWriter<W> {
    /// An empty archive.
    pub fn new(out: W) -> ArchiveWriter<W> {
        let fault = Fault::default();
        ArchiveWriter { zip: ZipWriter::new(Watched::new(out, fault.clone())), fault }
    }

    /// Takes over the comment of another archive.
    ///
    /// # Errors
    /// It is too long, which none that was read is.
    pub fn comment<R: Read + Seek>(&mut self, from: &Archive<R>) -> Result<(), WriteError> {
        let set = self.zip.set_raw_comment(from.zip.comment().into());
        self.told("comment", set)
    }

    /// Adds an entry of another archive as it is: its name, its packed bytes, its date
    /// and its extra fields. It is not unpacked; a damaged one stays damaged.
    ///
    /// # Errors
    /// There is no such entry, its bytes cannot be read, or the writer refuses.
    pub fn copy<R: Read + Seek>(&mut self, from: &mut Archive<R>, index: usize) -> Result<(), WriteError> {
        let Some(entry) = from.entries.get(index) else {
            return Err(ArchiveError::Missing { name: format!("entry {index}") }.into());
        };
        let unread = |e: ZipError| match e {
            ZipError::Io(e) => ArchiveError::Io(e),
            e => ArchiveError::Entry { name: entry.name.to_string(), why: e.to_string() },
        };
        let content = from.zip.by_index_raw(index).map_err(unread)?;
        let copied = self.zip.raw_copy_file(content);
        match (copied, self.fault.take()) {
            (_, Some(fault)) => Err(fault.into()),
            (Err(e), None) => Err(unread(e).into()),
            (Ok(()), None) => Ok(()),
        }
    }

    /// Adds a new entry.
    ///
    /// # Errors
    /// The writer refuses, or there is an entry of this name already.
    pub fn add(&mut self, name: &str, bytes: &[u8], packed: Packed) -> Result<(), WriteError> {
        let method = match packed {
            Packed::Stored => CompressionMethod::Stored,
            Packed::Deflated => CompressionMethod::Deflated,
        };
        let options =
            SimpleFileOptions::default().compression_method(method).last_modified_time(DateTime::default());
        let options = if packed == Packed::Deflated { options.compression_level(Some(1)) } else { options };
        let added = self.zip.start_file(name, options);
        let added = added.and_then(|()| Ok(self.zip.write_all(bytes)?));
        self.told(name, added)
    }

    /// Writes the directory and gives the writer back.
    ///
    /// # Errors
    /// The writer refuses.
    pub fn finish(self) -> Result<W, WriteError> {
        let finished = self.zip.finish();
        match (finished, self.fault.take()) {
            (_, Some(fault)) => Err(fault.into()),
            (Err(e), None) => Err(WriteError::Entry { name: "directory".to_owned(), why: e.to_string() }),
            (Ok(watched), None) => Ok(watched.out),
        }
    }

    /// What became of an entry: the writer's own words where it refused.
    fn told(&self, name: &str, added: Result<(), ZipError>) -> Result<(), WriteError> {
        match (added, self.fault.take()) {
            (_, Some(fault)) => Err(fault.into()),
            (Err(e), None) => Err(WriteError::Entry { name: name.to_owned(), why: e.to_string() }),
            (Ok(()), None) => Ok(()),
        }
    }
}

/// The first error of a writer. The zip crate mixes it with errors of what is read, and
/// tries to write again when it is dropped.
#[derive(Clone, Debug, Default)]
struct Fault(Arc<Mutex<Option<io::Error>>>);

impl Fault {
    fn take(&self) -> Option<io::Error> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }
}

/// A writer that keeps its first error, and after it takes everything without writing:
/// what is dropped then says nothing on standard error.
#[derive(Debug)]
struct Watched<W> {
    out: W,
    broken: bool,
    /// Where it stands, and the farthest that it stood: also what it only seemed to take.
    at: u64,
    end: u64,
    fault: Fault,
}

impl<W> Watched<W> {
    /// From the beginning of an empty writer.
    fn new(out: W, fault: Fault) -> Watched<W> {
        Watched { out, broken: false, at: 0, end: 0, fault }
    }

    fn stand(&mut self, at: u64) -> u64 {
        self.at = at;
        self.end = self.end.max(at);
        at
    }

    fn note<T>(&mut self, done: io::Result<T>, otherwise: T) -> io::Result<T> {
        match done {
            Err(e) if e.kind() != io::ErrorKind::Interrupted => {
                self.broken = true;
                *self.fault.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(e);
                Ok(otherwise)
            }
            done => done,
        }
    }
}

impl<W: Write> Write for Watched<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = match self.broken {
            true => Ok(bytes.len()),
            false => self.out.write(bytes),
        };
        let written = match written {
            Ok(0) if !bytes.is_empty() => Err(io::ErrorKind::WriteZero.into()),
            written => written,
        };
        let written = self.note(written, bytes.len())?;
        self.stand(self.at + written as u64);
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.broken {
            return Ok(());
        }
        let flushed = self.out.flush();
        self.note(flushed, ())
    }
}

impl<W: Seek> Seek for Watched<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let seeming = match to {
            SeekFrom::Start(at) => at,
            SeekFrom::Current(by) => self.at.saturating_add_signed(by),
            SeekFrom::End(by) => self.end.saturating_add_signed(by),
        };
        // A buffer writes what it holds before it moves, and may fail at that.
        let moved = if self.broken { Ok(seeming) } else { self.out.seek(to) };
        let at = self.note(moved, seeming)?;
        Ok(self.stand(at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin::testing::{archive, stored};
    use std::io::{BufWriter, Cursor};

    fn entries() -> [(&'static str, Vec<u8>); 3] {
        [("a.txt", b"hello".repeat(50)), ("b/ü.png", vec![7; 300]), ("empty", vec![])]
    }

    fn opened(bytes: Vec<u8>) -> Archive<Cursor<Vec<u8>>> {
        Archive::open(Cursor::new(bytes)).expect("an archive")
    }

    #[test]
    fn a_copy_of_all_entries_is_the_archive() {
        for bytes in [archive(&entries()), stored(&entries())] {
            let mut from = opened(bytes.clone());
            let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
            writer.comment(&from).expect("no comment");
            (0..3).for_each(|i| writer.copy(&mut from, i).expect("copied"));
            assert_eq!(writer.finish().expect("finished").into_inner(), bytes);
        }
    }

    #[test]
    fn what_nobody_here_unpacks_is_copied_too() {
        let mut bytes = stored(&entries());
        // Packed with LZMA, encrypted, and with a comment.
        let directory = bytes.windows(4).position(|w| w == b"PK\x01\x02").expect("a directory");
        (bytes[8], bytes[directory + 10], bytes[6], bytes[directory + 8]) = (14, 14, 1, 1);
        let end = bytes.len() - 2;
        bytes[end] = 2;
        bytes.extend(b"hi");
        let mut from = opened(bytes);
        let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
        writer.comment(&from).expect("a comment");
        let said = writer.copy(&mut from, 0).err().map(|e| e.to_string());
        assert_eq!(said, None);
        writer.copy(&mut from, 1).expect("copied");
        assert!(writer.finish().expect("finished").into_inner().ends_with(b"\x02\0hi"));
    }

    #[test]
    fn new_entries_stand_beside_copied_ones() {
        let make = || {
            let mut from = opened(archive(&entries()));
            let mut writer = ArchiveWriter::new(Cursor::new(Vec::new()));
            writer.add("new.txt", b"new", Packed::Deflated).expect("added");
            writer.copy(&mut from, 1).expect("copied");
            writer.add("new.png", &[1; 99], Packed::Stored).expect("added");
            assert!(matches!(writer.copy(&mut from, 3), Err(WriteError::Read(ArchiveError::Missing { .. }))));
            let twice = writer.add("new.txt", b"", Packed::Stored).expect_err("refused").to_string();
            assert!(twice.contains("\"new.txt\" cannot be put"), "{twice}");
            writer.finish().expect("finished").into_inner()
        };
        let bytes = make();
        assert_eq!(bytes, make(), "the same calls give the same bytes");
        let mut read = opened(bytes);
        assert_eq!(read.names().collect::<Vec<_>>(), ["new.txt", "b/ü.png", "new.png"]);
        let expect: [&[u8]; 3] = [b"new", &[7; 300], &[1; 99]];
        for (i, expect) in expect.into_iter().enumerate() {
            assert_eq!(read.read(i, 1000).expect("an entry"), expect);
        }
    }

    /// A disk with room for some bytes.
    struct Disk(Cursor<Vec<u8>>, usize);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.position() as usize + bytes.len() > self.1 {
                return Err(io::Error::other("the disk is full"));
            }
            self.0.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    impl Seek for Disk {
        fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
            self.0.seek(to)
        }
    }

    #[test]
    fn a_full_disk_is_told_as_such() {
        let bytes = stored(&entries());
        for room in 0..bytes.len() {
            let mut from = opened(bytes.clone());
            let mut writer = ArchiveWriter::new(Disk(Cursor::new(Vec::new()), room));
            let written = (0..3).try_for_each(|i| writer.copy(&mut from, i));
            let said = written.and_then(|()| writer.finish().map(drop)).expect_err("no room").to_string();
            assert_eq!(said, "the disk is full", "{room}");

            // Behind a buffer, which fails when it is moved.
            let mut writer = ArchiveWriter::new(BufWriter::new(Disk(Cursor::new(Vec::new()), room)));
            let written = (0..3).try_for_each(|i| writer.add(&i.to_string(), &[7; 9], Packed::Stored));
            let Err(e) = written.and_then(|()| writer.finish()?.flush().map_err(WriteError::Io)) else {
                continue;
            };
            assert_eq!(e.to_string(), "the disk is full", "{room}");
        }
    }
}
