//! Overhangs: pieces of a layer that reach out too far over the layer below.
//!
//! What is bright (128 and more) in a layer and not in the one below it overhangs. A piece of that is
//! told where something is left of it after 40 erosions with a cross: where a pixel has no other one
//! within 40 steps along rows and columns that is held or dark. The panel's edge does not erode. The
//! whole piece is told, not what is left of it.
//!
//! Source: UVtools' overhang detection, its name and defaults. It takes the difference of brightness
//! over 127; here each layer is first said to be bright or not, which is the same but at pixels that are
//! grey in both layers.
use crate::layers::raster::{Level, Mask, Piece, Pieces, Raster};

/// Erosions that a piece must outlast.
pub const EROSIONS: u32 = 40;

/// The overhangs of a layer.
#[must_use]
pub fn overhangs(layer: &Raster, below: &Raster) -> Vec<Piece> {
    overhangs_after(layer, below, EROSIONS)
}

fn overhangs_after(layer: &Raster, below: &Raster, erosions: u32) -> Vec<Piece> {
    let pieces = Pieces::of(layer.mask(Level::Bright).without(&below.mask(Level::Bright)));
    let size = [layer.width_px(), layer.height_px()];
    let all = pieces.list().iter().zip(0..);
    let long = all.filter(|(piece, _)| is_long(piece, size, erosions));
    long.filter(|(_, k)| outlasts(pieces.only(*k), erosions)).map(|(piece, _)| *piece).collect()
}

/// Whether a piece is long enough both ways to outlast erosions at all.
fn is_long(piece: &Piece, size: [u32; 2], erosions: u32) -> bool {
    (0..2).all(|axis| {
        let ends = u32::from(piece.low[axis] > 0) + u32::from(piece.high[axis] < size[axis]);
        piece.high[axis] - piece.low[axis] > ends * erosions
    })
}

fn outlasts(mut mask: Mask, erosions: u32) -> bool {
    for _ in 0..erosions {
        mask = mask.eroded();
        if mask.is_empty() {
            return false;
        }
    }
    !mask.is_empty()
}

#[cfg(test)]
mod tests {
    use super::super::reference::{self, Grey, grey};
    use super::*;
    use proptest::prelude::*;

    /// A rectangle of a panel of 300 × 200 px.
    fn rectangle(x: usize, y: usize, width: usize, height: usize) -> Grey {
        let mut rows = vec![vec![0; 300]; 200];
        for row in rows.iter_mut().skip(y).take(height) {
            row[x..x + width].fill(255);
        }
        rows
    }

    #[test]
    fn forty_erosions_are_outlasted_from_81_pixels_on() {
        let nothing = vec![vec![0; 300]; 200];
        let check = |layer: &Grey, below: &Grey, expect: &[u64]| {
            let found = overhangs(&reference::raster(layer), &reference::raster(below));
            assert_eq!(found.iter().map(|p| p.pixels).collect::<Vec<_>>(), expect);
        };
        check(&rectangle(50, 50, 81, 81), &nothing, &[81 * 81]);
        check(&rectangle(50, 50, 80, 120), &nothing, &[]);
        check(&rectangle(50, 50, 200, 80), &nothing, &[]);
        // The panel's edges do not erode.
        check(&rectangle(0, 0, 41, 41), &nothing, &[41 * 41]);
        check(&rectangle(0, 50, 41, 81), &nothing, &[41 * 81]);
        check(&rectangle(0, 50, 40, 81), &nothing, &[]);
        check(&rectangle(0, 0, 300, 200), &nothing, &[300 * 200]);
        // What is held below does not overhang.
        check(&rectangle(50, 50, 121, 81), &rectangle(50, 50, 40, 81), &[81 * 81]);
        check(&rectangle(50, 50, 120, 81), &rectangle(50, 50, 40, 81), &[]);
    }

    proptest! {
        #[test]
        fn they_are_those_of_the_slow_way(below in grey(14, 9), layer in grey(14, 9), erosions in 0_u32..4) {
            let found = overhangs_after(&reference::raster(&layer), &reference::raster(&below), erosions);
            let found: Vec<u64> = found.iter().map(|p| p.pixels).collect();
            prop_assert_eq!(found, reference::overhangs(&layer, &below, erosions));
        }
    }
}
