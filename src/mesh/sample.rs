//! Meshes for tests: closed bodies whose volume is known, and files of them.
use super::Mesh;
use super::report::Mended;
use std::f64::consts::TAU;

/// Triangles without shared vertices, as in a file.
#[derive(Clone, Debug, Default)]
pub(super) struct Soup(pub(super) Vec<[[f32; 3]; 3]>);

impl Soup {
    fn add(&mut self, corners: [[f64; 3]; 3]) {
        self.0.push(corners.map(|v| v.map(|c| c as f32)));
    }

    /// A quadrilateral, counter-clockwise from outside.
    fn quad(&mut self, [a, b, c, d]: [[f64; 3]; 4]) {
        self.add([a, b, c]);
        self.add([a, c, d]);
    }

    /// Both.
    pub(super) fn and(mut self, other: Soup) -> Soup {
        self.0.extend(other.0);
        self
    }

    /// The same facing the other way.
    pub(super) fn inverted(mut self) -> Soup {
        self.0.iter_mut().for_each(|t| t.swap(1, 2));
        self
    }

    /// A binary STL file.
    pub(super) fn file(&self) -> Vec<u8> {
        let mut file = vec![0; 80];
        file.extend((self.0.len() as u32).to_le_bytes());
        for t in &self.0 {
            file.extend([0; 12]);
            t.as_flattened().iter().for_each(|c| file.extend(c.to_le_bytes()));
            file.extend([0; 2]);
        }
        file
    }

    /// Mended, and how.
    pub(super) fn mended(&self) -> (Mesh, Mended) {
        let (mesh, report) = super::read(&mut std::io::Cursor::new(self.file())).expect("a mesh");
        (mesh, report.mended)
    }

    /// As a mesh.
    pub(super) fn mesh(&self) -> Mesh {
        self.mended().0
    }
}

/// A block of 12 triangles.
pub(super) fn block(low: [f64; 3], size: [f64; 3]) -> Soup {
    let v = |x: usize, y: usize, z: usize| {
        let at = [x, y, z];
        [0, 1, 2].map(|k| low[k] + size[k] * at[k] as f64)
    };
    let mut soup = Soup::default();
    soup.quad([v(0, 0, 0), v(0, 1, 0), v(1, 1, 0), v(1, 0, 0)]);
    soup.quad([v(0, 0, 1), v(1, 0, 1), v(1, 1, 1), v(0, 1, 1)]);
    soup.quad([v(0, 0, 0), v(1, 0, 0), v(1, 0, 1), v(0, 0, 1)]);
    soup.quad([v(1, 0, 0), v(1, 1, 0), v(1, 1, 1), v(1, 0, 1)]);
    soup.quad([v(1, 1, 0), v(0, 1, 0), v(0, 1, 1), v(1, 1, 1)]);
    soup.quad([v(0, 1, 0), v(0, 0, 0), v(0, 0, 1), v(0, 1, 1)]);
    soup
}

/// A grid of `n` × `m` quadrilaterals that closes upon itself both ways, by the place of (i/n, j/m).
fn closed_grid(n: usize, m: usize, place: impl Fn(f64, f64) -> [f64; 3]) -> Soup {
    let v = |i: usize, j: usize| place((i % n) as f64 / n as f64, (j % m) as f64 / m as f64);
    let mut soup = Soup::default();
    for i in 0..n {
        for j in 0..m {
            soup.quad([v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)]);
        }
    }
    soup
}

/// A torus about z through `middle`: 2 `n` `m` triangles.
pub(super) fn torus(middle: [f64; 3], radii: [f64; 2], n: usize, m: usize) -> Soup {
    closed_grid(n, m, |u, v| {
        let r = radii[0] + radii[1] * (v * TAU).cos();
        let (s, c) = (u * TAU).sin_cos();
        [middle[0] + r * c, middle[1] + r * s, middle[2] + radii[1] * (v * TAU).sin()]
    })
}

/// A ball of `n` meridians and `m` rings.
pub(super) fn ball(middle: [f64; 3], radius: f64, n: usize, m: usize) -> Soup {
    let v = |i: usize, j: usize| {
        let (s, c) = ((i % n) as f64 / n as f64 * TAU).sin_cos();
        let (sj, cj) = (j as f64 / m as f64 * TAU / 2.0).sin_cos();
        let ring = if j == 0 || j == m { 0.0 } else { sj * radius };
        [middle[0] + ring * c, middle[1] + ring * s, middle[2] - radius * cj]
    };
    let mut soup = Soup::default();
    for i in 0..n {
        soup.add([v(i, 0), v(i + 1, 1), v(i, 1)]);
        soup.add([v(i, m), v(i, m - 1), v(i + 1, m - 1)]);
        for j in 1..m - 1 {
            soup.quad([v(i, j), v(i + 1, j), v(i + 1, j + 1), v(i, j + 1)]);
        }
    }
    soup
}

/// Holds what every mended mesh must: twins of twins, opposite ways, three different vertices, all used.
pub(super) fn assert_sound(mesh: &Mesh, mended: &Mended) {
    assert_eq!(mesh.twins.len(), mesh.triangles.len() * 3);
    let ends = |h: u32| super::twins::ends(&mesh.triangles, h);
    let mut open = 0;
    for (h, &twin) in mesh.twins.iter().enumerate() {
        if twin == super::OPEN {
            open += 1;
            continue;
        }
        let h = h as u32;
        assert_eq!(mesh.twins[twin as usize], h);
        let ([a, b], [c, d]) = (ends(h), ends(twin));
        assert!(a == d && b == c && twin != h, "half-edges {h} and {twin}");
    }
    assert_eq!(open, mended.open_edges);
    let mut used = vec![false; mesh.vertices.len()];
    for t in &mesh.triangles {
        assert!(t[0] != t[1] && t[1] != t[2] && t[2] != t[0]);
        t.iter().for_each(|&v| used[v as usize] = true);
    }
    assert!(used.iter().all(|&u| u), "every vertex has a triangle");
}
