//! The order of beads: which bead next, and from which end.
//!
//! Takes beads as two ends each and a rule that says which jumps need a lift;
//! gives an order. Takes a region and gives the beads that fill it. Knows no G-code
//! text and no file.
//!
//! # Layout
//! - [`bead`]: what is ordered, and what an order costs
//! - [`nearest`]: nearest neighbour from a position
//! - [`breakpoints`]: nearest neighbour restarted where it broke (paper 002)
//! - [`walls`]: which jumps cross a perimeter
//! - [`cover`]: which spots of a layer are printed on
//! - [`fill`]: from a region to rings, rasters and spots
pub mod bead;
pub mod breakpoints;
pub mod cover;
pub mod fill;
pub mod nearest;
pub mod walls;
