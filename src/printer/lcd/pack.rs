//! One row of the panel into one row of the display.
//!
//! Takes brightness, a byte a pixel, gives the display's bytes. Knows neither rows above nor below;
//! what the bytes are stands at [`Depth`] and [`Pixels`].
use super::LcdError;
use super::layout::{Depth, Format, Layout, Order, Pixels};

/// Steps of a brightness in so few bits.
const FIVE: [u16; 256] = steps(31);
const SIX: [u16; 256] = steps(63);

/// What a display of 32 bits has beside the colours.
const OPAQUE: u8 = 255;

/// Each brightness as the nearest of the steps 0 to `most`.
const fn steps(most: u16) -> [u16; 256] {
    let mut steps = [0; 256];
    let mut brightness = 0;
    while brightness < 256 {
        // Fits: 255 × 63 + 127 < 65,536. A constant cannot be made with `for`.
        steps[brightness] = (brightness as u16 * most + 127) / 255;
        brightness += 1;
    }
    steps
}

/// The bytes of a 16-bit pixel.
fn word([red, green, blue]: [u8; 3]) -> [u8; 2] {
    let [red, green, blue] = [red, green, blue].map(usize::from);
    (FIVE[red] << 11 | SIX[green] << 5 | FIVE[blue]).to_le_bytes()
}

/// Packs the rows of one layout for one format, which fit.
#[derive(Clone, Copy, Debug)]
pub(super) struct Packer {
    layout: Layout,
    format: Format,
}

impl Packer {
    /// # Errors
    /// As [`Layout::fits`].
    pub(super) fn new(layout: Layout, format: Format) -> Result<Packer, LcdError> {
        layout.fits(format)?;
        Ok(Packer { layout, format })
    }

    pub(super) fn layout(&self) -> Layout {
        self.layout
    }

    pub(super) fn format(&self) -> Format {
        self.format
    }

    /// Packs a row of the panel, from its left, into the beginning of a display's row;
    /// what lies behind its pixels stays as it is.
    pub(super) fn row(&self, row: &[u8], to: &mut [u8]) {
        match (self.layout.pixels, self.format.depth) {
            (Pixels::Grey, Depth::Eight) => copy(row, to),
            (Pixels::Grey, Depth::Sixteen) => each(row, to, |v| word([v; 3])),
            (Pixels::Grey, Depth::TwentyFour) => each(row, to, |v| [v; 3]),
            (Pixels::Grey, Depth::ThirtyTwo) => each(row, to, |v| [v, v, v, OPAQUE]),
            // Memory has blue first, so that these are the bytes as they are.
            (Pixels::Packed { order: Order::Bgr }, Depth::TwentyFour) => {
                let end = row.len().next_multiple_of(3).min(to.len());
                to[row.len().min(end)..end].fill(0);
                copy(row, to);
            }
            (Pixels::Packed { order }, depth) => threes(row, to, order, depth),
        }
    }

    /// A display's row that is dark.
    pub(super) fn dark(&self) -> Vec<u8> {
        let mut dark = vec![0; self.format.stride_bytes as usize];
        self.row(&vec![0; self.layout.width_px as usize], &mut dark);
        dark
    }
}

fn copy(row: &[u8], to: &mut [u8]) {
    to.iter_mut().zip(row).for_each(|(to, v)| *to = *v);
}

/// Each pixel of the panel is one of the display.
fn each<const N: usize>(row: &[u8], to: &mut [u8], pixel: impl Fn(u8) -> [u8; N]) {
    let (to, _) = to.as_chunks_mut();
    to.iter_mut().zip(row).for_each(|(to, v)| *to = pixel(*v));
}

/// Three pixels of the panel are one of the display.
fn threes(row: &[u8], to: &mut [u8], order: Order, depth: Depth) {
    match (depth, order) {
        // Refused before; nothing is written rather than something wrong.
        (Depth::Eight, _) => {}
        (Depth::Sixteen, Order::Rgb) => each_three(row, to, word),
        (Depth::Sixteen, Order::Bgr) => each_three(row, to, |[b, g, r]| word([r, g, b])),
        (Depth::TwentyFour, Order::Rgb) => each_three(row, to, |[r, g, b]| [b, g, r]),
        (Depth::TwentyFour, Order::Bgr) => each_three(row, to, |bgr| bgr),
        (Depth::ThirtyTwo, Order::Rgb) => each_three(row, to, |[r, g, b]| [b, g, r, OPAQUE]),
        (Depth::ThirtyTwo, Order::Bgr) => each_three(row, to, |[b, g, r]| [b, g, r, OPAQUE]),
    }
}

fn each_three<const N: usize>(row: &[u8], to: &mut [u8], pixel: impl Fn([u8; 3]) -> [u8; N]) {
    let (whole, rest) = row.as_chunks::<3>();
    let (to, _) = to.as_chunks_mut();
    to.iter_mut().zip(whole).for_each(|(to, three)| *to = pixel(*three));
    if let (false, Some(to)) = (rest.is_empty(), to.get_mut(whole.len())) {
        let mut last = [0; 3];
        copy(rest, &mut last);
        *to = pixel(last);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_are_as_linux_has_them() {
        let check = |pixels, depth: Depth, row: &[u8], expect: &[u8]| {
            let layout = Layout { width_px: row.len() as u32, height_px: 1, pixels };
            let [width_px, height_px] = layout.display_px();
            let format = Format { width_px, height_px, stride_bytes: width_px * depth.bytes() + 1, depth };
            let mut to = vec![7; format.stride_bytes as usize];
            Packer::new(layout, format).unwrap().row(row, &mut to);
            assert_eq!(to, [expect, &[7]].concat(), "{pixels:?} {depth:?} {row:?}");
        };
        let rgb = Pixels::Packed { order: Order::Rgb };
        let bgr = Pixels::Packed { order: Order::Bgr };
        check(Pixels::Grey, Depth::Eight, &[0, 9, 255], &[0, 9, 255]);
        check(Pixels::Grey, Depth::Sixteen, &[0, 255], &[0, 0, 255, 255]);
        check(Pixels::Grey, Depth::TwentyFour, &[9, 255], &[9, 9, 9, 255, 255, 255]);
        check(Pixels::Grey, Depth::ThirtyTwo, &[0, 9], &[0, 0, 0, 255, 9, 9, 9, 255]);
        check(rgb, Depth::Sixteen, &[255, 0, 0, 0, 255, 0, 0, 0, 255], &[0, 0xf8, 0xe0, 7, 0x1f, 0]);
        check(bgr, Depth::Sixteen, &[255, 0, 0, 0, 255], &[0x1f, 0, 0xe0, 7]);
        check(rgb, Depth::TwentyFour, &[1, 2, 3, 4, 5, 6, 7], &[3, 2, 1, 6, 5, 4, 0, 0, 7]);
        check(bgr, Depth::TwentyFour, &[1, 2, 3, 4, 5, 6, 7], &[1, 2, 3, 4, 5, 6, 7, 0, 0]);
        check(rgb, Depth::ThirtyTwo, &[1, 2, 3, 4, 5], &[3, 2, 1, 255, 0, 5, 4, 255]);
        check(bgr, Depth::ThirtyTwo, &[1, 2, 3, 4], &[1, 2, 3, 255, 4, 0, 0, 255]);
    }

    #[test]
    fn a_brightness_becomes_the_nearest_step() {
        for (steps, most) in [(FIVE, 31), (SIX, 63)] {
            for (brightness, &step) in steps.iter().enumerate() {
                let off = (i32::from(step) * 255 - brightness as i32 * most).abs();
                assert!(2 * off <= 255, "{brightness} of 255 is {step} of {most}");
            }
            assert_eq!([steps[0], steps[255]], [0, most as u16]);
        }
    }
}
