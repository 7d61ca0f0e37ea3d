//! Parallel lines through rings: where they are inside.
//!
//! Takes rings, and how a point of the plate is seen from the lines: how far along them it
//! lies and how far across. By the even-odd rule; a line through a vertex counts it once,
//! since an edge has its lower end and not its upper one.
use super::shape::{Point, Ring, ring_edges};

/// For each of some lines, told by how far across they lie (ascending), the pieces
/// that are inside: from and to, along the line. In proportion to the vertices and the
/// crossings.
pub fn spans<'a>(
    rings: impl IntoIterator<Item = &'a Ring>,
    seen: impl Fn(Point) -> [f64; 2],
    offsets: &[f64],
) -> Vec<Vec<[f64; 2]>> {
    let mut crossings: Vec<Vec<f64>> = vec![Vec::new(); offsets.len()];
    for [a, b] in rings.into_iter().flat_map(|ring| ring_edges(ring)) {
        let (a, b) = (seen(a), seen(b));
        let (low, high) = if a[1] < b[1] { (a, b) } else { (b, a) };
        let from = offsets.partition_point(|&y| y < low[1]);
        let to = offsets.partition_point(|&y| y < high[1]);
        for k in from..to {
            let t = (offsets[k] - low[1]) / (high[1] - low[1]);
            crossings[k].push(low[0] + t * (high[0] - low[0]));
        }
    }
    let pieces = |mut xs: Vec<f64>| {
        xs.sort_unstable_by(f64::total_cmp);
        xs.chunks_exact(2).map(|pair| [pair[0], pair[1]]).filter(|[from, to]| from < to).collect()
    };
    crossings.into_iter().map(pieces).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn vertices_count_once() {
        let ring =
            |points: &[(f64, f64)]| points.iter().map(|(x, y)| Point::from_mm(*x, *y)).collect::<Ring>();
        let diamond = [ring(&[(0.0, 1.0), (1.0, 0.0), (2.0, 1.0), (1.0, 2.0)])];
        let check = |offsets: &[f64], expect: &[&[[f64; 2]]]| {
            assert_eq!(spans(&diamond, Point::mm, offsets), expect, "{offsets:?}");
        };
        check(&[], &[]);
        check(
            &[-1.0, 0.0, 0.5, 1.0, 1.5, 2.0, 3.0],
            &[&[], &[], &[[0.5, 1.5]], &[[0.0, 2.0]], &[[0.5, 1.5]], &[], &[]],
        );
        // Seen from the side, and two rings that lie within each other.
        let both = [diamond[0].clone(), ring(&[(0.5, 1.0), (1.0, 0.5), (1.5, 1.0), (1.0, 1.5)])];
        let turned = spans(
            &both,
            |p| {
                let [x, y] = p.mm();
                [y, x]
            },
            &[1.0],
        );
        assert_eq!(turned, [vec![[0.0, 0.5], [1.5, 2.0]]]);
    }
}
