//! What a sliced file prints, by its text alone, with the time it took.
//!
//! `cargo run --release --example gcode_layers -- FILE.gcode…`
//!
//! Prints a row for each file: its beads and layers; seconds to read it, and with all
//! layers made; the volume that was extruded, that of the part's layers and of what is
//! printed to help it (supports, skirt, raft …); the polygons' vertices; and how many
//! polygons of the part begin on nothing of the layer below. Exit status 1 at the first
//! file that cannot be read.
#![allow(clippy::print_stdout)]
use anyhow::Context;
use outrigger::layers::from_gcode::{Options, read};
use outrigger::layers::polygon::overlaps;
use outrigger::layers::stack::{Layer, Layers};
use std::fs::File;
use std::io::BufReader;
use std::time::Instant;

fn main() -> anyhow::Result<()> {
    println!(
        "{:>9} {:>6} {:>6} {:>6} {:>9} {:>9} {:>9} {:>8} {:>6}  file",
        "beads", "layers", "read s", "all s", "E mm³", "part mm³", "aid mm³", "vertices", "begin"
    );
    for path in std::env::args().skip(1) {
        row(&path).with_context(|| path.clone())?;
    }
    Ok(())
}

fn row(path: &str) -> anyhow::Result<()> {
    let start = Instant::now();
    let mut job = read(BufReader::new(File::open(path)?), &Options::default())?;
    let read_s = start.elapsed().as_secs_f64();
    let (mut layers, mut part_mm3, mut aid_mm3, mut vertices, mut begin) = (0, 0.0, 0.0, 0, 0);
    let (mut all_s, mut below) = (read_s, None);
    loop {
        // What is counted here is not part of the time.
        let start = Instant::now();
        let batch = job.next_batch()?;
        all_s += start.elapsed().as_secs_f64();
        let Some(batch) = batch else { break };
        for layer in batch {
            layers += 1;
            part_mm3 += layer.part.area_mm2() * layer.thickness_mm();
            aid_mm3 += layer.aid.area_mm2() * layer.thickness_mm();
            vertices += layer.part.len() + layer.aid.len();
            begin += below.as_ref().map_or(0, |below| beginning(below, &layer));
            below = Some(layer);
        }
    }
    let facts = job.facts();
    println!(
        "{:>9} {layers:>6} {read_s:>6.3} {all_s:>6.3} {:>9.1} {part_mm3:>9.1} {aid_mm3:>9.1} {vertices:>8} {begin:>6}  {path}",
        facts.beads, facts.extruded_mm3
    );
    Ok(())
}

/// How many polygons of the part have nothing below.
fn beginning(below: &Layer, layer: &Layer) -> usize {
    let hangs = |polygon: &&_| {
        let mut bearing = below.part.polygons.iter().chain(&below.aid.polygons);
        !bearing.any(|b| overlaps(b, polygon))
    };
    layer.part.polygons.iter().filter(hangs).count()
}
