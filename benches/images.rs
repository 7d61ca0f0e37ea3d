//! How fast a resin job's pictures become polygons, and are searched for what would go wrong.
//!
//! `cargo bench --bench images`; `OUTRIGGER_BENCH_RESIN=FILE` measures a job of your own
//! besides those that the bench makes: many supports on a panel of 2560 × 1440 px, and
//! a lattice on a 12K panel (11,520 × 5120 px).
//!
//! The peer in the same run is the least that any reader must do: unpacking the
//! archive and the pictures, on as many threads. The target is that contours cost less
//! than that: a ratio of at least 0.5. Searching the pictures besides (islands, traps, cups and the
//! rest, with the polygons' own islands) may cost as much again: a third. A slicer's job keeps both
//! (0.67, 0.35); the two that are made here, with more edges than any, do not yet (0.48, 0.11 to 0.21).
#[path = "../gcode/benches/common/mod.rs"]
mod common;

use common::ratio::Ratios;
use common::run::run;
use criterion::{Criterion, SamplingMode, Throughput};
use outrigger::detect::walk::{Ask, walk};
use outrigger::layers::from_images::FromImages;
use outrigger::layers::stack::Layers;
use outrigger::resin;
use png::{BitDepth, ColorType, Encoder};
use rayon::prelude::*;
use std::hint::black_box;
use std::io::{Cursor, Write};
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

/// A job's bytes, and how many pixels they hold.
struct Bench {
    name: String,
    job: Vec<u8>,
    pixels: usize,
}

impl Bench {
    fn new(name: &str, job: Vec<u8>) -> Bench {
        let opened = resin::open(Cursor::new(&job)).expect("a resin job");
        let panel = opened.panel();
        let pixels = opened.layers().len() * panel.width_px as usize * panel.height_px as usize;
        Bench { name: name.to_owned(), job, pixels }
    }

    fn all() -> Vec<Bench> {
        let mut all = vec![
            Bench::new("supports 1440x2560 x64", job(1440, 2560, 64, supports)),
            Bench::new("lattice 11520x5120 x6", job(11_520, 5120, 6, lattice)),
        ];
        if let Some(path) = std::env::var_os("OUTRIGGER_BENCH_RESIN") {
            let bytes = std::fs::read(&path).expect("the file of OUTRIGGER_BENCH_RESIN");
            all.push(Bench::new(&path.to_string_lossy(), bytes));
        }
        all
    }

    /// Corners of all layers.
    fn contours(&self) -> usize {
        let job = resin::open(Cursor::new(&self.job)).expect("a resin job");
        let mut layers = FromImages::new(job);
        let mut corners = 0;
        while let Some(batch) = layers.next_batch().expect("layers") {
            corners += batch.iter().map(|l| l.part.len()).sum::<usize>();
        }
        corners
    }

    /// Issues of all layers.
    fn searched(&self) -> usize {
        let job = resin::open(Cursor::new(&self.job)).expect("a resin job");
        let ask = Ask { resin: true, ..Ask::default() };
        let found = walk(&mut FromImages::new(job).keeping_pictures(), &ask, &mut ()).expect("layers");
        found.resin.map_or(0, |issues| issues.list.len())
    }

    /// Rows of all pictures.
    fn unpacked(&self) -> usize {
        let mut job = resin::open(Cursor::new(&self.job)).expect("a resin job");
        let panel = job.panel();
        let number = job.layers().len() as u32;
        let mut rows = 0;
        for first in (0..number).step_by(32) {
            let batch: Vec<Vec<u8>> =
                (first..number.min(first + 32)).map(|i| job.packed(i).expect("a picture")).collect();
            let count = |png: &Vec<u8>| {
                let mut rows = 0;
                panel.rows(png, |row| rows += black_box(row).len().min(1)).expect("a picture");
                rows
            };
            rows += batch.par_iter().map(count).sum::<usize>();
        }
        rows
    }
}

/// Brightness of a pixel whose middle is inside a shape by so much, anti-aliased.
fn covered(inside_px: f64) -> u8 {
    ((inside_px + 0.5).clamp(0.0, 1.0) * 255.0) as u8
}

/// Pillars of 0.8 mm each 2.4 mm, leaning a little from layer to layer, on pixels of 0.047 mm.
fn supports(layer: u32, x: u32, y: u32) -> u8 {
    let centre = |c: u32| f64::from((c + layer / 3) % 51) - 25.0;
    covered(8.5 - centre(x).hypot(centre(y)))
}

/// A lattice of holes of 1.1 mm each 1.5 mm, on pixels of 0.019 mm.
fn lattice(layer: u32, x: u32, y: u32) -> u8 {
    let centre = |c: u32| f64::from((c + layer) % 79) - 39.0;
    if x < 200 || y < 200 { 0 } else { 255 - covered(29.0 - centre(x).hypot(centre(y))) }
}

/// An SL1 job of a panel in landscape.
fn job(width: u32, height: u32, layers: u32, brightness: fn(u32, u32, u32) -> u8) -> Vec<u8> {
    let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
    let mut put = |name: &str, bytes: &[u8]| {
        zip.start_file(name, SimpleFileOptions::default()).expect("a new entry");
        zip.write_all(bytes).expect("written");
    };
    let config = format!("expTime = 2\njobDir = job\nlayerHeight = 0.05\nnumFast = {layers}\n");
    put("config.ini", config.as_bytes());
    let [wide, high] = [width, height].map(|px| f64::from(px) * 0.05);
    let settings = format!(
        "display_width = {wide}\ndisplay_height = {high}\ndisplay_pixels_x = {width}\ndisplay_pixels_y = {height}\n"
    );
    put("prusaslicer.ini", settings.as_bytes());
    for layer in 0..layers {
        let row = |y: u32| (0..width).map(move |x| brightness(layer, x, y));
        let pixels: Vec<u8> = (0..height).into_par_iter().flat_map_iter(row).collect();
        let mut png = Vec::new();
        let mut encoder = Encoder::new(&mut png, width, height);
        encoder.set_color(ColorType::Grayscale);
        encoder.set_depth(BitDepth::Eight);
        let mut writer = encoder.write_header().expect("a header");
        writer.write_image_data(&pixels).expect("a picture");
        writer.finish().expect("a picture");
        put(&format!("job{layer:05}.png"), &png);
    }
    zip.finish().expect("an archive").into_inner()
}

fn benches(c: &mut Criterion) {
    for bench in Bench::all() {
        let mut group = c.benchmark_group(format!("images/{}", bench.name));
        group.sampling_mode(SamplingMode::Flat).throughput(Throughput::Bytes(bench.pixels as u64));
        group.bench_function("contours", |b| b.iter(|| bench.contours()));
        group.bench_function("searched", |b| b.iter(|| bench.searched()));
        group.bench_function("unpacking alone", |b| b.iter(|| bench.unpacked()));
    }
}

fn ratios(ratios: &Ratios) {
    for bench in Bench::all() {
        eprintln!("{}: {} MPx, {} corners", bench.name, bench.pixels / 1_000_000, bench.contours());
        let contours = || bench.contours();
        ratios.compare(bench.pixels, ("contours", contours), ("unpacking alone", || bench.unpacked()));
        let searched = || bench.searched();
        ratios.compare(bench.pixels, ("searched", searched), ("unpacking alone", || bench.unpacked()));
    }
}

fn main() {
    run(benches, ratios);
}
