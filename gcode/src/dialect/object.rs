//! Objects, labelled in every dialect alike: `; printing object`, `M486`, Klipper's `EXCLUDE_OBJECT_…`.
use crate::line::{Command, Line, key_value};

/// Where one object's lines begin or end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectMark<'a> {
    /// This object's lines follow.
    Begin(&'a [u8]),
    /// They end.
    End,
    /// Says something of objects, and begins or ends none.
    Define,
}

/// The object mark of a line, of whatever dialect.
#[must_use]
pub fn object<'a>(line: &Line<'a>) -> Option<ObjectMark<'a>> {
    match line.command {
        Command::None => comment(line.comment),
        Command::Classic { letter: b'M', number: 486, .. } => Some(m486(line.text())),
        Command::Named(name) => klipper(name, line.args),
        _ => None,
    }
}

fn comment(comment: &[u8]) -> Option<ObjectMark<'_>> {
    if comment.len() < 10 {
        return None;
    }
    if let Some(name) = comment.strip_prefix(b"; printing object ") {
        return Some(ObjectMark::Begin(name.trim_ascii()));
    }
    if comment.starts_with(b"; stop printing object") {
        return Some(ObjectMark::End);
    }
    // SuperSlicer's list of objects, beside each mark.
    comment.starts_with(b"; INIT ").then_some(ObjectMark::Define)
}

/// `S3` begins object 3, `S-1` ends, `T4` and `A name` define.
fn m486(text: &[u8]) -> ObjectMark<'_> {
    match text {
        [b'S' | b's', b'-', ..] => ObjectMark::End,
        [b'S' | b's', id @ ..] => ObjectMark::Begin(id.trim_ascii()),
        _ => ObjectMark::Define,
    }
}

fn klipper<'a>(name: &[u8], args: &'a [u8]) -> Option<ObjectMark<'a>> {
    match name {
        b"EXCLUDE_OBJECT_START" => {
            let name = key_value(args).ok().filter(|(_, (key, _))| *key == b"NAME").map(|(_, (_, v))| v);
            Some(ObjectMark::Begin(name.unwrap_or(args.trim_ascii())))
        }
        b"EXCLUDE_OBJECT_END" => Some(ObjectMark::End),
        b"EXCLUDE_OBJECT_DEFINE" => Some(ObjectMark::Define),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::line::parse;

    #[test]
    fn marks() {
        let check = |line: &str, expect: Option<ObjectMark<'_>>| {
            assert_eq!(object(&parse(line.as_bytes())), expect, "{line}");
        };
        check("; printing object cube id:0 copy 0", Some(ObjectMark::Begin(b"cube id:0 copy 0")));
        check("; stop printing object cube id:0 copy 0", Some(ObjectMark::End));
        check("M486 S2", Some(ObjectMark::Begin(b"2")));
        check("M486 S-1", Some(ObjectMark::End));
        check("M486 Apart S.stl", Some(ObjectMark::Define));
        check("EXCLUDE_OBJECT_START NAME=part_0", Some(ObjectMark::Begin(b"part_0")));
        check("EXCLUDE_OBJECT_END NAME=part_0", Some(ObjectMark::End));
        check("EXCLUDE_OBJECT_DEFINE NAME=a CENTER=1,2", Some(ObjectMark::Define));
        check("G1 X1 ; printing object", None);
    }
}
