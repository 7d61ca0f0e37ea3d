//! How fast a mesh is sliced, and the polygons of its layers are worked on.
//!
//! `cargo bench --bench slice`; `OUTRIGGER_BENCH_MESH=FILE.stl` takes a mesh of your
//! own, which stands on the plate, instead of the one that the bench makes.
//!
//! After criterion's own figures it prints ratios to peers timed in the same run, on
//! the same contours and one thread where it says so. MB are points of 8 bytes.
#[path = "../gcode/benches/common/mod.rs"]
mod common;
#[path = "common/meshes.rs"]
mod meshes;

use common::ratio::Ratios;
use common::run::run;
use criterion::{Criterion, SamplingMode, Throughput};
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::nest::Nester;
use outrigger::layers::polygon::{self, Inside};
use outrigger::layers::shape::{Region, Ring};
use outrigger::layers::stack::Layers;
use outrigger::mesh::Mesh;
use std::hint::black_box;

/// Half of the made mesh's triangles are this squared.
const FINENESS: u32 = 300;

/// Thickness of the layers, mm.
const LAYER_MM: f64 = 0.025;

/// Thickness of those whose polygons are worked on one by one, mm.
const COARSE_MM: f64 = 0.2;

/// How far regions grow, mm.
const GROWN_MM: f64 = 0.1;

fn mesh() -> Mesh {
    match std::env::var_os("OUTRIGGER_BENCH_MESH") {
        Some(path) => meshes::read(&std::fs::read(path).expect("a file that can be read")),
        None => meshes::read(&meshes::lumpy_ring(FINENESS)),
    }
}

/// Every layer's part.
fn slice(mesh: &Mesh, layer_mm: f64) -> Vec<Region> {
    let mut source = FromMesh::new(mesh, LayerHeights::even(layer_mm)).expect("a mesh that can be sliced");
    let mut parts = Vec::new();
    while let Ok(Some(batch)) = source.next_batch() {
        parts.extend(batch.into_iter().map(|layer| layer.part));
    }
    parts
}

/// Slices and forgets, batch by batch.
fn slice_only(mesh: &Mesh) -> usize {
    let mut source = FromMesh::new(mesh, LayerHeights::even(LAYER_MM)).expect("a mesh that can be sliced");
    let mut points = 0;
    while let Ok(Some(batch)) = source.next_batch() {
        points += batch.iter().map(|layer| layer.part.len()).sum::<usize>();
    }
    points
}

fn benches(c: &mut Criterion) {
    let mesh = mesh();
    let crossings = FromMesh::new(&mesh, LayerHeights::even(LAYER_MM)).expect("a mesh").crossings();
    let mut group = c.benchmark_group("slice");
    group.throughput(Throughput::Elements(crossings)).sampling_mode(SamplingMode::Flat);
    group.bench_function("crossings of 0.025 mm layers", |b| b.iter(|| slice_only(black_box(&mesh))));
    group.finish();
}

fn ratios(ratios: &Ratios) {
    let mesh = mesh();
    let bytes = |regions: &[Region]| 8 * regions.iter().map(Region::len).sum::<usize>();
    let fine = slice(&mesh, LAYER_MM);
    let resolve = |r: &Region| polygon::resolve(r.rings(), Inside::Positive).len();
    eprintln!("\n{} triangles, {} layers, {} points", mesh.triangles.len(), fine.len(), bytes(&fine) / 8);
    ratios.compare(
        bytes(&fine),
        ("slice, all cores", || slice_only(&mesh)),
        ("resolve the same, one thread", || fine.iter().map(resolve).sum::<usize>()),
    );
    drop(fine);
    let parts = slice(&mesh, COARSE_MM);
    let size = bytes(&parts);
    let rings: Vec<Vec<Ring>> = parts.iter().map(|r| r.rings().cloned().collect()).collect();
    let mut nester = Nester::default();
    ratios.compare(
        size,
        ("nest", || rings.iter().map(|r| nester.nest(r).map_or(0, |r| r.len())).sum::<usize>()),
        ("resolve", || parts.iter().map(resolve).sum::<usize>()),
    );
    for mm in [GROWN_MM, -GROWN_MM] {
        ratios.compare(
            size,
            (&format!("grow by {mm} mm"), || parts.iter().map(|r| polygon::grow(r, mm).len()).sum::<usize>()),
            ("resolve", || parts.iter().map(resolve).sum::<usize>()),
        );
    }
    let pairs = || parts.windows(2);
    ratios.compare(
        size,
        ("difference of neighbours", || {
            pairs().map(|p| polygon::difference(&p[1], &p[0]).len()).sum::<usize>()
        }),
        ("resolve", || parts.iter().map(resolve).sum::<usize>()),
    );
    ratios.compare(
        size,
        ("overlaps of neighbours", || {
            pairs()
                .filter(|p| {
                    p[0].polygons.iter().any(|a| p[1].polygons.iter().any(|b| polygon::overlaps(a, b)))
                })
                .count()
        }),
        ("resolve", || parts.iter().map(resolve).sum::<usize>()),
    );
}

fn main() {
    run(benches, ratios);
}
