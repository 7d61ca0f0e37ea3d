//! Pictures pixel by pixel, for tests: slow and plain.
use super::mask::Mask;
use super::{Level, Raster};
use proptest::prelude::*;

/// A raster of rows of brightness.
pub(crate) fn of(rows: &[&[u8]]) -> Raster {
    let mut raster = Raster::new(rows[0].len() as u32);
    for row in rows {
        raster.row(row).expect("a small picture");
    }
    raster
}

/// The set of pixels that are true.
pub(crate) fn mask(bits: &[Vec<bool>]) -> Mask {
    let rows: Vec<Vec<u8>> =
        bits.iter().map(|row| row.iter().map(|&bit| if bit { 255 } else { 0 }).collect()).collect();
    of(&rows.iter().map(|row| &row[..]).collect::<Vec<_>>()).mask(Level::Bright)
}

/// Pixel by pixel; the picture is as wide as its inverse.
pub(crate) fn bits(mask: &Mask) -> Vec<Vec<bool>> {
    let inverse = mask.inverse();
    (0..mask.height_px())
        .map(|row| {
            let ends = [mask, &inverse].map(|m| m.spans(row).last().map_or(0, |span| span[1]));
            let mut bits = vec![false; usize::from(ends[0].max(ends[1]))];
            for &[begin, end] in mask.spans(row) {
                bits[usize::from(begin)..usize::from(end)].fill(true);
            }
            bits
        })
        .collect()
}

/// The connected components, column and row of each pixel, in the order of their first pixels.
pub(crate) fn flood(bits: &[Vec<bool>]) -> Vec<Vec<(u32, u32)>> {
    let mut left = bits.to_vec();
    let mut found = Vec::new();
    for row in 0..bits.len() {
        for column in 0..bits[row].len() {
            if !left[row][column] {
                continue;
            }
            let (mut piece, mut next) = (Vec::new(), vec![(column, row)]);
            while let Some((x, y)) = next.pop() {
                let Some(bit) = left.get_mut(y).and_then(|row| row.get_mut(x)).filter(|bit| **bit) else {
                    continue;
                };
                *bit = false;
                piece.push((x as u32, y as u32));
                next.extend([(x + 1, y), (x, y + 1), (x.wrapping_sub(1), y), (x, y.wrapping_sub(1))]);
            }
            found.push(piece);
        }
    }
    found
}

/// Any set of pixels, often in larger spots.
pub(crate) fn grown(width: usize, height: usize) -> impl Strategy<Value = Vec<Vec<bool>>> {
    let rectangle = (0..width, 0..height, 1..=width, 1..=height, any::<bool>());
    prop::collection::vec(rectangle, 0..8).prop_map(move |rectangles| {
        let mut bits = vec![vec![false; width]; height];
        for (x, y, w, h, on) in rectangles {
            for row in bits.iter_mut().skip(y).take(h) {
                row.iter_mut().skip(x).take(w).for_each(|bit| *bit = on);
            }
        }
        bits
    })
}
