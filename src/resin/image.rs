//! One layer's picture: PNG bytes, or runs, to rows of brightness.
//!
//! Takes the bytes of a PNG file, or GOO's runs, and what the job says of it ([`Panel`]), gives its
//! rows from the top as 8-bit brightness, one a time, so that a picture of any
//! allowed size costs the memory of a few rows. Knows no archive and no millimetre.
mod colour;
pub mod pack;

pub(super) use colour::coloured;

use super::goo::runs::{self, RunsError};
use png::{ColorType, Decoder, DecodingError, Limits, Transformations};
use std::io::Cursor;

/// Most pixels along a side. The largest panels sold have 15,360 × 8,640.
pub const MAX_SIDE_PX: u32 = 16_384;

/// Most pixels of an interlaced picture, which must be held as a whole: 64 MB at four
/// bytes. No slicer interlaces.
pub const MAX_INTERLACED_PX: u64 = 1 << 24;

/// What the PNG reader may hold besides the rows: chunk buffers.
const MAX_PNG_BYTES: usize = 8 << 20;

/// The panel that a job's pictures are made for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Panel {
    /// Pixels of the panel along a picture's row.
    pub width_px: u32,
    /// Pixels of the panel along a picture's column.
    pub height_px: u32,
    /// How a picture's bytes are its pixels.
    pub packing: Packing,
}

/// How a picture's bytes are the panel's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// A pixel of the picture is one of the panel.
    Grey,
    /// Red, green and blue of a pixel are three neighbours of a monochrome panel, which
    /// is three times as wide as the picture (NanoDLP's "RGB" panels).
    Subpixels,
    /// Runs of one brightness (GOO); a pixel of the picture is one of the panel.
    Runs,
}

/// A picture in memory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Image {
    /// Pixels along a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Brightness, row by row from the top.
    pub pixels: Vec<u8>,
}

/// Why a picture cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// It is no PNG file, or it is cut off or damaged.
    #[error("the picture cannot be read ({0}); export the job again")]
    Png(#[from] DecodingError),
    /// The same of a picture of runs.
    #[error("the picture cannot be read ({0}); export the job again")]
    Runs(#[from] RunsError),
    /// Larger than any panel.
    #[error("the picture has {width} × {height} px, at most {MAX_SIDE_PX} along a side are read")]
    TooLarge {
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Interlaced and too large to be held as a whole.
    #[error(
        "the picture of {width} × {height} px is interlaced, which is read up to {MAX_INTERLACED_PX} px; export it without interlacing"
    )]
    Interlaced {
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
    },
    /// Not of the panel's size.
    #[error(
        "the picture has {width} × {height} px, the job's panel needs {panel_width} × {panel_height}; export the job again for this printer"
    )]
    WrongSize {
        /// Pixels along a row.
        width: u32,
        /// Rows.
        height: u32,
        /// Pixels of the picture that the panel needs.
        panel_width: u32,
        /// Rows that the panel needs.
        panel_height: u32,
    },
    /// Coloured: no brightness is given.
    #[error(
        "the picture is {colour}, and its pixel in column {column}, row {row} is coloured or transparent; export 8-bit grey pictures"
    )]
    Coloured {
        /// What the picture says it is.
        colour: &'static str,
        /// From 0 at the left.
        column: u32,
        /// From 0 at the top.
        row: u32,
    },
    /// A kind of picture that no job has.
    #[error("the picture is {colour}; export 8-bit grey pictures")]
    Unsupported {
        /// What the picture says it is.
        colour: &'static str,
    },
}

impl Panel {
    /// Width and height that a picture for it has.
    #[must_use]
    pub fn picture_px(self) -> [u32; 2] {
        match self.packing {
            Packing::Grey | Packing::Runs => [self.width_px, self.height_px],
            Packing::Subpixels => [self.width_px.div_ceil(3), self.height_px],
        }
    }

    /// Reads a picture and shows its rows from the top, each of `width_px` bytes.
    /// 16 bits are cut to the upper 8; 1, 2 and 4 bits are spread over 0 to 255.
    ///
    /// # Errors
    /// The picture is damaged, too large, of another size, or not grey.
    pub fn rows(self, packed: &[u8], mut show: impl FnMut(&[u8])) -> Result<(), ImageError> {
        if self.packing == Packing::Runs {
            return Ok(runs::rows(packed, [self.width_px, self.height_px], show)?);
        }
        let mut decoder = decoder(packed);
        let (size, interlaced) = {
            let info = decoder.read_header_info()?;
            (info.size(), info.interlaced)
        };
        let (width, height) = checked(size)?;
        self.fits([width, height])?;
        if interlaced && u64::from(width) * u64::from(height) > MAX_INTERLACED_PX {
            return Err(ImageError::Interlaced { width, height });
        }
        decoder.set_transformations(Transformations::EXPAND | Transformations::STRIP_16);
        let mut reader = decoder.read_info()?;
        let colour = reader.output_color_type().0;
        let mut grey = Greyed { panel: self, colour, row: 0, buffer: Vec::new() };
        if interlaced {
            let mut whole = vec![0; reader.output_buffer_size().unwrap_or(0)];
            let line = reader.next_frame(&mut whole)?.line_size;
            whole.chunks_exact(line).try_for_each(|row| grey.row(row, &mut show))?;
        } else {
            while let Some(row) = reader.next_row()? {
                grey.row(row.data(), &mut show)?;
            }
        }
        // An animated PNG may announce a first frame that is smaller than the picture.
        self.fits([width, grey.row])
    }

    /// Whether a picture of this width and height is one for it.
    ///
    /// # Errors
    /// It is not.
    pub fn fits(self, [width, height]: [u32; 2]) -> Result<(), ImageError> {
        let [panel_width, panel_height] = self.picture_px();
        if [width, height] == [panel_width, panel_height] {
            return Ok(());
        }
        Err(ImageError::WrongSize { width, height, panel_width, panel_height })
    }

    /// Reads a picture into memory.
    ///
    /// # Errors
    /// As [`Panel::rows`].
    pub fn image(self, packed: &[u8]) -> Result<Image, ImageError> {
        let mut pixels = Vec::new();
        self.rows(packed, |row| pixels.extend_from_slice(row))?;
        Ok(Image { width_px: self.width_px, height_px: self.height_px, pixels })
    }
}

/// Width and height of a picture, from its header alone, px.
///
/// # Errors
/// It is no PNG file, or larger than [`MAX_SIDE_PX`].
pub fn size_px(png: &[u8]) -> Result<[u32; 2], ImageError> {
    let (width, height) = checked(decoder(png).read_header_info()?.size())?;
    Ok([width, height])
}

fn decoder(png: &[u8]) -> Decoder<Cursor<&[u8]>> {
    let mut decoder = Decoder::new_with_limits(Cursor::new(png), Limits { bytes: MAX_PNG_BYTES });
    // Neither says anything of a layer, and both are packed: room for a bomb.
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    decoder
}

fn checked((width, height): (u32, u32)) -> Result<(u32, u32), ImageError> {
    if width > MAX_SIDE_PX || height > MAX_SIDE_PX {
        return Err(ImageError::TooLarge { width, height });
    }
    Ok((width, height))
}

/// Rows of any kind of picture as rows of brightness.
struct Greyed {
    panel: Panel,
    colour: ColorType,
    row: u32,
    buffer: Vec<u8>,
}

impl Greyed {
    fn row(&mut self, row: &[u8], show: &mut impl FnMut(&[u8])) -> Result<(), ImageError> {
        let panel = self.panel;
        let row = match (self.colour, panel.packing) {
            (ColorType::Grayscale, Packing::Grey) | (ColorType::Rgb, Packing::Subpixels) => row,
            (ColorType::GrayscaleAlpha, Packing::Grey) => self.reduced::<2>(row, |p| p[1] == 255)?,
            (ColorType::Rgb, Packing::Grey) => self.reduced::<3>(row, grey)?,
            (ColorType::Rgba, Packing::Grey) => {
                self.reduced::<4>(row, |p| grey(&[p[0], p[1], p[2]]) && p[3] == 255)?
            }
            (ColorType::Rgba, Packing::Subpixels) => {
                self.buffer.clear();
                self.buffer.extend(row.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]));
                &self.buffer
            }
            (colour, _) => return Err(ImageError::Unsupported { colour: named(colour) }),
        };
        // A panel whose width is no multiple of three has a pixel or two too many in the picture;
        // the first frame of an animated PNG may have too few.
        let width = panel.width_px as usize;
        let Some(row) = row.get(..width) else {
            let [panel_width, panel_height] = panel.picture_px();
            let (width, height) = (row.len() as u32, panel_height);
            return Err(ImageError::WrongSize { width, height, panel_width, panel_height });
        };
        show(row);
        self.row += 1;
        Ok(())
    }

    /// Pixels of `N` bytes whose first is the brightness, where that is all that they say.
    fn reduced<const N: usize>(
        &mut self,
        row: &[u8],
        plain: impl Fn(&[u8; N]) -> bool,
    ) -> Result<&[u8], ImageError> {
        self.buffer.clear();
        for (column, pixel) in row.as_chunks::<N>().0.iter().enumerate() {
            if !plain(pixel) {
                let colour = named(self.colour);
                return Err(ImageError::Coloured { colour, column: column as u32, row: self.row });
            }
            self.buffer.push(pixel[0]);
        }
        Ok(&self.buffer)
    }
}

fn grey(p: &[u8; 3]) -> bool {
    p[0] == p[1] && p[1] == p[2]
}

fn named(colour: ColorType) -> &'static str {
    match colour {
        ColorType::Grayscale => "grey",
        ColorType::GrayscaleAlpha => "grey with transparency",
        ColorType::Rgb | ColorType::Indexed => "coloured (RGB)",
        ColorType::Rgba => "coloured with transparency (RGBA)",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::resin::testing::{grey, header, picture};
    use png::BitDepth;
    use proptest::prelude::*;

    const PANEL: Panel = Panel { width_px: 3, height_px: 2, packing: Packing::Grey };
    const SUBPIXELS: Panel = Panel { packing: Packing::Subpixels, ..PANEL };

    #[test]
    fn every_kind_of_grey_is_read() {
        use {BitDepth::*, ColorType::*};
        let check = |panel: Panel, png: Vec<u8>, expect: &[u8]| {
            assert_eq!(panel.image(&png).expect("read").pixels, expect);
        };
        let six = [0, 127, 128, 255, 1, 254];
        check(PANEL, grey(3, 2, &six), &six);
        check(PANEL, picture(3, 2, Grayscale, One, &[0b1010_0000, 0b0100_0000]), &[255, 0, 255, 0, 255, 0]);
        check(PANEL, picture(3, 2, Grayscale, Two, &[0b0001_1011, 0]), &[0, 85, 170, 0, 0, 0]);
        check(PANEL, picture(3, 2, Grayscale, Four, &[0x78, 0xf0, 0, 0]), &[119, 136, 255, 0, 0, 0]);
        let wide: Vec<u8> = six.iter().flat_map(|&b| [b, 77]).collect();
        check(PANEL, picture(3, 2, Grayscale, Sixteen, &wide), &six);
        let clear: Vec<u8> = six.iter().flat_map(|&b| [b, 255]).collect();
        check(PANEL, picture(3, 2, GrayscaleAlpha, Eight, &clear), &six);
        let rgb: Vec<u8> = six.iter().flat_map(|&b| [b; 3]).collect();
        check(PANEL, picture(3, 2, Rgb, Eight, &rgb), &six);
        let rgba: Vec<u8> = six.iter().flat_map(|&b| [b, b, b, 255]).collect();
        check(PANEL, picture(3, 2, Rgba, Eight, &rgba), &six);
        check(PANEL, picture(3, 2, Indexed, One, &[0b1010_0000, 0]), &[255, 0, 255, 0, 0, 0]);
        check(SUBPIXELS, picture(1, 2, Rgb, Eight, &six), &six);
        check(SUBPIXELS, picture(1, 2, Rgba, Eight, &[0, 127, 128, 9, 255, 1, 254, 9]), &six);
        // A panel of four pixels needs two of the picture: two of six are no pixels.
        let four = Panel { width_px: 4, height_px: 1, packing: Packing::Subpixels };
        check(four, picture(2, 1, Rgb, Eight, &six), &six[..4]);
    }

    #[test]
    fn what_cannot_be_read_says_why() {
        use {BitDepth::*, ColorType::*};
        let check = |panel: Panel, png: &[u8], words: &[&str]| {
            let said = panel.image(png).expect_err("refused").to_string();
            assert!(words.iter().all(|w| said.contains(w)), "{said}");
        };
        let good = grey(3, 2, &[0, 50, 100, 150, 200, 250]);
        check(PANEL, b"", &["cannot be read"]);
        check(PANEL, b"GIF89a", &["cannot be read"]);
        for cut in 8..good.len() - 12 {
            check(PANEL, &good[..cut], &["cannot be read"]);
        }
        check(PANEL, &grey(2, 2, &[0; 4]), &["2 × 2 px", "3 × 2"]);
        check(PANEL, &header(100_000, 100_000), &["100000 × 100000 px", "16384"]);
        check(PANEL, &header(1, u32::MAX), &["1 × 4294967295 px"]);
        check(PANEL, &header(3, 2), &["cannot be read"]);
        let large = Panel { width_px: 16_384, height_px: 1025, packing: Packing::Grey };
        check(large, &interlaced(16_384, 1025, &[]), &["interlaced", "16777216 px"]);
        let red: Vec<u8> = (0..18).map(|i| if i == 12 { 9 } else { 0 }).collect();
        check(PANEL, &picture(3, 2, Rgb, Eight, &red), &["RGB", "column 1, row 1"]);
        let ghost = picture(3, 2, GrayscaleAlpha, Eight, &[0; 12]);
        check(PANEL, &ghost, &["transparency", "column 0, row 0"]);
        check(SUBPIXELS, &grey(1, 2, &[0; 2]), &["picture is grey"]);
    }

    #[test]
    fn only_the_header_is_needed_for_the_size() {
        assert_eq!(size_px(&header(1440, 2560)).expect("a size"), [1440, 2560]);
        assert!(matches!(size_px(&header(16_385, 1)), Err(ImageError::TooLarge { .. })));
    }

    /// A picture that is interlaced (Adam7), of the passes' rows with their filters.
    fn interlaced(width: u32, height: u32, passes: &[u8]) -> Vec<u8> {
        let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::none());
        std::io::Write::write_all(&mut packed, passes).expect("packed");
        let packed = packed.finish().expect("packed");
        let mut png = header(width, height);
        let mut head = png.split_off(16);
        head.truncate(13);
        head[12] = 1;
        png.truncate(8);
        for (kind, bytes) in [(b"IHDR", &head[..]), (b"IDAT", &packed), (b"IEND", &[])] {
            let mut crc = flate2::Crc::new();
            crc.update(kind);
            crc.update(bytes);
            png.extend((bytes.len() as u32).to_be_bytes());
            png.extend(kind);
            png.extend(bytes);
            png.extend(crc.sum().to_be_bytes());
        }
        png
    }

    #[test]
    fn interlaced_pictures_are_read() {
        // Passes: 1 (0,0) · 4 (2,0) · 6 (1,0) · 7 row 1; the others are empty.
        let png = interlaced(3, 2, &[0, 10, 0, 12, 0, 11, 0, 20, 21, 22]);
        assert_eq!(PANEL.image(&png).expect("read").pixels, [10, 11, 12, 20, 21, 22]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn rows_come_back((width, height) in (1_u32..40, 1_u32..20), seed in any::<u32>()) {
            let pixels: Vec<u8> = (0..width * height).map(|i| (i ^ seed).wrapping_mul(0x9e37_79b1).to_le_bytes()[3]).collect();
            let panel = Panel { width_px: width, height_px: height, packing: Packing::Grey };
            let png = grey(width, height, &pixels);
            prop_assert_eq!(panel.image(&png).expect("read").pixels, pixels);
        }
    }
}
