//! Supports of many models by three methods: tips, material, time, what cannot be held.
//!
//! `cargo run --release --example support_table -- DIR [WORDS]`: every STL of DIR whose name
//! holds one of the words, as a filament print (0.2 mm layers) and as a resin print (0.05 mm).
//!
//! Exits with 1 when a file cannot be done, when ours takes more than 85 % of the baseline's
//! material in all or more tips, or when an overhang is farther from its tip than the rules say.
//!
//! By *straight* (the fewest tips, a column each), *baseline* (tips at a fixed distance,
//! trees as in "Clever Support"; what paper 000 measures itself against) and *ours*. The
//! material is the volume of the printed layers: the area of each section times its height.
//! `far` is the distance from overhanging places to their nearest tip and `area` what a tip
//! carries, both at the 95th percentile by area. `scar` is what its tips scar on average by
//! the planner's own measure; `on edges` counts those within 0.5 mm of an edge of the mesh that
//! sticks out and turns by 45° or more.
#![allow(clippy::print_stdout)]
use outrigger::detect::overhang::SelfSupport;
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::shape::{Bounds, Point, Region};
use outrigger::mesh::{self, Mesh, OPEN, place};
use outrigger::support::cut::Cuts;
use outrigger::support::look::{Look, look};
use outrigger::support::plan::{Branching, Placing, Plan, plan};
use outrigger::support::rules::{Process, Rules};
use outrigger::support::scar::Eye;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let mut args = std::env::args().skip(1);
    let Some(dir) = args.next() else {
        eprintln!("usage: support_table DIR [WORDS]");
        return ExitCode::from(2);
    };
    let words: Vec<String> = args.collect();
    let mut files: Vec<PathBuf> = std::fs::read_dir(&dir)
        .expect("the folder of models")
        .filter_map(|e| Some(e.ok()?.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "stl"))
        .filter(|p| {
            let name = p.file_name().unwrap_or_default().to_string_lossy();
            words.is_empty() || words.iter().any(|w| name.contains(w.as_str()))
        })
        .collect();
    files.sort();
    println!(
        "| model | print | method | tips | at least | junctions | plate | model | length mm | volume mm³ | far mm | area mm² | scar | on edges | unheld | s |"
    );
    println!("|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    let mut sums = Sums::default();
    for file in &files {
        for process in [Process::Filament, Process::Resin] {
            if let Err(error) = rows(file, process, &mut sums) {
                println!("| {} | {process:?} | {error} |", file.display());
                sums.faults += 1;
            }
        }
    }
    sums.print();
    if sums.holds() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

#[derive(Default)]
struct Sums {
    /// By process and method: tips, volume of models that all methods hold alike.
    tips: [[f64; 3]; 2],
    volume: [[f64; 3]; 2],
    ratios: [Vec<f64>; 2],
    /// What the tips scar, summed, and how many of them are on edges.
    scar: [[f64; 3]; 2],
    on_edges: [[u32; 3]; 2],
    /// Files that could not be done, and rows of ours with tips too far.
    faults: u32,
}

/// An edge turns by at least so much, degrees.
const SHARP_DEG: f64 = 45.0;

/// A tip is on an edge that is so near, mm.
const EDGE_MM: f64 = 0.5;

/// Most material of ours, as a share of the baseline's.
const MOST: f64 = 0.85;

impl Sums {
    fn holds(&self) -> bool {
        let less =
            |k: usize| self.volume[k][2] <= MOST * self.volume[k][1] && self.tips[k][2] <= self.tips[k][1];
        self.faults == 0 && (0..2).all(less)
    }

    fn print(&self) {
        for (k, name) in ["filament", "resin"].iter().enumerate() {
            let (tips, volume) = (self.tips[k], self.volume[k]);
            let mut ratios = self.ratios[k].clone();
            ratios.sort_by(f64::total_cmp);
            let middle = ratios.get(ratios.len() / 2).copied().unwrap_or(f64::NAN);
            let scar: Vec<String> =
                (0..3).map(|m| format!("{:.3}", self.scar[k][m] / tips[m].max(1.0))).collect();
            let on_edges = self.on_edges[k].map(|count| count.to_string());
            println!(
                "\n{name}: tips {:.0} / {:.0} / {:.0}, volume {:.0} / {:.0} / {:.0} mm³ (straight / baseline / ours): ours {:.1} % less than the baseline in all, {:.1} % by the median model",
                tips[0],
                tips[1],
                tips[2],
                volume[0],
                volume[1],
                volume[2],
                100.0 * (1.0 - volume[2] / volume[1]),
                100.0 * (1.0 - middle)
            );
            println!(
                "{name}: a tip scars {} on average, and {} tips are on edges",
                scar.join(" / "),
                on_edges.join(" / ")
            );
        }
    }
}

fn rows(file: &Path, process: Process, sums: &mut Sums) -> Result<(), String> {
    let (layer_mm, own) = match process {
        Process::Filament => (0.2, SelfSupport { angle_deg: 45.0, bridge_mm: 10.0, min_area_mm2: 0.16 }),
        Process::Resin => (0.05, SelfSupport { angle_deg: 55.0, bridge_mm: 2.0, min_area_mm2: 0.01 }),
    };
    let bytes = std::fs::read(file).map_err(|e| e.to_string())?;
    let began = Instant::now();
    let (mut mesh, _) = mesh::read(&mut Cursor::new(bytes)).map_err(|e| e.to_string())?;
    place::place(&mut mesh, &place::Placing::default()).map_err(|e| e.to_string())?;
    let [min, max] = mesh.bounds_mm();
    let bounds = Bounds { min: Point::from_mm(min[0], min[1]), max: Point::from_mm(max[0], max[1]) };
    let rules = Rules::usual(process, layer_mm);
    let mut layers = FromMesh::new(&mesh, LayerHeights::even(layer_mm)).map_err(|e| e.to_string())?;
    let seen = look(&mut layers, (bounds, max[2]), &Region::default(), own, &rules, &mut ())
        .map_err(|e| e.to_string())?;
    let looked = began.elapsed().as_secs_f64();
    let ways = [
        ("straight", Placing::Cover, Branching::Straight),
        ("baseline", Placing::Fixed, Branching::Vanek),
        ("ours", Placing::Cover, Branching::Tree),
    ];
    let k = usize::from(process == Process::Resin);
    let (eye, edges) = (Eye::new(&seen.space), edges(&mesh));
    let mut volumes = [0.0; 3];
    for (m, (name, placing, branching)) in ways.into_iter().enumerate() {
        let began = Instant::now();
        let made = plan(&seen.demand, &seen.space, &rules, placing, branching);
        let seconds = looked + began.elapsed().as_secs_f64();
        let volume = Cuts::new(&made.forest, 0.0).volume_in_mm3(layer_mm);
        let tally = made.forest.tally();
        let (far, area) = percentiles(&seen, &made);
        let places: Vec<[f64; 3]> =
            made.points.tips.iter().map(|t| seen.demand.needs[t.need as usize].at_mm).collect();
        let scar: f64 = places.iter().map(|at| eye.scar(*at).weight()).sum();
        let near = |at: &&[f64; 3]| edges.iter().any(|e| off_mm(**at, *e) <= EDGE_MM);
        let on_edges = places.iter().filter(near).count() as u32;
        println!(
            "| {} | {process:?} | {name} | {} | {} | {} | {} | {} | {:.0} | {volume:.1} | {far:.2} | {area:.2} | {:.3} | {on_edges} | {} | {seconds:.2} |",
            file.file_stem().unwrap_or_default().to_string_lossy(),
            tally.tips,
            made.points.at_least,
            tally.junctions,
            tally.trunks_on_plate,
            tally.landings_on_model,
            tally.length_mm,
            scar / f64::from(tally.tips.max(1)),
            made.points.unheld.len(),
        );
        sums.faults += u32::from(name == "ours" && far > rules.spacing_mm + 1e-9);
        sums.tips[k][m] += f64::from(tally.tips);
        sums.volume[k][m] += volume;
        sums.scar[k][m] += scar;
        sums.on_edges[k][m] += on_edges;
        volumes[m] = volume;
    }
    if volumes[1] > 0.0 {
        sums.ratios[k].push(volumes[2] / volumes[1]);
    }
    Ok(())
}

/// Distance to the nearest tip, and area of a tip, at the 95th percentile by area. Places that
/// the plan says it cannot hold are counted in their own column.
fn percentiles(seen: &Look, made: &Plan) -> (f64, f64) {
    let needs = &seen.demand.needs;
    let tips: Vec<[f64; 3]> = made.points.tips.iter().map(|t| needs[t.need as usize].at_mm).collect();
    let mut far: Vec<(f64, f64)> = needs
        .iter()
        .filter(|n| !made.points.unheld_mm.contains(&n.at_mm))
        .map(|n| {
            let apart = |t: &[f64; 3]| (0..3).map(|k| (t[k] - n.at_mm[k]).powi(2)).sum::<f64>();
            let least = tips.iter().map(apart).fold(f64::INFINITY, f64::min);
            (least.sqrt(), n.area_mm2)
        })
        .collect();
    let mut area: Vec<(f64, f64)> = made.points.tips.iter().map(|t| (t.area_mm2, t.area_mm2)).collect();
    (at_95(&mut far), at_95(&mut area))
}

fn at_95(values: &mut [(f64, f64)]) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = values.iter().map(|v| v.1).sum();
    let mut sum = 0.0;
    for (value, weight) in values.iter() {
        sum += weight;
        if sum >= 0.95 * all {
            return *value;
        }
    }
    0.0
}

/// Edges of the mesh that stick out and turn by at least [`SHARP_DEG`], by their ends, mm.
fn edges(mesh: &Mesh) -> Vec<[[f64; 3]; 2]> {
    let corner = |h: usize| mesh.vertices[mesh.triangles[h / 3][h % 3] as usize];
    let next = |h: usize| h / 3 * 3 + (h + 1) % 3;
    // The triangle's plane, and the corner that is not on the edge.
    let side = |h: usize| {
        let [a, b, c] = [corner(h), corner(next(h)), corner(next(next(h)))];
        let (u, v) = (less(b, a), less(c, a));
        let normal = [0, 1, 2].map(|k| u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3]);
        let long = dot(normal, normal).sqrt();
        (normal.map(|n| n / long), c)
    };
    let pairs = mesh.twins.iter().enumerate().filter(|(h, twin)| **twin != OPEN && *h < **twin as usize);
    let sharp = pairs.filter(|(h, twin)| {
        let ((own, _), (other, beyond)) = (side(*h), side(**twin as usize));
        dot(own, other) <= SHARP_DEG.to_radians().cos() && dot(own, less(beyond, corner(*h))) < 0.0
    });
    sharp.map(|(h, _)| [corner(h), corner(next(h))]).collect()
}

/// How far a place is from a piece of a line, mm.
fn off_mm(at: [f64; 3], [a, b]: [[f64; 3]; 2]) -> f64 {
    let (along, to) = (less(b, a), less(at, a));
    let t = (dot(along, to) / dot(along, along)).clamp(0.0, 1.0);
    let off = less(to, along.map(|c| c * t));
    dot(off, off).sqrt()
}

fn less(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|k| a[k] - b[k])
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}
