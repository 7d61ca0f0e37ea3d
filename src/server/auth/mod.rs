//! Who may do what: users, API keys, sessions, and how often one may guess.
//!
//! Takes names, texts that claim to be passwords, tokens or keys, addresses and the time; gives a
//! [`Who`] or a reason. Everything here is plain calculation on lists in memory: no sockets, no
//! files, no clock, no thread. Randomness alone comes from the operating system.
//!
//! # Layout
//! - `secret`: what is shown once, and its digest; the only comparison of secrets.
//! - `name`, `password`, `scope`: what users and keys are made of.
//! - `users`, `keys`, `kept`: what outlives the process. `sessions`, `setup`, `appkeys`: what does not.
//! - `source`: whose address counts. `throttle`, `bucket` on `recent`: how often.
//! - `login`: what takes a password. `manage`: what admins do. `who`: the answer.
//!
//! # What the caller must do
//! - Ask `admit` for every request.
//! - Call [`Attempt::check`] and [`PasswordHash::of`] where nothing waits for them.
//! - After any change ask `take_change`, and write what it gives before the next one is taken.
//! - Where a request has a key, let the key decide: a cookie beside it must not.
//! - Hold whatever changes something to [`Who::check_csrf`] and a scope.
mod appkeys;
mod bucket;
mod kept;
mod keys;
mod login;
mod manage;
mod name;
mod password;
mod recent;
mod scope;
mod secret;
mod sessions;
mod setup;
mod source;
#[cfg(test)]
mod tests;
mod throttle;
mod users;
mod who;

pub(crate) use appkeys::AppRequest;
pub(crate) use kept::Kept;
pub(crate) use keys::{ApiKey, KeysError};
pub(crate) use login::{Login, SetupError};
pub(crate) use manage::AppAnswer;
pub(crate) use name::Name;
pub(crate) use password::{PasswordHash, check_length as check_password_length};
pub(crate) use scope::{Role, Scope, ScopeSet};
pub(crate) use sessions::MAX_AGE_S as SESSION_MAX_AGE_S;
pub(crate) use setup::CodeError;
pub(crate) use source::{Source, client};
pub(crate) use throttle::Limited;
pub(crate) use users::{User, UsersError};
pub(crate) use who::{Refused, Via, Who};

use std::sync::Arc;

/// All of it, for one daemon.
#[derive(Debug)]
pub(crate) struct Auth {
    kept: Kept,
    changed: bool,
    sessions: sessions::Sessions,
    setup: setup::Setup,
    throttle: throttle::Throttle,
    buckets: bucket::Buckets,
    apps: appkeys::AppKeys,
    at_work: Arc<()>,
}

impl Auth {
    /// Begins with what was kept.
    pub(crate) fn new(kept: Kept) -> Self {
        Self {
            kept,
            changed: false,
            sessions: sessions::Sessions::default(),
            setup: setup::Setup::default(),
            throttle: throttle::Throttle::new(users::MAX_USERS),
            buckets: bucket::Buckets::new(),
            apps: appkeys::AppKeys::default(),
            at_work: Arc::default(),
        }
    }

    /// Counts a request of a source.
    ///
    /// # Errors
    /// Too many.
    pub(crate) fn admit(&mut self, source: Source, now_ms: u64) -> Result<(), Limited> {
        self.buckets.take(source, now_ms)
    }

    /// The person whose browser has that cookie. The session counts as used.
    ///
    /// # Errors
    /// [`Refused::Unauthenticated`].
    pub(crate) fn by_cookie(&mut self, token: &str, now_unix_s: u64) -> Result<Who, Refused> {
        let session = self.sessions.find(token, now_unix_s).ok_or(Refused::Unauthenticated)?;
        let user = self.kept.users.iter().find(|user| user.name.folded() == session.user);
        user.map(|user| Who::of_session(session, user, now_unix_s)).ok_or(Refused::Unauthenticated)
    }

    /// The program that has that key. A right one is never held up: one slicer with a revoked key
    /// would keep out all that come from its address, and nobody finds 256 bits by guessing.
    ///
    /// # Errors
    /// [`Refused::Unauthenticated`], or after too many of them [`Refused::Limited`].
    pub(crate) fn by_key(
        &mut self,
        given: &str,
        source: Source,
        now_unix_s: u64,
        now_ms: u64,
    ) -> Result<Who, Refused> {
        let Some(key) = self.kept.keys.find(given) else {
            self.throttle.wrong_key(source, now_ms)?;
            return Err(Refused::Unauthenticated);
        };
        let who = Who::of_key(key);
        let id = key.id.clone();
        self.changed |= self.kept.keys.used(&id, now_unix_s);
        Ok(who)
    }

    /// The same one, as they are now: with the role they have by now, or `None` if their session or
    /// key has ended. Does not count as use. For connections that stay.
    pub(crate) fn refresh(&self, who: &Who, now_unix_s: u64) -> Option<Who> {
        match &who.via {
            Via::Session { session, .. } => {
                let session = self.sessions.get(*session, now_unix_s)?;
                let user = self.kept.users.iter().find(|user| user.name.folded() == session.user)?;
                Some(Who::of_session(session, user, now_unix_s))
            }
            Via::Key { id } => self.kept.keys.get(id).map(Who::of_key),
        }
    }

    /// Whether nobody could log in.
    pub(crate) fn needs_first_user(&self) -> bool {
        self.kept.users.is_empty()
    }

    /// What is kept, as it is now.
    pub(crate) fn kept(&self) -> &Kept {
        &self.kept
    }

    /// What must be written, if anything has changed since the last call. Whoever takes it writes it
    /// before anybody takes the next: the later one would be overwritten.
    pub(crate) fn take_change(&mut self) -> Option<Kept> {
        std::mem::take(&mut self.changed).then(|| self.kept.clone())
    }

    /// Writing has failed: the next [`Auth::take_change`] gives it again.
    pub(crate) fn change_not_kept(&mut self) {
        self.changed = true;
    }

    /// Somebody else has changed what is kept (`outrigger user add` while the daemon runs). Sessions
    /// of users who are gone or have another password end.
    pub(crate) fn reload(&mut self, kept: Kept) {
        for user in self.kept.users.iter() {
            let same = kept.users.find(&user.name).is_some_and(|now| now.password.is_same(&user.password));
            if !same {
                self.sessions.end_user(&user.name.folded());
                self.throttle.forget_user(&user.name.folded());
            }
        }
        self.kept = kept;
        self.changed = false;
        if !self.needs_first_user() {
            self.setup.close();
        }
    }
}
