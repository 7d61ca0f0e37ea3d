//! Parts for the tests of this room.
use super::look::{Look, look};
use super::rules::Rules;
use crate::detect::overhang::SelfSupport;
use crate::layers::polygon::{Inside, resolve};
use crate::layers::shape::{Bounds, Point, Region, Ring};
use crate::layers::stack::{Layer, Layers};
use crate::mesh::{self, Mesh, stl};
use std::convert::Infallible;
use std::io::Cursor;

/// Rectangles `[x0, y0, x1, y1]` united, mm.
pub(crate) fn region(rectangles: &[[f64; 4]]) -> Region {
    let ring = |r: &[f64; 4]| -> Ring {
        [(r[0], r[1]), (r[2], r[1]), (r[2], r[3]), (r[0], r[3])].map(|p| Point::from_mm(p.0, p.1)).to_vec()
    };
    let all: Vec<Ring> = rectangles.iter().map(ring).collect();
    resolve(&all, Inside::NonZero)
}

/// Layers of one height; `part` gives what is at the height of a layer's middle, mm.
pub(crate) fn layers(count: u32, layer_mm: f64, part: impl Fn(f64) -> Region) -> Vec<Layer> {
    let layer = |number: u32| {
        let bottom_mm = f64::from(number) * layer_mm;
        let part = part(bottom_mm + layer_mm / 2.0);
        Layer { number, bottom_mm, top_mm: bottom_mm + layer_mm, part, ..Layer::default() }
    };
    (0..count).map(layer).collect()
}

/// Layers that are there, in batches of eight.
pub(super) struct Given(pub(super) Vec<Layer>);

impl Layers for Given {
    type Error = Infallible;

    fn count(&self) -> Option<u32> {
        None
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, Infallible> {
        let batch: Vec<Layer> = self.0.drain(..self.0.len().min(8)).collect();
        Ok((!batch.is_empty()).then_some(batch))
    }
}

/// What holds itself in tests.
pub(super) const OWN: SelfSupport = SelfSupport { angle_deg: 45.0, bridge_mm: 2.0, min_area_mm2: 0.05 };

/// A look at layers.
pub(super) fn seen(layers: Vec<Layer>, rules: &Rules) -> Look {
    let bounds = layers.iter().fold(Bounds::EMPTY, |b, l| b.joined(l.part.bounds()));
    let top = layers.last().map_or(0.0, |l| l.top_mm);
    let Ok(found) = look(&mut Given(layers), (bounds, top), &Region::default(), OWN, rules, &mut ());
    found
}

/// Boxes, lowest and highest corner, mm, as a mesh.
pub(super) fn mesh(boxes: &[[[f64; 3]; 2]]) -> Mesh {
    const FACES: [[usize; 4]; 6] =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let mut triangles = Vec::new();
    for ends in boxes {
        let corner = |k: usize| [0, 1, 2].map(|axis| ends[k >> axis & 1][axis] as f32);
        let halves = FACES.iter().flat_map(|f| [[f[0], f[1], f[2]], [f[0], f[2], f[3]]]);
        triangles.extend(halves.map(|t| t.map(corner)));
    }
    let mut file = Vec::new();
    stl::write(&mut file, &triangles).expect("memory takes it");
    mesh::read(&mut Cursor::new(file)).expect("a model").0
}
