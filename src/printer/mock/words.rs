//! One command taken apart: letter, number, parameters, text.
//!
//! Takes an accepted line, gives its words the way Marlin's parser reads
//! them: no exponents, blanks allowed between a letter and its value, lower
//! case no command. Knows not what a command does.
use super::line::trim_start;

/// A command, borrowed from its line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Command<'a> {
    /// `G`, `M` or `T`; `?` when it is none of them.
    pub(crate) letter: u8,
    /// The number after the letter.
    pub(crate) code: u32,
    /// What follows it after a point: 9 in `G92.9`.
    pub(crate) sub: u32,
    /// From the command's letter to before the checksum, for messages.
    pub(crate) whole: &'a [u8],
    /// What follows the code, without the checksum.
    pub(crate) rest: &'a [u8],
}

impl<'a> Command<'a> {
    /// Never fails: what is no command has the letter `?`.
    pub(crate) fn parse(line: &'a [u8]) -> Self {
        let line = skip_number(trim_start(line));
        // The first letter is passed over in the search, as Marlin does.
        let end = line.iter().skip(1).position(|&b| b == b'*').map_or(line.len(), |at| at + 1);
        let whole = trim_end(&line[..end]);
        let unknown = Self { letter: b'?', code: 0, sub: 0, whole, rest: &[] };
        let Some((&letter, after)) = whole.split_first() else {
            return unknown;
        };
        let after = trim_start(after);
        if !matches!(letter, b'G' | b'M' | b'T') || !after.first().is_some_and(u8::is_ascii_digit) {
            return unknown;
        }
        let (code, after) = whole_number(after);
        let (sub, after) = match after.split_first() {
            Some((b'.', more)) => whole_number(more),
            _ => (0, after),
        };
        Self { letter, code, sub, whole, rest: trim_start(after) }
    }

    /// Whether a parameter is there, with a value or without.
    pub(crate) fn has(&self, letter: u8) -> bool {
        self.find(letter).is_some()
    }

    /// A parameter's value; `None` where the parameter or its value is missing.
    pub(crate) fn value(&self, letter: u8) -> Option<f64> {
        decimal(self.find(letter)?)
    }

    /// What follows a parameter's letter.
    fn find(&self, letter: u8) -> Option<&'a [u8]> {
        let mut text = self.rest;
        while let Some((&found, after)) = text.split_first() {
            let value = trim_start(after);
            if found.to_ascii_uppercase() == letter {
                return Some(value);
            }
            let skip = value.iter().take_while(|b| matches!(b, b'0'..=b'9' | b'+' | b'-' | b'.')).count();
            text = trim_start(&value[skip..]);
        }
        None
    }
}

/// The digits at the beginning as a number, and what follows them.
fn whole_number(text: &[u8]) -> (u32, &[u8]) {
    let digits = text.iter().take_while(|b| b.is_ascii_digit()).count();
    let number =
        text[..digits].iter().fold(0u32, |n, b| n.saturating_mul(10).saturating_add(u32::from(b - b'0')));
    (number, &text[digits..])
}

/// The number at the beginning of some bytes: a sign, digits, a point, digits.
fn decimal(text: &[u8]) -> Option<f64> {
    let sign = usize::from(matches!(text.first(), Some(b'+' | b'-')));
    let whole = text[sign..].iter().take_while(|b| b.is_ascii_digit()).count();
    let mut end = sign + whole;
    let mut digits = whole;
    if text.get(end) == Some(&b'.') {
        let part = text[end + 1..].iter().take_while(|b| b.is_ascii_digit()).count();
        digits += part;
        end += 1 + part;
    }
    if digits == 0 {
        return None;
    }
    std::str::from_utf8(&text[..end]).ok()?.parse().ok()
}

/// Passes over `N…`, whose case does not matter here.
fn skip_number(line: &[u8]) -> &[u8] {
    let numbered =
        matches!(line.first(), Some(b'N' | b'n')) && matches!(line.get(1), Some(b'0'..=b'9' | b'-' | b'+'));
    if !numbered {
        return line;
    }
    let digits = line[2..].iter().take_while(|b| b.is_ascii_digit()).count();
    trim_start(&line[2 + digits..])
}

fn trim_end(text: &[u8]) -> &[u8] {
    let blanks = text.iter().rev().take_while(|&&b| b == b' ').count();
    &text[..text.len() - blanks]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(line: &str, letter: u8, code: u32, rest: &str) {
        let found = Command::parse(line.as_bytes());
        assert_eq!((found.letter, found.code), (letter, code), "{line:?}");
        assert_eq!(found.rest, rest.as_bytes(), "{line:?}");
    }

    #[test]
    fn commands_are_found() {
        check("G1 X1", b'G', 1, "X1");
        check("N5 G1 X1 *33", b'G', 1, "X1");
        check("N-1 M110 N-1*125", b'M', 110, "N-1");
        check("n5 G1 X1", b'G', 1, "X1");
        check("M 105", b'M', 105, "");
        check("T0", b'T', 0, "");
        check("G1X1Y2", b'G', 1, "X1Y2");
        check("M117 a*b", b'M', 117, "a");
        check("G92.9 Z1.5", b'G', 92, "Z1.5");
        check("G92.9Z1.5", b'G', 92, "Z1.5");
        assert_eq!(Command::parse(b"G92.9 Z1").sub, 9);
        assert_eq!(Command::parse(b"G92 Z1").sub, 0);
        check("g1 X1", b'?', 0, "");
        check("X4 G1", b'?', 0, "");
        check("G", b'?', 0, "");
        check("   ", b'?', 0, "");
        check("", b'?', 0, "");
        check("*", b'?', 0, "");
        check("G99999999999", b'G', u32::MAX, "");
    }

    #[test]
    fn values_are_read_as_marlin_reads_them() {
        let value = |line: &str, letter| Command::parse(line.as_bytes()).value(letter);
        assert_eq!(value("G1 X1.5 Y-2 Z.25 E+3", b'X'), Some(1.5));
        assert_eq!(value("G1 X1.5 Y-2 Z.25 E+3", b'Y'), Some(-2.0));
        assert_eq!(value("G1 X1.5 Y-2 Z.25 E+3", b'Z'), Some(0.25));
        assert_eq!(value("G1 X1.5Y-2Z.25E+3.", b'E'), Some(3.0));
        assert_eq!(value("G1 x7", b'X'), Some(7.0));
        assert_eq!(value("G1 X 7", b'X'), Some(7.0));
        assert_eq!(value("G1 X", b'X'), None);
        assert_eq!(value("G1 X-", b'X'), None);
        assert_eq!(value("G1 X1e3", b'X'), Some(1.0));
        assert_eq!(value("G1 X1e3", b'E'), Some(3.0));
        assert_eq!(value("G1 X1-2", b'X'), Some(1.0));
        assert!(Command::parse(b"G28 X").has(b'X'));
        assert!(!Command::parse(b"G28 X").has(b'Y'));
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_a_command_or_none(line: Vec<u8>) {
            let command = Command::parse(&line);
            for letter in b'A'..=b'Z' {
                let _ = command.value(letter);
            }
        }
    }
}
