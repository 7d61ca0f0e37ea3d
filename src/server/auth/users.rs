//! The users: a name, a role and a password's hash for each.
//!
//! Takes changes; gives the list, which is always empty or has an admin, and no two names that
//! differ in case only. What is read back is held to the same. Knows no sessions and no file.
use super::name::Name;
use super::password::PasswordHash;
use super::scope::Role;
use serde::{Deserialize, Serialize};

/// Users at most: a club's workshop; what is kept stays a small file.
pub(crate) const MAX_USERS: usize = 64;

/// Why the list stays as it was.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum UsersError {
    /// The name is taken.
    #[error("there is a user {0} already")]
    Taken(Name),
    /// Nobody has that name.
    #[error("there is no user of that name")]
    Unknown,
    /// Nobody could let anybody in any more.
    #[error("there must be an admin: make another one first")]
    NoAdmin,
    /// The list is full.
    #[error("there are {MAX_USERS} users, more do not fit: remove one first")]
    Full,
}

/// A user.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct User {
    /// What they are called.
    pub(crate) name: Name,
    /// What they may do.
    pub(crate) role: Role,
    /// When they were added.
    pub(crate) created_unix_s: u64,
    pub(super) password: PasswordHash,
}

/// All of them, in the order in which they came.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(try_from = "Vec<User>", into = "Vec<User>")]
pub(crate) struct Users(Vec<User>);

impl Users {
    /// The users.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &User> {
        self.0.iter()
    }

    /// Whether there is none.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The user of that name, whatever its case.
    pub(crate) fn find(&self, name: &Name) -> Option<&User> {
        let folded = name.folded();
        self.iter().find(|user| user.name.folded() == folded)
    }

    /// Adds a user. The first one is an admin.
    ///
    /// # Errors
    /// The name is taken, the list is full, or there would be no admin.
    pub(crate) fn add(
        &mut self,
        name: Name,
        role: Role,
        password: PasswordHash,
        now_unix_s: u64,
    ) -> Result<(), UsersError> {
        self.change(|users| {
            users.push(User { name, role, password, created_unix_s: now_unix_s });
            Ok(())
        })
    }

    /// Removes a user.
    ///
    /// # Errors
    /// There is none, or no admin would be left.
    pub(crate) fn remove(&mut self, name: &Name) -> Result<(), UsersError> {
        self.change(|users| {
            let at = position(users, name)?;
            users.remove(at);
            // An empty list would open the door to whoever sets up first.
            if users.is_empty() { Err(UsersError::NoAdmin) } else { Ok(()) }
        })
    }

    /// Gives a user another password.
    ///
    /// # Errors
    /// There is no such user.
    pub(crate) fn set_password(&mut self, name: &Name, password: PasswordHash) -> Result<(), UsersError> {
        let at = position(&self.0, name)?;
        self.0[at].password = password;
        Ok(())
    }

    /// Gives a user another role.
    ///
    /// # Errors
    /// There is no such user, or no admin would be left.
    pub(crate) fn set_role(&mut self, name: &Name, role: Role) -> Result<(), UsersError> {
        self.change(|users| {
            let at = position(users, name)?;
            users[at].role = role;
            Ok(())
        })
    }

    /// Makes a change on a copy, which is kept if it is in order.
    fn change(
        &mut self,
        how: impl FnOnce(&mut Vec<User>) -> Result<(), UsersError>,
    ) -> Result<(), UsersError> {
        let mut users = self.0.clone();
        how(&mut users)?;
        *self = Self::try_from(users)?;
        Ok(())
    }
}

fn position(users: &[User], name: &Name) -> Result<usize, UsersError> {
    let folded = name.folded();
    users.iter().position(|user| user.name.folded() == folded).ok_or(UsersError::Unknown)
}

impl TryFrom<Vec<User>> for Users {
    type Error = UsersError;

    fn try_from(users: Vec<User>) -> Result<Self, UsersError> {
        let mut names = std::collections::HashSet::new();
        if let Some(twice) = users.iter().find(|user| !names.insert(user.name.folded())) {
            return Err(UsersError::Taken(twice.name.clone()));
        }
        if users.len() > MAX_USERS {
            return Err(UsersError::Full);
        }
        if !users.is_empty() && !users.iter().any(|user| user.role == Role::Admin) {
            return Err(UsersError::NoAdmin);
        }
        Ok(Self(users))
    }
}

impl From<Users> for Vec<User> {
    fn from(users: Users) -> Self {
        users.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> Name {
        Name::new(text).unwrap()
    }

    fn users(list: &[(&str, Role)]) -> Users {
        let mut users = Users::default();
        for &(who, role) in list {
            users.add(name(who), role, PasswordHash::quick("password"), 7).unwrap();
        }
        users
    }

    /// Makes a change; a change that is refused changes nothing.
    fn check(
        list: &[(&str, Role)],
        how: impl FnOnce(&mut Users) -> Result<(), UsersError>,
        expect: Result<&str, UsersError>,
    ) {
        let mut users = users(list);
        let show = |users: &Users| {
            users.iter().map(|u| format!("{}={}", u.name, u.role)).collect::<Vec<_>>().join(" ")
        };
        let before = show(&users);
        match (how(&mut users), expect) {
            (Ok(()), Ok(after)) => assert_eq!(show(&users), after),
            (Err(got), Err(error)) => {
                assert_eq!(got, error);
                assert_eq!(show(&users), before);
            }
            (got, expect) => panic!("{got:?}, but {expect:?}"),
        }
    }

    #[test]
    fn an_admin_is_always_left() {
        use Role::{Admin, Operator, Viewer};
        let two = [("anna", Admin), ("Bo", Viewer)];
        let hash = || PasswordHash::quick("password");
        check(&two, |u| u.remove(&name("bo")), Ok("anna=admin"));
        check(&two, |u| u.remove(&name("ANNA")), Err(UsersError::NoAdmin));
        check(&two[..1], |u| u.remove(&name("anna")), Err(UsersError::NoAdmin));
        check(&two, |u| u.set_role(&name("anna"), Operator), Err(UsersError::NoAdmin));
        check(&two, |u| u.set_role(&name("bo"), Admin), Ok("anna=admin Bo=admin"));
        check(&[("a", Admin), ("b", Admin)], |u| u.remove(&name("a")), Ok("b=admin"));
        check(&two, |u| u.remove(&name("carl")), Err(UsersError::Unknown));
        check(&two, |u| u.set_password(&name("carl"), hash()), Err(UsersError::Unknown));
        check(&[], |u| u.add(name("a"), Viewer, hash(), 0), Err(UsersError::NoAdmin));
    }

    #[test]
    fn names_are_unlike_whatever_their_case() {
        let hash = || PasswordHash::quick("password");
        let list = [("Änna", Role::Admin)];
        check(&list, |u| u.add(name(" äNNA"), Role::Admin, hash(), 0), Err(UsersError::Taken(name("äNNA"))));
        assert_eq!(users(&list).find(&name("äNnA")).unwrap().name.as_str(), "Änna");
        assert!(users(&list).find(&name("Anna")).is_none());
    }

    #[test]
    fn the_list_is_bounded() {
        let mut users = users(&[("u0", Role::Admin)]);
        let hash = PasswordHash::quick("password");
        for n in 1..MAX_USERS {
            users.add(name(&format!("u{n}")), Role::Viewer, hash.clone(), 0).unwrap();
        }
        assert_eq!(users.add(name("more"), Role::Viewer, hash, 0), Err(UsersError::Full));
    }

    #[test]
    fn what_is_kept_has_no_password_and_is_held_to_the_rules() {
        let list = users(&[("anna", Role::Admin), ("bo", Role::Viewer)]);
        let text = serde_json::to_string(&list).unwrap();
        assert!(!text.contains("\"password\":\"password\"") && text.contains("$argon2id$"), "{text}");
        assert!(!format!("{list:?}").contains("argon2id"));
        let back: Users = serde_json::from_str(&text).unwrap();
        assert_eq!(serde_json::to_string(&back).unwrap(), text);
        for (from, to) in
            [("admin", "viewer"), ("\"bo\"", "\"ANNA\""), ("\"bo\"", "\"b\\u0000o\""), ("$arg", "arg")]
        {
            assert!(serde_json::from_str::<Users>(&text.replace(from, to)).is_err(), "{from} {to}");
        }
    }
}
