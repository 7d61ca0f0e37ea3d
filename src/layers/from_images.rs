//! Layers from the images of a resin job: contours at half brightness.
//!
//! Takes an open [`Job`], gives its layers with polygons that follow the edges of the
//! bright pixels exactly: bright is 128 and more of 255. Anti-aliased borders are thus
//! cut where a pixel is half covered. Corner `k` of a side lies at the grid's point
//! nearest to `k` pixels, so that nothing drifts over a panel whose pixel is no whole
//! number of grid steps. x runs to the right and y to the back of the plate seen from
//! above, from a corner of the panel ([`crate::resin::job::Placement`]).
//!
//! Supports cannot be told from the part in a picture: all is [`Layer::part`], and
//! [`Layer::aid`] is empty. Knows no format of jobs.
mod runs;
mod trace;

use super::raster::{self, Raster};
use super::shape::{Point, Polygon, Region, Ring, UNITS_PER_MM};
use super::stack::{Layer, Layers};
use crate::resin::image::{ImageError, Panel};
use crate::resin::job::{Job, JobError, JobLayer, Placement};
use rayon::prelude::*;
use std::io::{Read, Seek};
use trace::{Corner, MAX_CORNERS, TooFine, Trace};

/// Most layers of a batch: progress is to be seen.
const MAX_BATCH: usize = 32;

/// Fewest pictures that are traced at once, as many as a board has cores: how large one is, is known only
/// then.
const MIN_AT_ONCE: usize = 4;

/// Most bytes of packed pictures that are traced at once.
const BATCH_BYTES: u64 = 64 << 20;

/// Corners after which a batch is over: 64 MB of points.
const BATCH_CORNERS: usize = 1 << 23;

/// Why a job's pictures give no layers.
#[derive(Debug, thiserror::Error)]
pub enum FromImagesError {
    /// The job, its archive or a picture.
    #[error(transparent)]
    Job(#[from] JobError),
    /// Noise or dithering instead of shapes.
    #[error(
        "layer {layer} ({entry:?}): its shapes have more than {MAX_CORNERS} corners; export it without dithering"
    )]
    TooFine {
        /// From 0 at the plate.
        layer: u32,
        /// Name of the picture in the archive.
        entry: String,
    },
}

/// The layers of a job, picture by picture.
#[derive(Debug)]
pub struct FromImages<R> {
    job: Job<R>,
    /// The next layer to be read.
    next: u32,
    keep_pictures: bool,
}

/// A picture that is read and not yet traced.
struct Packed {
    layer: u32,
    bytes: Vec<u8>,
}

impl<R: Read + Seek> FromImages<R> {
    /// The layers of a job from the plate up.
    #[must_use]
    pub fn new(job: Job<R>) -> FromImages<R> {
        FromImages { job, next: 0, keep_pictures: false }
    }

    /// The same with each layer's picture ([`Layer::picture`]).
    #[must_use]
    pub fn keeping_pictures(self) -> FromImages<R> {
        FromImages { keep_pictures: true, ..self }
    }

    /// The job, when its layers are done with.
    #[must_use]
    pub fn into_job(self) -> Job<R> {
        self.job
    }

    /// The job.
    #[must_use]
    pub fn job(&self) -> &Job<R> {
        &self.job
    }

    /// The next pictures, at most so many.
    fn read(&mut self, most: usize) -> Result<Vec<Packed>, JobError> {
        let mut packed = Vec::new();
        let mut bytes = 0;
        while packed.len() < most && (self.next as usize) < self.job.layers().len() {
            bytes += self.job.packed_bytes(self.next);
            if bytes > BATCH_BYTES && !packed.is_empty() {
                break;
            }
            packed.push(Packed { layer: self.next, bytes: self.job.packed(self.next)? });
            self.next += 1;
        }
        Ok(packed)
    }

    /// The layer of a picture's polygons, or what was wrong with it.
    fn layer(
        &self,
        layer: u32,
        read: Result<(Region, Option<Raster>), Fault>,
    ) -> Result<Layer, FromImagesError> {
        let (part, picture) = read.map_err(|fault| match fault {
            Fault::Picture(source) => self.job.picture_error(layer, source).into(),
            Fault::TooFine => {
                FromImagesError::TooFine { layer, entry: self.job.entry_name(layer).into_owned() }
            }
        })?;
        let JobLayer { top_mm, height_mm, .. } = self.job.layers()[layer as usize];
        let bottom_mm = (top_mm - height_mm).max(0.0);
        Ok(Layer { number: layer, bottom_mm, top_mm, part, aid: Region::default(), picture })
    }
}

impl<R: Read + Seek> Layers for FromImages<R> {
    type Error = FromImagesError;

    fn count(&self) -> Option<u32> {
        Some(self.job.layers().len() as u32)
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, FromImagesError> {
        let panel = self.job.panel();
        let grid = Grid::new(panel, self.job.placement());
        let keep = self.keep_pictures;
        let at_once = rayon::current_num_threads().clamp(MIN_AT_ONCE, MAX_BATCH);
        let (mut layers, mut corners) = (Vec::new(), 0);
        while layers.len() < MAX_BATCH && corners < BATCH_CORNERS {
            let packed = self.read(at_once.min(MAX_BATCH - layers.len()))?;
            if packed.is_empty() {
                break;
            }
            let read: Vec<_> = packed.par_iter().map(|p| contours(panel, &grid, &p.bytes, keep)).collect();
            for (packed, read) in packed.iter().zip(read) {
                let layer = self.layer(packed.layer, read)?;
                corners += layer.part.len() + layer.picture.as_ref().map_or(0, Raster::runs);
                layers.push(layer);
            }
        }
        Ok((!layers.is_empty()).then_some(layers))
    }
}

/// What is wrong with one picture.
enum Fault {
    Picture(ImageError),
    TooFine,
}

/// Contours of one picture at half brightness, in grid steps over the plate, and the picture if it is
/// to be kept.
fn contours(panel: Panel, grid: &Grid, packed: &[u8], keep: bool) -> Result<(Region, Option<Raster>), Fault> {
    let mut trace = Trace::default();
    let mut changes = Vec::new();
    let mut fits = Ok(());
    let mut picture = keep.then(|| Raster::new(panel.width_px));
    let row = |row: &[u8]| {
        if fits.is_ok() {
            runs::changes(row, &mut changes);
            fits = trace.row(&changes);
        }
        if let Some(picture) = picture.as_mut().filter(|_| fits.is_ok()) {
            fits = picture.row(row).map_err(|raster::TooFine| TooFine);
        }
    };
    panel.rows(packed, row).map_err(Fault::Picture)?;
    let polygons = fits.and_then(|()| trace.polygons(|c| grid.point(c))).map_err(|TooFine| Fault::TooFine)?;
    Ok((grid.region(polygons), picture))
}

/// Where the corners of pixels lie over the plate.
struct Grid {
    /// Along a row, by the columns from the left.
    u: Vec<i32>,
    /// Along a column, by the rows from the top.
    v: Vec<i32>,
    swap: bool,
    mirrored: bool,
}

impl Grid {
    fn new(panel: Panel, placement: Placement) -> Grid {
        let side = |px: u32, pixel_mm: f64, reverse: bool| {
            let at = |k: u32| (f64::from(k) * pixel_mm * UNITS_PER_MM).round() as i32;
            (0..=px).map(|k| at(if reverse { px - k } else { k })).collect()
        };
        let [along, across] = placement.pixel_mm;
        Grid {
            u: side(panel.width_px, along, placement.reverse_u),
            v: side(panel.height_px, across, placement.reverse_v),
            swap: placement.swap,
            mirrored: placement.mirrored(),
        }
    }

    fn point(&self, [u, v]: Corner) -> Point {
        let (a, b) = (self.u[u as usize], self.v[v as usize]);
        if self.swap { Point { x: b, y: a } } else { Point { x: a, y: b } }
    }

    fn region(&self, polygons: Vec<trace::Rings<Point>>) -> Region {
        let turned = |mut rings: Vec<Ring>| {
            if self.mirrored {
                rings.iter_mut().for_each(|ring| ring.reverse());
            }
            Polygon { rings }
        };
        polygons.into_iter().map(turned).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin;
    use crate::resin::testing::sl1;
    use std::io::Cursor;

    /// Pixels of `#` 255, `+` 128, `-` 127, anything else 0.
    fn pixels(rows: &[&str]) -> Vec<u8> {
        let brightness = |b: u8| match b {
            b'#' => 255,
            b'+' => 128,
            b'-' => 127,
            _ => 0,
        };
        rows.iter().flat_map(|r| r.bytes()).map(brightness).collect()
    }

    fn all<R: Read + Seek>(mut layers: FromImages<R>) -> Result<Vec<Layer>, FromImagesError> {
        let mut found = Vec::new();
        while let Some(batch) = layers.next_batch()? {
            assert!(!batch.is_empty());
            found.extend(batch);
        }
        assert_eq!(layers.count(), Some(found.len() as u32));
        Ok(found)
    }

    fn layers(width: u32, height: u32, pictures: &[&[&str]]) -> Vec<Layer> {
        let pictures: Vec<Vec<u8>> = pictures.iter().map(|p| pixels(p)).collect();
        let job = resin::open(Cursor::new(sl1(width, height, &pictures))).expect("a job");
        all(FromImages::new(job)).expect("its layers")
    }

    fn mm(region: &Region) -> Vec<Vec<Vec<[f64; 2]>>> {
        let ring = |r: &Ring| r.iter().map(|p| p.mm()).collect();
        region.polygons.iter().map(|p| p.rings.iter().map(ring).collect()).collect()
    }

    #[test]
    fn layers_lie_upright_over_the_plate() {
        let found = layers(4, 3, &[&["#...", "....", "...+"], &["....", ".-..", "...."], &["####"; 3]]);
        let square = |x: f64, y: f64| vec![vec![[x, y + 1.0], [x, y], [x + 1.0, y], [x + 1.0, y + 1.0]]];
        assert_eq!(mm(&found[0].part), [square(0.0, 2.0), square(3.0, 0.0)]);
        assert!(found[1].part.is_empty(), "127 is dark");
        assert!((found[2].part.area_mm2() - 12.0).abs() < 1e-9);
        let heights: Vec<_> = found.iter().map(|l| (l.number, l.bottom_mm, l.top_mm)).collect();
        assert_eq!(heights[0], (0, 0.0, 0.1));
        for (l, expect) in found.iter().zip([[0.0, 0.1], [0.1, 0.15], [0.15, 0.2]]) {
            assert!((l.bottom_mm - expect[0]).abs() < 1e-12 && (l.top_mm - expect[1]).abs() < 1e-12);
            assert!(l.aid.is_empty());
        }
    }

    #[test]
    fn every_turn_of_the_panel_keeps_the_invariants() {
        let picture = pixels(&["##..", "#.#.", "####"]);
        let panel = Panel { width_px: 4, height_px: 3, packing: resin::image::Packing::Grey };
        let png = crate::resin::testing::grey(4, 3, &picture);
        for turn in 0..8 {
            let [reverse_u, reverse_v, swap] = [turn & 1 != 0, turn & 2 != 0, turn & 4 != 0];
            let placement = Placement { pixel_mm: [2.0, 3.0], reverse_u, reverse_v, swap };
            let Ok((region, None)) = contours(panel, &Grid::new(panel, placement), &png, false) else {
                panic!("a picture")
            };
            assert_eq!(region.polygons.len(), 1, "{turn}");
            let rings = &region.polygons[0].rings;
            let areas: Vec<f64> =
                rings.iter().map(|r| super::super::shape::twice_area(r) as f64 / 2e8).collect();
            assert_eq!(areas, [9.0 * 6.0, -6.0], "{turn}");
            // The pixel at the left of the top row, by its middle.
            let along = if reverse_u { 3.5 } else { 0.5 } * 2.0;
            let across = if reverse_v { 2.5 } else { 0.5 } * 3.0;
            let [x, y] = if swap { [across, along] } else { [along, across] };
            let corner = Point::from_mm(
                if x < 1.51 { 0.0 } else { x + if swap { 1.5 } else { 1.0 } },
                if y < 1.51 { 0.0 } else { y + if swap { 1.0 } else { 1.5 } },
            );
            assert!(rings[0].contains(&corner), "{turn}: {corner:?} of {rings:?}");
        }
    }

    #[test]
    fn corners_do_not_drift_over_a_panel() {
        let panel = Panel { width_px: 15_360, height_px: 1, packing: resin::image::Packing::Grey };
        let placement =
            Placement { pixel_mm: [0.047_25, 0.014], reverse_u: false, reverse_v: true, swap: false };
        let grid = Grid::new(panel, placement);
        for (k, &at) in grid.u.iter().enumerate() {
            assert!((f64::from(at) - k as f64 * 472.5).abs() <= 0.5, "{k}");
        }
    }

    #[test]
    fn a_damaged_picture_is_named() {
        let mut job = sl1(8, 8, &[vec![0; 64], vec![255; 64], vec![255; 64]]);
        // The picture of layer 1, damaged before it was packed.
        let mut png = crate::resin::testing::grey(8, 8, &[255; 64]);
        png[45] ^= 0xff;
        let entries = ["config.ini", "prusaslicer.ini", "job00000.png", "job00001.png", "job00002.png"];
        let mut archive = resin::archive::Archive::open(Cursor::new(&job)).expect("an archive");
        let mut entries: Vec<(&str, Vec<u8>)> =
            entries.map(|n| (n, archive.read_named(n, 1000).expect("an entry"))).to_vec();
        entries[3].1 = png;
        job = crate::resin::testing::archive(&entries);
        let job = resin::open(Cursor::new(job)).expect("a job");
        let said = all(FromImages::new(job)).expect_err("refused").to_string();
        assert!(said.contains("layer 1 (\"job00001.png\"): the picture cannot be read"), "{said}");
    }

    #[test]
    fn noise_is_refused_with_its_layer() {
        let (width, height) = (4096, 600);
        let noise: Vec<u8> = (0..width * height).map(|i| ((i + i / width) % 2 * 255) as u8).collect();
        let job = resin::open(Cursor::new(sl1(width, height, &[noise]))).expect("a job");
        let said = all(FromImages::new(job)).expect_err("refused").to_string();
        assert!(said.contains("layer 0 (\"job00000.png\")") && said.contains("dithering"), "{said}");
    }
}
