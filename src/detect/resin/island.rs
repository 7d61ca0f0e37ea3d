//! Islands: pieces of a layer that too little of the layer below holds.
//!
//! A piece is 4-connected pixels of brightness 10 and more. It is held where the layer below has
//! brightness 150 and more: by a quarter of its pixels at least, and by one. Where it is not, it is an
//! island; the layer above it then stands on it, so that each island is told once, at its lowest layer.
//!
//! Source: UVtools' island detection, its names and defaults.
use crate::layers::raster::{Level, Piece, Pieces, Raster};

/// Of so many pixels of a piece one must be held.
const ONE_HELD_OF: u64 = 4;

/// The islands of a layer.
#[must_use]
pub fn islands(layer: &Raster, below: &Raster) -> Vec<Piece> {
    let pieces = Pieces::of(layer.mask(Level::Counts));
    let held = pieces.pixels_in(&below.mask(Level::Holds));
    let pairs = pieces.list().iter().zip(held);
    pairs.filter(|(piece, held)| !is_held(piece.pixels, *held)).map(|(piece, _)| *piece).collect()
}

/// Whether enough pixels of a piece are held.
pub(super) fn is_held(pixels: u64, held: u64) -> bool {
    held > 0 && held * ONE_HELD_OF >= pixels
}

#[cfg(test)]
mod tests {
    use super::super::reference::{self, grey};
    use super::*;
    use crate::layers::raster::testing::of;
    use proptest::prelude::*;

    #[test]
    fn a_quarter_must_be_held() {
        let check = |below: [u8; 8], layer: [u8; 8], expect: &[u64]| {
            let found: Vec<u64> = islands(&of(&[&layer]), &of(&[&below])).iter().map(|p| p.pixels).collect();
            assert_eq!(found, expect, "{layer:?} over {below:?}");
        };
        check([0; 8], [0; 8], &[]);
        check([0; 8], [9; 8], &[]);
        check([0; 8], [10; 8], &[8]);
        check([149; 8], [255; 8], &[8]);
        check([150, 0, 0, 0, 0, 0, 0, 0], [255; 8], &[8]);
        check([150, 150, 0, 0, 0, 0, 0, 0], [255; 8], &[]);
        check([255, 0, 0, 0, 0, 0, 0, 0], [255, 0, 255, 255, 0, 0, 0, 10], &[2, 1]);
    }

    proptest! {
        #[test]
        fn they_are_those_of_the_slow_way(below in grey(12, 8), layer in grey(12, 8)) {
            let found: Vec<u64> = islands(&reference::raster(&layer), &reference::raster(&below)).iter().map(|p| p.pixels).collect();
            prop_assert_eq!(found, reference::islands(&layer, &below));
        }
    }
}
