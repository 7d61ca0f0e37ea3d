//! `outrigger check` through the real binary.
mod common;

use common::made::{Triangle, archive, binary_stl, cuboid, png};
use common::{corpus, folder_of, names, outrigger, outrigger_after};
use serde_json::Value;
use std::fs;
use tempfile::TempDir;

/// A foot, a post, a roof, and a peg of 2 × 2 mm that hangs from the roof down to
/// Z 5, at X 6 Y 7.
fn lamp() -> Vec<Triangle> {
    [
        cuboid([-10.0, -10.0, 0.0], [10.0, 10.0, 2.0]),
        cuboid([-2.0, -2.0, 1.0], [2.0, 2.0, 12.0]),
        cuboid([-10.0, -10.0, 11.0], [10.0, 10.0, 13.0]),
        cuboid([5.0, 6.0, 5.0], [7.0, 8.0, 12.0]),
    ]
    .concat()
}

fn ascii_stl(triangles: &[Triangle]) -> Vec<u8> {
    let mut text = String::from("solid made by a test\n");
    for triangle in triangles {
        text += "facet normal 0 0 0\nouter loop\n";
        for [x, y, z] in triangle {
            text += &format!("vertex {x} {y} {z}\n");
        }
        text += "endloop\nendfacet\n";
    }
    (text + "endsolid\n").into_bytes()
}

/// What `check FILE ARGS --json -` says, and nothing else on standard output.
#[track_caller]
fn json(folder: &TempDir, args: &[&str]) -> Value {
    let args = [&["check"], args, &["--json", "-"]].concat();
    let run = outrigger(folder.path(), args);
    serde_json::from_str(&run.ends(0).stdout).expect("JSON alone on standard output")
}

#[track_caller]
fn near(value: &Value, expect: f64, within: f64) {
    let found = value.as_f64().unwrap_or(f64::NAN);
    assert!((found - expect).abs() <= within, "{found}, not {expect}");
}

#[test]
fn the_island_of_a_model_is_found_where_it_is() {
    for bytes in [binary_stl(&lamp()), ascii_stl(&lamp())] {
        let folder = folder_of("lamp.stl", &bytes);
        let report = json(&folder, &["lamp.stl"]);
        assert_eq!((&report["file"], &report["kind"]), (&"lamp.stl".into(), &"stl".into()));
        assert_eq!((&report["triangles"], &report["layers"]), (&48.into(), &65.into()));
        near(&report["height_mm"], 13.0, 1e-6);
        let islands = report["islands"].as_array().expect("a list");
        assert_eq!(islands.len(), 1, "{islands:?}");
        let island = &islands[0];
        // Layers of 0.2 mm, cut in their middle: the first above Z 5 is cut at 5.1, the
        // first above Z 11 at 11.1.
        assert_eq!((&island["layer"], &island["end_layer"]), (&25.into(), &55.into()));
        near(&island["z_mm"], 5.1, 1e-9);
        near(&island["top_mm"], 5.2, 1e-9);
        near(&island["end_z_mm"], 11.1, 1e-9);
        near(&island["end_top_mm"], 11.2, 1e-9);
        near(&island["area_mm2"], 4.0, 1e-3);
        near(&island["centroid_mm"][0], 6.0, 1e-3);
        near(&island["centroid_mm"][1], 7.0, 1e-3);
        near(&island["bbox_mm"][0][0], 5.0, 1e-3);
        near(&island["bbox_mm"][1][1], 8.0, 1e-3);
        assert_eq!(island["joins"], true);
        // The roof less the post and the peg, each grown by the layer's 0.2 mm, round at corners.
        assert_eq!(report["overhangs"]["method"], "layer");
        let grown = |side: f64| side * side + 4.0 * side * 0.2 + std::f64::consts::PI * 0.04;
        let largest = &report["overhangs"]["largest"][0];
        near(&largest["area_mm2"], 400.0 - grown(4.0) - grown(2.0), 0.1);
        assert_eq!(largest["layer"], 55);
        for name in ["read", "slice", "islands", "overhangs", "total"] {
            assert!(report["seconds"][name].as_f64().is_some_and(|s| (0.0..60.0).contains(&s)), "{name}");
        }
        assert!(report["mended"]["open_edges"] == 0 && report["warnings"] == Value::Array(vec![]));
    }
}

#[test]
fn people_are_told_the_same() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    let run = outrigger(folder.path(), ["check", "lamp.stl"]);
    let words = &run.ends(0).stdout;
    assert!(words.contains("lamp.stl: stl, 48 triangles, 65 layers, 13.00 mm high"), "{words}");
    assert!(words.contains("1 island\n"), "{words}");
    let row = words.lines().find(|l| l.contains("layer    25")).expect("the island's row");
    for part in ["Z    5.20 mm", "4.00 mm²", "X    6.0", "Y    7.0", "joins the part at Z 11.20"] {
        assert!(row.contains(part), "{row}");
    }
    assert_eq!(outrigger(folder.path(), ["check", "-q", "lamp.stl"]).ends(0).stdout, "");
    assert_eq!(names(folder.path()), ["lamp.stl"]);
}

#[test]
fn models_are_turned_and_scaled_and_cut_as_told() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    // Upside down the peg stands on the roof.
    let turned = json(&folder, &["lamp.stl", "--rotate", "180,0,0"]);
    assert_eq!(turned["islands"], Value::Array(vec![]));
    let scaled = json(&folder, &["lamp.stl", "--height-mm", "26", "--layer-height", "0.1"]);
    assert_eq!((&scaled["layers"], &scaled["islands"][0]["layer"]), (&260.into(), &100.into()));
    near(&scaled["islands"][0]["area_mm2"], 16.0, 1e-3);
    let first = json(&folder, &["lamp.stl", "--first-layer-height", "0.5"]);
    // Cut at 0.25, 0.6, 0.8 … 5.0: a plane at the underside's own height sees what is above it.
    near(&first["islands"][0]["z_mm"], 5.0, 1e-9);
    near(&first["islands"][0]["top_mm"], 5.1, 1e-9);
}

#[test]
fn rules_come_from_the_material_and_the_flags() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    let report =
        json(&folder, &["lamp.stl", "--material", "abs", "--min-area-mm2", "5", "--overhang", "none"]);
    assert_eq!((&report["rules"]["material"], &report["overhangs"]), (&"abs".into(), &Value::Null));
    assert_eq!(report["islands"], Value::Array(vec![]));
    assert_eq!(report["small_islands"][0]["layer"], 25);
    let run = outrigger(folder.path(), ["check", "lamp.stl", "--material", "abbs"]);
    run.ends(1).says("did you mean abs");
}

#[test]
fn findings_fail_only_where_asked() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    let check = |args: &[&str], code: i32| {
        outrigger(folder.path(), [&["check", "-q", "lamp.stl"], args].concat()).ends(code).stderr.clone()
    };
    check(&[], 0);
    assert!(check(&["--fail-on", "islands"], 1).contains("islands: 1"));
    check(&["--fail-on", "islands,overhangs"], 1);
    check(&["--fail-on", "islands", "--min-area-mm2", "5"], 0);
    check(&["--fail-on", "overhangs", "--overhang", "none"], 2);
    check(&["--fail-on", "weather"], 2);
}

#[test]
fn wrong_usage_is_told_before_anything_is_done() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    let check = |args: &[&str], words: &str| {
        outrigger(folder.path(), [&["check", "lamp.stl"], args].concat()).ends(2).says(words);
    };
    for height in ["0", "1e-9", "NaN", "-0.2", "inf", "1000", "thin"] {
        check(&[&format!("--layer-height={height}")], "layer-height");
        check(&[&format!("--first-layer-height={height}")], "first-layer-height");
    }
    check(&["--picture", "a.pdf"], ".svg, .png or .html");
    check(&["--picture", "svg"], ".svg, .png or .html");
    check(&["--picture", "-"], ".svg, .png or .html");
    check(&["--height-mm", "0"], "more than 0");
    check(&["--rotate", "1,2"], "three angles");
    check(&["--angle-deg", "90"], "less than 90");
    check(&["--pixel-mm", "0"], "0.001");
    check(&["--overhang", "guess"], "possible values");
    check(&["--filament-mm", "1.75"], "for G-code");
    check(&["--json", "./lamp.stl"], "would replace");
    check(&["--json", "a.html", "--picture", "a.html"], "same file");
    assert_eq!(names(folder.path()), ["lamp.stl"]);
}

#[test]
fn pictures_are_written_whole() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    let path = |name: &str| folder.path().join(name);
    fs::write(path("a.svg"), "old").expect("an old picture");
    for name in ["a.svg", "a.png", "a.html"] {
        outrigger(folder.path(), ["check", "-q", "lamp.stl", "--picture", name]).ends(0);
    }
    let svg = fs::read_to_string(path("a.svg")).expect("text");
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
    // Light blue, dark blue and orange: the island, where it appears, and the roof's underside.
    for colour in ["#7dc4f5", "#0b3a9c", "#f29a2e"] {
        assert!(svg.contains(colour), "{colour}");
    }
    assert!(svg.contains("layer 25, Z 5.20") && !svg.contains("NaN"));
    let png = fs::read(path("a.png")).expect("bytes");
    assert!(png.starts_with(b"\x89PNG\r\n"));
    let html = fs::read_to_string(path("a.html")).expect("text");
    assert!(html.contains("<title>lamp.stl</title>") && html.contains("</html>"));
    assert_eq!(names(folder.path()), ["a.html", "a.png", "a.svg", "lamp.stl"]);
    let run = outrigger(folder.path(), ["check", "lamp.stl", "--picture", "none/a.svg"]);
    run.ends(1).says("cannot write the picture none/a.svg");
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let folder = folder_of("lamp.stl", &binary_stl(&lamp()));
    let with = |threads: &str| {
        let before = format!("export RAYON_NUM_THREADS={threads}");
        let run = outrigger_after(folder.path(), &before, &["check", "lamp.stl", "--json", "-"]);
        let mut report: Value = serde_json::from_str(&run.ends(0).stdout).expect("JSON");
        report["seconds"] = Value::Null;
        report
    };
    assert_eq!(with("1"), with("5"));
}

#[test]
fn content_tells_what_a_file_is() {
    let job = corpus("ps25-marlin-gapfill.gcode");
    let as_stl = folder_of("job.stl", &job);
    let report = json(&as_stl, &["job.stl"]);
    assert_eq!((&report["kind"], &report["triangles"]), (&"gcode".into(), &Value::Null));
    assert_eq!((&report["layers"], &report["mended"]), (&10.into(), &Value::Null));
    outrigger(as_stl.path(), ["check", "job.stl", "--layer-height", "0.1"])
        .ends(2)
        .says("has its own layers");
    outrigger(as_stl.path(), ["check", "job.stl", "--overhang", "normal"]).ends(2).says("is for models");
    let binary = folder_of("job.txt", &corpus("ps25-marlin-gapfill.bgcode"));
    let of_binary = json(&binary, &["job.txt"]);
    assert_eq!((&of_binary["kind"], &of_binary["layers"]), (&"bgcode".into(), &10.into()));
    let model = folder_of("model.gcode", &binary_stl(&lamp()));
    assert_eq!(json(&model, &["model.gcode"])["kind"], "stl");
}

#[test]
fn what_is_no_job_is_told_so() {
    let check = |bytes: &[u8], words: &str| {
        let folder = folder_of("file.stl", bytes);
        outrigger(folder.path(), ["check", "file.stl"]).ends(1).says(words);
    };
    check(b"", "empty");
    check(b"\x1f\x8b\x08\0\0\0", "gunzip");
    check(b"solid nothing\nendsolid nothing\n", "triangle");
    check(&binary_stl(&[]), "triangle");
    let nan = [[[0.0, 0.0, 0.0], [f32::NAN, 0.0, 1.0], [0.0, 1.0, 2.0]]];
    check(&binary_stl(&nan), "triangle");
    let line = [[[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [2.0, 2.0, 2.0]]];
    check(&binary_stl(&line), "nothing to print");
    let whole = binary_stl(&lamp());
    check(&whole[..whole.len() - 7], "cut short");
    let text = ascii_stl(&lamp());
    check(&text[..text.len() - 40], "line");
    check(b"PK\x03\x04 and then nothing", "archive");
    let folder = folder_of("letter.txt", b"Dear reader,\nthis is no job.\n");
    outrigger(folder.path(), ["check", "letter.txt"]).ends(1).says("neither STL nor G-code");
    outrigger(folder.path(), ["check", "none.stl"]).ends(1).says("cannot open none.stl");
    outrigger(folder.path(), ["check", "."]).ends(1).says("no regular file");
    outrigger(folder.path(), ["check"]).ends(2);
}

#[test]
fn damaged_models_are_mended_and_the_island_is_still_there() {
    let check = |triangles: &[Triangle], mended: &str| {
        let folder = folder_of("lamp.stl", &binary_stl(triangles));
        let report = json(&folder, &["lamp.stl"]);
        assert_eq!(report["islands"].as_array().map(Vec::len), Some(1), "{mended}: {report}");
        near(&report["islands"][0]["area_mm2"], 4.0, 0.01);
        assert!(
            mended.is_empty() || report["mended"][mended].as_u64() > Some(0),
            "{mended}: {}",
            report["mended"]
        );
        report
    };
    let good = lamp();
    let inside_out: Vec<Triangle> = good.iter().map(|&[a, b, c]| [a, c, b]).collect();
    check(&inside_out, "turned_shells");
    let mut flipped = good.clone();
    flipped[40].swap(0, 1);
    check(&flipped, "flipped_triangles");
    let mut doubled = good.clone();
    doubled.extend_from_slice(&good);
    check(&doubled, "duplicate_triangles");
    let mut holed = good.clone();
    holed.remove(41);
    check(&holed, "filled_holes");
    let mut flat = good.clone();
    flat.push([[0.0; 3], [1.0; 3], [0.0; 3]]);
    check(&flat, "degenerate_triangles");
}

#[test]
fn a_likely_unit_is_a_warning() {
    let small: Vec<Triangle> = lamp().iter().map(|t| t.map(|p| p.map(|c| c / 1000.0))).collect();
    let folder = folder_of("lamp.stl", &binary_stl(&small));
    let report = json(&folder, &["lamp.stl", "--layer-height", "0.002"]);
    let warning = report["warnings"][0].as_str().expect("a warning");
    assert!(warning.contains("metres") && warning.contains("--height-mm 13"), "{warning}");
    outrigger(folder.path(), ["check", "lamp.stl", "--height-mm", "13"]).ends(0);
    // Too flat to be sliced, and told why that may be.
    let refused = outrigger(folder.path(), ["check", "lamp.stl"]);
    refused.ends(1);
    assert!(refused.stderr.contains("--height-mm 13"), "{refused:?}");
}

#[test]
fn many_duplicates_cost_little() {
    let many: Vec<Triangle> = lamp().into_iter().cycle().take(100_000).collect();
    let folder = folder_of("lamp.stl", &binary_stl(&many));
    let run =
        outrigger_after(folder.path(), "ulimit -v 1000000", &["check", "-q", "lamp.stl", "--json", "-"]);
    let report: Value = serde_json::from_str(&run.ends(0).stdout).expect("JSON");
    assert_eq!((&report["triangles"], &report["islands"][0]["layer"]), (&48.into(), &25.into()));
}

const CONFIG: &[u8] = b"jobDir = a\nlayerHeight = 0.05\nexpTime = 5\nexpTimeFirst = 30\nnumFade = 2\nnumFast = 4\nnumSlow = 0\n";
/// The archive says the layer height and the printer's pixels.
const SETTINGS: &[u8] = b"display_width = 8\ndisplay_height = 4\ndisplay_pixels_x = 80\ndisplay_pixels_y = 40\ndisplay_orientation = landscape\ndisplay_mirror_x = 0\ndisplay_mirror_y = 0\n";

#[test]
fn the_island_of_a_resin_job_is_found() {
    let body = [10, 10, 40, 30];
    let island = [60, 10, 64, 15];
    let pictures = [
        png([80, 40], &[body]),
        png([80, 40], &[body]),
        png([80, 40], &[body, island]),
        png([80, 40], &[[10, 10, 64, 30]]),
    ];
    let job = archive(&[
        ("config.ini", CONFIG),
        ("prusaslicer.ini", SETTINGS),
        ("a00000.png", &pictures[0]),
        ("a00001.png", &pictures[1]),
        ("a00002.png", &pictures[2]),
        ("a00003.png", &pictures[3]),
    ]);
    let folder = folder_of("job.sl1", &job);
    let report = json(&folder, &["job.sl1"]);
    assert_eq!((&report["kind"], &report["layers"]), (&"sl1".into(), &4.into()));
    assert_eq!(report["rules"]["material"], "resin-standard");
    let islands = report["islands"].as_array().expect("a list");
    assert_eq!(islands.len(), 1, "{islands:?}");
    // 4 × 5 pixels of 0.1 mm.
    near(&islands[0]["area_mm2"], 0.2, 1e-6);
    assert_eq!((&islands[0]["layer"], &islands[0]["end_layer"]), (&2.into(), &3.into()));
    outrigger(folder.path(), ["check", "job.sl1", "--rotate", "0,0,90"]).ends(2).says("a resin job");
}

#[test]
fn archives_that_lie_end_before_memory_is_spent() {
    let check = |entries: &[(&str, &[u8])], words: &str| {
        let folder = folder_of("job.sl1", &archive(entries));
        outrigger_after(folder.path(), "ulimit -v 1000000", &["check", "job.sl1"]).ends(1).says(words);
    };
    let mut huge = png([80, 40], &[]);
    huge[16..24].copy_from_slice(&[0, 1, 0x86, 0xa0, 0, 1, 0x86, 0xa0]); // 100,000 × 100,000
    let crc = crc32(&huge[12..29]);
    huge[29..33].copy_from_slice(&crc.to_be_bytes());
    let config = String::from_utf8_lossy(CONFIG).replace("numFast = 4", "numFast = 1");
    let entries = [("config.ini", config.as_bytes()), ("prusaslicer.ini", SETTINGS), ("a00000.png", &huge)];
    check(&entries, "a00000.png");
    let zeros = vec![0; 40 << 20];
    check(&[("config.ini", &zeros)], "config.ini");
    check(&[("readme.txt", b"hello")], "resin");
}

/// The checksum of PNG's chunks.
fn crc32(bytes: &[u8]) -> u32 {
    let step = |crc: u32, byte: &u8| {
        (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xedb8_8320 } else { c >> 1 })
    };
    !bytes.iter().fold(!0, step)
}

/// Models that are kept beside the project, where they are there.
fn models() -> Option<std::path::PathBuf> {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models");
    folder.is_dir().then_some(folder)
}

#[test]
fn every_island_that_was_built_in_is_found_and_none_is_invented() {
    let Some(models) = models() else { return };
    for name in ["islands-1", "islands-2", "wedges-1", "wedges-2"] {
        let built: Value = serde_json::from_slice(
            &fs::read(models.join(name).with_extension("json")).expect("what is in it"),
        )
        .expect("JSON");
        let built = built["islands"].as_array().cloned().unwrap_or_default();
        let folder =
            folder_of("model.stl", &fs::read(models.join(name).with_extension("stl")).expect("a model"));
        let args = ["model.stl", "--layer-height", "0.1", "--overhang", "none", "--min-area-mm2", "0"];
        let report = json(&folder, &args);
        let mut found = report["islands"].as_array().cloned().expect("a list");
        assert_eq!(found.len(), built.len(), "{name}");
        for island in built {
            let of = |v: &Value| v.as_f64().expect("a number");
            let near_it = |f: &Value| {
                let [x, y] = [0, 1].map(|k| of(&f["centroid_mm"][k]));
                (x - of(&island["x"])).abs() < 0.1 && (y - of(&island["y"])).abs() < 0.1
            };
            let at = found.iter().position(near_it).unwrap_or_else(|| panic!("{name}: {island} is missing"));
            let found = found.remove(at);
            // Cut at most a layer above where it begins.
            let above = of(&found["z_mm"]) - of(&island["z"]);
            assert!((-1e-3..=0.1).contains(&above), "{name}: {found} {island}");
            // Cylinders are many-sided.
            let share = of(&found["area_mm2"]) / of(&island["area"]);
            assert!((0.97..1.001).contains(&share), "{name}: {found} {island}");
        }
    }
}

/// A job of one wall at X 100 that goes on up to X `to`, in PLA.
fn walled(to: f64, end: &str) -> String {
    let mut text = String::from(
        "; generated by PrusaSlicer 2.5.0 on 2024-01-01 at 00:00:00 UTC\nM104 S210\nM140 S60\nG28\nM83\nG90\n",
    );
    for k in 1..=4 {
        text += &format!(
            ";LAYER_CHANGE\n;Z:{z:.1}\n;HEIGHT:0.2\nG1 Z{z:.1} F9000\n;TYPE:External perimeter\n;WIDTH:0.45\nG1 X100 Y100 F9000\nG1 X{to} E4 F1800\n",
            z = 0.2 * f64::from(k)
        );
    }
    text + end + "; filament_type = PLA\n"
}

#[test]
fn a_job_is_checked_for_its_printer() {
    const END: &str = "G1 E-1 F2100\nM104 S0\nM140 S0\nM84\n";
    let findings = |job: &str, args: &[&str]| -> Vec<String> {
        let folder = folder_of("job.gcode", job.as_bytes());
        let report = json(&folder, &[&["job.gcode", "--printer", "ender-3"], args].concat());
        assert_eq!(report["printer"]["name"], "ender-3");
        let list = report["printer"]["findings"].as_array().expect("a list");
        list.iter().map(|f| format!("{} {}", f["kind"].as_str().expect("a kind"), f["line"])).collect()
    };
    assert_eq!(findings(&walled(150.0, END), &[]), [""; 0]);
    assert_eq!(findings(&walled(250.0, END), &[]), ["outside_bed 14"]);
    assert_eq!(findings(&walled(150.0, "M84\n"), &[]), ["heaters_left_on 39"]);
    assert_eq!(findings(&walled(150.0, END), &["--material", "pc"]), ["nozzle_below_material 14"]);
    // What the firmware would cut ends the reading: nothing is said of the end.
    let long = format!("G1 X1{}\n", "0".repeat(120));
    assert_eq!(findings(&walled(150.0, &long), &[]), ["line_too_long 39"]);
    let folder = folder_of("job.gcode", walled(250.0, END).as_bytes());
    let args = ["check", "job.gcode", "--printer", "ender-3", "--fail-on", "printer"];
    let run = outrigger(folder.path(), args);
    run.ends(1).says("findings for the printer: 1");
    assert!(
        run.stdout.contains("ender-3: 1 thing amiss\n  line 14: it prints up to 30.0 mm beside the bed"),
        "{run:?}"
    );
    outrigger(folder.path(), ["check", "job.gcode", "--fail-on", "printer"]).ends(2).says("--printer NAME");
    outrigger(folder.path(), ["check", "job.gcode", "--printer", "nobody"]).ends(1).says("nobody");
}
