//! Standard input in a thread of its own: reading it would block the loop.
use super::Typed;
use crate::printer::lines::MAX_REPLY_LEN;
use std::io::{BufRead, Read};
use tokio::sync::mpsc::{Receiver, channel};

/// Longest line; no firmware takes so much.
const MAX_LINE: usize = MAX_REPLY_LEN;

/// What is read ahead of the loop.
const AHEAD: usize = 4;

/// Bytes read at once.
const READ_BYTES: usize = 4096;

/// Lines, until the end of the input.
pub(super) fn lines() -> Receiver<Typed> {
    let (to, from) = channel(AHEAD);
    spawn(move || {
        let mut input = std::io::stdin().lock();
        while let Some(typed) = line(&mut input) {
            let over = matches!(typed, Typed::End);
            if to.blocking_send(typed).is_err() || over {
                return;
            }
        }
    });
    from
}

/// The next line; the end, also where reading fails.
fn line(input: &mut impl BufRead) -> Option<Typed> {
    let mut bytes = Vec::new();
    let limit = u64::try_from(MAX_LINE).unwrap_or(u64::MAX);
    let read = input.by_ref().take(limit).read_until(b'\n', &mut bytes);
    Some(match read {
        Ok(0) | Err(_) => Typed::End,
        Ok(len) if len == MAX_LINE && !bytes.ends_with(b"\n") => {
            // The rest of it is no line of its own.
            while let Ok(some) = input.fill_buf() {
                let end = memchr::memchr(b'\n', some);
                let used = end.map_or(some.len(), |at| at + 1);
                input.consume(used);
                if end.is_some() || used == 0 {
                    break;
                }
            }
            Typed::Wrong(format!("not sent: a line of more than {MAX_LINE} bytes"))
        }
        Ok(_) => Typed::Line(String::from_utf8_lossy(&bytes).into_owned()),
    })
}

/// Bytes as they come, until the end of the input.
pub(super) fn bytes() -> Receiver<Vec<u8>> {
    let (to, from) = channel(AHEAD);
    spawn(move || {
        let mut input = std::io::stdin().lock();
        let mut some = [0; READ_BYTES];
        while let Ok(len @ 1..) = input.read(&mut some) {
            if to.blocking_send(some[..len].to_vec()).is_err() {
                return;
            }
        }
    });
    from
}

fn spawn(work: impl FnOnce() + Send + 'static) {
    // Without the thread its channel ends at once, as an empty input would.
    let _ = std::thread::Builder::new().name("input".to_owned()).spawn(work);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_bounded() {
        let check = |input: &[u8], expect: &[&str]| {
            let mut input = input;
            let mut got = Vec::new();
            loop {
                match line(&mut input) {
                    Some(Typed::Line(text)) => got.push(text),
                    Some(Typed::Wrong(_)) => got.push("wrong".to_owned()),
                    _ => break,
                }
            }
            assert_eq!(got, expect);
        };
        check(b"G28\nM105", &["G28\n", "M105"]);
        check(b"", &[]);
        let long = [b'x'; 5000];
        check(&long, &["wrong"]);
        check(&[&long[..], b"\nM105\n"].concat(), &["wrong", "M105\n"]);
        check(&[&long[..MAX_LINE - 1], b"\n"].concat(), &[&("x".repeat(MAX_LINE - 1) + "\n")]);
    }
}
