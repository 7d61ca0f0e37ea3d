//! Scripted and random faults: what goes wrong, and at which line or time.
//!
//! Takes TOML, gives a [`Faults`] that the firmware asks at each line, each
//! `ok` and each moment. Random faults come from a seed, so that every run is
//! the same run.
//!
//! What a file may say is in [`HELP`], which `outrigger mock --help-faults` prints.
use serde::Deserialize;

/// What a faults file may say, for people.
pub const HELP: &str = r#"Faults of the mock printer, in TOML. All parts are optional.

[random]              # shares of the numbered lines, 0 to 1
seed = 7              # the same seed gives the same faults
corrupt_line = 0.01   # one byte is damaged on its way in
drop_ok = 0.01        # the line's ok is not sent
garble_reply = 0.01   # one byte of the line's ok is damaged

[[fault]]
at_line = 120         # when the line with this number comes (or its ok goes)
do = "corrupt_line"
byte = 0              # which byte of the line, from 0 (default: the middle one)
times = 3             # for its first 3 arrivals (default 1)

[[fault]]
at_s = 12.5           # real seconds since the mock was started; a fault that
do = "hang_up"        # needs a line then takes the next one
for_s = 3.0

do                 needs  what happens
corrupt_line              a byte of the line is damaged before it is checked
resend_without_ok         the same, and the ok after its "Resend:" is missing,
                          as in some versions of Marlin
drop_ok                   the line is executed, its ok is not sent
garble_reply              a byte of its ok is damaged
noise              text   these bytes go out before its ok, without a line end
say                text   this line goes out, e.g. "//action:pause"
kill               text   "Error:" and this text, then the board halts
reset                     the board restarts, as after a brown-out
hang               for_s  the board does nothing for so long; bytes are lost
hang_up            for_s  the serial device is gone for so long
"#;

/// Most entries of a faults file: each is looked at for every line.
const FAULTS_MAX: usize = 1000;

/// Longest `for_s` and `at_s`: a day.
const SECONDS_MAX: f64 = 86_400.0;

/// Longest `text`, in bytes.
const TEXT_BYTES_MAX: usize = 200;

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(missing_docs, reason = "the table of HELP describes each")]
pub enum Kind {
    CorruptLine,
    ResendWithoutOk,
    DropOk,
    GarbleReply,
    Noise,
    Say,
    Kill,
    Reset,
    Hang,
    HangUp,
}

/// One entry, as it stands in the file.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// When the line with this number comes.
    pub at_line: Option<i64>,
    /// Real seconds since the start.
    pub at_s: Option<f64>,
    /// What goes wrong.
    #[serde(rename = "do")]
    pub kind: Kind,
    /// How long, s.
    pub for_s: Option<f64>,
    /// What is said.
    pub text: Option<String>,
    /// Which byte of the line, from 0.
    pub byte: Option<usize>,
    /// For how many arrivals of the line (default 1).
    pub times: Option<u32>,
}

/// Shares of lines that something happens to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Random {
    /// Where the generator begins.
    pub seed: u64,
    /// Share of lines, 0 to 1.
    pub corrupt_line: f64,
    /// Share of lines, 0 to 1.
    pub drop_ok: f64,
    /// Share of lines, 0 to 1.
    pub garble_reply: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct File {
    random: Random,
    fault: Vec<Fault>,
}

/// Why a faults file is none.
#[derive(Debug, thiserror::Error)]
pub enum FaultsError {
    /// Not TOML, or an unknown key; the text has line and column.
    #[error("{0}")]
    Toml(Box<toml::de::Error>),
    /// An entry that makes no sense.
    #[error("fault {number} ({kind:?}): {why}")]
    Entry {
        /// Which `[[fault]]`, from 1.
        number: usize,
        /// Its kind.
        kind: Kind,
        /// What is missing or out of range.
        why: &'static str,
    },
    /// A share outside 0 to 1.
    #[error("random.{key} is {value}, outside 0 to 1")]
    Share {
        /// The key.
        key: &'static str,
        /// Its value.
        value: f64,
    },
    /// More entries than are looked at.
    #[error("{0} faults; at most {FAULTS_MAX} are taken")]
    TooMany(usize),
}

/// The faults that are still to come.
#[derive(Clone, Debug, Default)]
pub struct Faults {
    random: Random,
    state: u64,
    pending: Vec<(Fault, u32)>,
}

impl Faults {
    /// Reads a faults file.
    ///
    /// # Errors
    /// [`FaultsError`]: what is wrong and where.
    pub fn parse(text: &str) -> Result<Self, FaultsError> {
        let file: File = toml::from_str(text).map_err(|e| FaultsError::Toml(Box::new(e)))?;
        Self::new(file.random, file.fault)
    }

    /// Faults from values.
    ///
    /// # Errors
    /// [`FaultsError`]: an entry that makes no sense.
    pub fn new(random: Random, faults: Vec<Fault>) -> Result<Self, FaultsError> {
        for (key, value) in [
            ("corrupt_line", random.corrupt_line),
            ("drop_ok", random.drop_ok),
            ("garble_reply", random.garble_reply),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return Err(FaultsError::Share { key, value });
            }
        }
        if faults.len() > FAULTS_MAX {
            return Err(FaultsError::TooMany(faults.len()));
        }
        for (at, fault) in faults.iter().enumerate() {
            if let Some(why) = fault.wrong() {
                return Err(FaultsError::Entry { number: at + 1, kind: fault.kind, why });
            }
        }
        Ok(Self {
            random,
            // Any odd number spreads the seeds; 0 would stay 0 for ever.
            state: random.seed.wrapping_mul(2) | 1,
            pending: faults.into_iter().map(|f| (f.clone(), f.times.unwrap_or(1))).collect(),
        })
    }

    /// A line has come: damages it if it is its turn. True when the resend
    /// request that follows must lack its `ok`.
    pub(crate) fn damage(&mut self, number: Option<i64>, line: &mut [u8]) -> bool {
        if number.is_none() || line.is_empty() {
            return false;
        }
        let kinds = [Kind::CorruptLine, Kind::ResendWithoutOk];
        if let Some(fault) = self.take_for_line(number, &kinds) {
            let at = fault.byte.unwrap_or(line.len() / 2).min(line.len() - 1);
            line[at] ^= 1;
            return fault.kind == Kind::ResendWithoutOk;
        }
        if self.chance(self.random.corrupt_line) {
            let at = (self.next() >> 32) as usize % line.len();
            // The low bits: letters and digits become others of their kind.
            line[at] ^= 1 << (self.next() >> 62);
        }
        false
    }

    /// The `ok` of a line is to go out: changes its bytes.
    pub(crate) fn reply(&mut self, number: Option<i64>, ok: &mut Vec<u8>) {
        if number.is_none() {
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

    /// What happens at a time, in real seconds.
    pub(crate) fn event_at_time(&mut self, now_s: f64) -> Option<Fault> {
        let due = |f: &Fault| EVENTS.contains(&f.kind) && f.at_s.is_some_and(|at| at <= now_s);
        let at = self.pending.iter().position(|(f, _)| due(f))?;
        Some(self.pending.remove(at).0)
    }

    /// When [`Self::event_at_time`] next has something.
    pub(crate) fn next_event_s(&self) -> Option<f64> {
        self.pending
            .iter()
            .filter(|(f, _)| EVENTS.contains(&f.kind))
            .filter_map(|(f, _)| f.at_s)
            .min_by(f64::total_cmp)
    }

    /// Tells the time, so that timed faults of lines know their next line.
    pub(crate) fn arm(&mut self, now_s: f64, next_number: i64) {
        for (fault, _) in &mut self.pending {
            if !EVENTS.contains(&fault.kind) && fault.at_s.is_some_and(|at| at <= now_s) {
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

/// Faults that do not concern one line's bytes or its `ok`.
const EVENTS: [Kind; 5] = [Kind::Say, Kind::Kill, Kind::Reset, Kind::Hang, Kind::HangUp];

impl Fault {
    fn wrong(&self) -> Option<&'static str> {
        let seconds = |s: Option<f64>| s.is_none_or(|s| (0.0..=SECONDS_MAX).contains(&s));
        let times_without_line = self.times.is_some() && self.at_line.is_none();
        if self.at_line.is_some() == self.at_s.is_some() {
            return Some("needs either at_line or at_s");
        }
        if !seconds(self.at_s) || !seconds(self.for_s) {
            return Some("at_s and for_s are seconds from 0 to 86400");
        }
        if matches!(self.kind, Kind::Hang | Kind::HangUp) != self.for_s.is_some() {
            return Some("hang and hang_up need for_s, and nothing else has it");
        }
        if matches!(self.kind, Kind::Noise | Kind::Say | Kind::Kill) != self.text.is_some() {
            return Some("noise, say and kill need text, and nothing else has it");
        }
        if self.text.as_ref().is_some_and(|t| t.len() > TEXT_BYTES_MAX) {
            return Some("text has more than 200 bytes");
        }
        if self.byte.is_some() && !matches!(self.kind, Kind::CorruptLine | Kind::ResendWithoutOk) {
            return Some("only corrupt_line and resend_without_ok have byte");
        }
        if self.times == Some(0) || times_without_line {
            return Some("times is at least 1 and goes with at_line");
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check_file(text: &str, expect: &str) {
        match Faults::parse(text) {
            Ok(_) => assert_eq!(expect, "", "{text:?}"),
            Err(e) => {
                let said = e.to_string();
                assert!(!expect.is_empty() && said.contains(expect), "{text:?}: {said}");
            }
        }
    }

    #[test]
    fn the_example_of_the_help_is_valid() {
        let example = HELP.split_once("\ndo  ").unwrap().0.split_once('\n').unwrap().1;
        assert_eq!(Faults::parse(example).unwrap().pending.len(), 2);
        for kind in HELP.split_once("what happens\n").unwrap().1.lines() {
            let Some(name) = kind.split(' ').next().filter(|n| !n.is_empty()) else {
                continue;
            };
            let text = format!("[[fault]]\nat_line = 1\ndo = {name:?}");
            let said = Faults::parse(&text).map_or_else(|e| e.to_string(), |_| String::new());
            assert!(!said.contains("variant"), "{said}");
        }
    }

    #[test]
    fn files_are_checked() {
        let fault = |rest: &str| format!("[[fault]]\n{rest}");
        check_file("", "");
        check_file("[random]\nseed=1\ndrop_ok=0.5", "");
        check_file("[random]\ndrop_ok=1.5", "random.drop_ok is 1.5");
        check_file("[random]\ndrop_oks=0.5", "line 2");
        check_file(&fault("at_line=1\ndo='drop_ok'"), "");
        check_file(&fault("at_line=1\ndo='drop'"), "line 3");
        check_file(&fault("do='drop_ok'"), "fault 1 (DropOk): needs either");
        check_file(&fault("at_line=1\nat_s=1\ndo='drop_ok'"), "needs either");
        check_file(&fault("at_s=-1\ndo='drop_ok'"), "seconds");
        check_file(&fault("at_s=nan\ndo='drop_ok'"), "seconds");
        check_file(&fault("at_s=1\ndo='hang'"), "need for_s");
        check_file(&fault("at_s=1\nfor_s=1\ndo='reset'"), "nothing else");
        check_file(&fault("at_s=1\ndo='say'"), "need text");
        check_file(&fault("at_s=1\ndo='reset'\nbyte=1"), "byte");
        check_file(&fault("at_s=1\ndo='drop_ok'\ntimes=2"), "times");
        check_file(&"[[fault]]\nat_s=1\ndo='reset'\n".repeat(1001), "at most 1000");
    }

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
            assert!(!faults.damage(Some(5), &mut line));
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
        assert_eq!(faults.next_event_s(), Some(2.0));
        assert!(faults.event_at_time(1.9).is_none());
        faults.arm(1.5, 42);
        assert_eq!(faults.event_at_time(2.0).unwrap().kind, Kind::Reset);
        assert!(faults.event_at_time(99.0).is_none());
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
                    let mut line = *b"N1 G1 X1*77";
                    faults.damage(Some(n), &mut line);
                    line != *b"N1 G1 X1*77"
                })
                .collect::<Vec<_>>()
        };
        assert_eq!(hits(1), hits(1));
        assert_ne!(hits(1), hits(2));
        assert!((900..1100).contains(&hits(3).len()), "{}", hits(3).len());
    }
}
