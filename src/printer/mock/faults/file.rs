//! The file of faults: its keys, its checks, its help.
//!
//! Plain data; knows nothing of when a fault happens.
use serde::Deserialize;

/// What a faults file may say, for people.
pub const HELP: &str = r#"Faults of the mock printer, in TOML. All parts are optional.

[random]              # shares of the numbered lines, 0 to 1
seed = 7              # the same seed gives the same faults
corrupt_line = 0.01   # one byte is damaged on its way in
lose_line = 0.01      # the line never arrives
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
lose_line                 the line never arrives
drop_byte                 a byte of the line never arrives (byte, as above)
drop_ok                   the line is executed, its ok is not sent
garble_reply              a byte of its ok is damaged
cut_reply                 the second half of its ok and the line end are lost
noise              text   these bytes go out before its ok, without a line end
say                text   this line goes out, e.g. "//action:pause"
kill               text   "Error:" and this text, then the board halts
reset                     the board restarts, as after a brown-out
hang               for_s  the board does nothing for so long; bytes are lost
hang_up (unplug)   for_s  the serial device is gone for so long, and what is on
                          the wire is lost; the board goes on, or with
                          reset = true it has restarted when the device is back
blocked            for_s  the device takes no more bytes from the host
power_cut          for_s  no power: the position is lost, it cools; Z sinks by
                          sag_mm (default 0); with unplugs = true the serial
                          device is gone meanwhile
filament_out              the runout sensor: //action:out_of_filament, and the
                          board waits as for M600
part_removed              somebody takes the part off the bed
"#;

/// Most entries of a faults file: each is looked at for every line.
const FAULTS_MAX: usize = 1000;

/// Longest `for_s` and `at_s`: a day.
const SECONDS_MAX: f64 = 86_400.0;

/// Farthest that an axis sinks, mm: a carriage falls no farther than its frame.
const SAG_MM_MAX: f64 = 100.0;

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
    #[serde(alias = "unplug")]
    HangUp,
    LoseLine,
    DropByte,
    CutReply,
    Blocked,
    PowerCut,
    FilamentOut,
    PartRemoved,
}

impl Kind {
    /// As it stands in the file.
    fn name(self) -> &'static str {
        match self {
            Self::CorruptLine => "corrupt_line",
            Self::ResendWithoutOk => "resend_without_ok",
            Self::DropOk => "drop_ok",
            Self::GarbleReply => "garble_reply",
            Self::Noise => "noise",
            Self::Say => "say",
            Self::Kill => "kill",
            Self::Reset => "reset",
            Self::Hang => "hang",
            Self::HangUp => "hang_up",
            Self::LoseLine => "lose_line",
            Self::DropByte => "drop_byte",
            Self::CutReply => "cut_reply",
            Self::Blocked => "blocked",
            Self::PowerCut => "power_cut",
            Self::FilamentOut => "filament_out",
            Self::PartRemoved => "part_removed",
        }
    }
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
    /// How far Z sinks without power, mm.
    pub sag_mm: Option<f64>,
    /// The serial device goes with the power.
    pub unplugs: Option<bool>,
    /// The board has restarted when the device is back.
    pub reset: Option<bool>,
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
    pub lose_line: f64,
    /// Share of lines, 0 to 1.
    pub drop_ok: f64,
    /// Share of lines, 0 to 1.
    pub garble_reply: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct File {
    pub(super) random: Random,
    pub(super) fault: Vec<Fault>,
}

/// Why a faults file is none.
#[derive(Debug, thiserror::Error)]
pub enum FaultsError {
    /// Not TOML, or an unknown key; the text has line and column.
    #[error("{0}")]
    Toml(Box<toml::de::Error>),
    /// An entry that makes no sense.
    #[error("fault {number} ({}): {why}", kind.name())]
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
        let lasts = matches!(self.kind, Kind::Hang | Kind::HangUp | Kind::Blocked | Kind::PowerCut);
        if lasts != self.for_s.is_some() {
            return Some("hang, hang_up, blocked and power_cut need for_s, and nothing else has it");
        }
        if self.kind != Kind::PowerCut && (self.sag_mm.is_some() || self.unplugs.is_some()) {
            return Some("only power_cut has sag_mm and unplugs");
        }
        if !self.sag_mm.is_none_or(|mm| (0.0..=SAG_MM_MAX).contains(&mm)) {
            return Some("sag_mm is from 0 to 100");
        }
        if self.kind != Kind::HangUp && self.reset.is_some() {
            return Some("only hang_up has reset");
        }
        if matches!(self.kind, Kind::Noise | Kind::Say | Kind::Kill) != self.text.is_some() {
            return Some("noise, say and kill need text, and nothing else has it");
        }
        if self.text.as_ref().is_some_and(|t| t.len() > TEXT_BYTES_MAX) {
            return Some("text has more than 200 bytes");
        }
        let hits_byte = matches!(self.kind, Kind::CorruptLine | Kind::ResendWithoutOk | Kind::DropByte);
        if self.byte.is_some() && !hits_byte {
            return Some("only corrupt_line, resend_without_ok and drop_byte have byte");
        }
        if self.times == Some(0) || times_without_line {
            return Some("times is at least 1 and goes with at_line");
        }
        None
    }
}

/// Checks what TOML and types cannot.
pub(super) fn check(random: Random, faults: &[Fault]) -> Result<(), FaultsError> {
    for (key, value) in [
        ("corrupt_line", random.corrupt_line),
        ("lose_line", random.lose_line),
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
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::Faults;
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
        assert_eq!(toml::from_str::<File>(example).unwrap().fault.len(), 2);
        Faults::parse(example).unwrap();
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
        check_file(&fault("do='drop_ok'"), "fault 1 (drop_ok): needs either");
        check_file(&fault("at_line=1\nat_s=1\ndo='drop_ok'"), "needs either");
        check_file(&fault("at_s=-1\ndo='drop_ok'"), "seconds");
        check_file(&fault("at_s=nan\ndo='drop_ok'"), "seconds");
        check_file(&fault("at_s=1\ndo='hang'"), "need for_s");
        check_file(&fault("at_s=1\nfor_s=1\ndo='reset'"), "nothing else");
        check_file(&fault("at_s=1\ndo='say'"), "need text");
        check_file(&fault("at_s=1\nfor_s=1\ndo='power_cut'\nsag_mm=0.4\nunplugs=true"), "");
        check_file(&fault("at_s=1\nfor_s=1\ndo='power_cut'\nsag_mm=-1"), "sag_mm");
        check_file(&fault("at_s=1\ndo='power_cut'"), "need for_s");
        check_file(&fault("at_s=1\nfor_s=1\ndo='hang'\nsag_mm=1"), "only power_cut");
        check_file(&fault("at_s=1\nfor_s=1\ndo='unplug'\nreset=true"), "");
        check_file(&fault("at_s=1\nfor_s=1\ndo='hang'\nreset=true"), "only hang_up");
        check_file(&fault("at_line=1\ndo='lose_line'"), "");
        check_file(&fault("at_s=1\ndo='reset'\nbyte=1"), "byte");
        check_file(&fault("at_s=1\ndo='drop_ok'\ntimes=2"), "times");
        check_file(&"[[fault]]\nat_s=1\ndo='reset'\n".repeat(1001), "at most 1000");
    }
}
