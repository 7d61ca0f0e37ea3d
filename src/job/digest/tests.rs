use super::*;
use crate::printer::job_file::{Reader, check};
use crate::printer::source::Source;
use proptest::prelude::*;

fn sums(bytes: &[u8]) -> Sums {
    Scan::new(bytes, bytes.len() as u64).unwrap().finish().unwrap()
}

fn read_back(now: &[u8], sums: Sums) -> (Vec<u8>, Option<String>) {
    let mut got = Vec::new();
    let error = Verified::new(now, sums).read_to_end(&mut got).err();
    (got, error.map(|e| e.to_string()))
}

fn hex(digest: &[u8]) -> String {
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn a_digest_is_the_usual_one() {
    let check = |bytes: &[u8], expect: &str| assert_eq!(hex(&sums(bytes).digest), expect);
    check(b"", "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
    check(b"abc", "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    check(&[b'a'; 1_000_000], "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

#[test]
fn chunks_are_bounded() {
    let check = |bytes: u64, expect: Option<u32>| assert_eq!(chunk_bytes(bytes), expect, "{bytes}");
    check(0, Some(65_536));
    check(256 << 20, Some(65_536));
    check((256 << 20) + 1, Some(131_072));
    check(4 << 30, Some(1 << 20));
    check(64 << 30, Some(MAX_CHUNK_BYTES));
    check((64 << 30) + 1, None);
    check(u64::MAX, None);
}

#[test]
fn a_file_that_grows_or_shrinks_while_it_is_summed_is_told() {
    let check = |bytes: &[u8], said: u64| {
        let error = Scan::new(bytes, said).unwrap().finish().unwrap_err().to_string();
        assert!(error.contains("changed while it was checked"), "{error}");
    };
    check(b"12345", 4);
    check(b"12345", 6);
    check(&[0; 200_000], 100_000);
}

/// A job of lines as long as each other, the chunk of a line, and what a printer gets
/// of a file that changed.
fn printed(was: &[u8], now: &[u8]) -> (Vec<String>, Option<String>) {
    let mut scan = Scan::new(was, was.len() as u64).unwrap();
    let checked = check(&mut scan, Some(95), |_, _| {}).unwrap();
    let sums = scan.finish().unwrap();
    let accepted = Accepted {
        digest: sums.digest,
        bytes: sums.bytes,
        commands: checked.commands,
        last_line: checked.last_command,
        chunk_bytes: sums.chunk_bytes,
        chunks: sums.chunks,
        ..Accepted::default()
    };
    let mut reader = Reader::new(Verified::new(now, accepted.sums()), accepted.checked(), |_, _| {});
    let mut lines = Vec::new();
    loop {
        match reader.advance() {
            Ok(true) => lines.push(String::from_utf8_lossy(reader.line().command).into_owned()),
            Ok(false) => return (lines, None),
            Err(error) => return (lines, Some(error.reason)),
        }
    }
}

#[test]
fn a_file_that_changed_stops_before_the_first_changed_line() {
    let text: String = (0..20_000).map(|n| format!("G1 X{n:05} ; {}\n", n % 7)).collect();
    let was = text.as_bytes();
    let lines: Vec<String> = (0..20_000).map(|n| format!("G1 X{n:05}")).collect();
    let check = |now: &[u8], changed: Option<usize>| {
        let (got, error) = printed(was, now);
        assert!(lines.starts_with(&got), "no line but those of the job");
        let Some(line) = changed else {
            assert_eq!((got.len(), error), (lines.len(), None));
            return;
        };
        // No line that changed, and all of the chunks before.
        assert!(got.len() <= line, "{} lines, changed in {line}", got.len());
        assert!(got.len() + 65_536 / 14 + 1 >= line, "{} lines, changed in {line}", got.len());
        assert!(error.unwrap().contains("the file was changed since"));
    };
    check(was, None);
    // What was added behind is not the job's.
    check(&[was, b"M112\n"].concat(), None);
    for line in [0, 1, 4000, 4400, 12_345, 19_999] {
        let mut now = was.to_vec();
        now[line * 14 + 5] = b'9' - (now[line * 14 + 5] - b'0') / 2;
        if now != was {
            check(&now, Some(line));
        }
        check(&was[..line * 14 + 4], Some(line));
        check(&[&was[..line * 14], b"M104 S300\n", &was[line * 14..]].concat(), Some(line));
    }
    check(b"", Some(0));
    check(b"G28\n", Some(0));
}

/// Bytes of the container are looked at, below the decoder: a comment's change counts.
#[test]
fn binary_jobs_are_verified_too() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/gcode/corpus");
    let mut seen = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "bgcode") {
            continue;
        }
        seen += 1;
        let was = std::fs::read(&path).unwrap();
        let (lines, error) = printed(&was, &was);
        assert!(error.is_none() && lines.len() > 100, "{}", path.display());
        let mut now = was.clone();
        now[was.len() / 2] ^= 1;
        let (got, error) = printed(&was, &now);
        assert!(lines.starts_with(&got) && got.len() < lines.len(), "{}", path.display());
        assert!(error.unwrap().contains("the file was changed since"), "{}", path.display());
    }
    assert!(seen > 0, "the corpus has binary jobs");
}

/// Fails once in the midst, as a network drive does, then goes on elsewhere.
struct Shaky<'a>(&'a [u8], bool);

impl Read for Shaky<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.0.len() < 100_000 && !std::mem::replace(&mut self.1, true) {
            return Err(io::Error::other("the drive is gone"));
        }
        self.0.read(buffer)
    }
}

#[test]
fn nothing_is_given_out_after_an_error() {
    let bytes = [b'x'; 200_000];
    let mut reader = Verified::new(Shaky(&bytes, false), sums(&bytes));
    let mut got = Vec::new();
    assert!(reader.read_to_end(&mut got).unwrap_err().to_string().contains("drive"));
    assert_eq!(got.len(), 65_536);
    assert!(reader.read(&mut [0; 10]).is_err());
}

proptest! {
    // Sums of megabytes are slow without optimization.
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// However a file is read, its sums are the same, and it reads back as it was.
    #[test]
    fn a_file_reads_back(seed in any::<u8>(), len in 0..300_000usize, steps in prop::collection::vec(1..90_000usize, 1..8)) {
        let bytes: Vec<u8> = (0..len).map(|n| (n / 3) as u8 ^ seed).collect();
        let mut scan = Scan::new(&bytes[..], len as u64).unwrap();
        for step in &steps {
            let _ = scan.read(&mut vec![0; *step]).unwrap();
        }
        let scanned = scan.finish().unwrap();
        prop_assert_eq!(&scanned, &sums(&bytes));
        prop_assert_eq!(scanned.chunks.len(), len.div_ceil(65_536));
        prop_assert_eq!(read_back(&bytes, scanned), (bytes, None));
    }

    /// It reads the same wherever one begins, and as if it were plain bytes.
    #[test]
    fn a_file_reads_the_same_anywhere(
        len in 0..300_000usize,
        steps in prop::collection::vec((0..400_000u64, 0..90_000usize), 1..12),
    ) {
        let bytes: Vec<u8> = (0..len).map(|n| (n / 3) as u8).collect();
        let mut verified = Verified::new(std::io::Cursor::new(&bytes), sums(&bytes));
        let mut plain = std::io::Cursor::new(&bytes);
        for (to, want) in steps {
            let to = std::io::SeekFrom::Start(to);
            prop_assert_eq!(verified.seek(to).unwrap(), plain.seek(to).unwrap());
            let (mut got, mut expect) = (Vec::new(), Vec::new());
            (&mut verified).take(want as u64).read_to_end(&mut got).unwrap();
            (&mut plain).take(want as u64).read_to_end(&mut expect).unwrap();
            prop_assert!(got == expect, "{} bytes at {:?}", want, to);
        }
    }

    /// Of a file that changed no byte comes through from the first changed one on.
    #[test]
    fn no_changed_byte_comes_through(len in 1..300_000usize, at: prop::sample::Index, cut: bool) {
        let bytes: Vec<u8> = (0..len).map(|n| (n / 3) as u8).collect();
        let at = at.index(len);
        let mut now = bytes.clone();
        match cut {
            true => now.truncate(at),
            false => now[at] ^= 0x40,
        }
        let (got, error) = read_back(&now, sums(&bytes));
        prop_assert!(error.is_some());
        prop_assert!(got.len() <= at && got == bytes[..got.len()]);
        prop_assert_eq!(got.len(), at - at % 65_536);
    }
}
