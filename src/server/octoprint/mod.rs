//! The API of OctoPrint, as far as slicers and apps speak it: one group of routes a file.
//!
//! Takes what they send; gives it to the foreman or an actor, as our own API does, and answers in
//! OctoPrint's words. `print=true` and `start` queue a job: the check may hold it, and the bed may
//! have to be cleared first. Errors are plain text ([`plain`]). The default printer at the root,
//! each under `/p/ID` ([`asked`]).
//!
//! - [`host`]: version, server, connection, settings, profiles, who is asking
//! - [`printer`]: temperatures, flags, commands; [`job`]; [`files`], with [`form`] for uploads
//! - [`appkeys`]: applications that ask for a key
//!
//! `docs/compat.md` lists the routes, and what is not there.
mod appkeys;
pub(super) mod asked;
pub(super) mod files;
pub(super) mod form;
mod host;
pub(super) mod job;
pub(super) mod plain;
mod printer;

use super::app::App;
use axum::Router;
use std::sync::Arc;

/// The routes, without the printer's prefix.
pub(super) fn routes() -> Router<Arc<App>> {
    Router::new()
        .merge(host::routes())
        .merge(printer::routes())
        .merge(job::routes())
        .merge(files::routes())
        .merge(appkeys::routes())
}
