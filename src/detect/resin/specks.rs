//! Specks: islands of a resin job that stay small, and can be left out rather than supported.
//!
//! Takes the layers' pictures from the plate up and the largest area of a speck; gives the pixels of all
//! of them. A speck begins with a piece under which nothing is exposed, and goes on with pieces that lie
//! over it and over nothing else. It ends where nothing lies over it, or where what does lies over
//! something else as well. It is kept where one of its pieces is larger than that area, and where what
//! lies over it would be an island without it. Pieces are 4-connected pixels that are not black, so that
//! nothing of a speck stays as a fringe.
//!
//! Memory: the rows of the specks that were found, [`MAX_ROWS`] at the most; what comes after that is kept.
use super::island::is_held;
use crate::layers::raster::{Level, Mask, Pieces, Raster};
use std::collections::BTreeMap;

/// Most spans of rows that are kept for all specks together: 48 MB.
pub const MAX_ROWS: usize = 4 << 20;

/// A row of pixels: the row, the first column, and the one behind the last.
pub type Row = (u32, [u16; 2]);

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// The pixels of all specks, by layer.
    pub rows: BTreeMap<u32, Vec<Row>>,
    /// Specks.
    pub specks: u64,
    /// Their pixels in all layers.
    pub pixels: u64,
}

/// Specks on their way up.
#[derive(Debug)]
pub struct Specks {
    max_pixels: u64,
    found: Found,
    rows_left: usize,
    /// The last layer.
    below: Option<Below>,
    /// Those that go on: a forest of sets that met.
    sets: Vec<Set>,
}

#[derive(Debug)]
struct Below {
    pieces: Pieces,
    /// The set of each piece; none: it is no speck.
    sets: Vec<Option<u32>>,
    /// What holds, but for specks.
    holds: Mask,
}

#[derive(Debug, Default)]
struct Set {
    parent: u32,
    kept: bool,
    rows: Vec<(u32, Row)>,
    pixels: u64,
    /// The last layer that it has a piece in.
    layer: u32,
}

impl Specks {
    /// Specks whose pieces have no more pixels than that.
    #[must_use]
    pub fn new(max_pixels: u64) -> Specks {
        Specks { max_pixels, found: Found::default(), rows_left: MAX_ROWS, below: None, sets: Vec::new() }
    }

    /// Takes the next layer, from 0 at the plate.
    pub fn push(&mut self, layer: u32, picture: &Raster) {
        let pieces = Pieces::of(picture.mask(Level::Lit));
        let mut sets = vec![None; pieces.list().len()];
        if let Some(below) = self.below.take() {
            let counts = Pieces::of(picture.mask(Level::Counts));
            let held = counts.pixels_in(&below.holds);
            let loose = counts.those(|one| !is_held(counts.list()[one as usize].pixels, held[one as usize]));
            let loose = pieces.pixels_in(&loose);
            self.follow(layer, &pieces, &below, &loose, &mut sets);
        }
        self.bury(layer, &mut sets);
        let of_speck = pieces.those(|piece| sets[piece as usize].is_some());
        let holds = picture.mask(Level::Holds).without(&of_speck);
        self.below = Some(Below { pieces, sets, holds });
    }

    /// The layers are over.
    #[must_use]
    pub fn finish(mut self) -> Found {
        for set in std::mem::take(&mut self.sets) {
            self.found.add(set);
        }
        self.found
    }

    /// Says of each piece whether it is a speck's, by what it lies over. `loose`: pixels of each that would
    /// be islands without the specks below.
    fn follow(
        &mut self,
        layer: u32,
        pieces: &Pieces,
        below: &Below,
        loose: &[u64],
        sets: &mut [Option<u32>],
    ) {
        let whole = below.pieces.labels(below.pieces.mask());
        // What each piece lies over: sets, and whether anything else.
        let mut over: Vec<(Vec<u32>, bool)> = vec![(Vec::new(), false); sets.len()];
        for (piece, lower, _) in pieces.labels(pieces.mask()).shared(&whole) {
            let (on_sets, on_else) = &mut over[piece as usize];
            match below.sets[lower as usize]
                .map(|set| self.root(set))
                .filter(|&set| !self.sets[set as usize].kept)
            {
                Some(set) => on_sets.push(set),
                None => *on_else = true,
            }
        }
        for (k, (piece, (on_sets, on_else))) in pieces.list().iter().zip(&over).enumerate() {
            let small = piece.pixels <= self.max_pixels;
            // Another piece may have joined or kept them meanwhile.
            let on_sets: Vec<u32> = on_sets.iter().map(|&set| self.root(set)).collect();
            let on_kept = on_sets.iter().any(|&set| self.sets[set as usize].kept);
            if *on_else || on_kept || !small {
                // It stays, and so must what it needs.
                if !(*on_else && loose[k] == 0) {
                    on_sets.iter().for_each(|&set| self.sets[set as usize].kept = true);
                }
                continue;
            }
            let set = self.joined(&on_sets);
            sets[k] = self.grow(set, layer, pieces, k as u32, piece.pixels);
        }
    }

    /// One set of several; a new one of none.
    fn joined(&mut self, sets: &[u32]) -> u32 {
        let Some((&first, others)) = sets.split_first() else {
            let own = self.sets.len() as u32;
            self.sets.push(Set { parent: own, ..Set::default() });
            return own;
        };
        for &other in others {
            let (into, from) = (self.root(first), self.root(other));
            if into != from {
                let Set { kept, rows, pixels, layer, .. } = std::mem::take(&mut self.sets[from as usize]);
                self.sets[from as usize].parent = into;
                let joined = &mut self.sets[into as usize];
                joined.kept |= kept;
                joined.rows.extend(rows);
                joined.pixels += pixels;
                joined.layer = joined.layer.max(layer);
            }
        }
        self.root(first)
    }

    /// Adds a piece to a set, if there is room; none: the set is kept.
    fn grow(&mut self, set: u32, layer: u32, pieces: &Pieces, piece: u32, pixels: u64) -> Option<u32> {
        let rows = pieces.rows(piece);
        let grown = &mut self.sets[set as usize];
        if rows.len() > self.rows_left {
            grown.kept = true;
            return None;
        }
        self.rows_left -= rows.len();
        grown.rows.extend(rows.into_iter().map(|row| (layer, row)));
        grown.pixels += pixels;
        grown.layer = layer;
        Some(set)
    }

    fn root(&self, mut set: u32) -> u32 {
        while self.sets[set as usize].parent != set {
            set = self.sets[set as usize].parent;
        }
        set
    }

    /// Sets without a piece in this layer are over; the others are numbered anew. Kept ones are forgotten:
    /// their pieces are like any other.
    fn bury(&mut self, layer: u32, sets: &mut [Option<u32>]) {
        let roots: Vec<u32> = (0..self.sets.len() as u32).map(|set| self.root(set)).collect();
        let mut number = vec![None; self.sets.len()];
        let mut alive = Vec::new();
        for (k, set) in std::mem::take(&mut self.sets).into_iter().enumerate() {
            if set.parent as usize != k {
                continue;
            }
            if set.kept || set.layer != layer {
                self.rows_left += if set.kept { set.rows.len() } else { 0 };
                self.found.add(set);
            } else {
                number[k] = Some(alive.len() as u32);
                alive.push(Set { parent: alive.len() as u32, ..set });
            }
        }
        for set in sets {
            *set = set.and_then(|set| number[roots[set as usize] as usize]);
        }
        self.sets = alive;
    }
}

impl Found {
    /// Adds a speck that is over, unless it is kept.
    fn add(&mut self, set: Set) {
        if set.kept || set.rows.is_empty() {
            return;
        }
        self.specks += 1;
        self.pixels += set.pixels;
        for (layer, row) in set.rows {
            self.rows.entry(layer).or_default().push(row);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::island::islands;
    use super::super::reference::{Grey, grey, raster};
    use super::*;
    use proptest::prelude::*;

    fn found(layers: &[Grey], max_pixels: u64) -> Found {
        let mut specks = Specks::new(max_pixels);
        for (layer, k) in layers.iter().zip(0..) {
            specks.push(k, &raster(layer));
        }
        specks.finish()
    }

    fn without(layers: &[Grey], found: &Found) -> Vec<Grey> {
        let mut layers = layers.to_vec();
        for (layer, rows) in &found.rows {
            for &(row, [begin, end]) in rows {
                layers[*layer as usize][row as usize][usize::from(begin)..usize::from(end)].fill(0);
            }
        }
        layers
    }

    /// Pixels in a row; `#` is white, `-` is nearly black.
    fn rows(text: &str) -> Grey {
        let pixel = |c: char| match c {
            '#' => 255,
            '-' => 9,
            _ => 0,
        };
        vec![text.chars().map(pixel).collect()]
    }

    #[test]
    fn what_stays_small_and_holds_nothing_is_a_speck() {
        let check = |layers: &[&str], max_pixels: u64, expect: &[&str]| {
            let layers: Vec<Grey> = layers.iter().map(|layer| rows(layer)).collect();
            let found = found(&layers, max_pixels);
            let expect: Vec<Grey> = expect.iter().map(|layer| rows(layer)).collect();
            assert_eq!(without(&layers, &found), expect, "{found:?}");
        };
        // On the plate nothing is one.
        check(&["#......"], 3, &["#......"]);
        check(&["###....", "###.#.."], 3, &["###....", "###...."]);
        // It goes on, and ends.
        check(
            &["###....", "###.#..", "###.##.", "###...."],
            3,
            &["###....", "###....", "###....", "###...."],
        );
        // It grows too large: a part that wants support.
        check(&["###....", "###.#..", "###.###"], 2, &["###....", "###.#..", "###.###"]);
        // What joins the part is held without it, or not.
        check(&["#####....", "#####.#..", "#######.."], 3, &["#####....", "#####....", "#######.."]);
        check(&["#........", "#...#....", "#########"], 3, &["#........", "#...#....", "#########"]);
        // Two meet; one of two branches is needed.
        check(&["###......", "###.#.#..", "###.###.."], 3, &["###......", "###......", "###......"]);
        check(
            &["#..........", "#..###.....", "#..#.#.....", "####.#####."],
            3,
            &["#..........", "#..###.....", "#..#.#.....", "####.#####."],
        );
        // A fringe goes with it.
        check(&["###.....", "###.-#-."], 3, &["###.....", "###....."]);
    }

    proptest! {
        #[test]
        fn no_island_comes_and_specks_go(layers in prop::collection::vec(grey(10, 6), 1..6), max_pixels in 1_u64..20) {
            let found = found(&layers, max_pixels);
            let after = without(&layers, &found);
            // Islands by the other detector: of those that are left, all were there.
            let of = |layers: &[Grey], k: usize| -> Vec<([u32; 2], [u32; 2], u64)> {
                let islands = islands(&raster(&layers[k]), &raster(&layers[k - 1]));
                islands.iter().map(|piece| (piece.low, piece.high, piece.pixels)).collect()
            };
            for k in 1..layers.len() {
                let before = of(&layers, k);
                for island in of(&after, k) {
                    prop_assert!(before.contains(&island), "{island:?} came in layer {k}");
                }
            }
            prop_assert_eq!(&after[0], &layers[0]);
            let lit = |layers: &[Grey]| layers.iter().flatten().flatten().filter(|&&pixel| pixel > 0).count() as u64;
            prop_assert_eq!(lit(&after) + found.pixels, lit(&layers));
            // All of them were found: a second look finds no speck.
            prop_assert_eq!(super::tests::found(&after, max_pixels), Found::default());
        }
    }
}
