//! A job's life: what it may do next, what is written down of it, how it is taken up
//! again.
//!
//! # Layout
//! - [`state`]: one enum, one transition function.
//! - [`record`]: what is written down, and the picture of a job that records add up to.
//! - [`journal`]: records on a medium, through [`storage`].
//! - [`disk`]: that medium as files; one folder holds all jobs.
//! - [`digest`]: a job file that must not change, chunk by chunk.
//! - [`tracker`]: the machine's state that the lines sent so far add up to.
//! - [`host`]: one job on one printer: session, state, records and tracker together; no I/O, no clock.
//! - [`run`]: a host, a port, a clock and a user together; [`scribe`]: the journal's thread.
//! - [`recover`]: where a job that was broken off stands, and the way back into it.
//!
//! Invariant: [`state`], [`record`], [`tracker`], [`host`] and [`recover`] are pure;
//! [`journal`] reaches a medium through [`storage`] alone. Only [`run`] and [`scribe`] know threads and
//! a clock.
pub mod digest;
pub mod disk;
pub mod host;
pub mod journal;
pub mod record;
pub mod recover;
#[cfg(test)]
mod reference;
pub mod run;
pub mod scribe;
pub mod state;
pub mod storage;
pub mod tracker;
