//! What would print in the air.
//!
//! Takes [`crate::layers::stack::Layer`]s from the plate up, gives islands and
//! overhangs. One detector a file. Knows no file system, no clock and no picture.
//!
//! # Layout
//! - [`walk`]: one walk over the layers that runs what was asked for
//! - [`overlap`]: whether two polygons share area, exactly
//! - [`links`]: which polygons a layer's polygons stand on
//! - [`island`]: pieces of a layer that nothing below holds (paper 003)
//! - [`overhang`]: what the overhang detectors give; `regions` joins it from layer to layer
//! - [`overhang_normal`]: faces that lean too far (paper 001, section 2.1)
//! - [`overhang_layer`]: a layer without what the layer below holds, in polygons
//! - [`overhang_image`]: the same in images, as the peers do it (paper 001, section 1)
//! - [`resin`]: what would go wrong with a resin job, in its own pictures
pub mod island;
pub mod links;
pub mod overhang;
pub mod overhang_image;
pub mod overhang_layer;
pub mod overhang_normal;
pub mod overlap;
mod regions;
pub mod resin;
mod slabs;
#[cfg(test)]
mod testing;
pub mod walk;
