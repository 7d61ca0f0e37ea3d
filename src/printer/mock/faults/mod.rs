//! Scripted and random faults: what goes wrong, and at which line or time.
//!
//! Takes TOML, gives a [`Faults`] that the firmware asks at each line, each
//! `ok` and each moment. Random faults come from a seed, so that every run is
//! the same run.
//!
//! What a file may say is in [`HELP`], which `outrigger mock --help-faults` prints.
mod file;

pub use file::{Fault, FaultsError, HELP, Kind, Random};

/// The faults that are still to come.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    random: Random,
    /// Whether any share of `random` is above 0.
    by_chance: bool,
    state: u64,
    pending: Vec<(Fault, u32)>,
}

/// What became of a line on its way in, besides damaged bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Damage {
    None,
    /// It never arrived.
    Lost,
    /// The resend request that follows must lack its `ok`.
    ResendWithoutOk,
}

impl Faults {
    /// Reads a faults file.
    ///
    /// # Errors
    /// [`FaultsError`]: what is wrong and where.
    pub fn parse(text: &str) -> Result<Self, FaultsError> {
        let file: file::File = toml::from_str(text).map_err(|e| FaultsError::Toml(Box::new(e)))?;
        Self::new(file.random, file.fault)
    }

    /// Faults from values.
    ///
    /// # Errors
    /// [`FaultsError`]: an entry that makes no sense.
    pub fn new(random: Random, faults: Vec<Fault>) -> Result<Self, FaultsError> {
        file::check(random, &faults)?;
        Ok(Self {
            random,
            by_chance: [random.corrupt_line, random.lose_line, random.drop_ok, random.garble_reply]
                .iter()
                .any(|share| *share > 0.0),
            // Any odd number spreads the seeds; 0 would stay 0 for ever.
            state: random.seed.wrapping_mul(2) | 1,
            pending: faults.into_iter().map(|f| (f.clone(), f.times.unwrap_or(1))).collect(),
        })
    }

    /// One more, which comes before older ones of the same line.
    pub(crate) fn add(&mut self, fault: Fault) {
        let times = fault.times.unwrap_or(1);
        self.pending.insert(0, (fault, times));
    }

    /// A line has come: damages it if it is its turn.
    pub(crate) fn damage(&mut self, number: Option<i64>, line: &mut Vec<u8>) -> Damage {
        if number.is_none() || line.is_empty() || self.is_over() {
            return Damage::None;
        }
        let kinds = [Kind::CorruptLine, Kind::ResendWithoutOk, Kind::LoseLine, Kind::DropByte];
        if let Some(fault) = self.take_for_line(number, &kinds) {
            let at = fault.byte.unwrap_or(line.len() / 2).min(line.len() - 1);
            match fault.kind {
                Kind::LoseLine => return Damage::Lost,
                Kind::DropByte => drop(line.remove(at)),
                _ => line[at] ^= 1,
            }
            let silent = fault.kind == Kind::ResendWithoutOk;
            return if silent { Damage::ResendWithoutOk } else { Damage::None };
        }
        if self.chance(self.random.lose_line) {
            return Damage::Lost;
        }
        if self.chance(self.random.corrupt_line) {
            let at = (self.next() >> 32) as usize % line.len();
            // The low bits: letters and digits become others of their kind.
            line[at] ^= 1 << (self.next() >> 62);
        }
        Damage::None
    }

    /// Nothing is left to happen: the common case, and it should cost nothing.
    fn is_over(&self) -> bool {
        self.pending.is_empty() && !self.by_chance
    }

    /// The `ok` of a line is to go out: changes its bytes.
    pub(crate) fn reply(&mut self, number: Option<i64>, ok: &mut Vec<u8>) {
        if number.is_none() || self.is_over() {
            return;
        }
        if self.take_for_line(number, &[Kind::DropOk]).is_some() || self.chance(self.random.drop_ok) {
            ok.clear();
            return;
        }
        let scripted = self.take_for_line(number, &[Kind::GarbleReply]).is_some();
        if scripted || self.chance(self.random.garble_reply) {
            // The line end stays, as most often in a short reply; which byte
            // is hit depends on the line, so that a script is repeatable.
            let at = number.unwrap_or(0).unsigned_abs() as usize % ok.len().max(2).div_euclid(2);
            if let Some(byte) = ok.get_mut(at) {
                *byte ^= 0x04;
            }
        }
        if self.take_for_line(number, &[Kind::CutReply]).is_some() {
            ok.truncate(ok.len() / 2);
        }
        while let Some(fault) = self.take_for_line(number, &[Kind::Noise]) {
            let text = fault.text.unwrap_or_default();
            ok.splice(0..0, text.into_bytes());
        }
    }

    /// What happens when a line is executed.
    pub(crate) fn event_at_line(&mut self, number: Option<i64>) -> Option<Fault> {
        number?;
        self.take_for_line(number, &EVENTS)
    }

    /// What happens at a time, in nanoseconds.
    pub(crate) fn event_at_time(&mut self, now_ns: u64) -> Option<Fault> {
        let due = |f: &Fault| EVENTS.contains(&f.kind) && at_ns(f).is_some_and(|at| at <= now_ns);
        let at = self.pending.iter().position(|(f, _)| due(f))?;
        Some(self.pending.remove(at).0)
    }

    /// When [`Self::event_at_time`] next has something.
    pub(crate) fn next_event_ns(&self) -> Option<u64> {
        self.pending.iter().filter(|(f, _)| EVENTS.contains(&f.kind)).filter_map(|(f, _)| at_ns(f)).min()
    }

    /// Tells the time, so that timed faults of lines know their next line.
    pub(crate) fn arm(&mut self, now_ns: u64, next_number: i64) {
        for (fault, _) in &mut self.pending {
            if !EVENTS.contains(&fault.kind) && at_ns(fault).is_some_and(|at| at <= now_ns) {
                fault.at_s = None;
                fault.at_line = Some(next_number);
            }
        }
    }

    fn take_for_line(&mut self, number: Option<i64>, kinds: &[Kind]) -> Option<Fault> {
        let at = self.pending.iter().position(|(f, _)| f.at_line == number && kinds.contains(&f.kind))?;
        let (fault, times) = &mut self.pending[at];
        *times = times.saturating_sub(1);
        let found = fault.clone();
        if *times == 0 {
            self.pending.remove(at);
        }
        Some(found)
    }

    fn chance(&mut self, share: f64) -> bool {
        share > 0.0 && (self.next() >> 11) as f64 / ((1u64 << 53) as f64) < share
    }

    /// xorshift64* (Vigna, 2016): enough to scatter faults.
    fn next(&mut self) -> u64 {
        self.state ^= self.state >> 12;
        self.state ^= self.state << 25;
        self.state ^= self.state >> 27;
        self.state.wrapping_mul(0x2545_f491_4f6c_dd1d)
    }
}

/// The time of a fault on the board's clock: one conversion for every use, or
/// a fault could be due for one and not yet for another.
fn at_ns(fault: &Fault) -> Option<u64> {
    fault.at_s.map(|s| (s * 1e9) as u64)
}

/// Faults that do not concern one line's bytes or its `ok`.
const EVENTS: [Kind; 9] = [
    Kind::Say,
    Kind::Kill,
    Kind::Reset,
    Kind::Hang,
    Kind::HangUp,
    Kind::Blocked,
    Kind::PowerCut,
    Kind::FilamentOut,
    Kind::PartRemoved,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lines_faults_come_as_often_as_asked() {
        let mut faults = Faults::parse(
            "[[fault]]\nat_line=5\ndo='corrupt_line'\nbyte=0\ntimes=2\n\
             [[fault]]\nat_line=5\ndo='drop_ok'\n\
             [[fault]]\nat_line=6\ndo='garble_reply'\n\
             [[fault]]\nat_line=6\ndo='noise'\ntext=\"\\u0001x\"",
        )
        .unwrap();
        let mut arrivals = Vec::new();
        for _ in 0..3 {
            let mut line = b"N5 G1*1".to_vec();
            assert_eq!(faults.damage(Some(5), &mut line), Damage::None);
            arrivals.push(line[0]);
        }
        assert_eq!(arrivals, b"OON");
        let reply = |faults: &mut Faults, n| {
            let mut ok = b"ok\n".to_vec();
            faults.reply(Some(n), &mut ok);
            String::from_utf8(ok).unwrap()
        };
        assert_eq!(reply(&mut faults, 5), "");
        assert_eq!(reply(&mut faults, 5), "ok\n");
        assert_eq!(reply(&mut faults, 6), "\u{1}xkk\n");
        assert_eq!(reply(&mut faults, 6), "ok\n");
        let mut unnumbered = b"ok\n".to_vec();
        faults.reply(None, &mut unnumbered);
        assert_eq!(unnumbered, b"ok\n");
    }

    #[test]
    fn timed_faults_wait_for_their_time_and_their_line() {
        let mut faults =
            Faults::parse("[[fault]]\nat_s=2\ndo='reset'\n[[fault]]\nat_s=1\ndo='drop_ok'").unwrap();
        assert_eq!(faults.next_event_ns(), Some(2_000_000_000));
        assert!(faults.event_at_time(1_999_999_999).is_none());
        faults.arm(1_500_000_000, 42);
        let found = faults.event_at_time(2_000_000_000).unwrap();
        assert_eq!(found.kind, Kind::Reset);
        assert!(faults.event_at_time(99_000_000_000).is_none());
        let mut ok = b"ok\n".to_vec();
        faults.reply(Some(42), &mut ok);
        assert_eq!(ok, b"");
    }

    #[test]
    fn random_faults_repeat_with_their_seed_and_hit_their_share() {
        let hits = |seed| {
            let random = Random { seed, corrupt_line: 0.1, ..Random::default() };
            let mut faults = Faults::new(random, Vec::new()).unwrap();
            (0..10_000)
                .filter(|&n| {
                    let mut line = b"N1 G1 X1*77".to_vec();
                    faults.damage(Some(n), &mut line);
                    line != b"N1 G1 X1*77"
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(hits(1), hits(1));
        assert_ne!(hits(1), hits(2));
        assert!((900..1100).contains(&hits(3).len()), "{}", hits(3).len());
    }
}
