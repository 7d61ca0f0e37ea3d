//! The machine and the host, in Moonraker's words.
use super::objects::klippy;
use crate::server::app::App;
use crate::server::metrics::kernel;
use crate::server::model::PrinterKind;
use crate::server::octoprint::asked::At;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

/// Sockets that are open.
pub(super) static SOCKETS: AtomicUsize = AtomicUsize::new(0);

/// Sockets at a time: a few apps and pages for each of many printers.
pub(super) const MAX_SOCKETS: usize = 100;

static LAST: AtomicU64 = AtomicU64::new(0);

/// A socket that is counted as long as it lasts.
pub(super) struct Counted(pub(super) u64);

impl Counted {
    /// One more; `None`: there are enough.
    pub(super) fn new() -> Option<Self> {
        let more = |open| (open < MAX_SOCKETS).then_some(open + 1);
        SOCKETS.fetch_update(Ordering::Relaxed, Ordering::Relaxed, more).ok()?;
        Some(Self(LAST.fetch_add(1, Ordering::Relaxed) + 1))
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        SOCKETS.fetch_sub(1, Ordering::Relaxed);
    }
}

pub(super) fn server_info(at: &At) -> Value {
    let (state, _) = klippy(&at.now());
    json!({
        "klippy_connected": state != "disconnected",
        "klippy_state": state,
        "components": ["file_manager", "klippy_apis"],
        "failed_components": [],
        "registered_directories": ["gcodes"],
        "warnings": [],
        "websocket_count": SOCKETS.load(Ordering::Relaxed),
        "moonraker_version": concat!("v0.9.3-0-outrigger-", env!("CARGO_PKG_VERSION")),
        "missing_klippy_requirements": [],
        "api_version": [1, 5, 0],
        "api_version_string": "1.5.0",
    })
}

pub(super) fn printer_info(at: &At) -> Value {
    let (state, message) = klippy(&at.now());
    json!({
        "state": if state == "disconnected" { "shutdown" } else { state },
        "state_message": message,
        "hostname": at.app.config.server.name,
        "software_version": concat!("outrigger-", env!("CARGO_PKG_VERSION")),
        "cpu_info": "",
        "klipper_path": "",
        "python_path": "",
        "log_file": "",
        "config_file": "",
    })
}

/// A number that the kernel tells.
fn told(path: &str, find: impl Fn(&str) -> Option<f64>) -> f64 {
    kernel(path).and_then(|text| find(&text)).unwrap_or(0.0)
}

fn memory_kb(what: &str) -> f64 {
    told("/proc/meminfo", |text| {
        let line = text.lines().find(|line| line.starts_with(what))?;
        line.split_ascii_whitespace().nth(1)?.parse().ok()
    })
}

pub(super) fn system_info() -> Value {
    let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    json!({"system_info": {"cpu_info": {
        "cpu_count": cores,
        "processor": std::env::consts::ARCH,
        "total_memory": memory_kb("MemTotal:") as u64,
        "memory_units": "kB",
    }}})
}

/// Klipper's object of that name.
pub(super) fn system_stats() -> Value {
    let load = told("/proc/loadavg", |text| text.split(' ').next()?.parse().ok());
    json!({"sysload": load, "memavail": memory_kb("MemAvailable:") as u64, "cputime": 0.0})
}

/// A sample a second, as clients expect them; ours are [`SAMPLE_S`](crate::server::actor::board::SAMPLE_S)
/// apart, so each is told as often.
pub(super) fn temperature_store(at: &At) -> Value {
    let samples = at.station().handle.board.samples();
    let column = |column: usize| -> Vec<f64> {
        let each = |sample: &[f64; 5]| {
            std::iter::repeat_n(sample[column], crate::server::actor::board::SAMPLE_S as usize)
        };
        samples.iter().flat_map(each).collect()
    };
    let heater = |actual, target| {
        let temperatures = column(actual);
        json!({"powers": vec![0.0; temperatures.len()], "targets": column(target), "temperatures": temperatures})
    };
    match at.station().kind() {
        PrinterKind::Fdm => json!({"extruder": heater(1, 2), "heater_bed": heater(3, 4)}),
        PrinterKind::Msla => json!({}),
    }
}

pub(super) fn gcode_store(at: &At, count: usize) -> Value {
    let (lines, _) = at.station().handle.board.console_since(0);
    let lines = &lines[lines.len().saturating_sub(count)..];
    let line = |line: &crate::server::model::ConsoleLine| {
        let kind = if line.from == "us" { "command" } else { "response" };
        json!({"message": line.text, "time": line.at_unix_s, "type": kind})
    };
    json!({"gcode_store": lines.iter().map(line).collect::<Vec<_>>()})
}

pub(super) fn webcams(at: &At) -> Value {
    let camera = |url: &String| {
        json!({
            "name": at.id(),
            "uid": at.id(),
            "location": "printer",
            "icon": "mdiWebcam",
            "enabled": true,
            "service": "mjpegstreamer",
            "stream_url": url,
            "snapshot_url": url,
            "target_fps": 15,
            "flip_horizontal": false,
            "flip_vertical": false,
            "rotation": 0,
            "aspect_ratio": "4:3",
            "source": "config",
        })
    };
    json!({"webcams": at.station().config.webcam_url.iter().map(camera).collect::<Vec<_>>()})
}

/// Seconds of a clock that nobody sets.
pub(super) fn event_time(app: &App) -> f64 {
    app.started.elapsed().as_secs_f64()
}
