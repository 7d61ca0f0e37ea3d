//! Connected pieces of a surface.
//!
//! Takes triangles and their neighbours, gives for each triangle the shell that it
//! belongs to, and what each shell measures. Pieces that touch in a vertex only
//! are two.
use super::twins::CROWDED;
use super::vector::{cross, distance, dot, length, sub};

/// A connected piece.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shell {
    /// Its triangles.
    pub(super) triangles: u32,
    /// Half-edges without a neighbour.
    pub(super) open_edges: u32,
    /// Signed volume, mm³: positive when it faces outward. Where it is open, that of
    /// the shell closed by triangles to the middle of the bounds.
    pub(super) volume_mm3: f64,
    /// Area, mm².
    pub(super) area_mm2: f64,
    /// Length of its rims, mm.
    pub(super) rim_mm: f64,
    /// One of its triangles: the largest.
    pub(super) largest: u32,
}

/// All shells.
pub(super) struct Shells {
    /// For each triangle the number of its shell.
    pub(super) of: Vec<u32>,
    /// In the order of their first triangles.
    pub(super) list: Vec<Shell>,
}

/// No shell yet.
const NONE: u32 = u32::MAX;

impl Shells {
    /// Finds them.
    pub(super) fn of(vertices: &[[f64; 3]], triangles: &[[u32; 3]], twins: &[u32]) -> Shells {
        let mut shells = Shells { of: vec![NONE; triangles.len()], list: Vec::new() };
        let mut stack = Vec::new();
        for first in 0..triangles.len() as u32 {
            if shells.of[first as usize] != NONE {
                continue;
            }
            let number = shells.list.len() as u32;
            shells.of[first as usize] = number;
            stack.push(first);
            let mut shell = Measure::new(vertices[triangles[first as usize][0] as usize]);
            while let Some(t) = stack.pop() {
                let corners = triangles[t as usize].map(|v| vertices[v as usize]);
                shell.add(t, corners);
                for (k, &twin) in twins[t as usize * 3..t as usize * 3 + 3].iter().enumerate() {
                    if twin >= CROWDED {
                        shell.shell.open_edges += 1;
                        shell.shell.rim_mm += distance(corners[k], corners[(k + 1) % 3]);
                    } else if shells.of[(twin / 3) as usize] == NONE {
                        shells.of[(twin / 3) as usize] = number;
                        stack.push(twin / 3);
                    }
                }
            }
            shells.list.push(shell.finish());
        }
        shells
    }
}

/// A shell while its triangles are added.
struct Measure {
    shell: Shell,
    /// Volumes are measured from here.
    origin: [f64; 3],
    /// Lowest and highest coordinates.
    low: [f64; 3],
    high: [f64; 3],
    /// Sum of the area vectors, twice: 0 for a closed shell.
    twice_area: [f64; 3],
    largest_mm2: f64,
}

impl Measure {
    fn new(origin: [f64; 3]) -> Measure {
        let shell =
            Shell { triangles: 0, open_edges: 0, volume_mm3: 0.0, area_mm2: 0.0, rim_mm: 0.0, largest: 0 };
        let (low, high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        Measure { shell, origin, low, high, twice_area: [0.0; 3], largest_mm2: -1.0 }
    }

    fn add(&mut self, t: u32, [a, b, c]: [[f64; 3]; 3]) {
        let normal = cross(sub(b, a), sub(c, a));
        let area = length(normal) / 2.0;
        self.shell.triangles += 1;
        self.shell.volume_mm3 += dot(sub(a, self.origin), normal) / 6.0;
        self.shell.area_mm2 += area;
        if area > self.largest_mm2 {
            (self.largest_mm2, self.shell.largest) = (area, t);
        }
        for k in 0..3 {
            self.twice_area[k] += normal[k];
            self.low[k] = self.low[k].min(a[k]).min(b[k]).min(c[k]);
            self.high[k] = self.high[k].max(a[k]).max(b[k]).max(c[k]);
        }
    }

    fn finish(mut self) -> Shell {
        let middle = [0, 1, 2].map(|k| (self.low[k] + self.high[k]) / 2.0);
        // Seen from the middle every triangle's height differs by the same vector.
        self.shell.volume_mm3 += dot(sub(self.origin, middle), self.twice_area) / 6.0;
        self.shell
    }
}
