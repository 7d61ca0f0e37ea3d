//! Files by their names: the newest of a name is the file of that name.
use super::asked::{Asked, At};
use super::form::{Form, goes, kept};
use super::job::select;
use super::plain::{Plain, Print, Read, encoded, json};
use crate::server::api::files::attachment;
use crate::server::app::App;
use crate::server::model::File;
use crate::server::problem::Problem;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Path, Request};
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::sync::Arc;

pub(super) fn routes() -> Router<Arc<App>> {
    // Uploads have a bound of their own, and are not held in memory.
    let upload = post(upload).layer(DefaultBodyLimit::disable());
    Router::new()
        .route("/api/files", get(list))
        .route("/api/files/local", get(list).merge(upload))
        .route("/api/files/local/{*name}", get(one).post(command).delete(remove))
        .route("/downloads/files/local/{*name}", get(download))
}

#[derive(Deserialize)]
struct Named {
    name: String,
}

/// Where a file is, as its client has to ask for it.
pub(crate) fn resource(at: &At, file: &File) -> String {
    format!("{}/api/files/local/{}", at.base(), encoded(&file.name))
}

pub(crate) fn refs(at: &At, file: &File) -> Value {
    let download = format!("{}/downloads/files/local/{}", at.base(), encoded(&file.name));
    json!({"resource": resource(at, file), "download": download})
}

fn entry(at: &At, file: &File) -> Value {
    json!({
        "name": file.name,
        "display": file.name,
        "path": file.name,
        "type": "machinecode",
        "typePath": ["machinecode", "gcode"],
        "origin": "local",
        "size": file.bytes,
        "date": file.uploaded_unix_s,
        "hash": file.sha256.get(..40),
        "refs": refs(at, file),
    })
}

/// The files that names mean, the newest first.
pub(crate) fn newest(app: &App) -> Vec<File> {
    let mut names = BTreeSet::new();
    app.view.files().into_iter().filter(|file| names.insert(file.name.clone())).collect()
}

async fn list(Read(Asked { at, .. }): Read) -> Json<Value> {
    let files = newest(&at.app);
    let used: u64 = files.iter().map(|file| file.bytes).sum();
    let free = at.app.shelf.free_bytes().unwrap_or(0);
    let files: Vec<_> = files.iter().map(|file| entry(&at, file)).collect();
    Json(json!({"files": files, "free": free, "total": free + used}))
}

async fn one(Read(Asked { at, .. }): Read, Path(Named { name }): Path<Named>) -> Result<Json<Value>, Plain> {
    Ok(Json(entry(&at, &at.file(&name)?)))
}

async fn download(
    Read(Asked { at, .. }): Read,
    Path(Named { name }): Path<Named>,
) -> Result<Response, Plain> {
    Ok(attachment(&at.app, &at.file(&name)?).await?)
}

/// An upload is a new file, whatever its name; refused is only the name of what is being printed
/// here ([`At::free_name`]). With `print` it is queued: `effectivePrint` says whether it goes to the
/// printer now. One that is still looked at, is held, or waits for its turn or a clear bed does not.
async fn upload(Print(Asked { at, who }): Print, request: Request) -> Result<Response, Plain> {
    let form = Form::read(&at.app, request, |name| at.free_name(name)).await?;
    let (prints, selects) = (form.says("print"), form.says("select"));
    let (file, job) = kept(&at, &who, form.upload, form.name, prints).await?;
    if prints || selects {
        select(&at, &file.name);
    }
    let told = json!({
        "files": {"local": {"name": file.name, "path": file.name, "origin": "local", "refs": refs(&at, &file)}},
        "done": true,
        "effectiveSelect": prints || selects,
        "effectivePrint": job.as_ref().is_some_and(goes),
    });
    Ok(created(&resource(&at, &file), told))
}

/// 201 with where the new thing is.
pub(crate) fn created(location: &str, told: Value) -> Response {
    let mut response = (StatusCode::CREATED, Json(told)).into_response();
    if let Ok(location) = HeaderValue::from_str(location) {
        response.headers_mut().insert(header::LOCATION, location);
    }
    response
}

async fn command(
    Print(Asked { at, who }): Print,
    Path(Named { name }): Path<Named>,
    body: Bytes,
) -> Result<StatusCode, Plain> {
    #[derive(Deserialize)]
    struct Command {
        command: String,
        #[serde(default)]
        print: bool,
    }
    let file = at.file(&name)?;
    let Command { command, print } = json(&body)?;
    if command != "select" {
        return Err(Plain(Problem::bad("`command` is select")));
    }
    select(&at, &file.name);
    if print {
        at.print(&file, &who).await?;
    }
    Ok(StatusCode::NO_CONTENT)
}

async fn remove(
    Print(Asked { at, .. }): Print,
    Path(Named { name }): Path<Named>,
) -> Result<StatusCode, Plain> {
    at.remove(&name).await?;
    Ok(StatusCode::NO_CONTENT)
}
