//! Rings with fewer points that lie no farther than a tolerance from the old line.
//!
//! One pass with a wedge of directions (Williams' cone method): from a kept
//! point, every point passed over leaves the directions that come within the
//! tolerance of it; a point outside of what is left ends the segment. Linear in
//! the number of points, whatever the ring. The result may touch itself: it is
//! for the eye only.
use crate::layers::shape::{Point, Ring};

type Vector = [f64; 2];

fn cross(a: Vector, b: Vector) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// The directions in which a segment may go on.
struct Wedge {
    anchor: Point,
    tolerance: f64,
    /// Clockwise and counter-clockwise ends; `None`: every direction.
    ends: Option<[Vector; 2]>,
    /// Farthest point passed over.
    reach: f64,
}

impl Wedge {
    fn from(anchor: Point, tolerance: f64) -> Wedge {
        Wedge { anchor, tolerance, ends: None, reach: 0.0 }
    }

    /// Whether a segment to `p` comes within the tolerance of all points passed
    /// over; if so `p` is passed over too.
    fn takes(&mut self, p: Point) -> bool {
        let v = [f64::from(p.x) - f64::from(self.anchor.x), f64::from(p.y) - f64::from(self.anchor.y)];
        let distance = dot(v, v).sqrt();
        // Back towards the anchor: the line would be shorter than what it stands for.
        if distance < self.reach - self.tolerance {
            return false;
        }
        if let Some([right, left]) = self.ends
            && (cross(right, v) < 0.0 || cross(v, left) < 0.0 || dot(v, right) + dot(v, left) < 0.0)
        {
            return false;
        }
        self.reach = self.reach.max(distance);
        if distance > self.tolerance {
            let sine = self.tolerance / distance;
            let cosine = (1.0 - sine * sine).sqrt();
            let turned = |s: f64| [v[0] * cosine - v[1] * s, v[0] * s + v[1] * cosine];
            let (mut right, mut left) = (turned(-sine), turned(sine));
            if let Some([old_right, old_left]) = self.ends {
                if cross(right, old_right) > 0.0 {
                    right = old_right;
                }
                if cross(left, old_left) < 0.0 {
                    left = old_left;
                }
            }
            self.ends = Some([right, left]);
        }
        true
    }
}

/// The ring with fewer points; no point of the old line is farther from the new
/// one than about the tolerance, in grid steps. A ring keeps at least three
/// points, so that a tiny island is still drawn.
pub(super) fn simplified(ring: &[Point], tolerance: f64) -> Ring {
    // A point at the rim of the ring is a corner, so that it may be kept for sure.
    let Some(start) = (0..ring.len()).min_by_key(|&k| ring[k]) else { return Ring::new() };
    let at = |k: usize| ring[(start + k) % ring.len()];
    let mut kept = vec![at(0)];
    let mut wedge = Wedge::from(at(0), tolerance);
    for k in 1..=ring.len() {
        if !wedge.takes(at(k)) {
            let anchor = at(k - 1);
            kept.push(anchor);
            wedge = Wedge::from(anchor, tolerance);
            wedge.takes(at(k));
        }
    }
    if kept.len() >= 3 || ring.len() < 3 {
        return kept;
    }
    if ring.len() <= 6 {
        return ring.to_vec();
    }
    // What is left is thinner than the tolerance: its outermost points stand for it.
    let (x, y) = (|k: usize| i64::from(ring[k].x), |k: usize| i64::from(ring[k].y));
    let mut corners = Vec::with_capacity(8);
    let outermost: [&dyn Fn(usize) -> i64; 4] = [&x, &y, &|k| x(k) + y(k), &|k| x(k) - y(k)];
    for by in outermost {
        corners.extend((0..ring.len()).min_by_key(|&k| by(k)));
        corners.extend((0..ring.len()).max_by_key(|&k| by(k)));
    }
    corners.sort_unstable();
    corners.dedup();
    if corners.len() < 3 {
        corners = vec![0, ring.len() / 3, 2 * ring.len() / 3];
    }
    corners.into_iter().map(|k| ring[k]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Distance of a point from a segment.
    fn distance(p: Point, a: Point, b: Point) -> f64 {
        let v = |a: Point, b: Point| [f64::from(b.x) - f64::from(a.x), f64::from(b.y) - f64::from(a.y)];
        let (ab, ap) = (v(a, b), v(a, p));
        let t = (dot(ab, ap) / dot(ab, ab).max(1e-9)).clamp(0.0, 1.0);
        (ap[0] - t * ab[0]).hypot(ap[1] - t * ab[1])
    }

    fn farthest(old: &[Point], new: &[Point]) -> f64 {
        let nearest = |p: &Point| {
            (0..new.len()).map(|k| distance(*p, new[k], new[(k + 1) % new.len()])).fold(f64::MAX, f64::min)
        };
        old.iter().map(nearest).fold(0.0, f64::max)
    }

    #[test]
    fn a_circle_needs_few_points_and_a_square_four() {
        let circle: Ring = (0..3600)
            .map(|k| f64::from(k) / 3600.0 * std::f64::consts::TAU)
            .map(|a| Point { x: (1e5 * a.cos()) as i32, y: (1e5 * a.sin()) as i32 })
            .collect();
        let few = simplified(&circle, 100.0);
        // A chord may leave the circle by the tolerance on one side of its ends: about 70 chords.
        assert!((35..110).contains(&few.len()), "{}", few.len());
        assert!(farthest(&circle, &few) <= 101.0);
        let side = |from: [i32; 2], step: [i32; 2]| {
            (0..100).map(move |k| Point { x: from[0] + k * step[0], y: from[1] + k * step[1] })
        };
        let square: Ring = side([0, 0], [9, 0])
            .chain(side([900, 0], [0, 9]))
            .chain(side([900, 900], [-9, 0]))
            .chain(side([0, 900], [0, -9]))
            .collect();
        assert_eq!(simplified(&square, 1.0).len(), 4);
    }

    #[test]
    fn a_ring_never_vanishes() {
        let dot: Ring = (0..20).map(|k| Point { x: k % 5, y: k / 5 }).collect();
        assert!(simplified(&dot, 1000.0).len() >= 3);
        let square = [(0, 0), (2, 0), (2, 2), (0, 2)].map(|(x, y)| Point { x, y });
        assert_eq!(simplified(&square, 1000.0).len(), 4);
        assert!(simplified(&[], 1.0).is_empty());
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]
        #[test]
        fn no_point_is_left_far_behind(
            points in prop::collection::vec((-500..500_i32, -500..500_i32), 3..60),
            tolerance in 0..200_i32,
        ) {
            let ring: Ring = points.into_iter().map(|(x, y)| Point { x, y }).collect();
            let tolerance = f64::from(tolerance);
            let few = simplified(&ring, tolerance);
            if few.len() >= 5 {
                prop_assert!(farthest(&ring, &few) <= tolerance * 1.5 + 1.0, "{few:?}");
            }
            prop_assert!(few.iter().all(|p| ring.contains(p)));
        }
    }
}
