//! A picture in memory to the bytes that a job holds.
//!
//! Takes an [`Image`], gives a PNG file: 8-bit grey, or three neighbours of the panel
//! as red, green and blue where the panel is packed so. Quick rather than small: a
//! job has thousands of pictures.
use super::{Image, Packing, Panel};
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
        match packing {
            Packing::Grey => Ok(png([width, height], ColorType::Grayscale, &image.pixels)?),
            Packing::Subpixels => {
                let across = width.div_ceil(3);
                let mut rows = vec![0; 3 * across as usize * height as usize];
                let padded = rows.chunks_exact_mut(3 * across as usize);
                for (to, row) in padded.zip(image.pixels.chunks_exact(width as usize)) {
                    to[..row.len()].copy_from_slice(row);
                }
                Ok(png([across, height], ColorType::Rgb, &rows)?)
            }
        }
    }
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
            subpixels in any::<bool>(),
            seed in any::<u32>(),
            few in any::<bool>(),
        ) {
            let value = |i: u32| (i ^ seed).wrapping_mul(0x9e37_79b1).to_le_bytes()[3];
            let value = |i| if few { value(i / 7) & 0xc0 } else { value(i) };
            let packing = if subpixels { Packing::Subpixels } else { Packing::Grey };
            let panel = Panel { width_px, height_px, packing };
            let image = Image { width_px, height_px, pixels: (0..width_px * height_px).map(value).collect() };
            let packed = panel.pack(&image).expect("packed");
            prop_assert_eq!(&panel.image(&packed).expect("read"), &image);
            prop_assert_eq!(panel.pack(&image).expect("packed"), packed);
        }
    }
}
