//! Connected components of a set of pixels.

use super::mask::Mask;
use rustc_hash::FxHashMap;

/// A set of pixels that hang together by their edges (4-connected).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Pixels.
    pub pixels: u64,
    /// Sums of the pixels' columns and rows, each counted at the pixel's middle.
    pub sums: [f64; 2],
    /// Its first column and row.
    pub low: [u32; 2],
    /// The column and row behind its last.
    pub high: [u32; 2],
}

impl Piece {
    /// No pixel yet.
    pub(crate) const NONE: Piece = Piece { pixels: 0, sums: [0.0; 2], low: [u32::MAX; 2], high: [0; 2] };

    /// Adds a span of a row.
    pub(crate) fn add(&mut self, row: u32, [begin, end]: [u16; 2]) {
        let pixels = f64::from(end - begin);
        self.pixels += u64::from(end - begin);
        self.sums[0] += pixels * (f64::from(begin) + f64::from(end)) / 2.0;
        self.sums[1] += pixels * (f64::from(row) + 0.5);
        self.low = [self.low[0].min(u32::from(begin)), self.low[1].min(row)];
        self.high = [self.high[0].max(u32::from(end)), self.high[1].max(row + 1)];
    }

    /// Centre of gravity, in columns and rows.
    #[must_use]
    pub fn centroid(&self) -> [f64; 2] {
        self.sums.map(|sum| sum / self.pixels as f64)
    }
}

/// The pieces of a [`Mask`], in the order of their first pixels.
#[derive(Clone, Debug, Default)]
pub struct Pieces {
    /// The set itself.
    mask: Mask,
    list: Vec<Piece>,
    /// The piece of each span of the mask.
    of_span: Vec<u32>,
}

impl Pieces {
    /// The pieces of a set.
    #[must_use]
    pub fn of(mask: Mask) -> Pieces {
        let spans = mask.len();
        let mut parent: Vec<u32> = (0..spans as u32).collect();
        for row in 1..mask.height_px() {
            mask.meet_rows(row, &mask, row - 1, &mut |one, other, _| {
                join(&mut parent, one as u32, other as u32);
            });
        }
        let (mut list, mut of_span) = (Vec::<Piece>::new(), vec![0; spans]);
        for row in 0..mask.height_px() {
            for place in mask.places(row) {
                // The oldest span is its own root and comes first.
                let root = root(&mut parent, place as u32) as usize;
                if root == place {
                    of_span[place] = list.len() as u32;
                    list.push(Piece::NONE);
                } else {
                    of_span[place] = of_span[root];
                }
                list[of_span[place] as usize].add(row, mask.span(place));
            }
        }
        Pieces { mask, list, of_span }
    }

    /// The pieces.
    #[must_use]
    pub fn list(&self) -> &[Piece] {
        &self.list
    }

    /// How many pixels of each piece are in a set.
    #[must_use]
    pub fn pixels_in(&self, set: &Mask) -> Vec<u64> {
        let mut pixels = vec![0; self.list.len()];
        self.mask.meet(set, |place, _, shared| pixels[self.of_span[place] as usize] += u64::from(shared));
        pixels
    }

    /// The pieces' pixels that are in a subset of theirs, each span with the piece that it is of.
    #[must_use]
    pub fn labels(&self, subset: &Mask) -> Labels {
        let mut of_span = vec![0; subset.len()];
        self.mask.meet(subset, |place, of_subset, _| of_span[of_subset] = self.of_span[place]);
        Labels { mask: subset.clone(), of_span }
    }

    /// The pixels of one piece.
    #[must_use]
    pub fn only(&self, piece: u32) -> Mask {
        self.those(|one| one == piece)
    }

    /// The pixels of the pieces that are wanted.
    #[must_use]
    pub fn those(&self, wanted: impl Fn(u32) -> bool) -> Mask {
        self.mask.filtered(|place| wanted(self.of_span[place]))
    }

    /// The pixels of all pieces.
    #[must_use]
    pub fn mask(&self) -> &Mask {
        &self.mask
    }

    /// The pixels of one piece: rows, and the columns in them.
    #[must_use]
    pub fn rows(&self, piece: u32) -> Vec<(u32, [u16; 2])> {
        let Piece { low, high, .. } = self.list[piece as usize];
        let of_row = |row| {
            let own = self.mask.places(row).filter(|&place| self.of_span[place] == piece);
            own.map(move |place| (row, self.mask.span(place)))
        };
        (low[1]..high[1]).flat_map(of_row).collect()
    }
}

/// Pixels of pieces.
#[derive(Clone, Debug, Default)]
pub struct Labels {
    mask: Mask,
    /// The piece of each span of the mask.
    of_span: Vec<u32>,
}

impl Labels {
    /// Which pieces of two pictures share pixels, and how many: a piece of this one and one of the
    /// other, in order.
    #[must_use]
    pub fn shared(&self, other: &Labels) -> Vec<(u32, u32, u64)> {
        let mut shared: FxHashMap<(u32, u32), u64> = FxHashMap::default();
        self.mask.meet(&other.mask, |ours, theirs, pixels| {
            *shared.entry((self.of_span[ours], other.of_span[theirs])).or_default() += u64::from(pixels);
        });
        let mut list: Vec<_> = shared.into_iter().map(|((a, b), pixels)| (a, b, pixels)).collect();
        list.sort_unstable();
        list
    }
}

fn root(parent: &mut [u32], mut one: u32) -> u32 {
    while parent[one as usize] != one {
        let above = parent[parent[one as usize] as usize];
        parent[one as usize] = above;
        one = above;
    }
    one
}

/// Joins two; the older one, whose number is smaller, stays the root.
fn join(parent: &mut [u32], one: u32, other: u32) {
    let (one, other) = (root(parent, one), root(parent, other));
    parent[one.max(other) as usize] = one.min(other);
}

#[cfg(test)]
mod tests {
    use super::super::testing::{flood, grown, mask};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn pieces_are_what_a_flood_fills(a in grown(11, 7), b in grown(11, 7)) {
            let pieces = Pieces::of(mask(&a));
            let filled = flood(&a);
            prop_assert_eq!(pieces.list().len(), filled.len());
            for (k, (piece, pixels)) in pieces.list().iter().zip(&filled).enumerate() {
                prop_assert_eq!(piece.pixels, pixels.len() as u64);
                let of = |f: fn(&(u32, u32)) -> u32| pixels.iter().map(f).collect::<Vec<_>>();
                let (columns, rows) = (of(|p| p.0), of(|p| p.1));
                prop_assert_eq!(piece.low, [*columns.iter().min().unwrap(), *rows.iter().min().unwrap()]);
                prop_assert_eq!(piece.high, [columns.iter().max().unwrap() + 1, rows.iter().max().unwrap() + 1]);
                let mean = |of: &[u32]| of.iter().map(|&k| f64::from(k) + 0.5).sum::<f64>() / of.len() as f64;
                prop_assert!((piece.centroid()[0] - mean(&columns)).abs() < 1e-9);
                prop_assert!((piece.centroid()[1] - mean(&rows)).abs() < 1e-9);
                let mut only = vec![vec![false; 11]; 7];
                pixels.iter().for_each(|&(x, y)| only[y as usize][x as usize] = true);
                prop_assert_eq!(pieces.only(k as u32), mask(&only));
            }
            let holds = |pixels: &[(u32, u32)]| pixels.iter().filter(|p| b[p.1 as usize][p.0 as usize]).count() as u64;
            let expect: Vec<u64> = filled.iter().map(|pixels| holds(pixels)).collect();
            prop_assert_eq!(pieces.pixels_in(&mask(&b)), expect);
            let others = flood(&b);
            let mut expect = Vec::new();
            for (i, ours) in filled.iter().enumerate() {
                for (k, theirs) in others.iter().enumerate() {
                    let both = ours.iter().filter(|p| theirs.contains(p)).count() as u64;
                    if both > 0 {
                        expect.push((i as u32, k as u32, both));
                    }
                }
            }
            let whole = |bits: &[Vec<bool>]| Pieces::of(mask(bits)).labels(&mask(bits));
            prop_assert_eq!(whole(&a).shared(&whole(&b)), expect);
        }
    }
}
