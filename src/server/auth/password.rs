//! Passwords: Argon2id with what OWASP asks for at least, which a Raspberry Pi 3 bears.
//!
//! Takes a password; gives a [`PasswordHash`], or says whether it is the right one. Both take a
//! tenth of a second to a whole one and 19 MiB: run them where nothing waits. Knows no users.
//!
//! Source: OWASP Password Storage Cheat Sheet, Argon2id with m = 19456 KiB, t = 2, p = 1; the text
//! of a hash is a PHC string.
use super::secret::{NoRandom, random};
use argon2::password_hash::phc;
use argon2::{Algorithm, Argon2, Params, PasswordHasher, PasswordVerifier, Version};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Shortest password, bytes.
pub(crate) const MIN_BYTES: usize = 8;

/// Longest password, bytes: a sentence fits, and nobody keeps the processor busy with a book.
pub(crate) const MAX_BYTES: usize = 256;

const MEMORY_KIB: u32 = 19 * 1024;
const PASSES: u32 = 2;
const LANES: u32 = 1;

/// The most that a hash which was read may ask for: what is kept was written by this program or by
/// a later one, but a slip must not take all of a Pi's memory.
const MAX_MEMORY_KIB: u32 = 64 * 1024;
const MAX_PASSES: u32 = 16;

/// Why there is no hash.
#[derive(Debug, thiserror::Error)]
pub(crate) enum PasswordError {
    /// Too easy.
    #[error("a password has at least {MIN_BYTES} bytes")]
    TooShort,
    /// Too long.
    #[error("a password has {MAX_BYTES} bytes at most")]
    TooLong,
    /// No salt.
    #[error(transparent)]
    NoRandom(#[from] NoRandom),
    /// The hash function itself.
    #[error("the password cannot be hashed: {0}")]
    Hash(argon2::password_hash::Error),
    /// A text that is no hash of ours.
    #[error("is no Argon2id hash as a PHC string, or asks for too much")]
    NoHash,
}

/// Looks at the length only, so that a bad password costs nothing.
///
/// # Errors
/// It is too short or too long.
pub(crate) fn check_length(password: &str) -> Result<(), PasswordError> {
    match password.len() {
        ..MIN_BYTES => Err(PasswordError::TooShort),
        MIN_BYTES..=MAX_BYTES => Ok(()),
        _ => Err(PasswordError::TooLong),
    }
}

/// What is kept of a password: a PHC string. `Debug` does not show it.
#[derive(Clone, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub(crate) struct PasswordHash(String);

impl PasswordHash {
    /// Hashes a new password. Slow: see the module.
    ///
    /// # Errors
    /// Its length; the system has no random numbers.
    pub(crate) fn of(password: &str) -> Result<Self, PasswordError> {
        Self::with(password, &hasher(MEMORY_KIB, PASSES, LANES)?)
    }

    fn with(password: &str, hasher: &Argon2<'_>) -> Result<Self, PasswordError> {
        check_length(password)?;
        let hash: phc::PasswordHash = hasher
            .hash_password_with_salt(password.as_bytes(), &random::<16>()?)
            .map_err(PasswordError::Hash)?;
        Ok(Self(hash.to_string()))
    }

    /// For tests of other rooms: as weak as it is quick.
    #[cfg(test)]
    pub(super) fn quick(password: &str) -> Self {
        Self::with(password, &hasher(8, 1, 1).unwrap()).unwrap()
    }

    /// Whether both are one hash of one password with one salt.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        self.0 == other.0
    }
}

impl fmt::Debug for PasswordHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("PasswordHash(…)")
    }
}

impl TryFrom<String> for PasswordHash {
    type Error = PasswordError;

    fn try_from(text: String) -> Result<Self, PasswordError> {
        let hash = phc::PasswordHash::new(&text).map_err(|_| PasswordError::NoHash)?;
        let params = Params::try_from(&hash).map_err(|_| PasswordError::NoHash)?;
        let ours = hash.algorithm == Algorithm::Argon2id.ident()
            && hash.salt.is_some()
            && hash.hash.is_some()
            && params.m_cost() <= MAX_MEMORY_KIB
            && params.t_cost() <= MAX_PASSES;
        if ours { Ok(Self(text)) } else { Err(PasswordError::NoHash) }
    }
}

impl From<PasswordHash> for String {
    fn from(hash: PasswordHash) -> Self {
        hash.0
    }
}

fn hasher(memory_kib: u32, passes: u32, lanes: u32) -> Result<Argon2<'static>, PasswordError> {
    let params = Params::new(memory_kib, passes, lanes, None).map_err(|e| PasswordError::Hash(e.into()))?;
    Ok(Argon2::new(Algorithm::Argon2id, Version::V0x13, params))
}

/// Whether a password is the right one. Slow: see the module. Where there is no user, and so no
/// hash, the work is done all the same: the time must not tell who has an account.
pub(super) fn verify(hash: Option<&PasswordHash>, password: &str) -> bool {
    // Such a password belongs to nobody, whoever there is: this tells nothing.
    if check_length(password).is_err() {
        return false;
    }
    let Ok(hasher) = hasher(MEMORY_KIB, PASSES, LANES) else { return false };
    match hash {
        Some(hash) => hasher.verify_password(password.as_bytes(), hash.0.as_str()).is_ok(),
        None => {
            let work: Result<phc::PasswordHash, _> =
                hasher.hash_password_with_salt(password.as_bytes(), b"nobody is there!");
            std::hint::black_box(work.is_ok());
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn the_right_password_alone_is_right() {
        let hash = PasswordHash::of("correct horse").unwrap();
        assert!(hash.0.starts_with("$argon2id$v=19$m=19456,t=2,p=1$"), "{}", hash.0);
        assert!(verify(Some(&hash), "correct horse"));
        assert!(!verify(Some(&hash), "correct horsf"));
        assert!(!verify(Some(&hash), ""));
        assert!(!verify(None, "correct horse"));
        assert!(!hash.is_same(&PasswordHash::quick("correct horse")), "the salt is the same");
        assert_eq!(format!("{hash:?}"), "PasswordHash(…)");
    }

    /// A user who is not there takes as long as one who is. The margin is wide, as this may run on a
    /// busy machine; without the work it would be a thousandth.
    #[test]
    fn the_time_does_not_tell_who_is_there() {
        let hash = PasswordHash::of("correct horse").unwrap();
        let least = |hash: Option<&PasswordHash>| {
            let time = |_| {
                let start = Instant::now();
                assert!(!verify(hash, "wrong horse"));
                start.elapsed()
            };
            (0..3).map(time).min().unwrap()
        };
        let (there, nobody) = (least(Some(&hash)), least(None));
        assert!(nobody * 8 > there, "{there:?} {nobody:?}");
    }

    #[test]
    fn lengths_are_bounded_before_any_work() {
        let check = |len: usize, expect: &str| match check_length(&"x".repeat(len)) {
            Ok(()) => assert_eq!(expect, "", "{len}"),
            Err(e) => assert_eq!(e.to_string(), expect, "{len}"),
        };
        check(0, "a password has at least 8 bytes");
        check(7, "a password has at least 8 bytes");
        check(8, "");
        check(256, "");
        check(257, "a password has 256 bytes at most");
        assert!(matches!(PasswordHash::of("short"), Err(PasswordError::TooShort)));
    }

    #[test]
    fn what_is_read_is_a_hash_of_ours() {
        let check = |text: &str, expect: bool| {
            assert_eq!(PasswordHash::try_from(text.to_owned()).is_ok(), expect, "{text:?}");
        };
        let good = PasswordHash::quick("correct horse").0;
        check(&good, true);
        check("", false);
        check("correct horse", false);
        check(&good.replace("argon2id", "argon2i"), false);
        check(&good.replace("m=8,", "m=4194304,"), false);
        check(&good.replace("t=1,", "t=1000,"), false);
        check(good.rsplit_once('$').unwrap().0, false);
        check("$argon2id$v=19$m=8,t=1,p=1", false);
    }
}
