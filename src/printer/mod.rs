//! The printer's side of the house: a job's lines go to a Marlin-family firmware
//! over a serial port, none lost, none doubled, none out of order.
//!
//! # Layout
//! - [`lines`]: bytes from the wire into lines.
//! - [`reply`], [`temperature`]: what a line of the printer means.
//!
//! Knows the G-code crate's framing. Settings come as plain values: this room
//! knows no profile, no command line and no terminal.
pub mod lines;
pub mod reply;
pub mod session;
pub mod temperature;
pub mod window;
