//! At which speed a printer talks: one question at each likely speed, until an
//! answer can be read.
//!
//! Takes the bytes of a port and the time in ms, says which speed is to be set and
//! what is to be written. Does no I/O and owns no clock.
//!
//! # What it does to the printer
//! It asks for temperatures (`M105`, without a number), behind a line feed that
//! ends whatever stood in the firmware's buffer. At a wrong speed the firmware sees
//! a few bytes of noise, which the next line feed ends: an unknown command. Nothing
//! moves, no line number changes, a job that the firmware still has goes on. The
//! port stays open while the speed changes, so a board that opening resets is reset
//! once and not at each try; it is given its boot time before the first question.
//!
//! # What it costs
//! A printer that answers at the first speed: its boot time, or nothing. The whole
//! list without an answer: the boot time and 14.5 s.
use crate::printer::lines::LineSplitter;
use crate::printer::reply::{self, Reply};

/// The likely speeds, the likeliest first. Native USB takes any, so there the first
/// try wins.
pub const LIKELY: [u32; 9] = [250_000, 115_200, 500_000, 1_000_000, 57_600, 76_800, 38_400, 19_200, 9_600];

/// Wait for the answer to M105: at 9600 baud it takes 0.1 s, and a firmware between
/// two moves some tenths.
const ANSWER_MS: u64 = 700;

/// In the second round, for a printer that is busy: Marlin says so every 2 s.
const BUSY_MS: u64 = 2_500;

/// The second round goes over so many of the speeds.
const SECOND_ROUND: usize = 3;

/// A board that has said something unreadable and falls silent has booted.
const QUIET_MS: u64 = 500;

/// Wait for the firmware's name (M115), its boot included.
const NAME_MS: u64 = 3_000;

/// Longest name kept.
const MAX_NAME: usize = 120;

/// The question: harmless in every state of the printer.
const QUESTION: &[u8] = b"\nM105\n";

/// What came of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Verdict {
    /// It talks at this speed.
    Speaks {
        /// Bits per second.
        baud: u32,
        /// What the firmware calls itself, if that was asked for and answered;
        /// unescaped.
        firmware: Option<String>,
    },
    /// Bytes came, at no speed to be read.
    Noise,
    /// Nothing came.
    Silence,
}

/// The search. See the module's text.
#[derive(Debug)]
pub struct Detect {
    rates: Vec<u32>,
    at: usize,
    second_round: bool,
    phase: Phase,
    until_ms: u64,
    lines: LineSplitter,
    heard: bool,
    asks_name: bool,
    firmware: Option<String>,
    output: Vec<u8>,
    verdict: Option<Verdict>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Phase {
    /// The board may be booting: only listen.
    Boot {
        /// The end of it at the latest.
        end_ms: u64,
    },
    Asked,
    /// The speed is known, the name is asked for.
    Naming,
}

impl Detect {
    /// A search at `rates`, in this order, on a port that was opened at `now_ms`
    /// with the first of them. `boot_ms`: how long a board that opening may have
    /// reset needs; 0 if it was not.
    pub fn new(rates: Vec<u32>, boot_ms: u64, asks_name: bool, now_ms: u64) -> Self {
        let end_ms = now_ms + boot_ms;
        let mut detect = Self {
            rates,
            at: 0,
            second_round: false,
            phase: Phase::Boot { end_ms },
            until_ms: end_ms,
            lines: LineSplitter::default(),
            heard: false,
            asks_name,
            firmware: None,
            output: Vec::new(),
            verdict: None,
        };
        detect.on_tick(now_ms);
        detect
    }

    /// The speed to be set now. When it changes, drop what was not read yet.
    pub fn baud(&self) -> u32 {
        self.rates.get(self.at).copied().unwrap_or_default()
    }

    /// Bytes to be written.
    pub fn output(&self) -> &[u8] {
        &self.output
    }

    /// The first `len` of them are.
    pub fn written(&mut self, len: usize) {
        self.output.drain(..len.min(self.output.len()));
    }

    /// When [`Self::on_tick`] is due.
    pub fn deadline(&self) -> u64 {
        self.until_ms
    }

    /// The end of the search.
    pub fn verdict(&self) -> Option<&Verdict> {
        self.verdict.as_ref()
    }

    /// The port does not have this speed: the next one.
    pub fn refused(&mut self, now_ms: u64) {
        if self.verdict.is_none() {
            self.next(now_ms);
        }
    }

    /// Bytes came.
    pub fn on_bytes(&mut self, bytes: &[u8], now_ms: u64) {
        if self.verdict.is_some() {
            return;
        }
        self.heard |= !bytes.is_empty();
        let (mut known, mut name) = (false, None);
        self.lines.push(bytes, |line| {
            let class = reply::parse(line);
            known |= told(line, &class);
            if let Reply::Firmware(text) = class {
                name = Some(String::from_utf8_lossy(&text[..text.len().min(MAX_NAME)]).into_owned());
            }
        });
        self.firmware = name.or(self.firmware.take());
        match self.phase {
            Phase::Naming if self.firmware.is_some() => self.speaks(),
            Phase::Naming => {}
            Phase::Boot { .. } | Phase::Asked if known => self.known(now_ms),
            // Noise: it does not wait for us.
            Phase::Boot { end_ms } => self.until_ms = end_ms.min(now_ms + QUIET_MS),
            Phase::Asked => {}
        }
        self.on_tick(now_ms);
    }

    /// Time passed.
    pub fn on_tick(&mut self, now_ms: u64) {
        if self.verdict.is_some() || now_ms < self.until_ms {
            return;
        }
        match self.phase {
            Phase::Naming => self.speaks(),
            Phase::Boot { .. } => self.ask(now_ms),
            Phase::Asked => self.next(now_ms),
        }
    }

    fn ask(&mut self, now_ms: u64) {
        if self.rates.is_empty() {
            self.verdict = Some(Verdict::Silence);
            return;
        }
        self.phase = Phase::Asked;
        self.until_ms = now_ms + if self.second_round { BUSY_MS } else { ANSWER_MS };
        self.output = QUESTION.to_vec();
    }

    fn next(&mut self, now_ms: u64) {
        self.lines.forget();
        self.at += 1;
        let end = match self.second_round {
            true => self.rates.len().min(SECOND_ROUND),
            false => self.rates.len(),
        };
        if self.at >= end {
            self.at = 0;
            if std::mem::replace(&mut self.second_round, true) {
                self.verdict = Some(if self.heard { Verdict::Noise } else { Verdict::Silence });
                return;
            }
        }
        self.ask(now_ms);
    }

    fn known(&mut self, now_ms: u64) {
        if !self.asks_name || self.firmware.is_some() {
            return self.speaks();
        }
        self.phase = Phase::Naming;
        self.until_ms = now_ms + NAME_MS;
        self.output = b"\nM115\n".to_vec();
    }

    fn speaks(&mut self) {
        self.output.clear();
        self.verdict = Some(Verdict::Speaks { baud: self.baud(), firmware: self.firmware.take() });
    }
}

/// The speeds to try: `first`, then the likely ones.
pub fn rates(first: u32) -> Vec<u32> {
    std::iter::once(first).chain(LIKELY.into_iter().filter(|rate| *rate != first)).collect()
}

/// Whether noise cannot have made this line: its class says something, and all of
/// it can be read.
fn told(line: &[u8], class: &Reply<'_>) -> bool {
    let readable = std::str::from_utf8(line).is_ok_and(|text| !text.chars().any(char::is_control));
    let says = match class {
        Reply::Other(_) => false,
        // `//` is two bytes; `echo:` is five.
        Reply::Note(_) | Reply::Action(_) => line.starts_with(b"echo:"),
        _ => true,
    };
    readable && says
}
