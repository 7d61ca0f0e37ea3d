//! What the beginning of a file tells before its beads are read: the dialect, and
//! whether E words are distances though no line says so.
use super::GcodeError;
use outrigger_gcode::dialect::{Detection, Dialect, Feature, Mark, detect};
use outrigger_gcode::line::{Command, Line, parse, split_lines};
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
        Ok(Beginning { bytes, dialect, relative_e })
    }
}

/// Whether E words read as positions would pull filament back within every third
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
    extrusions >= TELLING && falls * 3 > extrusions
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
    // ideaMaker's.
    match line.comment.trim_ascii_end() {
        b";TYPE:RAFT" => Some(Mark::Feature(Feature::Support)),
        b";TYPE:BRIM" => Some(Mark::Feature(Feature::Skirt)),
        _ => unknown,
    }
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
        check(";LAYER:-2", Some(Mark::Layer));
        check("G1 X1", None);
    }
}
