//! Made resin jobs with issues that are known, 20 of each kind at random places: `outrigger check` finds
//! all of them where they are, and invents none.
mod common;

use common::made::{archive, png};
use common::printer::BINARY;
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

/// The panel, px, with pixels of 1/20 mm. Layers have 0.1 mm.
const PANEL: [usize; 2] = [320, 240];
const PIXEL_MM: f64 = 0.05;
const LAYERS: usize = 24;
const CASES: u64 = 20;

/// A block in the middle that all stands on.
const BLOCK: Rectangle = [100, 60, 220, 180];

/// Left, top, and the column and row behind the last.
type Rectangle = [usize; 4];

/// Kind, first and last layer, and the rectangle that it lies in where it has a place.
type Expected = (&'static str, usize, usize, Option<Rectangle>);

/// Numbers that look random: xorshift64*.
struct Dice(u64);

impl Dice {
    fn of(&mut self, from: usize, to: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        let number = self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 33;
        from + number as usize % (to - from + 1)
    }

    /// A rectangle of such sides within another one.
    fn within(&mut self, [left, top, right, bottom]: Rectangle, least: usize, most: usize) -> Rectangle {
        let (width, height) = (self.of(least, most), self.of(least, most));
        let (x, y) = (self.of(left, right - width), self.of(top, bottom - height));
        [x, y, x + width, y + height]
    }

    /// First and last of some layers.
    fn layers(&mut self, from: usize, to: usize, least: usize) -> [usize; 2] {
        let first = self.of(from, to + 1 - least);
        [first, self.of(first + least - 1, to)]
    }
}

/// A job on its way.
struct Made {
    bright: Vec<Vec<Rectangle>>,
    exposures: [f64; 2],
}

impl Made {
    fn new() -> Made {
        Made { bright: vec![vec![BLOCK]; LAYERS], exposures: [30.0, 6.0] }
    }

    fn add(&mut self, [first, last]: [usize; 2], rectangle: Rectangle) {
        self.bright[first..=last].iter_mut().for_each(|layer| layer.push(rectangle));
    }

    /// Cuts a rectangle out of the block, which is all that those layers have.
    fn cut(&mut self, [first, last]: [usize; 2], [left, top, right, bottom]: Rectangle) {
        let [x0, y0, x1, y1] = BLOCK;
        let frame =
            vec![[x0, y0, x1, top], [x0, bottom, x1, y1], [x0, top, left, bottom], [right, top, x1, bottom]];
        self.bright[first..=last].iter_mut().for_each(|layer| layer.clone_from(&frame));
    }

    fn job(&self) -> Vec<u8> {
        let [first_s, usual_s] = self.exposures;
        let [wide, high] = PANEL;
        let config = format!(
            "expTime = {usual_s}\nexpTimeFirst = {first_s}\njobDir = job\nlayerHeight = 0.1\nnumFade = 4\n\
             numFast = {LAYERS}\nnumSlow = 0\n"
        );
        let settings = format!(
            "display_width = {}\ndisplay_height = {}\ndisplay_pixels_x = {wide}\ndisplay_pixels_y = {high}\n\
             display_orientation = landscape\ndisplay_mirror_x = 0\ndisplay_mirror_y = 0\ninitial_layer_height = 0.1\n",
            wide as f64 * PIXEL_MM,
            high as f64 * PIXEL_MM
        );
        let mut entries = vec![
            ("config.ini".to_owned(), config.into_bytes()),
            ("prusaslicer.ini".to_owned(), settings.into_bytes()),
        ];
        for (k, bright) in self.bright.iter().enumerate() {
            entries.push((format!("job{k:05}.png"), png(PANEL, bright)));
        }
        archive(&entries)
    }
}

/// What the verb finds in a job.
fn issues(job: &[u8]) -> Vec<Value> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("job.sl1");
    std::fs::write(&file, job).unwrap();
    issues_of(&file)
}

fn issues_of(file: &Path) -> Vec<Value> {
    let done =
        Command::new(BINARY).args(["check", "--overhang", "none", "--json", "-"]).arg(file).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(report["resin"]["unlisted"], 0);
    report["resin"]["issues"].as_array().unwrap().clone()
}

#[track_caller]
fn check(made: &Made, expect: &[Expected]) {
    let found = issues(&made.job());
    let kinds: Vec<&str> = found.iter().map(|issue| issue["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, expect.iter().map(|e| e.0).collect::<Vec<_>>(), "{found:#?}");
    for (issue, (kind, first, last, place)) in found.iter().zip(expect) {
        assert_eq!(
            (&issue["layer"], &issue["end_layer"]),
            (&Value::from(*first), &Value::from(*last)),
            "{kind}: {issue}"
        );
        let Some([left, top, right, bottom]) = place else {
            assert!(issue["centroid_mm"].is_null(), "{issue}");
            continue;
        };
        // Upright pictures: rows run to the front of the plate.
        let mm = |px: usize| px as f64 * PIXEL_MM;
        let expect = [[mm(*left), mm(PANEL[1] - bottom)], [mm(*right), mm(PANEL[1] - top)]];
        for corner in 0..2 {
            for axis in 0..2 {
                let is = issue["bbox_mm"][corner][axis].as_f64().unwrap();
                assert!((is - expect[corner][axis]).abs() < 1e-9, "{kind}: {issue} for {expect:?}");
            }
        }
    }
}

fn cases(make: impl Fn(&mut Dice, &mut Made) -> Vec<Expected>) {
    for case in 1..=CASES {
        let mut made = Made::new();
        let expect = make(&mut Dice(case.wrapping_mul(0x9e37_79b9_7f4a_7c15)), &mut made);
        check(&made, &expect);
    }
}

/// Beside the block, and off the panel's margin.
const BESIDE: Rectangle = [6, 6, 94, 234];

/// Within the block.
const INSIDE: Rectangle = [104, 64, 216, 176];

#[test]
fn nothing_is_invented() {
    check(&Made::new(), &[]);
}

#[test]
fn islands_are_found() {
    cases(|dice, made| {
        let (layers, place) = (dice.layers(1, LAYERS - 1, 1), dice.within(BESIDE, 1, 40));
        made.add(layers, place);
        vec![("island", layers[0], layers[0], Some(place))]
    });
}

#[test]
fn overhangs_are_found() {
    cases(|dice, made| {
        let first = dice.of(1, LAYERS - 1);
        // A slab to the right of the block, so large that a pixel in it is far from all.
        let (width, top, bottom) = (dice.of(81, 90), dice.of(61, 80), dice.of(165, 180));
        let slab = [BLOCK[2], top, BLOCK[2] + width, bottom];
        made.add([first, LAYERS - 1], slab);
        vec![("overhang", first, first, Some(slab))]
    });
    // What is no wider than 80 px is near something everywhere.
    let mut made = Made::new();
    made.add([5, LAYERS - 1], [BLOCK[2], 62, BLOCK[2] + 80, 178]);
    check(&made, &[]);
}

#[test]
fn resin_traps_are_found() {
    cases(|dice, made| {
        let (layers, place) = (dice.layers(0, LAYERS - 2, 1), dice.within(INSIDE, 4, 60));
        made.cut(layers, place);
        vec![("resin_trap", layers[0], layers[1], Some(place))]
    });
}

#[test]
fn a_hole_is_proposed_through_the_thinnest_wall() {
    for case in 1..=CASES {
        let (mut dice, mut made) = (Dice(case), Made::new());
        let place = dice.within(INSIDE, 30, 60);
        made.cut([2, 20], place);
        let found = issues(&made.job());
        let hole = &found[0]["hole"];
        let [left, top, right, bottom] = place;
        let walls = [left - BLOCK[0], top - BLOCK[1], BLOCK[2] - right, BLOCK[3] - bottom];
        // From the middle of a pixel to the middle of another.
        let expect_mm = (walls.into_iter().min().unwrap() + 1) as f64 * PIXEL_MM;
        assert!((hole["length_mm"].as_f64().unwrap() - expect_mm).abs() < 1e-9, "{place:?}: {hole}");
        // 1 mm above the lowest layer, whose top is at 0.3 mm.
        let top_mm = hole["top_mm"].as_f64().unwrap();
        assert!((1.29..1.41).contains(&top_mm), "{hole}");
    }
}

#[test]
fn suction_cups_are_found() {
    cases(|dice, made| {
        let (first, place) = (dice.of(0, LAYERS - 6), dice.within(INSIDE, 10, 60));
        made.cut([first, LAYERS - 1], place);
        vec![("suction_cup", first, LAYERS - 1, Some(place))]
    });
}

#[test]
fn what_touches_the_panels_edge_is_found() {
    cases(|dice, made| {
        let last = dice.of(0, LAYERS - 1);
        let (along, depth) = (dice.of(6, 200), dice.of(1, 5));
        let [wide, high] = PANEL;
        let place = match dice.of(0, 3) {
            0 => [along, 5 - depth, along + 20, 5],
            1 => [along, high - 5, along + 20, high - 5 + depth],
            2 => [5 - depth, along, 5, along + 20],
            _ => [wide - 5, along, wide - 5 + depth, along + 20],
        };
        made.add([0, last], place);
        vec![("touching_bounds", 0, last, Some(place))]
    });
}

#[test]
fn empty_layers_are_found() {
    cases(|dice, made| {
        let [first, last] = dice.layers(1, LAYERS - 1, 1);
        made.bright[first..=last].iter_mut().for_each(Vec::clear);
        let mut expect = vec![("empty_layer", first, last, None)];
        if last < LAYERS - 1 {
            // Nothing holds what comes above, and it is wide.
            let above = |kind| (kind, last + 1, last + 1, Some(BLOCK));
            expect = vec![above("island"), above("overhang"), expect[0]];
        }
        expect
    });
}

#[test]
fn odd_exposures_are_found() {
    cases(|dice, made| {
        let usual_s = dice.of(2, 12) as f64;
        let (exposures, expect) = match dice.of(0, 3) {
            0 => ([30.0, 0.0], vec![("exposure", 4, LAYERS - 1, None)]),
            1 => ([30.0, usual_s / 100.0], vec![("exposure", 4, LAYERS - 1, None)]),
            2 => (
                [30.0 * usual_s, usual_s],
                if 30.0 * usual_s > 300.0 { vec![("exposure", 0, 0, None)] } else { vec![] },
            ),
            _ => ([usual_s / 2.0, usual_s], vec![("exposure", 0, 0, None)]),
        };
        made.exposures = exposures;
        expect
    });
}

/// `outrigger post` with those arguments, in a folder.
fn post(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(BINARY).arg("post").args(arguments).current_dir(folder).output().unwrap()
}

#[test]
fn islands_that_stay_small_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut made = Made::new();
    // 0.25 mm², 2.25 mm², and one that grows: it wants support.
    let (small, large, tip, grown) =
        ([20, 20, 30, 30], [20, 60, 50, 90], [20, 150, 24, 154], [20, 150, 80, 190]);
    made.add([4, 9], small);
    made.add([4, 9], large);
    made.add([4, 5], tip);
    made.add([6, LAYERS - 1], grown);
    let job = made.job();
    std::fs::write(path("job.sl1"), &job).unwrap();
    let done = post(folder.path(), &["--remove-islands", "0.5", "-o", "out.sl1", "--report", "-", "job.sl1"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    for (key, expect) in
        [("removed_islands", 1), ("removed_pixels", 600), ("layers_changed", 6), ("islands_left", 3)]
    {
        assert_eq!(report[key], expect, "{report}");
    }
    // The large one, the tip, and what is too wide for its tip.
    let left: Vec<u64> = issues_of(&path("out.sl1"))
        .iter()
        .filter(|i| i["kind"] == "island")
        .map(|i| i["layer"].as_u64().unwrap())
        .collect();
    assert_eq!(left, [4, 4, 6]);
    assert!(std::fs::read(path("job.sl1")).unwrap() == job, "FILE stays");
    // In place, and in another format.
    let done = post(folder.path(), &["--remove-islands", "3", "job.sl1"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(issues_of(&path("job.sl1")).iter().filter(|i| i["kind"] == "island").count(), 2);
    let done = post(folder.path(), &["--remove-islands", "0.1", "-o", "out.goo", "job.sl1"]);
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    assert_eq!(issues_of(&path("out.goo")).iter().filter(|i| i["kind"] == "island").count(), 2);
}

#[test]
fn where_no_island_stays_small_the_job_stays() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut made = Made::new();
    made.add([4, 9], [20, 60, 50, 90]);
    let job = made.job();
    std::fs::write(path("job.sl1"), &job).unwrap();
    let said = |done: &Output| String::from_utf8_lossy(&done.stderr).into_owned();
    let done = post(folder.path(), &["--remove-islands", "0.5", "job.sl1"]);
    assert!(done.status.success() && said(&done).contains("left as it was"), "{}", said(&done));
    let done = post(folder.path(), &["--remove-islands", "0.5", "-o", "copy.sl1", "job.sl1"]);
    assert!(done.status.success(), "{}", said(&done));
    for name in ["job.sl1", "copy.sl1"] {
        assert!(std::fs::read(path(name)).unwrap() == job, "{name}");
    }
    for wrong in ["-1", "0", "x"] {
        assert_eq!(
            post(folder.path(), &["--remove-islands", wrong, "job.sl1"]).status.code(),
            Some(2),
            "{wrong}"
        );
    }
    std::fs::write(path("job.gcode"), "G28\n").unwrap();
    assert_eq!(post(folder.path(), &["--remove-islands", "1", "job.gcode"]).status.code(), Some(2));
}
