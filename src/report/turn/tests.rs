//! The page, read by a decoder of its own.
use super::*;
use crate::report::embed::testing::{inside, is_whole_and_alone, unpacked};
use crate::support::site::Reason;
use crate::support::tree::{GROUND, Kind};
use serde_json::json;

const CUBE: [[f64; 3]; 8] = [
    [0.0, 0.0, 5.0],
    [10.0, 0.0, 5.0],
    [10.0, 10.0, 5.0],
    [0.0, 10.0, 5.0],
    [0.0, 0.0, 15.0],
    [10.0, 0.0, 15.0],
    [10.0, 10.0, 15.0],
    [0.0, 10.0, 15.0],
];

const SIDES: [[u32; 3]; 12] = [
    [0, 2, 1],
    [0, 3, 2],
    [4, 5, 6],
    [4, 6, 7],
    [0, 1, 5],
    [0, 5, 4],
    [1, 2, 6],
    [1, 6, 5],
    [2, 3, 7],
    [2, 7, 6],
    [3, 0, 4],
    [3, 4, 7],
];

fn tree() -> Forest {
    let mut forest = Forest::default();
    let foot = forest.push([5.0, 5.0, 0.0], Kind::Plate, GROUND, 2.0);
    let joint = forest.push([5.0, 5.0, 2.5], Kind::Joint, foot, 0.6);
    forest.push([3.0, 5.0, 5.0], Kind::Tip, joint, 0.4);
    forest.push([7.0, 5.0, 5.0], Kind::Tip, joint, 0.4);
    let floor = forest.push([9.0, 9.0, 1.0], Kind::Model, GROUND, 0.4);
    forest.push([9.0, 9.0, 5.0], Kind::Tip, floor, 0.4);
    forest
}

fn need(at_mm: [f64; 3], area_mm2: f64, island: bool) -> Need {
    Need { at_mm, area_mm2, region: 0, island, under: None }
}

fn unheld(z: f64, area_mm2: f64, island: bool) -> Unheld {
    Unheld { place_mm: [1.0, 2.0, z], area_mm2, island, reason: Reason::Enclosed }
}

fn page(scene: &Scene<'_>) -> String {
    html(scene).expect("a page")
}

fn data(page: &str) -> Value {
    serde_json::from_str(inside(page, "scene")).expect("JSON")
}

const NOTHING: Scene<'_> =
    Scene { title: "a.stl", vertices: &[], triangles: &[], needs: &[], methods: &[], notes: &[] };

/// Reads by digits of base 128, not by shifts as the writer writes.
struct Digits<'a>(&'a [u8]);

impl Digits<'_> {
    fn number(&mut self) -> u64 {
        let end = self.0.iter().position(|b| *b < 128).expect("a last digit");
        let (digits, rest) = self.0.split_at(end + 1);
        self.0 = rest;
        digits.iter().rev().fold(0, |sum, digit| sum * 128 + u64::from(digit % 128))
    }

    fn signed(&mut self) -> i64 {
        let number = self.number() as i64;
        if number % 2 == 0 { number / 2 } else { -(number / 2) - 1 }
    }

    fn step(&mut self, last: &mut [i64; 3]) -> [i64; 3] {
        last.iter_mut().for_each(|c| *c += self.signed());
        *last
    }
}

#[test]
fn the_page_is_whole_and_alone() {
    let page = page(&NOTHING);
    is_whole_and_alone(&page, &["@TITLE@", "@STYLE@", "@SCENE@", "@SHAPES@", "@SCRIPTS@"], 2, SCRIPTS.len());
    assert_eq!(unpacked(inside(&page, "shapes")), [0, 0], "no triangles, no needs");
}

#[test]
fn shapes_come_back_from_the_page() {
    let needs = [need([5.0, 5.0, 5.0], 1.5, false), need([3.0, 5.0, 5.0], 0.25, true)];
    let forest = tree();
    let methods = [Method { name: "tree", forest: &forest, unheld: &[], figures: Value::Null }];
    let scene = Scene { vertices: &CUBE, triangles: &SIDES, needs: &needs, methods: &methods, ..NOTHING };
    let page = page(&scene);
    let data = data(&page);
    let number = |v: &Value| v.as_f64().expect("a number");
    let step = number(&data["step_mm"]);
    assert!(step <= 15.0 / 65535.0 + 1e-12);
    let origin = [0, 1, 2].map(|k| number(&data["origin_mm"][k]));
    let is_at = |at: [i64; 3], expect: [f64; 3]| {
        for k in 0..3 {
            assert!((0..=65535).contains(&at[k]));
            let off = origin[k] + at[k] as f64 * step - expect[k];
            assert!(off.abs() <= step * 0.5001, "{at:?} {expect:?}");
        }
    };
    let bytes = unpacked(inside(&page, "shapes"));
    let mut read = Digits(&bytes);
    assert_eq!(read.number(), 12);
    let (mut seen, mut last) = (Vec::new(), [0; 3]);
    for corner in SIDES.iter().flatten() {
        let age = read.number() as usize;
        if age == 0 {
            seen.push(read.step(&mut last));
        }
        let at = seen[seen.len() - age.max(1)];
        is_at(at, CUBE[*corner as usize]);
    }
    assert_eq!(seen.len(), 8);
    assert_eq!(read.number(), 2);
    last = [0; 3];
    for need in &needs {
        is_at(read.step(&mut last), need.at_mm);
        let area = read.number();
        assert_eq!((area / 2) as f64 / 1e4, need.area_mm2);
        assert_eq!(area % 2 == 1, need.island);
    }
    assert_eq!(read.number(), forest.nodes.len() as u64);
    last = [0; 3];
    for (k, node) in forest.nodes.iter().enumerate() {
        let kinds = [Kind::Tip, Kind::Joint, Kind::Plate, Kind::Model];
        assert_eq!(kinds[read.number() as usize], node.kind);
        is_at(read.step(&mut last), node.at_mm);
        assert!((read.number() as f64 * step - node.radius_mm).abs() <= step);
        match read.signed() {
            0 => assert_eq!(node.down, GROUND),
            step => assert_eq!(k as i64 + step, i64::from(node.down)),
        }
    }
    assert!(read.0.is_empty());
    assert_eq!(data["part"], json!({"count": 12, "of": 12, "cell_mm": 0.0}));
    assert_eq!(data["methods"][0]["nodes"], 6);
    // The foot is as wide as it is.
    assert_eq!(data["bounds_mm"], json!([[0.0, 0.0, 0.0], [10.0, 10.0, 15.0]]));
}

#[test]
fn words_are_only_text() {
    let name = "</script><script>alert(1)</script><!-- @SHAPES@ \u{2028}\".stl";
    let forest = tree();
    let figures = json!({"method": name, name: 1});
    let methods = [Method { name, forest: &forest, unheld: &[], figures }];
    let notes = [name.to_owned()];
    let page = page(&Scene { title: name, methods: &methods, notes: &notes, ..NOTHING });
    assert_eq!(page.matches("<script").count(), 2 + SCRIPTS.len());
    assert!(!page.contains("<!-- @SHAPES@"));
    let data = data(&page);
    assert_eq!(data["title"], name);
    assert_eq!(data["notes"][0], name);
    assert_eq!(data["methods"][0]["name"], name);
    assert_eq!(data["methods"][0]["figures"][name], 1);
}

#[test]
fn long_lists_begin_with_the_worst() {
    let forest = Forest::default();
    let list: Vec<Unheld> = (0..2000).map(|k| unheld(f64::from(k), f64::from(k % 700), k == 3)).collect();
    let figures = json!({ "words": "x".repeat(WORDS_MAX) });
    let method = Method { name: "tree", forest: &forest, unheld: &list, figures };
    let methods = vec![method; METHODS_MAX + 1];
    let notes = vec!["x".repeat(WORDS_MAX + 1)];
    let data = data(&page(&Scene { methods: &methods, notes: &notes, ..NOTHING }));
    assert_eq!(data["methods"].as_array().map(Vec::len), Some(METHODS_MAX));
    let method = &data["methods"][0];
    assert_eq!(method["totals"]["unheld"], 2000);
    assert_eq!(method["figures"], Value::Null);
    assert_eq!(data["notes"], json!([]));
    let shown = method["unheld"].as_array().expect("a list");
    assert_eq!(shown.len(), LISTED_MAX);
    assert_eq!(shown[0]["place_mm"], json!([1.0, 2.0, 3.0]), "the island first");
    assert_eq!(shown[1]["area_mm2"], 699.0);
    assert_eq!(shown[1]["reason"], Reason::Enclosed.words());
}

/// Small triangles everywhere: nothing that deflates well.
fn dust(count: u32) -> (Vec<[f64; 3]>, Vec<[u32; 3]>) {
    let mut state = 1_u64;
    let mut random = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / f64::from(1_u32 << 31)
    };
    let mut vertices = Vec::new();
    let triangles = (0..count).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    for _ in 0..count {
        let at = [0; 3].map(|_| 100.0 * random());
        vertices.extend((0..3).map(|_| at.map(|c| c + 0.3 * random())));
    }
    (vertices, triangles)
}

#[test]
fn parts_stay_small() {
    let (vertices, triangles) = dust(45_000);
    let grid = Grid::around(vertices.iter().copied());
    let check = |most: pack::Most| {
        let (bytes, kept) = pack::part(&grid, &vertices, &triangles, most).expect("bytes");
        assert_eq!(kept.of, 45_000);
        assert!((100..=most.triangles).contains(&kept.count), "{kept:?}");
        assert!(deflated(&bytes).expect("deflated").len() <= most.bytes);
        assert!(kept.cell_mm > 0.0);
    };
    check(pack::Most { triangles: 40_000, bytes: 1 << 30 });
    check(pack::Most { triangles: 100_000, bytes: 200_000 });
}

#[test]
fn pages_stay_small() {
    // As many bytes as each of these may take, and in base64.
    let most = pack::MOST.bytes + 15 * pack::NEEDS_MAX + 16 * NODES_MAX;
    assert!(most / 3 * 4 < 8_500_000);
    let (vertices, _) = dust(70_000);
    let needs: Vec<Need> = vertices.iter().map(|v| need(*v, v[0].fract() * 9.0, false)).collect();
    let area: f64 = needs.iter().map(|n| n.area_mm2).sum();
    let mut forest = Forest::default();
    for (k, v) in vertices.iter().take(NODES_MAX + 9).enumerate() {
        forest.push(*v, Kind::Joint, (k as u32).wrapping_mul(7919) % 100_000, v[1].fract());
    }
    let method = Method { name: "tree", forest: &forest, unheld: &[], figures: Value::Null };
    let methods = [method.clone(), method];
    let page = page(&Scene { needs: &needs, methods: &methods, ..NOTHING });
    assert!(page.len() < 4_000_000, "{}", page.len());
    let data = data(&page);
    let demand = &data["demand"];
    assert!(demand["count"].as_u64().is_some_and(|c| (1_000..=60_000).contains(&c)), "{demand}");
    assert_eq!(data["methods"][0]["nodes"], NODES_MAX);
    assert_eq!(data["methods"][1]["nodes"], 0);
    // What is gathered is not lost.
    let bytes = unpacked(inside(&page, "shapes"));
    let mut read = Digits(&bytes);
    assert_eq!(read.number(), 0);
    let mut last = [0; 3];
    let mut sum = 0.0;
    for _ in 0..read.number() {
        read.step(&mut last);
        sum += (read.number() / 2) as f64 / 1e4;
    }
    assert!((sum / area - 1.0).abs() < 1e-3, "{sum} of {area}");
}

#[test]
fn a_thinned_cube_is_a_cube() {
    // Each side of 40 × 40 squares.
    let count = 40_u32;
    let mut vertices = Vec::new();
    let mut triangles = Vec::new();
    for side in 0..6_u32 {
        let first = vertices.len() as u32;
        let axis = side as usize % 3;
        for k in 0..=count {
            for j in 0..=count {
                let mut at = [0.0; 3];
                at[axis] = if side < 3 { 0.0 } else { 10.0 };
                at[(axis + 1) % 3] = f64::from(k) / 4.0;
                at[(axis + 2) % 3] = f64::from(j) / 4.0;
                vertices.push(at);
            }
        }
        for k in 0..count * count {
            let at = first + k / count * (count + 1) + k % count;
            triangles.push([at, at + 1, at + count + 2]);
            triangles.push([at, at + count + 2, at + count + 1]);
        }
    }
    let cell = thin::cell_for(&vertices, &triangles, triangles.len() / 8);
    let (fewer, kept) = thin::gathered(&vertices, &triangles, cell);
    assert!((200..triangles.len() / 4).contains(&kept.len()), "{} of {}", kept.len(), triangles.len());
    let off = |v: &[f64; 3]| {
        let to_side = v.map(|c| c.min(10.0 - c));
        to_side.into_iter().fold(f64::INFINITY, f64::min)
    };
    assert!(fewer.iter().all(|v| off(v).abs() < cell));
}

#[test]
fn what_is_nowhere_is_left_out() {
    let vertices = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [f64::NAN, 0.0, f64::INFINITY]];
    let triangles = [[0, 1, 2], [0, 1, 3], [0, 1, 99]];
    let needs = [need([f64::NAN; 3], f64::NAN, true)];
    let data = data(&page(&Scene { vertices: &vertices, triangles: &triangles, needs: &needs, ..NOTHING }));
    assert_eq!(data["part"], json!({"count": 1, "of": 3, "cell_mm": 0.0}));
    assert_eq!(data["bounds_mm"][1], json!([1.0, 1.0, 0.0]));
}
