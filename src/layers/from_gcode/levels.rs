//! From the heights at which beads lie to layers, and which sheets fill each.
//!
//! Layers end where the part is printed: at each height of a flat bead of it. A
//! sheet fills all layers between its bottom and its top, so objects with layers
//! of different thickness, or printed one after another, stand in one stack. Supports
//! fill the layers that they lie in; only where no part is do they make layers of
//! their own. Skirts and prime lines never do beside the part.
//!
//! A bead's bottom is its top less the thickness that the file gives, and lies on
//! the nearest layer's end; where the file gives none, the next lower height of
//! the same pass. A height that leaves more room below it than 1.6 times its
//! neighbours do hangs in the air by the rest. What rises along the way (a spiral
//! vase) is cut into layers of constant thickness, of a turn each; a bead fills those
//! whose middles lie within it.
use super::trace::{Class, Path, Sheet, Trace};
use super::{GcodeError, MAX_LAYER_POINTS, MAX_LAYERS, reach};
use crate::layers::shape::UNITS_PER_MM;

/// Heights that differ by less are one, grid steps: a quarter of the thinnest layer.
pub(super) const NEAR: i32 = 250;

/// A layer twice as thick as its neighbours would be is none; the limit between.
const GAP_RATIO: f64 = 1.6;

/// The thickest layer that a lone height can be, grid steps.
const MAX_LONE: i32 = 15_000;

/// The thickness of what nothing tells of, grid steps.
const USUAL: i32 = 2_000;

/// A later object begins on the plate when its lowest bead lies within this of the
/// first one's, grid steps.
pub(super) const FIRST_LAYERS: i32 = 3_000;

/// The layers of a job and what lies in each.
#[derive(Debug, Default)]
pub(super) struct Stack {
    /// Where layers end, grid steps, upwards; the first is where the lowest one begins.
    levels: Vec<i32>,
    /// Thickness of each sheet, grid steps.
    thickness: Vec<i32>,
    /// Indices of paths, in the order of the file, layer by layer.
    paths: Vec<u32>,
    /// Where each layer's paths begin in `paths`, and the end.
    starts: Vec<usize>,
    /// Points of each layer's paths.
    points: Vec<usize>,
    spiral: bool,
}

impl Stack {
    pub(super) fn layers(&self) -> usize {
        self.points.len()
    }

    /// Indices of the paths that fill a layer.
    pub(super) fn paths(&self, layer: usize) -> &[u32] {
        &self.paths[self.starts[layer]..self.starts[layer + 1]]
    }

    pub(super) fn points(&self, layer: usize) -> usize {
        self.points[layer]
    }

    /// Bottom and top, mm.
    pub(super) fn heights_mm(&self, layer: usize) -> [f64; 2] {
        [self.levels[layer], self.levels[layer + 1]].map(|z| f64::from(z) / UNITS_PER_MM)
    }

    /// Thickness of a sheet's beads, mm.
    pub(super) fn thickness_mm(&self, sheet: u32) -> f64 {
        f64::from(self.thickness[sheet as usize].max(100)) / UNITS_PER_MM
    }

    pub(super) fn spiral(&self) -> bool {
        self.spiral
    }
}

/// Makes the layers of a job.
pub(super) fn stack(trace: &Trace) -> Result<Stack, GcodeError> {
    let passes = Pass::all(trace);
    let spiral = passes.iter().any(|pass| pass.spiral);
    let ground = passes.iter().filter(|p| p.first().is_some()).map(|p| p.ground).min().unwrap_or(0);
    let thickness: Vec<i32> =
        trace.sheets.iter().map(|sheet| passes[sheet.key.pass as usize].thickness(sheet)).collect();
    let levels = levels(trace, &passes, &thickness, ground);
    if levels.len() > MAX_LAYERS {
        return Err(GcodeError::ManyLayers);
    }
    let ranges: Vec<Option<[usize; 2]>> = (trace.sheets.iter().zip(&thickness))
        .map(|(sheet, &thick)| layers_of(sheet, thick, &levels))
        .collect();
    let beyond = reach::beyond(trace, &levels, &thickness, &ranges);
    fill(trace, Stack { levels, thickness, spiral, ..Stack::default() }, &ranges, &beyond)
}

/// Lists the paths of each layer.
fn fill(
    trace: &Trace,
    mut stack: Stack,
    ranges: &[Option<[usize; 2]>],
    beyond: &[(u32, usize)],
) -> Result<Stack, GcodeError> {
    let layers = stack.levels.len() - 1;
    let (mut counts, mut points) = (vec![0_usize; layers], vec![0_usize; layers]);
    let range = |path: &Path| match ranges[path.sheet as usize] {
        Some([first, last]) => first..last + 1,
        None => 0..0,
    };
    let own = || (0..).zip(&trace.paths).flat_map(|(k, path)| range(path).map(move |layer| (k, layer)));
    let all = || own().chain(beyond.iter().copied());
    for (path, layer) in all() {
        counts[layer] += 1;
        points[layer] += trace.paths[path as usize].count as usize;
        if points[layer] > MAX_LAYER_POINTS {
            let z_mm = f64::from(stack.levels[layer + 1]) / UNITS_PER_MM;
            return Err(GcodeError::LargeLayer { z_mm });
        }
    }
    let mut starts = Vec::with_capacity(layers + 1);
    let mut at = 0;
    for count in &counts {
        starts.push(at);
        at += count;
    }
    starts.push(at);
    let mut next = starts.clone();
    let mut paths = vec![0; at];
    for (path, layer) in all() {
        paths[next[layer]] = path;
        next[layer] += 1;
    }
    stack.paths = paths;
    stack.starts = starts;
    stack.points = points;
    Ok(stack)
}

/// Heights upwards, and how thick what ends there is.
#[derive(Debug, Default)]
struct Heights {
    tops: Vec<i32>,
    thick: Vec<i32>,
}

impl Heights {
    /// Of what ends at a height or at the next one above it: beads that rise belong to
    /// the turn that they end.
    fn thickness(&self, top: i32) -> Option<i32> {
        let k = self.tops.partition_point(|&t| t < top - NEAR);
        self.thick.get(k).or(self.thick.last()).copied()
    }
}

/// One pass.
#[derive(Debug)]
struct Pass {
    /// Where flat beads of the part lie, and the turns of a spiral.
    part: Heights,
    /// Where those of supports lie too: these may be layers of another thickness.
    all: Heights,
    /// Where the lowest begins.
    ground: i32,
    spiral: bool,
}

impl Pass {
    /// All of a job, in order.
    fn all(trace: &Trace) -> Vec<Pass> {
        let count = trace.sheets.iter().map(|sheet| sheet.key.pass).max().unwrap_or(0) as usize + 1;
        let mut sheets: Vec<Vec<&Sheet>> = vec![Vec::new(); count];
        for sheet in trace.sheets.iter() {
            sheets[sheet.key.pass as usize].push(sheet);
        }
        // The pass that begins lowest stands on the plate, others beside it or higher.
        let alone: Vec<Pass> = sheets.iter().map(|own| Pass::new(own, None)).collect();
        let lowest = alone.iter().filter_map(|p| Some((p.first()?, p.ground))).min();
        sheets.iter().map(|own| Pass::new(own, lowest)).collect()
    }

    /// `lowest`: the first height of the lowest pass, and where that begins.
    fn new(sheets: &[&Sheet], lowest: Option<(i32, i32)>) -> Pass {
        let flat = |classes: &[Class]| {
            let own = sheets.iter().filter(|s| classes.contains(&s.key.class) && !s.key.slope);
            clusters(own.map(|s| s.key.top).collect())
        };
        let supports = flat(&[Class::Support]);
        let mut tops = flat(&[Class::Part, Class::Infill]);
        let rises = |s: &&&Sheet| s.key.slope && is_part(s.key.class);
        let mut rising: Vec<(i32, i32)> =
            sheets.iter().filter(rises).map(|s| (s.key.top, s.key.height)).collect();
        rising.sort_unstable();
        let turns = turns(&tops, &rising);
        let spiral = turns.len() > 2;
        tops = clusters([tops, turns].concat());
        let all = clusters([tops.as_slice(), &supports].concat());
        let first = all.first().copied().unwrap_or(0);
        let told = sheets.iter().filter(|s| s.key.class != Class::Aid && s.key.height > 0);
        let told = told.filter(|s| s.key.top.abs_diff(first) <= NEAR as u32).map(|s| s.key.height).max();
        let own = told.unwrap_or_else(|| lone(&all));
        let ground = match lowest {
            Some((top, ground)) if first <= top.saturating_add(FIRST_LAYERS) => ground,
            // A thicker layer than any is nothing to stand on the plate with.
            _ if own >= first - NEAR => first.min(0),
            _ => first - own,
        };
        // The part may begin on a raft or on supports, and is then no thinner than it goes on.
        let below = tops.first().map_or(0, |&z| supports.partition_point(|&top| top < z - NEAR));
        let mut thick = thicknesses(&tops, ground);
        if let (Some(k), [z, ..]) = (below.checked_sub(1), tops.as_slice()) {
            thick[0] = (z - supports[k]).max(tops.get(1).map_or(0, |next| next - z).min(z - ground));
        }
        let all = Heights { thick: thicknesses(&all, ground), tops: all };
        Pass { part: Heights { tops, thick }, all, ground, spiral }
    }

    /// The lowest height.
    fn first(&self) -> Option<i32> {
        self.all.tops.first().copied()
    }

    /// Of a sheet's beads, grid steps.
    fn thickness(&self, sheet: &Sheet) -> i32 {
        let key = sheet.key;
        if key.height > 0 {
            return key.height;
        }
        let heights = if is_part(key.class) { &self.part } else { &self.all };
        match heights.thickness(key.top) {
            Some(thick) => thick,
            None if (1..MAX_LONE).contains(&key.top) => key.top,
            None => USUAL,
        }
    }
}

fn is_part(class: Class) -> bool {
    matches!(class, Class::Part | Class::Infill)
}

/// How thick the lowest of some heights is when nothing tells.
fn lone(tops: &[i32]) -> i32 {
    let next = tops.get(1).map_or(USUAL, |next| next - tops[0]);
    match tops.first() {
        Some(&first) if (1..=MAX_LONE.max(next)).contains(&first) => first,
        _ => next,
    }
}

/// Each height's room down to the one below; less where it hangs in the air.
fn thicknesses(tops: &[i32], ground: i32) -> Vec<i32> {
    let room = |k: usize| tops[k] - if k == 0 { ground } else { tops[k - 1] };
    let mut thick: Vec<i32> = Vec::with_capacity(tops.len());
    for k in 0..tops.len() {
        let own = room(k);
        // The first layer is often thicker than the others; it stands on the plate.
        let neighbours = match (k, k + 1 < tops.len()) {
            (0, _) => own,
            (1, true) => thick[0].max(room(2)),
            (1, false) => thick[0],
            (_, true) => thick[k - 1].max(room(k + 1)),
            (_, false) => thick[k - 1],
        };
        let hangs = f64::from(own) > GAP_RATIO * f64::from(neighbours);
        thick.push(if hangs { neighbours } else { own });
    }
    thick
}

/// Ends of the turns of spirals, from beads that rise (height, thickness) between flat ones.
fn turns(tops: &[i32], rising: &[(i32, i32)]) -> Vec<i32> {
    let mut found = Vec::new();
    for k in 0..=tops.len() {
        let low = if k == 0 { 0 } else { tops[k - 1] };
        let high = tops.get(k).copied();
        let from = rising.partition_point(|&(z, _)| z <= low);
        let to = high.map_or(rising.len(), |high| rising.partition_point(|&(z, _)| z < high));
        let Some(within) = rising.get(from..to).filter(|within| !within.is_empty()) else { continue };
        let told = within.iter().map(|&(_, height)| height).max().filter(|&height| height > NEAR);
        let below = if k >= 2 { low - tops[k - 2] } else { low };
        let step = told.unwrap_or(if (1..MAX_LONE).contains(&below) { below } else { USUAL }).max(NEAR + 1);
        let end = high.unwrap_or(within[within.len() - 1].0 + step - 1);
        if i64::from(end) - i64::from(low) <= i64::from(step) * 3 / 2 && high.is_some() {
            continue;
        }
        let mut z = i64::from(low) + i64::from(step);
        while z <= i64::from(end) - if high.is_some() { i64::from(step) / 2 } else { 0 } {
            found.push(z as i32);
            z += i64::from(step);
        }
    }
    found
}

/// Sorted, and of those that are [`NEAR`] each other the lowest.
fn clusters(mut heights: Vec<i32>) -> Vec<i32> {
    heights.sort_unstable();
    heights.dedup_by(|next, kept| next.abs_diff(*kept) <= NEAR as u32);
    heights
}

/// The ends of layers, upwards, from where the lowest begins.
fn levels(trace: &Trace, passes: &[Pass], thickness: &[i32], ground: i32) -> Vec<i32> {
    let sheets = || trace.sheets.iter().zip(thickness);
    let flat = |s: &Sheet| is_part(s.key.class) && !s.key.slope;
    let mut tops: Vec<i32> = sheets().filter(|(s, _)| flat(s)).map(|(s, _)| s.key.top).collect();
    let mut solid: Vec<[i32; 2]> =
        sheets().filter(|(s, _)| flat(s)).map(|(s, &h)| [s.key.top - h, s.key.top]).collect();
    for pass in passes.iter().filter(|pass| pass.spiral) {
        let Heights { tops: own, thick } = &pass.part;
        tops.extend(own);
        solid.extend(own.iter().zip(thick).map(|(&top, &h)| [top - h, top]));
    }
    let mut levels = clusters(tops);
    // Bottoms that hang in the air.
    let bottoms = solid.iter().filter(|&&[bottom, top]| {
        let rests = nearest(&levels, bottom).is_some_and(|z| near(z, bottom, top - bottom));
        !rests && !near(ground, bottom, top - bottom) && bottom > ground
    });
    let bottoms: Vec<i32> = bottoms.map(|&[bottom, _]| bottom).collect();
    levels = clusters([levels, bottoms].concat());
    // Supports where no part is; skirts only where nothing else is.
    let solid = merged(solid);
    let alone = |z: i32| {
        let k = solid.partition_point(|&[_, top]| top < z - NEAR);
        !solid.get(k).is_some_and(|&[bottom, _]| bottom + NEAR < z)
    };
    for class in [Class::Support, Class::Aid] {
        let own = sheets().filter(|(s, _)| s.key.class == class).map(|(s, _)| s.key.top);
        let own: Vec<i32> = own
            .filter(|&z| alone(z) && nearest(&levels, z).is_none_or(|at| at.abs_diff(z) > NEAR as u32))
            .collect();
        if class == Class::Support || levels.is_empty() {
            levels = clusters([levels, own].concat());
        }
    }
    levels.retain(|&z| z > ground.saturating_add(NEAR));
    if levels.is_empty() {
        levels.push(ground.saturating_add(USUAL));
    }
    levels.insert(0, ground);
    levels
}

/// Whether two heights are the same end of a bead as thick as this.
fn near(a: i32, b: i32, thick: i32) -> bool {
    a.abs_diff(b) <= (thick / 2).max(NEAR) as u32
}

/// The nearest of some heights that ascend.
fn nearest(levels: &[i32], z: i32) -> Option<i32> {
    let k = levels.partition_point(|&level| level < z);
    let around = [k.checked_sub(1).and_then(|k| levels.get(k)), levels.get(k)];
    around.into_iter().flatten().copied().min_by_key(|level| level.abs_diff(z))
}

/// Intervals united where they overlap or touch.
fn merged(mut intervals: Vec<[i32; 2]>) -> Vec<[i32; 2]> {
    intervals.sort_unstable();
    let mut out: Vec<[i32; 2]> = Vec::new();
    for [low, high] in intervals {
        match out.last_mut() {
            Some(last) if low <= last[1].saturating_add(NEAR) => last[1] = last[1].max(high),
            _ => out.push([low, high]),
        }
    }
    out
}

/// Height of a layer's middle.
pub(super) fn middle(levels: &[i32], layer: usize) -> i32 {
    i32::midpoint(levels[layer], levels[layer + 1])
}

/// First and last layer that a sheet fills; `None` for skirts above or below them all.
fn layers_of(sheet: &Sheet, thick: i32, levels: &[i32]) -> Option<[usize; 2]> {
    let last = levels.len() - 2;
    let key = sheet.key;
    // The layer that a height lies in, its upper end included.
    let holding = |z: i32| levels.partition_point(|&level| level < z).saturating_sub(1).min(last);
    let bottom = key.top.saturating_sub(thick);
    if is_part(key.class) && !key.slope {
        let index = |z: i32| nearest(levels, z).map_or(0, |at| levels.partition_point(|&l| l < at));
        let top = index(key.top).clamp(1, last + 1);
        return Some([index(bottom).min(top - 1), top - 1]);
    }
    if key.class == Class::Aid && (bottom >= levels[last + 1] || key.top <= levels[0] - NEAR) {
        return None;
    }
    // Layers whose middles lie within, and the one that the bead's own middle lies in.
    let middle = |k: usize| middle(levels, k);
    let own = holding(i32::midpoint(bottom, key.top));
    let low = (holding(bottom)..=own).find(|&k| middle(k) > bottom).unwrap_or(own);
    // What rises lies in the turn that it belongs to, however little of it.
    let reaches = |k: usize| key.slope || middle(k) < key.top;
    let high = (own..=holding(key.top)).rev().find(|&k| reaches(k)).unwrap_or(own);
    Some([low.min(own), high.max(own)])
}
