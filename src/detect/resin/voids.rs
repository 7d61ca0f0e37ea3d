//! Hollows: resin traps, which stay full of resin, and suction cups, which suck at each peel.
//!
//! A hollow is 4-connected pixels of a layer that are no wall (brightness below 100). Two hollows of
//! neighbouring layers are one where at least 10 px of the one lie over the other, dark enough to drain
//! (30 and less) in both. A hollow that reaches the panel's edge is open. The plate closes what lies on
//! it; behind the last layer all is open.
//!
//! While a layer is printed, resin and air come into a hollow from layers that are printed already, or
//! not at all:
//! - A hollow that no open one is linked with through the layers up to this one is a *suction cup* there,
//!   until a layer opens it or the job ends. Told from 100 px and 0.5 mm on.
//! - One that is closed again by a layer, and never was open, is a *resin trap*.
//!
//! Both follow from one pass from the plate up, with sets of hollows that are joined where they meet:
//! a way that leads up and down again through any number of layers is found, which two passes over the
//! layers (UVtools) do not.
//!
//! Source: UVtools' names and defaults. A trap of which no layer has 10 px is none: nothing so small
//! would count as drained anyway.
use super::{Issue, Kind};
use crate::layers::raster::{Labels, Level, Piece, Pieces, Raster};

/// Pixels that two hollows must share to be one.
pub const MIN_DRAIN_PX: u64 = 10;

/// Smallest area of a suction cup, px.
pub const MIN_CUP_PX: u64 = 100;

/// Smallest height of a suction cup, mm.
pub const MIN_CUP_MM: f64 = 0.5;

/// Heights are sums of floating-point numbers.
const SLACK_MM: f64 = 1e-6;

/// The hollows of a layer.
#[derive(Debug, Default)]
pub struct Hollows {
    /// Each of them, and whether it reaches the panel's edge.
    list: Vec<(Piece, bool)>,
    /// Their pixels that are dark enough to drain.
    drains: Labels,
}

impl Hollows {
    /// The hollows of a layer.
    #[must_use]
    pub fn of(layer: &Raster) -> Hollows {
        let pieces = Pieces::of(layer.mask(Level::Walls).inverse());
        let (width, height) = (layer.width_px(), layer.height_px());
        let open = |p: &Piece| p.low[0] == 0 || p.low[1] == 0 || p.high[0] == width || p.high[1] == height;
        let list = pieces.list().iter().map(|piece| (*piece, open(piece))).collect();
        Hollows { list, drains: pieces.labels(&layer.mask(Level::Dams).inverse()) }
    }

    /// How they are linked with those of the layer below.
    #[must_use]
    pub fn links(&self, below: Option<&Hollows>) -> Links {
        let mut shared = below.map_or_else(Vec::new, |below| self.drains.shared(&below.drains));
        shared.retain(|&(.., pixels)| pixels >= MIN_DRAIN_PX);
        Links { list: self.list.clone(), below: shared.into_iter().map(|(a, b, _)| (a, b)).collect() }
    }
}

/// The hollows of a layer and how they hang together with those below.
#[derive(Debug, Default)]
pub struct Links {
    list: Vec<(Piece, bool)>,
    /// One of this layer, and one of the layer below.
    below: Vec<(u32, u32)>,
}

/// Hollows that hang together, up to a layer.
#[derive(Clone, Copy, Debug)]
struct Set {
    /// The set that this one was joined to, or itself.
    parent: u32,
    open: bool,
    layer: u32,
    end_layer: u32,
    bottom_mm: f64,
    top_mm: f64,
    volume_px_mm: f64,
    largest: Piece,
    low: [u32; 2],
    high: [u32; 2],
}

/// Sets of hollows on their way up.
#[derive(Debug, Default)]
pub struct Voids {
    /// Those that are alive: some hollow of the last layer belongs to them.
    sets: Vec<Set>,
    /// The set of each hollow of the last layer.
    last: Vec<u32>,
}

impl Voids {
    /// Takes the next layer, which lies between those heights, and tells what is over.
    pub fn push(&mut self, layer: u32, span_mm: [f64; 2], links: &Links, mut tell: impl FnMut(Issue)) {
        let before = self.sets.clone();
        let first = before.len() as u32;
        self.sets.extend(links.list.iter().zip(first..).map(|((piece, open), own)| Set {
            parent: own,
            open: *open,
            layer,
            end_layer: layer,
            bottom_mm: span_mm[0],
            top_mm: span_mm[1],
            volume_px_mm: piece.pixels as f64 * (span_mm[1] - span_mm[0]),
            largest: *piece,
            low: piece.low,
            high: piece.high,
        }));
        for &(ours, below) in &links.below {
            self.join(self.last[below as usize], first + ours);
        }
        for (set, k) in before.iter().zip(0..) {
            let now = &self.sets[self.root(k) as usize];
            if !set.open && now.open {
                // It was one up to the layer below.
                set.cup(&mut tell);
            } else if !set.open && now.end_layer < layer && set.largest.pixels >= MIN_DRAIN_PX {
                tell(set.issue(Kind::ResinTrap));
            }
        }
        self.keep_alive(layer, (first..).take(links.list.len()));
    }

    /// The job is over: what is not closed from above is open there.
    pub fn finish(self, mut tell: impl FnMut(Issue)) {
        self.sets.iter().filter(|set| !set.open).for_each(|set| set.cup(&mut tell));
    }

    fn root(&self, mut set: u32) -> u32 {
        while self.sets[set as usize].parent != set {
            set = self.sets[set as usize].parent;
        }
        set
    }

    fn join(&mut self, one: u32, other: u32) {
        let (one, other) = (self.root(one), self.root(other));
        if one == other {
            return;
        }
        let Set { open, layer, end_layer, bottom_mm, top_mm, volume_px_mm, largest, low, high, .. } =
            self.sets[other as usize];
        self.sets[other as usize].parent = one;
        let joined = &mut self.sets[one as usize];
        joined.open |= open;
        joined.layer = joined.layer.min(layer);
        joined.end_layer = joined.end_layer.max(end_layer);
        joined.bottom_mm = joined.bottom_mm.min(bottom_mm);
        joined.top_mm = joined.top_mm.max(top_mm);
        joined.volume_px_mm += volume_px_mm;
        if largest.pixels > joined.largest.pixels {
            joined.largest = largest;
        }
        for axis in 0..2 {
            joined.low[axis] = joined.low[axis].min(low[axis]);
            joined.high[axis] = joined.high[axis].max(high[axis]);
        }
    }

    /// Keeps the sets that a hollow of this layer belongs to, numbered anew; `of` has the set of each.
    fn keep_alive(&mut self, layer: u32, of: impl Iterator<Item = u32>) {
        let mut number = vec![u32::MAX; self.sets.len()];
        let mut alive = Vec::new();
        for (k, set) in self.sets.iter().enumerate() {
            if set.parent as usize == k && set.end_layer == layer {
                number[k] = alive.len() as u32;
                alive.push(Set { parent: number[k], ..*set });
            }
        }
        self.last = of.map(|set| number[self.root(set) as usize]).collect();
        self.sets = alive;
    }
}

impl Set {
    fn issue(&self, kind: Kind) -> Issue {
        Issue {
            kind,
            layer: self.layer,
            end_layer: self.end_layer,
            pixels: self.largest.pixels,
            volume_px_mm: self.volume_px_mm,
            centroid_px: self.largest.centroid(),
            box_px: [self.low, self.high],
        }
    }

    fn cup(&self, tell: &mut impl FnMut(Issue)) {
        let height_mm = self.top_mm - self.bottom_mm;
        if self.largest.pixels >= MIN_CUP_PX && height_mm >= MIN_CUP_MM - SLACK_MM {
            tell(self.issue(Kind::SuctionCup));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::reference::{self, Grey, grey};
    use super::*;
    use proptest::prelude::*;

    /// Traps and cups of layers of 0.1 mm, as kind, first and last layer, largest area.
    fn found(layers: &[Grey]) -> Vec<(Kind, u32, u32, u64)> {
        let (mut voids, mut below, mut list) = (Voids::default(), None, Vec::new());
        for (layer, k) in layers.iter().zip(0..) {
            let hollows = Hollows::of(&reference::raster(layer));
            let span_mm = [f64::from(k) * 0.1, f64::from(k + 1) * 0.1];
            voids.push(k, span_mm, &hollows.links(below.as_ref()), |issue| list.push(issue));
            below = Some(hollows);
        }
        voids.finish(|issue| list.push(issue));
        let mut found: Vec<_> = list.iter().map(|i| (i.kind, i.layer, i.end_layer, i.pixels)).collect();
        found.sort_unstable();
        found
    }

    /// A block of 24 × 16 px on a panel of 30 × 20 px, with dark rectangles cut out of it.
    fn block(holes: &[[usize; 4]]) -> Grey {
        let mut rows = vec![vec![0; 30]; 20];
        rows[2..18].iter_mut().for_each(|row| row[3..27].fill(255));
        for &[x, y, width, height] in holes {
            rows[y..y + height].iter_mut().for_each(|row| row[x..x + width].fill(0));
        }
        rows
    }

    /// A hole of 10 × 10 px, one of 2 × 5 px, and one beside them.
    const WIDE: [usize; 4] = [5, 5, 10, 10];
    const DRAIN: [usize; 4] = [6, 6, 2, 5];
    const BESIDE: [usize; 4] = [17, 5, 8, 10];

    #[test]
    fn traps_and_cups_are_told_apart() {
        use Kind::{ResinTrap, SuctionCup};
        let full = || block(&[]);
        let with = |hole: [usize; 4]| block(&[hole]);
        let check = |layers: &[(usize, Grey)], expect: &[(Kind, u32, u32, u64)]| {
            let layers: Vec<Grey> =
                layers.iter().flat_map(|(n, layer)| std::iter::repeat_n(layer.clone(), *n)).collect();
            assert_eq!(found(&layers), expect);
            let traps: Vec<_> = expect.iter().filter(|i| i.0 == ResinTrap).map(|i| [i.1, i.2]).collect();
            assert_eq!(reference::traps(&layers), traps);
        };
        check(&[(8, full())], &[]);
        // Closed all around.
        check(&[(2, full()), (5, with(WIDE)), (2, full())], &[(ResinTrap, 2, 6, 100)]);
        // On the plate, which closes it; in the other case it is open in the end.
        check(&[(6, with(WIDE)), (2, full())], &[(ResinTrap, 0, 5, 100)]);
        check(&[(2, full()), (6, with(WIDE))], &[(SuctionCup, 2, 7, 100)]);
        // Too low, too small.
        check(&[(2, full()), (4, with(WIDE))], &[]);
        check(&[(2, full()), (6, with([5, 5, 9, 11]))], &[]);
        // A drain of 2 × 5 px leads up, one of 9 px does not count.
        check(&[(1, full()), (6, with(WIDE)), (3, with(DRAIN))], &[(SuctionCup, 1, 9, 100)]);
        check(&[(1, full()), (6, with(WIDE)), (3, with([6, 6, 3, 3]))], &[(ResinTrap, 1, 6, 100)]);
        // A hole in the wall, below or above.
        let wall = [3, 8, 5, 3];
        let holed = block(&[WIDE, wall]);
        check(&[(1, full()), (1, holed.clone()), (6, with(WIDE)), (2, full())], &[]);
        check(&[(1, full()), (6, with(WIDE)), (1, holed), (2, full())], &[(SuctionCup, 1, 6, 100)]);
        // Up, over and down again: the hollow beside is open through the other one.
        let two = block(&[WIDE, BESIDE]);
        let over = block(&[[5, 5, 20, 10]]);
        let open_below = block(&[WIDE, BESIDE, wall]);
        check(&[(1, full()), (1, open_below), (6, two.clone()), (1, over.clone()), (2, full())], &[]);
        // Two closed ones that meet are one trap.
        check(&[(1, full()), (3, two), (1, over), (2, full())], &[(ResinTrap, 1, 4, 200)]);
    }

    #[test]
    fn grey_is_a_wall_from_100_and_does_not_drain_from_31() {
        let check = |lid: u8, expect: Option<Kind>| {
            let full = block(&[]);
            let mut covered = block(&[WIDE]);
            covered[5..15].iter_mut().for_each(|row| row[5..15].fill(lid));
            let mut layers = vec![full];
            layers.extend(std::iter::repeat_n(block(&[WIDE]), 6));
            layers.push(covered);
            assert_eq!(found(&layers).first().map(|i| i.0), expect, "{lid}");
        };
        check(255, Some(Kind::ResinTrap));
        check(100, Some(Kind::ResinTrap));
        check(99, Some(Kind::ResinTrap));
        check(31, Some(Kind::ResinTrap));
        check(30, Some(Kind::SuctionCup));
    }

    proptest! {
        #[test]
        fn traps_are_what_a_flood_in_space_does_not_reach(
            layers in prop::collection::vec(grey(14, 10), 1..7),
        ) {
            let traps: Vec<[u32; 2]> = found(&layers)
                .into_iter()
                .filter(|issue| issue.0 == Kind::ResinTrap)
                .map(|issue| [issue.1, issue.2])
                .collect();
            prop_assert_eq!(traps, reference::traps(&layers));
        }
    }
}
