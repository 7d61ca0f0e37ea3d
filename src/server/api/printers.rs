//! `/printers`: what they do, and what may be wanted of them.
use crate::job::host::Request;
use crate::server::actor::Order;
use crate::server::actor::board::SAMPLE_S;
use crate::server::app::{App, Station};
use crate::server::asker::{Control, Print, Read, Who};
use crate::server::foreman::Message;
use crate::server::model::{ConsoleLine, Link, Printer, Sample};
use crate::server::problem::{Kind, Problem, ProblemDetails};
use crate::station::settings;
use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::sync::Arc;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Longest way that is jogged at once, mm.
const MAX_JOG_MM: f64 = 500.0;

/// Feed rate of a jog that says none, mm/min: slow enough to stop it in time.
const JOG_MM_MIN: f64 = 1500.0;

/// The same along Z, where machines are slow.
const JOG_Z_MM_MIN: f64 = 300.0;

/// Fastest jog, mm/min.
const MAX_JOG_MM_MIN: f64 = 12_000.0;

/// Commands that are taken at once.
const MAX_COMMANDS: usize = 50;

/// Longest command, bytes: no firmware takes more.
const MAX_COMMAND_BYTES: usize = 500;

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(list))
        .routes(routes!(one))
        .routes(routes!(act))
        .routes(routes!(jog))
        .routes(routes!(heat))
        .routes(routes!(gcode))
        .routes(routes!(console))
        .routes(routes!(temperatures))
        .routes(routes!(queue))
}

/// All printers
#[utoipa::path(get, path = "/printers", responses((status = 200, body = [Printer])))]
async fn list(_: Read, State(app): State<Arc<App>>) -> Json<Vec<Printer>> {
    Json(app.printers())
}

/// One printer
#[utoipa::path(get, path = "/printers/{id}", params(("id" = String, Path)),
    responses((status = 200, body = Printer), (status = 404, body = ProblemDetails)))]
async fn one(_: Read, State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Json<Printer>, Problem> {
    Ok(Json(app.printer(app.station(&id)?)))
}

/// What is wanted of a printer.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Action {
    action: Wanted,
    /// With `answer`: the button's place, from 0.
    choice: Option<u8>,
}

/// See `Action`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Wanted {
    Pause,
    Resume,
    Cancel,
    Stop,
    Confirm,
    Answer,
    Connect,
    Disconnect,
    BedCleared,
}

/// Pause, resume, cancel, emergency stop and the like
#[utoipa::path(post, path = "/printers/{id}/actions", params(("id" = String, Path)), request_body = Action,
    responses((status = 202), (status = 403, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn act(
    Print(who): Print,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Json(wanted): Json<Action>,
) -> Result<StatusCode, Problem> {
    if wanted.action == Wanted::Confirm {
        who.confirmed()?;
    }
    tracing::info!(printer = id, by = who.name(), "{:?}", wanted.action);
    action(&app, &id, wanted.action, wanted.choice).await?;
    Ok(StatusCode::ACCEPTED)
}

/// Does it, whoever asks.
///
/// # Errors
/// There is no such printer, or it cannot be now.
pub(crate) async fn action(app: &App, id: &str, wanted: Wanted, choice: Option<u8>) -> Result<(), Problem> {
    let station = app.station(id)?;
    let busy = station.handle.board.picture().link == Link::Busy;
    let order = match wanted {
        Wanted::Stop => Order::Ask(Request::EmergencyStop),
        Wanted::Pause | Wanted::Resume | Wanted::Cancel | Wanted::Confirm if !busy => {
            return Err(Problem::conflict("no job has the printer"));
        }
        Wanted::Pause => Order::Ask(Request::Pause),
        Wanted::Resume => Order::Ask(Request::Resume),
        Wanted::Cancel => Order::Ask(Request::Cancel),
        Wanted::Confirm => Order::Ask(Request::Confirm),
        Wanted::Answer => {
            let choice =
                choice.ok_or_else(|| Problem::bad("`answer` wants `choice`: the button's place, from 0"))?;
            Order::Ask(Request::Answer(choice))
        }
        Wanted::Connect => Order::Connect,
        Wanted::Disconnect if busy => {
            return Err(Problem::conflict("a job has the printer: cancel it first"));
        }
        Wanted::Disconnect => Order::Disconnect,
        Wanted::BedCleared => {
            return app.ask(|answer| Message::BedClear { printer: id.to_owned(), answer }).await;
        }
    };
    give(station, order)
}

fn give(station: &Station, order: Order) -> Result<(), Problem> {
    match station.handle.give(order) {
        true => Ok(()),
        false => Err(Problem::conflict("the printer takes no orders now: try again")),
    }
}

/// The printer without a job.
fn idle<'a>(app: &'a App, id: &str) -> Result<&'a Station, Problem> {
    let station = app.station(id)?;
    match station.handle.board.picture().link {
        Link::Ready => Ok(station),
        Link::Busy => Err(Problem::conflict("a job has the printer")),
        Link::Offline | Link::Connecting | Link::Failed => {
            Err(Problem::conflict("the printer is not connected"))
        }
    }
}

/// Gives commands to a printer, one after the other.
///
/// # Errors
/// It takes no orders now.
pub(crate) fn send(station: &Station, commands: &[String]) -> Result<(), Problem> {
    commands.iter().try_for_each(|command| give(station, Order::Ask(Request::Command(command.clone()))))
}

/// Where the head is to go, or the plate: so far along each axis, or home.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Jog {
    pub(crate) x_mm: f64,
    pub(crate) y_mm: f64,
    pub(crate) z_mm: f64,
    pub(crate) feed_mm_min: Option<f64>,
    /// Axes to home: `x`, `y`, `z`; then nothing else is said.
    pub(crate) home: Vec<String>,
}

impl Jog {
    /// The commands for it, on a printer that is there.
    ///
    /// # Errors
    /// It says nothing, or too much, or more than a plate can do: that goes up and down.
    pub(crate) fn commands(&self, station: &Station) -> Result<Vec<String>, Problem> {
        let Some(msla) = station.profile.msla() else { return self.of_head() };
        let across = self.x_mm != 0.0
            || self.y_mm != 0.0
            || self.home.iter().any(|axis| !axis.eq_ignore_ascii_case("z"));
        if across {
            return Err(Problem::bad("a resin printer's plate goes up and down: only z is taken"));
        }
        if !self.home.is_empty() {
            return Ok(settings::home(msla));
        }
        let feed_mm_min = self.feed_mm_min.unwrap_or(JOG_Z_MM_MIN).min(msla.plate.max_mm_min.0);
        Jog { z_mm: self.z_mm, feed_mm_min: Some(feed_mm_min), ..Jog::default() }.of_head()
    }

    /// The same for a head.
    fn of_head(&self) -> Result<Vec<String>, Problem> {
        if !self.home.is_empty() {
            let mut command = String::from("G28");
            for axis in ["x", "y", "z"] {
                if self.home.iter().any(|wanted| wanted.eq_ignore_ascii_case(axis)) {
                    // Writing to a String cannot fail.
                    let _ = write!(command, " {}", axis.to_ascii_uppercase());
                }
            }
            let known = self.home.iter().all(|a| ["x", "y", "z"].contains(&a.to_ascii_lowercase().as_str()));
            return match known {
                true => Ok(vec![command]),
                false => Err(Problem::bad("`home` takes x, y and z")),
            };
        }
        let axes = [("X", self.x_mm), ("Y", self.y_mm), ("Z", self.z_mm)];
        let far = axes.iter().any(|(_, mm)| !mm.is_finite() || mm.abs() > MAX_JOG_MM);
        if far {
            return Err(Problem::bad(format!("a jog goes {MAX_JOG_MM} mm at most")));
        }
        let mut command = String::from("G1");
        for (axis, mm) in axes.iter().filter(|(_, mm)| *mm != 0.0) {
            let _ = write!(command, " {axis}{mm:.3}");
        }
        if command == "G1" {
            return Err(Problem::bad("the jog says no way: x_mm, y_mm, z_mm or home"));
        }
        let usual = if self.z_mm == 0.0 { JOG_MM_MIN } else { JOG_Z_MM_MIN };
        let feed = self.feed_mm_min.unwrap_or(usual);
        if !(1.0..=MAX_JOG_MM_MIN).contains(&feed) {
            return Err(Problem::bad(format!("feed_mm_min is from 1 to {MAX_JOG_MM_MIN}")));
        }
        let _ = write!(command, " F{feed:.0}");
        // Whatever the mode was: printers without a job stand in G90 by custom.
        Ok(vec!["G91".to_owned(), command, "G90".to_owned()])
    }
}

/// Move the head, or the plate
#[utoipa::path(post, path = "/printers/{id}/jog", params(("id" = String, Path)), request_body = Jog,
    responses((status = 202), (status = 400, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn jog(
    _: Control,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Json(jog): Json<Jog>,
) -> Result<StatusCode, Problem> {
    let station = idle(&app, &id)?;
    send(station, &jog.commands(station)?)?;
    Ok(StatusCode::ACCEPTED)
}

/// What is to be hot.
#[derive(Debug, Default, Deserialize, ToSchema)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Hot {
    pub(crate) nozzle_c: Option<f64>,
    pub(crate) bed_c: Option<f64>,
}

impl Hot {
    /// The commands for it.
    ///
    /// # Errors
    /// It says nothing, or more than the printer bears.
    pub(crate) fn commands(&self, station: &Station) -> Result<Vec<String>, Problem> {
        let Some(fdm) = station.profile.fdm() else {
            let name = &station.profile.name;
            return Err(Problem::bad(format!("{name} is a resin printer: nothing of it is heated")));
        };
        let limits = fdm.limits;
        let one = |what: &str, letter: &str, wanted: Option<f64>, most: f64| match wanted {
            None => Ok(None),
            Some(c) if c.is_finite() && (0.0..=most).contains(&c) => Ok(Some(format!("{letter} S{c:.0}"))),
            Some(c) => Err(Problem::bad(format!("the {what} goes from 0 to {most:.0} °C, not to {c}"))),
        };
        let nozzle = one("nozzle", "M104", self.nozzle_c, limits.nozzle_c.0)?;
        let bed = one("bed", "M140", self.bed_c, limits.bed_c.0)?;
        let all: Vec<String> = nozzle.into_iter().chain(bed).collect();
        if all.is_empty() {
            return Err(Problem::bad("say nozzle_c or bed_c"));
        }
        Ok(all)
    }
}

/// Heat, or cool
#[utoipa::path(post, path = "/printers/{id}/heat", params(("id" = String, Path)), request_body = Hot,
    responses((status = 202), (status = 400, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn heat(
    _: Control,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Json(hot): Json<Hot>,
) -> Result<StatusCode, Problem> {
    let station = idle(&app, &id)?;
    send(station, &hot.commands(station)?)?;
    Ok(StatusCode::ACCEPTED)
}

/// Commands for the firmware.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Commands {
    commands: Vec<String>,
}

/// Send commands
#[utoipa::path(post, path = "/printers/{id}/gcode", params(("id" = String, Path)), request_body = Commands,
    responses((status = 202), (status = 400, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn gcode(
    Control(who): Control,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Json(Commands { commands }): Json<Commands>,
) -> Result<StatusCode, Problem> {
    let station = may_command(&app, &id, &who, &commands)?;
    tracing::info!(printer = id, by = who.name(), "console: {commands:?}");
    send(station, &commands)?;
    Ok(StatusCode::ACCEPTED)
}

/// The printer, if who asks may send it these commands now.
///
/// # Errors
/// While it prints only admins may; or a command is none.
pub(crate) fn may_command<'a>(
    app: &'a App,
    id: &str,
    who: &Who,
    commands: &[String],
) -> Result<&'a Station, Problem> {
    let station = app.station(id)?;
    if commands.is_empty() || commands.len() > MAX_COMMANDS {
        return Err(Problem::bad(format!("1 to {MAX_COMMANDS} commands are taken at once")));
    }
    let odd =
        |c: &String| c.len() > MAX_COMMAND_BYTES || c.chars().any(char::is_control) || c.trim().is_empty();
    if let Some(command) = commands.iter().find(|c| odd(c)) {
        return Err(Problem::bad(format!(
            "{command:?} is no command: one line of at most {MAX_COMMAND_BYTES} bytes"
        )));
    }
    if station.handle.board.picture().link == Link::Busy && !who.is_admin() {
        return Err(Problem::new(
            Kind::Conflict,
            "while a job has the printer only admins may send commands",
        ));
    }
    if matches!(station.handle.board.picture().link, Link::Offline | Link::Connecting | Link::Failed) {
        return Err(Problem::conflict("the printer is not connected"));
    }
    Ok(station)
}

/// What was said.
#[derive(Debug, Serialize, ToSchema)]
struct Console {
    lines: Vec<ConsoleLine>,
}

/// The last lines of the console
#[utoipa::path(get, path = "/printers/{id}/console", params(("id" = String, Path)),
    responses((status = 200, body = Console), (status = 404, body = ProblemDetails)))]
async fn console(
    _: Control,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
) -> Result<Json<Console>, Problem> {
    let lines = app.station(&id)?.handle.board.console_since(0).0;
    Ok(Json(Console { lines }))
}

/// Temperatures of the last half hour.
#[derive(Debug, Serialize, ToSchema)]
struct History {
    /// Seconds between two samples.
    every_s: u64,
    /// Each: s since 1970, nozzle, its target, bed, its target (°C).
    #[schema(value_type = Vec<Vec<f64>>)]
    samples: Vec<Sample>,
}

/// Temperatures of the last half hour
#[utoipa::path(get, path = "/printers/{id}/temperatures", params(("id" = String, Path)),
    responses((status = 200, body = History), (status = 404, body = ProblemDetails)))]
async fn temperatures(
    _: Read,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
) -> Result<Json<History>, Problem> {
    let samples = app.station(&id)?.handle.board.samples();
    Ok(Json(History { every_s: SAMPLE_S, samples }))
}

/// Jobs that wait, the next first.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct NewOrder {
    order: Vec<String>,
}

/// Put the queue into another order
#[utoipa::path(put, path = "/printers/{id}/queue", params(("id" = String, Path)), request_body = NewOrder,
    responses((status = 204), (status = 404, body = ProblemDetails)))]
async fn queue(
    _: Print,
    State(app): State<Arc<App>>,
    Path(printer): Path<String>,
    Json(NewOrder { order }): Json<NewOrder>,
) -> Result<StatusCode, Problem> {
    app.ask(|answer| Message::Reorder { printer, order, answer }).await?;
    Ok(StatusCode::NO_CONTENT)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_jog_is_bounded_and_leaves_the_mode_as_it_was() {
        let check = |json: &str, expect: Option<&str>| {
            let jog: Jog = serde_json::from_str(json).unwrap();
            assert_eq!(jog.of_head().ok().map(|c| c.join("|")).as_deref(), expect, "{json}");
        };
        check(r#"{"x_mm": 10}"#, Some("G91|G1 X10.000 F1500|G90"));
        check(r#"{"z_mm": -0.1}"#, Some("G91|G1 Z-0.100 F300|G90"));
        check(r#"{"x_mm": 1, "y_mm": 2, "feed_mm_min": 600}"#, Some("G91|G1 X1.000 Y2.000 F600|G90"));
        check(r#"{"home": ["x", "Y"]}"#, Some("G28 X Y"));
        check(r#"{"home": ["e"]}"#, None);
        check(r#"{"x_mm": 1e6}"#, None);
        check(r#"{"x_mm": 1, "feed_mm_min": 1e9}"#, None);
        check("{}", None);
        assert!(serde_json::from_str::<Jog>(r#"{"x": 10}"#).is_err());
    }
}
