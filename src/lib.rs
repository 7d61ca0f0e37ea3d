//! Outrigger: the rooms behind the `outrigger` binary. ARCHITECTURE.md is the map.
mod causes;
pub mod cli;
pub mod detect;
pub mod job;
pub mod layers;
pub mod merge;
pub mod mesh;
pub mod post;
pub mod printer;
pub mod profile;
pub mod report;
pub mod resin;
mod server;
mod station;
pub mod support;
pub mod toolpath;
pub mod units;
