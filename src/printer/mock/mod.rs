//! A mock printer: a strict Marlin 2.1.2.1 on a pseudo-terminal.
//!
//! # Layout
//! Bytes come in through [`uart`] (speed of the line, receive buffer), past
//! `emergency`, into `line` (cutting, numbers, checksums); `words` takes a
//! command apart, `execute` does it with `motion`, `planner` and `heater`,
//! `report` has the words of the replies. `firmware` is the board that ties
//! them together on a clock from outside; `faults` are what goes wrong,
//! `stats` what is counted. Only `pty` does I/O.
//!
//! Invariant: nothing here uses the sender's code: no checksum, no reply
//! parser, no G-code crate. What both sides get wrong together, no test sees.
mod emergency;
mod execute;
pub mod faults;
mod firmware;
mod heater;
mod line;
mod motion;
mod planner;
mod pty;
mod report;
pub mod stats;
mod uart;
mod words;

#[cfg(test)]
mod tests;

pub use faults::Faults;
pub use firmware::{Config, Firmware, Machine};
pub use planner::{Cornering, Dynamics};
pub use pty::{Handle, MockError, Options, spawn};
pub use stats::Stats;

impl Default for Machine {
    /// A bed slinger of the common kind: 250 by 210 by 210 mm, 1.75 mm filament.
    fn default() -> Self {
        Self {
            name: "Outrigger mock".to_owned(),
            dynamics: Dynamics {
                max_feed_mm_s: [200.0, 200.0, 12.0, 120.0],
                max_accel_mm_s2: [1000.0, 1000.0, 200.0, 5000.0],
                print_mm_s2: 1250.0,
                travel_mm_s2: 1250.0,
                retract_mm_s2: 1250.0,
                cornering: Cornering::JerkMmS(8.0),
            },
            nozzle_max_c: 290.0,
            bed_max_c: 120.0,
        }
    }
}

impl Default for Config {
    /// Marlin's own choices, at 250,000 baud.
    fn default() -> Self {
        Self {
            baud: 250_000,
            rx_bytes: 128,
            speed: 1.0,
            advanced_ok: false,
            emergency_parser: true,
            dtr_reset: false,
            machine: Machine::default(),
        }
    }
}
