//! What the benches share: a long job made of a short one, ratios to a peer, and how they run.
//!
//! Also used, by path, by the root package's benches and examples.
#![allow(dead_code)] // each target uses its own part

pub(crate) mod long_job;
pub(crate) mod ratio;
pub(crate) mod run;
