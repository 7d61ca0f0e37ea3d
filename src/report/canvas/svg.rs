//! The drawing as SVG: presentation attributes only, for light viewers.
use super::super::svg::{Rgb, hex, number, text};
use super::{Anchor, Canvas, Outline, Style};
use std::fmt::Write;

/// The words' typefaces: what the viewer has of these.
const FONTS: &str = "Inter, 'Segoe UI', 'Helvetica Neue', Helvetica, Arial, 'DejaVu Sans', sans-serif";

/// An SVG that grows.
pub(in super::super) struct Svg {
    out: String,
}

impl Svg {
    /// An empty picture, px; `title` is what browsers show as its name.
    pub(in super::super) fn new(size: [f64; 2], title: &str) -> Svg {
        let [width, height] = size.map(f64::ceil);
        let mut out = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\" font-family=\"{FONTS}\">\n"
        );
        let _ = writeln!(out, "<title>{}</title>", super::super::svg::escaped(title));
        Svg { out }
    }

    /// The whole text.
    pub(in super::super) fn finish(mut self) -> String {
        self.out.push_str("</svg>\n");
        self.out
    }

    fn path(&mut self, points: &[[f64; 2]], close: bool) {
        for (k, &[x, y]) in points.iter().enumerate() {
            self.out.push(if k == 0 { 'M' } else { 'L' });
            number(&mut self.out, x);
            self.out.push(' ');
            number(&mut self.out, y);
        }
        if close {
            self.out.push('Z');
        }
    }
}

impl Canvas for Svg {
    fn frame(&mut self, [x, y]: [f64; 2], [width, height]: [f64; 2], fill: Rgb, border: Rgb) {
        let _ = writeln!(
            self.out,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{}\" \
             stroke=\"{}\"/>",
            hex(fill),
            hex(border)
        );
    }

    fn fill(&mut self, outlines: &[Outline], colour: Rgb) {
        if outlines.is_empty() {
            return;
        }
        let _ = write!(self.out, "<path fill=\"{}\" fill-rule=\"evenodd\" d=\"", hex(colour));
        for outline in outlines {
            self.path(outline, true);
        }
        self.out.push_str("\"/>\n");
    }

    fn line(&mut self, points: &[[f64; 2]], colour: Rgb, width: f64) {
        let _ = write!(
            self.out,
            "<path fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" d=\"",
            hex(colour)
        );
        self.path(points, false);
        self.out.push_str("\"/>\n");
    }

    fn circle(&mut self, [x, y]: [f64; 2], radius: f64, colour: Rgb, width: f64) {
        let _ = writeln!(
            self.out,
            "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\" fill=\"none\" stroke=\"{}\" \
             stroke-width=\"{width}\"/>",
            hex(colour)
        );
    }

    fn text(&mut self, [x, y]: [f64; 2], style: Style, words: &str) {
        let mut attributes = format!("font-size=\"{}\" fill=\"{}\"", style.size, hex(style.colour));
        if style.bold {
            attributes.push_str(" font-weight=\"700\"");
        }
        attributes.push_str(match style.anchor {
            Anchor::Start => "",
            Anchor::End => " text-anchor=\"end\"",
        });
        text(&mut self.out, x, y, &attributes, words);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shapes_are_written_as_they_are() {
        let mut svg = Svg::new([20.0, 9.5], "<a>");
        let square = vec![[1.0, 1.0], [2.5, 1.0], [2.5, 2.0]];
        svg.fill(std::slice::from_ref(&square), [1, 2, 3]);
        svg.fill(&[], [1, 2, 3]);
        svg.line(&square, [0, 0, 0], 1.5);
        let style = Style { size: 12.0, bold: true, colour: [9, 9, 9], anchor: Anchor::End };
        svg.text([3.0, 4.0], style, "a & b");
        let text = svg.finish();
        assert!(text.contains("viewBox=\"0 0 20 10\"") && text.contains("<title>&lt;a&gt;</title>"));
        assert!(text.contains("<path fill=\"#010203\" fill-rule=\"evenodd\" d=\"M1 1L2.5 1L2.5 2Z\"/>"));
        assert_eq!(text.matches("<path").count(), 2);
        assert!(text.contains("text-anchor=\"end\">a &amp; b</text>") && text.ends_with("</svg>\n"));
    }
}
