//! Pictures for people: what a job looks like, before and after.
//!
//! Takes typed layers, gives text (SVG). Knows no file system and no clock, and
//! nothing of printers: where a picture goes is the caller's business.
//!
//! # Layout
//! - [`strokes`]: a layer as beads and jumps, in the order of the print
//! - [`gain`]: the layer of a job that post-processing improved most
//! - [`paths`]: the picture of a layer's paths, before and after
//! - `panel`, `frame`, `legend`: its parts
//! - `svg`: numbers, text and colours as SVG has them
mod frame;
pub mod gain;
mod legend;
mod panel;
pub mod paths;
pub mod strokes;
mod svg;
