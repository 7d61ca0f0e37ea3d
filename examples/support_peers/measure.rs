//! The measure: contacts of supports with a part, and what they hold, from printed layers only.
//!
//! Takes what of a part and of supports lies in each layer, whoever planned these, and the
//! places that must be held. A *contact* is where a support ends right under the part, or with
//! at most the process's gap between them. Pieces of contacts that nearly touch are one
//! contact: a cone meets a slope over several layers. Knows no plan, no tip and no file.
use outrigger::layers::polygon::{difference, intersection, overlaps};
use outrigger::layers::shape::{Bounds, Place, Point, Polygon, Region};
use outrigger::support::demand::Demand;
use rayon::prelude::*;

/// Pieces of a contact are at most so far apart, mm; the peers' tips are 1 mm apart at least.
const JOIN_MM: f64 = 0.1;

/// Contacts of less area in all are where a support grazes a wall, mm².
const LEAST_MM2: f64 = 0.01;

/// The part and its supports, layer by layer from the plate up.
pub(crate) struct Printed<'a> {
    pub(crate) part: &'a [Region],
    /// Does not overlap the part.
    pub(crate) support: &'a [Region],
    pub(crate) layer_mm: f64,
    /// Layers that may stay free between a support and what it holds.
    pub(crate) gap: usize,
    /// Layers at the plate that do not count: a pad.
    pub(crate) skip: usize,
}

/// A piece of a contact: where, and the underside that it meets.
struct Piece {
    z_mm: f64,
    polygon: Polygon,
}

/// Where a support holds the part.
pub(crate) struct Contact {
    pieces: Vec<Piece>,
    area_mm2: f64,
}

/// What supports do for a demand. Percentiles are by area.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Figures {
    /// Islands with a contact under them, of all.
    pub(crate) islands: [u32; 2],
    /// Distance from what must be held to the nearest contact, mm: median and 95th percentile.
    pub(crate) far_mm: [f64; 2],
    /// Area that a contact carries, mm², at the 95th percentile.
    pub(crate) area_mm2: f64,
    /// The same for each mm² of the contact.
    pub(crate) load: f64,
    pub(crate) contacts: usize,
    /// Contacts to which nothing that must be held is nearest.
    pub(crate) idle: usize,
    /// Area of all contacts, mm².
    pub(crate) contact_mm2: f64,
}

impl Figures {
    /// Whether it is no worse at what issue-wide promises are about.
    pub(crate) fn no_worse(&self, than: &Figures) -> bool {
        self.islands[0] >= than.islands[0]
            && self.far_mm[1] <= than.far_mm[1]
            && self.area_mm2 <= than.area_mm2
    }
}

pub(crate) fn figures(demand: &Demand, printed: &Printed<'_>) -> Figures {
    let contacts = contacts(printed);
    let needs: Vec<_> = demand.needs.iter().filter(|n| n.area_mm2 > 0.0).collect();
    let nearest: Vec<(f64, usize)> = needs.par_iter().map(|n| nearest(&contacts, n.at_mm)).collect();
    let far = |share| {
        percentile(nearest.iter().zip(&needs).map(|(near, need)| (near.0, need.area_mm2)).collect(), share)
    };
    let mut carried = vec![0.0; contacts.len()];
    for ((_, contact), need) in nearest.iter().zip(&needs) {
        if let Some(carried) = carried.get_mut(*contact) {
            *carried += need.area_mm2;
        }
    }
    let islands: Vec<_> = demand.needs.iter().filter(|n| n.island).collect();
    let held = islands.iter().filter(|n| is_held(n.at_mm, printed, &contacts)).count();
    let loads = carried.iter().zip(&contacts).map(|(mm2, c)| (mm2 / c.area_mm2, *mm2)).collect();
    Figures {
        islands: [held as u32, islands.len() as u32],
        far_mm: [far(0.5), far(0.95)],
        area_mm2: percentile(carried.iter().map(|mm2| (*mm2, *mm2)).collect(), 0.95),
        load: percentile(loads, 0.95),
        contacts: contacts.len(),
        idle: carried.iter().filter(|mm2| **mm2 == 0.0).count(),
        contact_mm2: contacts.iter().map(|c| c.area_mm2).sum(),
    }
}

/// All contacts, the lowest first.
pub(crate) fn contacts(printed: &Printed<'_>) -> Vec<Contact> {
    let nothing = Region::default();
    let in_layer = |k: usize| {
        let above = printed.support.get(k + 1).unwrap_or(&nothing);
        let mut ends = difference(&printed.support[k], above);
        let mut found = Vec::new();
        for over in k + 1..=k + 1 + printed.gap {
            let Some(part) = printed.part.get(over).filter(|_| !ends.is_empty()) else { break };
            let z_mm = over as f64 * printed.layer_mm;
            let met = intersection(&ends, part).polygons.into_iter();
            found.extend(met.map(|polygon| Piece { z_mm, polygon }));
            ends = difference(&ends, part);
        }
        found
    };
    let layers = printed.skip..printed.support.len();
    let pieces: Vec<Piece> = layers.into_par_iter().flat_map_iter(in_layer).collect();
    // What is joined to what, as a forest; layers beside each other and the gap's come close.
    let reach_mm = (1 + printed.gap) as f64 * printed.layer_mm + 1e-6;
    let mut root: Vec<usize> = (0..pieces.len()).collect();
    for k in 0..pieces.len() {
        for other in (0..k).rev() {
            // Pieces come by their support's layer: an underside lies a gap higher at most.
            if pieces[k].z_mm - pieces[other].z_mm > 2.0 * reach_mm {
                break;
            }
            let close = (pieces[k].z_mm - pieces[other].z_mm).abs() <= reach_mm;
            if close && touch(&pieces[k].polygon, &pieces[other].polygon) {
                let (a, b) = (find(&mut root, k), find(&mut root, other));
                root[a.max(b)] = a.min(b);
            }
        }
    }
    let mut found: Vec<Contact> = Vec::new();
    let mut place = vec![usize::MAX; pieces.len()];
    for (k, piece) in pieces.into_iter().enumerate() {
        let of = find(&mut root, k);
        if of == k {
            place[k] = found.len();
            found.push(Contact { pieces: Vec::new(), area_mm2: 0.0 });
        }
        let contact = &mut found[place[of]];
        contact.area_mm2 += piece.polygon.area_mm2();
        contact.pieces.push(piece);
    }
    found.retain(|c| c.area_mm2 >= LEAST_MM2);
    found
}

fn find(root: &mut [usize], mut k: usize) -> usize {
    while root[k] != k {
        root[k] = root[root[k]];
        k = root[k];
    }
    k
}

fn touch(a: &Polygon, b: &Polygon) -> bool {
    let near = |a: &Polygon, b: &Polygon| a.rings.iter().flatten().any(|p| apart_mm(b, p.mm()) <= JOIN_MM);
    bounds_apart_mm(a.bounds(), b.bounds()) <= JOIN_MM && (near(a, b) || near(b, a))
}

fn bounds_apart_mm(a: Bounds, b: Bounds) -> f64 {
    let ([a_min, a_max], [b_min, b_max]) = (a.mm(), b.mm());
    let gap = |k: usize| (a_min[k] - b_max[k]).max(b_min[k] - a_max[k]).max(0.0);
    gap(0).hypot(gap(1))
}

/// Distance of a place to a polygon, mm; 0 within.
fn apart_mm(polygon: &Polygon, at: [f64; 2]) -> f64 {
    if polygon.place(Point::from_mm(at[0], at[1])) != Place::Outside {
        return 0.0;
    }
    let edge = |a: [f64; 2], b: [f64; 2]| {
        let (way, to) = ([b[0] - a[0], b[1] - a[1]], [at[0] - a[0], at[1] - a[1]]);
        let t = ((way[0] * to[0] + way[1] * to[1]) / (way[0] * way[0] + way[1] * way[1])).clamp(0.0, 1.0);
        (to[0] - t * way[0]).hypot(to[1] - t * way[1])
    };
    let rings = polygon.rings.iter();
    let edges = rings.flat_map(|r| r.iter().zip(r.iter().cycle().skip(1)));
    edges.map(|(a, b)| edge(a.mm(), b.mm())).fold(f64::INFINITY, f64::min)
}

/// Distance to the nearest contact, mm, and which it is.
fn nearest(contacts: &[Contact], at_mm: [f64; 3]) -> (f64, usize) {
    let here = Bounds::of(&[Point::from_mm(at_mm[0], at_mm[1])]);
    let mut best = (f64::INFINITY, usize::MAX);
    for (k, contact) in contacts.iter().enumerate() {
        for piece in &contact.pieces {
            let up = piece.z_mm - at_mm[2];
            if up.hypot(bounds_apart_mm(piece.polygon.bounds(), here)) < best.0 {
                let apart = up.hypot(apart_mm(&piece.polygon, [at_mm[0], at_mm[1]]));
                best = if apart < best.0 { (apart, k) } else { best };
            }
        }
    }
    best
}

/// Whether a contact lies under the island that begins at a place.
fn is_held(at_mm: [f64; 3], printed: &Printed<'_>, contacts: &[Contact]) -> bool {
    let at = Point::from_mm(at_mm[0], at_mm[1]);
    let layer = printed.part.get((at_mm[2] / printed.layer_mm).round() as usize);
    let island = layer.and_then(|l| l.polygons.iter().find(|p| p.place(at) != Place::Outside));
    let pieces = contacts.iter().flat_map(|c| &c.pieces);
    let mut beside = pieces.filter(|p| (p.z_mm - at_mm[2]).abs() < printed.layer_mm / 2.0);
    island.is_some_and(|island| beside.any(|p| overlaps(&p.polygon, island)))
}

/// The least value that this share of the weight does not exceed; 0 of nothing.
fn percentile(mut values: Vec<(f64, f64)>, share: f64) -> f64 {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = share * values.iter().map(|v| v.1).sum::<f64>() * (1.0 - 1e-12);
    let mut sum = 0.0;
    let reached = |v: &&(f64, f64)| {
        sum += v.1;
        sum >= wanted
    };
    values.iter().find(reached).map_or(0.0, |v| v.0)
}

#[cfg(test)]
mod tests;
