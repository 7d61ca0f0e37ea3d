//! How fast STL files become mended meshes, and the ratio to `stl_io`'s own index.
//!
//! `cargo bench --bench mesh`; `OUTRIGGER_BENCH_STL=FILE.stl` takes a file of your own
//! besides. The bodies are wrinkled tori of 700,000 triangles, made here: in the order
//! in which a program would write them, in no order, and damaged.
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use common::ratio::Ratios;
use common::run::run;
use criterion::{Criterion, SamplingMode, Throughput};
use outrigger::mesh::read;
use std::f32::consts::TAU;
use std::hint::black_box;
use std::io::Cursor;

/// Rings of the torus, and quadrilaterals in each.
const RINGS: usize = 700;
const QUADS: usize = 500;

/// Least throughput for a closed mesh, MB/s of the file.
const TARGET_MB_S: f64 = 500.0;

type Triangle = [[f32; 3]; 3];

fn torus() -> Vec<Triangle> {
    let place = |i: usize, j: usize| {
        let (u, v) = ((i % RINGS) as f32 / RINGS as f32 * TAU, (j % QUADS) as f32 / QUADS as f32 * TAU);
        let small = 10.0 + 0.5 * (23.0 * u).sin() * (17.0 * v).cos();
        let r = 30.0 + small * v.cos();
        [r * u.cos(), r * u.sin(), small * v.sin()]
    };
    let mut triangles = Vec::with_capacity(RINGS * QUADS * 2);
    for i in 0..RINGS {
        for j in 0..QUADS {
            let [a, b, c, d] = [place(i, j), place(i + 1, j), place(i + 1, j + 1), place(i, j + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    triangles
}

/// The same triangles in no order: a full cycle of a multiplicative step.
fn shuffled(triangles: &[Triangle]) -> Vec<Triangle> {
    let step = 433_494_437; // a prime that does not divide the count
    (0..triangles.len()).map(|k| triangles[k * step % triangles.len()]).collect()
}

/// Each 50th triangle lost, flipped, there twice, or cut at an edge that its neighbour keeps whole.
fn damaged(triangles: &[Triangle]) -> Vec<Triangle> {
    let mut out = Vec::with_capacity(triangles.len() * 11 / 10);
    for (k, &[a, b, c]) in triangles.iter().enumerate() {
        match (k % 50, k / 50 % 4) {
            (0, 0) => (),
            (0, 1) => out.push([b, a, c]),
            (0, 2) => out.extend([[a, b, c]; 2]),
            (0, _) => {
                let middle = [0, 1, 2].map(|i| (a[i] + b[i]) / 2.0);
                out.extend([[a, middle, c], [middle, b, c]]);
            }
            _ => out.push([a, b, c]),
        }
    }
    out
}

fn binary(triangles: &[Triangle]) -> Vec<u8> {
    let mut file = vec![0; 80];
    file.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        file.extend([0; 12]);
        t.as_flattened().iter().for_each(|c| file.extend(c.to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}

fn ascii(triangles: &[Triangle]) -> Vec<u8> {
    let mut text = String::from("solid torus\n");
    for t in triangles {
        text.push_str("facet normal 0 0 0\n outer loop\n");
        for [x, y, z] in t {
            text.push_str(&format!("  vertex {x:e} {y:e} {z:e}\n"));
        }
        text.push_str(" endloop\nendfacet\n");
    }
    text.push_str("endsolid torus\n");
    text.into_bytes()
}

fn files() -> Vec<(&'static str, Vec<u8>)> {
    let whole = torus();
    let mut files = vec![
        ("binary", binary(&whole)),
        ("binary, no order", binary(&shuffled(&whole))),
        ("binary, damaged", binary(&damaged(&whole))),
        ("ascii", ascii(&whole[..whole.len() / 4])),
    ];
    if let Some(own) = std::env::var_os("OUTRIGGER_BENCH_STL") {
        files.push(("own", std::fs::read(&own).unwrap_or_else(|e| panic!("{}: {e}", own.display()))));
    }
    files
}

fn ours(file: &[u8]) -> usize {
    read(&mut Cursor::new(file)).expect("a mesh").0.triangles.len()
}

fn stl_ios(file: &[u8]) -> usize {
    stl_io::read_stl(&mut Cursor::new(file)).expect("a mesh").faces.len()
}

fn benches(c: &mut Criterion) {
    let mut group = c.benchmark_group("mesh");
    group.sampling_mode(SamplingMode::Flat);
    for (name, file) in files() {
        group.throughput(Throughput::Bytes(file.len() as u64));
        group.bench_function(name, |b| b.iter(|| ours(black_box(&file))));
    }
    group.finish();
}

fn ratios(ratios: &Ratios) {
    eprintln!("\nreading, indexing, neighbours and mends against stl_io's reading and indexing:");
    for (name, file) in files() {
        let timed =
            ratios.compare(file.len(), (name, || ours(&file)), ("stl_io::read_stl", || stl_ios(&file)));
        if name == "binary" {
            ratios.target(name, timed.mb_s(file.len()), TARGET_MB_S);
        }
        if name.starts_with("binary") {
            let (_, report) = read(&mut Cursor::new(&file)).expect("a mesh");
            eprintln!("  {}", report.mended);
        }
    }
}

fn main() {
    run(benches, ratios);
}
