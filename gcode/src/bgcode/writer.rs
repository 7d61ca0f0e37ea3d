//! G-code text into blocks.
//!
//! Takes whole lines, cuts the text at line ends into blocks of at most
//! [`BLOCK_TEXT_BYTES`] as libbgcode does, packs each, and reads it back from its
//! own bytes before it is written. Knows no other kind of block; those are copied
//! from where they came ([`super::Block::raw`]) or made by [`block`].
use super::compress;
use super::error::{Error, Fault};
use super::header::{BlockHeader, Checksum, Compression, Encoding, FileHeader, Kind};
use super::meatpack;
use super::reader::Reader;
use super::text::unpack_block;
use std::borrow::Cow;
use std::io::Write;

/// Most text of one block, bytes, as libbgcode cuts it; only a longer line has more.
pub const BLOCK_TEXT_BYTES: usize = 64 << 10;

/// How G-code is put into blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Packing {
    /// How the encoded text is packed.
    pub compression: Compression,
    /// How the text is encoded.
    pub encoding: Encoding,
    /// What each block ends with.
    pub checksum: Checksum,
}

/// A file's header, as it stands at its beginning.
#[must_use]
pub fn file_header(checksum: Checksum) -> [u8; FileHeader::BYTES] {
    FileHeader { checksum }.to_bytes()
}

/// A whole block: header, parameters, data (packed here) and checksum.
///
/// # Panics
/// The data has 4 GiB or more.
#[must_use]
pub fn block(
    kind: Kind,
    parameters: &[u8],
    data: &[u8],
    compression: Compression,
    checksum: Checksum,
) -> Vec<u8> {
    let packed = compress::pack(data, compression);
    let size = |bytes: &[u8]| u32::try_from(bytes.len()).expect("a block is smaller than 4 GiB");
    let header = BlockHeader { kind, compression, unpacked_bytes: size(data), packed_bytes: size(&packed) };
    let mut block = Vec::with_capacity(packed.len() + 32);
    header.write(&mut block);
    block.extend_from_slice(parameters);
    block.extend_from_slice(&packed);
    if checksum == Checksum::Crc32 {
        let sum = crc32fast::hash(&block);
        block.extend_from_slice(&sum.to_le_bytes());
    }
    block
}

fn encode(text: &[u8], encoding: Encoding) -> Result<Cow<'_, [u8]>, Fault> {
    Ok(match encoding {
        Encoding::None => Cow::Borrowed(text),
        Encoding::MeatPack => Cow::Owned(meatpack::pack(text, false)?),
        Encoding::MeatPackComments => Cow::Owned(meatpack::pack(text, true)?),
    })
}

/// Writes text as G-code blocks.
#[derive(Debug)]
pub struct Writer<W> {
    out: W,
    packing: Packing,
    /// Text that is not written yet, as it will be read back.
    text: Vec<u8>,
    blocks: u32,
    bytes: u64,
}

impl<W: Write> Writer<W> {
    /// Writes behind what stands in `out` already: the file's header and what comes before the G-code.
    pub fn new(out: W, packing: Packing) -> Writer<W> {
        Writer { out, packing, text: Vec::new(), blocks: 0, bytes: 0 }
    }

    /// Takes the next whole lines (the last of all may lack its end), and gives what
    /// a reader will find: the same for [`Encoding::None`]; else without blank lines
    /// and comments behind commands, and with a space before each word of a motion.
    ///
    /// # Errors
    /// The writer's; or with an [`Error`] inside, what makes the text unfit (its block is counted from 1).
    pub fn put<'a>(&mut self, lines: &'a [u8]) -> std::io::Result<Cow<'a, [u8]>> {
        let found = self.read_back(lines)?;
        self.text.extend_from_slice(&found);
        let mut from = 0;
        while self.text.len() - from > BLOCK_TEXT_BYTES {
            let rest = &self.text[from..];
            // A line longer than a block gets one of its own.
            let end =
                memchr::memrchr(b'\n', &rest[..BLOCK_TEXT_BYTES]).or_else(|| memchr::memchr(b'\n', rest));
            let Some(end) = end else {
                if rest.len() > Kind::GCode.limit_bytes() as usize / 2 {
                    return Err(self.error(Fault::LongLine(rest.len())).into());
                }
                break;
            };
            self.write_block(from, from + end + 1)?;
            from += end + 1;
        }
        self.text.drain(..from);
        Ok(found)
    }

    fn read_back<'a>(&self, lines: &'a [u8]) -> Result<Cow<'a, [u8]>, Error> {
        let encoded = encode(lines, self.packing.encoding).map_err(|fault| self.error(fault))?;
        let Cow::Owned(packed) = encoded else { return Ok(Cow::Borrowed(lines)) };
        let mut text = Vec::with_capacity(lines.len());
        meatpack::Unpacker::default().unpack(&packed, &mut text);
        Ok(Cow::Owned(text))
    }

    /// Writes what is left, and gives the writer back.
    ///
    /// # Errors
    /// As [`Writer::put`].
    pub fn finish(mut self) -> std::io::Result<W> {
        if !self.text.is_empty() {
            self.write_block(0, self.text.len())?;
        }
        self.out.flush()?;
        Ok(self.out)
    }

    fn write_block(&mut self, from: usize, to: usize) -> std::io::Result<()> {
        let text = &self.text[from..to];
        let packed = self.packed(text).map_err(|fault| self.error(fault))?;
        self.out.write_all(&packed)?;
        self.blocks = self.blocks.saturating_add(1);
        self.bytes += packed.len() as u64;
        Ok(())
    }

    /// The block of a text, which reads back as it should.
    fn packed(&self, text: &[u8]) -> Result<Vec<u8>, Fault> {
        let Packing { compression, encoding, checksum } = self.packing;
        let data = encode(text, encoding)?;
        if data.len() > Kind::GCode.limit_bytes() as usize {
            return Err(Fault::LongLine(text.len()));
        }
        let parameters = (encoding as u16).to_le_bytes();
        let packed = block(Kind::GCode, &parameters, &data, compression, checksum);
        prove(&packed, checksum, text)?;
        Ok(packed)
    }

    fn error(&self, fault: Fault) -> Error {
        Error { block: self.blocks.saturating_add(1), byte: self.bytes, fault }
    }
}

/// Reads a block from its bytes as they will stand in the file: it must give the text.
fn prove(packed: &[u8], checksum: Checksum, expect: &[u8]) -> Result<(), Fault> {
    let header = file_header(checksum);
    let mut found = Vec::new();
    let mut read = || -> Result<(), Error> {
        let mut reader = Reader::new(std::io::Read::chain(&header[..], packed))?;
        while let Some(block) = reader.next_block()? {
            unpack_block(&block, &mut found)?;
        }
        Ok(())
    };
    let whole = read().is_ok();
    if whole && found == expect { Ok(()) } else { Err(Fault::Mismatch) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SUM: Checksum = Checksum::Crc32;

    fn packing(compression: Compression, encoding: Encoding) -> Packing {
        Packing { compression, encoding, checksum: SUM }
    }

    fn written(pieces: &[&[u8]], packing: Packing) -> std::io::Result<Vec<u8>> {
        let mut writer = Writer::new(file_header(SUM).to_vec(), packing);
        for piece in pieces {
            writer.put(piece)?;
        }
        writer.finish()
    }

    /// The texts of the blocks of a file.
    fn texts(file: &[u8]) -> Vec<Vec<u8>> {
        let mut reader = Reader::new(file).unwrap();
        let mut texts = Vec::new();
        while let Some(block) = reader.next_block().unwrap() {
            let mut text = Vec::new();
            unpack_block(&block, &mut text).unwrap();
            texts.push(text);
        }
        texts
    }

    #[test]
    fn blocks_end_with_lines() {
        let text = b"G1 X10 Y20 E.5\n;TYPE:Perimeter\n".repeat(10_000);
        for encoding in [Encoding::None, Encoding::MeatPackComments] {
            let pieces: Vec<&[u8]> = text.chunks(32 * 31).collect();
            let texts = texts(&written(&pieces, packing(Compression::Deflate, encoding)).unwrap());
            assert!(texts.len() > 4);
            for text in &texts[..texts.len() - 1] {
                assert!(text.ends_with(b"\n") && text.len() <= BLOCK_TEXT_BYTES);
                assert!(text.len() > BLOCK_TEXT_BYTES - 32);
            }
            assert_eq!(texts.concat(), text);
        }
    }

    #[test]
    fn a_long_line_has_a_block_of_its_own() {
        let mut line = b"; ".to_vec();
        line.resize(200_000, b'x');
        let text = [b"G28\n", &line[..], b"\nG1 X1\n"].concat();
        let file = written(&[&text], packing(Compression::Heatshrink11, Encoding::MeatPackComments)).unwrap();
        let lens: Vec<usize> = texts(&file).iter().map(Vec::len).collect();
        assert_eq!(lens, [4, 200_001, 6]);
    }

    #[test]
    fn what_does_not_fit_is_an_error() {
        let plain = packing(Compression::None, Encoding::None);
        let endless = vec![b'x'; (8 << 20) + 1];
        assert!(written(&[&endless], plain).unwrap_err().to_string().contains("does not fit"));
        let odd = written(&[b"G28\n; \xff\n"], packing(Compression::None, Encoding::MeatPack)).unwrap_err();
        assert!(odd.to_string().contains("byte 255"), "{odd}");
        assert_eq!(written(&[], plain).unwrap(), file_header(SUM));
    }

    #[test]
    fn nothing_else_than_the_text_is_let_through() {
        let text = b"G1 X1 Y2 E.5\nM84\n";
        let data = meatpack::pack(text, true).unwrap();
        for checksum in [Checksum::None, SUM] {
            let packed = block(Kind::GCode, &[2, 0], &data, Compression::None, checksum);
            assert!(prove(&packed, checksum, text).is_ok());
            assert!(prove(&packed, checksum, b"G1 X1 Y2 E.6\nM84\n").is_err());
            assert!(prove(&packed[..packed.len() - 1], checksum, text).is_err());
            // A mistake of the packer's: the checksum would be right.
            let mut other = data.clone();
            other[8] ^= 1;
            let wrong = block(Kind::GCode, &[2, 0], &other, Compression::None, checksum);
            assert!(matches!(prove(&wrong, checksum, text), Err(Fault::Mismatch)));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn text_comes_back(lines in prop::collection::vec("[GM;]?[ -~]{0,40}", 0..50), cut in 1usize..9) {
            let lines: Vec<Vec<u8>> = lines.iter().map(|l| [l.as_bytes(), b"\n"].concat()).collect();
            let text = lines.concat();
            let pieces: Vec<Vec<u8>> = lines.chunks(cut).map(<[Vec<u8>]>::concat).collect();
            let pieces: Vec<&[u8]> = pieces.iter().map(Vec::as_slice).collect();
            for compression in [Compression::None, Compression::Deflate, Compression::Heatshrink11, Compression::Heatshrink12] {
                for encoding in [Encoding::None, Encoding::MeatPack, Encoding::MeatPackComments] {
                    let mut writer = Writer::new(file_header(SUM).to_vec(), packing(compression, encoding));
                    let mut expect = Vec::new();
                    for piece in &pieces {
                        expect.extend_from_slice(&writer.put(piece).unwrap());
                    }
                    prop_assert_eq!(texts(&writer.finish().unwrap()).concat(), expect);
                }
                let exact = written(&pieces, packing(compression, Encoding::None)).unwrap();
                prop_assert_eq!(texts(&exact).concat(), text.clone());
            }
        }
    }
}
