//! GOO's run-length code: a picture as runs of one brightness.
//!
//! Takes the bytes between a layer's definition and its end, gives the picture's rows;
//! and the other way round. Source: Elegoo's "Goo Format Spec V1.2", image data: the
//! byte 0x55, runs, and the bitwise NOT of the sum of their bytes. The first byte of a
//! run holds its kind (bits 7 and 6), how many bytes its length has (5 and 4) and the
//! lowest four bits of that (3 to 0); the other bytes of the length follow, highest
//! first. Runs go on over the ends of rows. Where the specification is silent (a
//! length of 36 bits in one of its examples) it is read as UVtools does. Knows no file.

/// The first byte of a picture.
const MAGIC: u8 = 0x55;

/// Kinds of runs, in the upper two bits: dark, a brightness of its own in the next
/// byte, and full brightness. The fourth, 2, is the brightness before, plus or minus up
/// to 15.
const DARK: u8 = 0;
const OTHER: u8 = 1;
const FULL: u8 = 3;

/// Longest run: 28 bits.
const MAX_RUN: u64 = (1 << 28) - 1;

/// Why a picture's runs cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RunsError {
    /// It does not begin as a picture.
    #[error("it begins with {found:#04x} instead of {MAGIC:#04x}")]
    NoPicture {
        /// Its first byte; 0 where there is none.
        found: u8,
    },
    /// Its bytes are not those that were written.
    #[error("its bytes have the checksum {found:#04x}, it says {told:#04x}")]
    Checksum {
        /// Of its bytes.
        found: u8,
        /// What stands at its end.
        told: u8,
    },
    /// The last run is cut off.
    #[error("its last run is cut off")]
    CutOff,
    /// Other than as many pixels as the panel has.
    #[error("its runs hold {holds} px, the panel {wanted}")]
    Pixels {
        /// What the runs add up to, as far as they were read.
        holds: u64,
        /// Pixels of the panel.
        wanted: u64,
    },
}

/// Shows the rows of a picture from the top, each of `width` bytes.
///
/// A picture without a single pixel is dark: some programs write empty layers so.
///
/// # Errors
/// It is damaged, or not of as many pixels. Rows may have been shown by then.
pub fn rows(packed: &[u8], [width, height]: [u32; 2], mut show: impl FnMut(&[u8])) -> Result<(), RunsError> {
    let runs = payload(packed)?;
    let wanted = u64::from(width) * u64::from(height);
    let mut row = vec![0; width as usize];
    if width == 0 || Runs::of(runs).all(|run| run.is_ok_and(|(_, length)| length == 0)) {
        (0..height).for_each(|_| show(&row));
        return Ok(());
    }
    let (mut column, mut holds) = (0, 0);
    for run in Runs::of(runs) {
        let (brightness, length) = run?;
        holds += u64::from(length);
        if holds > wanted {
            return Err(RunsError::Pixels { holds, wanted });
        }
        let mut left = length as usize;
        while left > 0 {
            let some = left.min(row.len() - column);
            row[column..column + some].fill(brightness);
            (column, left) = (column + some, left - some);
            if column == row.len() {
                show(&row);
                column = 0;
            }
        }
    }
    if holds == wanted { Ok(()) } else { Err(RunsError::Pixels { holds, wanted }) }
}

/// The runs of a picture whose checksum is right.
fn payload(packed: &[u8]) -> Result<&[u8], RunsError> {
    let (found, rest) = packed.split_first().unwrap_or((&0, &[]));
    if *found != MAGIC {
        return Err(RunsError::NoPicture { found: *found });
    }
    let (told, runs) = rest.split_last().ok_or(RunsError::CutOff)?;
    let found = checksum(runs);
    if found == *told { Ok(runs) } else { Err(RunsError::Checksum { found, told: *told }) }
}

fn checksum(runs: &[u8]) -> u8 {
    !runs.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte))
}

/// Brightness and length of each run.
struct Runs<'a> {
    rest: &'a [u8],
    brightness: u8,
}

impl Runs<'_> {
    fn of(rest: &[u8]) -> Runs<'_> {
        Runs { rest, brightness: 0 }
    }

    fn byte(&mut self) -> Result<u8, RunsError> {
        let (byte, rest) = self.rest.split_first().ok_or(RunsError::CutOff)?;
        self.rest = rest;
        Ok(*byte)
    }

    fn run(&mut self, first: u8) -> Result<(u8, u32), RunsError> {
        let (kind, form, low) = (first >> 6, first >> 4 & 3, first & 15);
        match kind {
            DARK => self.brightness = 0,
            OTHER => self.brightness = self.byte()?,
            FULL => self.brightness = u8::MAX,
            _ => {
                let [long, down] = [form & 1 != 0, form & 2 != 0];
                let before = self.brightness;
                self.brightness = if down { before.wrapping_sub(low) } else { before.wrapping_add(low) };
                let length = if long { self.byte()? } else { 1 };
                return Ok((self.brightness, length.into()));
            }
        }
        let mut high = 0;
        for _ in 0..form {
            high = high << 8 | u32::from(self.byte()?);
        }
        Ok((self.brightness, high << 4 | u32::from(low)))
    }
}

impl Iterator for Runs<'_> {
    type Item = Result<(u8, u32), RunsError>;

    fn next(&mut self) -> Option<Self::Item> {
        let first = self.byte().ok()?;
        let run = self.run(first);
        if run.is_err() {
            self.rest = &[];
        }
        Some(run)
    }
}

/// Packs a picture, row by row.
///
/// Runs of the fourth kind are not written: they save a byte where brightness changes
/// little, and not every printer's firmware reads them.
#[derive(Debug)]
pub struct Packer {
    bytes: Vec<u8>,
    brightness: u8,
    length: u64,
}

impl Default for Packer {
    fn default() -> Packer {
        Packer::new()
    }
}

impl Packer {
    /// A picture of no pixel yet.
    #[must_use]
    pub fn new() -> Packer {
        Packer { bytes: vec![MAGIC], brightness: 0, length: 0 }
    }

    /// Takes the next pixels: a row, or many.
    pub fn row(&mut self, mut pixels: &[u8]) {
        while let Some(&first) = pixels.first() {
            if first != self.brightness {
                self.end_run();
                self.brightness = first;
            }
            let (same, later) = pixels.split_at(alike(pixels, first));
            self.length += same.len() as u64;
            pixels = later;
        }
    }

    /// The whole picture: magic, runs, checksum.
    #[must_use]
    pub fn finish(mut self) -> Vec<u8> {
        self.end_run();
        self.bytes.push(checksum(&self.bytes[1..]));
        self.bytes
    }

    fn end_run(&mut self) {
        while self.length > 0 {
            let some = self.length.min(MAX_RUN);
            self.length -= some;
            self.write(some as u32);
        }
    }

    fn write(&mut self, length: u32) {
        let kind = match self.brightness {
            0 => DARK,
            u8::MAX => FULL,
            _ => OTHER,
        };
        let high = (length >> 4).to_be_bytes();
        // Bytes of the length besides the lowest four bits.
        let form = match length {
            0..=0xf => 0,
            0x10..=0xfff => 1,
            0x1000..=0xf_ffff => 2,
            _ => 3,
        };
        self.bytes.push(kind << 6 | form << 4 | (length & 15) as u8);
        if kind == OTHER {
            self.bytes.push(self.brightness);
        }
        self.bytes.extend(&high[4 - usize::from(form)..]);
    }
}

/// How many pixels from the first on have this brightness.
fn alike(pixels: &[u8], brightness: u8) -> usize {
    let word = u64::from_le_bytes([brightness; 8]);
    let (words, _) = pixels.as_chunks::<8>();
    for (i, chunk) in words.iter().enumerate() {
        let differs = u64::from_le_bytes(*chunk) ^ word;
        if differs != 0 {
            return 8 * i + differs.trailing_zeros() as usize / 8;
        }
    }
    let from = 8 * words.len();
    from + pixels[from..].iter().take_while(|&&pixel| pixel == brightness).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(packed: &[u8], size: [u32; 2]) -> Result<Vec<u8>, RunsError> {
        let mut pixels = Vec::new();
        rows(packed, size, |row| {
            assert_eq!(row.len(), size[0] as usize);
            pixels.extend_from_slice(row);
        })?;
        Ok(pixels)
    }

    fn packed(pixels: &[u8]) -> Vec<u8> {
        let mut packer = Packer::new();
        packer.row(pixels);
        packer.finish()
    }

    /// A picture of some runs, its frame right.
    fn framed(runs: &[u8]) -> Vec<u8> {
        let sum = !runs.iter().fold(0_u8, |sum, b| sum.wrapping_add(*b));
        [&[0x55], runs, &[sum]].concat()
    }

    #[test]
    fn the_specifications_runs_are_read() {
        let check = |runs: &[u8], expect: &[(u8, u32)]| {
            let found: Result<Vec<(u8, u32)>, RunsError> = Runs::of(runs).collect();
            assert_eq!(found.as_deref(), Ok(expect), "{runs:02x?}");
        };
        check(&[0x3f, 0x55, 0x56, 0x57], &[(0, 0x555_657f)]);
        check(&[0x75, 0xaa, 0xbb, 0xcc, 0x15], &[(0xaa, 0xbbc_c155)]);
        check(&[0x05], &[(0, 5)]);
        check(&[0xf1, 0xcc, 0xbb, 0xaa], &[(255, 0xccb_baa1)]);
        check(&[0xe2, 0x12, 0x34], &[(255, 0x1_2342)]);
        check(&[0xd3, 0x02], &[(255, 0x23)]);
        check(&[0x81], &[(1, 1)]);
        check(&[0x41, 100, 0x92, 0xff, 0xa1, 0xb2, 0xee], &[(100, 1), (102, 255), (101, 1), (99, 0xee)]);
        check(&[0xc1, 0x81, 0xa2], &[(255, 1), (0, 1), (254, 1)]);
    }

    #[test]
    fn what_is_wrong_is_told() {
        let check = |bytes: &[u8], size, expect: RunsError| assert_eq!(read(bytes, size), Err(expect));
        check(&[], [2, 2], RunsError::NoPicture { found: 0 });
        check(&[7, 4, 251], [2, 2], RunsError::NoPicture { found: 7 });
        check(&[0x55], [2, 2], RunsError::CutOff);
        check(&[0x55, 4, 250], [2, 2], RunsError::Checksum { found: 251, told: 250 });
        check(&framed(&[3]), [2, 2], RunsError::Pixels { holds: 3, wanted: 4 });
        check(&framed(&[3, 2]), [2, 2], RunsError::Pixels { holds: 5, wanted: 4 });
        check(&framed(&[4, 0x41]), [2, 2], RunsError::CutOff);
        check(&framed(&[4, 0x30, 1, 1]), [2, 2], RunsError::CutOff);
        check(&framed(&[4, 0x91]), [2, 2], RunsError::CutOff);
        // A bomb: 268 million pixels in four bytes end at the panel's size.
        let bomb = framed(&[0xff; 400]);
        check(&bomb, [2, 2], RunsError::Pixels { holds: MAX_RUN, wanted: 4 });
    }

    #[test]
    fn an_empty_picture_is_dark() {
        for bytes in [&framed(&[])[..], &framed(&[0]), &framed(&[0xc0])] {
            assert_eq!(read(bytes, [2, 2]), Ok(vec![0; 4]));
        }
    }

    #[test]
    fn runs_are_as_short_as_they_can_be() {
        let check = |brightness: u8, length: usize, expect: &[u8]| {
            assert_eq!(packed(&vec![brightness; length]), framed(expect), "{brightness} × {length}");
        };
        check(0, 15, &[0x0f]);
        check(0, 16, &[0x10, 0x01]);
        check(255, 0xfff, &[0xdf, 0xff]);
        check(255, 0x1000, &[0xe0, 0x01, 0x00]);
        check(7, 0xf_ffff, &[0x6f, 7, 0xff, 0xff]);
        check(7, 0x10_0000, &[0x70, 7, 0x01, 0x00, 0x00]);
        // The largest picture that is read has one pixel more than the longest run.
        let mut packer = Packer::new();
        (0..1 << 14).for_each(|_| packer.row(&[9; 1 << 14]));
        assert_eq!(packer.finish(), framed(&[0x7f, 9, 0xff, 0xff, 0xff, 0x41, 9]));
    }

    proptest! {
        #[test]
        fn what_is_packed_is_read_back(
            runs in prop::collection::vec((prop::sample::select(vec![0, 1, 127, 128, 254, 255]), 1_usize..5000), 1..40),
            width in 1_u32..300,
        ) {
            let mut pixels: Vec<u8> = runs.iter().flat_map(|&(b, n)| std::iter::repeat_n(b, n)).collect();
            pixels.resize(pixels.len().next_multiple_of(width as usize), 3);
            let height = pixels.len() as u32 / width;
            let read = read(&packed(&pixels), [width, height]);
            prop_assert_eq!(read.as_ref(), Ok(&pixels));
            // The same bytes however the rows come.
            let mut packer = Packer::new();
            pixels.chunks(7).for_each(|some| packer.row(some));
            prop_assert_eq!(packer.finish(), packed(&pixels));
        }

        #[test]
        fn any_runs_are_read_or_refused(
            runs in prop::collection::vec(any::<u8>(), 0..60),
            width in 1_u32..40,
            height in 1_u32..40,
        ) {
            if let Ok(pixels) = read(&framed(&runs), [width, height]) {
                prop_assert_eq!(read(&packed(&pixels), [width, height]), Ok(pixels));
            }
            let _ = read(&runs, [width, height]);
        }
    }
}
