//! STL files, binary and ASCII, as triangles: the one place that names `stl_io`.
//!
//! Takes the bytes of a file, gives its triangles one by one and a [`Source`] that
//! says what the file was. What stands in the way of `stl_io` (a binary file that
//! begins with "solid", upper case, several solids …) is put right on the way in.
//! The normals of the file are not read: those that follow from the order of the
//! corners are what every slicer goes by. Knows no mesh.
use super::plain_text::PlainLines;
use super::vector::{cross, length, sub};
use serde::Serialize;
use std::cell::Cell;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom, Write};

/// Bytes before the first triangle of a binary file: a header of 80, a count of 4.
const HEAD_BYTES: u64 = 84;

/// Bytes of a triangle in a binary file: a normal, three corners, two attribute bytes.
const TRIANGLE_BYTES: u64 = 50;

/// Most triangles that are read. A file of as many has 500 MB, its mesh with all
/// that mending needs some 1.5 GB: what a Pi of 2 GB can just bear.
pub const MAX_TRIANGLES: u64 = 10_000_000;

/// Fewest bytes of a facet in an ASCII file: its words and nine one-digit numbers.
const FACET_TEXT_BYTES: u64 = 70;

/// Bytes at the beginning by which ASCII and binary are told apart.
const SAMPLE_BYTES: u64 = 1024;

/// How a file was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// 50 bytes a triangle.
    Binary,
    /// Text.
    Ascii,
}

/// What a file was.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Source {
    /// How it was written.
    pub format: Format,
    /// Triangles in it.
    pub triangles: u64,
    /// Bytes (binary) or lines (ASCII) after the last triangle that were left out.
    pub trailing: u64,
    /// An ASCII file ended without `endsolid`, at the end of a facet: it may be cut short.
    pub endsolid_missing: bool,
}

/// A triangle's corners, mm, counter-clockwise from outside.
pub type Triangle = [[f32; 3]; 3];

/// Writes triangles as a binary STL file, with the normals that follow from their corners.
///
/// # Errors
/// The writer's own.
pub fn write(out: &mut impl Write, triangles: &[Triangle]) -> std::io::Result<()> {
    let triangle = |t: &Triangle| {
        let [a, b, c] = t.map(|p| p.map(f64::from));
        let n = cross(sub(b, a), sub(c, a));
        let long = length(n);
        let n = if long > 0.0 { n.map(|c| (c / long) as f32) } else { [0.0; 3] };
        stl_io::Triangle { normal: stl_io::Normal::new(n), vertices: t.map(stl_io::Vertex::new) }
    };
    stl_io::write_stl(out, triangles.iter().map(triangle))
}

/// Why a file is no STL, or none that can be read.
#[derive(Debug, thiserror::Error)]
pub enum StlError {
    /// The file cannot be read.
    #[error("cannot read: {0}")]
    Read(#[source] std::io::Error),
    /// Neither kind of STL.
    #[error(
        "no STL file: it has {bytes} bytes and does not begin with \"solid\"; a binary STL has at least {HEAD_BYTES}"
    )]
    TooShort {
        /// Its length.
        bytes: u64,
    },
    /// A binary file ends before its last triangle, or is none.
    #[error(
        "the file is cut short or is no STL: its header promises {promised} triangles ({} bytes), but it has \
         {bytes} bytes, enough for {}; copy or export it again",
        HEAD_BYTES + promised * TRIANGLE_BYTES,
        (bytes - HEAD_BYTES) / TRIANGLE_BYTES
    )]
    Truncated {
        /// Triangles that the header promises.
        promised: u64,
        /// Length of the file.
        bytes: u64,
    },
    /// Binary, the count is zero and yet triangles follow.
    #[error(
        "the header says that there are no triangles, but {bytes} bytes follow, enough for {}: the program \
         that wrote the file did not finish; export it again",
        bytes / TRIANGLE_BYTES
    )]
    NoCount {
        /// Bytes after the header.
        bytes: u64,
    },
    /// Too many triangles to hold.
    #[error("{triangles} triangles, at most {MAX_TRIANGLES} are read; simplify (decimate) the model")]
    TooMany {
        /// Those that the file has, at least.
        triangles: u64,
    },
    /// Not a triangle.
    #[error("no triangles in the file; export the model again")]
    Empty,
    /// A corner of a binary file's triangle is no place.
    #[error(
        "triangle {triangle} has a corner that is no number or infinite ({value}); repair the model in the \
         program that made it and export it again"
    )]
    NotFinite {
        /// Its number in the file, from 1.
        triangle: u64,
        /// The coordinate.
        value: f32,
    },
    /// An ASCII file is not as it should be.
    #[error("line {line}: {message}; export the model again, best as binary STL")]
    Text {
        /// The line, from 1.
        line: u64,
        /// What is wrong there.
        message: String,
    },
    /// An ASCII file ends within a facet.
    #[error(
        "the file is cut short: it ends in line {line} within facet {facet}; copy or export the model again"
    )]
    TextEnds {
        /// The last line, from 1.
        line: u64,
        /// The facet's number, from 1.
        facet: u64,
    },
}

/// Takes what a file holds, triangle by triangle.
pub(super) trait Sink {
    /// About how many triangles will come; already checked against the file's length.
    fn expect(&mut self, triangles: usize);
    /// The next triangle, finite corners in the order of the file.
    fn triangle(&mut self, corners: [[f32; 3]; 3]);
}

/// Reads a whole file.
///
/// Memory is bounded by the length of the file: the count that a header states is
/// believed only when the file is as long.
///
/// # Errors
/// The file cannot be read, is cut short, has no or too many triangles, or a
/// coordinate that is not finite.
pub(super) fn read(input: &mut (impl Read + Seek), sink: &mut impl Sink) -> Result<Source, StlError> {
    let bytes = input.seek(SeekFrom::End(0)).map_err(StlError::Read)?;
    input.seek(SeekFrom::Start(0)).map_err(StlError::Read)?;
    let mut sample = Vec::new();
    input.by_ref().take(SAMPLE_BYTES).read_to_end(&mut sample).map_err(StlError::Read)?;
    input.seek(SeekFrom::Start(0)).map_err(StlError::Read)?;
    let count = sample.get(80..84).map(|c| u64::from(u32::from_le_bytes([c[0], c[1], c[2], c[3]])));
    let exact = count.is_some_and(|n| bytes == HEAD_BYTES + n * TRIANGLE_BYTES);
    if !exact && is_text(&sample) {
        return read_text(input, bytes, sink);
    }
    let Some(promised) = count else { return Err(StlError::TooShort { bytes }) };
    let after = bytes.saturating_sub(HEAD_BYTES);
    match after.checked_sub(promised * TRIANGLE_BYTES) {
        None => Err(StlError::Truncated { promised, bytes }),
        Some(0) if promised == 0 => Err(StlError::Empty),
        Some(_) if promised == 0 && after >= TRIANGLE_BYTES => Err(StlError::NoCount { bytes: after }),
        Some(_) if promised == 0 => Err(StlError::Empty),
        Some(_) if promised > MAX_TRIANGLES => Err(StlError::TooMany { triangles: promised }),
        Some(trailing) => read_binary(input, promised, trailing, sink),
    }
}

/// Whether a file of another length than its count tells is ASCII: it begins with
/// "solid", and the next line with "facet" or "endsolid".
///
/// Many programs begin the header of binary files with "solid" too.
fn is_text(sample: &[u8]) -> bool {
    let sample = sample.strip_prefix(b"\xef\xbb\xbf").unwrap_or(sample);
    let begins =
        |text: &[u8], word: &[u8]| text.len() >= word.len() && text[..word.len()].eq_ignore_ascii_case(word);
    let text = sample.trim_ascii_start();
    if !begins(text, b"solid") {
        return false;
    }
    let Some(end) = memchr::memchr2(b'\n', b'\r', text) else { return !text.contains(&0) };
    let next = text[end..].trim_ascii_start();
    [&b"facet"[..], b"endsolid"].iter().any(|word| begins(next, &word[..word.len().min(next.len())]))
}

fn read_binary(
    input: &mut (impl Read + Seek),
    triangles: u64,
    trailing: u64,
    sink: &mut impl Sink,
) -> Result<Source, StlError> {
    let mut plain = PlainHead { input, at: 0 };
    let reader = stl_io::create_stl_reader(&mut plain).map_err(StlError::Read)?;
    sink.expect(triangles as usize);
    for (number, triangle) in (1..).zip(reader) {
        let corners = triangle.map_err(StlError::Read)?.vertices.map(|v| v.0);
        if let Some(&value) = corners.as_flattened().iter().find(|c| !c.is_finite()) {
            return Err(StlError::NotFinite { triangle: number, value });
        }
        sink.triangle(corners);
    }
    Ok(Source { format: Format::Binary, triangles, trailing, endsolid_missing: false })
}

/// A binary file whose header reads as line ends.
///
/// `stl_io` takes a file that begins with "solid " for ASCII, and to find that out
/// reads up to the first line end, wherever that may be.
struct PlainHead<'a, R> {
    input: &'a mut R,
    at: u64,
}

impl<R: Read> Read for PlainHead<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.input.read(buffer)?;
        let head = 80_u64.saturating_sub(self.at).min(read as u64) as usize;
        buffer[..head].fill(b'\n');
        self.at += read as u64;
        Ok(read)
    }
}

impl<R: Seek> Seek for PlainHead<'_, R> {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        self.at = self.input.seek(to)?;
        Ok(self.at)
    }
}

fn read_text(input: &mut (impl Read + Seek), bytes: u64, sink: &mut impl Sink) -> Result<Source, StlError> {
    let (line, inside) = (Cell::new(0), Cell::new(false));
    let mut plain = PlainLines::new(BufReader::with_capacity(1 << 16, input), &line, &inside);
    let mut triangles = 0;
    {
        let reader = stl_io::create_stl_reader(&mut plain).map_err(|e| text_error(e, &line, &inside, 1))?;
        sink.expect((bytes / FACET_TEXT_BYTES / 4).min(MAX_TRIANGLES) as usize);
        for triangle in reader {
            let triangle = triangle.map_err(|e| text_error(e, &line, &inside, triangles + 1))?;
            triangles += 1;
            if triangles > MAX_TRIANGLES {
                return Err(StlError::TooMany { triangles });
            }
            sink.triangle(triangle.vertices.map(|v| v.0));
        }
    }
    if triangles == 0 {
        return Err(StlError::Empty);
    }
    let (trailing, endsolid_missing) = (plain.trailing(), plain.endsolid_missing());
    Ok(Source { format: Format::Ascii, triangles, trailing, endsolid_missing })
}

fn text_error(error: std::io::Error, line: &Cell<u64>, inside: &Cell<bool>, facet: u64) -> StlError {
    let line = line.get();
    match error.kind() {
        ErrorKind::UnexpectedEof if inside.get() => StlError::TextEnds { line, facet },
        ErrorKind::InvalidData | ErrorKind::UnexpectedEof => {
            StlError::Text { line, message: error.to_string() }
        }
        _ => StlError::Read(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    type Triangles = Vec<[[f32; 3]; 3]>;

    #[derive(Default)]
    struct All(Triangles);

    impl Sink for All {
        fn expect(&mut self, triangles: usize) {
            // What is believed of a count is at most what a file of a megabyte holds.
            assert!(triangles < 1 << 20, "{triangles}");
        }

        fn triangle(&mut self, corners: [[f32; 3]; 3]) {
            self.0.push(corners);
        }
    }

    /// Reads a file: its triangles and what it was, or the error's words.
    fn reading(file: &[u8]) -> Result<(Triangles, Source), String> {
        let mut all = All::default();
        let source = read(&mut Cursor::new(file), &mut all).map_err(|e| e.to_string())?;
        Ok((all.0, source))
    }

    /// A binary file of triangle (k, 0, 0), (0, 1, 0), (0, 0, 1) for each k from 1, whatever the count says.
    fn binary(head: &str, count: u32, triangles: usize, after: &[u8]) -> Vec<u8> {
        let mut file = head.as_bytes().to_vec();
        file.resize(80, b' ');
        file.extend(count.to_le_bytes());
        for k in 1..=triangles {
            file.extend([0xff; 12]);
            for c in [k as f32, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0] {
                file.extend(c.to_le_bytes());
            }
            file.extend([7; 2]);
        }
        file.extend(after);
        file
    }

    const FACET: &str = "facet normal 0 0 1\n outer loop\n  vertex 1 0 0\n  vertex 0 1 0\n  vertex 0 0 1\n endloop\nendfacet\n";

    fn expected(triangles: usize) -> Triangles {
        (1..=triangles).map(|k| [[k as f32, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).collect()
    }

    #[test]
    fn files_of_all_kinds_are_read() {
        let check = |file: &[u8], format: Format, triangles: usize, trailing: u64, endsolid_missing: bool| {
            let (found, source) = reading(file).unwrap_or_else(|e| panic!("{e}: {}", file.escape_ascii()));
            let expect = Source { format, triangles: triangles as u64, trailing, endsolid_missing };
            assert_eq!(source, expect, "{}", file.escape_ascii());
            match format {
                Format::Binary => assert_eq!(found, expected(triangles)),
                Format::Ascii => assert_eq!(found, vec![expected(1)[0]; triangles]),
            }
        };
        let binaries =
            [binary("", 3, 3, b""), binary("solid part", 3, 3, b""), binary("solid\nfacet", 3, 3, b"")];
        binaries.iter().for_each(|file| check(file, Format::Binary, 3, 0, false));
        check(&binary("solid part", 3, 3, b"junk"), Format::Binary, 3, 4, false);
        check(&binary("", 2, 3, b""), Format::Binary, 2, 50, false);
        let text = |text: &str, triangles: usize, trailing: u64, endsolid_missing: bool| {
            check(text.as_bytes(), Format::Ascii, triangles, trailing, endsolid_missing);
        };
        let solid = format!("solid part\n{FACET}endsolid part\n");
        text(&solid, 1, 0, false);
        text(&solid.replace('\n', "\r\n"), 1, 0, false);
        text(&solid.replace('\n', "\r"), 1, 0, false);
        text(&solid.to_uppercase(), 1, 0, false);
        text(&format!("\u{feff}\n  {}", solid.replace('\n', "\n\n")), 1, 0, false);
        text(&solid.replace("part", "Größe 12 µm"), 1, 0, false);
        text(&solid.replace(" part", ""), 1, 0, false);
        text(&solid.replace("0 0 1\n outer", "nan -NaN inf\n outer"), 1, 0, false);
        text(&solid.replace("vertex 1 0 0", "vertex +1.0e+000 -0.0 .0"), 1, 0, false);
        text(&format!("{solid}{solid}solid empty\nendsolid\n"), 2, 0, false);
        text(&format!("{solid}\0\0\0\nmade by hand\n"), 1, 2, false);
        text(&format!("{solid}facet_count 1\n{solid}"), 2, 1, false);
        text(&format!("solid part\n{FACET}{FACET}"), 2, 0, true);
        text(format!("solid part\n{FACET}").trim_end(), 1, 0, true);
    }

    #[test]
    fn bad_files_are_refused_with_place_and_reason() {
        let check = |file: &[u8], expect: &str| {
            let error = reading(file).expect_err(&file.escape_ascii().to_string());
            assert!(error.contains(expect), "{error:?} instead of {expect:?}");
        };
        check(b"", "it has 0 bytes");
        check(b"PK\x03\x04", "no STL file: it has 4 bytes");
        check(&[0; 83], "it has 83 bytes");
        check(&binary("", 0, 0, b""), "no triangles");
        check(&binary("solid", 0, 0, b""), "no triangles");
        check(&binary("", 0, 4, b""), "200 bytes follow, enough for 4: the program");
        check(
            &binary("", 4, 3, b""),
            "promises 4 triangles (284 bytes), but it has 234 bytes, enough for 3;",
        );
        check(&binary("", u32::MAX, 3, b""), "promises 4294967295 triangles (214748364834 bytes)");
        check(&binary("solid part", 4, 3, &[0; 49]), "enough for 3;");
        for (bad, words) in [(f32::NAN, "(NaN)"), (f32::INFINITY, "(inf)"), (f32::NEG_INFINITY, "(-inf)")] {
            let mut file = binary("", 3, 3, b"");
            file[84 + 50 + 12 + 8..84 + 50 + 12 + 12].copy_from_slice(&bad.to_le_bytes());
            check(&file, "triangle 2 has a corner");
            check(&file, words);
        }
        let text = |text: &str, expect: &str| check(text.as_bytes(), expect);
        let solid = format!("solid part\n{FACET}endsolid part\n");
        text("solid", "no triangles");
        text("solid part\nendsolid part\n", "no triangles");
        text("solid\n\n\n", "no triangles");
        text(&format!("solid part\n{FACET}{}", &FACET[..46]), "cut short: it ends in line 11 within facet 2");
        text(&solid.replace("  vertex 0 0 1\n", ""), "line 6: vertex f32 f32 f32, got [\"endloop\"]");
        text(&solid.replace(" endloop", "  vertex 1 1 1\n endloop"), "line 7: ");
        text(&solid.replace("vertex 0 1 0", "vertex 0 1"), "line 5: ");
        text(&solid.replace("vertex 0 1 0", "vertex 0 1,5 0"), "line 5: invalid float literal");
        text(&solid.replace("vertex 0 1 0", "vertex 0 nan 0"), "line 5: expected finite");
        text(&solid.replace("vertex 0 1 0", "vertex 0 1e99 0"), "line 5: expected finite");
        text(&solid.replace("endfacet\n", ""), "line 8: expected [\"endfacet\"], got");
        text(&solid.replace("endfacet", "hello"), "line 8: expected");
        check(&[b"solid\nfacet ", &[b'x'; 5000][..]].concat(), "line 2: longer than 4096 bytes");
        check(&[b"solid part\nfacet\nouter loop\nvertex \xff 0 0", &[b'\n'; 60][..]].concat(), "line 4: ");
    }

    #[test]
    fn a_reader_that_fails_is_told() {
        struct Broken(Cursor<Vec<u8>>);
        impl Read for Broken {
            fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
                let at_most = buffer.len().min(512);
                let read = self.0.read(&mut buffer[..at_most])?;
                if self.0.position() > 4000 {
                    Err(std::io::Error::other("the disk is gone"))
                } else {
                    Ok(read)
                }
            }
        }
        impl Seek for Broken {
            fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
                self.0.seek(to)
            }
        }
        let text = format!("solid part\n{}endsolid", FACET.repeat(100)).into_bytes();
        for file in [binary("", 100, 100, b""), text] {
            let error = read(&mut Broken(Cursor::new(file)), &mut All::default()).expect_err("broken");
            assert!(matches!(&error, StlError::Read(e) if e.to_string().contains("gone")), "{error}");
        }
    }
}
