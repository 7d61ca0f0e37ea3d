//! What is written down of a job, and the picture that the records add up to.
//!
//! Plain data; how records look on a medium is the journal's matter.
use super::state::State;
use std::path::PathBuf;

/// A SHA-256.
pub type Digest = [u8; 32];

/// Numbers on the wire below the last checkpoint that are still told apart. An `ok`
/// does not prove acceptance: after a checkpoint the printer's last line may be lower
/// than what was acknowledged, by what its buffers hold (at most some 256 lines).
pub const SETTLE_MARGIN: u32 = 1024;

/// Numbers kept that are not the file's: six days of a question every 2 s without
/// one command of the file getting on. Beyond, numbers say nothing any more.
pub const MAX_OWN: usize = 1 << 18;

/// Longest text kept of a record: PATH_MAX of Linux, and far more than a port's name or
/// a failure's words have. The rest is left out.
pub const MAX_TEXT_BYTES: usize = 4096;

/// As much of a text as is kept.
pub(super) fn kept(text: &str) -> &str {
    &text[..text.floor_char_boundary(MAX_TEXT_BYTES)]
}

/// What is known of a job from its acceptance on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Accepted {
    /// The file, absolute.
    pub path: PathBuf,
    /// SHA-256 of its bytes.
    pub digest: Digest,
    /// Its bytes.
    pub bytes: u64,
    /// Lines of it that are sent.
    pub commands: u64,
    /// Number of the last of these in the file, from 1.
    pub last_line: u64,
    /// Bytes of a chunk of `chunks`, the last may be shorter.
    pub chunk_bytes: u32,
    /// The first 16 bytes of the SHA-256 of each chunk.
    pub chunks: Vec<[u8; 16]>,
    /// The printer's profile as it was named: a name, or an absolute path.
    pub profile: String,
    /// When, in seconds since 1970.
    pub at_unix_s: u64,
    /// Tells whether the file was written to since, from what the file system says of
    /// it (`disk::stamp`); 0: not known.
    pub stamp: u64,
}

/// How far a job is, as far as the printer has acknowledged it.
///
/// A position in a job is a count of its commands: `n` means that the first `n`
/// lines of the file that are sent (M110 not among them) were acknowledged.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Checkpoint {
    /// Commands of the file that were acknowledged.
    pub commands: u64,
    /// The file's line number of the last of these; 0 before the first.
    pub line: u64,
    /// Layers begun, by the file's marks; 0: none, or not marked.
    pub layer: u32,
    /// Z after the last of these, mm, in the file's coordinates.
    pub z_mm: f64,
    /// Measured and wanted temperature of the active nozzle, °C.
    pub nozzle_c: [f32; 2],
    /// The bed's, °C.
    pub bed_c: [f32; 2],
}

/// One entry of the journal.
#[derive(Debug, Clone, PartialEq)]
pub enum Record {
    /// The job is accepted. Always the first.
    Accepted(Accepted),
    /// A host has opened a port for it.
    Opened {
        /// What finds the printer again: a path, or `usb:SERIAL`.
        port: String,
        /// Bits per second.
        baud: u32,
        /// When, in seconds since 1970.
        at_unix_s: u64,
    },
    /// It is in another state.
    State(State),
    /// From now on the line numbered `first` on the wire is the first command of the
    /// file after `after` commands, and each following number the following
    /// command, up to the next `Own` or `Numbers`.
    Numbers {
        /// Number on the wire.
        first: u32,
        /// Commands of the file before it.
        after: u64,
    },
    /// The number `n` is not the file's: commands go on with `n + 1`.
    Own {
        /// Number on the wire.
        n: u32,
    },
    /// The count on the wire begins anew and says nothing of the file until the next
    /// `Numbers`: exactly `after` commands of the file were accepted.
    Unnumbered {
        /// Commands of the file.
        after: u64,
    },
    /// How far it is.
    Checkpoint(Checkpoint),
    /// The safe sequence ran; the nozzle is now at this height, mm, in the file's
    /// coordinates, if that is known.
    MadeSafe {
        /// Height, mm.
        z_mm: Option<f64>,
    },
    /// The printer has told that it may hold so many moves that it has accepted and not
    /// made: more than its profile says.
    Depth(u32),
    /// What a person should know when looking at the job: a failure's words.
    Note(String),
}

/// What all records of a job add up to.
#[derive(Debug, Clone, PartialEq)]
pub struct Log {
    /// The job.
    pub accepted: Accepted,
    /// Where it is.
    pub state: State,
    /// Port and baud of the last host, and when it began.
    pub opened: Option<(String, u32, u64)>,
    /// Times that a port was opened for it.
    pub starts: u32,
    /// Which command a number on the wire is; `None` before the file's first line.
    pub numbers: Numbers,
    /// How far it is.
    pub checkpoint: Checkpoint,
    /// The last safe sequence, if nothing moved since.
    pub made_safe: Option<Option<f64>>,
    /// The most moves that the printer has told it may hold; 0: it told nothing.
    pub depth: u32,
    /// The last note.
    pub note: Option<String>,
    /// The journal was damaged in its middle: records after the damage are lost, and
    /// the job may be further than all of this says.
    pub damaged: bool,
}

/// Which command of the file a number on the wire is.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Numbers {
    /// Numbers say nothing; so many commands of the file were accepted.
    Nothing {
        /// Commands of the file.
        after: u64,
    },
    /// Numbers from `first` on are the file's, but for those in `own`.
    Job {
        /// Number on the wire.
        first: u32,
        /// Commands of the file before it.
        after: u64,
        /// Numbers that are not the file's, ascending.
        own: Vec<u32>,
    },
}

impl Numbers {
    /// How many commands of the file a printer has accepted whose last line was `last`;
    /// `None` for a number that the job cannot have come to.
    pub fn commands_through(&self, last: u32) -> Option<u64> {
        match self {
            Numbers::Nothing { after } => Some(*after),
            Numbers::Job { first, after, own } => {
                let sent = (u64::from(last) + 1).checked_sub(u64::from(*first))?;
                let not_ours = own.partition_point(|n| *n <= last) as u64;
                Some(after + sent.saturating_sub(not_ours))
            }
        }
    }

    /// Numbers of which nothing is known: no number leads to a place in the file.
    pub fn unknown() -> Self {
        Numbers::Job { first: u32::MAX, after: 0, own: Vec::new() }
    }

    /// `n` is not the file's.
    fn not_ours(&mut self, n: u32) {
        let Numbers::Job { own, first, .. } = self else { return };
        if own.last().is_some_and(|last| n <= *last) || n < *first {
            // Told twice, or of a count that is over.
            return;
        }
        if own.len() >= MAX_OWN {
            // A wrong place is worse than none.
            *self = Numbers::unknown();
            return;
        }
        own.push(n);
    }

    /// `commands` commands of the file were acknowledged: numbers more than
    /// [`SETTLE_MARGIN`] below that one are put together, so that `own` stays short.
    /// Every number above them leads where it led before; those below lead nowhere.
    fn settle(&mut self, commands: u64) {
        let Some(acked) = self.number_of(commands) else { return };
        let Numbers::Job { first, after, own } = self else { return };
        let Some(cut) = acked.checked_sub(SETTLE_MARGIN).filter(|cut| *cut > *first) else { return };
        let below = own.partition_point(|n| *n < cut);
        *after += u64::from(cut - *first) - below as u64;
        *first = cut;
        own.drain(..below);
    }

    /// The number on the wire of the file's command `commands`; `None` where that is
    /// before the first, or no number.
    fn number_of(&self, commands: u64) -> Option<u32> {
        let Numbers::Job { first, after, own } = self else { return None };
        let mut n = u64::from(*first) + commands.checked_sub(*after)?.checked_sub(1)?;
        for not_ours in own {
            if u64::from(*not_ours) > n {
                break;
            }
            n += 1;
        }
        u32::try_from(n).ok()
    }
}

impl Log {
    /// The picture after the first record.
    pub fn new(accepted: Accepted) -> Self {
        Self {
            accepted,
            state: State::Accepted,
            opened: None,
            starts: 0,
            numbers: Numbers::Nothing { after: 0 },
            checkpoint: Checkpoint::default(),
            made_safe: None,
            depth: 0,
            note: None,
            damaged: false,
        }
    }

    /// The picture of a journal that was damaged in its middle: a job that is not over
    /// was broken off somewhere, and no number on the wire tells where.
    pub fn distrust(&mut self) {
        self.damaged = true;
        self.numbers = Numbers::unknown();
        if !self.state.is_over() {
            self.state = State::Interrupted;
        }
    }

    /// The picture after one more record.
    pub fn apply(&mut self, record: &Record) {
        match record {
            // Only the first record is one; a second changes nothing.
            Record::Accepted(_) => {}
            Record::Opened { port, baud, at_unix_s } => {
                self.opened = Some((kept(port).to_owned(), *baud, *at_unix_s));
                self.starts += 1;
            }
            Record::State(state) => self.state = *state,
            Record::Numbers { first, after } => {
                self.numbers = Numbers::Job { first: *first, after: *after, own: Vec::new() };
                self.made_safe = None;
            }
            Record::Own { n } => self.numbers.not_ours(*n),
            Record::Unnumbered { after } => self.numbers = Numbers::Nothing { after: *after },
            Record::Checkpoint(checkpoint) => {
                self.checkpoint = *checkpoint;
                self.numbers.settle(checkpoint.commands);
            }
            Record::MadeSafe { z_mm } => self.made_safe = Some(*z_mm),
            Record::Depth(moves) => self.depth = self.depth.max(*moves),
            Record::Note(text) => self.note = Some(kept(text).to_owned()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Numbers as the host tells them: `ours[k]` says whether number `first + k` is the
    /// file's.
    fn numbers(first: u32, after: u64, ours: &[bool]) -> Numbers {
        let mut numbers = Numbers::Job { first, after, own: Vec::new() };
        for (k, _) in ours.iter().enumerate().filter(|(_, ours)| !**ours) {
            numbers.not_ours(first + k as u32);
        }
        numbers
    }

    #[test]
    fn a_number_leads_to_a_place_in_the_file() {
        let n = numbers(10, 5, &[true, true, false, true, false]);
        let check = |last, expect| assert_eq!(n.commands_through(last), expect, "N{last}");
        check(8, None);
        check(9, Some(5));
        check(10, Some(6));
        check(11, Some(7));
        check(12, Some(7));
        check(13, Some(8));
        check(14, Some(8));
        check(15, Some(9));
        assert_eq!(Numbers::Nothing { after: 3 }.commands_through(77), Some(3));
        assert_eq!(Numbers::unknown().commands_through(77), None);
    }

    #[test]
    fn a_count_that_is_over_tells_nothing() {
        let mut n = numbers(10, 5, &[true, false]);
        for old in [3, 11, 9] {
            n.not_ours(old);
        }
        assert_eq!(n, Numbers::Job { first: 10, after: 5, own: vec![11] });
    }

    #[test]
    fn more_numbers_than_can_be_kept_lead_nowhere() {
        let mut n = numbers(0, 0, &[]);
        (0..=MAX_OWN as u32).for_each(|own| n.not_ours(own));
        assert_eq!(n, Numbers::unknown());
    }

    proptest! {
        /// A checkpoint changes no number that a printer may still name as its last.
        #[test]
        fn settling_changes_no_answer(
            first in 0..100_000u32,
            after in 0..1_000_000u64,
            runs in prop::collection::vec((any::<bool>(), 1..400usize), 1..40),
            acked: prop::sample::Index,
        ) {
            let ours: Vec<bool> =
                runs.iter().flat_map(|(ours, len)| std::iter::repeat_n(*ours, *len)).collect();
            let before = numbers(first, after, &ours);
            let last = first + acked.index(ours.len()) as u32;
            let commands = before.commands_through(last).unwrap();
            let mut settled = before.clone();
            settled.settle(commands);
            let lowest = last.saturating_sub(SETTLE_MARGIN).max(first.saturating_sub(1));
            // The acknowledged number may be followed by some that are not the file's.
            let lowest = before.number_of(commands).map_or(lowest, |n| n.saturating_sub(SETTLE_MARGIN).max(lowest));
            for n in lowest..first + ours.len() as u32 + 10 {
                prop_assert_eq!(settled.commands_through(n), before.commands_through(n), "N{}", n);
            }
            if let Numbers::Job { first: from, own, .. } = &settled {
                prop_assert!(own.first().is_none_or(|n| n >= from), "{:?}", own);
            }
        }
    }
}
