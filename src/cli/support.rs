//! `outrigger support`: the least that holds a model, as a mesh of its own.
//!
//! What is written was read again, cut into layers together with the model, and found to
//! hold; anything else is not written.
mod flags;

use super::files;
use super::interrupt::clean_up_on_signal;
use super::material::{Printed, printed};
use super::model::{Model, not_negative, positive, slope};
use super::page::{self, Surface};
use super::progress;
use crate::detect::overhang::SelfSupport;
use crate::detect::walk::{Seen, Watch};
use crate::layers::from_mesh::{FromMesh, LayerHeights};
use crate::layers::shape::{Bounds, Point, Region};
use crate::merge::into_mesh::triangles;
use crate::merge::together::Together;
use crate::mesh::{self, Mesh, place, stl};
use crate::report::support::Report;
use crate::support::cut::Cuts;
use crate::support::demand::Demand;
use crate::support::look::{Look, look};
use crate::support::plan::{Branching, Placing, Plan, plan};
use crate::support::proof::{Promise, Proof, prove};
use crate::support::rules::{Process, Rules};
use anyhow::{Context, ensure};
use clap::Args as ClapArgs;
use flags::Method;
use indicatif::ProgressBar;
use std::f64::consts::PI;
use std::io::{BufReader, Cursor};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

/// Read buffer, bytes.
const BUFFER_BYTES: usize = 256 << 10;

/// Grow the least supports that hold a model
///
/// FILE is a model (.stl). Tips stand where nothing else holds the print: under every
/// island, and no farther from any overhang than the spacing; branches run down from them
/// and meet on their way. The supports are written as a model (.stl) at the same place, to
/// be sliced together with FILE; with a resin they reach into it a little, with a filament
/// they end a layer below it.
///
/// Whether they hold is proved before anything is written: supports and model are cut into
/// layers again and checked for islands and overhangs. What no support can reach is told,
/// with its place and why.
///
/// Exit status: 0 when OUT was written or nothing needs support; 1 when something cannot be
/// held (unless --allow-unroutable), or the file cannot be read; 2 for wrong usage.
#[derive(ClapArgs, Debug)]
pub(super) struct Args {
    /// The model
    file: PathBuf,
    /// Write the supports here
    #[arg(short, long, value_name = "OUT.stl")]
    output: Option<PathBuf>,
    /// Write the model with them, in one file
    #[arg(long, requires = "output")]
    with_model: bool,
    /// Write what holds although something cannot be held
    #[arg(long)]
    allow_unroutable: bool,
    /// Write what was planned as JSON; "-" is standard output
    ///
    /// Its fields are named with their units and only ever added to: file, method, process,
    /// material, layer_mm, demand_mm2, islands, tips, tips_at_least, junctions,
    /// trunks_on_plate, landings_on_model, length_mm, volume_mm3, unroutable (each with
    /// place_mm, reason, area_mm2, island), negligible, amiss, warnings, seconds.
    #[arg(long, value_name = "FILE.json")]
    json: Option<PathBuf>,
    /// Draw the model with its supports: a page that turns, .html, that needs no network
    #[arg(long, value_name = "FILE.html", value_parser = page::name)]
    picture: Option<PathBuf>,
    /// Say nothing unless something is wrong
    #[arg(short, long)]
    quiet: bool,
    #[command(flatten, next_help_heading = "Supports")]
    wishes: flags::Wishes,
    #[command(flatten, next_help_heading = "The model")]
    model: Model,
    /// Raise the model above the plate, so that it stands on supports alone
    #[arg(long, value_name = "MM", value_parser = not_negative, default_value_t = 0.0, help_heading = "The model")]
    lift_mm: f64,
    /// The material, from `outrigger profile list` or a file: its kind says whether the part
    /// is printed with filament or in resin
    #[arg(long, value_name = "NAME", default_value = "pla", help_heading = "What holds itself")]
    material: String,
    /// Steepest overhang that holds itself, from the vertical: 0 is a wall, 90 a ceiling
    #[arg(long, value_name = "DEGREES", value_parser = slope, help_heading = "What holds itself")]
    angle_deg: Option<f64>,
    /// Longest bridge between two held ends
    #[arg(long, value_name = "MM", value_parser = not_negative, help_heading = "What holds itself")]
    bridge_mm: Option<f64>,
}

/// Moves the bar.
struct Bar(ProgressBar);

impl Watch for Bar {
    fn layer(&mut self, seen: &Seen<'_>) {
        if seen.layer.number.is_multiple_of(16) {
            self.0.set_position(u64::from(seen.layer.number));
        }
    }
}

/// A model with all that is asked of its supports.
struct Task {
    mesh: Mesh,
    heights: LayerHeights,
    rules: Rules,
    own: SelfSupport,
}

/// Runs the verb.
///
/// # Errors
/// The file cannot be read, something cannot be held, the proof fails, or an output cannot
/// be written.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    clean_up_on_signal();
    if let Some(same) =
        [&args.output, &args.json, &args.picture].into_iter().flatten().find(|to| is_same(to, &args.file))
    {
        eprintln!("outrigger: {} would be replaced itself; name another file", same.display());
        return Ok(ExitCode::from(2));
    }
    let began = Instant::now();
    let mut report = Report::default();
    let task = read(args, &mut report).with_context(|| files::display_name(&args.file))?;
    report.seconds.read = began.elapsed().as_secs_f64();
    let seen = see(args, &task, &mut report)?;
    let planning = Instant::now();
    let made = plan(&seen.demand, &seen.space, &task.rules, Placing::Cover, args.wishes.method.branching());
    report.put(&made, PI / 4.0 * task.rules.tip_mm * task.rules.tip_mm);
    report.volume_mm3 = Cuts::new(&made.forest, 0.0).volume_in_mm3(task.heights.layer_mm);
    report.seconds.plan = planning.elapsed().as_secs_f64();
    let file = as_file(&made)?;
    let proving = Instant::now();
    let proof = if made.forest.nodes.is_empty() {
        Proof::default()
    } else {
        proved(&file, &task, &seen.demand, &made)?
    };
    report.amiss = proof.words();
    report.seconds.proof = proving.elapsed().as_secs_f64();
    report.seconds.total = began.elapsed().as_secs_f64();
    tell(args, &report)?;
    // Whether or not the supports may be written: it shows what cannot be held.
    if let Some(to) = &args.picture {
        let surface = Surface { vertices: &task.mesh.vertices, triangles: &task.mesh.triangles };
        page::write(to, &args.file, &surface, &seen.demand, &made, &report)?;
    }
    ensure!(
        proof.holds(),
        "the supports were not written, because the result does not hold: {}; this is a fault of the program: please report it with the model",
        report.amiss.join("; ")
    );
    let lost = report.unroutable.len();
    ensure!(
        lost == 0 || args.allow_unroutable,
        "the supports were not written, because {lost} places cannot be held (see above); turn the model, allow feet on the part with --trunks anywhere, or take what holds with --allow-unroutable"
    );
    write(args, &task, &made, file)?;
    Ok(ExitCode::SUCCESS)
}

fn is_same(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().is_ok_and(|a| b.canonicalize().is_ok_and(|b| a == b))
}

/// Reads the model and puts it on the plate or above it.
fn read(args: &Args, report: &mut Report) -> anyhow::Result<Task> {
    let Printed { own, process, kind } = printed(&args.material)?;
    let usual_mm = if process == Process::Filament { 0.2 } else { 0.05 };
    let layer_mm = args.model.layer_height.unwrap_or(usual_mm);
    let heights = LayerHeights { layer_mm, first_mm: args.model.first_layer_height.unwrap_or(layer_mm) };
    let own = SelfSupport {
        angle_deg: args.angle_deg.unwrap_or(own.angle_deg),
        bridge_mm: args.bridge_mm.unwrap_or(own.bridge_mm),
        ..own
    };
    let rules = args.wishes.rules(process, layer_mm);
    let mut input = BufReader::with_capacity(BUFFER_BYTES, files::open_regular(&args.file)?);
    let (mut mesh, read) = mesh::read(&mut input)?;
    let placing =
        place::Placing { rotate_deg: args.model.rotate.unwrap_or_default(), height_mm: args.model.height_mm };
    let doubt = place::place(&mut mesh, &placing)?;
    mesh.vertices.iter_mut().for_each(|v| v[2] += args.lift_mm);
    *report = Report {
        file: files::display_name(&args.file),
        method: args.wishes.method.word(),
        process: kind,
        material: args.material.clone(),
        layer_mm,
        warnings: read.warnings(),
        ..Report::default()
    };
    report.warnings.extend(doubt.map(|doubt| doubt.to_string()));
    Ok(Task { mesh, heights, rules, own })
}

/// Looks at the model's layers.
fn see(args: &Args, task: &Task, report: &mut Report) -> anyhow::Result<Look> {
    let began = Instant::now();
    let [min, max] = task.mesh.bounds_mm();
    let mut layers =
        FromMesh::new(&task.mesh, task.heights).with_context(|| files::display_name(&args.file))?;
    let bounds = Bounds { min: Point::from_mm(min[0], min[1]), max: Point::from_mm(max[0], max[1]) };
    let mut bar = Bar(progress::layers(crate::layers::stack::Layers::count(&layers), args.quiet));
    let seen = look(&mut layers, (bounds, max[2]), &Region::default(), task.own, &task.rules, &mut bar)?;
    bar.0.finish_and_clear();
    report.demand_mm2 = seen.demand.area_mm2;
    report.islands = seen.demand.needs.iter().filter(|n| n.island).count();
    if seen.demand.cut_off {
        report.warnings.push("there is more overhang than can be held: the highest was left out".to_owned());
    }
    report.seconds.look = began.elapsed().as_secs_f64();
    Ok(seen)
}

fn as_file(made: &Plan) -> anyhow::Result<Vec<u8>> {
    let mut file = Vec::new();
    stl::write(&mut file, &triangles(&made.forest)).context("cannot make the supports")?;
    Ok(file)
}

/// Reads the file of the supports as any program would, and looks at both together.
fn proved(file: &[u8], task: &Task, demand: &Demand, made: &Plan) -> anyhow::Result<Proof> {
    let (supports, read) = mesh::read(&mut Cursor::new(file)).context("the supports cannot be read again")?;
    ensure!(read.mended.is_closed(), "the supports are no closed bodies: please report it with the model");
    let raised = {
        let mut mesh = supports.clone();
        mesh.vertices.iter_mut().for_each(|v| v[2] += task.rules.gap_mm.max(0.0));
        mesh
    };
    let cut = |mesh| FromMesh::new(mesh, task.heights).context("the supports cannot be cut again");
    let mut aids = vec![cut(&supports)?];
    if task.rules.gap_mm > 0.0 {
        aids.push(cut(&raised)?);
    }
    let mut layers = Together::new(FromMesh::new(&task.mesh, task.heights)?, aids);
    let Task { rules, own, .. } = task;
    let promise =
        Promise { plan: made, demand, floating: &[], rules, own: *own, layer_mm: task.heights.layer_mm };
    Ok(prove(&mut layers, &promise, rules.gap_mm.max(0.0))?)
}

fn tell(args: &Args, report: &Report) -> anyhow::Result<()> {
    let taken = args.json.as_deref() == Some(Path::new("-"));
    if !args.quiet {
        let table = report.table();
        if taken { eprintln!("{table}") } else { super::say(&table) }
    }
    let Some(to) = &args.json else { return Ok(()) };
    let text = report.json().context("cannot write the report")?;
    if taken {
        super::say(text.trim_end());
        return Ok(());
    }
    files::write_whole(text.as_bytes(), to, "report")
}

fn write(args: &Args, task: &Task, made: &Plan, mut file: Vec<u8>) -> anyhow::Result<()> {
    let Some(to) = &args.output else { return Ok(()) };
    if made.forest.nodes.is_empty() && !args.with_model {
        eprintln!("outrigger: nothing needs support, so {} was not written", to.display());
        return Ok(());
    }
    if args.with_model {
        let corner = |v: u32| task.mesh.vertices[v as usize].map(|c| c as f32);
        let mut all: Vec<stl::Triangle> = task.mesh.triangles.iter().map(|t| t.map(corner)).collect();
        all.extend(triangles(&made.forest));
        file.clear();
        stl::write(&mut file, &all).context("cannot make the file")?;
    }
    files::write_whole(&file, to, "supports")
}

impl Method {
    fn branching(self) -> Branching {
        match self {
            Method::Straight => Branching::Straight,
            Method::Tree => Branching::Tree,
        }
    }

    fn word(self) -> &'static str {
        match self {
            Method::Straight => "straight",
            Method::Tree => "tree",
        }
    }
}
