//! Applications that ask for a key: OctoPrint's application keys, without its plugin.
//!
//! An application says what it is called and gets a token to ask with; an admin, who sees it by
//! another name, allows or denies it; the application asks again and gets its key, once. Takes
//! texts of strangers; gives cleaned ones. Knows no keys: whoever asks makes them, when they are
//! fetched, so that none is made that nobody has.
use super::name::{Name, NameError};
use super::scope::ScopeSet;
use super::secret::{self, Digest, NoRandom, Secret, random_id};
use super::source::Source;

/// Requests that are open at once.
const MAX_OPEN: usize = 16;

/// Of one source, so that one stranger does not keep the others out.
const MAX_PER_SOURCE: usize = 4;

/// A request ends after so long, s: the time to walk to a browser.
const OPEN_S: u64 = 5 * 60;

/// Why a request is not made or not answered.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub(crate) enum AppKeysError {
    /// Too many are open.
    #[error("too many applications ask for a key: answer them, or wait {} minutes", OPEN_S / 60)]
    Full,
    /// What the application calls itself.
    #[error(transparent)]
    Name(#[from] NameError),
    /// It was answered, fetched, or too old.
    #[error("there is no such request, or it is too old: let the application ask again")]
    Unknown,
    /// A key that allows nothing is a slip.
    #[error("a key needs at least one scope")]
    NoScope,
    /// No token can be made.
    #[error(transparent)]
    NoRandom(#[from] NoRandom),
}

/// A request, as an admin sees it.
#[derive(Clone, Debug)]
pub(crate) struct AppRequest {
    /// What it is called in addresses; no secret.
    pub(crate) id: String,
    /// What the application calls itself.
    pub(crate) app: Name,
    /// The user for whom it says it asks. Nobody has checked that.
    pub(crate) user: Option<Name>,
    /// When.
    pub(crate) asked_unix_s: u64,
    source: Source,
    token: Digest,
    grant: Option<Grant>,
}

/// What an admin allowed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Grant {
    pub(super) app: Name,
    pub(super) scopes: ScopeSet,
    pub(super) by: String,
}

/// What an application hears.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Answer {
    /// Nobody has decided yet.
    Pending,
    /// Yes; a second time it is [`Answer::Gone`].
    Granted(Grant),
    /// Denied, fetched, too old, or never there.
    Gone,
}

/// All open requests.
#[derive(Debug, Default)]
pub(super) struct AppKeys(Vec<AppRequest>);

impl AppKeys {
    /// An application asks. Gives what an admin is to see, and the token to poll with.
    ///
    /// # Errors
    /// Too many are open, nothing is left of the application's name, or the system has no random
    /// numbers.
    pub(super) fn ask(
        &mut self,
        source: Source,
        app: &str,
        user: Option<&str>,
        now_unix_s: u64,
    ) -> Result<(&AppRequest, Secret), AppKeysError> {
        self.sweep(now_unix_s);
        let app = Name::cleaned(app)?;
        let of_source = self.0.iter().filter(|request| request.source == source).count();
        if self.0.len() >= MAX_OPEN || of_source >= MAX_PER_SOURCE {
            return Err(AppKeysError::Full);
        }
        let token = Secret::random("")?;
        self.0.push(AppRequest {
            id: random_id('R')?,
            app,
            user: user.and_then(|user| Name::cleaned(user).ok()),
            asked_unix_s: now_unix_s,
            source,
            token: Digest::of(token.reveal()),
            grant: None,
        });
        Ok((&self.0[self.0.len() - 1], token))
    }

    /// Those on which nobody has decided, the oldest first.
    pub(super) fn pending(&mut self, now_unix_s: u64) -> impl Iterator<Item = &AppRequest> {
        self.sweep(now_unix_s);
        self.0.iter().filter(|request| request.grant.is_none())
    }

    /// An admin allows it.
    ///
    /// # Errors
    /// It is not open, or nothing would be allowed.
    pub(super) fn allow(
        &mut self,
        id: &str,
        scopes: ScopeSet,
        by: &str,
        now_unix_s: u64,
    ) -> Result<(), AppKeysError> {
        if scopes.is_empty() {
            return Err(AppKeysError::NoScope);
        }
        let at = self.find(id, now_unix_s)?;
        let request = &mut self.0[at];
        request.grant = Some(Grant { app: request.app.clone(), scopes, by: by.to_owned() });
        Ok(())
    }

    /// An admin denies it.
    ///
    /// # Errors
    /// It is not open.
    pub(super) fn deny(&mut self, id: &str, now_unix_s: u64) -> Result<(), AppKeysError> {
        let at = self.find(id, now_unix_s)?;
        self.0.remove(at);
        Ok(())
    }

    /// The application asks what has become of it.
    pub(super) fn poll(&mut self, token: &str, now_unix_s: u64) -> Answer {
        self.sweep(now_unix_s);
        if !secret::well_formed(token, "") {
            return Answer::Gone;
        }
        match secret::find(token, self.0.iter().map(|request| &request.token)) {
            None => Answer::Gone,
            Some(at) if self.0[at].grant.is_none() => Answer::Pending,
            Some(at) => self.0.remove(at).grant.map_or(Answer::Gone, Answer::Granted),
        }
    }

    fn find(&mut self, id: &str, now_unix_s: u64) -> Result<usize, AppKeysError> {
        self.sweep(now_unix_s);
        let open = |request: &AppRequest| request.id == id && request.grant.is_none();
        self.0.iter().position(open).ok_or(AppKeysError::Unknown)
    }

    fn sweep(&mut self, now_unix_s: u64) {
        self.0.retain(|request| now_unix_s.abs_diff(request.asked_unix_s) < OPEN_S);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::auth::scope::Scope;
    use std::net::IpAddr;

    const PRINT: ScopeSet = ScopeSet::of(&[Scope::Print]);

    fn from(last: u8) -> Source {
        IpAddr::from([192, 0, 2, last]).into()
    }

    /// Cura asks at 1000.
    fn asked() -> (AppKeys, String, Secret) {
        let mut apps = AppKeys::default();
        let (request, token) = apps.ask(from(1), "Cu\u{1b}ra", Some("anna"), 1000).unwrap();
        assert_eq!((request.app.as_str(), request.user.as_ref().unwrap().as_str()), ("Cura", "anna"));
        let id = request.id.clone();
        (apps, id, token)
    }

    #[test]
    fn a_key_is_given_once() {
        let (mut apps, id, token) = asked();
        assert_eq!(apps.poll(token.reveal(), 1001), Answer::Pending);
        apps.allow(&id, PRINT, "bo", 1002).unwrap();
        assert_eq!(apps.pending(1002).count(), 0);
        let expect = Grant { app: Name::new("Cura").unwrap(), scopes: PRINT, by: "bo".to_owned() };
        assert_eq!(apps.poll(token.reveal(), 1003), Answer::Granted(expect));
        assert_eq!(apps.poll(token.reveal(), 1003), Answer::Gone);
    }

    #[test]
    fn what_was_decided_stays_decided() {
        let (mut apps, id, token) = asked();
        apps.deny(&id, 1001).unwrap();
        assert_eq!(apps.poll(token.reveal(), 1001), Answer::Gone);
        assert!(matches!(apps.allow(&id, PRINT, "bo", 1001), Err(AppKeysError::Unknown)));
        let (mut apps, id, _) = asked();
        assert!(matches!(apps.allow(&id, ScopeSet::default(), "bo", 1001), Err(AppKeysError::NoScope)));
        apps.allow(&id, PRINT, "bo", 1001).unwrap();
        assert!(matches!(apps.deny(&id, 1001), Err(AppKeysError::Unknown)));
        assert!(matches!(apps.allow(&id, PRINT, "eve", 1001), Err(AppKeysError::Unknown)));
    }

    #[test]
    fn a_request_ends_by_itself() {
        let (mut apps, id, token) = asked();
        assert_eq!(apps.pending(1299).count(), 1);
        apps.allow(&id, PRINT, "bo", 1299).unwrap();
        assert_eq!(apps.poll(token.reveal(), 1300), Answer::Gone);
        let (mut apps, id, _) = asked();
        assert!(matches!(apps.allow(&id, PRINT, "bo", 1300), Err(AppKeysError::Unknown)));
        assert_eq!(apps.pending(1300).count(), 0);
    }

    #[test]
    fn only_the_token_fetches() {
        let (mut apps, id, token) = asked();
        apps.allow(&id, PRINT, "bo", 1001).unwrap();
        for bad in ["", &id, &token.reveal()[1..], &"A".repeat(43)] {
            assert_eq!(apps.poll(bad, 1001), Answer::Gone, "{bad:?}");
        }
        assert!(!format!("{apps:?}").contains(token.reveal()));
        assert!(matches!(apps.poll(token.reveal(), 1001), Answer::Granted(_)));
    }

    #[test]
    fn open_requests_are_bounded() {
        let mut apps = AppKeys::default();
        for n in 0..16 {
            apps.ask(from(n / 4), "x", None, 0).unwrap();
            let of_source = apps.0.iter().filter(|request| request.source == from(n / 4)).count();
            let full = apps.0.len() == 16 || of_source == 4;
            assert_eq!(apps.clone_ask(n / 4), full);
        }
        assert!(matches!(apps.ask(from(99), "x", None, 299), Err(AppKeysError::Full)));
        apps.ask(from(99), "x", None, 300).unwrap();
        assert!(matches!(apps.ask(from(99), "\n", None, 300), Err(AppKeysError::Name(_))));
    }

    impl AppKeys {
        /// Whether one more of that source would be one too many.
        fn clone_ask(&self, last: u8) -> bool {
            let mut copy = Self(self.0.clone());
            matches!(copy.ask(from(last), "x", None, 0), Err(AppKeysError::Full))
        }
    }
}
