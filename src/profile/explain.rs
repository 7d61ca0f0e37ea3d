//! Prints a profile as TOML with the documentation of each key above it.
//!
//! Takes a valid profile, gives text that loads as the same profile.
use super::keys::{self, Key, Takes};
use super::{Any, check, material::MaterialKind, printer::Kind};
use std::fmt::Write;
use toml::Value;

/// The whole profile, every key explained.
///
/// # Errors
/// None of ours: only what serialising to TOML itself reports.
pub fn explain(profile: &Any) -> Result<String, toml::ser::Error> {
    let (value, table) = match profile {
        Any::Printer(p) => match p.kind {
            Kind::Fdm(_) => (Value::try_from(p.as_ref())?, keys::fdm()),
            Kind::Msla(_) => (Value::try_from(p.as_ref())?, keys::msla()),
        },
        Any::Material(m) => match m.kind {
            MaterialKind::Filament(_) => (Value::try_from(m)?, keys::filament()),
            MaterialKind::Resin => (Value::try_from(m)?, keys::MATERIAL.to_vec()),
        },
    };
    let mut out = String::new();
    for key in &table {
        match (lookup(&value, key.path), key.takes) {
            (Some(Value::Array(list)), Takes::Tables(_)) => write_tables(&mut out, key, list, &table),
            (Some(found), _) => write_key(&mut out, key, found),
            (None, _) => {}
        }
    }
    Ok(out)
}

fn lookup<'v>(value: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').try_fold(value, |v, word| v.get(word))
}

/// `[[key]]`, once for each of the list.
fn write_tables(out: &mut String, key: &Key, list: &[Value], keys: &[Key]) {
    for one in list {
        // Writing to a String cannot fail.
        let _ = write!(out, "\n# {}\n[[{}]]\n", key.doc, key.path);
        for child in keys.iter().filter(|child| check::parent(child.path) == key.path) {
            if let Some(found) = one.get(check::last(child.path)) {
                write_key(out, child, found);
            }
        }
    }
}

/// Tables at the root become `[table]`; deeper ones become dotted keys, so
/// that every value keeps a line of its own for its comment.
fn write_key(out: &mut String, key: &Key, value: &Value) {
    let root = check::parent(key.path).is_empty();
    let table = matches!(key.takes, Takes::Table | Takes::Choice);
    // Writing to a String cannot fail.
    let _ = match (table, root) {
        (true, true) => write!(out, "\n# {}\n[{}]\n", key.doc, key.path),
        (true, false) => writeln!(out, "# {}:", key.doc),
        (false, _) => {
            let name =
                if root { key.path } else { key.path.split_once('.').map_or(key.path, |(_, rest)| rest) };
            let text = match value {
                Value::String(s) if s.contains('\n') && !s.contains("'''") => {
                    format!("'''\n{s}'''")
                }
                other => other.to_string(),
            };
            writeln!(out, "# {}\n{name} = {text}", key.doc)
        }
    };
}
