//! The page: its files, embedded in the binary, packed once.
//!
//! Every name is known beforehand; nothing that a client says becomes part of a path.
use axum::Router;
use axum::body::Body;
use axum::extract::Path;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use flate2::Compression;
use flate2::write::GzEncoder;
use rust_embed::RustEmbed;
use std::collections::BTreeMap;
use std::io::Write;
use std::sync::LazyLock;

#[derive(RustEmbed)]
#[folder = "web/page/"]
struct Sources;

/// A file of the page.
struct Asset {
    kind: &'static str,
    plain: Vec<u8>,
    packed: Vec<u8>,
    /// Changes with the content.
    tag: String,
}

static ASSETS: LazyLock<BTreeMap<String, Asset>> = LazyLock::new(|| {
    Sources::iter()
        .filter(|name| !name.ends_with(".md"))
        .filter_map(|name| Some((name.to_string(), asset(&name)?)))
        .collect()
});

fn asset(name: &str) -> Option<Asset> {
    let file = Sources::get(name)?;
    let plain = file.data.into_owned();
    let mut packer = GzEncoder::new(Vec::new(), Compression::best());
    // Writing to a vector cannot fail.
    let packed = packer.write_all(&plain).and_then(|()| packer.finish()).unwrap_or_default();
    let tag = file.metadata.sha256_hash()[..8].iter().map(|b| format!("{b:02x}")).collect();
    let ending = name.rsplit('.').next().unwrap_or_default();
    let kind = match ending {
        "html" => "text/html; charset=utf-8",
        "css" => "text/css; charset=utf-8",
        "js" => "text/javascript; charset=utf-8",
        "svg" => "image/svg+xml",
        "png" => "image/png",
        "webmanifest" => "application/manifest+json",
        _ => "application/octet-stream",
    };
    Some(Asset { kind, plain, packed, tag })
}

/// The page's routes.
pub(crate) fn routes<S: Clone + Send + Sync + 'static>() -> Router<S> {
    Router::new().route("/", get(|headers: HeaderMap| async move { give("index.html", &headers) })).route(
        "/assets/{name}",
        get(|Path(name): Path<String>, headers: HeaderMap| async move { give(&name, &headers) }),
    )
}

fn give(name: &str, asked: &HeaderMap) -> Response {
    let Some(asset) = ASSETS.get(name) else { return StatusCode::NOT_FOUND.into_response() };
    let tag = format!("\"{}\"", asset.tag);
    let known = asked.get(header::IF_NONE_MATCH).is_some_and(|given| given.as_bytes() == tag.as_bytes());
    let packs = asked
        .get(header::ACCEPT_ENCODING)
        .and_then(|value| value.to_str().ok())
        .is_some_and(|ways| ways.split(',').any(|way| way.trim().starts_with("gzip")));
    let mut response = match (known, packs) {
        (true, _) => StatusCode::NOT_MODIFIED.into_response(),
        (false, true) => Response::new(Body::from(asset.packed.clone())),
        (false, false) => Response::new(Body::from(asset.plain.clone())),
    };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(asset.kind));
    headers.insert(header::VARY, HeaderValue::from_static("Accept-Encoding"));
    // Asked for each time, and answered in a few bytes if nothing has changed: after an update
    // nobody sees half an old page.
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    if let Ok(tag) = HeaderValue::from_str(&tag) {
        headers.insert(header::ETAG, tag);
    }
    if packs && !known {
        headers.insert(header::CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Largest first view, bytes on the wire.
    const FIRST_VIEW_BYTES: usize = 150_000;

    #[test]
    fn the_first_view_is_small_and_asks_for_nothing_from_elsewhere() {
        let all: usize = ASSETS.values().map(|asset| asset.packed.len()).sum();
        assert!(all > 0 && all < FIRST_VIEW_BYTES, "{all} bytes");
        for (name, asset) in ASSETS.iter() {
            let text = String::from_utf8_lossy(&asset.plain);
            for address in
                text.split(['"', '\'', '`', ' ', '(']).filter(|w| w.starts_with("http") && w.contains("://"))
            {
                let known = ["http://www.w3.org/", "http://", "https://"];
                assert!(known.contains(&address) || address.starts_with(known[0]), "{name}: {address}");
            }
        }
    }

    #[test]
    fn what_is_known_is_not_sent_again() {
        let mut headers = HeaderMap::new();
        let first = give("index.html", &headers);
        assert_eq!(first.status(), StatusCode::OK);
        headers.insert(header::IF_NONE_MATCH, first.headers()[header::ETAG].clone());
        assert_eq!(give("index.html", &headers).status(), StatusCode::NOT_MODIFIED);
        assert_eq!(give("../Cargo.toml", &headers).status(), StatusCode::NOT_FOUND);
    }
}
