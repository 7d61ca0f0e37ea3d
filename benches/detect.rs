//! How fast islands and overhangs are found, pair by pair of neighbouring layers.
//!
//! `cargo bench --bench detect`; `OUTRIGGER_BENCH_MESH=FILE.stl` takes a mesh of your
//! own, which stands on the plate, instead of the one that the bench makes.
//!
//! After criterion's own figures it prints ratios to peers timed in the same run, on
//! the same layers and one thread. The peer for islands is the plain way of paper 003
//! (section 3.2, Fig. 5): each layer without the one below, and the layer without that.
//! The peer for overhangs is the plain way of paper 001's peers: the layer below grown
//! by Clipper, and one boolean; it knows neither gaps nor bridges. MB are points of 8 bytes.
#[path = "../gcode/benches/common/mod.rs"]
mod common;
#[path = "common/meshes.rs"]
mod meshes;

use common::ratio::Ratios;
use criterion::{Criterion, SamplingMode, Throughput, criterion_group};
use outrigger::detect::links::{Links, links};
use outrigger::detect::overhang::{Growth, SelfSupport};
use outrigger::detect::overhang_layer::{pieces, reach_mm};
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::polygon::{difference, grow};
use outrigger::layers::stack::{Layer, Layers};
use outrigger::mesh::Mesh;
use std::hint::black_box;
use std::time::Duration;

/// Half of the made mesh's triangles are this squared.
const FINENESS: u32 = 200;

/// Thickness of the layers, mm.
const LAYER_MM: f64 = 0.1;

/// The rules of the first figures: nothing bridges, so that the peer answers the same question.
const PLAIN: SelfSupport = SelfSupport { angle_deg: 45.0, bridge_mm: 0.0, min_area_mm2: 0.0 };

/// A usual material's.
const BRIDGED: SelfSupport = SelfSupport { bridge_mm: 10.0, ..PLAIN };

fn mesh() -> Mesh {
    match std::env::var_os("OUTRIGGER_BENCH_MESH") {
        Some(path) => meshes::read(&std::fs::read(path).expect("a file that can be read")),
        None => meshes::read(&meshes::lumpy_ring(FINENESS)),
    }
}

/// All layers, from the plate up.
fn layers() -> Vec<Layer> {
    let mesh = mesh();
    let mut source = FromMesh::new(&mesh, LayerHeights::even(LAYER_MM)).expect("a mesh that can be sliced");
    let mut layers = Vec::new();
    while let Ok(Some(batch)) = source.next_batch() {
        layers.extend(batch);
    }
    layers
}

fn points(layers: &[Layer]) -> usize {
    layers.iter().map(|layer| layer.part.len()).sum()
}

/// The links of each layer to the one below.
fn linked(layers: &[Layer]) -> Vec<Links> {
    layers.windows(2).map(|pair| links(&pair[0], &pair[1])).collect()
}

/// Polygons that nothing holds.
fn islands(layers: &[Layer]) -> usize {
    let alone = |links: &Links| (0..links.len()).filter(|&k| links.below(k).is_empty()).count();
    linked(layers).iter().map(alone).sum()
}

/// What is left of each layer where its residual is taken away, by booleans.
fn residuals(layers: &[Layer]) -> usize {
    let sustained = |pair: &[Layer]| {
        let (below, layer) = (&pair[0].part, &pair[1].part);
        difference(layer, &difference(layer, below)).len()
    };
    layers.windows(2).map(sustained).sum()
}

/// Overhanging area, mm².
fn overhangs(layers: &[Layer], linked: &[Links], rules: &SelfSupport, growth: Growth) -> f64 {
    let found = layers
        .windows(2)
        .zip(linked)
        .flat_map(|(pair, links)| pieces(&pair[0], &pair[1], links, rules, growth));
    found.map(|piece| piece.polygon.area_mm2()).sum()
}

/// The same by an offset of the whole layer below and one boolean.
fn offsets(layers: &[Layer]) -> f64 {
    let left = |pair: &[Layer]| {
        let held = grow(&pair[0].part, reach_mm(&pair[0], &pair[1], PLAIN.angle_deg));
        difference(&pair[1].part, &held).area_mm2()
    };
    layers.windows(2).map(left).sum()
}

fn benches(c: &mut Criterion) {
    let layers = layers();
    let linked = linked(&layers);
    let mut group = c.benchmark_group("detect");
    group.throughput(Throughput::Elements(points(&layers) as u64)).sampling_mode(SamplingMode::Flat);
    group.bench_function("islands, points", |b| b.iter(|| islands(black_box(&layers))));
    for (name, rules) in [("overhangs, points", PLAIN), ("overhangs and bridges, points", BRIDGED)] {
        let find = || overhangs(black_box(&layers), &linked, &rules, Growth::Conditional);
        group.bench_function(name, |b| b.iter(find));
    }
    group.finish();
}

fn ratios() {
    let ratios = Ratios::from_args();
    let layers = layers();
    let linked = linked(&layers);
    let bytes = 8 * points(&layers);
    eprintln!("\n{} layers, {} points", layers.len(), bytes / 8);
    let (own, peer) = (overhangs(&layers, &linked, &PLAIN, Growth::Conditional), offsets(&layers));
    eprintln!("overhanging: {own:.3} mm² by conditional growth, {peer:.3} mm² by plain offsets");
    ratios.compare(
        bytes,
        ("islands, one thread", || islands(&layers)),
        ("residuals by two booleans", || residuals(&layers)),
    );
    for (name, rules) in [("overhangs, one thread", PLAIN), ("and bridges of 10 mm", BRIDGED)] {
        ratios.compare(
            bytes,
            (name, || overhangs(&layers, &linked, &rules, Growth::Conditional)),
            ("offset and one boolean", || offsets(&layers)),
        );
    }
}

criterion_group! {
    name = detect_benches;
    config = Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(6));
    targets = benches
}

fn main() {
    detect_benches();
    Criterion::default().configure_from_args().final_summary();
    ratios();
}
