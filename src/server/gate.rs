//! What every request passes: how often one may ask, and what every answer says to browsers.
//!
//! Also the log's line for a request, without its query and headers: keys may stand there.
use super::app::App;
use super::asker::source;
use super::config::webcam_origin;
use super::http::Peer;
use axum::body::Body;
use axum::extract::{Request, State};
use axum::http::{HeaderName, HeaderValue, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::StreamExt;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tokio::time::timeout;

/// A client that sends nothing of its body for so long has gone.
const SILENT: Duration = Duration::from_secs(30);

/// What a browser may do with the page: nothing but what came from here.
pub(crate) fn policy(app: &App) -> String {
    let cams: Vec<&str> =
        app.stations.iter().filter_map(|s| webcam_origin(s.config.webcam_url.as_deref()?)).collect();
    format!(
        "default-src 'self'; img-src 'self' data: {}; frame-src 'self'; object-src 'none'; base-uri 'none'; \
         form-action 'self'; frame-ancestors 'self'",
        cams.join(" ")
    )
}

/// A path as it may stand in a log: what an application fetches its key with is left out.
fn told(path: &str) -> String {
    const SECRET: &str = "/appkeys/request/";
    match path.split_once(SECRET) {
        Some((before, _)) => format!("{before}{SECRET}…"),
        None => path.to_owned(),
    }
}

/// A body whose client falls silent ends with a fault: nobody holds connections by announcing what
/// never comes, known or not.
fn unless_silent(body: Body) -> Body {
    let pieces = futures_util::stream::try_unfold(body.into_data_stream(), |mut pieces| async move {
        match timeout(SILENT, pieces.next()).await {
            Ok(Some(piece)) => Ok(Some((piece?, pieces))),
            Ok(None) => Ok(None),
            Err(_) => {
                let words = format!("nothing came for {} s", SILENT.as_secs());
                Err(axum::Error::new(std::io::Error::other(words)))
            }
        }
    });
    Body::from_stream(pieces)
}

/// The layer around all routes.
pub(crate) async fn pass(
    State((app, policy)): State<(Arc<App>, HeaderValue)>,
    request: Request,
    next: Next,
) -> Response {
    let began = Instant::now();
    let from = source(request.headers(), request.extensions().get::<Peer>(), &app);
    let (method, path) = (request.method().clone(), told(request.uri().path()));
    let encrypted = request.extensions().get::<Peer>().is_some_and(|peer| peer.encrypted);
    let mut response = match app.auth.admit(from) {
        Ok(()) => next.run(request.map(unless_silent)).await,
        Err(problem) => problem.into_response(),
    };
    let headers = response.headers_mut();
    // A picture made of somebody's file brings a stricter one.
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(policy);
    for (name, value) in [
        (header::X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (header::REFERRER_POLICY, "same-origin"),
        (header::X_FRAME_OPTIONS, "SAMEORIGIN"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
        (HeaderName::from_static("permissions-policy"), "camera=(), microphone=(), geolocation=()"),
    ] {
        headers.insert(name, HeaderValue::from_static(value));
    }
    if encrypted {
        headers.insert(header::STRICT_TRANSPORT_SECURITY, HeaderValue::from_static("max-age=31536000"));
    }
    // The page's files say themselves how long they are good.
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("no-store"));
    tracing::debug!(%method, path, status = response.status().as_u16(), ms = began.elapsed().as_millis() as u64, "request");
    response
}
