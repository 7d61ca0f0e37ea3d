//! From bytes to checked lines, as Marlin 2.1.2 does it.
//!
//! Takes the bytes out of the receive buffer one at a time; gives, at each
//! line end, what is to be done with the line. Its checksum is its own: it
//! shares no code with the sender. Knows no command but M110.

/// Marlin's MAX_CMD_SIZE: a line keeps at most this many bytes less one, and
/// what is longer is cut without a word.
pub(crate) const MAX_CMD_SIZE: usize = 96;

/// Collects a line as `process_stream_char` does.
#[derive(Debug, Default)]
pub(crate) struct LineBuffer {
    bytes: Vec<u8>,
    /// A comment began or the line is full: the rest is skipped.
    skip: bool,
    /// The byte before was a backslash: this one is kept as it is.
    escaped: bool,
}

impl LineBuffer {
    /// Takes one byte; true when it ended a line that is not empty.
    pub(crate) fn take(&mut self, byte: u8) -> bool {
        if byte == b'\n' || byte == b'\r' {
            self.skip = false;
            self.escaped = false;
            return !self.bytes.is_empty();
        }
        if self.skip {
            return false;
        }
        if !std::mem::take(&mut self.escaped) {
            if byte == b'\\' {
                self.escaped = true;
                return false;
            }
            if byte == b';' {
                self.skip = true;
                return false;
            }
        }
        self.bytes.push(byte);
        self.skip = self.bytes.len() >= MAX_CMD_SIZE - 1;
        false
    }

    /// Takes bytes none of which ends a line.
    pub(crate) fn take_run(&mut self, run: &[u8]) {
        let plain = !self.skip && !self.escaped && !run.iter().any(|b| matches!(b, b';' | b'\\'));
        if plain && self.bytes.len() + run.len() < MAX_CMD_SIZE - 1 {
            self.bytes.extend_from_slice(run);
        } else {
            for &byte in run {
                self.take(byte);
            }
        }
    }

    /// The finished line; the buffer is empty afterwards.
    pub(crate) fn finish(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.bytes)
    }

    /// Forgets what has come of a line, as after an error.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
    }
}

/// What is to be done with a line.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// To the queue; with its number if it had one.
    Accept(Option<i64>),
    /// The last line or the one before, again: dropped without a word.
    Repeat,
    /// Not the next number.
    WrongNumber(i64),
    /// The checksum does not fit.
    WrongChecksum,
    /// A number but no checksum.
    NoChecksum,
}

/// The number of the last line that was accepted.
#[derive(Debug, Default)]
pub(crate) struct Numbering {
    pub(crate) last: i64,
}

impl Numbering {
    /// Judges a line and remembers its number if it is accepted.
    pub(crate) fn judge(&mut self, line: &[u8]) -> Verdict {
        let line = trim_start(line);
        if line.first() != Some(&b'N') {
            return Verdict::Accept(None);
        }
        let renumbers = find(line, b"M110").is_some();
        let number = renumbers
            .then(|| line.iter().skip(4).position(|&b| b == b'N'))
            .flatten()
            .map_or(&line[1..], |at| &line[4 + at + 1..]);
        let n = whole_number(number);
        if n != self.last.saturating_add(1) && !renumbers {
            if n == self.last || n == self.last.saturating_sub(1) {
                return Verdict::Repeat;
            }
            return Verdict::WrongNumber(n);
        }
        let Some(star) = line.iter().rposition(|&b| b == b'*') else {
            return Verdict::NoChecksum;
        };
        let sum = line[..star].iter().fold(0u8, |sum, b| sum ^ b);
        if whole_number(&line[star + 1..]) != i64::from(sum) {
            return Verdict::WrongChecksum;
        }
        self.last = n;
        Verdict::Accept(Some(n))
    }
}

/// The number of a line as it stands at its beginning, for scripted faults
/// and counts; unlike [`Numbering::judge`] it checks nothing.
pub(crate) fn number_of(line: &[u8]) -> Option<i64> {
    let line = trim_start(line);
    (line.first() == Some(&b'N') && line.get(1).is_some_and(u8::is_ascii_digit))
        .then(|| whole_number(&line[1..]))
}

/// As C's `strtol`: blanks, a sign, digits, then anything; saturates, and is
/// 0 where there is no digit.
pub(crate) fn whole_number(text: &[u8]) -> i64 {
    let text = trim_start(text);
    let (negative, digits) = match text.first() {
        Some(b'-') => (true, &text[1..]),
        Some(b'+') => (false, &text[1..]),
        _ => (false, text),
    };
    let value = digits
        .iter()
        .take_while(|b| b.is_ascii_digit())
        .fold(0i64, |n, b| n.saturating_mul(10).saturating_add(i64::from(b - b'0')));
    if negative { -value } else { value }
}

pub(crate) fn trim_start(text: &[u8]) -> &[u8] {
    let blanks = text.iter().take_while(|&&b| b == b' ').count();
    &text[blanks..]
}

fn find(text: &[u8], word: &[u8]) -> Option<usize> {
    text.windows(word.len()).position(|w| w == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(input: &[u8]) -> Vec<String> {
        let mut buffer = LineBuffer::default();
        let mut found = Vec::new();
        for &byte in input {
            if buffer.take(byte) {
                found.push(String::from_utf8_lossy(&buffer.finish()).into_owned());
            }
        }
        found
    }

    #[test]
    fn lines_are_cut_as_marlin_cuts_them() {
        assert_eq!(lines(b"G1 X1\r\n\n;c\nM105;x*3\n"), ["G1 X1", "M105"]);
        assert_eq!(lines(b"a\\;b\\\\c\\\nd\n"), ["a;b\\c", "d"]);
        assert_eq!(lines(b"  \n"), ["  "]);
        let long = [b'x'; 200];
        let mut input = long.to_vec();
        input.push(b'\n');
        assert_eq!(lines(&input), ["x".repeat(95)]);
        assert_eq!(lines(b"no end"), [""; 0]);
    }

    fn check(last: i64, line: &str, expect: Verdict, last_after: i64) {
        let mut numbering = Numbering { last };
        assert_eq!(numbering.judge(line.as_bytes()), expect, "{line:?}");
        assert_eq!(numbering.last, last_after, "{line:?}");
    }

    #[test]
    fn numbers_and_checksums_are_judged() {
        use Verdict::*;
        check(4, "N5 G1 X10*84", Accept(Some(5)), 5);
        check(4, "  N5 G1 X10*84", Accept(Some(5)), 5);
        check(4, "N5 G1 X10*85", WrongChecksum, 4);
        check(4, "N5 G1 X10", NoChecksum, 4);
        check(4, "N5 G1 X10*", WrongChecksum, 4);
        check(4, "N6 G1 X10*87", WrongNumber(6), 4);
        check(5, "N5 G1 X10*84", Repeat, 5);
        check(6, "N5 G1 X10*84", Repeat, 6);
        check(7, "N5 G1 X10*84", WrongNumber(5), 7);
        check(7, "G1 X10", Accept(None), 7);
        check(7, "M110 N77", Accept(None), 7);
        check(7, "N0 M110 N0*125", Accept(Some(0)), 0);
        check(7, "N-1 M110 N-1*125", Accept(Some(-1)), -1);
        check(7, "N5 M110*38", Accept(Some(5)), 5);
        check(7, "NOTE", WrongNumber(0), 7);
        check(7, "n8 G1", Accept(None), 7);
        check(7, "N99999999999999999999*1", WrongNumber(i64::MAX), 7);
    }

    proptest::proptest! {
        #[test]
        fn any_bytes_are_judged(input: Vec<u8>, last: i64) {
            let mut buffer = LineBuffer::default();
            let mut numbering = Numbering { last };
            for byte in input {
                if buffer.take(byte) {
                    let line = buffer.finish();
                    assert!(line.len() < MAX_CMD_SIZE);
                    numbering.judge(&line);
                }
            }
        }

        #[test]
        fn a_flipped_bit_never_passes(n in 1i64..1_000_000, x in 0..2000, bit in 0u8..8, at: usize) {
            let text = format!("N{n} G1 X{x}");
            let sum = text.bytes().fold(0, |s, b| s ^ b);
            let mut line = format!("{text}*{sum}").into_bytes();
            let mut numbering = Numbering { last: n - 1 };
            assert_eq!(numbering.judge(&line), Verdict::Accept(Some(n)));
            let at = 1 + at % (text.len() - 1);
            line[at] ^= 1 << bit;
            let mut numbering = Numbering { last: n - 1 };
            assert!(!matches!(numbering.judge(&line), Verdict::Accept(_)));
        }
    }
}
