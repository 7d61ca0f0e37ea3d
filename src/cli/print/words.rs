//! What a user may want of a running job, as words, a line each: for scripts.
use crate::job::host::Request;
use crate::job::run::Mail;
use std::io::{BufRead, Read};
use tokio::sync::mpsc;

/// Longest line that is read: no command is longer.
const MAX_WORDS_BYTES: usize = 4096;

/// For who wrote something else.
pub(super) const HELP: &str = "pause, resume, confirm, cancel, stop (emergency), answer N, send GCODE";

/// What a line asks for; `None` for nothing that is known.
fn request(line: &str) -> Option<Request> {
    let line = line.trim();
    let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
    let rest = rest.trim();
    match (word, rest) {
        ("pause", "") => Some(Request::Pause),
        ("resume", "") => Some(Request::Resume),
        ("confirm", "") => Some(Request::Confirm),
        ("cancel", "") => Some(Request::Cancel),
        ("stop", "") => Some(Request::EmergencyStop),
        ("answer", n) => n.parse().ok().map(Request::Answer),
        ("send", command) if !command.is_empty() => Some(Request::Command(command.to_owned())),
        _ => None,
    }
}

/// Reads standard input in a thread of its own until its end.
///
/// # Errors
/// The system has no thread left.
pub(super) fn listen(post: mpsc::Sender<Mail>) -> std::io::Result<()> {
    std::thread::Builder::new().name("commands".to_owned()).spawn(move || {
        let mut input = std::io::stdin().lock();
        let mut line = Vec::new();
        loop {
            line.clear();
            // A line without end must not fill the memory: its pieces are unknown words.
            match input.by_ref().take(MAX_WORDS_BYTES as u64).read_until(b'\n', &mut line) {
                Ok(1..) => {}
                Ok(0) | Err(_) => return,
            }
            let text = String::from_utf8_lossy(&line);
            let letter = match request(&text) {
                Some(request) => Mail::Ask(request),
                None if text.trim().is_empty() => continue,
                None => Mail::Tell(format!("{:?} is none of: {HELP}", text.trim())),
            };
            if post.blocking_send(letter).is_err() {
                return;
            }
        }
    })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_requests() {
        let check = |line: &str, expect: Option<Request>| assert_eq!(request(line), expect, "{line}");
        check("pause\n", Some(Request::Pause));
        check(" resume ", Some(Request::Resume));
        check("cancel", Some(Request::Cancel));
        check("stop\r\n", Some(Request::EmergencyStop));
        check("answer 2", Some(Request::Answer(2)));
        check("send  M117 Hi there ", Some(Request::Command("M117 Hi there".to_owned())));
        for unknown in ["", "stop now", "answer", "answer 300", "answer -1", "send", "halt", "Pause"] {
            check(unknown, None);
        }
    }
}
