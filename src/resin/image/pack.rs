//! A picture in memory to the bytes that a job holds.
//!
//! Takes an [`Image`], gives a PNG file: 8-bit grey, or three neighbours of the panel
//! as red, green and blue, or runs, as the panel's pictures are packed. Quick rather than small: a
//! job has thousands of pictures.
use super::{Image, ImageError, Packing, Panel, size_px};
use crate::resin::archive::MAX_ENTRY_BYTES;
use crate::resin::goo::runs::Packer;
use crate::resin::preview::Preview;
use png::{BitDepth, ColorType, DeflateCompression, Encoder, EncodingError, Filter};

/// Why a picture cannot be packed.
#[derive(Debug, thiserror::Error)]
pub enum PackError {
    /// Whoever made or changed it gave it another size than the panel's.
    #[error(
        "the picture has {width} × {height} px and {bytes} bytes, the panel {panel_width} × {panel_height} px: this is a mistake in the program"
    )]
    WrongSize {
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Its bytes; one a pixel is needed.
        bytes: usize,
        /// The panel's pixels along a row.
        panel_width: u32,
        /// The panel's rows.
        panel_height: u32,
    },
    /// Noise or dithering instead of shapes: its bytes would not be read again.
    #[error(
        "the picture would take {bytes} bytes, at most {MAX_ENTRY_BYTES} are read: export it without dithering"
    )]
    TooFine {
        /// Bytes that it takes packed.
        bytes: usize,
    },
    /// The PNG writer refused.
    #[error("the picture cannot be packed ({0})")]
    Png(#[from] EncodingError),
}

impl Panel {
    /// The bytes of a picture of the panel's size, which [`Panel::rows`] reads back as
    /// they are. The same picture gives the same bytes.
    ///
    /// # Errors
    /// It is not of the panel's size.
    pub fn pack(self, image: &Image) -> Result<Vec<u8>, PackError> {
        let (width, height, bytes) = (image.width_px, image.height_px, image.pixels.len());
        let Panel { width_px: panel_width, height_px: panel_height, packing } = self;
        let fits = [width, height] == [panel_width, panel_height]
            && bytes as u64 == u64::from(width) * u64::from(height);
        if !fits {
            return Err(PackError::WrongSize { width, height, bytes, panel_width, panel_height });
        }
        let packed = match packing {
            Packing::Grey => png([width, height], ColorType::Grayscale, &image.pixels)?,
            Packing::Subpixels => {
                let across = width.div_ceil(3);
                let mut rows = vec![0; 3 * across as usize * height as usize];
                let padded = rows.chunks_exact_mut(3 * across as usize);
                for (to, row) in padded.zip(image.pixels.chunks_exact(width as usize)) {
                    to[..row.len()].copy_from_slice(row);
                }
                png([across, height], ColorType::Rgb, &rows)?
            }
            Packing::Runs => {
                let mut packer = Packer::new();
                packer.row(&image.pixels);
                packer.finish()
            }
        };
        readable(packed)
    }

    /// The bytes of a picture of the panel's size that another job holds for `from`,
    /// whose pixels are the same. Rows are packed as they come; where both are 8-bit
    /// grey PNGs it is the same bytes, not unpacked.
    ///
    /// # Errors
    /// The picture cannot be read, or not be packed.
    pub fn repack(self, from: Panel, packed: &[u8]) -> Result<Result<Vec<u8>, PackError>, ImageError> {
        if self.packing == Packing::Grey && from == self && is_plain(packed) {
            from.fits(size_px(packed)?)?;
            return Ok(Ok(packed.to_vec()));
        }
        if self.packing == Packing::Runs {
            let mut packer = Packer::new();
            from.rows(packed, |row| packer.row(row))?;
            return Ok(readable(packer.finish()));
        }
        Ok(self.pack(&from.image(packed)?))
    }
}

fn readable(packed: Vec<u8>) -> Result<Vec<u8>, PackError> {
    if packed.len() as u64 > MAX_ENTRY_BYTES {
        return Err(PackError::TooFine { bytes: packed.len() });
    }
    Ok(packed)
}

/// Whether a PNG is 8-bit grey and not interlaced.
fn is_plain(packed: &[u8]) -> bool {
    let mut decoder = super::decoder(packed);
    decoder.read_header_info().is_ok_and(|info| {
        info.color_type == ColorType::Grayscale && info.bit_depth == BitDepth::Eight && !info.interlaced
    })
}

/// A thumbnail as PNG.
///
/// # Errors
/// It has no pixel.
pub(in crate::resin) fn thumbnail(preview: &Preview) -> Result<Vec<u8>, EncodingError> {
    let bytes: Vec<u8> = preview.pixels.as_flattened().to_vec();
    png([preview.width_px, preview.height_px], ColorType::Rgb, &bytes)
}

fn png([width, height]: [u32; 2], colour: ColorType, rows: &[u8]) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(colour);
    encoder.set_depth(BitDepth::Eight);
    // Most rows are the row above: nothing but zeros, once that is taken off.
    encoder.set_filter(Filter::Up);
    encoder.set_deflate_compression(DeflateCompression::FdeflateUltraFast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(rows)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_picture_of_another_size_is_refused() {
        let panel = Panel { width_px: 3, height_px: 2, packing: Packing::Grey };
        for (width_px, height_px, bytes) in [(2, 3, 6), (3, 2, 5), (3, 2, 7), (0, 0, 0)] {
            let image = Image { width_px, height_px, pixels: vec![0; bytes] };
            let said = panel.pack(&image).expect_err("refused").to_string();
            assert!(said.contains("3 × 2 px"), "{said}");
        }
    }

    proptest! {
        #[test]
        fn what_is_packed_is_read_back(
            (width_px, height_px) in (1_u32..40, 1_u32..20),
            packing in prop::sample::select(vec![Packing::Grey, Packing::Subpixels, Packing::Runs]),
            seed in any::<u32>(),
            few in any::<bool>(),
        ) {
            let value = |i: u32| (i ^ seed).wrapping_mul(0x9e37_79b1).to_le_bytes()[3];
            let value = |i| if few { value(i / 7) & 0xc0 } else { value(i) };
            let panel = Panel { width_px, height_px, packing };
            let image = Image { width_px, height_px, pixels: (0..width_px * height_px).map(value).collect() };
            let packed = panel.pack(&image).expect("packed");
            prop_assert_eq!(&panel.image(&packed).expect("read"), &image);
            prop_assert_eq!(panel.pack(&image).expect("packed"), packed);
        }
    }
}
