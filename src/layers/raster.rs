//! A resin job's picture as runs of brightness, and sets of its pixels.
//!
//! Takes rows of brightness, gives a [`Raster`]: as much of the picture as the checks ask for, in the
//! memory of its edges. [`Mask`] is a set of pixels, [`Pieces`] its connected components. All that is
//! done with them takes time and memory by their runs, not by the pixels. Pixels are counted from the
//! picture's left and top. Knows no format of pictures and no millimetre.
mod mask;
mod pieces;
#[cfg(test)]
pub(crate) mod testing;

pub use mask::Mask;
pub use pieces::{Labels, Piece, Pieces};

/// Most runs of one picture: as many as the polygons of a picture may have corners
/// ([`super::from_images`]). Only noise and dithering have more.
pub const MAX_RUNS: usize = 1 << 22;

/// Brightness that the checks ask for, of 255. A pixel that has one has all before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// 1: not black.
    Lit,
    /// 10: counts as printed when islands are looked for.
    Counts,
    /// 31: resin does not drain through it.
    Dams,
    /// 100: a wall around resin.
    Walls,
    /// 127: printed, at the panel's margin.
    Margin,
    /// 128: printed.
    Bright,
    /// 150: holds what is printed over it.
    Holds,
}

impl Level {
    const ALL: [Level; 7] =
        [Level::Lit, Level::Counts, Level::Dams, Level::Walls, Level::Margin, Level::Bright, Level::Holds];

    /// The darkest brightness that has it.
    #[must_use]
    pub const fn brightness(self) -> u8 {
        match self {
            Level::Lit => 1,
            Level::Counts => 10,
            Level::Dams => 31,
            Level::Walls => 100,
            Level::Margin => 127,
            Level::Bright => 128,
            Level::Holds => 150,
        }
    }
}

/// How many levels each brightness has.
const LEVELS: [u8; 256] = {
    let mut levels = [0; 256];
    let mut brightness = 0;
    while brightness < 256 {
        let mut k = 0;
        while k < Level::ALL.len() {
            if brightness >= Level::ALL[k].brightness() as usize {
                levels[brightness] += 1;
            }
            k += 1;
        }
        brightness += 1;
    }
    levels
};

/// Pixels that are compared at once.
const BLOCK: usize = 32;

/// Pixels of a row that have as many levels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Run {
    begin: u16,
    end: u16,
    levels: u8,
}

/// A picture, as far as its pixels' [`Level`]s tell it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Raster {
    width_px: u32,
    /// Where the runs of each row begin, and where those of the last end.
    rows: Vec<u32>,
    runs: Vec<Run>,
}

/// A picture has more than [`MAX_RUNS`] runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooFine;

impl Raster {
    /// A picture without rows, `width_px` wide.
    ///
    /// # Panics
    /// It is wider than 65,535 px; the largest panels have 15,360.
    #[must_use]
    pub fn new(width_px: u32) -> Raster {
        assert!(u16::try_from(width_px).is_ok(), "{width_px} px");
        Raster { width_px, rows: vec![0], runs: Vec::new() }
    }

    /// Takes the next row from the top: `width_px` bytes of brightness.
    ///
    /// # Errors
    /// The picture is too fine.
    pub fn row(&mut self, row: &[u8]) -> Result<(), TooFine> {
        let first = self.runs.len();
        let mut at = 0;
        while let Some(&brightness) = row.get(at) {
            let end = at + alike(&row[at..], brightness);
            let levels = LEVELS[usize::from(brightness)];
            let goes_on = |run: &&mut Run| run.levels == levels && usize::from(run.end) == at;
            if let Some(last) = self.runs[first..].last_mut().filter(goes_on) {
                last.end = end as u16;
            } else if levels > 0 {
                if self.runs.len() >= MAX_RUNS {
                    return Err(TooFine);
                }
                self.runs.push(Run { begin: at as u16, end: end as u16, levels });
            }
            at = end;
        }
        self.rows.push(self.runs.len() as u32);
        Ok(())
    }

    /// Pixels along a row.
    #[must_use]
    pub fn width_px(&self) -> u32 {
        self.width_px
    }

    /// Rows.
    #[must_use]
    pub fn height_px(&self) -> u32 {
        self.rows.len().saturating_sub(1) as u32
    }

    /// Runs of brightness that it is kept as, 6 bytes each.
    #[must_use]
    pub fn runs(&self) -> usize {
        self.runs.len()
    }

    /// Whether it is black all over.
    #[must_use]
    pub fn is_black(&self) -> bool {
        self.runs.is_empty()
    }

    /// The pixels that have a level.
    #[must_use]
    pub fn mask(&self, level: Level) -> Mask {
        let least = level as u8 + 1;
        let mut mask = Mask::new(self.width_px);
        for row in self.rows.windows(2) {
            let runs = &self.runs[row[0] as usize..row[1] as usize];
            mask.row(runs.iter().filter(|run| run.levels >= least).map(|run| [run.begin, run.end]));
        }
        mask
    }
}

/// How many pixels from the first on have that brightness.
fn alike(row: &[u8], brightness: u8) -> usize {
    let (blocks, _) = row.as_chunks::<BLOCK>();
    let same = |block: &&[u8; BLOCK]| block.iter().fold(0, |any, &pixel| any | (pixel ^ brightness)) == 0;
    let whole = blocks.iter().take_while(same).count() * BLOCK;
    whole + row[whole..].iter().take_while(|&&pixel| pixel == brightness).count()
}

#[cfg(test)]
mod tests {
    use super::testing::{bits, of};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_level_begins_at_its_brightness() {
        for level in Level::ALL {
            let raster = of(&[&[0, level.brightness() - 1, level.brightness(), 255]]);
            assert_eq!(bits(&raster.mask(level)), [[false, false, true, true]], "{level:?}");
        }
        assert!(of(&[&[0, 0], &[0, 0]]).is_black() && !of(&[&[0, 1]]).is_black());
    }

    #[test]
    fn noise_is_refused() {
        let mut raster = Raster::new(16_384);
        let noise: Vec<u8> = (0..16_384).map(|x| (x % 2 * 255) as u8).collect();
        let rows = (0..10_000).take_while(|_| raster.row(&noise).is_ok()).count();
        assert_eq!(rows, MAX_RUNS / 8192);
    }

    proptest! {
        #[test]
        fn masks_say_what_pixels_say(
            rows in prop::collection::vec(
                prop::collection::vec((any::<u8>(), prop_oneof![1..4_usize, 1..100_usize]), 1..6), 1..5),
        ) {
            let rows: Vec<Vec<u8>> = rows
                .into_iter()
                .map(|runs| {
                    let mut row: Vec<u8> =
                        runs.into_iter().flat_map(|(b, n)| std::iter::repeat_n(b, n)).collect();
                    row.resize(300, 0);
                    row
                })
                .collect();
            let raster = of(&rows.iter().map(|row| &row[..]).collect::<Vec<_>>());
            for level in Level::ALL {
                let expect: Vec<Vec<bool>> =
                    rows.iter().map(|row| row.iter().map(|&b| b >= level.brightness()).collect()).collect();
                prop_assert_eq!(bits(&raster.mask(level)), expect);
            }
        }
    }
}
