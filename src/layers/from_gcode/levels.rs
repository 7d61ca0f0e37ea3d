//! From the heights at which beads lie to layers, and which sheets fill each.
//!
//! Layers end where the part is printed: at each height of a flat bead of it. A
//! sheet fills all layers between its bottom and its top, so objects with layers
//! of different thickness, or printed one after another, stand in one stack. Supports
//! fill the layers that they lie in, and what is left between them and the part
//! so that it can be taken off (they still bear it: Cura's trees end two layers below
//! it); only where no part is
//! do they make layers of their own. Skirts and prime lines never do beside the part.
//!
//! A bead's bottom is its top less the thickness that the file gives, and lies on
//! the nearest layer's end; where the file gives none, the next lower height of
//! the same pass. A height that leaves more room below it than 1.6 times its
//! neighbours do hangs in the air by the rest. What rises along the way (a spiral
//! vase) is cut into layers of constant thickness, of a turn each; a bead fills those
//! whose middles lie within it.
use super::trace::{Class, Path, Sheet, Trace, grid};
use super::{GcodeError, MAX_LAYER_POINTS, MAX_LAYERS};
use crate::layers::shape::UNITS_PER_MM;

/// Heights that differ by less are one, grid steps: a quarter of the thinnest layer.
pub(super) const NEAR: i32 = 250;

/// A layer twice as thick as its neighbours would be is none; the limit between.
const GAP_RATIO: f64 = 1.6;

/// The thickest layer that a lone height can be, grid steps.
const MAX_LONE: i32 = 15_000;

/// The thickness of what nothing tells of, grid steps.
const USUAL: i32 = 2_000;

/// Supports bear the part across a gap of this, mm, a little more than the file says,
/// and two layers and a quarter.
const CONTACT_MM: f64 = 0.3;
const CONTACT_MORE_MM: f64 = 0.1;

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
    let ground = passes.iter().filter(|p| !p.tops.is_empty()).map(|p| p.ground).min().unwrap_or(0);
    let thickness: Vec<i32> =
        trace.sheets.iter().map(|sheet| passes[sheet.key.pass as usize].thickness(sheet)).collect();
    let levels = levels(trace, &passes, &thickness, ground);
    if levels.len() > MAX_LAYERS {
        return Err(GcodeError::ManyLayers);
    }
    let reach = trace.contact_mm.map_or(CONTACT_MM, |told| (told + CONTACT_MORE_MM).clamp(CONTACT_MM, 2.0));
    let ranges: Vec<Option<[usize; 2]>> = (trace.sheets.iter().zip(&thickness))
        .map(|(sheet, &thick)| layers_of(sheet, thick, &levels, grid(reach)))
        .collect();
    fill(trace, Stack { levels, thickness, spiral, ..Stack::default() }, &ranges)
}

/// Lists the paths of each layer.
fn fill(trace: &Trace, mut stack: Stack, ranges: &[Option<[usize; 2]>]) -> Result<Stack, GcodeError> {
    let layers = stack.levels.len() - 1;
    let (mut counts, mut points) = (vec![0_usize; layers], vec![0_usize; layers]);
    let range = |path: &Path| match ranges[path.sheet as usize] {
        Some([first, last]) => first..last + 1,
        None => 0..0,
    };
    for path in &trace.paths {
        for layer in range(path) {
            counts[layer] += 1;
            points[layer] += path.count as usize;
            if points[layer] > MAX_LAYER_POINTS {
                let z_mm = f64::from(stack.levels[layer + 1]) / UNITS_PER_MM;
                return Err(GcodeError::LargeLayer { z_mm });
            }
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
    for (k, path) in trace.paths.iter().enumerate() {
        for layer in range(path) {
            paths[next[layer]] = k as u32;
            next[layer] += 1;
        }
    }
    stack.paths = paths;
    stack.starts = starts;
    stack.points = points;
    Ok(stack)
}

/// The heights of one pass upwards.
struct Pass {
    /// Where flat beads of part and support lie, and the turns of a spiral.
    tops: Vec<i32>,
    /// Thickness of each.
    thick: Vec<i32>,
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
        let lowest = alone.iter().filter_map(|p| Some((*p.tops.first()?, p.ground))).min();
        sheets.iter().map(|own| Pass::new(own, lowest)).collect()
    }

    /// `lowest`: the first height of the lowest pass, and where that begins.
    fn new(sheets: &[&Sheet], lowest: Option<(i32, i32)>) -> Pass {
        let bears = |s: &&&Sheet| s.key.class != Class::Aid;
        let flat = |s: &&&Sheet| !s.key.slope;
        let mut tops = clusters(sheets.iter().filter(bears).filter(flat).map(|s| s.key.top).collect());
        let mut rising: Vec<(i32, i32)> = (sheets.iter().filter(bears).filter(|s| s.key.slope))
            .map(|s| (s.key.top, s.key.height))
            .collect();
        rising.sort_unstable();
        let turns = turns(&tops, &rising);
        let spiral = turns.len() > 2;
        tops = clusters([tops, turns].concat());
        let first = tops.first().copied().unwrap_or(0);
        let told = sheets.iter().filter(bears).find(|s| s.key.top - first < NEAR && s.key.height > 0);
        let own = told.map_or_else(|| lone(&tops), |s| s.key.height);
        let ground = match lowest {
            Some((top, ground)) if first <= top.saturating_add(FIRST_LAYERS) => ground,
            // A thicker layer than any is nothing to stand on the plate with.
            _ if own >= first - NEAR => first.min(0),
            _ => first - own,
        };
        let thick = thicknesses(&tops, ground);
        Pass { tops, thick, ground, spiral }
    }

    /// Of a sheet's beads, grid steps.
    fn thickness(&self, sheet: &Sheet) -> i32 {
        let key = sheet.key;
        if key.height > 0 {
            return key.height;
        }
        // The height at or above: beads that rise belong to the turn that they end.
        let k = self.tops.partition_point(|&top| top < key.top - NEAR);
        match self.thick.get(k).or(self.thick.last()) {
            Some(&thick) => thick,
            None if (1..MAX_LONE).contains(&key.top) => key.top,
            None => USUAL,
        }
    }
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
    let part = |class: Class| matches!(class, Class::Part | Class::Infill);
    let flat = |s: &Sheet| part(s.key.class) && !s.key.slope;
    let mut tops: Vec<i32> = sheets().filter(|(s, _)| flat(s)).map(|(s, _)| s.key.top).collect();
    let mut solid: Vec<[i32; 2]> =
        sheets().filter(|(s, _)| flat(s)).map(|(s, &h)| [s.key.top - h, s.key.top]).collect();
    for pass in passes.iter().filter(|pass| pass.spiral) {
        tops.extend(&pass.tops);
        solid.extend(pass.tops.iter().zip(&pass.thick).map(|(&top, &h)| [top - h, top]));
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

/// First and last layer that a sheet fills; `None` for skirts above or below them all.
fn layers_of(sheet: &Sheet, thick: i32, levels: &[i32], reach: i32) -> Option<[usize; 2]> {
    let last = levels.len() - 2;
    let key = sheet.key;
    // The layer that a height lies in, its upper end included.
    let holding = |z: i32| levels.partition_point(|&level| level < z).saturating_sub(1).min(last);
    let bottom = key.top.saturating_sub(thick);
    if matches!(key.class, Class::Part | Class::Infill) && !key.slope {
        let index = |z: i32| nearest(levels, z).map_or(0, |at| levels.partition_point(|&l| l < at));
        let top = index(key.top).clamp(1, last + 1);
        return Some([index(bottom).min(top - 1), top - 1]);
    }
    if key.class == Class::Aid && (bottom >= levels[last + 1] || key.top <= levels[0] - NEAR) {
        return None;
    }
    let reach = match key.class {
        Class::Support => reach.max(thick.saturating_mul(9) / 4),
        _ => 0,
    };
    // Layers whose middles lie within, and the one that the bead's own middle lies in.
    let middle = |k: usize| i32::midpoint(levels[k], levels[k + 1]);
    let own = holding(i32::midpoint(bottom, key.top));
    let low = (holding(bottom)..=own).find(|&k| middle(k) > bottom).unwrap_or(own);
    let top = key.top.saturating_add(reach);
    // What rises lies in the turn that it belongs to, however little of it.
    let reaches = |k: usize| key.slope || middle(k) < top;
    let high = (own..=holding(top)).rev().find(|&k| reaches(k)).unwrap_or(own);
    Some([low.min(own), high.max(own)])
}
