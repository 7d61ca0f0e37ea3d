//! The printer itself: temperatures and flags; heat, move, send commands.
use super::asked::{Asked, At, Doing, Now};
use super::job::state_text;
use super::plain::{Control, Plain, Read, json};
use crate::server::api::printers::{Hot, Jog, may_command, send};
use crate::server::app::App;
use crate::server::model::{Heat, Heater, PrinterKind, Sample, Stage};
use crate::server::problem::Problem;
use axum::body::Bytes;
use axum::extract::Query;
use axum::http::StatusCode;
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Farthest that filament is pushed or drawn at once, mm.
const MAX_EXTRUDE_MM: f64 = 100.0;

/// Its feed rate, mm/min: what a hotend melts.
const EXTRUDE_MM_MIN: f64 = 180.0;

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/api/printer", get(printer))
        .route("/api/printer/tool", get(tool).post(set_tool))
        .route("/api/printer/bed", get(bed).post(set_bed))
        .route("/api/printer/chamber", get(chamber).post(set_chamber))
        .route("/api/printer/printhead", post(print_head))
        .route("/api/printer/command", post(command))
}

/// `exclude`, `history` and `limit`, each of which may be missing or odd.
type Asks = Query<BTreeMap<String, String>>;

async fn printer(Read(Asked { at, .. }): Read, Query(asks): Asks) -> Result<Json<Value>, Plain> {
    let now = there(&at)?;
    let mut told = json!({
        "temperature": temperatures(&at, now.printer.temperatures, &asks),
        "sd": {"ready": false},
        "state": {"text": state_text(&now), "flags": flags(&now)},
    });
    let excluded = asks.get("exclude").map_or("", String::as_str);
    if let Some(told) = told.as_object_mut() {
        told.retain(|part, _| !excluded.split(',').any(|excluded| excluded.trim() == part));
    }
    Ok(Json(told))
}

/// The printer, if it is there: clients take 409 for "not connected".
fn there(at: &At) -> Result<Now, Plain> {
    let now = at.now();
    match now.doing.is_operational() {
        true => Ok(now),
        false => Err(Plain(Problem::conflict(format!("the printer is not operational: {}", now.words())))),
    }
}

fn flags(now: &Now) -> Value {
    let stage = now.job.as_ref().map(|job| job.state);
    let doing = now.doing;
    json!({
        "operational": doing.is_operational(),
        "printing": matches!(doing, Doing::Starting | Doing::Printing | Doing::Pausing | Doing::Cancelling),
        "paused": doing == Doing::Paused,
        "pausing": doing == Doing::Pausing,
        "resuming": stage == Some(Stage::Resuming),
        "cancelling": doing == Doing::Cancelling,
        "finishing": stage == Some(Stage::Ending),
        "ready": doing == Doing::Ready,
        "sdReady": false,
        "error": doing == Doing::Failed,
        "closedOrError": !doing.is_operational(),
    })
}

fn told(heater: Heater) -> Value {
    let tenths = |c: f32| (f64::from(c) * 10.0).round() / 10.0;
    json!({"actual": tenths(heater.actual_c), "target": tenths(heater.target_c), "offset": 0})
}

/// Each key is a heater, but for `history` where it was asked for.
fn temperatures(at: &At, heat: Heat, asks: &BTreeMap<String, String>) -> Map<String, Value> {
    let all = [("tool0", heat.nozzle), ("bed", heat.bed), ("chamber", heat.chamber)];
    let mut heaters: Map<_, _> =
        all.into_iter().filter_map(|(name, heater)| Some((name.to_owned(), told(heater?)))).collect();
    if asks.get("history").is_some_and(|yes| ["true", "yes", "1"].contains(&yes.as_str())) {
        let samples = at.station().handle.board.samples();
        let limit = asks.get("limit").and_then(|limit| limit.parse().ok()).unwrap_or(samples.len());
        let one = |&[at_s, nozzle, nozzle_target, bed, bed_target]: &Sample| {
            json!({
                "time": at_s as u64,
                "tool0": {"actual": nozzle, "target": nozzle_target},
                "bed": {"actual": bed, "target": bed_target},
            })
        };
        let history = samples[samples.len().saturating_sub(limit)..].iter().map(one).collect();
        heaters.insert("history".to_owned(), Value::Array(history));
    }
    heaters
}

/// One heater and the history, as the routes of single heaters have them.
fn only(at: &At, name: &str, asks: &BTreeMap<String, String>) -> Result<Json<Value>, Plain> {
    let now = there(at)?;
    let mut all = temperatures(at, now.printer.temperatures, asks);
    all.retain(|key, _| key == name || key == "history");
    Ok(Json(Value::Object(all)))
}

async fn tool(Read(Asked { at, .. }): Read, Query(asks): Asks) -> Result<Json<Value>, Plain> {
    only(&at, "tool0", &asks)
}

async fn bed(Read(Asked { at, .. }): Read, Query(asks): Asks) -> Result<Json<Value>, Plain> {
    only(&at, "bed", &asks)
}

async fn chamber(Read(Asked { at, .. }): Read, Query(asks): Asks) -> Result<Json<Value>, Plain> {
    only(&at, "chamber", &asks)
}

/// What is wanted of a heater, of the extruder or of the head; each command reads its own fields.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Wanted {
    command: String,
    targets: BTreeMap<String, f64>,
    target: Option<f64>,
    tool: Option<String>,
    amount: Option<f64>,
    factor: Option<f64>,
    axes: Vec<String>,
    x: f64,
    y: f64,
    z: f64,
    speed: Option<f64>,
    absolute: bool,
}

/// Gives commands to a printer that is idle.
fn give(at: &At, commands: &[String]) -> Result<StatusCode, Plain> {
    at.now().is_idle()?;
    send(at.station(), commands)?;
    Ok(StatusCode::NO_CONTENT)
}

fn bad(words: &str) -> Plain {
    Plain(Problem::bad(words))
}

/// A factor in per cent, or as a fraction, which OctoPrint takes a number with a point for.
fn per_cent(factor: Option<f64>) -> Result<f64, Plain> {
    let factor = factor.ok_or_else(|| bad("say `factor`"))?;
    let per_cent = if factor <= 2.0 { factor * 100.0 } else { factor };
    match (10.0..=200.0).contains(&per_cent) {
        true => Ok(per_cent),
        false => Err(bad("`factor` is from 10 to 200 per cent")),
    }
}

/// Refuses where there is neither nozzle nor bed.
fn melts(at: &At) -> Result<(), Plain> {
    match at.station().kind() {
        PrinterKind::Fdm => Ok(()),
        PrinterKind::Msla => Err(bad("this is a resin printer: it has no extruder and no heater")),
    }
}

async fn set_tool(Control(Asked { at, .. }): Control, body: Bytes) -> Result<StatusCode, Plain> {
    melts(&at)?;
    let wanted: Wanted = json(&body)?;
    let other = wanted.targets.keys().chain(&wanted.tool).any(|tool| tool != "tool0");
    if other {
        return Err(bad("there is one tool: tool0"));
    }
    let commands = match wanted.command.as_str() {
        "target" => {
            Hot { nozzle_c: wanted.targets.get("tool0").copied(), bed_c: None }.commands(at.station())?
        }
        "select" => Vec::new(),
        "flowrate" => vec![format!("M221 S{:.0}", per_cent(wanted.factor)?)],
        "extrude" => match wanted.amount {
            Some(mm) if mm.is_finite() && mm.abs() <= MAX_EXTRUDE_MM => {
                // Whatever the mode was: jobs set theirs before their first bead.
                vec!["M83".to_owned(), format!("G1 E{mm:.2} F{EXTRUDE_MM_MIN:.0}"), "M82".to_owned()]
            }
            _ => return Err(bad("`amount` is from -100 to 100 mm")),
        },
        _ => return Err(bad("`command` is target, select, extrude or flowrate")),
    };
    give(&at, &commands)
}

async fn set_bed(Control(Asked { at, .. }): Control, body: Bytes) -> Result<StatusCode, Plain> {
    let wanted: Wanted = json(&body)?;
    match wanted.command.as_str() {
        "target" => give(&at, &Hot { nozzle_c: None, bed_c: wanted.target }.commands(at.station())?),
        _ => Err(bad("`command` is target")),
    }
}

/// No profile knows what a chamber bears.
async fn set_chamber(_: Control) -> Plain {
    bad("a chamber's heater is not commanded here")
}

async fn print_head(Control(Asked { at, .. }): Control, body: Bytes) -> Result<StatusCode, Plain> {
    let wanted: Wanted = json(&body)?;
    let commands = match wanted.command.as_str() {
        "jog" if wanted.absolute => return Err(bad("only relative jogs are taken")),
        "jog" => Jog {
            x_mm: wanted.x,
            y_mm: wanted.y,
            z_mm: wanted.z,
            feed_mm_min: wanted.speed,
            home: Vec::new(),
        }
        .commands(at.station())?,
        "home" if wanted.axes.is_empty() => return Err(bad("say `axes`: some of x, y, z")),
        "home" => Jog { home: wanted.axes, ..Jog::default() }.commands(at.station())?,
        // The speed of a plate is what keeps the part on it.
        "feedrate" if at.station().kind() == PrinterKind::Msla => {
            return Err(bad("this is a resin printer: its job says how fast the plate moves"));
        }
        "feedrate" => vec![format!("M220 S{:.0}", per_cent(wanted.factor)?)],
        _ => return Err(bad("`command` is jog, home or feedrate")),
    };
    give(&at, &commands)
}

async fn command(Control(Asked { at, who }): Control, body: Bytes) -> Result<StatusCode, Plain> {
    #[derive(Deserialize)]
    struct Commands {
        command: Option<String>,
        #[serde(default)]
        commands: Vec<String>,
    }
    let Commands { command, mut commands } = json(&body)?;
    commands.extend(command);
    let station = may_command(&at.app, at.id(), &who, &commands)?;
    tracing::info!(printer = at.id(), by = who.name(), "console: {commands:?}");
    send(station, &commands)?;
    Ok(StatusCode::NO_CONTENT)
}
