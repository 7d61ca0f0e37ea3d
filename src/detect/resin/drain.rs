//! Where a hollow would drain: the shortest way out of it through the wall, in one layer.
//!
//! Takes a layer's picture, the box of a hollow ([`super::voids`]) and the size of a pixel; gives the
//! middle of a pixel in the hollow and of one outside, as near to each other as any. Through this way a
//! hole would be cut; nobody cuts it here.
use crate::layers::raster::{Level, Pieces, Raster};

/// Rows of a hollow at most whose ways are measured: of larger ones every second, third … row is.
const MAX_ROWS: usize = 512;

/// A way through the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Way {
    /// In the hollow, column and row.
    pub from_px: [f64; 2],
    /// Outside.
    pub to_px: [f64; 2],
    /// From the one to the other, mm.
    pub length_mm: f64,
}

/// The shortest way out of the largest closed hollow within a box of a layer; none where it has none, or
/// nothing is outside.
#[must_use]
pub fn shortest_way(picture: &Raster, box_px: [[u32; 2]; 2], pixel_mm: [f64; 2]) -> Option<Way> {
    let hollows = Pieces::of(picture.mask(Level::Walls).inverse());
    let size = [picture.width_px(), picture.height_px()];
    let [low, high] = box_px;
    let closed = |k: u32| {
        let piece = &hollows.list()[k as usize];
        (0..2).all(|axis| piece.low[axis] > 0 && piece.high[axis] < size[axis])
    };
    let within = |k: &u32| {
        let piece = &hollows.list()[*k as usize];
        (0..2).all(|axis| piece.low[axis] >= low[axis] && piece.high[axis] <= high[axis])
    };
    let all = 0..hollows.list().len() as u32;
    let own = all.filter(|&k| closed(k)).filter(within).max_by_key(|&k| hollows.list()[k as usize].pixels)?;
    let outside = hollows.those(|k| !closed(k));
    let rows = hollows.rows(own);
    let mut best: Option<Way> = None;
    for &(row, span) in rows.iter().step_by(rows.len().div_ceil(MAX_ROWS)) {
        // Rows farther and farther away, until they alone are farther than the best way.
        for away in 0..size[1] {
            let least_mm = f64::from(away) * pixel_mm[1];
            if best.is_some_and(|way| way.length_mm <= least_mm) || (away > row && row + away >= size[1]) {
                break;
            }
            let others = [row.checked_sub(away), Some(row + away).filter(|&other| other < size[1])];
            for other in others.into_iter().flatten() {
                for &[begin, end] in outside.spans(other) {
                    let [from, to] = nearest(span, [begin, end]);
                    let length_mm = (f64::from(from.abs_diff(to)) * pixel_mm[0]).hypot(least_mm);
                    if best.is_none_or(|way| length_mm < way.length_mm) {
                        let middle = |column: u16, row: u32| [f64::from(column) + 0.5, f64::from(row) + 0.5];
                        best = Some(Way { from_px: middle(from, row), to_px: middle(to, other), length_mm });
                    }
                }
            }
        }
    }
    best
}

/// The columns of two spans that are nearest to each other.
fn nearest([begin, end]: [u16; 2], [other_begin, other_end]: [u16; 2]) -> [u16; 2] {
    let column = begin.max(other_begin).min(end - 1);
    let other = column.clamp(other_begin, other_end - 1);
    [other.clamp(begin, end - 1), other]
}

#[cfg(test)]
mod tests {
    use super::super::reference::{Grey, grey, raster};
    use super::*;
    use crate::layers::raster::testing::flood;
    use proptest::prelude::*;

    /// A block of 20 × 14 px with a hollow, on a panel of 30 × 20 px.
    fn block(hollow: [usize; 4]) -> Grey {
        let mut rows = vec![vec![0; 30]; 20];
        rows[3..17].iter_mut().for_each(|row| row[5..25].fill(255));
        let [x, y, width, height] = hollow;
        rows[y..y + height].iter_mut().for_each(|row| row[x..x + width].fill(0));
        rows
    }

    #[test]
    fn the_thinnest_wall_is_found() {
        let check = |hollow: [usize; 4], pixel_mm: [f64; 2], expect: Option<f64>| {
            let [x, y, width, height] = hollow.map(|px| px as u32);
            let found = shortest_way(&raster(&block(hollow)), [[x, y], [x + width, y + height]], pixel_mm);
            assert_eq!(found.map(|way| way.length_mm), expect, "{hollow:?}: {found:?}");
        };
        // Three pixels of wall to the left, so four from middle to middle.
        check([8, 8, 6, 4], [1.0, 1.0], Some(4.0));
        check([12, 5, 6, 4], [1.0, 1.0], Some(3.0));
        // Pixels that are wide make the wall above the nearer one.
        check([8, 8, 6, 4], [2.0, 1.0], Some(6.0));
        check([17, 8, 6, 4], [1.0, 1.0], Some(3.0));
        check([0, 0, 0, 0], [1.0, 1.0], None);
        // A hollow that is open needs none.
        check([2, 8, 10, 4], [1.0, 1.0], None);
    }

    proptest! {
        #[test]
        fn no_pixel_outside_is_nearer(picture in grey(14, 10)) {
            let hollows = flood(&picture.iter().map(|row| row.iter().map(|&p| p < 100).collect()).collect::<Vec<_>>());
            let open = |piece: &[(u32, u32)]| piece.iter().any(|p| p.0 == 0 || p.1 == 0 || p.0 == 13 || p.1 == 9);
            let found = shortest_way(&raster(&picture), [[0, 0], [14, 10]], [1.0, 1.5]);
            let largest = hollows.iter().filter(|piece| !open(piece)).map(Vec::len).max();
            let ways = hollows.iter().filter(|piece| !open(piece) && Some(piece.len()) == largest).map(|own| {
                let outside = hollows.iter().filter(|piece| open(piece)).flatten();
                let length = |a: &(u32, u32), b: &(u32, u32)| {
                    f64::from(a.0.abs_diff(b.0)).hypot(f64::from(a.1.abs_diff(b.1)) * 1.5)
                };
                outside.flat_map(|b| own.iter().map(move |a| length(a, b))).min_by(f64::total_cmp)
            });
            let expect: Vec<Option<f64>> = ways.collect();
            match found {
                Some(way) => prop_assert!(expect.iter().flatten().any(|mm| (mm - way.length_mm).abs() < 1e-9), "{expect:?} {way:?}"),
                None => prop_assert!(expect.iter().all(Option::is_none)),
            }
        }
    }
}
