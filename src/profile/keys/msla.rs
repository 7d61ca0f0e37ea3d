//! The keys of a resin printer's profile: LCD, light, plate, and what is asked before a print.
use super::Takes::{Choice, Flag, Line, Macro, Number, OneOf, Table, Tables, Text, Whole};
use super::{Key, TEXT_BYTES_MAX, key, optional};

/// Longest side of a panel, px: twice what the largest sold have.
const SIDE_PX_MAX: i64 = 16_384;

/// Longest path of a folder: Linux's PATH_MAX.
const PATH_BYTES_MAX: usize = 4096;

/// Longest of any one wait, ms: a minute; longer ones are mistyped seconds.
const WAIT_MS_MAX: i64 = 60_000;

/// Fastest plate, mm/min: 100 mm/s is far above what a screw under a plate does.
const SPEED_MM_MIN_MAX: f64 = 6000.0;

/// Most questions before a print: more would be clicked away unread.
const BEFORE_MAX: usize = 8;

/// The keys that a resin printer's profile has besides those of any printer.
pub const MSLA: &[Key] = &[
    key("lcd", Table, "The monochrome panel that shows the pictures"),
    key("lcd.width_px", Whole(1, SIDE_PX_MAX), "Its own pixels in a row, as a job's pictures have them"),
    key("lcd.height_px", Whole(1, SIDE_PX_MAX), "Its rows"),
    key(
        "lcd.pixels",
        OneOf(&["grey", "rgb", "bgr"]),
        "grey: a panel pixel is one pixel of the display; rgb, bgr: three neighbours of a row are red, green and blue (or blue, green and red) of one (the depth, 5-6-5 or 8-8-8, is told by the display itself)",
    ),
    optional(
        "lcd.mirror",
        OneOf(&["none", "x", "y", "xy"]),
        "How a picture is turned before it is shown: x changes left and right, y top and bottom (left out: none)",
    ),
    key("lcd.sink", Choice, "Where the pictures go: one of two"),
    optional("lcd.sink.framebuffer", Line(16), "A framebuffer by its name in /dev: fb0"),
    optional("lcd.sink.folder", Line(PATH_BYTES_MAX), "A folder in which each is written as a file"),
    key(
        "lcd.settle_ms",
        Whole(0, 5000),
        "How long a picture is shown before the light goes on, ms: the liquid crystals turn, and the lines of the exposure arrive (at 115200 baud 6 ms for four, and some 40 ms where one is sent again: so with less than 50 a disturbed line makes the layer wait; at least 20 where the controller times)",
    ),
    key("light", Table, "The UV light behind the panel"),
    key("light.on", Macro, "Switches it on at {power}, 0 to 255: M106 S{power}"),
    key("light.off", Macro, "Switches it off: M107"),
    key(
        "light.timed_by",
        OneOf(&["controller", "host"]),
        "Whose clock ends an exposure: the controller has on, dwell and off in its queue before the light goes on, so that it goes off without a host too; the host sends off when it is time",
    ),
    optional(
        "light.pulse",
        Macro,
        "Lines of which the last lights for {ms} at {power} and ends by itself, where the controller can (left out: on, dwell, off)",
    ),
    optional("light.dwell", Macro, "Waits for {ms} before what follows it (left out: G4 P{ms})"),
    key(
        "light.off_when_halted",
        Flag,
        "Whether a firmware that halts (M112) switches this pin off: Marlin does so with that of a laser or spindle (M3, M5), not with a fan's (M106, M107)",
    ),
    optional(
        "light.most_s",
        Number(0.1, 600.0),
        "Longest exposure that is believed, s; a job that asks for more is refused (left out: 120)",
    ),
    key("plate", Table, "What the part hangs on, and how it moves"),
    key(
        "plate.homes",
        OneOf(&["up", "down"]),
        "Where its switch is; with a part on the plate only one that homes up can be homed",
    ),
    key("plate.lift", Table, "How it comes off the film, where the job's file says nothing"),
    key("plate.lift.slow_mm", Number(0.0, 100.0), "How far slowly, while the part comes off, mm"),
    key("plate.lift.slow_mm_min", Number(1.0, SPEED_MM_MIN_MAX), "How fast that is, mm/min"),
    key("plate.lift.fast_mm", Number(0.0, 100.0), "How much further fast (0: no further), mm"),
    key("plate.lift.fast_mm_min", Number(1.0, SPEED_MM_MIN_MAX), "How fast that is, mm/min"),
    key("plate.retract", Table, "How it goes back down, where the job's file says nothing"),
    key("plate.retract.slow_mm", Number(0.0, 100.0), "How much of the way, the last, is slow (0: none), mm"),
    key("plate.retract.slow_mm_min", Number(1.0, SPEED_MM_MIN_MAX), "How fast that is, mm/min"),
    key("plate.retract.fast_mm_min", Number(1.0, SPEED_MM_MIN_MAX), "How fast it is before, mm/min"),
    key(
        "plate.settle_ms",
        Whole(0, WAIT_MS_MAX),
        "After the move, before the picture, ms: resin flows from under the part",
    ),
    key("plate.rest_ms", Whole(0, WAIT_MS_MAX), "After the light, before the lift, ms: the layer hardens on"),
    key("plate.top_ms", Whole(0, WAIT_MS_MAX), "At the top of the lift, ms: resin flows into the gap"),
    optional(
        "plate.done",
        Macro,
        "Lines after which the printer says {word} alone on a line once the plate stands (left out: M400, then M118 {word})",
    ),
    key(
        "plate.max_mm_min",
        Number(1.0, SPEED_MM_MIN_MAX),
        "Fastest that it moves, mm/min; for estimates and the mock printer",
    ),
    key(
        "plate.accel_mm_s2",
        Number(1.0, 1e5),
        "How it gains speed, mm/s²; for estimates and the mock printer",
    ),
    optional("plate.home", Macro, "Homes it, before a print only (left out: G28 Z)"),
    optional(
        "plate.clear_mm",
        Number(1.0, 500.0),
        "How far it is raised at a pause or cancel, if there is room, mm (left out: 20)",
    ),
    optional("before", Tables(BEFORE_MAX), "What is to be so before a print; one such table for each"),
    key("before.what", Text, "In words for a person: the vat is full and the cover closed"),
    optional(
        "before.send",
        Line(TEXT_BYTES_MAX),
        "A command that asks the firmware for it, such as M119 (left out: a person is asked)",
    ),
    optional("before.wants", Line(TEXT_BYTES_MAX), "What some line of the answer to send must contain"),
];
