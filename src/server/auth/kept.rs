//! What outlives the process: users and keys, as JSON without a password or a key in it.
//!
//! Takes and gives text; whoever holds the file writes it atomically and for its own eyes only.
use super::keys::ApiKeys;
use super::users::Users;
use serde::{Deserialize, Serialize};

/// What this program writes, and the newest it reads.
const VERSION: u32 = 1;

/// Why a text is not taken.
#[derive(Debug, thiserror::Error)]
pub(crate) enum KeptError {
    /// It is no such text, or breaks a rule of the lists.
    #[error("users and keys cannot be read: {0}")]
    Json(#[from] serde_json::Error),
    /// A later program wrote it: reading a half of it would let somebody in or out.
    #[error("users and keys were written by a later version (form {found}, known up to {VERSION})")]
    Newer {
        /// Its form.
        found: u32,
    },
}

/// Users and keys.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Kept {
    version: u32,
    /// The users.
    pub(crate) users: Users,
    /// The keys.
    pub(crate) keys: ApiKeys,
}

impl Default for Kept {
    fn default() -> Self {
        Self { version: VERSION, users: Users::default(), keys: ApiKeys::default() }
    }
}

impl Kept {
    /// Reads what [`Kept::to_json`] wrote.
    ///
    /// # Errors
    /// It is anything else.
    pub(crate) fn from_json(text: &str) -> Result<Self, KeptError> {
        #[derive(Deserialize)]
        struct Form {
            version: u32,
        }
        let Form { version: found } = serde_json::from_str(text)?;
        if found > VERSION {
            return Err(KeptError::Newer { found });
        }
        Ok(serde_json::from_str(text)?)
    }

    /// The text to keep.
    ///
    /// # Errors
    /// None that could happen: these are plain lists.
    pub(crate) fn to_json(&self) -> Result<String, KeptError> {
        Ok(serde_json::to_string_pretty(self)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(text: &str, error: &str) {
        match Kept::from_json(text) {
            Ok(kept) => {
                assert_eq!(error, "", "{text}");
                let again = kept.to_json().unwrap();
                assert_eq!(Kept::from_json(&again).unwrap().to_json().unwrap(), again);
            }
            Err(e) => assert!(!error.is_empty() && e.to_string().contains(error), "{text}: {e}"),
        }
    }

    #[test]
    fn only_a_whole_text_of_a_known_form_is_taken() {
        check(r#"{"version":1,"users":[],"keys":[]}"#, "");
        check(&Kept::default().to_json().unwrap(), "");
        check("", "cannot be read");
        check("{}", "missing field");
        check(r#"{"version":1,"users":[]}"#, "missing field `keys`");
        check(r#"{"version":1,"users":[],"keys":[],"kyes":[]}"#, "unknown field");
        check(r#"{"version":2,"users":{},"more":[]}"#, "later version (form 2, known up to 1)");
        check(
            r#"{"version":1,"users":[{"name":"a","role":"admin","created_unix_s":0,"password":"secret"}],"keys":[]}"#,
            "no Argon2id hash",
        );
    }
}
