//! Bridges: strands that hang between two held ends.
//!
//! A strand of filament laid straight across a gap holds itself when both its ends lie
//! on something and are no farther apart than the material bears. In polygons: of a
//! residual piece, a point is bridged in a direction when the chord of the piece through
//! the point in that direction ends on held edges at both ends and is no longer than the
//! span. All of a piece is laid in one direction; of a few likely ones (square to
//! the held edges) that one is taken which leaves least. This is conservative: what
//! hangs on one end only, what is too wide, and pieces of more than [`MOST_EDGES`] edges
//! stay overhangs; the printer that fans strands out could do better.
use super::held::{Residual, V, at, cross, dot, minus};
use super::is_dust;
use crate::layers::polygon::without;
use crate::layers::shape::{Point, Polygon, Ring};

/// Pieces of more edges than this are not searched, so that no piece takes long.
const MOST_EDGES: usize = 4000;

/// Directions that are tried.
const TRIED: usize = 4;

/// Held edges within this angle of each other count as one direction, parts of a half turn.
const BINS: usize = 12;

/// Strands are cut out wider than they are by this, grid steps, so that rounding leaves no hairs.
const HAIR: f64 = 1.5;

/// Strands this near an overhang are cut out, grid steps: they are a hair wider, and rounded.
const MARGIN: f64 = 4.0;

/// Ends of strands this near are the same, grid steps.
const SAME: f64 = 0.5;

/// Ranges of heights at most that are told apart, so that many bits take no long time.
const MOST_RANGES: usize = 8;

/// An edge in the frame of a direction: along it and square to it, lower end first.
struct Wall {
    low: V,
    high: V,
    held: bool,
}

impl Wall {
    fn at(&self, height: f64) -> f64 {
        let part = (height - self.low[1]) / (self.high[1] - self.low[1]);
        self.low[0] + (self.high[0] - self.low[0]) * part
    }
}

/// What of the overhanging polygons of a piece no bridge of this span (grid steps) holds.
pub(super) fn unbridged(piece: &Residual, overhang: Vec<Polygon>, span: f64) -> Vec<Polygon> {
    if piece.polygon.len() > MOST_EDGES {
        return overhang;
    }
    let area = |left: &[Polygon]| left.iter().map(Polygon::area_mm2).sum::<f64>();
    let (mut best, mut least) = (None, area(&overhang));
    for way in directions(piece) {
        let boxes: Vec<FramedBox> = overhang.iter().map(|p| FramedBox::of(p, way)).collect();
        let strands = strands(piece, way, span, &boxes);
        if strands.is_empty() {
            continue;
        }
        let left = without(overhang.iter().flat_map(|p| &p.rings), &strands).polygons;
        let left: Vec<Polygon> = left.into_iter().filter(|p| !is_dust(p)).collect();
        if area(&left) < least {
            least = area(&left);
            best = Some(left);
        }
        if least == 0.0 {
            break;
        }
    }
    best.unwrap_or(overhang)
}

/// The bounds of an overhanging polygon in the frame of a direction: only strands that
/// meet these can hold something of it, and the others are spared.
struct FramedBox {
    low: V,
    high: V,
}

impl FramedBox {
    fn of(polygon: &Polygon, way: V) -> FramedBox {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for &p in polygon.rings.first().into_iter().flatten() {
            let at = framed(way, at(p));
            low = [0, 1].map(|c: usize| low[c].min(at[c] - MARGIN));
            high = [0, 1].map(|c: usize| high[c].max(at[c] + MARGIN));
        }
        FramedBox { low, high }
    }

    fn meets(&self, low: V, high: V) -> bool {
        (0..2).all(|c| self.low[c] <= high[c] && low[c] <= self.high[c])
    }
}

/// A place in the frame of a direction: along it and square to it.
fn framed(way: V, p: V) -> V {
    [dot(way, p), cross(way, p)]
}

/// The heights that the boxes cover, as disjoint ranges from low to high; one for all
/// where they would be many.
fn ranges(boxes: &[FramedBox]) -> Vec<[f64; 2]> {
    let mut ranges: Vec<[f64; 2]> = boxes.iter().map(|b| [b.low[1], b.high[1]]).collect();
    ranges.sort_by(|a, b| a[0].total_cmp(&b[0]));
    joined(&mut ranges);
    if ranges.len() > MOST_RANGES {
        ranges = vec![[ranges[0][0], ranges[ranges.len() - 1][1]]];
    }
    ranges
}

/// Joins ranges that meet, sorted by their lower ends.
fn joined(ranges: &mut Vec<[f64; 2]>) {
    ranges.dedup_by(|next, last| {
        let meet = next[0] <= last[1];
        if meet {
            last[1] = last[1].max(next[1]);
        }
        meet
    });
}

/// Directions square to the held edges, those with the longest edges first.
fn directions(piece: &Residual) -> Vec<V> {
    let mut bins = [[0.0_f64; 3]; BINS];
    for (a, b, held) in edges(piece) {
        if !held {
            continue;
        }
        let mut normal = minus(b, a);
        normal = [-normal[1], normal[0]];
        // One of the two ways along the same line.
        if normal[1] < 0.0 || (normal[1] == 0.0 && normal[0] < 0.0) {
            normal = [-normal[0], -normal[1]];
        }
        let part = normal[1].atan2(normal[0]) / std::f64::consts::PI * BINS as f64;
        let bin = &mut bins[(part.round() as usize) % BINS];
        // Ways on both sides of the cut between the last bin and the first are opposite.
        let sign = if part.round() as usize == BINS { -1.0 } else { 1.0 };
        let length = normal[0].hypot(normal[1]);
        *bin = [bin[0] + sign * normal[0], bin[1] + sign * normal[1], bin[2] + length];
    }
    let mut order: Vec<usize> = (0..BINS).filter(|&k| bins[k][2] > 0.0).collect();
    order.sort_by(|&a, &b| bins[b][2].total_cmp(&bins[a][2]).then(a.cmp(&b)));
    order.truncate(TRIED);
    let unit = |[x, y, _]: [f64; 3]| {
        let length = x.hypot(y);
        (length > 0.0).then(|| [x / length, y / length])
    };
    order.into_iter().filter_map(|k| unit(bins[k])).collect()
}

fn edges(piece: &Residual) -> impl Iterator<Item = (V, V, bool)> + '_ {
    piece.polygon.rings.iter().zip(&piece.held).flat_map(|(ring, held)| {
        held.iter().enumerate().map(|(k, &held)| (at(ring[k]), at(ring[(k + 1) % ring.len()]), held))
    })
}

/// The parts of the piece whose chords along a direction are bridges, as polygons,
/// where they meet one of the boxes.
fn strands(piece: &Residual, way: V, span: f64, boxes: &[FramedBox]) -> Vec<Ring> {
    let walls = edges(piece).map(|(a, b, held)| {
        let (a, b) = (framed(way, a), framed(way, b));
        if a[1] <= b[1] { Wall { low: a, high: b, held } } else { Wall { low: b, high: a, held } }
    });
    let mut walls: Vec<Wall> = walls.filter(|w| w.low[1] < w.high[1]).collect();
    let mut ranges = ranges(boxes);
    for range in &mut ranges {
        // A strand reaches from one height at which a wall ends to the next.
        let [low, high] = *range;
        let ends = || walls.iter().flat_map(|w| [w.low[1], w.high[1]]);
        range[0] = ends().filter(|&t| t <= low).fold(f64::NEG_INFINITY, f64::max);
        range[1] = ends().filter(|&t| t >= high).fold(f64::INFINITY, f64::min);
    }
    joined(&mut ranges);
    walls.retain(|w| ranges.iter().any(|r| w.low[1] <= r[1] && r[0] <= w.high[1]));
    walls.sort_by(|a, b| a.low[1].total_cmp(&b.low[1]));
    let within = |t: f64| ranges.iter().any(|r| r[0] <= t && t <= r[1]);
    let mut heights: Vec<f64> =
        walls.iter().flat_map(|w| [w.low[1], w.high[1]]).filter(|&t| within(t)).collect();
    heights.sort_by(f64::total_cmp);
    heights.dedup();
    let (mut open, mut next): (Vec<&Wall>, usize) = (Vec::new(), 0);
    let mut done = Vec::new();
    let mut growing: Vec<Strand<'_>> = Vec::new();
    for ends in heights.windows(2) {
        let (low, high) = (ends[0], ends[1]);
        let middle = (low + high) / 2.0;
        if !within(middle) {
            continue;
        }
        while next < walls.len() && walls[next].low[1] <= low {
            open.push(&walls[next]);
            next += 1;
        }
        open.retain(|w| w.high[1] >= high);
        open.sort_by(|a, b| a.at(middle).total_cmp(&b.at(middle)));
        // Both the strands and the pairs come from left to right.
        let mut before = std::mem::take(&mut growing).into_iter().peekable();
        for pair in open.chunks_exact(2) {
            let (l, r) = (pair[0], pair[1]);
            let along = [l.at(low), r.at(low), l.at(high), r.at(high)];
            let width = (along[1] - along[0]).max(along[3] - along[2]);
            if !l.held || !r.held || width > span {
                continue;
            }
            let (from, to) = ([along[0].min(along[2]), low], [along[1].max(along[3]), high]);
            if !boxes.iter().any(|b| b.meets(from, to)) {
                continue;
            }
            while let Some(past) = before.next_if(|s| s.left.end()[0] < along[0] - SAME) {
                done.push(past.ring(way));
            }
            match before.next_if(|s| s.goes_on(low, along)) {
                Some(mut strand) => {
                    strand.left.up_to(l, [along[2], high]);
                    strand.right.up_to(r, [along[3], high]);
                    growing.push(strand);
                }
                None => growing.push(Strand {
                    left: Side { places: vec![[along[0], low], [along[2], high]], last: l },
                    right: Side { places: vec![[along[1], low], [along[3], high]], last: r },
                }),
            }
        }
        done.extend(before.map(|s| s.ring(way)));
    }
    done.extend(growing.into_iter().map(|s| s.ring(way)));
    done
}

/// Strands side by side as one polygon: from low to high.
struct Strand<'a> {
    left: Side<'a>,
    right: Side<'a>,
}

/// A chain of walls from low to high.
struct Side<'a> {
    places: Vec<V>,
    last: &'a Wall,
}

impl<'a> Side<'a> {
    fn end(&self) -> V {
        self.places[self.places.len() - 1]
    }

    fn up_to(&mut self, wall: &'a Wall, end: V) {
        // Along one and the same wall the way is straight.
        if std::ptr::eq(wall, self.last) {
            self.places.pop();
        }
        self.places.push(end);
        self.last = wall;
    }
}

impl Strand<'_> {
    /// Whether it ends where one with these ends (lower left and right first) begins.
    fn goes_on(&self, low: f64, along: [f64; 4]) -> bool {
        let meets = |end: V, at: f64| end[1] == low && (end[0] - at).abs() <= SAME;
        meets(self.left.end(), along[0]) && meets(self.right.end(), along[1])
    }

    /// Its outline, counter-clockwise, wider than it is by a [`HAIR`].
    fn ring(&self, way: V) -> Ring {
        let back = |[s, t]: V| Point {
            x: (way[0] * s - way[1] * t).round() as i32,
            y: (way[1] * s + way[0] * t).round() as i32,
        };
        let wider = |side: &Side<'_>, by: f64| -> Vec<V> {
            let mut places: Vec<V> = side.places.iter().map(|p| [p[0] + by, p[1]]).collect();
            let last = places.len() - 1;
            places[0][1] -= HAIR;
            places[last][1] += HAIR;
            places
        };
        let (left, right) = (wider(&self.left, -HAIR), wider(&self.right, HAIR));
        right.into_iter().chain(left.into_iter().rev()).map(back).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::held::Borders;
    use super::*;
    use crate::layers::polygon::{Inside, resolve};
    use crate::layers::shape::ring_length;
    use proptest::prelude::*;

    /// The area that all chords of a piece leave, each cut out by itself between each two
    /// heights, and none spared.
    fn slowly(piece: &Residual, overhang: &[Polygon], way: V, span: f64) -> f64 {
        let walls: Vec<(V, V, bool)> =
            edges(piece).map(|(a, b, held)| (framed(way, a), framed(way, b), held)).collect();
        let mut heights: Vec<f64> = walls.iter().flat_map(|w| [w.0[1], w.1[1]]).collect();
        heights.sort_by(f64::total_cmp);
        heights.dedup();
        let mut cut: Vec<Ring> = Vec::new();
        for ends in heights.windows(2) {
            let middle = (ends[0] + ends[1]) / 2.0;
            let mut open: Vec<_> = walls.iter().filter(|w| (w.0[1] > middle) != (w.1[1] > middle)).collect();
            let place =
                |w: &(V, V, bool), t: f64| w.0[0] + (w.1[0] - w.0[0]) * (t - w.0[1]) / (w.1[1] - w.0[1]);
            open.sort_by(|a, b| place(a, middle).total_cmp(&place(b, middle)));
            for pair in open.chunks_exact(2).filter(|p| p[0].2 && p[1].2) {
                let width = |t: f64| place(pair[1], t) - place(pair[0], t);
                if width(ends[0]).max(width(ends[1])) <= span {
                    let corners = [(0, 0, -1.0), (1, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0)];
                    let corner = |(side, end, out): (usize, usize, f64)| {
                        let (s, t) = (place(pair[side], ends[end]) + HAIR * out, ends[end]);
                        let t = t + if end == 0 { -HAIR } else { HAIR };
                        let (x, y) = (way[0] * s - way[1] * t, way[1] * s + way[0] * t);
                        Point { x: x.round() as i32, y: y.round() as i32 }
                    };
                    cut.push(corners.map(corner).to_vec());
                }
            }
        }
        without(overhang.iter().flat_map(|p| &p.rings), &cut).area_mm2()
    }

    fn shape(points: usize) -> impl Strategy<Value = Vec<Polygon>> {
        let point = (0..40, 0..40).prop_map(|(x, y)| Point { x: x * 2500, y: y * 2500 });
        let rings = prop::collection::vec(prop::collection::vec(point, 3..points), 1..4);
        rings.prop_map(|r: Vec<Ring>| resolve(&r, Inside::Odd).polygons)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// Strands that are joined, and those that are spared, change nothing.
        #[test]
        fn joined_strands_hold_what_single_ones_do(
            above in shape(9),
            below in shape(9),
            part in shape(5),
            span in 3000.0..60_000.0_f64,
        ) {
            let lower: Vec<&Polygon> = below.iter().collect();
            let rings = |all: &[Polygon]| all.iter().flat_map(|p| p.rings.clone()).collect::<Vec<Ring>>();
            for upper in &above {
                let borders = Borders::new(upper, &lower);
                for residual in without(&upper.rings, &rings(&below)).polygons {
                    let piece = borders.residual(residual);
                    let overhang = crate::layers::polygon::within(&piece.polygon.rings, &rings(&part)).polygons;
                    let border: f64 = overhang.iter().flat_map(|p| &p.rings).map(|r| ring_length(r)).sum();
                    for way in directions(&piece) {
                        let boxes: Vec<FramedBox> = overhang.iter().map(|p| FramedBox::of(p, way)).collect();
                        let strands = strands(&piece, way, span, &boxes);
                        let left = without(overhang.iter().flat_map(|p| &p.rings), &strands).area_mm2();
                        let slow = slowly(&piece, &overhang, way, span);
                        // Hairs along the cuts.
                        let hairs = 1e-4 + 8.0 * border / 1e8;
                        prop_assert!((left - slow).abs() <= hairs, "{left} {slow}");
                    }
                }
            }
        }
    }
}
