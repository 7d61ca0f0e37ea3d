//! OrcaSlicer: PrusaSlicer's marks, other names of features.
use super::{Feature, Mark, prusa};
use crate::line::Line;

pub(super) fn mark<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    prusa::common(line, feature)
}

/// The names that Bambu Studio shares.
pub(super) fn feature(name: &[u8]) -> Feature {
    match name {
        b"Outer wall" => Feature::ExternalPerimeter,
        b"Inner wall" => Feature::Perimeter,
        b"Overhang wall" => Feature::OverhangPerimeter,
        b"Sparse infill" => Feature::Infill,
        b"Internal solid infill" => Feature::SolidInfill,
        b"Top surface" => Feature::TopSolidInfill,
        b"Bottom surface" => Feature::BottomSurface,
        b"Bridge" => Feature::Bridge,
        b"Internal Bridge" => Feature::InternalBridge,
        b"Gap infill" => Feature::GapFill,
        b"Ironing" => Feature::Ironing,
        b"Support" | b"Support transition" => Feature::Support,
        b"Support interface" => Feature::SupportInterface,
        b"Skirt" | b"Brim" => Feature::Skirt,
        b"Prime tower" => Feature::Tower,
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
        let check = |line: &str, expect: Mark<'_>| {
            assert_eq!(mark(&parse(line.as_bytes())), Some(expect), "{line}");
        };
        check(";LAYER_CHANGE", Mark::Layer);
        check(";TYPE:Sparse infill", Mark::Feature(Feature::Infill));
        check(";TYPE:Bottom surface", Mark::Feature(Feature::BottomSurface));
        check(";TYPE:Internal Bridge", Mark::Feature(Feature::InternalBridge));
        check(";WIDTH:0.42", Mark::Width(0.42));
    }
}
