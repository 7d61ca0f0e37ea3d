//! Data in a page: the page's sources with what they show in their midst.
//!
//! Takes templates and bytes, gives text. Knows nothing of what is shown.
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;
use std::io::Write;

/// Appends a varint.
pub(super) fn put(out: &mut Vec<u8>, mut value: u64) {
    while value > 0x7f {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

/// Appends a varint of zigzag.
pub(super) fn put_signed(out: &mut Vec<u8>, value: i64) {
    put(out, ((value << 1) ^ (value >> 63)) as u64);
}

/// The page with its marks, which stand in this order, replaced. What is put in is
/// not looked at again: a file named like a mark does no harm.
pub(super) fn filled(page: &str, marks: &[(&str, &str)]) -> String {
    let mut out = String::with_capacity(page.len() + marks.iter().map(|m| m.1.len()).sum::<usize>());
    let mut rest = page;
    for (mark, text) in marks {
        let (before, after) = rest.split_once(mark).unwrap_or((rest, ""));
        out.push_str(before);
        out.push_str(text);
        rest = after;
    }
    out.push_str(rest);
    out
}

/// JSON that ends no script element: `<` is written as an escape.
pub(super) fn json(data: &impl Serialize) -> std::io::Result<String> {
    Ok(serde_json::to_string(data)?.replace('<', "\\u003c"))
}

/// A zlib stream.
pub(super) fn deflated(bytes: &[u8]) -> std::io::Result<Vec<u8>> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes)?;
    encoder.finish()
}

/// RFC 4648, section 4.
pub(super) fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let byte = |k: usize| u32::from(three.get(k).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for k in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * k) & 63) as usize];
            out.push(if k <= three.len() { char::from(letter) } else { '=' });
        }
    }
    out
}

/// What tests read a page by; nothing here is the writer's way.
#[cfg(test)]
pub(super) mod testing {
    use std::io::Read;

    /// What stands between the tags of an element with an id.
    pub(in crate::report) fn inside<'a>(page: &'a str, id: &str) -> &'a str {
        let from = page.find(&format!("id=\"{id}\">")).expect("the element") + id.len() + 6;
        page[from..].split("</script>").next().expect("its end")
    }

    /// A page is whole and needs nothing from outside: no mark is left in it, and as many scripts
    /// as were put in, besides so many elements of data.
    #[track_caller]
    pub(in crate::report) fn is_whole_and_alone(page: &str, marks: &[&str], data: usize, scripts: usize) {
        for mark in marks {
            assert!(!page.contains(mark), "{mark}");
        }
        for outside in ["http:", "https:", "src=", "href=", "@import", "url("] {
            assert!(!page.contains(outside), "{outside}");
        }
        assert_eq!(page.matches("<script").count(), data + scripts);
        assert_eq!(page.matches("</script>").count(), data + scripts);
        assert!(page.trim_end().ends_with("</html>"));
    }

    /// The bytes of a base64 text, inflated.
    pub(in crate::report) fn unpacked(text: &str) -> Vec<u8> {
        let bytes: Vec<u8> = text.bytes().filter(|&b| b != b'=').collect();
        // Read by bits, not by the writer's way.
        let value = |b: u8| match b {
            b'A'..=b'Z' => b - b'A',
            b'a'..=b'z' => b - b'a' + 26,
            b'0'..=b'9' => b - b'0' + 52,
            b'+' => 62,
            _ => 63,
        };
        let bits: Vec<u8> =
            bytes.iter().flat_map(|&b| (0..6).rev().map(move |k| value(b) >> k & 1)).collect();
        let raw: Vec<u8> = bits.chunks_exact(8).map(|c| c.iter().fold(0, |v, b| v << 1 | b)).collect();
        let mut plain = Vec::new();
        flate2::read::ZlibDecoder::new(raw.as_slice()).read_to_end(&mut plain).expect("deflated");
        plain
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_as_in_the_standard() {
        let check = |text: &str, expect: &str| assert_eq!(base64(text.as_bytes()), expect);
        check("", "");
        check("f", "Zg==");
        check("fo", "Zm8=");
        check("foo", "Zm9v");
        check("foob", "Zm9vYg==");
        check("foobar", "Zm9vYmFy");
        assert_eq!(base64(&[0xff, 0xff, 0xfe]), "///+");
    }
}
