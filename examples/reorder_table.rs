//! Post-processes every job in a folder and prints a table of what changed.
fn main() {}
