//! Slic3r 1.3 with verbose G-code: nothing but comments at the end of moves.
use super::{Feature, Mark};
use crate::line::{Command, Line};

pub(super) fn mark<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    if !matches!(line.command, Command::Classic { letter: b'G', number: 0..=3, sub: None }) {
        return None;
    }
    let text = line.comment_text();
    if text.starts_with(b"move to next layer (") {
        return Some(Mark::Layer);
    }
    let feature = match text {
        b"perimeter" => Feature::Perimeter,
        b"external perimeter" => Feature::ExternalPerimeter,
        b"perimeter (bridge)" => Feature::OverhangPerimeter,
        b"infill" | b"fill" => Feature::AnyInfill,
        b"infill (bridge)" => Feature::Bridge,
        b"gap fill" => Feature::GapFill,
        b"support material" => Feature::Support,
        b"support material interface" => Feature::SupportInterface,
        b"skirt" | b"brim" => Feature::Skirt,
        _ => return None,
    };
    Some(Mark::Inline(feature))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line::parse;

    #[test]
    fn marks() {
        let check = |line: &str, expect: Option<Mark<'_>>| {
            assert_eq!(mark(&parse(line.as_bytes())), expect, "{line}");
        };
        check("G1 Z0.350 F7800.000 ; move to next layer (0)", Some(Mark::Layer));
        check("G1 X1 Y1 E1 ; infill", Some(Mark::Inline(Feature::AnyInfill)));
        check("G1 X1 Y1 E1 ; perimeter", Some(Mark::Inline(Feature::Perimeter)));
        check("G1 X1 Y1 F7800 ; move to first infill point", None);
        check("; infill", None);
        check("M107 ; infill", None);
    }
}
