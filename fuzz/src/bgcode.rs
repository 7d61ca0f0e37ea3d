//! Binary G-code: no bytes make the reader panic, hang or take much memory, and
//! what the writer packs reads back.
//!
//! Takes the fuzzer's bytes as a file, as the blocks of a file without checksums
//! (where they are not stopped by a wrong one), and as text to be packed. Fails by
//! panic.
#![no_main]
use libfuzzer_sys::fuzz_target;
use outrigger_gcode::bgcode::{
    Checksum, Compression, Encoding, Packing, Reader, Writer, bare_text, file_header, survey, text,
};
use std::io::{BufRead, BufReader};

const COMPRESSIONS: [Compression; 4] =
    [Compression::None, Compression::Deflate, Compression::Heatshrink11, Compression::Heatshrink12];

fuzz_target!(|data: &[u8]| {
    read(data);
    read(&[&file_header(Checksum::None)[..], data].concat());
    if let Some((first, rest)) = data.split_first() {
        let encoding = match first & 3 {
            0 => Encoding::None,
            1 => Encoding::MeatPack,
            _ => Encoding::MeatPackComments,
        };
        let compression = COMPRESSIONS[usize::from(first >> 2 & 3)];
        let checksum = if first & 16 == 0 { Checksum::None } else { Checksum::Crc32 };
        write(rest, Packing { compression, encoding, checksum });
    }
});

/// As a file: the same text however it comes in, and a survey that agrees.
fn read(file: &[u8]) {
    let whole = all(bare_text(file));
    let pieces = all(bare_text(BufReader::with_capacity(3, file)));
    assert_eq!(whole, pieces);
    let _ = all(text(file));
    if !file.starts_with(b"GCDE") {
        assert_eq!(whole.expect("text is never damaged"), file);
        return;
    }
    let Ok(found) = survey(file) else { return };
    assert_eq!(found.bytes, file.len() as u64);
    assert!(found.gcode_from <= found.gcode_to && found.gcode_to <= found.bytes);
    let mut blocks = Reader::new(file).expect("surveyed");
    let mut raw = file_header(blocks.header().checksum).to_vec();
    while let Some(block) = blocks.next_block().expect("surveyed") {
        let _ = (block.data(), block.metadata());
        raw.extend_from_slice(block.raw());
    }
    assert_eq!(raw, file, "the blocks are not the file");
}

/// As text: what the writer says will be read back is, and packs to itself.
fn write(lines: &[u8], packing: Packing) {
    let new = || Writer::new(file_header(packing.checksum).to_vec(), packing);
    let mut writer = new();
    let Ok(expect) = writer.put(lines) else {
        assert!(lines.contains(&0xff));
        return;
    };
    assert_eq!(new().put(&expect).expect("packable"), expect);
    let file = writer.finish().expect("packable");
    assert_eq!(all(bare_text(&file[..])).expect("whole"), &*expect);
}

fn all(mut source: impl BufRead) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    source.read_to_end(&mut bytes).map(|_| bytes).map_err(|e| e.to_string())
}
