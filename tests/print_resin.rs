//! `outrigger print` with resin jobs through the real binary, against the mock printer.
//!
//! What cannot be printed well is refused before the plate moves, with what to do about it. What can is
//! shown, exposed and lifted once a layer, whatever happens in between.
mod common;

use common::made::{archive, png};
use common::printer::{Mock, output, signal, text, wait_for, wait_until};
use serde_json::Value;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The panel: small, since pictures are slow to unpack without optimisation.
const PX: [usize; 2] = [40, 30];

/// Layers of the job, of 0.1 mm.
const LAYERS: usize = 6;

type Entries = Vec<(String, Vec<u8>)>;

/// A layer's picture; all differ.
fn picture(layer: usize) -> Vec<u8> {
    png(PX, &[[layer, 4, layer + 12, 20]])
}

fn config(exposure: &str, layers: usize) -> String {
    format!(
        "expTime = {exposure}\nexpTimeFirst = {exposure}\njobDir = job\nlayerHeight = 0.1\nnumFade = 0\nnumFast = {layers}\nnumSlow = 0\n"
    )
}

fn slicer([wide, high]: [usize; 2], more: &str) -> String {
    format!(
        "display_width = {wide}\ndisplay_height = {high}\ndisplay_pixels_x = {wide}\ndisplay_pixels_y = {high}\ndisplay_orientation = landscape\ninitial_layer_height = 0.1\n{more}"
    )
}

/// A good job, exposed for `s` seconds.
fn job(s: &str) -> Entries {
    let mut entries = vec![
        ("config.ini".to_owned(), config(s, LAYERS).into_bytes()),
        ("prusaslicer.ini".to_owned(), slicer(PX, "").into_bytes()),
    ];
    entries.extend((0..LAYERS).map(|layer| (format!("job{layer:05}.png"), picture(layer))));
    entries
}

/// A printer for it.
const PROFILE: &str = r#"
name = "tiny"
title = "A resin printer for tests"
kind = "msla"
firmware = "marlin"
[bed]
shape = "rectangle"
origin = "corner"
x_mm = 40
y_mm = 30
z_mm = 60
[serial]
baud = 115200
window = { bytes = 120 }
max_line = 95
dtr_reset = false
[lcd]
width_px = 40
height_px = 30
pixels = "grey"
sink = { folder = "/dev/null/shown" }
settle_ms = 200
[light]
on = "M106 S{power}"
off = "M107"
timed_by = "controller"
off_when_halted = false
[plate]
homes = "up"
lift = { slow_mm = 2, slow_mm_min = 120, fast_mm = 3, fast_mm_min = 300 }
retract = { slow_mm = 2, slow_mm_min = 120, fast_mm_min = 300 }
settle_ms = 20
rest_ms = 20
top_ms = 0
max_mm_min = 600
accel_mm_s2 = 100
[macros]
cancel = '''
M107
G91
G1 Z20 F600
G90
M400'''
"#;

/// A mock of this printer, with a profile and a job in its folder.
struct Rig {
    mock: Mock,
    profile: PathBuf,
    _folder: tempfile::TempDir,
}

impl Rig {
    fn new(speed: &str, profile: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tiny.toml");
        fs::write(&path, profile).unwrap();
        let mock = Mock::steady(&["--speed", speed, "--profile", path.to_str().unwrap()], "");
        Self { mock, profile: path, _folder: folder }
    }

    /// `outrigger print` with what is usual.
    fn print(&self, entries: &Entries) -> Command {
        let path = self.mock.path("job.sl1");
        fs::write(&path, archive(entries)).unwrap();
        let mut command = self.mock.outrigger();
        command.arg("print").arg(path).arg("--port").arg(self.mock.path("tty"));
        command.arg("--profile").arg(&self.profile).arg("--lcd-folder").arg(self.mock.path("shown"));
        command.arg("--no-guard");
        command
    }

    fn resume(&self, args: &[&str]) -> std::process::Output {
        let mut command = self.mock.outrigger();
        command.args(["jobs", "resume", "1", "--no-guard", "--lcd-folder"]).arg(self.mock.path("shown"));
        output(command.args(args))
    }

    /// The lines of `shown.jsonl` so far: what was shown, and its sum.
    fn shown(&self) -> Vec<(String, String)> {
        shown(&self.mock.path("shown"))
    }

    /// Waits until so many pictures were shown.
    fn wait_for_picture(&self, n: usize) {
        let pictures = || self.shown().iter().filter(|(what, _)| what != "blank").count();
        wait_until("a picture", || pictures() >= n);
    }
}

fn shown(folder: &Path) -> Vec<(String, String)> {
    let text = fs::read_to_string(folder.join("shown.jsonl")).unwrap_or_default();
    let line = |line: &str| {
        let value: Value = serde_json::from_str(line).ok()?;
        let word = |key: &str| value[key].as_str().unwrap().to_owned();
        Some((word("picture"), word("sum")))
    };
    text.lines().filter_map(line).collect()
}

/// The pixels of a picture.
fn pixels(png: &[u8]) -> Vec<u8> {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut pixels = vec![0; PX[0] * PX[1]];
    reader.next_frame(&mut pixels).unwrap();
    pixels
}

/// Which layer each picture was that was shown, in order, by its pixels.
fn layers_shown(folder: &Path) -> Vec<usize> {
    let pictures: Vec<_> = (0..LAYERS).map(|layer| pixels(&picture(layer))).collect();
    let layer = |(what, _): &(String, String)| {
        let found = pixels(&fs::read(folder.join(format!("{what}.png"))).unwrap());
        pictures.iter().position(|picture| *picture == found).unwrap()
    };
    shown(folder).iter().filter(|(what, _)| what != "blank").map(layer).collect()
}

/// The mock's counts after a job: exposures, the seconds of light, and that nothing was harmed.
#[track_caller]
fn check_light(stats: &Value, pulses: u64, seconds: std::ops::Range<f64>) {
    let light_s = stats["light_s"].as_f64().unwrap();
    assert_eq!(stats["light_pulses"], pulses, "{stats}");
    assert!(seconds.contains(&light_s), "{light_s} s of light, not {seconds:?}");
    assert_eq!([&stats["light_moved"], &stats["crashes"]], [&Value::from(0); 2], "{stats}");
    assert_eq!(stats["light_on"], false, "{stats}");
}

#[test]
fn bad_input_is_refused_before_the_plate_moves() {
    let rig = Rig::new("200", PROFILE);
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).unwrap();
        folder.path().join(name)
    };
    // A file for a profile is refused with words, and before anything is sent.
    let check = |file: PathBuf, profile: &str, args: &[&str], expect: &[&str]| {
        let name = if profile.contains('\n') { "of-case.toml" } else { profile };
        if name != profile {
            fs::write(folder.path().join(name), profile).unwrap();
        }
        let mut command = rig.mock.outrigger();
        command.current_dir(folder.path()).arg("print").arg(&file).arg("--port").arg(rig.mock.path("tty"));
        let out = output(command.args(["--profile", name]).args(args));
        let said = text(&out.stderr);
        assert_eq!(out.status.code(), Some(1), "{file:?} {expect:?}: {said}");
        for words in expect {
            assert!(said.contains(words), "no {words:?} of {file:?} in: {said}");
        }
    };
    let shown = ["--lcd-folder", "shown"];
    let sl1 = |name: &str, entries: &Entries, expect: &[&str]| {
        check(file(name, &archive(entries)), PROFILE, &shown, expect);
    };
    let without = |name: &str| -> Entries { job("2").into_iter().filter(|(n, _)| n != name).collect() };
    let with = |name: &str, bytes: &[u8]| -> Entries {
        let mut entries = without(name);
        entries.push((name.to_owned(), bytes.to_vec()));
        entries
    };
    // Layers.
    sl1("missing.sl1", &without("job00002.png"), &["layer 2 is missing", "export the job again"]);
    sl1("last-missing.sl1", &without("job00005.png"), &["announces 6 layers, the archive holds 5"]);
    sl1("extra.sl1", &with("job00006.png", &picture(6)), &["announces 6 layers, the archive holds 7"]);
    let from_one: Entries = job("2")
        .into_iter()
        .map(|(name, bytes)| match name.strip_prefix("job").and_then(|n| n[..5].parse::<usize>().ok()) {
            Some(n) => (format!("job{:05}.png", n + 1), bytes),
            None => (name, bytes),
        })
        .collect();
    sl1("from-one.sl1", &from_one, &["layer 0 is missing", "export the job again"]);
    sl1("twice.sl1", &with("job000002.png", &picture(2)), &["layer 2 has two pictures"]);
    let large = png([80, 60], &[[1, 1, 9, 9]]);
    sl1("oversized.sl1", &with("job00003.png", &large), &["layer 3", "80 × 60 px", "40 × 30"]);
    let mut damaged = picture(3);
    let middle = damaged.len() / 2;
    damaged[middle] ^= 0x55;
    sl1(
        "damaged.sl1",
        &with("job00003.png", &damaged),
        &["layer 3", "cannot be read", "export the job again"],
    );
    sl1("cut.sl1", &with("job00003.png", &picture(3)[..60]), &["layer 3", "cannot be read"]);
    sl1("text.sl1", &with("job00003.png", b"no picture"), &["layer 3", "cannot be read"]);
    let mut last = job("2");
    last.last_mut().unwrap().1.truncate(60);
    sl1("last-cut.sl1", &last, &["layer 5", "cannot be read"]);
    // Archives.
    let whole = archive(&job("2"));
    check(file("half.sl1", &whole[..whole.len() / 2]), PROFILE, &shown, &["cut off or damaged"]);
    let mut turned = whole.clone();
    let at = whole.windows(4).position(|four| four == b"IDAT").unwrap_or(whole.len() / 3);
    turned[at + 6] ^= 0xff;
    check(file("turned.sl1", &turned), PROFILE, &shown, &["export"]);
    let bomb = vec![0; 80 << 20];
    sl1("bomb.sl1", &with("job00003.png", &bomb), &["job00003.png", "bytes", "at most"]);
    sl1("settings-bomb.sl1", &with("config.ini", &bomb[..8 << 20]), &["config.ini", "at most"]);
    check(file("empty.sl1", b""), PROFILE, &shown, &["tiny is a resin printer"]);
    check(folder.path().join("gone.sl1"), PROFILE, &shown, &["No such file"]);
    check(folder.path().to_owned(), PROFILE, &shown, &["this is a directory"]);
    // Settings.
    sl1("no-config.sl1", &without("config.ini"), &["neither config.ini"]);
    sl1("no-panel.sl1", &without("prusaslicer.ini"), &["prusaslicer.ini"]);
    let exposed = |s: &str| with("config.ini", config(s, LAYERS).as_bytes());
    sl1("negative.sl1", &exposed("-1"), &["expTime = -1", "export the job again"]);
    sl1("endless.sl1", &exposed("10000"), &["expTime = 10000", "export the job again"]);
    sl1("nan.sl1", &exposed("nan"), &["expTime = nan"]);
    sl1("untold.sl1", &exposed(""), &["no expTime", "export the job again"]);
    sl1("zero.sl1", &exposed("0"), &["layer 0 is to be exposed for 0 s", "in the slicer"]);
    sl1("long.sl1", &exposed("130"), &["exposed for 130 s", "light.most_s"]);
    let flat = config("2", LAYERS).replace("layerHeight = 0.1", "layerHeight = 0");
    sl1("flat.sl1", &with("config.ini", flat.as_bytes()), &["layerHeight = 0"]);
    // Panels.
    let of = |px: [usize; 2], more: &str| with("prusaslicer.ini", slicer(px, more).as_bytes());
    let all = |px: [usize; 2]| -> Entries {
        let paint = |(name, bytes): (String, Vec<u8>)| match name.ends_with(".png") {
            true => (name, png(px, &[[1, 1, 9, 9]])),
            false => (name, bytes),
        };
        of(px, "").into_iter().map(paint).collect()
    };
    sl1("other.sl1", &all([44, 30]), &["another panel", "44 × 30", "40 × 30", "Export it for this printer"]);
    sl1("portrait.sl1", &all([30, 40]), &["turned by a quarter", "portrait or landscape"]);
    sl1("mirrored.sl1", &of(PX, "display_mirror_x = 1\n"), &["left to right", "mirror image", "lcd.mirror"]);
    let mirrored = PROFILE.replace("settle_ms = 200", "settle_ms = 200\nmirror = \"y\"");
    check(file("plain.sl1", &whole), &mirrored, &shown, &["top to bottom", "lcd.mirror"]);
    // Printers.
    let low = PROFILE.replace("z_mm = 60", "z_mm = 10");
    let low = low.replace("top_ms = 0", "top_ms = 0\nclear_mm = 5");
    let tall = |layers: usize| -> Vec<u8> {
        let config = config("2", layers).replace("layerHeight = 0.1", "layerHeight = 1");
        let slicer = slicer(PX, "").replace("height = 0.1", "height = 1");
        let mut entries = vec![
            ("config.ini".to_owned(), config.into_bytes()),
            ("prusaslicer.ini".to_owned(), slicer.into_bytes()),
        ];
        entries.extend((0..layers).map(|layer| (format!("job{layer:05}.png"), picture(layer))));
        archive(&entries)
    };
    check(file("high.sl1", &tall(11)), &low, &shown, &["reaches 10 mm", "make the part lower", "bed.z_mm"]);
    check(file("no-room.sl1", &tall(10)), &low, &shown, &["no room for a lift", "reaches 10 mm"]);
    check(file("job.gcode", b"G28\nG1 X1\n"), PROFILE, &shown, &["is a resin printer", "SL1"]);
    check(file("job.sl1", &whole), "generic-marlin", &[], &["prints filament", "msla"]);
    check(file("other.sl1", &whole), "prusa-mk4", &["--lcd-folder", "shown"], &["prints filament"]);
    // Displays.
    let vanished = PROFILE.replace("folder = \"/dev/null/shown\"", "framebuffer = \"fb77\"");
    check(file("fb.sl1", &whole), &vanished, &[], &["there is no display", "fb77", "driver"]);
    check(file("folder.sl1", &whole), PROFILE, &[], &["/dev/null/shown"]);
    // What a person sees to.
    let asks = format!("{PROFILE}\n[[before]]\nwhat = \"the vat is full\"\n");
    check(file("asks.sl1", &whole), &asks, &shown, &["the vat is full", "--ready"]);
    let deaf = asks.replace("is full\"", "is full\"\nsend = \"M115\"\nwants = \"FIRMWARE\"");
    check(file("deaf.sl1", &whole), &deaf, &shown, &["cannot ask with M115", "M119"]);
    let stats = rig.mock.stats();
    for (count, key) in [(0, "lines_accepted"), (0, "moves"), (0, "light_pulses"), (0, "connects")] {
        assert_eq!(stats[key], count, "{key}: {stats}");
    }
}

#[test]
fn a_sensor_that_does_not_say_so_keeps_all_still() {
    let asks = |wants: &str| {
        format!(
            "{PROFILE}\n[[before]]\nwhat = \"the cover is closed\"\nsend = \"M118 cover: closed\"\nwants = \"{wants}\"\n"
        )
    };
    let rig = Rig::new("200", &asks("NEVER"));
    let out = output(&mut rig.print(&job("2")));
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    for words in ["nothing was moved", "the cover is closed", "M118 cover", "NEVER"] {
        assert!(said.contains(words), "no {words:?} in {said}");
    }
    assert_eq!(rig.mock.record(1)["state"], "failed");
    assert!(layers_shown(&rig.mock.path("shown")).is_empty());
    let stats = rig.mock.stats();
    assert_eq!([&stats["moves"], &stats["light_pulses"]], [&Value::from(0); 2], "{stats}");
    // One that says so.
    let rig = Rig::new("200", &asks("cover: closed"));
    let out = output(&mut rig.print(&job("2")));
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    check_light(&rig.mock.stats(), LAYERS as u64, 11.9..12.2);
}

#[test]
fn every_layer_is_shown_and_exposed_once_and_in_order() {
    let rig = Rig::new("40", PROFILE);
    let out = output(&mut rig.print(&job("4")));
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{said}");
    assert!(text(&out.stdout).contains("printed"), "{}", text(&out.stdout));
    assert!(said.contains(&format!("{LAYERS} exposures, ")), "{said}");
    let shown = rig.shown();
    assert_eq!(layers_shown(&rig.mock.path("shown")), (0..LAYERS).collect::<Vec<_>>());
    // Dark before the first, between any two, and behind the last.
    let left = common::names(&rig.mock.path("shown"));
    assert!(!left.iter().any(|name| name.starts_with('.')), "{left:?}");
    assert_eq!((shown[0].0.as_str(), shown[shown.len() - 1].0.as_str()), ("blank", "blank"));
    assert!(shown.windows(2).all(|two| two.iter().any(|(what, _)| what == "blank")), "{shown:?}");
    let dark: Vec<_> = shown.iter().filter(|(what, _)| what == "blank").map(|(_, sum)| sum).collect();
    assert!(dark.windows(2).all(|two| two[0] == two[1]));
    let mut sums: Vec<_> = shown.iter().filter(|(what, _)| what != "blank").map(|(_, sum)| sum).collect();
    sums.sort();
    sums.dedup();
    assert!(sums.len() == LAYERS && !sums.contains(&dark[0]));
    assert_eq!(rig.mock.record(1)["state"], "finished");
    check_light(&rig.mock.stats(), LAYERS as u64, 23.9..24.3);
}

#[test]
fn a_pause_comes_between_layers_and_costs_none() {
    let rig = Rig::new("20", PROFILE);
    let mut child = rig.print(&job("2")).arg("--commands").stdin(Stdio::piped()).spawn().unwrap();
    let mut words = child.stdin.take().unwrap();
    rig.wait_for_picture(2);
    writeln!(words, "pause").unwrap();
    wait_until("the pause", || rig.mock.record(1)["state"] == "paused");
    let count = rig.shown().len();
    assert_eq!(rig.shown()[count - 1].0, "blank", "light goes off, and the display dark, before it pauses");
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(rig.shown().len(), count);
    writeln!(words, "resume").unwrap();
    wait_for(&mut child);
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(0), "{}", text(&out.stderr));
    assert_eq!(layers_shown(&rig.mock.path("shown")), (0..LAYERS).collect::<Vec<_>>());
    check_light(&rig.mock.stats(), LAYERS as u64, 11.9..12.2);
}

#[test]
fn a_cancelled_job_ends_lifted_and_dark() {
    let rig = Rig::new("10", PROFILE);
    let mut child = rig.print(&job("4")).spawn().unwrap();
    rig.wait_for_picture(3);
    signal("INT", &child);
    wait_for(&mut child);
    let out = child.wait_with_output().unwrap();
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("cancelled"), "{said}");
    assert_eq!(rig.shown().last().unwrap().0, "blank");
    assert_eq!(rig.mock.record(1)["state"], "cancelled");
    let stats = rig.mock.stats();
    assert_eq!(stats["light_on"], false, "{stats}");
    assert_eq!(stats["light_moved"], 0, "{stats}");
    assert!(stats["true_position_mm"][2].as_f64() > Some(15.0), "{stats}");
}

/// Ends the host as a loss of power would.
fn kill(mut child: Child) {
    child.kill().unwrap();
    wait_for(&mut child);
}

/// The controller has the whole exposure, and makes it without its host.
#[test]
fn a_host_that_dies_in_an_exposure_costs_no_layer() {
    let rig = Rig::new("10", PROFILE);
    let child = rig.print(&job("4")).spawn().unwrap();
    rig.wait_for_picture(3);
    // It takes 0.4 s: the light is on by then.
    std::thread::sleep(Duration::from_millis(150));
    kill(child);
    let out = rig.resume(&[]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{said}");
    let layers = layers_shown(&rig.mock.path("shown"));
    let mut once = layers.clone();
    once.dedup();
    assert_eq!(once, (0..LAYERS).collect::<Vec<_>>(), "{layers:?}");
    assert_eq!(rig.mock.record(1)["state"], "finished");
    assert_eq!(rig.shown().last().unwrap().0, "blank");
    check_light(&rig.mock.stats(), LAYERS as u64, 23.9..24.4);
}

/// The host keeps the time: how long the light was on before it died nobody knows.
#[test]
fn a_torn_exposure_waits_for_a_persons_word() {
    let rig = Rig::new("10", &PROFILE.replace("\"controller\"", "\"host\""));
    let child = rig.print(&job("1.5")).spawn().unwrap();
    rig.wait_for_picture(3);
    // The host's clock is as slow as life: the light is on by then, and stays on for a second.
    std::thread::sleep(Duration::from_millis(500));
    kill(child);
    let out = rig.resume(&[]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("in the middle of an exposure"), "{said}");
    assert_eq!(rig.mock.record(1)["state"], "interrupted");
    let out = rig.resume(&[]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(1), "{said}");
    assert!(said.contains("or plate, are clear") && said.contains("--yes-part-and-"), "{said}");
    let out = rig.resume(&["--yes-part-and-plate-are-clear"]);
    let said = text(&out.stderr);
    assert_eq!(out.status.code(), Some(0), "{said}");
    let mut layers = layers_shown(&rig.mock.path("shown"));
    assert_eq!(layers.len(), LAYERS + 1, "{layers:?}");
    layers.dedup();
    assert_eq!(layers, (0..LAYERS).collect::<Vec<_>>());
    assert_eq!(rig.mock.record(1)["state"], "finished");
    let stats = rig.mock.stats();
    assert_eq!(stats["light_pulses"], LAYERS as u64 + 1, "{stats}");
    assert_eq!([&stats["light_moved"], &stats["crashes"]], [&Value::from(0); 2], "{stats}");
}
