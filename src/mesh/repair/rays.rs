//! Rays upwards through a mesh.
//!
//! Takes a draft, gives the triangles above a point. Triangles are sorted into
//! columns of a grid in x and y. A ray that meets an edge or a vertex counts one of
//! the triangles there, the same whichever is asked: nothing is crossed twice.
use super::draft::Draft;
use crate::mesh::bounds;

/// Triangles that lie over more columns than this stand in a list for all.
const COLUMNS_EACH: usize = 64;

/// Most columns along a side.
const SIDE_MAX: f64 = 512.0;

/// Triangles looked at for all rays together: 1 s or so.
const LOOKS_MAX: usize = 200_000_000;

/// Triangles by column.
pub(super) struct Columns {
    low: [f64; 2],
    /// Columns per millimetre in x and y.
    scale: [f64; 2],
    side: usize,
    /// Where in `triangles` each column begins.
    starts: Vec<u32>,
    triangles: Vec<u32>,
    large: Vec<u32>,
    looks: usize,
}

impl Columns {
    pub(super) fn new(draft: &Draft) -> Columns {
        let [low, high] = bounds(&draft.vertices);
        let side = ((draft.triangles.len() as f64 / 2.0).sqrt()).clamp(1.0, SIDE_MAX) as usize;
        let scale = [0, 1].map(|k| side as f64 / (high[k] - low[k]).max(f64::MIN_POSITIVE));
        let mut columns = Columns {
            low: [low[0], low[1]],
            scale,
            side,
            starts: vec![0; side * side + 1],
            triangles: Vec::new(),
            large: Vec::new(),
            looks: LOOKS_MAX,
        };
        let mut entries = Vec::new();
        for t in 0..draft.triangles.len() {
            let corners = draft.corners(t).map(|c| columns.column(c));
            let from = [0, 1].map(|k| corners.iter().map(|c| c[k]).min().unwrap_or(0));
            let to = [0, 1].map(|k| corners.iter().map(|c| c[k]).max().unwrap_or(0));
            if (to[0] - from[0] + 1) * (to[1] - from[1] + 1) > COLUMNS_EACH {
                columns.large.push(t as u32);
                continue;
            }
            for y in from[1]..=to[1] {
                entries.extend((from[0]..=to[0]).map(|x| ((y * side + x) as u32, t as u32)));
            }
        }
        entries.sort_unstable();
        for e in &entries {
            columns.starts[e.0 as usize + 1] += 1;
        }
        for c in 1..columns.starts.len() {
            columns.starts[c] += columns.starts[c - 1];
        }
        columns.triangles = entries.into_iter().map(|e| e.1).collect();
        columns
    }

    fn column(&self, place: [f64; 3]) -> [usize; 2] {
        [0, 1].map(|k| (((place[k] - self.low[k]) * self.scale[k]).max(0.0) as usize).min(self.side - 1))
    }

    /// The triangles above a place, each with 1 where it faces up and −1 where it
    /// faces down; `None` when all looks are used up.
    pub(super) fn above(&mut self, draft: &Draft, place: [f64; 3]) -> Option<Vec<(u32, i32)>> {
        let [x, y] = self.column(place);
        let column = y * self.side + x;
        let here = &self.triangles[self.starts[column] as usize..self.starts[column + 1] as usize];
        self.looks = self.looks.checked_sub(here.len() + self.large.len() + 1)?;
        let crossed = |&t: &u32| crossing(draft.corners(t as usize), place).map(|sign| (t, sign));
        Some(here.iter().chain(&self.large).filter_map(crossed).collect())
    }
}

/// 1 where the ray upwards from a place leaves through a triangle that faces up, −1 through one that faces down.
fn crossing([a, b, c]: [[f64; 3]; 3], place: [f64; 3]) -> Option<i32> {
    if a[2] <= place[2] && b[2] <= place[2] && c[2] <= place[2] {
        return None;
    }
    let inside = passes(a, b, place) ^ passes(b, c, place) ^ passes(c, a, place);
    if !inside {
        return None;
    }
    let [ab, ac, ap] = [[a, b], [a, c], [a, place]].map(|[p, q]| [q[0] - p[0], q[1] - p[1], q[2] - p[2]]);
    let up = ab[0] * ac[1] - ab[1] * ac[0];
    // Height of the triangle's plane over the place, times `up`.
    let height =
        -(ap[0] * (ab[1] * ac[2] - ab[2] * ac[1]) + ap[1] * (ab[2] * ac[0] - ab[0] * ac[2])) - ap[2] * up;
    match (up > 0.0, height > 0.0) {
        (true, true) => Some(1),
        (false, false) if up < 0.0 && height < 0.0 => Some(-1),
        _ => None,
    }
}

/// Whether a half-line to the right of a place crosses an edge, seen from above: the
/// same for both directions of the edge, to the last bit.
fn passes(a: [f64; 3], b: [f64; 3], place: [f64; 3]) -> bool {
    if (a[1] > place[1]) == (b[1] > place[1]) {
        return false;
    }
    let (low, high) = if a[1] < b[1] { (a, b) } else { (b, a) };
    let side = (high[0] - low[0]) * (place[1] - low[1]) - (high[1] - low[1]) * (place[0] - low[0]);
    side > 0.0
}
