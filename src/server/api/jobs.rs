//! `/jobs`: files on their way to a printer.
use super::files::{bytes_of, sandboxed};
use crate::server::app::App;
use crate::server::asker::{Print, Read};
use crate::server::foreman::Message;
use crate::server::model::{Can, Job};
use crate::server::problem::{Problem, ProblemDetails};
use crate::server::shelf::is_id;
use axum::Json;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use std::sync::Arc;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(list, queue))
        .routes(routes!(one))
        .routes(routes!(act))
        .routes(routes!(mended))
        .routes(routes!(paths))
}

#[derive(Debug, Deserialize)]
struct Of {
    printer: Option<String>,
}

/// All jobs, the newest first
#[utoipa::path(get, path = "/jobs", params(("printer" = Option<String>, Query)),
    responses((status = 200, body = [Job])))]
async fn list(_: Read, State(app): State<Arc<App>>, Query(of): Query<Of>) -> Json<Vec<Job>> {
    let mut jobs = app.view.jobs();
    if let Some(printer) = of.printer {
        jobs.retain(|job| job.printer == printer);
    }
    Json(jobs)
}

/// One job
#[utoipa::path(get, path = "/jobs/{id}", params(("id" = String, Path)),
    responses((status = 200, body = Job), (status = 404, body = ProblemDetails)))]
async fn one(_: Read, State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Json<Job>, Problem> {
    app.view.job(&id).map(Json).ok_or_else(|| Problem::no_such("job"))
}

/// What is to be printed where.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Wanted {
    /// The file's id.
    file: String,
    /// The printer's id.
    printer: String,
    /// It waits for a person even if nothing is found.
    #[serde(default)]
    hold: bool,
}

/// Queue a file
#[utoipa::path(post, path = "/jobs", request_body = Wanted,
    params(("Idempotency-Key" = Option<String>, Header, description = "The same key is done once, and answered the same for a day")),
    responses((status = 201, body = Job), (status = 404, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn queue(
    Print(who): Print,
    State(app): State<Arc<App>>,
    Json(Wanted { file, printer, hold }): Json<Wanted>,
) -> Result<(StatusCode, Json<Job>), Problem> {
    let by = who.name().to_owned();
    let job = app.ask(|answer| Message::Queue { file, printer, hold, by, answer }).await?;
    tracing::info!(job = job.id, name = job.name, printer = job.printer, by = job.by, "queued");
    Ok((StatusCode::CREATED, Json(job)))
}

/// What is wanted of a job.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Action {
    action: Can,
}

/// Approve, mend, cancel, resume and the like
#[utoipa::path(post, path = "/jobs/{id}/actions", params(("id" = String, Path)), request_body = Action,
    responses((status = 200, body = Job), (status = 403, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn act(
    Print(who): Print,
    State(app): State<Arc<App>>,
    Path(job): Path<String>,
    Json(Action { action }): Json<Action>,
) -> Result<Json<Job>, Problem> {
    if matches!(action, Can::Start | Can::Forget | Can::Confirm) {
        who.confirmed()?;
    }
    let by = who.name().to_owned();
    tracing::info!(job, by, "{action:?}");
    Ok(Json(app.ask(|answer| Message::Act { job, what: action, by, answer }).await?))
}

/// The page of a mended job's supports
#[utoipa::path(get, path = "/jobs/{id}/pictures/mended", params(("id" = String, Path)),
    responses((status = 200, content_type = "text/html"), (status = 404, body = ProblemDetails)))]
async fn mended(_: Read, State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Response, Problem> {
    Ok(sandboxed(picture(&app, &id, "supports.html", "text/html; charset=utf-8").await?))
}

/// The paths of a layer, before and after reordering
#[utoipa::path(get, path = "/jobs/{id}/pictures/paths", params(("id" = String, Path)),
    responses((status = 200, content_type = "image/svg+xml"), (status = 404, body = ProblemDetails)))]
async fn paths(_: Read, State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Response, Problem> {
    Ok(sandboxed(picture(&app, &id, "paths.svg", "image/svg+xml").await?))
}

async fn picture(app: &App, id: &str, what: &str, kind: &'static str) -> Result<Response, Problem> {
    let job = app.view.job(id).filter(|_| is_id(id, 'J')).ok_or_else(|| Problem::no_such("job"))?;
    let of_job = app.shelf.of_job(id, what);
    // A job that was not mended has the picture of its file, where its infill was reordered.
    let path = if what == "paths.svg" && !of_job.exists() && is_id(&job.file, 'F') {
        app.shelf.made(&job.file, &job.printer, what)
    } else {
        of_job
    };
    bytes_of(&path, kind).await
}
