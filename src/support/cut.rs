//! A forest cut at any height.
//!
//! A branch is what a ball sweeps that goes from one end to the other and changes its
//! radius evenly: a plane cuts it in the hull of the discs in which it cuts the balls.
//! A foot on the plate is a plain cone. Above a tip's contact there is nothing, and nothing
//! below the plate.
use super::section::{Section, Sections};
use super::tree::{Branch, Forest, Kind};
use crate::layers::polygon::union_all;
use crate::layers::shape::{Point, Polygon, Region, Ring};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Balls that stand for a branch, and corners of a disc.
const BALLS: u32 = 9;
const CORNERS: u32 = 24;

/// A branch, and whether it is a tip's.
#[derive(Clone, Copy, Debug)]
struct Piece {
    branch: Branch,
    /// Lowest and highest place that it has, mm.
    z_mm: [f64; 2],
    tip: bool,
    /// It stands on the plate: a plain cone, which no ball of its foot's width would follow.
    foot: bool,
}

/// A forest that can be cut.
#[derive(Debug)]
pub struct Cuts {
    pieces: Vec<Piece>,
    /// Pieces by bands of height.
    bands: Vec<Vec<u32>>,
    interface_mm: f64,
    top_mm: f64,
}

/// Height of a band, mm.
const BAND_MM: f64 = 0.5;

impl Cuts {
    /// Of a forest; what of a tip lies at most `interface_mm` below its contact is interface.
    #[must_use]
    pub fn new(forest: &Forest, interface_mm: f64) -> Cuts {
        let mut pieces = Vec::new();
        for node in &forest.nodes {
            let Some(down) = forest.nodes.get(node.down as usize) else { continue };
            let tip = node.kind == Kind::Tip;
            let branch =
                Branch { ends_mm: [node.at_mm, down.at_mm], radii_mm: [node.radius_mm, down.radius_mm] };
            let high = node.at_mm[2] + if tip { 0.0 } else { node.radius_mm };
            let high = high.max(down.at_mm[2]);
            let low = (down.at_mm[2] - down.radius_mm).max(forest.ground_mm(down));
            let foot = down.kind == Kind::Plate;
            let high = if foot { node.at_mm[2] } else { high };
            pieces.push(Piece { branch, z_mm: [low.max(0.0), high], tip, foot });
        }
        let top_mm = pieces.iter().map(|p| p.z_mm[1]).fold(0.0, f64::max);
        let mut bands = vec![Vec::new(); (top_mm / BAND_MM).floor() as usize + 1];
        for (k, piece) in pieces.iter().enumerate() {
            let [low, high] = piece.z_mm.map(|z| (z / BAND_MM).floor().max(0.0) as usize);
            let last = high.min(bands.len() - 1);
            bands[low.min(last)..=last].iter_mut().for_each(|band| band.push(k as u32));
        }
        Cuts { pieces, bands, interface_mm, top_mm }
    }
}

impl Cuts {
    /// What is printed of it in layers between these heights, mm³: the area of each section
    /// times its height.
    #[must_use]
    pub fn volume_mm3(&self, layers_mm: &[[f64; 2]]) -> f64 {
        let layer = |[bottom, top]: &[f64; 2]| {
            let section = self.section(*bottom, *top);
            (section.body.area_mm2() + section.interface.area_mm2()) * (top - bottom)
        };
        // Summed in order, so that it is the same on any number of threads.
        layers_mm.par_iter().map(layer).collect::<Vec<f64>>().iter().sum()
    }

    /// The same in layers of one height, mm.
    #[must_use]
    pub fn volume_in_mm3(&self, layer_mm: f64) -> f64 {
        let count = (self.top_mm / layer_mm).ceil() as u32;
        let layers: Vec<_> =
            (0..count).map(|k| [f64::from(k), f64::from(k + 1)].map(|k| k * layer_mm)).collect();
        self.volume_mm3(&layers)
    }
}

impl Sections for Cuts {
    fn top_mm(&self) -> f64 {
        self.top_mm
    }

    fn section(&self, bottom_mm: f64, top_mm: f64) -> Section {
        let z = (bottom_mm + top_mm) / 2.0;
        let band = self.bands.get((z / BAND_MM).floor().max(0.0) as usize).map_or(&[][..], |b| b);
        let (mut body, mut interface) = (Vec::new(), Vec::new());
        for piece in band.iter().map(|k| &self.pieces[*k as usize]) {
            if z < piece.z_mm[0] || z > piece.z_mm[1] {
                continue;
            }
            let Some(ring) = cut(piece, z) else { continue };
            let contact_mm = piece.branch.ends_mm[0][2];
            let near = piece.tip && z > contact_mm - self.interface_mm;
            let to = if near { &mut interface } else { &mut body };
            to.push(Region { polygons: vec![Polygon { rings: vec![ring] }] });
        }
        Section { body: union_all(&body), interface: union_all(&interface) }
    }
}

/// The hull of the discs, counter-clockwise.
fn cut(piece: &Piece, z: f64) -> Option<Ring> {
    let branch = &piece.branch;
    let [a, b] = branch.ends_mm;
    let mut points = Vec::new();
    let balls = if piece.foot { 0 } else { BALLS };
    for k in 0..balls {
        let t = f64::from(k) / f64::from(BALLS - 1);
        disc(branch, a, b, t, z, &mut points);
    }
    if (a[2] - b[2]).abs() > 1e-9 {
        // The ball in the plane itself, the widest of a branch that is no cone.
        let t = (a[2] - z) / (a[2] - b[2]);
        if (0.0..=1.0).contains(&t) {
            disc(branch, a, b, t, z, &mut points);
        }
    }
    hull(points)
}

fn disc(branch: &Branch, a: [f64; 3], b: [f64; 3], t: f64, z: f64, points: &mut Vec<Point>) {
    let at = [0, 1, 2].map(|k| a[k] + (b[k] - a[k]) * t);
    let radius = branch.radii_mm[0] + (branch.radii_mm[1] - branch.radii_mm[0]) * t;
    let squared = radius * radius - (z - at[2]) * (z - at[2]);
    if squared <= 0.0 {
        return;
    }
    let radius = squared.sqrt();
    for k in 0..CORNERS {
        let turn = TAU * f64::from(k) / f64::from(CORNERS);
        points.push(Point::from_mm(at[0] + radius * turn.cos(), at[1] + radius * turn.sin()));
    }
}

/// The convex hull, counter-clockwise (Andrew's monotone chain); `None` without area.
fn hull(mut points: Vec<Point>) -> Option<Ring> {
    points.sort_unstable();
    points.dedup();
    if points.len() < 3 {
        return None;
    }
    let turn = |a: Point, b: Point, c: Point| {
        let d = |p: Point, q: Point| (i64::from(q.x) - i64::from(p.x), i64::from(q.y) - i64::from(p.y));
        let ((ux, uy), (vx, vy)) = (d(a, b), d(a, c));
        ux * vy - uy * vx
    };
    let chain = |points: &mut dyn Iterator<Item = Point>| {
        let mut half: Ring = Vec::new();
        for p in points {
            while half.len() > 1 && turn(half[half.len() - 2], half[half.len() - 1], p) <= 0 {
                half.pop();
            }
            half.push(p);
        }
        half.pop();
        half
    };
    let mut ring = chain(&mut points.iter().copied());
    ring.extend(chain(&mut points.iter().rev().copied()));
    (ring.len() > 2).then_some(ring)
}
