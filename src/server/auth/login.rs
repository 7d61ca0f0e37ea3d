//! Passwords at the door: logging in, giving the password again, and the very first user.
//!
//! A password takes long to look at, and nothing else may wait for it. So there are three steps:
//! `begin` asks whether there may be a try at all, [`Attempt::check`] does the work, away from
//! everything else, and `finish` takes the result, if by then it still means anything.
use super::Auth;
use super::name::Name;
use super::password::{self, PasswordHash};
use super::scope::Role;
use super::secret::{NoRandom, Secret};
use super::setup::{CodeError, SetupPass};
use super::source::Source;
use super::throttle::Limited;
use super::users::UsersError;
use super::who::{Refused, Via, Who};
use std::sync::Arc;

/// Passwords that are looked at at once: each takes 19 MiB, and a Pi has four cores.
const MAX_AT_ONCE: usize = 4;

/// A try that may be made. Dropped, it counts as failed.
#[must_use]
#[derive(Debug)]
pub(crate) struct Attempt {
    source: Source,
    name: Option<Name>,
    hash: Option<PasswordHash>,
    // One of [`MAX_AT_ONCE`], given back when the attempt goes.
    _place: Arc<()>,
}

/// A try that was made.
#[must_use]
#[derive(Debug)]
pub(crate) struct Checked {
    source: Source,
    /// Whose password it was.
    user: Option<(Name, PasswordHash)>,
}

impl Attempt {
    /// Looks at the password: up to a second on a small computer. It takes as long where there is
    /// no such user.
    pub(crate) fn check(self, password: &str) -> Checked {
        let right = password::verify(self.hash.as_ref(), password);
        let user = self.name.zip(self.hash).filter(|_| right);
        Checked { source: self.source, user }
    }
}

/// A session has begun.
#[derive(Debug)]
pub(crate) struct Login {
    /// For the cookie, and for nothing else.
    pub(crate) token: Secret,
    /// Who it is.
    pub(crate) who: Who,
}

/// Why there is no first user.
#[derive(Debug, thiserror::Error)]
pub(crate) enum SetupError {
    /// The code.
    #[error(transparent)]
    Code(#[from] CodeError),
    /// The list of users.
    #[error(transparent)]
    Users(#[from] UsersError),
    /// No token can be made.
    #[error(transparent)]
    NoRandom(#[from] NoRandom),
}

impl Auth {
    /// Before a password is looked at.
    ///
    /// # Errors
    /// [`Refused::Limited`]: the source or the name has to wait, or too many are at it.
    pub(crate) fn begin_login(
        &mut self,
        source: Source,
        name: &str,
        now_ms: u64,
    ) -> Result<Attempt, Refused> {
        let place = Arc::clone(&self.at_work);
        // The list's own and this one are no attempts.
        if Arc::strong_count(&place) > MAX_AT_ONCE + 1 {
            return Err(Limited { retry_after_s: 1 }.into());
        }
        // A text that can be no name is treated as one that nobody bears.
        let name = Name::new(name).ok();
        let user = name.as_ref().and_then(|name| self.kept.users.find(name));
        let folded = name.as_ref().map(Name::folded);
        self.throttle.try_password(source, folded.as_deref(), user.is_some(), now_ms)?;
        let hash = user.map(|user| user.password.clone());
        Ok(Attempt { source, name, hash, _place: place })
    }

    /// Begins a session, always with a new token; the one that the browser had ends.
    ///
    /// # Errors
    /// [`Refused::WrongPassword`], also where the user has changed or gone meanwhile.
    pub(crate) fn finish_login(
        &mut self,
        checked: Checked,
        old_token: Option<&str>,
        now_unix_s: u64,
    ) -> Result<Login, Refused> {
        let name = self.right_password(checked)?;
        if let Some(old) = old_token {
            self.sessions.end_token(old);
        }
        self.begin_session(&name, now_unix_s)
    }

    /// Before the password of a session's user is looked at again. The rest as for a login.
    ///
    /// # Errors
    /// [`Refused::Unauthenticated`]: a key has no password, or the session has ended;
    /// [`Refused::Limited`].
    pub(crate) fn begin_confirm(
        &mut self,
        who: &Who,
        source: Source,
        now_unix_s: u64,
        now_ms: u64,
    ) -> Result<Attempt, Refused> {
        let still = self.refresh(who, now_unix_s).ok_or(Refused::Unauthenticated)?;
        match still.via {
            Via::Session { .. } => self.begin_login(source, &still.name, now_ms),
            Via::Key { .. } => Err(Refused::Unauthenticated),
        }
    }

    /// Allows the session dangerous actions for ten minutes.
    ///
    /// # Errors
    /// [`Refused::WrongPassword`]; [`Refused::Unauthenticated`]: the session has ended meanwhile.
    pub(crate) fn finish_confirm(
        &mut self,
        checked: Checked,
        who: &Who,
        now_unix_s: u64,
    ) -> Result<(), Refused> {
        let name = self.right_password(checked)?;
        match who.via {
            Via::Session { session, .. } if name.as_str() == who.name => {
                if self.sessions.confirm(session, now_unix_s) {
                    Ok(())
                } else {
                    Err(Refused::Unauthenticated)
                }
            }
            _ => Err(Refused::Unauthenticated),
        }
    }

    /// Ends a session.
    pub(crate) fn log_out(&mut self, who: &Who) {
        if let Via::Session { session, .. } = who.via {
            self.sessions.end(session);
        }
    }

    /// Opens the setup, if there is no user: makes a code, to be shown in the terminal. An earlier
    /// one is void.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(crate) fn open_setup(&mut self) -> Result<Option<Secret>, NoRandom> {
        if self.needs_first_user() { self.setup.open().map(Some) } else { Ok(None) }
    }

    /// Looks at a setup's code.
    ///
    /// # Errors
    /// It is not the code. After [`CodeError::Spent`] the caller opens the setup anew.
    pub(crate) fn check_setup(&mut self, code: &str) -> Result<SetupPass, CodeError> {
        self.setup.check(code)
    }

    /// Makes the first user, an admin, and begins a session. Nobody else comes in this way.
    ///
    /// # Errors
    /// Somebody was quicker.
    pub(crate) fn finish_setup(
        &mut self,
        _pass: SetupPass,
        name: Name,
        password: PasswordHash,
        now_unix_s: u64,
    ) -> Result<Login, SetupError> {
        if !self.needs_first_user() {
            return Err(CodeError::Closed.into());
        }
        self.add_user(name.clone(), Role::Admin, password, now_unix_s)?;
        self.begin_session(&name, now_unix_s).map_err(|refused| match refused {
            Refused::NoRandom(e) => e.into(),
            // The user has just been added.
            _ => SetupError::Users(UsersError::Unknown),
        })
    }

    /// The name as its user writes it.
    fn right_password(&mut self, checked: Checked) -> Result<Name, Refused> {
        let (name, hash) = checked.user.ok_or(Refused::WrongPassword)?;
        // Between the two steps the password may have become another one.
        let user = self.kept.users.find(&name).filter(|user| user.password.is_same(&hash));
        let name = user.ok_or(Refused::WrongPassword)?.name.clone();
        self.throttle.right_password(checked.source, &name.folded());
        Ok(name)
    }

    fn begin_session(&mut self, name: &Name, now_unix_s: u64) -> Result<Login, Refused> {
        let user = self.kept.users.find(name).ok_or(Refused::Unauthenticated)?;
        let (token, session) = self.sessions.begin(name.folded(), now_unix_s)?;
        Ok(Login { token, who: Who::of_session(session, user, now_unix_s) })
    }
}
