//! Cura: `;LAYER:n` (negative under a raft), `;TYPE:`, `;MESH:`.
use super::{Feature, Mark, ObjectMark};
use crate::line::Line;

pub(super) fn mark<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    if !line.is_comment() {
        return None;
    }
    if let Some(name) = line.comment.strip_prefix(b";TYPE:") {
        return Some(Mark::Feature(feature(name.trim_ascii())));
    }
    if let Some(name) = line.comment.strip_prefix(b";MESH:") {
        return Some(Mark::Object(match name.trim_ascii() {
            b"NONMESH" => ObjectMark::End,
            name => ObjectMark::Begin(name),
        }));
    }
    if let Some(number) = line.comment.strip_prefix(b";LAYER:") {
        let (rest, _) = crate::number::decimal(number.trim_ascii()).ok()?;
        return rest.is_empty().then_some(Mark::Layer);
    }
    line.comment.starts_with(b";TIME_ELAPSED:").then_some(Mark::Note)
}

fn feature(name: &[u8]) -> Feature {
    match name {
        b"WALL-OUTER" => Feature::ExternalPerimeter,
        b"WALL-INNER" => Feature::Perimeter,
        b"FILL" => Feature::Infill,
        b"SKIN" => Feature::Skin,
        b"SUPPORT" => Feature::Support,
        b"SUPPORT-INTERFACE" => Feature::SupportInterface,
        b"SKIRT" => Feature::Skirt,
        b"PRIME-TOWER" => Feature::Tower,
        b"CUSTOM" => Feature::Custom,
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
        check(";LAYER:12", Some(Mark::Layer));
        check(";LAYER:-2", Some(Mark::Layer));
        check(";LAYER_COUNT:75", None);
        check(";TYPE:FILL", Some(Mark::Feature(Feature::Infill)));
        check(";TYPE:SKIN", Some(Mark::Feature(Feature::Skin)));
        check(";MESH:part.stl", Some(Mark::Object(ObjectMark::Begin(b"part.stl"))));
        check(";MESH:NONMESH", Some(Mark::Object(ObjectMark::End)));
        check(";TIME_ELAPSED:12.3", Some(Mark::Note));
        check("; a note", None);
    }
}
