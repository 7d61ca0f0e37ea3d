//! Supports as a mesh: each branch a closed body of its own.
//!
//! A branch becomes a cone with round ends where it meets others, and flat ends where it
//! touches the part or stands. Bodies overlap at joints, as slicers expect of supports: each
//! is closed, manifold and faces outward, and no two share an edge.
use crate::mesh::stl::Triangle;
use crate::mesh::vector::{cross, length, sub};
use crate::support::tree::{Forest, Kind};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Corners of a ring.
const CORNERS: usize = 16;

/// Parts of a step by which one body is turned against the next: never the same again.
const GOLDEN: f64 = 0.618_033_988_749_895;

/// Rings of a round end between the branch's own and the pole.
const RINGS: usize = 3;

/// The triangles of a forest, mm, counter-clockwise from outside.
#[must_use]
pub fn triangles(forest: &Forest) -> Vec<Triangle> {
    let mut found = Vec::new();
    for (k, node) in forest.nodes.iter().enumerate() {
        let Some(down) = forest.nodes.get(node.down as usize) else { continue };
        let round = [node, down].map(|n| n.kind == Kind::Joint);
        let ground_mm = forest.ground_mm(down);
        // Two branches may run down the same way: their corners must not be the same.
        let turned = (k as f64 * GOLDEN).fract();
        body(
            [node.at_mm, down.at_mm],
            [node.radius_mm, down.radius_mm],
            round,
            [ground_mm, turned],
            &mut found,
        );
    }
    found
}

/// Adds a branch from its upper to its lower end, turned by a part of a step; what would reach
/// below the ground is pressed flat upon it.
fn body(
    ends: [[f64; 3]; 2],
    radii: [f64; 2],
    round: [bool; 2],
    [ground_mm, turned]: [f64; 2],
    found: &mut Vec<Triangle>,
) {
    let along = sub(ends[1], ends[0]);
    let long = length(along);
    if long < 1e-6 {
        return;
    }
    let axis = along.map(|c| c / long);
    let aside = if axis[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let v = unit(cross(axis, aside));
    let w = cross(axis, v);
    // Rings from the top to the bottom: how far along, how wide. Each is turned by a part of
    // a step, so that branches in one line do not share edges.
    let mut rings: Vec<(f64, f64)> = Vec::new();
    let pole = |end: usize| if round[end] { radii[end] } else { 0.0 };
    let caps = |end: usize| {
        (1..=RINGS).map(move |k| FRAC_PI_2 * k as f64 / (RINGS + 1) as f64).map(move |a| (end, a))
    };
    if round[0] {
        rings.extend(caps(0).rev().map(|(end, a)| (-radii[end] * a.sin(), radii[end] * a.cos())));
    }
    rings.extend([(0.0, radii[0]), (long, radii[1])]);
    if round[1] {
        rings.extend(caps(1).map(|(end, a)| (long + radii[end] * a.sin(), radii[end] * a.cos())));
    }
    let point = |ring: usize, corner: usize| {
        let (at, radius) = rings[ring];
        let turn = TAU * (corner as f64 + 0.31 * ring as f64 + turned) / CORNERS as f64;
        let (c, s) = (turn.cos() * radius, turn.sin() * radius);
        [0, 1, 2].map(|k| ends[0][k] + axis[k] * at + v[k] * c + w[k] * s)
    };
    let centre = |at: f64| [0, 1, 2].map(|k| ends[0][k] + axis[k] * at);
    let above = |p: [f64; 3]| [p[0], p[1], p[2].max(ground_mm)].map(|c| c as f32);
    let mut put = |corners: [[f64; 3]; 3]| found.push(corners.map(above));
    let last = rings.len() - 1;
    for k in 0..CORNERS {
        let next = (k + 1) % CORNERS;
        put([centre(-pole(0)), point(0, next), point(0, k)]);
        put([centre(long + pole(1)), point(last, k), point(last, next)]);
        for ring in 0..last {
            put([point(ring, k), point(ring, next), point(ring + 1, k)]);
            put([point(ring, next), point(ring + 1, next), point(ring + 1, k)]);
        }
    }
}

fn unit(a: [f64; 3]) -> [f64; 3] {
    let long = length(a);
    a.map(|c| c / long)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh;
    use crate::support::tree::GROUND;
    use std::io::Cursor;

    /// A trunk with a bend, a branch upon it and two tips, one of them in line with it.
    fn forest() -> Forest {
        let mut forest = Forest::default();
        let foot = forest.push([0.0, 0.0, 0.0], Kind::Plate, GROUND, 1.5);
        let low = forest.push([0.0, 0.0, 0.6], Kind::Joint, foot, 0.5);
        let high = forest.push([0.0, 0.0, 8.0], Kind::Joint, low, 0.5);
        let side = forest.push([3.0, 1.0, 12.0], Kind::Joint, high, 0.4);
        let up = forest.push([0.0, 0.0, 12.0], Kind::Joint, high, 0.4);
        forest.push([3.0, 1.0, 13.5], Kind::Tip, side, 0.2);
        forest.push([0.0, 0.0, 13.5], Kind::Tip, up, 0.2);
        forest
    }

    #[test]
    fn a_forest_is_closed_bodies_that_face_outward() {
        let forest = forest();
        let mut file = Vec::new();
        mesh::stl::write(&mut file, &triangles(&forest)).expect("written");
        let (mesh, report) = mesh::read(&mut Cursor::new(file)).expect("a mesh");
        assert!(report.mended.is_closed(), "{report:?}");
        assert_eq!(report.mended.done(), Vec::<String>::new());
        // Cones of 16 corners, and halves of balls at the joints.
        let cones = forest.volume_mm3();
        assert!(mesh.volume_mm3() > 0.95 * cones && mesh.volume_mm3() < 1.3 * cones);
        let [low, high] = mesh.bounds_mm();
        assert!(low[2].abs() < 1e-6 && (high[2] - 13.5).abs() < 1e-5, "{low:?} {high:?}");
    }

    #[test]
    fn branches_that_run_the_same_way_are_bodies_of_their_own() {
        let mut forest = Forest::default();
        for aside in [0.0, 0.3] {
            let foot = forest.push([0.0, 0.0, 0.0], Kind::Plate, GROUND, 1.5);
            let low = forest.push([0.0, 0.0, 0.6], Kind::Joint, foot, 0.5);
            let top = forest.push([0.0, 0.0, 8.0], Kind::Joint, low, 0.5);
            forest.push([aside, 0.0, 9.5], Kind::Tip, top, 0.2);
        }
        let mut file = Vec::new();
        mesh::stl::write(&mut file, &triangles(&forest)).expect("written");
        let (mesh, report) = mesh::read(&mut Cursor::new(file)).expect("a mesh");
        assert!(report.mended.is_closed(), "{report:?}");
        assert_eq!(report.mended.done(), Vec::<String>::new());
        assert_eq!(mesh.triangles.len(), triangles(&forest).len());
    }

    #[test]
    fn a_branch_of_no_length_is_nothing() {
        let mut forest = Forest::default();
        let a = forest.push([1.0, 1.0, 5.0], Kind::Joint, GROUND, 0.4);
        forest.push([1.0, 1.0, 5.0], Kind::Joint, a, 0.4);
        assert!(triangles(&forest).is_empty());
    }
}
