//! Bytes from the wire, in whatever pieces they come, into lines.
//!
//! Takes chunks, gives each complete line once, without its end, without NULs
//! and without blanks around it. Knows nothing of what lines mean.

/// Longest reply kept. Marlin's longest, the identity after M115, is about 300
/// bytes; the rest of a longer line is dropped, so that noise without line feeds
/// cannot grow the memory.
pub const MAX_REPLY_LEN: usize = 1024;

/// Collects bytes until a line is whole. An incomplete line is "not yet".
#[derive(Debug, Default)]
pub struct LineSplitter {
    /// The start of a line whose end has not come.
    partial: Vec<u8>,
}

impl LineSplitter {
    /// Takes the next bytes and calls `each` with every line that they complete.
    ///
    /// Both `\n` and `\r\n` end a line; empty lines are left out.
    pub fn push(&mut self, mut bytes: &[u8], mut each: impl FnMut(&[u8])) {
        while let Some(end) = memchr::memchr2(b'\n', b'\r', bytes) {
            let (head, rest) = (&bytes[..end], &bytes[end + 1..]);
            // The usual case copies nothing: the whole line lies in this chunk.
            if self.partial.is_empty() && memchr::memchr(0, head).is_none() {
                give(&head[..head.len().min(MAX_REPLY_LEN)], &mut each);
            } else {
                self.keep(head);
                give(&self.partial, &mut each);
                self.partial.clear();
            }
            bytes = rest;
        }
        self.keep(bytes);
    }

    /// Drops the beginning of a line whose end has not come.
    pub fn forget(&mut self) {
        self.partial.clear();
    }

    fn keep(&mut self, bytes: &[u8]) {
        let room = MAX_REPLY_LEN - self.partial.len();
        // A board that is switched on puts NULs on the line; no reply has any.
        self.partial.extend(bytes.iter().filter(|b| **b != 0).take(room));
    }
}

fn give(line: &[u8], each: &mut impl FnMut(&[u8])) {
    let line = line.trim_ascii();
    if !line.is_empty() {
        each(line);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lines(chunks: &[&[u8]]) -> Vec<Vec<u8>> {
        let mut splitter = LineSplitter::default();
        let mut got = Vec::new();
        for chunk in chunks {
            splitter.push(chunk, |line| got.push(line.to_vec()));
        }
        got
    }

    #[test]
    fn splits_lines() {
        let check = |chunks: &[&[u8]], expect: &[&[u8]]| assert_eq!(lines(chunks), expect);
        check(&[b"ok\n"], &[b"ok"]);
        check(&[b"o", b"k", b"\r", b"\n"], &[b"ok"]);
        check(&[b"ok"], &[]);
        check(&[b"\n\r\n  \n ok \n"], &[b"ok"]);
        check(&[b"\0\0start\n"], &[b"start"]);
        check(&[b"\xff\xfe\nok\n"], &[b"\xff\xfe", b"ok"]);
        let long = [b'x'; 3 * MAX_REPLY_LEN];
        check(&[&long, b"\nok\n"], &[&long[..MAX_REPLY_LEN], b"ok"]);
        let mut whole = long.to_vec();
        whole.push(b'\n');
        check(&[&whole], &[&long[..MAX_REPLY_LEN]]);
    }

    proptest! {
        #[test]
        fn pieces_do_not_matter(
            bytes in prop::collection::vec(prop_oneof![Just(b'\n'), Just(b'\r'), Just(0), any::<u8>()], 0..300),
            cuts in prop::collection::vec(1_usize..40, 1..20),
        ) {
            let mut pieces = Vec::new();
            let mut rest = &bytes[..];
            for cut in cuts {
                let (head, tail) = rest.split_at(cut.min(rest.len()));
                pieces.push(head);
                rest = tail;
            }
            pieces.push(rest);
            prop_assert_eq!(lines(&pieces), lines(&[&bytes]));
        }
    }
}
