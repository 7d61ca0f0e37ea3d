//! How fast the language is read and written, on a 24 MB job of real slicer output.
//!
//! `cargo bench -p outrigger-gcode --bench parse`
//!
//! After criterion's own figures it prints ratios to peers timed in the same run:
//! a bare line count (what reading lines costs at least) and an idiomatic nom
//! parser. The target is 250 MB/s a core for the parser alone.
mod common;

use common::long_job::LongJob;
use common::ratio::Ratios;
use common::run::run;
use criterion::{Criterion, SamplingMode, Throughput};
use nom::{
    IResult, Parser,
    bytes::complete::take_while,
    character::complete::{digit1, satisfy, space0},
    combinator::recognize,
    multi::many0,
    number::complete::double,
    sequence::preceded,
};
use outrigger_gcode::line::{parse, split_lines, write};
use outrigger_gcode::state::{Effect, Machine};
use std::hint::black_box;
use std::path::Path;

/// Size of the job, bytes: a long print's, and more than a core's own caches hold.
const JOB_BYTES: usize = 24_000_000;

/// Least throughput of the parser on one core, MB/s.
const TARGET_MB_S: f64 = 250.0;

/// One of each family: relative E without leading zeros, absolute E with F first, inline comments.
const SAMPLES: [(&str, &str); 3] = [
    ("prusa", "demo.gcode"),
    ("cura", "cura413-marlin-abs-lines.gcode"),
    ("slic3r", "slic3r13-rel-comments.gcode"),
];

fn job(file: &str) -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(file);
    let short = std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    LongJob::of(&short).expect("a job with layers").bytes(JOB_BYTES)
}

/// Every line parsed; the sum keeps the numbers from being optimized away.
fn parsed(job: &[u8]) -> f64 {
    split_lines(job).map(|bytes| parse(bytes).words.get(b'X').unwrap_or(0.0)).sum()
}

/// Every line parsed and done by the machine.
fn applied(job: &[u8]) -> f64 {
    let mut machine = Machine::default();
    let mut filament = 0.0;
    for bytes in split_lines(job) {
        if let Effect::Motion(m) = machine.apply(&parse(bytes)) {
            filament += m.e;
        }
    }
    filament
}

fn round_trip(job: &[u8], out: &mut Vec<u8>) -> usize {
    out.clear();
    for bytes in split_lines(job) {
        write(&parse(bytes), out);
    }
    out.len()
}

/// Lines cut one by one, as the parser gets them.
fn count_lines(job: &[u8]) -> usize {
    split_lines(job).map(black_box).count()
}

/// Command, words, and the rest of the line.
type Parts<'a> = (&'a [u8], Vec<(char, f64)>, &'a [u8]);

/// The peer: a line of G-code as nom's documentation would have it written. It
/// allocates for each line and takes the E of `X10E5` for an exponent.
fn idiomatic(line: &[u8]) -> IResult<&[u8], Parts<'_>> {
    let command = recognize((satisfy(|c| c.is_ascii_uppercase()), digit1));
    let word = preceded(space0, (satisfy(|c| c.is_ascii_alphabetic()), double));
    (command, many0(word), take_while(|_| true)).parse(line)
}

fn idiomatically_parsed(job: &[u8]) -> f64 {
    let x = |bytes| match idiomatic(bytes) {
        Ok((_, (_, words, _))) => words.iter().find(|w| w.0 == 'X').map_or(0.0, |w| w.1),
        Err(_) => 0.0,
    };
    split_lines(job).map(x).sum()
}

fn benches(c: &mut Criterion) {
    for (name, file) in SAMPLES {
        let job = job(file);
        let mut out = Vec::with_capacity(job.len());
        let mut group = c.benchmark_group(name);
        group.throughput(Throughput::Bytes(job.len() as u64)).sampling_mode(SamplingMode::Flat);
        group.bench_function("parse", |b| b.iter(|| parsed(black_box(&job))));
        group.bench_function("parse+apply", |b| b.iter(|| applied(black_box(&job))));
        group.bench_function("parse+write", |b| b.iter(|| round_trip(black_box(&job), &mut out)));
        group.finish();
    }
}

fn ratios(ratios: &Ratios) {
    for (name, file) in SAMPLES {
        let job = job(file);
        let mut out = Vec::with_capacity(job.len());
        let mut copy = Vec::with_capacity(job.len());
        eprintln!("\n{name}: {:.1} MB, {} lines", job.len() as f64 / 1e6, count_lines(&job));
        let size = job.len();
        // A peer that reads something else would be no peer.
        let (own, peer) = (parsed(&job), idiomatically_parsed(&job));
        assert!((own - peer).abs() <= 1e-9 * own.abs(), "{own} {peer}");
        let parsing = ratios.compare(
            size,
            ("parse", || parsed(&job)),
            ("idiomatic nom (many0, double)", || idiomatically_parsed(&job)),
        );
        ratios.compare(size, ("parse", || parsed(&job)), ("line count (memchr)", || count_lines(&job)));
        ratios.compare(size, ("parse+apply", || applied(&job)), ("parse", || parsed(&job)));
        ratios.compare(
            size,
            ("parse+write", || round_trip(&job, &mut out)),
            ("copy (memcpy)", || {
                copy.clear();
                copy.extend_from_slice(&job);
            }),
        );
        ratios.target("parse", parsing.mb_s(size), TARGET_MB_S);
    }
}

fn main() {
    run(benches, ratios);
}
