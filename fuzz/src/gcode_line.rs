//! The line parser: whatever the bytes, what is written is what was read, and
//! decimals are those that the standard library reads.
//!
//! Takes the fuzzer's bytes as one line and as a file of lines. Fails by panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger_gcode::{line, number};

fuzz_target!(|data: &[u8]| {
    // As one line, though line feeds may lie inside: the parser promises the same for it.
    round_trip(data);

    let mut whole = Vec::with_capacity(data.len());
    for piece in line::split_lines(data) {
        assert!(!piece.is_empty(), "an empty piece");
        assert!(!piece[..piece.len() - 1].contains(&b'\n'), "a line feed inside a line");
        round_trip(piece);
        whole.extend_from_slice(piece);
    }
    assert_eq!(whole, data, "the lines are not the file");

    decimal_agrees(data);
});

/// `write(parse(x)) == x`, and every view of the line can be asked for.
fn round_trip(input: &[u8]) {
    let parsed = line::parse(input);
    let mut written = Vec::with_capacity(input.len());
    line::write(&parsed, &mut written);
    assert_eq!(written, input, "{parsed:?}");

    let words = parsed.words.as_slice();
    assert!(words.len() <= line::MAX_WORDS);
    for word in words {
        assert!(word.letter.is_ascii_uppercase(), "{word:?}");
        assert!(word.value.is_none_or(|v| !v.is_nan()), "{word:?}");
        assert!(parsed.words.has(word.letter));
    }
    let _ = (parsed.line_number(), parsed.comment_text(), parsed.is_comment(), parsed.text());
}

/// The number at the start of the bytes is what `str::parse` makes of the same characters.
fn decimal_agrees(input: &[u8]) {
    let Ok((rest, found)) = number::decimal(input) else { return };
    let text = std::str::from_utf8(&input[..input.len() - rest.len()]).expect("digits are ASCII");
    let expected: f64 = text.parse().expect("a decimal");
    assert_eq!(found.value.to_bits(), expected.to_bits(), "{text}");
}
