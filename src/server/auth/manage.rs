//! What admins do: users and keys come and go, and applications get the keys they ask for.
//!
//! Takes names that are valid and passwords that are hashed; changes the lists, and ends what a
//! change makes void. That an admin asks has been seen to before.
use super::Auth;
use super::appkeys::{self, AppKeysError, AppRequest};
use super::keys::{ApiKey, KeysError};
use super::name::Name;
use super::password::PasswordHash;
use super::scope::{Role, ScopeSet};
use super::secret::Secret;
use super::source::Source;
use super::users::{User, UsersError};

/// What an application hears that asks for a key.
#[derive(Debug)]
pub(crate) enum AppAnswer {
    /// Nobody has decided yet.
    Pending,
    /// Its key, this once.
    Key(Secret),
    /// Denied, fetched, too old, or never there.
    Gone,
}

impl Auth {
    /// The users.
    pub(crate) fn users(&self) -> impl Iterator<Item = &User> {
        self.kept.users.iter()
    }

    /// Adds a user. The first is an admin, and ends the setup.
    ///
    /// # Errors
    /// See [`UsersError`].
    pub(crate) fn add_user(
        &mut self,
        name: Name,
        role: Role,
        password: PasswordHash,
        now_unix_s: u64,
    ) -> Result<(), UsersError> {
        self.kept.users.add(name, role, password, now_unix_s)?;
        self.setup.close();
        self.changed = true;
        Ok(())
    }

    /// Removes a user and ends their sessions. Keys that they made stay: machines use them, and
    /// [`ApiKey::by`] tells whose they were.
    ///
    /// # Errors
    /// There is none of that name, or no admin would be left.
    pub(crate) fn remove_user(&mut self, name: &Name) -> Result<(), UsersError> {
        self.kept.users.remove(name)?;
        self.sessions.end_user(&name.folded());
        self.throttle.forget_user(&name.folded());
        self.changed = true;
        Ok(())
    }

    /// Gives a user another password and ends all their sessions, also the one that asks.
    ///
    /// # Errors
    /// There is none of that name.
    pub(crate) fn set_password(&mut self, name: &Name, password: PasswordHash) -> Result<(), UsersError> {
        self.kept.users.set_password(name, password)?;
        self.sessions.end_user(&name.folded());
        self.changed = true;
        Ok(())
    }

    /// Gives a user another role, which their sessions have at once.
    ///
    /// # Errors
    /// There is none of that name, or no admin would be left.
    pub(crate) fn set_role(&mut self, name: &Name, role: Role) -> Result<(), UsersError> {
        self.kept.users.set_role(name, role)?;
        self.changed = true;
        Ok(())
    }

    /// The keys.
    pub(crate) fn keys(&self) -> impl Iterator<Item = &ApiKey> {
        self.kept.keys.iter()
    }

    /// Makes a key. The secret is to be shown once; it is kept nowhere.
    ///
    /// # Errors
    /// See [`KeysError`].
    pub(crate) fn make_key(
        &mut self,
        name: Name,
        scopes: ScopeSet,
        by: &str,
        now_unix_s: u64,
    ) -> Result<(ApiKey, Secret), KeysError> {
        let (key, secret) = self.kept.keys.make(name, scopes, by, now_unix_s)?;
        self.changed = true;
        Ok((key.clone(), secret))
    }

    /// Takes a key's rights away.
    ///
    /// # Errors
    /// There is none of that id.
    pub(crate) fn revoke_key(&mut self, id: &str) -> Result<(), KeysError> {
        self.kept.keys.revoke(id)?;
        self.changed = true;
        Ok(())
    }

    /// An application asks for a key. Gives what admins are to see, and the token to poll with.
    ///
    /// # Errors
    /// See [`AppKeysError`].
    pub(crate) fn ask_key(
        &mut self,
        source: Source,
        app: &str,
        user: Option<&str>,
        now_unix_s: u64,
    ) -> Result<(AppRequest, Secret), AppKeysError> {
        self.apps.ask(source, app, user, now_unix_s).map(|(request, token)| (request.clone(), token))
    }

    /// The applications that wait for an admin.
    pub(crate) fn key_requests(&mut self, now_unix_s: u64) -> impl Iterator<Item = &AppRequest> {
        self.apps.pending(now_unix_s)
    }

    /// An admin allows an application so much (`Some`), or denies it.
    ///
    /// # Errors
    /// It waits no more, or nothing would be allowed.
    pub(crate) fn answer_key_request(
        &mut self,
        id: &str,
        allow: Option<ScopeSet>,
        by: &str,
        now_unix_s: u64,
    ) -> Result<(), AppKeysError> {
        match allow {
            Some(scopes) => self.apps.allow(id, scopes, by, now_unix_s),
            None => self.apps.deny(id, now_unix_s),
        }
    }

    /// An application asks what has become of it. Its key is made now.
    ///
    /// # Errors
    /// There is no room for a key, or the system has no random numbers; it has to ask anew.
    pub(crate) fn poll_key(&mut self, token: &str, now_unix_s: u64) -> Result<AppAnswer, KeysError> {
        Ok(match self.apps.poll(token, now_unix_s) {
            appkeys::Answer::Pending => AppAnswer::Pending,
            appkeys::Answer::Gone => AppAnswer::Gone,
            appkeys::Answer::Granted(grant) => {
                let (_, secret) = self.make_key(grant.app, grant.scopes, &grant.by, now_unix_s)?;
                AppAnswer::Key(secret)
            }
        })
    }
}
