//! PrusaSlicer and SuperSlicer: `;LAYER_CHANGE`, `;Z:`, `;HEIGHT:`, `;WIDTH:`, `;TYPE:`, `;WIPE_START`.
use super::{Feature, Mark, number_after};
use crate::line::Line;

pub(super) fn mark<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    common(line, feature)
}

/// The marks that OrcaSlicer shares; the features' names are the caller's.
pub(super) fn common<'a>(line: &Line<'a>, feature: fn(&[u8]) -> Feature) -> Option<Mark<'a>> {
    if !line.is_comment() {
        return None;
    }
    if let Some(width) = number_after(line, b";WIDTH:") {
        return Some(Mark::Width(width));
    }
    if let Some(name) = line.comment.strip_prefix(b";TYPE:") {
        return Some(Mark::Feature(feature(name.trim_ascii())));
    }
    match line.comment.trim_ascii() {
        b";WIPE_START" => return Some(Mark::WipeStart),
        b";WIPE_END" => return Some(Mark::WipeEnd),
        b";LAYER_CHANGE" => return Some(Mark::Layer),
        b";BEFORE_LAYER_CHANGE" | b";AFTER_LAYER_CHANGE" => return Some(Mark::Note),
        b"; CP TOOLCHANGE START" | b"; CP TOOLCHANGE END" => return Some(Mark::Tower),
        _ => {}
    }
    number_after(line, b";Z:")
        .map(Mark::Z)
        .or_else(|| number_after(line, b";HEIGHT:").map(Mark::Height))
        // The layer's z again, alone on a line, after AFTER_LAYER_CHANGE.
        .or_else(|| number_after(line, b";").map(|_| Mark::Note))
}

fn feature(name: &[u8]) -> Feature {
    match name {
        b"External perimeter" => Feature::ExternalPerimeter,
        b"Perimeter" | b"Internal perimeter" | b"Thin wall" => Feature::Perimeter,
        b"Overhang perimeter" => Feature::OverhangPerimeter,
        b"Internal infill" => Feature::Infill,
        b"Solid infill" => Feature::SolidInfill,
        b"Top solid infill" => Feature::TopSolidInfill,
        b"Bridge infill" => Feature::Bridge,
        b"Internal bridge infill" => Feature::InternalBridge,
        b"Ironing" => Feature::Ironing,
        b"Gap fill" => Feature::GapFill,
        b"Support material" => Feature::Support,
        b"Support material interface" => Feature::SupportInterface,
        b"Skirt" | b"Skirt/Brim" | b"Brim" => Feature::Skirt,
        b"Wipe tower" => Feature::Tower,
        b"Custom" => Feature::Custom,
        _ => Feature::Unknown,
    }
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
        check(";LAYER_CHANGE\n", Some(Mark::Layer));
        check(";Z:.4\r\n", Some(Mark::Z(0.4)));
        check(";HEIGHT:0.2", Some(Mark::Height(0.2)));
        check(";WIDTH:0.449999", Some(Mark::Width(0.449_999)));
        check(";TYPE:Internal infill", Some(Mark::Feature(Feature::Infill)));
        check(";TYPE:Something new", Some(Mark::Feature(Feature::Unknown)));
        check(";WIPE_START", Some(Mark::WipeStart));
        check(";0.4", Some(Mark::Note));
        check("; a note", None);
        check("G1 X1 ;WIDTH:0.4", None);
        check(";WIDTH:wide", None);
    }
}
