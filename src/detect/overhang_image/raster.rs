//! Polygons as pixels: runs of a row, and where borders cross the lines of centres.
//!
//! Takes polygons and a grid of pixels over some bounds, gives the pixels whose centres lie
//! inside. Everything is counted from the grid's corner. Knows no layer.
use crate::detect::slabs::{Edge, edges};
use crate::layers::shape::{Bounds, Polygon};

/// Pixels along a side of a grid at most; beyond it pixels get larger.
pub(super) const MOST_PIXELS: f64 = 65_536.0;

/// Crossings of borders with lines at most (about 250 MB); beyond it pixels get larger.
const MOST_CROSSINGS: f64 = 3e7;

/// Length of the borders along both axes within some bounds, at most, grid steps.
fn border(polygons: &[&Polygon], bounds: Bounds) -> f64 {
    let inside = |low: i32, high: i32, a: i32, b: i32| {
        (f64::from(a.max(b).min(high)) - f64::from(a.min(b).max(low))).max(0.0)
    };
    let edge = |(a, b): Edge| {
        inside(bounds.min.x, bounds.max.x, a.x, b.x) + inside(bounds.min.y, bounds.max.y, a.y, b.y)
    };
    polygons.iter().flat_map(|p| &p.rings).flat_map(edges).map(edge).sum()
}

/// Where the pixels are, in steps of the layers' grid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grid {
    low: [f64; 2],
    /// Side of a pixel.
    pub(super) pixel: f64,
    columns: i32,
    rows: i32,
}

impl Grid {
    /// Over some bounds. Pixels lie at whole multiples of their size from the origin, so
    /// that those of all polygons agree.
    pub(super) fn over(bounds: Bounds, pixel: f64, polygons: &[&Polygon]) -> Grid {
        let ends = |low: i32, high: i32| (f64::from(low), f64::from(high));
        let (x, y) = (ends(bounds.min.x, bounds.max.x), ends(bounds.min.y, bounds.max.y));
        let widest = (x.1 - x.0).max(y.1 - y.0).max(1.0);
        let pixel = pixel.max(widest / MOST_PIXELS).max(border(polygons, bounds) / MOST_CROSSINGS);
        let low = [(x.0 / pixel).floor() * pixel, (y.0 / pixel).floor() * pixel];
        let count = |k: usize, high: f64| ((high - low[k]) / pixel).ceil() as i32 + 1;
        Grid { low, pixel, columns: count(0, x.1), rows: count(1, y.1) }
    }

    pub(super) fn centre(&self, x: i32, row: i32) -> [f64; 2] {
        let [left, bottom] = self.corner(x, row);
        [left + self.pixel / 2.0, bottom + self.pixel / 2.0]
    }

    pub(super) fn corner(&self, x: i32, row: i32) -> [f64; 2] {
        [self.low[0] + f64::from(x) * self.pixel, self.low[1] + f64::from(row) * self.pixel]
    }
}

/// For each line through centres the places where borders cross it, ascending.
struct Lines(Vec<Vec<f64>>);

impl Lines {
    /// Rows (`axis` 1) or columns (`axis` 0).
    fn of(polygons: &[&Polygon], grid: &Grid, axis: usize) -> Lines {
        let count = if axis == 1 { grid.rows } else { grid.columns };
        let mut lines = vec![Vec::new(); count.max(0) as usize];
        let all = polygons.iter().flat_map(|p| &p.rings).flat_map(edges);
        all.for_each(|edge| cross(edge, grid, axis, &mut lines));
        lines.iter_mut().for_each(|l| l.sort_unstable_by(f64::total_cmp));
        Lines(lines)
    }
}

/// Notes where an edge crosses the lines. A line belongs to the edge's lower end, not to
/// its upper one, so that a line through a vertex is crossed as often as it should be.
fn cross((a, b): Edge, grid: &Grid, axis: usize, lines: &mut [Vec<f64>]) {
    let at = |p: crate::layers::shape::Point| [f64::from(p.x), f64::from(p.y)];
    let (a, b) = (at(a), at(b));
    let (low, high) = if a[axis] <= b[axis] { (a, b) } else { (b, a) };
    let first = ((low[axis] - grid.low[axis]) / grid.pixel - 0.5).ceil().max(0.0) as usize;
    for (k, line) in lines.iter_mut().enumerate().skip(first) {
        let height = grid.low[axis] + (k as f64 + 0.5) * grid.pixel;
        if height >= high[axis] {
            break;
        }
        if height >= low[axis] {
            let part = (height - low[axis]) / (high[axis] - low[axis]);
            line.push(low[1 - axis] + (high[1 - axis] - low[1 - axis]) * part);
        }
    }
}

/// Runs of a row, ascending.
pub(super) type Runs = Vec<(i32, i32)>;

/// Runs of pixels by row; each is from the first on to before the second.
pub(super) struct Raster {
    pub(super) rows: Vec<Runs>,
}

impl Raster {
    /// The pixels whose centres lie in any of the polygons.
    pub(super) fn of(polygons: &[&Polygon], grid: &Grid) -> Raster {
        let mut rows: Vec<Runs> = vec![Vec::new(); grid.rows.max(0) as usize];
        let column = |x: f64| {
            let k = ((x - grid.low[0]) / grid.pixel - 0.5).ceil();
            k.clamp(0.0, f64::from(grid.columns)) as i32
        };
        for polygon in polygons {
            for (row, line) in rows.iter_mut().zip(&Lines::of(&[polygon], grid, 1).0) {
                let runs = line.chunks_exact(2).map(|pair| (column(pair[0]), column(pair[1])));
                row.extend(runs.filter(|r| r.0 < r.1));
            }
        }
        rows.iter_mut().for_each(unite);
        Raster { rows }
    }

    /// The run of a row that holds a column.
    pub(super) fn run(&self, x: i32, row: usize) -> Option<usize> {
        let runs = self.rows.get(row)?;
        let after = runs.partition_point(|r| r.0 <= x);
        let run = after.checked_sub(1)?;
        (x < runs[run].1).then_some(run)
    }

    pub(super) fn holds(&self, x: i32, row: i32) -> bool {
        usize::try_from(row).is_ok_and(|row| self.run(x, row).is_some())
    }

    /// The pixels that the other has not.
    pub(super) fn minus(&self, other: &Raster) -> Raster {
        let row = |(own, cut): (&Runs, &Runs)| {
            let mut left = Vec::new();
            for &(from, to) in own {
                let mut x = from;
                let skip = cut.partition_point(|c| c.1 <= from);
                for &(a, b) in cut[skip..].iter().take_while(|c| c.0 < to) {
                    if x < a {
                        left.push((x, a));
                    }
                    x = x.max(b);
                }
                if x < to {
                    left.push((x, to));
                }
            }
            left
        };
        Raster { rows: self.rows.iter().zip(&other.rows).map(row).collect() }
    }
}

/// Sorts runs and joins those that meet.
fn unite(runs: &mut Vec<(i32, i32)>) {
    runs.sort_unstable();
    let mut kept: Vec<(i32, i32)> = Vec::with_capacity(runs.len());
    for &(from, to) in runs.iter() {
        match kept.last_mut() {
            Some(last) if from <= last.1 => last.1 = last.1.max(to),
            _ => kept.push((from, to)),
        }
    }
    *runs = kept;
}

/// Where borders cross the lines through the centres.
pub(super) struct Crossings {
    along_rows: Lines,
    along_columns: Lines,
}

impl Crossings {
    pub(super) fn of(polygons: &[&Polygon], grid: &Grid) -> Crossings {
        Crossings { along_rows: Lines::of(polygons, grid, 1), along_columns: Lines::of(polygons, grid, 0) }
    }

    /// Where the border lies between the centre of a pixel and that of a neighbour; the
    /// crossing nearest to the pixel, half way where none is found.
    pub(super) fn between(&self, x: i32, row: i32, dx: i32, dy: i32, grid: &Grid) -> [f64; 2] {
        let here = grid.centre(x, row);
        let axis = usize::from(dx == 0);
        let line = if axis == 0 {
            self.along_rows.0.get(row as usize)
        } else {
            self.along_columns.0.get(x as usize)
        };
        let step = f64::from(dx + dy) * grid.pixel;
        let (low, high) = (here[axis].min(here[axis] + step), here[axis].max(here[axis] + step));
        let inside =
            line.map_or(&[][..], |l| &l[l.partition_point(|v| *v < low)..l.partition_point(|v| *v <= high)]);
        let place = if step > 0.0 { inside.first() } else { inside.last() };
        let mut found = here;
        found[axis] = place.copied().unwrap_or(here[axis] + step / 2.0);
        found
    }

    /// All of them.
    pub(super) fn points(&self, grid: &Grid) -> Vec<[f64; 2]> {
        let centre = |k: usize| grid.centre(k as i32, k as i32);
        let rows = self.along_rows.0.iter().enumerate();
        let columns = self.along_columns.0.iter().enumerate();
        rows.flat_map(|(k, l)| l.iter().map(move |&x| [x, centre(k)[1]]))
            .chain(columns.flat_map(|(k, l)| l.iter().map(move |&y| [centre(k)[0], y])))
            .collect()
    }
}
