//! Numbers, text and colours as SVG has them.
//!
//! Only presentation attributes, no style sheet and no script: light viewers
//! read no more.
use std::fmt::Write;

/// A colour: red, green, blue.
pub(super) type Rgb = [u8; 3];

/// Text for an element or an attribute. What XML forbids (control characters)
/// becomes U+FFFD.
pub(super) fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => out.push('\u{fffd}'),
            c => out.push(c),
        }
    }
    out
}

/// Appends a text at its baseline.
pub(super) fn text(out: &mut String, x: f64, y: f64, attributes: &str, content: &str) {
    let _ = writeln!(out, "<text x=\"{x:.1}\" y=\"{y:.1}\" {attributes}>{}</text>", escaped(content));
}

/// A colour between two: `part` 0 is the first, 1 the second.
pub(super) fn between(first: Rgb, second: Rgb, part: f64) -> Rgb {
    std::array::from_fn(|k| {
        let (a, b) = (f64::from(first[k]), f64::from(second[k]));
        (a + (b - a) * part.clamp(0.0, 1.0)).round() as u8
    })
}

/// `#rrggbb`.
pub(super) fn hex([r, g, b]: Rgb) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Appends a coordinate in px, to a hundredth; zeros at the end are left out.
pub(super) fn number(out: &mut String, value: f64) {
    let value = if value.is_finite() { value } else { 0.0 };
    // Away with the sign of -0.
    let hundredths = (value * 100.0).round() + 0.0;
    let start = out.len();
    let _ = write!(out, "{:.2}", hundredths / 100.0);
    let text = &out[start..];
    let kept = text.trim_end_matches('0').trim_end_matches('.').len();
    out.truncate(start + kept);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_text() {
        let check = |text: &str, expect: &str| assert_eq!(escaped(text), expect);
        check("Würfel 2×.gcode", "Würfel 2×.gcode");
        check("<script>\"a\" & 'b'", "&lt;script&gt;&quot;a&quot; &amp; &#39;b&#39;");
        check("\x1b[2J\0\u{ffff}", "\u{fffd}[2J\u{fffd}\u{fffd}");
    }

    #[test]
    fn numbers_are_short_and_finite() {
        let check = |value: f64, expect: &str| {
            let mut out = "x".to_owned();
            number(&mut out, value);
            assert_eq!(out, format!("x{expect}"));
        };
        check(1.0, "1");
        check(100.0, "100");
        check(1.456, "1.46");
        check(-0.5, "-0.5");
        check(-0.001, "0");
        check(f64::NAN, "0");
        check(f64::INFINITY, "0");
    }

    #[test]
    fn colours_mix() {
        assert_eq!(between([0, 0, 200], [100, 0, 0], 0.5), [50, 0, 100]);
        assert_eq!(between([0, 0, 200], [100, 0, 0], 7.0), [100, 0, 0]);
        assert_eq!(hex([1, 0x23, 0xff]), "#0123ff");
    }
}
