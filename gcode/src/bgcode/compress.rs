//! A block's data, packed and unpacked.
//!
//! Takes and gives whole blocks, whose size is bounded by
//! [`super::Kind::limit_bytes`]. Unpacking stops as soon as more comes out than
//! was announced.
use super::error::Fault;
use super::header::Compression;
use super::heatshrink;
use flate2::Compression as Level;
use flate2::read::{ZlibDecoder, ZlibEncoder};
use std::borrow::Cow;
use std::io::Read;

/// Deflate never packs better than this (RFC 1951: 258 bytes in 2 bits).
const DEFLATE_MOST: usize = 1032;

/// Unpacks data that announces `unpacked_bytes`. What stands behind the end of a
/// zlib stream is not looked at.
///
/// # Errors
/// It is damaged, or gives less or more.
pub(super) fn unpack(
    data: &[u8],
    compression: Compression,
    unpacked_bytes: u32,
) -> Result<Cow<'_, [u8]>, Fault> {
    let wrong = || Fault::Unpack { expected: unpacked_bytes };
    let size = unpacked_bytes as usize;
    let out = match compression {
        Compression::None => return Ok(Cow::Borrowed(data)),
        Compression::Deflate => {
            if size > data.len().saturating_mul(DEFLATE_MOST) {
                return Err(wrong());
            }
            let mut out = Vec::with_capacity(size);
            // One byte more tells a stream that is too long.
            let read = ZlibDecoder::new(data).take(u64::from(unpacked_bytes) + 1).read_to_end(&mut out);
            read.is_ok_and(|n| n == size).then_some(out)
        }
        Compression::Heatshrink11 => heatshrink::unpack(data, 11, size),
        Compression::Heatshrink12 => heatshrink::unpack(data, 12, size),
    };
    out.map(Cow::Owned).ok_or_else(wrong)
}

/// Packs data.
pub(super) fn pack(data: &[u8], compression: Compression) -> Cow<'_, [u8]> {
    Cow::Owned(match compression {
        Compression::None => return Cow::Borrowed(data),
        Compression::Deflate => {
            let mut out = Vec::with_capacity(data.len() / 2);
            // Reading from memory into memory cannot fail.
            let _ = ZlibEncoder::new(data, Level::default()).read_to_end(&mut out);
            out
        }
        Compression::Heatshrink11 => heatshrink::pack(data, 11),
        Compression::Heatshrink12 => heatshrink::pack(data, 12),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const ALL: [Compression; 4] =
        [Compression::None, Compression::Deflate, Compression::Heatshrink11, Compression::Heatshrink12];

    #[test]
    fn a_bomb_ends_at_the_announced_size() {
        let zeros = vec![0; 1 << 20];
        let bomb = pack(&zeros, Compression::Deflate);
        assert!(bomb.len() < 2000);
        for announced in [0, 1, 1000, (1 << 20) - 1, (1 << 20) + 1, u32::MAX] {
            assert!(unpack(&bomb, Compression::Deflate, announced).is_err(), "{announced}");
        }
        assert_eq!(unpack(&bomb, Compression::Deflate, 1 << 20).unwrap().len(), 1 << 20);
    }

    #[test]
    fn damage_is_an_error() {
        let text = b"G1 X1 Y2\n".repeat(50);
        for compression in &ALL[1..] {
            let packed = pack(&text, *compression);
            assert!(unpack(&packed[..packed.len() / 2], *compression, text.len() as u32).is_err());
            assert!(unpack(&packed, *compression, text.len() as u32 - 1).is_err());
            assert!(unpack(b"", *compression, 1).is_err());
        }
        assert!(unpack(b"no zlib at all", Compression::Deflate, 5).is_err());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]
        #[test]
        fn what_was_packed_unpacks(data in prop::collection::vec(any::<u8>(), 0..2000)) {
            for compression in ALL {
                let packed = pack(&data, compression);
                let back = unpack(&packed, compression, data.len() as u32).unwrap();
                prop_assert_eq!(&back[..], &data[..]);
            }
        }
    }
}
