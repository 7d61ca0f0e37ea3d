//! The printer's side of the house: a job's lines go to a Marlin-family firmware
//! over a serial port, none lost, none doubled, none out of order.
//!
//! # Layout
//! - [`job_file`]: a file, checked, as a source of commands.
//! - [`preflight`]: what of a job the printer could not do.
//! - [`window`]: numbered lines, what is in flight, what can be sent again.
//! - [`lines`]: bytes from the wire into lines.
//! - [`reply`], [`temperature`], [`action`]: what a line of the printer means.
//! - [`source`]: where a job's lines come from; [`exposure`]: those of a resin job, and what they
//!   wait for.
//! - [`session`]: the state machine over these; no I/O, no clock.
//! - [`port`]: the serial port.
//! - [`find`]: which port, at which speed, and the same one again.
//! - [`mock`]: the other side: a strict Marlin on a pseudo-terminal.
//! - [`lcd`]: the display of a resin printer, which masks the light.
//!
//! Invariant: on the sender's side nothing but [`port`], [`find`] and the displays in [`lcd`]
//! does I/O or asks the time; it shares no code with [`mock`].
//!
//! Knows the G-code crate's framing. Settings come as plain values: this room
//! knows no profile, no command line and no terminal.
pub mod action;
pub mod exposure;
pub mod find;
pub mod job_file;
pub mod lcd;
pub mod lines;
pub mod mock;
pub mod port;
pub mod preflight;
pub mod reply;
pub mod session;
pub mod source;
pub mod temperature;
pub mod window;
