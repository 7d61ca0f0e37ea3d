//! `/metrics`, for Prometheus: what is measured is read when it is asked for.
use super::app::App;
use super::asker::Read;
use super::model::Link;
use super::problem::Problem;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::registry::Registry;
use std::sync::Arc;
use std::sync::atomic::AtomicU64;

type Labels = Vec<(&'static str, String)>;
type Number = Family<Labels, Gauge<f64, AtomicU64>>;

/// The answer to a scrape.
pub(crate) async fn metrics(_: Read, State(app): State<Arc<App>>) -> Result<Response, Problem> {
    let mut registry = Registry::with_prefix("outrigger");
    let mut family = |name: &str, help: &str| {
        let family = Number::default();
        registry.register(name, help, family.clone());
        family
    };
    let build = family("build", "Always 1; the version is a label");
    let uptime = family("uptime_seconds", "Since the daemon started");
    let up = family("printer_connected", "1 where the printer answers");
    let busy = family("printer_busy", "1 while a job has it");
    let heat = family("heater_celsius", "Measured");
    let target = family("heater_target_celsius", "Wanted; 0 is off");
    let progress = family("job_progress_ratio", "Of the running job's lines, 0 to 1");
    let left = family("job_left_seconds", "Estimate for the running job");
    let lines = family("job_line", "Last line of the running job that was acknowledged");
    let resends = family("job_resends", "Lines of the running job that were asked for again");
    let jobs = family("jobs", "By state");
    let files = family("files", "Uploaded and kept");
    let bytes = family("file_bytes", "Of uploaded files");
    let free = family("disk_free_bytes", "Where the data folder is");
    let memory = family("resident_memory_bytes", "Of the daemon's process");

    let set = |family: &Number, labels: Labels, value: f64| {
        family.get_or_create(&labels).set(value);
    };
    set(&build, vec![("version", env!("CARGO_PKG_VERSION").to_owned())], 1.0);
    set(&uptime, Vec::new(), app.started.elapsed().as_secs_f64());
    for station in &app.stations {
        let now = station.handle.board.picture();
        let of = |more: Option<(&'static str, &str)>| {
            let mut labels = vec![("printer", station.config.id.clone())];
            labels.extend(more.map(|(name, value)| (name, value.to_owned())));
            labels
        };
        let is = |yes: bool| f64::from(u8::from(yes));
        set(&up, of(None), is(matches!(now.link, Link::Ready | Link::Busy)));
        set(&busy, of(None), is(now.link == Link::Busy));
        for (name, heater) in
            [("nozzle", now.heat.nozzle), ("bed", now.heat.bed), ("chamber", now.heat.chamber)]
        {
            if let Some(heater) = heater {
                set(&heat, of(Some(("heater", name))), heater.actual_c.into());
                set(&target, of(Some(("heater", name))), heater.target_c.into());
            }
        }
        if let Some(at) = now.progress {
            set(&progress, of(None), at.fraction);
            set(&lines, of(None), at.line as f64);
            set(&resends, of(None), now.resends as f64);
            if let Some(left_s) = at.left_s {
                set(&left, of(None), left_s);
            }
        }
    }
    for job in app.view.jobs() {
        let state = serde_json::to_value(job.state).ok().and_then(|v| v.as_str().map(str::to_owned));
        let labels = vec![("printer", job.printer), ("state", state.unwrap_or_default())];
        jobs.get_or_create(&labels).inc();
    }
    let kept = app.view.files();
    set(&files, Vec::new(), kept.len() as f64);
    set(&bytes, Vec::new(), kept.iter().map(|file| file.bytes).sum::<u64>() as f64);
    if let Ok(bytes) = app.shelf.free_bytes() {
        set(&free, Vec::new(), bytes as f64);
    }
    if let Some(bytes) = resident_bytes() {
        set(&memory, Vec::new(), bytes as f64);
    }
    let mut text = String::new();
    encode(&mut text, &registry).map_err(|e| Problem::internal(e.to_string()))?;
    let kind = "application/openmetrics-text; version=1.0.0; charset=utf-8";
    Ok(([(header::CONTENT_TYPE, kind)], text).into_response())
}

/// Memory that is in use, as the kernel counts it.
pub(crate) fn resident_bytes() -> Option<u64> {
    let pages: u64 = kernel("/proc/self/statm")?.split(' ').nth(1)?.parse().ok()?;
    Some(pages * rustix::param::page_size() as u64)
}

/// What the kernel tells in a file of `/proc`, which is on no disk: nobody waits for it.
pub(crate) fn kernel(path: &str) -> Option<String> {
    std::fs::read_to_string(path).ok()
}
