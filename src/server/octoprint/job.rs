//! The job: how far it is, and what is wanted of it.
//!
//! Other hosts have one file that is selected and printed; here jobs wait in a queue. A job that
//! waits (for its check, its turn, a clear bed) shows as the selected file of an operational printer.
use super::asked::{Asked, At, Doing, Now};
use super::plain::{Plain, Print, Read, json};
use crate::server::api::printers::{Wanted, action};
use crate::server::app::App;
use crate::server::asker::Who;
use crate::server::foreman::Message;
use crate::server::model::{Can, File, Job, Stage};
use crate::server::problem::Problem;
use axum::body::Bytes;
use axum::http::StatusCode;
use axum::routing::get;
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::{Arc, PoisonError};

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new().route("/api/job", get(job).post(act))
}

/// What the printer does, in a word that clients know; any other shows as offline.
pub(super) fn state_text(now: &Now) -> String {
    let word = match now.doing {
        Doing::Offline => "Offline",
        Doing::Connecting => "Connecting",
        Doing::Failed => return format!("Error: {}", now.words()),
        Doing::Ready => "Operational",
        Doing::Starting => "Starting",
        Doing::Printing => "Printing",
        Doing::Pausing => "Pausing",
        Doing::Paused => "Paused",
        Doing::Cancelling => "Cancelling",
    };
    word.to_owned()
}

/// The file's name that a client has selected for a printer.
pub(super) fn selected(at: &At) -> Option<String> {
    at.app.selected.lock().unwrap_or_else(PoisonError::into_inner).get(at.id()).cloned()
}

/// Selects a file, by its name: the newest of that name counts.
pub(crate) fn select(at: &At, name: &str) {
    let mut selected = at.app.selected.lock().unwrap_or_else(PoisonError::into_inner);
    selected.insert(at.id().to_owned(), name.to_owned());
}

/// The file that a client is to see, and the job of it that runs or has ended.
fn shown(at: &At, now: &Now) -> (Option<String>, Option<Job>) {
    let selected = selected(at);
    match (&now.job, &now.next, &now.last) {
        (Some(job), _, _) => (Some(job.name.clone()), Some(job.clone())),
        (None, Some(next), _) => (Some(next.name.clone()), None),
        (None, None, Some(last)) if selected.as_ref().is_none_or(|name| *name == last.name) => {
            (Some(last.name.clone()), Some(last.clone()))
        }
        (None, None, _) => (selected, None),
    }
}

async fn job(Read(Asked { at, .. }): Read) -> Json<Value> {
    let now = at.now();
    let (name, job) = shown(&at, &now);
    let file = name.as_deref().and_then(|name| at.app.view.file_named(name));
    let progress = progress(&now, job.as_ref());
    let whole_s = match (progress["printTime"].as_u64(), progress["printTimeLeft"].as_u64()) {
        (Some(printed_s), Some(left_s)) => Some(printed_s + left_s),
        _ => None,
    };
    let mut told = json!({
        "job": {
            "file": {
                "name": name,
                "display": name,
                "path": name,
                "origin": name.as_ref().map(|_| "local"),
                "size": file.as_ref().map(|file| file.bytes),
                "date": file.as_ref().map(|file| file.uploaded_unix_s),
            },
            "estimatedPrintTime": whole_s,
            "lastPrintTime": null,
            "filament": null,
            "user": job.as_ref().or(now.next.as_ref()).map(|job| job.by.clone()),
        },
        "progress": progress,
        "state": state_text(&now),
    });
    if now.doing == Doing::Failed {
        told["error"] = json!(now.words());
    }
    Json(told)
}

fn progress(now: &Now, job: Option<&Job>) -> Value {
    let over = job.is_some_and(|job| job.state.is_over());
    let told = |completion: Option<f64>, printed_s: Option<f64>, left_s: Option<f64>| {
        let whole = |s: f64| s.max(0.0).round() as u64;
        json!({
            "completion": completion,
            "filepos": null,
            "printTime": printed_s.map(whole),
            "printTimeLeft": left_s.map(whole),
            "printTimeLeftOrigin": left_s.map(|_| "estimate"),
        })
    };
    match (job, now.printer.progress) {
        (Some(_), Some(at)) if !over => told(Some(at.fraction * 100.0), Some(at.elapsed_s), at.left_s),
        (Some(job), _) if job.state == Stage::Finished => {
            let printed_s =
                job.ended_unix_s.zip(job.started_unix_s).map(|(end, start)| end.saturating_sub(start));
            told(Some(100.0), printed_s.map(|s| s as f64), Some(0.0))
        }
        _ => told(None, None, None),
    }
}

#[derive(Deserialize)]
struct Action {
    command: String,
    action: Option<String>,
}

async fn act(Print(Asked { at, who }): Print, body: Bytes) -> Result<StatusCode, Plain> {
    let Action { command, action } = json(&body)?;
    tracing::info!(printer = at.id(), by = who.name(), "{command} {}", action.as_deref().unwrap_or_default());
    match (command.as_str(), action.as_deref()) {
        ("start", _) => {
            at.now().is_idle()?;
            let name = selected(&at).ok_or_else(|| Problem::conflict("no file is selected"))?;
            at.print(&at.file(&name)?, &who).await?;
        }
        ("cancel", _) => cancel(&at, &who).await?,
        ("restart", _) => restart(&at, &who).await?,
        ("pause", Some("pause")) => pause(&at).await?,
        ("pause", Some("resume")) => resume(&at, &who).await?,
        ("pause", None | Some("toggle")) => match at.now().doing {
            Doing::Paused | Doing::Pausing => resume(&at, &who).await?,
            _ => pause(&at).await?,
        },
        _ => return Err(Plain(Problem::bad("`command` is start, cancel, restart or pause"))),
    }
    Ok(StatusCode::NO_CONTENT)
}

fn none() -> Problem {
    Problem::conflict("no job has the printer")
}

/// Pauses; done already is done.
///
/// # Errors
/// There is nothing to pause.
pub(crate) async fn pause(at: &At) -> Result<(), Problem> {
    match at.now().doing {
        Doing::Paused | Doing::Pausing => Ok(()),
        _ => action(&at.app, at.id(), Wanted::Pause, None).await,
    }
}

/// Goes on, also with a job that was broken off.
///
/// # Errors
/// There is nothing to go on with.
pub(crate) async fn resume(at: &At, who: &Who) -> Result<(), Problem> {
    let now = at.now();
    match (now.doing, now.job) {
        (_, Some(job)) if job.state == Stage::Interrupted => of(at, who, job, Can::Resume).await,
        (Doing::Printing | Doing::Starting, Some(_)) => Ok(()),
        _ => action(&at.app, at.id(), Wanted::Resume, None).await,
    }
}

/// Ends the job that has the printer, not one that waits: the client shows an idle printer then.
///
/// # Errors
/// There is none.
pub(crate) async fn cancel(at: &At, who: &Who) -> Result<(), Problem> {
    match at.now().job {
        Some(job) if job.state == Stage::Interrupted => of(at, who, job, Can::Cancel).await,
        Some(_) => action(&at.app, at.id(), Wanted::Cancel, None).await,
        None => Err(none()),
    }
}

async fn of(at: &At, who: &Who, job: Job, what: Can) -> Result<(), Problem> {
    let by = who.name().to_owned();
    at.app.ask(|answer| Message::Act { job: job.id, what, by, answer }).await.map(drop)
}

/// From the beginning, once the bed is clear; a paused job only, as OctoPrint has it.
async fn restart(at: &At, who: &Who) -> Result<(), Problem> {
    let now = at.now();
    let (Doing::Paused, Some(job)) = (now.doing, now.job) else {
        return Err(Problem::conflict("only a paused job can be restarted"));
    };
    let file: File = at.app.view.file(&job.file).ok_or_else(|| Problem::no_such("file"))?;
    cancel(at, who).await?;
    at.queue(file.id, who).await.map(drop)
}
