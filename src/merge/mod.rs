//! Supports into what is printed: a mesh.
//!
//! Takes a forest of [`crate::support`], gives it in the form of the job. Plans nothing.
pub mod into_mesh;
pub mod together;
