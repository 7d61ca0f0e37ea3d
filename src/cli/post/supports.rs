//! `outrigger post --supports`: supports under what a sliced job would print in the air.
//!
//! The demand comes from the job itself, its beads or its images; no model is needed, but one
//! may be given ([`model`]). What the slicer has already supported is held, unless its supports
//! are to be replaced: then they are taken out first, into a file that has no name. The result is read anew and looked
//! at with the same detectors before it takes the job's place.
use super::resin::{is_resin, named, open, written};
use super::{Args, Supports, forgive, model, write_report};
use crate::causes;
use crate::cli::files::{self, Replacement, Seen};
use crate::cli::material::{self, printed};
use crate::cli::page::{self, Surface};
use crate::cli::progress;
use crate::detect::overhang::SelfSupport;
use crate::layers::from_gcode::{self, BeadLayers};
use crate::layers::from_images::FromImages;
use crate::layers::polygon::{Inside, resolve};
use crate::layers::shape::{Bounds, Point};
use crate::layers::stack::Layers;
use crate::merge::gcode::plate;
use crate::merge::into_gcode::{Options, into_gcode};
use crate::merge::into_images::Drawn;
use crate::merge::out_of_gcode::out_of_gcode;
use crate::merge::together::Together;
use crate::report::support::Report;
use crate::report::turn::hull;
use crate::support::cut::Cuts;
use crate::support::look::{Look, look};
use crate::support::model::Outlines;
use crate::support::plan::{Branching, Placing, Plan, plan};
use crate::support::proof::{Promise, Proof, prove};
use crate::support::rules::{Process, Rules};
use anyhow::{Context, bail, ensure};
use std::f64::consts::PI;
use std::fs::File;
use std::io::{BufReader, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

/// Bytes that are read and written at a time.
const BUFFER_BYTES: usize = 256 << 10;

/// Layers right under the part that are printed as interface.
const INTERFACE_LAYERS: f64 = 2.0;

/// Why the job stays as it is although nothing is wrong.
#[derive(Debug, thiserror::Error)]
#[error("nothing in it needs support")]
struct Nothing;

/// Puts supports into a job.
///
/// # Errors
/// With an output, whatever stands in the way; in place only that FILE is gone.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let began = Instant::now();
    let path = files::resolve(&args.file)?;
    let file = files::open_regular(&path)?;
    let mut report = Report { file: files::display_name(&args.file), method: "tree", ..Report::default() };
    let done = if is_resin(&path) {
        into_resin(args, &file, &path, &mut report)
    } else {
        into_text(args, &file, &path, &mut report)
    };
    report.seconds.total = began.elapsed().as_secs_f64();
    let taken = args.report.as_deref() == Some(Path::new("-"));
    if done.is_ok() && !args.quiet {
        let table = report.table();
        if taken { eprintln!("{table}") } else { crate::cli::say(&table) }
    }
    if let Some(to) = &args.report {
        forgive(args, write_report(&report, to))?;
    }
    match done {
        Ok(()) => Ok(ExitCode::SUCCESS),
        Err(reason) if args.output.is_none() || reason.is::<Nothing>() => {
            eprintln!("outrigger: {}: left as it was: {}", report.file, causes::line(&reason));
            if let Some(to) = &args.output {
                let mut source = file.try_clone().context("cannot read the file")?;
                Replacement::beside(to)?.copy_of(&mut source)?.put(&file)?;
            }
            Ok(ExitCode::SUCCESS)
        }
        Err(reason) => Err(reason.context(report.file)),
    }
}

/// The rules of the material that is named, else of the job's own, which must be printed in
/// the job's way.
fn own_rules(args: &Args, own: &str, process: Process, report: &mut Report) -> anyhow::Result<SelfSupport> {
    let name = args.material.as_deref().unwrap_or(own);
    let material = printed(name)?;
    name.clone_into(&mut report.material);
    report.process = material.kind;
    ensure!(material.process == process, "{name} is a {}, which the job is not printed with", material.kind);
    Ok(material.own)
}

/// Plans supports for what was seen, and draws them.
fn planned(args: &Args, seen: &Look, rules: &Rules, report: &mut Report) -> anyhow::Result<Plan> {
    let began = Instant::now();
    report.demand_mm2 = seen.demand.area_mm2;
    report.islands = seen.demand.needs.iter().filter(|n| n.island).count();
    let made = plan(&seen.demand, &seen.space, rules, Placing::Cover, Branching::Tree);
    report.put(&made, PI / 4.0 * rules.tip_mm * rules.tip_mm);
    report.volume_mm3 = Cuts::new(&made.forest, 0.0).volume_in_mm3(report.layer_mm);
    report.seconds.plan = began.elapsed().as_secs_f64();
    // Whether or not they may be put in: the page shows what cannot be held.
    if let Some(to) = &args.picture {
        let hull = hull(&seen.space, seen.part);
        let surface = Surface { vertices: &hull.vertices, triangles: &hull.triangles };
        forgive(args, page::write(to, &args.file, &surface, &seen.demand, &made, report))?;
    }
    if let Some(first) = report.unroutable.first() {
        let [x, y, z] = first.place_mm;
        ensure!(
            args.allow_unroutable,
            "{} places cannot be held, the lowest at X {x:.1} Y {y:.1} Z {z:.2}: {}; turn the model and slice it again, or take what holds with --allow-unroutable, which should not be printed",
            report.unroutable.len(),
            first.reason
        );
    }
    Ok(made)
}

/// The job without the slicer's own supports, beside where the result will be.
fn without_supports(args: &Args, mut job: File, target: &Path, report: &mut Report) -> anyhow::Result<File> {
    let mut bare = files::unnamed_beside(target)?;
    let bar = progress::layers(None, args.quiet);
    let mut out = BufWriter::with_capacity(BUFFER_BYTES, &mut bare);
    let taken = out_of_gcode(&mut job, &mut out, &|done, count| {
        bar.set_length(count.into());
        bar.set_position(done.into());
    })?;
    out.flush().with_context(|| format!("cannot write beside {}", target.display()))?;
    drop(out);
    bar.finish_and_clear();
    report.replaced_mm3 = taken.volume_mm3;
    if taken.beads == 0 {
        report.warnings.push("the slicer put no supports into this job that could be replaced".to_owned());
    }
    Ok(bare)
}

fn holds(proof: &Proof, report: &mut Report, began: Instant) -> anyhow::Result<()> {
    report.seconds.proof = began.elapsed().as_secs_f64();
    report.amiss = proof.words();
    ensure!(proof.holds(), "the result does not hold: {}", report.amiss.join("; "));
    Ok(())
}

/// The beads of a job, text or binary.
fn beads(file: &File) -> anyhow::Result<BeadLayers> {
    let mut reader = BufReader::with_capacity(BUFFER_BYTES, file);
    reader.seek(SeekFrom::Start(0))?;
    Ok(from_gcode::read(outrigger_gcode::bgcode::text(reader), &from_gcode::Options::default())?)
}

fn into_text(args: &Args, file: &File, path: &Path, report: &mut Report) -> anyhow::Result<()> {
    let seen_as = Seen::of(file)?;
    let target = args.output.as_deref().unwrap_or(path);
    let mut input = file.try_clone().context("cannot read the file")?;
    let filament = material::of_gcode(&mut input).context("cannot read the file")?;
    let own = own_rules(args, filament.unwrap_or("pla"), Process::Filament, report)?;
    let began = Instant::now();
    if args.supports == Some(Supports::Replace) {
        input = without_supports(args, input, target, report)?;
    }
    let mut layers = beads(&input)?;
    ensure!(!layers.facts().spiral, "this is a spiral vase, which has no layers to print supports in");
    ensure!(
        layers.facts().features_told,
        "the file does not say what is part and what is support, so nothing can be proved of it"
    );
    let height_mm = layers.height_mm();
    report.layer_mm = round(height_mm / f64::from(layers.count().unwrap_or(1).max(1)));
    let rules = Rules::usual(Process::Filament, report.layer_mm);
    report.seconds.read = began.elapsed().as_secs_f64();
    let looking = Instant::now();
    let bounds = layers.bounds();
    let mut outlines = args.model().map(|_| Outlines::default());
    let plate = plate(&mut input)?;
    let mut seen = look(&mut layers, (bounds, height_mm), &plate, own, &rules, &mut outlines)?;
    if let Some((path, outlines)) = args.model().zip(outlines) {
        model::added(path, args.align, (&mut seen, &outlines), beads(&input)?, own, &rules, report)?;
    }
    report.seconds.look = looking.elapsed().as_secs_f64();
    let made = planned(args, &seen, &rules, report)?;
    let Look { demand, findings, .. } = seen;
    let cuts = Cuts::new(&made.forest, INTERFACE_LAYERS * report.layer_mm);
    if made.forest.nodes.is_empty() && report.replaced_mm3 == 0.0 {
        bail!(Nothing);
    }
    let mut replacement = Replacement::beside(target)?;
    let bar = progress::layers(layers.count(), args.quiet);
    let mut out = BufWriter::with_capacity(BUFFER_BYTES, replacement.file());
    input.seek(SeekFrom::Start(0)).context("cannot read the file")?;
    let merged = into_gcode(&mut input, &mut out, &cuts, &Options::default(), &|done, _| {
        bar.set_position(done.into());
    })?;
    out.flush().with_context(|| format!("cannot write beside {}", target.display()))?;
    drop(out);
    bar.finish_and_clear();
    report.volume_mm3 = merged.volume_mm3;
    report.warnings.extend(merged.words());
    let proving = Instant::now();
    let mut result = beads(replacement.file())?;
    let floating = &findings.islands.floating_aid;
    let promise =
        Promise { plan: &made, demand: &demand, floating, rules: &rules, own, layer_mm: report.layer_mm };
    let proof = prove(&mut result, &promise, 0.0)?;
    holds(&proof, report, proving)?;
    ensure!(seen_as.still_holds(file, path), "it was replaced or changed while it was read");
    replacement.put(file)
}

fn into_resin(args: &Args, file: &File, path: &Path, report: &mut Report) -> anyhow::Result<()> {
    let seen_as = Seen::of(file)?;
    let own = own_rules(args, "resin-standard", Process::Resin, report)?;
    let began = Instant::now();
    let job = open(file)?;
    let (placement, panel) = (job.placement(), job.panel());
    let layers = job.layers().to_vec();
    let height_mm = layers.last().map_or(0.0, |l| l.top_mm);
    report.layer_mm = round(height_mm / layers.len().max(1) as f64);
    let target = args.output.as_deref().unwrap_or(path);
    let format = named(target).unwrap_or(job.format());
    let rules = Rules::usual(Process::Resin, report.layer_mm);
    let size = [
        f64::from(panel.width_px) * placement.pixel_mm[0],
        f64::from(panel.height_px) * placement.pixel_mm[1],
    ];
    let [x, y] = if placement.swap { [size[1], size[0]] } else { size };
    let bounds = Bounds { min: Point::default(), max: Point::from_mm(x, y) };
    let corners = [(0.0, 0.0), (x, 0.0), (x, y), (0.0, y)].map(|(x, y)| Point::from_mm(x, y));
    let plate = resolve([&corners.to_vec()], Inside::NonZero);
    let mut pictures = FromImages::new(job);
    let mut outlines = args.model().map(|_| Outlines::default());
    let mut seen = look(&mut pictures, (bounds, height_mm), &plate, own, &rules, &mut outlines)?;
    if let Some((path, outlines)) = args.model().zip(outlines) {
        let again = FromImages::new(open(file)?);
        model::added(path, args.align, (&mut seen, &outlines), again, own, &rules, report)?;
    }
    report.seconds.look = began.elapsed().as_secs_f64();
    let made = planned(args, &seen, &rules, report)?;
    let demand = seen.demand;
    if made.forest.nodes.is_empty() {
        bail!(Nothing);
    }
    let cuts = Cuts::new(&made.forest, 0.0);
    let heights: Vec<_> = layers.iter().map(|l| [l.top_mm - l.height_mm, l.top_mm]).collect();
    report.volume_mm3 = cuts.volume_mm3(&heights);
    let edits = Drawn::new(&cuts, &layers, placement);
    let (mut replacement, written) = written(args, &mut open(file)?, format, &edits, target)?;
    report.warnings.extend(written.notes);
    let proving = Instant::now();
    // The job that was and the one that is: what the latter has besides is what holds.
    let before = FromImages::new(open(file)?);
    let mut both = Together::new(before, vec![FromImages::new(open(replacement.file())?)]);
    let promise = Promise {
        plan: &made,
        demand: &demand,
        floating: &[],
        rules: &rules,
        own,
        layer_mm: report.layer_mm,
    };
    let proof = prove(&mut both, &promise, 0.0)?;
    drop(both);
    holds(&proof, report, proving)?;
    ensure!(seen_as.still_holds(file, path), "it was replaced or changed while it was read");
    replacement.put(file)
}

/// Heights come from sums: as people write them.
fn round(mm: f64) -> f64 {
    (mm * 1e4).round() / 1e4
}
