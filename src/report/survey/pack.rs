//! A layer's pieces as bytes: the page's format, small and quick to read.
//!
//! All numbers are varints: seven bits a byte, the lowest first, the highest bit
//! set on all but the last byte. Signed ones are zigzag (0, −1, 1, −2 …).
//!
//! ```text
//! layer   := groups, group…          one group a class that is there
//! group   := class, polygons, polygon…
//! polygon := rings, ring…            the outer ring first, then the holes
//! ring    := points, (dx, dy)…       signed steps of the page's grid, from the
//!                                    last point of the layer (0, 0 at first)
//! ```
//!
//! A reader skips no group: a class that it does not know is read and not drawn.
use super::class::{ALL, Class};
use super::simplify::simplified;
use crate::layers::shape::{Point, Polygon, Ring, UNITS_PER_MM};
use crate::report::embed::{put, put_signed};

/// A step of the page's grid, mm.
pub const STEP_MM: f64 = 0.005;

/// Grid steps of [`crate::layers::shape`] in one of the page's.
const UNITS: f64 = STEP_MM * UNITS_PER_MM;

/// Most bytes of one layer; polygons beyond it are left out, the smallest first.
pub const LAYER_BYTES_MAX: usize = 1 << 20;

/// A layer's pieces, packed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Packed {
    /// As the module says.
    pub bytes: Vec<u8>,
    /// Polygons that had no room.
    pub left_out: u32,
}

/// Takes a varint from the front; `None` at the end, and for one of more than 64 bits.
fn take(bytes: &mut &[u8]) -> Option<u64> {
    let mut value = 0_u64;
    for shift in (0..64).step_by(7) {
        let (&byte, rest) = bytes.split_first()?;
        *bytes = rest;
        value |= u64::from(byte & 0x7f) << shift;
        if byte < 0x80 {
            return Some(value);
        }
    }
    None
}

fn take_signed(bytes: &mut &[u8]) -> Option<i64> {
    let value = take(bytes)?;
    Some((value >> 1) as i64 ^ -((value & 1) as i64))
}

fn on_page(ring: &[Point]) -> Ring {
    let step = |c: i32| (f64::from(c) / UNITS).round() as i32;
    let mut points: Ring = ring.iter().map(|p| Point { x: step(p.x), y: step(p.y) }).collect();
    points.dedup();
    if points.len() > 3 && points.first() == points.last() {
        points.pop();
    }
    points
}

/// Packs pieces, simplified to a tolerance in mm.
pub fn pack<'a>(pieces: impl Iterator<Item = (Class, &'a Polygon)>, tolerance_mm: f64) -> Packed {
    let steps = |(class, polygon): (Class, &Polygon)| {
        (class, Polygon { rings: polygon.rings.iter().map(|r| on_page(r)).collect() })
    };
    pack_steps(pieces.map(steps), tolerance_mm)
}

/// Packs what was packed before with another tolerance.
#[must_use]
pub fn repack(bytes: &[u8], tolerance_mm: f64) -> Packed {
    pack_steps(unpack(bytes).unwrap_or_default().into_iter(), tolerance_mm)
}

fn pack_steps(pieces: impl Iterator<Item = (Class, Polygon)>, tolerance_mm: f64) -> Packed {
    let tolerance = tolerance_mm / STEP_MM;
    let mut by_class: [Vec<Polygon>; ALL.len()] = Default::default();
    for (class, polygon) in pieces {
        let rings: Vec<Ring> = polygon.rings.iter().map(|r| simplified(r, tolerance)).collect();
        by_class[class as usize].push(Polygon { rings });
    }
    let points: usize = by_class.iter().flatten().map(Polygon::len).sum();
    let mut packed = write(&by_class);
    // Two bytes a point is the least, so this is seldom reached by what prints.
    if packed.len() > LAYER_BYTES_MAX {
        let before: usize = by_class.iter().map(Vec::len).sum();
        // A point takes at most ten bytes.
        let room = LAYER_BYTES_MAX / (packed.len() / points.max(1) + 1).clamp(2, 10);
        keep_largest(&mut by_class, room);
        packed = write(&by_class);
        let after: usize = by_class.iter().map(Vec::len).sum();
        return Packed { bytes: packed, left_out: (before - after) as u32 };
    }
    Packed { bytes: packed, left_out: 0 }
}

/// Leaves out the smallest polygons so that at most `room` points stay; of equals
/// the last ones.
fn keep_largest(by_class: &mut [Vec<Polygon>; ALL.len()], room: usize) {
    let mut order: Vec<(f64, usize)> = by_class.iter().flatten().map(Polygon::area_mm2).zip(0..).collect();
    order.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let sizes: Vec<usize> = by_class.iter().flatten().map(Polygon::len).collect();
    let mut keep = vec![false; sizes.len()];
    let mut left = room;
    for (_, k) in order {
        if let Some(less) = left.checked_sub(sizes[k]) {
            left = less;
            keep[k] = true;
        }
    }
    let mut keep = keep.into_iter();
    by_class.iter_mut().for_each(|polygons| polygons.retain(|_| keep.next().unwrap_or(false)));
}

fn write(by_class: &[Vec<Polygon>; ALL.len()]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut at = Point::default();
    put(&mut out, by_class.iter().filter(|list| !list.is_empty()).count() as u64);
    for (class, polygons) in by_class.iter().enumerate().filter(|(_, list)| !list.is_empty()) {
        put(&mut out, class as u64);
        put(&mut out, polygons.len() as u64);
        for polygon in polygons {
            put(&mut out, polygon.rings.len() as u64);
            for ring in &polygon.rings {
                put(&mut out, ring.len() as u64);
                for &p in ring {
                    put_signed(&mut out, i64::from(p.x) - i64::from(at.x));
                    put_signed(&mut out, i64::from(p.y) - i64::from(at.y));
                    at = p;
                }
            }
        }
    }
    out
}

/// The pieces of a packed layer, in steps of the page's grid; `None` if the bytes are none.
#[must_use]
pub fn unpack(mut bytes: &[u8]) -> Option<Vec<(Class, Polygon)>> {
    let bytes = &mut bytes;
    let (mut x, mut y) = (0_i64, 0_i64);
    let mut pieces = Vec::new();
    for _ in 0..take(bytes)? {
        let class = *ALL.get(usize::try_from(take(bytes)?).ok()?)?;
        for _ in 0..take(bytes)? {
            let mut polygon = Polygon::default();
            for _ in 0..take(bytes)? {
                let mut ring = Ring::new();
                for _ in 0..take(bytes)? {
                    x = x.checked_add(take_signed(bytes)?)?;
                    y = y.checked_add(take_signed(bytes)?)?;
                    ring.push(Point { x: i32::try_from(x).ok()?, y: i32::try_from(y).ok()? });
                }
                polygon.rings.push(ring);
            }
            pieces.push((class, polygon));
        }
    }
    Some(pieces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::shape::{Bounds, MAX_COORDINATE};
    use proptest::prelude::*;

    fn polygon(points: &[(i32, i32)]) -> Polygon {
        Polygon { rings: vec![points.iter().map(|&(x, y)| Point { x, y }).collect()] }
    }

    #[test]
    fn bytes_are_as_documented() {
        // 50 units a step: a triangle (0,0) (2,0) (0,-1) of the class 3.
        let triangle = polygon(&[(0, 0), (100, 0), (0, -50)]);
        let packed = pack([(Class::Appears, &triangle)].into_iter(), 0.0);
        // It starts at its leftmost, lowest point: (0,-1), then (0,0), (2,0).
        assert_eq!(packed.bytes, [1, 3, 1, 1, 3, 0, 1, 0, 2, 4, 0]);
    }

    #[test]
    fn the_largest_coordinates_come_back() {
        let m = MAX_COORDINATE;
        let wide = polygon(&[(-m, -m), (m, -m), (m, m), (-m, m)]);
        let packed = pack([(Class::Body, &wide)].into_iter(), 0.0);
        let found = unpack(&packed.bytes).expect("what was packed");
        let steps = (f64::from(m) / UNITS).round() as i32;
        let b = found[0].1.bounds();
        assert_eq!((b.min.x, b.max.y), (-steps, steps));
    }

    #[test]
    fn a_huge_layer_keeps_its_largest_pieces() {
        let square = |k: i32, side: i32| {
            let x = k * 400;
            polygon(&[(x, 0), (x + side, 0), (x + side, side), (x, side)])
        };
        let many: Vec<Polygon> =
            (0..120_000).map(|k| square(k, if k % 1000 == 0 { 300 } else { 100 })).collect();
        let packed = pack(many.iter().map(|p| (Class::Body, p)), 0.0);
        assert!(packed.bytes.len() <= LAYER_BYTES_MAX && packed.left_out > 0);
        let found = unpack(&packed.bytes).expect("what was packed");
        assert_eq!(found.len() + packed.left_out as usize, 120_000);
        let large = found.iter().filter(|(_, p)| p.bounds().max.x - p.bounds().min.x == 6).count();
        assert_eq!(large, 120);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn any_bytes_are_read_without_harm(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
            let _ = unpack(&bytes);
        }

        #[test]
        fn what_is_packed_comes_back(
            rings in prop::collection::vec(
                (0..5_usize, prop::collection::vec((-9000..9000_i32, -9000..9000_i32), 3..9)), 0..9),
        ) {
            // On the page's grid already, and no two points alike in a row.
            let pieces: Vec<(Class, Polygon)> = rings
                .iter()
                .map(|(c, ring)| {
                    let points: Vec<_> = ring.iter().enumerate().map(|(k, p)| (p.0 * 50 + k as i32 * 1_000_000, p.1 * 50)).collect();
                    (ALL[*c], polygon(&points))
                })
                .collect();
            let packed = pack(pieces.iter().map(|(c, p)| (*c, p)), 0.0);
            let mut expect: Vec<(Class, Bounds)> = pieces
                .iter()
                .map(|(c, p)| (*c, p.bounds()))
                .collect();
            expect.sort_by_key(|e| e.0);
            let found: Vec<(Class, Bounds)> = unpack(&packed.bytes)
                .unwrap()
                .iter()
                .map(|(c, p)| (*c, p.bounds()))
                .map(|(c, b)| {
                    let times = |p: Point| Point { x: p.x * 50, y: p.y * 50 };
                    (c, Bounds { min: times(b.min), max: times(b.max) })
                })
                .collect();
            prop_assert_eq!(found, expect);
        }
    }
}
