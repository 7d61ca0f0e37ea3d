//! Layer marks of every slicer, for readers that do not ask whose they are.

/// How slicers mark a layer. Some files have two kinds for each layer: a reader keeps to the
/// first that it meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LayerMark {
    /// `;LAYER_CHANGE` (PrusaSlicer and its kin), `; CHANGE_LAYER` (Bambu).
    Change,
    /// `;LAYER:4` (Cura, ideaMaker); of a raft `;LAYER:-2`.
    Cura,
    /// `; layer 4, Z = 0.8`, `;<layer>`, `; --- layer 4` (others).
    Other,
}

/// What a comment, without `;` and the blanks around it, marks.
#[must_use]
pub fn layer_mark(comment: &[u8]) -> Option<LayerMark> {
    if matches!(comment, b"LAYER_CHANGE" | b"CHANGE_LAYER") {
        return Some(LayerMark::Change);
    }
    if let Some(n) = comment.strip_prefix(b"LAYER:") {
        let n = std::str::from_utf8(n.trim_ascii()).ok()?.parse::<f64>().ok()?;
        return n.is_finite().then_some(LayerMark::Cura);
    }
    let other = comment.strip_prefix(b"--- ").unwrap_or(comment);
    let n = other.strip_prefix(b"layer ")?;
    let digits = n.iter().take_while(|b| b.is_ascii_digit()).count();
    let ends = n.get(digits).is_none_or(|b| matches!(b, b',' | b' '));
    (digits > 0 && ends).then_some(LayerMark::Other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks() {
        for (comment, expect) in [
            ("LAYER_CHANGE", Some(LayerMark::Change)),
            ("CHANGE_LAYER", Some(LayerMark::Change)),
            ("BEFORE_LAYER_CHANGE", None),
            ("LAYER:0", Some(LayerMark::Cura)),
            ("LAYER:-2", Some(LayerMark::Cura)),
            ("LAYER:x", None),
            ("LAYER_COUNT:9", None),
            ("layer 4, Z = 0.8", Some(LayerMark::Other)),
            ("--- layer 4", Some(LayerMark::Other)),
            ("layer 4th", None),
            ("layer height: 0.2", None),
        ] {
            assert_eq!(layer_mark(comment.as_bytes()), expect, "{comment}");
        }
    }
}
