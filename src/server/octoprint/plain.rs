//! Errors as these clients read them, and who may ask: text/plain, its first 100 characters tell it.
//!
//! A wrong key is 403, none at all is 401: so does OctoPrint, and its clients ask for a new key at
//! a 403 only. The challenge is the one that we can take; programs use `X-Api-Key`.
use super::asked::{Asked, At};
use crate::server::app::App;
use crate::server::asker::{Who, key};
use crate::server::auth::Scope;
use crate::server::problem::{Kind, Problem};
use axum::body::Body;
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderValue, header};
use axum::response::{IntoResponse, Response};
use serde::de::DeserializeOwned;
use std::sync::Arc;

/// What is wrong, in plain text.
#[derive(Debug)]
pub(crate) struct Plain(pub(crate) Problem);

impl From<Problem> for Plain {
    fn from(problem: Problem) -> Self {
        Self(problem)
    }
}

impl IntoResponse for Plain {
    fn into_response(self) -> Response {
        let Plain(problem) = self;
        let mut response = Response::new(Body::from(problem.detail.clone()));
        *response.status_mut() = problem.status();
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/plain; charset=utf-8"));
        if problem.kind == Kind::Unauthenticated {
            headers
                .insert(header::WWW_AUTHENTICATE, HeaderValue::from_static("Bearer realm=\"Printer API\""));
        }
        if let Some(seconds) = problem.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

/// Who asks for which printer, if they have that scope.
async fn asked(parts: &mut Parts, app: &Arc<App>, scope: Scope) -> Result<Asked, Plain> {
    let who = match Who::from_request_parts(parts, app).await {
        Err(problem) if problem.kind == Kind::Unauthenticated => {
            return Err(Plain(match key(&parts.headers) {
                Some(_) => Problem::new(
                    Kind::Forbidden,
                    "this API key is wrong, or was withdrawn: make one on the page",
                ),
                None => {
                    Problem::new(Kind::Unauthenticated, "give an API key (X-Api-Key): make one on the page")
                }
            }));
        }
        who => who?,
    };
    who.require(scope)?;
    Ok(Asked { at: At::of(parts, app).await?, who })
}

macro_rules! scoped {
    ($($(#[$doc:meta])* $name:ident),*) => {$(
        $(#[$doc])*
        pub(crate) struct $name(pub(crate) Asked);

        impl FromRequestParts<Arc<App>> for $name {
            type Rejection = Plain;

            async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Plain> {
                asked(parts, app, Scope::$name).await.map(Self)
            }
        }
    )*};
}

scoped!(
    /// Whoever may read.
    Read,
    /// Whoever may print.
    Print,
    /// Whoever may command the printer.
    Control
);

/// The printer, whoever asks.
pub(super) struct Anybody(pub(super) At);

impl FromRequestParts<Arc<App>> for Anybody {
    type Rejection = Plain;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Plain> {
        Ok(Self(At::of(parts, app).await?))
    }
}

/// A body's JSON, whatever the client calls its kind.
///
/// # Errors
/// It is none, or another one.
pub(super) fn json<T: DeserializeOwned>(body: &[u8]) -> Result<T, Plain> {
    serde_json::from_slice(body)
        .map_err(|e| Plain(Problem::bad(format!("the body is not the JSON that goes here: {e}"))))
}

/// A text as a part of an address: only what RFC 3986 calls unreserved stays as it is.
pub(crate) fn encoded(text: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte);
    let one = |byte: u8| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    text.bytes().map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_in_an_address_cannot_leave_it() {
        assert_eq!(encoded("a b/ü?.gcode"), "a%20b%2F%C3%BC%3F.gcode");
    }

    #[test]
    fn no_key_is_asked_for_one() {
        let response = Plain(Problem::new(Kind::Unauthenticated, "x")).into_response();
        assert_eq!(response.status(), 401);
        assert!(response.headers().contains_key(header::WWW_AUTHENTICATE));
        let response = Plain(Problem::conflict("x")).into_response();
        assert_eq!(response.headers()[header::CONTENT_TYPE], "text/plain; charset=utf-8");
    }
}
