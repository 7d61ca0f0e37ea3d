//! What was sent, what is acknowledged, and how much more may be on its way.
//!
//! Takes commands, gives their framed lines in order of their numbers; takes
//! acknowledgements and resend requests as numbers. Does not know replies,
//! time, or why a line is sent.
//!
//! All lines are numbered one after the other, so that four numbers say all:
//!
//! ```text
//!   first      acked        cursor      next
//!     |  history |  in flight |  to send  |
//! ```
//!
//! `first ≤ acked ≤ cursor ≤ next`. A resend request moves `cursor` back (and
//! `acked`, if an `ok` had lied); sending moves it forward again.
use outrigger_gcode::checksum::frame;
use std::collections::VecDeque;

/// Lines kept after their acknowledgement. An `ok` does not prove acceptance, so
/// a resend may ask for acknowledged lines: at most those that the firmware's
/// buffer (1024 bytes, the shortest frame is 8) and queue (32 commands) can hold.
pub const HISTORY_LINES: usize = 256;

/// Bytes kept after their acknowledgement: the same buffer and queue, full of
/// the longest lines of Marlin, with room to spare.
pub const HISTORY_BYTES: usize = 16 * 1024;

/// Line numbers end here: firmware counts in 32 bits with a sign, and a number that
/// no line can have is needed to ask for the last one.
pub const MAX_NUMBER: u32 = 1_999_999_999;

/// How much may be unacknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// So many bytes, which must fit the firmware's receive buffer.
    Bytes(usize),
    /// So many lines.
    Lines(usize),
}

/// What the session wants to know of a line again when it is acknowledged, asked
/// for again or waited for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Tag {
    /// The job's own line number; 0 for a line that is not the job's.
    pub job_line: u64,
    /// What the line does to the wire.
    pub kind: Kind,
}

/// How long a command may take, and what its `ok` looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    /// Queued at once.
    Quick,
    /// M105: its `ok` brings temperatures.
    AskTemperature,
    /// Runs for minutes, perhaps without a busy note.
    Long,
    /// As `Long`, and M108 ends it.
    Heat,
    /// Waits for a person.
    User,
}

#[derive(Debug)]
struct Entry {
    len: usize,
    tag: Tag,
}

/// The line history and the window over it.
#[derive(Debug)]
pub struct Window {
    limit: Limit,
    bytes: VecDeque<u8>,
    entries: VecDeque<Entry>,
    first: u32,
    acked: u32,
    cursor: u32,
    /// Bytes of `first..acked`: where the in-flight lines begin in `bytes`.
    history_bytes: usize,
    in_flight_bytes: usize,
    /// Framing goes through here, so that the ring gets whole lines.
    scratch: Vec<u8>,
}

impl Window {
    /// An empty window whose first line will be `N1`.
    pub fn new(limit: Limit) -> Self {
        Self {
            limit,
            bytes: VecDeque::with_capacity(HISTORY_BYTES * 2),
            entries: VecDeque::with_capacity(HISTORY_LINES * 2),
            first: 1,
            acked: 1,
            cursor: 1,
            history_bytes: 0,
            in_flight_bytes: 0,
            scratch: Vec::with_capacity(128),
        }
    }

    /// Forgets every line: the printer was told to count from 0.
    pub fn reset(&mut self) {
        self.bytes.clear();
        self.entries.clear();
        (self.first, self.acked, self.cursor) = (1, 1, 1);
        (self.history_bytes, self.in_flight_bytes) = (0, 0);
    }

    /// Forgets every line and counts on from `next`: the printer has accepted the lines
    /// before it from someone else. `next` must be at most [`MAX_NUMBER`].
    pub fn count_from(&mut self, next: u32) {
        self.reset();
        (self.first, self.acked, self.cursor) = (next, next, next);
    }

    /// The printer has accepted every line before `next`, and none from there on: the
    /// former are acknowledged, the latter still to send. `false`, and nothing
    /// changed, where the lines from `next` on are not all kept.
    pub fn settle(&mut self, next: u32) -> bool {
        if !self.rewind(next) {
            return false;
        }
        while self.ack_one() {}
        true
    }

    /// Number of the oldest line that can be sent again.
    pub fn first(&self) -> u32 {
        self.first
    }

    /// Number of the oldest line without an acknowledgement.
    pub fn acked(&self) -> u32 {
        self.acked
    }

    /// Number of the line that is sent next, be it new or asked for again.
    pub fn cursor(&self) -> u32 {
        self.cursor
    }

    /// Number that the next new line gets.
    pub fn next(&self) -> u32 {
        // `push` keeps this sum within 32 bits.
        self.first + self.entries.len() as u32
    }

    /// Whether every line that was pushed has also been sent.
    pub fn all_sent(&self) -> bool {
        self.cursor == self.next()
    }

    /// Whether no sent line waits for its acknowledgement.
    pub fn is_idle(&self) -> bool {
        self.acked == self.cursor
    }

    /// Tags of the lines in flight, oldest first.
    pub fn in_flight(&self) -> impl Iterator<Item = Tag> + '_ {
        let from = (self.acked - self.first) as usize;
        let count = (self.cursor - self.acked) as usize;
        self.entries.iter().skip(from).take(count).map(|e| e.tag)
    }

    /// The tag of line `n`, if it is still kept.
    pub fn tag(&self, n: u32) -> Option<Tag> {
        let at = n.checked_sub(self.first)?;
        self.entries.get(at as usize).map(|e| e.tag)
    }

    /// The framed line `n` without its line feed, if it is still kept.
    pub fn line(&self, n: u32) -> Option<Vec<u8>> {
        let at = n.checked_sub(self.first)? as usize;
        let entry = self.entries.get(at)?;
        let start: usize = self.entries.iter().take(at).map(|e| e.len).sum();
        let framed = self.bytes.range(start..start + entry.len - 1);
        Some(framed.copied().collect())
    }

    /// Whether a line of `len` bytes, line feed included, may go now.
    ///
    /// One line always may when nothing is in flight: a long Klipper line would
    /// otherwise wait for ever.
    pub fn has_room(&self, len: usize) -> bool {
        let lines = (self.cursor - self.acked) as usize;
        lines == 0
            || match self.limit {
                Limit::Bytes(max) => self.in_flight_bytes + len <= max,
                Limit::Lines(max) => lines < max,
            }
    }

    /// Puts a new line at the end, numbered; it is sent in its turn.
    ///
    /// `false`, and nothing changed, when the line numbers are used up.
    pub fn push(&mut self, command: &[u8], tag: Tag) -> bool {
        let n = self.next();
        if n > MAX_NUMBER {
            return false;
        }
        self.forget_old();
        self.scratch.clear();
        frame(n, command, &mut self.scratch);
        self.bytes.extend(&self.scratch);
        self.entries.push_back(Entry { len: self.scratch.len(), tag });
        true
    }

    /// Appends the line at the cursor to `out` if the window has room for it, or
    /// in any case if `force`. Returns whether a line went out.
    pub fn send_next(&mut self, out: &mut Vec<u8>, force: bool) -> bool {
        let Some(entry) = self.entries.get((self.cursor - self.first) as usize) else {
            return false;
        };
        let len = entry.len;
        if !force && !self.has_room(len) {
            return false;
        }
        let start = self.history_bytes + self.in_flight_bytes;
        append(&self.bytes, start, len, out);
        self.cursor += 1;
        self.in_flight_bytes += len;
        true
    }

    /// Acknowledges the oldest line in flight, if there is one.
    pub fn ack_one(&mut self) -> bool {
        if self.is_idle() {
            return false;
        }
        let len = self.entries[(self.acked - self.first) as usize].len;
        self.acked += 1;
        self.history_bytes += len;
        self.in_flight_bytes -= len;
        true
    }

    /// Acknowledges every line in flight up to and with line `n`.
    pub fn ack_through(&mut self, n: u32) {
        while self.acked <= n && self.ack_one() {}
    }

    /// The oldest line in flight of this kind.
    pub fn find_in_flight(&self, kind: Kind) -> Option<u32> {
        let at = self.in_flight().position(|tag| tag.kind == kind)?;
        Some(self.acked + at as u32)
    }

    /// The printer wants line `n` and all after it again: they are no longer in
    /// flight, the lines below `n` still are. `false` if `n` is not kept.
    pub fn rewind(&mut self, n: u32) -> bool {
        if n < self.first || n > self.next() {
            return false;
        }
        while self.acked > n {
            self.acked -= 1;
            self.history_bytes -= self.entries[(self.acked - self.first) as usize].len;
        }
        self.cursor = n;
        let from = (self.acked - self.first) as usize;
        let count = (self.cursor - self.acked) as usize;
        let in_flight = self.entries.iter().skip(from).take(count);
        self.in_flight_bytes = in_flight.map(|e| e.len).sum();
        true
    }

    /// Forgets the lines that are still to send: what the printer does not have,
    /// it shall not get.
    pub fn truncate(&mut self) {
        self.entries.truncate((self.cursor - self.first) as usize);
        self.bytes.truncate(self.history_bytes + self.in_flight_bytes);
    }

    fn forget_old(&mut self) {
        while self.first < self.acked
            && (self.entries.len() >= HISTORY_LINES || self.bytes.len() >= HISTORY_BYTES)
            && let Some(old) = self.entries.pop_front()
        {
            self.bytes.drain(..old.len);
            self.history_bytes -= old.len;
            self.first += 1;
        }
    }
}

/// Appends `ring[start..start + len]`, which may lie in two pieces.
fn append(ring: &VecDeque<u8>, start: usize, len: usize, out: &mut Vec<u8>) {
    let (head, tail) = ring.as_slices();
    let end = start + len;
    let split = head.len();
    if start < split {
        out.extend_from_slice(&head[start..end.min(split)]);
    }
    if end > split {
        out.extend_from_slice(&tail[start.saturating_sub(split)..end - split]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const JOB: Tag = Tag { job_line: 1, kind: Kind::Quick };

    fn sent(window: &mut Window) -> String {
        let mut out = Vec::new();
        while window.send_next(&mut out, false) {}
        String::from_utf8(out).unwrap()
    }

    fn filled(limit: Limit, lines: usize) -> Window {
        let mut window = Window::new(limit);
        for _ in 0..lines {
            assert!(window.push(b"G1 X1", JOB));
        }
        window
    }

    #[test]
    fn counts_bytes() {
        // `N1 G1 X1*99\n` is 12 bytes; three of them fit 40.
        let mut window = filled(Limit::Bytes(40), 5);
        assert_eq!(sent(&mut window).lines().count(), 3);
        assert_eq!(sent(&mut window), "");
        assert!(window.ack_one());
        assert_eq!(sent(&mut window).lines().count(), 1);
        assert_eq!((window.acked(), window.cursor(), window.next()), (2, 5, 6));
    }

    #[test]
    fn counts_lines() {
        let mut window = filled(Limit::Lines(1), 3);
        assert_eq!(sent(&mut window).lines().count(), 1);
        assert!(window.ack_one());
        assert!(sent(&mut window).starts_with("N2 "));
    }

    #[test]
    fn a_line_longer_than_the_window_goes_alone() {
        let mut window = Window::new(Limit::Bytes(20));
        window.push(&[b'X'; 500], JOB);
        window.push(b"G1", JOB);
        assert_eq!(sent(&mut window).lines().count(), 1);
        window.ack_one();
        assert_eq!(sent(&mut window).lines().count(), 1);
    }

    #[test]
    fn rewinds_below_what_was_acknowledged() {
        let mut window = filled(Limit::Bytes(1000), 6);
        sent(&mut window);
        window.ack_through(4);
        assert!(window.rewind(3));
        assert_eq!((window.acked(), window.cursor()), (3, 3));
        assert!(sent(&mut window).starts_with("N3 "));
        // A request inside the flight keeps what lies below it.
        assert!(window.rewind(5));
        assert_eq!((window.acked(), window.cursor()), (3, 5));
        assert!(!window.rewind(8));
        assert!(!window.rewind(0));
    }

    #[test]
    fn acknowledgements_without_flight_do_nothing() {
        let mut window = filled(Limit::Bytes(100), 1);
        assert!(!window.ack_one());
        window.ack_through(9);
        assert_eq!(window.acked(), 1);
        sent(&mut window);
        window.ack_through(9);
        assert_eq!(window.acked(), 2);
    }

    #[test]
    fn truncates_what_is_to_send() {
        let mut window = filled(Limit::Bytes(1000), 3);
        sent(&mut window);
        window.rewind(2);
        window.truncate();
        assert_eq!(window.next(), 2);
        window.push(b"M107", JOB);
        assert!(sent(&mut window).starts_with("N2 M107*"));
    }

    #[test]
    fn keeps_a_bounded_history() {
        let mut window = Window::new(Limit::Bytes(120));
        for _ in 0..10_000 {
            window.push(b"G1 X10.123 Y20.456 E.01234", JOB);
            sent(&mut window);
            window.ack_one();
        }
        assert!(window.bytes.len() <= HISTORY_BYTES + 128);
        assert_eq!(window.entries.len(), HISTORY_LINES);
        let old = window.first();
        assert!(window.rewind(old));
        assert!(window.line(old).unwrap().starts_with(b"N97"));
        assert!(!window.rewind(old - 1));
    }

    #[derive(Debug, Clone)]
    enum Step {
        Push(usize),
        Send(bool),
        Ack,
        AckThrough(u32),
        Rewind(u32),
        Truncate,
    }

    fn step() -> impl Strategy<Value = Step> {
        prop_oneof![
            4 => (1_usize..60).prop_map(Step::Push),
            6 => any::<bool>().prop_map(Step::Send),
            4 => Just(Step::Ack),
            1 => (0_u32..50).prop_map(Step::AckThrough),
            1 => (0_u32..50).prop_map(Step::Rewind),
            1 => Just(Step::Truncate),
        ]
    }

    proptest! {
        /// Against the plainest model: a list of all lines and three numbers.
        #[test]
        fn does_what_the_model_does(steps in prop::collection::vec(step(), 0..200)) {
            let mut window = Window::new(Limit::Bytes(120));
            let mut lines: Vec<Vec<u8>> = Vec::new();
            let (mut acked, mut cursor) = (0_usize, 0_usize);
            for step in steps {
                match step {
                    Step::Push(len) => {
                        let command = vec![b'G'; len];
                        let mut framed = Vec::new();
                        frame(lines.len() as u32 + 1, &command, &mut framed);
                        prop_assert!(window.push(&command, JOB));
                        lines.push(framed);
                    }
                    Step::Send(force) => {
                        let flight: usize = lines[acked..cursor].iter().map(Vec::len).sum();
                        let may = lines.get(cursor).filter(|l| force || acked == cursor || flight + l.len() <= 120);
                        let mut out = Vec::new();
                        prop_assert_eq!(window.send_next(&mut out, force), may.is_some());
                        if let Some(line) = may {
                            prop_assert_eq!(&out, line);
                            cursor += 1;
                        }
                    }
                    Step::Ack => {
                        prop_assert_eq!(window.ack_one(), acked < cursor);
                        acked = cursor.min(acked + 1);
                    }
                    Step::AckThrough(n) => {
                        window.ack_through(n);
                        acked = acked.max(cursor.min(n as usize));
                    }
                    Step::Rewind(n) => {
                        let kept = n >= 1 && n as usize <= lines.len() + 1;
                        prop_assert_eq!(window.rewind(n), kept);
                        if kept {
                            cursor = n as usize - 1;
                            acked = acked.min(cursor);
                        }
                    }
                    Step::Truncate => {
                        window.truncate();
                        lines.truncate(cursor);
                    }
                }
                prop_assert_eq!(window.acked() as usize, acked + 1);
                prop_assert_eq!(window.cursor() as usize, cursor + 1);
                prop_assert_eq!(window.next() as usize, lines.len() + 1);
            }
        }
    }
}
