//! A mock printer: a strict Marlin 2.1.2.1 on a pseudo-terminal.
//!
//! # Layout
//! Bytes come in through `uart` (speed of the line, receive buffer), past
//! `emergency`, into `line` (cutting, numbers, checksums); `words` takes a
//! command apart; `motion`, `planner` and `heater` are the machine as the
//! firmware has it, `body` the machine as it is (`plate` that of a resin printer, `light` what
//! its light did); `report` has the words of the
//! replies, [`personality`](PERSONALITIES) the firmwares with a name. [`firmware`](Firmware) is the board that ties
//! them together on a clock from outside; [`faults`] are what goes wrong,
//! [`stats`] what is counted. Only `pty` does I/O.
//!
//! Invariant: nothing here uses the sender's code: no checksum, no reply
//! parser, no G-code crate. What both sides get wrong together, no test sees.
mod body;
mod config;
mod emergency;
pub mod faults;
mod firmware;
mod heater;
mod light;
mod line;
mod motion;
mod personality;
mod planner;
mod plate;
mod pty;
mod report;
pub mod stats;
mod uart;
mod words;

#[cfg(test)]
mod tests;

pub use config::{
    Config, EXTRUDERS_MAX, Habits, LightPin, Machine, OkForm, Repeats, ResendForm, ResinMachine,
};
pub use faults::Faults;
pub use firmware::{Executed, Firmware};
pub use light::{Moment, Pulse};
pub use personality::{PERSONALITIES, Personality, help as personalities_help};
pub use planner::{Cornering, Dynamics};
pub use pty::{Handle, MockError, Options, spawn};
pub use stats::Stats;
