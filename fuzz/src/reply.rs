//! The replies: whatever comes from the wire, however it is cut, is told apart
//! without a panic and always the same way.
//!
//! Takes the fuzzer's bytes: the first says how long the pieces are, the rest
//! is the wire. Fails by panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger::printer::lines::{LineSplitter, MAX_REPLY_LEN};
use outrigger::printer::reply::{self, Reply};

fuzz_target!(|data: &[u8]| {
    let Some((&size, wire)) = data.split_first() else { return };
    let whole = replies([wire]);
    let pieces = replies(wire.chunks(usize::from(size).max(1)));
    assert_eq!(whole, pieces, "cut into pieces of {size}");
});

/// Every reply on the wire, as text: a NaN temperature equals itself there.
fn replies<'a>(pieces: impl IntoIterator<Item = &'a [u8]>) -> Vec<String> {
    let mut splitter = LineSplitter::default();
    let mut found = Vec::new();
    for piece in pieces {
        splitter.push(piece, |line| {
            assert!(!line.is_empty() && line.len() <= MAX_REPLY_LEN);
            found.push(told_apart(line));
        });
    }
    found
}

/// The class of a line, checked against the plainest reading of it.
fn told_apart(line: &[u8]) -> String {
    let class = reply::parse(line);
    match &class {
        // What acknowledges a line must never be found in the middle of another.
        Reply::Ok(_) => assert!(line == b"ok" || line.starts_with(b"ok") && line[2].is_ascii_whitespace()),
        Reply::Resend(_) => assert!(line[0].eq_ignore_ascii_case(&b'r')),
        Reply::Start => assert_eq!(line, b"start"),
        Reply::Wait => assert_eq!(line, b"wait"),
        Reply::Fatal(text) | Reply::Error(text) => assert_eq!(*text, line),
        Reply::Other(text) => assert_eq!(*text, line),
        _ => {}
    }
    format!("{class:?}")
}
