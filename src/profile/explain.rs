//! Prints a profile as TOML with the documentation of each key above it.
//!
//! Takes a valid profile, gives text that loads as the same profile.
use super::keys::{self, Key, Takes};
use super::{Any, check, material::MaterialKind};
use std::fmt::Write;
use toml::Value;

/// The whole profile, every key explained.
///
/// # Errors
/// None of ours: only what serialising to TOML itself reports.
pub fn explain(profile: &Any) -> Result<String, toml::ser::Error> {
    let (value, table) = match profile {
        Any::Printer(p) => (Value::try_from(p.as_ref())?, keys::PRINTER.to_vec()),
        Any::Material(m) => match m.kind {
            MaterialKind::Filament(_) => (Value::try_from(m)?, keys::filament()),
            MaterialKind::Resin => (Value::try_from(m)?, keys::MATERIAL.to_vec()),
        },
    };
    let mut out = String::new();
    for key in &table {
        if let Some(found) = lookup(&value, key.path) {
            write_key(&mut out, key, found);
        }
    }
    Ok(out)
}

fn lookup<'v>(value: &'v Value, path: &str) -> Option<&'v Value> {
    path.split('.').try_fold(value, |v, word| v.get(word))
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
