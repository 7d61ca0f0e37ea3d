//! How well overhangs by polygons and by images agree.
//!
//! `cargo run --release --example overhang_agreement -- LAYER_MM ANGLE_DEG PIXEL_MM FILE.stl…`
//!
//! Prints for each model the overhanging area (mm²) by polygons and by images of the same
//! layers, with the same conditional growth, and how well they agree in three ways.
//! *Total* compares the sums. *By layer* adds up the differences of each layer, so that no
//! layer makes up for another. *By place* is the area that only one of the two reports
//! over the area that either does, with the polygons looked at as an image: a pixel is
//! theirs if its centre is. (Without that, the steps of the pixels alone would be the
//! difference.) Exit status 1 at the first file that cannot be read.
#![allow(clippy::print_stdout)]
use anyhow::Context;
use outrigger::detect::links::links;
use outrigger::detect::overhang::{Growth, Piece, SelfSupport};
use outrigger::detect::{overhang_image, overhang_layer};
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::polygon::{difference, intersection};
use outrigger::layers::shape::Region;
use outrigger::layers::stack::{Layer, Layers};
use rayon::prelude::*;

fn main() -> anyhow::Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize| -> anyhow::Result<f64> {
        Ok(arguments.get(k).context("LAYER_MM ANGLE_DEG PIXEL_MM FILE.stl…")?.parse()?)
    };
    let (layer_mm, angle_deg, pixel_mm) = (number(0)?, number(1)?, number(2)?);
    let rules = SelfSupport { angle_deg, bridge_mm: 0.0, min_area_mm2: 0.0 };
    println!("{:28} {:>10} {:>10}  total  by layer  by place", "model", "polygons", "images");
    for path in &arguments[3..] {
        let bytes = std::fs::read(path).with_context(|| path.clone())?;
        let (mesh, _) = outrigger::mesh::read(&mut std::io::Cursor::new(&bytes))?;
        let mut layers = FromMesh::new(&mesh, LayerHeights::even(layer_mm))?;
        let mut below = Layer::default();
        let mut sums = [0.0; 5];
        while let Some(batch) = layers.next_batch()? {
            let pairs: Vec<(&Layer, &Layer)> = std::iter::once(&below).chain(&batch).zip(&batch).collect();
            let found: Vec<[f64; 5]> =
                pairs.par_iter().map(|(b, l)| compare(b, l, &rules, pixel_mm)).collect();
            found.iter().for_each(|f| (0..5).for_each(|k| sums[k] += f[k]));
            below = batch.into_iter().next_back().unwrap_or_default();
        }
        let [polygons, images, apart, only, either] = sums;
        println!(
            "{:28} {polygons:10.3} {images:10.3}  {:5.2} %  {:5.2} %  {:5.2} %",
            path.rsplit('/').next().unwrap_or(path),
            agreement((polygons - images).abs(), images),
            agreement(apart, images),
            agreement(only, either),
        );
    }
    Ok(())
}

/// Percent of an area that is not off; nothing of nothing agrees.
fn agreement(off_mm2: f64, of_mm2: f64) -> f64 {
    if off_mm2 == 0.0 { 100.0 } else { 100.0 * (1.0 - off_mm2 / of_mm2) }
}

/// Area by polygons, by images, their difference, the area of one alone, and of either.
fn compare(below: &Layer, layer: &Layer, rules: &SelfSupport, pixel_mm: f64) -> [f64; 5] {
    let links = links(below, layer);
    let reach = overhang_layer::reach_mm(below, layer, rules.angle_deg);
    let region = |pieces: Vec<Piece>| -> Region { pieces.into_iter().map(|p| p.polygon).collect() };
    let polygons = region(overhang_layer::pieces(below, layer, &links, rules, Growth::Conditional));
    let images = region(overhang_image::pieces(below, layer, &links, reach, Growth::Conditional, pixel_mm));
    let seen = Region { polygons: overhang_image::pixels(&polygons.polygons, pixel_mm) };
    let only = difference(&seen, &images).area_mm2() + difference(&images, &seen).area_mm2();
    let both = intersection(&seen, &images).area_mm2();
    let (a, b) = (polygons.area_mm2(), images.area_mm2());
    [a, b, (a - b).abs(), only, only + both]
}
