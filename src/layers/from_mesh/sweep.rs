//! Which triangles each plane crosses, found batch by batch on the way up.
//!
//! Takes the planes that cross each triangle, gives for each plane of a batch the triangles that
//! it crosses. Memory is bounded by the mesh and by what one batch crosses, however
//! tall the triangles are. Knows no coordinate.
use std::ops::Range;

/// Most layers in a batch: few enough that a progress bar moves.
const BATCH_LAYERS: usize = 256;

/// Triangles crossed in a batch beyond which no layer is added: what bounds memory
/// (some 40 bytes each). A single layer may have more.
const BATCH_CROSSINGS: u64 = 1 << 20;

/// The sweep over the planes.
#[derive(Debug, Default)]
pub(super) struct Sweep {
    /// For each triangle the first plane that crosses it, and the one past the last.
    spans: Vec<[u32; 2]>,
    /// Triangles that some plane crosses; those that plane `p` crosses first are
    /// `order[begin[p]..begin[p + 1]]`, in the order of the mesh.
    order: Vec<u32>,
    begin: Vec<u32>,
    /// How many triangles each plane crosses.
    crossings: Vec<u32>,
    /// Triangles that a plane before the next one crosses, and the next one too.
    active: Vec<u32>,
    /// The next plane.
    next: usize,
}

/// The triangles that the planes of a batch cross.
pub(super) struct Crossed {
    /// The planes of the batch.
    pub(super) planes: Range<usize>,
    triangles: Vec<u32>,
    /// Where those of each plane begin, and where the last end.
    begin: Vec<usize>,
}

impl Crossed {
    /// Those that a plane of the batch crosses.
    pub(super) fn by_plane(&self, plane: usize) -> &[u32] {
        let k = plane - self.planes.start;
        &self.triangles[self.begin[k]..self.begin[k + 1]]
    }
}

impl Sweep {
    /// Puts triangles in the order of the planes, of which there are so many.
    pub(super) fn new(spans: Vec<[u32; 2]>, planes: usize) -> Sweep {
        let mut begin = vec![0_u32; planes + 1];
        let mut ends = vec![0_u32; planes + 1];
        for &[first, end] in spans.iter().filter(|s| s[0] < s[1]) {
            begin[first as usize] += 1;
            ends[end as usize] += 1;
        }
        let (mut crossed, mut placed) = (0, 0);
        let mut crossings = Vec::with_capacity(planes);
        for (count, end) in begin.iter_mut().zip(&ends) {
            crossed = crossed + *count - end;
            crossings.push(crossed);
            placed += std::mem::replace(count, placed);
        }
        crossings.truncate(planes);
        let mut order = vec![0_u32; placed as usize];
        let mut next = begin.clone();
        for (t, &[first, _]) in (0_u32..).zip(&spans).filter(|(_, s)| s[0] < s[1]) {
            let place = &mut next[first as usize];
            order[*place as usize] = t;
            *place += 1;
        }
        Sweep { spans, order, begin, crossings, active: Vec::new(), next: 0 }
    }

    /// How many triangles all planes cross in all.
    pub(super) fn crossings(&self) -> u64 {
        self.crossings.iter().map(|&c| u64::from(c)).sum()
    }

    /// One past the last plane of the batch that begins at the next plane.
    fn batch_end(&self) -> usize {
        let mut crossings = 0;
        let fits = |count: &&u32| {
            crossings += u64::from(**count);
            crossings <= BATCH_CROSSINGS
        };
        let rest = &self.crossings[self.next..];
        self.next + rest.iter().take(BATCH_LAYERS).take_while(fits).count().max(1)
    }

    /// The next batch; `None` after the last plane.
    pub(super) fn next(&mut self) -> Option<Crossed> {
        if self.next == self.crossings.len() {
            return None;
        }
        let planes = self.next..self.batch_end();
        let mut begin = vec![0];
        for &count in &self.crossings[planes.clone()] {
            begin.push(begin[begin.len() - 1] + count as usize);
        }
        let mut place = begin.clone();
        let mut crossed = vec![0_u32; begin[planes.len()]];
        self.active.extend_from_slice(
            &self.order[self.begin[planes.start] as usize..self.begin[planes.end] as usize],
        );
        self.active.retain(|&t| {
            let [first, end] = self.spans[t as usize].map(|p| p as usize);
            for p in first.max(planes.start)..end.min(planes.end) {
                let place = &mut place[p - planes.start];
                crossed[*place] = t;
                *place += 1;
            }
            end > planes.end
        });
        self.next = planes.end;
        Some(Crossed { planes, triangles: crossed, begin })
    }
}
