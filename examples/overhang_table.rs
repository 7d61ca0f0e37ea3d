//! Islands and overhangs of models, with the time each took.
//!
//! `cargo run --release --example overhang_table -- LAYER_MM ANGLE_DEG BRIDGE_MM PIXEL_MM FILE.stl…`
//!
//! Prints for each model the milliseconds of each stage (overhangs: by all methods
//! together) and the number of islands, then a line for each method: regions, their
//! area, and those below 0.01 mm². An angle of 0 leaves the polygons' method out, a
//! pixel of 0 the images'. Exit status 1 at the first file that cannot be read.
#![allow(clippy::print_stdout)]
use anyhow::Context;
use outrigger::detect::overhang::{Growth, SelfSupport};
use outrigger::detect::walk::{Ask, ImageAsk, LayerAsk, Stage, Watch, walk};
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use std::time::{Duration, Instant};

struct Clock {
    last: Instant,
    spent: [Duration; 4],
}

impl Watch for Clock {
    fn lap(&mut self, stage: Stage) {
        self.spent[stage as usize] += self.last.elapsed();
        self.last = Instant::now();
    }
}

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize| -> anyhow::Result<f64> {
        Ok(arguments.get(k).context("LAYER_MM ANGLE_DEG BRIDGE_MM PIXEL_MM FILE.stl…")?.parse()?)
    };
    let (layer_mm, angle_deg, bridge_mm, pixel_mm) = (number(0)?, number(1)?, number(2)?, number(3)?);
    let rules = SelfSupport { angle_deg, bridge_mm, min_area_mm2: 0.01 };
    for path in &arguments[4..] {
        let bytes = std::fs::read(path).with_context(|| path.clone())?;
        let start = Instant::now();
        let (mesh, _) = outrigger::mesh::read(&mut std::io::Cursor::new(&bytes))?;
        let read = start.elapsed();
        let mut layers = FromMesh::new(&mesh, LayerHeights::even(layer_mm))?;
        let mut clock = Clock { last: Instant::now(), spent: [Duration::ZERO; 4] };
        let layer = (angle_deg > 0.0).then_some(LayerAsk { rules, growth: Growth::Conditional });
        let image = (pixel_mm > 0.0).then_some(ImageAsk { rules, growth: Growth::Conditional, pixel_mm });
        let found = walk(&mut layers, &Ask { min_island_mm2: 0.01, layer, image, resin: false }, &mut clock)?;
        let ms = |d: Duration| d.as_secs_f64() * 1e3;
        let [slice, islands, overhangs, _] = clock.spent;
        println!(
            "{:28} {:5} layers  read {:4.0} slice {:4.0} islands {:4.0} overhangs {:5.0} ms  all {:5.0}  islands {} + {} small",
            path.rsplit('/').next().unwrap_or(path),
            found.layers,
            ms(read),
            ms(slice),
            ms(islands),
            ms(overhangs),
            ms(start.elapsed()),
            found.islands.islands.len(),
            found.islands.small.len(),
        );
        for o in [&found.layer, &found.image].into_iter().flatten() {
            println!(
                "    {:?}: {} regions, {:.3} mm², {} small, {:.3} mm²",
                o.method,
                o.regions.len(),
                o.area_mm2,
                o.small.len(),
                o.small_area_mm2
            );
        }
    }
    Ok(())
}
