//! Edges of three and more triangles: which belong together.
//!
//! Takes a draft with crowded edges, pairs their half-edges so that each pair
//! bounds a wedge that is solid: bodies that touch along an edge stay apart. What
//! finds no partner stays open.
use super::draft::Draft;
use crate::mesh::twins::{CROWDED, apex};
use crate::mesh::vector::{cross, dot, length, sub};

/// Pairs the half-edges of all crowded edges.
pub(super) fn pair(draft: &mut Draft) {
    let mut pairs = Vec::new();
    let mut sorted = Vec::new();
    let mut waiting = Vec::new();
    for crowd in draft.pairing.crowds().filter(|c| c.len() > 2) {
        sort_around(draft, crowd, &mut sorted);
        // Turning counter-clockwise about the edge one enters a solid by a backward
        // half-edge's triangle, and leaves it by a forward one's. Twice round: a wedge
        // may contain the direction where counting begins.
        waiting.clear();
        for round in 0..2 {
            for item in &mut sorted {
                match (item.forward, item.paired, round) {
                    (false, false, 0) => waiting.push(item.half_edge),
                    (true, false, _) => {
                        if let Some(entered) = waiting.pop() {
                            item.paired = true;
                            pairs.push((entered, item.half_edge));
                        }
                    }
                    _ => (),
                }
            }
        }
    }
    for (h, other) in pairs {
        debug_assert_eq!(draft.pairing.twins[h as usize], CROWDED);
        draft.pairing.join(h, other);
    }
}

/// A half-edge of a crowd.
#[derive(Clone, Copy)]
struct Around {
    /// Of its triangle about the edge, from −π to π.
    angle: f64,
    /// Whether it runs from the vertex of the lower number.
    forward: bool,
    half_edge: u32,
    paired: bool,
}

/// The half-edges counter-clockwise about their edge, seen from its end; at the same angle those that leave a
/// solid first, since no wedge without width is solid.
fn sort_around(draft: &Draft, crowd: &[u32], sorted: &mut Vec<Around>) {
    let mut edge = draft.ends(crowd[0]);
    edge.sort_unstable();
    let [from, to] = edge.map(|v| draft.vertices[v as usize]);
    let along = sub(to, from);
    let scale = length(along).max(f64::MIN_POSITIVE);
    let axis = along.map(|c| c / scale);
    // The coordinate axis that the edge is farthest from gives a direction across it.
    let flattest = (0..3).min_by(|&a, &b| axis[a].abs().total_cmp(&axis[b].abs())).unwrap_or(0);
    let mut unit = [0.0; 3];
    unit[flattest] = 1.0;
    let right = cross(axis, unit);
    let up = cross(axis, right);
    sorted.clear();
    sorted.extend(crowd.iter().map(|&h| {
        let out = sub(draft.vertices[apex(&draft.triangles, h) as usize], from);
        let angle = dot(out, up).atan2(dot(out, right));
        Around { angle, forward: draft.ends(h)[0] == edge[0], half_edge: h, paired: false }
    }));
    sorted.sort_by(|a, b| {
        a.angle.total_cmp(&b.angle).then(b.forward.cmp(&a.forward)).then(a.half_edge.cmp(&b.half_edge))
    });
}
