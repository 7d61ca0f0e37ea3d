//! Overhanging pieces of neighbouring layers joined to regions.
//!
//! Takes [`Piece`]s layer by layer, gives [`OverhangRegion`]s. Pieces of two neighbouring
//! layers belong together when they come as near as what a layer holds reaches: above an
//! overhanging wall the next strip begins that far beside the one below. Pieces of one
//! layer belong together when others join them. Knows no detector.
use super::overhang::{MAX_REGIONS, Method, OverhangRegion, Overhangs, Piece};
use super::overlap::sweep;
use crate::layers::shape::{Bounds, Point, Polygon, UNITS_PER_MM};

/// Pairs of pieces, of the layer below and of the layer, that belong together. Pure.
pub(super) fn joins(below: &[Piece], pieces: &[Piece], reach_mm: f64) -> Vec<(u32, u32)> {
    let reach = (reach_mm * UNITS_PER_MM).ceil().clamp(0.0, f64::from(1 << 28)) as i32 + 2;
    let bounds = |all: &[Piece]| -> Vec<Bounds> { all.iter().map(|p| p.polygon.bounds()).collect() };
    let (lower, upper) = (bounds(below), bounds(pieces));
    let wider = |b: &Bounds| widened(*b, reach);
    let spans =
        |all: &[Bounds], of: fn(&Bounds) -> (i32, i32)| -> Vec<(i32, i32)> { all.iter().map(of).collect() };
    let wide: Vec<Bounds> = lower.iter().map(wider).collect();
    let mut found = Vec::new();
    let x: fn(&Bounds) -> (i32, i32) = |b| (b.min.x, b.max.x);
    sweep(&spans(&wide, x), &spans(&upper, x), |b, k| {
        let (i, j) = (b as usize, k as usize);
        if wide[i].overlap(upper[j]) && near(&below[i].polygon, &pieces[j].polygon, reach) {
            found.push((b, k));
        }
        false
    });
    found.sort_unstable();
    found
}

fn widened(b: Bounds, by: i32) -> Bounds {
    Bounds {
        min: Point { x: b.min.x.saturating_sub(by), y: b.min.y.saturating_sub(by) },
        max: Point { x: b.max.x.saturating_add(by), y: b.max.y.saturating_add(by) },
    }
}

/// Whether the borders of two polygons come this near, or one lies in the other.
fn near(a: &Polygon, b: &Polygon, reach: i32) -> bool {
    use super::overlap::Outline;
    let (edges_a, edges_b) = (boxes(a, reach), boxes(b, 0));
    let span = |all: &[(Bounds, [Point; 2])]| -> Vec<(i32, i32)> {
        all.iter().map(|(b, _)| (b.min.x, b.max.x)).collect()
    };
    let reach_2 = f64::from(reach) * f64::from(reach);
    sweep(&span(&edges_a), &span(&edges_b), |i, k| {
        let ((p, e), (q, f)) = (&edges_a[i as usize], &edges_b[k as usize]);
        p.min.y <= q.max.y && q.min.y <= p.max.y && distance_2(*e, *f) <= reach_2
    }) || Outline::new(a).surely_overlaps(&Outline::new(b))
}

fn boxes(polygon: &Polygon, wider: i32) -> Vec<(Bounds, [Point; 2])> {
    polygon
        .rings
        .iter()
        .flat_map(super::slabs::edges)
        .map(|(a, b)| (widened(Bounds::of(&[a, b]), wider), [a, b]))
        .collect()
}

/// Distance of two edges from each other's ends, squared; edges that cross overlap anyway.
fn distance_2(e: [Point; 2], f: [Point; 2]) -> f64 {
    let at = |p: Point| [f64::from(p.x), f64::from(p.y)];
    let from = |p: Point, e: [Point; 2]| {
        let (p, a, b) = (at(p), at(e[0]), at(e[1]));
        let (along, to) = ([b[0] - a[0], b[1] - a[1]], [p[0] - a[0], p[1] - a[1]]);
        let length = along[0] * along[0] + along[1] * along[1];
        let t =
            if length > 0.0 { ((to[0] * along[0] + to[1] * along[1]) / length).clamp(0.0, 1.0) } else { 0.0 };
        (to[0] - t * along[0]).powi(2) + (to[1] - t * along[1]).powi(2)
    };
    from(e[0], f).min(from(e[1], f)).min(from(f[0], e)).min(from(f[1], e))
}

/// A region that may still grow.
#[derive(Clone, Debug)]
struct Open {
    region: OverhangRegion,
    /// Area times centroid, mm³.
    moment: [f64; 2],
}

/// Regions met so far; layers are pushed from the plate up.
#[derive(Debug)]
pub(super) struct Regions {
    found: Overhangs,
    min_area_mm2: f64,
    open: Vec<Open>,
    /// Which open region each piece of the last layer belongs to.
    owners: Vec<u32>,
}

impl Regions {
    pub(super) fn new(method: Method, min_area_mm2: f64) -> Regions {
        let found = Overhangs {
            method,
            regions: Vec::new(),
            small: Vec::new(),
            unlisted: 0,
            area_mm2: 0.0,
            small_area_mm2: 0.0,
        };
        Regions { found, min_area_mm2, open: Vec::new(), owners: Vec::new() }
    }

    /// Takes the pieces of the next layer, and which belong to which below.
    pub(super) fn push(&mut self, layer: u32, z_mm: f64, pieces: &[Piece], joins: &[(u32, u32)]) {
        let below = std::mem::take(&mut self.open);
        let mut sets: Vec<u32> = (0..(below.len() + pieces.len()) as u32).collect();
        let of_piece = |k: u32| below.len() as u32 + k;
        for &(b, k) in joins {
            let (a, b) = (find(&mut sets, self.owners[b as usize]), find(&mut sets, of_piece(k)));
            sets[a.max(b) as usize] = a.min(b);
        }
        let roots: Vec<u32> = (0..sets.len() as u32).map(|k| find(&mut sets, k)).collect();
        let mut goes_on = vec![false; sets.len()];
        (0..pieces.len()).for_each(|k| goes_on[roots[below.len() + k] as usize] = true);
        let mut place = vec![None; sets.len()];
        for (k, open) in below.iter().enumerate() {
            let root = roots[k] as usize;
            if !goes_on[root] {
                self.close(open.clone());
            } else {
                self.put(&mut place, root, open.clone());
            }
        }
        for (k, piece) in pieces.iter().enumerate() {
            self.put(&mut place, roots[below.len() + k] as usize, opened(layer, z_mm, piece));
        }
        let owner = |k: usize| place[roots[below.len() + k] as usize].unwrap_or(0);
        self.owners = (0..pieces.len()).map(owner).collect();
    }

    fn put(&mut self, place: &mut [Option<u32>], root: usize, open: Open) {
        match place[root] {
            Some(k) => self.open[k as usize].add(&open),
            None => {
                place[root] = Some(self.open.len() as u32);
                self.open.push(open);
            }
        }
    }

    fn close(&mut self, open: Open) {
        let Open { mut region, moment } = open;
        region.centroid_mm = moment.map(|m| m / region.area_mm2.max(f64::MIN_POSITIVE));
        let small = region.area_mm2 < self.min_area_mm2;
        let total = if small { &mut self.found.small_area_mm2 } else { &mut self.found.area_mm2 };
        *total += region.area_mm2;
        if self.found.regions.len() + self.found.small.len() >= MAX_REGIONS {
            self.found.unlisted += 1;
        } else if small {
            self.found.small.push(region);
        } else {
            self.found.regions.push(region);
        }
    }

    /// After the last layer.
    pub(super) fn finish(mut self) -> Overhangs {
        for open in std::mem::take(&mut self.open) {
            self.close(open);
        }
        for list in [&mut self.found.regions, &mut self.found.small] {
            list.sort_by(|a, b| {
                let place = |r: &OverhangRegion| r.bbox_mm[0];
                let (p, q) = (place(a), place(b));
                a.layer.cmp(&b.layer).then(p[0].total_cmp(&q[0])).then(p[1].total_cmp(&q[1]))
            });
        }
        self.found
    }
}

fn opened(layer: u32, z_mm: f64, piece: &Piece) -> Open {
    let (area, centroid) = (piece.polygon.area_mm2(), piece.polygon.centroid_mm());
    let region = OverhangRegion {
        layer,
        z_mm,
        end_layer: layer,
        end_z_mm: z_mm,
        area_mm2: area,
        surface_mm2: area,
        centroid_mm: centroid,
        bbox_mm: piece.polygon.bounds().mm(),
        island: piece.island,
    };
    Open { region, moment: centroid.map(|c| c * area) }
}

impl Open {
    fn add(&mut self, other: &Open) {
        let (a, b) = (&mut self.region, &other.region);
        if b.layer < a.layer {
            (a.layer, a.z_mm) = (b.layer, b.z_mm);
        }
        if b.end_layer > a.end_layer {
            (a.end_layer, a.end_z_mm) = (b.end_layer, b.end_z_mm);
        }
        a.area_mm2 += b.area_mm2;
        a.surface_mm2 += b.surface_mm2;
        a.island |= b.island;
        for k in 0..2 {
            self.moment[k] += other.moment[k];
            a.bbox_mm[0][k] = a.bbox_mm[0][k].min(b.bbox_mm[0][k]);
            a.bbox_mm[1][k] = a.bbox_mm[1][k].max(b.bbox_mm[1][k]);
        }
    }
}

fn find(sets: &mut [u32], mut k: u32) -> u32 {
    while sets[k as usize] != k {
        let up = sets[sets[k as usize] as usize];
        sets[k as usize] = up;
        k = up;
    }
    k
}
