//! `/keys`: what programs come in with, and applications that ask for one.
use crate::server::app::App;
use crate::server::asker::Admin;
use crate::server::auth::{ApiKey, AppRequest, KeysError, Name, Role, Scope, ScopeSet};
use crate::server::foreman::view;
use crate::server::problem::{Problem, ProblemDetails};
use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::sync::Arc;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(list, make))
        .routes(routes!(revoke))
        .routes(routes!(requests))
        .routes(routes!(decide))
}

/// A key, without what opens the door.
#[derive(Debug, Serialize, ToSchema)]
struct Key {
    id: String,
    name: String,
    scopes: Vec<&'static str>,
    /// Who made it.
    by: String,
    created_unix_s: u64,
    /// When it was last used, to within some minutes.
    used_unix_s: Option<u64>,
    /// The key itself: only in the answer that makes it.
    #[serde(skip_serializing_if = "Option::is_none")]
    key: Option<String>,
}

fn shown(key: &ApiKey) -> Key {
    Key {
        id: key.id.clone(),
        name: key.name.to_string(),
        scopes: key.scopes.iter().map(Scope::word).collect(),
        by: key.by.clone(),
        created_unix_s: key.created_unix_s,
        used_unix_s: key.last_used_unix_s,
        key: None,
    }
}

impl From<KeysError> for Problem {
    fn from(why: KeysError) -> Self {
        match why {
            KeysError::Unknown => Problem::no_such("key"),
            why => Problem::conflict(why.to_string()),
        }
    }
}

/// All keys
#[utoipa::path(get, path = "/keys", responses((status = 200, body = [Key])))]
async fn list(_: Admin, State(app): State<Arc<App>>) -> Json<Vec<Key>> {
    Json(app.auth.with(|auth, _| auth.keys().map(shown).collect()))
}

/// A new key.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct New {
    name: String,
    /// Of `read`, `print`, `control`, `admin`.
    #[schema(value_type = Vec<String>)]
    scopes: ScopeSet,
}

/// Make a key; it is shown this once
#[utoipa::path(post, path = "/keys", request_body = New,
    responses((status = 201, body = Key), (status = 400, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn make(
    Admin(who): Admin,
    State(app): State<Arc<App>>,
    Json(new): Json<New>,
) -> Result<(StatusCode, Json<Key>), Problem> {
    who.confirmed()?;
    let name = Name::new(&new.name).map_err(|e| Problem::bad(e.to_string()))?;
    if new.scopes.is_empty() {
        return Err(Problem::bad(
            "a key without scopes opens nothing: say some of read, print, control, admin",
        ));
    }
    let (key, secret) = app.auth.change(|auth, now| auth.make_key(name, new.scopes, who.name(), now)).await?;
    tracing::info!(key = key.id, name = %key.name, by = who.name(), "key made");
    Ok((StatusCode::CREATED, Json(Key { key: Some(secret.reveal().to_owned()), ..shown(&key) })))
}

/// Revoke a key
#[utoipa::path(delete, path = "/keys/{id}", params(("id" = String, Path)),
    responses((status = 204), (status = 404, body = ProblemDetails)))]
async fn revoke(
    Admin(who): Admin,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
) -> Result<StatusCode, Problem> {
    who.confirmed()?;
    app.auth.change(|auth, _| auth.revoke_key(&id)).await?;
    tracing::info!(key = id, by = who.name(), "key revoked");
    Ok(StatusCode::NO_CONTENT)
}

/// An application that waits for an answer.
#[derive(Debug, Serialize, ToSchema)]
struct Asking {
    id: String,
    /// What it calls itself.
    app: String,
    /// For whom it asks, as it says.
    user: Option<String>,
}

fn asking(request: &AppRequest) -> Asking {
    Asking {
        id: request.id.clone(),
        app: request.app.to_string(),
        user: request.user.as_ref().map(ToString::to_string),
    }
}

/// Applications that ask for a key
#[utoipa::path(get, path = "/keys/requests", responses((status = 200, body = [Asking])))]
async fn requests(_: Admin, State(app): State<Arc<App>>) -> Json<Vec<Asking>> {
    Json(app.auth.with(|auth, now| auth.key_requests(now).map(asking).collect()))
}

/// Whether an application gets its key.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Decision {
    allow: bool,
    /// What it may do; left out: read, print, control.
    #[schema(value_type = Option<Vec<String>>)]
    scopes: Option<ScopeSet>,
}

/// Give an application its key, or not
#[utoipa::path(post, path = "/keys/requests/{id}", params(("id" = String, Path)), request_body = Decision,
    responses((status = 204), (status = 404, body = ProblemDetails)))]
async fn decide(
    Admin(who): Admin,
    State(app): State<Arc<App>>,
    Path(id): Path<String>,
    Json(decision): Json<Decision>,
) -> Result<StatusCode, Problem> {
    let scopes = decision.allow.then(|| decision.scopes.unwrap_or(Role::Operator.scopes()));
    app.auth
        .with(|auth, now| auth.answer_key_request(&id, scopes, who.name(), now))
        .map_err(|e| Problem::new(crate::server::problem::Kind::NotFound, e.to_string()))?;
    tracing::info!(
        request = id,
        allow = decision.allow,
        by = who.name(),
        "an application's request for a key"
    );
    app.view.tell(view::Scope::Admin, || json!({"type": "key_answered", "id": id}));
    Ok(StatusCode::NO_CONTENT)
}
