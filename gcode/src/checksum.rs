//! Framing: from a line of a file to the numbered, checksummed line on the wire.
//!
//! Takes one line of a job, gives the command that a printer should get
//! ([`sendable`]), whether it fits the firmware's buffer ([`fit`]) and its frame
//! `N<n> <command>*<checksum>\n` ([`frame`]). Nothing here allocates in steady
//! state: results are slices of the line or lie in the caller's buffers.
//!
//! Does not know what was sent before, nor what the printer answers.
use thiserror::Error;

/// Digits counted for the checksum when a line is measured: a byte in decimal.
///
/// The true checksum may be shorter, but it changes with the line number, and
/// a verdict on a line must not.
const CHECKSUM_DIGITS: usize = 3;

/// A command that would not fit the firmware's line buffer once framed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error(
    "the line is {framed_len} characters with its number and checksum, \
     but the firmware takes {max_line}"
)]
pub struct TooLong {
    /// Characters of the framed line, without the line feed.
    pub framed_len: usize,
    /// What the firmware takes, without the line feed.
    pub max_line: usize,
}

/// XOR of all bytes: the checksum of the RepRap serial protocol.
pub fn xor(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum ^ byte)
}

/// Appends `N<n> <command>*<checksum>\n` to `out`.
///
/// `command` must come from [`sendable`] or be as clean: no line feed, no comment.
pub fn frame(n: u32, command: &[u8], out: &mut Vec<u8>) {
    let start = out.len();
    out.push(b'N');
    push_decimal(n, out);
    out.push(b' ');
    out.extend_from_slice(command);
    let sum = xor(&out[start..]);
    out.push(b'*');
    push_decimal(u32::from(sum), out);
    out.push(b'\n');
}

/// Characters of the frame of a command of `command_len` bytes as line `n`,
/// without the line feed and with the longest checksum.
pub fn framed_len(n: u32, command_len: usize) -> usize {
    let mark_and_blank = 2;
    let star = 1;
    mark_and_blank + decimal_len(n) + command_len + star + CHECKSUM_DIGITS
}

/// The command as it can be sent as line `n` to a firmware that takes `max_line`
/// characters a line (`None`: no limit).
///
/// The text of `M117` and `M118` is only shown to people, so it is shortened,
/// between characters when it is UTF-8. Any other long command is an error:
/// cutting it would change what the printer does.
pub fn fit(n: u32, command: &[u8], max_line: Option<usize>) -> Result<&[u8], TooLong> {
    let Some(max_line) = max_line else {
        return Ok(command);
    };
    let framed = framed_len(n, command.len());
    if framed <= max_line {
        return Ok(command);
    }
    let too_long = TooLong { framed_len: framed, max_line };
    let word = Word::of(command);
    if !matches!(word.code(), Some((b'M', 117 | 118))) {
        return Err(too_long);
    }
    let room = command.len().checked_sub(framed - max_line).ok_or(too_long)?;
    let cut = trim_end(&command[..char_boundary(command, room)]);
    if cut.len() < word.len {
        return Err(too_long);
    }
    Ok(cut)
}

/// The part of a line of a file that a printer should get, or `None` for a line
/// without a command.
///
/// - A `;` comment and, outside quotes and text arguments, `( )` comments go.
/// - A number and checksum that the file brings along (`N12 G1 X1*57`) go: the
///   sender numbers anew.
/// - Backslashes and control characters go: firmware takes the former for an
///   escape, a carriage return for the end of the line, and either breaks the
///   checksum of every copy that is sent again.
/// - A lower-case command (`g1 x2`) becomes upper-case, since Marlin does not
///   know the other; text arguments and quoted strings keep their case.
///
/// `scratch` is used only when bytes inside the command change.
pub fn sendable<'a>(line: &'a [u8], scratch: &'a mut Vec<u8>) -> Option<&'a [u8]> {
    let code = match memchr::memchr(b';', line) {
        Some(at) => &line[..at],
        None => line,
    };
    let code = strip_number(trim(code));
    if code.is_empty() {
        return None;
    }
    let plain = |b: &u8| !matches!(b, b'(' | b'\\' | 0..0x20 | 0x7f);
    let command = if code.iter().all(plain) && !code[0].is_ascii_lowercase() {
        code
    } else {
        clean(code, scratch);
        // A number may have hidden behind bytes that are gone now.
        strip_number(trim(scratch))
    };
    (!command.is_empty()).then_some(command)
}

/// Whether parentheses in this command belong to a text argument.
///
/// M23, M28, M30, M32, M33 and M928 name files, M16 a machine, M0, M1, M117,
/// M118 and M486 show text; a word that is no G, M or T code is a macro
/// (Klipper) whose values are its own affair.
fn takes_text(word: &Word) -> bool {
    match word.code() {
        Some((b'M', n)) => {
            matches!(n, 0 | 1 | 16 | 20 | 23 | 28 | 30 | 32 | 33 | 36 | 98 | 117 | 118 | 486 | 928)
        }
        Some(_) => false,
        // `(a comment)` alone starts no word.
        None => word.letter.is_ascii_alphabetic(),
    }
}

/// Copies `code` to `out` (replacing what is there) without what must not be sent.
fn clean(code: &[u8], out: &mut Vec<u8>) {
    out.clear();
    let word = Word::of(code);
    let text = takes_text(&word);
    let raise = code[0].is_ascii_lowercase() && word.code().is_some();
    let (mut quoted, mut depth) = (false, 0_u32);
    for (at, &byte) in code.iter().enumerate() {
        match byte {
            b'(' if !text && !quoted => depth = depth.saturating_add(1),
            b')' if depth > 0 => depth -= 1,
            _ if depth > 0 => {}
            b'\t' => out.push(b' '),
            b'\\' | 0..0x20 | 0x7f => {}
            _ => {
                quoted ^= byte == b'"';
                let in_text = text && at >= word.len;
                out.push(if raise && !in_text && !quoted { byte.to_ascii_uppercase() } else { byte });
            }
        }
    }
}

/// Removes a leading `N<digits>` and, if there was one, a trailing `*<digits>`;
/// again as long as there is one, for firmware would take a second for the first.
fn strip_number(mut code: &[u8]) -> &[u8] {
    while let [b'N' | b'n', rest @ ..] = code {
        let digits = rest.iter().take_while(|b| b.is_ascii_digit()).count();
        if digits == 0 {
            break;
        }
        let rest = &rest[digits..];
        code = match memchr::memrchr(b'*', rest) {
            Some(at) if is_checksum(&rest[at + 1..]) => trim(&rest[..at]),
            _ => trim(rest),
        };
    }
    code
}

fn is_checksum(bytes: &[u8]) -> bool {
    (1..=CHECKSUM_DIGITS).contains(&bytes.len()) && bytes.iter().all(u8::is_ascii_digit)
}

fn trim(bytes: &[u8]) -> &[u8] {
    let start = bytes.iter().position(|b| !blank(*b)).unwrap_or(bytes.len());
    trim_end(&bytes[start..])
}

fn trim_end(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().rposition(|b| !blank(*b)).map_or(0, |at| at + 1);
    &bytes[..end]
}

fn blank(byte: u8) -> bool {
    byte <= b' '
}

/// The last character boundary at or before `at` if `bytes` are UTF-8, else `at`.
fn char_boundary(bytes: &[u8], at: usize) -> usize {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.floor_char_boundary(at),
        Err(_) => at,
    }
}

fn push_decimal(n: u32, out: &mut Vec<u8>) {
    let mut digits = [0_u8; 10];
    let mut at = digits.len();
    let mut rest = n;
    loop {
        at -= 1;
        digits[at] = b'0' + (rest % 10) as u8;
        rest /= 10;
        if rest == 0 {
            break;
        }
    }
    out.extend_from_slice(&digits[at..]);
}

fn decimal_len(n: u32) -> usize {
    n.checked_ilog10().map_or(1, |log| log as usize + 1)
}

/// The command word of a line: `G1`, `M117`, `START_PRINT`.
struct Word {
    letter: u8,
    /// The number after a single letter; `None` if the word is not letter + digits.
    number: Option<u32>,
    /// Bytes of the letter and the digits.
    len: usize,
}

impl Word {
    fn of(command: &[u8]) -> Self {
        let letter = command.first().map_or(0, u8::to_ascii_uppercase);
        let digits = command.iter().skip(1).take_while(|b| b.is_ascii_digit()).count();
        let number = command
            .get(1..=digits)
            .filter(|d| !d.is_empty())
            .and_then(|d| std::str::from_utf8(d).ok())
            .and_then(|d| d.parse().ok());
        Self { letter, number, len: 1 + digits }
    }

    /// Letter and number if this is a G, M or T code.
    fn code(&self) -> Option<(u8, u32)> {
        let number = self.number?;
        matches!(self.letter, b'G' | b'M' | b'T').then_some((self.letter, number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn framed(n: u32, command: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        frame(n, command, &mut out);
        out
    }

    #[test]
    fn frames_known_lines() {
        let check = |n, command: &str, expect: &str| {
            assert_eq!(framed(n, command.as_bytes()), expect.as_bytes());
        };
        // The first is the reset line that every Marlin host sends.
        check(0, "M110 N0", "N0 M110 N0*125\n");
        check(1, "G28", "N1 G28*18\n");
        check(4_294_967_295, "M105", "N4294967295 M105*26\n");
    }

    #[test]
    fn sends_commands_only() {
        let check = |line: &str, expect: Option<&str>| {
            let mut scratch = Vec::new();
            let got = sendable(line.as_bytes(), &mut scratch);
            assert_eq!(got, expect.map(str::as_bytes), "{line:?}");
        };
        check("", None);
        check(" \t\r\n", None);
        check("; only a comment", None);
        check("(only a comment)", None);
        check("G1 X1 ; move", Some("G1 X1"));
        check("  G1 X1\r", Some("G1 X1"));
        check("G1 (to the left) X1", Some("G1  X1"));
        check("G1 X1 (a (nested) one) Y2", Some("G1 X1  Y2"));
        check("G1 X1 (never closed Y2", Some("G1 X1"));
        check("M117 50% (2/4)", Some("M117 50% (2/4)"));
        check("M118 A1 (hi)", Some("M118 A1 (hi)"));
        check("M486 AArm (left)", Some("M486 AArm (left)"));
        check("M23 part(1).gco", Some("M23 part(1).gco"));
        check("EXCLUDE_OBJECT_START NAME=a(1)", Some("EXCLUDE_OBJECT_START NAME=a(1)"));
        check("G10 P\"(kept)\" (gone)", Some("G10 P\"(kept)\""));
        check("M117 a\\b", Some("M117 ab"));
        check("\\", None);
        check("G1\tX1", Some("G1 X1"));
        check("G1 X\r1", Some("G1 X1"));
        check("g1 x1 e.5", Some("G1 X1 E.5"));
        check("m117 Hello", Some("M117 Hello"));
        check("start_print bed=60", Some("start_print bed=60"));
        check("N12 G1 X1*57", Some("G1 X1"));
        check("N12G1 X1", Some("G1 X1"));
        check("N12 N13G1 X1*57", Some("G1 X1"));
        check("N12", None);
        check("N12 ; comment", None);
        check("M110 N0*125", Some("M110 N0*125"));
        check("N7 M117 2*3", Some("M117 2"));
        check("M117 2*3", Some("M117 2*3"));
        check("NEXT_OBJECT", Some("NEXT_OBJECT"));
    }

    #[test]
    fn limits_lines() {
        let check = |n, command: &str, expect: Result<&str, usize>| {
            let got = fit(n, command.as_bytes(), Some(95));
            let expect = expect.map(str::as_bytes).map_err(|framed_len| TooLong { framed_len, max_line: 95 });
            assert_eq!(got, expect);
        };
        let run = |head: &str, len: usize| format!("{head}{}", "x".repeat(len - head.len()));
        // `N1 ` and `*123` are 7 characters.
        check(1, &run("G1 X", 88), Ok(&run("G1 X", 88)));
        check(1, &run("G1 X", 89), Err(96));
        check(10, &run("G1 X", 88), Err(96));
        check(1, &run("M117 ", 400), Ok(&run("M117 ", 88)));
        check(1, &run("M118 A1 ", 89), Ok(&run("M118 A1 ", 88)));
        check(1, &run("M1170 ", 89), Err(96));
        // 83 + 2-byte characters: the cut falls inside one.
        let text = format!("M117 x{}", "é".repeat(60));
        check(1, &text, Ok(&format!("M117 x{}", "é".repeat(41))));
        assert_eq!(fit(1, &[b'G'; 4000], None), Ok(&[b'G'; 4000][..]));
        assert!(fit(1, b"M117 hello", Some(8)).is_err());
    }

    proptest! {
        #[test]
        fn a_frame_holds_its_checksum(n: u32, command in "[!-~][ -~]{0,60}") {
            let line = framed(n, command.as_bytes());
            let star = line.iter().rposition(|b| *b == b'*').unwrap();
            let sum: u8 = std::str::from_utf8(&line[star + 1..line.len() - 1]).unwrap().parse().unwrap();
            prop_assert_eq!(xor(&line[..star]), sum);
            prop_assert!(line.len() - 1 <= framed_len(n, command.len()));
            prop_assert!(line.len() - 1 + 2 >= framed_len(n, command.len()));
        }

        #[test]
        fn what_is_sent_is_clean_and_stays_so(line: Vec<u8>) {
            let mut scratch = Vec::new();
            if let Some(command) = sendable(&line, &mut scratch) {
                prop_assert!(!command.is_empty());
                prop_assert!(command.iter().all(|b| *b >= b' ' && *b != b';' && *b != b'\\'));
                prop_assert!(command.len() <= line.len());
            }
        }

        #[test]
        fn sending_what_is_sendable_changes_nothing(line in "[GMT][0-9]{1,3}( [A-Z][0-9.-]{1,5}){0,6}") {
            let mut scratch = Vec::new();
            prop_assert_eq!(sendable(line.as_bytes(), &mut scratch), Some(line.as_bytes()));
        }

        #[test]
        fn a_shortened_text_fits_and_is_a_prefix(text in "\\PC{0,200}", n: u32) {
            let command = format!("M117 {text}");
            let cut = fit(n, command.as_bytes(), Some(95)).unwrap();
            prop_assert!(framed_len(n, cut.len()) <= 95);
            prop_assert!(command.as_bytes().starts_with(cut));
            prop_assert!(std::str::from_utf8(cut).is_ok());
        }
    }
}
