//! The printer's text for a terminal (and a USB device's): nothing in it may act on the terminal.
//!
//! Takes any text, gives text in which control characters and those that reorder
//! what surrounds them are written out.

/// Characters shown of one text; a printer that sends noise shall not fill the
/// screen.
const MAX_CHARS: usize = 300;

/// The text with every character that is not plainly printable written as
/// `\u{1b}`, and cut at [`MAX_CHARS`].
pub(crate) fn printable(text: &str) -> String {
    printable_to(text, MAX_CHARS)
}

/// The same, cut at `max_chars`.
pub(crate) fn printable_to(text: &str, max_chars: usize) -> String {
    let mut out = String::with_capacity(text.len().min(4 * max_chars));
    for (at, c) in text.chars().enumerate() {
        if at == max_chars {
            out.push('…');
            break;
        }
        if acts(c) {
            out.extend(c.escape_unicode());
        } else {
            out.push(c);
        }
    }
    out
}

/// Control characters, line and paragraph separators, marks that change the
/// direction of the text, invisible ones.
fn acts(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2060}'..='\u{206f}' | '\u{feff}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_acts_on_the_terminal() {
        let check = |text: &str, expect: &str| assert_eq!(printable(text), expect);
        check("T:20.0 /0.0", "T:20.0 /0.0");
        check("Düse ✓", "Düse ✓");
        check("\x1b[2Jgone", "\\u{1b}[2Jgone");
        check("a\r\nb\t\u{9b}31m\0", "a\\u{d}\\u{a}b\\u{9}\\u{9b}31m\\u{0}");
        check("\u{202e}evil", "\\u{202e}evil");
        let long = "x".repeat(1000);
        assert_eq!(printable(&long).chars().count(), MAX_CHARS + 1);
    }
}
