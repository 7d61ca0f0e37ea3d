//! Supports into what will be printed: a mesh, sliced G-code, the images of a resin job.
//!
//! Takes a job and supports that can be cut at any height; gives the job with the
//! supports in it, or without those that a slicer put there. Knows no file system, and not
//! how supports were planned.
//!
//! # Layout
//! - [`into_mesh`]: a forest as closed bodies; [`together`]: these and a part as one stack
//! - [`into_gcode`]: as beads, layer by layer; [`out_of_gcode`]: the slicer's own taken out;
//!   [`gcode`]: what both know of a job
//! - [`into_images`]: drawn into pictures; [`out_of_images`]: pixels taken out of them
pub mod gcode;
pub mod into_gcode;
pub mod into_images;
pub mod into_mesh;
pub mod out_of_gcode;
pub mod out_of_images;
#[cfg(test)]
mod testing;
pub mod together;
