//! What one may do: four scopes, sets of them, and the three roles that are such sets.
//!
//! Sets are written as lists of words, as `docs/api.md` has them. Knows neither users nor keys.
use serde::{Deserialize, Serialize};
use std::fmt;

/// A kind of thing that one may do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Scope {
    /// See everything but users and keys.
    Read,
    /// Upload, queue, approve, pause, resume, cancel, stop.
    Print,
    /// Jog, heat, console.
    Control,
    /// Users, keys, forgetting jobs, the console while printing.
    Admin,
}

impl Scope {
    /// All of them, in the order in which they are written.
    pub(crate) const ALL: [Self; 4] = [Self::Read, Self::Print, Self::Control, Self::Admin];

    /// Its word.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Print => "print",
            Self::Control => "control",
            Self::Admin => "admin",
        }
    }

    const fn bit(self) -> u8 {
        1 << self as u8
    }
}

impl fmt::Display for Scope {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// Some of the scopes. No scope holds another: who may `admin` but not `print` does not print.
#[derive(Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Vec<Scope>", into = "Vec<Scope>")]
pub(crate) struct ScopeSet(u8);

impl ScopeSet {
    /// The set of those.
    pub(crate) const fn of(scopes: &[Scope]) -> Self {
        let mut bits = 0;
        let mut at = 0;
        while at < scopes.len() {
            bits |= scopes[at].bit();
            at += 1;
        }
        Self(bits)
    }

    /// Whether that scope is among them.
    pub(crate) fn has(self, scope: Scope) -> bool {
        self.0 & scope.bit() != 0
    }

    /// Whether nothing is allowed.
    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The scopes, in the order of [`Scope::ALL`].
    pub(crate) fn iter(self) -> impl Iterator<Item = Scope> {
        Scope::ALL.into_iter().filter(move |&scope| self.has(scope))
    }
}

impl From<Vec<Scope>> for ScopeSet {
    fn from(scopes: Vec<Scope>) -> Self {
        Self::of(&scopes)
    }
}

impl From<ScopeSet> for Vec<Scope> {
    fn from(set: ScopeSet) -> Self {
        set.iter().collect()
    }
}

impl fmt::Debug for ScopeSet {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

/// What a user is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Role {
    /// Looks on.
    Viewer,
    /// Prints.
    Operator,
    /// Does everything.
    Admin,
}

impl Role {
    /// What it may do.
    pub(crate) const fn scopes(self) -> ScopeSet {
        match self {
            Self::Viewer => ScopeSet::of(&[Scope::Read]),
            Self::Operator => ScopeSet::of(&[Scope::Read, Scope::Print, Scope::Control]),
            Self::Admin => ScopeSet::of(&Scope::ALL),
        }
    }

    /// Its word.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Viewer => "viewer",
            Self::Operator => "operator",
            Self::Admin => "admin",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(role: Role, words: &str) {
        assert_eq!(serde_json::to_string(&role.scopes()).unwrap(), words);
        assert_eq!(serde_json::to_string(&role).unwrap(), format!("\"{role}\""));
    }

    #[test]
    fn roles_are_the_sets_of_the_contract() {
        check(Role::Viewer, r#"["read"]"#);
        check(Role::Operator, r#"["read","print","control"]"#);
        check(Role::Admin, r#"["read","print","control","admin"]"#);
        for scope in Scope::ALL {
            assert_eq!(serde_json::to_string(&scope).unwrap(), format!("\"{scope}\""));
        }
    }

    #[test]
    fn a_word_nobody_knows_is_refused() {
        assert!(serde_json::from_str::<ScopeSet>(r#"["read","root"]"#).is_err());
        assert!(serde_json::from_str::<ScopeSet>("15").is_err());
        assert!(serde_json::from_str::<Role>(r#""Admin""#).is_err());
        assert!(serde_json::from_str::<ScopeSet>("[]").unwrap().is_empty());
    }

    proptest::proptest! {
        #[test]
        fn a_set_holds_what_it_was_made_of(picks in proptest::collection::vec(0_usize..4, 0..9)) {
            let set: ScopeSet = picks.iter().map(|&at| Scope::ALL[at]).collect::<Vec<_>>().into();
            for (at, scope) in Scope::ALL.into_iter().enumerate() {
                assert_eq!(set.has(scope), picks.contains(&at));
            }
            let text = serde_json::to_string(&set).unwrap();
            assert_eq!(serde_json::from_str::<ScopeSet>(&text).unwrap(), set);
        }
    }
}
