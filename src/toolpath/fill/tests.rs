use super::*;
use crate::layers::polygon::{Inside, difference, grow, resolve, stroke, union_all};
use crate::layers::shape::{Place, Point as Grid};
use proptest::prelude::*;

fn rectangle(x: f64, y: f64, wide: f64, deep: f64) -> Region {
    let ring = [(x, y), (x + wide, y), (x + wide, y + deep), (x, y + deep)].map(|(x, y)| Grid::from_mm(x, y));
    Region { polygons: vec![Polygon { rings: vec![ring.to_vec()] }] }
}

fn disc(x: f64, y: f64, radius: f64) -> Region {
    stroke(&[vec![Grid::from_mm(x, y)]], radius)
}

/// What beads of a width print along paths.
fn printed(paths: &[Path], width_mm: f64) -> Region {
    let lines: Vec<Vec<Grid>> =
        paths.iter().map(|p| p.points.iter().map(|q| Grid::from_mm(q[0], q[1])).collect()).collect();
    stroke(&lines, width_mm / 2.0)
}

fn solid(width_mm: f64, rings: usize) -> Fill {
    Fill { width_mm, rings, spacing_mm: width_mm, angle_deg: 30.0, phase: Phase::Fitted }
}

#[test]
fn rings_lie_within_each_other() {
    let check = |region: &Region, count: usize, rings_expected: usize, left_mm2: f64| {
        let (paths, left) = rings(region, 0.4, count);
        let number = paths.iter().filter(|p| p.kind == Kind::Ring).count();
        assert_eq!(number, rings_expected, "{count} in {:?}", region.bounds().mm());
        assert!((left.area_mm2() - left_mm2).abs() < 0.02, "{}", left.area_mm2());
    };
    let square = rectangle(0.0, 0.0, 4.0, 4.0);
    check(&square, 0, 0, 16.0);
    check(&square, 1, 1, 3.2 * 3.2);
    check(&square, 2, 2, 2.4 * 2.4);
    check(&square, 9, 5, 0.0);
    let (first, _) = rings(&square, 0.4, 1);
    assert!((first[0].length_mm() - 4.0 * 3.6).abs() < 1e-3);
    assert_eq!(first[0].points.first(), first[0].points.last());
    // Around a hole too.
    let frame = difference(&rectangle(0.0, 0.0, 6.0, 6.0), &rectangle(2.0, 2.0, 2.0, 2.0));
    check(&frame, 1, 2, 5.2 * 5.2 - (4.0 + 3.2 + 0.16 * std::f64::consts::PI));
}

#[test]
fn a_raster_has_its_angle_its_spacing_and_goes_around_holes() {
    let frame = difference(&rectangle(0.0, 0.0, 6.0, 6.0), &rectangle(2.0, 2.0, 2.0, 2.0));
    let check = |spacing: f64, angle: f64, phase: Phase, count: usize, length: f64| {
        let lines = raster(&frame, spacing, angle, phase);
        let total: f64 = lines.iter().map(Path::length_mm).sum();
        assert_eq!(lines.len(), count, "{spacing} {angle} {phase:?}");
        assert!((total - length).abs() < 0.05, "{spacing} {angle} {phase:?}: {total}");
    };
    // At 1, 3 and 5 mm, of which 3 goes through the hole; at 0 too, not at 6.
    check(1.0, 0.0, Phase::Grid, 6 + 2, 4.0 * 6.0 + 2.0 * 4.0);
    check(1.0, 90.0, Phase::Grid, 6 + 2, 4.0 * 6.0 + 2.0 * 4.0);
    // At both borders, and twice through the hole.
    check(2.0, 0.0, Phase::Fitted, 4 + 2, 2.0 * 6.0 + 2.0 * 4.0);
    assert!(raster(&Region::default(), 1.0, 0.0, Phase::Grid).is_empty());
    assert!(!raster(&frame, 0.0, f64::NAN, Phase::Grid).iter().any(|p| p.points.len() < 2));
}

#[test]
fn what_is_narrower_than_a_line_is_never_nothing() {
    let check = |region: &Region, count: usize, length: f64| {
        let paths = fill(region, &solid(0.4, 2));
        assert!(paths.iter().all(|p| p.kind == Kind::Spot));
        let total: f64 = paths.iter().map(Path::length_mm).sum();
        assert_eq!(paths.len(), count, "{paths:?}");
        assert!((total - length).abs() < 0.1, "{total} {length}");
    };
    let dot = std::f64::consts::FRAC_PI_4 * 0.4;
    check(&disc(5.0, 5.0, 0.15), 1, dot);
    check(&rectangle(1.0, 1.0, 1e-3, 1e-3), 1, dot);
    check(&rectangle(1.0, 1.0, 5.0, 0.3), 1, 4.6);
    check(&rectangle(1.0, 1.0, 0.3, 5.0), 1, 4.6);
    // A bow of three quarters of a circle of 3 mm: two lines that follow it, or more.
    let ring = difference(&disc(0.0, 0.0, 3.1), &disc(0.0, 0.0, 2.9));
    let bow = difference(&ring, &rectangle(0.0, 0.0, 9.0, 9.0));
    let paths = fill(&bow, &solid(0.4, 2));
    let total: f64 = paths.iter().map(Path::length_mm).sum();
    assert!((11.0..15.0).contains(&total), "{total}: {paths:?}");
    for p in paths.iter().filter(|p| p.points.len() > 2).flat_map(|p| &p.points) {
        assert!((p[0].hypot(p[1]) - 3.0).abs() < 0.1, "{p:?}");
    }
}

#[test]
fn an_hourglass_and_the_empty_are_survived() {
    let ring = [(0, 0), (90_000, 0), (0, 90_000), (90_000, 90_000)].map(|(x, y)| Grid { x, y }).to_vec();
    let twisted = resolve([&ring], Inside::NonZero);
    assert!(!fill(&twisted, &solid(0.4, 3)).is_empty());
    assert!(fill(&Region::default(), &solid(0.4, 3)).is_empty());
    let nothing = Region { polygons: vec![Polygon { rings: vec![] }, Polygon { rings: vec![vec![]] }] };
    assert!(fill(&nothing, &solid(0.4, 3)).is_empty());
    for width in [0.0, -1.0, f64::NAN, 1e9] {
        let _ = fill(&rectangle(0.0, 0.0, 3.0, 3.0), &solid(width, 2));
    }
}

/// Some discs and rectangles, united, some cut out again.
fn region() -> impl Strategy<Value = Region> {
    let piece = (0.0..12.0f64, 0.0..12.0f64, 1.0..5.0f64, 1.0..5.0f64, 0..3u8);
    proptest::collection::vec(piece, 1..6).prop_map(|pieces| {
        let shape = |&(x, y, a, b, kind): &(f64, f64, f64, f64, u8)| match kind {
            0 => rectangle(x, y, a, b),
            _ => disc(x, y, a / 2.0),
        };
        let (cut, body): (Vec<_>, Vec<_>) = pieces.iter().enumerate().partition(|(k, p)| *k > 0 && p.4 == 2);
        let body: Vec<Region> = body.iter().map(|(_, p)| shape(p)).collect();
        let cut: Vec<Region> = cut.iter().map(|(_, p)| shape(p)).collect();
        difference(&union_all(&body), &union_all(&cut))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn beads_fill_the_region_and_nothing_else(region in region(), rings in 0usize..4, angle in 0.0..180.0f64) {
        let width = 0.4;
        let how = Fill { angle_deg: angle, ..solid(width, rings) };
        let paths = fill(&region, &how);
        prop_assert_eq!(&paths, &fill(&region, &how));
        let (spots, lines): (Vec<Path>, Vec<Path>) = paths.into_iter().partition(|p| p.kind == Kind::Spot);
        // Beads lie in the region, but for roundings; those of spots reach a width beyond.
        let beyond = difference(&printed(&lines, width), &grow(&region, 0.01));
        prop_assert!(beyond.area_mm2() < 1e-3, "{} mm² beyond", beyond.area_mm2());
        let beyond = difference(&printed(&spots, width), &grow(&region, width));
        prop_assert!(beyond.area_mm2() < 1e-3, "{} mm² of spots beyond", beyond.area_mm2());
        // What a bead fits into is covered, but for what round ends and corners leave, a strip
        // along borders that the raster runs a little askew to, and without rings the lines'
        // ends along the border.
        let fits = grow(&grow(&region, -width / 2.0), width / 2.0);
        let all: Vec<Path> = lines.into_iter().chain(spots).collect();
        let bare = difference(&fits, &printed(&all, width));
        let around: f64 = region.rings().map(|r| closed(r).length_mm()).sum();
        let most = 0.03 * fits.area_mm2() + if rings == 0 { 0.5 } else { 0.25 } * width * around;
        prop_assert!(bare.area_mm2() <= most, "{} of {}, {} around", bare.area_mm2(), fits.area_mm2(), around);
        for polygon in &region.polygons {
            let touched = all.iter().any(|p| p.points.iter().chain([&middle(p)]).any(|q| polygon.place(Grid::from_mm(q[0], q[1])) != Place::Outside));
            prop_assert!(touched, "a polygon of {} mm² has no bead", polygon.area_mm2());
        }
    }

    #[test]
    fn sparse_lines_are_as_long_as_their_share(region in region(), spacing in 0.5..2.0f64, angle in 0.0..180.0f64) {
        let lines = raster(&region, spacing, angle, Phase::Grid);
        let length: f64 = lines.iter().map(Path::length_mm).sum();
        // Each line stands for a strip of the spacing: off by a strip's end at each polygon's border.
        let around: f64 = region.rings().map(|r| closed(r).length_mm()).sum();
        prop_assert!((length * spacing - region.area_mm2()).abs() <= spacing * around);
        for p in lines.iter().flat_map(|l| &l.points) {
            let near = grow(&region, 0.001);
            prop_assert!(near.place(Grid::from_mm(p[0], p[1])) != Place::Outside);
        }
    }
}

fn middle(path: &Path) -> Point {
    let (a, b) = (path.points[0], path.points[path.points.len() - 1]);
    [f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])]
}
