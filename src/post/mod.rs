//! Post-processing.
pub mod annotate;
pub mod layer;
pub mod measure;
mod rewrite;
mod settings;
pub mod time;
