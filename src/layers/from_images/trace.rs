//! Boundaries of bright pixels, traced along pixel edges.
//!
//! Takes the rows of one picture from the top, gives its polygons with corners
//! counted in pixels. Pixels that share an edge are one piece, pixels that touch in a
//! corner only are not (4-connectivity, as UVtools has it). Time and memory grow with
//! the corners of the boundary, not with the pixels. Knows no brightness and no
//! millimetre.
//!
//! # How
//! Between two rows the boundary has an edge wherever one is bright and the other is
//! not. Going along that line, such edges begin and end by turns, so corner `2 k` and
//! corner `2 k + 1` are always joined by an edge along the row. Each corner is also the
//! upper or lower end of an edge along a column, which begins where a row changes at
//! a column and its upper neighbour does not, and is carried down until that ends.
//!
//! ```text
//!  upper row      ████████          edges along the line: 0-1 and 2-3
//!            0---1       2---3      column edges from above end at 1 and 2,
//!  lower row ████████████████       new ones begin at 0 and 3
//! ```
//!
//! Where two bright pixels touch in a corner only, two corners lie in one point, and
//! the end of a run comes before the beginning of one: each bright pixel then keeps
//! its own corner. Rings follow the edges with the bright side to the left as seen. A
//! ring that comes to such a point a second time is cut there in two, so that rings
//! are simple: an outer ring and the hole that touches it, or two holes.
use rustc_hash::FxHashMap;
use std::ops::Range;

/// Most corners of one picture's boundaries: a thousand times those of usual layers,
/// and below 100 MB while they are traced. Only noise and dithering have more.
pub(super) const MAX_CORNERS: usize = 1 << 22;

/// A corner of pixels: columns from the left, rows from the top.
pub(super) type Corner = [u32; 2];

/// The outer ring, counter-clockwise as seen, and the holes, clockwise: of corners, or
/// of what was made of them.
pub(super) type Rings<P> = Vec<Vec<P>>;

const NONE: u32 = u32::MAX;

/// An edge along a column that goes on from the row above.
#[derive(Clone, Copy)]
struct Edge {
    /// The corner at its upper end.
    top: u32,
    /// The piece of the bright run beside it.
    piece: u32,
}

/// Traces one picture.
#[derive(Default)]
pub(super) struct Trace {
    row: u32,
    corners: Vec<Corner>,
    /// The piece beside each corner.
    piece: Vec<u32>,
    /// The next corner along the ring.
    next: Vec<u32>,
    /// Pieces that turned out to be one: a forest, each pointing to its parent.
    parent: Vec<u32>,
    /// Where the row above changes, and the edges there.
    columns: Vec<u32>,
    edges: Vec<Edge>,
    /// Those of the row in work.
    lower: Vec<Edge>,
}

/// The boundary has more than [`MAX_CORNERS`] corners.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct TooFine;

impl Trace {
    /// Takes the next row: the columns where it changes, as [`super::runs::changes`]
    /// gives them.
    pub(super) fn row(&mut self, columns: &[u32]) -> Result<(), TooFine> {
        // Walls that go straight up make most rows like the one above.
        if columns != self.columns {
            if self.corners.len() + columns.len() + self.columns.len() > MAX_CORNERS {
                return Err(TooFine);
            }
            self.groups(columns);
            std::mem::swap(&mut self.edges, &mut self.lower);
            self.columns.clear();
            self.columns.extend_from_slice(columns);
        }
        self.row += 1;
        Ok(())
    }

    /// Cuts the two rows into groups of runs that touch each other, from the left, so
    /// that the usual group, one run above one, takes no search.
    fn groups(&mut self, columns: &[u32]) {
        self.lower.clear();
        self.lower.resize(columns.len(), Edge { top: NONE, piece: NONE });
        let upper = std::mem::take(&mut self.columns);
        let at = |row: &[u32], i: usize| row.get(i).copied().unwrap_or(NONE);
        let (mut a, mut b) = (0, 0);
        while a < upper.len() || b < columns.len() {
            let (from_a, from_b) = (a, b);
            if at(&upper, a) < at(columns, b) {
                a += 2
            } else {
                b += 2
            }
            loop {
                // What the group's last runs reach.
                let reach_a = if a > from_a { upper[a - 1] } else { 0 };
                let reach_b = if b > from_b { columns[b - 1] } else { 0 };
                if at(columns, b) < reach_a {
                    b += 2;
                } else if at(&upper, a) < reach_b {
                    a += 2;
                } else {
                    break;
                }
            }
            if a - from_a == 2 && b - from_b == 2 {
                self.one_above_one(&upper, columns, from_a, from_b);
            } else {
                self.join_pieces(&upper, columns, from_a..a, from_b..b);
                self.line(&upper, columns, from_a..a, from_b..b);
            }
        }
        self.columns = upper;
    }

    /// A run whose only neighbour above is another, whose only one below it is.
    fn one_above_one(&mut self, upper: &[u32], columns: &[u32], a: usize, b: usize) {
        let piece = self.edges[a].piece;
        for side in 0..2 {
            let (above, below) = (upper[a + side], columns[b + side]);
            let mut top = self.edges[a + side].top;
            if above < below {
                self.end_edge(a + side, above);
                top = self.corner(below, piece);
            } else if above > below {
                top = self.corner(below, piece);
                self.end_edge(a + side, above);
            }
            self.lower[b + side] = Edge { top, piece };
        }
    }

    /// Gives each run of the new row the piece of a run above that it shares an edge
    /// with, and joins the pieces of all such runs.
    fn join_pieces(&mut self, upper: &[u32], columns: &[u32], a: Range<usize>, b: Range<usize>) {
        let mut above = a.start;
        for run in b.step_by(2) {
            let [begin, end] = [columns[run], columns[run + 1]];
            while above < a.end && upper[above + 1] <= begin {
                above += 2;
            }
            let mut piece = NONE;
            // The last run above that reaches this one may reach the next one too.
            for k in (above..a.end).step_by(2).take_while(|&k| upper[k] < end) {
                let other = self.edges[k].piece;
                piece = if piece == NONE { self.root(other) } else { self.join(piece, other) };
            }
            if piece == NONE {
                piece = self.parent.len() as u32;
                self.parent.push(piece);
            }
            self.lower[run].piece = piece;
            self.lower[run + 1].piece = piece;
        }
    }

    /// Makes the corners of a group on the line above the new row.
    fn line(&mut self, upper: &[u32], columns: &[u32], a: Range<usize>, b: Range<usize>) {
        let ends = [a.end, b.end];
        let (mut a, mut b) = (a.start, b.start);
        while a < ends[0] || b < ends[1] {
            let above = if a < ends[0] { upper[a] } else { NONE };
            let below = if b < ends[1] { columns[b] } else { NONE };
            // Even indices begin a run, odd ones end it.
            if above == below && a % 2 == b % 2 {
                self.lower[b].top = self.edges[a].top;
                (a, b) = (a + 1, b + 1);
            } else if above < below || (above == below && a % 2 == 1) {
                self.end_edge(a, above);
                a += 1;
            } else {
                let piece = self.lower[b].piece;
                self.lower[b].top = self.corner(below, piece);
                b += 1;
            }
        }
    }

    fn corner(&mut self, column: u32, piece: u32) -> u32 {
        let id = self.corners.len() as u32;
        self.corners.push([column, self.row]);
        self.piece.push(piece);
        self.next.push(NONE);
        id
    }

    /// Ends a column edge of the upper row. With the bright side to the left, the left
    /// side of a run is followed downwards and its right side upwards.
    fn end_edge(&mut self, index: usize, column: u32) {
        let Edge { top, piece } = self.edges[index];
        let bottom = self.corner(column, piece);
        let [from, to] = if index.is_multiple_of(2) { [top, bottom] } else { [bottom, top] };
        self.next[from as usize] = to;
        self.next[to as usize] = to ^ 1;
    }

    fn root(&mut self, mut piece: u32) -> u32 {
        while self.parent[piece as usize] != piece {
            let above = self.parent[self.parent[piece as usize] as usize];
            self.parent[piece as usize] = above;
            piece = above;
        }
        piece
    }

    fn join(&mut self, one: u32, other: u32) -> u32 {
        let (one, other) = (self.root(one), self.root(other));
        // The older piece stays, so that polygons come in the order of their first rows.
        let (older, newer) = (one.min(other), one.max(other));
        self.parent[newer as usize] = older;
        older
    }

    /// The polygons, in the order of their first corners from the top, of points that
    /// `place` makes of corners.
    pub(super) fn polygons<P>(mut self, place: impl Fn(Corner) -> P) -> Result<Vec<Rings<P>>, TooFine> {
        self.row(&[])?;
        let mut polygons: Vec<Rings<P>> = Vec::new();
        let mut of_piece = vec![NONE; self.parent.len()];
        let mut path = Vec::new();
        for start in 0..self.corners.len() {
            if self.next[start] == NONE {
                continue;
            }
            let root = self.root(self.piece[start]) as usize;
            if of_piece[root] == NONE {
                of_piece[root] = polygons.len() as u32;
                polygons.push(vec![Vec::new()]);
            }
            let polygon = &mut polygons[of_piece[root] as usize];
            self.ring(start as u32, &mut path, |ring| {
                let placed = ring.iter().map(|&(_, corner)| place(corner)).collect();
                if turns_left(ring) { polygon[0] = placed } else { polygon.push(placed) }
            });
        }
        Ok(polygons)
    }

    /// Follows a ring from a corner to itself, cut where it touches itself, and shows
    /// each simple ring of it. `path` is room to work in.
    fn ring(&mut self, start: u32, path: &mut Vec<(u32, Corner)>, mut show: impl FnMut(&[(u32, Corner)])) {
        path.clear();
        // Corners of the path that share their point with another, and where they stand in it.
        let mut shared: FxHashMap<u32, usize> = FxHashMap::default();
        let mut at = start;
        loop {
            let twin = self.twin(at);
            let stands = |&k: &usize| path.get(k).is_some_and(|c| Some(c.0) == twin);
            let met = twin.and_then(|t| shared.get(&t).copied()).filter(stands);
            if let Some(k) = met {
                show(&path[k..]);
                path.truncate(k + 1);
            } else {
                if twin.is_some() {
                    shared.insert(at, path.len());
                }
                path.push((at, self.corners[at as usize]));
            }
            at = std::mem::replace(&mut self.next[at as usize], NONE);
            if at == start {
                break;
            }
        }
        show(path);
    }

    /// The other corner in the same point: made just before or just after.
    fn twin(&self, corner: u32) -> Option<u32> {
        let other = if corner % 2 == 1 { corner + 1 } else { corner.checked_sub(1)? };
        let same = self.corners.get(other as usize) == self.corners.get(corner as usize);
        same.then_some(other)
    }
}

/// Whether a ring runs counter-clockwise as seen, with rows downwards.
fn turns_left(ring: &[(u32, Corner)]) -> bool {
    let Some(&(_, mut last)) = ring.last() else { return false };
    let mut area = 0_i64;
    for &(_, corner) in ring {
        // Edges along columns alone: the others sweep none of the area to their left.
        area += i64::from(corner[0]) * (i64::from(corner[1]) - i64::from(last[1]));
        last = corner;
    }
    area < 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    /// Rows of a picture; `#` is bright.
    type Bits = Vec<Vec<bool>>;

    fn traced(bits: &Bits) -> Vec<Rings<Corner>> {
        let mut trace = Trace::default();
        for row in bits {
            let row: Vec<u8> = row.iter().map(|&b| if b { 255 } else { 0 }).collect();
            let mut columns = Vec::new();
            super::super::runs::changes(&row, &mut columns);
            trace.row(&columns).expect("a small picture");
        }
        trace.polygons(|c| c).expect("a small picture")
    }

    fn art(rows: &[&str]) -> Bits {
        rows.iter().map(|r| r.bytes().map(|b| b == b'#').collect()).collect()
    }

    fn at(bits: &Bits, x: i64, y: i64) -> bool {
        let row = usize::try_from(y).ok().and_then(|y| bits.get(y));
        row.and_then(|r| usize::try_from(x).ok().and_then(|x| r.get(x))).is_some_and(|&b| b)
    }

    /// Pixels inside a ring, by the edges along columns to the left of their middles.
    fn filled(ring: &[Corner], width: usize, height: usize) -> Bits {
        let mut bits = vec![vec![false; width]; height];
        for (i, &[x, y]) in ring.iter().enumerate() {
            let [other_x, other_y] = ring[(i + 1) % ring.len()];
            if x != other_x {
                continue;
            }
            for row in &mut bits[y.min(other_y) as usize..y.max(other_y) as usize] {
                row[x as usize..].iter_mut().for_each(|b| *b = !*b);
            }
        }
        bits
    }

    /// Pieces by flooding over shared edges, of pixels that are like `wanted`; one pixel
    /// of border around the picture counts as dark.
    fn flooded(bits: &Bits, wanted: impl Fn(i64, i64) -> bool) -> Vec<BTreeSet<(i64, i64)>> {
        let (height, width) = (bits.len() as i64, bits.first().map_or(0, Vec::len) as i64);
        let mut open: BTreeSet<(i64, i64)> = (-1..=height)
            .flat_map(|y| (-1..=width).map(move |x| (x, y)))
            .filter(|&(x, y)| wanted(x, y))
            .collect();
        let mut pieces = Vec::new();
        while let Some(first) = open.pop_first() {
            let (mut piece, mut edge) = (BTreeSet::from([first]), vec![first]);
            while let Some((x, y)) = edge.pop() {
                for near in [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)] {
                    if open.remove(&near) {
                        piece.insert(near);
                        edge.push(near);
                    }
                }
            }
            pieces.push(piece);
        }
        pieces
    }

    /// Everything that must hold of any picture.
    fn must_hold(bits: &Bits) {
        let (height, width) = (bits.len(), bits.first().map_or(0, Vec::len));
        let polygons = traced(bits);
        let pieces = flooded(bits, |x, y| at(bits, x, y));
        assert_eq!(polygons.len(), pieces.len(), "pieces of {bits:?}");
        let mut seen = vec![vec![false; width]; height];
        for rings in &polygons {
            let mut own = vec![vec![false; width]; height];
            for (i, ring) in rings.iter().enumerate() {
                let numbered: Vec<(u32, Corner)> = ring.iter().map(|&c| (0, c)).collect();
                assert_eq!(turns_left(&numbered), i == 0, "ring {i} of {rings:?}");
                let points: BTreeSet<&Corner> = ring.iter().collect();
                assert_eq!(points.len(), ring.len(), "a ring touches itself: {ring:?}");
                for (k, corner) in ring.iter().enumerate() {
                    let (before, after) =
                        (ring[(k + ring.len() - 1) % ring.len()], ring[(k + 1) % ring.len()]);
                    let turn = |a: Corner, b: Corner| (a[0] == b[0]) != (a[1] == b[1]);
                    assert!(turn(before, *corner) && turn(*corner, after), "slanted: {ring:?}");
                    assert_ne!(before[0] == corner[0], corner[0] == after[0], "no corner: {ring:?}");
                }
                for (o, f) in own.iter_mut().flatten().zip(filled(ring, width, height).iter().flatten()) {
                    *o ^= *f;
                }
            }
            let inside = |x: i64, y: i64| at(&own, x, y);
            let piece = pieces.iter().find(|p| p.iter().any(|&(x, y)| inside(x, y))).expect("its piece");
            let pixels: BTreeSet<(i64, i64)> = flooded(bits, inside).into_iter().flatten().collect();
            assert_eq!(&pixels, piece, "rings {rings:?}");
            let outside = flooded(bits, |x, y| !piece.contains(&(x, y)));
            assert_eq!(rings.len(), outside.len(), "holes of {rings:?}");
            for (s, o) in seen.iter_mut().flatten().zip(own.iter().flatten()) {
                assert!(!(*s && *o), "polygons overlap");
                *s |= *o;
            }
        }
        assert_eq!(&seen, bits);
    }

    #[test]
    fn rings_follow_the_edges_of_pixels() {
        let check = |rows: &[&str], expect: &[Rings<Corner>]| {
            let bits = art(rows);
            assert_eq!(traced(&bits), expect, "{rows:#?}");
            must_hold(&bits);
        };
        check(&[], &[]);
        check(&["...", "..."], &[]);
        check(&["#"], &[vec![vec![[0, 0], [0, 1], [1, 1], [1, 0]]]]);
        // Straight walls and rows give no corner.
        check(&["....", ".##.", ".##.", ".##."], &[vec![vec![[1, 1], [1, 4], [3, 4], [3, 1]]]]);
        // Touching in a corner only: two pieces.
        check(
            &["#.", ".#"],
            &[vec![vec![[0, 0], [0, 1], [1, 1], [1, 0]]], vec![vec![[1, 1], [1, 2], [2, 2], [2, 1]]]],
        );
        check(
            &[".#", "#."],
            &[vec![vec![[1, 0], [1, 1], [2, 1], [2, 0]]], vec![vec![[0, 1], [0, 2], [1, 2], [1, 1]]]],
        );
        // A hole, clockwise.
        check(
            &["###", "#.#", "###"],
            &[vec![vec![[0, 0], [0, 3], [3, 3], [3, 0]], vec![[1, 1], [2, 1], [2, 2], [1, 2]]]],
        );
    }

    #[test]
    fn rings_that_touch_themselves_are_cut_in_two() {
        let check = |rows: &[&str], rings: &[usize]| {
            let bits = art(rows);
            must_hold(&bits);
            let found: Vec<usize> = traced(&bits).iter().map(Vec::len).collect();
            assert_eq!(found, rings, "{rows:#?}");
        };
        // A piece whose two ends meet in a corner encloses a hole.
        check(&[".##", "#.#", "###"], &[2]);
        check(&["##.", "#.#", "###"], &[2]);
        check(&["###", "#.#", "##."], &[2]);
        // Two holes that touch in a corner.
        check(&["####", "#.##", "##.#", "####"], &[3]);
        check(&["####", "##.#", "#.##", "####"], &[3]);
        // Dark pixels around a piece of its own are one hole with it.
        check(&["#####", "##.##", "#.#.#", "##.##", "#####"], &[2, 1]);
        // A U whose arms are one piece: joined only at the bottom row.
        check(&["#.#.#", "#.#.#", "#####"], &[1]);
        // Nested: a ring, and a body in its hole that touches it in a corner.
        check(&["#####", "#...#", "#.#.#", "#..##", "#####"], &[2, 1]);
        check(&["#####", "#...#", "#..#.", "#...#", "#####"], &[1, 1]);
    }

    #[test]
    fn too_many_corners_are_refused() {
        let mut trace = Trace::default();
        let odd: Vec<u32> = (0..4096).collect();
        let even: Vec<u32> = (1..4097).collect();
        let refused = (0..2048).find_map(|i| trace.row(if i % 2 == 0 { &odd } else { &even }).err());
        assert_eq!(refused, Some(TooFine));
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn any_picture_comes_back((width, bits) in (1_usize..9).prop_flat_map(|w| (Just(w), prop::collection::vec(prop::collection::vec(any::<bool>(), w), 0..9)))) {
            prop_assert!(bits.iter().all(|r| r.len() == width));
            must_hold(&bits);
        }
    }
}
