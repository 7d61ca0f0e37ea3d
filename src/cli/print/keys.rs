//! What a user may want of a running job, as keys on the terminal.
//!
//! The terminal gives every key at once and shows none, from [`Keys::listen`] until
//! the handle is dropped, which a panic does as well. Ctrl-C stays a signal; Ctrl-Z does
//! nothing, for a job that sleeps starves its printer.
use crate::job::host::Request;
use crate::job::run::Mail;
use rustix::termios::{
    LocalModes, OptionalActions, SpecialCodeIndex, Termios, tcgetattr, tcgetpgrp, tcsetattr,
};
use std::io::{IsTerminal, Read};
use tokio::sync::mpsc;

/// What the keys are, for the line at the start.
pub(super) const HELP: &str = "keys: p pause, r resume or answer, 0-9 a button of a question, c cancel, \
                               ! emergency stop, h help; Ctrl-C cancels, twice quits";

/// A terminal whose value of a control character switches it off.
const NO_CHARACTER: u8 = 0;

/// What a key asks for; `None` for nothing that is known.
fn letter(key: u8) -> Option<Mail> {
    Some(match key {
        b'p' | b'P' => Mail::Ask(Request::Pause),
        b'r' | b'R' => Mail::Ask(Request::Resume),
        b'c' | b'C' => Mail::Ask(Request::Cancel),
        b'y' | b'Y' => Mail::Ask(Request::Confirm),
        b'!' => Mail::Ask(Request::EmergencyStop),
        b'0'..=b'9' => Mail::Ask(Request::Answer(key - b'0')),
        b'h' | b'H' | b'?' => Mail::Tell(HELP.to_owned()),
        _ => return None,
    })
}

/// The terminal as it was; dropped, it is that again.
pub(in crate::cli) struct Keys {
    before: Termios,
}

impl Keys {
    /// Reads keys in a thread of its own, if standard input is a terminal that is ours:
    /// a job in the shell's background must not touch it.
    pub(super) fn listen(post: mpsc::Sender<Mail>) -> Option<Self> {
        let input = std::io::stdin();
        let ours =
            input.is_terminal() && tcgetpgrp(&input).is_ok_and(|group| group == rustix::process::getpgrp());
        if !ours {
            return None;
        }
        let before = tcgetattr(&input).ok()?;
        let mut modes = before.clone();
        modes.local_modes.remove(LocalModes::ICANON | LocalModes::ECHO);
        modes.special_codes[SpecialCodeIndex::VSUSP] = NO_CHARACTER;
        modes.special_codes[SpecialCodeIndex::VMIN] = 1;
        modes.special_codes[SpecialCodeIndex::VTIME] = 0;
        tcsetattr(&input, OptionalActions::Now, &modes).ok()?;
        // From here on the drop puts it back.
        let keys = Self { before };
        std::thread::Builder::new().name("keys".to_owned()).spawn(move || read(&post)).ok()?;
        Some(keys)
    }
}

impl Drop for Keys {
    fn drop(&mut self) {
        // A terminal that is gone needs no modes.
        let _ = tcsetattr(std::io::stdin(), OptionalActions::Now, &self.before);
    }
}

fn read(post: &mpsc::Sender<Mail>) {
    let mut input = std::io::stdin().lock();
    let mut keys = [0; 64];
    while let Ok(len @ 1..) = input.read(&mut keys) {
        let keys = &keys[..len];
        // An arrow or function key is one read that begins with ESC; pieces of it mean nothing.
        if keys[0] == 0x1b {
            continue;
        }
        for letter in keys.iter().copied().filter_map(letter) {
            if post.blocking_send(letter).is_err() {
                return;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_requests() {
        let check = |key: u8, expect: Option<Request>| {
            let got = letter(key).and_then(|l| if let Mail::Ask(r) = l { Some(r) } else { None });
            assert_eq!(got, expect, "{}", key as char);
        };
        check(b'p', Some(Request::Pause));
        check(b'r', Some(Request::Resume));
        check(b'c', Some(Request::Cancel));
        check(b'!', Some(Request::EmergencyStop));
        check(b'y', Some(Request::Confirm));
        check(b'7', Some(Request::Answer(7)));
        // The same key without Shift, and what a cat would press.
        for nothing in [b'1' - 1, b' ', b'\n', b'q', 0x1b, 0xff] {
            let expect = (nothing == b'0').then_some(Request::Answer(0));
            check(nothing, expect);
        }
        // No key quits: only a signal does.
        assert!((0..=255).all(|key| letter(key) != Some(Mail::Quit)));
    }
}
