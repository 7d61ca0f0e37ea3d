//! Islands of whole meshes against a slow reference that shares no code with the project.
mod reference;

use outrigger::detect::island::{Found, Island};
use outrigger::detect::walk::{Ask, walk};
use outrigger::layers::from_mesh::{FromMesh, LayerHeights};
use reference::{Triangle, components, dilated, islands, layers, stl, triangles};
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// What the project finds.
fn found(bytes: &[u8], height_mm: f64) -> Found {
    let (mesh, _) = outrigger::mesh::read(&mut Cursor::new(bytes)).expect("a mesh");
    let mut layers = FromMesh::new(&mesh, LayerHeights::even(height_mm)).expect("layers");
    walk(&mut layers, &Ask::default(), &mut ()).expect("an end").islands
}

/// Whether two boxes come within a pixel or two of each other, mm.
fn meet(island: &Island, bounds: [i32; 4], pixel: f64) -> bool {
    let [low, high] = island.bbox_mm;
    let edge = |k: usize| f64::from(bounds[k]) * pixel;
    let reach = 2.0 * pixel;
    low[0] <= edge(2) + reach
        && edge(0) <= high[0] + reach
        && low[1] <= edge(3) + reach
        && edge(1) <= high[1] + reach
}

/// Islands that pixels show for sure: even with all borders a pixel farther out they
/// hang together with nothing below.
fn sure(layers: &[reference::Layer]) -> Vec<(usize, [i32; 4], i64)> {
    let wide: Vec<reference::Layer> = layers.iter().map(dilated).collect();
    let mut sure = Vec::new();
    for (number, pair) in wide.windows(2).enumerate() {
        let (component, count) = components(&pair[1]);
        let mut held = vec![false; count];
        for (run, c) in pair[1].iter().zip(&component) {
            let first = pair[0].partition_point(|r| (r.0, r.2) <= (run.0, run.1));
            held[*c] |= pair[0].get(first).is_some_and(|r| r.0 == run.0 && r.1 < run.2);
        }
        for c in (0..count).filter(|c| !held[*c]) {
            let mine = pair[1].iter().zip(&component).filter(|x| *x.1 == c).map(|x| x.0);
            let (mut bounds, mut pixels) = ([i32::MAX, i32::MAX, i32::MIN, i32::MIN], 0);
            for r in mine {
                let b = bounds;
                bounds = [b[0].min(r.1 + 1), b[1].min(r.0 + 1), b[2].max(r.2 - 1), b[3].max(r.0)];
                pixels += i64::from(r.2 - r.1);
            }
            sure.push((number + 1, bounds, pixels));
        }
    }
    sure
}

/// Compares a mesh with the reference. Gives the number of islands, of those that are
/// too thin for pixels, and of those whose end pixels see elsewhere.
fn compare(name: &str, bytes: &[u8], height_mm: f64, pixel: f64) -> [usize; 3] {
    let found = found(bytes, height_mm);
    let ours: Vec<&Island> = found.islands.iter().chain(&found.small).collect();
    let layers = layers(&triangles(bytes), height_mm, pixel);
    let theirs = islands(&layers);
    // None missed: what pixels show for sure is found, in that layer and place, or a layer
    // or two before as a tip that no pixel's centre lies in.
    for (layer, bounds, pixels) in sure(&layers) {
        let here = |i: &&&Island| i.layer as usize == layer && meet(i, bounds, pixel);
        let tip = |i: &&&Island| {
            let early = (i.layer as usize + 1..=i.layer as usize + 2).contains(&layer);
            early && i.end_layer as usize >= layer && i.area_mm2 < pixel * pixel && meet(i, bounds, pixel)
        };
        let hit = ours.iter().any(|i| here(&i) || tip(&i));
        // Pixels do not see what is thinner than they are, so a speck may hang on a thread.
        assert!(hit || pixels < 40, "{name}: layer {layer}, pixels {bounds:?}, {pixels}: missed");
    }
    // None invented, and followed to the same end: what is larger than a few pixels is there.
    let (mut thin, mut elsewhere) = (0, 0);
    for island in &ours {
        let same = |i: &&reference::Island| i.layer == island.layer as usize && meet(island, i.bounds, pixel);
        let hits: Vec<&reference::Island> = theirs.iter().filter(same).collect();
        let end = |i: &&reference::Island| {
            i.joins == island.joins && i.end_layer.abs_diff(island.end_layer as usize) <= 1
        };
        if hits.is_empty() {
            let side = |k: usize| island.bbox_mm[1][k] - island.bbox_mm[0][k];
            let is_thin = island.area_mm2 < 4.0 * pixel * side(0).max(side(1)).max(pixel);
            assert!(is_thin, "{name}: {island:?}: invented");
            thin += 1;
        } else if !hits.iter().any(end) {
            eprintln!("{name}: {island:?} ends elsewhere: {hits:?}");
            elsewhere += 1;
        } else if let [one] = hits.as_slice() {
            let side = |k: usize| island.bbox_mm[1][k] - island.bbox_mm[0][k];
            let area = one.pixels as f64 * pixel * pixel;
            let border = pixel * 4.0 * (side(0) + side(1) + pixel);
            assert!((area - island.area_mm2).abs() <= border, "{name}: {island:?} {one:?}");
        }
    }
    [ours.len(), thin, elsewhere]
}

fn models() -> Option<PathBuf> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    path.is_dir().then_some(path)
}

#[test]
fn real_meshes_have_the_islands_that_pixels_show() {
    let Some(models) = models() else { return };
    // Coarser where the tests are not optimized: they should not take long.
    let coarser = if cfg!(debug_assertions) { 2.6 } else { 1.0 };
    for (name, height_mm, untold) in REAL {
        let bytes = std::fs::read(models.join(name)).expect("a model");
        let [count, thin, elsewhere] = compare(name, &bytes, height_mm * coarser, 0.05);
        eprintln!("{name}: {count} islands, {thin} too thin for pixels, {elsewhere} end elsewhere");
        assert!(elsewhere as f64 <= untold * count as f64, "{name}: {elsewhere} of {count} islands");
    }
}

/// Models, layer heights such that no plane goes through a flat face, and the part of the
/// islands whose end pixels may see elsewhere: the lily's petals hang on threads.
const REAL: &[(&str, f64, f64)] = &[
    ("bunny-56200.stl", 0.23, 0.0),
    ("fertility.stl", 0.23, 0.0),
    ("lily-flower.stl", 0.13, 0.2),
    ("scorpion.stl", 0.23, 0.0),
    ("springer-knight.stl", 0.17, 0.0),
    ("nefertiti-bust.stl", 0.23, 0.0),
    ("prusa-extruder-body.stl", 0.23, 0.0),
    ("prusa-x-end-idler.stl", 0.23, 0.0),
    ("prusa-extruder-idler.stl", 0.13, 0.0),
    ("prusa-lcd-knob.stl", 0.13, 0.0),
    ("prusa-fs-lever.stl", 0.13, 0.0),
    ("calib-supporttest.stl", 0.23, 0.0),
    ("calib-overhangdouble.stl", 0.23, 0.0),
    ("voron0-b-idler-lower.stl", 0.23, 0.0),
    ("voron0-t8-nut-block.stl", 0.23, 0.0),
    ("islands-1.stl", 0.23, 0.0),
    ("islands-2.stl", 0.23, 0.0),
    ("wedges-1.stl", 0.23, 0.0),
];

#[test]
fn models_made_with_islands_have_these_and_no_others() {
    let Some(models) = models() else { return };
    for name in ["islands-1", "islands-2", "wedges-1", "wedges-2"] {
        let text = std::fs::read_to_string(models.join(format!("{name}.json"))).expect("what is in it");
        let truth: serde_json::Value = serde_json::from_str(&text).expect("JSON");
        let bytes = std::fs::read(models.join(format!("{name}.stl"))).expect("a model");
        let height_mm = 0.05;
        let found = found(&bytes, height_mm);
        let expected = truth["islands"].as_array().expect("islands");
        let number = |v: &serde_json::Value| v.as_f64().expect("a number");
        assert_eq!(found.islands.len(), expected.len(), "{name}");
        assert!(found.small.is_empty() && found.floating_aid.is_empty());
        for island in expected {
            let (x, y, z) = (number(&island["x"]), number(&island["y"]), number(&island["z"]));
            let near = |i: &&Island| (i.centroid_mm[0] - x).hypot(i.centroid_mm[1] - y) < 0.05;
            let hit = found.islands.iter().find(near).unwrap_or_else(|| panic!("{name}: {island}"));
            assert!(hit.z_mm > z && hit.z_mm <= z + height_mm, "{name}: {island} {hit:?}");
            assert!((hit.area_mm2 / number(&island["area"]) - 1.0).abs() < 0.002, "{island} {hit:?}");
            let roof = number(&truth["roof_underside_z"]);
            assert!(hit.joins && hit.end_z_mm > roof && hit.end_z_mm <= roof + height_mm, "{hit:?}");
        }
    }
}

/// A block between two corners.
fn block(low: [f64; 3], high: [f64; 3]) -> Vec<Triangle> {
    let corner = |k: usize| [0, 1, 2].map(|axis| if k >> axis & 1 == 0 { low[axis] } else { high[axis] });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]];
    let two = |q: [usize; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]];
    quads.into_iter().flat_map(two).map(|t| t.map(corner)).collect()
}

/// A ball.
fn ball(centre: [f64; 3], radius: f64) -> Vec<Triangle> {
    let (around, up) = (24, 12);
    let at = |i: usize, k: usize| {
        let (turn, rise) = (
            std::f64::consts::TAU * (i % around) as f64 / around as f64,
            std::f64::consts::PI * (k as f64 / up as f64 - 0.5),
        );
        let flat = if k == 0 || k == up { 0.0 } else { rise.cos() };
        [
            centre[0] + radius * flat * turn.cos(),
            centre[1] + radius * flat * turn.sin(),
            centre[2] + radius * rise.sin(),
        ]
    };
    let mut triangles = Vec::new();
    for k in 0..up {
        for i in 0..around {
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            if k > 0 {
                triangles.push([a, b, c]);
            }
            if k + 1 < up {
                triangles.push([a, c, d]);
            }
        }
    }
    triangles
}

/// Turned inside out: a cavity.
fn cavity(triangles: Vec<Triangle>) -> Vec<Triangle> {
    triangles.into_iter().map(|[a, b, c]| [a, c, b]).collect()
}

/// Layers of 0.25 mm; expected are (appears, ends, joins), by layer and then by place.
fn check(name: &str, parts: &[Vec<Triangle>], expect: &[(u32, u32, bool)]) {
    let bytes = stl(&parts.concat());
    let found = found(&bytes, 0.25);
    let got: Vec<_> = found.islands.iter().map(|i| (i.layer, i.end_layer, i.joins)).collect();
    assert_eq!(got, expect, "{name}");
    assert_eq!(compare(name, &bytes, 0.25, 0.03), [expect.len(), 0, 0], "{name}");
}

#[test]
fn made_meshes_have_the_islands_that_they_should() {
    let post = || block([0.0, 0.0, 0.0], [2.0, 2.0, 6.0]);
    let roof = || block([0.0, 0.0, 5.0], [9.0, 2.0, 6.0]);
    check(
        "a pillar that hangs",
        &[post(), roof(), block([6.0, 0.5, 2.0], [8.0, 1.5, 5.5])],
        &[(8, 20, true)],
    );
    check("an arch", &[post(), roof(), block([7.0, 0.0, 0.0], [9.0, 2.0, 6.0])], &[]);
    check("a ball that hangs", &[post(), roof(), ball([6.0, 1.0, 4.2], 1.01)], &[(13, 20, true)]);
    check("one layer", &[post(), roof(), block([4.0, 0.5, 2.0], [6.0, 1.5, 2.25])], &[(8, 8, false)]);
    let legs = [block([4.0, 0.5, 1.0], [5.0, 1.5, 3.5]), block([6.0, 0.5, 2.0], [7.0, 1.5, 3.5])];
    let beam = block([3.9, 0.4, 3.0], [7.1, 1.6, 4.0]);
    let stem = block([5.0, 0.6, 3.5], [6.0, 1.4, 5.5]);
    check(
        "two that meet before they meet the body",
        &[post(), roof(), legs[0].clone(), legs[1].clone(), beam, stem],
        &[(4, 20, true), (8, 20, true)],
    );
    let box_of = |low: f64, high: f64| block([low, low, low], [high, high, high]);
    let (shell, hollow) = (block([0.0; 3], [10.0; 3]), cavity(box_of(1.0, 9.0)));
    check(
        "a ball in a shell",
        &[shell.clone(), hollow.clone(), ball([5.0, 5.0, 5.0], 2.02)],
        &[(12, 27, false)],
    );
    check(
        "a shell in a shell",
        &[shell, hollow, box_of(2.0, 8.0), cavity(box_of(3.0, 7.0)), ball([5.0, 5.0, 5.0], 1.01)],
        &[(8, 31, false), (16, 23, false)],
    );
    let outside = block([0.0; 3], [10.0, 10.0, 8.0]);
    check(
        "a peg in a hole",
        &[outside, cavity(block([1.0, 1.0, 0.0], [9.0, 9.0, 6.0])), block([4.0, 4.0, 2.0], [6.0, 6.0, 7.0])],
        &[(8, 24, true)],
    );
    let base = || block([0.0; 3], [2.0, 2.0, 2.0]);
    check("an edge only", &[base(), block([2.0, 0.0, 2.0], [4.0, 2.0, 4.0])], &[(8, 15, false)]);
    check("a vertex only", &[base(), block([2.0, 2.0, 2.0], [4.0, 4.0, 4.0])], &[(8, 15, false)]);
    check("a corner over", &[base(), block([1.9, 1.9, 2.0], [4.0, 4.0, 4.0])], &[]);
}
