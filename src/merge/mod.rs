//! Supports into what will be printed.
//!
//! Takes a job and supports that can be cut at any height; gives the job with the
//! supports in it. Knows no file system, and not how supports were planned.
pub mod into_gcode;
