//! Our own API, `/api/v2`: one group of routes a file, each described where it stands.
//!
//! `docs/api.md` tells the same to people; the OpenAPI document is made from the routes themselves,
//! so that neither can lack what the other has. Handlers hold no rules: they take what was asked,
//! give it to the foreman or an actor, and tell what came of it.
pub(crate) mod files;
mod jobs;
mod keys;
pub(crate) mod live;
pub(crate) mod printers;
mod session;
mod users;

pub(crate) use live::tick;
pub(crate) use session::show_code;

use super::app::App;
use super::problem::Kind;
use axum::routing::get;
use axum::{Json, Router};
use std::sync::Arc;
use utoipa::OpenApi;
use utoipa_axum::router::OpenApiRouter;

/// Where it lies.
pub(crate) const ROOT: &str = "/api/v2";

#[derive(OpenApi)]
#[openapi(info(title = "Outrigger", description = "The daemon beside a 3D printer"))]
struct Described;

/// The routes, with their description.
fn described() -> OpenApiRouter<Arc<App>> {
    let routes = OpenApiRouter::new()
        .merge(session::routes())
        .merge(printers::routes())
        .merge(files::routes())
        .merge(jobs::routes())
        .merge(users::routes())
        .merge(keys::routes())
        .merge(live::routes());
    OpenApiRouter::with_openapi(Described::openapi()).nest(ROOT, routes)
}

/// The description alone.
pub(crate) fn description() -> utoipa::openapi::OpenApi {
    let mut told = described().split_for_parts().1;
    let kinds = Kind::words().join(", ");
    told.info.description = Some(format!(
        "The daemon beside a 3D printer. Errors are RFC 9457's problem details; the last word of their type is one of: {kinds}."
    ));
    told
}

/// The routes.
pub(crate) fn routes() -> Router<Arc<App>> {
    let (routes, _) = described().split_for_parts();
    routes.route(&format!("{ROOT}/openapi.json"), get(|| async { Json(description()) }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_route_of_the_documentation_is_described_and_the_other_way_round() {
        let told = serde_json::to_value(description()).unwrap();
        let mut described: Vec<String> = Vec::new();
        for (path, methods) in told["paths"].as_object().unwrap() {
            for method in methods.as_object().unwrap().keys() {
                let path = path.strip_prefix(ROOT).unwrap();
                described.push(format!("{} {path}", method.to_uppercase()));
            }
        }
        let text = include_str!("../../../docs/api.md");
        let rows = text.split("## Routes").nth(1).unwrap().split("## Events").next().unwrap();
        let mut written: Vec<String> = Vec::new();
        for row in rows.lines().filter(|row| row.starts_with("| ")) {
            let cell = row.split('|').nth(1).unwrap();
            let mut method = "";
            for (at, part) in cell.split('`').enumerate() {
                if at % 2 == 0 {
                    method = part
                        .split([',', ' '])
                        .rfind(|word| word.chars().all(|c| c.is_ascii_uppercase()) && word.len() > 2)
                        .unwrap_or(method);
                } else if part.starts_with('/') {
                    let path = part.split('?').next().unwrap();
                    written.push(format!("{method} {path}"));
                }
            }
        }
        described.sort();
        written.retain(|route| !route.ends_with("/openapi.json"));
        written.sort();
        written.dedup();
        assert_eq!(described, written);
    }
}
