//! The API of PrusaLink, as far as PrusaSlicer and apps speak it: uploads by PUT, and what the printer
//! does.
//!
//! Takes a key in `X-Api-Key`; HTTP Digest is not spoken. A PUT without a key is refused before any of
//! its body, so that the empty one that a client of Digest sends first makes no file. Errors are those
//! of [`octoprint`](super::octoprint).
use super::api::files::take;
use super::app::App;
use super::model::{Heater, Stage};
use super::octoprint::asked::{Asked, Doing, Now};
use super::octoprint::files::{created, refs, resource};
use super::octoprint::form::{goes, kept};
use super::octoprint::job::select;
use super::octoprint::plain::{Plain, Print, Read};
use super::problem::Problem;
use super::upload::shown_name;
use axum::extract::{DefaultBodyLimit, Path, Request};
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, put};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// The one storage.
const STORAGE: &str = "local";

/// The routes, without the printer's prefix.
pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/api/v1/storage", get(storage))
        .route("/api/v1/files/{storage}/{*path}", put(upload).layer(DefaultBodyLimit::disable()))
        .route("/api/v1/info", get(info))
        .route("/api/v1/status", get(status))
        .route("/api/v1/job", get(job))
}

/// `storage_list` must be the first key: it is the only one.
async fn storage(Read(Asked { at, .. }): Read) -> Json<Value> {
    let kept = at.app.config.storage.min_free_mb * 1_000_000;
    let free = at.app.shelf.free_bytes().unwrap_or(0).saturating_sub(kept);
    Json(json!({"storage_list": [{
        "name": "Outrigger",
        "type": "LOCAL",
        "path": format!("/{STORAGE}"),
        "read_only": false,
        "available": true,
        "free_space": free,
    }]}))
}

#[derive(Deserialize)]
struct Target {
    storage: String,
    path: String,
}

/// A structured header's boolean (RFC 8941).
fn says(headers: &HeaderMap, name: &str) -> Option<bool> {
    match headers.get(name)?.as_bytes() {
        b"?1" | b"1" | b"true" => Some(true),
        _ => Some(false),
    }
}

async fn upload(
    Print(Asked { at, who }): Print,
    Path(Target { storage, path }): Path<Target>,
    request: Request,
) -> Result<Response, Plain> {
    if storage != STORAGE {
        return Err(Plain(Problem::no_such("storage")));
    }
    // Folders are let go: files are known by their names.
    let name = shown_name(&path)?;
    at.free_name(&name)?;
    let headers = request.headers();
    if says(headers, "overwrite") == Some(false) && at.file(&name).is_ok() {
        return Err(Plain(Problem::conflict(format!(
            "there is a {name} already, and it shall not be overwritten"
        ))));
    }
    let prints = says(headers, "print-after-upload") == Some(true);
    let announced = headers.get(header::CONTENT_LENGTH).and_then(|n| n.to_str().ok()?.parse().ok());
    let upload = take(&at.app, announced, request.into_body()).await?;
    let (file, job) = kept(&at, &who, upload, name, prints).await?;
    if prints {
        select(&at, &file.name);
    }
    let told = json!({
        "name": file.name,
        "path": format!("/{STORAGE}"),
        "size": file.bytes,
        "m_timestamp": file.uploaded_unix_s,
        "refs": refs(&at, &file),
        "print_started": job.as_ref().is_some_and(goes),
    });
    Ok(created(&resource(&at, &file), told))
}

async fn info(Read(Asked { at, .. }): Read) -> Json<Value> {
    let profile = &at.station().profile;
    Json(json!({
        "hostname": at.app.config.server.name,
        "name": at.app.printer(at.station()).name,
        "nozzle_diameter": profile.fdm().map(|fdm| fdm.nozzle_mm.0),
        "mmu": false,
        "sd_ready": false,
        "min_extrusion_temp": profile.fdm().map(|_| 170),
    }))
}

fn state(now: &Now) -> &'static str {
    let asks = now
        .job
        .as_ref()
        .is_some_and(|job| matches!(job.state, Stage::Asking | Stage::Lost | Stage::Interrupted));
    match now.doing {
        Doing::Failed | Doing::Offline => "ERROR",
        Doing::Connecting => "BUSY",
        Doing::Paused if asks => "ATTENTION",
        Doing::Paused => "PAUSED",
        Doing::Starting | Doing::Printing | Doing::Pausing => "PRINTING",
        Doing::Cancelling => "BUSY",
        Doing::Ready if now.next.is_some() => "READY",
        Doing::Ready => match now.last.as_ref().map(|job| job.state) {
            Some(Stage::Finished) => "FINISHED",
            Some(Stage::Cancelled | Stage::Failed) => "STOPPED",
            _ => "IDLE",
        },
    }
}

async fn status(Read(Asked { at, .. }): Read) -> Json<Value> {
    let now = at.now();
    let heat = now.printer.temperatures;
    let both = |heater: Option<Heater>| heater.map_or((None, None), |h| (Some(h.actual_c), Some(h.target_c)));
    let ((nozzle, nozzle_target), (bed, bed_target)) = (both(heat.nozzle), both(heat.bed));
    let mut told = json!({"printer": {
        "state": state(&now),
        "temp_nozzle": nozzle,
        "target_nozzle": nozzle_target,
        "temp_bed": bed,
        "target_bed": bed_target,
        "axis_z": now.printer.progress.and_then(|at| at.z_mm),
        "flow": 100,
        "speed": 100,
    }});
    if let Some(job) = running(&now) {
        told["job"] = job;
    }
    Json(told)
}

/// The running job, in few words.
fn running(now: &Now) -> Option<Value> {
    let job = now.job.as_ref()?;
    let at = now.printer.progress.unwrap_or_default();
    let mut told = json!({
        "id": job.place,
        "progress": (at.fraction * 1000.0).round() / 10.0,
        "time_printing": at.elapsed_s.round(),
    });
    if let Some(left_s) = at.left_s {
        told["time_remaining"] = json!(left_s.round());
    }
    Some(told)
}

async fn job(Read(Asked { at, .. }): Read) -> Response {
    let now = at.now();
    let Some((mut told, job)) = running(&now).zip(now.job.as_ref()) else {
        return StatusCode::NO_CONTENT.into_response();
    };
    told["state"] = json!(state(&now));
    told["file"] = json!({"name": job.name, "display_name": job.name, "path": format!("/{STORAGE}")});
    Json(told).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_says_yes_no_or_nothing() {
        let check = |value: Option<&'static str>, expect| {
            let mut headers = HeaderMap::new();
            if let Some(value) = value {
                headers.insert("overwrite", value.parse().unwrap());
            }
            assert_eq!(says(&headers, "overwrite"), expect, "{value:?}");
        };
        check(Some("?1"), Some(true));
        check(Some("?0"), Some(false));
        check(None, None);
    }
}
