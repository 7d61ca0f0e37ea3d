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
use std::time::Duration;
use tokio::time::{Instant, timeout};

/// A client that sends less than [`LEAST_BYTES`] of its body in so long has gone, or only wants to
/// hold the connection.
const SILENT: Duration = Duration::from_secs(30);

/// Slower than the slowest link that anybody uploads by: 1 kB/s.
const LEAST_BYTES: usize = 30_000;

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

/// A body whose client falls silent, or all but silent, ends with a fault: nobody holds connections by
/// announcing what never comes, known or not. The time that we take to write it does not count.
fn unless_silent(body: Body) -> Body {
    struct Coming {
        pieces: axum::body::BodyDataStream,
        /// Waited for, since so many bytes came last.
        waited: Duration,
        bytes: usize,
    }
    let coming = Coming { pieces: body.into_data_stream(), waited: Duration::ZERO, bytes: 0 };
    let pieces = futures_util::stream::try_unfold(coming, |mut coming| async move {
        let began = Instant::now();
        match timeout(SILENT.saturating_sub(coming.waited), coming.pieces.next()).await {
            Ok(Some(piece)) => {
                let piece = piece?;
                coming.waited += began.elapsed();
                coming.bytes += piece.len();
                if coming.bytes >= LEAST_BYTES {
                    (coming.waited, coming.bytes) = (Duration::ZERO, 0);
                }
                Ok(Some((piece, coming)))
            }
            Ok(None) => Ok(None),
            Err(_) => {
                let words =
                    format!("{} bytes came in {} s: too few to go on", coming.bytes, SILENT.as_secs());
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

#[cfg(test)]
mod tests {
    use super::*;
    use axum::body::Bytes;
    use futures_util::stream;

    #[tokio::test(start_paused = true)]
    async fn whoever_sends_next_to_nothing_is_given_up() {
        async fn check(pieces: usize, bytes: usize, pause_s: u64, expect: Result<usize, &str>) {
            let slow = stream::unfold(0, move |sent| async move {
                tokio::time::sleep(Duration::from_secs(pause_s)).await;
                (sent < pieces).then(|| (Ok::<_, axum::Error>(Bytes::from(vec![0; bytes])), sent + 1))
            });
            let got = axum::body::to_bytes(unless_silent(Body::from_stream(slow)), usize::MAX).await;
            let told = got.map(|all| all.len()).map_err(|why| why.to_string());
            match (told, expect) {
                (Ok(got), Ok(expect)) => assert_eq!(got, expect),
                (Err(got), Err(expect)) => assert!(got.contains(expect), "{got}"),
                (got, expect) => panic!("{got:?} for {expect:?}"),
            }
        }
        check(0, 0, 0, Ok(0)).await;
        check(3, 1, 7, Ok(3)).await;
        check(1, 1, 31, Err("0 bytes came in 30 s")).await;
        check(100, 1, 29, Err("1 bytes came")).await;
        check(1000, 900, 1, Err("bytes came in 30 s")).await;
        check(1000, 1100, 1, Ok(1_100_000)).await;
        check(50, 60_000, 29, Ok(3_000_000)).await;
    }
}
