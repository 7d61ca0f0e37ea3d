//! Slices of meshes made here, whose layers are known.
use super::*;
use crate::layers::shape::{Region, Ring, twice_area};
use crate::mesh::OPEN;
use proptest::prelude::*;
use std::collections::HashMap;

type Soup = Vec<[[f64; 3]; 3]>;

/// Vertices shared where they are equal, half-edges paired in the order in which they come.
fn mesh(soup: &[[[f64; 3]; 3]]) -> Mesh {
    let mut index = HashMap::new();
    let mut mesh = Mesh::default();
    for triangle in soup {
        let corners = triangle.map(|at| {
            *index.entry(at.map(f64::to_bits)).or_insert_with(|| {
                mesh.vertices.push(at);
                mesh.vertices.len() as u32 - 1
            })
        });
        mesh.triangles.push(corners);
    }
    mesh.twins = vec![OPEN; 3 * mesh.triangles.len()];
    let mut waiting: HashMap<(u32, u32), Vec<u32>> = HashMap::new();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        for k in 0..3 {
            let (half, from, to) = ((3 * t + k) as u32, corners[k], corners[(k + 1) % 3]);
            match waiting.get_mut(&(to, from)).and_then(Vec::pop) {
                Some(twin) => {
                    mesh.twins[half as usize] = twin;
                    mesh.twins[twin as usize] = half;
                }
                None => waiting.entry((from, to)).or_default().push(half),
            }
        }
    }
    mesh
}

/// The twelve triangles of a box, outside out.
fn cuboid(min: [f64; 3], max: [f64; 3]) -> Soup {
    let corner =
        |k: usize| std::array::from_fn(|axis| if k >> axis & 1 == 0 { min[axis] } else { max[axis] });
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    faces.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]).map(|t| t.map(corner)).collect()
}

fn inside_out(soup: Soup) -> Soup {
    soup.into_iter().map(|[a, b, c]| [a, c, b]).collect()
}

/// A ring of tubes round the z axis, wavy so that no two of its triangles are alike.
fn torus(around: u32, across: u32, height: f64) -> Soup {
    let at = |i: u32, j: u32| {
        let turn = |k: u32, n: u32| std::f64::consts::TAU * f64::from(k % n) / f64::from(n);
        let (a, b) = (turn(i, around), turn(j, across));
        let tube = 2.0 + 0.3 * (5.0 * a).sin();
        let radius = 6.0 + tube * b.cos();
        [
            radius * a.cos(),
            radius * a.sin(),
            height / 2.0 + height * 0.2 * (tube * b.sin() + (3.0 * a).cos() * 0.05),
        ]
    };
    let quad =
        |(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]];
    (0..around).flat_map(|i| (0..across).map(move |j| (i, j))).flat_map(quad).collect()
}

fn layers_of(mesh: &Mesh, heights: LayerHeights) -> (Vec<Layer>, Sliced) {
    let mut source = FromMesh::new(mesh, heights).expect("a mesh that can be sliced");
    let crossings = source.crossings();
    let mut layers = Vec::new();
    while let Some(batch) = source.next_batch().expect("a mesh that can be sliced to its end") {
        assert!(!batch.is_empty());
        layers.extend(batch);
    }
    assert_eq!((source.crossings(), source.next_batch()), (crossings, Ok(None)));
    assert_eq!(source.count(), Some(layers.len() as u32));
    assert!(layers.iter().zip(0..).all(|(l, n)| l.number == n && l.aid.is_empty()));
    (layers, source.sliced())
}

/// The areas of a soup's layers of 0.2 mm and how many polygons each has.
fn check(soup: &Soup, expect: &[(f64, usize)]) -> Sliced {
    let (layers, sliced) = layers_of(&mesh(soup), LayerHeights::even(0.2));
    let found: Vec<(f64, usize)> =
        layers.iter().map(|l| (l.part.area_mm2(), l.part.polygons.len())).collect();
    assert_eq!(found.len(), expect.len(), "{found:?}");
    for (k, (found, expect)) in found.iter().zip(expect).enumerate() {
        assert!((found.0 - expect.0).abs() < 1e-3 && found.1 == expect.1, "layer {k}: {found:?} {expect:?}");
    }
    sliced
}

#[test]
fn a_box_is_the_same_all_the_way_up() {
    let soup = cuboid([1.0, 2.0, 0.0], [4.0, 4.0, 1.0]);
    assert_eq!(check(&soup, &[(6.0, 1); 5]), Sliced::default());
    let (layers, _) = layers_of(&mesh(&soup), LayerHeights { layer_mm: 0.2, first_mm: 0.3 });
    let heights: Vec<[f64; 3]> = layers.iter().map(|l| [l.bottom_mm, l.plane_mm(), l.top_mm]).collect();
    for (found, expect) in heights.iter().zip([[0.0, 0.15, 0.3], [0.3, 0.4, 0.5], [0.5, 0.6, 0.7]]) {
        assert!((0..3).all(|k| (found[k] - expect[k]).abs() < 1e-12), "{found:?}");
    }
    let ring: Vec<[f64; 2]> = layers[0].part.polygons[0].rings[0].iter().map(|p| p.mm()).collect();
    assert_eq!(ring, [[1.0, 2.0], [4.0, 2.0], [4.0, 4.0], [1.0, 4.0]]);
}

#[test]
fn a_plane_through_a_face_sees_what_is_above_it() {
    // Planes at 0.1, 0.3, 0.5, 0.7 …: the step is at the second, the lid at the fourth.
    let mut soup = cuboid([0.0, 0.0, 0.0], [4.0, 4.0, 0.3]);
    soup.extend(cuboid([0.0, 0.0, 0.3], [2.0, 4.0, 0.7]));
    check(&soup, &[(16.0, 1), (8.0, 1), (8.0, 1)]);
    // And a hanging one: its underside, on the plane, is there; its lid, on a plane, is not.
    let mut soup = cuboid([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]);
    soup.extend(cuboid([3.0, 0.0, 0.3], [4.0, 1.0, 0.7]));
    check(&soup, &[(1.0, 1), (2.0, 2), (2.0, 2), (1.0, 1), (1.0, 1)]);
}

#[test]
fn an_octahedron_with_its_equator_on_a_plane() {
    let (x, y, z) = (
        [[1.0, 0.0, 0.5], [-1.0, 0.0, 0.5]],
        [[0.0, 1.0, 0.5], [0.0, -1.0, 0.5]],
        [[0.0, 0.0, 0.9], [0.0, 0.0, 0.1]],
    );
    let mut soup = Soup::new();
    for k in 0..8_usize {
        let triangle = [x[k & 1], y[k >> 1 & 1], z[k >> 2]];
        let [a, b, c] = triangle;
        soup.push(if k.count_ones().is_multiple_of(2) { triangle } else { [a, c, b] });
    }
    // Its lower tip is on the first plane (a point is nothing), its upper on the last.
    let sliced = check(&soup, &[(0.0, 0), (0.5, 1), (2.0, 1), (0.5, 1)]);
    assert_eq!(sliced, Sliced::default());
}

#[test]
fn shells_nest_and_unite() {
    let outer = || cuboid([0.0; 3], [4.0, 4.0, 1.0]);
    let inner = |x: f64| cuboid([x, 1.0, 0.2], [x + 2.0, 3.0, 0.8]);
    let check = |second: Soup, expect: &[(f64, usize)], crossing: u32| {
        let sliced = check(&[outer(), second].concat(), expect);
        assert_eq!(sliced, Sliced { crossing_layers: crossing, ..Sliced::default() });
    };
    // A body in a body; a cavity; bodies that overlap; what turns the wrong way in the open.
    check(inner(1.0), &[(16.0, 1); 5], 0);
    check(inside_out(inner(1.0)), &[(16.0, 1), (12.0, 1), (12.0, 1), (12.0, 1), (16.0, 1)], 0);
    check(inner(3.0), &[(16.0, 1), (18.0, 1), (18.0, 1), (18.0, 1), (16.0, 1)], 3);
    check(inside_out(inner(3.0)), &[(16.0, 1), (14.0, 1), (14.0, 1), (14.0, 1), (16.0, 1)], 3);
    check(inside_out(inner(5.0)), &[(16.0, 1); 5], 0);
}

#[test]
fn bodies_that_touch() {
    let one = cuboid([0.0; 3], [1.0; 3]);
    let check = |min: [f64; 3], max: [f64; 3], expect: &[(f64, usize)]| {
        check(&[one.clone(), cuboid(min, max)].concat(), expect);
    };
    // Along a vertical edge they stay two; along a face they become one; at a corner or
    // along a level edge they never are in the same layer.
    check([1.0, 1.0, 0.0], [2.0, 2.0, 1.0], &[(2.0, 2); 5]);
    check([1.0, 0.0, 0.0], [2.0, 1.0, 1.0], &[(2.0, 1); 5]);
    check([1.0, 1.0, 1.0], [2.0, 2.0, 1.4], &[(1.0, 1); 7]);
    check([1.0, 0.0, 1.0], [2.0, 1.0, 1.4], &[(1.0, 1); 7]);
}

#[test]
fn a_box_without_a_side_is_closed_and_told() {
    let whole = cuboid([0.0; 3], [4.0, 2.0, 1.0]);
    // Two triangles a side: without the last two, the side at x = 4 is missing.
    let sliced = check(&whole[..10].to_vec(), &[(8.0, 1); 5]);
    let expect = Sliced {
        open_layers: 5,
        first_open_layer: Some(0),
        open_contours: 5,
        widest_gap_mm: 2.0,
        crossing_layers: 0,
    };
    assert_eq!(sliced, expect);
    // Triangles that share nothing: every chain is one segment, and all gaps are null.
    let mut loose = mesh(&whole);
    loose.twins.fill(OPEN);
    let (layers, sliced) = layers_of(&loose, LayerHeights::even(0.2));
    assert!(layers.iter().all(|l| (l.part.area_mm2() - 8.0).abs() < 1e-6));
    assert_eq!(sliced, Sliced::default());
}

#[test]
fn what_cannot_be_sliced_is_refused() {
    let check = |mesh: &Mesh, layer_mm: f64, part: &str| {
        let message = FromMesh::new(mesh, LayerHeights::even(layer_mm)).err().map(|e| e.to_string());
        assert!(message.as_ref().is_some_and(|m| m.contains(part)), "{message:?} instead of {part}");
    };
    let good = mesh(&cuboid([0.0; 3], [1.0; 3]));
    for mm in [0.0, -0.2, 1e-9, f64::NAN, 1e6] {
        check(&good, mm, "--layer-height");
    }
    check(&good, 3.0, "less than half");
    check(&Mesh::default(), 0.2, "no triangle");
    check(&mesh(&cuboid([0.0, 0.0, -1.0], [1.0; 3])), 0.2, "below the plate");
    check(&mesh(&cuboid([0.0; 3], [1.0, 1.0, 5000.0])), 0.001, "--height-mm");
    for bad in [f64::NAN, f64::INFINITY, 6e4] {
        let mut mesh = good.clone();
        mesh.vertices[3][1] = bad;
        check(&mesh, 0.2, "vertex 3");
    }
    let broken: [fn(&mut Mesh); 5] = [
        |m| m.triangles[5][1] = 99,
        |m| m.twins.truncate(7),
        |m| m.twins[3] = 3,
        |m| m.twins[4] = OPEN,
        |m| m.twins.swap(0, 20),
    ];
    for breaks in broken {
        let mut mesh = good.clone();
        breaks(&mut mesh);
        check(&mesh, 0.2, "put together wrongly");
    }
}

/// Six times the volume of a closed surface, mm³, by the divergence theorem.
fn volume_mm3(soup: &[[[f64; 3]; 3]]) -> f64 {
    let triple = |[a, b, c]: &[[f64; 3]; 3]| {
        a[0] * (b[1] * c[2] - b[2] * c[1])
            + a[1] * (b[2] * c[0] - b[0] * c[2])
            + a[2] * (b[0] * c[1] - b[1] * c[0])
    };
    soup.iter().map(triple).sum::<f64>() / 6.0
}

#[test]
fn layers_add_up_to_the_volume() {
    let soup = torus(60, 40, 5.0);
    let (layers, sliced) = layers_of(&mesh(&soup), LayerHeights::even(0.02));
    let sum: f64 = layers.iter().map(|l| l.part.area_mm2() * l.thickness_mm()).sum();
    let volume = volume_mm3(&soup);
    assert!(volume > 100.0 && (sum / volume - 1.0).abs() < 3e-4, "{sum} {volume}");
    assert_eq!(sliced, Sliced::default());
}

#[test]
fn a_jobs_own_heights_cut_where_they_are() {
    // A pyramid: at each height a square of 10 mm less the height.
    let (top, base) = ([5.0, 5.0, 10.0], [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]]);
    let base = base.map(|[x, y]: [f64; 2]| [x, y, 0.0]);
    let side = |k: usize| [base[k], base[(k + 1) % 4], top];
    let soup: Soup =
        (0..4).map(side).chain([[base[0], base[2], base[1]], [base[0], base[3], base[2]]]).collect();
    let mesh = mesh(&soup);
    // Irregular, with a gap, and beyond the top.
    let heights = vec![[0.0, 0.3], [0.3, 0.4], [0.4, 2.0], [5.0, 5.1], [5.1, 5.9], [9.8, 9.9], [9.9, 12.0]];
    let mut source = FromMesh::at(&mesh, heights.clone()).expect("a mesh that can be sliced");
    let layers = source.next_batch().expect("layers").expect("some");
    assert_eq!(layers.len(), heights.len());
    for (layer, [bottom_mm, top_mm]) in layers.iter().zip(heights) {
        assert_eq!([layer.bottom_mm, layer.top_mm], [bottom_mm, top_mm]);
        let side_mm = (10.0 - (bottom_mm + top_mm) / 2.0).max(0.0);
        assert!((layer.part.area_mm2() - side_mm * side_mm).abs() < 0.01, "{layer:?}");
    }
    // Even ones are the same either way.
    let (even, _) = layers_of(&mesh, LayerHeights { layer_mm: 0.2, first_mm: 0.3 });
    let heights = even.iter().map(|l| [l.bottom_mm, l.top_mm]).collect();
    let mut source = FromMesh::at(&mesh, heights).expect("a mesh that can be sliced");
    let mut given = Vec::new();
    while let Some(batch) = source.next_batch().expect("layers") {
        given.extend(batch);
    }
    assert_eq!(given, even);
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let soup = [torus(40, 30, 5.0), cuboid([4.0, -1.0, 0.0], [9.0, 1.0, 3.0])].concat();
    let mesh = mesh(&soup);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| layers_of(&mesh, LayerHeights::even(0.02)))
    };
    let one = with(1);
    assert!(one.1.crossing_layers > 0);
    assert_eq!(one, with(5));
}

#[test]
fn bodies_that_all_overlap_are_refused_before_memory_is_spent() {
    // Boxes each shifted a little against the one before: every contour crosses every other.
    let heap = |count: u32| -> Soup {
        let corner = |k: u32| [f64::from(k) * 1e-3, f64::from(count - k) * 1e-3, 0.0];
        (0..count).flat_map(|k| cuboid(corner(k), [0, 1, 2].map(|a| corner(k)[a] + 5.0))).collect()
    };
    let (layers, sliced) = layers_of(&mesh(&heap(60)), LayerHeights::even(1.0));
    assert!(sliced.crossing_layers == 5 && layers[4].part.polygons.len() == 1);
    let mesh = mesh(&heap(800));
    let mut source = FromMesh::new(&mesh, LayerHeights::even(1.0)).expect("a mesh that can be begun");
    let message = source.next_batch().err().map(|e| e.to_string()).unwrap_or_default();
    assert!(
        message.starts_with("layer 0, 0.5 mm above the plate") && message.contains("repair"),
        "{message}"
    );
}

/// Triangles anywhere on a coarse grid: edges shared by chance, flat, upright, twice the same.
fn heap() -> impl Strategy<Value = Soup> {
    let at = || (0..6_u8, 0..6_u8, 0..6_u8).prop_map(|(x, y, z)| [x, y, z].map(|c| f64::from(c) * 0.2));
    prop::collection::vec([at(), at(), at()], 1..60)
}

fn is_sound(region: &Region) -> bool {
    let turns = |ring: &Ring, k: usize| ring.len() > 2 && (twice_area(ring) > 0) == (k == 0);
    region.polygons.iter().all(|p| p.rings.iter().enumerate().all(|(k, r)| turns(r, k)))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, ..ProptestConfig::default() })]

    #[test]
    fn no_heap_of_triangles_is_too_bad(soup in heap(), shared in any::<bool>()) {
        let mut mesh = mesh(&soup);
        if !shared {
            mesh.twins.fill(OPEN);
        }
        if let Ok(mut source) = FromMesh::new(&mesh, LayerHeights::even(0.13)) {
            for layer in source.next_batch().ok().flatten().unwrap_or_default() {
                prop_assert!(is_sound(&layer.part), "{layer:?}");
            }
        }
    }
}
