//! Which jumps cross a perimeter: the walls of one layer in a grid of buckets.
//!
//! Takes the segments of a layer's perimeters (centre lines), answers for a
//! straight jump whether it crosses one.
use super::bead::{Point, distance_mm};

/// A jump's ends are drawn in by this much before it is tested, mm: infill
/// overlaps the innermost wall, so its ends may lie on that wall's centre line.
const END_SLACK_MM: f64 = 0.1;

/// Most buckets of a layer; larger layers get larger buckets.
const MAX_BUCKETS: f64 = 65_536.0;

/// Smallest bucket, mm: a few segments of a finely tessellated wall.
const MIN_BUCKET_MM: f64 = 1.0;

/// The walls of one layer.
#[derive(Debug, Default)]
pub struct Walls {
    segments: Vec<[Point; 2]>,
    origin: Point,
    bucket_mm: f64,
    columns: usize,
    rows: usize,
    /// `starts[b]..starts[b + 1]` are bucket b's places in `members`.
    starts: Vec<u32>,
    members: Vec<u32>,
}

impl Walls {
    /// Puts the segments into buckets. Those with a coordinate that is not finite are left out.
    #[must_use]
    pub fn new(segments: Vec<[Point; 2]>) -> Walls {
        let segments: Vec<_> =
            segments.into_iter().filter(|s| s.iter().flatten().all(|c| c.is_finite())).collect();
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for p in segments.iter().flatten() {
            for k in 0..2 {
                low[k] = low[k].min(p[k]);
                high[k] = high[k].max(p[k]);
            }
        }
        if segments.is_empty() {
            return Walls::default();
        }
        let area = (high[0] - low[0] + 1.0) * (high[1] - low[1] + 1.0);
        let bucket_mm = (area / MAX_BUCKETS).sqrt().max(MIN_BUCKET_MM);
        let cells = |k: usize| ((high[k] - low[k]) / bucket_mm) as usize + 1;
        let mut walls =
            Walls { segments, origin: low, bucket_mm, columns: cells(0), rows: cells(1), ..Walls::default() };
        walls.fill();
        walls
    }

    /// Counts, then places: two passes and two flat arrays.
    fn fill(&mut self) {
        let mut starts = vec![0u32; self.columns * self.rows + 1];
        for s in &self.segments {
            self.each_bucket(s[0], s[1], |b| {
                starts[b + 1] += 1;
                false
            });
        }
        for b in 1..starts.len() {
            starts[b] += starts[b - 1];
        }
        let mut next = starts.clone();
        let mut members = vec![0u32; *starts.last().unwrap_or(&0) as usize];
        for (k, s) in self.segments.iter().enumerate() {
            self.each_bucket(s[0], s[1], |b| {
                members[next[b] as usize] = k as u32;
                next[b] += 1;
                false
            });
        }
        self.starts = starts;
        self.members = members;
    }

    /// Visits the buckets of a segment row by row until `found` says true.
    fn each_bucket(&self, a: Point, b: Point, mut found: impl FnMut(usize) -> bool) -> bool {
        if self.columns == 0 {
            return false;
        }
        let (a, b) = if a[1] <= b[1] { (a, b) } else { (b, a) };
        let cell = |v: f64, k: usize, n: usize| {
            (((v - self.origin[k]) / self.bucket_mm).max(0.0) as usize).min(n - 1)
        };
        let slope = if b[1] > a[1] { (b[0] - a[0]) / (b[1] - a[1]) } else { 0.0 };
        for row in cell(a[1], 1, self.rows)..=cell(b[1], 1, self.rows) {
            let low = self.origin[1] + row as f64 * self.bucket_mm;
            let (y0, y1) = (low.clamp(a[1], b[1]), (low + self.bucket_mm).clamp(a[1], b[1]));
            let (x0, x1) = if slope == 0.0 && a[1] == b[1] {
                (a[0], b[0])
            } else {
                (a[0] + slope * (y0 - a[1]), a[0] + slope * (y1 - a[1]))
            };
            let (left, right) = (cell(x0.min(x1), 0, self.columns), cell(x0.max(x1), 0, self.columns));
            for column in left..=right {
                if found(row * self.columns + column) {
                    return true;
                }
            }
        }
        false
    }

    /// Whether the straight jump crosses a wall.
    #[must_use]
    pub fn crosses(&self, from: Point, to: Point) -> bool {
        let length = distance_mm(from, to);
        let slack = END_SLACK_MM.min(length / 4.0);
        if self.segments.is_empty() || length < 1e-9 {
            return false;
        }
        let t = slack / length;
        let along = |t: f64| [from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])];
        let (a, b) = (along(t), along(1.0 - t));
        self.each_bucket(a, b, |bucket| {
            let range = self.starts[bucket] as usize..self.starts[bucket + 1] as usize;
            self.members[range].iter().any(|&k| {
                let [c, d] = self.segments[k as usize];
                intersect(a, b, c, d)
            })
        })
    }
}

/// Whether two segments share a point; touching counts.
fn intersect(a: Point, b: Point, c: Point, d: Point) -> bool {
    let side = |p: Point, q: Point, r: Point| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let (c_side, d_side) = (side(a, b, c), side(a, b, d));
    let (a_side, b_side) = (side(c, d, a), side(c, d, b));
    let overlap = |k: usize| a[k].min(b[k]) <= c[k].max(d[k]) && c[k].min(d[k]) <= a[k].max(b[k]);
    c_side * d_side <= 0.0 && a_side * b_side <= 0.0 && overlap(0) && overlap(1)
}

#[cfg(test)]
mod tests {
    use super::super::bead::testing::point;
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn square() {
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]];
        let walls = Walls::new((0..4).map(|k| [corners[k], corners[(k + 1) % 4]]).collect());
        let check = |from: Point, to: Point, expect: bool| {
            assert_eq!(walls.crosses(from, to), expect, "{from:?} {to:?}");
            assert_eq!(walls.crosses(to, from), expect, "{to:?} {from:?}");
        };
        check([5.0, 5.0], [8.0, 8.0], false);
        check([5.0, 5.0], [15.0, 5.0], true);
        check([-5.0, 5.0], [15.0, 5.0], true);
        check([20.0, 20.0], [30.0, 20.0], false);
        // An end on the wall itself, as overlapping infill has.
        check([10.0, 5.0], [5.0, 5.0], false);
        check([5.0, 5.0], [5.0, 5.0], false);
    }

    #[test]
    fn no_walls_cross_nothing() {
        assert!(!Walls::new(Vec::new()).crosses([0.0, 0.0], [9.0, 9.0]));
        assert!(!Walls::new(vec![[[f64::NAN, 0.0], [1.0, 1.0]]]).crosses([0.0, 0.0], [9.0, 9.0]));
    }

    proptest! {
        #[test]
        fn buckets_miss_nothing(segments in proptest::collection::vec([point(), point()], 0..40), a in point(), b in point()) {
            let walls = Walls::new(segments.clone());
            let slack = (END_SLACK_MM / distance_mm(a, b)).min(0.25);
            let along = |t: f64| [a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1])];
            let plain = segments.iter().any(|s| intersect(along(slack), along(1.0 - slack), s[0], s[1]));
            prop_assert_eq!(walls.crosses(a, b), plain);
        }
    }
}
