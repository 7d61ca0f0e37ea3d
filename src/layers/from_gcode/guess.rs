//! What files do not say plainly: the dialect, E words that are distances though no
//! line says so, prime lines that nothing names.
use super::GcodeError;
use super::levels::{FIRST_LAYERS, NEAR};
use super::trace::{Class, Sheet};
use crate::layers::shape::Bounds;
use outrigger_gcode::dialect::{Detection, Dialect, Feature, Mark, detect};
use outrigger_gcode::line::{Command, Line, parse, split_lines};
use outrigger_gcode::number::decimal;
use std::io::{BufRead, Read};

/// So much of a file shows its dialect: headers with thumbnails are some 100 KiB.
const BEGINNING_BYTES: u64 = 1 << 20;

/// After so many extrusions it shows whether E words are positions.
const TELLING: u32 = 50;

/// The beginning of a file, and what it tells.
pub(super) struct Beginning {
    pub(super) bytes: Vec<u8>,
    /// `None`: every dialect's comments are tried.
    pub(super) dialect: Option<Dialect>,
    /// E words are distances, though neither `M83` nor `M82` says so.
    pub(super) relative_e: bool,
    /// Layers or features are marked, in whatever dialect.
    pub(super) marked: bool,
}

impl Beginning {
    pub(super) fn read(reader: &mut impl BufRead) -> Result<Beginning, GcodeError> {
        let mut bytes = Vec::new();
        reader
            .take(BEGINNING_BYTES)
            .read_to_end(&mut bytes)
            .map_err(|source| GcodeError::Read { line: 0, source })?;
        let dialect = match detect(&bytes) {
            Detection::One(dialect) => Some(dialect),
            Detection::Unknown | Detection::Mixed(..) => None,
        };
        let relative_e = relative_e(&bytes);
        let marks = |bytes| matches!(mark(&parse(bytes)), Some(Mark::Layer | Mark::Feature(_)));
        let marked = dialect.is_some() || split_lines(&bytes).any(marks);
        Ok(Beginning { bytes, dialect, relative_e, marked })
    }
}

/// Tells prime lines of files that name nothing: what lies higher than the first layer
/// and comes before it, or lies lower and wholly beside the next height.
pub(super) fn set_primes(sheets: &mut [Sheet]) {
    let lowest = |sheets: &[Sheet], pass: u32, above: i32| {
        let own = sheets.iter().filter(|s| s.key.pass == pass && !s.key.slope);
        own.map(|s| s.key.top).filter(|&top| top > above).min()
    };
    let mut prime: Option<(u32, i32)> = None;
    if let (Some(first), Some(next)) = (lowest(sheets, 0, i32::MIN), lowest(sheets, 1, i32::MIN))
        && first > next.saturating_add(FIRST_LAYERS)
    {
        prime = Some((0, i32::MAX));
    } else if let Some(first) = lowest(sheets, 0, i32::MIN)
        && let Some(next) = lowest(sheets, 0, first.saturating_add(NEAR))
    {
        let bounds = |low: i32, high: i32| {
            let own = sheets.iter().filter(|s| s.key.pass == 0 && (low..=high).contains(&s.key.top));
            own.fold(Bounds::EMPTY, |b, s| b.joined(s.bounds))
        };
        let (low, high) = (bounds(first, first + NEAR), bounds(next, next + NEAR));
        prime = (!low.overlap(high)).then_some((0, first + NEAR));
    }
    let Some((pass, top)) = prime else { return };
    for sheet in sheets.iter_mut().filter(|s| s.key.pass == pass && s.key.top <= top) {
        sheet.key.class = Class::Aid;
    }
}

/// Whether E words read as positions would pull filament back before every fourth
/// extrusion, where nothing says what they are: a start macro hides the `M83`.
fn relative_e(beginning: &[u8]) -> bool {
    let (mut last, mut extrusions, mut falls) = (0.0, 0, 0);
    for bytes in split_lines(beginning) {
        let line = parse(bytes);
        match line.command {
            Command::Classic { letter: b'M', number: 82 | 83, sub: None }
            | Command::Classic { letter: b'G', number: 91, sub: None } => return false,
            Command::Classic { letter: b'G', number: 92, sub: None } => {
                last = line.words.get(b'E').unwrap_or(last);
            }
            Command::Classic { letter: b'G', number: 1..=3, sub: None } => {
                let moves = line.words.get(b'X').or(line.words.get(b'Y')).is_some();
                let Some(e) = line.words.get(b'E') else { continue };
                if moves && e > 0.0 {
                    extrusions += 1;
                    falls += u32::from(e <= last);
                }
                last = e;
            }
            _ => {}
        }
    }
    extrusions >= TELLING && falls * 4 > extrusions
}

/// What a line says in any dialect, for files whose slicer is not known: some
/// write PrusaSlicer's or Cura's comments, or names of their own.
pub(super) fn mark<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    let mut unknown = None;
    for dialect in Dialect::ALL {
        match dialect.mark(line) {
            None | Some(Mark::Inline(_) | Mark::Note) => {}
            Some(mark @ Mark::Feature(Feature::Unknown)) => unknown = Some(mark),
            Some(mark) => return Some(mark),
        }
    }
    other(line).or(unknown)
}

/// What ideaMaker and KISSlicer say in words of their own.
fn other<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    if !line.is_comment() {
        return None;
    }
    let text = line.comment_text();
    if let Some(at) = memchr::memmem::find(text, b" z_thickness=") {
        let (_, number) = decimal(&text[at + 13..]).ok()?;
        return Some(Mark::Height(number.value));
    }
    let kiss = || Some(text.strip_prefix(b"'")?.split(|&b| b == b'\'').next()?.strip_suffix(b" Path"));
    let named = text.strip_prefix(b"TYPE:").or_else(|| kiss().flatten())?;
    let says = |word: &[u8]| memchr::memmem::find(named, word).is_some();
    let feature = match named {
        _ if says(b"RAFT") || says(b"Raft") || says(b"SUPPORT") || says(b"Support") => Feature::Support,
        b"BRIM" | b"Brim" | b"Skirt" | b"Prime Pillar" => Feature::Skirt,
        b"INFILL" | b"Sparse Infill" | b"Stacked Sparse Infill" => Feature::Infill,
        b"SOLID-FILL" | b"Solid" => Feature::SolidInfill,
        b"Perimeter" => Feature::ExternalPerimeter,
        b"Loop" => Feature::Perimeter,
        _ => return None,
    };
    Some(Mark::Feature(feature))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn e_words_that_cannot_be_positions_are_distances() {
        let check = |head: &str, e: fn(u32) -> f64, expect: bool| {
            let lines: String = (0..100).map(|k| format!("G1 X{k} E{:.5}\n", e(k))).collect();
            assert_eq!(relative_e(format!("{head}{lines}").as_bytes()), expect, "{head:?}");
        };
        check("", |_| 0.1, true);
        check("", |k| 0.1 + f64::from(k % 3) / 10.0, true);
        check("", |k| f64::from(k + 1) * 0.1, false);
        check("M82\n", |_| 0.1, false);
        check("M83\n", |_| 0.1, false);
        check("", |k| if k < 20 { 0.1 } else { f64::from(k) }, false);
    }

    #[test]
    fn marks_of_any_dialect() {
        let check = |text: &str, expect: Option<Mark<'_>>| {
            assert_eq!(mark(&parse(text.as_bytes())), expect, "{text}");
        };
        check(";TYPE:WALL-OUTER", Some(Mark::Feature(Feature::ExternalPerimeter)));
        check(";TYPE:External perimeter", Some(Mark::Feature(Feature::ExternalPerimeter)));
        check("; FEATURE: Support", Some(Mark::Feature(Feature::Support)));
        check(";TYPE:RAFT", Some(Mark::Feature(Feature::Support)));
        check(";TYPE:OUTER", Some(Mark::Feature(Feature::Unknown)));
        check(";HEIGHT:0.380", Some(Mark::Height(0.38)));
        check("; BEGIN_LAYER_OBJECT z=0.263 z_thickness=0.263", Some(Mark::Height(0.263)));
        check("; 'Perimeter Path', 0.3 [feed mm/s]", Some(Mark::Feature(Feature::ExternalPerimeter)));
        check("; 'Support Interface Path', 1", Some(Mark::Feature(Feature::Support)));
        check("; 'Travel/Ironing Path', 1", None);
        check(";LAYER:-2", Some(Mark::Layer));
        check("G1 X1", None);
    }
}
