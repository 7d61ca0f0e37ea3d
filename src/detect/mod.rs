//! What would print in the air.
//!
//! Takes [`crate::layers::stack::Layer`]s from the plate up, gives islands and
//! overhangs. One detector a file. Knows no file system, no clock and no picture.
//!
//! # Layout
//! - [`island`]: pieces of a layer that nothing below holds (paper 003)
pub mod island;
