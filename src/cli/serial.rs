//! How a user names a port and its speed: `--port` and `--baud`, as several verbs
//! take them.
use crate::printer::find::Rate;
use std::str::FromStr;

/// `--baud`: a number, or `auto`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Baud {
    /// So many bits per second.
    Given(u32),
    /// To be found.
    Auto,
}

/// No line is faster.
const MAX_BAUD: u32 = 12_000_000;

impl FromStr for Baud {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.parse() {
            _ if text == "auto" => Ok(Self::Auto),
            Ok(baud @ 1..=MAX_BAUD) => Ok(Self::Given(baud)),
            _ => Err(format!("bits per second, from 1 to {MAX_BAUD}, or auto")),
        }
    }
}

/// What `--baud` and the profile say together.
pub(super) fn rate(baud: Option<Baud>, profiles: u32) -> Rate {
    match baud {
        Some(Baud::Given(baud)) => Rate::Given(baud),
        Some(Baud::Auto) => Rate::Auto { first: profiles },
        None => Rate::Given(profiles),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_speed_is_a_number_or_to_be_found() {
        let check = |text: &str, expect: Option<Rate>| {
            assert_eq!(text.parse().ok().map(|baud| rate(Some(baud), 250_000)), expect, "{text}");
        };
        check("115200", Some(Rate::Given(115_200)));
        check("auto", Some(Rate::Auto { first: 250_000 }));
        for wrong in ["0", "-1", "fast", "99999999999", ""] {
            check(wrong, None);
        }
        assert_eq!(rate(None, 57_600), Rate::Given(57_600));
    }
}
