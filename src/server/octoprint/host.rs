//! What the host is: version, server, connection, settings, profiles, and who is asking.
use super::asked::{Asked, At, Doing};
use super::job::state_text;
use super::plain::{Control, Plain, Read, json};
use crate::profile::printer::{BedShape, Origin};
use crate::server::api::printers::{Wanted, action};
use crate::server::app::App;
use crate::server::model::PrinterKind;
use crate::server::problem::{Kind, Problem};
use axum::body::Bytes;
use axum::http::StatusCode;
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// The version of OctoPrint that clients take us for: old enough to have `api`, and new enough for
/// all that is answered here.
const VERSION: &str = "1.9.0";

/// The only printer's profile of a host.
const PROFILE: &str = "_default";

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/api/version", get(version))
        .route("/api/server", get(server))
        .route("/api/connection", get(connection).post(connect))
        .route("/api/settings", get(settings))
        .route("/api/printerprofiles", get(profiles))
        .route("/api/printerprofiles/{profile}", get(one_profile))
        .route("/api/login", post(log_in))
        .route("/api/currentuser", get(current_user))
        .route("/api/system/commands", get(commands))
        .route("/api/system/commands/{source}/{action}", post(no_command))
}

/// PrusaLink's clients ask here, too: hence the capability. PrusaSlicer sends resin jobs only to who
/// calls itself so.
async fn version(Read(Asked { at, .. }): Read) -> Json<Value> {
    let text = match at.station().kind() {
        PrinterKind::Fdm => format!("OctoPrint {VERSION}"),
        PrinterKind::Msla => concat!("Prusa SLA (Outrigger ", env!("CARGO_PKG_VERSION"), ")").to_owned(),
    };
    Json(json!({"api": "0.1", "server": VERSION, "text": text, "capabilities": {"upload-by-put": true}}))
}

async fn server(_: Read) -> Json<Value> {
    Json(json!({"version": VERSION, "safemode": null}))
}

async fn connection(Read(Asked { at, .. }): Read) -> Json<Value> {
    let now = at.now();
    let baud = at.station().config.baud.unwrap_or(at.station().profile.serial.baud);
    let open = (now.doing != Doing::Offline).then(|| at.station().config.port.clone());
    Json(json!({
        "current": {
            "state": state_text(&now),
            "port": open,
            "baudrate": open.is_some().then_some(baud),
            "printerProfile": PROFILE,
        },
        "options": {
            "ports": [at.station().config.port],
            "baudrates": [baud],
            "printerProfiles": [{"id": PROFILE, "name": now.printer.name}],
            "portPreference": at.station().config.port,
            "baudratePreference": baud,
            "printerProfilePreference": PROFILE,
            "autoconnect": true,
        },
    }))
}

/// Ports, speeds and profiles are the configuration's: what a client says of them is let be.
#[derive(Deserialize)]
struct Command {
    command: String,
}

async fn connect(Control(Asked { at, who }): Control, body: Bytes) -> Result<StatusCode, Plain> {
    let Command { command } = json(&body)?;
    let wanted = match command.as_str() {
        "connect" => Wanted::Connect,
        "disconnect" => Wanted::Disconnect,
        "fake_ack" => return Ok(StatusCode::NO_CONTENT),
        _ => return Err(Plain(Problem::bad("`command` is connect or disconnect"))),
    };
    tracing::info!(printer = at.id(), by = who.name(), "{wanted:?}");
    action(&at.app, at.id(), wanted, None).await?;
    Ok(StatusCode::NO_CONTENT)
}

async fn settings(Read(Asked { at, .. }): Read) -> Result<Json<Value>, Plain> {
    let shelf = at.app.shelf.clone();
    let uuid = tokio::task::spawn_blocking(move || shelf.uuid()).await;
    let uuid = uuid.map_err(|_| Problem::internal("the daemon's own name could not be read"))?;
    let printer = at.app.printer(at.station());
    let mut told = json!({
        "api": {"key": null},
        "appearance": {"name": printer.name, "color": "default"},
        "feature": {"sdSupport": false},
        "folder": {},
        "temperature": {"profiles": []},
        "plugins": {"discovery": {"upnpUuid": uuid_of(&uuid, at.index)}, "appkeys": {}},
    });
    // Half a webcam breaks clients: all of it or none.
    if let Some(url) = &printer.webcam_url {
        told["webcam"] = json!({
            "webcamEnabled": true,
            "streamUrl": url,
            "snapshotUrl": url,
            "flipH": false,
            "flipV": false,
            "rotate90": false,
            "bitrate": "10000k",
            "snapshotSslValidation": true,
        });
    }
    Ok(Json(told))
}

/// The announced name is the default printer's; the others' differ in the last digits, for apps tell
/// printers by it.
fn uuid_of(host: &str, index: usize) -> String {
    match index {
        0 => host.to_owned(),
        index => format!("{}{index:04x}", host.get(..host.len().saturating_sub(4)).unwrap_or_default()),
    }
}

fn profile(at: &At) -> Value {
    let profile = &at.station().profile;
    let bed = &profile.bed;
    // A resin printer has no extruder and no heater, and moves in Z only.
    let fdm = profile.fdm();
    let plate_mm_s = profile.msla().map_or(0.0, |msla| msla.plate.max_mm_min.0 / 60.0);
    let fast = fdm.map_or([0.0, 0.0, plate_mm_s, 0.0], |fdm| {
        let feed = fdm.motion.max_feed_mm_s;
        [feed.x.0, feed.y.0, feed.z.0, feed.e.0]
    });
    let axis = |mm_s: f64| json!({"speed": (mm_s * 60.0).round(), "inverted": false});
    json!({
        "id": PROFILE,
        "name": at.app.printer(at.station()).name,
        "model": profile.title,
        "color": "default",
        "current": true,
        "default": true,
        "heatedBed": fdm.is_some_and(|fdm| fdm.limits.bed_c.0 > 0.0),
        "heatedChamber": false,
        "extruder": {
            "count": usize::from(fdm.is_some()),
            "nozzleDiameter": fdm.map_or(0.0, |fdm| fdm.nozzle_mm.0),
            "sharedNozzle": false,
            "offsets": fdm.map_or_else(Vec::new, |_| vec![[0.0, 0.0]]),
        },
        "volume": {
            "formFactor": if bed.shape == BedShape::Circle { "circular" } else { "rectangular" },
            "origin": if bed.origin == Origin::Centre { "center" } else { "lowerleft" },
            "width": bed.x_mm.0,
            "depth": bed.y_mm.0,
            "height": bed.z_mm.0,
            "custom_box": false,
        },
        "axes": {"x": axis(fast[0]), "y": axis(fast[1]), "z": axis(fast[2]), "e": axis(fast[3])},
        "resource": format!("{}/api/printerprofiles/{PROFILE}", at.base()),
    })
}

async fn profiles(Read(Asked { at, .. }): Read) -> Json<Value> {
    Json(json!({"profiles": {PROFILE: profile(&at)}}))
}

#[derive(Deserialize)]
struct Named {
    profile: String,
}

async fn one_profile(
    Read(Asked { at, .. }): Read,
    axum::extract::Path(named): axum::extract::Path<Named>,
) -> Result<Json<Value>, Plain> {
    match named.profile == PROFILE {
        true => Ok(Json(profile(&at))),
        false => Err(Plain(Problem::no_such("printer profile"))),
    }
}

/// Passive only: who has the key. People log in on the page.
async fn log_in(Read(Asked { at, who }): Read, body: Bytes) -> Result<Json<Value>, Plain> {
    #[derive(Deserialize)]
    struct Passive {
        #[serde(default)]
        passive: bool,
    }
    let Passive { passive } = json(&body)?;
    if !passive {
        return Err(Plain(Problem::new(Kind::Forbidden, "log in on the page, or give an API key")));
    }
    Ok(Json(json!({
        "name": who.name(),
        "active": true,
        "admin": who.is_admin(),
        "user": true,
        "apikey": null,
        "groups": groups(&who),
        "permissions": [],
        "needs": {},
        // Clients give it back on a socket that we have not.
        "session": at.id(),
        "_is_external_client": false,
    })))
}

fn groups(who: &crate::server::asker::Who) -> Vec<&'static str> {
    if who.is_admin() { vec!["admins", "users"] } else { vec!["users"] }
}

async fn current_user(Read(Asked { who, .. }): Read) -> Json<Value> {
    Json(json!({"name": who.name(), "groups": groups(&who), "permissions": []}))
}

async fn commands(_: Read) -> Json<Value> {
    Json(json!({"core": [], "custom": []}))
}

/// No command of a network reaches the machine's own shell.
async fn no_command(_: Control) -> Plain {
    Plain(Problem::no_such("command: the machine is switched off elsewhere"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn printers_have_names_of_their_own() {
        let host = "01234567-89ab-4def-8123-456789abcdef";
        assert_eq!(uuid_of(host, 0), host);
        assert_eq!(uuid_of(host, 1), "01234567-89ab-4def-8123-456789ab0001");
    }
}
