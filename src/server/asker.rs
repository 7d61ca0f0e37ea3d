//! Who asks: from a request's headers and its connection to somebody with scopes, or a problem.
//!
//! The extractors [`Read`], [`Print`], [`Control`] and [`Admin`] stand in the handlers' signatures,
//! so that what a route wants is where the route is. A key decides where there is one; a cookie
//! beside it does not count. Whatever is not GET or HEAD and comes with a cookie also needs the
//! page's token.
use super::app::App;
use super::auth::{self, Refused, Scope, Source, client};
use super::http::Peer;
use super::problem::{Kind, Problem};
use axum::extract::FromRequestParts;
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, header};
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;

/// The cookie's name.
pub(crate) const COOKIE: &str = "outrigger_session";

/// The page's token.
pub(crate) const CSRF: &str = "x-csrf-token";

/// Somebody who is known.
#[derive(Clone, Debug)]
pub(crate) struct Who(pub(crate) auth::Who);

impl Who {
    /// The user's or the key's name.
    pub(crate) fn name(&self) -> &str {
        &self.0.name
    }

    /// May do all.
    pub(crate) fn is_admin(&self) -> bool {
        self.0.scopes.has(Scope::Admin)
    }

    /// Has a scope.
    ///
    /// # Errors
    /// Has not.
    pub(crate) fn require(&self, scope: Scope) -> Result<(), Problem> {
        Ok(self.0.require(scope)?)
    }

    /// Has given the password lately, or is a program.
    ///
    /// # Errors
    /// Has not.
    pub(crate) fn confirmed(&self) -> Result<(), Problem> {
        Ok(self.0.require_confirmed(Scope::Read, crate::station::now_unix_s())?)
    }
}

impl From<Refused> for Problem {
    fn from(refused: Refused) -> Self {
        let words = refused.to_string();
        match refused {
            Refused::Limited(limited) => Problem::rate_limited(limited.retry_after_s),
            Refused::NoRandom(_) => Problem::internal(words),
            refused => Problem::new(Kind::of(refused.kind()), words),
        }
    }
}

/// Whoever may read.
#[derive(Clone, Debug)]
pub(crate) struct Read(#[allow(dead_code)] pub(crate) Who);

/// Whoever may print.
#[derive(Clone, Debug)]
pub(crate) struct Print(pub(crate) Who);

/// Whoever may command a printer.
#[derive(Clone, Debug)]
pub(crate) struct Control(pub(crate) Who);

/// Admins.
#[derive(Clone, Debug)]
pub(crate) struct Admin(pub(crate) Who);

macro_rules! scoped {
    ($($name:ident),*) => {$(
        impl FromRequestParts<Arc<App>> for $name {
            type Rejection = Problem;

            async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Problem> {
                let who = who(parts, app)?;
                who.require(Scope::$name)?;
                Ok(Self(who))
            }
        }
    )*};
}

scoped!(Read, Print, Control, Admin);

/// Who asks, if it is anybody.
impl FromRequestParts<Arc<App>> for Who {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Problem> {
        who(parts, app)
    }
}

/// Where a request comes from.
pub(crate) struct Whence(pub(crate) Source);

impl FromRequestParts<Arc<App>> for Whence {
    type Rejection = Problem;

    async fn from_request_parts(parts: &mut Parts, app: &Arc<App>) -> Result<Self, Problem> {
        Ok(Self(source(&parts.headers, parts.extensions.get(), app)))
    }
}

/// Where a request comes from; nobody but the configured proxies is believed about others.
pub(crate) fn source(headers: &HeaderMap, peer: Option<&Peer>, app: &App) -> Source {
    let nowhere = SocketAddr::new(IpAddr::V4(Ipv4Addr::UNSPECIFIED), 0);
    let peer = peer.map_or(nowhere, |peer| peer.address);
    let all = |name: header::HeaderName| {
        headers
            .get_all(name)
            .into_iter()
            .filter_map(|value| value.to_str().ok())
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    let forwarded_for = all(header::HeaderName::from_static("x-forwarded-for"));
    let forwarded = all(header::FORWARDED);
    fn texts(all: &[String]) -> Vec<&str> {
        all.iter().map(String::as_str).collect()
    }
    let trusted = &app.config.server.trusted_proxies;
    Source::from(client(peer.ip(), trusted, &texts(&forwarded_for), &texts(&forwarded)))
}

/// The session's token in the cookies.
pub(crate) fn cookie(headers: &HeaderMap) -> Option<&str> {
    headers
        .get_all(header::COOKIE)
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|cookies| cookies.split(';'))
        .find_map(|cookie| cookie.trim().strip_prefix(COOKIE)?.strip_prefix('='))
}

/// The key in the headers; an empty one is one, and a wrong one.
pub(crate) fn key(headers: &HeaderMap) -> Option<&str> {
    let own = headers.get("x-api-key").map(|value| value.to_str().unwrap_or(""));
    own.or_else(|| {
        let told = headers.get(header::AUTHORIZATION)?.to_str().ok()?;
        told.strip_prefix("Bearer ").or_else(|| told.strip_prefix("bearer "))
    })
}

fn who(parts: &Parts, app: &App) -> Result<Who, Problem> {
    let changes = parts.method != Method::GET && parts.method != Method::HEAD;
    let csrf = parts.headers.get(CSRF).and_then(|value| value.to_str().ok());
    identify(&parts.headers, parts.extensions.get(), changes.then_some(csrf), app)
}

/// Who sends these headers; `changes`: with which page's token, for what changes something.
///
/// # Errors
/// Nobody is known by them, or the token is wrong.
pub(crate) fn identify(
    headers: &HeaderMap,
    peer: Option<&Peer>,
    changes: Option<Option<&str>>,
    app: &App,
) -> Result<Who, Problem> {
    let now_ms = app.auth.now_ms();
    if let Some(given) = key(headers) {
        let source = source(headers, peer, app);
        return Ok(app.auth.with(|auth, now| auth.by_key(given, source, now, now_ms)).map(Who)?);
    }
    let token = cookie(headers).ok_or(Refused::Unauthenticated)?;
    let who = app.auth.with(|auth, now| auth.by_cookie(token, now))?;
    if let Some(token) = changes {
        who.check_csrf(token)?;
    }
    Ok(Who(who))
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderValue;

    fn headers(pairs: &[(&'static str, &'static str)]) -> HeaderMap {
        pairs
            .iter()
            .map(|(name, value)| (header::HeaderName::from_static(name), HeaderValue::from_static(value)))
            .collect()
    }

    #[test]
    fn cookies_and_keys_are_found() {
        let check = |pairs: &[(&'static str, &'static str)], expect: Option<&str>| {
            assert_eq!(cookie(&headers(pairs)), expect, "{pairs:?}");
        };
        check(&[("cookie", "a=b; outrigger_session=T; c=d")], Some("T"));
        check(&[("cookie", "outrigger_session2=T")], None);
        check(&[("cookie", "a=b")], None);
        let check = |pairs: &[(&'static str, &'static str)], expect: Option<&str>| {
            assert_eq!(key(&headers(pairs)), expect, "{pairs:?}");
        };
        check(&[("x-api-key", "K")], Some("K"));
        check(&[("x-api-key", "")], Some(""));
        check(&[("authorization", "Bearer K")], Some("K"));
        check(&[("authorization", "Digest username=\"x\"")], None);
        check(&[], None);
    }
}
