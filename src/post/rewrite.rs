//! A line with some of its numbers changed, the rest as it was.
use outrigger_gcode::line::Line;
use outrigger_gcode::number::{Format, write_decimal};

/// What becomes of a word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Change {
    /// This value, put in where the line lacks the letter.
    Set(f64, Format),
    /// Left out.
    Drop,
}

/// Where the slicer would put a letter: F first in Cura's lines is kept where it stands.
const ORDER: &[u8] = b"XYZIJREF";

/// Appends the line with `head` for its command and the words changed; its
/// comment and line ending stay, its indent goes. Words are parted by one blank.
pub(super) fn rewrite(line: &Line<'_>, head: &[u8], changes: &[(u8, Change)], out: &mut Vec<u8>) {
    out.extend_from_slice(head);
    let mut missing: Vec<(u8, f64, Format)> = changes
        .iter()
        .filter(|(letter, _)| !line.words.has(*letter))
        .filter_map(|&(letter, change)| match change {
            Change::Set(value, format) => Some((letter, value, format)),
            Change::Drop => None,
        })
        .collect();
    let rank = |letter: u8| ORDER.iter().position(|&l| l == letter).unwrap_or(ORDER.len());
    missing.sort_by_key(|m| rank(m.0));
    let mut missing = missing.into_iter().peekable();
    for word in line.words.as_slice() {
        // A leading F stays in front; everything else keeps the usual order.
        while let Some(&(letter, value, format)) = missing.peek()
            && word.letter != b'F'
            && rank(letter) < rank(word.letter)
        {
            push(out, letter, value, format);
            missing.next();
        }
        match changes.iter().find(|(letter, _)| *letter == word.letter) {
            Some((_, Change::Drop)) => {}
            Some(&(letter, Change::Set(value, format))) => push(out, letter, value, format),
            None => {
                out.push(b' ');
                out.push(word.letter);
                out.extend_from_slice(line.written(word));
            }
        }
    }
    for (letter, value, format) in missing {
        push(out, letter, value, format);
    }
    if !line.comment.is_empty() {
        out.push(b' ');
        out.extend_from_slice(line.comment);
    }
    out.extend_from_slice(if line.ending.is_empty() { b"\n" } else { line.ending });
}

fn push(out: &mut Vec<u8>, letter: u8, value: f64, format: Format) {
    out.push(b' ');
    out.push(letter);
    write_decimal(out, value, format);
}

#[cfg(test)]
mod tests {
    use super::*;
    use outrigger_gcode::line::parse;

    const MM: Format = Format { decimals: 3, bare_point: true };

    #[test]
    fn rewrites() {
        let check = |input: &str, head: &str, changes: &[(u8, Change)], expect: &str| {
            let mut out = Vec::new();
            rewrite(&parse(input.as_bytes()), head.as_bytes(), changes, &mut out);
            assert_eq!(String::from_utf8_lossy(&out), expect, "{input}");
        };
        let x = (b'X', Change::Set(1.5, MM));
        let y = (b'Y', Change::Set(0.25, MM));
        check("G1 X9 Y9.000 E.5 ; infill\n", "G1", &[x, y], "G1 X1.5 Y.25 E.5 ; infill\n");
        check("G1 X9 E.5\n", "G1", &[x, y], "G1 X1.5 Y.25 E.5\n");
        check("G1 Y9 F600\r\n", "G1", &[x, y], "G1 X1.5 Y.25 F600\r\n");
        check(
            "G1 F3000 X9 Y9 E7\n",
            "G1",
            &[(b'F', Change::Drop), (b'E', Change::Set(8.0, MM))],
            "G1 X9 Y9 E8\n",
        );
        check("G0 F9000 X9 Y9 Z3\n", "G0", &[(b'Z', Change::Drop), x, y], "G0 F9000 X1.5 Y.25\n");
        check("G1 F9000\n", "G1", &[x, y], "G1 F9000 X1.5 Y.25\n");
        check("G2 X1 Y1 I2 J2 E1", "G3", &[(b'I', Change::Set(-2.0, MM))], "G3 X1 Y1 I-2 J2 E1\n");
        check("G1 X9 E.5\n", "G1", &[(b'F', Change::Set(600.0, MM))], "G1 X9 E.5 F600\n");
    }
}
