//! A thumbnail: PNG bytes to colours.
//!
//! Takes a PNG file of any kind, gives its pixels on black. Within bounds far above any
//! slicer's thumbnails. Knows no job.
use super::{ImageError, decoder, named};
use crate::resin::preview::Preview;
use png::{ColorType, Transformations};

/// Most pixels along a side: 16 MB at four bytes a pixel.
const MAX_THUMBNAIL_PX: u32 = 2048;

/// Reads a thumbnail.
///
/// # Errors
/// It is damaged, or larger than any.
pub(in crate::resin) fn coloured(png: &[u8]) -> Result<Preview, ImageError> {
    let mut decoder = decoder(png);
    let (width, height) = decoder.read_header_info()?.size();
    if width > MAX_THUMBNAIL_PX || height > MAX_THUMBNAIL_PX {
        return Err(ImageError::TooLarge { width, height });
    }
    decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
    let mut reader = decoder.read_info()?;
    let mut bytes = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let frame = reader.next_frame(&mut bytes)?;
    bytes.truncate(frame.buffer_size());
    let dimmed = |value: u8, alpha: u8| (u16::from(value) * u16::from(alpha) / 255) as u8;
    let pixels: Vec<[u8; 3]> = match frame.color_type {
        ColorType::Grayscale => bytes.iter().map(|&v| [v; 3]).collect(),
        ColorType::GrayscaleAlpha => {
            bytes.as_chunks::<2>().0.iter().map(|p| [dimmed(p[0], p[1]); 3]).collect()
        }
        ColorType::Rgb => bytes.as_chunks::<3>().0.to_vec(),
        ColorType::Rgba => {
            bytes.as_chunks::<4>().0.iter().map(|p| [p[0], p[1], p[2]].map(|v| dimmed(v, p[3]))).collect()
        }
        colour => return Err(ImageError::Unsupported { colour: named(colour) }),
    };
    Ok(Preview { width_px: frame.width, height_px: frame.height, pixels })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin::testing::{BitDepth, grey, header, picture};

    #[test]
    fn thumbnails_of_all_kinds_are_read() {
        use ColorType::*;
        let check = |png: Vec<u8>, expect: &[[u8; 3]]| {
            assert_eq!(coloured(&png).expect("read").pixels, expect);
        };
        check(grey(2, 1, &[7, 255]), &[[7; 3], [255; 3]]);
        check(picture(2, 1, GrayscaleAlpha, BitDepth::Eight, &[200, 255, 200, 51]), &[[200; 3], [40; 3]]);
        check(picture(1, 1, Rgb, BitDepth::Eight, &[1, 2, 3]), &[[1, 2, 3]]);
        check(picture(1, 1, Rgba, BitDepth::Eight, &[255, 2, 3, 0]), &[[0; 3]]);
        check(picture(2, 1, Indexed, BitDepth::One, &[0x40]), &[[0; 3], [255; 3]]);
        assert!(coloured(&header(2049, 1)).is_err() && coloured(b"GIF89a").is_err());
    }
}
