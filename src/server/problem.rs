//! What a client is told when something was not done: RFC 9457's problem details.
//!
//! One kind, one status; words for people say what, where and what to do. Texts that came from a
//! client or a printer enter as JSON strings only.
use super::foreman::Refusal;
use axum::body::Body;
use axum::http::{HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use serde::Serialize;
use utoipa::ToSchema;

/// Where the kinds are named. `.invalid` is reserved (RFC 2606): nobody can own it.
const BASE: &str = "https://outrigger.invalid/problems/";

/// Kinds of problems.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// There is no such thing.
    NotFound,
    /// The request says something that cannot be.
    BadRequest,
    /// Nobody is known to ask.
    Unauthenticated,
    /// Who asks may not.
    Forbidden,
    /// The password is wanted once more.
    Reauthenticate,
    /// The page's token is missing or wrong.
    Csrf,
    /// It cannot be now.
    Conflict,
    /// Too many bytes.
    TooLarge,
    /// The disk is full.
    NoSpace,
    /// The content is of another kind.
    Unsupported,
    /// Too often.
    RateLimited,
    /// The bytes are not those that were announced.
    DigestMismatch,
    /// A fault of ours, or of the machine.
    Internal,
}

impl Kind {
    const ALL: [Kind; 13] = [
        Kind::NotFound,
        Kind::BadRequest,
        Kind::Unauthenticated,
        Kind::Forbidden,
        Kind::Reauthenticate,
        Kind::Csrf,
        Kind::Conflict,
        Kind::TooLarge,
        Kind::NoSpace,
        Kind::Unsupported,
        Kind::RateLimited,
        Kind::DigestMismatch,
        Kind::Internal,
    ];

    /// Its word, status and title.
    fn told(self) -> (&'static str, StatusCode, &'static str) {
        match self {
            Kind::NotFound => ("not-found", StatusCode::NOT_FOUND, "There is no such thing"),
            Kind::BadRequest => ("bad-request", StatusCode::BAD_REQUEST, "That request cannot be"),
            Kind::Unauthenticated => ("unauthenticated", StatusCode::UNAUTHORIZED, "Log in first"),
            Kind::Forbidden => ("forbidden", StatusCode::FORBIDDEN, "That is not allowed to you"),
            Kind::Reauthenticate => ("reauthenticate", StatusCode::FORBIDDEN, "Give your password once more"),
            Kind::Csrf => ("csrf", StatusCode::FORBIDDEN, "The page's token is missing: load the page again"),
            Kind::Conflict => ("conflict", StatusCode::CONFLICT, "That cannot be now"),
            Kind::TooLarge => ("too-large", StatusCode::PAYLOAD_TOO_LARGE, "That is too large"),
            Kind::NoSpace => ("no-space", StatusCode::INSUFFICIENT_STORAGE, "The disk is full"),
            Kind::Unsupported => {
                ("unsupported", StatusCode::UNSUPPORTED_MEDIA_TYPE, "That kind of content is not taken")
            }
            Kind::RateLimited => ("rate-limited", StatusCode::TOO_MANY_REQUESTS, "Too often: wait a little"),
            Kind::DigestMismatch => {
                ("digest-mismatch", StatusCode::BAD_REQUEST, "The bytes are not those that were announced")
            }
            Kind::Internal => ("internal", StatusCode::INTERNAL_SERVER_ERROR, "The daemon could not do it"),
        }
    }

    /// The kind of a word; a word that is none is a fault of ours.
    pub(crate) fn of(word: &str) -> Self {
        Kind::ALL.into_iter().find(|kind| kind.told().0 == word).unwrap_or(Kind::Internal)
    }

    /// All words, for the description of the API.
    pub(crate) fn words() -> Vec<&'static str> {
        Kind::ALL.iter().map(|kind| kind.told().0).collect()
    }
}

/// A problem.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    pub(crate) kind: Kind,
    pub(crate) detail: String,
    /// When it may be tried again.
    pub(crate) retry_after_s: Option<u64>,
}

/// How a problem is told.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub(crate) struct ProblemDetails {
    /// The kind, as an address that nobody answers.
    r#type: String,
    /// The kind, for people.
    title: &'static str,
    /// The status of the answer.
    status: u16,
    /// What, where, and what to do.
    detail: String,
}

impl Problem {
    /// A problem in words.
    pub(crate) fn new(kind: Kind, detail: impl Into<String>) -> Self {
        Self { kind, detail: detail.into(), retry_after_s: None }
    }

    /// There is no such thing.
    pub(crate) fn no_such(what: &str) -> Self {
        Self::new(Kind::NotFound, format!("there is no such {what}"))
    }

    /// The request says something that cannot be.
    pub(crate) fn bad(detail: impl Into<String>) -> Self {
        Self::new(Kind::BadRequest, detail)
    }

    /// It cannot be now.
    pub(crate) fn conflict(detail: impl Into<String>) -> Self {
        Self::new(Kind::Conflict, detail)
    }

    /// A fault of ours; the words are for the log as well.
    pub(crate) fn internal(detail: impl Into<String>) -> Self {
        let detail = detail.into();
        tracing::error!("{detail}");
        Self::new(Kind::Internal, detail)
    }

    /// Too often; to be tried again after so long.
    pub(crate) fn rate_limited(retry_after_s: u64) -> Self {
        let detail = format!("too many tries: again in {retry_after_s} s");
        Self { kind: Kind::RateLimited, detail, retry_after_s: Some(retry_after_s) }
    }

    /// The answer's status.
    pub(crate) fn status(&self) -> StatusCode {
        self.kind.told().1
    }
}

impl From<Refusal> for Problem {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::NoSuch(what) => Problem::no_such(what),
            Refusal::Conflict(words) => Problem::conflict(words),
            Refusal::Unfit(words) => Problem::new(Kind::Unsupported, words),
            Refusal::Shelf(why) if why.is_full() => {
                tracing::warn!("{why}");
                Problem::new(Kind::NoSpace, format!("{why}: make room, or delete files"))
            }
            Refusal::Shelf(why) => Problem::internal(why.to_string()),
            Refusal::Ending => Problem::conflict("the daemon is ending"),
        }
    }
}

impl IntoResponse for Problem {
    fn into_response(self) -> Response {
        let (word, status, title) = self.kind.told();
        let details = ProblemDetails {
            r#type: format!("{BASE}{word}"),
            title,
            status: status.as_u16(),
            detail: self.detail,
        };
        let body = serde_json::to_vec(&details).unwrap_or_default();
        let mut response = Response::new(Body::from(body));
        *response.status_mut() = status;
        let headers = response.headers_mut();
        headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("application/problem+json"));
        if let Some(seconds) = self.retry_after_s {
            headers.insert(header::RETRY_AFTER, HeaderValue::from(seconds));
        }
        response
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::to_bytes;

    #[tokio::test]
    async fn a_problem_is_told_as_rfc_9457_wants() {
        let response = Problem::rate_limited(7).into_response();
        assert_eq!(response.status(), StatusCode::TOO_MANY_REQUESTS);
        assert_eq!(response.headers()[header::RETRY_AFTER], "7");
        assert_eq!(response.headers()[header::CONTENT_TYPE], "application/problem+json");
        let body = to_bytes(response.into_body(), 4096).await.unwrap();
        let told: serde_json::Value = serde_json::from_slice(&body).unwrap();
        assert_eq!(told["type"], "https://outrigger.invalid/problems/rate-limited");
        assert_eq!(told["status"], 429);
    }

    #[test]
    fn kinds_have_words_of_their_own() {
        let mut words = Kind::words();
        words.sort_unstable();
        words.dedup();
        assert_eq!(words.len(), Kind::ALL.len());
        for kind in Kind::ALL {
            assert_eq!(Kind::of(kind.told().0), kind);
        }
    }
}
