//! What a file is, told by its content; its name is a hint only where the content
//! would allow more than one answer.
use super::super::files;
use crate::resin;
use anyhow::Context;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes that are looked at.
const BEGINNING_BYTES: u64 = 8 << 10;

/// Bytes before the first triangle of a binary STL.
const STL_HEAD_BYTES: usize = 84;

/// Bytes of a triangle in a binary STL.
const STL_TRIANGLE_BYTES: u64 = 50;

/// What a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A mesh, binary or ASCII.
    Stl,
    /// G-code, text or binary.
    Gcode,
    /// A resin job: a zip, or GOO.
    Resin,
}

impl Kind {
    /// What people call it.
    pub(super) fn words(self) -> &'static str {
        match self {
            Kind::Stl => "a model",
            Kind::Gcode => "G-code",
            Kind::Resin => "a resin job",
        }
    }
}

/// An open file.
pub(super) struct Opened {
    pub(super) file: File,
    pub(super) kind: Kind,
    /// Length, bytes.
    pub(super) bytes: u64,
}

/// Opens a file and tells what it is.
///
/// # Errors
/// It cannot be read, is empty, or is nothing that can be checked.
pub(super) fn open(path: &Path) -> anyhow::Result<Opened> {
    let shown = path.display();
    let meta = path.metadata().with_context(|| format!("cannot open {shown}"))?;
    anyhow::ensure!(meta.is_file(), "{shown} is no regular file; name a model, a sliced job or a resin job");
    let mut file = files::open_regular(path)?;
    let bytes = meta.len();
    anyhow::ensure!(bytes > 0, "{shown} is empty; export or slice it again");
    let mut beginning = Vec::new();
    (&mut file)
        .take(BEGINNING_BYTES)
        .read_to_end(&mut beginning)
        .with_context(|| format!("cannot read {shown}"))?;
    file.seek(SeekFrom::Start(0)).with_context(|| format!("cannot read {shown}"))?;
    let named_stl = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("stl"));
    let kind = told(&beginning, bytes, named_stl).map_err(|reason| anyhow::anyhow!("{shown}: {reason}"))?;
    Ok(Opened { file, kind, bytes })
}

/// What the beginning and the length of a file make it.
fn told(beginning: &[u8], bytes: u64, named_stl: bool) -> Result<Kind, &'static str> {
    if resin::may_be_job(beginning) {
        // 3MF is a zip too; its first entries are these.
        let name = beginning.get(30..).unwrap_or_default();
        if [&b"[Content_Types].xml"[..], b"3D/", b"_rels/"].iter().any(|n| name.starts_with(n)) {
            return Err("it is a 3MF model; export it as STL");
        }
        return Ok(Kind::Resin);
    }
    if beginning.starts_with(b"GCDE") {
        return Ok(Kind::Gcode);
    }
    for (magic, advice) in OTHERS {
        if beginning.starts_with(magic) {
            return Err(advice);
        }
    }
    // A binary STL may begin with "solid" or with text; its length gives it away.
    if let Some(count) = beginning.get(STL_HEAD_BYTES - 4..STL_HEAD_BYTES) {
        let count = u64::from(u32::from_le_bytes([count[0], count[1], count[2], count[3]]));
        if count > 0 && bytes == STL_HEAD_BYTES as u64 + count * STL_TRIANGLE_BYTES {
            return Ok(Kind::Stl);
        }
    }
    let text = beginning.trim_ascii_start();
    let solid = text.get(..5).is_some_and(|w| w.eq_ignore_ascii_case(b"solid"));
    let binary = is_binary(beginning);
    if solid || (named_stl && (binary || bytes < STL_HEAD_BYTES as u64)) {
        return Ok(Kind::Stl);
    }
    if binary {
        return Err("it is none of STL, G-code, SL1, NanoDLP and GOO; export or slice it again");
    }
    if looks_like_gcode(beginning) {
        return Ok(Kind::Gcode);
    }
    Err("it is text, but neither STL nor G-code; export or slice it again")
}

/// Formats that people may well try, and what to do instead.
const OTHERS: &[(&[u8], &str)] = &[
    (b"\x1f\x8b", "it is compressed with gzip; unpack it first (gunzip)"),
    (b"\x89PNG", "it is a PNG picture; name the resin job's archive"),
    (b"ply\n", "it is a PLY model; export it as STL"),
    (b"ply\r", "it is a PLY model; export it as STL"),
    (b"\x7fELF", "it is a program, neither a model nor a job"),
];

/// Bytes that no text has.
fn is_binary(beginning: &[u8]) -> bool {
    beginning.iter().any(|&b| b < 0x20 && !matches!(b, b'\t' | b'\n' | b'\r' | 0x0b | 0x0c | 0x1b))
}

/// Whether lines are comments or commands of a letter and a number, and one at least is.
fn looks_like_gcode(beginning: &[u8]) -> bool {
    let beginning = beginning.strip_prefix(b"\xef\xbb\xbf").unwrap_or(beginning);
    let lines = beginning.split(|&b| b == b'\n').map(<[u8]>::trim_ascii);
    let (mut fits, mut others) = (0, 0);
    for line in lines.filter(|l| !l.is_empty()) {
        let command = line[0].is_ascii_alphabetic() && line.get(1).is_some_and(|b| b.is_ascii_digit());
        // Klipper's macros are words of capitals and underscores.
        let name = line.split(|b| b.is_ascii_whitespace()).next().unwrap_or_default();
        let is_macro =
            name.len() > 2 && name.iter().all(|b| b.is_ascii_uppercase() || matches!(b, b'_' | b'0'..=b'9'));
        match line[0] {
            b';' | b'(' | b'%' => fits += 1,
            _ if command || is_macro => fits += 1,
            _ => others += 1,
        }
    }
    fits > others
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_tells() {
        let stl = |head: &str, triangles: u32| {
            let mut bytes = head.as_bytes().to_vec();
            bytes.resize(80, 0);
            bytes.extend(triangles.to_le_bytes());
            bytes
        };
        let check = |beginning: &[u8], bytes: u64, expect: Option<Kind>| {
            assert_eq!(told(beginning, bytes, false).ok(), expect, "{}", String::from_utf8_lossy(beginning));
        };
        check(b"PK\x03\x04...", 99, Some(Kind::Resin));
        check(b"PK\x03\x04..........................3D/3dmodel.model", 99, None);
        check(b"V3.0\x07\0\0\0DLP\0slicer", 99, Some(Kind::Resin));
        check(b"V5.1\x07\0\0\0DLP\0slicer", 99, Some(Kind::Resin));
        check(b"V3.0\x07\0\0\0DLQ\0slicer", 99, None);
        check(b"GCDE\x01", 99, Some(Kind::Gcode));
        check(&stl("solid of an exporter", 2), 184, Some(Kind::Stl));
        check(&stl("G1 X1", 2), 184, Some(Kind::Stl));
        check(&stl("anything", 2), 183, None);
        check(b"  SOLID cube\nfacet normal", 25, Some(Kind::Stl));
        check(b"; generated by PrusaSlicer\nG28\n", 30, Some(Kind::Gcode));
        check(b"\xef\xbb\xbfG28\n", 7, Some(Kind::Gcode));
        check(b"START_PRINT BED=60\nG1 X1 Y1\n", 28, Some(Kind::Gcode));
        check(b"M104 S200\r\nG28\r\n", 16, Some(Kind::Gcode));
        check(b"Dear reader,\nthis is a letter.\n", 30, None);
        check(b"\x1f\x8b\x08", 99, None);
        check(b"\0\0\0\0", 4, None);
        check(b"\n\n", 2, None);
    }

    #[test]
    fn a_damaged_stl_is_still_an_stl_by_its_name() {
        // So that its reader can say what is wrong with it.
        assert_eq!(told(&[0; 84], 90, true).ok(), Some(Kind::Stl));
        assert_eq!(told(b"abc", 3, true).ok(), Some(Kind::Stl));
        assert_eq!(told(b"G28\n", 1000, true).ok(), Some(Kind::Gcode));
    }
}
