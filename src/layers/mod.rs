//! A job as a stack of layers: polygons at each height, whatever it came from.
//!
//! Takes a mesh, sliced G-code or the images of a resin job, gives [`stack::Layer`]s
//! from the plate up. Everything that analyses a job sees these and nothing else.
//!
//! # Layout
//! - [`shape`]: points on a grid, polygons with holes, their measures
//! - [`scan`]: parallel lines through rings
//! - [`tidy`]: rings rid of points that say nothing
//! - `tangle`: whether edges cross so often that a boolean would not end
//! - [`outline`]: what a round nozzle sweeps
//! - [`polygon`]: booleans, predicates and offsets; alone names the polygon libraries
//! - [`nest`]: rings that do not meet become polygons without a boolean
//! - [`raster`]: a resin job's picture as runs of brightness, for what is checked pixel by pixel
//! - [`stack`]: a layer, and where layers come from
//! - [`from_mesh`], [`from_gcode`], [`from_images`]: the three places
pub mod from_gcode;
pub mod from_images;
pub mod from_mesh;
pub mod nest;
pub mod outline;
pub mod polygon;
pub mod raster;
pub mod scan;
pub mod shape;
pub mod stack;
mod tangle;
mod tidy;
