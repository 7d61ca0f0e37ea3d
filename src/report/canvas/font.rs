//! Letters as lines, for pictures made where no font is installed.
//!
//! Takes words, gives the lines of a pen. Each glyph is drawn on a grid: the
//! baseline is at 2, small letters reach 6, capitals 8, tails 0. Letters with
//! marks are written without them; what is not here becomes a box.

/// Height of a capital on the grid.
const CAPITAL: f64 = 6.0;

/// Height of the baseline on the grid.
const BASELINE: f64 = 2.0;

/// Between one letter and the next, on the grid.
const SPACING: f64 = 1.9;

/// A capital's height, as a part of the font's size: as common fonts have it.
const CAPITAL_SHARE: f64 = 0.7;

/// Each glyph's lines: points as two digits (x, y), lines apart by a space, and its width.
#[rustfmt::skip]
const GLYPHS: &[(char, &str, f64)] = &[
    (' ', "", 1.0),
    ('A', "022842 1535", 4.0), ('B', "02083847463505 3544433202", 4.0), ('C', "4738180703123243", 4.0),
    ('D', "0208283746443322 02", 4.0), ('E', "48080242 0535", 4.0), ('F', "480802 0535", 4.0),
    ('G', "47381807031232434525", 4.0), ('H', "0802 4842 0545", 4.0), ('I', "0802", 0.0),
    ('J', "3833221203", 3.0), ('K', "0802 4804 2642", 4.0), ('L', "080242", 4.0),
    ('M', "0208254842", 4.0), ('N', "02084248", 4.0), ('O', "180703123243473818", 4.0),
    ('P', "02083847463505", 4.0), ('Q', "180703123243473818 2442", 4.0), ('R', "02083847463505 2542", 4.0),
    ('S', "473818070615354443321203", 4.0), ('T', "0848 2822", 4.0), ('U', "080312324348", 4.0),
    ('V', "082248", 4.0), ('W', "0812263248", 4.0), ('X', "0842 0248", 4.0),
    ('Y', "082548 2522", 4.0), ('Z', "08480242", 4.0),
    ('a', "3632 3526160503122233", 3.0), ('b', "0802 0516263533221203", 3.0), ('c', "3526160503122233", 3.0),
    ('d', "3832 3526160503122233", 3.0), ('e', "04343526160503122233", 3.0), ('f', "281712 0626", 2.0),
    ('g', "3631201001 3526160503122233", 3.0), ('h', "0802 0516263532", 3.0), ('i', "0602 08", 0.0),
    ('j', "161100 18", 1.0), ('k', "0802 3603 1432", 3.0), ('l', "080312", 1.0),
    ('m', "0602 05162522 25364542", 4.0), ('n', "0602 0516263532", 3.0), ('o', "160503122233352616", 3.0),
    ('p', "0600 0516263533221203", 3.0), ('q', "3630 3526160503122233", 3.0), ('r', "0602 051626", 2.0),
    ('s', "35261605142433221203", 3.0), ('t', "18132232 0626", 3.0), ('u', "0603122233 3632", 3.0),
    ('v', "062246", 4.0), ('w', "0612253246", 4.0), ('x', "0632 0236", 3.0),
    ('y', "0622 4610", 4.0), ('z', "06360232", 3.0),
    ('0', "180703122233372818", 3.0), ('1', "072822 1232", 3.0), ('2', "0718283736030232", 3.0),
    ('3', "07182837362515 253433221203", 3.0), ('4', "280434 2822", 3.0), ('5', "380805253433221203", 3.0),
    ('6', "372818070312223334251504", 3.0), ('7', "083812", 3.0),
    ('8', "180706152536372818 1504031222333425", 3.0), ('9', "031222333728180706152536", 3.0),
    ('.', "02", 0.0), (',', "1201", 1.0), (':', "02 05", 0.0), (';', "1201 15", 1.0), ('!', "0804 02", 0.0),
    ('?', "071828373625 1413 12", 3.0), ('-', "0535", 3.0), ('–', "0545", 4.0), ('_', "0141", 4.0),
    ('+', "0545 2327", 4.0), ('=', "0444 0646", 4.0), ('%', "0248 0817 4233", 4.0), ('/', "0148", 4.0),
    ('(', "18060412", 1.0), (')', "08161402", 1.0), ('[', "18080212", 1.0), (']', "08181202", 1.0),
    ('×', "0337 0733", 3.0), ('·', "05", 0.0), ('²', "0817160414", 1.0), ('°', "0817070818", 1.0),
    ('\'', "0807", 0.0), ('"', "0807 1817", 1.0), ('#', "0343 0747 1208 3228", 4.0), ('&', "420718270403122244", 4.0),
    ('@', "362624344447381807031242", 4.0), ('*', "0347 0743 2822", 4.0), ('~', "04152536", 3.0),
    ('<', "370533", 3.0), ('>', "073503", 3.0), ('…', "02 22 42", 4.0), ('→', "0545 375543", 5.0),
    ('≥', "083604 0333", 3.0),
];

/// What stands for a letter that is not here.
const BOX: (&str, f64) = ("0208383202", 3.0);

/// Letters with marks, and what they are written as.
const PLAIN: &[(&str, char)] = &[
    ("àáâãäåā", 'a'),
    ("èéêëēęě", 'e'),
    ("ìíîïī", 'i'),
    ("òóôõöøō", 'o'),
    ("ùúûüūů", 'u'),
    ("çćč", 'c'),
    ("ñńň", 'n'),
    ("śš", 's'),
    ("źžż", 'z'),
    ("ýÿ", 'y'),
    ("ł", 'l'),
    ("ÀÁÂÃÄÅ", 'A'),
    ("ÈÉÊË", 'E'),
    ("ÌÍÎÏ", 'I'),
    ("ÒÓÔÕÖØ", 'O'),
    ("ÙÚÛÜ", 'U'),
    ("ÇČ", 'C'),
    ("ÑŃ", 'N'),
    ("ŚŠ", 'S'),
    ("ŹŽŻ", 'Z'),
    ("−‐‑", '-'),
    ("’‘", '\''),
    ("„“”", '"'),
];

fn glyph(letter: char) -> (&'static str, f64) {
    let plain = PLAIN.iter().find(|(from, _)| from.contains(letter)).map_or(letter, |&(_, to)| to);
    GLYPHS.iter().find(|g| g.0 == plain).map_or(BOX, |&(_, lines, width)| (lines, width))
}

/// Width of words in px, in a font of this size.
pub(in super::super) fn width(words: &str, size: f64) -> f64 {
    let unit = size * CAPITAL_SHARE / CAPITAL;
    let letters: f64 = words.chars().map(|c| glyph(c).1 + SPACING).sum();
    (letters - SPACING).max(0.0) * unit
}

/// The pen's lines for words that begin at `at`, their baseline, px. A line of
/// one point is a dot.
pub(in super::super) fn lines(words: &str, at: [f64; 2], size: f64) -> Vec<Vec<[f64; 2]>> {
    let unit = size * CAPITAL_SHARE / CAPITAL;
    let mut x = at[0];
    let mut found = Vec::new();
    for letter in words.chars() {
        let (text, width) = glyph(letter);
        for line in text.split_ascii_whitespace() {
            let place = |pair: &[u8]| {
                let [px, py] = [pair[0], pair[1]].map(|digit| f64::from(digit - b'0'));
                [x + px * unit, at[1] - (py - BASELINE) * unit]
            };
            found.push(line.as_bytes().chunks_exact(2).map(place).collect());
        }
        x += (width + SPACING) * unit;
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_glyph_is_whole_and_inside_its_width() {
        for (letter, text, width) in GLYPHS {
            for line in text.split_ascii_whitespace() {
                assert!(line.len() % 2 == 0, "{letter}: {line}");
                for pair in line.as_bytes().chunks_exact(2) {
                    assert!(pair.iter().all(u8::is_ascii_digit), "{letter}: {line}");
                    assert!(f64::from(pair[0] - b'0') <= *width && pair[1] <= b'8', "{letter}: {line}");
                }
            }
        }
    }

    #[test]
    fn words_stand_on_their_baseline_and_are_as_wide_as_said() {
        // A capital is six steps high and 0.7 of the size: this size makes a step 1 px.
        let size = 60.0 / 7.0;
        assert_eq!(lines("L", [10.0, 20.0], size).len(), 1);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        let l = &lines("L", [10.0, 20.0], size)[0];
        assert!(near(l[0][0], 10.0) && near(l[0][1], 14.0) && near(l[2][0], 14.0) && near(l[2][1], 20.0));
        assert!(near(width("LL", size), 4.0 + SPACING + 4.0));
        assert!(near(width("", size), 0.0));
    }

    #[test]
    fn unknown_letters_are_boxes_and_marks_are_dropped() {
        assert_eq!(lines("é", [0.0; 2], 10.0), lines("e", [0.0; 2], 10.0));
        assert_eq!(lines("漢", [0.0; 2], 10.0).len(), 1);
        assert_eq!(lines("\u{1b}", [0.0; 2], 10.0)[0].len(), 5);
    }
}
