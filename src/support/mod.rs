//! What holds the part: supports.
pub mod section;
