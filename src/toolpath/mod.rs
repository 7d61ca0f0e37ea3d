//! The order of beads: which bead next, and from which end.
//!
//! Takes beads as two ends each and a rule that says which jumps need a lift;
//! gives an order. Knows no G-code text, no layer and no file.
//!
//! # Layout
//! - [`bead`]: what is ordered, and what an order costs
//! - [`nearest`]: nearest neighbour from a position
//! - [`breakpoints`]: nearest neighbour restarted where it broke (paper 002)
//! - [`walls`]: which jumps cross a perimeter
//! - [`cover`]: which spots of a layer are printed on
pub mod bead;
pub mod breakpoints;
pub mod cover;
pub mod nearest;
pub mod walls;
