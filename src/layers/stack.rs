//! A layer, and where layers come from.
//!
//! Layers come in batches from the plate up, so that a batch is made by all cores
//! and the whole stack never has to be in memory at once.
use super::raster::Raster;
use super::shape::Region;

/// What is solid between two heights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Layer {
    /// From 0 at the plate, without gaps.
    pub number: u32,
    /// Height where it begins, mm above the plate.
    pub bottom_mm: f64,
    /// Height where it ends, mm above the plate: the Z at which it is printed.
    pub top_mm: f64,
    /// The part.
    pub part: Region,
    /// What is printed besides and taken away later: supports, brim, wipe tower.
    /// It may overlap the part.
    pub aid: Region,
    /// The picture that it is made of, where a resin job's pictures are kept
    /// ([`super::from_images::FromImages::keeping_pictures`]).
    pub picture: Option<Raster>,
}

impl Layer {
    /// Height of the plane that stands for the layer: its middle, mm. A mesh is cut
    /// there, and heights in reports are those of the plane.
    #[must_use]
    pub fn plane_mm(&self) -> f64 {
        (self.bottom_mm + self.top_mm) / 2.0
    }

    /// Thickness, mm.
    #[must_use]
    pub fn thickness_mm(&self) -> f64 {
        self.top_mm - self.bottom_mm
    }
}

/// Where layers come from.
pub trait Layers {
    /// Why there are no more.
    type Error: std::error::Error + Send + Sync + 'static;

    /// How many layers there are in all, where that is known before the end.
    fn count(&self) -> Option<u32>;

    /// The next layers in order, at least one; `None` after the last.
    ///
    /// # Errors
    /// What was read is not what it should be; the error says where.
    fn next_batch(&mut self) -> Result<Option<Vec<Layer>>, Self::Error>;
}
