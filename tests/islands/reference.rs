//! A slow reference for islands: pixels of triangles, joined one by one.
//!
//! Shares no code with the project. Takes the triangles as they stand in the file, finds
//! for each plane and each row of pixel centres where the row enters and leaves the
//! solid (winding number not zero), and follows what hangs together from layer to layer.

/// A triangle, mm.
pub(super) type Triangle = [[f64; 3]; 3];

/// Reads a binary STL file.
pub(super) fn triangles(bytes: &[u8]) -> Vec<Triangle> {
    let number = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")));
    let count = u32::from_le_bytes(bytes[80..84].try_into().expect("four bytes")) as usize;
    let corner = |t: usize, k: usize| [0, 1, 2].map(|c| number(84 + 50 * t + 12 + 12 * k + 4 * c));
    (0..count).map(|t| [corner(t, 0), corner(t, 1), corner(t, 2)]).collect()
}

/// Writes one.
pub(super) fn stl(triangles: &[Triangle]) -> Vec<u8> {
    let mut bytes = vec![0; 80];
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for t in triangles {
        bytes.extend([0; 12]);
        t.iter().flatten().for_each(|c| bytes.extend((*c as f32).to_le_bytes()));
        bytes.extend([0; 2]);
    }
    bytes
}

/// A run of pixels: row, first column, column after the last.
pub(super) type Run = (i32, i32, i32);

/// The pixels of one layer, as runs in order.
pub(super) type Layer = Vec<Run>;

/// All layers of a solid; layer `k` is cut at `(k + 1/2) height`.
pub(super) fn layers(triangles: &[Triangle], height: f64, pixel: f64) -> Vec<Layer> {
    let top = triangles.iter().flatten().fold(0.0_f64, |z, p| z.max(p[2]));
    let count = (top / height).ceil() as usize;
    // For each layer crossings (row, x, way in or out).
    let mut crossings: Vec<Vec<(i32, f64, i32)>> = vec![Vec::new(); count];
    for t in triangles {
        let (low, high) = t.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[2]), h.max(p[2])));
        let first = ((low / height) - 0.5).floor().max(0.0) as usize;
        for (k, row) in crossings.iter_mut().enumerate().skip(first) {
            let z = (k as f64 + 0.5) * height;
            if z > high {
                break;
            }
            cut(t, z, pixel, row);
        }
    }
    crossings.into_iter().map(|c| runs(c, pixel)).collect()
}

/// Where rows cross a triangle in the plane at `z`.
fn cut(t: &Triangle, z: f64, pixel: f64, crossings: &mut Vec<(i32, f64, i32)>) {
    let above = t.map(|p| p[2] > z);
    let (mut enters, mut leaves) = (None, None);
    for k in 0..3 {
        let (p, q) = (t[k], t[(k + 1) % 3]);
        if above[k] != above[(k + 1) % 3] {
            let part = (z - p[2]) / (q[2] - p[2]);
            let at = [p[0] + (q[0] - p[0]) * part, p[1] + (q[1] - p[1]) * part];
            if above[k] { enters = Some(at) } else { leaves = Some(at) }
        }
    }
    let (Some(a), Some(b)) = (enters, leaves) else { return };
    let (low, high, way) = if a[1] <= b[1] { (a, b, 1) } else { (b, a, -1) };
    let mut row = (low[1] / pixel - 0.5).ceil() as i32;
    loop {
        let y = (f64::from(row) + 0.5) * pixel;
        if y >= high[1] {
            break;
        }
        if y >= low[1] {
            crossings.push((row, low[0] + (high[0] - low[0]) * (y - low[1]) / (high[1] - low[1]), way));
        }
        row += 1;
    }
}

fn runs(mut crossings: Vec<(i32, f64, i32)>, pixel: f64) -> Layer {
    crossings.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut runs: Layer = Vec::new();
    let (mut winding, mut from, mut row) = (0, 0.0, i32::MIN);
    let column = |x: f64| (x / pixel - 0.5).ceil() as i32;
    for (at, x, way) in crossings {
        if at != row {
            (winding, row) = (0, at);
        }
        if winding == 0 {
            from = x;
        }
        winding += way;
        if winding == 0 && column(from) < column(x) {
            match runs.last_mut() {
                Some(last) if last.0 == row && last.2 >= column(from) => last.2 = last.2.max(column(x)),
                _ => runs.push((row, column(from), column(x))),
            }
        }
    }
    runs
}

/// The same with each pixel's eight neighbours.
pub(super) fn dilated(layer: &Layer) -> Layer {
    let mut wide: Vec<Run> =
        layer.iter().flat_map(|r| (-1..=1).map(move |d| (r.0 + d, r.1 - 1, r.2 + 1))).collect();
    wide.sort_unstable();
    let mut joined: Layer = Vec::new();
    for run in wide {
        match joined.last_mut() {
            Some(last) if last.0 == run.0 && last.2 >= run.1 => last.2 = last.2.max(run.2),
            _ => joined.push(run),
        }
    }
    joined
}

fn find(sets: &mut [usize], mut k: usize) -> usize {
    while sets[k] != k {
        sets[k] = sets[sets[k]];
        k = sets[k];
    }
    k
}

/// Pairs of runs whose rows differ by `step` and whose columns share a pixel.
fn touching(a: &Layer, b: &Layer, step: i32, mut see: impl FnMut(usize, usize)) {
    for (i, run) in a.iter().enumerate() {
        let first = b.partition_point(|r| (r.0, r.2) <= (run.0 + step, run.1));
        for (k, other) in b.iter().enumerate().skip(first) {
            if other.0 != run.0 + step || other.1 >= run.2 {
                break;
            }
            see(i, k);
        }
    }
}

/// For each run the number of its component, from 0.
pub(super) fn components(layer: &Layer) -> (Vec<usize>, usize) {
    let mut sets: Vec<usize> = (0..layer.len()).collect();
    touching(layer, layer, 1, |i, k| {
        let (a, b) = (find(&mut sets, i), find(&mut sets, k));
        sets[a.max(b)] = a.min(b);
    });
    let mut numbers = vec![usize::MAX; layer.len()];
    let mut count = 0;
    let found: Vec<usize> = (0..layer.len())
        .map(|k| {
            let root = find(&mut sets, k);
            if numbers[root] == usize::MAX {
                numbers[root] = count;
                count += 1;
            }
            numbers[root]
        })
        .collect();
    (found, count)
}

/// An island as the pixels show it.
#[derive(Clone, Debug)]
pub(super) struct Island {
    pub(super) layer: usize,
    pub(super) end_layer: usize,
    pub(super) joins: bool,
    pub(super) pixels: i64,
    /// Lowest and highest column and row, the highest after the last.
    pub(super) bounds: [i32; 4],
}

/// Follows all that hangs together, from the plate up.
pub(super) fn islands(layers: &[Layer]) -> Vec<Island> {
    let mut found: Vec<Island> = Vec::new();
    // Bodies and islands are sets; set 0 stands on the plate.
    let mut sets: Vec<usize> = vec![0];
    let mut alive: Vec<usize> = Vec::new();
    let mut below: (Layer, Vec<usize>) = (Vec::new(), Vec::new());
    for (number, layer) in layers.iter().enumerate() {
        let (component, count) = components(layer);
        let mut owner: Vec<Option<usize>> = vec![(number == 0).then_some(0); count];
        touching(layer, &below.0, 0, |i, k| {
            let under = find(&mut sets, below.1[k]);
            match owner[component[i]] {
                None => owner[component[i]] = Some(under),
                Some(other) => {
                    let other = find(&mut sets, other);
                    sets[under.max(other)] = under.min(other);
                }
            }
        });
        for (c, owner) in owner.iter_mut().enumerate() {
            if owner.is_none() {
                let mine: Vec<&Run> =
                    layer.iter().zip(&component).filter(|x| *x.1 == c).map(|x| x.0).collect();
                found.push(Island {
                    layer: number,
                    end_layer: number,
                    joins: false,
                    pixels: mine.iter().map(|r| i64::from(r.2 - r.1)).sum(),
                    bounds: mine.iter().fold([i32::MAX, i32::MAX, i32::MIN, i32::MIN], |b, r| {
                        [b[0].min(r.1), b[1].min(r.0), b[2].max(r.2), b[3].max(r.0 + 1)]
                    }),
                });
                sets.push(sets.len());
                alive.push(found.len() - 1);
                *owner = Some(found.len());
            }
        }
        let owners: Vec<usize> = owner.iter().map(|o| find(&mut sets, o.expect("set above"))).collect();
        alive.retain(|&k| {
            let set = find(&mut sets, k + 1);
            if set == 0 {
                (found[k].end_layer, found[k].joins) = (number, true);
                return false;
            }
            if owners.contains(&set) {
                found[k].end_layer = number;
            }
            owners.contains(&set)
        });
        below = (layer.clone(), component.iter().map(|c| owners[*c]).collect());
    }
    found
}
