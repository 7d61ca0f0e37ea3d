//! How the pixels of a monochrome panel lie in the bytes that a display takes.
//!
//! The panel hangs on a display output made for colours (HDMI, MIPI, SPI). Its maker either leaves
//! it at that ([`Pixels::Grey`]), or takes the three channels of each display pixel for three
//! pixels of the panel ([`Pixels::Packed`]), as a 2560 × 1440 panel does that says of itself that
//! it has 854 × 1440.
//!
//! Gives sizes and refuses what cannot be. Does not know the bytes: that is `pack`.
use super::LcdError;

/// Most pixels along a side. The largest panels sold have 15,360 × 8,640.
pub const MAX_SIDE_PX: u32 = 16_384;

/// A display may leave so much room after each row: a page of memory, or up to a power of
/// two of the row, and nothing like the rest of the machine's memory.
const MAX_PADDING_BYTES: u32 = 65_536;

/// The panel, and how its pixels lie in the display's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Pixels of the panel along a row, 1 to [`MAX_SIDE_PX`].
    pub width_px: u32,
    /// Rows of the panel, 1 to [`MAX_SIDE_PX`].
    pub height_px: u32,
    /// Which of them are a pixel of the display.
    pub pixels: Pixels,
}

/// Which pixels of the panel are a pixel of the display.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pixels {
    /// Each is one of its own, with equal red, green and blue.
    Grey,
    /// Three neighbours along a row are the red, green and blue of one. Where the panel's
    /// width is no multiple of three, the channels left over at the right end are dark.
    ///
    /// A display of 16 bits has 5, 6 and 5 for them: each brightness becomes the nearest
    /// of 32, 64 and 32 steps, so that 0 stays dark and 255 stays full, and a pixel is off
    /// by half a step at most; cutting the lower bits off would be off by up to a whole one,
    /// and always to the dark side.
    Packed {
        /// Which neighbour is which channel.
        order: Order,
    },
}

/// Which of three neighbours is which channel, from the left.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Red, green, blue: as NanoDLP packs its pictures for such panels.
    Rgb,
    /// Blue, green, red.
    Bgr,
}

/// The size of a display and of its rows in memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// Display pixels along a row.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Bytes from the beginning of a row to that of the next.
    pub stride_bytes: u32,
    /// Bits of a pixel.
    pub depth: Depth,
}

/// How a display's pixel lies in memory, as Linux has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Depth {
    /// A byte of brightness.
    Eight,
    /// A little-endian word: from the top 5 bits of red, 6 of green, 5 of blue.
    Sixteen,
    /// Three bytes: blue, green, red.
    TwentyFour,
    /// Four bytes: blue, green, red, and 255, which is opaque where a display asks for that.
    ThirtyTwo,
}

impl Depth {
    /// The depth of so many bits a pixel; `None` of others.
    #[must_use]
    pub fn of_bits(bits: u32) -> Option<Depth> {
        match bits {
            8 => Some(Depth::Eight),
            16 => Some(Depth::Sixteen),
            24 => Some(Depth::TwentyFour),
            32 => Some(Depth::ThirtyTwo),
            _ => None,
        }
    }

    /// Bytes of a pixel.
    #[must_use]
    pub fn bytes(self) -> u32 {
        match self {
            Depth::Eight => 1,
            Depth::Sixteen => 2,
            Depth::TwentyFour => 3,
            Depth::ThirtyTwo => 4,
        }
    }
}

impl Layout {
    /// Pixels along a row and rows that the display must have.
    #[must_use]
    pub fn display_px(self) -> [u32; 2] {
        match self.pixels {
            Pixels::Grey => [self.width_px, self.height_px],
            Pixels::Packed { .. } => [self.width_px.div_ceil(3), self.height_px],
        }
    }

    /// The same panel with a byte a pixel and no room between the rows.
    #[must_use]
    pub fn plain(self) -> (Layout, Format) {
        let Layout { width_px, height_px, .. } = self;
        let format = Format { width_px, height_px, stride_bytes: width_px, depth: Depth::Eight };
        (Layout { pixels: Pixels::Grey, ..self }, format)
    }

    /// Whether the panel can be.
    ///
    /// # Errors
    /// [`LcdError::Panel`].
    pub fn checked(self) -> Result<Layout, LcdError> {
        let Layout { width_px: width, height_px: height, .. } = self;
        let sides = 1..=MAX_SIDE_PX;
        if sides.contains(&width) && sides.contains(&height) {
            Ok(self)
        } else {
            Err(LcdError::Panel { width, height })
        }
    }

    /// Whether the panel can be, and a display of this format shows it.
    ///
    /// # Errors
    /// [`LcdError::Panel`], [`LcdError::Size`], [`LcdError::NoColours`], [`LcdError::Stride`].
    pub fn fits(self, format: Format) -> Result<(), LcdError> {
        let [needs_width, needs_height] = self.checked()?.display_px();
        let Format { width_px: width, height_px: height, stride_bytes: stride, depth } = format;
        if [width, height] != [needs_width, needs_height] {
            return Err(LcdError::Size { width, height, needs_width, needs_height });
        }
        if depth == Depth::Eight && self.pixels != Pixels::Grey {
            return Err(LcdError::NoColours);
        }
        let least = width * depth.bytes();
        let most = least + MAX_PADDING_BYTES;
        if (least..=most).contains(&stride) { Ok(()) } else { Err(LcdError::Stride { stride, least, most }) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PACKED: Pixels = Pixels::Packed { order: Order::Rgb };

    fn layout(width_px: u32, height_px: u32, pixels: Pixels) -> Layout {
        Layout { width_px, height_px, pixels }
    }

    #[test]
    fn three_neighbours_are_one_pixel_of_the_display() {
        let check = |width, pixels, expect| {
            assert_eq!(layout(width, 7, pixels).display_px(), [expect, 7], "{width} {pixels:?}");
        };
        check(2560, Pixels::Grey, 2560);
        check(2560, PACKED, 854);
        check(3, PACKED, 1);
        check(1, PACKED, 1);
        check(MAX_SIDE_PX, PACKED, 5462);
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let check = |layout: Layout, [width, height, stride]: [u32; 3], depth, expect: &str| {
            let format = Format { width_px: width, height_px: height, stride_bytes: stride, depth };
            let got = layout.fits(format).map_or_else(|e| e.to_string(), |()| "fits".to_owned());
            assert!(got.contains(expect), "{layout:?} {format:?}: {got}");
        };
        let grey = |width, height| layout(width, height, Pixels::Grey);
        check(grey(4, 2), [4, 2, 4], Depth::Eight, "fits");
        check(grey(4, 2), [4, 2, 16], Depth::ThirtyTwo, "fits");
        check(grey(4, 2), [4, 2, 15], Depth::ThirtyTwo, "rows of 15 bytes");
        check(grey(4, 2), [4, 2, 16 + MAX_PADDING_BYTES], Depth::ThirtyTwo, "fits");
        check(grey(4, 2), [4, 2, u32::MAX], Depth::ThirtyTwo, "65552 at most");
        check(grey(4, 2), [2, 4, 8], Depth::ThirtyTwo, "has 2 × 4 px, the panel needs 4 × 2");
        check(grey(0, 2), [0, 2, 0], Depth::Eight, "0 × 2 px");
        check(grey(4, 16_385), [4, 16_385, 4], Depth::Eight, "4 × 16385 px");
        check(grey(u32::MAX, 1), [u32::MAX, 1, 4], Depth::ThirtyTwo, "must have 1 to 16384");
        check(layout(4, 2, PACKED), [2, 2, 4], Depth::Sixteen, "fits");
        check(layout(4, 2, PACKED), [2, 2, 2], Depth::Eight, "no colours");
        check(layout(4, 2, PACKED), [4, 2, 16], Depth::ThirtyTwo, "needs 2 × 2");
    }

    #[test]
    fn depths_are_told_by_their_bits() {
        for bits in 0..=64 {
            let depth = Depth::of_bits(bits);
            assert_eq!(depth.map(|d| 8 * d.bytes()), [8, 16, 24, 32].contains(&bits).then_some(bits));
        }
    }
}
