//! Layers from a mesh: every triangle against every plane, by a sweep from the plate up.
//!
//! Takes a [`Mesh`] that stands on the plate (z = 0) and the heights of the layers,
//! gives [`Layer`]s in batches. All is exact on the grid of tenths of a micrometre:
//! vertices and planes are put there once, each rounded by itself, and from then on
//! only integers are compared. A vertex that lies on a plane counts as below it, so
//! that no case is special and every contour closes. Knows no file and no detector.
//!
//! Inside is what the contours wind around at least once, counter-clockwise seen from
//! above counting up: bodies that overlap or lie in each other are one, a shell that is
//! turned inside out is a hole in a body and nothing in the open. Mending turns wholly
//! inverted shells round before; what is still inverted is where a surface runs through
//! itself, and more was taken away there than there was.
//!
//! # Layout
//! - [`heights`]: layer heights and the planes
//! - [`grid`]: the mesh on the grid
//! - [`sweep`]: which triangles each plane crosses, batch by batch
//! - [`walk`]: the contours of one plane
//! - [`join`]: open contours closed
use super::nest::Nester;
use super::polygon::{self, Inside};
use super::shape::{UNITS_PER_MM, ring_edges};
use super::stack::{Layer, Layers};
use super::tangle::tangled;
use super::tidy::tidy;
use crate::mesh::Mesh;
use grid::Corner;
use heights::Levels;
pub use heights::{LayerHeights, MAX_LAYER_MM, MAX_LAYERS, MIN_LAYER_MM};
use join::Joined;
use rayon::prelude::*;
use std::sync::Mutex;
use sweep::{Crossed, Sweep};
use walk::{Plane, Surface, Visited};

mod grid;
mod heights;
mod join;
mod sweep;
mod walk;

/// Crossings of contours that are no trouble: about 100 MB while a thread untangles them.
const FREE_CROSSINGS: u64 = 1 << 18;

/// Why a mesh cannot be sliced.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum SliceError {
    /// No triangle.
    #[error("the mesh holds no triangle: export it again from the program it comes from")]
    Empty,
    /// A height no printer can do.
    #[error(
        "a layer height of {mm} mm cannot be used: give {option} from {MIN_LAYER_MM} to {MAX_LAYER_MM} (mm)"
    )]
    LayerHeight {
        /// Option that asks for it.
        option: &'static str,
        /// What was asked for, mm.
        mm: f64,
    },
    /// More layers than anything prints.
    #[error(
        "a part {part_mm} mm high has more than {MAX_LAYERS} layers of {layer_mm} mm: \
         give a greater --layer-height, or the right size with --height-mm"
    )]
    TooManyLayers {
        /// Height of the part, mm.
        part_mm: f64,
        /// Layer height, mm.
        layer_mm: f64,
    },
    /// No plane meets it.
    #[error(
        "the part is {part_mm} mm high, less than half of a first layer of {first_mm} mm: there is nothing \
         to slice; give the right size with --height-mm, or smaller layers"
    )]
    Flat {
        /// Height of the part, mm.
        part_mm: f64,
        /// Height of the first layer, mm.
        first_mm: f64,
    },
    /// Not a number, or far outside of any printer.
    #[error(
        "vertex {vertex} has a coordinate of {mm} mm, beyond ±53 m: give the right size with --height-mm"
    )]
    Coordinate {
        /// Its place in the mesh, from 0.
        vertex: usize,
        /// The coordinate, mm.
        mm: f64,
    },
    /// Heights that do not rise.
    #[error("layer {layer} does not begin above the one below it, as layers of a job must")]
    Heights {
        /// From 0 at the plate.
        layer: u32,
    },
    /// It was not put on the plate.
    #[error("the mesh reaches {mm} mm below the plate: put it on the plate before it is sliced")]
    BelowPlate {
        /// Depth, mm.
        mm: f64,
    },
    /// Untangling it would take more memory than a machine has.
    #[error(
        "layer {layer}, {z_mm} mm above the plate: its contours cross each other about {crossings} times; \
         so many bodies that overlap cannot be united: do that, or repair it, in the program it comes from"
    )]
    Tangled {
        /// From 0 at the plate.
        layer: u32,
        /// Height of the layer's plane, mm.
        z_mm: f64,
        /// An estimate.
        crossings: u64,
    },
    /// The caller made a mesh whose parts do not fit each other.
    #[error(
        "triangle {triangle} names vertices or neighbours that are not its own: the mesh was put together wrongly"
    )]
    Mesh {
        /// Its place in the mesh, from 0.
        triangle: usize,
    },
}

/// What slicing met on its way that is worth telling.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sliced {
    /// Layers with contours that a hole in the mesh left open.
    pub open_layers: u32,
    /// The first of them.
    pub first_open_layer: Option<u32>,
    /// Open contours of all layers, after they were joined where their ends were near.
    pub open_contours: u64,
    /// Widest gap that a straight line closed, mm.
    pub widest_gap_mm: f64,
    /// Layers whose contours cross or touch: shells that overlap, or a surface that
    /// runs through itself. They were united.
    pub crossing_layers: u32,
}

/// The layers of a mesh, from the plate up.
pub struct FromMesh<'a> {
    mesh: &'a Mesh,
    levels: Levels,
    corners: Vec<Corner>,
    planes: Vec<i32>,
    sweep: Sweep,
    /// What the next batch crosses, where that was found while the last one was cut.
    ready: Option<Crossed>,
    sliced: Sliced,
    scratch: Mutex<Vec<Scratch>>,
}

/// What a thread keeps from layer to layer.
#[derive(Default)]
struct Scratch {
    visited: Visited,
    nester: Nester,
}

/// One layer, and what was met on the way to it.
struct Cut {
    layer: Layer,
    open: usize,
    widest: f64,
    crossing: bool,
}

impl<'a> FromMesh<'a> {
    /// Makes ready to slice a mesh that stands on the plate, z = 0.
    ///
    /// The plane of a layer is its middle, rounded to the grid, and the last layer
    /// is the last whose plane lies below the top of the mesh.
    ///
    /// Takes 16 bytes a vertex and at most 12 a triangle beside the mesh itself.
    ///
    /// # Errors
    /// Heights out of range, a mesh without triangles, too flat, too large, below the
    /// plate, or not put together as [`Mesh`] says.
    pub fn new(mesh: &'a Mesh, heights: LayerHeights) -> Result<FromMesh<'a>, SliceError> {
        FromMesh::with(mesh, Levels::Even(heights))
    }

    /// The same with layers that begin and end at given heights, mm, as those of a job do.
    ///
    /// Layers above the mesh are empty.
    ///
    /// # Errors
    /// Those of [`FromMesh::new`], and heights whose middles do not rise.
    pub fn at(mesh: &'a Mesh, heights: Vec<[f64; 2]>) -> Result<FromMesh<'a>, SliceError> {
        FromMesh::with(mesh, Levels::Given(heights))
    }

    fn with(mesh: &'a Mesh, levels: Levels) -> Result<FromMesh<'a>, SliceError> {
        grid::check(mesh)?;
        let mut corners = grid::corners(mesh)?;
        let [bottom, top] = grid::reach(&corners, &mesh.triangles);
        if bottom < 0 {
            return Err(SliceError::BelowPlate { mm: f64::from(-bottom) / UNITS_PER_MM });
        }
        let planes = levels.planes(top)?;
        grid::set_levels(&mut corners, &planes);
        let sweep = Sweep::new(grid::spans(&corners, &mesh.triangles), planes.len());
        Ok(FromMesh {
            mesh,
            levels,
            corners,
            planes,
            sweep,
            ready: None,
            sliced: Sliced::default(),
            scratch: Mutex::default(),
        })
    }

    /// How many triangles all planes cross in all: what the time of slicing goes with.
    #[must_use]
    pub fn crossings(&self) -> u64 {
        self.sweep.crossings()
    }

    /// What was met in the layers given so far.
    #[must_use]
    pub fn sliced(&self) -> Sliced {
        self.sliced
    }

    fn cut(&self, number: usize, crossed: &[u32]) -> Result<Cut, SliceError> {
        let mut scratch = self.scratch.lock().ok().and_then(|mut s| s.pop()).unwrap_or_default();
        scratch.visited.fit(self.mesh.triangles.len());
        let surface =
            Surface { corners: &self.corners, triangles: &self.mesh.triangles, twins: &self.mesh.twins };
        let plane = Plane { number: number as u32, z: self.planes[number] };
        let contours = surface.cut(plane, crossed, &mut scratch.visited);
        let Joined { rings: joined, open, widest } = join::join(&contours.open);
        let mut rings = contours.closed;
        rings.extend(joined);
        rings.retain_mut(|ring| {
            tidy(ring);
            !ring.is_empty()
        });
        let nested = scratch.nester.nest(&rings);
        if let Ok(mut pool) = self.scratch.lock() {
            pool.push(scratch);
        }
        let layer = self.levels.empty_layer(plane.number);
        let crossing = nested.is_none();
        let part = match nested {
            Some(part) => part,
            None => match tangled(rings.iter().flat_map(|ring| ring_edges(ring)), FREE_CROSSINGS) {
                None => polygon::resolve(&rings, Inside::Positive),
                Some(crossings) => {
                    let (layer, z_mm) = (layer.number, layer.plane_mm());
                    return Err(SliceError::Tangled { layer, z_mm, crossings });
                }
            },
        };
        let layer = Layer { part, ..layer };
        Ok(Cut { layer, open, widest, crossing })
    }

    fn note(&mut self, cut: Cut) -> Layer {
        if cut.open > 0 {
            self.sliced.open_layers += 1;
            self.sliced.first_open_layer.get_or_insert(cut.layer.number);
            self.sliced.open_contours += cut.open as u64;
            self.sliced.widest_gap_mm = self.sliced.widest_gap_mm.max(cut.widest / UNITS_PER_MM);
        }
        self.sliced.crossing_layers += u32::from(cut.crossing);
        cut.layer
    }
}

impl Layers for FromMesh<'_> {
    type Error = SliceError;

    fn count(&self) -> Option<u32> {
        Some(self.planes.len() as u32)
    }

    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, SliceError> {
        let ready = self.ready.take().or_else(|| self.sweep.next());
        let Some(crossed) = ready else { return Ok(None) };
        let mut sweep = std::mem::take(&mut self.sweep);
        let cut = |n: usize| self.cut(n, crossed.by_plane(n));
        // Finding the next batch's triangles is no work to share, but it need not be waited for.
        let (cuts, ready) = rayon::join(
            || crossed.planes.clone().into_par_iter().map(cut).collect::<Vec<Result<Cut, SliceError>>>(),
            || sweep.next(),
        );
        (self.sweep, self.ready) = (sweep, ready);
        cuts.into_iter().map(|cut| Ok(self.note(cut?))).collect::<Result<_, _>>().map(Some)
    }
}

#[cfg(test)]
mod tests;
