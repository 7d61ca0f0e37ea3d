use super::*;
use crate::layers::from_gcode::{self, Facts};
use crate::layers::polygon::{difference, grow, union_all};
use crate::layers::stack::{Layer as Slab, Layers as _};
use crate::merge::gcode::survey::Surveyor;
use crate::merge::gcode::told::Told;
use crate::merge::testing::{
    Column, Columns, OwnBead, around_the_bench, column, corpus, merged, part_beads, plain, same_beads,
};
use crate::support::section::Section;
use outrigger_gcode::dialect::Dialect;
use outrigger_gcode::line::{parse, split_lines};
use outrigger_gcode::state::{Effect, Kind, Machine};

fn slabs(text: &[u8]) -> (Vec<Slab>, Facts) {
    let mut layers =
        from_gcode::read(outrigger_gcode::bgcode::text(text), &from_gcode::Options::default()).unwrap();
    let mut all = Vec::new();
    while let Some(batch) = layers.next_batch().unwrap() {
        all.extend(batch);
    }
    (all, layers.facts().clone())
}

/// The supports appear where they were planned, the part is what it was, and the filament adds up.
fn check(name: &str) {
    let input = corpus(name);
    let sections = around_the_bench();
    let options = Options::default();
    let (output, report) = merged(&input, &sections, &options).unwrap_or_else(|e| panic!("{name}: {e}"));
    let (before, facts) = slabs(&input);
    let (after, facts_after) = slabs(&output);
    assert_eq!(before.len(), after.len(), "{name}");
    for (old, new) in before.iter().zip(&after) {
        assert_eq!(old.part, new.part, "{name}: the part at {}", old.top_mm);
        let planned = sections.section(old.bottom_mm, old.top_mm);
        let planned = union_all([&planned.body, &planned.interface]);
        // Beads are read back a little wider than they are, and reach over gaps of two layers
        // and a quarter where a branch ends or tapers; the fill is sparse.
        let added = difference(&new.aid, &old.aid);
        let near = old.top_mm - old.bottom_mm;
        let around = (-3..=3).map(|k| f64::from(k) * near).filter(|dz| old.bottom_mm + dz > -1e-9);
        let around: Vec<Section> =
            around.map(|dz| sections.section(old.bottom_mm + dz, old.top_mm + dz)).collect();
        let around = union_all(around.iter().flat_map(|s| [&s.body, &s.interface]));
        let beyond = difference(&added, &grow(&around, 0.06));
        assert!(beyond.area_mm2() < 0.02, "{name}: {} mm² beyond at {}", beyond.area_mm2(), old.top_mm);
        let rim = difference(&planned, &grow(&planned, -0.6));
        let bare = difference(&rim, &union_all([&new.aid]));
        assert!(
            bare.area_mm2() <= 0.1 * rim.area_mm2(),
            "{name}: {} of {} bare at {}",
            bare.area_mm2(),
            rim.area_mm2(),
            old.top_mm
        );
    }
    let (text, text_after) = (plain(&input), plain(&output));
    let ((own, all), (own_after, all_after)) = (part_beads(&text), part_beads(&text_after));
    same_beads(name, &own, &own_after);
    assert!(
        (all_after - all - report.filament_mm).abs() < 0.01,
        "{name}: {all_after} {all} {}",
        report.filament_mm
    );
    let more = facts_after.extruded_mm3 - facts.extruded_mm3;
    assert!((more / report.volume_mm3 - 1.0).abs() < 0.01, "{name}: {more} {}", report.volume_mm3);
    let longest = split_lines(&text_after).map(|l| memchr::memchr(b';', l).unwrap_or(l.len())).max();
    let longest_before = split_lines(&text).map(|l| memchr::memchr(b';', l).unwrap_or(l.len())).max();
    assert!(longest.unwrap_or(0) <= longest_before.unwrap_or(0).max(81), "{name}");
    assert_eq!(
        report.layers_supported,
        before.iter().filter(|l| l.bottom_mm < 4.5 - 0.15).count() as u32,
        "{name}"
    );
    assert_eq!(report.clipped_by_part.layers, 0, "{name}: {:?}", report.clipped_by_part);
    assert_eq!(report.missing_top_mm, 0.0, "{name}");
}

#[test]
fn prusaslicer_with_relative_e() {
    check("ps25-marlin-rel-triangles.gcode");
}

#[test]
fn prusaslicer_with_absolute_e() {
    check("ps25-marlin-abs-grid.gcode");
}

#[test]
fn prusaslicer_with_wipes_and_z_hops() {
    check("ps25-marlin-wipe-zhop-honeycomb.gcode");
}

#[test]
fn prusaslicer_with_firmware_retraction() {
    check("ps25-marlin2-fwretract-rectilinear.gcode");
}

#[test]
fn prusaslicer_with_comments_on_every_move() {
    check("ps25-marlin-comments.gcode");
}

#[test]
fn klipper_with_macros() {
    check("ps25-klipper-gyroid.gcode");
}

#[test]
fn cura_with_absolute_and_relative_e() {
    check("cura413-marlin-zhop-triangles.gcode");
    check("cura413-marlin-rel-cubic.gcode");
}

#[test]
fn slic3r_with_inline_comments() {
    check("slic3r13-rel-comments.gcode");
}

#[test]
fn bambus_dialect() {
    check("remarked-bambu.gcode");
}

#[test]
fn binary_stays_binary() {
    check("ps25-marlin-abs-grid.bgcode");
}

#[test]
fn the_same_job_twice_is_the_same_text() {
    let input = corpus("demo.gcode");
    let sections = Columns(vec![column(20.0, 20.0, 2.0, 7.0), column(110.0, 150.0, 1.0, 3.0)]);
    let one = merged(&input, &sections, &Options::default()).unwrap();
    assert_eq!(one, merged(&input, &sections, &Options::default()).unwrap());
    assert!(one.0.len() > input.len() && one.1.layers_supported > 20);
}

#[test]
fn nothing_to_print_changes_nothing() {
    for name in ["demo.gcode", "ps25-marlin-abs-grid.bgcode"] {
        let input = corpus(name);
        let (output, report) = merged(&input, &Columns(Vec::new()), &Options::default()).unwrap();
        // Binary blocks may be cut elsewhere.
        assert_eq!(plain(&output), plain(&input), "{name}");
        assert_eq!((report.layers_supported, report.paths, report.filament_mm), (0, 0, 0.0));
    }
}

#[test]
fn supports_keep_from_part_skirt_prime_line_and_the_plates_border() {
    let check = |name: &str, sections: Columns, clipped: [bool; 3]| {
        let input = corpus(name);
        let (_, report) =
            merged(&input, &sections, &Options::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        let causes = [report.clipped_by_part, report.clipped_by_aids, report.clipped_by_bed];
        assert_eq!(causes.map(|c| c.layers > 0), clipped, "{name}: {report:?}");
        for cause in causes.iter().filter(|c| c.layers > 0) {
            assert!(cause.area_mm2 > 0.1 && cause.first_z_mm > 0.0, "{cause:?}");
        }
        report
    };
    let name = "ps25-marlin-rel-triangles.gcode";
    // Beside a foot, with its edge in the foot's wall.
    let report = check(name, Columns(vec![column(106.0, 110.0, 2.5, 1.5)]), [true, false, false]);
    assert!(report.clipped_by_part.first_layer == 1, "{report:?}");
    // Over the skirt: in the first layer only.
    let report = check(name, Columns(vec![column(95.6, 110.0, 1.5, 4.0)]), [false, true, false]);
    assert_eq!(report.clipped_by_aids.layers, 1);
    check(name, Columns(vec![column(220.0, 50.0, 2.0, 4.0)]), [false, false, true]);
    // Cura's prime line stands 0.28 mm high; its plate is not told.
    let report = check(
        "cura413-marlin-zhop-triangles.gcode",
        Columns(vec![column(10.1, 80.0, 2.0, 4.0)]),
        [false, true, false],
    );
    assert_eq!(report.clipped_by_aids.layers, 2);
    let input = corpus("cura413-marlin-zhop-triangles.gcode");
    let bed = Some(Columns(vec![column(110.0, 110.0, 100.0, 1.0)]).section(0.0, 0.2).body);
    let far = Columns(vec![column(209.0, 110.0, 2.0, 2.0)]);
    let (_, report) = merged(&input, &far, &Options { bed, ..Options::default() }).unwrap();
    assert!(report.clipped_by_bed.layers > 5, "{report:?}");
}

#[test]
fn travels_over_supports_go_above_them() {
    for name in [
        "ps25-marlin-rel-triangles.gcode",
        "ps25-marlin-abs-grid.gcode",
        "ps25-marlin2-fwretract-rectilinear.gcode",
        "cura413-marlin-rel-cubic.gcode",
        "cura413-marlin-zhop-triangles.gcode",
        "cura413-marlin-fwretract-two-meshes.gcode",
    ] {
        let input = corpus(name);
        // Between the bench's feet; where the two meshes are, between those of each.
        let x = if name.contains("two") { 95.3 } else { 110.0 };
        let sections = Columns([105.0, 107.5, 110.0, 112.5, 115.0].map(|y| column(x, y, 1.3, 1.9)).to_vec());
        let (output, report) =
            merged(&input, &sections, &Options::default()).unwrap_or_else(|e| panic!("{name}: {e}"));
        // One lifts all its long travels itself.
        assert!(report.travels_lifted > 0 || name.contains("zhop"), "{name}: {report:?}");
        // By a reader of its own: nothing without filament moves over a column at its height.
        let mut machine = Machine::default();
        let (mut support, mut printed) = (false, 0.0);
        for bytes in split_lines(&output) {
            let line = parse(bytes);
            let comment = String::from_utf8_lossy(line.comment).to_lowercase();
            if comment.starts_with(";type:") {
                support = comment.contains("support");
            }
            let Effect::Motion(m) = machine.apply(&line) else { continue };
            if support && m.kind() == Kind::Deposit {
                printed = m.to[2];
            }
            if support || m.kind() != Kind::Travel || m.from[2].min(m.to[2]) > printed + 0.01 {
                continue;
            }
            let way = [[m.from[0], m.from[1]], [m.to[0], m.to[1]]];
            for column in &sections.0 {
                let gap = cross::to_segment_mm(column.at, way);
                assert!(
                    gap > column.radii_mm[0],
                    "{name}: {} over {:?}",
                    String::from_utf8_lossy(bytes),
                    column.at
                );
            }
        }
    }
}

#[test]
fn what_cannot_take_supports_is_refused_with_a_reason() {
    let sections = around_the_bench();
    let check = |input: &[u8], expect: &str| match merged(input, &sections, &Options::default()) {
        Err(Failure::Refused(refusal)) => {
            assert!(refusal.to_string().contains(expect), "{refusal} / {expect}")
        }
        other => panic!("{other:?} instead of {expect}"),
    };
    check(&corpus("ps25-marlin-sequential.gcode"), "one after the other");
    check(&corpus("ps25-marlin-vase.gcode"), "spiral vase");
    check(&corpus("ps25-marlin-vase.bgcode"), "without comments");
    check(&corpus("slic3r13-abs.gcode"), "no slicer's layer comments");
    check(b"", "empty");
    check(b"G1 X1\0", "zero");
    check(b";LAYER_CHANGE\n;LAYER:1\n", "mixed dialects");
    check(b";LAYER_CHANGE\n;TYPE:Perimeter\nG1 X1\n", "no part");
    let mut damaged = corpus("ps25-marlin-abs-grid.bgcode");
    let middle = damaged.len() / 2;
    damaged[middle] ^= 1;
    check(&damaged, "");
    // A job that leaves a gap where supports would grow.
    let layer = |z: f64| {
        format!(
            ";LAYER_CHANGE\nG1 Z{z} F600\nG1 X0 Y0 F9000\n;TYPE:Perimeter\n;WIDTH:0.4\nG1 X9 E.3 F1200\nG1 X9 Y9 F9000\nG1 X0 E.3 F1200\n"
        )
    };
    let gap: String = [0.2, 0.4, 2.0].map(layer).concat();
    check(format!("M83\n{gap}").as_bytes(), "prints nothing between Z 0.4 and 2 mm (layer 3)");
}

/// The proof, on a job of one layer with a square of supports put in.
fn proof(change: impl Fn(String) -> String) -> Result<(), String> {
    // What a wipe of rounded pieces pulled is not wholly pushed again.
    const HEAD: &str = "M83\n;LAYER_CHANGE\n;Z:.2\n;HEIGHT:0.2\nG1 Z.2 F600\nG1 E-1.00001 F2400\nG1 X50 Y50 F9000\nG1 E1 F2400\n;TYPE:Perimeter\n;WIDTH:0.4\nG1 F1200\n";
    const BODY: &str = "G1 X60 Y50 E.4\nG1 X60 Y60 E.4\nG1 X30 Y10 F9000\nG1 F1200\nG1 X40 Y10 E.4\n";
    let input = format!("{HEAD}{BODY}");
    let (output, _) =
        merged(input.as_bytes(), &Columns(vec![column(20.0, 20.0, 3.0, 9.0)]), &Options::default())
            .map_err(|e| e.to_string())?;
    let output = String::from_utf8(output).unwrap();
    let changed = change(output.clone());
    // What is new is found by what both ends of the text share with the input.
    let start = HEAD.len();
    let end = changed.len() - BODY.len();
    let mut told = Told::default();
    told.read(input.as_bytes());
    let mut surveyor = Surveyor::new(Dialect::Prusa, told).unwrap();
    let mut layers = Layers::new(input.as_bytes(), Dialect::Prusa).without_covers();
    let all: Vec<Layer> = std::iter::from_fn(|| layers.next_layer().unwrap()).collect();
    all.iter().for_each(|layer| surveyor.layer(layer).unwrap());
    let survey = surveyor.finish().unwrap();
    let sections = Columns(vec![column(20.0, 20.0, 3.0, 9.0)]);
    let options = Options::default();
    let plan = plan::plan(&all[1], [0.0, 0.2], [50.0, 50.0], &sections, &survey, &options).unwrap().unwrap();
    let mut verifier = Verifier::new(&survey, &options);
    let first = all[0].input().len();
    assert_eq!(first, HEAD.len());
    verifier.layer(0, HEAD.as_bytes(), None).unwrap();
    let text = &changed.as_bytes()[first..];
    let added = 0..end - start;
    let made = Made { text, added: std::slice::from_ref(&added), plan: &plan };
    verifier.layer(1, BODY.as_bytes(), Some(made)).map_err(|d| d.to_string())?;
    verifier.finish().map_err(|d| d.to_string())
}

#[test]
fn the_proof_holds_and_every_change_breaks_it() {
    assert_eq!(proof(|text| text), Ok(()));
    let check = |from: &str, to: &str, expect: &str| {
        let got = proof(|text| {
            assert!(text.contains(from), "{from} in {text}");
            text.replacen(from, to, 1)
        });
        let got = got.expect_err(&format!("{from} → {to}"));
        assert!(got.contains(expect), "{from} → {to}: {got}");
    };
    check("G1 X60 Y50 E.4", "G1 X60 Y51 E.4", "changed, moved or left out");
    check(";TYPE:Support material\n", "", "as something else");
    check(";TYPE:Support material\n", ";TYPE:Support material\nM106 S255\n", "would be put in");
    check(";TYPE:Support material\n", ";TYPE:Support material\n; a note\n", "would be put in");
    check(
        ";TYPE:Support material\n",
        ";TYPE:Support material\nG1 X21 Y20.5 E.02\n",
        "of filament instead of",
    );
    let end = ";TYPE:Perimeter\nG1 F1200\n";
    check(end, &format!("G1 X50.1 Y50 E.004\nG1 X50\n{end}"), "outside of the planned");
    check(";TYPE:Support material\n", ";TYPE:Support material\nG1 Z.1\nG1 Z.2\n", "below the layer");
    check(";TYPE:Support material\n", ";TYPE:Support material\nG1 Z.3\n", "at another height");
    check(";TYPE:Support material\n", ";TYPE:Support material\nG1 E-1\n", "filament pulled back");
    check(";TYPE:Support material\n", ";TYPE:Support material\nG1 E-2\nG1 E2\n", "deeper than the file");
    check(";TYPE:Support material\n", ";TYPE:Support material\nG1 F90000\n", "faster than the file");
    check(
        ";TYPE:Support material\n",
        &format!(";TYPE:Support material\nG1{} F600\n", " ".repeat(90)),
        "longer than",
    );
    check(";TYPE:Perimeter\nG1 F1200\nG1 X60", "G1 F1200\nG1 X60", "what it is");
}

mod random {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// Columns anywhere, over part, skirt and border: either the proof holds, or it is told what was clipped.
        #[test]
        fn columns_anywhere_leave_the_part_as_it_was(
            columns in proptest::collection::vec((85.0..135.0f64, 92.0..128.0f64, 0.1..5.0f64, 0.1..5.0f64, 0.2..5.0f64, 0.0..1.0f64), 1..6),
            file in 0..4usize,
        ) {
            let name = ["ps25-marlin-abs-grid.gcode", "cura413-marlin-zhop-triangles.gcode", "ps25-klipper-gyroid.gcode", "slic3r13-rel-comments.gcode"][file];
            let columns = columns.into_iter().map(|(x, y, low, high, top_mm, interface_mm)| Column { at: [x, y], radii_mm: [low, high], top_mm, interface_mm });
            let input = corpus(name);
            let (output, report) = match merged(&input, &Columns(columns.collect()), &Options::default()) {
                Ok(done) => done,
                Err(failure) => return Err(TestCaseError::fail(failure.to_string())),
            };
            let ((own, all), (own_after, all_after)) = (part_beads(&input), part_beads(&output));
            prop_assert_eq!(own.len(), own_after.len());
            let pushed = |beads: &[OwnBead]| beads.iter().map(|b| b.2).sum::<f64>();
            prop_assert!((pushed(&own) - pushed(&own_after)).abs() < 1e-3);
            prop_assert!((all_after - all - report.filament_mm).abs() < 0.02);
        }

        /// No text makes it panic.
        #[test]
        fn any_text_is_survived(lines in proptest::collection::vec(
            "G[0-3]( [XYZEFIJ]-?[0-9]{1,2}(\\.[0-9]{1,2})?){1,4}|G9[0-2]( E0)?|M8[23]|G1[01]|;LAYER_CHANGE|;TYPE:(Perimeter|Internal infill|Support material|Bridge infill)|;(WIDTH|HEIGHT):0\\.[1-9]|T[01]", 0..80)) {
            let text = format!(";LAYER_CHANGE\n{}", lines.join("\n"));
            let _ = merged(text.as_bytes(), &Columns(vec![column(20.0, 20.0, 9.0, 50.0)]), &Options::default());
        }
    }
}
