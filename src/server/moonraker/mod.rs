//! The API of Moonraker (Klipper's host), as far as slicers and apps speak it: HTTP, and JSON-RPC over
//! a WebSocket.
//!
//! One registry, [`METHODS`], names what can be asked; HTTP paths are made from the names. Takes a
//! method and its parameters; gives a result or a [`Fault`]. No printer here runs Klipper: its objects
//! are told from what is known of ours ([`objects`]).
//!
//! - [`call`]: what each method does; [`files`], [`host`]: files and the machine
//! - [`socket`]: the WebSocket and what it tells unasked; [`oneshot`]: its tokens for browsers
//! - [`fault`]: errors, and who may ask
mod call;
mod fault;
mod files;
mod host;
mod objects;
pub(super) mod oneshot;
mod socket;

use super::app::App;
use super::auth::Scope;
use axum::Router;
use axum::body::Bytes;
use axum::extract::{DefaultBodyLimit, Query};
use axum::routing::{MethodRouter, get, post};
use axum::{Json, http::StatusCode};
use fault::{Caller, Fault};
use serde_json::{Map, Value, json};
use std::sync::Arc;

/// How a method is asked for over HTTP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Http {
    /// Not at all, or by a route of its own.
    No,
    Get,
    Post,
    Both,
}

/// Something that can be asked for.
#[derive(Debug)]
struct Method {
    name: &'static str,
    http: Http,
    /// Its path; empty: the name with slashes.
    path: &'static str,
    scope: Scope,
}

const fn reads(name: &'static str) -> Method {
    Method { name, http: Http::Get, path: "", scope: Scope::Read }
}

const fn does(name: &'static str, scope: Scope) -> Method {
    Method { name, http: Http::Post, path: "", scope }
}

/// All methods, but for those that only a socket has ([`socket`]).
const METHODS: &[Method] = &[
    reads("access.info"),
    reads("access.oneshot_token"),
    reads("machine.system_info"),
    does("printer.emergency_stop", Scope::Print),
    reads("printer.gcode.help"),
    does("printer.gcode.script", Scope::Control),
    reads("printer.info"),
    reads("printer.objects.list"),
    Method { http: Http::Both, ..reads("printer.objects.query") },
    does("printer.print.cancel", Scope::Print),
    does("printer.print.pause", Scope::Print),
    does("printer.print.resume", Scope::Print),
    does("printer.print.start", Scope::Print),
    Method { http: Http::No, ..does("server.files.delete_file", Scope::Print) },
    Method { path: "/server/files/directory", ..reads("server.files.get_directory") },
    reads("server.files.list"),
    reads("server.files.metadata"),
    reads("server.files.roots"),
    Method { scope: Scope::Control, ..reads("server.gcode_store") },
    reads("server.info"),
    reads("server.temperature_store"),
    reads("server.webcams.list"),
];

/// The method of a name.
///
/// # Errors
/// There is none.
fn method(name: &str) -> Result<&'static Method, Fault> {
    METHODS.iter().find(|method| method.name == name).ok_or_else(Fault::no_method)
}

/// The routes, without the printer's prefix.
pub(super) fn routes() -> Router<Arc<App>> {
    let upload = post(files::upload).layer(DefaultBodyLimit::disable());
    let routes = Router::new()
        .route("/server/files/upload", upload)
        .route("/server/files/{root}/{*name}", get(files::download).delete(files::remove))
        .route("/websocket", get(socket::open));
    METHODS.iter().filter(|method| method.http != Http::No).fold(routes, |routes, method| {
        let path = match method.path {
            "" => format!("/{}", method.name.replace('.', "/")),
            path => path.to_owned(),
        };
        routes.route(&path, answers(method))
    })
}

fn answers(method: &'static Method) -> MethodRouter<Arc<App>> {
    let by_get = move |caller: Caller, Query(query): Query<Vec<(String, String)>>| async move {
        by_http(method, caller, query, Bytes::new()).await
    };
    let by_post = move |caller: Caller, Query(query): Query<Vec<(String, String)>>, body: Bytes| async move {
        by_http(method, caller, query, body).await
    };
    match method.http {
        Http::Get | Http::No => get(by_get),
        Http::Post => post(by_post),
        Http::Both => get(by_get).post(by_post),
    }
}

/// `result` is the first key, for it is the only one.
async fn by_http(
    method: &'static Method,
    Caller(asked): Caller,
    query: Vec<(String, String)>,
    body: Bytes,
) -> Result<Json<Value>, Fault> {
    let params = params(method, query, &body)?;
    let result = call::call(&asked, method, &params).await?;
    Ok(Json(json!({"result": result})))
}

/// What the body says, and what the address says. Of printers' objects the address names each, with
/// its fields.
fn params(method: &Method, query: Vec<(String, String)>, body: &[u8]) -> Result<Map<String, Value>, Fault> {
    let mut params = match body.iter().all(u8::is_ascii_whitespace) {
        true => Map::new(),
        false => match serde_json::from_slice(body) {
            Ok(Value::Object(params)) => params,
            _ => return Err(Fault::new(StatusCode::BAD_REQUEST, "the body is no JSON object")),
        },
    };
    if method.name == "printer.objects.query" && !query.is_empty() {
        let fields = |fields: &str| match fields {
            "" => Value::Null,
            fields => fields.split(',').map(Value::from).collect(),
        };
        let objects: Map<_, _> = query.iter().map(|(name, list)| (name.clone(), fields(list))).collect();
        params.insert("objects".to_owned(), Value::Object(objects));
    } else {
        params.extend(query.into_iter().map(|(name, value)| (name, Value::String(value))));
    }
    Ok(params)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_named_in_the_address() {
        let query =
            |pairs: &[(&str, &str)]| pairs.iter().map(|(a, b)| ((*a).to_owned(), (*b).to_owned())).collect();
        let objects = method("printer.objects.query").unwrap();
        let got = params(objects, query(&[("print_stats", "state,message"), ("webhooks", "")]), b"").unwrap();
        assert_eq!(
            Value::Object(got),
            json!({"objects": {"print_stats": ["state", "message"], "webhooks": null}})
        );
        let start = method("printer.print.start").unwrap();
        let got = params(start, query(&[("filename", "a.gcode")]), b"").unwrap();
        assert_eq!(Value::Object(got), json!({"filename": "a.gcode"}));
        assert!(params(start, Vec::new(), b"[1]").is_err());
    }

    #[test]
    fn what_changes_something_is_never_asked_for_by_get() {
        let reads =
            |method: &Method| matches!(method.scope, Scope::Read) || method.name == "server.gcode_store";
        for method in METHODS {
            assert!(reads(method) || matches!(method.http, Http::Post | Http::No), "{}", method.name);
        }
    }
}
