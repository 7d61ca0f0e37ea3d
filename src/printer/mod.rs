//! The printer: the mock one.
pub mod mock;
