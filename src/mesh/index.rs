//! Corners that lie at the same place, to the last bit, made one vertex.
//!
//! Takes triangles, gives vertices in the order in which they first come and
//! triangles of their numbers. Knows no tolerance: near is not the same.
use super::stl::Sink;
use std::hash::{BuildHasher, RandomState};

/// An empty slot of the table.
const FREE: u32 = u32::MAX;

/// Vertices found by place.
///
/// Open addressing with linear probing; a slot holds a vertex's number, the
/// places stand in `vertices` alone. The hash is multilinear with keys of the
/// run (Carter and Wegman 1979; Lemire and Kaser 2014): universal, so no file can
/// be made that collides, and the numbers do not depend on the keys.
pub(super) struct Index {
    /// Places, mm, none twice; no −0.
    vertices: Vec<[f32; 3]>,
    /// Triangles of three different vertices.
    triangles: Vec<[u32; 3]>,
    /// Triangles left out because two corners are one vertex.
    degenerate: u64,
    slots: Vec<u32>,
    /// The hash is shifted right by this to make a slot.
    shift: u32,
    keys: [u64; 4],
}

impl Index {
    pub(super) fn new() -> Index {
        let random = RandomState::new();
        let keys = [0_u64, 1, 2, 3].map(|k| random.hash_one(k));
        let (vertices, triangles) = (Vec::new(), Vec::new());
        Index { vertices, triangles, degenerate: 0, slots: vec![FREE; 16], shift: 60, keys }
    }

    /// Vertices, triangles, and how many were left out.
    pub(super) fn into_parts(self) -> (Vec<[f64; 3]>, Vec<[u32; 3]>, u64) {
        (self.vertices.iter().map(|v| v.map(f64::from)).collect(), self.triangles, self.degenerate)
    }

    fn slot(&self, bits: [u32; 3]) -> usize {
        let [x, y, z] = bits.map(u64::from);
        let [k, l, m, n] = self.keys;
        let hash =
            k.wrapping_mul(x).wrapping_add(l.wrapping_mul(y)).wrapping_add(m.wrapping_mul(z)).wrapping_add(n);
        (hash >> self.shift) as usize
    }

    /// The number of the vertex at a place.
    fn vertex(&mut self, place: [f32; 3]) -> u32 {
        // −0 + 0 is 0, everything else stays as it is.
        let place = place.map(|c| c + 0.0);
        let mask = self.slots.len() - 1;
        let mut slot = self.slot(place.map(f32::to_bits));
        loop {
            let found = self.slots[slot];
            if found == FREE {
                break;
            }
            if self.vertices[found as usize] == place {
                return found;
            }
            slot = (slot + 1) & mask;
        }
        let number = self.vertices.len() as u32;
        self.slots[slot] = number;
        self.vertices.push(place);
        if self.vertices.len() * 2 > self.slots.len() {
            self.resize(self.slots.len() * 2);
        }
        number
    }

    /// Makes the table of this many slots, a power of two.
    fn resize(&mut self, slots: usize) {
        self.slots.clear();
        self.slots.resize(slots, FREE);
        self.shift = 64 - slots.trailing_zeros();
        for number in 0..self.vertices.len() {
            let mut slot = self.slot(self.vertices[number].map(f32::to_bits));
            while self.slots[slot] != FREE {
                slot = (slot + 1) & (slots - 1);
            }
            self.slots[slot] = number as u32;
        }
    }
}

impl Sink for Index {
    /// Room for a closed mesh, which has half as many vertices as triangles.
    fn expect(&mut self, triangles: usize) {
        self.triangles.reserve(triangles);
        self.vertices.reserve(triangles / 2 + 8);
        self.resize((triangles + 16).next_power_of_two());
    }

    fn triangle(&mut self, corners: [[f32; 3]; 3]) {
        let [a, b, c] = corners.map(|place| self.vertex(place));
        if a == b || b == c || c == a {
            self.degenerate += 1;
        } else {
            self.triangles.push([a, b, c]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_at_the_same_place_are_one_vertex() {
        let next = f32::from_bits(1.0_f32.to_bits() + 1);
        let mut index = Index::new();
        index.expect(2);
        index.triangle([[0.0, -0.0, 0.0], [1.0, 0.0, 0.0], [-0.0, 1.0, 0.0]]);
        index.triangle([[-0.0, 0.0, -0.0], [next, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        index.triangle([[0.0; 3], [-0.0; 3], [5.0; 3]]);
        let (vertices, triangles, degenerate) = index.into_parts();
        assert_eq!(triangles, [[0, 1, 2], [0, 3, 2]]);
        let places = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f64::from(next), 0.0, 0.0], [5.0; 3]];
        assert_eq!((vertices, degenerate), (places.to_vec(), 1));
    }

    #[test]
    fn the_table_grows_and_numbers_come_in_order() {
        // Nothing is expected, as of a file whose length says nothing.
        let mut index = Index::new();
        let place = |k: u32| [k as f32, (k * k % 7) as f32, 1.0 / (k + 1) as f32];
        for round in 0..2 {
            for k in (0..30_000).step_by(3) {
                index.triangle([place(k), place(k + 1), place(k + 2)]);
                assert_eq!(index.triangles[(round * 10_000 + k / 3) as usize], [k, k + 1, k + 2]);
            }
        }
        assert_eq!(index.vertices.len(), 30_000);
    }
}
