//! Islands: pieces of a layer that nothing below holds (paper 003, sections 3.1, 3.2).

/// One island: where it begins, and where it joins something that stands on the plate.
#[derive(Clone, Debug, PartialEq)]
pub struct Island {
    /// Layer in which it appears.
    pub layer: u32,
    /// Height of that layer's plane, mm.
    pub z_mm: f64,
    /// First layer in which it is no island any more because it meets a body that stands
    /// on the plate (the paper's S4); its last layer where it never does.
    pub end_layer: u32,
    /// Height of that layer's plane, mm.
    pub end_z_mm: f64,
    /// Whether it ever meets such a body.
    pub joins: bool,
    /// Area in the layer where it appears, mm².
    pub area_mm2: f64,
    /// Largest area in one layer as an island, mm²; islands that met share it.
    pub max_area_mm2: f64,
    /// Centroid in the layer where it appears, mm.
    pub centroid_mm: [f64; 2],
    /// `[[min x, min y], [max x, max y]]` in the layer where it appears, mm.
    pub bbox_mm: [[f64; 2]; 2],
}

/// What a polygon of a layer is, for pictures and for other detectors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// Joined to the plate.
    Body,
    /// An island that appears in this layer: dark blue in the paper's Figs. 8 and 10.
    Appears,
    /// An island, or several that met, on their way up: light blue.
    Island,
}
