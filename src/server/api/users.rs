//! `/users`: who may come in.
use crate::server::app::App;
use crate::server::asker::Admin;
use crate::server::auth::{Name, PasswordHash, Role, UsersError};
use crate::server::problem::{Problem, ProblemDetails};
use axum::Json;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

pub(super) fn routes() -> OpenApiRouter<Arc<App>> {
    OpenApiRouter::new().routes(routes!(list, add)).routes(routes!(remove)).routes(routes!(password))
}

/// A user.
#[derive(Debug, Serialize, ToSchema)]
struct User {
    name: String,
    /// `viewer`, `operator` or `admin`.
    role: &'static str,
}

impl From<UsersError> for Problem {
    fn from(why: UsersError) -> Self {
        match why {
            UsersError::Unknown => Problem::no_such("user"),
            why => Problem::conflict(why.to_string()),
        }
    }
}

fn name(text: &str) -> Result<Name, Problem> {
    Name::new(text).map_err(|e| Problem::bad(e.to_string()))
}

async fn hash(password: String) -> Result<PasswordHash, Problem> {
    let hashed = tokio::task::spawn_blocking(move || PasswordHash::of(&password)).await;
    hashed
        .map_err(|_| Problem::internal("a password could not be kept"))?
        .map_err(|e| Problem::bad(e.to_string()))
}

/// All users
#[utoipa::path(get, path = "/users", responses((status = 200, body = [User])))]
async fn list(_: Admin, State(app): State<Arc<App>>) -> Json<Vec<User>> {
    let user =
        |user: &crate::server::auth::User| User { name: user.name.to_string(), role: user.role.word() };
    Json(app.auth.with(|auth, _| auth.users().map(user).collect()))
}

/// A new user.
#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct New {
    name: String,
    password: String,
    /// `viewer`, `operator` or `admin`.
    #[schema(value_type = String)]
    role: Role,
}

/// Add a user
#[utoipa::path(post, path = "/users", request_body = New,
    responses((status = 201, body = User), (status = 400, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn add(
    Admin(who): Admin,
    State(app): State<Arc<App>>,
    Json(new): Json<New>,
) -> Result<(StatusCode, Json<User>), Problem> {
    who.confirmed()?;
    let (name, role) = (name(&new.name)?, new.role);
    let hash = hash(new.password).await?;
    let told = User { name: name.to_string(), role: role.word() };
    app.auth.change(|auth, now| auth.add_user(name, role, hash, now)).await?;
    tracing::info!(user = told.name, role = told.role, by = who.name(), "user added");
    Ok((StatusCode::CREATED, Json(told)))
}

/// Remove a user
#[utoipa::path(delete, path = "/users/{name}", params(("name" = String, Path)),
    responses((status = 204), (status = 404, body = ProblemDetails), (status = 409, body = ProblemDetails)))]
async fn remove(
    Admin(who): Admin,
    State(app): State<Arc<App>>,
    Path(user): Path<String>,
) -> Result<StatusCode, Problem> {
    who.confirmed()?;
    let name = name(&user)?;
    app.auth.change(|auth, _| auth.remove_user(&name)).await?;
    tracing::info!(user, by = who.name(), "user removed");
    Ok(StatusCode::NO_CONTENT)
}

#[derive(Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
struct Password {
    password: String,
}

/// Give a user another password
#[utoipa::path(put, path = "/users/{name}/password", params(("name" = String, Path)), request_body = Password,
    responses((status = 204), (status = 400, body = ProblemDetails), (status = 404, body = ProblemDetails)))]
async fn password(
    Admin(who): Admin,
    State(app): State<Arc<App>>,
    Path(user): Path<String>,
    Json(Password { password }): Json<Password>,
) -> Result<StatusCode, Problem> {
    who.confirmed()?;
    let name = name(&user)?;
    let hash = hash(password).await?;
    app.auth.change(|auth, _| auth.set_password(&name, hash)).await?;
    tracing::info!(user, by = who.name(), "password changed");
    Ok(StatusCode::NO_CONTENT)
}
