//! From an open resin job to what was found in it.
use super::Args;
use super::kind::Opened;
use super::printer;
use super::source::{BUFFER_BYTES, Checked, ask, examine, rules};
use crate::cli::files;
use crate::detect::resin::drain::shortest_way;
use crate::detect::resin::{Issue, Issues, Kind, exposure};
use crate::detect::walk::Ask;
use crate::layers::from_images::FromImages;
use crate::layers::raster::{Raster, TooFine};
use crate::report::check::{Ground, Hole, Report, Resin, Tops};
use crate::resin::job::Job;
use std::io::{BufReader, Read, Seek};
use std::time::Instant;

/// Hollows that a hole is looked for, the largest: each takes a picture.
const MAX_HOLES: usize = 20;

/// A hole is proposed so high above the hollow's lowest layer, mm: its lower edge stays in the wall.
const ABOVE_MM: f64 = 1.0;

/// Smallest hollow that is worth one, mm³.
const LEAST_MM3: f64 = 1.0;

/// Reads and checks a job.
///
/// # Errors
/// It cannot be read, or is damaged.
pub(super) fn check(args: &Args, opened: Opened) -> anyhow::Result<Checked> {
    let started = Instant::now();
    let (told, rules) = rules(args, "resin-standard")?;
    let job = crate::resin::open(BufReader::with_capacity(BUFFER_BYTES, opened.file))?;
    let kind = job.format().key();
    let mut report = Report { file: files::display_name(&args.file), kind, rules: told, ..Report::default() };
    report.printer = args.printer.as_deref().map(|name| printer::beside_resin(name, &job)).transpose()?;
    report.seconds.read = started.elapsed().as_secs_f64();
    let mut layers = FromImages::new(job).keeping_pictures();
    let ask = Ask { resin: true, ..ask(args, rules) };
    let (mut report, eye, issues) = examine(args, &mut layers, &ask, report)?;
    let looking = Instant::now();
    let issues = issues.unwrap_or_default();
    let mut job = layers.into_job();
    let (panel, placement) = (job.panel(), job.placement());
    let [along_mm, across_mm] = placement.pixel_mm;
    let plate_mm = |place| placement.plate_mm(panel, place);
    let ground = Ground { plate_mm: &plate_mm, pixel_mm2: along_mm * across_mm };
    let exposures_s: Vec<f64> = job.layers().iter().map(|layer| layer.exposure_s).collect();
    let mut resin = Resin::new(&issues, &exposure::amiss(&exposures_s), &ground, &eye.tops);
    for (at, hole) in holes(&mut job, &issues, &ground, &eye.tops)? {
        resin.issues[at].hole = Some(hole);
    }
    resin.note_listed("islands", &report.islands);
    resin.note_listed("small_islands", &report.small_islands);
    report.resin = Some(resin);
    report.seconds.resin += looking.elapsed().as_secs_f64();
    Ok(Checked { report, mended_words: String::new(), survey: eye.survey })
}

/// Where the largest hollows would drain, by their places in the list.
fn holes<R: Read + Seek>(
    job: &mut Job<R>,
    issues: &Issues,
    ground: &Ground<'_>,
    tops: &Tops,
) -> anyhow::Result<Vec<(usize, Hole)>> {
    let is_hollow = |issue: &Issue| {
        matches!(issue.kind, Kind::ResinTrap | Kind::SuctionCup)
            && issue.volume_px_mm * ground.pixel_mm2 >= LEAST_MM3
    };
    let mut hollows: Vec<(usize, &Issue)> =
        issues.list.iter().enumerate().filter(|(_, issue)| is_hollow(issue)).collect();
    hollows.sort_by(|a, b| b.1.volume_px_mm.total_cmp(&a.1.volume_px_mm));
    hollows.truncate(MAX_HOLES);
    let (panel, pixel_mm) = (job.panel(), job.placement().pixel_mm);
    let mut holes = Vec::new();
    for (at, issue) in hollows {
        let layer = tops.layer_at(tops.of(issue.layer) + ABOVE_MM).min(issue.end_layer);
        let packed = job.packed(layer)?;
        let (mut picture, mut fits) = (Raster::new(panel.width_px), Ok(()));
        let row = |row: &[u8]| {
            if fits.is_ok() {
                fits = picture.row(row);
            }
        };
        panel.rows(&packed, row).map_err(|error| job.picture_error(layer, error))?;
        if fits == Err(TooFine) {
            continue;
        }
        if let Some(way) = shortest_way(&picture, issue.box_px, pixel_mm) {
            holes.push((
                at,
                Hole {
                    layer,
                    top_mm: tops.of(layer),
                    from_mm: (ground.plate_mm)(way.from_px),
                    to_mm: (ground.plate_mm)(way.to_px),
                    length_mm: way.length_mm,
                },
            ));
        }
    }
    Ok(holes)
}
