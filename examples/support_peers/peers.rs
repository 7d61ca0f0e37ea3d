//! What peers print as supports, in the place of the part: from pictures, and from beads.
//!
//! PrusaSlicer's SL1 archives hold no word of what is support: it is what a job with supports
//! has more than the same job without. Cura's G-code says it of every bead.
use anyhow::{Context, Result, ensure};
use outrigger::layers::from_images::FromImages;
use outrigger::layers::polygon::{difference, grow, sweep};
use outrigger::layers::shape::{Bounds, Point, Region};
use outrigger::layers::stack::Layers;
use outrigger_gcode::line::{Command, parse, split_lines};
use rayon::prelude::*;
use std::fs::File;
use std::path::Path;

/// Half a pixel of 0.05 mm and a little: what is thinner is where two pictures differ by chance.
const SLIVER_MM: f64 = 0.03;

/// Width of Cura's beads, mm, at a flow of 100 %.
const BEAD_MM: f64 = 0.4;

/// Layers of a job, whatever they are.
pub(crate) struct Job {
    pub(crate) layer_mm: f64,
    pub(crate) layers: Vec<Region>,
}

/// Supports of a peer.
pub(crate) struct Peer {
    pub(crate) support: Vec<Region>,
    /// Material layer by layer, mm³.
    pub(crate) volume_mm3: Vec<f64>,
    pub(crate) layer_mm: f64,
    /// By how many layers the part was raised.
    pub(crate) raised: usize,
    /// Bounds of the part as printed, in the peer's place: those of the mesh's layers but for
    /// half a pixel or bead.
    pub(crate) part: Bounds,
}

/// The pictures of an SL1 archive, all layers of one height.
pub(crate) fn pictures(path: &Path) -> Result<Job> {
    let file = File::open(path)?;
    let mut images = FromImages::new(outrigger::resin::open(std::io::BufReader::new(file))?);
    let layer_mm = images.job().layers().first().context("no layer")?.height_mm;
    ensure!(
        images.job().layers().iter().all(|l| (l.height_mm - layer_mm).abs() < 1e-9),
        "slice with initial-layer-height as layer-height: layers of one height are compared"
    );
    let mut layers = Vec::new();
    while let Some(batch) = images.next_batch()? {
        layers.extend(batch.into_iter().map(|l| l.part));
    }
    Ok(Job { layer_mm, layers })
}

/// What a job has more than the bare one. The part may be raised by whole layers, and may lie
/// elsewhere: its highest tenth, where supports seldom are, tells where.
pub(crate) fn beyond(bare: &Job, with: &Job) -> Result<Peer> {
    let raised = with.layers.len().checked_sub(bare.layers.len()).context("fewer layers with supports")?;
    let top = |layers: &[Region]| bounds(&layers[layers.len() - bare.layers.len().div_ceil(10)..]);
    let (from, to) = (top(&bare.layers), top(&with.layers));
    let shift = Point { x: to.min.x - from.min.x, y: to.min.y - from.min.y };
    let nothing = Region::default();
    let layer = |k: usize| {
        let part = k.checked_sub(raised).map_or(&nothing, |k| &bare.layers[k]);
        let more_mm2 = with.layers[k].area_mm2() - part.area_mm2();
        let support = difference(&with.layers[k], &moved(part, shift));
        (grow(&grow(&support, -SLIVER_MM), SLIVER_MM), more_mm2 * with.layer_mm)
    };
    let (support, volume_mm3) = (0..with.layers.len()).into_par_iter().map(layer).unzip();
    let part = bounds(&moved_all(&bare.layers, shift));
    Ok(Peer { support, volume_mm3, layer_mm: with.layer_mm, raised, part })
}

/// The beads that Cura calls support, swept, and their volume: length × width × layer height.
pub(crate) fn beads(text: &[u8]) -> Result<Peer> {
    let told = |line: &[u8]| {
        let mm = line.strip_prefix(b";Layer height:")?.trim_ascii();
        std::str::from_utf8(mm).ok()?.parse::<f64>().ok()
    };
    let layer_mm = split_lines(text).find_map(told).context("no line \";Layer height:\": not Cura's")?;
    let mut paths: Vec<Vec<Vec<Point>>> = Vec::new();
    let (mut support, mut part, mut bounds) = (false, false, Bounds::EMPTY);
    let (mut at, mut e, mut relative) = ([0.0; 3], 0.0, false);
    let mut goes_on = false;
    for line in split_lines(text).map(parse) {
        if let Some(kind) = line.comment.strip_prefix(b";TYPE:") {
            support = kind.starts_with(b"SUPPORT");
            part = !support && !kind.starts_with(b"SKIRT") && !kind.starts_with(b"PRIME");
            goes_on = false;
        }
        match line.command {
            Command::Classic { letter: b'M', number: 82 | 83, .. } => {
                relative = line.command == Command::classic(b'M', 83);
            }
            Command::Classic { letter: b'G', number: 92, .. } => e = line.words.get(b'E').unwrap_or(e),
            Command::Classic { letter: b'G', number: 0 | 1, .. } => {
                let from = at;
                for (k, letter) in [b'X', b'Y', b'Z'].into_iter().enumerate() {
                    at[k] = line.words.get(letter).unwrap_or(at[k]);
                }
                let before = if relative { 0.0 } else { e };
                e = line.words.get(b'E').unwrap_or(before);
                let ends = [from, at].map(|p| Point::from_mm(p[0], p[1]));
                let bead = e > before && ends[0] != ends[1];
                if bead && part {
                    bounds = ends.into_iter().fold(bounds, Bounds::with);
                }
                if bead && support {
                    let layer = ((at[2] / layer_mm).round() as usize).max(1) - 1;
                    ensure!(layer < 100_000, "a bead at Z {} mm", at[2]);
                    paths.resize_with(paths.len().max(layer + 1), Vec::new);
                    match paths[layer].last_mut().filter(|_| goes_on) {
                        Some(path) => path.push(ends[1]),
                        None => paths[layer].push(ends.to_vec()),
                    }
                }
                goes_on = bead && support;
            }
            _ => {}
        }
    }
    let layer = |paths: &Vec<Vec<Point>>| {
        let long = |p: &Vec<Point>| p.windows(2).map(|w| length_mm(w[0], w[1])).sum::<f64>();
        let volume_mm3 = paths.iter().map(long).sum::<f64>() * BEAD_MM * layer_mm;
        (sweep(paths.iter().map(|p| (p.as_slice(), BEAD_MM / 2.0)), 0.01), volume_mm3)
    };
    let (support, volume_mm3) = paths.par_iter().map(layer).unzip();
    Ok(Peer { support, volume_mm3, layer_mm, raised: 0, part: bounds })
}

fn length_mm(a: Point, b: Point) -> f64 {
    let (a, b) = (a.mm(), b.mm());
    (b[0] - a[0]).hypot(b[1] - a[1])
}

pub(crate) fn bounds(layers: &[Region]) -> Bounds {
    layers.iter().fold(Bounds::EMPTY, |b, l| b.joined(l.bounds()))
}

pub(crate) fn moved(region: &Region, by: Point) -> Region {
    let mut region = region.clone();
    for p in region.polygons.iter_mut().flat_map(|p| &mut p.rings).flatten() {
        *p = Point { x: p.x + by.x, y: p.y + by.y };
    }
    region
}

pub(crate) fn moved_all(layers: &[Region], by: Point) -> Vec<Region> {
    layers.par_iter().map(|l| moved(l, by)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beads_of_supports_are_told_from_those_of_the_part() {
        let text =
            b";Layer height: 0.2\nG92 E0\n;TYPE:SUPPORT\nG0 X0 Y0 Z0.4\nG1 X5 E1\nG1 Y5 E2\nG1 X9 E1\n\
            ;TYPE:WALL-OUTER\nG0 X20 Y20\nG1 X30 Y40 E3\n;TYPE:SKIRT\nG1 X99 E4\n";
        let peer = beads(text).expect("Cura's");
        assert_eq!((peer.support.len(), peer.raised), (2, 0));
        assert!((peer.volume_mm3[1] - 10.0 * 0.4 * 0.2).abs() < 1e-12, "{:?}", peer.volume_mm3);
        assert_eq!(peer.support[1].polygons.len(), 1);
        assert_eq!(peer.part.mm(), [[20.0, 20.0], [30.0, 40.0]]);
        assert!(beads(b"G1 X5 E1\n").is_err());
    }

    #[test]
    fn a_raised_and_shifted_part_is_found_again() {
        let square = |x: f64, wide: f64| {
            let ring = [(x, 0.0), (x + wide, 0.0), (x + wide, wide), (x, wide)];
            sweep([(ring.map(|(x, y)| Point::from_mm(x, y)).as_slice(), 0.1)], 0.01)
        };
        let bare = Job { layer_mm: 0.05, layers: vec![square(0.0, 2.0); 20] };
        let pillar = square(10.0, 1.0);
        let mut layers = vec![pillar.clone(); 4];
        layers.extend((0..20).map(|_| square(3.0, 2.0)));
        let peer = beyond(&bare, &Job { layer_mm: 0.05, layers }).expect("more layers");
        assert_eq!(peer.raised, 4);
        let areas: Vec<f64> = peer.support.iter().map(Region::area_mm2).collect();
        assert!(areas[..4].iter().all(|a| (a - pillar.area_mm2()).abs() < 0.01), "{areas:?}");
        assert!(areas[4..].iter().all(|a| *a == 0.0), "{areas:?}");
        assert_eq!(peer.part.min, Point::from_mm(2.9, -0.1));
    }
}
