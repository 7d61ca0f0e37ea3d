//! Applications that ask for a key, as with OctoPrint's application keys: they ask, a person decides
//! on the page, they fetch the key. Nobody needs one to ask; how many may is bounded.
use super::files::created;
use super::plain::{Anybody, Plain, json};
use crate::server::app::App;
use crate::server::asker::Whence;
use crate::server::auth::AppAnswer;
use crate::server::foreman::view::Scope;
use crate::server::problem::{Kind, Problem};
use axum::body::Bytes;
use axum::extract::Path;
use axum::http::StatusCode;
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;

pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .route("/plugin/appkeys/probe", get(|| async { StatusCode::NO_CONTENT }))
        .route("/plugin/appkeys/request", post(ask))
        .route("/plugin/appkeys/request/{token}", get(poll))
}

#[derive(Deserialize)]
struct Application {
    app: String,
    user: Option<String>,
}

async fn ask(Anybody(at): Anybody, Whence(source): Whence, body: Bytes) -> Result<Response, Plain> {
    let Application { app, user } = json(&body)?;
    let asked = at.app.auth.with(|auth, now| auth.ask_key(source, &app, user.as_deref(), now));
    // Too many wait, mostly; or nothing is left of its name.
    let (request, token) = asked.map_err(|why| Problem::new(Kind::RateLimited, why.to_string()))?;
    tracing::info!(request = request.id, app = %request.app, "an application asks for a key");
    at.app
        .view
        .tell(Scope::Admin, || json!({"type": "key_request", "id": request.id, "app": request.app.as_str()}));
    let location = format!("{}/plugin/appkeys/request/{}", at.base(), token.reveal());
    let told = json!({"app_token": token.reveal(), "auth_dialog": format!("{}/#/settings", at.origin)});
    Ok(created(&location, told))
}

#[derive(Deserialize)]
struct Token {
    token: String,
}

async fn poll(Anybody(at): Anybody, Path(Token { token }): Path<Token>) -> Result<Response, Plain> {
    let answer = at.app.auth.with(|auth, now| auth.poll_key(&token, now));
    match answer.map_err(|why| Problem::new(Kind::NotFound, why.to_string()))? {
        AppAnswer::Pending => {
            Ok((StatusCode::ACCEPTED, Json(json!({"message": "Awaiting decision"}))).into_response())
        }
        AppAnswer::Key(key) => {
            // What is not on the medium is gone with the next start: no client shall rely on it.
            at.app.auth.keep().await?;
            Ok(Json(json!({"api_key": key.reveal()})).into_response())
        }
        AppAnswer::Gone => Err(Plain(Problem::no_such("request: denied, fetched, or too old"))),
    }
}
