//! Meshes for benches and examples: made, or made finer, to any number of triangles.
#![allow(dead_code)] // each target uses its own part
use outrigger::mesh::{self, Mesh};
use std::collections::HashMap;
use std::io::Cursor;

/// A lumpy ring that lies on the plate, about 60 mm wide and 40 mm high, of
/// `2 n²` triangles: organic, closed, with overhangs, a hole and fine bumps.
pub(crate) fn lumpy_ring(n: u32) -> Vec<u8> {
    let turn = |k: u32| std::f64::consts::TAU * f64::from(k % n) / f64::from(n);
    let at = |i: u32, j: u32| {
        let (a, b) = (turn(i), turn(j));
        let tube = 12.0 + 3.0 * (3.0 * a).sin() + 0.4 * (17.0 * a).sin() * (13.0 * b).cos();
        let radius = 20.0 + tube * b.cos();
        [radius * a.cos(), radius * a.sin(), tube * b.sin() * 1.3 + 2.0 * (2.0 * a).cos()]
    };
    let mut soup = Vec::new();
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let quad = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        soup.extend([[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]);
    }
    let low = soup.iter().flatten().map(|v| v[2]).fold(f64::INFINITY, f64::min);
    soup.iter_mut().flatten().for_each(|v| v[2] -= low);
    stl(&soup)
}

/// A binary STL file.
fn stl(soup: &[[[f64; 3]; 3]]) -> Vec<u8> {
    let mut file = vec![0; 80];
    file.extend((soup.len() as u32).to_le_bytes());
    for triangle in soup {
        file.extend([0; 12]);
        triangle.iter().flatten().for_each(|&c| file.extend((c as f32).to_le_bytes()));
        file.extend([0; 2]);
    }
    file
}

/// The same body of `triangles` triangles or one more: edges are halved, the longest
/// first, each time in both of its triangles.
pub(crate) fn finer(file: &[u8], triangles: usize) -> Vec<u8> {
    let mut mesh = read(file);
    while mesh.triangles.len() < triangles {
        mesh = halved(&mesh, triangles);
    }
    let soup: Vec<_> = mesh.triangles.iter().map(|t| t.map(|v| mesh.vertices[v as usize])).collect();
    stl(&soup)
}

/// Halves edges, each triangle's at most one, until there are so many triangles.
fn halved(mesh: &Mesh, triangles: usize) -> Mesh {
    let ends = |h: u32| {
        let (t, k) = (h as usize / 3, h as usize % 3);
        [mesh.triangles[t][k], mesh.triangles[t][(k + 1) % 3]]
    };
    let place = |v: u32| mesh.vertices[v as usize];
    let length = |h: u32| {
        let [a, b] = ends(h).map(place);
        (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f64>()
    };
    let mut edges: Vec<(f64, u32)> =
        (0_u32..).zip(&mesh.twins).filter(|&(h, &twin)| h < twin).map(|(h, _)| (length(h), h)).collect();
    edges.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut cut: HashMap<u32, (usize, u32)> = HashMap::new();
    let mut fine = Mesh { vertices: mesh.vertices.clone(), ..Mesh::default() };
    let mut count = mesh.triangles.len();
    for (_, half) in edges {
        let sides: Vec<u32> =
            [half, mesh.twins[half as usize]].into_iter().filter(|&h| h != mesh::OPEN).collect();
        if count >= triangles {
            break;
        }
        if sides.iter().any(|h| cut.contains_key(&(h / 3))) {
            continue;
        }
        let [a, b] = ends(half).map(place);
        let middle = fine.vertices.len() as u32;
        fine.vertices.push([0, 1, 2].map(|k| (a[k] + b[k]) / 2.0));
        count += sides.len();
        for h in sides {
            cut.insert(h / 3, (h as usize % 3, middle));
        }
    }
    for (t, &corners) in (0_u32..).zip(&mesh.triangles) {
        match cut.get(&t) {
            None => fine.triangles.push(corners),
            Some(&(k, middle)) => {
                let [a, b, c] = [0, 1, 2].map(|j| corners[(k + j) % 3]);
                fine.triangles.extend([[a, middle, c], [middle, b, c]]);
            }
        }
    }
    // Neighbours are found by reading the triangles anew.
    let soup: Vec<_> = fine.triangles.iter().map(|t| t.map(|v| fine.vertices[v as usize])).collect();
    read(&stl(&soup))
}

/// Reads a file of the bench's own.
pub(crate) fn read(file: &[u8]) -> Mesh {
    mesh::read(&mut Cursor::new(file)).expect("a mesh of the bench's own").0
}
