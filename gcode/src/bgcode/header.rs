//! The file's header and the blocks' headers: numbers to types and back.
//!
//! Takes and gives little-endian bytes. Bounds: a block that announces more than
//! [`Kind::limit_bytes`] is an error before anything is allocated for it.
use super::error::Fault;
use std::fmt;

/// The first bytes of binary G-code.
pub const MAGIC: &[u8; 4] = b"GCDE";

/// The only version of the format.
const VERSION: u32 = 1;

/// What stands at the beginning of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileHeader {
    /// What each block ends with.
    pub checksum: Checksum,
}

impl FileHeader {
    /// In the file, bytes.
    pub const BYTES: usize = 10;

    /// Reads it.
    ///
    /// # Errors
    /// It is not a header of version 1.
    pub fn parse(bytes: &[u8; Self::BYTES]) -> Result<FileHeader, Fault> {
        let [m0, m1, m2, m3, v0, v1, v2, v3, c0, c1] = *bytes;
        if [m0, m1, m2, m3] != *MAGIC {
            return Err(Fault::Magic);
        }
        match u32::from_le_bytes([v0, v1, v2, v3]) {
            VERSION => {}
            other => return Err(Fault::Version(other)),
        }
        let checksum = match u16::from_le_bytes([c0, c1]) {
            0 => Checksum::None,
            1 => Checksum::Crc32,
            other => return Err(Fault::ChecksumKind(other)),
        };
        Ok(FileHeader { checksum })
    }

    /// As it stands in the file.
    #[must_use]
    pub fn to_bytes(self) -> [u8; Self::BYTES] {
        let [v0, v1, v2, v3] = VERSION.to_le_bytes();
        let [c0, c1] = (self.checksum as u16).to_le_bytes();
        let [m0, m1, m2, m3] = *MAGIC;
        [m0, m1, m2, m3, v0, v1, v2, v3, c0, c1]
    }
}

/// What each block ends with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Checksum {
    /// Nothing.
    None = 0,
    /// CRC-32 (ISO 3309, as in zip) of header, parameters and data.
    Crc32 = 1,
}

impl Checksum {
    /// In the file, bytes.
    #[must_use]
    pub fn bytes(self) -> usize {
        match self {
            Checksum::None => 0,
            Checksum::Crc32 => 4,
        }
    }
}

/// What a block holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Who made the file, and when.
    FileMetadata,
    /// G-code.
    GCode,
    /// The slicer's settings.
    SlicerMetadata,
    /// What the printer wants to know: its model, the nozzle, the filament.
    PrinterMetadata,
    /// Times and filament of the print.
    PrintMetadata,
    /// A picture.
    Thumbnail,
    /// A kind that the specification does not have.
    Other(u16),
}

impl Kind {
    fn of(number: u16) -> Kind {
        match number {
            0 => Kind::FileMetadata,
            1 => Kind::GCode,
            2 => Kind::SlicerMetadata,
            3 => Kind::PrinterMetadata,
            4 => Kind::PrintMetadata,
            5 => Kind::Thumbnail,
            other => Kind::Other(other),
        }
    }

    fn number(self) -> u16 {
        match self {
            Kind::FileMetadata => 0,
            Kind::GCode => 1,
            Kind::SlicerMetadata => 2,
            Kind::PrinterMetadata => 3,
            Kind::PrintMetadata => 4,
            Kind::Thumbnail => 5,
            Kind::Other(other) => other,
        }
    }

    /// Bytes of the parameters between header and data; `None` for a kind that is
    /// not known.
    #[must_use]
    pub fn parameter_bytes(self) -> Option<usize> {
        match self {
            Kind::Thumbnail => Some(6),
            Kind::Other(_) => None,
            _ => Some(2),
        }
    }

    /// Most bytes that a block may announce, packed or unpacked. libbgcode cuts
    /// G-code at 64 KiB, settings have some 40 kB, thumbnails some 100 kB; what is
    /// far beyond is damage, or meant to harm.
    #[must_use]
    pub fn limit_bytes(self) -> u32 {
        match self {
            Kind::GCode | Kind::Other(_) => 16 << 20,
            Kind::Thumbnail => 8 << 20,
            _ => 1 << 20,
        }
    }

    /// Whether it holds `key=value` lines.
    #[must_use]
    pub fn is_metadata(self) -> bool {
        matches!(
            self,
            Kind::FileMetadata | Kind::SlicerMetadata | Kind::PrinterMetadata | Kind::PrintMetadata
        )
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Kind::FileMetadata => "file metadata",
            Kind::GCode => "G-code",
            Kind::SlicerMetadata => "slicer metadata",
            Kind::PrinterMetadata => "printer metadata",
            Kind::PrintMetadata => "print metadata",
            Kind::Thumbnail => "thumbnail",
            Kind::Other(_) => "unknown",
        })
    }
}

/// How a block's data is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compression {
    /// Not at all.
    None = 0,
    /// Deflate within the zlib format (RFC 1950).
    Deflate = 1,
    /// Heatshrink, a window of 2048 bytes, matches of at most 16.
    Heatshrink11 = 2,
    /// Heatshrink, a window of 4096 bytes, matches of at most 16.
    Heatshrink12 = 3,
}

impl Compression {
    fn of(number: u16) -> Result<Compression, Fault> {
        Ok(match number {
            0 => Compression::None,
            1 => Compression::Deflate,
            2 => Compression::Heatshrink11,
            3 => Compression::Heatshrink12,
            other => return Err(Fault::Compression(other)),
        })
    }
}

/// How G-code is written within a block's data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// As text.
    None = 0,
    /// MeatPack: no comments, no blank lines.
    MeatPack = 1,
    /// MeatPack with lines that are comments kept; comments at the end of a command are not.
    MeatPackComments = 2,
}

impl Encoding {
    /// By its number.
    ///
    /// # Errors
    /// It is not known.
    pub fn of(number: u16) -> Result<Encoding, Fault> {
        Ok(match number {
            0 => Encoding::None,
            1 => Encoding::MeatPack,
            2 => Encoding::MeatPackComments,
            other => return Err(Fault::Encoding(other)),
        })
    }
}

/// What stands at the beginning of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BlockHeader {
    /// What it holds.
    pub kind: Kind,
    /// How it is packed.
    pub compression: Compression,
    /// Bytes of the data when unpacked.
    pub unpacked_bytes: u32,
    /// Bytes of the data in the file; the same where it is not compressed.
    pub packed_bytes: u32,
}

impl BlockHeader {
    /// What every header has, bytes; a compressed block's has [`Self::PACKED_SIZE_BYTES`] more.
    pub const BYTES: usize = 8;

    /// The size in the file, where the block is compressed, bytes.
    pub const PACKED_SIZE_BYTES: usize = 4;

    /// Reads what every header has; for a compressed block the packed size is still to come.
    ///
    /// # Errors
    /// The compression is not known, or the block too large.
    pub fn parse(bytes: [u8; Self::BYTES]) -> Result<BlockHeader, Fault> {
        let [k0, k1, c0, c1, u0, u1, u2, u3] = bytes;
        let kind = Kind::of(u16::from_le_bytes([k0, k1]));
        let compression = Compression::of(u16::from_le_bytes([c0, c1]))?;
        let unpacked_bytes = u32::from_le_bytes([u0, u1, u2, u3]);
        BlockHeader { kind, compression, unpacked_bytes, packed_bytes: unpacked_bytes }.bounded()
    }

    /// With the packed size of a compressed block.
    ///
    /// # Errors
    /// The block is too large.
    pub fn with_packed_size(self, bytes: [u8; Self::PACKED_SIZE_BYTES]) -> Result<BlockHeader, Fault> {
        BlockHeader { packed_bytes: u32::from_le_bytes(bytes), ..self }.bounded()
    }

    fn bounded(self) -> Result<BlockHeader, Fault> {
        let (size, limit) = (self.unpacked_bytes.max(self.packed_bytes), self.kind.limit_bytes());
        if size > limit {
            return Err(Fault::TooLarge { kind: self.kind, size, limit });
        }
        Ok(self)
    }

    /// As it stands in the file.
    pub fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.kind.number().to_le_bytes());
        out.extend_from_slice(&(self.compression as u16).to_le_bytes());
        out.extend_from_slice(&self.unpacked_bytes.to_le_bytes());
        if self.compression != Compression::None {
            out.extend_from_slice(&self.packed_bytes.to_le_bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_headers() {
        let check = |bytes: &[u8; 10], expect: &str| {
            let found = match FileHeader::parse(bytes) {
                Ok(header) => {
                    assert_eq!(header.to_bytes(), *bytes);
                    format!("{:?}", header.checksum)
                }
                Err(fault) => fault.to_string(),
            };
            assert!(found.contains(expect), "{found}");
        };
        check(b"GCDE\x01\0\0\0\0\0", "None");
        check(b"GCDE\x01\0\0\0\x01\0", "Crc32");
        check(b"GCDF\x01\0\0\0\x01\0", "no binary G-code");
        check(b"GCDE\x02\0\0\0\x01\0", "version 2");
        check(b"GCDE\0\0\0\x01\x01\0", "version 16777216");
        check(b"GCDE\x01\0\0\0\x02\0", "kind 2");
    }

    #[test]
    fn block_headers() {
        let check = |bytes: &[u8], expect: &str| {
            let (fixed, rest) = bytes.split_first_chunk().expect("8 bytes");
            let header = BlockHeader::parse(*fixed).and_then(|h| match rest.split_first_chunk() {
                Some((size, _)) => h.with_packed_size(*size),
                None => Ok(h),
            });
            let found = match header {
                Ok(header) => {
                    let mut written = Vec::new();
                    header.write(&mut written);
                    assert_eq!(written, bytes);
                    format!("{header:?}")
                }
                Err(fault) => fault.to_string(),
            };
            assert!(found.contains(expect), "{found}");
        };
        check(b"\x01\0\0\0\x05\0\0\0", "GCode, compression: None, unpacked_bytes: 5, packed_bytes: 5");
        check(b"\x02\0\x01\0\x05\x01\0\0\x03\0\0\0", "Deflate, unpacked_bytes: 261, packed_bytes: 3");
        check(b"\x05\0\x02\0\0\0\0\0\0\0\0\0", "Thumbnail, compression: Heatshrink11");
        check(b"\x63\0\x03\0\x01\0\0\0\x01\0\0\0", "Other(99), compression: Heatshrink12");
        check(b"\x01\0\x04\0\x05\0\0\0", "compression 4");
        check(b"\x01\0\0\0\x01\0\0\x01", "announces 16777217 bytes");
        check(b"\x01\0\x01\0\x01\0\0\0\xff\xff\xff\xff", "announces 4294967295 bytes");
        check(b"\x00\0\0\0\x01\0\x10\0", "more than the 1048576 that a file metadata block");
    }
}
