//! A conversation with a printer by hand: what is sent when, and what is shown.
//!
//! Takes typed lines, the printer's bytes and the time in ms; gives bytes to write,
//! wishes for the port, and lines to show. Does no I/O and owns no clock.
//!
//! Commands go one after the other: the next when the printer has said `ok`. They
//! have no line numbers: what the firmware counts stays as it was. Emergency
//! commands wait for nothing; M112 (`/stop`) goes ahead of every byte that is not
//! sent yet and drops what waits.
use super::boot::Boot;
use crate::printer::lines::LineSplitter;
use crate::printer::reply::{self, Reply};
use outrigger_gcode::checksum::sendable;
use std::collections::VecDeque;

/// Commands that may wait; somebody pasted a file, which is `print`'s work.
pub(super) const MAX_WAITING: usize = 500;

/// Silence while the printer owes an answer, before the user is told so.
const SILENT_MS: u64 = 10_000;

/// After a resend request an `ok` may follow or not.
const RESEND_MS: u64 = 500;

/// An emergency stop has had its effect by then, or not.
const STOP_MS: u64 = 1_000;

/// Commands that firmware reads ahead of its queue, if it has an emergency parser.
const AT_ONCE: [&[u8]; 4] = [b"M108", b"M112", b"M410", b"M876"];

/// Commands whose temperatures are their progress.
const HEATING: [&[u8]; 6] = [b"M109", b"M190", b"M191", b"M303", b"M116", b"M192"];

/// The words that are for us and not for the printer.
pub(super) const HELP: &str = "\
/stop     M112 at once, ahead of everything: heaters and motors off
/reset    reset the board by DTR
/drop     wait no longer for the printer's ok, forget what waits to be sent
/verbose  show temperatures and waits that come by themselves, or hide them
/quit     end (also Ctrl-D); the printer goes on with what it has
M108 ends a wait for heat or for a person, M410 stops moves: both are sent at once.
All else is sent as it is, without its comments, after the ok of what was sent before.";

/// Something to show.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Shown {
    /// The printer's words, unescaped.
    Said(String),
    /// The same, of little interest.
    Aside(String),
    /// Our own words.
    Note(String),
}

/// What is to be done to the port, before more bytes go to it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wish {
    /// Drop what was not sent.
    Flush,
    /// Reset the board, then call [`Talk::was_reset`].
    Reset,
    /// Close it and end.
    Quit,
}

/// How a conversation is held.
#[derive(Debug, Clone, Copy)]
pub(super) struct Manner {
    /// Show what comes by itself.
    pub(super) verbose: bool,
    /// Longest line that the firmware takes.
    pub(super) max_line: Option<usize>,
    /// How long a board that opening resets needs to boot; 0 if it is awake.
    pub(super) boot_ms: u64,
}

/// The conversation. See the module's text.
#[derive(Debug)]
pub(super) struct Talk {
    manner: Manner,
    lines: LineSplitter,
    waiting: VecDeque<Vec<u8>>,
    /// What the printer owes an `ok` for.
    sent: Option<Vec<u8>>,
    output: Vec<u8>,
    /// Some of `output`'s line is out already.
    cut: bool,
    busy_shown: bool,
    /// Nothing is sent before its end.
    boot: Boot,
    /// When something is due to be said about a silence.
    silent_at: Option<u64>,
    resend_until: Option<u64>,
    stop_until: Option<u64>,
    heard_ms: u64,
    trouble: Option<&'static str>,
    shown: VecDeque<Shown>,
    wishes: VecDeque<Wish>,
}

impl Talk {
    pub(super) fn new(manner: Manner, now_ms: u64) -> Self {
        Self {
            manner,
            lines: LineSplitter::default(),
            waiting: VecDeque::new(),
            sent: None,
            output: Vec::new(),
            cut: false,
            busy_shown: false,
            boot: Boot::new(manner.boot_ms, now_ms),
            silent_at: None,
            resend_until: None,
            stop_until: None,
            heard_ms: now_ms,
            trouble: None,
            shown: VecDeque::new(),
            wishes: VecDeque::new(),
        }
    }

    // ---- what comes in ----

    /// A line was typed.
    pub(super) fn type_line(&mut self, line: &str, now_ms: u64) {
        let line = line.trim();
        match line {
            "/quit" | "/exit" => self.wishes.push_back(Wish::Quit),
            "/help" | "/?" | "help" | "?" => self.note(HELP),
            "/stop" => self.stop(now_ms),
            "/reset" => self.wishes.push_back(Wish::Reset),
            "/drop" => self.drop_all(now_ms),
            "/verbose" => {
                self.manner.verbose = !self.manner.verbose;
                self.note(if self.manner.verbose {
                    "all is shown"
                } else {
                    "what comes by itself is hidden"
                });
            }
            _ if line.starts_with('/') => self.note(&format!("{line} is no word of ours; /help lists them")),
            "" => {}
            _ => self.command(line, now_ms),
        }
        self.go_on(now_ms);
    }

    fn command(&mut self, line: &str, now_ms: u64) {
        let mut scratch = Vec::new();
        let Some(command) = sendable(line.as_bytes(), &mut scratch) else {
            return self.note("nothing was sent: this is a comment");
        };
        let command = command.to_vec();
        if self.manner.max_line.is_some_and(|max| command.len() > max) {
            let (len, max) = (command.len(), self.manner.max_line.unwrap_or_default());
            return self.note(&format!("not sent: it has {len} characters, the firmware takes {max}"));
        }
        let word = command.split(|b| b.is_ascii_whitespace()).next().unwrap_or_default();
        match word {
            b"M112" => self.stop(now_ms),
            word if AT_ONCE.contains(&word) => self.at_once(&command),
            _ if self.waiting.len() >= MAX_WAITING => {
                self.note(&format!("not sent: {MAX_WAITING} commands wait; `outrigger print` sends files"));
            }
            _ => self.waiting.push_back(command),
        }
    }

    /// The user pressed Ctrl-C.
    pub(super) fn interrupt(&mut self) {
        let Some(sent) = &self.sent else {
            return self.note("/quit or Ctrl-D ends; /stop (M112) stops the printer");
        };
        let sent = String::from_utf8_lossy(sent).into_owned();
        self.note(&format!(
            "the printer is still at {sent}: M108 ends a wait, M410 stops moves, /stop (M112) stops \
             everything, /drop waits no longer, /quit leaves it alone"
        ));
    }

    /// Bytes came from the printer.
    pub(super) fn on_bytes(&mut self, bytes: &[u8], now_ms: u64) {
        self.heard_ms = now_ms;
        if self.sent.is_some() {
            self.silent_at = Some(now_ms + SILENT_MS);
        }
        let mut lines = std::mem::take(&mut self.lines);
        lines.push(bytes, |line| self.on_line(line, now_ms));
        self.lines = lines;
        self.go_on(now_ms);
    }

    fn on_line(&mut self, line: &[u8], now_ms: u64) {
        let text = String::from_utf8_lossy(line).into_owned();
        let class = reply::parse(line);
        let shown = match class {
            Reply::Temperatures(_) if self.heats() => Some(Shown::Aside(text)),
            Reply::Temperatures(_) | Reply::Wait => self.manner.verbose.then_some(Shown::Aside(text)),
            Reply::Busy(_) => (self.manner.verbose || !self.busy_shown).then_some(Shown::Aside(text)),
            Reply::Ok(ack) if ack.temperatures.is_none() => Some(Shown::Aside(text)),
            _ => Some(Shown::Said(text)),
        };
        self.busy_shown |= matches!(class, Reply::Busy(_));
        self.shown.extend(shown);
        match class {
            Reply::Ok(_) => self.answered(),
            Reply::Resend(_) => {
                self.note("it wants a line again; here lines have no numbers, so look at what it said");
                self.resend_until = Some(now_ms + RESEND_MS);
            }
            Reply::Start => self.restarted(),
            Reply::Fatal(_) => {
                let wished = self.stop_until.is_some();
                self.forget();
                let what = if wished { "stopped" } else { "given up" };
                self.trouble = (!wished).then_some("the firmware has given up");
                self.note(&format!("the firmware has {what}, its heaters are off: /reset starts it again"));
            }
            _ => {}
        }
        self.boot.hear(&class, now_ms);
    }

    /// The port was opened again, or the board was reset as wished.
    pub(super) fn was_reset(&mut self, boot_ms: u64, now_ms: u64) {
        self.lines.forget();
        self.forget();
        self.boot = Boot::new(boot_ms, now_ms);
    }

    /// Time passed.
    pub(super) fn on_tick(&mut self, now_ms: u64) {
        let due = |at: Option<u64>| at.is_some_and(|at_ms| at_ms <= now_ms);
        self.boot.tick(now_ms);
        if due(self.resend_until) {
            self.answered();
        }
        if due(self.silent_at) {
            self.silent_at = None;
            if let Some(sent) = &self.sent {
                let sent = String::from_utf8_lossy(sent).into_owned();
                self.note(&format!(
                    "silence since {sent}: a long command, or its ok was lost; /drop goes on"
                ));
            }
        }
        if due(self.stop_until) {
            self.stop_until = None;
            self.trouble = Some("the printer did not confirm the emergency stop");
            self.note(
                "the printer did not say that it stopped: SWITCH IT OFF if it goes on; /reset resets the \
                 board where DTR is wired to it, and a board in reset heats nothing",
            );
        }
        self.go_on(now_ms);
    }

    // ---- what goes out ----

    /// Bytes to write, after the wishes are fulfilled.
    pub(super) fn output(&self) -> &[u8] {
        &self.output
    }

    /// The first `len` of them are written.
    pub(super) fn written(&mut self, len: usize) {
        self.cut = self.output.get(len.saturating_sub(1)).is_some_and(|last| *last != b'\n');
        self.output.drain(..len.min(self.output.len()));
    }

    pub(super) fn poll_wish(&mut self) -> Option<Wish> {
        self.wishes.pop_front()
    }

    pub(super) fn poll_shown(&mut self) -> Option<Shown> {
        self.shown.pop_front()
    }

    /// When [`Self::on_tick`] is due.
    pub(super) fn deadline(&self) -> Option<u64> {
        let all = [self.boot.until_ms(), self.silent_at, self.resend_until, self.stop_until];
        all.into_iter().flatten().min()
    }

    /// Whether all that was typed is sent and answered, and a stop has shown its effect.
    pub(super) fn idle(&self) -> bool {
        self.waiting.is_empty() && self.sent.is_none() && self.output.is_empty() && self.stop_until.is_none()
    }

    /// Commands that wait.
    pub(super) fn backlog(&self) -> usize {
        self.waiting.len()
    }

    /// What the printer owes an answer for, and when it last said something.
    pub(super) fn owed(&self) -> Option<(&[u8], u64)> {
        self.sent.as_deref().map(|sent| (sent, self.heard_ms))
    }

    /// What ends a script: the firmware gave up, or did not stop when it should.
    pub(super) fn trouble(&self) -> Option<&'static str> {
        self.trouble
    }

    // ---- in between ----

    fn go_on(&mut self, now_ms: u64) {
        if self.sent.is_some() || self.boot.until_ms().is_some() || !self.output.is_empty() {
            return;
        }
        if let Some(command) = self.waiting.pop_front() {
            self.output.extend_from_slice(&command);
            self.output.push(b'\n');
            self.silent_at = Some(now_ms + SILENT_MS);
            self.heard_ms = now_ms;
            self.sent = Some(command);
        }
    }

    fn answered(&mut self) {
        self.sent = None;
        self.busy_shown = false;
        self.silent_at = None;
        self.resend_until = None;
    }

    fn forget(&mut self) {
        self.answered();
        self.waiting.clear();
        self.output.clear();
        self.stop_until = None;
        self.cut = false;
    }

    fn drop_all(&mut self, now_ms: u64) {
        let waiting = self.waiting.len();
        self.waiting.clear();
        self.answered();
        self.boot = Boot::new(0, now_ms);
        self.note(&format!("not waiting any longer; {waiting} commands were not sent"));
        self.go_on(now_ms);
    }

    /// M112, ahead of every byte that is not sent.
    fn stop(&mut self, now_ms: u64) {
        let waiting = self.waiting.len();
        self.forget();
        self.boot = Boot::new(0, now_ms);
        self.wishes.push_back(Wish::Flush);
        // The line feed ends a line that was cut, wherever it was.
        self.output = b"\nM112\n".to_vec();
        self.stop_until = Some(now_ms + STOP_MS);
        self.note(&format!(
            "M112 is sent{}",
            match waiting {
                0 => String::new(),
                n => format!("; {n} commands that waited are dropped"),
            }
        ));
    }

    /// Ahead of what waits; a line of which bytes are out is finished first.
    fn at_once(&mut self, command: &[u8]) {
        let rest = match self.cut {
            true => self.output.iter().position(|b| *b == b'\n').map_or(0, |at| at + 1),
            false => 0,
        };
        let line: Vec<u8> = command.iter().copied().chain([b'\n']).collect();
        self.output.splice(rest..rest, line);
    }

    fn restarted(&mut self) {
        self.trouble = None;
        if self.boot.until_ms().is_some() {
            // This is what was waited for.
            return;
        }
        let lost = self.waiting.len() + usize::from(self.sent.is_some());
        self.forget();
        if lost > 0 {
            self.note(&format!("the board has started anew: {lost} commands are lost or dropped"));
        }
    }

    fn heats(&self) -> bool {
        let Some(sent) = &self.sent else { return false };
        let word = sent.split(|b| b.is_ascii_whitespace()).next().unwrap_or_default();
        HEATING.contains(&word)
    }

    /// Our own words.
    pub(super) fn note(&mut self, text: &str) {
        self.shown.push_back(Shown::Note(text.to_owned()));
    }
}
