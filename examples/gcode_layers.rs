//! What a sliced file prints, by its text alone: layers, time, volume, and how many pieces begin on nothing.
//!
//! `cargo run --release --example gcode_layers -- FILE.gcode…`
use outrigger::layers::from_gcode::{Options, read};
use outrigger::layers::polygon::overlaps;
use outrigger::layers::shape::Polygon;
use outrigger::layers::stack::{Layer, Layers};
use std::io::BufReader;
use std::time::Instant;

fn bearing(layer: &Layer) -> impl Iterator<Item = &Polygon> {
    layer.part.polygons.iter().chain(&layer.aid.polygons)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!(
        "{:>9} {:>6} {:>6} {:>6} {:>9} {:>9} {:>9} {:>8} {:>6}  file",
        "beads", "layers", "read s", "all s", "E mm³", "part mm³", "aid mm³", "vertices", "begin"
    );
    for file in std::env::args().skip(1) {
        let start = Instant::now();
        let mut job = match read(BufReader::new(std::fs::File::open(&file)?), &Options::default()) {
            Ok(job) => job,
            Err(e) => {
                println!("{file}: {e}");
                continue;
            }
        };
        let read_s = start.elapsed().as_secs_f64();
        let facts = job.facts().clone();
        let (mut part, mut aid, mut vertices, mut begin) = (0.0, 0.0, 0, 0);
        let (mut seconds, mut layers) = (read_s, 0);
        let mut below: Option<Layer> = None;
        let mut wheres = Vec::new();
        loop {
            let start = Instant::now();
            let Some(batch) = job.next_batch()? else { break };
            seconds += start.elapsed().as_secs_f64();
            for layer in batch {
                layers += 1;
                part += layer.part.area_mm2() * layer.thickness_mm();
                aid += layer.aid.area_mm2() * layer.thickness_mm();
                vertices += layer.part.len() + layer.aid.len();
                if std::env::var("DUMP").is_ok_and(|n| n == layer.number.to_string()) {
                    for (name, region) in [("part", &layer.part), ("aid", &layer.aid)] {
                        for ring in region.rings() {
                            let points: Vec<_> = ring.iter().map(|p| p.mm()).collect();
                            println!("RING {name} {points:?}");
                        }
                    }
                }
                if let Some(below) = &below {
                    for polygon in &layer.part.polygons {
                        let bounds = polygon.bounds();
                        if !bearing(below).any(|b| b.bounds().overlap(bounds) && overlaps(b, polygon)) {
                            begin += 1;
                            wheres.push((
                                layer.number,
                                layer.top_mm,
                                polygon.area_mm2(),
                                polygon.centroid_mm(),
                            ));
                        }
                    }
                }
                below = Some(layer);
            }
        }
        println!(
            "{:>9} {layers:>6} {read_s:>6.3} {seconds:>6.3} {:>9.1} {part:>9.1} {aid:>9.1} {vertices:>8} {begin:>6}  {file}",
            facts.beads, facts.extruded_mm3
        );
        if std::env::var_os("VERBOSE").is_some() {
            println!("{facts:?}");
            for (number, top, area, at) in wheres.iter().take(20) {
                println!("  layer {number} Z {top:.3}: {area:.3} mm² at {:.2} {:.2}", at[0], at[1]);
            }
        }
    }
    Ok(())
}
