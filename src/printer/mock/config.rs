//! What a mock is like: the board's options and the machine around it.
use super::planner::{Cornering, Dynamics};

/// What a mock is like.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Bits per second; 0 is a line without a speed limit.
    pub baud: u32,
    /// RX_BUFFER_SIZE, bytes (Marlin's own choice is 128).
    pub rx_bytes: usize,
    /// How many times faster than life moves, heaters and pauses are.
    pub speed: f64,
    /// ADVANCED_OK: `ok N1 P15 B3`.
    pub advanced_ok: bool,
    /// How long a reply is on its way to the host after its last bit: what a USB adapter
    /// holds it back, ns.
    pub latency_ns: u64,
    /// EMERGENCY_PARSER: M108, M112, M410 and M876 are seen on arrival.
    pub emergency_parser: bool,
    /// Whether opening the port resets the board.
    pub dtr_reset: bool,
    /// The machine around the board.
    pub machine: Machine,
}

/// The machine around the board.
#[derive(Clone, Debug, PartialEq)]
pub struct Machine {
    /// MACHINE_TYPE of M115.
    pub name: String,
    /// Speeds and accelerations at power-on.
    pub dynamics: Dynamics,
    /// Highest target of the nozzle, °C: more is cut to it.
    pub nozzle_max_c: f64,
    /// Highest target of the bed, °C.
    pub bed_max_c: f64,
}

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
            latency_ns: 0,
            emergency_parser: true,
            dtr_reset: false,
            machine: Machine::default(),
        }
    }
}
