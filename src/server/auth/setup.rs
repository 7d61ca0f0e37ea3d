//! The one-time code with which the first user is made: who reads the terminal owns the daemon.
//!
//! Gives a code to be shown in the terminal and, for the right one, a [`SetupPass`]. Kept as its
//! SHA-256. Ten wrong tries, and it is gone; the caller then shows another one. Knows no users.
use super::secret::{Digest, NoRandom, Secret, random};

/// Digits and letters without I, L, O and U: what is read out is not mistaken (Crockford's base 32).
const ALPHABET: &[u8; 32] = b"0123456789ABCDEFGHJKMNPQRSTVWXYZ";

/// Characters of a code: 40 bits, of which ten tries guess nothing.
const CHARS: usize = 8;

/// Wrong tries that a code bears.
const TRIES: u8 = 10;

/// Why the code lets nobody in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum CodeError {
    /// No code is expected: there is a user, or the code is used up.
    #[error("no setup is open: the code was used, or there is a user already")]
    Closed,
    /// Another code.
    #[error("that is not the code of the terminal; {tries_left} tries are left")]
    Wrong {
        /// Before it is gone.
        tries_left: u8,
    },
    /// That was the last try. The caller is to open a new code and to show it.
    #[error("that is not the code of the terminal, and it was the last try: a new code stands there")]
    Spent,
}

/// Shows that the right code was given. Good for one user, who is the first.
#[derive(Debug)]
pub(crate) struct SetupPass(());

/// The code, if one is open.
#[derive(Debug, Default)]
pub(super) struct Setup {
    open: Option<(Digest, u8)>,
}

impl Setup {
    /// Makes a code; an earlier one is void.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(super) fn open(&mut self) -> Result<Secret, NoRandom> {
        // A byte's low five bits are as random as the byte.
        let code = random::<CHARS>()?.map(|byte| char::from(ALPHABET[usize::from(byte & 31)]));
        self.open = Some((Digest::of(&String::from_iter(code)), TRIES));
        let (left, right) = code.split_at(CHARS / 2);
        Ok(Secret::from_text(format!("{}-{}", String::from_iter(left), String::from_iter(right))))
    }

    /// Ends it: there is a user.
    pub(super) fn close(&mut self) {
        self.open = None;
    }

    /// Looks at what somebody typed.
    ///
    /// # Errors
    /// It is not the code.
    pub(super) fn check(&mut self, given: &str) -> Result<SetupPass, CodeError> {
        let Some((code, tries)) = &mut self.open else { return Err(CodeError::Closed) };
        if Digest::of(&plain(given)).matches(code) {
            return Ok(SetupPass(()));
        }
        *tries -= 1;
        match *tries {
            0 => {
                self.close();
                Err(CodeError::Spent)
            }
            tries_left => Err(CodeError::Wrong { tries_left }),
        }
    }
}

/// What was meant: in capitals, without dashes and spaces, and with the digits that people read as
/// letters.
fn plain(given: &str) -> String {
    // More is no code, and no work is done for it.
    given
        .chars()
        .take(4 * CHARS)
        .filter(|c| !c.is_whitespace() && !matches!(c, '-' | '\u{2010}'..='\u{2015}'))
        .map(|c| match c.to_ascii_uppercase() {
            'O' => '0',
            'I' | 'L' => '1',
            c => c,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn open() -> (Setup, String) {
        let mut setup = Setup::default();
        let code = setup.open().unwrap().reveal().to_owned();
        (setup, code)
    }

    #[test]
    fn a_code_has_its_form() {
        let (setup, code) = open();
        assert_eq!((code.len(), code.find('-')), (9, Some(4)), "{code}");
        assert!(code.bytes().all(|b| b == b'-' || ALPHABET.contains(&b)), "{code}");
        assert_ne!(code, open().1);
        assert!(!format!("{setup:?}").contains(&code));
    }

    #[test]
    fn what_is_meant_counts() {
        let (mut setup, code) = open();
        let mut check =
            |given: &str, expect: bool| assert_eq!(setup.check(given).is_ok(), expect, "{given:?}");
        check(&code, true);
        check(&code.to_lowercase(), true);
        check(&code.replace('-', ""), true);
        check(&format!(" {} ", code.replace('-', " – ")), true);
        check(&code.replace('0', "o").replace('1', "l"), true);
        check(&code[..8], false);
        check(&format!("{code}0"), false);
        check("", false);
        check("-", false);
    }

    #[test]
    fn ten_wrong_tries_and_it_is_gone() {
        let (mut setup, code) = open();
        for tries_left in (1..10).rev() {
            assert_eq!(setup.check("").unwrap_err(), CodeError::Wrong { tries_left });
        }
        assert!(setup.check(&code).is_ok());
        assert_eq!(setup.check("").unwrap_err(), CodeError::Spent);
        assert_eq!(setup.check(&code).unwrap_err(), CodeError::Closed);
        let again = setup.open().unwrap();
        assert!(setup.check(&code).is_err() && setup.check(again.reveal()).is_ok());
        setup.close();
        assert_eq!(setup.check(again.reveal()).unwrap_err(), CodeError::Closed);
        assert_eq!(Setup::default().check("").unwrap_err(), CodeError::Closed);
    }

    proptest::proptest! {
        #[test]
        fn no_other_text_is_the_code(text in "[0-9A-Z]{4}-[0-9A-Z]{4}|.{0,40}") {
            let (mut setup, code) = open();
            if plain(&text) != plain(&code) {
                assert!(setup.check(&text).is_err());
            }
        }
    }
}
