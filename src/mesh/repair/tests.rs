//! Bodies damaged as files are, and mended: closed, of their old volume, and counted.
use crate::mesh::report::Mended;
use crate::mesh::sample::{Soup, assert_sound, ball, block, torus};
use crate::mesh::{Mesh, MeshError, read};
use proptest::prelude::*;
use std::io::Cursor;

/// Mends, and holds that the mesh is sound and what was mended.
fn check(name: &str, soup: &Soup, volume_mm3: Option<f64>, expect: Mended) -> Mesh {
    let (mesh, mended) = soup.mended();
    assert_sound(&mesh, &mended);
    match (mended.volume_mm3, volume_mm3) {
        (Some(found), Some(expect)) => {
            assert!((found - expect).abs() < 1e-4 * expect, "{name}: {found} mm³, not {expect}");
            assert!((found - mesh.volume_mm3()).abs() < 1e-6 * expect, "{name}: {found} by shells");
        }
        (found, expect) => assert_eq!(found, expect, "{name}"),
    }
    let counts = Mended { area_mm2: mended.area_mm2, volume_mm3: mended.volume_mm3, ..expect };
    assert_eq!(mended, counts, "{name}");
    mesh
}

/// Of one closed shell that needs no mending.
const CLEAN: Mended = Mended {
    degenerate_triangles: 0,
    duplicate_triangles: 0,
    opposite_triangles: 0,
    welded_vertices: 0,
    split_edges: 0,
    flipped_triangles: 0,
    filled_holes: 0,
    filling_triangles: 0,
    turned_shells: 0,
    shells: 1,
    open_shells: 0,
    cavities: 0,
    open_edges: 0,
    crowded_edges: 0,
    area_mm2: 0.0,
    volume_mm3: None,
};

fn cube(x: f64) -> Soup {
    block([x, 0.0, 0.0], [10.0; 3])
}

#[test]
fn whole_bodies_stay_as_they_are() {
    check("block", &cube(0.0), Some(1000.0), CLEAN);
    check("two", &cube(0.0).and(cube(20.0)), Some(2000.0), Mended { shells: 2, ..CLEAN });
    let crossing = cube(0.0).and(cube(5.0));
    check("crossing", &crossing, Some(2000.0), Mended { shells: 2, ..CLEAN });
}

#[test]
fn duplicates_are_left_out() {
    let twice = cube(0.0).and(cube(0.0));
    check("twice", &twice, Some(1000.0), Mended { duplicate_triangles: 12, ..CLEAN });
    let two_sided = cube(0.0).and(cube(0.0).inverted());
    check("two-sided", &two_sided, Some(1000.0), Mended { duplicate_triangles: 12, ..CLEAN });
    let mut one = cube(0.0);
    one.0.extend(vec![one.0[3]; 5]);
    check("one five times more", &one, Some(1000.0), Mended { duplicate_triangles: 5, ..CLEAN });
}

#[test]
fn a_wall_between_two_bodies_is_no_air() {
    // The second block mirrored in x, so that the diagonals of the common face agree.
    let mirrored = Soup(cube(-20.0).0.iter().map(|t| t.map(|[x, y, z]| [-x, y, z])).collect()).inverted();
    let side_by_side = cube(0.0).and(mirrored);
    check("side by side", &side_by_side, Some(2000.0), Mended { opposite_triangles: 4, ..CLEAN });
    // The diagonals differ: no triangle has an opposite, and each body stays whole.
    let touching = cube(0.0).and(cube(10.0));
    check("touching", &touching, Some(2000.0), Mended { shells: 2, crowded_edges: 4, ..CLEAN });
}

#[test]
fn bodies_that_touch_in_an_edge_stay_apart() {
    let two = cube(0.0).and(block([10.0, 10.0, 0.0], [10.0; 3]));
    check("edge", &two, Some(2000.0), Mended { shells: 2, crowded_edges: 1, ..CLEAN });
    let vertex = cube(0.0).and(block([10.0; 3], [10.0; 3]));
    check("vertex", &vertex, Some(2000.0), Mended { shells: 2, ..CLEAN });
    let all_inside_out = two.inverted();
    // Wound the wrong way it is the air that the edge keeps apart: one shell is turned, two come out.
    check(
        "inside out",
        &all_inside_out,
        Some(2000.0),
        Mended { shells: 2, crowded_edges: 1, turned_shells: 1, ..CLEAN },
    );
}

#[test]
fn shells_face_outward_unless_they_are_cavities() {
    let inner = |x: f64, size: f64| block([x; 3], [size; 3]);
    check("inside out", &cube(0.0).inverted(), Some(1000.0), Mended { turned_shells: 1, ..CLEAN });
    let beside = cube(0.0).and(cube(20.0).inverted());
    check("beside", &beside, Some(2000.0), Mended { turned_shells: 1, shells: 2, ..CLEAN });
    let hollow = cube(0.0).and(inner(2.0, 6.0).inverted());
    let two = Mended { shells: 2, cavities: 1, ..CLEAN };
    check("hollow", &hollow, Some(784.0), two);
    check(
        "hollow, all inside out",
        &hollow.clone().inverted(),
        Some(784.0),
        Mended { turned_shells: 2, ..two },
    );
    let three = hollow.clone().and(inner(4.0, 2.0));
    check("a body in a hollow", &three, Some(792.0), Mended { shells: 3, ..two });
    let wrong = hollow.and(inner(4.0, 2.0).inverted());
    check("inside out in a hollow", &wrong, Some(792.0), Mended { shells: 3, turned_shells: 1, ..two });
    check(
        "three, all inside out",
        &three.inverted(),
        Some(792.0),
        Mended { shells: 3, turned_shells: 3, ..two },
    );
    let within = cube(0.0).and(inner(2.0, 6.0)).inverted();
    check(
        "one within another, inside out",
        &within,
        Some(1216.0),
        Mended { shells: 2, turned_shells: 2, ..CLEAN },
    );
}

#[test]
fn triangles_are_turned_as_their_neighbours_face() {
    let mut soup = torus([0.0; 3], [10.0, 3.0], 24, 12);
    let volume = soup.mesh().volume_mm3();
    for t in [0, 1, 2, 77, 300] {
        soup.0[t].swap(0, 1);
    }
    check("five", &soup, Some(volume), Mended { flipped_triangles: 5, ..CLEAN });
    for t in &mut soup.0[100..500] {
        t.swap(0, 1);
    }
    let (mesh, mended) = soup.mended();
    assert_sound(&mesh, &mended);
    assert!((mesh.volume_mm3() - volume).abs() < 1e-9 * volume && mended.open_edges == 0, "{mended:?}");
}

#[test]
fn a_strip_with_one_side_stays_open() {
    let n = 40;
    let v = |i: usize, side: f64| {
        let turn = i as f64 / n as f64 * std::f64::consts::TAU;
        let (r, z) = (10.0 + side * (turn / 2.0).cos(), side * (turn / 2.0).sin());
        [(r * turn.cos()) as f32, (r * turn.sin()) as f32, z as f32]
    };
    let mut soup = Soup::default();
    for i in 0..n {
        // The last joins the first with its sides exchanged.
        let (a, b) = (v(i, -2.0), v(i, 2.0));
        let (c, d) = if i + 1 < n { (v(i + 1, -2.0), v(i + 1, 2.0)) } else { (v(0, 2.0), v(0, -2.0)) };
        soup.0.extend([[a, c, d], [a, d, b]]);
    }
    let (mesh, mended) = soup.mended();
    assert_sound(&mesh, &mended);
    assert_eq!((mended.shells, mended.open_edges), (1, 2 * n as u64 + 2));
}

#[test]
fn small_holes_are_filled_and_large_ones_told() {
    let whole = ball([5.0; 3], 10.0, 32, 16);
    let volume = whole.mesh().volume_mm3();
    let mut one = whole.clone();
    one.0.remove(200);
    check("one triangle", &one, Some(volume), Mended { filled_holes: 1, filling_triangles: 1, ..CLEAN });
    let mut several = whole.clone();
    several.0.drain(300..306);
    let (mesh, mended) = several.mended();
    assert_sound(&mesh, &mended);
    assert!(
        mended.is_closed() && mended.filled_holes > 0 && (mesh.volume_mm3() - volume).abs() < 2e-3 * volume,
        "{mended:?}"
    );
    let mut lidless = cube(0.0);
    lidless.0.drain(2..4);
    check("no lid", &lidless, None, Mended { open_edges: 4, open_shells: 1, ..CLEAN });
    check(
        "no lid, inside out",
        &lidless.inverted(),
        None,
        Mended { open_edges: 4, open_shells: 1, turned_shells: 1, ..CLEAN },
    );
    let sheet = Soup(vec![[[0.0; 3], [9.0, 0.0, 0.0], [0.0, 9.0, 1.0]]]);
    check("one triangle alone", &sheet, None, Mended { open_edges: 3, open_shells: 1, ..CLEAN });
}

#[test]
fn holes_that_share_a_vertex_are_two() {
    let mut soup = torus([0.0; 3], [10.0, 3.0], 24, 12);
    let volume = soup.mesh().volume_mm3();
    // The first triangles of two quadrilaterals that meet in a corner only.
    soup.0.remove(2 * 13);
    soup.0.remove(0);
    check("two", &soup, Some(volume), Mended { filled_holes: 2, filling_triangles: 2, ..CLEAN });
}

#[test]
fn a_row_of_holes_that_cuts_a_body_in_bands_is_filled() {
    let (n, m) = (24, 12);
    let whole = torus([0.0; 3], [10.0, 3.0], n, m);
    let volume = whole.mesh().volume_mm3();
    let rows = |rows: &[usize]| {
        let lost = |k: &usize| k.is_multiple_of(2) && rows.contains(&(k / 2 % m));
        Soup((0..whole.0.len()).filter(|k| !lost(k)).map(|k| whole.0[k]).collect())
    };
    let filled = |count: u64| Mended { filled_holes: count, filling_triangles: count, ..CLEAN };
    check("one row", &rows(&[3]), Some(volume), filled(24));
    check("two rows", &rows(&[0, 5]), Some(volume), filled(48));
    // Three holes at every vertex between, and the triangles of the first row hang on nothing.
    check("two rows side by side", &rows(&[3, 4]), Some(volume), filled(48));
    let star = |k: usize| {
        k.is_multiple_of(2) && [3, 4, 5].contains(&(k / 2 % m)) && [3, 4, 5].contains(&(k / 2 / m))
    };
    let nine = Soup((0..whole.0.len()).filter(|&k| !star(k)).map(|k| whole.0[k]).collect());
    check("nine in a square", &nine, Some(volume), filled(9));
}

#[test]
fn edges_are_split_where_vertices_lie_on_them() {
    // The top of a block in pieces of a fifth by a seventh, the sides in one.
    let mut soup = cube(0.0);
    soup.0.drain(2..4);
    let place = |i: u32, j: u32| [(i * 2) as f32, (f64::from(j) * 10.0 / 7.0) as f32, 10.0];
    for i in 0..5 {
        for j in 0..7 {
            soup.0.push([place(i, j), place(i + 1, j), place(i + 1, j + 1)]);
            soup.0.push([place(i, j), place(i + 1, j + 1), place(i, j + 1)]);
        }
    }
    check("top", &soup, Some(1000.0), Mended { split_edges: 2 * (4 + 6), ..CLEAN });
}

#[test]
fn rims_that_nearly_meet_are_joined() {
    let mut soup = cube(0.0);
    for (k, corners) in soup.0.iter_mut().enumerate() {
        let off = 1e-6 * (k % 3) as f32;
        corners.iter_mut().for_each(|v| v[0] += off);
    }
    let (mesh, mended) = soup.mended();
    assert_sound(&mesh, &mended);
    assert!(mesh.vertices.len() == 8 && mended.welded_vertices > 0 && mended.is_closed(), "{mended:?}");
    assert!((mesh.volume_mm3() - 1000.0).abs() < 0.01);
}

#[test]
fn lines_and_points_are_left_out_where_they_join_nothing() {
    let mut soup = cube(0.0);
    soup.0.push([[3.0; 3]; 3]);
    soup.0.push([[0.0; 3], [1.0; 3], [1.0; 3]]);
    soup.0.push([[20.0, 0.0, 0.0], [21.0, 0.0, 0.0], [22.0, 0.0, 0.0]]);
    check("three", &soup, Some(1000.0), Mended { degenerate_triangles: 3, ..CLEAN });
    let line = Soup(vec![[[0.0; 3], [1.0; 3], [2.0; 3]], [[0.0; 3], [1.0; 3], [1.0; 3]]]);
    let error = read(&mut Cursor::new(line.file())).expect_err("no area");
    assert!(matches!(error, MeshError::NoArea { triangles: 2 }), "{error}");
}

#[test]
fn files_made_to_take_long_do_not() {
    // All triangles on one edge, none with another's third corner.
    let n = 20_000;
    let fan = |k: u32| {
        let turn = f64::from(k) / f64::from(n) * std::f64::consts::TAU;
        [turn.cos() as f32, turn.sin() as f32, 0.5]
    };
    let one_edge = Soup((0..n).map(|k| [[0.0; 3], [0.0, 0.0, 1.0], fan(k)]).collect());
    assert_eq!(one_edge.mended().1.crowded_edges, 1);
    // One triangle over and over, both ways.
    let t = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]];
    let same = Soup((0..n).map(|k| if k % 2 == 0 { t } else { [t[1], t[0], t[2]] }).collect());
    assert_eq!(same.mended().1.duplicate_triangles, u64::from(n) - 1);
    // Every open edge crosses all others: long needles through one cell.
    let star = |k: u32| fan(k).map(|c| c * 100.0);
    let needles = Soup((0..n / 5).map(|k| [star(k), star(k).map(|c| -c), [0.0, 0.0, k as f32]]).collect());
    assert!(needles.mended().1.open_edges > 0);
    // Shells within shells, all inside out.
    let nested =
        (1..300).fold(Soup::default(), |s, k| s.and(block([-f64::from(k); 3], [2.0 * f64::from(k); 3])));
    assert_eq!(nested.inverted().mended().1.turned_shells, 299);
}

/// What happens to a body on its way into a file.
#[derive(Clone, Debug)]
enum Damage {
    /// The triangle is missing.
    Lost(usize),
    /// It faces the other way.
    Flipped(usize),
    /// It is there twice.
    Twice(usize),
    /// It is cut in two at an edge's middle; its neighbour is not.
    Cut(usize),
    /// One of its corners is off by a rounding.
    Off(usize, f32),
}

fn damage() -> impl Strategy<Value = Damage> {
    let at = any::<usize>();
    prop_oneof![
        at.prop_map(Damage::Lost),
        at.prop_map(Damage::Flipped),
        at.prop_map(Damage::Twice),
        at.prop_map(Damage::Cut),
        (any::<usize>(), -1e-6_f32..1e-6).prop_map(|(k, off)| Damage::Off(k, off)),
    ]
}

/// Damages triangles of a body, none twice and no neighbours of each other by number;
/// of a block's twelve only the first, since two that are gone leave a hole that may be meant.
fn damaged(mut soup: Soup, damages: &[Damage]) -> Soup {
    let whole = soup.0.len();
    let mut lost = vec![false; whole];
    let mut touched = vec![false; whole / 16 + 1];
    for damage in damages {
        let (Damage::Lost(k) | Damage::Flipped(k) | Damage::Twice(k) | Damage::Cut(k) | Damage::Off(k, _)) =
            damage;
        let k = k % whole / 16 * 16;
        if std::mem::replace(&mut touched[k / 16], true) {
            continue;
        }
        let [a, b, c] = soup.0[k];
        match damage {
            Damage::Lost(_) => lost[k] = true,
            Damage::Flipped(_) => soup.0[k] = [b, a, c],
            Damage::Twice(_) => soup.0.push([a, b, c]),
            Damage::Cut(_) => {
                let middle = [0, 1, 2].map(|i| (a[i] + b[i]) / 2.0);
                soup.0[k] = [a, middle, c];
                soup.0.push([middle, b, c]);
            }
            Damage::Off(_, off) => soup.0[k][0][0] += off,
        }
    }
    let mut kept = lost.iter().map(|l| !l).chain(std::iter::repeat(true));
    soup.0.retain(|_| kept.next().unwrap_or(true));
    soup
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Whatever happens to a few triangles, the body comes back closed, with its volume.
    #[test]
    fn damaged_bodies_come_back(
        kind in 0..3,
        damages in prop::collection::vec(damage(), 1..9),
        order in any::<u64>(),
        inside_out in any::<bool>(),
    ) {
        let whole = match kind {
            0 => torus([20.0, 0.0, 5.0], [10.0, 4.0], 20, 12),
            1 => ball([-3.0; 3], 8.0, 20, 12),
            _ => block([0.0; 3], [4.0, 5.0, 6.0]).and(torus([20.0, 0.0, 5.0], [10.0, 4.0], 16, 12)),
        };
        let volume = whole.mesh().volume_mm3();
        let mut soup = damaged(whole, &damages);
        if inside_out {
            soup = soup.inverted();
        }
        soup.0.sort_by_key(|t| t[0][0].to_bits().wrapping_mul(order as u32 | 1).rotate_left((order >> 32) as u32));
        let (mesh, mended) = soup.mended();
        assert_sound(&mesh, &mended);
        prop_assert!(mended.is_closed(), "{mended:?}");
        prop_assert!((mesh.volume_mm3() - volume).abs() < 0.01 * volume, "{} {volume} {mended:?}", mesh.volume_mm3());
    }

    /// Whatever triangles there are, the mesh is sound.
    #[test]
    fn any_triangles_give_a_sound_mesh(
        corners in prop::collection::vec(prop::array::uniform3(prop::array::uniform3(0_u8..4)), 1..60),
    ) {
        let soup = Soup(corners.into_iter().map(|t| t.map(|v| v.map(f32::from))).collect());
        if let Ok((mesh, report)) = read(&mut Cursor::new(soup.file())) {
            assert_sound(&mesh, &report.mended);
        }
    }
}
