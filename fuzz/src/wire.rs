//! Framing: whatever a file holds, one line of it becomes at most one clean
//! frame on the wire.
//!
//! Takes the fuzzer's bytes as a line of a job. Fails by panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger_gcode::checksum;

/// What Marlin takes, framed.
const MAX_LINE: usize = 95;

fuzz_target!(|data: &[u8]| {
    let line = data.split(|&b| b == b'\n').next().unwrap_or_default();
    let mut scratch = Vec::new();
    let Some(command) = checksum::sendable(line, &mut scratch) else { return };
    assert!(!command.is_empty());
    let Ok(command) = checksum::fit(4_000_000_000, command, Some(MAX_LINE)) else { return };
    let mut frame = Vec::new();
    checksum::frame(4_000_000_000, command, &mut frame);
    assert_frame(&frame, command);
});

/// `N<n> <command>*<checksum>\n`, checked as a firmware would, with none of our code.
fn assert_frame(frame: &[u8], command: &[u8]) {
    let (end, body) = frame.split_last().expect("a frame");
    assert_eq!(*end, b'\n');
    assert!(body.len() <= MAX_LINE, "{} characters", body.len());
    assert!(!body.iter().any(|b| *b < b' ' || matches!(b, b';' | b'\\' | 0x7f)), "unclean: {body:?}");
    let star = body.iter().rposition(|&b| b == b'*').expect("a checksum");
    let sum = body[..star].iter().fold(0, |sum, b| sum ^ b);
    assert_eq!(std::str::from_utf8(&body[star + 1..]), Ok(sum.to_string().as_str()));
    let text = body[..star].strip_prefix(b"N4000000000 ").expect("the number");
    assert_eq!(text, command);
    // An N at the start would be taken for a second line number.
    assert!(
        !(text[0].eq_ignore_ascii_case(&b'N') && text.get(1).is_some_and(u8::is_ascii_digit)),
        "{text:?}"
    );
}
