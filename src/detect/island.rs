//! Islands: pieces of a layer that nothing below holds (paper 003, sections 3.1, 3.2).
//!
//! Takes layers from the plate up with their [`Links`], gives [`Island`]s. A piece that
//! shares no area with anything below appears as an island (the paper's null residual).
//! It is followed upward, as in the paper's Fig. 5, until a layer in which it meets a
//! body that stands on the plate: there it ends (the paper's S4).
//!
//! Choices where the paper leaves room:
//! - Layer 0 lies on the plate and stands. So does all that shares area with something
//!   that stands, support or part. Touching beside, in the same layer, holds nothing.
//! - Islands that meet before they meet a body go on as one group. When a branch of the
//!   group meets a body, all of it ends in that layer: the rest is held through it.
//! - What happens in a layer does not depend on the order of its polygons.
//! - "Small" is an island whose area stays below the smallest asked for until it ends or
//!   meets an island that has been larger; the larger one goes on with the area of both.
//!   So a tip that grows is never small, and a speck that joins a big island is.
use super::links::{Links, polygons};
use crate::layers::shape::Polygon;
use crate::layers::stack::Layer;

/// One island: where it begins, and where it joins something that stands on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct Island {
    /// Layer in which it appears.
    pub layer: u32,
    /// Height of that layer's plane, mm.
    pub z_mm: f64,
    /// First layer in which it is no island any more because it meets a body that stands
    /// on the plate (the paper's S4); its last layer where it never does.
    pub end_layer: u32,
    /// Height of that layer's plane, mm.
    pub end_z_mm: f64,
    /// Whether it ever meets such a body.
    pub joins: bool,
    /// Area in the layer where it appears, mm².
    pub area_mm2: f64,
    /// Largest area in one layer as an island, mm²; islands that met share it.
    pub max_area_mm2: f64,
    /// Largest area in one layer before it met an island that had been larger, mm²: what
    /// tells the small ones apart.
    pub own_area_mm2: f64,
    /// Centroid in the layer where it appears, mm.
    pub centroid_mm: [f64; 2],
    /// `[[min x, min y], [max x, max y]]` in the layer where it appears, mm.
    pub bbox_mm: [[f64; 2]; 2],
}

/// What a polygon of a layer is, for pictures and for other detectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Joined to the plate.
    Body,
    /// An island that appears in this layer: dark blue in the paper's Figs. 8 and 10.
    Appears,
    /// An island, or several that met, on their way up: light blue.
    Island,
}

/// What the polygons of a layer are.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Standings {
    /// Of `layer.part.polygons`, in their order.
    pub part: Vec<Standing>,
    /// Of `layer.aid.polygons`, in their order.
    pub aid: Vec<Standing>,
}

/// The islands of a job, each list by layer and then by place.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Found {
    /// Those of the part, as large as was asked for at least.
    pub islands: Vec<Island>,
    /// Smaller ones of the part.
    pub small: Vec<Island>,
    /// Supports, brims and towers that begin in the air.
    pub floating_aid: Vec<Island>,
    /// Islands that are in no list because there are more than [`MAX_ISLANDS`].
    pub unlisted: u64,
}

/// Islands that are kept at most, so that a hostile job does not fill the memory.
pub const MAX_ISLANDS: usize = 1_000_000;

/// An island with what is needed to follow it.
#[derive(Debug)]
struct Record {
    island: Island,
    aid: bool,
}

/// Islands that met, on their way up.
#[derive(Debug, Default)]
struct Group {
    /// Indices of the records; those not kept are not here.
    members: Vec<u32>,
    /// The member that has been largest so far: the one that goes on.
    eldest: Option<u32>,
    max_area_mm2: f64,
}

/// What a polygon of the last layer belongs to: the body, or a group.
const BODY: u32 = 0;

/// The islands met so far; layers are pushed from the plate up.
#[derive(Debug, Default)]
pub struct Islands {
    records: Vec<Record>,
    unlisted: u64,
    /// Alive in the last layer; group `k` is node `k + 1`, node 0 the body.
    groups: Vec<Group>,
    /// Nodes of the last layer's polygons.
    nodes: Vec<u32>,
    /// Number and height of the last layer.
    last: (u32, f64),
}

/// Sets that are joined; the lowest index of a set stands for it, so the body wins.
struct Sets(Vec<u32>);

impl Sets {
    fn find(&mut self, mut k: u32) -> u32 {
        while self.0[k as usize] != k {
            let up = self.0[self.0[k as usize] as usize];
            self.0[k as usize] = up;
            k = up;
        }
        k
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

impl Islands {
    /// None yet.
    #[must_use]
    pub fn new() -> Islands {
        Islands::default()
    }

    /// Takes the next layer with its links to the one below; of layer 0 the links do not matter.
    pub fn push(&mut self, layer: &Layer, links: &Links) -> Standings {
        let z = layer.plane_mm();
        let mut sets = Sets((0..=self.groups.len() as u32).collect());
        let mut nodes: Vec<Option<u32>> = Vec::new();
        for k in 0..polygons(layer).count() {
            if layer.number == 0 {
                nodes.push(Some(BODY));
                continue;
            }
            let mut below = links.below(k).iter().map(|&b| self.nodes[b as usize]);
            let first = below.next();
            if let Some(first) = first {
                below.for_each(|other| sets.join(first, other));
            }
            nodes.push(first);
        }
        let mut alive = self.regroup(layer.number, z, &mut sets, &nodes);
        let parts = layer.part.polygons.len();
        let mut standings = Standings::default();
        let (mut fresh, mut areas) = (Vec::new(), vec![0.0; alive.groups.len()]);
        self.nodes.clear();
        for (k, (polygon, node)) in polygons(layer).zip(nodes).enumerate() {
            let (node, standing) = match node.map(|n| alive.node_of[sets.find(n) as usize]) {
                Some(BODY) => (BODY, Standing::Body),
                Some(node) => {
                    areas[node as usize - 1] += polygon.area_mm2();
                    (node, Standing::Island)
                }
                None => {
                    fresh.push(self.appear(layer, polygon, k >= parts));
                    ((alive.groups.len() + fresh.len()) as u32, Standing::Appears)
                }
            };
            self.nodes.push(node);
            if k < parts { standings.part.push(standing) } else { standings.aid.push(standing) }
        }
        for (group, area) in alive.groups.iter_mut().zip(areas) {
            group.max_area_mm2 = group.max_area_mm2.max(area);
            if let Some(eldest) = group.eldest {
                let own = &mut self.records[eldest as usize].island.own_area_mm2;
                *own = own.max(area);
            }
        }
        alive.groups.append(&mut fresh);
        self.groups = alive.groups;
        self.last = (layer.number, z);
        standings
    }

    /// Joins the groups that met, ends those that met a body and those that go no further.
    fn regroup(&mut self, number: u32, z: f64, sets: &mut Sets, nodes: &[Option<u32>]) -> Alive {
        let count = self.groups.len();
        let mut goes_on = vec![false; count + 1];
        for node in nodes.iter().flatten() {
            goes_on[sets.find(*node) as usize] = true;
        }
        let mut alive = Alive { groups: Vec::new(), node_of: vec![BODY; count + 1] };
        let (last, last_z) = self.last;
        for (k, group) in std::mem::take(&mut self.groups).into_iter().enumerate() {
            let own = k as u32 + 1;
            let root = sets.find(own);
            if root == BODY {
                self.end(group, number, z, true);
            } else if !goes_on[root as usize] {
                self.end(group, last, last_z, false);
            } else if root == own {
                alive.groups.push(group);
                alive.node_of[own as usize] = alive.groups.len() as u32;
            } else {
                // A set's lowest group stands for it, so it is alive already.
                let into = alive.node_of[root as usize];
                alive.node_of[own as usize] = into;
                self.merge(&mut alive.groups[into as usize - 1], group);
            }
        }
        alive
    }

    fn merge(&self, into: &mut Group, mut other: Group) {
        let own = |e: Option<u32>| e.map_or(-1.0, |e| self.records[e as usize].island.own_area_mm2);
        if own(other.eldest) > own(into.eldest) {
            into.eldest = other.eldest;
        }
        into.max_area_mm2 = into.max_area_mm2.max(other.max_area_mm2);
        if other.members.len() > into.members.len() {
            std::mem::swap(&mut into.members, &mut other.members);
        }
        into.members.append(&mut other.members);
    }

    fn end(&mut self, group: Group, number: u32, z: f64, joins: bool) {
        for k in group.members {
            let island = &mut self.records[k as usize].island;
            (island.end_layer, island.end_z_mm, island.joins) = (number, z, joins);
            island.max_area_mm2 = group.max_area_mm2;
        }
    }

    fn appear(&mut self, layer: &Layer, polygon: &Polygon, aid: bool) -> Group {
        let area = polygon.area_mm2();
        if self.records.len() >= MAX_ISLANDS {
            self.unlisted += 1;
            return Group { max_area_mm2: area, ..Group::default() };
        }
        let (number, z_mm) = (layer.number, layer.plane_mm());
        let island = Island {
            layer: number,
            z_mm,
            end_layer: number,
            end_z_mm: z_mm,
            joins: false,
            area_mm2: area,
            max_area_mm2: area,
            own_area_mm2: area,
            centroid_mm: polygon.centroid_mm(),
            bbox_mm: polygon.bounds().mm(),
        };
        self.records.push(Record { island, aid });
        let index = self.records.len() as u32 - 1;
        Group { members: vec![index], eldest: Some(index), max_area_mm2: area }
    }

    /// After the last layer: all islands, those smaller than `min_area_mm2` apart.
    #[must_use]
    pub fn finish(mut self, min_area_mm2: f64) -> Found {
        let (last, last_z) = self.last;
        for group in std::mem::take(&mut self.groups) {
            self.end(group, last, last_z, false);
        }
        let mut found = Found { unlisted: self.unlisted, ..Found::default() };
        for Record { island, aid } in self.records {
            if aid {
                found.floating_aid.push(island);
            } else if island.own_area_mm2 < min_area_mm2 {
                found.small.push(island);
            } else {
                found.islands.push(island);
            }
        }
        for list in [&mut found.islands, &mut found.small, &mut found.floating_aid] {
            list.sort_by(|a, b| {
                let place = |i: &Island| (i.bbox_mm[0][0], i.bbox_mm[0][1]);
                let (p, q) = (place(a), place(b));
                a.layer.cmp(&b.layer).then(p.0.total_cmp(&q.0)).then(p.1.total_cmp(&q.1))
            });
        }
        found
    }
}

/// Groups that go on into a layer.
struct Alive {
    groups: Vec<Group>,
    /// For each node of the layer below its node now.
    node_of: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use super::super::links::links;
    use super::super::testing::{layer, region};
    use super::*;
    use crate::layers::shape::Region;

    fn found(layers: Vec<Region>) -> (Found, Vec<Standings>) {
        let (mut islands, mut below) = (Islands::new(), Layer::default());
        let mut standings = Vec::new();
        for (number, part) in layers.into_iter().enumerate() {
            let layer = layer(number as u32, part);
            standings.push(islands.push(&layer, &links(&below, &layer)));
            below = layer;
        }
        (islands.finish(0.0), standings)
    }

    /// Layers of rectangles; expected are (appears, ends, joins) of the islands, in order.
    fn check(layers: &[&[[f64; 4]]], expect: &[(u32, u32, bool)]) {
        let found = found(layers.iter().map(|r| region(r, &[])).collect()).0;
        let got: Vec<_> = found.islands.iter().map(|i| (i.layer, i.end_layer, i.joins)).collect();
        assert_eq!(got, expect, "{layers:?}");
    }

    const POST: [f64; 4] = [0.0, 0.0, 2.0, 2.0];
    const A: [f64; 4] = [3.0, 0.0, 4.0, 2.0];
    const B: [f64; 4] = [5.0, 0.0, 6.0, 2.0];
    const ROOF: [f64; 4] = [0.0, 0.0, 6.0, 2.0];

    #[test]
    fn islands_begin_in_the_air_and_end_at_a_body() {
        check(&[&[POST], &[POST]], &[]);
        check(&[&[POST, A], &[POST, A], &[ROOF]], &[]);
        check(&[&[POST], &[POST, A], &[POST, A], &[ROOF]], &[(1, 3, true)]);
        check(&[&[POST], &[POST, A], &[POST]], &[(1, 1, false)]);
        check(&[&[POST], &[POST, A], &[POST, A]], &[(1, 2, false)]);
        check(&[&[POST], &[POST, A], &[POST], &[POST, A], &[ROOF]], &[(1, 1, false), (3, 4, true)]);
        check(&[&[], &[POST], &[POST]], &[(1, 2, false)]);
        check(&[], &[]);
    }

    #[test]
    fn islands_that_meet_go_on_as_one() {
        let both = [3.0, 0.0, 6.0, 2.0];
        check(
            &[&[POST], &[POST, A], &[POST, A, B], &[POST, both], &[POST, both], &[ROOF]],
            &[(1, 5, true), (2, 5, true)],
        );
        check(&[&[POST], &[POST, A, B], &[POST, both], &[POST]], &[(1, 2, false), (1, 2, false)]);
    }

    #[test]
    fn a_branch_is_held_through_its_group() {
        let both = [3.0, 0.0, 6.0, 2.0];
        let near = [0.0, 0.0, 4.0, 2.0];
        // Two branches of one group, of which one meets the post: the other stands too.
        check(&[&[POST], &[POST, both], &[POST, A, B], &[near, B], &[near, B]], &[(1, 3, true)]);
        let parts = [&[POST][..], &[POST, both], &[POST, A, B], &[near, B]];
        let standings = found(parts.iter().map(|r| region(r, &[])).collect()).1;
        assert!(standings[3].part.iter().all(|s| *s == Standing::Body), "{standings:?}");
        assert_eq!(standings[1].part.iter().filter(|s| **s == Standing::Appears).count(), 1);
        assert_eq!(standings[2].part.iter().filter(|s| **s == Standing::Island).count(), 2);
    }

    #[test]
    fn touching_below_holds_nothing() {
        let edge = [2.0, 0.0, 3.0, 2.0];
        let vertex = [2.0, 2.0, 3.0, 3.0];
        check(&[&[POST], &[edge]], &[(1, 1, false)]);
        check(&[&[POST], &[vertex]], &[(1, 1, false)]);
        check(&[&[POST], &[[1.9999, 1.9999, 3.0, 3.0]]], &[]);
    }

    #[test]
    fn an_island_in_a_hole_is_found() {
        let ring = || region(&[[0.0, 0.0, 9.0, 9.0]], &[[1.0, 1.0, 8.0, 8.0]]);
        let with = crate::layers::polygon::union(&ring(), &region(&[[3.0, 3.0, 4.0, 4.0]], &[]));
        let roof = region(&[[0.0, 0.0, 9.0, 9.0]], &[]);
        let found = found(vec![ring(), with.clone(), with, roof]).0;
        assert_eq!(found.islands.len(), 1);
        let island = &found.islands[0];
        assert_eq!((island.layer, island.end_layer, island.joins), (1, 3, true));
        assert!((island.area_mm2 - 1.0).abs() < 1e-9 && (island.z_mm - 0.15).abs() < 1e-9);
        assert_eq!(island.bbox_mm, [[3.0, 3.0], [4.0, 4.0]]);
        assert!((island.centroid_mm[0] - 3.5).abs() < 1e-9);
    }

    #[test]
    fn a_tip_that_grows_is_not_small_but_a_speck_that_joins_it_is() {
        let (tip, wide, speck) = ([3.0, 0.0, 3.01, 0.01], [3.0, 0.0, 5.0, 2.0], [5.5, 0.0, 5.51, 0.01]);
        let parts = [&[POST][..], &[POST, tip], &[POST, wide, speck], &[POST, [3.0, 0.0, 6.0, 2.0]], &[ROOF]];
        let (mut islands, mut below) = (Islands::new(), Layer::default());
        for (number, part) in parts.iter().enumerate() {
            let layer = layer(number as u32, region(part, &[]));
            islands.push(&layer, &links(&below, &layer));
            below = layer;
        }
        let found = islands.finish(0.1);
        assert_eq!((found.islands.len(), found.small.len()), (1, 1));
        assert_eq!((found.islands[0].layer, found.small[0].layer), (1, 2));
        assert!((found.islands[0].max_area_mm2 - 6.0).abs() < 1e-9);
        assert_eq!(found.islands[0].max_area_mm2, found.small[0].max_area_mm2);
    }

    #[test]
    fn supports_hold_and_floating_supports_are_told_apart() {
        let mut layers: Vec<Layer> = [&[POST][..], &[POST, A], &[POST, A, B]]
            .iter()
            .zip(0..)
            .map(|(r, n)| layer(n, region(r, &[])))
            .collect();
        for layer in &mut layers {
            layer.aid = region(&[A], &[]);
        }
        layers[2].aid = region(&[A, [8.0, 0.0, 9.0, 1.0]], &[]);
        let (mut islands, mut below) = (Islands::new(), Layer::default());
        for layer in layers {
            islands.push(&layer, &links(&below, &layer));
            below = layer;
        }
        let found = islands.finish(0.0);
        assert_eq!(found.islands.iter().map(|i| i.layer).collect::<Vec<_>>(), [2]);
        assert_eq!(found.floating_aid.iter().map(|i| i.bbox_mm[0][0]).collect::<Vec<_>>(), [8.0]);
    }
}
