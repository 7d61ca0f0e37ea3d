//! MeatPack: G-code text with its 15 commonest characters in half a byte each.
//!
//! Takes and gives the data of one block; each begins anew. By Scott Mudge's
//! scheme as libbgcode uses it:
//! - a byte holds two characters, the first in its lower half; a half of 15 says
//!   that the character follows as a whole byte (the first's before the second's)
//! - `255 255 c` is a command: 251 and 250 switch packing on and off, 247 and 246
//!   switch to and from "no spaces", where the half byte of a space is an `E`; 249
//!   resets
//! - a packed line feed in the first half ends the byte: the second half fills up
//!
//! libbgcode's encoder takes the spaces out of motions, and its decoder drops blank
//! lines and puts a space before each of `X Y Z E F I J R G P W H C A S` in a line
//! that begins with `G` (older versions have fewer letters). Ours gives the same text
//! for every line that begins with a `G` and a digit. Where another line begins with
//! a `G` (a macro's name), libbgcode tears it apart with spaces; firmware does not,
//! nor do we.
//!
//! Does not know what the commands mean. The crate `meatpack` 0.1 (its first
//! release) puts no spaces back, so that its text is not what libbgcode gives.
use super::error::Fault;

const SIGNAL: u8 = 0xFF;
const ENABLE_PACKING: u8 = 251;
const DISABLE_PACKING: u8 = 250;
const RESET_ALL: u8 = 249;
const ENABLE_NO_SPACES: u8 = 247;
const DISABLE_NO_SPACES: u8 = 246;

/// The characters of the half bytes 0 to 14; the twelfth is the space's, or the `E`'s.
const PACKED: [u8; 15] = *b"0123456789. \nGX";

/// The half byte of a space, or of an `E`.
const SPACE: u8 = 11;

/// The half byte that says that a whole one follows.
const WHOLE: u8 = 15;

/// Words that get a space before them in a line of `G` and a number.
const PARAMETERS: &[u8] = b"XYZEFIJRGPWHCAS";

/// Puts the spaces back and drops blank lines.
#[derive(Debug, Default)]
struct Spacer {
    /// The last byte that was given; none at the beginning of a block.
    last: Option<u8>,
    /// The line began with a `G` just now: a digit decides.
    begun: bool,
    /// The line begins with a `G` and a digit.
    spaced: bool,
}

impl Spacer {
    fn put(&mut self, byte: u8, out: &mut Vec<u8>) {
        let at_start = matches!(self.last, None | Some(b'\n'));
        if byte == b'\n' {
            // A line feed before all else stays, as libbgcode has it.
            if self.last == Some(b'\n') {
                return;
            }
            (self.begun, self.spaced) = (false, false);
        } else if at_start {
            (self.begun, self.spaced) = (byte == b'G', false);
        } else {
            if self.begun {
                (self.begun, self.spaced) = (false, byte.is_ascii_digit());
            }
            if self.spaced && self.last != Some(b' ') && PARAMETERS.contains(&byte) {
                out.push(b' ');
            }
        }
        out.push(byte);
        self.last = Some(byte);
    }
}

/// Unpacks the data of one block, in pieces as they come.
#[derive(Debug, Default)]
pub(super) struct Unpacker {
    packing: bool,
    no_spaces: bool,
    /// Signal bytes seen: a second one makes the next byte a command.
    signals: u8,
    command: bool,
    /// Whole bytes to come for the packed byte before.
    whole: u8,
    /// The second character, while the first is still to come.
    second: Option<u8>,
    spacer: Spacer,
}

impl Unpacker {
    /// Unpacks a piece; the text goes to the end of `out`, at most 4 bytes for each.
    pub(super) fn unpack(&mut self, data: &[u8], out: &mut Vec<u8>) {
        for &byte in data {
            self.byte(byte, out);
        }
    }

    fn byte(&mut self, byte: u8, out: &mut Vec<u8>) {
        if byte == SIGNAL {
            if self.signals > 0 {
                self.command = true;
                self.signals = 0;
            } else {
                self.signals = 1;
            }
        } else if self.command {
            self.command = false;
            self.obey(byte);
        } else {
            if self.signals > 0 {
                // It was none: two whole characters follow.
                self.signals = 0;
                self.character(SIGNAL, out);
            }
            self.character(byte, out);
        }
    }

    fn obey(&mut self, command: u8) {
        match command {
            ENABLE_PACKING => self.packing = true,
            // libbgcode leaves "no spaces" on; firmware resets it. Its encoder asks for a reset at the end alone.
            DISABLE_PACKING | RESET_ALL => self.packing = false,
            ENABLE_NO_SPACES => self.no_spaces = true,
            DISABLE_NO_SPACES => self.no_spaces = false,
            _ => {}
        }
    }

    fn character(&mut self, byte: u8, out: &mut Vec<u8>) {
        if !self.packing {
            self.spacer.put(byte, out);
        } else if self.whole > 0 {
            self.whole -= 1;
            self.spacer.put(byte, out);
            if let Some(second) = self.second.take() {
                self.spacer.put(second, out);
            }
        } else {
            let (first, second) = (byte & 15, byte >> 4);
            if first == WHOLE {
                self.whole = 1 + u8::from(second == WHOLE);
                self.second = self.half(second);
                return;
            }
            let first = self.half(first).unwrap_or_default();
            self.spacer.put(first, out);
            if first == b'\n' {
                return;
            }
            match self.half(second) {
                Some(second) => self.spacer.put(second, out),
                None => self.whole = 1,
            }
        }
    }

    fn half(&self, half: u8) -> Option<u8> {
        match half {
            WHOLE => None,
            SPACE if self.no_spaces => Some(b'E'),
            half => PACKED.get(usize::from(half)).copied(),
        }
    }
}

/// Packs the text of one block, which begins and ends with a line's. With
/// `comments`, lines that are comments stay; comments behind commands and blank
/// lines go in any case. A line without an end gets one, unless it is a comment.
///
/// # Errors
/// [`Fault::Unpackable`].
pub(super) fn pack(text: &[u8], comments: bool) -> Result<Vec<u8>, Fault> {
    if memchr::memchr(SIGNAL, text).is_some() {
        return Err(Fault::Unpackable);
    }
    let out = Vec::with_capacity(text.len() * 2 / 3 + 9);
    let mut packer = Packer { out, packing: true, bare: Vec::new(), again: Vec::new() };
    packer.command(ENABLE_PACKING);
    packer.command(ENABLE_NO_SPACES);
    for line in crate::line::split_lines(text) {
        packer.line(line, comments);
    }
    if !comments {
        packer.command(RESET_ALL);
    }
    Ok(packer.out)
}

struct Packer {
    out: Vec<u8>,
    packing: bool,
    /// Room for a line without its spaces, and with them again.
    bare: Vec<u8>,
    again: Vec<u8>,
}

impl Packer {
    fn command(&mut self, command: u8) {
        self.out.extend_from_slice(&[SIGNAL, SIGNAL, command]);
    }

    fn line(&mut self, line: &[u8], comments: bool) {
        if line.trim_ascii_start().starts_with(b";") {
            if comments {
                if std::mem::replace(&mut self.packing, false) {
                    self.command(DISABLE_PACKING);
                }
                self.out.extend_from_slice(line);
            }
            return;
        }
        let mut code = line.strip_suffix(b"\n").unwrap_or(line);
        if let Some(at) = memchr::memchr(b';', code) {
            code = code[..at].trim_ascii_end();
        }
        if code.trim_ascii().is_empty() {
            return;
        }
        if !std::mem::replace(&mut self.packing, true) {
            self.command(ENABLE_PACKING);
        }
        if self.without_spaces(code) {
            pairs(&self.bare, &mut self.out);
        } else {
            pairs(code, &mut self.out);
        }
    }

    /// A motion without its spaces into `bare`, if the decoder puts back just these.
    fn without_spaces(&mut self, code: &[u8]) -> bool {
        if !matches!(code, [b'G', digit, ..] if digit.is_ascii_digit()) {
            return false;
        }
        self.bare.clear();
        self.again.clear();
        let mut spacer = Spacer::default();
        for &byte in code.iter().filter(|b| **b != b' ') {
            self.bare.push(byte);
            spacer.put(byte, &mut self.again);
        }
        self.again == code
    }
}

/// A line and its end, two characters at a time.
fn pairs(code: &[u8], out: &mut Vec<u8>) {
    let mut characters = code.iter().copied().chain([b'\n']);
    while let Some(first) = characters.next() {
        let second = characters.next().unwrap_or(b'\n');
        let (a, b) = (HALF[usize::from(first)], HALF[usize::from(second)]);
        out.push(a | (b << 4));
        if a == WHOLE {
            out.push(first);
        }
        if b == WHOLE {
            out.push(second);
        }
    }
}

/// The half byte of each character, where there are no spaces.
const HALF: [u8; 256] = {
    let mut table = [WHOLE; 256];
    let mut k = 0;
    while k < PACKED.len() {
        table[PACKED[k] as usize] = k as u8;
        k += 1;
    }
    table[b' ' as usize] = WHOLE;
    table[b'E' as usize] = SPACE;
    table
};

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn unpack(data: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        Unpacker::default().unpack(data, &mut out);
        assert!(out.len() <= data.len() * 4);
        out
    }

    const ON: &[u8] = b"\xff\xff\xfb";
    const BOTH_ON: &[u8] = b"\xff\xff\xfb\xff\xff\xf7";

    /// Packed by hand, from the table at the top.
    #[test]
    fn unpacks() {
        let check = |data: &[&[u8]], expect: &str| {
            let data = data.concat();
            let text = unpack(&data);
            assert_eq!(String::from_utf8_lossy(&text), expect, "{data:x?}");
            // However the data is cut.
            for at in 0..data.len() {
                let (mut pieces, mut unpacker) = (Vec::new(), Unpacker::default());
                unpacker.unpack(&data[..at], &mut pieces);
                unpacker.unpack(&data[at..], &mut pieces);
                assert_eq!(pieces, text, "{at}");
            }
        };
        check(&[b"G1 X1\n"], "G1 X1\n");
        // G1, X1, LF and filling.
        check(&[ON, b"\x1d\x1e\xcc"], "G1 X1\n");
        // M and its whole byte before the 8: "M8", "4\n".
        check(&[ON, b"\x8fM\xc4"], "M84\n");
        // G1, X., 5 and a whole Y, 2E, LF.
        check(&[BOTH_ON, b"\x1d\xae\xf5Y\xb2\xc0"], "G1 X.5 Y2 E0\n");
        // The half byte 11 is a space without the command.
        check(&[ON, b"\x1d\xeb\xc3"], "G1 X3\n");
        // Two whole ones: T, A.
        check(&[ON, b"\xffTA\xcc"], "TA\n");
        // Off again: a comment; on again.
        check(
            &[BOTH_ON, b"\x8fM\xc4\xff\xff\xfa;A B\n\xff\xff\xfb\x8fM\xc4\xff\xff\xf9"],
            "M84\n;A B\nM84\n",
        );
        // The second half after a line feed is nothing, even a whole one's.
        check(&[ON, b"\x1d\xfc\x1d\xcc"], "G1\nG1\n");
        // Blank lines go, but for one before all.
        check(&[b"\n\nG1\n\n\nG1\n\n"], "\nG1\nG1\n");
        // A line that begins with G and no digit is a name.
        check(&[b"GET_POSITION\nG28XYZ\nM1XY\nG1S1T1F2\n"], "GET_POSITION\nG28 X Y Z\nM1XY\nG1 S1T1 F2\n");
        // An unknown command is nothing; a signal alone is two whole characters.
        check(&[ON, b"\xff\xff\x01\xffaY\xcc"], "aY\n");
        check(&[b"\xffA\xff"], "\u{fffd}A");
    }

    /// The text that a printer gets.
    #[track_caller]
    fn check_pack(text: &str, comments: bool, expect: &str) {
        let packed = pack(text.as_bytes(), comments).unwrap();
        assert_eq!(String::from_utf8_lossy(&unpack(&packed)), expect, "{packed:x?}");
    }

    #[test]
    fn packs() {
        check_pack("G1 X1 Y2 E.5 F300\n", false, "G1 X1 Y2 E.5 F300\n");
        check_pack("G1 X1 ; right\n;TYPE:Perimeter\n\n", true, "G1 X1\n;TYPE:Perimeter\n");
        check_pack("G1 X1 ; right\n;TYPE:Perimeter\n\r\n", false, "G1 X1\n");
        check_pack(" ; far in\nM117 Hello  World E\n", true, " ; far in\nM117 Hello  World E\n");
        check_pack("G10 L2 S1\nG1  X1\nG1X1\n", true, "G10 L2 S1\nG1  X1\nG1 X1\n");
        check_pack("M84", true, "M84\n");
        check_pack("M84\n; the end", true, "M84\n; the end");
        check_pack("M486 AShape G1 E2\nG28 W\n", true, "M486 AShape G1 E2\nG28 W\n");
        assert_eq!(pack(b"G1 X1\n", true).unwrap(), [BOTH_ON, b"\x1d\x1e\xcc"].concat());
        assert_eq!(pack(b"G1 E1\n", false).unwrap(), [BOTH_ON, b"\x1d\x1b\xcc\xff\xff\xf9"].concat());
        assert!(matches!(pack(b"; \xff\n", true), Err(Fault::Unpackable)));
    }

    /// Commands without spaces and comments, and comments: what must be the same after packing.
    fn meaning(text: &[u8]) -> Vec<Vec<u8>> {
        let line = |line: &[u8]| match line.trim_ascii_start().first() {
            None => None,
            Some(b';') => Some(line.to_vec()),
            Some(_) => {
                let code = line.split(|b| *b == b';').next().unwrap_or_default();
                let code: Vec<u8> = code.iter().copied().filter(|b| !b.is_ascii_whitespace()).collect();
                (!code.is_empty()).then_some(code)
            }
        };
        text.split(|b| *b == b'\n').filter_map(line).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(128))]
        #[test]
        fn commands_stay(lines in prop::collection::vec("[GM]?[ -~]{0,24}", 0..12)) {
            let text = lines.join("\n").into_bytes();
            let once = unpack(&pack(&text, true).unwrap());
            prop_assert_eq!(meaning(&once), meaning(&text));
            // What was unpacked packs to itself.
            prop_assert_eq!(unpack(&pack(&once, true).unwrap()), once);
        }

        #[test]
        fn any_bytes_unpack(data in prop::collection::vec(prop_oneof![any::<u8>(), 240u8..=255], 0..200)) {
            unpack(&data);
        }
    }
}
