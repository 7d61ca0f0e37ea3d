//! The same checks pixel by pixel, slow and plain, to hold the fast ones against; and pictures to check.
use crate::layers::raster::Raster;
use crate::layers::raster::testing::{flood, of};
use proptest::prelude::*;

/// Rows of brightness.
pub(super) type Grey = Vec<Vec<u8>>;

pub(super) fn raster(rows: &Grey) -> Raster {
    of(&rows.iter().map(|row| &row[..]).collect::<Vec<_>>())
}

/// Any picture of larger and smaller spots, with brightness on both sides of every level.
pub(super) fn grey(width: usize, height: usize) -> impl Strategy<Value = Grey> {
    let brightness = prop_oneof![
        3 => Just(255_u8),
        3 => Just(0_u8),
        1 => prop::sample::select(vec![1_u8, 9, 10, 30, 31, 99, 100, 126, 127, 128, 149, 150]),
    ];
    let rectangle = (0..width, 0..height, 1..=width, 1..=height, brightness);
    prop::collection::vec(rectangle, 0..7).prop_map(move |rectangles| {
        let mut rows = vec![vec![0; width]; height];
        for (x, y, w, h, brightness) in rectangles {
            for row in rows.iter_mut().skip(y).take(h) {
                row.iter_mut().skip(x).take(w).for_each(|pixel| *pixel = brightness);
            }
        }
        rows
    })
}

fn bits(rows: &Grey, has: impl Fn(u8) -> bool) -> Vec<Vec<bool>> {
    rows.iter().map(|row| row.iter().map(|&pixel| has(pixel)).collect()).collect()
}

/// Areas of the islands, px.
pub(super) fn islands(layer: &Grey, below: &Grey) -> Vec<u64> {
    let pieces = flood(&bits(layer, |pixel| pixel >= 10));
    let held = |piece: &[(u32, u32)]| {
        let held = piece.iter().filter(|p| below[p.1 as usize][p.0 as usize] >= 150).count() as f64;
        held >= (0.25 * piece.len() as f64).max(1.0)
    };
    pieces.iter().filter(|piece| !held(piece)).map(|piece| piece.len() as u64).collect()
}

/// Areas of the overhangs, px: those of which a pixel is farther than that from all that is not theirs.
pub(super) fn overhangs(layer: &Grey, below: &Grey, erosions: u32) -> Vec<u64> {
    let (layer, below) = (bits(layer, |pixel| pixel >= 128), bits(below, |pixel| pixel >= 128));
    let free: Vec<Vec<bool>> =
        layer.iter().zip(&below).map(|(a, b)| a.iter().zip(b).map(|(&a, &b)| a && !b).collect()).collect();
    let mut others = Vec::new();
    for (y, row) in free.iter().enumerate() {
        others.extend(row.iter().enumerate().filter(|(_, free)| !**free).map(|(x, _)| (x as u32, y as u32)));
    }
    let far = |p: &(u32, u32)| others.iter().all(|o| p.0.abs_diff(o.0) + p.1.abs_diff(o.1) > erosions);
    flood(&free).iter().filter(|piece| piece.iter().any(far)).map(|piece| piece.len() as u64).collect()
}

/// Pixels within 5 px of the edges.
pub(super) fn margin(layer: &Grey) -> u64 {
    let (width, height) = (layer[0].len(), layer.len());
    let near = |x: usize, y: usize| x < 5 || y < 5 || x + 5 >= width || y + 5 >= height;
    let mut pixels = 0;
    for (y, row) in layer.iter().enumerate() {
        pixels += row.iter().enumerate().filter(|&(x, &pixel)| pixel >= 127 && near(x, y)).count();
    }
    pixels as u64
}

/// First and last layer of each resin trap, in order: hollows that a flood from the panel's edges and
/// from behind the last layer does not reach.
pub(super) fn traps(layers: &[Grey]) -> Vec<[u32; 2]> {
    let (width, height) = (layers[0][0].len() as u32, layers[0].len() as u32);
    let hollows: Vec<Vec<Vec<(u32, u32)>>> =
        layers.iter().map(|layer| flood(&bits(layer, |pixel| pixel < 100))).collect();
    let dark = |layer: usize, p: &(u32, u32)| layers[layer][p.1 as usize][p.0 as usize] <= 30;
    let linked = |low: usize, a: usize, b: usize| {
        let both = |p: &&(u32, u32)| hollows[low][a].contains(*p) && dark(low, p) && dark(low + 1, p);
        hollows[low + 1][b].iter().filter(both).count() >= 10
    };
    let edge = |p: &(u32, u32)| p.0 == 0 || p.1 == 0 || p.0 + 1 == width || p.1 + 1 == height;
    // Which set each hollow is in, by spreading the smallest number until nothing changes.
    let mut set: Vec<Vec<usize>> = Vec::new();
    let mut count = 0;
    for layer in &hollows {
        set.push((count..count + layer.len()).collect());
        count += layer.len();
    }
    loop {
        let before = set.clone();
        for low in 0..layers.len() - 1 {
            for a in 0..hollows[low].len() {
                for b in 0..hollows[low + 1].len() {
                    if linked(low, a, b) {
                        let least = set[low][a].min(set[low + 1][b]);
                        (set[low][a], set[low + 1][b]) = (least, least);
                    }
                }
            }
        }
        if before == set {
            break;
        }
    }
    let mut traps = Vec::new();
    for number in 0..count {
        let of: Vec<(usize, usize)> = (0..layers.len())
            .flat_map(|layer| (0..hollows[layer].len()).map(move |k| (layer, k)))
            .filter(|&(layer, k)| set[layer][k] == number)
            .collect();
        let reached =
            |&(layer, k): &(usize, usize)| layer + 1 == layers.len() || hollows[layer][k].iter().any(edge);
        let large = of.iter().any(|&(layer, k)| hollows[layer][k].len() >= 10);
        if !of.is_empty() && large && !of.iter().any(reached) {
            traps.push([of[0].0 as u32, of[of.len() - 1].0 as u32]);
        }
    }
    traps.sort_unstable();
    traps
}
