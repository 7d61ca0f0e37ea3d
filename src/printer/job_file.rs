//! A G-code file as a source of lines: checked whole before the first is sent.
//!
//! Takes anything that can be read, text or binary G-code, gives commands with
//! their line numbers, in bounded memory whatever the file holds. [`check`] goes through all of it as
//! [`Reader`] later will, so that a line which cannot be sent is found before the
//! heaters are on. Does not know printers' answers or terminals.
use super::source::{JobLine, Source, SourceError};
use outrigger_gcode::bgcode::{Text, text};
use outrigger_gcode::checksum::{fit, sendable};
use std::io::{BufReader, Read};
use thiserror::Error;

/// Longest command kept. Klipper takes commands without limit, and its object
/// outlines have some kilobytes; comments may be longer.
pub const MAX_COMMAND_BYTES: usize = 64 * 1024;

/// Bytes read at once.
const CHUNK_BYTES: usize = 64 * 1024;

/// Our own lines before the job's first (M115, M155, M105): its lines begin at
/// this number, which counts in their length.
const FIRST_JOB_NUMBER: u32 = 4;

/// What is wrong with a job file.
#[derive(Debug, Error)]
pub enum JobError {
    /// The system cannot read it.
    #[error("cannot read it{}: {source}", after(*.line))]
    Read {
        /// The last line that was read.
        line: u64,
        /// What the system said.
        source: std::io::Error,
    },
    /// Another kind of file.
    #[error("this is {what}, not G-code: {advice}")]
    NotGcode {
        /// What it is.
        what: &'static str,
        /// What to do.
        advice: &'static str,
    },
    /// Bytes that no G-code has.
    #[error("line {line} holds binary data: this is no G-code file, or it is damaged")]
    Binary {
        /// Line of the file, from 1.
        line: u64,
    },
    /// No command in it.
    #[error("there is no command in it")]
    Empty,
    /// A line that the firmware would cut.
    #[error(
        "line {line} is {framed_len} characters with its number and checksum, but this printer's \
         firmware takes {max_line}: shorten it, or choose a profile without the limit (such as \
         one for Klipper) if your firmware has none"
    )]
    LineTooLong {
        /// Line of the file, from 1.
        line: u64,
        /// Characters of the framed line.
        framed_len: usize,
        /// What the firmware takes.
        max_line: usize,
    },
    /// A command beyond all measure.
    #[error("line {line} has more than {MAX_COMMAND_BYTES} bytes before its end or comment")]
    LineTooBig {
        /// Line of the file, from 1.
        line: u64,
    },
}

fn after(line: u64) -> String {
    match line {
        0 => String::new(),
        n => format!(" after line {n}"),
    }
}

/// What the beginning of a file says it is.
const MAGICS: [(&[u8], &str, &str); 4] = [
    (b"\x1f\x8b", "a gzip file", "unpack it first (gunzip)"),
    (b"PK\x03\x04", "a zip file (3MF, SL1 or an archive)", "slice it or unpack it first"),
    (b"\x7fELF", "a program", "name the sliced file"),
    (b"%PDF", "a PDF file", "name the sliced file"),
];

/// What a whole file holds, from [`check`].
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq)]
pub struct Checked {
    /// Lines, with and without a command.
    pub lines: u64,
    /// Lines that will be sent.
    pub commands: u64,
    /// Number of the last of these: what follows are comments (settings,
    /// thumbnails), so this line is the job's end.
    pub last_command: u64,
    /// Messages (M117, M118) that will be shortened.
    pub shortened: u64,
    /// Bytes.
    pub bytes: u64,
}

/// Reads all of a file and finds what would stop the job: the first line that is
/// too long for `max_line` (characters, framed), binary data, no command at all.
///
/// `each` sees every line's number and its bytes, comments included (their first
/// 64 KiB), for what else the caller wants to know of the file.
pub fn check(
    file: impl Read,
    max_line: Option<usize>,
    mut each: impl FnMut(u64, &[u8]),
) -> Result<Checked, JobError> {
    let mut lines = Lines::new(file);
    let mut scratch = Vec::new();
    let mut checked = Checked { lines: 0, commands: 0, last_command: 0, shortened: 0, bytes: 0 };
    while let Some((number, line)) = lines.next_line()? {
        each(number, line);
        let Some(command) = sendable(line, &mut scratch) else {
            continue;
        };
        let n = u32::try_from(checked.commands).unwrap_or(u32::MAX);
        let n = n.saturating_add(FIRST_JOB_NUMBER);
        let fitted = fit(n, command, max_line).map_err(|e| JobError::LineTooLong {
            line: number,
            framed_len: e.framed_len,
            max_line: e.max_line,
        })?;
        checked.shortened += u64::from(fitted.len() < command.len());
        checked.commands += 1;
        checked.last_command = number;
    }
    checked.lines = lines.number;
    checked.bytes = lines.bytes;
    match checked.commands {
        0 => Err(JobError::Empty),
        _ => Ok(checked),
    }
}

/// The second reading: gives the lines that were checked.
#[derive(Debug)]
pub struct Reader<R, F> {
    lines: Lines<R>,
    each: F,
    scratch: Vec<u8>,
    command: Vec<u8>,
    /// What the check saw. Fewer bytes now mean that the file was cut since.
    expected: Checked,
}

impl<R: Read, F: FnMut(u64, &[u8])> Reader<R, F> {
    /// Reads the file again, which [`check`] has found to be as `expected`;
    /// `each` sees every line as it is read.
    pub fn new(file: R, expected: Checked, each: F) -> Self {
        Self { lines: Lines::new(file), each, scratch: Vec::new(), command: Vec::new(), expected }
    }
}

impl<R: Read, F: FnMut(u64, &[u8])> Source for Reader<R, F> {
    fn advance(&mut self) -> Result<bool, SourceError> {
        loop {
            let read = match self.lines.next_line() {
                Ok(Some((number, line))) => {
                    (self.each)(number, line);
                    sendable(line, &mut self.scratch).map(|command| {
                        self.command.clear();
                        self.command.extend_from_slice(command);
                    })
                }
                Ok(None) => return self.end().map(|()| false),
                Err(e) => return Err(self.error(e.to_string())),
            };
            // What was appended since the check was not checked.
            if self.lines.number > self.expected.lines {
                return Ok(false);
            }
            if read.is_some() {
                return Ok(true);
            }
        }
    }

    fn line(&self) -> JobLine<'_> {
        JobLine { command: &self.command, number: self.lines.number }
    }
}

impl<R, F> Reader<R, F> {
    fn end(&self) -> Result<(), SourceError> {
        if self.lines.bytes < self.expected.bytes {
            let reason = "the file has become shorter since it was checked";
            return Err(self.error(reason.to_owned()));
        }
        Ok(())
    }

    fn error(&self, reason: String) -> SourceError {
        SourceError { line: self.lines.number, reason }
    }
}

/// Lines of a file, without their ends, in bounded memory.
#[derive(Debug)]
struct Lines<R> {
    file: Text<BufReader<R>>,
    chunk: Vec<u8>,
    at: usize,
    end: usize,
    current: Vec<u8>,
    number: u64,
    bytes: u64,
}

impl<R: Read> Lines<R> {
    fn new(file: R) -> Self {
        Self {
            file: text(BufReader::with_capacity(CHUNK_BYTES, file)),
            chunk: vec![0; CHUNK_BYTES],
            at: 0,
            end: 0,
            current: Vec::with_capacity(256),
            number: 0,
            bytes: 0,
        }
    }

    /// The next line and its number, from 1.
    fn next_line(&mut self) -> Result<Option<(u64, &[u8])>, JobError> {
        self.current.clear();
        let mut whole = false;
        let mut any = false;
        while !whole {
            if self.at == self.end && !self.fill()? {
                break;
            }
            any = true;
            let rest = &self.chunk[self.at..self.end];
            let len = match memchr::memchr(b'\n', rest) {
                Some(len) => {
                    whole = true;
                    self.at += len + 1;
                    len
                }
                None => {
                    self.at = self.end;
                    rest.len()
                }
            };
            let room = MAX_COMMAND_BYTES - self.current.len();
            self.current.extend_from_slice(&rest[..len.min(room)]);
            // The rest of a long comment is of no use; a long command is an error.
            if len > room && memchr::memchr(b';', &self.current).is_none() {
                return Err(JobError::LineTooBig { line: self.number + 1 });
            }
        }
        if !any {
            return Ok(None);
        }
        self.number += 1;
        if self.number == 1 && self.current.starts_with(b"\xef\xbb\xbf") {
            // A byte order mark, as some Windows editors put it.
            self.current.drain(..3);
        }
        self.refuse_binary()?;
        Ok(Some((self.number, &self.current)))
    }

    /// A NUL, or a command that begins with no printable ASCII character.
    fn refuse_binary(&self) -> Result<(), JobError> {
        let first = self.current.iter().find(|b| !b.is_ascii_whitespace());
        let odd = first.is_some_and(|b| !b.is_ascii_graphic());
        if odd || memchr::memchr(0, &self.current).is_some() {
            return Err(JobError::Binary { line: self.number });
        }
        Ok(())
    }

    /// Reads the next chunk; `false` at the end.
    fn fill(&mut self) -> Result<bool, JobError> {
        let first = self.bytes == 0;
        self.at = 0;
        self.end = 0;
        // The first bytes tell the kind of file: wait for enough of them.
        let enough = if first { 4 } else { 1 };
        while self.end < enough {
            match self.file.read(&mut self.chunk[self.end..]) {
                Ok(0) => break,
                Ok(len) => self.end += len,
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(source) => {
                    return Err(JobError::Read { line: self.number, source });
                }
            }
        }
        self.bytes += self.end as u64;
        if first {
            let head = &self.chunk[..self.end];
            if let Some((_, what, advice)) = MAGICS.iter().find(|m| head.starts_with(m.0)) {
                return Err(JobError::NotGcode { what, advice });
            }
        }
        Ok(self.end > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read_all(bytes: &[u8], expected: Checked) -> Result<Vec<(u64, String)>, SourceError> {
        let mut reader = Reader::new(bytes, expected, |_, _| {});
        let mut got = Vec::new();
        while reader.advance()? {
            let line = reader.line();
            let text = String::from_utf8_lossy(line.command).into_owned();
            got.push((line.number, text));
        }
        Ok(got)
    }

    #[test]
    fn gives_commands_with_their_line_numbers() {
        let check_file = |text: &str, expect: &[(u64, &str)]| {
            let checked = check(text.as_bytes(), Some(95), |_, _| {}).unwrap();
            assert_eq!(checked.commands as usize, expect.len());
            assert_eq!(Some(checked.last_command), expect.last().map(|e| e.0));
            assert_eq!(checked.bytes as usize, text.len());
            let got = read_all(text.as_bytes(), checked).unwrap();
            let got: Vec<_> = got.iter().map(|(n, c)| (*n, c.as_str())).collect();
            assert_eq!(got, expect);
        };
        check_file("G28\nG1 X1\n", &[(1, "G28"), (2, "G1 X1")]);
        check_file("; a\r\n\r\nG28 ; home\r\nG1 X1", &[(3, "G28"), (4, "G1 X1")]);
        check_file("\u{feff}G28\n", &[(1, "G28")]);
        check_file("N5 G28*99\n\nN6 G1 X1*3\n", &[(1, "G28"), (3, "G1 X1")]);
        let comment = format!("G28 ;{}\nG1 X1\n", "x".repeat(300_000));
        check_file(&comment, &[(1, "G28"), (2, "G1 X1")]);
    }

    #[test]
    fn refuses_what_cannot_be_printed() {
        let check_file = |bytes: &[u8], expect: &str| {
            let error = check(bytes, Some(95), |_, _| {}).unwrap_err().to_string();
            assert!(error.contains(expect), "{error}");
        };
        check_file(b"GCDE\x01\0\0\0", "cannot read it: binary G-code, block 0");
        check_file(b"\x1f\x8b\x08", "gzip");
        check_file(b"PK\x03\x04", "zip");
        check_file(b"", "no command");
        check_file(b"; nothing\n\n", "no command");
        check_file(b"G28\nG1 X\0\n", "line 2 holds binary");
        check_file(b"G28\n\xff\xfe\x01\n", "line 2 holds binary");
        check_file(&[b'G'; 200_000], "line 1 has more than");
        let long = format!("G28\n; c\nG1 X{}\n", "1".repeat(100));
        check_file(long.as_bytes(), "line 3 is 111 characters");
    }

    #[test]
    fn the_limit_is_exact() {
        let framed = |len: usize| format!("G1 X{}\n", "1".repeat(len - 4));
        // `N4 ` and `*123` are 7 characters.
        assert!(check(framed(88).as_bytes(), Some(95), |_, _| {}).is_ok());
        assert!(check(framed(89).as_bytes(), Some(95), |_, _| {}).is_err());
        assert!(check(framed(5000).as_bytes(), None, |_, _| {}).is_ok());
    }

    #[test]
    fn notices_a_file_that_changed() {
        let whole = b"G28\nG1 X1\nG1 X2\n";
        let checked = check(&whole[..], Some(95), |_, _| {}).unwrap();
        let error = read_all(&whole[..10], checked).unwrap_err();
        assert_eq!(error.line, 2);
        assert!(error.reason.contains("shorter"));
        let longer = b"G28\nG1 X1\nG1 X2\nM112\n";
        assert_eq!(read_all(longer, checked).unwrap().len(), 3);
    }

    proptest! {
        #[test]
        fn no_file_panics(bytes: Vec<u8>) {
            if let Ok(checked) = check(&bytes[..], Some(95), |_, _| {}) {
                let lines = read_all(&bytes, checked).unwrap();
                prop_assert_eq!(lines.len() as u64, checked.commands);
            }
        }
    }
}
