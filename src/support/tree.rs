//! Supports as a forest: tips above, branches that meet on their way down, feet below.
//!
//! Each node knows the node that it stands on; a branch is a node with what it stands on,
//! a frustum from the one's radius to the other's. Knows no part and no file.
use super::rules::Rules;
use crate::mesh::vector::distance;
use std::f64::consts::PI;

/// No node below: it stands on the plate or on the part.
pub const GROUND: u32 = u32::MAX;

/// What a node is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Touches what it holds.
    Tip,
    /// A bend, or where branches meet.
    Joint,
    /// Stands on the plate.
    Plate,
    /// Stands on the part.
    Model,
}

/// A place through which a branch runs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// Where, mm.
    pub at_mm: [f64; 3],
    /// What it is.
    pub kind: Kind,
    /// The node that it stands on, or [`GROUND`].
    pub down: u32,
    /// Radius there, mm.
    pub radius_mm: f64,
    /// Tips that it carries.
    pub load: u32,
    /// Longest way up to a tip that it carries, mm.
    pub length_mm: f64,
    /// It may not be moved or thickened: the end of a tip's head, or a foot.
    pub fixed: bool,
}

/// A forest of supports.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Forest {
    /// Its nodes; indices are what [`Node::down`] holds.
    pub nodes: Vec<Node>,
}

/// A branch with its two ends, the upper first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Branch {
    /// Ends, mm.
    pub ends_mm: [[f64; 3]; 2],
    /// Radii there, mm.
    pub radii_mm: [f64; 2],
}

/// What a forest amounts to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tally {
    /// Places that are held.
    pub tips: u32,
    /// Where branches meet.
    pub junctions: u32,
    /// Feet on the plate.
    pub trunks_on_plate: u32,
    /// Feet on the part.
    pub landings_on_model: u32,
    /// All branches, mm.
    pub length_mm: f64,
}

/// Whether a branch may run from `a` down to `b`, `slope` being mm sideways a mm down.
#[must_use]
pub fn leans_within(a: [f64; 3], b: [f64; 3], slope: f64) -> bool {
    (a[0] - b[0]).hypot(a[1] - b[1]) <= slope * (a[2] - b[2]) + 1e-6
}

/// Volume of a frustum, mm³.
#[must_use]
pub fn frustum_mm3(length_mm: f64, radii_mm: [f64; 2]) -> f64 {
    let [a, b] = radii_mm;
    PI * length_mm * (a * a + a * b + b * b) / 3.0
}

impl Branch {
    /// Its volume, mm³, joints counted as often as branches meet.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        frustum_mm3(distance(self.ends_mm[0], self.ends_mm[1]), self.radii_mm)
    }
}

impl Forest {
    /// Adds a node and gives its index.
    pub fn push(&mut self, at_mm: [f64; 3], kind: Kind, down: u32, radius_mm: f64) -> u32 {
        let fixed = kind != Kind::Joint;
        self.nodes.push(Node { at_mm, kind, down, radius_mm, load: 0, length_mm: 0.0, fixed });
        self.nodes.len() as u32 - 1
    }

    /// All branches.
    pub fn branches(&self) -> impl Iterator<Item = Branch> + '_ {
        self.nodes.iter().filter_map(|n| {
            let down = self.nodes.get(n.down as usize)?;
            Some(Branch { ends_mm: [n.at_mm, down.at_mm], radii_mm: [n.radius_mm, down.radius_mm] })
        })
    }

    /// How deep the round end of a node may reach, mm: not below what it stands on next.
    #[must_use]
    pub fn ground_mm(&self, node: &Node) -> f64 {
        let ground = |n: &&Node| matches!(n.kind, Kind::Plate | Kind::Model);
        let own = Some(node).filter(ground);
        own.or(self.nodes.get(node.down as usize).filter(ground)).map_or(0.0, |n| n.at_mm[2])
    }

    /// What each node carries directly.
    #[must_use]
    pub fn children(&self) -> Vec<Vec<u32>> {
        let mut children = vec![Vec::new(); self.nodes.len()];
        for (k, node) in self.nodes.iter().enumerate() {
            if let Some(own) = children.get_mut(node.down as usize) {
                own.push(k as u32);
            }
        }
        children
    }

    /// Indices so that each node comes before what it stands on.
    #[must_use]
    pub fn downward(&self) -> Vec<u32> {
        let mut waits: Vec<u32> = vec![0; self.nodes.len()];
        for node in &self.nodes {
            if let Some(wait) = waits.get_mut(node.down as usize) {
                *wait += 1;
            }
        }
        let mut order: Vec<u32> = (0..self.nodes.len() as u32).filter(|k| waits[*k as usize] == 0).collect();
        let mut at = 0;
        while let Some(k) = order.get(at).copied() {
            at += 1;
            let down = self.nodes[k as usize].down;
            if let Some(wait) = waits.get_mut(down as usize) {
                *wait -= 1;
                if *wait == 0 {
                    order.push(down);
                }
            }
        }
        order
    }

    /// Sets loads, lengths and radii from the tips down: as thick as the rules ask for, but
    /// no thicker than `room` (mm around the way between two places) allows above and below.
    pub fn thicken(&mut self, rules: &Rules, room: impl Fn([f64; 3], [f64; 3]) -> f64) {
        for node in &mut self.nodes {
            (node.load, node.length_mm) = (u32::from(node.kind == Kind::Tip), 0.0);
        }
        // Room around what comes from above.
        let mut spare = vec![f64::INFINITY; self.nodes.len()];
        for k in self.downward() {
            let node = self.nodes[k as usize];
            let down = self.nodes.get(node.down as usize).copied();
            let below = room(node.at_mm, down.map_or(node.at_mm, |d| d.at_mm));
            if !node.fixed {
                let wanted = match down.map(|d| d.kind) {
                    Some(Kind::Plate) => rules.trunk_radius_mm(node.load, node.length_mm),
                    _ => rules.radius_mm(node.load, node.length_mm),
                };
                let least = rules.branch_mm / 2.0;
                self.nodes[k as usize].radius_mm = wanted.min(below).min(spare[k as usize]).max(least);
            }
            let radius_mm = self.nodes[k as usize].radius_mm;
            if let Some(down) = self.nodes.get_mut(node.down as usize) {
                if down.kind == Kind::Plate && node.kind == Kind::Joint {
                    // The foot's cone reaches up to where the trunk begins.
                    let widest = below + rules.clearance_mm / 2.0;
                    down.radius_mm = (rules.foot_mm / 2.0).min(widest).max(radius_mm);
                }
                down.load += node.load;
                let length = node.length_mm + distance(node.at_mm, down.at_mm);
                down.length_mm = down.length_mm.max(length);
                let spare = &mut spare[node.down as usize];
                // A head comes as close as it must.
                *spare = if node.kind == Kind::Tip { *spare } else { spare.min(below) };
            }
        }
    }

    /// Volume of all branches, mm³, joints counted as often as branches meet.
    #[must_use]
    pub fn volume_mm3(&self) -> f64 {
        self.branches().map(|b| b.volume_mm3()).sum()
    }

    /// What it amounts to.
    #[must_use]
    pub fn tally(&self) -> Tally {
        let mut tally = Tally::default();
        for (node, children) in self.nodes.iter().zip(self.children()) {
            match node.kind {
                Kind::Tip => tally.tips += 1,
                Kind::Joint => tally.junctions += u32::from(children.len() > 1),
                Kind::Plate => tally.trunks_on_plate += 1,
                Kind::Model => tally.landings_on_model += 1,
            }
        }
        tally.length_mm = self.branches().map(|b| distance(b.ends_mm[0], b.ends_mm[1])).sum();
        tally
    }
}
