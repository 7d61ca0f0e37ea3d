//! Places in cubic cells, and the cells around one.

/// The cell of a place, in cells of this size, mm.
pub(super) fn cell(at_mm: [f64; 3], cell_mm: f64) -> [i32; 3] {
    at_mm.map(|c| (c / cell_mm).floor() as i32)
}

/// A cell and the 26 that it touches.
pub(super) fn around([x, y, z]: [i32; 3]) -> impl Iterator<Item = [i32; 3]> {
    (0..27).map(move |k| [x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn cells_of_places_and_those_around() {
        assert_eq!(cell([0.0, -0.1, 2.5], 0.5), [0, -1, 5]);
        let near: BTreeSet<[i32; 3]> = around([7, 0, -1]).collect();
        assert_eq!(near.len(), 27);
        assert!(
            near.iter()
                .all(|c| (6..=8).contains(&c[0]) && (-1..=1).contains(&c[1]) && (-2..=0).contains(&c[2]))
        );
    }
}
