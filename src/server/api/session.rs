//! `/session` and `/setup`: how a person comes in, and the first of all.
use crate::server::app::App;
use crate::server::asker::{COOKIE, Whence, Who, cookie};
use crate::server::auth::{
    self, CodeError, Login, Name, PasswordHash, Role, SESSION_MAX_AGE_S, Scope, SetupError, Via,
};
use crate::server::http::Peer;
use crate::server::problem::{Kind, Problem, ProblemDetails};
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new()
        .routes(routes!(get, log_in, log_out))
        .routes(routes!(confirm))
        .routes(routes!(set_up))
}

/// Who is there.
#[derive(Debug, Serialize, ToSchema)]
struct Session {
    user: Option<User>,
    /// What a page sends along as `X-Csrf-Token` with whatever changes something.
    csrf: Option<String>,
    /// Nobody can log in yet: `/setup` makes the first user.
    needs_first_user: bool,
    version: &'static str,
}

/// A person, or a program.
#[derive(Debug, Serialize, ToSchema)]
struct User {
    name: String,
    /// `viewer`, `operator`, `admin`; of a program `key`.
    role: &'static str,
    scopes: Vec<&'static str>,
}

fn session(app: &App, who: Option<&auth::Who>) -> Session {
    let (role, csrf) = match who.map(|who| &who.via) {
        Some(Via::Session { role, csrf, .. }) => (role.word(), Some(csrf.reveal().to_owned())),
        _ => ("key", None),
    };
    Session {
        user: who.map(|who| User {
            name: who.name.clone(),
            role,
            scopes: who.scopes.iter().map(Scope::word).collect(),
        }),
        csrf,
        needs_first_user: app.auth.with(|auth, _| auth.needs_first_user()),
        version: env!("CARGO_PKG_VERSION"),
    }
}

/// Who is asking
#[utoipa::path(get, path = "/session", responses((status = 200, body = Session)))]
async fn get(State(app): State<Arc<App>>, who: Result<Who, Problem>) -> Result<Json<Session>, Problem> {
    match who {
        Ok(who) => Ok(Json(session(&app, Some(&who.0)))),
        Err(problem) if problem.kind == Kind::Unauthenticated => Ok(Json(session(&app, None))),
        Err(problem) => Err(problem),
    }
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Credentials {
    name: String,
    password: String,
}

/// Log in
#[utoipa::path(post, path = "/session", request_body = Credentials,
    responses((status = 200, body = Session), (status = 401, body = ProblemDetails), (status = 429, body = ProblemDetails)))]
async fn log_in(
    State(app): State<Arc<App>>,
    Whence(source): Whence,
    peer: Option<Extension<Peer>>,
    headers: HeaderMap,
    Json(Credentials { name, password }): Json<Credentials>,
) -> Result<Response, Problem> {
    let now_ms = app.auth.now_ms();
    let attempt = app.auth.with(|auth, _| auth.begin_login(source, &name, now_ms))?;
    let checked = blocking(move || attempt.check(&password)).await?;
    let login = app.auth.with(|auth, now| auth.finish_login(checked, cookie(&headers), now));
    match login {
        Ok(login) => {
            tracing::info!(user = login.who.name, "logged in");
            Ok(begun(&app, &login, peer))
        }
        Err(why) => {
            tracing::warn!(?source, "a log-in was refused");
            Err(why.into())
        }
    }
}

async fn blocking<T: Send + 'static>(this: impl FnOnce() -> T + Send + 'static) -> Result<T, Problem> {
    tokio::task::spawn_blocking(this)
        .await
        .map_err(|_| Problem::internal("a password could not be looked at"))
}

fn begun(app: &App, login: &Login, peer: Option<Extension<Peer>>) -> Response {
    let secure = if peer.is_some_and(|peer| peer.0.encrypted) { "; Secure" } else { "" };
    let told = format!(
        "{COOKIE}={}; Path=/; Max-Age={SESSION_MAX_AGE_S}; HttpOnly; SameSite=Strict{secure}",
        login.token.reveal()
    );
    with_cookie(Json(session(app, Some(&login.who))).into_response(), &told)
}

fn with_cookie(mut response: Response, told: &str) -> Response {
    if let Ok(value) = HeaderValue::from_str(told) {
        response.headers_mut().insert(header::SET_COOKIE, value);
    }
    response
}

/// Log out
#[utoipa::path(delete, path = "/session", responses((status = 204)))]
async fn log_out(State(app): State<Arc<App>>, who: Who) -> Response {
    app.auth.with(|auth, _| auth.log_out(&who.0));
    let told = format!("{COOKIE}=; Path=/; Max-Age=0; HttpOnly; SameSite=Strict");
    with_cookie(StatusCode::NO_CONTENT.into_response(), &told)
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Password {
    password: String,
}

/// Give the password once more, before dangerous actions
#[utoipa::path(post, path = "/session/confirm", request_body = Password,
    responses((status = 204), (status = 401, body = ProblemDetails), (status = 429, body = ProblemDetails)))]
async fn confirm(
    State(app): State<Arc<App>>,
    Whence(source): Whence,
    who: Who,
    Json(Password { password }): Json<Password>,
) -> Result<StatusCode, Problem> {
    let now_ms = app.auth.now_ms();
    let attempt = app.auth.with(|auth, now| auth.begin_confirm(&who.0, source, now, now_ms))?;
    let checked = blocking(move || attempt.check(&password)).await?;
    app.auth.with(|auth, now| auth.finish_confirm(checked, &who.0, now))?;
    Ok(StatusCode::NO_CONTENT)
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct First {
    /// The one-time code from the terminal.
    code: String,
    name: String,
    password: String,
}

/// Make the first user
#[utoipa::path(post, path = "/setup", request_body = First,
    responses((status = 200, body = Session), (status = 400, body = ProblemDetails), (status = 403, body = ProblemDetails)))]
async fn set_up(
    State(app): State<Arc<App>>,
    Whence(source): Whence,
    peer: Option<Extension<Peer>>,
    Json(First { code, name, password }): Json<First>,
) -> Result<Response, Problem> {
    let name = Name::new(&name).map_err(|e| Problem::bad(e.to_string()))?;
    auth::check_password_length(&password).map_err(|e| Problem::bad(e.to_string()))?;
    let pass = app.auth.with(|auth, _| auth.check_setup(&code)).map_err(|why| {
        tracing::warn!(?source, "a set-up was refused: {why}");
        if matches!(why, CodeError::Spent) {
            show_code(&app);
        }
        Problem::new(Kind::Forbidden, why.to_string())
    })?;
    let hash =
        blocking(move || PasswordHash::of(&password)).await?.map_err(|e| Problem::bad(e.to_string()))?;
    let made = app.auth.change(|auth, now| auth.finish_setup(pass, name, hash, now)).await;
    let login = made.inspect_err(|_| {
        // The code is spent, and nobody came of it.
        show_code(&app);
    })?;
    tracing::info!(user = login.who.name, role = Role::Admin.word(), "the first user was made");
    Ok(begun(&app, &login, peer))
}

impl From<SetupError> for Problem {
    fn from(why: SetupError) -> Self {
        match why {
            SetupError::NoRandom(why) => Problem::internal(why.to_string()),
            why => Problem::conflict(why.to_string()),
        }
    }
}

/// Shows a new one-time code where the daemon's owner reads.
pub(crate) fn show_code(app: &App) {
    match app.auth.with(|auth, _| auth.open_setup()) {
        Ok(Some(code)) => tracing::warn!("no user yet: the code for the first one is {}", code.reveal()),
        Ok(None) => {}
        Err(why) => tracing::error!("no code for the first user: {why}"),
    }
}
