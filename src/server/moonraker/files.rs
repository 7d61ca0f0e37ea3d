//! Files in Moonraker's words: one root, `gcodes`, without folders.
use super::fault::{Caller, Fault};
use crate::server::api::files::attachment;
use crate::server::auth::Scope;
use crate::server::model::File;
use crate::server::octoprint::asked::{Asked, At};
use crate::server::octoprint::files::{created, newest, resource};
use crate::server::octoprint::form::{Form, kept};
use crate::server::octoprint::job::select;
use crate::server::upload::hex;
use axum::Json;
use axum::extract::{Path, Request};
use axum::http::StatusCode;
use axum::response::Response;
use serde::Deserialize;
use serde_json::{Value, json};

/// The one root.
pub(super) const ROOT: &str = "gcodes";

fn no_root() -> Fault {
    Fault::new(StatusCode::NOT_FOUND, format!("the only root is {ROOT}"))
}

fn is_root(root: Option<&str>) -> Result<(), Fault> {
    if root.is_none_or(|root| root == ROOT) { Ok(()) } else { Err(no_root()) }
}

/// A file as notices and answers name it.
pub(super) fn item(file: &File) -> Value {
    json!({
        "path": file.name,
        "root": ROOT,
        "modified": file.uploaded_unix_s as f64,
        "size": file.bytes,
        "permissions": "rw",
    })
}

/// Some versions of slicers read the answer as it is, others its `result`: it is both. Whether a
/// print was started cannot be known yet: the check and the bed come first, so it is queued.
pub(super) async fn upload(Caller(Asked { at, who }): Caller, request: Request) -> Result<Response, Fault> {
    who.require(Scope::Print)?;
    let form = Form::read(&at.app, request, |name| at.free_name(name)).await?;
    is_root(form.field("root"))?;
    if let Some(sum) = form.field("checksum")
        && !sum.eq_ignore_ascii_case(&hex(&form.upload.sha256))
    {
        let words = format!("its SHA-256 is {}: the upload was damaged on its way", hex(&form.upload.sha256));
        return Err(Fault::new(StatusCode::UNPROCESSABLE_ENTITY, words));
    }
    let prints = form.says("print");
    let (file, job) = kept(&at, &who, form.upload, form.name, prints).await?;
    if prints {
        select(&at, &file.name);
    }
    let running = job.as_ref().is_some_and(|job| job.state.is_running());
    let told = json!({
        "item": item(&file),
        "print_started": running,
        "print_queued": job.is_some() && !running,
        "action": "create_file",
    });
    let mut both = told.clone();
    both["result"] = told;
    Ok(created(&resource(&at, &file), both))
}

#[derive(Deserialize)]
pub(super) struct Target {
    root: String,
    name: String,
}

pub(super) async fn download(
    Caller(Asked { at, who }): Caller,
    Path(Target { root, name }): Path<Target>,
) -> Result<Response, Fault> {
    who.require(Scope::Read)?;
    is_root(Some(&root))?;
    Ok(attachment(&at.app, &at.file(&name)?).await?)
}

pub(super) async fn remove(
    Caller(Asked { at, who }): Caller,
    Path(Target { root, name }): Path<Target>,
) -> Result<Json<Value>, Fault> {
    who.require(Scope::Print)?;
    is_root(Some(&root))?;
    Ok(Json(json!({"result": delete(&at, &name).await?})))
}

/// A name with or without its root.
pub(super) async fn delete(at: &At, path: &str) -> Result<Value, Fault> {
    let file = at.remove(path).await?;
    Ok(json!({"item": item(&file), "action": "delete_file"}))
}

pub(super) fn list(at: &At, root: Option<&str>) -> Result<Value, Fault> {
    is_root(root)?;
    let one = |file: &File| json!({"path": file.name, "modified": file.uploaded_unix_s as f64, "size": file.bytes, "permissions": "rw"});
    Ok(newest(&at.app).iter().map(one).collect())
}

pub(super) fn directory(at: &At, path: Option<&str>) -> Result<Value, Fault> {
    is_root(path)?;
    let files = newest(&at.app);
    let used: u64 = files.iter().map(|file| file.bytes).sum();
    let free = at.app.shelf.free_bytes().unwrap_or(0);
    let one = |file: &File| json!({"filename": file.name, "modified": file.uploaded_unix_s as f64, "size": file.bytes, "permissions": "rw"});
    Ok(json!({
        "dirs": [],
        "files": files.iter().map(one).collect::<Vec<_>>(),
        "disk_usage": {"total": free + used, "used": used, "free": free},
        "root_info": {"name": ROOT, "permissions": "rw"},
    }))
}

pub(super) fn roots() -> Value {
    json!([{"name": ROOT, "path": format!("/{ROOT}"), "permissions": "rw"}])
}

pub(super) fn metadata(at: &At, name: &str) -> Result<Value, Fault> {
    let file = at.file(name)?;
    Ok(json!({
        "filename": file.name,
        "size": file.bytes,
        "modified": file.uploaded_unix_s as f64,
        "uuid": file.id,
        "thumbnails": [],
    }))
}
