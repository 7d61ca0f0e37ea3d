//! The G-code language, and nothing of the printer.
//!
//! # Layout
//! Each module says what it is, what it takes and what it gives; this crate
//! knows no file system, no clock and no serial port.
pub mod checksum;
