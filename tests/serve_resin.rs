//! A resin printer behind `outrigger serve`, through the real binary: upload, check, mend, a person's word, print to
//! the end on the mock, whose pictures a folder shows.
mod common;

use common::http::{Answer, Daemon, poll_until};
use common::made::{archive, png};
use common::printer::{Mock, wait_until};
use outrigger::printer::lcd::sum::Sum;
use serde_json::{Value, json};
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The panel, px, with pixels of 0.1 mm. Layers have 0.2 mm.
const PANEL: [usize; 2] = [160, 120];
const LAYERS: usize = 25;

/// A block that stands on the plate: left, top, and the column and row behind the last.
const BLOCK: [usize; 4] = [30, 30, 70, 90];

/// A piece that begins in the air beside it, and from which layer on.
const ISLAND: ([usize; 4], usize) = ([95, 45, 120, 70], 15);

/// An SL1 job: with a piece in the air or without, exposed so long, for a panel of so many pixels.
fn job(island: bool, exposure_s: f64, [wide, high]: [usize; 2]) -> Vec<u8> {
    let config = format!(
        "expTime = {exposure_s}\nexpTimeFirst = {exposure_s}\njobDir = job\nlayerHeight = 0.2\nnumFade = 0\n\
         numFast = {LAYERS}\nnumSlow = 0\n"
    );
    let settings = format!(
        "display_width = {}\ndisplay_height = {}\ndisplay_pixels_x = {wide}\ndisplay_pixels_y = {high}\n\
         display_orientation = landscape\ndisplay_mirror_x = 0\ndisplay_mirror_y = 0\ninitial_layer_height = 0.2\n",
        wide as f64 * 0.1,
        high as f64 * 0.1
    );
    let mut entries = vec![
        ("config.ini".to_owned(), config.into_bytes()),
        ("prusaslicer.ini".to_owned(), settings.into_bytes()),
    ];
    for layer in 0..LAYERS {
        // No two layers alike: one that is shown twice or in another's place is seen.
        let [left, top, right, bottom] = BLOCK;
        let mut bright = vec![[left, top, right, bottom - layer]];
        if island && layer >= ISLAND.1 {
            bright.push(ISLAND.0);
        }
        entries.push((format!("job{layer:05}.png"), png([wide, high], &bright)));
    }
    archive(&entries)
}

/// What is shown of a job, in order: a sum for each picture.
fn pictures(job: &[u8]) -> Vec<String> {
    let mut zip = zip::ZipArchive::new(Cursor::new(job)).unwrap();
    let mut names: Vec<_> = zip.file_names().map(|name| name.unwrap().into_owned()).collect();
    names.retain(|name| name.ends_with(".png") && !name.contains('/'));
    names.sort();
    let mut sum_of = |name: &String| {
        let mut bytes = Vec::new();
        zip.by_name(name).unwrap().read_to_end(&mut bytes).unwrap();
        let mut decoder = png::Decoder::new(Cursor::new(bytes));
        decoder.set_transformations(png::Transformations::EXPAND);
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width as usize, info.line_size), (PANEL[0], PANEL[0]), "8 bits of grey");
        let mut sum = Sum::new();
        pixels.chunks(info.line_size).for_each(|row| sum.row(row));
        format!("{:016x}", sum.finish())
    };
    names.iter().map(&mut sum_of).collect()
}

/// A mock resin printer, its profile, and where its pictures go.
struct Resin {
    mock: Mock,
    folder: tempfile::TempDir,
}

impl Resin {
    fn start(speed: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("profiles/printers/generic-msla.toml");
        let shown = folder.path().join("shown");
        let cancel = "cancel = '''\nM107\nG91\nG1 Z20 F100\nG90\nM400'''";
        let text = std::fs::read_to_string(source)
            .unwrap()
            .replace("x_mm = 120.96", "x_mm = 16")
            .replace("y_mm = 68.04", "y_mm = 12")
            .replace("width_px = 2560", &format!("width_px = {}", PANEL[0]))
            .replace("height_px = 1440", &format!("height_px = {}", PANEL[1]))
            .replace("{ framebuffer = \"fb0\" }", &format!("{{ folder = '{}' }}", shown.display()))
            .replace("cancel = { file = \"msla-cancel.gcode\" }", cancel)
            // The host's own waits are not made faster as the mock is.
            .replace("settle_ms = 1000", "settle_ms = 20")
            .replace("rest_ms = 500", "rest_ms = 20")
            .replace("dtr_reset = true", "dtr_reset = false");
        let profile = folder.path().join("resin.toml");
        std::fs::write(&profile, text).unwrap();
        let mock = Mock::steady(&["--speed", speed, "--profile", profile.to_str().unwrap()], "");
        Self { mock, folder }
    }

    fn profile(&self) -> PathBuf {
        self.folder.path().join("resin.toml")
    }

    /// A configuration with this printer and what more is said of it.
    fn config(&self, more: &str) -> String {
        format!(
            "[server]\nmdns = false\n[[printer]]\nid = 'resin'\nprofile = '{}'\nport = '{}'\n{more}\n",
            self.profile().display(),
            self.mock.path("tty").display()
        )
    }

    /// The sums of the pictures that were shown, in order.
    fn shown(&self) -> Vec<String> {
        let text = std::fs::read_to_string(self.folder.path().join("shown/shown.jsonl")).unwrap_or_default();
        let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
        let pictures = lines.filter(|line| line["picture"] != "blank");
        pictures.map(|line| line["sum"].as_str().unwrap().to_owned()).collect()
    }
}

fn act(daemon: &Daemon, job: &Value, action: &str) -> Answer {
    let path = format!("/api/v2/jobs/{}/actions", job["id"].as_str().unwrap());
    daemon.post(&path, &json!({"action": action}))
}

fn of_printer(daemon: &Daemon, action: &str) {
    let said = daemon.post("/api/v2/printers/resin/actions", &json!({"action": action}));
    assert_eq!(said.status, 202, "{}", said.text());
}

/// Waits until a job waits for a person's word, and gives it.
fn say_the_word(daemon: &Daemon, job: &Value) {
    let path = format!("/api/v2/jobs/{}", job["id"].as_str().unwrap());
    poll_until("the job to wait for a word", || {
        let job = daemon.see(&path);
        job["waits_for"].as_str().is_some_and(|w| w.contains("the vat is full and the cover closed"))
    });
    of_printer(daemon, "bed_cleared");
}

#[test]
fn an_island_is_held_mended_and_printed_after_a_yes_and_a_word() {
    let resin = Resin::start("100");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &resin.config(""));
    let printer = daemon.wait_printer("resin", "ready");
    assert_eq!((&printer["kind"], printer["before"].as_array().unwrap().len()), (&json!("msla"), 2));
    let file = daemon.upload("part.sl1", &job(true, 0.2, PANEL));
    let job = daemon.queue(&file, "resin");
    daemon.wait_job(&job, "held");
    let file = daemon.see(&format!("/api/v2/files/{}", file["id"].as_str().unwrap()));
    let check = &file["checks"]["resin"];
    assert_eq!((&file["kind"], check["islands"].as_u64()), (&json!("resin"), Some(1)), "{check}");
    assert_eq!(check["printer_findings"], 0, "{check}");
    assert_eq!(act(&daemon, &job, "mend").status, 200);
    let mended = daemon.wait_job(&job, "mended");
    assert!(mended["mend"]["added_mm3"].as_f64().unwrap() > 0.1, "{mended}");
    assert_eq!(daemon.get(mended["mend"]["picture"].as_str().unwrap()).status, 200);
    assert_eq!(act(&daemon, &job, "approve").status, 200);
    say_the_word(&daemon, &job);
    let done = daemon.wait_job(&job, "finished");
    assert_eq!((&done["printed"], &done["prepared"]), (&json!("mended"), &json!(false)));
    let file = state.path().join("queue").join(job["id"].as_str().unwrap()).join("mended");
    let expected = pictures(&std::fs::read(file).unwrap());
    assert_eq!(expected.len(), LAYERS);
    assert_eq!(resin.shown(), expected);
    let printer = daemon.wait_printer("resin", "ready");
    assert!(printer["temperatures"]["nozzle"].is_null(), "{printer}");
    let measured = |m: &Value| m["words"].as_str().unwrap().contains("exposures");
    assert!(printer["messages"].as_array().unwrap().iter().any(measured), "{printer}");
    // Nothing starts on a plate that a part hangs on; a word is for one start.
    let next = act(&daemon, &job, "again").json();
    assert_eq!(daemon.wait_job(&next, "held")["prepared"], false);
    daemon.end();
    let stats = resin.mock.stats();
    let of = |key: &str| stats[key].as_u64();
    assert_eq!((of("light_pulses"), of("crashes")), (Some(LAYERS as u64), Some(0)), "{stats}");
    assert_eq!(stats["light_on"], false);
}

#[test]
fn a_file_of_the_other_kind_is_refused_with_clear_words() {
    let resin = Resin::start("100");
    let state = tempfile::tempdir().unwrap();
    let more = "[[printer]]\nid = 'melts'\nprofile = 'generic-marlin'\nport = '/dev/does-not-exist'";
    let daemon = Daemon::start(state.path(), &resin.config(more));
    let (pictures, lines) = (job(false, 0.2, PANEL), b"G28\nG1 X10 Y10 F3000\n".to_vec());
    let refused = |answer: &Answer, words: &str| {
        assert_eq!(answer.status, 415, "{}", answer.text());
        assert!(answer.text().contains(words), "{}", answer.text());
    };
    let form = |name: &str, bytes: &[u8]| {
        let head =
            format!("--B\r\nContent-Disposition: form-data; name=\"file\"; filename=\"{name}\"\r\n\r\n");
        [head.as_bytes(), bytes, b"\r\n--B--\r\n"].concat()
    };
    let multipart = [("Content-Type", "multipart/form-data; boundary=B")];
    let (no_pictures, no_lines) = ("its jobs are pictures", "prints filament");
    for (printer, name, bytes, words) in
        [("resin", "part.gcode", &lines, no_pictures), ("melts", "part.sl1", &pictures, no_lines)]
    {
        let own = format!("/api/v2/files?name={name}&printer={printer}");
        refused(&daemon.send("POST", &own, &[], bytes), words);
        let octoprint = format!("/p/{printer}/api/files/local");
        refused(&daemon.send("POST", &octoprint, &multipart, &form(name, bytes)), words);
        let prusalink = format!("/p/{printer}/api/v1/files/local/{name}");
        refused(&daemon.send("PUT", &prusalink, &[], bytes), words);
        let moonraker = format!("/p/{printer}/server/files/upload");
        refused(&daemon.send("POST", &moonraker, &multipart, &form(name, bytes)), words);
        assert_eq!(daemon.see("/api/v2/files"), json!([]), "nothing of it is kept");
    }
    // Uploaded for nobody, they are refused when they are queued.
    for (printer, name, bytes, words) in
        [("resin", "part.gcode", &lines, no_pictures), ("melts", "part.sl1", &pictures, no_lines)]
    {
        let file = daemon.upload(name, bytes);
        let job = json!({"file": file["id"], "printer": printer});
        refused(&daemon.post("/api/v2/jobs", &job), words);
    }
    daemon.end();
}

#[test]
fn a_job_for_another_panel_is_held_and_never_shown() {
    let resin = Resin::start("100");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &resin.config(""));
    daemon.wait_printer("resin", "ready");
    let file = daemon.upload("other.sl1", &job(false, 0.2, [200, 120]));
    let job = daemon.queue(&file, "resin");
    daemon.wait_job(&job, "held");
    let file = daemon.see(&format!("/api/v2/files/{}", file["id"].as_str().unwrap()));
    let check = &file["checks"]["resin"];
    assert_eq!(check["printer_findings"], 1, "{check}");
    assert!(check["findings"][0]["words"].as_str().unwrap().contains("another panel"), "{check}");
    // Whoever prints it anyway is told once more, and nothing moves.
    assert_eq!(act(&daemon, &job, "approve").status, 200);
    say_the_word(&daemon, &job);
    let failed = daemon.wait_job(&job, "failed");
    assert!(failed["error"].as_str().unwrap().contains("another panel"), "{failed}");
    assert_eq!(resin.shown(), Vec::<String>::new());
    daemon.end();
}

#[test]
fn prusaslicer_finds_a_host_for_resin_and_sends_to_it() {
    let resin = Resin::start("100");
    let state = tempfile::tempdir().unwrap();
    let more = "[[printer]]\nid = 'melts'\nprofile = 'generic-marlin'\nport = '/dev/does-not-exist'";
    let daemon = Daemon::start(state.path(), &resin.config(more));
    daemon.wait_printer("resin", "ready");
    let check = |path: &str, begins: &str| {
        let text = daemon.see(path)["text"].as_str().unwrap().to_owned();
        assert!(text.starts_with(begins), "{path}: {text}");
    };
    check("/api/version", "Prusa SLA");
    check("/p/resin/api/version", "Prusa SLA");
    check("/p/melts/api/version", "OctoPrint");
    // As its SL1 host does: the job, and nothing of a start.
    let head = "--B\r\nContent-Disposition: form-data; name=\"print\"\r\n\r\nfalse\r\n\
                --B\r\nContent-Disposition: form-data; name=\"path\"\r\n\r\n\r\n\
                --B\r\nContent-Disposition: form-data; name=\"file\"; filename=\"part.sl1\"\r\n\r\n";
    let body = [head.as_bytes(), &job(false, 0.2, PANEL), b"\r\n--B--\r\n"].concat();
    let multipart = [("Content-Type", "multipart/form-data; boundary=B")];
    let sent = daemon.send("POST", "/p/resin/api/files/local", &multipart, &body);
    assert_eq!(sent.status, 201, "{}", sent.text());
    assert_eq!(daemon.see("/api/v2/files")[0]["name"], "part.sl1");
    // No temperature is told of what is not there.
    let told = daemon.see("/p/resin/api/printer");
    assert_eq!(told["temperature"], json!({}), "{told}");
    let tool = daemon.post("/p/resin/api/printer/tool", &json!({"command": "extrude", "amount": 5}));
    assert_eq!(tool.status, 400, "{}", tool.text());
    assert!(daemon.see("/p/resin/api/v1/info")["min_extrusion_temp"].is_null());
    let objects = daemon.see("/p/resin/printer/objects/list")["result"]["objects"].clone();
    let objects: Vec<String> = serde_json::from_value(objects).unwrap();
    assert!(!objects.iter().any(|name| name == "extruder" || name == "heater_bed"), "{objects:?}");
    // The plate goes up and down.
    let jog = |way: Value| daemon.post("/api/v2/printers/resin/jog", &way).status;
    assert_eq!(
        [jog(json!({"z_mm": 1})), jog(json!({"x_mm": 1})), jog(json!({"home": ["x"]}))],
        [202, 400, 400]
    );
    daemon.end();
}

#[test]
fn a_cancelled_job_ends_dark_with_the_plate_raised() {
    let resin = Resin::start("20");
    let state = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(state.path(), &resin.config("on_findings = 'warn'"));
    daemon.wait_printer("resin", "ready");
    let job = daemon.queue(&daemon.upload("part.sl1", &job(false, 10.0, PANEL)), "resin");
    say_the_word(&daemon, &job);
    daemon.wait_job(&job, "printing");
    wait_until("some layers", || resin.shown().len() > 3);
    of_printer(&daemon, "cancel");
    daemon.wait_job(&job, "cancelled");
    daemon.wait_printer("resin", "ready");
    daemon.end();
    let stats = resin.mock.stats();
    assert_eq!((&stats["light_on"], &stats["crashes"]), (&json!(false), &json!(0)), "{stats}");
    assert!(stats["true_position_mm"][2].as_f64().unwrap() > 19.0, "{stats}");
}

#[test]
fn an_ending_daemon_ends_the_layer_raises_the_plate_and_goes_on_later() {
    let resin = Resin::start("20");
    let state = tempfile::tempdir().unwrap();
    let config = resin.config("on_findings = 'warn'");
    let daemon = Daemon::start(state.path(), &config);
    daemon.wait_printer("resin", "ready");
    let made = job(false, 10.0, PANEL);
    let job = daemon.queue(&daemon.upload("part.sl1", &made), "resin");
    say_the_word(&daemon, &job);
    daemon.wait_job(&job, "printing");
    wait_until("some layers", || resin.shown().len() > 3);
    let asked = Instant::now();
    daemon.end();
    // A layer takes a second and the plate's way up one more: what is parked is not waited for.
    assert!(asked.elapsed() < Duration::from_secs(30), "{:?}", asked.elapsed());
    wait_until("the mock to tell", || resin.mock.now()["true_position_mm"][2].as_f64() > Some(15.0));
    assert_eq!(resin.mock.now()["light_on"], false);
    let daemon = Daemon::start(state.path(), &config);
    daemon.wait_job(&job, "paused");
    of_printer(&daemon, "resume");
    daemon.wait_job(&job, "finished");
    assert_eq!(resin.shown(), pictures(&made), "each layer once");
    daemon.end();
    let stats = resin.mock.stats();
    assert_eq!(stats["light_pulses"].as_u64(), Some(LAYERS as u64), "{stats}");
}
