//! The emergency parser: M108, M112, M410 and M876 as the bytes arrive.
//!
//! Looks at every byte that the receiver gets, before any queue, and says at
//! a line's end what must happen now. Marlin runs it in the receive
//! interrupt. Knows nothing of what then happens.

/// What must happen at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Emergency {
    /// M108: whatever waits for heat or the user goes on.
    GoOn,
    /// M112: everything off, halt.
    Kill,
    /// M410: motion stops, what was planned is dropped.
    QuickStop,
    /// M876 S…: the user answered a prompt.
    Answer,
}

/// Longest line start that is looked at: `N`, a number, blanks and `M112`.
/// What is longer is no emergency.
const HEAD_BYTES: usize = 32;

/// Keeps the beginning of the present line.
#[derive(Debug, Default)]
pub(crate) struct EmergencyParser {
    head: Vec<u8>,
}

impl EmergencyParser {
    /// Takes bytes none of which ends a line.
    pub(crate) fn take_run(&mut self, run: &[u8]) {
        let room = HEAD_BYTES - self.head.len();
        self.head.extend_from_slice(&run[..run.len().min(room)]);
    }

    /// Takes one byte; an emergency is known at its line's end.
    pub(crate) fn take(&mut self, byte: u8) -> Option<Emergency> {
        if byte != b'\n' && byte != b'\r' {
            if self.head.len() < HEAD_BYTES {
                self.head.push(byte);
            }
            return None;
        }
        let found = classify(&self.head);
        self.head.clear();
        found
    }
}

fn classify(line: &[u8]) -> Option<Emergency> {
    let mut line = super::line::trim_start(line);
    if let Some(after) = line.strip_prefix(b"N") {
        let number = after.iter().take_while(|b| b.is_ascii_digit() || matches!(b, b'-' | b' ')).count();
        line = &after[number..];
    }
    let code = line.strip_prefix(b"M")?;
    let digits = code.iter().take_while(|b| b.is_ascii_digit()).count();
    let rest = super::line::trim_start(&code[digits..]);
    // Only a blank, a checksum or a comment may follow.
    let bare = matches!(rest.first(), None | Some(b'*' | b';'));
    match &code[..digits] {
        b"108" if bare => Some(Emergency::GoOn),
        b"112" if bare => Some(Emergency::Kill),
        b"410" if bare => Some(Emergency::QuickStop),
        b"876" if rest.first() == Some(&b'S') => Some(Emergency::Answer),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(input: &str, expect: &[Emergency]) {
        let mut parser = EmergencyParser::default();
        let found: Vec<_> = input.bytes().filter_map(|b| parser.take(b)).collect();
        assert_eq!(found, expect, "{input:?}");
    }

    #[test]
    fn emergencies_are_seen_at_the_line_end() {
        use Emergency::*;
        check("M112\n", &[Kill]);
        check("M112", &[]);
        check("G1 X1\nM112\nM108\r\n", &[Kill, GoOn]);
        check("N55 M410*77\n", &[QuickStop]);
        check("  M112 ; now\n", &[Kill]);
        check("M876 S0\n", &[Answer]);
        check("M876\nM1120\nM11\nG1 M112\nM117 M112\nm112\n", &[]);
        check(&format!("{}M112\n", " ".repeat(200)), &[]);
    }
}
