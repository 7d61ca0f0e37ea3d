//! Errors in Moonraker's form, over HTTP and over the socket, and who may ask.
use crate::server::api::live::same_origin;
use crate::server::app::App;
use crate::server::asker::Who;
use crate::server::auth::Scope;
use crate::server::octoprint::asked::{Asked, At};
use crate::server::problem::Problem;
use axum::Json;
use axum::extract::{FromRequestParts, Query};
use axum::http::request::Parts;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// JSON-RPC 2.0: there is no such method.
const NO_METHOD: i64 = -32601;

/// What is wrong.
#[derive(Clone, Debug)]
pub(super) struct Fault {
    status: StatusCode,
    /// What the socket says instead of the status.
    code: i64,
    message: String,
    retry_after_s: Option<u64>,
}

impl Fault {
    pub(super) fn new(status: StatusCode, message: impl Into<String>) -> Self {
        Self { status, code: status.as_u16().into(), message: message.into(), retry_after_s: None }
    }

    pub(super) fn bad(message: impl Into<String>) -> Self {
        Self::new(StatusCode::BAD_REQUEST, message)
    }

    pub(super) fn no_method() -> Self {
        Self { code: NO_METHOD, ..Self::new(StatusCode::NOT_FOUND, "Method not found") }
    }

    /// A fault that only JSON-RPC knows.
    pub(super) fn rpc(code: i64, message: &str) -> Self {
        Self { code, ..Self::bad(message) }
    }

    /// As the socket tells it.
    pub(super) fn told(&self) -> Value {
        json!({"code": self.code, "message": self.message})
    }
}

impl From<Problem> for Fault {
    fn from(problem: Problem) -> Self {
        let retry_after_s = problem.retry_after_s;
        Self { retry_after_s, ..Self::new(problem.status(), problem.detail) }
    }
}

impl IntoResponse for Fault {
    fn into_response(self) -> Response {
        let told = json!({"error": {"code": self.status.as_u16(), "message": self.message}});
        let mut response = (self.status, Json(told)).into_response();
        let headers = response.headers_mut();
        if self.status == StatusCode::UNAUTHORIZED {
            headers
                .insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"Printer API\""));
        }
        if let Some(seconds) = self.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

/// Somebody who is known; what they may is asked where the method is known. A wrong key is 401 here,
/// by which this API's clients ask for another one.
pub(super) struct Caller(pub(super) Asked);

impl FromRequestParts<Arc<App>> for Caller {
    type Rejection = Fault;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Fault> {
        let who = Who::from_request_parts(parts, app).await?;
        Ok(Self(Asked { at: At::of(parts, app).await?, who }))
    }
}

/// Somebody who may read: by a key, by a session, or by a token that opens this socket.
pub(super) struct Viewer(pub(super) Asked);

#[derive(Deserialize)]
struct Token {
    token: Option<String>,
}

impl FromRequestParts<Arc<App>> for Viewer {
    type Rejection = Fault;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Fault> {
        let token = Query::<Token>::try_from_uri(&parts.uri).ok().and_then(|Query(query)| query.token);
        let asked = match token {
            Some(token) => {
                let wrong = || Fault::new(StatusCode::UNAUTHORIZED, "the token is wrong, spent or too old");
                let who = app.oneshots.spend(&token).ok_or_else(wrong)?;
                Asked { at: At::of(parts, app).await?, who }
            }
            None => Caller::from_request_parts(parts, app).await?.0,
        };
        asked.who.require(Scope::Read)?;
        // A browser sends a session's cookie along whichever page opens the socket.
        match same_origin(&parts.headers) {
            true => Ok(Self(asked)),
            false => Err(Fault::new(
                StatusCode::FORBIDDEN,
                "this page may not listen here: it came from elsewhere",
            )),
        }
    }
}
