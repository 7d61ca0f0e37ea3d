//! What lies at the panel's margin: cut off there, or shown dimly by the panel's edge.
//!
//! Source: UVtools' "touching bounds", its margin and brightness.
use crate::layers::raster::{Level, Piece, Raster};

/// The margin, px.
pub const MARGIN_PX: u32 = 5;

/// What of a layer is brighter than 126 within the margin, as one piece.
#[must_use]
pub fn touching(layer: &Raster) -> Option<Piece> {
    let mask = layer.mask(Level::Margin);
    let (width, height) = (layer.width_px() as u16, layer.height_px());
    let margin = MARGIN_PX as u16;
    let mut found = Piece::NONE;
    for row in 0..height {
        let whole = row < MARGIN_PX || row + MARGIN_PX >= height;
        for &[begin, end] in mask.spans(row) {
            if whole || width <= 2 * margin {
                found.add(row, [begin, end]);
                continue;
            }
            for [begin, end] in [[begin, end.min(margin)], [begin.max(width - margin), end]] {
                if begin < end {
                    found.add(row, [begin, end]);
                }
            }
        }
    }
    (found.pixels > 0).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::super::reference::{self, grey};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_margin_is_five_pixels_wide() {
        let check = |x: usize, y: usize, brightness: u8, expect: bool| {
            let mut rows = vec![vec![0; 20]; 15];
            rows[y][x] = brightness;
            assert_eq!(touching(&reference::raster(&rows)).is_some(), expect, "{x} {y} {brightness}");
        };
        check(4, 7, 127, true);
        check(4, 7, 126, false);
        check(5, 5, 255, false);
        check(14, 9, 255, false);
        check(15, 9, 255, true);
        check(14, 10, 255, true);
        check(10, 4, 255, true);
    }

    proptest! {
        #[test]
        fn it_is_what_the_slow_way_finds(layer in (6..16_usize, 6..16_usize).prop_flat_map(|(w, h)| grey(w, h))) {
            let found = touching(&reference::raster(&layer)).map_or(0, |piece| piece.pixels);
            prop_assert_eq!(found, reference::margin(&layer));
        }
    }
}
