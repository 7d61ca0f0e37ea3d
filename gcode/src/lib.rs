//! The G-code language, and nothing of the printer.
//!
//! # Layout
//! - [`line`]: one line, parsed without loss; [`number`]: its decimals
//! - [`checksum`]: from a line of a job to its frame on the wire
//! - [`state`]: what the lines do to a machine (modes, position, filament)
//! - [`bgcode`]: binary G-code, the container that text may come in
//! - [`dialect`]: what slicers' comments say (layer, feature, width, object, wipe)
//!
//! Data flows in that order. This crate knows no file system, no clock and no
//! serial port.
pub mod bgcode;
pub mod checksum;
pub mod dialect;
pub mod line;
pub mod number;
pub mod state;
