//! Who asks, and what they may do: the answer to every request's first question.
//!
//! Plain data that the rest of the server passes around. Knows no lists and no clock.
use super::keys::ApiKey;
use super::scope::{Role, Scope, ScopeSet};
use super::secret::{NoRandom, Secret};
use super::sessions::{Session, SessionId};
use super::throttle::Limited;
use super::users::User;

/// Why somebody does not get what they ask for.
#[derive(Clone, Debug, thiserror::Error)]
pub(crate) enum Refused {
    /// Nobody knows who asks.
    #[error("log in, or give an API key: this one is missing, wrong, or has ended")]
    Unauthenticated,
    /// Name and password do not belong together. Which of them is wrong is not told.
    #[error("that name and that password do not belong together")]
    WrongPassword,
    /// They may not.
    #[error("this needs the scope {scope}: ask an admin")]
    Forbidden {
        /// What they lack.
        scope: Scope,
    },
    /// They may, but have not given the password lately.
    #[error("give your password again: this is asked before dangerous actions")]
    Reauthenticate,
    /// A page of somebody else may have sent this.
    #[error("the header X-Csrf-Token is missing or is not this session's: reload the page")]
    Csrf,
    /// Too often.
    #[error(transparent)]
    Limited(#[from] Limited),
    /// No token can be made.
    #[error(transparent)]
    NoRandom(#[from] NoRandom),
}

impl Refused {
    /// The word for it in `docs/api.md`.
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::Unauthenticated | Self::WrongPassword => "unauthenticated",
            Self::Forbidden { .. } => "forbidden",
            Self::Reauthenticate => "reauthenticate",
            Self::Csrf => "csrf",
            Self::Limited(_) => "rate-limited",
            Self::NoRandom(_) => "internal",
        }
    }
}

/// One who asks, and is known.
#[derive(Clone, Debug)]
pub(crate) struct Who {
    /// The user's name, or the key's.
    pub(crate) name: String,
    /// What they may do.
    pub(crate) scopes: ScopeSet,
    /// How they are known.
    pub(crate) via: Via,
}

/// How one is known.
#[derive(Clone, Debug)]
pub(crate) enum Via {
    /// A person, by a session's cookie, which a browser sends along whoever wrote the page:
    /// [`Who::check_csrf`] must follow for whatever changes something.
    Session {
        /// The session.
        session: SessionId,
        /// The user's role.
        role: Role,
        /// What the page must send along.
        csrf: Secret,
        /// Until when dangerous actions are allowed; past: not.
        confirmed_until_unix_s: u64,
    },
    /// A program, by its key.
    Key {
        /// The key's id.
        id: String,
    },
}

impl Who {
    pub(super) fn of_session(session: &Session, user: &User, now_unix_s: u64) -> Self {
        Self {
            name: user.name.to_string(),
            scopes: user.role.scopes(),
            via: Via::Session {
                session: session.id,
                role: user.role,
                csrf: session.csrf.clone(),
                confirmed_until_unix_s: session.confirmed_until_unix_s(now_unix_s),
            },
        }
    }

    pub(super) fn of_key(key: &ApiKey) -> Self {
        Self { name: key.name.to_string(), scopes: key.scopes, via: Via::Key { id: key.id.clone() } }
    }

    /// Holds them to a scope.
    ///
    /// # Errors
    /// They have not that scope.
    pub(crate) fn require(&self, scope: Scope) -> Result<(), Refused> {
        if self.scopes.has(scope) { Ok(()) } else { Err(Refused::Forbidden { scope }) }
    }

    /// Holds a person to having given the password lately, and both to a scope. A key needs none.
    ///
    /// # Errors
    /// They have not that scope, or it is too long ago.
    pub(crate) fn require_confirmed(&self, scope: Scope, now_unix_s: u64) -> Result<(), Refused> {
        self.require(scope)?;
        match self.via {
            Via::Session { confirmed_until_unix_s, .. } if now_unix_s >= confirmed_until_unix_s => {
                Err(Refused::Reauthenticate)
            }
            _ => Ok(()),
        }
    }

    /// Holds a page to the session's own token, for whatever changes something. No browser sends a
    /// key by itself: programs need none.
    ///
    /// # Errors
    /// The header is missing or another one.
    pub(crate) fn check_csrf(&self, header: Option<&str>) -> Result<(), Refused> {
        match &self.via {
            Via::Session { csrf, .. } if !header.is_some_and(|given| csrf.matches(given)) => {
                Err(Refused::Csrf)
            }
            _ => Ok(()),
        }
    }
}
