//! What each method does. Handlers hold no rules: the foreman and the actors have them.
use super::fault::Fault;
use super::objects::{Status, Wanted, all};
use super::{Method, files, host};
use crate::server::api::printers::{Wanted as Action, action, may_command, send};
use crate::server::octoprint::asked::{Asked, At, Now};
use crate::server::octoprint::job::{cancel, pause, resume, select};
use crate::server::problem::{Kind, Problem};
use serde_json::{Map, Value, json};

/// Lines of the console that are told at once.
const MAX_LINES: usize = 500;

fn text<'a>(params: &'a Map<String, Value>, name: &str) -> Result<&'a str, Fault> {
    let text = params.get(name).and_then(Value::as_str);
    text.ok_or_else(|| Fault::bad(format!("Argument '{name}' is missing, or is no text")))
}

/// What cannot be now is 400 here.
fn done(done: Result<(), Problem>) -> Result<Value, Fault> {
    match done {
        Ok(()) => Ok(json!("ok")),
        Err(problem) if problem.kind == Kind::Conflict => Err(Fault::bad(problem.detail)),
        Err(problem) => Err(problem.into()),
    }
}

/// All objects of a printer that does so.
pub(super) fn status(at: &At, now: &Now) -> Status {
    let file = now.job.as_ref().and_then(|job| at.app.view.file(&job.file));
    all(now, file.map_or(0, |file| file.bytes))
}

/// An answer about objects.
pub(super) fn told(at: &At, status: Status) -> Value {
    json!({"eventtime": host::event_time(&at.app), "status": status})
}

/// Does what a method says.
///
/// # Errors
/// Who asks may not, or it cannot be.
pub(super) async fn call(
    asked: &Asked,
    method: &Method,
    params: &Map<String, Value>,
) -> Result<Value, Fault> {
    let Asked { at, who } = asked;
    who.require(method.scope)?;
    let optional = |name: &str| params.get(name).and_then(Value::as_str);
    match method.name {
        "access.info" => Ok(json!({
            "default_source": "moonraker",
            "available_sources": ["moonraker"],
            "login_required": true,
            "trusted": false,
        })),
        "access.oneshot_token" => Ok(json!(at.app.oneshots.make(who)?)),
        "machine.system_info" => Ok(host::system_info()),
        "printer.emergency_stop" => {
            tracing::warn!(printer = at.id(), by = who.name(), "emergency stop");
            done(action(&at.app, at.id(), Action::Stop, None).await)
        }
        "printer.gcode.help" => Ok(json!({})),
        "printer.gcode.script" => {
            let lines = text(params, "script")?.lines().map(str::trim).filter(|line| !line.is_empty());
            let commands: Vec<String> = lines.map(str::to_owned).collect();
            tracing::info!(printer = at.id(), by = who.name(), "console: {commands:?}");
            done(may_command(&at.app, at.id(), who, &commands).and_then(|station| send(station, &commands)))
        }
        "printer.info" => Ok(host::printer_info(at)),
        "printer.objects.list" => Ok(json!({"objects": status(at, &at.now()).keys().collect::<Vec<_>>()})),
        "printer.objects.query" => {
            let all = status(at, &at.now());
            Ok(told(at, Wanted::of(params.get("objects"), &all).pick(&all)))
        }
        "printer.print.cancel" => done(cancel(at, who).await),
        "printer.print.pause" => done(pause(at).await),
        "printer.print.resume" => done(resume(at, who).await),
        "printer.print.start" => {
            let file = at.file(text(params, "filename")?)?;
            select(at, &file.name);
            done(at.print(&file, who).await.map(drop))
        }
        "server.files.delete_file" => files::delete(at, text(params, "path")?).await,
        "server.files.get_directory" => files::directory(at, optional("path")),
        "server.files.list" => files::list(at, optional("root")),
        "server.files.metadata" => files::metadata(at, text(params, "filename")?),
        "server.files.roots" => Ok(files::roots()),
        "server.gcode_store" => {
            let count = params.get("count").and_then(|n| n.as_u64().or_else(|| n.as_str()?.parse().ok()));
            Ok(host::gcode_store(at, count.map_or(MAX_LINES, |n| usize::try_from(n).unwrap_or(MAX_LINES))))
        }
        "server.info" => Ok(host::server_info(at)),
        "server.temperature_store" => Ok(host::temperature_store(at)),
        "server.webcams.list" => Ok(host::webcams(at)),
        _ => Err(Fault::no_method()),
    }
}
