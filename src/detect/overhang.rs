//! What the overhang detectors give, and the rules that they keep.
//!
//! An overhang is a part of a layer that what lies below does not hold and that does
//! not hold itself. Detectors give [`Piece`]s layer by layer; those of neighbouring
//! layers are joined to [`OverhangRegion`]s. Knows no detector.
use crate::layers::shape::Polygon;

/// What prints with nothing under it: plain values of the material's profile.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SelfSupport {
    /// Steepest overhang that holds itself, degrees from the vertical: 0 is a wall, 90 a ceiling.
    pub angle_deg: f64,
    /// Longest span between two held ends that holds itself, mm; 0 for none.
    pub bridge_mm: f64,
    /// Regions of less area than this are listed apart, mm².
    pub min_area_mm2: f64,
}

/// How overhangs were found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Faces of the mesh by their normals.
    Normal,
    /// Polygons of neighbouring layers.
    Layer,
    /// Images of neighbouring layers.
    Image,
}

/// How far what is held spreads sideways.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Growth {
    /// Only inside the layer's own material: a gap is not jumped.
    #[default]
    Conditional,
    /// Everywhere, as a plain offset does (the failure of paper 001, Fig. 11, case 1).
    Naive,
}

/// Overhanging pieces that hang together.
#[derive(Clone, Debug, PartialEq)]
pub struct OverhangRegion {
    /// Lowest layer.
    pub layer: u32,
    /// Height of that layer's plane, mm; of a mesh's faces their lowest point.
    pub z_mm: f64,
    /// Highest layer.
    pub end_layer: u32,
    /// Height of that layer's plane, mm; of a mesh's faces their highest point.
    pub end_z_mm: f64,
    /// Area seen from below, summed over the layers, mm².
    pub area_mm2: f64,
    /// Area of the faces themselves, mm²; the same as `area_mm2` where layers were looked at.
    pub surface_mm2: f64,
    /// Centroid, weighted by area, mm.
    pub centroid_mm: [f64; 2],
    /// `[[min x, min y], [max x, max y]]`, mm.
    pub bbox_mm: [[f64; 2]; 2],
    /// Whether it holds a piece that nothing below touches: an island's first layer.
    pub island: bool,
}

/// What one overhang detector found.
#[derive(Clone, Debug, PartialEq)]
pub struct Overhangs {
    /// By which detector.
    pub method: Method,
    /// Regions of at least the smallest area asked for, by layer and then by place.
    pub regions: Vec<OverhangRegion>,
    /// Regions smaller than that, likewise.
    pub small: Vec<OverhangRegion>,
    /// Regions that are in neither list because there are more than [`MAX_REGIONS`].
    pub unlisted: u64,
    /// Area of all `regions` (and of those not listed), mm².
    pub area_mm2: f64,
    /// Area of all `small`, mm².
    pub small_area_mm2: f64,
}

/// Regions that are listed at most, so that a hostile job does not fill the memory.
pub const MAX_REGIONS: usize = 1_000_000;

/// One overhanging polygon of a layer.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// Where.
    pub polygon: Polygon,
    /// Whether it is an island that appears: nothing below touches it.
    pub island: bool,
}
