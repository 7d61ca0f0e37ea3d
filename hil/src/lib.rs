//! The rig: scenarios as data, run on a virtual clock against the mock printer, over
//! pseudo-terminals against the real binary, and on a real printer's port.
//!
//! # Layout
//! - [`scenario`]: what a file under `tests/scenarios` says: a job, a firmware, what goes wrong, what must hold.
//! - [`world`]: host, journal, disk, wire and board on one virtual clock.
//! - [`judge`]: what must hold at the end, from what the board did.
//! - [`play`]: a scenario in that world.
//! - [`resin`]: jobs of resin for that world, and the host and the board for them.
//! - [`rig`]: a scenario through the real program, over pseudo-terminals or on a real port.
//! - [`simulate`]: thousands of random jobs with random trouble in that world, a seed each.
//! - [`dice`]: the random numbers of both.
pub mod dice;
pub mod judge;
pub mod play;
pub mod resin;
pub mod rig;
pub mod scenario;
pub mod simulate;
pub mod world;
