//! Decimal numbers as G-code writes them: read exactly, written as the file writes them.
//!
//! Takes bytes, gives `f64` and the number of decimals. `E` never begins an
//! exponent here: in `X10E5` it is the next word (Marlin reads it so, and every
//! slicer relies on it).
use nom::{IResult, Parser, error::ErrorKind};

/// A number and how it was written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decimal {
    /// The value, correctly rounded.
    pub value: f64,
    /// Digits after the point.
    pub decimals: u8,
    /// Written without a zero before the point (`.5`, `-.5`), as PrusaSlicer does.
    pub bare_point: bool,
}

/// Powers of ten that `f64` holds exactly.
const POW10: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18,
    1e19, 1e20, 1e21, 1e22,
];

/// Up to this many digits the mantissa is below 2^53, and one division rounds correctly.
const EXACT_DIGITS: usize = 15;

/// Reads `[+-]digits[.digits]`; at least one digit.
///
/// # Errors
/// No digit at the start of the input.
pub fn decimal(input: &[u8]) -> IResult<&[u8], Decimal> {
    let mut at = 0;
    let negative = match input.first() {
        Some(b'-') => {
            at = 1;
            true
        }
        Some(b'+') => {
            at = 1;
            false
        }
        _ => false,
    };
    let digits_at = at;
    let mut mantissa: u64 = 0;
    while let Some(d) = digit(input, at) {
        mantissa = mantissa.wrapping_mul(10).wrapping_add(d);
        at += 1;
    }
    let whole = at - digits_at;
    let mut decimals = 0;
    if input.get(at) == Some(&b'.') && (whole > 0 || digit(input, at + 1).is_some()) {
        at += 1;
        let from = at;
        while let Some(d) = digit(input, at) {
            mantissa = mantissa.wrapping_mul(10).wrapping_add(d);
            at += 1;
        }
        decimals = at - from;
    }
    if whole + decimals == 0 {
        return fail(input);
    }
    let magnitude = if whole + decimals <= EXACT_DIGITS {
        mantissa as f64 / POW10[decimals]
    } else {
        slow(&input[digits_at..at])
    };
    let number = Decimal {
        value: if negative { -magnitude } else { magnitude },
        decimals: decimals.min(255) as u8,
        bare_point: whole == 0,
    };
    Ok((&input[at..], number))
}

fn digit(input: &[u8], at: usize) -> Option<u64> {
    let d = input.get(at)?.wrapping_sub(b'0');
    (d < 10).then_some(u64::from(d))
}

fn fail<T>(input: &[u8]) -> IResult<&[u8], T> {
    nom::combinator::fail::<_, T, nom::error::Error<&[u8]>>()
        .parse(input)
        .map_err(|_| nom::Err::Error(nom::error::Error::new(input, ErrorKind::Digit)))
}

/// More digits than one division can round: the standard library does it.
#[cold]
fn slow(digits: &[u8]) -> f64 {
    std::str::from_utf8(digits).ok().and_then(|s| s.parse().ok()).unwrap_or(f64::INFINITY)
}

/// How a file writes its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// Digits after the point, at most 9; zeros at the end are left out.
    pub decimals: u8,
    /// `.5` rather than `0.5`.
    pub bare_point: bool,
}

/// Most decimals that [`Format`] writes: 10^9 times a build volume still fits 2^53.
pub const MAX_DECIMALS: u8 = 9;

/// Appends `value` with at most `format.decimals` decimals, rounded half away
/// from zero, no zeros at the end, never `-0`.
///
/// Values whose scaled magnitude exceeds 2^53 are written by the standard library.
pub fn write_decimal(out: &mut Vec<u8>, value: f64, format: Format) {
    let decimals = format.decimals.min(MAX_DECIMALS) as usize;
    let scaled = (value.abs() * POW10[decimals]).round();
    if scaled.is_nan() || scaled >= 9_007_199_254_740_992.0 {
        use std::io::Write;
        // Writing to a Vec cannot fail.
        let _ = write!(out, "{value}");
        return;
    }
    let mut units = scaled as u64;
    if units == 0 {
        out.push(b'0');
        return;
    }
    if value < 0.0 {
        out.push(b'-');
    }
    let mut places = decimals;
    while places > 0 && units.is_multiple_of(10) {
        units /= 10;
        places -= 1;
    }
    let mut buffer = [b'0'; 32];
    let mut at = buffer.len();
    let mut written = 0;
    while units > 0 || written < places {
        if written == places && places > 0 {
            at -= 1;
            buffer[at] = b'.';
        }
        at -= 1;
        buffer[at] = b'0' + (units % 10) as u8;
        units /= 10;
        written += 1;
    }
    if written == places && places > 0 {
        at -= 1;
        buffer[at] = b'.';
        if !format.bare_point {
            at -= 1;
            buffer[at] = b'0';
        }
    }
    out.extend_from_slice(&buffer[at..]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(input: &str, expect: Option<(f64, u8, &str)>) {
        let got = decimal(input.as_bytes()).ok();
        let expect = expect.map(|(value, decimals, rest)| (value, decimals, rest.as_bytes()));
        assert_eq!(got.map(|(rest, d)| (d.value, d.decimals, rest)), expect, "{input}");
    }

    #[test]
    fn reads() {
        check("1", Some((1.0, 0, "")));
        check("10E5", Some((10.0, 0, "E5")));
        check("-.38 F", Some((-0.38, 2, " F")));
        check("+0.5", Some((0.5, 1, "")));
        check("5.", Some((5.0, 0, "")));
        check(".", None);
        check("-", None);
        check("", None);
        check("NaN", None);
        check("0.1234567890123456789", Some((0.123_456_789_012_345_68, 19, "")));
        check("1.2.3", Some((1.2, 1, ".3")));
    }

    #[test]
    fn writes() {
        let check = |value: f64, decimals: u8, bare_point: bool, expect: &str| {
            let mut out = Vec::new();
            write_decimal(&mut out, value, Format { decimals, bare_point });
            assert_eq!(String::from_utf8_lossy(&out), expect);
        };
        check(0.01225, 5, true, ".01225");
        check(-0.38, 5, true, "-.38");
        check(-0.38, 5, false, "-0.38");
        check(120.0, 3, true, "120");
        check(-0.000_001, 3, true, "0");
        check(99.9996, 3, false, "100");
        check(0.05, 3, false, "0.05");
        check(1e300, 3, false, &format!("{}", 1e300));
        check(f64::NAN, 3, false, "NaN");
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_back(units in -9_999_999_999i64..9_999_999_999, decimals in 0u8..7, bare_point: bool) {
            let value = units as f64 / POW10[decimals as usize];
            let mut out = Vec::new();
            write_decimal(&mut out, value, Format { decimals, bare_point });
            let (rest, got) = decimal(&out).unwrap();
            prop_assert!(rest.is_empty());
            prop_assert_eq!(got.value, value);
        }

        #[test]
        fn agrees_with_the_standard_library(text in "[+-]?[0-9]{1,20}(\\.[0-9]{0,20})?") {
            let (_, got) = decimal(text.as_bytes()).unwrap();
            prop_assert_eq!(got.value, text.parse::<f64>().unwrap());
        }

        #[test]
        fn never_panics(bytes: Vec<u8>) {
            let _ = decimal(&bytes);
        }
    }
}
