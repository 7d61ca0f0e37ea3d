//! The picture of what post-processing did: its most improved layer, before and after.
use super::files;
use super::post::Done;
use crate::post::BEGINNING_BYTES;
use crate::report::gain::most_improved;
use crate::report::paths::svg;
use anyhow::Context;
use outrigger_gcode::bgcode::{bare_text, text};
use outrigger_gcode::dialect::{Detection, detect};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

/// Read buffer, bytes.
const BUFFER_BYTES: usize = 256 << 10;

/// What the picture shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shown {
    /// Number of the layer, from 1.
    pub(super) layer: u32,
    /// Retractions in it as it was, and as it is.
    pub(super) retractions: [u64; 2],
}

/// Writes the picture to a file; "-" is standard output. `None`: no layer was
/// changed, and nothing is written.
///
/// # Errors
/// A job cannot be read again, or the picture not be written.
pub(super) fn write(name: &str, done: &Done, to: &Path) -> anyhow::Result<Option<Shown>> {
    let mut before = &done.input;
    let after = files::open_regular(&done.target)?;
    let mut beginning = Vec::new();
    before.seek(SeekFrom::Start(0)).context("cannot read the job again for its picture")?;
    text(buffered(before))
        .take(BEGINNING_BYTES)
        .read_to_end(&mut beginning)
        .context("cannot read the job again")?;
    let Detection::One(dialect) = detect(&beginning) else { return Ok(None) };
    before.seek(SeekFrom::Start(0)).context("cannot read the job again for its picture")?;
    let pair = most_improved(bare_text(buffered(before)), bare_text(buffered(&after)), dialect)
        .context("cannot read the job again for its picture")?;
    let Some(pair) = pair else { return Ok(None) };
    files::write_text(&svg(name, &pair), to, "picture")?;
    let retractions = [pair.before.totals.retractions, pair.after.totals.retractions];
    Ok(Some(Shown { layer: pair.before.number, retractions }))
}

fn buffered(file: &File) -> BufReader<&File> {
    BufReader::with_capacity(BUFFER_BYTES, file)
}
