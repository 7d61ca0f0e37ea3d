//! The words of Marlin 2.1.2.1: what the board says, byte for byte.
//!
//! Takes values, gives text; every line ends in `\n` alone. Knows nothing of
//! when it is said.
use super::heater::Heater;

/// M0, M1 and M600 with HOST_PROMPT_SUPPORT.
pub(crate) const PROMPT: &[u8] = b"//action:prompt_end\n//action:prompt_begin M0 Stop\n//action:prompt_button Continue\n//action:prompt_show\n";

/// The lines of a start; `cause` is `PowerUp` or ` External Reset`.
pub(crate) fn boot(cause: &str) -> String {
    format!(
        "start\n{cause}\nMarlin 2.1.2.1\n\n\
         echo: Last Updated: 2023-02-11 | Author: (outrigger, mock)\n\
         echo: Compiled: Feb 11 2023\n\
         echo: Free Memory: 5187  PlannerBufferBytes: 1488\n\
         echo:Hardcoded Default Settings Loaded\n"
    )
}

/// `T:21.00 /0.00 B:21.00 /0.00 @:0 B@:0`
pub(crate) fn temperatures(nozzle: &Heater, bed: &Heater, now_s: f64) -> String {
    format!(
        "T:{:.2} /{:.2} B:{:.2} /{:.2} @:{} B@:{}",
        nozzle.temperature_c(now_s),
        nozzle.target_c(),
        bed.temperature_c(now_s),
        bed.target_c(),
        nozzle.power(now_s),
        bed.power(now_s)
    )
}

/// A line while M109 or M190 waits: `W:?` until the temperature is there,
/// then the seconds that are left.
pub(crate) fn heating(temperatures: &str, left_s: Option<u64>) -> String {
    match left_s {
        None => format!(" {temperatures} W:?\n"),
        Some(s) => format!(" {temperatures} W:{s}\n"),
    }
}

/// The keep-alive of a command that takes long.
pub(crate) fn busy(waits_for_user: bool) -> &'static [u8] {
    if waits_for_user { b"echo:busy: paused for user\n" } else { b"echo:busy: processing\n" }
}

/// Appends ` N12 P15 B3`, the number only if the line begins with one.
pub(crate) fn advanced_ok(ok: &mut Vec<u8>, line: &[u8], free: (usize, usize)) {
    if line.first() == Some(&b'N') {
        let digits = line[1..].iter().take_while(|b| b.is_ascii_digit() || matches!(b, b'-' | b'+'));
        ok.extend(b" N");
        ok.extend(digits);
    }
    ok.extend(format!(" P{} B{}", free.0, free.1).bytes());
}

/// M115: identity and capabilities.
pub(crate) fn identity(machine: &str, emergency_parser: bool) -> String {
    let caps = [
        ("SERIAL_XON_XOFF", false),
        ("BINARY_FILE_TRANSFER", false),
        ("EEPROM", false),
        ("VOLUMETRIC", true),
        ("AUTOREPORT_POS", false),
        ("AUTOREPORT_TEMP", true),
        ("PROGRESS", false),
        ("PRINT_JOB", true),
        ("AUTOLEVEL", false),
        ("RUNOUT", false),
        ("Z_PROBE", false),
        ("LEVELING_DATA", false),
        ("BUILD_PERCENT", true),
        ("SOFTWARE_POWER", false),
        ("TOGGLE_LIGHTS", false),
        ("CASE_LIGHT_BRIGHTNESS", false),
        ("EMERGENCY_PARSER", emergency_parser),
        ("HOST_ACTION_COMMANDS", true),
        ("PROMPT_SUPPORT", true),
        ("SDCARD", false),
        ("ARCS", true),
        ("BABYSTEPPING", false),
        ("CHAMBER_TEMPERATURE", false),
    ];
    let mut text = format!(
        "FIRMWARE_NAME:Marlin 2.1.2.1 (outrigger mock) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin \
         PROTOCOL_VERSION:1.0 MACHINE_TYPE:{machine} EXTRUDER_COUNT:1 \
         UUID:cede2a2f-41a2-4748-9b12-c55c62f367ff\n"
    );
    for (name, on) in caps {
        text += &format!("Cap:{name}:{}\n", u8::from(on));
    }
    text
}

/// M114: the position and the steppers' counts, 80, 80 and 400 steps a millimetre.
pub(crate) fn position(at_mm: [f64; 4]) -> String {
    let [x, y, z, e] = at_mm;
    let steps = |mm: f64, per_mm: f64| (mm * per_mm).round() as i64;
    format!(
        "X:{x:.2} Y:{y:.2} Z:{z:.2} E:{e:.2} Count X:{} Y:{} Z:{}\n",
        steps(x, 80.0),
        steps(y, 80.0),
        steps(z, 400.0)
    )
}
