//! Where the G-code lies in a file, and how it is packed.
//!
//! Takes a whole file once and checks every block; gives what one needs to put
//! other G-code in the place of that which is there, and all else byte for byte.
use super::error::Error;
use super::header::{Checksum, Compression, Encoding, Kind};
use super::reader::Reader;
use super::writer::Packing;
use std::io::Read;

/// What [`survey`] found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Survey {
    /// How the first G-code block is packed, and what blocks end with; without
    /// any G-code, not at all.
    pub packing: Packing,
    /// Whether every G-code block is packed so.
    pub uniform: bool,
    /// G-code blocks.
    pub gcode_blocks: u32,
    /// Where the first G-code block begins; the file's end where there is none.
    pub gcode_from: u64,
    /// Where the last G-code block ends.
    pub gcode_to: u64,
    /// Whether other blocks stand between those of G-code.
    pub interrupted: bool,
    /// The file's length, bytes.
    pub bytes: u64,
}

/// Reads a whole file and checks its blocks.
///
/// # Errors
/// The file is damaged, or of a kind that is not known.
pub fn survey(file: impl Read) -> Result<Survey, Error> {
    let mut reader = Reader::new(file)?;
    let checksum: Checksum = reader.header().checksum;
    let mut first: Option<Packing> = None;
    let mut found = Survey {
        packing: Packing { compression: Compression::None, encoding: Encoding::None, checksum },
        uniform: true,
        gcode_blocks: 0,
        gcode_from: 0,
        gcode_to: 0,
        interrupted: false,
        bytes: 0,
    };
    while let Some(block) = reader.next_block()? {
        if block.header.kind != Kind::GCode {
            continue;
        }
        let packing =
            Packing { compression: block.header.compression, encoding: block.encoding()?, checksum };
        match first {
            None => {
                first = Some(packing);
                found.gcode_from = block.byte;
            }
            Some(first) => {
                found.uniform &= first == packing;
                found.interrupted |= found.gcode_to != block.byte;
            }
        }
        found.gcode_blocks += 1;
        found.gcode_to = reader.position();
    }
    found.bytes = reader.position();
    match first {
        Some(packing) => found.packing = packing,
        None => (found.gcode_from, found.gcode_to) = (found.bytes, found.bytes),
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::super::writer::{block, file_header};
    use super::*;

    #[test]
    fn finds_the_gcode() {
        let sum = Checksum::Crc32;
        let metadata = block(Kind::FileMetadata, &[0, 0], b"a=b\n", Compression::None, sum);
        let gcode =
            |encoding: u8, compression| block(Kind::GCode, &[encoding, 0], b"G28\n", compression, sum);
        let plain = gcode(0, Compression::None);
        let check = |blocks: &[&[u8]], expect: (u32, usize, usize, bool, bool)| {
            let mut file = file_header(sum).to_vec();
            blocks.iter().for_each(|b| file.extend_from_slice(b));
            let s = survey(&file[..]).unwrap();
            let found =
                (s.gcode_blocks, s.gcode_from as usize, s.gcode_to as usize, s.uniform, s.interrupted);
            assert_eq!(found, expect);
            assert_eq!(s.bytes, file.len() as u64);
        };
        let (m, g) = (metadata.len(), plain.len());
        check(&[], (0, 10, 10, true, false));
        check(&[&metadata], (0, 10 + m, 10 + m, true, false));
        check(&[&metadata, &plain, &plain], (2, 10 + m, 10 + m + 2 * g, true, false));
        check(&[&plain, &metadata], (1, 10, 10 + g, true, false));
        check(&[&plain, &metadata, &plain], (2, 10, 10 + 2 * g + m, true, true));
        let packed = gcode(2, Compression::Deflate);
        check(&[&plain, &packed], (2, 10, 10 + g + packed.len(), false, false));
    }

    #[test]
    fn damage_is_told() {
        let sum = Checksum::Crc32;
        let odd = block(Kind::GCode, &[3, 0], b"G28\n", Compression::None, sum);
        let file = [&file_header(sum)[..], &odd].concat();
        assert!(survey(&file[..]).unwrap_err().to_string().contains("encoding 3"));
    }
}
