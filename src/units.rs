//! Units as types: a number that knows what it measures.
//!
//! Each is one `f64`, copied freely and written in TOML and JSON as the bare
//! number. Nothing converts by itself: `.0` is the number in the unit of the
//! name. This module knows nothing of who uses it.
use serde::{Deserialize, Serialize};
use std::fmt;

macro_rules! unit {
    ($(#[$doc:meta])* $name:ident, $symbol:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub f64);

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                self.0.fmt(f)?;
                f.write_str(concat!(" ", $symbol))
            }
        }
    };
}

unit!(
    /// A length in millimetres.
    Mm,
    "mm"
);
unit!(
    /// A speed in millimetres per second (G-code's F is per minute).
    MmPerS,
    "mm/s"
);
unit!(
    /// A speed in millimetres per minute, as resin printers' settings and G-code's F have it.
    MmPerMin,
    "mm/min"
);
unit!(
    /// An acceleration in millimetres per second squared.
    MmPerS2,
    "mm/s²"
);
unit!(
    /// A temperature in degrees Celsius.
    Celsius,
    "°C"
);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_is_the_bare_number_in_json_and_names_itself_to_people() {
        assert_eq!(serde_json::to_string(&Mm(0.4)).unwrap(), "0.4");
        assert_eq!(serde_json::from_str::<Celsius>("210").unwrap(), Celsius(210.0));
        assert_eq!(format!("{:.1}", MmPerS2(1250.0)), "1250.0 mm/s²");
        assert_eq!(MmPerS(12.5).to_string(), "12.5 mm/s");
    }
}
