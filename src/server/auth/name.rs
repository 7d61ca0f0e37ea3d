//! Names that people read: of users, of keys, of applications that ask for a key.
//!
//! Takes text from anywhere; gives a [`Name`], which is short, visible and on one line. Knows not
//! what is named; that two names are unlike is their list's matter.
use serde::{Deserialize, Serialize};
use std::fmt;

/// Longest name, bytes: fits a line of a page and of a log.
const MAX_BYTES: usize = 64;

/// Why a text is no name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum NameError {
    /// Nothing is left of it.
    #[error("a name must not be empty")]
    Empty,
    /// Too long.
    #[error("a name has {MAX_BYTES} bytes at most")]
    TooLong,
    /// A character that nobody sees.
    #[error("a name must not have control characters or invisible ones")]
    Invisible,
    /// A part of an address that stands for a folder.
    #[error("\".\" and \"..\" are no names: no address could point to them")]
    Dots,
}

/// One line of visible text, 1 to 64 bytes, no space at its ends.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub(crate) struct Name(String);

impl Name {
    /// Takes a text as it is, but for space at its ends.
    ///
    /// # Errors
    /// It is no name.
    pub(crate) fn new(text: &str) -> Result<Self, NameError> {
        let text = text.trim();
        match text {
            "" => Err(NameError::Empty),
            "." | ".." => Err(NameError::Dots),
            _ if text.len() > MAX_BYTES => Err(NameError::TooLong),
            _ if text.chars().any(invisible) => Err(NameError::Invisible),
            _ => Ok(Self(text.to_owned())),
        }
    }

    /// Makes a name of what a stranger calls itself: leaves out what nobody sees, cuts off what is
    /// too long.
    ///
    /// # Errors
    /// Nothing is left.
    pub(crate) fn cleaned(text: &str) -> Result<Self, NameError> {
        let mut clean = String::new();
        for c in text.trim().chars().filter(|&c| !invisible(c)) {
            if clean.len() + c.len_utf8() > MAX_BYTES {
                break;
            }
            clean.push(c);
        }
        Self::new(&clean)
    }

    /// The text.
    pub(crate) fn as_str(&self) -> &str {
        &self.0
    }

    /// The same for all that differ in case only.
    pub(crate) fn folded(&self) -> String {
        self.0.to_lowercase()
    }
}

/// Control characters, and those that turn the direction of writing or have no width: with them one
/// name could look like another.
fn invisible(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{ad}' | '\u{61c}' | '\u{180e}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}'
            | '\u{2060}'..='\u{206f}' | '\u{feff}' | '\u{fff9}'..='\u{fffb}' | '\u{e0000}'..='\u{e007f}')
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl TryFrom<String> for Name {
    type Error = NameError;

    fn try_from(text: String) -> Result<Self, NameError> {
        Self::new(&text)
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, expect: Result<&str, NameError>, cleaned: Result<&str, NameError>) {
        let got = Name::new(text);
        assert_eq!(got.as_ref().map(Name::as_str).map_err(|&e| e), expect, "{text:?}");
        let got = Name::cleaned(text);
        assert_eq!(got.as_ref().map(Name::as_str).map_err(|&e| e), cleaned, "{text:?}");
    }

    #[test]
    fn a_name_is_short_and_visible() {
        check("anna", Ok("anna"), Ok("anna"));
        check("  Änna B. ", Ok("Änna B."), Ok("Änna B."));
        check("", Err(NameError::Empty), Err(NameError::Empty));
        check(" \t\n", Err(NameError::Empty), Err(NameError::Empty));
        check("..", Err(NameError::Dots), Err(NameError::Dots));
        check("a\nb", Err(NameError::Invisible), Ok("ab"));
        check("\u{1b}[2Jcura", Err(NameError::Invisible), Ok("[2Jcura"));
        check("ad\u{200b}min", Err(NameError::Invisible), Ok("admin"));
        check("\u{202e}nimda", Err(NameError::Invisible), Ok("nimda"));
        check("\u{7f}", Err(NameError::Invisible), Err(NameError::Empty));
        check(&"x".repeat(64), Ok(&"x".repeat(64)), Ok(&"x".repeat(64)));
        check(&"x".repeat(65), Err(NameError::TooLong), Ok(&"x".repeat(64)));
        check(&"é".repeat(33), Err(NameError::TooLong), Ok(&"é".repeat(32)));
        check("<b>a</b>", Ok("<b>a</b>"), Ok("<b>a</b>"));
    }

    proptest::proptest! {
        #[test]
        fn what_was_cleaned_is_a_name(text in "(?s).{0,90}") {
            if let Ok(name) = Name::cleaned(&text) {
                assert_eq!(Name::new(name.as_str()), Ok(name));
            }
        }
    }
}
