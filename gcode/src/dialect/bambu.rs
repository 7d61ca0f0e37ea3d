//! Bambu Studio: `; CHANGE_LAYER`, `; Z_HEIGHT:`, `; LAYER_HEIGHT:`, `; FEATURE:`, `; LINE_WIDTH:`.
use super::{Mark, number_after, orca};
use crate::line::Line;

pub(super) fn mark<'a>(line: &Line<'a>) -> Option<Mark<'a>> {
    if !line.is_comment() {
        return None;
    }
    if let Some(name) = line.comment.strip_prefix(b"; FEATURE:") {
        return Some(Mark::Feature(orca::feature(name.trim_ascii())));
    }
    match line.comment.trim_ascii() {
        b"; CHANGE_LAYER" => return Some(Mark::Layer),
        b"; WIPE_START" => return Some(Mark::WipeStart),
        b"; WIPE_END" => return Some(Mark::WipeEnd),
        b"; WIPE_TOWER_START" | b"; WIPE_TOWER_END" => return Some(Mark::Tower),
        _ => {}
    }
    number_after(line, b"; LINE_WIDTH:")
        .map(Mark::Width)
        .or_else(|| number_after(line, b"; Z_HEIGHT:").map(Mark::Z))
        .or_else(|| number_after(line, b"; LAYER_HEIGHT:").map(Mark::Height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::Feature;
    use crate::line::parse;

    #[test]
    fn marks() {
        let check = |line: &str, expect: Option<Mark<'_>>| {
            assert_eq!(mark(&parse(line.as_bytes())), expect, "{line}");
        };
        check("; CHANGE_LAYER", Some(Mark::Layer));
        check("; Z_HEIGHT: 0.4", Some(Mark::Z(0.4)));
        check("; LAYER_HEIGHT: 0.2", Some(Mark::Height(0.2)));
        check("; LINE_WIDTH: 0.42", Some(Mark::Width(0.42)));
        check("; FEATURE: Sparse infill", Some(Mark::Feature(Feature::Infill)));
        check("; WIPE_TOWER_START", Some(Mark::Tower));
        check(";LAYER_CHANGE", None);
    }
}
