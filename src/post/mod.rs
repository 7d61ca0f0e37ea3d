//! Post-processing: a sliced job in, the same job with its infill reordered out, and a proof that it is the same.
//!
//! Takes a job that can be read twice and a writer; gives a [`Report`]. Knows no
//! file system and no clock: replacing the file, and `seconds`, are the caller's.
//!
//! # Layout
//! ```text
//! annotate (lines → layers) → passes (rows → rows) → write
//!                                            └─ verify, always last, from the text again
//! ```
//! `container` gives the text of binary G-code and takes it back.
//! Three threads, a few small layers or one large between each: memory is bounded by the largest layers.
pub mod annotate;
mod batch;
pub(crate) mod container;
mod emit;
pub mod habits;
pub mod layer;
pub(crate) mod link;
pub mod measure;
pub mod pass;
pub mod passes;
pub mod report;
mod rewrite;
pub mod section;
mod settings;
pub mod time;
pub mod verify;

use annotate::{Layers, Unfit};
use batch::{Batches, batches};
use container::{Container, Counted, Output, gcode};
use habits::FileHabits;
use layer::Layer;
use outrigger_gcode::bgcode::damage;
use outrigger_gcode::dialect::{Detection, Dialect, detect};
use passes::Wishes;
use report::Report;
use section::Neighbours;
use std::io::{BufRead, Read, Seek, SeekFrom, Write};
use std::sync::mpsc::Receiver;
use time::Accelerations;
use verify::{Difference, Figures, Verifier};

/// Read from the beginning to tell the dialect, bytes: thumbnails come first and take some 100 kB.
pub const BEGINNING_BYTES: u64 = 1 << 20;

/// Read from the end for the slicer's settings, bytes: OrcaSlicer's take some 40 kB.
pub(crate) const END_BYTES: u64 = 256 << 10;

/// Read and write buffers, bytes.
const BUFFER_BYTES: usize = 256 << 10;

/// A file that stays as it is is measured in pieces of this size, bytes.
const MEASURED_BYTES: u64 = 1 << 20;

/// What to do, beside what the file says.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// For the passes.
    pub wishes: Wishes,
    /// Before the file sets any.
    pub accelerations: Accelerations,
}

/// Why there is no output.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The input cannot be read.
    #[error("cannot read: {0}")]
    Read(#[source] std::io::Error),
    /// The output cannot be written.
    #[error("cannot write: {0}")]
    Write(#[source] std::io::Error),
}

/// Why a job stays as it is.
#[derive(Debug, thiserror::Error)]
enum Unchanged {
    #[error(transparent)]
    Unfit(#[from] Unfit),
    #[error("the result would not print the same: {0}")]
    Different(#[from] Difference),
    #[error("{0}")]
    Write(#[source] std::io::Error),
}

/// Post-processes a job, text or binary G-code. `progress` is told how many bytes have been read.
///
/// When the report has an `unchanged_reason`, what was written must not be used:
/// the input stands.
///
/// # Errors
/// The input cannot be read, or the output not written. Damaged binary G-code is
/// no error, but a reason to leave it.
pub fn post(
    input: &mut (impl Read + Seek + Send),
    output: &mut (impl Write + Send),
    options: Options,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Report, Failure> {
    match post_readable(input, output, options, progress) {
        Err(Failure::Read(error) | Failure::Write(error)) if damage(&error).is_some() => {
            let mut report = Report::default();
            report.unchanged(error.to_string());
            Ok(report)
        }
        done => done,
    }
}

fn post_readable(
    input: &mut (impl Read + Seek + Send),
    output: &mut (impl Write + Send),
    options: Options,
    progress: &(dyn Fn(u64) + Sync),
) -> Result<Report, Failure> {
    let container = Container::of(input).map_err(Failure::Read)?;
    if let Some(reason) = container.refusal() {
        return measured_only(input, options, reason.to_owned());
    }
    let beginning = container::beginning(input, BEGINNING_BYTES).map_err(Failure::Read)?;
    if let Some(reason) = not_for_us(&beginning) {
        let mut report = Report::default();
        report.unchanged(reason);
        return Ok(report);
    }
    let dialect = match detect(&beginning) {
        Detection::One(dialect) => dialect,
        Detection::Mixed(a, b) => {
            let reason = format!("layers are marked as {} and as {} do: mixed dialects", a.name(), b.name());
            return measured_only(input, options, reason);
        }
        Detection::Unknown => {
            return measured_only(input, options, "no slicer's layer comments that are known".to_owned());
        }
    };
    let habits = file_habits(input, container, &beginning, dialect).map_err(Failure::Read)?;
    let made = container.begin(input, &mut *output)?;
    input.seek(SeekFrom::Start(0)).map_err(Failure::Read)?;
    match run(Counted::new(&mut *input, progress), made, dialect, &habits, options) {
        Ok((figures, tally)) => {
            container.end(input, output)?;
            Ok(report(&figures, tally))
        }
        Err(Unchanged::Unfit(Unfit::Read { source, .. })) => Err(Failure::Read(source)),
        Err(Unchanged::Write(source)) => Err(Failure::Write(source)),
        Err(reason) => measured_only(input, options, reason.to_string()),
    }
}

fn report(figures: &Figures, tally: pass::Tally) -> Report {
    let mut report = Report::default();
    report.put(figures);
    report.sections = tally.sections;
    report.sections_changed = tally.changed;
    if tally.changed == 0 {
        report.unchanged("no order is better than the slicer's own");
    }
    report
}

pub(crate) fn not_for_us(beginning: &[u8]) -> Option<String> {
    if beginning.is_empty() {
        return Some("the file is empty".to_owned());
    }
    let text = &beginning[..beginning.len().min(4096)];
    memchr::memchr(0, text).map(|at| format!("byte {at} is zero: not G-code text"))
}

pub(crate) fn read_at(input: &mut (impl Read + Seek), at: u64, count: u64) -> std::io::Result<Vec<u8>> {
    input.seek(SeekFrom::Start(at))?;
    let mut bytes = Vec::new();
    input.take(count).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn file_habits(
    input: &mut (impl Read + Seek),
    container: Container,
    beginning: &[u8],
    dialect: Dialect,
) -> std::io::Result<FileHabits> {
    let mut habits = FileHabits::default();
    habits.read_settings(beginning);
    // Binary G-code has its settings before the G-code.
    if let Container::Text = container {
        let length = input.seek(SeekFrom::End(0))?;
        let end = read_at(input, length.saturating_sub(END_BYTES), END_BYTES)?;
        // The first piece may be half a line.
        let whole = memchr::memchr(b'\n', &end).map_or(end.len(), |at| at + 1);
        habits.read_settings(&end[whole.min(end.len())..]);
    }
    if !habits.is_known() {
        input.seek(SeekFrom::Start(0))?;
        habits.learn(gcode(input), dialect)?;
    }
    Ok(habits)
}

/// Figures of a file that stays as it is.
fn measured_only(
    input: &mut (impl Read + Seek),
    options: Options,
    reason: String,
) -> Result<Report, Failure> {
    let mut report = Report::default();
    input.seek(SeekFrom::Start(0)).map_err(Failure::Read)?;
    let mut reader = gcode(input);
    let mut verifier = Verifier::new(None, options.accelerations);
    let mut bytes = Vec::new();
    loop {
        bytes.clear();
        (&mut reader).take(MEASURED_BYTES).read_to_end(&mut bytes).map_err(Failure::Read)?;
        let full = bytes.len() as u64 == MEASURED_BYTES;
        if full {
            // On to the end of the line, if it is one.
            let limit = annotate::MAX_LINE_BYTES as u64;
            (&mut reader).take(limit).read_until(b'\n', &mut bytes).map_err(Failure::Read)?;
        }
        // The same bytes on both sides cannot differ.
        let _ = verifier.layer(0, &bytes, None);
        if !full {
            break;
        }
    }
    if let Ok(figures) = verifier.finish(0) {
        report.put(&figures);
    }
    report.unchanged(reason);
    Ok(report)
}

/// A layer's bytes for the verifier; the output's where they differ.
struct Pair {
    number: u32,
    /// The layer's text, and where in it the input stands.
    text: Vec<u8>,
    input: layer::Span,
    output: Option<Vec<u8>>,
}

fn run(
    input: impl Read + Send,
    output: Output<impl Write>,
    dialect: Dialect,
    habits: &FileHabits,
    options: Options,
) -> Result<(Figures, pass::Tally), Unchanged> {
    let mut passes = passes::all(options.wishes, habits);
    let (layers_in, layers) = batches::<Layer>();
    let (pairs_in, pairs) = batches::<Pair>();
    std::thread::scope(|scope| {
        let reading = scope.spawn(move || read(input, dialect, layers_in));
        let verifying = scope.spawn(move || verify(&pairs, dialect, options.accelerations));
        let written = rewrite_all(&layers, &mut passes, output, pairs_in);
        drop(layers);
        let read = reading.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        let verified = verifying.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        read?;
        let figures = verified?;
        written.map_err(Unchanged::Write)?;
        let tally = passes.iter().fold(pass::Tally::default(), |sum, pass| {
            let own = pass.tally();
            pass::Tally { sections: sum.sections + own.sections, changed: sum.changed + own.changed }
        });
        Ok((figures, tally))
    })
}

fn read(input: impl Read, dialect: Dialect, mut layers: Batches<Layer>) -> Result<(), Unfit> {
    let mut reader = Layers::new(gcode(input), dialect);
    while let Some(layer) = reader.next_layer()? {
        let size = layer.input().len();
        if layers.put(layer, size).is_err() {
            // The rewriting stopped; it tells why.
            return Ok(());
        }
    }
    // As above.
    let _ = layers.finish();
    Ok(())
}

/// Runs the passes over each layer, with its neighbours in sight, and writes it.
fn rewrite_all(
    layers: &Receiver<Vec<Layer>>,
    passes: &mut [Box<dyn pass::Pass>],
    mut output: Output<impl Write>,
    mut pairs: Batches<Pair>,
) -> std::io::Result<()> {
    let mut below = None;
    let mut layers = layers.iter().flatten();
    let mut next = layers.next();
    while let Some(mut layer) = next {
        next = layers.next();
        let neighbours =
            Neighbours { below: below.as_ref(), above: next.as_ref().and_then(|l| l.cover.as_ref()) };
        let rows = layer.rows.len();
        let text = layer.text.len();
        for pass in passes.iter_mut() {
            pass.layer(&mut layer, neighbours);
        }
        let changed = layer.rows.len() != rows || layer.text.len() != text;
        let made = changed.then(|| {
            let mut bytes = Vec::with_capacity(layer.input().len());
            layer.write(&mut bytes);
            bytes
        });
        let written = output.put(made, layer.input())?;
        let number = layer.number;
        below = layer.cover.take();
        let size = layer.input.end as usize - layer.input.start as usize;
        let pair = Pair { number, text: layer.text, input: layer.input, output: written };
        if pairs.put(pair, size).is_err() {
            // The verifier found a difference; it tells which.
            return Ok(());
        }
    }
    // As above.
    let _ = pairs.finish();
    output.finish()
}

fn verify(
    pairs: &Receiver<Vec<Pair>>,
    dialect: Dialect,
    accelerations: Accelerations,
) -> Result<Figures, Difference> {
    let mut verifier = Verifier::new(Some(dialect), accelerations);
    let mut last = 0;
    for pair in pairs.iter().flatten() {
        last = pair.number;
        let input = &pair.text[pair.input.start as usize..pair.input.end as usize];
        verifier.layer(pair.number, input, pair.output.as_deref())?;
    }
    verifier.finish(last)
}
