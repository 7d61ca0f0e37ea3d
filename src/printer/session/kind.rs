//! What a command does to the wire, told by its word alone.
use crate::printer::window::Kind;

/// The kind of a command; a word that is no G, M or T code is a macro, which may
/// do anything for any time.
pub(super) fn kind_of(command: &[u8]) -> Kind {
    let (letter, number) = match split_word(command) {
        Some(word) => word,
        None => return Kind::Long,
    };
    match (letter, number) {
        (b'M', 105) => Kind::AskTemperature,
        // Wait for a person: stop, filament change, pause.
        (b'M', 0 | 1 | 25 | 125 | 226 | 600 | 601) => Kind::User,
        (b'M', 109 | 116 | 190 | 191) => Kind::Heat,
        // Dwell, homing, probing and levelling.
        (b'G', 4 | 28..=35 | 76 | 80 | 81 | 425) => Kind::Long,
        // Probe test, PID tuning, waiting for moves, filament load and unload.
        (b'M', 48 | 226..=229 | 303 | 400 | 306 | 701 | 702) => Kind::Long,
        // Tool changers and multi-material units take their time.
        (b'T', _) => Kind::Long,
        (b'G' | b'M', _) => Kind::Quick,
        _ => Kind::Long,
    }
}

/// Whether this is M110, which would change the numbers under us.
pub(super) fn sets_line_number(command: &[u8]) -> bool {
    split_word(command) == Some((b'M', 110))
}

/// Whether an emergency parser reads this ahead of the queue: M108 (go on), M410 (stop
/// moving), M876 (an answer).
pub(super) fn is_urgent(command: &[u8]) -> bool {
    matches!(split_word(command), Some((b'M', 108 | 410 | 876)))
}

/// Whether this is M112.
pub(super) fn stops(command: &[u8]) -> bool {
    split_word(command) == Some((b'M', 112))
}

/// `G28 X` → (`G`, 28). A number past 9999 is no code.
fn split_word(command: &[u8]) -> Option<(u8, u16)> {
    let (letter, rest) = command.split_first()?;
    let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
    if !(1..=4).contains(&digits) {
        return None;
    }
    let number = rest[..digits].iter().fold(0_u16, |n, b| n * 10 + u16::from(b - b'0'));
    Some((letter.to_ascii_uppercase(), number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds() {
        let check = |command: &str, expect| assert_eq!(kind_of(command.as_bytes()), expect);
        check("G1 X10", Kind::Quick);
        check("G28", Kind::Long);
        check("G28 X", Kind::Long);
        check("G280", Kind::Quick);
        check("G4P100", Kind::Long);
        check("M105", Kind::AskTemperature);
        check("M109 S200", Kind::Heat);
        check("M1", Kind::User);
        check("M117 M109", Kind::Quick);
        check("T1", Kind::Long);
        check("START_PRINT BED=60", Kind::Long);
        check("M99999", Kind::Long);
        check("", Kind::Long);
        assert!(sets_line_number(b"M110 N5"));
        assert!(!sets_line_number(b"M1100"));
    }
}
