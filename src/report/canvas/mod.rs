//! What a picture is drawn on: one drawing, two forms.
//!
//! Takes shapes, lines and words in px (x to the right, y down), gives SVG text
//! ([`svg::Svg`]) or a PNG's bytes ([`png::Png`]). Knows nothing of layers.
pub(super) mod font;
pub(super) mod png;
pub(super) mod svg;

use super::svg::Rgb;

/// A closed curve, px.
pub(super) type Outline = Vec<[f64; 2]>;

/// Which point of the words stands at the place given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    /// The beginning.
    Start,
    /// The end.
    End,
}

/// How words look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Style {
    /// Size of the font, px.
    pub(super) size: f64,
    /// Whether they stand out.
    pub(super) bold: bool,
    /// Their colour.
    pub(super) colour: Rgb,
    /// What of them stands at the place given.
    pub(super) anchor: Anchor,
}

/// Where a picture goes, in the order of drawing: what comes later covers.
pub(super) trait Canvas {
    /// A rectangle with its border, 1 px wide.
    fn frame(&mut self, origin: [f64; 2], size: [f64; 2], fill: Rgb, border: Rgb);

    /// What an odd number of the outlines enclose.
    fn fill(&mut self, outlines: &[Outline], colour: Rgb);

    /// A line.
    fn line(&mut self, points: &[[f64; 2]], colour: Rgb, width: f64);

    /// The border of a circle.
    fn circle(&mut self, centre: [f64; 2], radius: f64, colour: Rgb, width: f64);

    /// Words at their baseline.
    fn text(&mut self, at: [f64; 2], style: Style, words: &str);
}

/// The beginning of words that are longer than `most` characters, and an ellipsis.
pub(super) fn shortened(words: &str, most: usize) -> String {
    if words.chars().count() <= most {
        return words.to_owned();
    }
    words.chars().take(most.saturating_sub(1)).chain(['…']).collect()
}

#[cfg(test)]
mod tests {
    use super::shortened;

    #[test]
    fn long_names_are_cut_between_characters() {
        assert_eq!(shortened("Würfel", 6), "Würfel");
        assert_eq!(shortened("Würfel.stl", 6), "Würfe…");
    }
}
