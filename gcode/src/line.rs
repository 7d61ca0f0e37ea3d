//! One line of G-code, parsed without loss.
//!
//! Takes bytes (no UTF-8 assumed, nothing allocated), gives a [`Line`] whose
//! slices lie side by side and together are the input: `write(parse(x)) == x`
//! for every input. Parsing is total: what is not understood stays as bytes.
//! Knows no dialect and no machine state.
use crate::number::decimal;
use nom::{
    IResult, Parser,
    bytes::complete::{tag_no_case, take_while, take_while1},
    character::complete::{digit1, satisfy},
    combinator::{opt, recognize},
};

/// Words kept of one line; a motion has at most X Y Z E F I J K R P.
pub const MAX_WORDS: usize = 12;

/// A letter and its number: `X10.5`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Word {
    /// Upper-case letter.
    pub letter: u8,
    /// `None` for a letter alone, as in `G28 X`.
    pub value: Option<f64>,
    /// Digits after the point, as written.
    pub decimals: u8,
    /// No zero before the point, as written.
    pub bare_point: bool,
    /// Where the number stands in the line's `args`; see [`Line::written`].
    span: (u16, u16),
}

const NO_WORD: Word = Word { letter: 0, value: None, decimals: 0, bare_point: false, span: (0, 0) };

/// The words of a command, in the order of the line.
#[derive(Clone, Copy, Debug)]
pub struct Words {
    list: [Word; MAX_WORDS],
    len: u8,
    /// False when something in the arguments is not a word, or there are too many.
    pub complete: bool,
}

impl Words {
    const NONE: Words = Words { list: [NO_WORD; MAX_WORDS], len: 0, complete: true };

    /// The value of the first word with this letter.
    #[must_use]
    pub fn get(&self, letter: u8) -> Option<f64> {
        self.as_slice().iter().find(|w| w.letter == letter).and_then(|w| w.value)
    }

    /// Whether a word with this letter is there, with a value or without.
    #[must_use]
    pub fn has(&self, letter: u8) -> bool {
        self.as_slice().iter().any(|w| w.letter == letter)
    }

    /// All words.
    #[must_use]
    pub fn as_slice(&self) -> &[Word] {
        &self.list[..self.len as usize]
    }
}

/// What a line commands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command<'a> {
    /// Blank or a comment alone.
    None,
    /// `G`, `M` or `T` and a number.
    Classic {
        /// Upper-case `G`, `M` or `T`.
        letter: u8,
        /// At most 65535.
        number: u16,
        /// `M862.3` has 3.
        sub: Option<u16>,
    },
    /// A word of another form: Klipper's `EXCLUDE_OBJECT_START`, Prusa's `Tx`.
    Named(&'a [u8]),
    /// Not a command.
    Unknown,
}

impl Command<'_> {
    /// A command without a sub-number.
    #[must_use]
    pub const fn classic(letter: u8, number: u16) -> Command<'static> {
        Command::Classic { letter, number, sub: None }
    }
}

/// A line in parts that lie side by side in the input.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    /// Blanks at the start.
    pub indent: &'a [u8],
    /// `N123 ` with the blanks after it, or empty.
    pub number: &'a [u8],
    /// The command word as written, or empty.
    pub head: &'a [u8],
    /// Everything between the command and the checksum or comment.
    pub args: &'a [u8],
    /// `*71` with what follows it up to the comment; only on numbered lines.
    pub checksum: &'a [u8],
    /// From `;` on, or empty. Comments in parentheses stay in `args`.
    pub comment: &'a [u8],
    /// `\n`, `\r\n` or empty (the last line of a file).
    pub ending: &'a [u8],
    /// What `head` says.
    pub command: Command<'a>,
    /// What `args` says; empty where the argument is text (M117 …) or the command is named.
    pub words: Words,
}

impl<'a> Line<'a> {
    /// The line number of `N123`, when it fits.
    #[must_use]
    pub fn line_number(&self) -> Option<u32> {
        let digits = self.number.get(1..)?.trim_ascii();
        std::str::from_utf8(digits).ok()?.parse().ok()
    }

    /// The comment without `;` and the blanks around it.
    #[must_use]
    pub fn comment_text(&self) -> &'a [u8] {
        self.comment.get(1..).unwrap_or_default().trim_ascii()
    }

    /// The number of one of this line's words as written (`.500`), empty for a letter alone.
    #[must_use]
    pub fn written(&self, word: &Word) -> &'a [u8] {
        self.args.get(usize::from(word.span.0)..usize::from(word.span.1)).unwrap_or_default()
    }

    /// Whether the line is a comment and nothing else.
    #[must_use]
    pub fn is_comment(&self) -> bool {
        self.command == Command::None && !self.comment.is_empty()
    }

    /// The text of an argument that is text (M117), or of a named command.
    #[must_use]
    pub fn text(&self) -> &'a [u8] {
        self.args.trim_ascii()
    }
}

/// Commands whose argument is text, not words.
const TEXT_ARGUMENT: [u16; 12] = [16, 20, 23, 28, 29, 30, 32, 117, 118, 532, 928, 486];

/// Parses one line, with its line ending if it has one. Never fails.
#[must_use]
pub fn parse(input: &[u8]) -> Line<'_> {
    let (body, ending) = split_ending(input);
    let (code, comment) = match memchr::memchr(b';', body) {
        Some(at) => body.split_at(at),
        None => (body, &body[body.len()..]),
    };
    let (code, indent) = blanks(code);
    let (code, number) = line_number(code).unwrap_or((code, &code[..0]));
    let (code, checksum) = if number.is_empty() { (code, &code[code.len()..]) } else { split_checksum(code) };
    let (args, (head, command)) = match classic(code).or_else(|_| named(code)) {
        Ok((args, found)) => (args, found),
        Err(_) if code.trim_ascii().is_empty() => (code, (&code[..0], Command::None)),
        Err(_) => (code, (&code[..0], Command::Unknown)),
    };
    let words = Words::NONE;
    let mut line = Line { indent, number, head, args, checksum, comment, ending, command, words };
    match command {
        Command::Classic { letter: b'M', number, .. } if TEXT_ARGUMENT.contains(&number) => {}
        Command::Classic { .. } => read_words(args, &mut line.words),
        _ => {}
    }
    line
}

/// Appends the line as it was read.
pub fn write(line: &Line<'_>, out: &mut Vec<u8>) {
    for part in [line.indent, line.number, line.head, line.args, line.checksum, line.comment, line.ending] {
        out.extend_from_slice(part);
    }
}

/// Cuts a buffer after each `\n`; the last piece may lack one. Nothing is lost.
pub fn split_lines(mut input: &[u8]) -> impl Iterator<Item = &[u8]> {
    std::iter::from_fn(move || {
        if input.is_empty() {
            return None;
        }
        let end = memchr::memchr(b'\n', input).map_or(input.len(), |at| at + 1);
        let (line, rest) = input.split_at(end);
        input = rest;
        Some(line)
    })
}

fn split_ending(input: &[u8]) -> (&[u8], &[u8]) {
    let mut end = input.len();
    if input.ends_with(b"\n") {
        end -= 1;
        if input[..end].ends_with(b"\r") {
            end -= 1;
        }
    }
    input.split_at(end)
}

fn is_blank(b: u8) -> bool {
    b == b' ' || b == b'\t'
}

fn blanks(input: &[u8]) -> (&[u8], &[u8]) {
    let end = input.iter().position(|&b| !is_blank(b)).unwrap_or(input.len());
    (&input[end..], &input[..end])
}

/// `N123` and the blanks after it.
fn line_number(input: &[u8]) -> IResult<&[u8], &[u8]> {
    recognize((tag_no_case("N"), digit1, take_while(is_blank))).parse(input)
}

/// The last `*` and digits, blanks after them allowed.
fn split_checksum(code: &[u8]) -> (&[u8], &[u8]) {
    let Some(at) = memchr::memrchr(b'*', code) else { return (code, &code[code.len()..]) };
    let digits = code[at + 1..].trim_ascii();
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return (code, &code[code.len()..]);
    }
    code.split_at(at)
}

/// `G1`, `M862.3`, `T0`; the number must be followed by no letter of a longer name.
fn classic(input: &[u8]) -> IResult<&[u8], (&[u8], Command<'_>)> {
    let (rest, letter) = satisfy(|c| matches!(c, 'G' | 'M' | 'T' | 'g' | 'm' | 't')).parse(input)?;
    let (rest, number) = small_number(rest)?;
    let (rest, sub) = match rest {
        [b'.', after @ ..] => {
            opt(small_number).parse(after).map(|(r, s)| if s.is_some() { (r, s) } else { (rest, None) })?
        }
        _ => (rest, None),
    };
    if matches!(rest.first(), Some(b'_')) {
        return Err(nom::Err::Error(nom::error::Error::new(input, nom::error::ErrorKind::Char)));
    }
    let head = &input[..input.len() - rest.len()];
    let letter = (letter as u8).to_ascii_uppercase();
    Ok((rest, (head, Command::Classic { letter, number, sub })))
}

fn small_number(input: &[u8]) -> IResult<&[u8], u16> {
    let (rest, digits) = digit1(input)?;
    let mut number: u32 = 0;
    for d in digits {
        number = number * 10 + u32::from(d - b'0');
        if number > u32::from(u16::MAX) {
            return Err(nom::Err::Error(nom::error::Error::new(input, nom::error::ErrorKind::TooLarge)));
        }
    }
    Ok((rest, number as u16))
}

/// A word of letters, digits and `_` that begins with a letter or `_`.
fn named(input: &[u8]) -> IResult<&[u8], (&[u8], Command<'_>)> {
    let (rest, head) = recognize((
        satisfy(|c| c.is_ascii_alphabetic() || c == '_'),
        take_while(|b: u8| b.is_ascii_alphanumeric() || b == b'_'),
    ))
    .parse(input)?;
    Ok((rest, (head, Command::Named(head))))
}

/// Reads `X10 Y-.5 E5F3000` with blanks and `(comments)` between; in place, for
/// the words are most of a line's size.
fn read_words(all: &[u8], words: &mut Words) {
    let mut args = all;
    loop {
        args = skip_blanks_and_parentheses(args);
        let Some((&letter, rest)) = args.split_first() else { return };
        if !letter.is_ascii_alphabetic() || usize::from(words.len) == MAX_WORDS {
            words.complete = false;
            return;
        }
        let mut word = Word { letter: letter.to_ascii_uppercase(), ..NO_WORD };
        args = rest;
        if let Ok((rest, number)) = decimal(rest) {
            word.value = Some(number.value);
            word.decimals = number.decimals;
            word.bare_point = number.bare_point;
            let at = |left: &[u8]| u16::try_from(all.len() - left.len()).unwrap_or(u16::MAX);
            word.span = (at(args), at(rest));
            args = rest;
        }
        words.list[usize::from(words.len)] = word;
        words.len += 1;
    }
}

/// Stops at a parenthesis that is never closed: that is no comment.
fn skip_blanks_and_parentheses(mut args: &[u8]) -> &[u8] {
    loop {
        match args.first() {
            Some(b' ' | b'\t' | b'\r') => args = &args[1..],
            Some(b'(') => match memchr::memchr(b')', args) {
                Some(at) => args = &args[at + 1..],
                None => return args,
            },
            _ => return args,
        }
    }
}

/// `NAME=value` arguments of Klipper's commands.
///
/// # Errors
/// No name followed by `=` at the start.
pub fn key_value(input: &[u8]) -> IResult<&[u8], (&[u8], &[u8])> {
    let (rest, _) = take_while(is_blank).parse(input)?;
    let (rest, key) = take_while1(|b: u8| b.is_ascii_alphanumeric() || b == b'_').parse(rest)?;
    let (rest, _) = nom::bytes::complete::tag("=").parse(rest)?;
    let (rest, value) = take_while(|b: u8| !is_blank(b)).parse(rest)?;
    Ok((rest, (key, value)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// `command head|args|checksum|comment` and the words.
    fn check(input: &str, command: Command<'_>, words: &[(char, Option<f64>)]) {
        let line = parse(input.as_bytes());
        assert_eq!(line.command, command, "{input}");
        let got: Vec<_> = line.words.as_slice().iter().map(|w| (w.letter as char, w.value)).collect();
        assert_eq!(got, words, "{input}");
        round_trip(input.as_bytes());
    }

    fn round_trip(input: &[u8]) {
        let mut out = Vec::new();
        write(&parse(input), &mut out);
        assert_eq!(out, input);
    }

    const G1: Command<'static> = Command::classic(b'G', 1);

    #[test]
    fn reads_lines() {
        check("G1 X10.5 Y-.5 E.01225\n", G1, &[('X', Some(10.5)), ('Y', Some(-0.5)), ('E', Some(0.01225))]);
        check(
            "G1 F3000 X1 Y2 E3 ; infill\r\n",
            G1,
            &[('F', Some(3000.0)), ('X', Some(1.0)), ('Y', Some(2.0)), ('E', Some(3.0))],
        );
        check("g01X10E5", Command::classic(b'G', 1), &[('X', Some(10.0)), ('E', Some(5.0))]);
        check("G1  X1", G1, &[('X', Some(1.0))]);
        check("G1 X1 (to the left) Y2", G1, &[('X', Some(1.0)), ('Y', Some(2.0))]);
        check("G28 X Y ; home", Command::classic(b'G', 28), &[('X', None), ('Y', None)]);
        check("N12 G1 X3*71\n", G1, &[('X', Some(3.0))]);
        check("M117 50% * of; it", Command::classic(b'M', 117), &[]);
        check("M486 Apart_1.stl", Command::classic(b'M', 486), &[]);
        check(
            "M862.3 P \"MK3S\"",
            Command::Classic { letter: b'M', number: 862, sub: Some(3) },
            &[('P', None)],
        );
        check("EXCLUDE_OBJECT_START NAME=part_0", Command::Named(b"EXCLUDE_OBJECT_START"), &[]);
        check("Tx", Command::Named(b"Tx"), &[]);
        check("G1_PARK", Command::Named(b"G1_PARK"), &[]);
        check("T1", Command::classic(b'T', 1), &[]);
        check(";LAYER:3\n", Command::None, &[]);
        check("", Command::None, &[]);
        check("  \t\n", Command::None, &[]);
        check("G99999999999 X1", Command::Named(b"G99999999999"), &[]);
        check("\u{fffd}\u{0}%", Command::Unknown, &[]);
    }

    #[test]
    fn numbered_lines() {
        let line = parse(b"N12 G1 X3 *71 ; x\n");
        assert_eq!(line.line_number(), Some(12));
        assert_eq!(line.checksum, b"*71 ");
        assert_eq!(line.comment_text(), b"x");
        assert_eq!(parse(b"N99999999999 G1").line_number(), None);
        assert_eq!(parse(b"G1 X3*71").checksum, b"");
    }

    #[test]
    fn words_that_are_not_whole_say_so() {
        assert!(!parse(b"G1 X1 #2").words.complete);
        assert!(!parse(b"G1 X1 (to the left Y2").words.complete);
        assert!(!parse(b"G1 A1B1C1D1E1F1G1H1I1J1K1L1M1").words.complete);
        assert!(parse(b"G1 XNaN").words.get(b'X').is_none());
    }

    #[test]
    fn words_keep_how_they_were_written() {
        let line = parse(b"G1  X1.500 (c) Y E.5");
        let written: Vec<_> = line.words.as_slice().iter().map(|w| line.written(w)).collect();
        assert_eq!(written, [&b"1.500"[..], b"", b".5"]);
    }

    #[test]
    fn klipper_arguments() {
        let (rest, (key, value)) = key_value(b" NAME=part_0 POLYGON=[[0,0]]").unwrap();
        assert_eq!((key, value), (&b"NAME"[..], &b"part_0"[..]));
        assert_eq!(key_value(rest).unwrap().1.0, b"POLYGON");
    }

    proptest! {
        #[test]
        fn every_input_round_trips(bytes: Vec<u8>) {
            round_trip(&bytes);
        }

        #[test]
        fn lines_like_g_code_round_trip(text in "[ \t]?(N[0-9]{1,4} ?)?[GMT][0-9.]{0,5}( ?[XYZEFIJ][-+.0-9eE]{0,9}| \\([^)]{0,4}\\)?|\\*[0-9]{0,3}){0,8}[ ;*]{0,2}.{0,6}(\r?\n)?") {
            round_trip(text.as_bytes());
        }

        #[test]
        fn cutting_into_lines_loses_nothing(bytes: Vec<u8>) {
            let joined: Vec<u8> = split_lines(&bytes).flatten().copied().collect();
            prop_assert_eq!(joined, bytes);
        }
    }
}
