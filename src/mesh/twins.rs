//! Which half-edge runs along which other: neighbours of triangles.
//!
//! Takes triangles of vertices, gives the twin of each half-edge where an edge has
//! two that run in opposite directions, and the edges that have anything else but
//! one. Linear in triangles: half-edges are sorted into a bucket a vertex, and
//! buckets are small or sorted. Knows no place of a vertex.
use super::OPEN;

/// The half-edge is one of a crowd: see [`Pairing::crowds`].
pub(super) const CROWDED: u32 = OPEN - 1;

/// The pairs of half-edges, and what cannot be paired so simply.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Pairing {
    /// As in [`super::Mesh::twins`], or [`CROWDED`].
    pub(super) twins: Vec<u32>,
    /// Edges of one half-edge.
    pub(super) open: u64,
    /// Half-edges of the crowds, crowd by crowd.
    crowded: Vec<u32>,
    /// Where in `crowded` each crowd ends.
    ends: Vec<u32>,
}

impl Pairing {
    /// The half-edges of each edge that has two in the same direction, or three and more.
    pub(super) fn crowds(&self) -> impl Iterator<Item = &[u32]> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(from, &to)| &self.crowded[from as usize..to as usize])
    }

    /// Whether any edge has a crowd.
    pub(super) fn has_crowds(&self) -> bool {
        !self.ends.is_empty()
    }

    /// Half-edges that are alone on their edge.
    pub(super) fn rim(&self) -> Vec<u32> {
        (0..self.twins.len() as u32).filter(|&h| self.twins[h as usize] == OPEN).collect()
    }

    /// Makes two half-edges neighbours.
    pub(super) fn join(&mut self, h: u32, other: u32) {
        self.twins[h as usize] = other;
        self.twins[other as usize] = h;
    }

    /// What an edge with these half-edges, as (far vertex, half-edge), becomes.
    fn edge(&mut self, triangles: &[[u32; 3]], edge: &[(u32, u32)]) {
        match *edge {
            [_] => self.open += 1,
            [(_, h), (_, other)] if ends(triangles, h)[0] != ends(triangles, other)[0] => self.join(h, other),
            _ => {
                for &(_, h) in edge {
                    self.twins[h as usize] = CROWDED;
                    self.crowded.push(h);
                }
                self.ends.push(self.crowded.len() as u32);
            }
        }
    }
}

/// The half-edge that follows within the triangle.
pub(super) fn next(h: u32) -> u32 {
    if h % 3 == 2 { h - 2 } else { h + 1 }
}

/// Where a half-edge begins and ends.
pub(super) fn ends(triangles: &[[u32; 3]], h: u32) -> [u32; 2] {
    let corners = triangles[(h / 3) as usize];
    let k = (h % 3) as usize;
    [corners[k], corners[(k + 1) % 3]]
}

/// The corner of its triangle that a half-edge does not touch.
pub(super) fn apex(triangles: &[[u32; 3]], h: u32) -> u32 {
    triangles[(h / 3) as usize][((h + 2) % 3) as usize]
}

/// Pairs the half-edges of triangles whose corners are three different of `vertices` vertices.
pub(super) fn pair(triangles: &[[u32; 3]], vertices: usize) -> Pairing {
    // A bucket holds the edges whose lower vertex is the bucket's: (other vertex, half-edge).
    let mut starts = vec![0_u32; vertices + 2];
    for t in triangles {
        for k in 0..3 {
            starts[t[k].min(t[(k + 1) % 3]) as usize + 2] += 1;
        }
    }
    for v in 2..starts.len() {
        starts[v] += starts[v - 1];
    }
    let mut edges = vec![(0_u32, 0_u32); triangles.len() * 3];
    for (t, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            let at = &mut starts[a.min(b) as usize + 1];
            edges[*at as usize] = (a.max(b), (t * 3 + k) as u32);
            *at += 1;
        }
    }
    let mut pairing = Pairing { twins: vec![OPEN; triangles.len() * 3], ..Pairing::default() };
    for v in 0..vertices {
        let bucket = &mut edges[starts[v] as usize..starts[v + 1] as usize];
        bucket.sort_unstable();
        for edge in bucket.chunk_by(|a, b| a.0 == b.0) {
            pairing.edge(triangles, edge);
        }
    }
    pairing
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::HashMap;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Against a table of all edges.
        #[test]
        fn half_edges_are_paired_as_a_table_says(
            corners in prop::collection::vec([0_u32..9, 0..9, 0..9], 0..60),
        ) {
            let differ = |t: &[u32; 3]| t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
            let triangles: Vec<[u32; 3]> = corners.into_iter().filter(differ).collect();
            let mut table: HashMap<[u32; 2], Vec<u32>> = HashMap::new();
            for h in 0..triangles.len() as u32 * 3 {
                let mut edge = ends(&triangles, h);
                edge.sort_unstable();
                table.entry(edge).or_default().push(h);
            }
            let pairing = pair(&triangles, 9);
            for edge in table.values() {
                let expect = match edge[..] {
                    [_] => vec![OPEN],
                    [h, other] if ends(&triangles, h)[0] != ends(&triangles, other)[0] => vec![other, h],
                    _ => vec![CROWDED; edge.len()],
                };
                let found: Vec<u32> = edge.iter().map(|&h| pairing.twins[h as usize]).collect();
                prop_assert_eq!(found, expect);
            }
            let mut crowds: Vec<Vec<u32>> = pairing.crowds().map(<[u32]>::to_vec).collect();
            crowds.sort();
            let mut expect: Vec<Vec<u32>> =
                table.into_values().filter(|e| pairing.twins[e[0] as usize] == CROWDED).collect();
            expect.sort();
            prop_assert_eq!(crowds, expect);
            prop_assert_eq!(pairing.open, pairing.rim().len() as u64);
        }
    }
}
