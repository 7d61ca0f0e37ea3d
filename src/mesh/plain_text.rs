//! ASCII STL as programs write it, made plain for a strict parser.
//!
//! Takes the lines of a file, gives one solid: lower case, `\n` at the ends, no
//! blank lines, no names, no normals, no `solid` and `endsolid` in between, and
//! nothing after the end. Counts the lines, and hands on one at a time: so the line
//! last handed on is the one that a parser finds fault with. Does not look at the
//! numbers of corners.
use std::cell::Cell;
use std::io::{BufRead, Error, ErrorKind, Read, Result, Seek, SeekFrom};

/// Longest line, bytes; a facet's longest has some 60, names have their own line.
const LINE_BYTES_MAX: usize = 4096;

/// One solid of plain lines, whatever the file has.
pub(super) struct PlainLines<'a, R> {
    input: R,
    /// Number of the line last handed on, from 1.
    line: &'a Cell<u64>,
    /// Whether the last lines began a facet that has not ended.
    inside: &'a Cell<bool>,
    /// What is still to be handed on.
    pending: Vec<u8>,
    handed_on: usize,
    raw: Vec<u8>,
    /// The line before ended with a carriage return: a line feed that follows belongs to it.
    returned: bool,
    stage: Stage,
    trailing: u64,
    endsolid_missing: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// The first line, which is ours, has not been asked for.
    Begin,
    /// Within a solid, or before the first.
    Solid,
    /// After `endsolid`: another solid may follow, or nothing that matters.
    Ended,
    /// The last line, which is ours, has been given.
    Done,
}

impl<'a, R: BufRead> PlainLines<'a, R> {
    /// Lines of a file that is read from its beginning.
    pub(super) fn new(input: R, line: &'a Cell<u64>, inside: &'a Cell<bool>) -> Self {
        PlainLines {
            input,
            line,
            inside,
            pending: Vec::new(),
            handed_on: 0,
            raw: Vec::new(),
            returned: false,
            stage: Stage::Begin,
            trailing: 0,
            endsolid_missing: false,
        }
    }

    /// Lines after the last `endsolid` that are neither blank nor a solid's.
    pub(super) fn trailing(&self) -> u64 {
        self.trailing
    }

    /// Whether the file ended within a solid, after a whole facet.
    pub(super) fn endsolid_missing(&self) -> bool {
        self.endsolid_missing
    }

    /// Reads a line into `raw`, without its end; false at the end of the file.
    fn read_line(&mut self) -> Result<bool> {
        self.raw.clear();
        loop {
            let buffer = self.input.fill_buf()?;
            if buffer.is_empty() {
                let some = !self.raw.is_empty();
                self.line.set(self.line.get() + u64::from(some));
                return Ok(some);
            }
            if std::mem::take(&mut self.returned) && buffer[0] == b'\n' {
                self.input.consume(1);
                continue;
            }
            let end = memchr::memchr2(b'\n', b'\r', buffer);
            let part = &buffer[..end.unwrap_or(buffer.len())];
            if self.raw.len() + part.len() > LINE_BYTES_MAX {
                self.line.set(self.line.get() + 1);
                let message = format!("longer than {LINE_BYTES_MAX} bytes, so this is no ASCII STL");
                return Err(Error::new(ErrorKind::InvalidData, message));
            }
            self.raw.extend_from_slice(part);
            let (used, ended) = (part.len() + usize::from(end.is_some()), end.is_some());
            self.returned = end.is_some_and(|at| buffer[at] == b'\r');
            self.input.consume(used);
            if ended {
                self.line.set(self.line.get() + 1);
                return Ok(true);
            }
        }
    }

    /// Puts the next plain line into `pending`; leaves it empty after the last.
    fn advance(&mut self) -> Result<()> {
        self.pending.clear();
        self.handed_on = 0;
        if self.stage == Stage::Begin {
            self.stage = Stage::Solid;
            self.pending.extend_from_slice(b"solid \n");
            return Ok(());
        }
        while self.stage != Stage::Done && self.pending.is_empty() {
            if !self.read_line()? {
                self.endsolid_missing = self.stage == Stage::Solid;
                self.stage = Stage::Done;
                // A facet that has not ended must not look as if the solid had.
                if !self.inside.get() {
                    self.pending.extend_from_slice(b"endsolid\n");
                }
                return Ok(());
            }
            self.plain();
        }
        Ok(())
    }

    /// Makes `raw` plain and puts it into `pending`, where it says anything.
    fn plain(&mut self) {
        let line = self.raw.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&self.raw).trim_ascii();
        let first = line.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        match first.to_ascii_lowercase().as_slice() {
            b"" => (),
            b"solid" if !self.inside.get() => self.stage = Stage::Solid,
            b"endsolid" if !self.inside.get() => self.stage = Stage::Ended,
            b"facet" => {
                self.inside.set(true);
                self.stage = Stage::Solid;
                self.pending.extend_from_slice(b"facet normal 0 0 0\n");
            }
            _ if self.stage == Stage::Ended && !self.inside.get() => self.trailing += 1,
            word => {
                if word == b"endfacet" {
                    self.inside.set(false);
                }
                self.pending.extend(line.iter().map(u8::to_ascii_lowercase));
                self.pending.push(b'\n');
            }
        }
    }
}

impl<R: BufRead> Read for PlainLines<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        if self.handed_on == self.pending.len() {
            self.advance()?;
        }
        let rest = &self.pending[self.handed_on..];
        let some = rest.len().min(buffer.len());
        buffer[..some].copy_from_slice(&rest[..some]);
        self.handed_on += some;
        Ok(some)
    }
}

impl<R: BufRead> Seek for PlainLines<'_, R> {
    /// Back to the beginning, as long as nothing but the first line has been read.
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        if to != SeekFrom::Start(0) || self.line.get() > 0 {
            return Err(Error::from(ErrorKind::Unsupported));
        }
        (self.stage, self.handed_on) = (Stage::Begin, 0);
        self.pending.clear();
        Ok(0)
    }
}
