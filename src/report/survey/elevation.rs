//! A job seen from the front and from the side: which stretches of each layer are what.
//!
//! A polygon is connected, so what is seen of it from the front is the whole
//! stretch between its lowest and highest x. Takes layers, keeps rows of such
//! stretches: at most [`ROWS_MAX`] rows of at most [`RUNS_MAX`] stretches a
//! class, whatever the job.
use super::Seen;
use super::class::{ALL, Class};

/// Most rows; beyond it two become one.
pub const ROWS_MAX: usize = 4096;

/// Most stretches of one class in one row; beyond it near ones become one.
pub const RUNS_MAX: usize = 64;

/// A stretch of x or y, grid steps.
pub type Run = [i32; 2];

/// What is seen of some neighbouring layers.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Row {
    /// Height where it begins, mm.
    pub bottom_mm: f64,
    /// Height where it ends, mm.
    pub top_mm: f64,
    /// Layers in it.
    layers: u32,
    /// Seen from the front (stretches of x) and from the right (of y), by class.
    runs: [[Vec<Run>; ALL.len()]; 2],
}

/// The rows from the plate up.
#[derive(Clone, Debug)]
pub struct Elevation {
    rows: Vec<Row>,
    /// Layers a row.
    stride: u32,
}

impl Default for Elevation {
    fn default() -> Elevation {
        Elevation { rows: Vec::new(), stride: 1 }
    }
}

impl Row {
    /// Stretches of a class: `axis` 0 from the front, 1 from the right.
    #[must_use]
    pub fn runs(&self, axis: usize, class: Class) -> &[Run] {
        &self.runs[axis][class as usize]
    }

    fn of(seen: Seen) -> Row {
        let mut row =
            Row { bottom_mm: seen.layer.bottom_mm, top_mm: seen.layer.top_mm, layers: 1, ..Row::default() };
        for (class, polygon) in seen.pieces() {
            let bounds = polygon.bounds();
            if bounds.min.x <= bounds.max.x {
                row.runs[0][class as usize].push([bounds.min.x, bounds.max.x]);
                row.runs[1][class as usize].push([bounds.min.y, bounds.max.y]);
            }
        }
        row.runs.iter_mut().flatten().for_each(unite);
        row
    }

    fn join(&mut self, other: Row) {
        self.top_mm = self.top_mm.max(other.top_mm);
        self.bottom_mm = self.bottom_mm.min(other.bottom_mm);
        self.layers += other.layers;
        for (own, others) in self.runs.iter_mut().flatten().zip(other.runs.into_iter().flatten()) {
            own.extend(others);
            unite(own);
        }
    }
}

impl Elevation {
    /// The rows from the plate up.
    #[must_use]
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// Takes the next layer.
    pub fn add(&mut self, seen: Seen) {
        let row = Row::of(seen);
        match self.rows.last_mut() {
            Some(last) if last.layers < self.stride => last.join(row),
            _ => self.rows.push(row),
        }
        if self.rows.len() > ROWS_MAX {
            let mut halved: Vec<Row> = Vec::with_capacity(ROWS_MAX);
            for (k, row) in std::mem::take(&mut self.rows).into_iter().enumerate() {
                match halved.last_mut() {
                    Some(last) if k % 2 == 1 => last.join(row),
                    _ => halved.push(row),
                }
            }
            self.rows = halved;
            self.stride = self.stride.saturating_mul(2);
        }
    }
}

/// Stretches in order, those that overlap or touch made one, and near ones where there are too many.
fn unite(runs: &mut Vec<Run>) {
    let mut gap = 0_i64;
    runs.sort_unstable();
    loop {
        runs.dedup_by(|next, last| {
            let joined = i64::from(next[0]) - i64::from(last[1]) <= gap;
            if joined {
                last[1] = last[1].max(next[1]);
            }
            joined
        });
        if runs.len() <= RUNS_MAX {
            return;
        }
        // From 0.01 mm on.
        gap = (gap * 2).max(100);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::island::Standing;
    use crate::layers::shape::{Point, Polygon, Region};
    use crate::layers::stack::Layer;

    fn square(x: i32, y: i32, side: i32) -> Polygon {
        let corners = [(x, y), (x + side, y), (x + side, y + side), (x, y + side)];
        Polygon { rings: vec![corners.map(|(x, y)| Point { x, y }).to_vec()] }
    }

    fn layer(number: u32, polygons: Vec<Polygon>) -> Layer {
        Layer {
            number,
            bottom_mm: f64::from(number) * 0.5,
            top_mm: f64::from(number + 1) * 0.5,
            part: Region { polygons },
            ..Layer::default()
        }
    }

    fn add(to: &mut Elevation, layer: &Layer, standings: &[Standing]) {
        to.add(Seen { layer, standings, overhangs: &[] });
    }

    #[test]
    fn stretches_are_those_of_the_bounds() {
        let mut elevation = Elevation::default();
        let polygons = vec![square(0, 0, 10), square(5, 90, 20), square(100, 7, 1)];
        add(&mut elevation, &layer(0, polygons), &[Standing::Body, Standing::Body, Standing::Appears]);
        let row = &elevation.rows()[0];
        assert_eq!(row.runs(0, Class::Body), [[0, 25]]);
        assert_eq!(row.runs(1, Class::Body), [[0, 10], [90, 110]]);
        assert_eq!(row.runs(0, Class::Appears), [[100, 101]]);
        assert!(row.runs(0, Class::Island).is_empty());
    }

    #[test]
    fn many_layers_and_many_pieces_stay_few() {
        let mut elevation = Elevation::default();
        for number in 0..10_000 {
            let standing = if number == 7_777 { Standing::Appears } else { Standing::Body };
            add(&mut elevation, &layer(number, vec![square(0, 0, 10)]), &[standing]);
        }
        let rows = elevation.rows();
        assert!(rows.len() <= ROWS_MAX && rows.len() > ROWS_MAX / 2, "{}", rows.len());
        assert_eq!(rows.iter().map(|r| r.layers).sum::<u32>(), 10_000);
        let island: Vec<_> = rows.iter().filter(|r| !r.runs(0, Class::Appears).is_empty()).collect();
        assert_eq!(island.len(), 1);
        assert!(island[0].bottom_mm <= 3888.5 && island[0].top_mm >= 3889.0);
        assert!(rows.windows(2).all(|w| w[0].top_mm == w[1].bottom_mm));

        let mut comb = Elevation::default();
        add(&mut comb, &layer(0, (0..5000).map(|k| square(k * 1000, 0, 10)).collect()), &[]);
        let runs = comb.rows()[0].runs(0, Class::Body);
        assert!(runs.len() <= RUNS_MAX);
        assert_eq!((runs[0][0], runs[runs.len() - 1][1]), (0, 4_999_010));
    }
}
