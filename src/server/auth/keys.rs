//! API keys: 256 random bits that a program shows instead of a name and a password.
//!
//! A key is shown once, when it is made; only its SHA-256 is kept, with a name, scopes and when it
//! was last of use. Takes texts that claim to be keys; gives the key they are. Knows no users and
//! no file.
use super::name::Name;
use super::scope::ScopeSet;
use super::secret::{self, Digest, NoRandom, Secret, random_id};
use serde::{Deserialize, Serialize};

/// What every key begins with: a person, a log's filter and a scanner of leaked secrets know it.
pub(crate) const PREFIX: &str = "or_";

/// Keys at most: two for each user.
pub(crate) const MAX_KEYS: usize = 128;

/// A key's last use is noted so coarsely, s: an SD card wears out from a write at every request.
const USE_EVERY_S: u64 = 3600;

/// Why there is no key.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub(crate) enum KeysError {
    /// The list is full.
    #[error("there are {MAX_KEYS} keys, more do not fit: revoke one first")]
    Full,
    /// Nothing has that id.
    #[error("there is no key of that id")]
    Unknown,
    /// A key that allows nothing is a slip.
    #[error("a key needs at least one scope")]
    NoScope,
    /// No key can be made.
    #[error(transparent)]
    NoRandom(#[from] NoRandom),
}

/// What is kept of a key.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ApiKey {
    /// What it is called in addresses; no secret.
    pub(crate) id: String,
    /// What it is for.
    pub(crate) name: Name,
    /// What it allows.
    pub(crate) scopes: ScopeSet,
    /// Who made it or allowed it.
    pub(crate) by: String,
    /// When it was made.
    pub(crate) created_unix_s: u64,
    /// When it was last of use, to the hour.
    pub(crate) last_used_unix_s: Option<u64>,
    sha256: Digest,
}

/// All keys, the oldest first.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(try_from = "Vec<ApiKey>", into = "Vec<ApiKey>")]
pub(crate) struct ApiKeys(Vec<ApiKey>);

impl ApiKeys {
    /// The keys.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &ApiKey> {
        self.0.iter()
    }

    /// The key of that id.
    pub(crate) fn get(&self, id: &str) -> Option<&ApiKey> {
        self.iter().find(|key| key.id == id)
    }

    /// Whether there is room for one more.
    pub(super) fn has_room(&self) -> bool {
        self.0.len() < MAX_KEYS
    }

    /// Makes a key. The secret is to be shown once and is kept nowhere.
    ///
    /// # Errors
    /// The list is full, nothing would be allowed, or the system has no random numbers.
    pub(crate) fn make(
        &mut self,
        name: Name,
        scopes: ScopeSet,
        by: &str,
        now_unix_s: u64,
    ) -> Result<(&ApiKey, Secret), KeysError> {
        if scopes.is_empty() {
            return Err(KeysError::NoScope);
        }
        if !self.has_room() {
            return Err(KeysError::Full);
        }
        let secret = Secret::random(PREFIX)?;
        let key = ApiKey {
            id: random_id('K')?,
            name,
            scopes,
            by: by.to_owned(),
            created_unix_s: now_unix_s,
            last_used_unix_s: None,
            sha256: Digest::of(secret.reveal()),
        };
        self.0.push(key);
        Ok((&self.0[self.0.len() - 1], secret))
    }

    /// Takes a key's rights away.
    ///
    /// # Errors
    /// There is no such key.
    pub(crate) fn revoke(&mut self, id: &str) -> Result<(), KeysError> {
        let at = self.0.iter().position(|key| key.id == id).ok_or(KeysError::Unknown)?;
        self.0.remove(at);
        Ok(())
    }

    /// The key that a text is. An empty text or one of another form is none.
    pub(super) fn find(&self, given: &str) -> Option<&ApiKey> {
        if !well_formed(given) {
            return None;
        }
        secret::find(given, self.iter().map(|key| &key.sha256)).map(|at| &self.0[at])
    }

    /// Notes that a key was of use. `true`: this should be kept.
    pub(super) fn used(&mut self, id: &str, now_unix_s: u64) -> bool {
        let Some(key) = self.0.iter_mut().find(|key| key.id == id) else { return false };
        // A clock that was set back would otherwise never be noted again.
        let fresh = key.last_used_unix_s.is_none_or(|last| now_unix_s.abs_diff(last) >= USE_EVERY_S);
        if fresh {
            key.last_used_unix_s = Some(now_unix_s);
        }
        fresh
    }
}

/// Whether a text could be a key at all.
pub(super) fn well_formed(given: &str) -> bool {
    secret::well_formed(given, PREFIX)
}

/// What was read is no list of keys.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub(crate) enum NoKeys {
    /// The list is full.
    #[error("there are more than {MAX_KEYS} keys")]
    TooMany,
    /// One cannot be revoked without the other.
    #[error("two keys have one id")]
    Twice,
}

impl TryFrom<Vec<ApiKey>> for ApiKeys {
    type Error = NoKeys;

    fn try_from(keys: Vec<ApiKey>) -> Result<Self, NoKeys> {
        if keys.len() > MAX_KEYS {
            return Err(NoKeys::TooMany);
        }
        let mut ids = std::collections::HashSet::new();
        match keys.iter().all(|key| ids.insert(key.id.clone())) {
            true => Ok(Self(keys)),
            false => Err(NoKeys::Twice),
        }
    }
}

impl From<ApiKeys> for Vec<ApiKey> {
    fn from(keys: ApiKeys) -> Self {
        keys.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::auth::scope::Scope;

    const READ: ScopeSet = ScopeSet::of(&[Scope::Read]);

    fn two() -> (ApiKeys, [Secret; 2]) {
        let mut keys = ApiKeys::default();
        let mut make = |name| keys.make(Name::new(name).unwrap(), READ, "anna", 7).unwrap().1;
        let secrets = [make("one"), make("two")];
        (keys, secrets)
    }

    #[test]
    fn only_a_whole_key_matches() {
        let (keys, [one, two]) = two();
        let check = |given: &str, expect: Option<&str>| {
            assert_eq!(keys.find(given).map(|key| key.name.as_str()), expect, "{given:?}");
        };
        let text = one.reveal();
        check(text, Some("one"));
        check(two.reveal(), Some("two"));
        check("", None);
        check(" ", None);
        check("or_", None);
        check("null", None);
        check(&text[..text.len() - 1], None);
        check(&format!("{text} "), None);
        check(&text.to_uppercase(), None);
        check(&format!("or_{}", "A".repeat(43)), None);
        // What is kept is not a key: who reads the file has none.
        let kept = serde_json::to_value(&keys).unwrap()[0]["sha256"].as_str().unwrap().to_owned();
        check(&kept, None);
        check(&format!("or_{kept}"), None);
        assert!(ApiKeys::default().find("").is_none() && ApiKeys::default().find(text).is_none());
        // Nor does an empty text match where somebody has written its digest into the file.
        let mut edited = serde_json::to_value(&keys).unwrap();
        edited[0]["sha256"] = serde_json::to_value(Digest::of("")).unwrap();
        let edited: ApiKeys = serde_json::from_value(edited).unwrap();
        assert!(edited.find("").is_none() && edited.find(two.reveal()).is_some());
    }

    #[test]
    fn a_revoked_key_is_none() {
        let (mut keys, [one, two]) = two();
        let id = keys.find(one.reveal()).unwrap().id.clone();
        keys.revoke(&id).unwrap();
        assert!(keys.find(one.reveal()).is_none() && keys.find(two.reveal()).is_some());
        assert!(matches!(keys.revoke(&id), Err(KeysError::Unknown)));
    }

    #[test]
    fn a_file_or_a_log_has_no_key() {
        let (keys, [one, _]) = two();
        let text = serde_json::to_string(&keys).unwrap();
        assert!(!text.contains(PREFIX), "{text}");
        assert!(!format!("{keys:?} {one:?}").contains(PREFIX));
        let back: ApiKeys = serde_json::from_str(&text).unwrap();
        assert_eq!(back.find(one.reveal()).unwrap().name.as_str(), "one");
        let one = text[1..text.len() - 1].split("},{").next().unwrap().to_owned() + "}";
        assert!(serde_json::from_str::<ApiKeys>(&format!("[{one}]")).is_ok());
        assert!(serde_json::from_str::<ApiKeys>(&format!("[{one},{one}]")).is_err());
    }

    #[test]
    fn use_is_noted_once_an_hour() {
        let (mut keys, [one, _]) = two();
        let id = keys.find(one.reveal()).unwrap().id.clone();
        let mut check = |now_unix_s, expect| assert_eq!(keys.used(&id, now_unix_s), expect, "{now_unix_s}");
        check(10_000, true);
        check(10_001, false);
        check(13_599, false);
        check(13_600, true);
        check(5, true);
        assert!(!keys.used("K", 99_999));
    }

    #[test]
    fn the_list_is_bounded() {
        let mut keys = ApiKeys::default();
        let name = Name::new("x").unwrap();
        for _ in 0..MAX_KEYS {
            keys.make(name.clone(), READ, "anna", 0).unwrap();
        }
        assert!(matches!(keys.make(name.clone(), READ, "anna", 0), Err(KeysError::Full)));
        assert!(matches!(keys.make(name, ScopeSet::default(), "anna", 0), Err(KeysError::NoScope)));
    }

    proptest::proptest! {
        #[test]
        fn no_other_text_is_a_key(text in "(or_)?[A-Za-z0-9_-]{0,50}|.{0,50}") {
            assert!(two().0.find(&text).is_none());
        }
    }
}
