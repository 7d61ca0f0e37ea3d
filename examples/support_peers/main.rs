//! Our supports beside those of PrusaSlicer (SLA) and Cura (trees), for the same demand.
//!
//! ```text
//! cargo run --release --example support_peers -- [OPTIONS] MODEL.stl BARE.sl1 WITH.sl1…
//! cargo run --release --example support_peers -- [OPTIONS] MODEL.stl TREES.gcode…
//!   --angle DEG   what holds itself, from the vertical; else 55 in resin, 45 in filament
//!   --above MM    what is lower counts for nobody: a pad
//! ```
//! The peers' files, in layers of one height. The peers' tip and pillar are 0.4 and 1 mm by
//! default, as ours; the foot is not:
//! ```text
//! SLA="prusa-slicer --export-sla --printer-technology SLA --layer-height 0.05
//!   --initial-layer-height 0.05 --display-width 120 --display-height 120 --display-pixels-x 2560
//!   --display-pixels-y 2560 --display-orientation landscape --gamma-correction 0
//!   --bed-shape 0x0,120x0,120x120,0x120 --center 60,60"
//! $SLA --pad-enable=0 --supports-enable=0 -o bare.sl1 MODEL.stl
//! $SLA --pad-enable=0 --supports-enable=1 --support-base-diameter 3 --support-base-height 0.6
//!   -o raised.sl1 MODEL.stl
//! $SLA --supports-enable=1 … --pad-enable=1 --pad-around-object=1 --pad-wall-thickness 0.1
//!   --pad-brim-size 0.1 -o flat.sl1 MODEL.stl                       (the part on the plate)
//! CuraEngine slice -j fdmprinter.def.json -s layer_height=0.2 -s layer_height_0=0.2
//!   -s support_enable=true -s support_structure=tree -s support_tree_enable=true
//!   -s support_angle=50 -s adhesion_type=none -s center_object=true
//!   -s support_infill_rate=0 -s support_line_distance=0 -s support_initial_layer_line_distance=0
//!   -s support_top_distance=0.3 -l MODEL.stl -o trees.gcode
//! ```
//! (CuraEngine alone takes a setting's default and not its formula: the last line gives what the
//! formulas of `fdmprinter.def.json` say for trees.)
//!
//! A peer that raises the part is compared with ours under the part raised as much. All are
//! measured alike, from the layers (`measure`): the part's are cut from the mesh, and a peer's
//! supports are moved so that its part lies on them. What must be held is gathered once for all,
//! by our usual rules. Columns:
//! - `islands`: with a contact right under their first layer, of all
//! - `far`: from what must be held to the edge of the nearest contact in space, mm
//! - `area`: what a contact carries, mm²; `load`: the same for each mm² of the contact
//! - `idle`: contacts to which nothing of the demand is nearest
//! - `volume`: of the supports outside of the part, mm³. Pictures: by exposed pixels; beads:
//!   length × width × height; ours: by section
//!
//! *Ours, as close* has the widest spacing, in steps of 15 %, at which islands, `far` and `area`
//! at the 95th percentile are no worse than the peer's.
#![allow(clippy::print_stdout)]
mod measure;
mod peers;

use anyhow::{Context, Result, bail, ensure};
use measure::{Figures, Printed, figures};
use outrigger::detect::overhang::SelfSupport;
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use outrigger::layers::polygon::{difference, union};
use outrigger::layers::shape::{Point, Region};
use outrigger::layers::stack::Layers;
use outrigger::mesh::{self, Mesh, place};
use outrigger::support::cut::Cuts;
use outrigger::support::look::{Look, look};
use outrigger::support::plan::{Branching, Placing, plan};
use outrigger::support::rules::{Process, Rules};
use outrigger::support::section::Sections;
use peers::Peer;
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Steps of spacing.
const STEP: f64 = 1.15;

/// Spacings that are tried, mm.
const SPACING_MM: std::ops::RangeInclusive<f64> = 0.4..=12.0;

/// Filament leaves one layer free, Cura's trees two.
const GAP_LAYERS: usize = 2;

#[derive(Default)]
struct Options {
    angle_deg: Option<f64>,
    above_mm: f64,
    files: Vec<PathBuf>,
}

fn main() -> Result<()> {
    let mut options = Options::default();
    let mut args = std::env::args().skip(1);
    while let Some(arg) = args.next() {
        let mut number = || -> Result<f64> { Ok(args.next().context("a number")?.parse()?) };
        match arg.as_str() {
            "--angle" => options.angle_deg = Some(number()?),
            "--above" => options.above_mm = number()?,
            _ => options.files.push(arg.into()),
        }
    }
    let [model, rest @ ..] = options.files.as_slice() else { bail!("MODEL.stl and the peers' files") };
    let mut input = std::io::Cursor::new(std::fs::read(model).context("the model")?);
    let (mut mesh, _) = mesh::read(&mut input)?;
    place::place(&mut mesh, &place::Placing::default())?;
    println!(
        "| model | demand | supports | islands | far 50 mm | far 95 mm | area 95 mm² | load 95 | contacts | idle | contact mm² | volume mm³ |"
    );
    println!("|---|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|");
    let is = |path: &Path, ending: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    match rest {
        [bare, with @ ..] if is(bare, "sl1") && !with.is_empty() => {
            let bare = peers::pictures(bare).context("the job without supports")?;
            for path in with {
                let job = peers::pictures(path).with_context(|| path.display().to_string())?;
                compare(&options, &mesh, Process::Resin, path, peers::beyond(&bare, &job)?)?;
            }
        }
        [_, ..] if rest.iter().all(|p| is(p, "gcode")) => {
            for path in rest {
                let peer = peers::beads(&std::fs::read(path).with_context(|| path.display().to_string())?)?;
                compare(&options, &mesh, Process::Filament, path, peer)?;
            }
        }
        _ => bail!("BARE.sl1 and those with supports, or G-code by Cura"),
    }
    Ok(())
}

/// A part as it lies under one peer's supports, and what of it must be held.
struct Task {
    mesh: Mesh,
    part: Vec<Region>,
    rules: Rules,
    own: SelfSupport,
    layer_mm: f64,
    gap: usize,
    skip: usize,
    seen: Look,
}

struct Row {
    figures: Figures,
    volume_mm3: f64,
}

impl Task {
    fn new(options: &Options, mesh: &Mesh, process: Process, peer: &Peer) -> Result<Task> {
        let layer_mm = peer.layer_mm;
        let mut mesh = mesh.clone();
        mesh.vertices.iter_mut().for_each(|v| v[2] += peer.raised as f64 * layer_mm);
        let (mut own, gap) = match process {
            Process::Resin => (SelfSupport { angle_deg: 55.0, bridge_mm: 2.0, min_area_mm2: 0.01 }, 0),
            Process::Filament => {
                (SelfSupport { angle_deg: 45.0, bridge_mm: 10.0, min_area_mm2: 0.16 }, GAP_LAYERS)
            }
        };
        own.angle_deg = options.angle_deg.unwrap_or(own.angle_deg);
        let rules = Rules::usual(process, layer_mm);
        let seen = see(&mesh, layer_mm, own, &rules)?;
        let mut layers = FromMesh::new(&mesh, LayerHeights::even(layer_mm))?;
        let mut part = Vec::new();
        while let Some(batch) = layers.next_batch()? {
            part.extend(batch.into_iter().map(|l| l.part));
        }
        let skip = (options.above_mm / layer_mm).round() as usize;
        Ok(Task { mesh, part, rules, own, layer_mm, gap, skip, seen })
    }

    fn row(&self, support: &[Region], volume_mm3: &[f64]) -> Row {
        let (part, layer_mm, gap, skip) = (&self.part, self.layer_mm, self.gap, self.skip);
        let printed = Printed { part, support, layer_mm, gap, skip };
        let figures = figures(&self.seen.demand, &printed);
        Row { figures, volume_mm3: volume_mm3.iter().skip(skip).sum() }
    }

    /// Ours at a spacing: looked at anew, for the cells are of its size.
    fn ours(&self, spacing_mm: f64) -> Result<Row> {
        let rules = Rules { spacing_mm, ..self.rules };
        let seen = see(&self.mesh, self.layer_mm, self.own, &rules)?;
        let made = plan(&seen.demand, &seen.space, &rules, Placing::Cover, Branching::Tree);
        let cuts = Cuts::new(&made.forest, 0.0);
        let layer = |k: usize| {
            let [bottom_mm, top_mm] = [k, k + 1].map(|k| k as f64 * self.layer_mm);
            let section = cuts.section(bottom_mm, top_mm);
            let support = difference(&union(&section.body, &section.interface), &self.part[k]);
            let volume_mm3 = support.area_mm2() * self.layer_mm;
            (support, volume_mm3)
        };
        let (support, volume_mm3): (Vec<_>, Vec<_>) = (0..self.part.len()).into_par_iter().map(layer).unzip();
        Ok(self.row(&support, &volume_mm3))
    }

    /// Ours at the widest spacing that is no worse than a peer.
    fn as_close(&self, usual: Row, peer: &Figures) -> Result<Option<(f64, Row)>> {
        let mut spacing_mm = self.rules.spacing_mm;
        let mut best = usual.figures.no_worse(peer).then_some((spacing_mm, usual));
        let wider = best.is_some();
        loop {
            spacing_mm = if wider { spacing_mm * STEP } else { spacing_mm / STEP };
            if !SPACING_MM.contains(&spacing_mm) {
                return Ok(best);
            }
            let row = self.ours(spacing_mm)?;
            match (row.figures.no_worse(peer), wider) {
                (true, true) => best = Some((spacing_mm, row)),
                (true, false) => return Ok(Some((spacing_mm, row))),
                (false, true) => return Ok(best),
                (false, false) => {}
            }
        }
    }
}

fn see(mesh: &Mesh, layer_mm: f64, own: SelfSupport, rules: &Rules) -> Result<Look> {
    let ([min, max], mut layers) = (mesh.bounds_mm(), FromMesh::new(mesh, LayerHeights::even(layer_mm))?);
    let [min, top] = [min, max].map(|p| Point::from_mm(p[0], p[1]));
    let bounds = outrigger::layers::shape::Bounds { min, max: top };
    Ok(look(&mut layers, (bounds, max[2]), &Region::default(), own, rules, &mut ())?)
}

/// Prints the rows of a peer and of ours beside it.
fn compare(options: &Options, mesh: &Mesh, process: Process, path: &Path, mut peer: Peer) -> Result<()> {
    let task = Task::new(options, mesh, process, &peer)?;
    let part = peers::bounds(&task.part);
    // Twice the way from middle to middle, and how much larger the peer's part is.
    let apart = |of: fn(Point) -> i32| {
        let (ours, theirs) = ([of(part.min), of(part.max)], [of(peer.part.min), of(peer.part.max)]);
        ((ours[0] + ours[1]) - (theirs[0] + theirs[1]), (theirs[1] - theirs[0]) - (ours[1] - ours[0]))
    };
    let ((x, wider), (y, deeper)) = (apart(|p| p.x), apart(|p| p.y));
    let by = Point { x: x / 2, y: y / 2 };
    let [wider, deeper] = Point { x: wider, y: deeper }.mm();
    ensure!(wider.abs().max(deeper.abs()) < 1.0, "the peer's part is {wider} × {deeper} mm larger than ours");
    peer.support = peers::moved_all(&peer.support, by);
    let name = |path: &Path| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let model = options.files.first().map(|p| name(p)).unwrap_or_default();
    let raised_mm = peer.raised as f64 * task.layer_mm;
    let demand = format!("{process:?}, {}°, raised {raised_mm:.1} mm", task.own.angle_deg);
    let print = |who: &str, row: &Row| {
        let (f, volume) = (&row.figures, row.volume_mm3);
        println!(
            "| {model} | {demand} | {who} | {} of {} | {:.2} | {:.2} | {:.2} | {:.1} | {} | {} | {:.1} | {volume:.0} |",
            f.islands[0],
            f.islands[1],
            f.far_mm[0],
            f.far_mm[1],
            f.area_mm2,
            f.load,
            f.contacts,
            f.idle,
            f.contact_mm2
        );
    };
    let theirs = task.row(&peer.support, &peer.volume_mm3);
    print(&name(path), &theirs);
    let usual = task.ours(task.rules.spacing_mm)?;
    print(&format!("ours, {} mm", task.rules.spacing_mm), &usual);
    let close = task.as_close(usual, &theirs.figures)?;
    let said = match &close {
        None => format!("at no spacing from {} mm up is ours as close", SPACING_MM.start()),
        Some((spacing_mm, row)) => {
            print(&format!("ours, as close: {spacing_mm:.2} mm"), row);
            let less = 100.0 * (1.0 - row.volume_mm3 / theirs.volume_mm3);
            format!("as close as the peer, ours takes {less:.0} % less")
        }
    };
    let [x, y] = by.mm();
    println!(
        "\n{}: moved by {x:.2}, {y:.2} mm onto the mesh's layers, where its part is {wider:.2} × {deeper:.2} mm larger; {:.0} mm² overhang; {said}.\n",
        name(path),
        task.seen.demand.area_mm2
    );
    Ok(())
}
