//! Overhangs by images, as the peers find them: the reference for the polygons.
//!
//! Takes two neighbouring layers as polygons, looks at them as at slice images of a
//! stated pixel size, gives the [`Piece`]s of the upper one that the lower one, dilated,
//! does not cover (paper 001, section 1, of Chen et al.; resin slicers likewise erode the
//! difference). Shares with [`super::overhang_layer`] the rule and no geometry:
//!
//! - A pixel belongs to a layer when its centre does (even-odd scan lines).
//! - Distances are Euclidean, from the centre of a pixel to the border of what is below.
//!   The border is known between two centres to less than a pixel, as the grey of an
//!   antialiased image tells it: it is sampled where it crosses the lines through the centres.
//! - [`Growth::Conditional`]: a border point holds the pixels that it reaches over
//!   pixels of the same polygon alone, each no farther from it than the reach.
//! - [`Growth::Naive`]: it holds all pixels within reach.
//! - Bridges are no concern of images.
//!
//! Time and memory go with the pixels that nothing lies under, not with the image.
mod raster;

use super::links::{Links, polygons};
use super::overhang::{Growth, Piece};
use crate::layers::polygon::{Inside, resolve};
use crate::layers::shape::{Point, Polygon, Ring, UNITS_PER_MM};
use crate::layers::stack::Layer;
use raster::{Grid, Raster};
use rustc_hash::FxHashMap;
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Smallest pixel, mm: ten steps of the grid.
pub const SMALLEST_PIXEL_MM: f64 = 0.001;

/// The overhanging pieces of a layer, for a reach in mm; see
/// [`super::overhang_layer::reach_mm`]. A polygon wider than
/// 65,536 pixels, or with more than 8 million that nothing lies under, is looked at with
/// larger ones.
#[must_use]
pub fn pieces(
    below: &Layer,
    layer: &Layer,
    links: &Links,
    reach_mm: f64,
    growth: Growth,
    pixel_mm: f64,
) -> Vec<Piece> {
    if layer.number == 0 {
        return Vec::new();
    }
    let lower: Vec<&Polygon> = polygons(below).collect();
    let mut found = Vec::new();
    for (k, polygon) in layer.part.polygons.iter().enumerate() {
        let linked = links.below(k);
        let holding: Vec<&Polygon> = match growth {
            Growth::Conditional => linked.iter().map(|&b| lower[b as usize]).collect(),
            Growth::Naive => lower.clone(),
        };
        let (bare, grid) = Bare::bounded(polygon, &holding, pixel_mm);
        if bare.count == 0 {
            continue;
        }
        let reach = reach_mm * UNITS_PER_MM;
        let held = match growth {
            Growth::Conditional => bare.spread(&holding, &grid, reach),
            Growth::Naive => bare.dilate(&holding, &grid, reach),
        };
        let left = bare.outlines(&held, &grid);
        found.extend(left.into_iter().map(|polygon| Piece { polygon, island: linked.is_empty() }));
    }
    found
}

/// A region as an image shows it: the pixels whose centres lie inside, as polygons. For
/// comparing what polygons say with what images say.
#[must_use]
pub fn pixels(polygons: &[Polygon], pixel_mm: f64) -> Vec<Polygon> {
    let mut found = Vec::new();
    for polygon in polygons {
        let (bare, grid) = Bare::bounded(polygon, &[], pixel_mm);
        found.extend(bare.outlines(&vec![false; bare.count], &grid));
    }
    found
}

/// Pixels of one polygon with nothing under them at most: about 200 MB.
const MOST_BARE: usize = 1 << 23;

/// The pixels of a polygon with nothing under them.
struct Bare {
    own: Raster,
    below: Raster,
    bare: Raster,
    /// Index of the first pixel of each run of `bare`, by row.
    starts: Vec<Vec<u32>>,
    count: usize,
}

/// A place in grid steps.
type V = [f64; 2];

impl Bare {
    /// With pixels of this size, or larger ones where they would be too many.
    fn bounded(polygon: &Polygon, holding: &[&Polygon], pixel_mm: f64) -> (Bare, Grid) {
        let all: Vec<&Polygon> = holding.iter().copied().chain([polygon]).collect();
        let mut pixel = pixel_mm.max(SMALLEST_PIXEL_MM) * UNITS_PER_MM;
        loop {
            let grid = Grid::over(polygon.bounds(), pixel, &all);
            let bare = Bare::new(polygon, holding, &grid);
            if bare.count <= MOST_BARE {
                return (bare, grid);
            }
            pixel = grid.pixel * 2.0;
        }
    }

    fn new(polygon: &Polygon, holding: &[&Polygon], grid: &Grid) -> Bare {
        let own = Raster::of(&[polygon], grid);
        let below = Raster::of(holding, grid);
        let bare = own.minus(&below);
        let mut count = 0_usize;
        let mut row_starts = |row: &Vec<(i32, i32)>| -> Vec<u32> {
            let mut index = |&(from, to): &(i32, i32)| {
                let first = count as u32;
                count += (to - from).unsigned_abs() as usize;
                first
            };
            row.iter().map(&mut index).collect()
        };
        let starts = bare.rows.iter().map(&mut row_starts).collect();
        Bare { own, below, bare, starts, count }
    }

    fn index(&self, x: i32, row: i32) -> Option<usize> {
        let row = usize::try_from(row).ok()?;
        let run = self.bare.run(x, row)?;
        Some(self.starts[row][run] as usize + (x - self.bare.rows[row][run].0) as usize)
    }

    fn pixels(&self) -> impl Iterator<Item = (usize, i32, i32)> + '_ {
        let runs = |(row, runs): (usize, &Vec<(i32, i32)>)| {
            let runs: Vec<(i32, i32)> = runs.clone();
            runs.into_iter().flat_map(move |(from, to)| (from..to).map(move |x| (x, row as i32)))
        };
        self.bare.rows.iter().enumerate().flat_map(runs).enumerate().map(|(k, (x, row))| (k, x, row))
    }

    /// Held pixels, where what is held spreads over the polygon's own pixels alone.
    fn spread(&self, holding: &[&Polygon], grid: &Grid, reach: f64) -> Vec<bool> {
        let borders = raster::Crossings::of(holding, grid);
        let reach_2 = reach * reach;
        let mut nearest: Vec<(f64, V)> = vec![(f64::INFINITY, [0.0; 2]); self.count];
        let mut queue = BinaryHeap::new();
        for (k, x, row) in self.pixels() {
            let here = grid.centre(x, row);
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1)] {
                if self.below.holds(x + dx, row + dy) && self.own.holds(x + dx, row + dy) {
                    let border = borders.between(x, row, dx, dy, grid);
                    offer(&mut nearest, &mut queue, (k, x, row), distance_2(here, border), border, reach_2);
                }
            }
        }
        while let Some((Reverse(bits), k, x, row)) = queue.pop() {
            let (best, border) = nearest[k as usize];
            if best.to_bits() != bits {
                continue;
            }
            for (dx, dy) in [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)] {
                if let Some(next) = self.index(x + dx, row + dy) {
                    let far = distance_2(grid.centre(x + dx, row + dy), border);
                    offer(&mut nearest, &mut queue, (next, x + dx, row + dy), far, border, reach_2);
                }
            }
        }
        nearest.into_iter().map(|(far, _)| far <= reach_2).collect()
    }

    /// Held pixels, where all within reach are held.
    fn dilate(&self, holding: &[&Polygon], grid: &Grid, reach: f64) -> Vec<bool> {
        let cell = reach.max(grid.pixel);
        let key = |p: V| ((p[0] / cell).floor() as i64, (p[1] / cell).floor() as i64);
        let mut cells: FxHashMap<(i64, i64), Vec<V>> = FxHashMap::default();
        for point in raster::Crossings::of(holding, grid).points(grid) {
            cells.entry(key(point)).or_default().push(point);
        }
        let near = |p: V| {
            let (x, y) = key(p);
            let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (x + dx, y + dy)));
            around.filter_map(|c| cells.get(&c)).flatten().any(|&b| distance_2(p, b) <= reach * reach)
        };
        self.pixels().map(|(_, x, row)| near(grid.centre(x, row))).collect()
    }

    /// The pixels that are not held, as polygons along the pixels' sides.
    fn outlines(&self, held: &[bool], grid: &Grid) -> Vec<Polygon> {
        let mut rows: Vec<Ring> = Vec::new();
        for (row, runs) in self.bare.rows.iter().enumerate() {
            for (run, &(from, to)) in runs.iter().enumerate() {
                let first = self.starts[row][run] as usize;
                let mut x = from;
                while x < to {
                    let is_held = |x: i32| held[first + (x - from) as usize];
                    let end = (x..to).find(|&e| is_held(e) != is_held(x)).unwrap_or(to);
                    if !is_held(x) {
                        rows.push(grid.rectangle(x, end, row as i32));
                    }
                    x = end;
                }
            }
        }
        resolve(&rows, Inside::NonZero).polygons
    }
}

type Queue = BinaryHeap<(Reverse<u64>, u32, i32, i32)>;

/// Takes a border point for a pixel if it is nearer than the one so far and within reach.
fn offer(
    nearest: &mut [(f64, V)],
    queue: &mut Queue,
    (k, x, row): (usize, i32, i32),
    far: f64,
    border: V,
    reach_2: f64,
) {
    if far < nearest[k].0 && far <= reach_2 {
        nearest[k] = (far, border);
        // Distances are not negative, so that their bits are in the same order.
        queue.push((Reverse(far.to_bits()), k as u32, x, row));
    }
}

fn distance_2(a: V, b: V) -> f64 {
    (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2)
}

impl Grid {
    /// The rectangle of pixels `from..to` of a row.
    fn rectangle(&self, from: i32, to: i32, row: i32) -> Ring {
        let corner = |x: i32, y: i32| {
            let [x, y] = self.corner(x, y);
            Point { x: x.round() as i32, y: y.round() as i32 }
        };
        vec![corner(from, row), corner(to, row), corner(to, row + 1), corner(from, row + 1)]
    }
}
