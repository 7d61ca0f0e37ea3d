//! From an open file to what was found in it.
use super::flags::{Drawing, Growth, LAYER_MM, PIXEL_MM, drawing};
use super::kind::{Kind, Opened};
use super::printer;
use super::watch::Eye;
use super::{Args, Overhang, resin};
use crate::cli::{files, material, progress};
use crate::detect::overhang::{self, SelfSupport};
use crate::detect::overhang_normal;
use crate::detect::resin::Issues;
use crate::detect::walk::{Ask, Findings, ImageAsk, LayerAsk, walk};
use crate::layers::from_gcode;
use crate::layers::from_mesh::{FromMesh, LayerHeights, Sliced};
use crate::layers::stack::Layers;
use crate::mesh::{self, place};
use crate::report::check::{Report, Rules};
use crate::report::survey::Survey;
use anyhow::Context;
use std::io::{BufReader, Seek};
use std::time::Instant;

/// Read buffer, bytes.
pub(super) const BUFFER_BYTES: usize = 256 << 10;

/// A file that was checked.
pub(super) struct Checked {
    pub(super) report: Report,
    /// What was mended in a mesh, for people; empty when nothing was.
    pub(super) mended_words: String,
    /// What pictures need, if one is wanted.
    pub(super) survey: Option<Survey>,
}

/// Reads and checks a file.
///
/// # Errors
/// It cannot be read, or is damaged, empty or beyond what can be checked.
pub(super) fn check(args: &Args, opened: Opened) -> anyhow::Result<Checked> {
    let started = Instant::now();
    let mut checked = match opened.kind {
        Kind::Stl => mesh(args, opened),
        Kind::Gcode => gcode(args, opened),
        Kind::Resin => resin::check(args, opened),
    }
    .with_context(|| files::display_name(&args.file))?;
    checked.report.seconds.total = started.elapsed().as_secs_f64();
    Ok(checked)
}

/// The rules of the material, but for what the flags say.
pub(super) fn rules(args: &Args, material: &str) -> anyhow::Result<(Rules, SelfSupport)> {
    let name = args.rules.material.as_deref().unwrap_or(material);
    let of = material::printed(name)?.own;
    let rules = SelfSupport {
        angle_deg: args.rules.angle_deg.unwrap_or(of.angle_deg),
        bridge_mm: args.rules.bridge_mm.unwrap_or(of.bridge_mm),
        min_area_mm2: args.rules.min_area_mm2.unwrap_or(of.min_area_mm2),
    };
    let told = Rules {
        material: name.to_owned(),
        angle_deg: rules.angle_deg,
        bridge_mm: rules.bridge_mm,
        min_area_mm2: rules.min_area_mm2,
    };
    Ok((told, rules))
}

/// What to look for.
pub(super) fn ask(args: &Args, rules: SelfSupport) -> Ask {
    let growth = match args.rules.growth {
        Growth::Conditional => overhang::Growth::Conditional,
        Growth::Naive => overhang::Growth::Naive,
    };
    let pixel_mm = args.rules.pixel_mm.unwrap_or(PIXEL_MM);
    let wants = |this: Overhang| [this, Overhang::All].contains(&args.overhang);
    Ask {
        min_island_mm2: rules.min_area_mm2,
        layer: wants(Overhang::Layer).then_some(LayerAsk { rules, growth }),
        image: wants(Overhang::Image).then_some(ImageAsk { rules, growth, pixel_mm }),
        resin: false,
    }
}

/// Walks over the layers and puts what is found into the report.
pub(super) fn examine<L: Layers>(
    args: &Args,
    layers: &mut L,
    ask: &Ask,
    mut report: Report,
) -> anyhow::Result<(Report, Eye, Option<Issues>)> {
    let bar = progress::layers(layers.count(), args.quiet);
    let wants_page = args.picture.as_deref().and_then(drawing) == Some(Drawing::Html);
    let survey = args.picture.is_some().then(|| Survey::new(wants_page));
    let mut eye = Eye::new(bar.clone(), survey);
    let mut found = walk(layers, ask, &mut eye)?;
    bar.finish_and_clear();
    anyhow::ensure!(found.layers > 0, "it holds no layer, so there is nothing to check");
    report.seconds = eye.seconds_with(report.seconds);
    let issues = found.resin.take();
    put(&mut report, found, &eye);
    Ok((report, eye, issues))
}

fn put(report: &mut Report, found: Findings, eye: &Eye) {
    let tops = &eye.tops;
    let islands = |list: &[crate::detect::island::Island]| list.iter().map(|i| tops.island(i)).collect();
    report.layers = found.layers;
    if report.height_mm == 0.0 {
        report.height_mm = found.height_mm;
    }
    report.bbox_mm = (eye.bounds.min.x <= eye.bounds.max.x).then(|| eye.bounds.mm());
    report.islands = islands(&found.islands.islands);
    report.small_islands = islands(&found.islands.small);
    report.floating_supports = islands(&found.islands.floating_aid);
    report.unlisted_islands = found.islands.unlisted;
    for overhangs in [found.layer, found.image].into_iter().flatten() {
        report.put_overhangs(tops.overhangs(&overhangs));
    }
}

fn mesh(args: &Args, opened: Opened) -> anyhow::Result<Checked> {
    let started = Instant::now();
    let (told, rules) = rules(args, "pla")?;
    let mut input = BufReader::with_capacity(BUFFER_BYTES, opened.file);
    let (mut mesh, read) = mesh::read(&mut input)?;
    let placing =
        place::Placing { rotate_deg: args.model.rotate.unwrap_or_default(), height_mm: args.model.height_mm };
    let doubt = place::place(&mut mesh, &placing)?;
    let mut report = Report {
        file: files::display_name(&args.file),
        kind: "stl",
        triangles: Some(mesh.triangles.len() as u64),
        height_mm: mesh.bounds_mm()[1][2],
        rules: told,
        mended: Some(serde_json::to_value(read.mended)?),
        ..Report::default()
    };
    report.warnings = read.warnings();
    report.warnings.extend(doubt.map(|doubt| doubt.to_string()));
    report.seconds.read = started.elapsed().as_secs_f64();
    let layer_mm = args.model.layer_height.unwrap_or(LAYER_MM);
    let heights = LayerHeights { layer_mm, first_mm: args.model.first_layer_height.unwrap_or(layer_mm) };
    let prepared = Instant::now();
    // What cannot be sliced is often in another unit.
    let doubted =
        |fault| report.warnings.iter().fold(anyhow::Error::new(fault), |e, w| anyhow::anyhow!("{e}; {w}"));
    let mut layers = FromMesh::new(&mesh, heights).map_err(doubted)?;
    report.seconds.slice = prepared.elapsed().as_secs_f64();
    let (mut report, eye, _) = examine(args, &mut layers, &ask(args, rules), report)?;
    if [Overhang::Normal, Overhang::All].contains(&args.overhang) {
        let began = Instant::now();
        let found = overhang_normal::overhangs(&mesh, &rules, |z_mm| eye.tops.layer_at(z_mm));
        report.put_overhangs(eye.tops.overhangs(&found));
        report.seconds.overhangs += began.elapsed().as_secs_f64();
    }
    report.warnings.extend(slicing_words(layers.sliced()));
    let mended_words = if read.mended.done().is_empty() { String::new() } else { read.mended.to_string() };
    Ok(Checked { report, mended_words, survey: eye.survey })
}

/// What slicing met that the user should know.
fn slicing_words(sliced: Sliced) -> Option<String> {
    (sliced.open_layers > 0).then(|| {
        format!(
            "contours were open in {} layers, from layer {} on: they were closed by straight lines of up to {:.2} mm",
            sliced.open_layers,
            sliced.first_open_layer.unwrap_or_default(),
            sliced.widest_gap_mm
        )
    })
}

fn gcode(args: &Args, mut opened: Opened) -> anyhow::Result<Checked> {
    let started = Instant::now();
    let named = material::of_gcode(&mut opened.file).context("cannot read the file")?;
    let (told, rules) = rules(args, named.unwrap_or("pla"))?;
    let printer = match &args.printer {
        Some(name) => {
            // What nobody told of the material is not judged by.
            let material = args.rules.material.as_deref().or(named);
            let beside = printer::beside(name, material, BufReader::new(&opened.file))?;
            opened.file.rewind().context("cannot read the file")?;
            Some(beside)
        }
        None => None,
    };
    let bar = progress::bytes(opened.bytes, args.quiet);
    let reader = BufReader::with_capacity(BUFFER_BYTES, bar.wrap_read(opened.file));
    let mut text = outrigger_gcode::bgcode::text(reader);
    let kind = if text.is_binary().context("cannot read the file")? { "bgcode" } else { "gcode" };
    let options = from_gcode::Options { filament_mm: args.filament_mm };
    let mut layers = from_gcode::read(text, &options)?;
    bar.finish_and_clear();
    let file = files::display_name(&args.file);
    let mut report = Report { file, kind, rules: told, printer, ..Report::default() };
    report.warnings = tracing_words(layers.facts());
    report.seconds.read = started.elapsed().as_secs_f64();
    let (report, eye, _) = examine(args, &mut layers, &ask(args, rules), report)?;
    Ok(Checked { report, mended_words: String::new(), survey: eye.survey })
}

/// What had to be guessed in G-code that the user should know.
fn tracing_words(facts: &from_gcode::Facts) -> Vec<String> {
    let mut words = Vec::new();
    if !facts.features_told {
        words.push(
            "the file does not say what is support, skirt or tower: all of it was checked as part of the model"
                .to_owned(),
        );
    }
    if !facts.widths_told && !facts.filament_told {
        words.push(format!(
            "the file says neither how wide its beads are nor how thick the filament is: {:.2} mm was taken; \
             --filament-mm gives the right one",
            facts.filament_mm
        ));
    }
    if facts.relative_e_guessed {
        words.push(
            "no line says whether E is relative (M83): it was taken so, as it makes no sense otherwise"
                .to_owned(),
        );
    }
    words
}
