//! How fast `post` and its stages are, on 24 MB jobs of real slicer output.
//!
//! `cargo bench --bench post`; `OUTRIGGER_BENCH_JOB=FILE.gcode` repeats the layers of
//! a file of your own instead of the corpus's.
//!
//! After criterion's own figures it prints ratios to peers timed in the same run,
//! and what the order of visits gains over the slicer's and over plain nearest
//! neighbour. The target is 40 MB/s for `post` as a whole on two cores.
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use common::long_job::LongJob;
use common::ratio::Ratios;
use common::run::run;
use criterion::{BatchSize, Criterion, SamplingMode, Throughput};
use outrigger::post::annotate::Layers;
use outrigger::post::habits::FileHabits;
use outrigger::post::layer::{Layer, What};
use outrigger::post::passes::{self, Wishes};
use outrigger::post::report::Report;
use outrigger::post::section::Neighbours;
use outrigger::post::time::Accelerations;
use outrigger::post::verify::Verifier;
use outrigger::post::{Options, post};
use outrigger::toolpath::bead::{Bead, Cost, Ends, LiftRule, Point, as_sliced, cost, distance_mm};
use outrigger::toolpath::breakpoints::never_worse;
use outrigger::toolpath::cover::Cover;
use outrigger::toolpath::nearest::{Limit, Near, Start, nearest};
use outrigger::toolpath::walls::Walls;
use outrigger_gcode::dialect::{Dialect, Feature};
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Kind, Machine};
use std::hint::black_box;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// Size of the job, bytes: a long print's, and more than a core's own caches hold.
const JOB_BYTES: usize = 24_000_000;

/// Least throughput of `post` as a whole on two cores, MB/s.
const TARGET_MB_S: f64 = 40.0;

/// Relative E, z-hop and 300 infill beads in 24 layers; absolute E and 2,000 beads in 20.
const SAMPLES: [&str; 2] = ["demo.gcode", "cura413-marlin-abs-lines.gcode"];

/// A job, and what each stage of `post` takes.
struct Bench {
    name: String,
    job: Vec<u8>,
    dialect: Dialect,
    habits: FileHabits,
    /// As they are read.
    layers: Vec<Layer>,
    /// As the passes leave them.
    rewritten: Vec<Layer>,
}

impl Bench {
    fn all() -> Vec<Bench> {
        let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus");
        match std::env::var_os("OUTRIGGER_BENCH_JOB") {
            Some(own) => vec![Bench::of(&PathBuf::from(own))],
            None => SAMPLES.iter().map(|file| Bench::of(&corpus.join(file))).collect(),
        }
    }

    fn of(path: &Path) -> Bench {
        let short = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let long = LongJob::of(&short).unwrap_or_else(|| panic!("{}: no layers to repeat", path.display()));
        let (job, dialect) = (long.bytes(JOB_BYTES), long.dialect);
        let mut habits = FileHabits::default();
        habits.read_settings(&short);
        if !habits.is_known() {
            habits.learn(&short[..], dialect).expect("reading from memory");
        }
        let layers = annotate(&job, dialect);
        let mut rewritten = layers.clone();
        reorder(&mut rewritten, &habits);
        let name = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        Bench { name, job, dialect, habits, layers, rewritten }
    }

    fn whole(&self) -> Report {
        let mut input = Cursor::new(&self.job);
        post(&mut input, &mut std::io::sink(), Options::default(), &|_| ()).expect("reading from memory")
    }

    /// Each layer before and after; `None` where it is the same.
    fn pairs(&self) -> Vec<(&Layer, Option<Vec<u8>>)> {
        let output = |old: &Layer, new: &Layer| {
            let mut bytes = Vec::new();
            new.write(&mut bytes);
            (bytes != old.input()).then_some(bytes)
        };
        self.layers.iter().zip(&self.rewritten).map(|(old, new)| (old, output(old, new))).collect()
    }
}

fn annotate(job: &[u8], dialect: Dialect) -> Vec<Layer> {
    let mut reader = Layers::new(job, dialect);
    std::iter::from_fn(|| reader.next_layer().expect("a job of the corpus is fit")).collect()
}

/// Annotates and forgets, layer by layer, as `post` does.
fn annotate_only(job: &[u8], dialect: Dialect) -> usize {
    let mut reader = Layers::new(job, dialect);
    let mut rows = 0;
    while let Some(layer) = reader.next_layer().expect("a job of the corpus is fit") {
        rows += layer.rows.len();
    }
    rows
}

fn reorder(layers: &mut [Layer], habits: &FileHabits) {
    let mut passes = passes::all(Wishes::default(), habits);
    for k in 0..layers.len() {
        let (before, rest) = layers.split_at_mut(k);
        let Some((layer, after)) = rest.split_first_mut() else { return };
        fn cover(layer: Option<&Layer>) -> Option<&Cover> {
            layer.and_then(|l| l.cover.as_ref())
        }
        let neighbours = Neighbours { below: cover(before.last()), above: cover(after.first()) };
        for pass in &mut passes {
            pass.layer(layer, neighbours);
        }
    }
}

fn write(layers: &[Layer], out: &mut Vec<u8>) {
    out.clear();
    for layer in layers {
        layer.write(out);
    }
}

fn verify(pairs: &[(&Layer, Option<Vec<u8>>)], dialect: Dialect) -> f64 {
    let mut verifier = Verifier::new(Some(dialect), Accelerations::default());
    for (layer, output) in pairs {
        verifier.layer(layer.number, layer.input(), output.as_deref()).expect("the passes keep the print");
    }
    verifier.finish(0).expect("the passes keep the print").time_s_after
}

/// The peer of `post`: every line parsed and done by the machine, twice, with
/// nothing else. No verified rewriting can read less.
fn read_twice(job: &[u8]) -> f64 {
    let mut machine = Machine::default();
    for _ in 0..2 {
        for bytes in split_lines(job) {
            black_box(machine.apply(&parse(bytes)));
        }
    }
    machine.e
}

// ------------------------------------------------------------------ orders

/// The infill of one layer, to be ordered.
struct Section {
    beads: Vec<Bead>,
    walls: Walls,
    entry: Point,
}

impl Section {
    fn of(layer: &Layer) -> Option<Section> {
        let (mut beads, mut walls): (Vec<Bead>, Vec<[Point; 2]>) = (Vec::new(), Vec::new());
        let mut open = false;
        for row in &layer.rows {
            let What::Move(m, kind) = row.what else { continue };
            let feature = layer.state(row).feature;
            if kind == Kind::Deposit && feature.is_perimeter() {
                m.chords(|a, b| walls.push([a, b]));
            }
            let infill = kind == Kind::Deposit && feature == Feature::Infill;
            match beads.last_mut().filter(|_| open && infill) {
                Some(bead) => bead.ends[1] = [m.to[0], m.to[1]],
                None if infill => {
                    beads.push(Bead { ends: [[m.from[0], m.from[1]], [m.to[0], m.to[1]]] });
                }
                None => {}
            }
            open = infill || (open && kind == Kind::Still);
        }
        let entry = beads.first().filter(|_| beads.len() > 1)?.ends[0];
        Some(Section { beads, walls: Walls::new(walls), entry })
    }

    fn ends(&self) -> Ends {
        Ends { entry: self.entry, entry_counts: false, exit: None, exit_counts: false }
    }
}

struct Rule<'a> {
    walls: &'a Walls,
    free_within_mm: f64,
}

impl LiftRule for Rule<'_> {
    fn needs_lift(&self, from: Point, to: Point) -> bool {
        distance_mm(from, to) > self.free_within_mm || self.walls.crosses(from, to)
    }
}

/// An order, of every section, and the sum of its costs.
fn order_all(sections: &[Section], mm: f64, order: impl Fn(&Section, &Rule<'_>) -> Cost) -> Cost {
    let mut sum = Cost::ZERO;
    for section in sections {
        let cost = order(section, &Rule { walls: &section.walls, free_within_mm: mm });
        sum = Cost { lifts: sum.lifts + cost.lifts, travel_mm: sum.travel_mm + cost.travel_mm };
    }
    sum
}

fn sliced(s: &Section, rule: &Rule<'_>) -> Cost {
    cost(&as_sliced(s.beads.len()), &s.beads, s.ends(), rule)
}

fn plain_nearest(s: &Section, rule: &Rule<'_>) -> Cost {
    nearest(&s.beads, &Near::new(&s.beads), s.ends(), Start::Entry, rule, Limit::NONE)
        .map_or(Cost::ZERO, |tour| tour.cost)
}

fn restarted(s: &Section, rule: &Rule<'_>) -> Cost {
    never_worse(&as_sliced(s.beads.len()), &s.beads, s.ends(), rule).1
}

// ----------------------------------------------------------------- running

fn benches(c: &mut Criterion) {
    for bench in Bench::all() {
        let Bench { name, job, dialect, habits, layers, rewritten } = &bench;
        let pairs = bench.pairs();
        let mut out = Vec::with_capacity(2 * job.len());
        let mut group = c.benchmark_group(name);
        group.throughput(Throughput::Bytes(job.len() as u64)).sampling_mode(SamplingMode::Flat);
        group.bench_function("annotate", |b| b.iter(|| annotate_only(black_box(job), *dialect)));
        group.bench_function("reorder", |b| {
            b.iter_batched(|| layers.clone(), |mut l| reorder(&mut l, habits), BatchSize::PerIteration);
        });
        group.bench_function("write", |b| b.iter(|| write(black_box(rewritten), &mut out)));
        group.bench_function("verify", |b| b.iter(|| verify(black_box(&pairs), *dialect)));
        group.bench_function("post", |b| b.iter(|| bench.whole()));
        group.finish();
    }
}

fn ratios(ratios: &Ratios) {
    for bench in Bench::all() {
        let (job, size) = (&bench.job, bench.job.len());
        let report = bench.whole();
        eprintln!(
            "\n{}: {:.1} MB, {} layers, {} of {} sections reordered{}",
            bench.name,
            size as f64 / 1e6,
            report.layers,
            report.sections_changed,
            report.sections,
            report.unchanged_reason.map(|why| format!(": {why}")).unwrap_or_default(),
        );
        let annotating = || annotate_only(job, bench.dialect);
        let reading = || read_twice(job);
        ratios.compare(size, ("annotate", annotating), ("parse+apply twice", reading));
        let pairs = bench.pairs();
        let verifying = || verify(&pairs, bench.dialect);
        ratios.compare(size, ("verify", verifying), ("parse+apply twice", reading));
        let (mut out, mut copy) = (Vec::with_capacity(2 * size), Vec::with_capacity(2 * size));
        let copying = || {
            copy.clear();
            copy.extend_from_slice(job);
        };
        ratios.compare(size, ("write", || write(&bench.rewritten, &mut out)), ("copy (memcpy)", copying));
        let whole = ratios.compare(size, ("post", || bench.whole()), ("parse+apply twice", reading));
        ratios.target("post", whole.mb_s(size), TARGET_MB_S);
        orders(ratios, &bench);
    }
}

fn orders(ratios: &Ratios, bench: &Bench) {
    let sections: Vec<Section> = bench.layers.iter().filter_map(Section::of).collect();
    let mm = bench.habits.free_within_mm(0);
    let (own, near) = (restarted, plain_nearest);
    ratios.compare(
        bench.job.len(),
        ("order: restarted where it broke", || order_all(&sections, mm, own)),
        ("order: plain nearest neighbour", || order_all(&sections, mm, near)),
    );
    let beads: usize = sections.iter().map(|s| s.beads.len()).sum();
    eprintln!(
        "sparse infill alone, {beads} beads in {} sections, from each section's first bead:",
        sections.len()
    );
    let orders = [
        ("the slicer's order", sliced as fn(&Section, &Rule<'_>) -> Cost),
        ("plain nearest neighbour", near),
        ("restarted where it broke", own),
    ];
    for (name, order) in orders {
        let Cost { lifts, travel_mm } = order_all(&sections, mm, order);
        eprintln!("  {name:<32} {lifts:>9} lifts {:>12.2} m travel", travel_mm / 1e3);
    }
}

fn main() {
    run(benches, ratios);
}
