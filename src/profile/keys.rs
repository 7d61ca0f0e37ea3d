//! The keys of a profile: the one place that documents and bounds them.
//!
//! `profile check` walks a file along these tables, `profile show` prints
//! their words above each value, and a test holds them to the structs that
//! serde fills. Knows no file system.

/// One key: where it stands, what it takes, what it means.
#[derive(Clone, Copy, Debug)]
pub struct Key {
    /// Dotted path from the root of the file: `serial.baud`.
    pub path: &'static str,
    /// What it takes.
    pub takes: Takes,
    /// Whether a file without it is refused.
    pub required: bool,
    /// What it means, with its unit, for people.
    pub doc: &'static str,
}

/// What a key takes.
#[derive(Clone, Copy, Debug)]
pub enum Takes {
    /// One line of text of at most [`TEXT_BYTES_MAX`].
    Text,
    /// One line of text of at most this many bytes: a path, an address.
    Line(usize),
    /// A list of at most this many such lines, each of at most [`TEXT_BYTES_MAX`].
    Texts(usize),
    /// A list of at most this many tables (`[[printer]]`), each with keys of its own.
    Tables(usize),
    /// One of these words.
    OneOf(&'static [&'static str]),
    /// A number from the first to the second, both included.
    Number(f64, f64),
    /// A whole number from the first to the second, both included.
    Whole(i64, i64),
    /// `true` or `false`.
    Flag,
    /// A table with keys of its own.
    Table,
    /// A table with exactly one of its keys.
    Choice,
    /// G-code, or `{ file = "NAME" }`.
    Macro,
}

/// Longest name or title, in bytes: it has to fit a line of a list.
pub const TEXT_BYTES_MAX: usize = 80;

const fn key(path: &'static str, takes: Takes, doc: &'static str) -> Key {
    Key { path, takes, required: true, doc }
}

const fn optional(path: &'static str, takes: Takes, doc: &'static str) -> Key {
    Key { path, takes, required: false, doc }
}

use Takes::{Choice, Flag, Macro, Number, OneOf, Table, Tables, Text, Whole};

mod msla;

pub use msla::MSLA;

/// The keys that every printer's profile has.
pub const PRINTER: &[Key] = &[
    key("name", Text, "Short name, as on the command line"),
    key("title", Text, "The maker's name for it"),
    key(
        "kind",
        OneOf(&["fdm", "msla"]),
        "How it prints: fdm melts filament, msla cures resin with the light behind an LCD",
    ),
    key(
        "firmware",
        OneOf(&["marlin", "prusa", "klipper", "repetier", "reprapfirmware"]),
        "Family of firmware at the other end of the cable",
    ),
    optional(
        "orphan_timeout_s",
        Whole(1, 86_400),
        "How long after the host's death another may take the job up before heaters or light are switched off, s (left out: 300)",
    ),
    key("bed", Table, "The volume that can be printed"),
    key(
        "bed.shape",
        OneOf(&["rectangle", "circle"]),
        "Outline of the bed; a circle is a delta, whose homing goes up (msla: a rectangle, the LCD's)",
    ),
    key(
        "bed.origin",
        OneOf(&["corner", "centre"]),
        "Where X 0, Y 0 lies: the front left corner or the middle",
    ),
    key("bed.x_mm", Number(10.0, 5000.0), "Width (of a circle the diameter; of an LCD along its rows), mm"),
    key("bed.y_mm", Number(10.0, 5000.0), "Depth (of a circle the diameter; of an LCD across its rows), mm"),
    key("bed.z_mm", Number(10.0, 5000.0), "Height (msla: the plate's travel), mm"),
    key("serial", Table, "How the host talks to it"),
    key("serial.baud", Whole(1200, 4_000_000), "Speed of the line, bits per second (native USB takes any)"),
    key("serial.window", Choice, "How much may be on its way unacknowledged: bytes or lines"),
    optional(
        "serial.window.bytes",
        Whole(16, 65_536),
        "Bytes on their way at most: below the firmware's receive buffer",
    ),
    optional(
        "serial.window.lines",
        Whole(1, 64),
        "Lines on their way at most: 1 where the receive buffer is unknown",
    ),
    optional(
        "serial.max_line",
        Whole(32, 4096),
        "Longest framed line that the firmware takes whole, bytes without the line end (left out: no limit)",
    ),
    key("serial.dtr_reset", Flag, "Whether opening the port (DTR) resets the board"),
    optional(
        "serial.hard_stop",
        OneOf(&["dtr", "none"]),
        "What stops a board that does not hear M112: dtr resets it (left out: dtr where dtr_reset is true)",
    ),
    key("macros", Table, "Commands that the host sends around a job, on top of the file's own"),
    optional(
        "macros.start",
        Macro,
        "Before the file's first line (`M85 S3600` here makes Marlin itself give up after an hour without a command, as from a host that died)",
    ),
    optional("macros.end", Macro, "After the file's last line"),
    optional(
        "macros.pause",
        Macro,
        "After the last line before a pause; on resume the host itself goes back to where it was",
    ),
    key(
        "macros.cancel",
        Macro,
        "When a job is given up: heaters and fan off (msla: first the light), Z raised relatively before anything else moves",
    ),
];

/// The keys that the profile of a printer of filament has besides.
pub const FDM: &[Key] = &[
    key("nozzle_mm", Number(0.05, 3.0), "Bore of the stock nozzle, mm"),
    key("filament_mm", Number(1.0, 4.0), "Diameter of the filament, mm"),
    key("limits", Table, "Temperatures that must not be passed"),
    key("limits.nozzle_c", Number(100.0, 600.0), "Hottest nozzle of the stock hot end, °C"),
    key("limits.bed_c", Number(0.0, 250.0), "Hottest bed (0: no heater), °C"),
    key("motion", Table, "Speeds and accelerations, for time estimates and the mock printer"),
    key("motion.print_mm_s2", Number(1.0, 1e5), "Acceleration of printing moves (M204 P), mm/s²"),
    key("motion.travel_mm_s2", Number(1.0, 1e5), "Acceleration of travel moves (M204 T), mm/s²"),
    key("motion.retract_mm_s2", Number(1.0, 1e5), "Acceleration of retractions (M204 R), mm/s²"),
    key("motion.cornering", Choice, "The firmware's rule for the speed through a corner: one of three"),
    optional(
        "motion.cornering.jerk_mm_s",
        Number(0.01, 100.0),
        "Classic jerk of X and Y (M205 X Y): step in speed taken at once, mm/s",
    ),
    optional("motion.cornering.junction_mm", Number(0.001, 0.3), "Junction deviation (M205 J), mm"),
    optional(
        "motion.cornering.square_corner_mm_s",
        Number(0.01, 100.0),
        "Klipper's square_corner_velocity: speed through a corner of 90°, mm/s",
    ),
    key("motion.max_feed_mm_s", Table, "Fastest speed of each axis (M203), mm/s"),
    key("motion.max_feed_mm_s.x", Number(0.1, 2000.0), "X, mm/s"),
    key("motion.max_feed_mm_s.y", Number(0.1, 2000.0), "Y, mm/s"),
    key("motion.max_feed_mm_s.z", Number(0.1, 2000.0), "Z, mm/s"),
    key("motion.max_feed_mm_s.e", Number(0.1, 2000.0), "Extruder, mm/s of filament"),
    key("motion.max_accel_mm_s2", Table, "Highest acceleration of each axis (M201), mm/s²"),
    key("motion.max_accel_mm_s2.x", Number(1.0, 1e5), "X, mm/s²"),
    key("motion.max_accel_mm_s2.y", Number(1.0, 1e5), "Y, mm/s²"),
    key("motion.max_accel_mm_s2.z", Number(1.0, 1e5), "Z, mm/s²"),
    key("motion.max_accel_mm_s2.e", Number(1.0, 1e5), "Extruder, mm/s²"),
    optional(
        "resume",
        Table,
        "The way back into a job after a reset or a power cut (left out: such a job is not resumed)",
    ),
    key(
        "resume.homes_xy_alone",
        Flag,
        "Whether X and Y can be homed without Z (not on a delta, polar or SCARA machine)",
    ),
    key(
        "resume.homing_clears_part",
        Flag,
        "Whether homing X and Y cannot touch a part on the bed once Z was raised",
    ),
    optional(
        "resume.raise_mm",
        Number(1.0, 100.0),
        "How far Z is raised before X or Y moves, mm (left out: 10)",
    ),
    optional(
        "resume.soften_c",
        Number(50.0, 300.0),
        "At which a nozzle comes off the part that it stands on without dripping, °C (left out: 150)",
    ),
    optional(
        "resume.planner_moves",
        Whole(0, 4096),
        "Moves that the firmware plans ahead: BLOCK_BUFFER_SIZE (left out: 16)",
    ),
    optional(
        "resume.queue_commands",
        Whole(0, 4096),
        "Commands that it queues besides: BUFSIZE (left out: 4)",
    ),
    optional(
        "resume.z_set",
        Macro,
        "Tells the firmware the height {z}, in mm, without a move; G92.9 Z{z} where it knows that (left out: G92 Z{z})",
    ),
    optional("resume.home", Macro, "Homes X and Y, and nothing moves in Z (left out: G28 R0 X Y)"),
    optional(
        "resume.levelling",
        Macro,
        "Turns on the bed levelling that the firmware kept: M420 S1 (left out: nothing)",
    ),
    optional(
        "resume.prime",
        Macro,
        "Presses filament out where there is no part; never lower than the raised height (left out: nothing)",
    ),
];

/// The keys of a printer of filament, in the order in which `show` prints them.
#[must_use]
pub fn fdm() -> Vec<Key> {
    values_first([PRINTER, FDM].concat())
}

/// The keys of a printer of resin, in the order in which `show` prints them.
#[must_use]
pub fn msla() -> Vec<Key> {
    values_first([PRINTER, MSLA].concat())
}

/// Plain values of the root come before the first table: after it they would be its own.
fn values_first(mut keys: Vec<Key>) -> Vec<Key> {
    let of_a_table = |key: &Key| key.path.contains('.') || matches!(key.takes, Table | Choice | Tables(_));
    keys.sort_by_key(of_a_table);
    keys
}

/// The keys that every material's profile has, in the order in which `show` prints them.
pub const MATERIAL: &[Key] = &[
    key("name", Text, "Short name, as on the command line"),
    key("title", Text, "What it is called"),
    key("kind", OneOf(&["filament", "resin"]), "How it comes: filament on a spool, resin in a bottle"),
    key("density_g_cm3", Number(0.2, 10.0), "Density, g/cm³"),
    key("self_support", Table, "What prints with nothing under it"),
    key(
        "self_support.angle_deg",
        Number(0.0, 89.0),
        "Steepest overhang that prints unsupported, degrees from the vertical (0: none)",
    ),
    key(
        "self_support.bridge_mm",
        Number(0.0, 200.0),
        "Longest span between two supported ends that prints unsupported (0: none), mm",
    ),
    key(
        "self_support.min_area_mm2",
        Number(0.0, 100.0),
        "Smallest island that shows in the print; smaller ones are listed apart, mm²",
    ),
];

/// The keys that a filament's profile has besides; they follow [`MATERIAL`].
pub const FILAMENT: &[Key] = &[
    key("nozzle_c", Table, "Temperature of the nozzle, °C"),
    key("nozzle_c.min", Number(100.0, 600.0), "Coolest at which it still flows and bonds, °C"),
    key("nozzle_c.usual", Number(100.0, 600.0), "Where to start, °C"),
    key("nozzle_c.max", Number(100.0, 600.0), "Hottest before it degrades, °C"),
    key("bed_c", Table, "Temperature of the bed, °C"),
    key("bed_c.min", Number(0.0, 250.0), "Coolest (0: a cold bed will do), °C"),
    key("bed_c.usual", Number(0.0, 250.0), "Where to start, °C"),
    key("bed_c.max", Number(0.0, 250.0), "Hottest that still makes sense, °C"),
    key("fan_percent", Table, "Part cooling fan after the first layers, %"),
    key("fan_percent.min", Number(0.0, 100.0), "Least, %"),
    key("fan_percent.max", Number(0.0, 100.0), "Most, %"),
];

/// The keys of a filament's profile.
#[must_use]
pub fn filament() -> Vec<Key> {
    [MATERIAL, FILAMENT].concat()
}
