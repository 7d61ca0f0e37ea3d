//! `/files`: uploads, what was found in them, their pictures.
use crate::server::app::App;
use crate::server::asker::{Print, Read};
use crate::server::foreman::Message;
use crate::server::model::{File, Kind};
use crate::server::problem::{Kind as ProblemKind, Problem, ProblemDetails};
use crate::server::shelf::{is_id, new_id};
use crate::server::upload::{
    Bounds, Incoming, ReadAhead, Upload, announced_digest, hex, read_ahead, shown_name,
};
use crate::station::now_unix_s;
use axum::Json;
use axum::body::Body;
use axum::extract::{DefaultBodyLimit, FromRequest, Multipart, Path, Query, Request, State};
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use futures_util::TryStreamExt;
use serde::Deserialize;
use std::path::Path as FilePath;
use std::sync::Arc;
use tokio::io::AsyncReadExt;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

/// Bytes that are read of a file at a time.
const PIECE_BYTES: usize = 64 << 10;

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(list, upload))
        .routes(routes!(one, remove))
        .routes(routes!(content))
        .routes(routes!(check))
        .routes(routes!(layers))
        // Uploads have bounds of their own.
        .layer(DefaultBodyLimit::disable())
}

/// All files, the newest first
#[utoipa::path(get, path = "/files", responses((status = 200, body = [File])))]
async fn list(_: Read, State(app): State<Arc<App>>) -> Json<Vec<File>> {
    Json(app.view.files())
}

/// One file
#[utoipa::path(get, path = "/files/{id}", params(("id" = String, Path)),
    responses((status = 200, body = File), (status = 404, body = ProblemDetails)))]
async fn one(_: Read, State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Json<File>, Problem> {
    app.view.file(&id).map(Json).ok_or_else(|| Problem::no_such("file"))
}

#[derive(Debug, Deserialize)]
struct Named {
    name: Option<String>,
    printer: Option<String>,
}

/// Upload a file
///
/// The body is the file's bytes, named by `name`; or a form with one part `file`.
#[utoipa::path(post, path = "/files",
    params(("name" = Option<String>, Query), ("printer" = Option<String>, Query),
        ("Content-Digest" = Option<String>, Header, description = "RFC 9530, sha-256; verified")),
    responses((status = 201, body = File), (status = 400, body = ProblemDetails),
        (status = 413, body = ProblemDetails), (status = 507, body = ProblemDetails)))]
async fn upload(
    Print(who): Print,
    State(app): State<Arc<App>>,
    Query(named): Query<Named>,
    request: Request,
) -> Result<(StatusCode, Json<File>), Problem> {
    let headers = request.headers().clone();
    let digest = header_text(&headers, "content-digest").map(announced_digest).transpose()?.flatten();
    let is_form = header_text(&headers, "content-type").is_some_and(|t| t.starts_with("multipart/form-data"));
    let (name, upload) = match is_form {
        true => form(&app, request).await?,
        false => {
            let name =
                named.name.as_deref().ok_or_else(|| Problem::bad("say the file's name with ?name="))?;
            let announced = header_text(&headers, "content-length").and_then(|n| n.parse().ok());
            (shown_name(name)?, take(&app, announced, request.into_body()).await?)
        }
    };
    if digest.is_some_and(|digest| digest != upload.sha256) {
        let words = format!("its SHA-256 is {}: the upload was damaged on its way", hex(&upload.sha256));
        return Err(Problem::new(ProblemKind::DigestMismatch, words));
    }
    let file = keep(&app, upload, name, who.name(), named.printer).await?;
    Ok((StatusCode::CREATED, Json(file)))
}

fn header_text<'a>(headers: &'a HeaderMap, name: &str) -> Option<&'a str> {
    headers.get(name)?.to_str().ok()
}

fn bounds(app: &App) -> Bounds {
    Bounds {
        max_bytes: app.config.server.max_upload_bytes(),
        min_free_bytes: app.config.storage.min_free_mb * 1_000_000,
    }
}

/// Takes a request's body onto the disk.
///
/// # Errors
/// It is too large, broken off, or the disk refuses.
pub(crate) async fn take(app: &App, announced: Option<u64>, body: Body) -> Result<Upload, Problem> {
    let mut incoming = Incoming::begin(&app.shelf, bounds(app), announced).await?;
    let mut pieces = body.into_data_stream();
    while let Some(piece) = pieces.try_next().await.map_err(broken_off)? {
        incoming.piece(piece).await?;
    }
    let upload = incoming.end().await?;
    if upload.bytes == 0 {
        return Err(Problem::bad("the file is empty"));
    }
    Ok(upload)
}

fn broken_off(why: impl std::fmt::Display) -> Problem {
    Problem::bad(format!("the upload was broken off: {why}"))
}

/// The form's part `file`.
async fn form(app: &App, request: Request) -> Result<(String, Upload), Problem> {
    let (head, body) = request.into_parts();
    let (body, ahead) = read_ahead(body);
    let request = Request::from_parts(head, body);
    let mut form = Multipart::from_request(request, &()).await.map_err(|e| Problem::bad(e.body_text()))?;
    while let Some(part) = form.next_field().await.map_err(|e| broken_off(e.body_text()))? {
        ahead.got();
        if part.name() != Some("file") {
            continue;
        }
        let name = shown_name(part.file_name().unwrap_or_default())?;
        return Ok((name, take_part(app, part, &ahead).await?));
    }
    Err(Problem::bad("the form has no part `file`"))
}

/// Takes a part of a form onto the disk.
///
/// # Errors
/// As [`take`].
pub(crate) async fn take_part(
    app: &App,
    mut part: axum::extract::multipart::Field<'_>,
    ahead: &ReadAhead,
) -> Result<Upload, Problem> {
    let mut incoming = Incoming::begin(&app.shelf, bounds(app), None).await?;
    while let Some(piece) = part.chunk().await.map_err(|e| broken_off(e.body_text()))? {
        ahead.got();
        incoming.piece(piece).await?;
    }
    let upload = incoming.end().await?;
    if upload.bytes == 0 {
        return Err(Problem::bad("the file is empty"));
    }
    Ok(upload)
}

/// Makes an upload a file.
///
/// # Errors
/// The disk refuses.
pub(crate) async fn keep(
    app: &App,
    upload: Upload,
    name: String,
    by: &str,
    printer: Option<String>,
) -> Result<File, Problem> {
    if let Some(printer) = &printer {
        app.station(printer)?;
    }
    let file = File {
        id: new_id('F').map_err(|e| Problem::internal(e.to_string()))?,
        name,
        bytes: upload.bytes,
        sha256: hex(&upload.sha256),
        uploaded_unix_s: now_unix_s(),
        by: by.to_owned(),
        kind: Kind::Unknown,
        checks: std::collections::BTreeMap::new(),
    };
    tracing::info!(file = file.id, name = file.name, bytes = file.bytes, by, "uploaded");
    app.ask(|answer| Message::Uploaded { upload: upload.file, file: Box::new(file), printer, answer }).await
}

/// Delete a file
#[utoipa::path(delete, path = "/files/{id}", params(("id" = String, Path)),
    responses((status = 204), (status = 404, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn remove(
    _: Print,
    State(app): State<Arc<App>>,
    Path(file): Path<String>,
) -> Result<StatusCode, Problem> {
    app.ask(|answer| Message::Remove { file, answer }).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// A file's bytes
#[utoipa::path(get, path = "/files/{id}/content", params(("id" = String, Path)),
    responses((status = 200, content_type = "application/octet-stream"), (status = 404, body = ProblemDetails)))]
async fn content(_: Read, State(app): State<Arc<App>>, Path(id): Path<String>) -> Result<Response, Problem> {
    let file = app.view.file(&id).ok_or_else(|| Problem::no_such("file"))?;
    attachment(&app, &file).await
}

/// A file as an attachment: no browser shows what somebody uploaded.
///
/// # Errors
/// It is gone.
pub(crate) async fn attachment(app: &App, file: &File) -> Result<Response, Problem> {
    let mut response = bytes_of(&app.shelf.content(&file.id), "application/octet-stream").await?;
    let plain: String = file
        .name
        .chars()
        .map(|c| if c.is_ascii_alphanumeric() || "._- ".contains(c) { c } else { '_' })
        .collect();
    let told = format!("attachment; filename=\"{plain}\"");
    if let Ok(value) = HeaderValue::from_str(&told) {
        response.headers_mut().insert(header::CONTENT_DISPOSITION, value);
    }
    Ok(response)
}

/// A file of ours as it is, read piece by piece.
///
/// # Errors
/// It is not there.
pub(crate) async fn bytes_of(path: &FilePath, kind: &'static str) -> Result<Response, Problem> {
    let missing = |_| Problem::no_such("picture or content: it was not made, or is gone");
    let file = tokio::fs::File::open(path).await.map_err(missing)?;
    let length = file.metadata().await.map_err(missing)?.len();
    let pieces = futures_util::stream::try_unfold(file, |mut file| async move {
        let mut piece = vec![0; PIECE_BYTES];
        let read = file.read(&mut piece).await?;
        piece.truncate(read);
        Ok::<_, std::io::Error>((read > 0).then_some((piece, file)))
    });
    let mut response = Body::from_stream(pieces).into_response();
    response.headers_mut().insert(header::CONTENT_TYPE, HeaderValue::from_static(kind));
    response.headers_mut().insert(header::CONTENT_LENGTH, HeaderValue::from(length));
    Ok(response)
}

#[derive(Debug, Deserialize)]
struct For {
    printer: String,
}

/// The full report of `outrigger check --json`
#[utoipa::path(get, path = "/files/{id}/check", params(("id" = String, Path), ("printer" = String, Query)),
    responses((status = 200, content_type = "application/json"), (status = 404, body = ProblemDetails)))]
async fn check(
    _: Read,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Query(of): Query<For>,
) -> Result<Response, Problem> {
    made(&app, &id, &of.printer, "check.json", "application/json").await
}

/// The page that goes through the layers, with what was found
#[utoipa::path(get, path = "/files/{id}/pictures/layers", params(("id" = String, Path), ("printer" = String, Query)),
    responses((status = 200, content_type = "text/html"), (status = 404, body = ProblemDetails)))]
async fn layers(
    _: Read,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Query(of): Query<For>,
) -> Result<Response, Problem> {
    let page = made(&app, &id, &of.printer, "layers.html", "text/html; charset=utf-8").await?;
    Ok(sandboxed(page))
}

async fn made(
    app: &App,
    id: &str,
    printer: &str,
    what: &str,
    kind: &'static str,
) -> Result<Response, Problem> {
    // Both become parts of a path: they are names of ours.
    app.station(printer)?;
    if !is_id(id, 'F') || app.view.file(id).is_none() {
        return Err(Problem::no_such("file"));
    }
    bytes_of(&app.shelf.made(id, printer, what), kind).await
}

/// A page that was made of somebody's file: whatever is in it, it has no origin, and reaches
/// nothing.
pub(crate) fn sandboxed(mut page: Response) -> Response {
    let policy = "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; \
                  img-src data: blob:; worker-src blob:; frame-ancestors 'self'";
    page.headers_mut().insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(policy));
    page
}
