//! The slicer's settings that a file carries: `; key = value` lines.
//!
//! PrusaSlicer, SuperSlicer, OrcaSlicer and Slic3r write them at the end,
//! Bambu Studio at the beginning; Cura writes none that can be read so.
use crate::line::Line;

/// The key and value of a `; key = value` line.
#[must_use]
pub fn setting<'a>(line: &Line<'a>) -> Option<(&'a str, &'a str)> {
    if !line.is_comment() {
        return None;
    }
    let text = std::str::from_utf8(line.comment_text()).ok()?;
    let (key, value) = text.split_once(" =")?;
    let plain =
        !key.is_empty() && key.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_');
    plain.then_some((key, value.trim()))
}

/// The number that a value holds for a tool: `1,2` has one for each; the last one
/// serves the tools beyond.
#[must_use]
pub fn number_for_tool(value: &str, tool: u16) -> Option<f64> {
    let mut parts = value.split(',');
    let part = parts.nth(usize::from(tool)).or_else(|| value.rsplit(',').next())?;
    let (rest, number) = crate::number::decimal(part.trim().as_bytes()).ok()?;
    rest.is_empty().then_some(number.value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line::parse;

    #[test]
    fn reads() {
        let check = |line: &str, expect: Option<(&str, &str)>| {
            assert_eq!(setting(&parse(line.as_bytes())), expect, "{line}");
        };
        check("; retract_before_travel = 1,2", Some(("retract_before_travel", "1,2")));
        check("; notes =", Some(("notes", "")));
        check("; top infill extrusion width = 0.56mm", None);
        check("G1 X1 ; a = b", None);
        check("; \u{e9} = b", None);
    }

    #[test]
    fn numbers() {
        let check = |value: &str, tool: u16, expect: Option<f64>| {
            assert_eq!(number_for_tool(value, tool), expect, "{value} {tool}");
        };
        check("1,2", 0, Some(1.0));
        check("1,2", 1, Some(2.0));
        check("1,2", 5, Some(2.0));
        check("15%", 0, None);
        check("", 0, None);
    }
}
