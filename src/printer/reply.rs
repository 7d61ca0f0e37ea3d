//! What a printer says: each line of a Marlin-family firmware, by class.
//!
//! Takes one line as [`LineSplitter`](super::lines::LineSplitter) gives it, gives
//! a [`Reply`]. Total: every byte string has a class, the last being
//! [`Reply::Other`]. A class is told by how the line begins, never by what it
//! contains somewhere: notes and file names contain `ok` too.
//!
//! Does not know what was sent; whether an `ok` acknowledges anything is the
//! session's affair.
use super::temperature::{Temperatures, temperatures};

/// One line of the printer, by class. Texts are slices of the line.
#[derive(Debug, Clone, PartialEq)]
pub enum Reply<'a> {
    /// `ok`, bare or with what the dialect adds.
    Ok(Ack),
    /// Send again from this line number: `Resend: 4`, `rs 4`, `Resend: N:4`.
    Resend(u32),
    /// `Error:…, Last Line: 3`, `Error:expected line 4 got 7` (Repetier): a line was
    /// refused; what follows it is lost.
    Refused {
        /// Number of the last line that was accepted.
        last_line: u32,
        /// The whole line.
        text: &'a [u8],
    },
    /// The firmware has given up: heaters are off, commands are ignored.
    Fatal(&'a [u8]),
    /// Another error; the firmware goes on.
    Error(&'a [u8]),
    /// Still at work on a command.
    Busy(Busy),
    /// Idle and without a command (`wait`).
    Wait,
    /// The firmware has just started.
    Start,
    /// Temperatures that came by themselves or for M105.
    Temperatures(Temperatures),
    /// Where the head is (M114), in mm.
    Position(Position),
    /// `FIRMWARE_NAME:…`: the name alone, without the keys that follow it.
    Firmware(&'a [u8]),
    /// `Cap:EMERGENCY_PARSER:1`.
    Capability {
        /// `EMERGENCY_PARSER`.
        name: &'a [u8],
        /// Whether the firmware has it.
        present: bool,
    },
    /// `//action:pause` and the like: what follows the colon.
    Action(&'a [u8]),
    /// `echo:Unknown command: "…"`.
    UnknownCommand(&'a [u8]),
    /// `echo:…` or `// …`, without the mark.
    Note(&'a [u8]),
    /// Anything else, whole.
    Other(&'a [u8]),
}

/// What came with an `ok`.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Ack {
    /// Number of the acknowledged line (ADVANCED_OK's `N`, Repetier's `ok 123`).
    pub line: Option<u32>,
    /// Free planner blocks (ADVANCED_OK's `P`).
    pub planner_free: Option<u32>,
    /// Free command slots (ADVANCED_OK's `B`).
    pub buffer_free: Option<u32>,
    /// The answer to M105.
    pub temperatures: Option<Temperatures>,
    /// The answer to M114, where it comes on the same line.
    pub position: Option<Position>,
}

/// What a busy printer waits for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Busy {
    /// `busy: processing`, and any word we do not know.
    Processing,
    /// `busy: paused for user`.
    PausedForUser,
    /// `busy: paused for input`.
    PausedForInput,
}

/// The head's position in mm; `e` in mm of filament.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Across.
    pub x_mm: f64,
    /// To the back.
    pub y_mm: f64,
    /// Up.
    pub z_mm: f64,
    /// Filament fed.
    pub e_mm: Option<f64>,
}

/// How fatal errors begin, after `Error:` and an optional heater number.
const FATAL: [&[u8]; 11] = [
    b"Printer halted",
    b"Printer stopped",
    b"MINTEMP",
    b"MAXTEMP",
    b"Heating failed",
    b"Thermal Runaway",
    b"THERMAL RUNAWAY",
    b"Heater decoupled",
    b"Extruder switched off",
    b"Heated bed switched off",
    b"Emergency stop",
];

/// The class of one line. Blanks around it do not matter.
pub fn parse(line: &[u8]) -> Reply<'_> {
    let line = line.trim_ascii();
    match line.first() {
        Some(b'o') => ok(line),
        Some(b'R' | b'r') => resend(line),
        Some(b'E' | b'e') => error_or_echo(line),
        Some(b'!') if line.starts_with(b"!!") => Some(Reply::Fatal(line)),
        Some(b'b') => busy(line),
        Some(b'w') if line == b"wait" => Some(Reply::Wait),
        Some(b's') if line == b"start" => Some(Reply::Start),
        Some(b'T' | b'B') => temperatures(line).map(Reply::Temperatures),
        Some(b'X') => position(line),
        Some(b'F') => after(line, b"FIRMWARE_NAME:").map(|rest| Reply::Firmware(first_value(rest))),
        Some(b'C') => capability(line),
        Some(b'/') => slashes(line),
        _ => None,
    }
    .unwrap_or(Reply::Other(line))
}

fn ok(line: &[u8]) -> Option<Reply<'_>> {
    let rest = after(line, b"ok")?;
    if rest.first().is_some_and(|b| !b.is_ascii_whitespace()) {
        return None;
    }
    let rest = rest.trim_ascii_start();
    let mut ack = Ack::default();
    if rest.is_empty() {
        return Some(Reply::Ok(ack));
    }
    if let Some(Reply::Position(p)) = position(rest) {
        ack.position = Some(p);
        return Some(Reply::Ok(ack));
    }
    ack.temperatures = temperatures(rest);
    if ack.temperatures.is_none() {
        for (at, word) in rest.split(u8::is_ascii_whitespace).enumerate() {
            match word {
                [b'N', n @ ..] => ack.line = ack.line.or(number(n)),
                [b'P', n @ ..] => ack.planner_free = number(n),
                [b'B', n @ ..] => ack.buffer_free = number(n),
                n if at == 0 => ack.line = number(n),
                _ => {}
            }
        }
    }
    Some(Reply::Ok(ack))
}

fn resend(line: &[u8]) -> Option<Reply<'_>> {
    let rest = after_ignoring_case(line, b"resend").or_else(|| after_ignoring_case(line, b"rs"))?;
    // `Resend: 4`, `Resend:4`, `Resend: N:4`, `rs N4`, `rs 4`.
    let marks = rest.iter().take_while(|b| matches!(b, b':' | b' ' | b'\t' | b'N')).count();
    let digits = &rest[marks..];
    let len = digits.iter().take_while(|b| b.is_ascii_digit()).count();
    let ends = digits.get(len).is_none_or(u8::is_ascii_whitespace);
    (marks > 0 && ends).then(|| number(&digits[..len]))?.map(Reply::Resend)
}

fn error_or_echo(line: &[u8]) -> Option<Reply<'_>> {
    if let Some(text) = after(line, b"echo:") {
        let text = text.trim_ascii_start();
        return busy(text).or_else(|| match after(text, b"Unknown command:") {
            Some(command) => Some(Reply::UnknownCommand(command.trim_ascii_start())),
            None => Some(Reply::Note(text)),
        });
    }
    let text = after_ignoring_case(line, b"error:")?.trim_ascii_start();
    // Marlin 1.0: `Error:0: Extruder switched off. MINTEMP triggered !`
    let heater = text.iter().take_while(|b| b.is_ascii_digit()).count();
    let cause = match text[heater..].trim_ascii_start() {
        [b':', rest @ ..] => rest.trim_ascii_start(),
        rest => rest,
    };
    if FATAL.iter().any(|start| cause.starts_with(start)) {
        return Some(Reply::Fatal(line));
    }
    Some(match last_line(text) {
        Some(last_line) => Reply::Refused { last_line, text: line },
        None => Reply::Error(line),
    })
}

/// The number at the end of `…, Last Line: 3`, or one less than in Repetier's
/// `expected line 4 got 7`.
fn last_line(text: &[u8]) -> Option<u32> {
    if let Some(rest) = text.trim_ascii_start().strip_prefix(b"expected line ") {
        let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        return rest[digits..].starts_with(b" got ").then(|| number(&rest[..digits]))??.checked_sub(1);
    }
    let digits = text.iter().rev().take_while(|b| b.is_ascii_digit()).count();
    let (head, n) = text.split_at(text.len() - digits);
    head.trim_ascii_end().strip_suffix(b"Last Line:")?;
    number(n)
}

fn busy(text: &[u8]) -> Option<Reply<'_>> {
    let what = after(text, b"busy:")?.trim_ascii_start();
    Some(Reply::Busy(match what {
        b"paused for user" => Busy::PausedForUser,
        b"paused for input" => Busy::PausedForInput,
        _ => Busy::Processing,
    }))
}

fn position(line: &[u8]) -> Option<Reply<'_>> {
    let (mut x, mut y, mut z, mut e) = (None, None, None, None);
    for word in line.split(u8::is_ascii_whitespace) {
        // What follows counts motor steps.
        if word == b"Count" {
            break;
        }
        let [axis, b':', value @ ..] = word else {
            continue;
        };
        let slot = match axis {
            b'X' => &mut x,
            b'Y' => &mut y,
            b'Z' => &mut z,
            b'E' => &mut e,
            _ => continue,
        };
        *slot = slot.or(decimal(value));
    }
    Some(Reply::Position(Position { x_mm: x?, y_mm: y?, z_mm: z?, e_mm: e }))
}

fn capability(line: &[u8]) -> Option<Reply<'_>> {
    let rest = after(line, b"Cap:")?;
    let colon = memchr::memrchr(b':', rest)?;
    let present = match rest[colon + 1..].trim_ascii() {
        b"1" => true,
        b"0" => false,
        _ => return None,
    };
    Some(Reply::Capability { name: &rest[..colon], present })
}

fn slashes(line: &[u8]) -> Option<Reply<'_>> {
    let rest = after(line, b"//")?.trim_ascii_start();
    Some(match after(rest, b"action:") {
        Some(action) => Reply::Action(action.trim_ascii()),
        None => Reply::Note(rest),
    })
}

/// The text before the next ` KEY:` of an M115 answer.
fn first_value(text: &[u8]) -> &[u8] {
    let mut at = 0;
    for word in text.split(|b| *b == b' ') {
        let key = word.iter().position(|b| *b == b':').unwrap_or(0);
        let is_key =
            key > 2 && word[..key].iter().all(|b| b.is_ascii_uppercase() || matches!(b, b'_' | b'-'));
        if is_key {
            break;
        }
        at += word.len() + 1;
    }
    text[..at.min(text.len())].trim_ascii()
}

fn after<'a>(line: &'a [u8], start: &[u8]) -> Option<&'a [u8]> {
    line.strip_prefix(start)
}

fn after_ignoring_case<'a>(line: &'a [u8], start: &[u8]) -> Option<&'a [u8]> {
    let (head, rest) = line.split_at_checked(start.len())?;
    head.eq_ignore_ascii_case(start).then_some(rest)
}

/// Decimal digits and nothing else, as far as 32 bits go.
fn number(digits: &[u8]) -> Option<u32> {
    if digits.is_empty() {
        return None;
    }
    digits.iter().try_fold(0_u32, |n, b| {
        let digit = char::from(*b).to_digit(10)?;
        n.checked_mul(10)?.checked_add(digit)
    })
}

/// A finite decimal number without exponent, infinity or name.
pub(super) fn decimal(text: &[u8]) -> Option<f64> {
    let plain = |b: &u8| b.is_ascii_digit() || matches!(b, b'-' | b'+' | b'.');
    if !text.iter().all(plain) {
        return None;
    }
    let value: f64 = std::str::from_utf8(text).ok()?.parse().ok()?;
    value.is_finite().then_some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(line: &str, expect: Reply<'_>) {
        assert_eq!(parse(line.as_bytes()), expect, "{line:?}");
    }

    fn ack(line: Option<u32>, planner_free: Option<u32>, buffer_free: Option<u32>) -> Reply<'static> {
        Reply::Ok(Ack { line, planner_free, buffer_free, temperatures: None, position: None })
    }

    #[test]
    fn acknowledgements() {
        check("ok", ack(None, None, None));
        check("ok ", ack(None, None, None));
        check("ok N123 P15 B3", ack(Some(123), Some(15), Some(3)));
        check("ok P15 B3", ack(None, Some(15), Some(3)));
        check("ok 123", ack(Some(123), None, None));
        check("ok N99999999999 P1 B1", ack(None, Some(1), Some(1)));
        check("ok C: X:0.00 Y:0.00", ack(None, None, None));
        let Reply::Ok(with_p) = parse(b"ok X:66.0 Y:60.0 Z:0.2 E:1.5 Count: A:6600 B:6000 C:20") else {
            panic!("no ok");
        };
        let p = with_p.position.expect("a position");
        assert_eq!((p.x_mm, p.y_mm, p.z_mm, p.e_mm), (66.0, 60.0, 0.2, Some(1.5)));
        let Reply::Ok(with_t) = parse(b"ok T:20.5 /0.0 B:21.0 /60.0 @:0 B@:0") else {
            panic!("an ok");
        };
        let t = with_t.temperatures.unwrap();
        assert_eq!(t.hotend().unwrap().actual_c, 20.5);
        assert_eq!(t.bed.unwrap().target_c, Some(60.0));
        assert_eq!(with_t.line, None);
    }

    #[test]
    fn no_acknowledgements() {
        for line in ["okay", "ok.", "okN5", "OK", "not ok", "o", "k", "oko"] {
            check(line, Reply::Other(line.as_bytes()));
        }
        check("echo:Unknown command: \"ok\"", Reply::UnknownCommand(b"\"ok\""));
        check("echo:ok", Reply::Note(b"ok"));
        check("// ok", Reply::Note(b"ok"));
        check("//action:ok", Reply::Action(b"ok"));
    }

    #[test]
    fn resend_requests() {
        for line in [
            "Resend: 4",
            "Resend:4",
            "Resend: N:4",
            "Resend: N4",
            "resend 4",
            "rs 4",
            "rs N4",
            "rs 4 again",
            "Resend: 4 ",
        ] {
            check(line, Reply::Resend(4));
        }
        for line in ["Resend: ", "Resend", "rs", "Resend: 4x", "rs4", "Resend: 99999999999", "Resend: -1"] {
            check(line, Reply::Other(line.trim_end().as_bytes()));
        }
    }

    #[test]
    fn errors() {
        let refused = |text: &'static str, last_line| {
            check(text, Reply::Refused { last_line, text: text.as_bytes() });
        };
        refused("Error:checksum mismatch, Last Line: 3", 3);
        refused("Error:Line Number is not Last Line Number+1, Last Line: 33", 33);
        refused("Error:No Checksum with line number, Last Line: 0", 0);
        refused("Error:expected line 39 got 2000000000", 38);
        for line in [
            "!! MCU shutdown",
            "Error:Printer halted. kill() called!",
            "Error:MINTEMP triggered, system stopped! Heater_ID: 0",
            "Error:MAXTEMP triggered, system stopped! Heater_ID: bed",
            "Error:Heating failed, system stopped! Heater_ID: 0",
            "Error:Thermal Runaway, system stopped! Heater_ID: 0",
            "Error:0: Extruder switched off. MINTEMP triggered !",
        ] {
            check(line, Reply::Fatal(line.as_bytes()));
        }
        for line in [
            "Error:File: thermal runaway.gco not found",
            "Error:Last Line: soon",
            "Error:expected line 39 g",
            "Error:expected line 0 got 7",
            "Error:",
            "error:volume.init failed",
        ] {
            check(line, Reply::Error(line.as_bytes()));
        }
    }

    #[test]
    fn states() {
        check("wait", Reply::Wait);
        check("waiting", Reply::Other(b"waiting"));
        check("start", Reply::Start);
        check("started", Reply::Other(b"started"));
        check("echo:start", Reply::Note(b"start"));
        check("echo:busy: processing", Reply::Busy(Busy::Processing));
        check("busy: paused for user", Reply::Busy(Busy::PausedForUser));
        check("echo:busy: paused for input", Reply::Busy(Busy::PausedForInput));
        check("//action:pause", Reply::Action(b"pause"));
        check("// action:prompt_begin Filament?", Reply::Action(b"prompt_begin Filament?"));
        check("Marlin 2.1.2.1", Reply::Other(b"Marlin 2.1.2.1"));
    }

    #[test]
    fn reports() {
        check(
            "X:1.50 Y:-2.00 Z:0.20 E:12.00 Count X:120 Y:-160 Z:80",
            Reply::Position(Position { x_mm: 1.5, y_mm: -2.0, z_mm: 0.2, e_mm: Some(12.0) }),
        );
        check("X:1.50 Y:nan Z:0", Reply::Other(b"X:1.50 Y:nan Z:0"));
        check(
            "FIRMWARE_NAME:Marlin 2.1.2.1 (Sep  1 2023 12:00:00) SOURCE_CODE_URL:github.com/MarlinFirmware/Marlin PROTOCOL_VERSION:1.0",
            Reply::Firmware(b"Marlin 2.1.2.1 (Sep  1 2023 12:00:00)"),
        );
        check("FIRMWARE_NAME:Klipper", Reply::Firmware(b"Klipper"));
        check("Cap:AUTOREPORT_TEMP:1", Reply::Capability { name: b"AUTOREPORT_TEMP", present: true });
        check("Cap:X", Reply::Other(b"Cap:X"));
        assert!(matches!(parse(b" T:210.1 /210.0 B:60.0 /60.0 @:64 B@:30"), Reply::Temperatures(_)));
    }

    proptest! {
        #[test]
        fn every_line_has_a_class(line: Vec<u8>) {
            let _ = parse(&line);
        }

        #[test]
        fn only_ok_acknowledges(line in "[a-zA-Z:/! 0-9]{0,20}") {
            if let Reply::Ok(_) = parse(line.as_bytes()) {
                let line = line.trim();
                prop_assert!(line == "ok" || line.starts_with("ok "));
            }
        }

        #[test]
        fn near_replies_do_not_panic(
            start in prop::sample::select(vec!["ok ", "Resend: ", "Error:", "T:", "X:", "Cap:", "FIRMWARE_NAME:", "//", "echo:busy:"]),
            rest: Vec<u8>,
        ) {
            let mut line = start.as_bytes().to_vec();
            line.extend(rest);
            let _ = parse(&line);
        }
    }
}
