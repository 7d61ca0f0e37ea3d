//! Temperatures as firmware reports them: `T:210.1 /210.0 B:60.0 /60.0 @:64`.
//!
//! Takes a line or the tail of an `ok`, gives readings of the hotends, the bed
//! and the chamber. Does not know which heaters the machine has.
use super::reply::decimal;

/// Hotends kept. Marlin knows at most 8.
pub const MAX_HOTENDS: usize = 8;

/// One heater.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reading {
    /// Measured, in °C.
    pub actual_c: f32,
    /// Wanted, in °C, if the firmware says; 0 is off.
    pub target_c: Option<f32>,
}

/// All that one report says.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Temperatures {
    /// `T:`, the hotend in use.
    pub active: Option<Reading>,
    /// `T0:`, `T1:`…
    pub hotends: [Option<Reading>; MAX_HOTENDS],
    /// `B:`.
    pub bed: Option<Reading>,
    /// `C:`.
    pub chamber: Option<Reading>,
}

impl Temperatures {
    /// The hotend in use, or the first that is reported.
    pub fn hotend(&self) -> Option<Reading> {
        self.active.or_else(|| self.hotends.iter().find_map(|h| *h))
    }

    fn slot(&mut self, name: &[u8]) -> Option<&mut Option<Reading>> {
        match name {
            b"T" => Some(&mut self.active),
            b"B" => Some(&mut self.bed),
            b"C" => Some(&mut self.chamber),
            [b'T', n @ b'0'..=b'9'] => self.hotends.get_mut(usize::from(n - b'0')),
            _ => None,
        }
    }
}

/// Reads a report, which begins with a hotend's or the bed's value.
///
/// Accepted: `T:20.0 /0.0`, `T:20.0/0.0`, `T:20.0 E:0`, `T0:…`, with or without
/// the power values `@:`. `None` for any other line.
pub(super) fn temperatures(text: &[u8]) -> Option<Temperatures> {
    let mut all = Temperatures::default();
    // Where the target of the last reading goes.
    let mut open: Option<&[u8]> = None;
    let mut any = false;
    for word in text.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()) {
        let (name, value) = match (word, memchr::memchr(b':', word)) {
            ([b'/', target @ ..], _) => {
                set_target(&mut all, open.take(), target);
                continue;
            }
            (_, Some(colon)) => (&word[..colon], &word[colon + 1..]),
            _ => (&[][..], word),
        };
        let (actual, target) = match memchr::memchr(b'/', value) {
            Some(slash) => (&value[..slash], Some(&value[slash + 1..])),
            None => (value, None),
        };
        open = None;
        if let Some(slot) = all.slot(name)
            && let Some(actual) = decimal(actual)
        {
            *slot = Some(Reading { actual_c: actual as f32, target_c: None });
            any = true;
            open = Some(name);
            if let Some(target) = target {
                set_target(&mut all, open.take(), target);
            }
        } else if !any {
            return None;
        }
    }
    any.then_some(all)
}

fn set_target(all: &mut Temperatures, name: Option<&[u8]>, target: &[u8]) {
    if let Some(Some(Some(reading))) = name.map(|name| all.slot(name).map(Option::as_mut)) {
        reading.target_c = decimal(target).map(|t| t as f32);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, expect: Option<&[(&str, f32, Option<f32>)]>) {
        let got = temperatures(text.as_bytes());
        let expect = expect.map(|readings| {
            let mut all = Temperatures::default();
            for (name, actual_c, target_c) in readings {
                *all.slot(name.as_bytes()).unwrap() =
                    Some(Reading { actual_c: *actual_c, target_c: *target_c });
            }
            all
        });
        assert_eq!(got, expect, "{text:?}");
    }

    #[test]
    fn dialects() {
        check(
            "T:210.1 /210.0 B:60.0 /60.5 @:64 B@:30",
            Some(&[("T", 210.1, Some(210.0)), ("B", 60.0, Some(60.5))]),
        );
        check(
            "T:24.2 /0.0 B:25.0 /0.0 T0:24.2 /0.0 T1:23.0 /5.0 @:0 P:0.0 A:26.4",
            Some(&[
                ("T", 24.2, Some(0.0)),
                ("B", 25.0, Some(0.0)),
                ("T0", 24.2, Some(0.0)),
                ("T1", 23.0, Some(5.0)),
            ]),
        );
        check(
            "T:170.00/170.00 B:85.00/85.00 X:40.15/36.00 C:30.0/0.0",
            Some(&[("T", 170.0, Some(170.0)), ("B", 85.0, Some(85.0)), ("C", 30.0, Some(0.0))]),
        );
        check("T:199.5 E:0 W:?", Some(&[("T", 199.5, None)]));
        check("T:199.5 W:3", Some(&[("T", 199.5, None)]));
        check("B:60.0 /60.0 T0:200.0 /200.0", Some(&[("B", 60.0, Some(60.0)), ("T0", 200.0, Some(200.0))]));
        check("T:-14.9 /0.0", Some(&[("T", -14.9, Some(0.0))]));
        check("T:20.0 /nan", Some(&[("T", 20.0, None)]));
        check("T9:20.0 /0", None);
        check("T:", None);
        check("T:nan", None);
        check("Total: 5", None);
        check("Bed Leveling On", None);
        check("/0.0", None);
    }
}
