//! Pictures for people: what a job looks like, before and after.
//!
//! Takes typed layers and what was found in them, gives text and bytes (SVG, PNG,
//! HTML, JSON). Knows no file system and no clock, and nothing of printers: where
//! a picture goes is the caller's business.
//!
//! # Layout
//! - [`strokes`]: a layer as beads and jumps, in the order of the print
//! - [`gain`]: the layer of a job that post-processing improved most
//! - [`paths`]: the picture of a layer's paths, before and after
//! - `panel`, `frame`, `legend`: its parts
//! - `svg`: numbers, text and colours as SVG has them
//! - [`check`]: what a check found, as JSON
//! - [`survey`]: a checked job as pictures and as a page
//! - [`support`]: what supports amount to, as JSON and as a table
//! - [`turn`]: a part with its supports as a page that turns it
//! - `canvas`: one drawing as SVG or PNG; `embed`: data in a page
mod canvas;
pub mod check;
mod embed;
mod frame;
pub mod gain;
mod legend;
mod panel;
pub mod paths;
pub mod strokes;
pub mod support;
pub mod survey;
mod svg;
pub mod turn;
