//! What only its owner may know, and what is kept of it.
//!
//! A [`Secret`] is shown once and never printed by accident; a [`Digest`] is all that stays here of
//! it. Neither has `==`: the only comparison there is takes the same time whatever it is given.
//! Randomness is the operating system's. Knows not what the secrets are for.
use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use std::fmt;
use subtle::ConstantTimeEq;

/// Of every random secret: 256 bits, which nobody guesses.
const RANDOM_BYTES: usize = 32;

/// The same as base64url without padding.
const RANDOM_CHARS: usize = 43;

/// The operating system gives no random numbers.
#[derive(Clone, Copy, Debug, thiserror::Error)]
#[error("the system gives no random numbers: {0}")]
pub(crate) struct NoRandom(getrandom::Error);

/// Fills an array with random bytes.
///
/// # Errors
/// The system has none.
pub(super) fn random<const N: usize>() -> Result<[u8; N], NoRandom> {
    let mut bytes = [0; N];
    getrandom::fill(&mut bytes).map_err(NoRandom)?;
    Ok(bytes)
}

/// A name for a thing that is no secret, but should not be counted up either: a letter and 64 random
/// bits.
///
/// # Errors
/// The system has no random numbers.
pub(super) fn random_id(letter: char) -> Result<String, NoRandom> {
    Ok(format!("{letter}{}", URL_SAFE_NO_PAD.encode(random::<8>()?)))
}

/// A text that only its owner may see. Its `Debug` shows nothing of it.
#[derive(Clone)]
pub(crate) struct Secret(String);

impl Secret {
    /// 256 random bits behind a prefix.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(super) fn random(prefix: &str) -> Result<Self, NoRandom> {
        Ok(Self(format!("{prefix}{}", URL_SAFE_NO_PAD.encode(random::<RANDOM_BYTES>()?))))
    }

    /// A text that was made elsewhere.
    pub(super) fn from_text(text: String) -> Self {
        Self(text)
    }

    /// The text itself, to be given to its owner and to nobody else: no log, no error, no address.
    pub(crate) fn reveal(&self) -> &str {
        &self.0
    }

    /// Whether a text is this one; takes the same time for every text of one length.
    pub(crate) fn matches(&self, given: &str) -> bool {
        Digest::of(&self.0).matches(&Digest::of(given))
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(…)")
    }
}

/// Whether a text has the form of a [`Secret::random`] with that prefix. What has not, matches
/// nothing, and nothing need be looked up.
pub(super) fn well_formed(text: &str, prefix: &str) -> bool {
    text.strip_prefix(prefix).is_some_and(|rest| {
        rest.len() == RANDOM_CHARS
            && rest.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'-' || b == b'_')
    })
}

/// The SHA-256 of a secret. Enough for 256 random bits, which no dictionary has; passwords are
/// another matter.
#[derive(Clone, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub(super) struct Digest([u8; 32]);

impl Digest {
    pub(super) fn of(text: &str) -> Self {
        Self(Sha256::digest(text.as_bytes()).into())
    }

    /// Whether both are the same, in constant time.
    pub(super) fn matches(&self, other: &Self) -> bool {
        self.0.ct_eq(&other.0).into()
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Digest(…)")
    }
}

/// Not the base64url of 32 bytes.
#[derive(Debug, thiserror::Error)]
#[error("is not a SHA-256 as base64url")]
pub(crate) struct NoDigest;

impl TryFrom<String> for Digest {
    type Error = NoDigest;

    fn try_from(text: String) -> Result<Self, NoDigest> {
        let bytes = URL_SAFE_NO_PAD.decode(text).map_err(|_| NoDigest)?;
        bytes.try_into().map(Self).map_err(|_| NoDigest)
    }
}

impl From<Digest> for String {
    fn from(digest: Digest) -> Self {
        URL_SAFE_NO_PAD.encode(digest.0)
    }
}

/// The place, in a list, of what a secret belongs to. Every entry is compared, so that the time tells
/// neither which one matched nor how nearly.
pub(super) fn find<'a>(given: &str, kept: impl Iterator<Item = &'a Digest>) -> Option<usize> {
    let given = Digest::of(given);
    let mut found = None;
    for (at, digest) in kept.enumerate() {
        if given.matches(digest) {
            found = Some(at);
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, prefix: &str, expect: bool) {
        assert_eq!(well_formed(text, prefix), expect, "{text:?}");
    }

    #[test]
    fn a_random_secret_has_its_form_and_is_never_the_same() {
        let (a, b) = (Secret::random("or_").unwrap(), Secret::random("or_").unwrap());
        check(a.reveal(), "or_", true);
        assert_eq!(a.reveal().len(), 3 + RANDOM_CHARS);
        assert!(a.matches(a.reveal()) && !a.matches(b.reveal()) && !a.matches(""));
        check("", "", false);
        check("", "or_", false);
        check("or_", "or_", false);
        check(&a.reveal()[3..], "or_", false);
        check(&a.reveal()[..45], "or_", false);
        check(&format!("{}a", a.reveal()), "or_", false);
        check(&format!("or_{}", "é".repeat(22)), "or_", false);
        check(&format!("or_{}", " ".repeat(43)), "or_", false);
    }

    #[test]
    fn nothing_is_shown_by_accident() {
        let secret = Secret::from_text("hunter2".to_owned());
        assert_eq!(format!("{secret:?} {:?}", Digest::of("hunter2")), "Secret(…) Digest(…)");
    }

    #[test]
    fn a_digest_outlives_a_file() {
        let text = serde_json::to_string(&Digest::of("abc")).unwrap();
        assert_eq!(text, "\"ungWv48Bz-pBQUDeXa4iI7ADYaOWF3qctBD_YfIAFa0\"");
        let back: Digest = serde_json::from_str(&text).unwrap();
        assert!(back.matches(&Digest::of("abc")) && !back.matches(&Digest::of("abd")));
        for bad in ["\"\"", "\"abc\"", "1", "\"ungWv48Bz-pBQUDeXa4iI7ADYaOWF3qctBD_YfIAFa0A\""] {
            assert!(serde_json::from_str::<Digest>(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn the_one_that_matches_is_found() {
        let kept: Vec<_> = ["a", "b", "c"].map(Digest::of).into();
        assert_eq!(find("a", kept.iter()), Some(0));
        assert_eq!(find("c", kept.iter()), Some(2));
        assert_eq!(find("", kept.iter()), None);
        assert_eq!(find("", [].iter()), None);
    }
}
