//! How fast beads become polygons: a job's layers, and one layer against the plain way.
//!
//! `cargo bench --bench beads`; `OUTRIGGER_BENCH_JOB=FILE.gcode` takes a file of your
//! own instead of the corpus's. After criterion's own figures it prints ratios to
//! peers timed in the same run: sweeping to a disc a vertex and a rectangle a
//! segment, resolved all at once (the plain way, to the same tolerance), and reading
//! the lines of the job with nothing else.
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use common::ratio::Ratios;
use common::run::run;
use criterion::{Criterion, SamplingMode, Throughput};
use outrigger::layers::from_gcode::{Options, read};
use outrigger::layers::polygon::{Inside, resolve, sweep};
use outrigger::layers::shape::{Point, Region, Ring, UNITS_PER_MM};
use outrigger::layers::stack::Layers;
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::Machine;
use std::f64::consts::{PI, TAU};
use std::hint::black_box;
use std::path::{Path, PathBuf};

/// 5 MB of job are checked in 2 s on two cores; making the layers may take a quarter of it.
const TARGET_MB_S: f64 = 10.0;

/// Round ends differ from circles by at most this, mm, as in `from_gcode`.
const TOLERANCE_MM: f64 = 0.02;

/// Half a bead, mm.
const RADIUS_MM: f64 = 0.225;

/// The corpus's largest jobs: 24 layers of separate infill lines, 20 of solid ones.
const SAMPLES: [&str; 2] = ["demo.gcode", "cura413-marlin-abs-lines.gcode"];

/// Names and texts of the jobs.
fn jobs() -> Vec<(String, Vec<u8>)> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus");
    let paths: Vec<PathBuf> = match std::env::var_os("OUTRIGGER_BENCH_JOB") {
        Some(own) => vec![PathBuf::from(own)],
        None => SAMPLES.iter().map(|file| corpus.join(file)).collect(),
    };
    let read = |path: &PathBuf| std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let name =
        |path: &PathBuf| path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    paths.iter().map(|path| (name(path), read(path))).collect()
}

/// Makes every layer; gives their number of vertices.
fn layers(job: &[u8]) -> usize {
    let mut layers = read(job, &Options::default()).expect("a job of the corpus");
    let mut vertices = 0;
    while let Some(batch) = layers.next_batch().expect("layers of ordinary size") {
        vertices += batch.iter().map(|layer| layer.part.len() + layer.aid.len()).sum::<usize>();
    }
    vertices
}

/// Every line parsed and done by the machine.
fn read_once(job: &[u8]) -> f64 {
    let mut machine = Machine::default();
    for bytes in split_lines(job) {
        black_box(machine.apply(&parse(bytes)));
    }
    machine.e
}

/// A layer of a part of 60 mm: three walls with a wavy outline, and solid lines 0.45 mm apart.
fn paths() -> Vec<Vec<Point>> {
    let mut paths = Vec::new();
    for wall in 0..3 {
        let radius = |angle: f64| 30.0 - 0.45 * f64::from(wall) + 0.8 * (12.0 * angle).sin();
        let points = (0..=400).map(|k| TAU * f64::from(k) / 400.0);
        paths.push(points.map(|a| Point::from_mm(radius(a) * a.cos(), radius(a) * a.sin())).collect());
    }
    for k in -62..=62 {
        let y = f64::from(k) * 0.45;
        let half = (28.5 * 28.5 - y * y).max(0.0).sqrt();
        paths.push(vec![Point::from_mm(-half, y), Point::from_mm(half, y)]);
    }
    paths
}

fn swept(paths: &[Vec<Point>]) -> Region {
    sweep(paths.iter().map(|path| (path.as_slice(), RADIUS_MM)), TOLERANCE_MM)
}

/// The plain way.
fn resolved(paths: &[Vec<Point>]) -> Region {
    let radius = RADIUS_MM * UNITS_PER_MM;
    let corners = (PI / (1.0 - TOLERANCE_MM / RADIUS_MM).acos()).ceil();
    let at = |p: Point, dx: f64, dy: f64| Point {
        x: (f64::from(p.x) + dx).round() as i32,
        y: (f64::from(p.y) + dy).round() as i32,
    };
    let mut rings: Vec<Ring> = Vec::new();
    for path in paths {
        for &p in path {
            let turn = |k: u32| TAU * f64::from(k) / corners;
            rings.push(
                (0..corners as u32).map(|k| at(p, radius * turn(k).cos(), radius * turn(k).sin())).collect(),
            );
        }
        for ends in path.windows(2) {
            let [a, b] = [ends[0], ends[1]];
            let (dx, dy) = (f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y));
            let scale = radius / dx.hypot(dy);
            let (nx, ny) = (-dy * scale, dx * scale);
            rings.push(vec![at(a, -nx, -ny), at(b, -nx, -ny), at(b, nx, ny), at(a, nx, ny)]);
        }
    }
    resolve(&rings, Inside::NonZero)
}

fn benches(c: &mut Criterion) {
    let paths = paths();
    let mut group = c.benchmark_group("beads");
    group.sampling_mode(SamplingMode::Flat);
    group.bench_function("one layer", |b| b.iter(|| swept(black_box(&paths))));
    for (name, job) in jobs() {
        group.throughput(Throughput::Bytes(job.len() as u64));
        group.bench_function(name, |b| b.iter(|| layers(black_box(&job))));
    }
    group.finish();
}

fn ratios(ratios: &Ratios) {
    let paths = paths();
    let (own, plain) = (swept(&paths).area_mm2(), resolved(&paths).area_mm2());
    assert!((own / plain - 1.0).abs() < 1e-3, "both ways cover the same: {own} {plain} mm²");
    let bytes = paths.iter().map(|path| path.len() * size_of::<Point>()).sum();
    let plainly = ("discs and rectangles", || resolved(&paths));
    ratios.compare(bytes, ("beads of one layer, swept", || swept(&paths)), plainly);
    for (name, job) in jobs() {
        let whole = ratios.compare(
            job.len(),
            (&format!("layers of {name}"), || layers(&job)),
            ("parse+apply once", || read_once(&job)),
        );
        ratios.target("layers of a job", whole.mb_s(job.len()), TARGET_MB_S);
    }
}

fn main() {
    run(benches, ratios);
}
