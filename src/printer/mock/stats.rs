//! What the mock printer counts, and the digest of what it executed.
//!
//! Plain data that becomes JSON; every field is part of the interface:
//! documented, named with its unit, and only ever added to. Knows neither
//! files nor clocks.
use serde::Serialize;

/// A snapshot. Counts are since the mock was started, over all connections
/// and resets; times are of the wall clock unless they say "simulated".
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Stats {
    /// Lines that came in, without empty ones.
    pub lines_received: u64,
    /// Lines that went to the command queue.
    pub lines_accepted: u64,
    /// Of these, lines without a number.
    pub lines_unnumbered: u64,
    /// Numbers that were jumped over: what an M110 moved the numbering ahead by.
    pub lines_lost: u64,
    /// Numbered lines accepted although their number had been accepted before
    /// in the same numbering (since the boot, or M110 with 0 or less).
    pub lines_repeated: u64,
    /// Lines refused because their number was not the last one plus 1.
    pub lines_out_of_order: u64,
    /// Repeats of the last line or the one before, dropped without a word.
    pub repeats_dropped: u64,
    /// Lines refused because their checksum did not fit.
    pub checksum_errors: u64,
    /// Lines refused because they had a number and no checksum.
    pub checksums_missing: u64,
    /// `Resend:` lines sent.
    pub resends_asked: u64,
    /// Bytes lost because the receive buffer was full.
    pub overflow_bytes: u64,
    /// Bytes that came while the board was starting or halted.
    pub deaf_bytes: u64,
    /// Reply bytes dropped because the host did not read.
    pub unread_bytes: u64,
    /// Commands answered with "Unknown command".
    pub unknown_commands: u64,
    /// Extrusions refused because the nozzle was cold.
    pub cold_extrusions: u64,
    /// Moves that ran (an arc is many).
    pub moves: u64,
    /// Filament through the nozzle, mm: all E forward less all E back.
    pub extruded_mm: f64,
    /// Share of a job's time in which no move was ready, 0 to 1:
    /// `planner_empty_s / (planner_empty_s + moving_s)`.
    pub planner_empty_share: f64,
    /// Time between the end of a move and the start of the next, from the
    /// first move to the last, less the time in which the board itself made
    /// the pause (heating, G4, homing, waiting for the user), s.
    pub planner_empty_s: f64,
    /// Time in which moves ran, s (at `--speed` 10 a tenth of the simulated).
    pub moving_s: f64,
    /// How often the planner ran dry between two moves.
    pub planner_gaps: u64,
    /// Most moves that were planned at a time (of 15).
    pub planner_most: usize,
    /// Most commands that were queued at a time (of 4).
    pub queue_most: usize,
    /// Most bytes that waited in the receive buffer.
    pub rx_bytes_most: usize,
    /// FNV-1a, 64 bits, in hexadecimal, over the numbered lines accepted in
    /// this numbering, in order: the command without number and checksum, and
    /// `\n`. Commands that a host adds of its own accord are left out: see
    /// [`is_hosts_own`].
    pub digest: String,
    /// Lines in the digest.
    pub digest_lines: u64,
    /// The same over all numberings and connections, in the order of acceptance.
    pub all_digest: String,
    /// Lines in it.
    pub all_digest_lines: u64,
    /// When the first line came that was not the host's own (see
    /// [`is_hosts_own`]), in s since the mock was started; 0 before.
    pub first_job_line_s: f64,
    /// Commands G0 to G3 whose last move has run to its end, over all connections,
    /// numberings and resets. What a reset threw out of the planner is not among them.
    pub executed: u64,
    /// FNV-1a, 64 bits, in hexadecimal, over these commands in the order in which they
    /// ended, each as in `digest`: over all connections, numberings and resets.
    pub executed_digest: String,
    /// Moves that put filament down.
    pub deposits: u64,
    /// FNV-1a over these moves: where each really began and ended, and its filament, in
    /// thousandths of a millimetre. Two prints with the same digest are the same part.
    pub deposit_digest: String,
    /// Times that the nozzle was driven into what it had printed, or X or Y moved after
    /// a reset before Z was raised, or Z was homed over a part; for a resin printer see `plate`.
    pub crashes: u64,
    /// Moves after a reset of a nozzle that stuck to the part because it was cold.
    pub moved_cold: u64,
    /// Height of the nozzle over the bed when X or Y first moved since the last reset
    /// that happened with a part on the bed, mm.
    pub first_xy_after_reset_z_mm: Option<f64>,
    /// Where the nozzle really is: X, Y, Z, mm. `position_mm` is what the firmware
    /// believes, and where the queued moves end.
    pub true_position_mm: [f64; 3],
    /// The highest of what was printed and not yet taken off the bed, mm; of a resin
    /// printer the highest that the plate was when the light came on.
    pub part_top_mm: f64,
    /// How often the power was cut.
    pub power_cuts: u64,
    /// How often the serial device was opened.
    pub connects: u64,
    /// How often the board started.
    pub boots: u64,
    /// How often it halted by `kill()`.
    pub kills: u64,
    /// Real time since the mock was started, s.
    pub real_s: f64,
    /// Simulated time since then, s: real time times `--speed`.
    pub simulated_s: f64,
    /// Whether any heater has a target.
    pub heaters_on: bool,
    /// Each extruder's nozzle: now and its target, °C.
    pub nozzles_c: Vec<[f64; 2]>,
    /// The chamber, where there is one: now and its target, °C.
    pub chamber_c: Option<[f64; 2]>,
    /// The extruder in use, from 0.
    pub tool: usize,
    /// Whether bed levelling is on (M420 S1).
    pub levelling_on: bool,
    /// The nozzle in use now, °C.
    pub nozzle_c: f64,
    /// The nozzle's target, °C; 0 is off.
    pub nozzle_target_c: f64,
    /// Bed now, °C.
    pub bed_c: f64,
    /// The bed's target, °C; 0 is off.
    pub bed_target_c: f64,
    /// Part cooling fan, 0 to 255.
    pub fan: u8,
    /// Whether the light of a resin printer is on; it and all of `light_…` stay at their
    /// beginning on any other.
    pub light_on: bool,
    /// Times that it came on, or got another power while it was on.
    pub light_pulses: u64,
    /// Of these, what the log of pulses did not keep because it was full.
    pub light_pulses_not_kept: u64,
    /// How long it was on altogether, s of the machine's time: the clock's times `--speed`.
    pub light_s: f64,
    /// The longest of its pulses, s of the machine's time.
    pub light_longest_s: f64,
    /// How often the plate moved, by more than 0.001 mm, while it was on.
    pub light_moved: u64,
    /// How far a part on a resin printer's plate was driven below its last layer at most, mm.
    pub pressed_in_mm: f64,
    /// Where the queued moves end: X, Y, Z, mm.
    pub position_mm: [f64; 3],
}

/// Digest of command lines, in the order in which they were accepted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Digest {
    state: u64,
    lines: u64,
}

impl Default for Digest {
    fn default() -> Self {
        Self {
            state: 0xcbf2_9ce4_8422_2325, // FNV-1a's offset basis
            lines: 0,
        }
    }
}

impl Digest {
    /// Adds one command, without number, checksum, comment and blanks at its
    /// end; those of [`is_hosts_own`] are passed over.
    pub fn add(&mut self, command: &[u8]) {
        if is_hosts_own(command) {
            return;
        }
        self.mix(command);
        self.mix(b"\n");
        self.lines += 1;
    }

    /// Adds bytes that are no line of their own.
    pub(crate) fn mix(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.state = (self.state ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }

    /// What was mixed in so far was one more.
    pub(crate) fn count(&mut self) {
        self.lines += 1;
    }

    /// Sixteen hexadecimal digits.
    pub fn hex(&self) -> String {
        format!("{:016x}", self.state)
    }

    /// How many lines went in.
    pub fn lines(&self) -> u64 {
        self.lines
    }
}

/// Commands that a host sends of its own accord between the lines of a job:
/// M105, M110, M113, M114, M115, M118, M155, M400 and the emergency commands.
pub fn is_hosts_own(command: &[u8]) -> bool {
    let word = command.split(|&b| b == b' ').next().unwrap_or_default();
    matches!(
        word,
        b"M105"
            | b"M108"
            | b"M110"
            | b"M112"
            | b"M113"
            | b"M114"
            | b"M115"
            | b"M118"
            | b"M155"
            | b"M400"
            | b"M410"
            | b"M876"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_digest_is_fnv_1a_of_the_jobs_lines() {
        let mut digest = Digest::default();
        assert_eq!(digest.hex(), "cbf29ce484222325");
        digest.add(b"M105");
        digest.add(b"M110 N0");
        assert_eq!((digest.hex().as_str(), digest.lines()), ("cbf29ce484222325", 0));
        digest.add(b"a");
        // FNV-1a of "a\n", from the published algorithm.
        assert_eq!(digest.hex(), "089bdc07b544e7b2");
        let mut other = Digest::default();
        other.add(b"G1 X1");
        other.add(b"G1 X2");
        let mut swapped = Digest::default();
        swapped.add(b"G1 X2");
        swapped.add(b"G1 X1");
        assert_ne!(other.hex(), swapped.hex());
        assert_eq!(other.lines(), 2);
    }
}
