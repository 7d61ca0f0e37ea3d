//! Outrigger: the rooms behind the `outrigger` binary. ARCHITECTURE.md is the map.
pub mod cli;
pub mod profile;
pub mod units;
