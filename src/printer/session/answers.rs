//! What the session makes of the printer's lines: acknowledgements, resend
//! requests, reports.
use super::settings::*;
use super::{Event, Failure, Phase, Session, Then, Whence};
use crate::printer::reply::{Ack, Reply, parse};
use crate::printer::window::Kind;

/// What is remembered between the printer's lines.
#[derive(Debug, Default)]
pub(super) struct Answers {
    bytes: u64,
    understood: u64,
    pub(super) drain: Option<Drain>,
    /// The `ok` that may follow a resend request acknowledges nothing.
    pub(super) swallow_ok: bool,
    /// The last `ok` was M105's, and nothing of the job was sent after it.
    pub(super) proved: bool,
    /// Line of the last resend request, and how often in a row it was asked for.
    pub(super) resend_line: u32,
    pub(super) resend_rounds: u32,
    pub(super) odd_requests: u32,
    pub(super) resends: u64,
    pub(super) warned: bool,
    /// `ok`s since the last that said of which line it was. One lost makes the window
    /// narrower by a line, for ever.
    pub(super) bare_oks: u32,
    /// A line came that may have been an `ok`.
    pub(super) suspects: bool,
    /// `start`s before the handshake was through.
    starts: u32,
}

/// A resend request came: nothing is sent until the wire is quiet.
#[derive(Debug, Clone, Copy)]
pub(super) struct Drain {
    /// The line asked for; `None` when the request was beyond what we have.
    pub(super) line: Option<u32>,
    quiet_ms: u64,
    latest_ms: u64,
}

impl Answers {
    pub(super) fn heard(&mut self, bytes: usize, now_ms: u64) {
        self.bytes = self.bytes.saturating_add(bytes as u64);
        if let Some(drain) = &mut self.drain {
            drain.quiet_ms = now_ms + DRAIN_QUIET_MS;
        }
    }

    pub(super) fn no_answer(&self) -> Failure {
        Failure::NoAnswer { bytes: self.bytes, lines: self.understood }
    }

    /// Starts to wait for silence.
    pub(super) fn drain(&mut self, now_ms: u64) {
        self.drain_for(Some(0), now_ms);
    }

    pub(super) fn drain_for(&mut self, line: Option<u32>, now_ms: u64) {
        self.drain =
            Some(Drain { line, quiet_ms: now_ms + DRAIN_QUIET_MS, latest_ms: now_ms + DRAIN_MAX_MS });
    }

    pub(super) fn forget_drain(&mut self) {
        self.drain = None;
        self.swallow_ok = false;
    }

    pub(super) fn is_draining(&self) -> bool {
        self.drain.is_some()
    }

    pub(super) fn drain_ends_ms(&self) -> Option<u64> {
        self.drain.map(|d| d.quiet_ms.min(d.latest_ms))
    }

    pub(super) fn proved(&self) -> bool {
        self.proved
    }

    pub(super) fn count_start(&mut self) -> u32 {
        self.starts += 1;
        self.starts
    }

    pub(super) fn forget_starts(&mut self) {
        self.starts = 0;
    }

    /// Over another connection nothing that was asked for is still awaited.
    pub(super) fn rejoined(&mut self) {
        self.forget_drain();
        self.proved = false;
        (self.resend_line, self.resend_rounds, self.odd_requests) = (0, 0, 0);
    }

    /// It is known which line was acknowledged: no `ok` is missing.
    pub(super) fn in_step(&mut self) {
        self.bare_oks = 0;
        self.suspects = false;
    }

    pub(super) fn unproved(&mut self) {
        self.proved = false;
    }
}

impl Session {
    pub(super) fn on_line(&mut self, line: &[u8], now_ms: u64) {
        if self.is_over() {
            return;
        }
        let reply = parse(line);
        if !matches!(reply, Reply::Other(_)) {
            self.answers.understood += 1;
        }
        if self.hear_in_search(&reply, now_ms) || self.hear_in_stop(&reply) {
            return;
        }
        match reply {
            Reply::Ok(ack) => self.on_ok(ack, now_ms),
            Reply::Resend(n) => self.on_resend(n, now_ms),
            Reply::Refused { last_line, text } => {
                self.tell(Event::PrinterError(lossy(text)));
                self.on_resend(last_line.saturating_add(1), now_ms);
            }
            Reply::Fatal(text) => self.on_fatal(text, now_ms),
            Reply::Start => self.on_start(now_ms),
            Reply::Busy(busy) => {
                self.on_busy(now_ms);
                self.person.noted(busy);
                self.tell(Event::Busy(busy));
            }
            Reply::Wait => self.on_wait(now_ms),
            Reply::Temperatures(t) => self.tell(Event::Temperatures(t)),
            Reply::Position(p) => self.tell(Event::Position(p)),
            Reply::Firmware(name) => self.printer.firmware = Some(lossy(name)),
            Reply::Capability { name, present } => match name {
                b"AUTOREPORT_TEMP" => self.printer.auto_report = present,
                b"EMERGENCY_PARSER" => self.printer.emergency_parser = present,
                b"PROMPT_SUPPORT" => self.printer.prompts = present,
                _ => {}
            },
            Reply::Action(action) => self.on_action(action),
            Reply::UnknownCommand(text) => self.tell(Event::UnknownCommand(lossy(text))),
            Reply::Error(text) => self.tell(Event::PrinterError(lossy(text))),
            Reply::Note(text) => self.on_note(text),
            Reply::Other(text) => {
                self.answers.suspects |= may_have_been_ok(text);
                self.on_note(text);
            }
        }
        if let Phase::Boot { speak_ms, latest_ms } = &mut self.phase {
            // While the printer still prints its settings, it would not listen.
            *speak_ms = (*speak_ms).max(now_ms + BOOT_QUIET_MS).min(*latest_ms);
        }
    }

    fn on_ok(&mut self, ack: Ack, now_ms: u64) {
        if let Some(t) = ack.temperatures {
            self.tell(Event::Temperatures(t));
        }
        if let Some(p) = ack.position {
            self.tell(Event::Position(p));
        }
        if let Phase::Numbering { then, tries, .. } = self.phase {
            // M110's `ok` is bare; one with temperatures answers an older M105.
            if ack.temperatures.is_none() {
                self.numbered(then, tries, now_ms);
            }
            return;
        }
        let bare = ack.line.is_none() && ack.temperatures.is_none();
        if bare && std::mem::take(&mut self.answers.swallow_ok) {
            return;
        }
        if bare && self.person.takes_ok(self.window.acked()) {
            return self.stall.progress(now_ms);
        }
        self.growth.on_ok(&ack, self.pending.full);
        let before = self.window.acked();
        let asked = self.window.find_in_flight(Kind::AskTemperature);
        match (ack.line, ack.temperatures.and(asked)) {
            (_, Some(n)) => {
                self.window.ack_through(n);
                self.proved_through = self.proved_through.max(n);
                self.answers.proved = self.window.is_idle() && self.window.all_sent();
                self.answers.in_step();
            }
            // A number below the flight was acknowledged by a later one already;
            // one beyond it is garbled, but an `ok` all the same.
            (Some(n), None) if n < self.window.cursor() => {
                self.window.ack_through(n);
                self.proved_through = self.proved_through.max(n);
                self.answers.in_step();
            }
            _ => {
                self.window.ack_one();
                self.answers.bare_oks += 1;
            }
        }
        if self.window.acked() != before {
            self.acked(before, now_ms);
        }
    }

    /// Lines from `from` on were acknowledged.
    pub(super) fn acked(&mut self, from: u32, now_ms: u64) {
        let upto = self.window.acked();
        let newest = (from..upto).rev().find_map(|n| self.window.tag(n).filter(|tag| tag.job_line > 0));
        if let Some(tag) = newest {
            self.job_acked = self.job_acked.max(tag.job_line);
        }
        self.stall.progress(now_ms);
        self.stall.acked(upto);
        self.person.goes_on();
        // The `ok` of a line proves nothing, that of the next but one does.
        if upto > self.answers.resend_line.saturating_add(1) {
            self.answers.resend_rounds = 0;
        }
    }

    fn on_fatal(&mut self, text: &[u8], now_ms: u64) {
        let failure = Failure::Fatal { text: lossy(text) };
        if text.starts_with(b"!!") {
            // Klipper says so of a refused command too, with heaters left on.
            self.fail(failure, now_ms);
        } else {
            self.fail_at_once(failure);
        }
    }

    fn on_start(&mut self, now_ms: u64) {
        match self.phase {
            // It boots while we ask: what was sent before is lost.
            Phase::Boot { .. }
            | Phase::Numbering { then: Then::Identify, .. }
            | Phase::Identify { whence: Whence::Anew, .. } => self.boots(now_ms),
            _ => {
                let job_line = self.job_acked;
                self.fail_at_once(Failure::Reset { job_line });
            }
        }
    }

    fn on_busy(&mut self, now_ms: u64) {
        self.stall.busy(now_ms);
        if let Phase::Numbering { retry_ms, .. } = &mut self.phase {
            // Someone else's command still runs; M110 waits behind it.
            *retry_ms = now_ms + HANDSHAKE_TRY_MS + PROBE_AFTER_MS;
        }
    }

    /// The printer has nothing to do: whatever we wait for is lost.
    fn on_wait(&mut self, now_ms: u64) {
        if !self.window.is_idle() && !self.answers.is_draining() && !self.stall.is_probing() {
            self.probe(now_ms);
        }
    }
}

/// Whether a line without a class may have been an `ok` before noise came over it: a
/// byte or two like it, or `ok` run into the next line.
fn may_have_been_ok(text: &[u8]) -> bool {
    text.len() <= 4 || text.starts_with(b"ok") || text.iter().any(|b| !(b' '..=b'~').contains(b))
}

/// The printer's bytes as text; what is no UTF-8 becomes a replacement mark.
pub(super) fn lossy(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}
