//! `outrigger support` and `outrigger post --supports auto`, through the real binary.
//!
//! Whether the results hold is asked of `outrigger check`, and of pixels and lines counted
//! here.
mod common;

use common::made::{archive, binary_stl, cuboid, png};
use common::{folder_of, names, outrigger};
use serde_json::Value;
use std::fmt::Write as _;
use std::fs;
use std::io::{Cursor, Read};
use std::path::Path;

fn stl(boxes: &[[[f32; 3]; 2]]) -> Vec<u8> {
    binary_stl(&boxes.iter().flat_map(|[low, high]| cuboid(*low, *high)).collect::<Vec<_>>())
}

/// A post with a roof, and a peg of 2 × 2 mm that hangs from it down to Z 5, at X 6 Y 7.
fn lamp() -> Vec<u8> {
    stl(&[
        [[-2.0, -2.0, 0.0], [2.0, 2.0, 12.0]],
        [[-10.0, -10.0, 11.0], [10.0, 10.0, 13.0]],
        [[5.0, 6.0, 5.0], [7.0, 8.0, 12.0]],
    ])
}

#[track_caller]
fn json(folder: &Path, args: &[&str]) -> Value {
    let run = outrigger(folder, args);
    serde_json::from_str(&run.ends(0).stdout).expect("JSON alone on standard output")
}

fn count(value: &Value) -> usize {
    value.as_array().expect("a list").len()
}

#[test]
fn a_models_supports_hold_it() {
    let folder = folder_of("lamp.stl", &lamp());
    let before = json(folder.path(), &["check", "lamp.stl", "--json", "-"]);
    assert_eq!(count(&before["islands"]), 1);
    for material in ["pla", "resin-standard"] {
        let args = ["support", "lamp.stl", "-o", "out.stl", "--material", material, "--json", "-"];
        let report = json(folder.path(), &args);
        assert_eq!(report["method"], "tree");
        assert_eq!((count(&report["unroutable"]), count(&report["amiss"])), (0, 0), "{report}");
        assert_eq!(report["islands"], 1);
        let tips = report["tips"].as_u64().expect("a count");
        assert!(tips >= report["tips_at_least"].as_u64().expect("a count") && tips > 10, "{report}");
        // The supports alone are closed bodies that stand on the plate.
        let alone = json(folder.path(), &["check", "out.stl", "--json", "-", "--overhang", "none"]);
        assert_eq!(count(&alone["islands"]), 0, "{material}: {}", alone["islands"]);
        assert_eq!(count(&alone["warnings"]), 0, "{alone}");
        // With the straight method there is more of them.
        let straight =
            [&args[..2], &["--method", "straight", "--material", material, "--json", "-"]].concat();
        let straight = json(folder.path(), &straight);
        let volume = |r: &Value| r["volume_mm3"].as_f64().expect("a volume");
        assert!(volume(&report) < 0.8 * volume(&straight), "{report} {straight}");
    }
    // In resin the model and its supports are one: nothing begins in the air any more.
    let args =
        ["support", "lamp.stl", "-o", "both.stl", "--with-model", "-q", "--material", "resin-standard"];
    outrigger(folder.path(), args).ends(0);
    let both = json(folder.path(), &["check", "both.stl", "--layer-height", "0.05", "--json", "-"]);
    assert_eq!(count(&both["islands"]), 0, "{}", both["islands"]);
    assert_eq!(names(folder.path()), ["both.stl", "lamp.stl", "out.stl"]);
}

#[test]
fn a_page_shows_model_and_supports() {
    let folder = folder_of("lamp.stl", &lamp());
    outrigger(folder.path(), ["support", "lamp.stl", "--picture", "p.html", "-q"]).ends(0);
    let page = fs::read_to_string(folder.path().join("p.html")).expect("the page");
    assert!(page.contains("lamp.stl") && page.ends_with("</html>\n"), "{}", &page[..200]);
    outrigger(folder.path(), ["support", "lamp.stl", "--picture", "p.svg"]).ends(2).says(".html");
}

#[test]
fn what_cannot_be_held_is_told_and_not_written() {
    // A closed box with a tongue inside.
    let boxes = [
        [[0.0, 0.0, 0.0], [20.0, 20.0, 1.0]],
        [[0.0, 0.0, 0.0], [1.0, 20.0, 12.0]],
        [[19.0, 0.0, 0.0], [20.0, 20.0, 12.0]],
        [[0.0, 0.0, 0.0], [20.0, 1.0, 12.0]],
        [[0.0, 19.0, 0.0], [20.0, 20.0, 12.0]],
        [[8.0, 8.0, 6.0], [12.0, 19.5, 7.0]],
    ];
    let folder = folder_of("box.stl", &stl(&boxes));
    let plate = ["support", "box.stl", "-o", "out.stl", "--trunks", "plate"];
    let run = outrigger(folder.path(), plate);
    run.ends(1).says("cannot be held").says("--allow-unroutable");
    assert!(run.stdout.contains("enclosed by the part"), "{run:?}");
    assert_eq!(names(folder.path()), ["box.stl"]);
    let report = json(folder.path(), &[&plate[..], &["--allow-unroutable", "--json", "-"]].concat());
    let place = report["unroutable"][0]["place_mm"].as_array().expect("a place");
    assert!((place[2].as_f64().expect("z") - 6.0).abs() < 0.11, "{report}");
    // On the part it can be held.
    outrigger(folder.path(), ["support", "box.stl", "-o", "out.stl", "-q"]).ends(0);
    // Nothing to hold is no failure.
    let folder = folder_of("cube.stl", &stl(&[[[0.0; 3], [9.0; 3]]]));
    outrigger(folder.path(), ["support", "cube.stl", "-o", "out.stl"]).ends(0).says("nothing needs support");
    assert_eq!(names(folder.path()), ["cube.stl"]);
    outrigger(folder.path(), ["support", "cube.stl", "-o", "cube.stl"]).ends(2).says("name another file");
}

/// G-code of a part given by rectangles at each height, in PrusaSlicer's words: each
/// rectangle hatched, 0.2 mm layers, relative E.
fn gcode(layers: u32, at: impl Fn(f64) -> Vec<[f64; 4]>) -> String {
    gcode_with(layers, |z| at(z).into_iter().map(|at| (at, "External perimeter")).collect())
}

/// The same, of rectangles that say what they are.
fn gcode_with(layers: u32, at: impl Fn(f64) -> Vec<([f64; 4], &'static str)>) -> String {
    let mut text = String::from(
        "; generated by PrusaSlicer 2.5.0 on 2024-01-01 at 00:00:00 UTC\nM83\nG90\nG28\nG1 Z5 F5000\n",
    );
    for k in 0..layers {
        let z = 0.2 * f64::from(k + 1);
        let _ = write!(text, ";LAYER_CHANGE\n;Z:{z:.1}\n;HEIGHT:0.2\nG1 Z{z:.2} F9000\n");
        for ([x0, y0, x1, y1], what) in at(z - 0.1) {
            let _ = write!(text, ";TYPE:{what}\n;WIDTH:0.45\n");
            let mut y = y0 + 0.225;
            while y < y1 - 0.2 {
                let e = (x1 - x0 - 0.45) * 0.0338;
                let _ = write!(
                    text,
                    "G1 E-0.8 F2100\nG1 X{:.3} Y{y:.3} F9000\nG1 E0.8 F2100\nG1 X{:.3} Y{y:.3} E{e:.5} F1800\n",
                    x0 + 0.225,
                    x1 - 0.225
                );
                y += 0.41;
            }
        }
    }
    text += "G1 E-0.8 F2100\nM107\nM84\n; filament_type = PLA\n; filament_diameter = 1.75\n; nozzle_diameter = 0.4\n; layer_height = 0.2\n; retract_length = 0.8\n; travel_speed = 150\n; bed_shape = 0x0,200x0,200x200,0x200\n";
    text
}

/// A post with a roof, and a peg that hangs from it.
fn lamp_at(z: f64) -> Vec<[f64; 4]> {
    let mut at = vec![[98.0, 98.0, 102.0, 102.0]];
    if z > 5.0 && z < 11.0 {
        at.push([105.0, 106.0, 107.0, 108.0]);
    }
    if z > 11.0 { vec![[90.0, 90.0, 110.0, 110.0]] } else { at }
}

#[test]
fn sliced_jobs_get_what_holds_them() {
    let job = gcode(65, lamp_at);
    let folder = folder_of("job.gcode", job.as_bytes());
    let check = |file: &str| json(folder.path(), &["check", file, "--json", "-"]);
    assert_eq!(count(&check("job.gcode")["islands"]), 1);
    let args = ["post", "job.gcode", "--supports", "auto", "-o", "out.gcode", "--report", "-"];
    let report = json(folder.path(), &args);
    assert_eq!((&report["process"], &report["islands"]), (&"filament".into(), &1.into()));
    let after = check("out.gcode");
    assert_eq!(count(&after["islands"]), 0, "{}", after["islands"]);
    assert_eq!(count(&after["floating_supports"]), 0, "{}", after["floating_supports"]);
    // Every line of the job is there, in its order.
    let out = fs::read_to_string(folder.path().join("out.gcode")).expect("the result");
    let mut lines = out.lines();
    assert!(job.lines().all(|line| lines.any(|l| l == line)), "a line of the job is missing");
    assert!(out.contains(";TYPE:Support material"), "supports are told as such");
    // In place, and once more: there is nothing left to do.
    outrigger(folder.path(), ["post", "job.gcode", "--supports", "auto", "-q"]).ends(0);
    assert_eq!(fs::read_to_string(folder.path().join("job.gcode")).expect("the job"), out);
    let again = outrigger(folder.path(), ["post", "job.gcode", "--supports", "auto"]);
    assert_eq!(again.code, Some(0), "{again:?}");
    assert_eq!(names(folder.path()), ["job.gcode", "out.gcode"]);
}

#[test]
fn a_page_shows_a_job_with_what_holds_it() {
    let folder = folder_of("job.gcode", gcode(65, lamp_at).as_bytes());
    let post = ["post", "job.gcode", "--supports", "auto", "-o", "out.gcode", "-q", "--picture"];
    outrigger(folder.path(), [&post[..], &["p.html"]].concat()).ends(0);
    let page = fs::read_to_string(folder.path().join("p.html")).expect("the page");
    let from = page.find("id=\"scene\">").expect("the scene") + 11;
    let scene = &page[from..from + page[from..].find("</script>").expect("its end")];
    let scene: Value = serde_json::from_str(scene).expect("JSON");
    // The lamp's surface in cells of 0.2 × 0.2 × 0.6 mm or so: some thousand triangles.
    let triangles = scene["part"]["count"].as_u64().expect("a count");
    assert!((4_000..400_000).contains(&triangles), "{triangles}");
    assert_eq!((&scene["title"], count(&scene["methods"])), (&"job.gcode".into(), 1));
    outrigger(folder.path(), [&post[..], &["p.svg"]].concat()).ends(2).says(".html");
    // A part whose tongue is enclosed: nothing is written but the page, which shows why.
    let tongue = |z: f64| {
        let mut at = vec![
            [80.0, 80.0, 82.0, 120.0],
            [118.0, 80.0, 120.0, 120.0],
            [82.0, 80.0, 118.0, 82.0],
            [82.0, 118.0, 118.0, 120.0],
        ];
        at.extend([[82.0, 95.0, 97.0, 105.0]].into_iter().filter(|_| (2.0..2.6).contains(&z)));
        if z < 1.2 { vec![[80.0, 80.0, 120.0, 120.0]] } else { at }
    };
    let folder = folder_of("job.gcode", gcode(20, tongue).as_bytes());
    outrigger(folder.path(), [&post[..], &["p.html"]].concat()).ends(1).says("cannot be held");
    assert_eq!(names(folder.path()), ["job.gcode", "p.html"]);
}

#[test]
fn supports_stay_on_the_plate() {
    // The roof reaches beyond the plate, to X 110.
    let job = |plate: &str| gcode(65, lamp_at).replace("0x0,200x0,200x200,0x200", plate);
    let folder = folder_of("job.gcode", job("0x0,109x0,109x200,0x200").as_bytes());
    let post = ["post", "job.gcode", "--supports", "auto", "-o", "out.gcode", "-q"];
    outrigger(folder.path(), post).ends(0);
    let out = fs::read_to_string(folder.path().join("out.gcode")).expect("the result");
    let (mut own, mut most) = (false, 0.0_f64);
    for line in out.lines() {
        if let Some(what) = line.strip_prefix(";TYPE:") {
            own = what.starts_with("Support");
        }
        let x = line.split(' ').find_map(|word| word.strip_prefix('X')?.parse::<f64>().ok());
        most = x.filter(|_| own).map_or(most, |x| most.max(x));
    }
    assert!((107.0..=109.0).contains(&most), "{most}");
    // The post has hardly any plate beside it.
    let none = folder_of("job.gcode", job("97x97,103x97,103x103,97x103").as_bytes());
    outrigger(none.path(), post).ends(1).says("cannot be held").says("border of the plate");
    assert_eq!(names(none.path()), ["job.gcode"]);
}

#[test]
fn a_slicers_supports_are_replaced() {
    // The slicer's own: a wall up to the peg, and one where nothing needs it.
    let job = gcode_with(65, |z| {
        let part = lamp_at(z).into_iter().map(|at| (at, "External perimeter"));
        let own = [[105.0, 106.0, 107.0, 108.0], [60.0, 60.0, 70.0, 70.0]].map(|at| (at, "Support material"));
        part.chain(own.into_iter().filter(|_| z < 4.9)).collect()
    });
    let folder = folder_of("job.gcode", job.as_bytes());
    let args = ["post", "job.gcode", "--supports", "replace", "-o", "out.gcode", "--report", "-"];
    let report = json(folder.path(), &args);
    // Two square columns, 4.8 mm high, of beads that are a little apart.
    let replaced = report["replaced_mm3"].as_f64().expect("a volume") / (4.8 * (2.0 * 2.0 + 10.0 * 10.0));
    assert!((0.85..=1.0).contains(&replaced), "{report}");
    let after = json(folder.path(), &["check", "out.gcode", "--json", "-"]);
    assert_eq!(count(&after["islands"]), 0, "{}", after["islands"]);
    let out = fs::read_to_string(folder.path().join("out.gcode")).expect("the result");
    assert!(!out.contains("G1 X60.225"), "the useless wall is gone");
    assert_eq!(names(folder.path()), ["job.gcode", "out.gcode"]);
    // Pictures do not tell supports from the part.
    let folder = folder_of("job.sl1", &sl1(3, |_| vec![[9, 9, 20, 20]]));
    outrigger(folder.path(), ["post", "job.sl1", "--supports", "replace"]).ends(2).says("is for G-code");
}

#[test]
fn a_jobs_model_is_laid_beside_it() {
    let folder = folder_of("job.gcode", gcode(65, lamp_at).as_bytes());
    let path = |name: &str| folder.path().join(name);
    fs::write(path("lamp.stl"), lamp()).expect("the model");
    // The lamp lies at the origin, and the job prints it in the middle of the bed.
    let args = ["post", "job.gcode", "--supports", "lamp.stl", "-o", "out.gcode"];
    let run = outrigger(folder.path(), args);
    run.ends(1).says("X +100.00 Y +99.8").says("--align");
    assert_eq!(names(folder.path()), ["job.gcode", "lamp.stl"]);
    let report = json(folder.path(), &[&args[..], &["--align", "--report", "-"]].concat());
    for (axis, by) in [100.0, 100.0, 0.0].into_iter().enumerate() {
        let moved = report["model"]["moved_mm"][axis].as_f64().expect("a way");
        assert!((moved - by).abs() < 0.3, "{report}");
    }
    assert_eq!(report["islands"], 1, "{report}");
    let after = json(folder.path(), &["check", "out.gcode", "--json", "-"]);
    assert_eq!(count(&after["islands"]), 0, "{}", after["islands"]);
    // Once more, beside supports that hold all of it: nothing more is needed.
    let again = ["post", "out.gcode", "--supports", "lamp.stl", "--align", "-o", "again.gcode", "-q"];
    outrigger(folder.path(), again).ends(0);
    // Another model, none, and nothing to move.
    fs::write(path("cube.stl"), stl(&[[[0.0; 3], [9.0; 3]]])).expect("the model");
    let job = fs::read(path("job.gcode")).expect("the job");
    let post = |how: &[&str]| {
        outrigger(folder.path(), [&["post", "job.gcode", "--supports"], how, &["-o", "no.gcode"]].concat())
    };
    let size = "20.0 × 19.8 × 13.0 mm and the model is 9.0 × 9.0 × 9.0 mm";
    post(&["cube.stl", "--align"]).ends(1).says("cube.stl").says(size);
    post(&["job.gcode"]).ends(1).says("STL");
    post(&["none.stl"]).ends(2).says("nor is there a model of that name");
    post(&["auto", "--align"]).ends(2).says("--align");
    assert_eq!(fs::read(path("job.gcode")).expect("the job"), job);
    assert!(!names(folder.path()).contains(&"no.gcode".to_owned()));
}

#[test]
fn a_resin_jobs_model_tells_part_from_support() {
    // The lamp in pixels of 0.1 mm, 2 mm above the plate on a post of the slicer's.
    let at = |layer: usize| match layer {
        0..20 => vec![[110, 110, 130, 130]],
        20..70 => vec![[100, 100, 140, 140]],
        70..130 => vec![[100, 100, 140, 140], [170, 40, 190, 60]],
        130..150 => vec![[20, 20, 220, 220]],
        _ => vec![],
    };
    let folder = folder_of("job.sl1", &sl1(150, at));
    fs::write(folder.path().join("lamp.stl"), lamp()).expect("the model");
    let args = ["post", "job.sl1", "--supports", "lamp.stl", "-o", "out.sl1"];
    outrigger(folder.path(), args).ends(1).says("Z +2.00").says("--align");
    let report = json(folder.path(), &[&args[..], &["--align", "--report", "-"]].concat());
    for (axis, by) in [12.0, 12.0, 2.0].into_iter().enumerate() {
        let moved = report["model"]["moved_mm"][axis].as_f64().expect("a way");
        assert!((moved - by).abs() < 0.06, "{report}");
    }
    let after = json(folder.path(), &["check", "out.sl1", "--json", "-"]);
    assert_eq!(count(&after["islands"]), 0, "{}", after["islands"]);
}

#[test]
fn a_job_that_no_supports_can_go_into_stays() {
    let spiral = fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("gcode/corpus/ps25-marlin-vase.gcode"));
    let folder = folder_of("vase.gcode", &spiral.expect("the corpus"));
    let before = fs::read(folder.path().join("vase.gcode")).expect("the job");
    let run = outrigger(folder.path(), ["post", "vase.gcode", "--supports", "auto"]);
    run.ends(0).says("left as it was");
    assert_eq!(fs::read(folder.path().join("vase.gcode")).expect("the job"), before);
    let with_output = ["post", "vase.gcode", "--supports", "auto", "-o", "out.gcode"];
    let run = outrigger(folder.path(), with_output);
    assert!(run.code == Some(1) || run.stderr.contains("nothing in it needs support"), "{run:?}");
}

const SETTINGS: &str = "display_width = 24\ndisplay_height = 24\ndisplay_pixels_x = 240\ndisplay_pixels_y = 240\ndisplay_orientation = landscape\ndisplay_mirror_x = 1\ndisplay_mirror_y = 0\n";

/// An SL1 job of 240 × 240 px of 0.1 mm by rectangles of pixels at each layer.
fn sl1(layers: usize, at: impl Fn(usize) -> Vec<[usize; 4]>) -> Vec<u8> {
    sl1_of(SETTINGS, layers, at)
}

/// The same with a display of other settings.
fn sl1_of(settings: &str, layers: usize, at: impl Fn(usize) -> Vec<[usize; 4]>) -> Vec<u8> {
    let config = format!(
        "jobDir = a\nlayerHeight = 0.1\nexpTime = 5\nexpTimeFirst = 30\nnumFade = 2\nnumFast = {layers}\nnumSlow = 0\nprinterModel = SL1\n"
    );
    let mut entries = vec![
        ("config.ini".to_owned(), config.into_bytes()),
        ("prusaslicer.ini".to_owned(), settings.as_bytes().to_vec()),
        ("of another program".to_owned(), b"?".to_vec()),
    ];
    entries.extend((0..layers).map(|n| (format!("a{n:05}.png"), png([240, 240], &at(n)))));
    archive(&entries)
}

#[test]
fn resin_jobs_get_what_holds_them() {
    let at = |layer: usize| match layer {
        0..40 => vec![[100, 100, 140, 140]],
        40..70 => vec![[100, 100, 140, 140], [180, 150, 190, 160]],
        _ => vec![[100, 100, 200, 170]],
    };
    let folder = folder_of("job.sl1", &sl1(90, at));
    let check = |file: &str| json(folder.path(), &["check", file, "--json", "-"]);
    assert_eq!(count(&check("job.sl1")["islands"]), 1);
    let args = ["post", "job.sl1", "--supports", "auto", "-o", "out.sl1", "--report", "-"];
    let report = json(folder.path(), &args);
    assert_eq!((&report["process"], &report["islands"]), (&"resin".into(), &1.into()));
    assert_eq!(count(&check("out.sl1")["islands"]), 0);
    // What another program put there is there; pictures above all supports are the same bytes.
    let read = |name: &str| {
        let file = fs::File::open(folder.path().join(name)).expect("the job");
        zip::ZipArchive::new(file).expect("an archive")
    };
    let (mut before, mut after) = (read("job.sl1"), read("out.sl1"));
    let bytes = |archive: &mut zip::ZipArchive<fs::File>, name: &str| {
        let mut bytes = Vec::new();
        archive.by_name(name).expect("an entry").read_to_end(&mut bytes).expect("its bytes");
        bytes
    };
    for name in ["of another program", "config.ini", "prusaslicer.ini", "a00089.png"] {
        assert_eq!(bytes(&mut before, name), bytes(&mut after, name), "{name}");
    }
    // The peg of 1 mm begins at layer 40: right below, something of a tip's width is there.
    let lit = |png: &[u8]| {
        let mut reader = png::Decoder::new(Cursor::new(png)).read_info().expect("a picture");
        let mut pixels = vec![0; reader.output_buffer_size().expect("its size")];
        reader.next_frame(&mut pixels).expect("its rows");
        let row = |y: usize| pixels[y * 240 + 175..y * 240 + 195].iter();
        (145..165).flat_map(row).filter(|p| **p > 127).count()
    };
    assert_eq!(lit(&bytes(&mut before, "a00039.png")), 0);
    let tip = lit(&bytes(&mut after, "a00039.png"));
    assert!((8..=40).contains(&tip), "{tip} pixels for a tip of 0.4 mm");
    // Into another format as well.
    outrigger(folder.path(), ["post", "job.sl1", "--supports", "auto", "-q", "-o", "out.goo"]).ends(0);
    let goo = check("out.goo");
    assert_eq!((count(&goo["islands"]), &goo["kind"]), (0, &"goo".into()));
}

#[test]
fn specks_of_a_resin_job_are_no_supports_in_the_air() {
    // Pixels of 0.05 mm: one of them alone is less than what counts.
    let small = SETTINGS.replace("= 24\n", "= 12\n");
    let at = |layer: usize| match layer {
        0..40 => vec![[100, 100, 140, 140], [50, 20, 51, 21]][..if layer == 30 { 2 } else { 1 }].to_vec(),
        _ => vec![[100, 100, 200, 170]],
    };
    let folder = folder_of("job.sl1", &sl1_of(&small, 60, at));
    let before = json(folder.path(), &["check", "job.sl1", "--json", "-"]);
    assert_eq!((count(&before["islands"]), count(&before["small_islands"])), (0, 1), "{before}");
    outrigger(folder.path(), ["post", "job.sl1", "--supports", "auto", "-q", "-o", "out.sl1"]).ends(0);
    assert_eq!(names(folder.path()), ["job.sl1", "out.sl1"]);
}
