//! What a session needs to be told, as plain values, and the limits it keeps.
use crate::printer::window::Limit;

/// What one printer needs; the limits common to all are the constants below.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// How much may be unacknowledged.
    pub window: Limit,
    /// Longest framed line in characters without its line feed; `None`: no limit.
    pub max_line: Option<usize>,
    /// How long to listen for `start` before speaking first, in ms. A board that
    /// is reset by opening the port needs its boot loader's time; 0 for others.
    pub boot_wait_ms: u64,
    /// Whether what changes the meaning of line numbers waits for
    /// [`Session::allow`](super::Session::allow): somebody writes it down first.
    pub asks: bool,
    /// Whether a lost port is waited for instead of ending the job.
    pub waits_for_link: bool,
    /// Lines that make the printer safe after a cancel or a failure.
    pub cancel_macro: Vec<String>,
}

impl Default for Settings {
    /// A Marlin with its usual buffers that the opened port resets.
    fn default() -> Self {
        Self {
            window: Limit::Bytes(DEFAULT_WINDOW_BYTES),
            max_line: Some(MARLIN_MAX_LINE),
            boot_wait_ms: DEFAULT_BOOT_WAIT_MS,
            asks: false,
            waits_for_link: false,
            cancel_macro: Vec::new(),
        }
    }
}

impl Settings {
    /// A port was opened just now.
    pub(super) fn boot(&self, now_ms: u64) -> super::Phase {
        let speak_ms = now_ms + self.boot_wait_ms;
        super::Phase::Boot { speak_ms, latest_ms: speak_ms + BOOT_MAX_MS }
    }
}

/// Fits the receive buffer of 128 bytes that Marlin's boards have, and keeps the
/// planner fed at 250,000 baud and 500 moves/s.
pub const DEFAULT_WINDOW_BYTES: usize = 120;

/// Marlin's MAX_CMD_SIZE is 96 and ends with a NUL.
pub const MARLIN_MAX_LINE: usize = 95;

/// An AVR boot loader gives the sketch control within 2 s of a reset.
pub const DEFAULT_BOOT_WAIT_MS: u64 = 2_500;

/// After `start` firmware prints its settings; it is asked when it falls silent.
pub(super) const BOOT_QUIET_MS: u64 = 250;

/// A boot that never falls silent (a stuck report) must not keep us from asking.
pub(super) const BOOT_MAX_MS: u64 = 10_000;

/// Wait for the answer to M110 before it is sent again.
pub(super) const HANDSHAKE_TRY_MS: u64 = 2_000;

/// Unanswered or garbled M110s before we call it no printer: 20 s cover the
/// slowest boards (network start-up, SD card).
pub(super) const HANDSHAKE_TRIES: u32 = 10;

/// Lines already in the firmware's queue are answered at once after a resend
/// request; when the wire was silent so long, they have drained.
pub(super) const DRAIN_QUIET_MS: u64 = 20;

/// A printer that talks without pause (reports, noise) must not hold up the
/// resend for ever.
pub(super) const DRAIN_MAX_MS: u64 = 500;

/// Without any sign of progress for so long, a probe asks whether an `ok` was
/// lost. Busy notes come every 2 s.
pub(super) const PROBE_AFTER_MS: u64 = 3_000;

/// The same, where a line came that may have been an `ok`: the probe is wanted sooner.
pub(super) const SUSPECT_AFTER_MS: u64 = 500;

/// `ok`s that do not say of which line they are, until an M105 is put between the job's
/// lines: a lost one must not narrow the window for longer. One line in 2,000.
pub(super) const RESYNC_OKS: u32 = 2_000;

/// Patience with G28, G29, M109 and the like in flight: firmware without busy
/// notes heats a large bed for that long.
pub(super) const LONG_COMMAND_MS: u64 = 10 * 60_000;

/// Patience with them where busy notes come every 2 s but have ceased. Waits for
/// heat are not among them: Marlin reports temperatures then and is not busy.
pub(super) const KEPT_ALIVE_MS: u64 = 30_000;

/// Timeouts in a row (3, 6, 12, 24 and 48 s) that end the job.
pub(super) const MAX_TIMEOUTS: u32 = 5;

/// How often one line is sent again before the job ends: what fails ten times
/// fails by its content or a broken cable.
pub(super) const MAX_RESENDS: u32 = 10;

/// A printer that asks so often in a row for what cannot be, the first line among it, was
/// reset: one request may be garbled.
pub(super) const ANEW_REQUESTS: u32 = 2;

/// Resend requests in a row for lines that we do not have. One may be garbled.
pub(super) const MAX_ODD_REQUESTS: u32 = 3;

/// Share of resends, in percent, at which the user is told to mind the cable…
pub(super) const RESEND_WARNING_PERCENT: u64 = 10;

/// …once so many lines went out.
pub(super) const RESEND_WARNING_LINES: u64 = 100;

/// A probe's bare `ok` comes within this time from a firmware that was idle.
pub(super) const PROBE_ANSWER_MS: u64 = 1_000;

/// Such answers in a row after which the lines before the probe count as done.
pub(super) const PROBE_ANSWERS: u32 = 2;

/// M105s that may fail to prove the end of a job: some firmware answers them
/// without temperatures.
pub(super) const PROOF_TRIES: u32 = 3;

/// Interval of the automatic temperature report, in s.
pub(super) const AUTO_REPORT_S: u32 = 2;

/// Interval of M105 where the firmware does not report by itself.
pub(super) const POLL_MS: u64 = 5_000;

/// After a cancel, wait so long for the lines that the printer has (it may be
/// heating) before the safe sequence goes out regardless.
pub(super) const WIND_DOWN_MS: u64 = 5 * 60_000;

/// Time for the safe sequence after a cancel: a park move may be slow.
pub(super) const SAFE_AFTER_CANCEL_MS: u64 = 120_000;

/// Time for the safe sequence over a link that has just failed.
pub(super) const SAFE_AFTER_FAILURE_MS: u64 = 20_000;

/// `start`s in a row before the handshake is through: a board says it once or twice
/// (boot loader, the opened port); more is a board that cannot stay up.
pub(super) const MAX_STARTS: u32 = 8;

/// M112 is said again at this interval until it has an effect: one wrong bit, or a
/// receive buffer that a refused line has emptied, must not keep it from its work.
pub(super) const STOP_REPEAT_MS: u64 = 300;

/// Without an effect of M112 for so long the board is to be reset.
pub(super) const HARD_STOP_MS: u64 = 1_000;

/// A board that was reset says `start` within this time: a boot loader's 2 s, and
/// a firmware's slow start.
pub(super) const RESET_HEARD_MS: u64 = 5_000;

/// Before a printer in mid-job is asked where it is, this is listened for at least: what
/// lay in the system's buffers is through, and so is the `start` of a fast board.
pub(super) const LISTEN_MS: u64 = 100;

/// The number of the question that a counting firmware must refuse. Marlin
/// counts in 32 bits with a sign; jobs never come near ([`MAX_NUMBER`](crate::printer::window::MAX_NUMBER)).
pub(super) const WRONG_NUMBER: u32 = 2_000_000_000;

/// After a refusal, quiet for so long: a second one (of a line that was cut) may follow.
pub(super) const REFUSED_QUIET_MS: u64 = 50;

/// Statements of the last line that must agree, one after the other: a wrong bit
/// in one would cost lines. One refusal makes two (`Last Line:`, `Resend:`).
pub(super) const AGREEING: u32 = 2;

/// Unanswered questions of a printer that says nothing at all (3, 6, 12, 24 and 48 s).
pub(super) const SILENT_QUESTIONS: u32 = 5;

/// Longest time between two questions. Each takes 22 bytes of the receive buffer of a
/// printer that is too busy to read.
pub(super) const QUESTION_MAX_MS: u64 = 48_000;

/// Questions that a printer acknowledged without a refusal, until it is taken for one
/// that does not count lines (Klipper).
pub(super) const UNREFUSED_QUESTIONS: u32 = 3;

/// Questions at most: noise that makes each answer another one must not go on for ever.
pub(super) const MAX_QUESTIONS: u32 = 60;

/// Commands of a person that wait for their turn; more come from no keyboard.
pub(super) const MAX_COMMANDS: usize = 16;

/// Unnumbered commands whose `ok` is awaited; that of a further one may acknowledge
/// a line too early.
pub(super) const MAX_STRAYS: usize = 8;

/// A command that waits for a person has begun to wait if it is not done after this:
/// some firmware acknowledges M0 at once.
pub(super) const WAITING_AFTER_MS: u64 = 1_000;

/// Events kept for a driver that does not fetch them; notes beyond are dropped.
pub(super) const MAX_EVENTS: usize = 256;
