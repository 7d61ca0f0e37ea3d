//! The contours in which one plane cuts a mesh, by walking from triangle to triangle.
//!
//! Takes the mesh on the grid and the triangles that the plane crosses, gives closed
//! rings and open chains. Knows no other plane, and not what is inside.
//!
//! A crossed triangle has one corner or two below the plane, and so exactly one edge
//! that goes up through it and one that goes down, counter-clockwise. Seen from
//! above, with the solid on the left, the walk comes in over the one that goes down
//! and leaves over the one that goes up, whose twin goes down in the next triangle.
use super::grid::Corner;
use crate::layers::shape::{Point, Ring};
use crate::mesh::OPEN;

/// What the walk needs of a mesh.
#[derive(Clone, Copy)]
pub(super) struct Surface<'a> {
    pub(super) corners: &'a [Corner],
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) twins: &'a [u32],
}

/// Which triangles have been walked over in this plane; kept from plane to plane.
#[derive(Default)]
pub(super) struct Visited {
    /// One more than the plane that came here last.
    plane: Vec<u32>,
}

impl Visited {
    /// Ready for any plane of a mesh. Planes that share this must have their own numbers.
    pub(super) fn fit(&mut self, triangles: usize) {
        if self.plane.len() != triangles {
            self.plane = vec![0; triangles];
        }
    }

    fn mark(&mut self, triangle: u32, plane: u32) -> bool {
        std::mem::replace(&mut self.plane[triangle as usize], plane + 1) != plane + 1
    }
}

/// The contours of a plane. Consecutive points may be equal.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Contours {
    pub(super) closed: Vec<Ring>,
    /// From rim to rim, where the mesh has holes.
    pub(super) open: Vec<Ring>,
}

/// A plane: its number, and its height in grid steps.
#[derive(Clone, Copy)]
pub(super) struct Plane {
    pub(super) number: u32,
    pub(super) z: i32,
}

impl Surface<'_> {
    /// The contours of a plane that crosses these triangles, in their order.
    pub(super) fn cut(&self, plane: Plane, crossed: &[u32], visited: &mut Visited) -> Contours {
        let mut found = Contours::default();
        let mut points = Vec::new();
        for &start in crossed {
            if !visited.mark(start, plane.number) {
                continue;
            }
            points.clear();
            let up = self.edge(start, plane, true);
            if self.walk(start, up, plane, visited, &mut points) {
                found.closed.push(points.clone());
                continue;
            }
            // A rim ahead: what lies behind the start belongs to the same chain.
            let mut behind = Vec::new();
            self.walk_back(start, self.edge(start, plane, false), plane, visited, &mut behind);
            behind.reverse();
            behind.extend_from_slice(&points);
            found.open.push(behind);
        }
        found
    }

    /// The edge of a crossed triangle that goes up through the plane, or down.
    fn edge(&self, triangle: u32, plane: Plane, up: bool) -> u32 {
        let below = self.triangles[triangle as usize].map(|v| self.corners[v as usize].level <= plane.number);
        let found = (0..3).find(|&k| below[k] == up && below[(k + 1) % 3] != up);
        debug_assert!(found.is_some(), "the plane crosses the triangle");
        3 * triangle + found.unwrap_or_default() as u32
    }

    /// Walks on from an edge that goes up, collecting crossings, to the start (true) or to a rim.
    fn walk(
        &self,
        start: u32,
        up: u32,
        plane: Plane,
        visited: &mut Visited,
        points: &mut Vec<Point>,
    ) -> bool {
        let corner = |half: u32| {
            let (t, k) = (half as usize / 3, half as usize % 3);
            self.corners[self.triangles[t][k] as usize]
        };
        let mut up = up;
        let (mut low, mut high) = (corner(up), corner(3 * (up / 3) + (up + 1) % 3));
        loop {
            points.push(crossing(&low, &high, plane.z));
            let twin = self.twins[up as usize];
            if twin == OPEN {
                return false;
            }
            let (triangle, k) = (twin / 3, twin % 3);
            if triangle == start {
                return true;
            }
            visited.mark(triangle, plane.number);
            // The twin goes down; the third corner tells which of the others goes up.
            let third = self.corners[self.triangles[triangle as usize][(k as usize + 2) % 3] as usize];
            up = if third.level <= plane.number {
                low = third;
                3 * triangle + (k + 2) % 3
            } else {
                high = third;
                3 * triangle + (k + 1) % 3
            };
        }
    }

    /// Walks back from an edge that goes down to a rim, collecting crossings.
    fn walk_back(&self, start: u32, down: u32, plane: Plane, visited: &mut Visited, points: &mut Vec<Point>) {
        let mut down = down;
        loop {
            let (triangle, k) = (down as usize / 3, down as usize % 3);
            let [high, low] = [k, (k + 1) % 3].map(|k| self.triangles[triangle][k] as usize);
            points.push(crossing(&self.corners[low], &self.corners[high], plane.z));
            let twin = self.twins[down as usize];
            if twin == OPEN || twin / 3 == start {
                return;
            }
            visited.mark(twin / 3, plane.number);
            down = self.edge(twin / 3, plane, false);
        }
    }
}

/// Where an edge crosses a plane, the nearest point of the grid. Computed from the
/// lower end to the upper one, so that it is the same in both triangles at the edge.
fn crossing(low: &Corner, high: &Corner, z: i32) -> Point {
    let rise = i64::from(high.z) - i64::from(low.z);
    let part = i64::from(z) - i64::from(low.z);
    // Coordinates have 30 bits with their sign: the numerators below stay within 62.
    let at = |from: i32, to: i32| {
        let run = i64::from(to) - i64::from(from);
        let doubled = 2 * run * part + rise;
        (i64::from(from) + doubled.div_euclid(2 * rise)) as i32
    };
    Point { x: at(low.x, high.x), y: at(low.y, high.y) }
}
