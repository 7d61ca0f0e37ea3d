//! Macros: short G-code sequences of a profile, and the proof that `cancel` is safe.
//!
//! Takes a macro's text, gives its commands; [`unsafe_cancel`] says why a
//! cancel macro would leave a machine hot or drive it into the part. Knows no
//! sender and no framing.
use serde::{Deserialize, Serialize};

/// Longest macro, in bytes: a macro is a screenful, not a job.
pub const MACRO_BYTES_MAX: usize = 4096;

/// What the frame of a numbered line adds at most: `N4294967295 ` and `*255`.
pub const FRAME_BYTES_MAX: usize = 16;

/// A macro's text as its file has it, comments included.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Macro(pub String);

impl Macro {
    /// The commands: one a line, without `;` comments, blanks around or empty lines.
    pub fn lines(&self) -> impl Iterator<Item = &str> {
        self.0.lines().map(|line| line.split(';').next().unwrap_or("").trim()).filter(|line| !line.is_empty())
    }

    /// The macro with values in the places of their names: `("{ms}", "2500")`.
    #[must_use]
    pub fn filled(&self, values: &[(&str, &str)]) -> Macro {
        Macro(values.iter().fold(self.0.clone(), |text, (place, value)| text.replace(place, value)))
    }

    /// True when there is nothing to send.
    pub fn is_empty(&self) -> bool {
        self.lines().next().is_none()
    }
}

/// Said of a command whose words cannot be told apart.
pub(super) const GLUED: &str =
    "it has a command that cannot be read: one letter and number a word, with blanks between";

/// One command taken apart, as far as the safety rules need it.
pub(super) struct Words<'a>(pub(super) &'a str);

impl Words<'_> {
    pub(super) fn is(&self, name: &str) -> bool {
        self.0.split_whitespace().next().is_some_and(|word| word.eq_ignore_ascii_case(name))
    }

    /// The number after a letter, if the command has it.
    pub(super) fn value(&self, letter: char) -> Option<f64> {
        self.0.split_whitespace().skip(1).find_map(|word| {
            let rest = word.strip_prefix([letter, letter.to_ascii_lowercase()])?;
            Some(if rest.is_empty() { 0.0 } else { rest.parse().unwrap_or(f64::NAN) })
        })
    }

    pub(super) fn moves(&self, axes: &str) -> bool {
        axes.chars().any(|axis| self.value(axis).is_some())
    }

    /// A command whose words stand without a blank between them (`G1X5Z-3`): firmware
    /// reads them, and a proof that reads word by word would not.
    pub(super) fn glued(&self) -> bool {
        let mut words = self.0.split_whitespace();
        let first = words.next().unwrap_or_default();
        let code = first.strip_prefix(['G', 'M', 'T', 'g', 'm', 't']).unwrap_or_default();
        if !code.starts_with(|c: char| c.is_ascii_digit()) || self.is("M117") || self.is("M118") {
            return false;
        }
        let number = |text: &str| text.bytes().all(|b| b.is_ascii_digit() || b"+-.".contains(&b));
        let plain = |word: &str| word.starts_with(|c: char| c.is_ascii_alphabetic()) && number(&word[1..]);
        !number(code) || !words.all(plain)
    }
}

/// Why a line or the whole of a macro cannot be sent, or `None`.
///
/// `max_line` is the firmware's limit for a framed line in bytes.
pub fn unsendable(text: &Macro, max_line: Option<u32>) -> Option<String> {
    if text.0.len() > MACRO_BYTES_MAX {
        return Some(format!("it has {} bytes; a macro has at most {MACRO_BYTES_MAX}", text.0.len()));
    }
    for line in text.lines() {
        if line.bytes().any(|b| !(b' '..=b'~').contains(&b) && b != b'\t') || line.contains('\\') {
            return Some(format!(
                "{line:?} has a character that firmware does not take: use plain ASCII without a backslash"
            ));
        }
        let framed = line.len() + FRAME_BYTES_MAX;
        if max_line.is_some_and(|max| framed > max as usize) {
            return Some(format!(
                "{line:?} would be up to {framed} bytes on the wire, over serial.max_line: shorten it"
            ));
        }
    }
    None
}

/// Why a cancel macro is not safe, or `None`.
///
/// It must switch off the nozzle, the bed and the fan, must not wait for heat,
/// and must not move until Z was raised: a job can be given up anywhere, so
/// every absolute Z may be inside the part. `delta` says that homing goes up.
pub fn unsafe_cancel(text: &Macro, delta: bool) -> Option<&'static str> {
    let (mut nozzle, mut bed, mut fan) = (false, false, false);
    let mut travel = Travel { delta, ..Travel::default() };
    for line in text.lines() {
        let words = Words(line);
        if words.glued() {
            return Some(GLUED);
        }
        let off = words.value('S') == Some(0.0);
        if words.is("TURN_OFF_HEATERS") {
            (nozzle, bed) = (true, true);
        } else if words.is("M104") {
            nozzle = off;
        } else if words.is("M140") {
            bed = off;
        } else if words.is("M107") || (words.is("M106") && off) {
            fan = true;
        } else if words.is("M109") || words.is("M190") {
            return Some("it waits for heat (M109 or M190), which holds up everything after it");
        } else if let Some(why) = travel.unsafe_step(&words) {
            return Some(why);
        }
    }
    match (nozzle, bed, fan) {
        (false, _, _) => Some("it leaves the nozzle's heater on: add M104 S0"),
        (_, false, _) => Some("it leaves the bed's heater on: add M140 S0"),
        (_, _, false) => Some("it leaves the fan on: add M107"),
        _ => None,
    }
}

/// Why a pause macro is not safe, or `None`: it may do what it likes but drive into the
/// part, over which it begins.
pub fn unsafe_pause(text: &Macro, delta: bool) -> Option<&'static str> {
    let mut travel = Travel { delta, ..Travel::default() };
    text.lines().map(Words).find_map(|words| {
        let glued = words.glued().then_some(GLUED);
        glued.or_else(|| travel.unsafe_step(&words))
    })
}

/// How a macro moves that begins over a part.
#[derive(Default)]
struct Travel {
    /// Homing goes up.
    delta: bool,
    relative: bool,
    raised: bool,
}

impl Travel {
    /// Why the next command could drive into the part.
    fn unsafe_step(&mut self, words: &Words<'_>) -> Option<&'static str> {
        if words.is("G90") {
            self.relative = false;
        } else if words.is("G91") {
            self.relative = true;
        } else if words.is("G0") || words.is("G1") {
            if words.value('Z').is_some() {
                if !self.relative {
                    return Some("it moves Z to an absolute height: raise it relatively (G91) first");
                }
                if words.value('Z').is_none_or(|z| z.is_nan() || z < 0.0) {
                    return Some("it moves Z downwards");
                }
                self.raised = true;
            }
            if words.moves("XY") && !self.raised {
                return Some("it moves X or Y before Z was raised");
            }
        } else if words.is("G28") {
            if !self.raised && !self.delta {
                return Some("it homes before Z was raised");
            }
            if !self.delta && (words.moves("Z") || !words.moves("XY")) {
                return Some("it homes Z, onto the part: home X and Y only");
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, delta: bool, expect: Option<&str>) {
        let found = unsafe_cancel(&Macro(text.into()), delta);
        match expect {
            None => assert_eq!(found, None, "{text:?}"),
            Some(part) => assert!(found.is_some_and(|why| why.contains(part)), "{text:?}: {found:?}"),
        }
    }

    #[test]
    fn a_cancel_macro_ends_cold_and_clear_of_the_part() {
        let off = "M104 S0\nM140 S0\nM107\n";
        check(off, false, None);
        check("TURN_OFF_HEATERS\nM107", false, None);
        check("M140 S0\nM107", false, Some("nozzle"));
        check("M104 S0\nM107", false, Some("bed"));
        check("M104 S0\nM140 S0 ; M107", false, Some("fan"));
        check(&format!("{off}M104 S200"), false, Some("nozzle"));
        check(&format!("{off}M109 S0"), false, Some("waits"));
        check(&format!("{off}G1 Z10"), false, Some("absolute"));
        check(&format!("{off}G91\nG1 Z-1"), false, Some("downwards"));
        check(&format!("{off}G91\nG1 Zx"), false, Some("cannot be read"));
        check(&format!("{off}G91\nG1 X5Z-3"), false, Some("cannot be read"));
        check(&format!("{off}G91\nG1Z-3"), false, Some("cannot be read"));
        check(&format!("{off}G91\ng1 z-3"), false, Some("downwards"));
        check(&format!("{off}M117 all off"), false, None);
        check(&format!("{off}G91\nG1 X5"), false, Some("before Z"));
        check(&format!("{off}G91\nG1 Z5\nG90\nG1 X0 Y200"), false, None);
        check(&format!("{off}G28"), false, Some("homes before"));
        check(&format!("{off}G91\nG1 Z5\nG28"), false, Some("homes Z"));
        check(&format!("{off}G91\nG1 Z5\nG28 X Y"), false, None);
        check(&format!("{off}G28"), true, None);
    }

    #[test]
    fn a_pause_macro_stays_clear_of_the_part() {
        let check = |text: &str, expect: Option<&str>| {
            let found = unsafe_pause(&Macro(text.into()), false);
            assert_eq!(found.is_some(), expect.is_some(), "{text:?}: {found:?}");
            assert!(found.is_none_or(|why| why.contains(expect.unwrap_or_default())), "{text:?}: {found:?}");
        };
        check("", None);
        check("G91\nG1 E-2 F1800\nG1 Z10\nG90\nG1 X0 Y200", None);
        check("PARK_HEAD", None);
        check("G1 X0", Some("before Z"));
        check("G1 Z50", Some("absolute"));
        check("G91\nG1 Z-2", Some("downwards"));
        check("G91\nG1 Z2\nG28", Some("homes Z"));
        check("G91\nG1 X5Z2", Some("cannot be read"));
    }

    #[test]
    fn lines_are_commands_without_comments() {
        let text = Macro("; head\n M104 S0 ; off\r\n\n\tM107\n".into());
        assert_eq!(text.lines().collect::<Vec<_>>(), ["M104 S0", "M107"]);
        assert!(Macro(" ; nothing\n\n".into()).is_empty());
    }

    #[test]
    fn what_firmware_would_not_take_is_refused() {
        let long = "M117 ".to_owned() + &"x".repeat(80);
        assert!(unsendable(&Macro(long.clone()), Some(95)).is_some());
        assert!(unsendable(&Macro(long), None).is_none());
        assert!(unsendable(&Macro("M117 na\u{ef}ve".into()), None).is_some());
        assert!(unsendable(&Macro("M117 a\\b".into()), None).is_some());
        assert!(unsendable(&Macro("M117 ok ; na\u{ef}ve comment".into()), Some(95)).is_none());
        assert!(unsendable(&Macro("M107\n".repeat(1000)), None).is_some());
    }
}
