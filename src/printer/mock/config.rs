//! What a mock is like: the board's options, how its firmware talks, and the
//! machine around it.
use super::planner::{BLOCKS, Cornering, Dynamics};

/// What a mock is like.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// Bits per second; 0 is a line without a speed limit.
    pub baud: u32,
    /// RX_BUFFER_SIZE, bytes (Marlin's own choice is 128).
    pub rx_bytes: usize,
    /// BUFSIZE: commands in the queue, the one being executed included.
    pub queue: usize,
    /// BLOCK_BUFFER_SIZE: a ring of so many moves that holds one less.
    pub blocks: usize,
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
    /// With `dtr_reset`: as on a real port the board is reset when DTR rises. It does
    /// when the port is opened for the first time, or was last closed with HUPCL set.
    pub keeps_dtr: bool,
    /// How the firmware talks.
    pub habits: Habits,
    /// The machine around the board.
    pub machine: Machine,
    /// Keep a record of every command that was executed, for [`super::Firmware::take_executed`].
    pub record: bool,
}

/// How a firmware talks, as far as families and versions differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Habits {
    /// Name and version, as M115 and the words at the start have it.
    pub version: &'static str,
    /// What the `ok` of a numbered line looks like.
    pub ok: OkForm,
    /// The `ok` comes when the line is queued, not when it was executed.
    pub ok_when_queued: bool,
    /// How a resend is asked for.
    pub resend: ResendForm,
    /// An `ok` follows the request.
    pub resend_ok: bool,
    /// What becomes of a line that comes again.
    pub repeats: Repeats,
    /// Line numbers and checksums are looked at. Klipper's host side does not.
    pub checks_lines: bool,
    /// Between two `wait` of an idle board, s; 0 for never.
    pub wait_s: f64,
    /// M155 is known.
    pub auto_report: bool,
    /// `echo:busy: …` while a command lasts (HOST_KEEPALIVE_FEATURE).
    pub busy_notes: bool,
    /// M115 lists `Cap:` lines.
    pub capabilities: bool,
    /// M0 and M600 ask with `//action:prompt_…` (HOST_PROMPT_SUPPORT).
    pub prompts: bool,
    /// G92.9 sets the position (POWER_LOSS_RECOVERY); else it is ignored without a word.
    pub native_position: bool,
    /// G28 knows `R`: the raise before homing.
    pub homing_raise: bool,
    /// G92 and G28 say where the machine is.
    pub tells_position: bool,
}

/// What the `ok` of a numbered line looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OkForm {
    /// `ok`, or with [`Config::advanced_ok`] `ok N12 P15 B3`.
    Plain,
    /// `ok 12`
    Number,
}

/// How a resend is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ResendForm {
    /// `Resend: 12`
    Marlin,
    /// `Resend:12`
    Tight,
    /// `Resend: N:12`
    WithN,
    /// `rs 12`
    Short,
}

/// What becomes of a line that comes again (one of the last two).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repeats {
    /// Dropped without a word: Marlin since 2.0.
    Dropped,
    /// Refused like any other wrong number: Marlin before.
    Refused,
    /// `skip 12` and `ok`: Repetier.
    Skipped,
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
    /// Nozzles with a heater each: 1 to 8.
    pub extruders: usize,
    /// Whether there is a heated chamber.
    pub chamber: bool,
    /// Whether bed levelling (M420) is there; its mesh outlives a reset.
    pub levelling: bool,
    /// Z_CLEARANCE_FOR_HOMING: Z is raised so far before anything is homed, mm.
    pub homing_raise_mm: f64,
    /// GCODE_MACROS: M810 to M819 keep commands and run them.
    pub macros: bool,
    /// It cures resin: a plate that goes up and down and a light, and no X, Y or E.
    pub resin: Option<ResinMachine>,
}

/// A resin printer that cures from below. Its pictures are the host's matter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ResinMachine {
    /// G28 drives the plate up to a switch at the top, where Z is `z_max_mm`; else down to 0.
    pub homes_up: bool,
    /// How far up the plate goes, mm; soft endstops cut moves to 0 and this.
    pub z_max_mm: f64,
    /// What the light hangs on.
    pub light: LightPin,
}

/// What the UV light hangs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightPin {
    /// The part cooling fan: M106 and M107. A board that was killed leaves it as it is.
    Fan,
    /// Spindle or laser: M3, M4 and M5, which wait for the moves. A kill switches it off.
    Cutter,
}

impl Machine {
    /// A resin printer with macros. Its heaters are of no use: any target becomes 0.
    pub fn resin(resin: ResinMachine) -> Self {
        Self {
            nozzle_max_c: 0.0,
            bed_max_c: 0.0,
            homing_raise_mm: 0.0,
            macros: true,
            resin: Some(resin),
            ..Self::default()
        }
    }
}

/// Most extruders that Marlin has.
pub const EXTRUDERS_MAX: usize = 8;

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
            extruders: 1,
            chamber: false,
            levelling: false,
            homing_raise_mm: 5.0,
            macros: false,
            resin: None,
        }
    }
}

impl Default for Habits {
    /// Marlin 2.1.2.1, as shipped with host prompts on.
    fn default() -> Self {
        Self {
            version: "Marlin 2.1.2.1",
            ok: OkForm::Plain,
            ok_when_queued: false,
            resend: ResendForm::Marlin,
            resend_ok: true,
            repeats: Repeats::Dropped,
            checks_lines: true,
            wait_s: 0.0,
            auto_report: true,
            busy_notes: true,
            capabilities: true,
            prompts: true,
            native_position: true,
            homing_raise: true,
            tells_position: true,
        }
    }
}

impl Default for Config {
    /// Marlin's own choices, at 250,000 baud.
    fn default() -> Self {
        Self {
            baud: 250_000,
            rx_bytes: 128,
            queue: 4,
            blocks: BLOCKS,
            speed: 1.0,
            advanced_ok: false,
            latency_ns: 0,
            emergency_parser: true,
            dtr_reset: false,
            keeps_dtr: false,
            habits: Habits::default(),
            machine: Machine::default(),
            record: false,
        }
    }
}
