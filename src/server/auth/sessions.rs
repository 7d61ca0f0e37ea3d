//! Sessions of people in browsers, in memory only: a restart ends them all.
//!
//! Takes a user's name; gives a token for the cookie and a second one against cross-site requests.
//! The first is kept as its SHA-256. A session ends after a day without use, after two weeks, when
//! its user's password changes or the user goes, or when there are too many. Knows no passwords.
use super::secret::{self, Digest, NoRandom, Secret};

/// A session that nobody used for so long ends, s: a day, as prints last so long.
pub(crate) const IDLE_S: u64 = 24 * 3600;

/// The oldest a session gets, s: two weeks.
pub(crate) const MAX_AGE_S: u64 = 14 * 24 * 3600;

/// For so long after the password was given dangerous actions are allowed, s.
pub(crate) const CONFIRMED_S: u64 = 10 * 60;

/// Of one user at most; the one that was used least lately goes.
const MAX_PER_USER: usize = 16;

/// In all at most.
const MAX_SESSIONS: usize = 256;

/// Names a session to those who hold no token.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct SessionId(u64);

/// A session.
#[derive(Clone, Debug)]
pub(super) struct Session {
    pub(super) id: SessionId,
    /// The user's name, folded.
    pub(super) user: String,
    pub(super) csrf: Secret,
    token: Digest,
    created_unix_s: u64,
    seen_unix_s: u64,
    password_unix_s: u64,
}

impl Session {
    /// A clock that is set (a Pi starts without the time) ends sessions, whichever way it jumps:
    /// none lives longer than it should.
    fn lives(&self, now_unix_s: u64) -> bool {
        now_unix_s.abs_diff(self.seen_unix_s) < IDLE_S && now_unix_s.abs_diff(self.created_unix_s) < MAX_AGE_S
    }

    /// Until when dangerous actions are allowed; a time that is past, or was never, is 0.
    pub(super) fn confirmed_until_unix_s(&self, now_unix_s: u64) -> u64 {
        match now_unix_s.checked_sub(self.password_unix_s) {
            Some(0..CONFIRMED_S) => self.password_unix_s + CONFIRMED_S,
            _ => 0,
        }
    }
}

/// All sessions.
#[derive(Debug, Default)]
pub(super) struct Sessions {
    list: Vec<Session>,
    last_id: u64,
}

impl Sessions {
    /// Begins a session of one who has just given the password. The token is always a new one:
    /// whoever has planted a token in the browser before has gained nothing.
    ///
    /// # Errors
    /// The system has no random numbers.
    pub(super) fn begin(&mut self, user: String, now_unix_s: u64) -> Result<(Secret, &Session), NoRandom> {
        let token = Secret::random("")?;
        let csrf = Secret::random("")?;
        self.sweep(now_unix_s);
        if self.list.iter().filter(|s| s.user == user).count() >= MAX_PER_USER {
            self.drop_oldest(|s| s.user == user);
        }
        if self.list.len() >= MAX_SESSIONS {
            self.drop_oldest(|_| true);
        }
        self.last_id += 1;
        self.list.push(Session {
            id: SessionId(self.last_id),
            user,
            csrf,
            token: Digest::of(token.reveal()),
            created_unix_s: now_unix_s,
            seen_unix_s: now_unix_s,
            password_unix_s: now_unix_s,
        });
        Ok((token, &self.list[self.list.len() - 1]))
    }

    /// The session of a token, which counts as used.
    pub(super) fn find(&mut self, token: &str, now_unix_s: u64) -> Option<&Session> {
        if !secret::well_formed(token, "") {
            return None;
        }
        self.sweep(now_unix_s);
        let at = secret::find(token, self.list.iter().map(|s| &s.token))?;
        let session = &mut self.list[at];
        session.seen_unix_s = session.seen_unix_s.max(now_unix_s);
        Some(session)
    }

    /// A session that still lives; does not count as used.
    pub(super) fn get(&self, id: SessionId, now_unix_s: u64) -> Option<&Session> {
        self.list.iter().find(|s| s.id == id && s.lives(now_unix_s))
    }

    /// Notes that the password was given again. `false`: the session is gone.
    pub(super) fn confirm(&mut self, id: SessionId, now_unix_s: u64) -> bool {
        self.sweep(now_unix_s);
        let found = self.list.iter_mut().find(|s| s.id == id);
        found.map(|session| session.password_unix_s = now_unix_s).is_some()
    }

    /// Ends one session.
    pub(super) fn end(&mut self, id: SessionId) {
        self.list.retain(|s| s.id != id);
    }

    /// Ends the session of a token, if there is one.
    pub(super) fn end_token(&mut self, token: &str) {
        if let Some(at) = secret::find(token, self.list.iter().map(|s| &s.token)) {
            self.list.remove(at);
        }
    }

    /// Ends all sessions of a user.
    pub(super) fn end_user(&mut self, folded: &str) {
        self.list.retain(|s| s.user != folded);
    }

    fn sweep(&mut self, now_unix_s: u64) {
        self.list.retain(|s| s.lives(now_unix_s));
    }

    fn drop_oldest(&mut self, among: impl Fn(&Session) -> bool) {
        let oldest = self.list.iter().filter(|s| among(s)).min_by_key(|s| (s.seen_unix_s, s.id.0));
        if let Some(id) = oldest.map(|s| s.id) {
            self.end(id);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: u64 = 1_700_000_000;

    fn begin(sessions: &mut Sessions, user: &str, now_unix_s: u64) -> Secret {
        sessions.begin(user.to_owned(), now_unix_s).unwrap().0
    }

    /// A session that is used at some times, each after `NOW`, lives at the last of them or not.
    fn check(used_after_s: &[i64], expect: bool) {
        let mut sessions = Sessions::default();
        let token = begin(&mut sessions, "anna", NOW);
        let mut lives = true;
        for &after_s in used_after_s {
            lives = sessions.find(token.reveal(), NOW.saturating_add_signed(after_s)).is_some();
        }
        assert_eq!(lives, expect, "{used_after_s:?}");
    }

    #[test]
    fn sessions_expire() {
        let day = IDLE_S as i64;
        check(&[0], true);
        check(&[day - 1], true);
        check(&[day], false);
        check(&[day, 1], false);
        check(&[day - 1, 2 * day - 2], true);
        let nearly: Vec<_> = (1..=14).map(|n| n * (day - 1)).collect();
        check(&nearly, true);
        check(&[nearly, vec![14 * day - 1]].concat(), true);
        check(&(1..=15).map(|n| n * (day - 1)).collect::<Vec<_>>(), false);
        // The clock was set.
        check(&[-1, -60], true);
        check(&[-day], false);
        check(&[50 * 365 * day], false);
        check(&[-(NOW as i64)], false);
    }

    #[test]
    fn only_a_whole_token_matches() {
        let mut sessions = Sessions::default();
        let a = begin(&mut sessions, "anna", NOW);
        let b = begin(&mut sessions, "bo", NOW);
        assert_eq!(sessions.find(a.reveal(), NOW).unwrap().user, "anna");
        assert_eq!(sessions.find(b.reveal(), NOW).unwrap().user, "bo");
        for bad in ["", " ", &a.reveal()[1..], "AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"] {
            assert!(sessions.find(bad, NOW).is_none(), "{bad:?}");
        }
        let shown = format!("{sessions:?}");
        assert!(!shown.contains(a.reveal()) && !shown.contains(sessions.list[0].csrf.reveal()));
        assert!(!sessions.list[0].csrf.matches(sessions.list[1].csrf.reveal()));
    }

    #[test]
    fn a_confirmation_lasts_ten_minutes() {
        let mut sessions = Sessions::default();
        begin(&mut sessions, "anna", NOW);
        let id = sessions.list[0].id;
        let until = |s: &Sessions, now| s.get(id, now).unwrap().confirmed_until_unix_s(now);
        assert_eq!(until(&sessions, NOW), NOW + 600);
        assert_eq!(until(&sessions, NOW + 599), NOW + 600);
        assert_eq!(until(&sessions, NOW + 600), 0);
        assert_eq!(until(&sessions, NOW - 1), 0, "the clock was set back");
        assert!(sessions.confirm(id, NOW + 5000));
        assert_eq!(until(&sessions, NOW + 5000), NOW + 5600);
        sessions.end(id);
        assert!(!sessions.confirm(id, NOW + 5000));
    }

    #[test]
    fn sessions_end_with_their_user() {
        let mut sessions = Sessions::default();
        let tokens = ["anna", "bo", "anna"].map(|user| begin(&mut sessions, user, NOW));
        sessions.end_user("anna");
        let live = tokens.map(|token| sessions.find(token.reveal(), NOW).is_some());
        assert_eq!(live, [false, true, false]);
    }

    #[test]
    fn the_least_lately_used_goes() {
        let mut sessions = Sessions::default();
        let first = begin(&mut sessions, "anna", NOW);
        let second = begin(&mut sessions, "anna", NOW);
        let other = begin(&mut sessions, "bo", NOW - 1);
        sessions.find(first.reveal(), NOW + 1).unwrap();
        for _ in 2..=MAX_PER_USER {
            begin(&mut sessions, "anna", NOW + 2);
        }
        assert!(sessions.find(first.reveal(), NOW + 3).is_some());
        assert!(sessions.find(second.reveal(), NOW + 3).is_none());
        assert!(sessions.find(other.reveal(), NOW + 3).is_some());
        for n in 0..MAX_SESSIONS * 2 {
            begin(&mut sessions, &n.to_string(), NOW + 4);
        }
        assert_eq!(sessions.list.len(), MAX_SESSIONS);
        assert!(sessions.find(first.reveal(), NOW + 5).is_none());
    }
}
