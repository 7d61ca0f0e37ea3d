//! Layers of real meshes against the mesh itself, by ways that share no code with the
//! slicer: whether a point is inside is told by a vertical ray through all triangles,
//! in floating point, and whether it is inside the layer by a level ray through all edges.
//!
//! The meshes lie outside the repository; without them this tests nothing but itself.
use outrigger::layers::from_mesh::{FromMesh, LayerHeights, Sliced};
use outrigger::layers::shape::Region;
use outrigger::layers::stack::{Layer, Layers};
use outrigger::mesh::{self, Mesh};
use std::path::{Path, PathBuf};

/// Points nearer than this to a border may be on either side of it, mm: rounding moves
/// a vertex by up to 0.05 µm and a crossing by as much again, and where a face is nearly
/// level that shifts its crossing sideways.
const BORDER_MM: f64 = 0.002;

/// Vertices and planes are rounded by at most half of this each, mm.
const ROUNDING_MM: f64 = 0.000_1;

/// Points tried in each mesh.
const POINTS: usize = 300;

fn models() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<PathBuf> = entries.map(|e| e.expect("an entry").path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "stl"));
    // The largest are for release builds.
    let limit = if cfg!(debug_assertions) { 600_000 } else { u64::MAX };
    paths.retain(|p| p.metadata().is_ok_and(|m| m.len() < limit));
    paths.sort();
    paths
}

fn read(path: &Path) -> Mesh {
    let bytes = std::fs::read(path).expect("a readable file");
    mesh::read(&mut std::io::Cursor::new(bytes)).expect("a mesh").0
}

fn slice(mesh: &Mesh, layer_mm: f64) -> (Vec<Layer>, Sliced) {
    let mut source = FromMesh::new(mesh, LayerHeights::even(layer_mm)).expect("a mesh that can be sliced");
    let mut layers = Vec::new();
    while let Ok(Some(batch)) = source.next_batch() {
        layers.extend(batch);
    }
    (layers, source.sliced())
}

/// A generator of the same numbers every time (SplitMix64).
struct Dice(u64);

impl Dice {
    /// From 0 to 1.
    fn roll(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// How often a mesh winds around a point: triangles above it that look up, less those
/// that look down. `None` where one is so near in height that rounding decides.
fn winding(mesh: &Mesh, [x, y, z]: [f64; 3]) -> Option<i32> {
    let mut sum = 0;
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
        let side = |p: [f64; 3], q: [f64; 3]| (q[0] - p[0]) * (y - p[1]) - (q[1] - p[1]) * (x - p[0]);
        let (u, v, w) = (side(b, c), side(c, a), side(a, b));
        let up = u > 0.0 && v > 0.0 && w > 0.0;
        let down = u < 0.0 && v < 0.0 && w < 0.0;
        if up || down {
            let above = (a[2] * u + b[2] * v + c[2] * w) / (u + v + w) - z;
            if above.abs() < ROUNDING_MM {
                return None;
            }
            sum += i32::from(above > 0.0) * if up { 1 } else { -1 };
        }
    }
    Some(sum)
}

/// Whether a point is inside a region, and how far from its border, mm.
fn inside(region: &Region, [x, y]: [f64; 2]) -> (bool, f64) {
    let (mut within, mut nearest) = (false, f64::INFINITY);
    for ring in region.rings() {
        for k in 0..ring.len() {
            let ([ax, ay], [bx, by]) = (ring[k].mm(), ring[(k + 1) % ring.len()].mm());
            if (ay > y) != (by > y) && ax + (y - ay) / (by - ay) * (bx - ax) > x {
                within = !within;
            }
            let (dx, dy) = (bx - ax, by - ay);
            let along = (((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
            nearest = nearest.min((ax + along * dx - x).hypot(ay + along * dy - y));
        }
    }
    (within, nearest)
}

#[test]
fn points_are_inside_a_layer_where_they_are_inside_the_mesh() {
    let mut checked = 0;
    for path in models() {
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let mesh = read(&path);
        if mesh.twins.contains(&mesh::OPEN) {
            continue;
        }
        let (layers, sliced) = slice(&mesh, 0.1);
        assert_eq!(sliced.open_layers, 0, "{name}");
        let [min, max] = mesh.bounds_mm();
        let mut dice = Dice(mesh.triangles.len() as u64);
        let (mut near, mut within) = (0, 0);
        for _ in 0..POINTS {
            let layer = &layers[(dice.roll() * layers.len() as f64) as usize];
            let at = [0, 1].map(|axis| min[axis] + dice.roll() * (max[axis] - min[axis]));
            let (found, distance) = inside(&layer.part, at);
            let expect = winding(&mesh, [at[0], at[1], layer.plane_mm()]);
            let Some(expect) = expect.filter(|_| distance >= BORDER_MM) else {
                near += 1;
                continue;
            };
            assert_eq!(found, expect > 0, "{name}: {at:?} in layer {}", layer.number);
            within += u32::from(found);
        }
        assert!(near < POINTS / 20, "{name}: {near} points are near a border");
        assert!(within > POINTS as u32 / 100, "{name}: hardly a point is inside");
        checked += 1;
    }
    assert!(checked >= 12 || models().is_empty(), "only {checked} meshes are closed");
}

#[test]
fn layers_add_up_to_the_volume() {
    for path in models() {
        let mesh = read(&path);
        let corners = |t: &[u32; 3]| t.map(|v| mesh.vertices[v as usize]);
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(corners)
            .map(|[a, b, c]| {
                a[0] * (b[1] * c[2] - b[2] * c[1])
                    + a[1] * (b[2] * c[0] - b[0] * c[2])
                    + a[2] * (b[0] * c[1] - b[1] * c[0])
            })
            .sum::<f64>()
            / 6.0;
        let (layers, sliced) = slice(&mesh, 0.05);
        if mesh.twins.contains(&mesh::OPEN) || sliced.crossing_layers > 0 {
            continue;
        }
        let sum: f64 = layers.iter().map(|l| l.part.area_mm2() * l.thickness_mm()).sum();
        // The middle of each layer stands for it: exact but where a face begins within one.
        assert!((sum / volume - 1.0).abs() < 6e-3, "{}: {sum} of {volume} mm³", path.display());
    }
}
