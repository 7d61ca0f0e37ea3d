//! The rooms together: what a client sees, and the lessons of hosts that were broken into.
use super::keys::PREFIX as KEY_PREFIX;
use super::secret::Secret;
use super::*;
use std::net::IpAddr;

const NOW: u64 = 1_700_000_000;

fn name(text: &str) -> Name {
    Name::new(text).unwrap()
}

fn home() -> Source {
    "127.0.0.1".parse::<IpAddr>().unwrap().into()
}

/// Anna is an admin, Bo looks on; both have the password `password`.
fn auth() -> Auth {
    let mut auth = Auth::new(Kept::default());
    auth.add_user(name("Anna"), Role::Admin, PasswordHash::quick("password"), NOW).unwrap();
    auth.add_user(name("bo"), Role::Viewer, PasswordHash::quick("password"), NOW).unwrap();
    assert!(auth.take_change().is_some() && auth.take_change().is_none());
    auth
}

fn log_in(auth: &mut Auth, who: &str, password: &str, now_unix_s: u64) -> Result<Login, Refused> {
    let attempt = auth.begin_login(home(), who, now_unix_s * 1000)?;
    auth.finish_login(attempt.check(password), None, now_unix_s)
}

fn cookie(auth: &mut Auth, token: &Secret, now_unix_s: u64) -> Option<Who> {
    auth.by_cookie(token.reveal(), now_unix_s).ok()
}

#[test]
fn one_logs_in_with_name_and_password() {
    let mut auth = auth();
    let mut check = |who: &str, password: &str, expect: &str| {
        let got = log_in(&mut auth, who, password, NOW);
        let got = got.map_or_else(|e| e.kind().to_owned(), |login| format!("{:?}", login.who.scopes));
        assert_eq!(got, expect, "{who} {password}");
    };
    check("Anna", "password", "{Read, Print, Control, Admin}");
    check(" ANNA ", "password", "{Read, Print, Control, Admin}");
    check("bo", "password", "{Read}");
    check("bo", "Password", "unauthenticated");
    check("bo", "", "unauthenticated");
    check("carl", "password", "unauthenticated");
    check("", "", "unauthenticated");
    check(&"x".repeat(1000), "", "unauthenticated");
    check("bo", "password", "rate-limited");
}

#[test]
fn a_refusal_does_not_tell_who_has_an_account() {
    let mut auth = auth();
    let words = |r: Result<Login, Refused>| r.unwrap_err().to_string();
    let there = words(log_in(&mut auth, "anna", "wrong password", NOW));
    let nobody = words(log_in(&mut auth, "carl", "wrong password", NOW));
    assert_eq!(there, nobody);
}

#[test]
fn guesses_at_once_are_counted_before_they_fail() {
    let mut auth = auth();
    let mut held = Vec::new();
    let busy = loop {
        match auth.begin_login(home(), "anna", 0) {
            Ok(attempt) => held.push(attempt),
            Err(refused) => break refused,
        }
    };
    assert!(matches!(busy, Refused::Limited(Limited { retry_after_s: 1 })) && held.len() == 4, "{busy}");
    held.clear();
    auth.begin_login(home(), "anna", 0).map(drop).unwrap();
    assert!(matches!(auth.begin_login(home(), "anna", 0), Err(Refused::Limited(_))));
}

#[test]
fn a_login_gives_a_new_token_and_ends_the_old_one() {
    let mut auth = auth();
    let first = log_in(&mut auth, "anna", "password", NOW).unwrap().token;
    let attempt = auth.begin_login(home(), "anna", 0).unwrap();
    let second = auth.finish_login(attempt.check("password"), Some(first.reveal()), NOW).unwrap().token;
    assert!(cookie(&mut auth, &first, NOW).is_none());
    assert!(cookie(&mut auth, &second, NOW).is_some());
    // A token that somebody has planted is not taken over.
    let planted = "A".repeat(43);
    let attempt = auth.begin_login(home(), "anna", 0).unwrap();
    auth.finish_login(attempt.check("password"), Some(&planted), NOW).unwrap();
    assert!(auth.by_cookie(&planted, NOW).is_err());
}

#[test]
fn a_page_of_somebody_else_does_nothing() {
    let mut auth = auth();
    let who = log_in(&mut auth, "anna", "password", NOW).unwrap().who;
    let other = log_in(&mut auth, "anna", "password", NOW).unwrap().who;
    let csrf = |who: &Who| match &who.via {
        Via::Session { csrf, .. } => csrf.reveal().to_owned(),
        Via::Key { .. } => String::new(),
    };
    who.check_csrf(Some(&csrf(&who))).unwrap();
    for bad in [None, Some(""), Some("null"), Some(csrf(&other).as_str())] {
        assert_eq!(who.check_csrf(bad).unwrap_err().kind(), "csrf");
    }
    let (_, key) = auth.make_key(name("cura"), Role::Viewer.scopes(), "Anna", NOW).unwrap();
    auth.by_key(key.reveal(), home(), NOW, 0).unwrap().check_csrf(None).unwrap();
}

#[test]
fn dangerous_actions_want_the_password_again() {
    let mut auth = auth();
    let token = log_in(&mut auth, "anna", "password", NOW).unwrap().token;
    let late = NOW + 601;
    let check = |auth: &mut Auth, password: &str, expect: &str| {
        let who = cookie(auth, &token, late).unwrap();
        let attempt = auth.begin_confirm(&who, home(), late, 0).unwrap();
        let got = auth.finish_confirm(attempt.check(password), &who, late);
        assert_eq!(got.map_or_else(|e| e.kind(), |()| "yes"), expect);
        let who = cookie(auth, &token, late).unwrap();
        let got = who.require_confirmed(Scope::Admin, late);
        assert_eq!(got.is_ok(), expect == "yes");
        assert!(got.is_ok() || got.unwrap_err().kind() == "reauthenticate");
    };
    check(&mut auth, "wrong password", "unauthenticated");
    check(&mut auth, "password", "yes");
    // A key has no password, and needs none.
    let (_, key) = auth.make_key(name("cura"), Role::Admin.scopes(), "Anna", NOW).unwrap();
    let who = auth.by_key(key.reveal(), home(), late, 0).unwrap();
    who.require_confirmed(Scope::Admin, late).unwrap();
    assert!(matches!(auth.begin_confirm(&who, home(), late, 0), Err(Refused::Unauthenticated)));
    // Nobody confirms with the password of another.
    let bo = log_in(&mut auth, "bo", "password", late).unwrap().who;
    let attempt = auth.begin_login(home(), "anna", 0).unwrap();
    assert!(auth.finish_confirm(attempt.check("password"), &bo, late).is_err());
}

#[test]
fn a_scope_is_needed_for_each_thing() {
    let mut auth = auth();
    let bo = log_in(&mut auth, "bo", "password", NOW).unwrap();
    bo.who.require(Scope::Read).unwrap();
    for scope in [Scope::Print, Scope::Control, Scope::Admin] {
        assert_eq!(bo.who.require(scope).unwrap_err().kind(), "forbidden");
        assert_eq!(bo.who.require_confirmed(scope, NOW).unwrap_err().kind(), "forbidden");
    }
    // A role holds at once, also in sessions and connections that there are.
    auth.set_role(&name("BO"), Role::Operator).unwrap();
    cookie(&mut auth, &bo.token, NOW).unwrap().require(Scope::Print).unwrap();
    auth.refresh(&bo.who, NOW).unwrap().require(Scope::Print).unwrap();
    assert!(auth.take_change().is_some());
}

#[test]
fn sessions_end_with_the_password_the_user_and_the_day() {
    let check = |how: &mut dyn FnMut(&mut Auth), later_s: u64, lives: bool| {
        let mut auth = auth();
        let Login { token, who } = log_in(&mut auth, "bo", "password", NOW).unwrap();
        how(&mut auth);
        assert_eq!(auth.refresh(&who, NOW + later_s).is_some(), lives);
        assert_eq!(cookie(&mut auth, &token, NOW + later_s).is_some(), lives);
    };
    let mut nothing = |_: &mut Auth| {};
    check(&mut nothing, 0, true);
    check(&mut nothing, 24 * 3600, false);
    check(&mut |auth| auth.set_password(&name("Bo"), PasswordHash::quick("password")).unwrap(), 0, false);
    check(&mut |auth| auth.set_password(&name("anna"), PasswordHash::quick("password")).unwrap(), 0, true);
    check(&mut |auth| auth.remove_user(&name("BO")).unwrap(), 0, false);
    // Another one of the same name does not inherit them.
    check(
        &mut |auth| {
            auth.remove_user(&name("bo")).unwrap();
            auth.add_user(name("bo"), Role::Admin, PasswordHash::quick("password"), NOW).unwrap();
        },
        0,
        false,
    );
    check(
        &mut |auth| {
            let mut kept = auth.kept.clone();
            kept.users.set_password(&name("bo"), PasswordHash::quick("password")).unwrap();
            auth.reload(kept);
        },
        0,
        false,
    );
    check(&mut |auth| auth.reload(auth.kept.clone()), 0, true);
}

#[test]
fn a_login_that_was_overtaken_fails() {
    let mut auth = auth();
    let checked = auth.begin_login(home(), "bo", 0).unwrap().check("password");
    auth.set_password(&name("bo"), PasswordHash::quick("password")).unwrap();
    assert!(matches!(auth.finish_login(checked, None, NOW), Err(Refused::WrongPassword)));
    let checked = auth.begin_login(home(), "bo", 0).unwrap().check("password");
    auth.remove_user(&name("bo")).unwrap();
    assert!(matches!(auth.finish_login(checked, None, NOW), Err(Refused::WrongPassword)));
}

#[test]
fn the_last_admin_stays() {
    let mut auth = auth();
    assert_eq!(auth.remove_user(&name("anna")), Err(UsersError::NoAdmin));
    assert_eq!(auth.set_role(&name("anna"), Role::Viewer), Err(UsersError::NoAdmin));
    assert!(auth.take_change().is_none());
    log_in(&mut auth, "anna", "password", NOW).unwrap();
}

#[test]
fn an_empty_or_wrong_key_is_none_and_is_counted() {
    let mut auth = auth();
    let (made, key) = auth.make_key(name("cura"), Role::Operator.scopes(), "Anna", NOW).unwrap();
    assert!(auth.take_change().is_some());
    let mut kinds = Vec::new();
    for given in ["", " ", "or_", "null", &key.reveal()[..20]].into_iter().cycle().take(21) {
        kinds.push(auth.by_key(given, home(), NOW, 0).unwrap_err().kind());
    }
    assert!(kinds[..20].iter().all(|&kind| kind == "unauthenticated"));
    assert_eq!(kinds[20], "rate-limited");
    let who = auth.by_key(key.reveal(), home(), NOW, 0).unwrap();
    assert_eq!((who.name.as_str(), who.require(Scope::Admin).is_err()), ("cura", true));
    // Its use is told once an hour.
    assert!(auth.take_change().is_some());
    auth.by_key(key.reveal(), home(), NOW + 60, 0).unwrap();
    assert!(auth.take_change().is_none());
    auth.revoke_key(&made.id).unwrap();
    assert!(auth.by_key(key.reveal(), home(), NOW, 0).is_err());
    assert!(auth.refresh(&who, NOW).is_none());
}

#[test]
fn a_key_is_no_cookie_and_a_cookie_no_key() {
    let mut auth = auth();
    let token = log_in(&mut auth, "anna", "password", NOW).unwrap().token;
    let (_, key) = auth.make_key(name("cura"), Role::Admin.scopes(), "Anna", NOW).unwrap();
    assert!(auth.by_cookie(key.reveal(), NOW).is_err() && auth.by_cookie("", NOW).is_err());
    assert!(auth.by_key(token.reveal(), home(), NOW, 0).is_err());
    assert!(auth.by_key(&format!("or_{}", token.reveal()), home(), NOW, 0).is_err());
}

#[test]
fn the_first_user_comes_in_by_the_code_and_nobody_after() {
    let mut auth = Auth::new(Kept::default());
    assert!(auth.needs_first_user());
    assert!(matches!(log_in(&mut auth, "", "", NOW), Err(Refused::WrongPassword)));
    assert_eq!(auth.check_setup("").unwrap_err(), CodeError::Closed);
    let code = auth.open_setup().unwrap().unwrap();
    assert!(matches!(auth.check_setup("0000"), Err(CodeError::Wrong { tries_left: 9 })));
    let pass = auth.check_setup(code.reveal()).unwrap();
    let second = auth.check_setup(code.reveal()).unwrap();
    let login = auth.finish_setup(pass, name("anna"), PasswordHash::quick("password"), NOW).unwrap();
    login.who.require_confirmed(Scope::Admin, NOW).unwrap();
    assert!(cookie(&mut auth, &login.token, NOW).is_some() && auth.take_change().is_some());
    let late = auth.finish_setup(second, name("eve"), PasswordHash::quick("password"), NOW);
    assert!(matches!(late, Err(SetupError::Code(CodeError::Closed))));
    assert_eq!(auth.check_setup(code.reveal()).unwrap_err(), CodeError::Closed);
    assert!(auth.open_setup().unwrap().is_none() && auth.users().count() == 1);
}

#[test]
fn an_application_gets_its_key_once() {
    let mut auth = auth();
    let (request, token) = auth.ask_key(home(), "Cura", None, NOW).unwrap();
    assert!(matches!(auth.poll_key(token.reveal(), NOW), Ok(AppAnswer::Pending)));
    assert_eq!(auth.key_requests(NOW).count(), 1);
    auth.answer_key_request(&request.id, Some(Role::Operator.scopes()), "Anna", NOW).unwrap();
    assert_eq!((auth.keys().count(), auth.take_change().is_some()), (0, false), "made before it is fetched");
    let Ok(AppAnswer::Key(key)) = auth.poll_key(token.reveal(), NOW) else { panic!("no key") };
    assert!(matches!(auth.poll_key(token.reveal(), NOW), Ok(AppAnswer::Gone)));
    assert!(auth.take_change().is_some());
    assert_eq!(auth.by_key(key.reveal(), home(), NOW, 0).unwrap().scopes, Role::Operator.scopes());
    let (request, token) = auth.ask_key(home(), "Cura", None, NOW).unwrap();
    auth.answer_key_request(&request.id, None, "Anna", NOW).unwrap();
    assert!(matches!(auth.poll_key(token.reveal(), NOW), Ok(AppAnswer::Gone)));
}

#[test]
fn what_is_kept_lets_the_same_ones_in() {
    let mut auth = auth();
    let (_, key) = auth.make_key(name("cura"), Role::Viewer.scopes(), "Anna", NOW).unwrap();
    auth.take_change().unwrap();
    auth.change_not_kept();
    let text = auth.take_change().unwrap().to_json().unwrap();
    for secret in [key.reveal(), "\"password\": \"password\"", KEY_PREFIX] {
        assert!(!text.contains(secret), "{text}");
    }
    let mut later = Auth::new(Kept::from_json(&text).unwrap());
    log_in(&mut later, "anna", "password", NOW).unwrap();
    later.by_key(key.reveal(), home(), NOW, 0).unwrap();
    let shown = format!("{later:?}");
    assert!(!shown.contains("argon2id") && !shown.contains(KEY_PREFIX), "{shown}");
}

#[test]
fn every_request_is_counted() {
    let mut auth = auth();
    let passed = (0..1000).filter(|_| auth.admit(home(), 0).is_ok()).count();
    assert_eq!(passed, 600);
    auth.admit(home(), 1000).unwrap();
}
