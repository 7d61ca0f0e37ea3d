//! Rows of a picture into a frame.
//!
//! Takes rows of brightness from the top, one at a time, and gives a [`Frame`] that needs only
//! to be shown. Each row is packed and summed up as it comes, so that a picture costs the
//! memory of its frame and of one row. Where the sink is a folder, the file is written ahead here
//! as well.
use super::folder::Ahead;
use super::layout::{Format, Layout};
use super::pack::Packer;
use super::sum::Sum;
use super::{Frame, LcdError};

/// Frames kept to be used again: the one shown, the next, and two on their way between threads.
const MAX_SPARES: usize = 4;

/// Makes frames for one sink, one after the other.
///
/// A picture is [`Painter::row`] for each of its rows and [`Painter::finish`].
#[derive(Debug)]
pub struct Painter {
    packer: Packer,
    ahead: Option<Ahead>,
    /// The display's bytes, as many as a frame has from the first row on.
    bytes: Vec<u8>,
    /// Rows that came.
    rows: u32,
    /// A row was refused.
    broken: bool,
    sum: Sum,
    spares: Vec<Vec<u8>>,
}

impl Painter {
    /// For a display of this format. A sink's own is [`super::Sink::painter`].
    ///
    /// # Errors
    /// As [`Layout::fits`].
    pub fn new(layout: Layout, format: Format) -> Result<Painter, LcdError> {
        Ok(Painter::with(Packer::new(layout, format)?, None))
    }

    pub(super) fn with(packer: Packer, ahead: Option<Ahead>) -> Painter {
        Painter {
            packer,
            ahead,
            bytes: Vec::new(),
            rows: 0,
            broken: false,
            sum: Sum::new(),
            spares: Vec::new(),
        }
    }

    /// Takes the next row from the top, a byte a pixel: 0 is dark, 255 is full.
    ///
    /// # Errors
    /// It has not as many pixels as the panel ([`LcdError::RowLength`]), or the panel has all its
    /// rows already ([`LcdError::RowCount`]). The picture cannot be finished then.
    pub fn row(&mut self, row: &[u8]) -> Result<(), LcdError> {
        let Layout { width_px, height_px, .. } = self.packer.layout();
        if row.len() != width_px as usize {
            self.broken = true;
            return Err(LcdError::RowLength { row: self.rows, got: row.len(), wanted: width_px });
        }
        if self.rows >= height_px {
            self.broken = true;
            return Err(LcdError::RowCount { got: self.rows + 1, wanted: height_px });
        }
        self.sum.row(row);
        let place = self.rows as usize;
        self.rows += 1;
        let stride = self.packer.format().stride_bytes as usize;
        if self.bytes.is_empty() {
            // A spare's rows are all written again, and behind them it is as empty as a new one's.
            let fresh = || vec![0; stride * height_px as usize];
            self.bytes = self.spares.pop().unwrap_or_else(fresh);
        }
        if let Some(to) = self.bytes.chunks_exact_mut(stride).nth(place) {
            self.packer.row(row, to);
        }
        Ok(())
    }

    /// The frame of the rows that came; the next row begins another picture, whatever comes out.
    ///
    /// # Errors
    /// Rows are missing ([`LcdError::RowCount`]), one was refused ([`LcdError::Broken`]), or
    /// the file cannot be written ahead ([`LcdError::Io`]).
    pub fn finish(&mut self) -> Result<Frame, LcdError> {
        let (layout, format) = (self.packer.layout(), self.packer.format());
        let (rows, broken, sum) = (self.rows, self.broken, self.sum.finish());
        if broken || rows != layout.height_px {
            self.discard();
            let wanted = layout.height_px;
            return Err(if broken { LcdError::Broken } else { LcdError::RowCount { got: rows, wanted } });
        }
        let staged = match self.ahead.as_ref().map(|ahead| ahead.write(&self.bytes, format)) {
            None => None,
            Some(Ok(staged)) => Some(staged),
            Some(Err(error)) => {
                self.discard();
                return Err(error);
            }
        };
        let bytes = std::mem::take(&mut self.bytes);
        self.begin();
        Ok(Frame { layout, format, bytes, sum, staged })
    }

    /// Forgets the rows that came: the picture could not be read to its end.
    pub fn discard(&mut self) {
        let bytes = std::mem::take(&mut self.bytes);
        self.keep(bytes);
        self.begin();
    }

    /// Takes a frame's memory to use it again. A frame of another sink is let go.
    pub fn take_back(&mut self, frame: Frame) {
        if frame.is_of(self.packer.layout(), self.packer.format()) {
            self.keep(frame.bytes);
        }
    }

    fn keep(&mut self, bytes: Vec<u8>) {
        if !bytes.is_empty() && self.spares.len() < MAX_SPARES {
            self.spares.push(bytes);
        }
    }

    fn begin(&mut self) {
        (self.rows, self.broken, self.sum) = (0, false, Sum::new());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::printer::lcd::layout::{Depth, Order, Pixels};
    use proptest::prelude::*;

    /// The brightness that a frame's bytes have at a place of the panel, and the most that it can be
    /// from what was given, each times 63 × 31 × 255: told from the bytes alone, a bit at a time.
    fn at(frame: &Frame, [x, y]: [usize; 2]) -> (u64, u64) {
        let (layout, format) = (frame.layout, frame.format);
        let bits = 8 * format.depth.bytes() as usize;
        let (pixel, channel) = match layout.pixels {
            Pixels::Grey => (x, "red"),
            Pixels::Packed { order: Order::Rgb } => (x / 3, ["red", "green", "blue"][x % 3]),
            Pixels::Packed { order: Order::Bgr } => (x / 3, ["blue", "green", "red"][x % 3]),
        };
        let first = y * format.stride_bytes as usize * 8 + pixel * bits;
        let (low, number) = match (format.depth, channel) {
            (Depth::Eight, _) => (0, 8),
            (Depth::Sixteen, "blue") => (0, 5),
            (Depth::Sixteen, "green") => (5, 6),
            (Depth::Sixteen, _) => (11, 5),
            (_, "blue") => (0, 8),
            (_, "green") => (8, 8),
            (_, _) => (16, 8),
        };
        let bit = |i: usize| u64::from(frame.bytes[i / 8] >> (i % 8) & 1);
        let value: u64 = (0..number).map(|k| bit(first + low + k) << k).sum();
        let most = (1 << number) - 1;
        let scale = 63 * 31 * 255 * 255;
        (value * scale / most, if number == 8 { 0 } else { scale / most / 2 })
    }

    fn layouts() -> impl Strategy<Value = (Layout, Format)> {
        let pixels = prop_oneof![
            Just(Pixels::Grey),
            Just(Pixels::Packed { order: Order::Rgb }),
            Just(Pixels::Packed { order: Order::Bgr }),
        ];
        let depth = prop_oneof![
            Just(Depth::Eight),
            Just(Depth::Sixteen),
            Just(Depth::TwentyFour),
            Just(Depth::ThirtyTwo),
        ];
        let panel = (1_u32..20, 1_u32..6, pixels);
        (panel, depth, 0_u32..5).prop_filter_map("no colours", |(panel, depth, padding)| {
            let (width_px, height_px, pixels) = panel;
            let layout = Layout { width_px, height_px, pixels };
            let [width_px, height_px] = layout.display_px();
            let stride_bytes = width_px * depth.bytes() + padding;
            let format = Format { width_px, height_px, stride_bytes, depth };
            layout.fits(format).ok().map(|()| (layout, format))
        })
    }

    fn painted(painter: &mut Painter, picture: &[u8]) -> Frame {
        let width = painter.packer.layout().width_px as usize;
        picture.chunks_exact(width).for_each(|row| painter.row(row).expect("a row"));
        painter.finish().expect("a frame")
    }

    proptest! {
        #[test]
        fn every_pixel_is_where_and_what_it_shall_be(
            (layout, format) in layouts(),
            pixels in proptest::collection::vec(any::<u8>(), 20 * 6),
        ) {
            let (width, height) = (layout.width_px as usize, layout.height_px as usize);
            let picture = &pixels[..width * height];
            let mut painter = Painter::new(layout, format).unwrap();
            let frame = painted(&mut painter, picture);
            for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                let (got, off) = at(&frame, [x, y]);
                let given = u64::from(picture[y * width + x]) * 63 * 31 * 255;
                prop_assert!(got.abs_diff(given) <= off, "{x}, {y} of {layout:?} {format:?}");
            }
            // What is no pixel of the panel is dark, and memory used again makes no difference.
            let drawn = (format.width_px * format.depth.bytes()) as usize;
            for row in frame.bytes.chunks_exact(format.stride_bytes as usize) {
                prop_assert!(row[drawn..].iter().all(|v| *v == 0));
            }
            if layout.pixels != Pixels::Grey {
                for (x, y) in (width..width.next_multiple_of(3)).zip(std::iter::repeat(0)) {
                    prop_assert_eq!(at(&frame, [x, y]).0, 0);
                }
            }
            let bytes = frame.bytes.clone();
            let sum = frame.sum();
            painter.take_back(frame);
            let inverse: Vec<u8> = picture.iter().map(|v| !v).collect();
            let other = painted(&mut painter, &inverse);
            prop_assert_ne!(other.sum(), sum);
            painter.take_back(other);
            let again = painted(&mut painter, picture);
            prop_assert_eq!(again.bytes(), bytes);
            prop_assert_eq!(again.sum(), sum);
        }
    }

    const LAYOUT: Layout = Layout { width_px: 3, height_px: 2, pixels: Pixels::Grey };

    #[test]
    fn the_sum_is_that_of_the_picture_as_given() {
        let mut sum = Sum::new();
        [[1, 2, 3], [4, 5, 6]].iter().for_each(|row| sum.row(row));
        let mut painter = Painter::new(LAYOUT, LAYOUT.plain().1).unwrap();
        let frame = painted(&mut painter, &[1, 2, 3, 4, 5, 6]);
        assert_eq!((frame.bytes(), frame.sum()), (&[1, 2, 3, 4, 5, 6][..], sum.finish()));
    }

    #[test]
    fn a_picture_of_another_size_is_refused_and_the_next_is_not() {
        let check = |rows: &[usize], expect: [&str; 2]| {
            let mut painter = Painter::new(LAYOUT, LAYOUT.plain().1).unwrap();
            let refused: Vec<String> = (rows.iter())
                .filter_map(|length| painter.row(&vec![9; *length]).err())
                .map(|e| e.to_string())
                .collect();
            assert_eq!(refused.join("; "), expect[0]);
            assert_eq!(painter.finish().expect_err("refused").to_string(), expect[1]);
            let frame = painted(&mut painter, &[1, 2, 3, 4, 5, 6]);
            assert_eq!(frame.bytes(), [1, 2, 3, 4, 5, 6]);
        };
        let broken = "the picture was broken off by a wrong row: this is a mistake in the program";
        check(&[], ["", "the picture has 0 rows, the panel 2"]);
        check(&[3], ["", "the picture has 1 rows, the panel 2"]);
        check(&[3, 3, 3], ["the picture has 3 or more rows, the panel 2", broken]);
        check(&[3, 2], ["row 1 of the picture has 2 px, the panel 3", broken]);
        check(&[4, 3, 3], ["row 0 of the picture has 4 px, the panel 3", broken]);
    }

    #[test]
    fn a_frame_of_another_size_is_not_used_again() {
        let small = Layout { height_px: 1, ..LAYOUT };
        let frame = painted(&mut Painter::new(small, small.plain().1).unwrap(), &[1, 2, 3]);
        let mut painter = Painter::new(LAYOUT, LAYOUT.plain().1).unwrap();
        painter.take_back(frame);
        assert_eq!(painted(&mut painter, &[1, 2, 3, 4, 5, 6]).bytes().len(), 6);
    }
}
