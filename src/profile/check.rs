//! Walks a profile's TOML along the table of its keys.
//!
//! Takes text and the keys; gives the first fault with its line, or nothing.
//! What passes here has every required key, no other key, the right types and
//! numbers in range. Knows no file system and no struct.
use super::keys::{Key, TEXT_BYTES_MAX, Takes};
use super::{Fault, Located};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// How far off a name may be (edits, transpositions counted as one) and still
/// be offered as the right one: past a third of its letters it is another
/// word, unless the one is a part of the other (`mk3s`, `baudrate`).
fn close_enough(written: &str, right: &str) -> bool {
    let part = written.len() >= 3 && right.contains(written) || right.len() >= 3 && written.contains(right);
    part || strsim::osa_distance(written, right) <= written.chars().count().max(3) / 3
}

/// The nearest of some names, if any is near at all.
pub(crate) fn nearest<'a>(written: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    names.filter(|name| close_enough(written, name)).min_by_key(|name| strsim::osa_distance(written, name))
}

/// The line, from 1, on which a byte of the text stands.
pub(crate) fn line_of(text: &str, offset: usize) -> usize {
    let before = text.as_bytes().get(..offset).unwrap_or(text.as_bytes());
    1 + before.iter().filter(|&&b| b == b'\n').count()
}

/// The line, from 1, on which a key stands, or the nearest table around it that the text has.
pub(crate) fn line_of_key(text: &str, path: &str) -> usize {
    let Ok(root) = DeTable::parse(text) else { return 1 };
    let (mut table, mut line) = (root.get_ref(), 1);
    for word in path.split('.') {
        let Some((name, value)) = table.iter().find(|(name, _)| name.get_ref() == word) else { break };
        line = line_of(text, name.span().start);
        let DeValue::Table(within) = value.get_ref() else { break };
        table = within;
    }
    line
}

/// Reports a fault of TOML itself.
pub(crate) fn syntax(text: &str, error: &toml::de::Error) -> Located {
    Located {
        line: error.span().map_or(1, |span| line_of(text, span.start)),
        fault: Fault::Syntax { message: error.message().to_owned() },
    }
}

/// Checks a whole file.
///
/// # Errors
/// The first fault, in the order of the file; missing keys come last.
pub(crate) fn check(text: &str, keys: &[Key]) -> Result<(), Located> {
    let root = DeTable::parse(text).map_err(|e| syntax(text, &e))?;
    Walk { text, keys }.table("", &root)
}

struct Walk<'a> {
    text: &'a str,
    keys: &'a [Key],
}

impl Walk<'_> {
    fn at(&self, offset: usize, fault: Fault) -> Located {
        Located { line: line_of(self.text, offset), fault }
    }

    fn table(&self, prefix: &str, table: &Spanned<DeTable<'_>>) -> Result<(), Located> {
        for (name, value) in table.get_ref() {
            let path = join(prefix, name.get_ref());
            match self.keys.iter().find(|key| key.path == path) {
                Some(key) => self.value(key, value)?,
                None => {
                    return Err(self.at(name.span().start, self.unknown(prefix, name.get_ref())));
                }
            }
        }
        for key in self.children(prefix).filter(|key| key.required) {
            let name = last(key.path);
            if !table.get_ref().contains_key(name) {
                return Err(
                    self.at(table.span().start, Fault::Missing { key: key.path.to_owned(), doc: key.doc })
                );
            }
        }
        Ok(())
    }

    fn children<'k>(&'k self, prefix: &'k str) -> impl Iterator<Item = &'k Key> {
        self.keys.iter().filter(move |key| parent(key.path) == prefix)
    }

    /// Looks among the table's own keys first, then for the same word elsewhere.
    fn unknown(&self, prefix: &str, name: &str) -> Fault {
        let here = nearest(name, self.children(prefix).map(|key| last(key.path)));
        let offer = match here {
            Some(near) => Some(join(prefix, near)),
            None => nearest(name, self.keys.iter().map(|key| last(key.path)))
                .and_then(|near| self.keys.iter().find(|key| last(key.path) == near))
                .map(|key| key.path.to_owned()),
        };
        Fault::UnknownKey { key: join(prefix, name), nearest: offer }
    }

    fn value(&self, key: &Key, value: &Spanned<DeValue<'_>>) -> Result<(), Located> {
        let wrong = |message: String| {
            Err(self.at(value.span().start, Fault::Value { key: key.path.to_owned(), message }))
        };
        match (&key.takes, value.get_ref()) {
            (Takes::Table | Takes::Choice, DeValue::Table(table)) => {
                let within = Spanned::new(value.span(), table.clone());
                self.table(key.path, &within)?;
                if matches!(key.takes, Takes::Choice) && table.len() != 1 {
                    let names: Vec<_> = self.children(key.path).map(|k| last(k.path)).collect();
                    return wrong(format!("must have exactly one of {}", names.join(", ")));
                }
                Ok(())
            }
            (Takes::Text, DeValue::String(s)) => line(s, TEXT_BYTES_MAX).or_else(wrong),
            (Takes::Line(max), DeValue::String(s)) => line(s, *max).or_else(wrong),
            (Takes::Texts(max), DeValue::Array(list)) => {
                if list.len() > *max {
                    return wrong(format!("takes {max} at most, but has {}", list.len()));
                }
                for item in list.iter() {
                    let text = match item.get_ref() {
                        DeValue::String(s) => line(s, TEXT_BYTES_MAX),
                        other => Err(format!("takes texts, but has {}", other.type_str())),
                    };
                    text.or_else(wrong)?;
                }
                Ok(())
            }
            (Takes::Tables(max), DeValue::Array(list)) => {
                if list.len() > *max {
                    return wrong(format!("takes {max} at most, but has {}", list.len()));
                }
                for item in list.iter() {
                    match item.get_ref() {
                        DeValue::Table(table) => {
                            self.table(key.path, &Spanned::new(item.span(), table.clone()))?;
                        }
                        other => return wrong(format!("takes tables, but has {}", other.type_str())),
                    }
                }
                Ok(())
            }
            (Takes::Macro, DeValue::String(_)) | (Takes::Flag, DeValue::Boolean(_)) => Ok(()),
            (Takes::OneOf(words), DeValue::String(s)) => {
                if words.contains(&s.as_ref()) {
                    return Ok(());
                }
                let hint = nearest(s, words.iter().copied())
                    .map(|near| format!("; did you mean {near:?}?"))
                    .unwrap_or_default();
                wrong(format!("is {s:?}, but takes {}{hint}", words.join(", ")))
            }
            (Takes::Whole(min, max), DeValue::Integer(n)) => {
                match i64::from_str_radix(n.as_str(), n.radix()) {
                    Ok(n) if (*min..=*max).contains(&n) => Ok(()),
                    _ => wrong(format!("is {}, outside {min} to {max}", n.as_str())),
                }
            }
            (Takes::Number(min, max), DeValue::Integer(_) | DeValue::Float(_)) => {
                match number(value.get_ref()) {
                    Some(n) if (*min..=*max).contains(&n) => Ok(()),
                    n => wrong(format!("is {}, outside {min} to {max}", n.unwrap_or(f64::NAN))),
                }
            }
            (Takes::Macro, DeValue::Table(table)) => {
                let named = table.len() == 1
                    && table.get("file").is_some_and(|v| matches!(v.get_ref(), DeValue::String(_)));
                if named {
                    Ok(())
                } else {
                    wrong("takes G-code in quotes, or { file = \"NAME\" }".to_owned())
                }
            }
            (takes, found) => wrong(format!("takes {}, but is {}", wanted(takes), found.type_str())),
        }
    }
}

/// One line of text.
fn line(text: &str, max_bytes: usize) -> Result<(), String> {
    if text.is_empty() || text.len() > max_bytes {
        return Err(format!("must have 1 to {max_bytes} bytes"));
    }
    match text.chars().any(char::is_control) {
        true => Err("must not have control characters".to_owned()),
        false => Ok(()),
    }
}

fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(n) => i64::from_str_radix(n.as_str(), n.radix()).ok().map(|n| n as f64),
        DeValue::Float(f) => f.as_str().parse().ok(),
        _ => None,
    }
}

fn wanted(takes: &Takes) -> &'static str {
    match takes {
        Takes::Text | Takes::Line(_) => "text",
        Takes::Texts(_) => "a list of texts",
        Takes::Tables(_) => "a list of tables: [[…]]",
        Takes::OneOf(_) => "one of some words",
        Takes::Number(..) => "a number",
        Takes::Whole(..) => "a whole number",
        Takes::Flag => "true or false",
        Takes::Table | Takes::Choice => "a table",
        Takes::Macro => "G-code in quotes",
    }
}

fn join(prefix: &str, name: &str) -> String {
    if prefix.is_empty() { name.to_owned() } else { format!("{prefix}.{name}") }
}

/// The last word of a path.
pub(crate) fn last(path: &str) -> &str {
    path.rsplit('.').next().unwrap_or(path)
}

/// The path without its last word.
pub(crate) fn parent(path: &str) -> &str {
    path.rsplit_once('.').map_or("", |(before, _)| before)
}

#[cfg(test)]
mod tests {
    use super::*;

    const KEYS: &[Key] = &[
        Key { path: "name", takes: Takes::Text, required: true, doc: "Name" },
        Key { path: "kind", takes: Takes::OneOf(&["fdm", "resin"]), required: false, doc: "" },
        Key { path: "serial", takes: Takes::Table, required: false, doc: "" },
        Key { path: "serial.baud", takes: Takes::Whole(1, 10), required: true, doc: "Speed" },
        Key { path: "serial.dtr", takes: Takes::Flag, required: false, doc: "" },
        Key { path: "serial.window", takes: Takes::Choice, required: false, doc: "" },
        Key { path: "serial.window.bytes", takes: Takes::Whole(1, 9), required: false, doc: "" },
        Key { path: "serial.window.lines", takes: Takes::Whole(1, 9), required: false, doc: "" },
        Key { path: "size_mm", takes: Takes::Number(0.5, 2.0), required: false, doc: "" },
        Key { path: "cancel", takes: Takes::Macro, required: false, doc: "" },
        Key { path: "listen", takes: Takes::Texts(2), required: false, doc: "" },
        Key { path: "printer", takes: Takes::Tables(2), required: false, doc: "" },
        Key { path: "printer.id", takes: Takes::Line(4), required: true, doc: "Short name" },
    ];

    /// `expect`: the line and a part of what is said; line 0 is "no fault".
    fn check(text: &str, line: usize, part: &str) {
        match super::check(text, KEYS) {
            Ok(()) => assert_eq!(line, 0, "{text:?} passed"),
            Err(found) => {
                assert_eq!(found.line, line, "{text:?}: {found:?}");
                let said = found.fault.to_string();
                assert!(said.contains(part), "{text:?}: {said}");
            }
        }
    }

    #[test]
    fn each_fault_is_named_with_its_line() {
        check("name='a'", 0, "");
        check("name='a'\nsize_mm=1", 0, "");
        check("name='a'\nsize_mm=0.5\nkind='fdm'", 0, "");
        check("name='a'\n\nnmae='b'", 3, "did you mean name?");
        check(
            "name='a'\n[serial]\nbaudrate=5\nbaud=5",
            3,
            "unknown key serial.baudrate; did you mean serial.baud?",
        );
        check("name='a'\n[serial]\nboud=5", 3, "did you mean serial.baud?");
        check("name='a'\nbaud=5", 2, "did you mean serial.baud?");
        check("name='a'\nzzzzzz=5", 2, "unknown key zzzzzz");
        check("kind='fdm'", 1, "name is missing (Name)");
        check("name='a'\n[serial]\ndtr=true", 2, "serial.baud is missing");
        check("name=''", 1, "1 to 80 bytes");
        check("name=\"a\\u0007\"", 1, "control");
        check("name=5", 1, "takes text, but is integer");
        check("name='a'\nkind='fmd'", 2, "did you mean \"fdm\"?");
        check("name='a'\nsize_mm=2.5", 2, "is 2.5, outside 0.5 to 2");
        check("name='a'\nsize_mm=nan", 2, "outside");
        check("name='a'\nsize_mm=0x1", 0, "");
        check("name='a'\n[serial]\nbaud=11", 3, "is 11, outside 1 to 10");
        check("name='a'\n[serial]\nbaud=99999999999999999999", 3, "");
        check("name='a'\n[serial]\nbaud=1.5", 3, "a whole number");
        check("name='a'\nserial.baud=1\nserial.window={}", 3, "exactly one of bytes, lines");
        check("name='a'\nserial.baud=1\nserial.window={bytes=1,lines=1}", 3, "exactly one");
        check("name='a'\nserial.baud=1\nserial.window={lines=1}", 0, "");
        check("name='a'\ncancel='M107'", 0, "");
        check("name='a'\ncancel={file='x'}", 0, "");
        check("name='a'\ncancel={fil='x'}", 2, "file = \"NAME\"");
        check("name='a'\nlisten=['a','b']", 0, "");
        check("name='a'\nlisten=['a','b','c']", 2, "2 at most");
        check("name='a'\nlisten=['']", 2, "1 to 80 bytes");
        check("name='a'\nlisten=[1]", 2, "takes texts");
        check("name='a'\nlisten='a'", 2, "a list of texts");
        check("name='a'\n[[printer]]\nid='a'\n[[printer]]\nid='b'", 0, "");
        check("name='a'\n[[printer]]\nid='abcde'", 3, "1 to 4 bytes");
        check("name='a'\n[[printer]]\nid='a'\nidd=1", 4, "unknown key printer.idd; did you mean printer.id?");
        check("name='a'\n[[printer]]\n", 2, "printer.id is missing");
        check("name='a'\nprinter=[1]", 2, "takes tables");
        check("name='a'\nname='b'", 2, "duplicate");
        check("name='a'\n?", 2, "");
        check("", 1, "name is missing");
    }

    proptest::proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "\\PC{0,60}|([a-z.=\\[\\]{}'0-9\n]{0,60})") {
            let _ = super::check(&text, KEYS);
        }
    }
}
