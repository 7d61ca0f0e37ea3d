//! Blocks, one after the other, from anything that can be read.
//!
//! Takes a reader, gives [`Block`]s with their bytes as they stand in the file.
//! Each is checked: its size before it is read, its checksum after. Memory: one
//! block, and of a file that is cut off no more than is there.
use super::compress;
use super::error::{Error, Fault};
use super::header::{BlockHeader, Checksum, Compression, Encoding, FileHeader, Kind};
use std::borrow::Cow;
use std::io::Read;

/// Parameters of a block of unknown kind are looked for up to this, bytes.
const MAX_UNKNOWN_PARAMETER_BYTES: usize = 32;

/// Keys and values.
pub type Pairs = Vec<(Vec<u8>, Vec<u8>)>;

/// Gives the blocks of a file.
#[derive(Debug)]
pub struct Reader<R> {
    inner: R,
    header: FileHeader,
    /// Blocks begun.
    block: u32,
    /// Where the current block begins, and how much was read.
    from: u64,
    byte: u64,
}

/// A block as it stands in the file.
#[derive(Clone, Debug)]
pub struct Block {
    /// Its header.
    pub header: BlockHeader,
    /// From 1.
    pub number: u32,
    /// Where it begins in the file.
    pub byte: u64,
    raw: Vec<u8>,
    /// Where in `raw` parameters, data and checksum begin.
    parts: [usize; 3],
}

impl Block {
    /// All of it: header, parameters, data, checksum.
    #[must_use]
    pub fn raw(&self) -> &[u8] {
        &self.raw
    }

    /// What stands between header and data.
    #[must_use]
    pub fn parameters(&self) -> &[u8] {
        &self.raw[self.parts[0]..self.parts[1]]
    }

    /// The data as it stands in the file.
    #[must_use]
    pub fn packed(&self) -> &[u8] {
        &self.raw[self.parts[1]..self.parts[2]]
    }

    /// The data, unpacked; its encoding is the caller's business.
    ///
    /// # Errors
    /// [`Fault::Unpack`].
    pub fn data(&self) -> Result<Cow<'_, [u8]>, Error> {
        compress::unpack(self.packed(), self.header.compression, self.header.unpacked_bytes)
            .map_err(|fault| self.error(fault))
    }

    /// How the G-code of a G-code block is written.
    ///
    /// # Errors
    /// [`Fault::Encoding`].
    pub fn encoding(&self) -> Result<Encoding, Error> {
        let number = match self.parameters() {
            [low, high, ..] => u16::from_le_bytes([*low, *high]),
            _ => u16::MAX,
        };
        Encoding::of(number).map_err(|fault| self.error(fault))
    }

    /// The keys and values of a metadata block, in order; none where the encoding is
    /// another than INI, which is the only one of the specification.
    ///
    /// # Errors
    /// [`Fault::Unpack`].
    pub fn metadata(&self) -> Result<Pairs, Error> {
        if !self.header.kind.is_metadata() || self.parameters() != [0, 0] {
            return Ok(Vec::new());
        }
        let data = self.data()?;
        let pairs = data.split(|b| *b == b'\n').filter_map(|line| {
            let at = memchr::memchr(b'=', line)?;
            Some((line[..at].to_vec(), line[at + 1..].to_vec()))
        });
        Ok(pairs.collect())
    }

    fn error(&self, fault: Fault) -> Error {
        Error { block: self.number, byte: self.byte, fault }
    }
}

impl<R: Read> Reader<R> {
    /// Reads the file's header.
    ///
    /// # Errors
    /// It is no binary G-code, or of a kind that is not known.
    pub fn new(mut inner: R) -> Result<Reader<R>, Error> {
        let mut bytes = [0; FileHeader::BYTES];
        let wrong = |fault| Error { block: 0, byte: 0, fault };
        inner.read_exact(&mut bytes).map_err(|e| wrong(ended(e)))?;
        let header = FileHeader::parse(&bytes).map_err(wrong)?;
        let byte = bytes.len() as u64;
        Ok(Reader { inner, header, block: 0, from: byte, byte })
    }

    /// The file's header.
    #[must_use]
    pub fn header(&self) -> FileHeader {
        self.header
    }

    /// Bytes of the file that were read.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.byte
    }

    /// The next block, `None` at the end of the file.
    ///
    /// # Errors
    /// The block is damaged, cut off, too large, or packed in a way that is not known.
    pub fn next_block(&mut self) -> Result<Option<Block>, Error> {
        self.block = self.block.saturating_add(1);
        self.from = self.byte;
        self.block().map_err(|fault| Error { block: self.block, byte: self.from, fault })
    }

    fn block(&mut self) -> Result<Option<Block>, Fault> {
        let mut raw = Vec::with_capacity(BlockHeader::BYTES);
        self.append(&mut raw, BlockHeader::BYTES)?;
        let Some(fixed) = raw.first_chunk() else {
            return if raw.is_empty() { Ok(None) } else { Err(Fault::Truncated) };
        };
        let mut header = BlockHeader::parse(*fixed)?;
        if header.compression != Compression::None {
            self.append(&mut raw, BlockHeader::PACKED_SIZE_BYTES)?;
            header = header.with_packed_size(*raw.last_chunk().ok_or(Fault::Truncated)?)?;
            if raw.len() != BlockHeader::BYTES + BlockHeader::PACKED_SIZE_BYTES {
                return Err(Fault::Truncated);
            }
        }
        let parameters = raw.len();
        let data = parameters + header.kind.parameter_bytes().unwrap_or(0);
        let end = data + header.packed_bytes as usize;
        self.exactly(&mut raw, end + self.header.checksum.bytes())?;
        let parts = match (header.kind, self.header.checksum) {
            (Kind::Other(kind), Checksum::None) => return Err(Fault::UnknownKind(kind)),
            (Kind::Other(_), Checksum::Crc32) => {
                let more = self.parameters_of_unknown(&mut raw, end)?;
                [parameters, data + more, end + more]
            }
            (_, Checksum::None) => [parameters, data, end],
            (_, Checksum::Crc32) if is_right(&raw, end) => [parameters, data, end],
            _ => return Err(Fault::Checksum),
        };
        let (number, byte) = (self.block, self.from);
        Ok(Some(Block { header, number, byte, raw, parts }))
    }

    /// How many parameters a block of unknown kind has: so many that its checksum is right.
    fn parameters_of_unknown(&mut self, raw: &mut Vec<u8>, end: usize) -> Result<usize, Fault> {
        for more in (0..=MAX_UNKNOWN_PARAMETER_BYTES).step_by(2) {
            self.exactly(raw, end + more + Checksum::Crc32.bytes())?;
            if is_right(raw, end + more) {
                return Ok(more);
            }
        }
        Err(Fault::Checksum)
    }

    /// Reads on until there are `len` bytes.
    fn exactly(&mut self, raw: &mut Vec<u8>, len: usize) -> Result<(), Fault> {
        self.append(raw, len - raw.len())?;
        if raw.len() < len { Err(Fault::Truncated) } else { Ok(()) }
    }

    /// Reads at most `count` bytes more; less at the end of the file. Room is made
    /// as bytes come, so that a size alone costs nothing.
    fn append(&mut self, raw: &mut Vec<u8>, count: usize) -> Result<(), Fault> {
        let read = (&mut self.inner).take(count as u64).read_to_end(raw).map_err(Fault::Read)?;
        self.byte += read as u64;
        Ok(())
    }
}

/// Whether the four bytes at `end` are the checksum of those before.
fn is_right(raw: &[u8], end: usize) -> bool {
    raw.split_at_checked(end).is_some_and(|(covered, sum)| sum == crc32fast::hash(covered).to_le_bytes())
}

fn ended(error: std::io::Error) -> Fault {
    match error.kind() {
        std::io::ErrorKind::UnexpectedEof => Fault::Truncated,
        _ => Fault::Read(error),
    }
}

#[cfg(test)]
mod tests {
    use super::super::writer::{block, file_header};
    use super::*;
    use proptest::prelude::*;

    /// A file with one block of each kind.
    fn sample(checksum: Checksum) -> Vec<u8> {
        let mut file = file_header(checksum).to_vec();
        let mut add = |kind, parameters: &[u8], data: &[u8], compression| {
            file.extend(block(kind, parameters, data, compression, checksum));
        };
        add(Kind::FileMetadata, &[0, 0], b"Producer=Nobody\n", Compression::None);
        add(Kind::PrinterMetadata, &[0, 0], b"a=1\nb=c=d\nno pair\n", Compression::Deflate);
        add(Kind::Thumbnail, &[0, 0, 16, 0, 16, 0], b"\x89PNG", Compression::None);
        add(Kind::SlicerMetadata, &[0, 0], b"key=value\n", Compression::Heatshrink11);
        add(Kind::GCode, &[0, 0], b"G28\n", Compression::Heatshrink12);
        file
    }

    fn read_all(file: &[u8]) -> Result<Vec<Block>, Error> {
        let mut reader = Reader::new(file)?;
        let mut blocks = Vec::new();
        while let Some(block) = reader.next_block()? {
            blocks.push(block);
        }
        assert_eq!(reader.position(), file.len() as u64);
        Ok(blocks)
    }

    #[test]
    fn reads_every_kind() {
        for checksum in [Checksum::None, Checksum::Crc32] {
            let file = sample(checksum);
            let blocks = read_all(&file).unwrap();
            let kinds: Vec<_> = blocks.iter().map(|b| b.header.kind).collect();
            use Kind::{FileMetadata, GCode, PrinterMetadata, SlicerMetadata, Thumbnail};
            assert_eq!(kinds, [FileMetadata, PrinterMetadata, Thumbnail, SlicerMetadata, GCode]);
            let raw: Vec<u8> = blocks.iter().flat_map(|b| b.raw().to_vec()).collect();
            assert_eq!(raw, file[FileHeader::BYTES..]);
            let pairs = blocks[1].metadata().unwrap();
            assert_eq!(pairs, [(b"a".to_vec(), b"1".to_vec()), (b"b".to_vec(), b"c=d".to_vec())]);
            assert_eq!(blocks[2].parameters(), [0, 0, 16, 0, 16, 0]);
            assert_eq!(blocks[2].packed(), b"\x89PNG");
            assert_eq!(&blocks[4].data().unwrap()[..], b"G28\n");
            assert_eq!(blocks[4].encoding().unwrap(), Encoding::None);
        }
    }

    #[test]
    fn every_cut_and_every_flipped_bit_is_found() {
        let file = sample(Checksum::Crc32);
        let ends: Vec<u64> = read_all(&file).unwrap().iter().map(|b| b.byte + b.raw().len() as u64).collect();
        for len in 0..file.len() {
            let whole = len == FileHeader::BYTES || ends.contains(&(len as u64));
            assert_eq!(read_all(&file[..len]).is_ok(), whole, "{len}");
        }
        for bit in 0..file.len() * 8 {
            let mut damaged = file.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(read_all(&damaged).is_err(), "bit {bit}");
        }
    }

    #[test]
    fn errors_tell_what_and_where() {
        let check = |file: &[u8], expect: &str| {
            let error = read_all(file).unwrap_err().to_string();
            assert!(error.contains(expect), "{error}");
        };
        let file = sample(Checksum::Crc32);
        check(b"", "block 0 (from byte 0): the file ends");
        check(b"GCDE\x01\0\0\0\x07\0", "kind 7");
        check(&file[..file.len() - 1], "block 5 (from byte");
        let mut damaged = file.clone();
        damaged[20] ^= 1;
        check(&damaged, "block 1 (from byte 10): the checksum is wrong");
        let announced = [&file[..10], b"\x01\0\0\0\xff\xff\xff\xff"].concat();
        check(&announced, "announces 4294967295 bytes");
        let large = [&file[..10], b"\x01\0\0\0\0\0\0\x01"].concat();
        check(&large, "the file ends within the block");
        let odd = [&file_header(Checksum::None)[..], b"\x09\0\0\0\0\0\0\0\0\0\0\0"].concat();
        check(&odd, "kind 9 is not known");
    }

    #[test]
    fn a_block_of_unknown_kind_is_passed_over() {
        for parameters in [&b""[..], b"\x01\x02", b"123456", &[7; 32]] {
            let mut file = file_header(Checksum::Crc32).to_vec();
            let odd = block(Kind::Other(77), parameters, b"data", Compression::None, Checksum::Crc32);
            file.extend_from_slice(&odd);
            file.extend(block(Kind::GCode, &[0, 0], b"G28\n", Compression::None, Checksum::Crc32));
            let blocks = read_all(&file).unwrap();
            assert_eq!(blocks.len(), 2);
            assert_eq!((blocks[0].raw(), blocks[0].parameters()), (&odd[..], parameters));
            assert_eq!(blocks[0].packed(), b"data");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), sums: bool) {
            let checksum = if sums { Checksum::Crc32 } else { Checksum::None };
            for head in [&b""[..], &file_header(checksum)] {
                if let Ok(blocks) = read_all(&[head, &bytes].concat()) {
                    for block in blocks {
                        let _ = (block.data(), block.metadata(), block.encoding());
                    }
                }
            }
        }
    }
}
