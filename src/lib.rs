//! Outrigger: the rooms behind the `outrigger` binary. ARCHITECTURE.md is the map.
pub mod cli;
pub mod printer;
pub mod profile;
pub mod units;
